"""Run CalculiX in run folders, and accept only results that are whole.

A run is accepted when the solver reports no error, left no part of the deck
out, converged at the end of the run, and closed its result file; the exit code
alone proves nothing. What it leaves out of your own deck is named, and the run
accepted. Accepted results are beside the deck with solver.toml, which says what
they answer and cost. A run that is not accepted leaves its files and the cause
in failed/ and touches no earlier result. A folder whose results are whole and
of the same deck is skipped.
"""

import argparse
import os
from typing import Any

from fembridge.commands.options import LIMITS, add_options, words_of
from fembridge.solver.settings import ITERATION_LIMIT, STALL_LIMIT_S

EXAMPLE = "fembridge run --jobs 2 runs/*"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    parser.add_argument(
        "folders", nargs="+", metavar="DIR", help="run folder, as build-deck writes it"
    )
    add_options(parser, LIMITS)
    for name, kind, default, metavar, when in (
        ("--stall-limit", float, STALL_LIMIT_S, "S", "when no file has grown for so long"),
        ("--iteration-limit", int, ITERATION_LIMIT, "N", "an increment after so many iterations"),
    ):
        text = f"give up {when} (default: %(default)g)"
        parser.add_argument(name, type=kind, default=default, metavar=metavar, help=text)
    parser.add_argument("--force", action="store_true", help="run also where whole results are")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Run; the summary has a row a folder, `exit_code` is 1 when one failed."""
    from fembridge import api
    from fembridge.errors import UsageError
    from fembridge.terminal import SolverBars, error_line, log

    for folder in args.folders:
        if not os.path.lexists(folder):
            raise UsageError(f"{folder}: no such folder; fembridge build-deck makes run folders")
    with SolverBars() as bars:
        outcomes = api.run(
            **{**words_of(args, api.run), "cache": args.cache and not args.force},
            stall_limit_s=args.stall_limit,
            on_progress=bars,
        )
    for outcome in outcomes:
        if not outcome.accepted:
            log(error_line(" ".join(str(outcome.to_error()).split())))
        elif not args.json:
            print(outcome)
        for words in outcome.warnings:
            log(f"{outcome.folder}: CalculiX warned: {words}")
        if outcome.accepted and not outcome.as_built:
            log(f"{outcome.folder}: the deck was changed since run.toml was written")
    failed = sum(not outcome.accepted for outcome in outcomes)
    return {
        "count": len(outcomes),
        "failed": failed,
        "skipped": sum(outcome.skipped for outcome in outcomes),
        "runs": [outcome.to_record() for outcome in outcomes],
        "exit_code": 1 if failed else 0,
    }
