"""Compare models of the afferents on the same observed rates.

Every model is fitted to the sinusoids of the table, then again without each
frequency, which it has to predict, all with several seeds. Written are a row a case
and seed (study.csv), the medians as tables (study.md) and a picture (study.png).
Without --drive the whole study is made: all models, pre-indentations, cells. It takes
most of an hour on one core; Ctrl-C keeps the cases that are finished.
"""

import argparse
from itertools import count
from typing import TYPE_CHECKING, Any

from fembridge.commands import Content, write_files, written
from fembridge.commands.options import (
    NUMBERS,
    STORED_FINGER,
    Several,
    Use,
    add_from,
    add_output_option,
)
from fembridge.interrupt import INTERRUPTED
from fembridge.terminal import log

if TYPE_CHECKING:
    import pandas

    from fembridge.fitting.study import Case
    from fembridge.observed import ObservedRates

EXAMPLE = "fembridge study --observed rates.csv --drive published rising -o study"

PICTURE_FILE = "study.png"

USES = (Use("--cells --preindent-um", "--drive; the study has its own", lambda args: args.drive),)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    from fembridge.api import fit

    add_from(parser, fit, "observed")
    add = parser.add_argument
    add(
        "--drive",
        action=Several,
        metavar="NAME",
        help="models to compare, of all classes that have them (default: the study)",
    )
    cells = "cells of each (default: the model's)"
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
    tried = "candidates that each search tries (default: %(default)d)"
    evaluations: dict[str, Any] = {"type": NUMBERS["evaluations"], "metavar": "N"}
    add("--evaluations", **evaluations, default=10_000, help=tried)
    processes = "processes (default: 1)"
    add("--jobs", type=NUMBERS["jobs"], metavar="N", default=1, help=processes)
    add_from(parser, fit, finger=STORED_FINGER)
    add_output_option(parser, default="study")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Study and write; the summary holds the best case of each class."""
    from pathlib import Path

    from fembridge.fitting import study as studies
    from fembridge.fitting.problem import stored_source
    from fembridge.observed import read_observed
    from fembridge.plots.fit import study_figure
    from fembridge.store import check_output

    observed = read_observed(Path(args.observed))
    cases = _cases_from(args, observed)
    check_output(args.output, studies.CASES_FILE, studies.SUMMARY_FILE, PICTURE_FILE)
    done = count(1)

    def on_case(trials: "pandas.DataFrame") -> None:
        case, median = trials.iloc[0], trials.median(numeric_only=True)
        log(
            f"{next(done)}/{len(cases)} {case['afferent']} {case['drive']}, cells "
            f"{case['cells']}, pre-indented by {case['preindent_um']:g} um: "
            f"RMSE {median['fitted_rmse_ips']:.1f} ips fitted, "
            f"{median['held_out_rmse_ips']:.1f} held out"
        )

    study = studies.study_models(
        observed,
        stored_source(args.finger or "quick").response,
        cases,
        seeds=args.seeds,
        evaluations=args.evaluations,
        jobs=args.jobs,
        on_case=on_case,
    )
    tried = len(study.cases)
    if not study.finished:
        log(f"interrupted: {tried} of {len(cases)} cases are kept")
    summary = studies.summary_text(study)
    files: dict[str, Content] = {
        studies.CASES_FILE: lambda path: studies.write_cases(path, study),
        PICTURE_FILE: study_figure(study),
        studies.SUMMARY_FILE: summary,
    }
    write_files(args.output, files)
    print(summary)
    best = {name: study.ranked(name)[0] for name in study.unfitted}
    return {
        **written(args.output, list(files)),
        "cases": tried,
        "finished": study.finished,
        "best": {
            name: {
                **trials.iloc[0][["drive", "cells", "preindent_um", "free_parameters"]],
                "held_out_rmse_ips": trials["held_out_rmse_ips"].median(),
            }
            for name, trials in best.items()
        },
        "exit_code": 0 if study.finished else INTERRUPTED,
    }


def _cases_from(args: argparse.Namespace, observed: "ObservedRates") -> "tuple[Case, ...]":
    """Cases that the options name."""
    from fembridge.fitting.fit import FitSettings
    from fembridge.fitting.problem import checked_model
    from fembridge.fitting.study import Case, default_cases
    from neural.models import MODELS

    if not args.drive:
        return default_cases(observed.afferents)
    FitSettings(cells=args.cells, evaluations=args.evaluations)  # checks both
    return tuple(
        Case(
            name,
            afferent,
            MODELS[name][afferent].cells if args.cells is None else args.cells,
            depth_um,
        )
        for name in dict.fromkeys(map(checked_model, args.drive))
        for depth_um in dict.fromkeys(args.preindent_um or (0.0,))
        for afferent in observed.afferents
        if afferent in MODELS[name]
    )
