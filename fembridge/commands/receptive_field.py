"""Map where on the skin a probe makes units fire: areas, hot spots and thresholds of a population.

Units of each class lie below the middle of the pad; a flat round probe is pressed at each position,
by a ramp of 20 ms and a hold of 100 ms, or vibrates. The field is where the probe causes a tenth
of the impulses of the hot spot, at least one. Printed are medians and quartiles over the units.
"""

import argparse
from typing import Any

from fembridge.commands import written
from fembridge.commands.options import (
    Several,
    Use,
    add_from,
    add_output_option,
    words_of,
)

EXAMPLE = "fembridge receptive-field --afferent RA --depth-um 50,100,200 -o field"

USES = (
    Use("--endings-mm", "--afferent SA or RA", lambda args: {"SA", "RA"} & set(args.afferent)),
    Use("--sa-von-mises", "--afferent SA", lambda args: "SA" in args.afferent),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    from fembridge.touching.receptive_field import receptive_field

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
        units=("N", "units of each class, at even quantiles of its sensitivity; 1: a median unit"),
        probe_diameter_mm=("D", "diameter of the probe"),
        depth_um=("UM", "depths, or amplitudes"),
        times_threshold=("N", "further depths, as multiples of the threshold of each unit"),
        criterion=("SHARE", "share of the impulses at the hot spot that counts as a response"),
        frequency_hz=("HZ", "vibrate the probe instead of pressing it"),
        background_um=(
            "UM",
            "depth of an array of such probes, before one of them goes deeper; units have adapted "
            "to it; 0: a single probe",
        ),
        step_mm=("MM", "distance of two positions (default: 0.25, in an array 1.5 diameters)"),
        parameters=("NAME", "a set's name or a TOML file (default: fitted_pad)"),
    )
    add_output_option(parser, default="field")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Map the fields; the summary has medians and quartiles."""
    from functools import partial

    import pandas

    from fembridge.plots.style import save_figure
    from fembridge.touching.pad_file import resolve_pad
    from fembridge.touching.receptive_field import (
        AREAS_FILE,
        MAPS_FILE,
        RECORD_FILE,
        SUMMARY_FILE,
        UNITS_FILE,
        receptive_field,
        write_fields,
    )

    pad = resolve_pad(args.pad)
    fields = [
        receptive_field(**{**words_of(args, receptive_field), "afferent": name, "pad": pad})
        for name in args.afferent
    ]
    pictures = {
        f"field_{field.afferent}.png": partial(save_figure, field.plot()) for field in fields
    }
    write_fields(args.output, fields, pictures)
    summary = pandas.concat([field.summary for field in fields], ignore_index=True)
    print(summary.to_string(index=False, float_format="{:.3g}".format))
    tables = (SUMMARY_FILE, UNITS_FILE, AREAS_FILE, MAPS_FILE, RECORD_FILE)
    return {
        **written(args.output, [*pictures, *tables]),
        "summary": summary.to_dict(orient="records"),
    }
