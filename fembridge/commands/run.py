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

from fembridge.commands.options import LIMITS, add_from, words_of
from fembridge.terminal import SolverBars, error_line, log

EXAMPLE = "fembridge run --jobs 2 runs/*"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    from fembridge import api

    parser.add_argument(
        "folders", nargs="+", metavar="DIR", help="run folder, as build-deck writes it"
    )
    add_from(
        parser,
        api.run,
        *LIMITS,
        stall_limit_s=("S", "give up when no file has grown for so long"),
        iteration_limit=("N", "give up an increment after so many iterations"),
        force="run also where whole results are",
    )


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Run; the summary has a row a folder, `exit_code` is 1 when one failed."""
    from fembridge import api
    from fembridge.errors import UsageError

    for folder in args.folders:
        if not os.path.lexists(folder):
            raise UsageError(f"{folder}: no such folder; fembridge build-deck makes run folders")
    with SolverBars() as bars:
        outcomes = api.run(
            **{**words_of(args, api.run), "cache": args.cache and not args.force},
            on_progress=bars,
        )
    for outcome in outcomes:
        if not outcome.accepted:
            log(error_line(" ".join(str(outcome.to_error()).split())))
        else:
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
