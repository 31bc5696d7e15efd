"""Find the gain of a robot's sensor from one press of known force or depth.

The table has a column of time and one or several of values, and begins before the press; columns
are recognised, or named by --columns. The object that pressed the sensor is pressed on the
fingertip of `fembridge touch`: the stress of SA, RA and PC afferents below it, divided by the
signal of the press, is the gain of each class, in Pa for 1 unit of the sensor. The signal without
load is the offset. The output is a small TOML file, which encode --calibration reads.
"""

import argparse
import shlex
from pathlib import Path
from typing import Any

from fembridge.commands.options import Several, add_from, parse_column

EXAMPLE = "fembridge calibrate press.csv --force-n 0.05"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    from fembridge.simulation.calibrate import calibrate

    add = parser.add_argument
    add("press", type=Path, metavar="CSV", help="table of one press")
    add(
        "-o",
        "--output",
        type=Path,
        default=Path("calibration.toml"),
        metavar="FILE",
        help="default: calibration.toml",
    )
    add_from(
        parser,
        calibrate,
        force_n=("N", "largest force of the press"),
        depth_um=("UM", "instead: depth to which the object would press a fingertip"),
        shape=(
            "SHAPE",
            "the object, as in touch: plate, ball:diameter_mm=5; punch is a pin of 1 mm",
        ),
    )
    add_from(parser, calibrate, "pad")
    add(
        "--columns",
        action=Several,
        type=parse_column,
        metavar="time=NAME,value=NAME",
        help="columns: time (in s, or as its name ends: _ms, _us) or time_ms, and value",
    )


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Calibrate and write; the summary has the gains, the offset and the press."""
    from fembridge.commands.encode import columns_by_key
    from fembridge.simulation.calibrate import calibrate

    calibration = calibrate(
        args.press,
        force_n=args.force_n,
        depth_um=args.depth_um,
        shape=args.shape,
        pad=args.pad,
        columns=columns_by_key(args.columns),
    )
    calibration.write(args.output)
    press = calibration.provenance
    print(
        f"{press['column']}: the press changes it by {press['change']:.6g}; "
        f"{press['force_n']:.3g} N is {press['depth_um']:.4g} um deep"
    )
    for name, gain in calibration.gain_pa.items():
        print(f"  {name}: {press['stress_pa'][name]:.4g} Pa, gain {gain:.6g} Pa for 1")
    for name, offset in calibration.offset.items():
        print(f"  {name}: {offset:.6g} without load")
    print(
        f"{args.output}: --calibration of encode; the gains alone: --gain-pa {calibration.option}"
    )
    return {
        "output": str(args.output),
        "gain_pa": dict(calibration.gain_pa),
        "offset": dict(calibration.offset),
        "parameters": calibration.parameters,
        "press": calibration.provenance,
        "next": [
            f"fembridge encode {shlex.quote(str(args.press))} --calibration "
            f"{shlex.quote(str(args.output))}"
        ],
    }
