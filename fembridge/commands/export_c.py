"""Write the encoder as one header for C99 and C++, for microcontrollers and other programs.

The header turns stress into spikes sample by sample, without memory allocation and without a
library: afferents_init, then afferents_step for each sample of the sensor. Its first comment
says how to call it and when each spike is. The spikes are those of fembridge encode in double
precision, compiled with -ffp-contract=off.
"""

import argparse
from pathlib import Path
from typing import Any

from fembridge.commands.options import NUMBERS, Several

EXAMPLE = "fembridge export-c --sensor-ms 1 -o afferents.h"

PRINTS_ITS_RESULT = True  # a text, which --quiet leaves


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    add = parser.add_argument
    add("-o", "--output", type=Path, metavar="FILE", help="write the header here, not to stdout")
    parameters = "parameter set: fitted, published (Table 2 of the paper) or a TOML file"
    add("--parameters", default="fitted", metavar="NAME", help=f"{parameters} (default: fitted)")
    precision = "type of all numbers; float for processors without double precision"
    add("--precision", choices=("double", "float"), default="double", help=precision)
    sensor = "time between two samples of the sensor; a coarser sensor is interpolated, with a "
    sensor += "delay of three samples (default: the step of the parameters)"
    add("--sensor-ms", type=NUMBERS["sensor_ms"], metavar="MS", help=sensor)
    add("--afferent", action=Several, choices=("SA", "RA", "PC"), help="classes (default: all)")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Print or write the header; the summary holds where it is, or the header."""
    from fembridge.host.store import write_text
    from neural.c_header import export_c

    header = export_c(
        args.parameters,
        precision=args.precision,
        sensor_ms=args.sensor_ms,
        afferents=args.afferent,
    )
    output: Path | None = args.output
    if output is None:
        print(header, end="")
        return {"output": None, "header": header}
    write_text(output, header)
    print(f"{output}: #include it; its first comment says how to call it")
    return {"output": str(output)}
