"""Where on the skin a probe makes an afferent fire: area against depth, and maps.

The median afferent of each class lies under the middle of the pad; a flat round probe is
put on everywhere, by a ramp of 20 ms and a hold of 100 ms, or vibrates. Written are
  areas.csv      afferent,depth_um,area_mm2,whole
  fields.csv     afferent,depth_um,x_mm,z_mm,impulses
  field_RA.png   the maps of a class, and its area against depth
The field is where the probe gives a tenth of the impulses of the hot spot, one at least;
`whole` is false where it goes on beyond the part of the pad that may be touched.
"""

import argparse
from typing import Any

from fembridge.commands import Content, write_files, written
from fembridge.commands.options import (
    Several,
    Use,
    add_from,
    add_output_option,
    words_of,
)

EXAMPLE = "fembridge receptive-field --afferent RA --depth-um 100,200,400 -o field"

USES = (
    Use("--endings-mm", "--afferent SA or RA", lambda args: {"SA", "RA"} & set(args.afferent)),
    Use("--sa-von-mises", "--afferent SA", lambda args: "SA" in args.afferent),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    from fembridge.touching.field import receptive_field

    parser.add_argument(
        "--afferent",
        action=Several,
        type=str.upper,
        choices=("SA", "RA", "PC"),
        default=["SA", "RA", "PC"],
        help="default: all three",
    )
    add_from(
        parser,
        receptive_field,
        "endings_mm",
        "sa_von_mises",
        "pad",
        probe_diameter_mm=("D", ""),
        depth_um=("UM", "depths, or amplitudes"),
        times_threshold=("N", "further depths, as multiples of threshold"),
        criterion=("SHARE", "share of the hot spot's impulses"),
        frequency_hz=("HZ", "the probe vibrates in place of the press"),
        step_mm=("MM", ""),
        parameters=("NAME", "a set's name or a TOML file (default: fitted_pad)"),
    )
    add_output_option(parser, default="field")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Map the fields; the summary holds areas and thresholds."""
    import pandas

    from fembridge.plots.field import field_figure
    from fembridge.touching.field import receptive_field
    from fembridge.touching.pad_file import pad_named

    pad = pad_named(args.pad)
    fields = [
        receptive_field(**{**words_of(args, receptive_field), "afferent": name, "pad": pad})
        for name in args.afferent
    ]
    areas = pandas.concat([field.areas for field in fields], ignore_index=True)
    maps = pandas.concat([field.to_frame() for field in fields], ignore_index=True)
    thresholds = {field.afferent: field.threshold_um for field in fields}
    files: dict[str, Content] = {
        **{f"field_{field.afferent}.png": field_figure(field) for field in fields},
        "fields.csv": maps,
        "areas.csv": areas,
    }
    write_files(args.output, files)
    print(areas.to_string(index=False))
    words = ", ".join(f"{name} {depth:.3g} um" for name, depth in thresholds.items())
    print(f"thresholds: {words}")
    return {
        **written(args.output, list(files)),
        "threshold_um": thresholds,
        "areas": areas.to_dict(orient="records"),
    }
