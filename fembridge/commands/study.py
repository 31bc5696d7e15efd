"""Compare models of the afferents on the same observed rates.

Every model is fitted to the sinusoids of the table, then again without each
frequency, which it has to predict, all with several seeds. Written are a row a case
and seed (study.csv), the medians as tables (study.md) and a picture (study.png).
Without --drive the whole study is made: all models, pre-indentations, cells. It takes
most of an hour on one core.
"""

import argparse
import sys
from typing import TYPE_CHECKING, Any

from fembridge.commands.options import (
    add_observed_option,
    add_output_option,
    add_stored_finger_option,
    checked_model,
)

if TYPE_CHECKING:
    from fembridge.fitting.study import Case, Finding
    from fembridge.observed import ObservedRates

EXAMPLE = "fembridge study --observed rates.csv --drive published rising -o study"

PICTURE_FILE = "study.png"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    add_observed_option(parser)
    parser.add_argument(
        "--drive",
        nargs="+",
        metavar="NAME",
        help="models to compare, of all classes that have them (default: the study)",
    )
    parser.add_argument(
        "--cells", type=int, metavar="N", help="cells of each (default: the model's)"
    )
    parser.add_argument(
        "--preindent-um",
        type=float,
        nargs="+",
        metavar="DEPTH",
        help="depths of the probe before time 0, with --drive (default: 0)",
    )
    parser.add_argument("--seeds", type=int, nargs="+", default=(1, 2, 3), help="default: 1 2 3")
    parser.add_argument(
        "--evaluations",
        type=int,
        default=10_000,
        metavar="N",
        help="candidates that each search tries (default: %(default)d)",
    )
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="processes (default: 1)")
    add_stored_finger_option(parser)
    add_output_option(parser, default="study")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Study and write; the summary holds the best case of each class."""
    from pathlib import Path

    from fembridge.fitting.problem import stored_source
    from fembridge.fitting.study import (
        CASES_FILE,
        SUMMARY_FILE,
        fitted_rmse_ips,
        held_out_rmse_ips,
        study_models,
        summary_text,
        write_cases,
    )
    from fembridge.observed import read_observed
    from fembridge.plots.study import study_figure
    from fembridge.plots.style import save_figure
    from fembridge.store import filling, write_text

    observed = read_observed(Path(args.observed))
    cases = _cases_from(args, observed)
    done: list[Finding] = []

    def on_finding(finding: "Finding") -> None:
        done.append(finding)
        case = finding.case
        print(
            f"{len(done)}/{len(cases)} {case.afferent} {case.model}, cells {case.cells}, "
            f"pre-indented by {case.preindent_um:g} um: "
            f"RMSE {finding.median(fitted_rmse_ips):.1f} ips fitted, "
            f"{finding.median(held_out_rmse_ips):.1f} held out",
            file=sys.stderr,
        )

    study = study_models(
        observed,
        stored_source(args.finger).response,
        cases,
        seeds=args.seeds,
        evaluations=args.evaluations,
        jobs=args.jobs,
        on_finding=on_finding,
    )
    output = Path(args.output)
    with filling(output, last=SUMMARY_FILE) as draft:
        write_cases(draft / CASES_FILE, study)
        save_figure(study_figure(study), draft / PICTURE_FILE)
        write_text(draft / SUMMARY_FILE, summary_text(study))
    best = {name: study.best(name) for name in study.unfitted}
    if not args.json:
        print(summary_text(study))
        print(f"{CASES_FILE}, {SUMMARY_FILE}, {PICTURE_FILE}: {output}")
    return {
        "output": args.output,
        "cases": len(cases),
        "best": {
            name: {
                "drive": one.case.model,
                "cells": one.case.cells,
                "preindent_um": one.case.preindent_um,
                "free_parameters": one.case.free_parameters,
                "held_out_rmse_ips": one.median(held_out_rmse_ips),
            }
            for name, one in best.items()
        },
    }


def _cases_from(args: argparse.Namespace, observed: "ObservedRates") -> "tuple[Case, ...]":
    """Cases that the options name."""
    from fembridge.errors import UsageError
    from fembridge.fitting.fit import FitSettings
    from fembridge.fitting.study import Case, default_cases
    from neural.models import MODELS

    if not args.drive:
        if args.cells is not None or args.preindent_um is not None:
            raise UsageError("--cells and --preindent-um go with --drive; the study has its own")
        return default_cases(observed.afferents)
    FitSettings(cells=args.cells, evaluations=args.evaluations)  # checks both
    return tuple(
        Case(
            name,
            afferent,
            MODELS[name][afferent].cells if args.cells is None else args.cells,
            depth_um,
        )
        for name in map(checked_model, args.drive)
        for depth_um in args.preindent_um or (0.0,)
        for afferent in observed.afferents
        if afferent in MODELS[name]
    )
