"""Compare models of the afferents on the same observed rates.

Each model is fitted to the sinusoids of the table, and again without each frequency,
which is then predicted; all with several seeds. Files: a row per case and seed
(study.csv), medians as tables (study.md), a picture (study.png) and a record (study.toml).
Without --drive the study is complete: all models, several pre-indentations and numbers of
cells. It takes most of an hour on one core; Ctrl-C keeps the finished cases.
"""

import argparse
from typing import Any

from fembridge.commands import written
from fembridge.commands.options import (
    NUMBERS,
    STORED_FINGER,
    Several,
    Use,
    add_from,
    add_output_option,
    add_pad_probe_options,
    pad_probe_from,
    pad_probe_use,
    words_of,
)
from fembridge.host.interrupt import INTERRUPTED

EXAMPLE = "fembridge study --observed rates.csv --drive published rising -o study"

USES = (
    Use("--cells --preindent-um", "--drive", lambda args: args.drive),
    pad_probe_use(),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    from fembridge.fitting.model_study import study

    add_from(parser, study, "observed")
    add = parser.add_argument
    add(
        "--drive",
        action=Several,
        metavar="NAME",
        help="models to compare, for all classes that have them (default: complete study)",
    )
    cells = "cells of each model (default: the number of the model)"
    add("--cells", type=NUMBERS["cells"], metavar="N", help=cells)
    add(
        "--preindent-um",
        action=Several,
        type=NUMBERS["preindent_um"],
        metavar="DEPTH",
        help="depths of the probe before time 0, with --drive (default: 0)",
    )
    add(
        "--seeds",
        action=Several,
        type=NUMBERS["seed"],
        metavar="N",
        default=[1, 2, 3],
        help="default: 1 2 3",
    )
    tried = "candidates evaluated per search (default: %(default)d)"
    evaluations: dict[str, Any] = {"type": NUMBERS["evaluations"], "metavar": "N"}
    add("--evaluations", **evaluations, default=10_000, help=tried)
    processes = "processes (default: 1)"
    add("--jobs", type=NUMBERS["jobs"], metavar="N", default=1, help=processes)
    stress = parser.add_mutually_exclusive_group()
    add_from(stress, study, "response", finger=STORED_FINGER)
    add_pad_probe_options(parser, stress)
    add_output_option(parser, default="study")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Study and write; the summary holds the best case of each class."""
    from fembridge.fitting.model_study import (
        CASES_FILE,
        PICTURE_FILE,
        RECORD_FILE,
        SUMMARY_FILE,
        study,
    )

    result = study(**{**words_of(args, study), "pad": pad_probe_from(args)})
    print(result.summary)
    best = {name: result.ranked(name)[0] for name in result.unfitted}
    return {
        **written(args.output, [CASES_FILE, RECORD_FILE, PICTURE_FILE, SUMMARY_FILE]),
        "cases": len(result.cases),
        "finished": result.finished,
        "best": {
            name: {
                **trials.iloc[0][["drive", "cells", "preindent_um", "free_parameters"]],
                "held_out_rmse_ips": trials["held_out_rmse_ips"].median(),
            }
            for name, trials in best.items()
        },
        "exit_code": 0 if result.finished else INTERRUPTED,
    }
