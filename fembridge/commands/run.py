"""Run CalculiX in run folders; only complete results are accepted.

A run is accepted if the solver reports no error, ignores no part of the deck,
converges to the end of the run and closes its result file; the exit code alone
proves nothing. Ignored cards of your own deck are listed, and the run is accepted.
Accepted results are next to the deck, with their checksums and cost in solver.toml.
A rejected run leaves its files and the cause in failed/; earlier results stay.
A folder with complete results of the same deck is skipped.
"""

import argparse
import os
from pathlib import Path
from typing import Any

from fembridge.commands.options import LIMITS, add_from, words_of
from fembridge.host.terminal import SolverBars, error_line, log

EXAMPLE = "fembridge run --jobs 2 runs/*"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    from fembridge.solver.settings import Solver

    parser.add_argument(
        "folders", nargs="+", metavar="DIR", help="run folder, as build-deck writes it"
    )
    add_from(
        parser,
        Solver,
        *LIMITS,
        stall_limit_s=("S", "stop a run whose files have not grown for S seconds"),
        iteration_limit=("N", "stop a run after N iterations of one increment"),
    )
    force = "solve also folders with complete results, without the cache"
    parser.add_argument("--force", action="store_true", help=force)


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Run; the summary has a row for each folder, `exit_code` is 1 if one failed."""
    from fembridge.errors import UsageError
    from fembridge.solver.ccx import run_folders
    from fembridge.solver.settings import Solver

    for folder in args.folders:
        if not os.path.lexists(folder):
            problem = "no such folder; fembridge build-deck makes run folders"
            raise UsageError(problem, Path(folder))
    with SolverBars() as bars:
        options = {**words_of(args, Solver), "cache": args.cache and not args.force}
        settings = Solver(**options, on_progress=bars)
        outcomes = run_folders(map(Path, args.folders), settings, force=args.force)
    for outcome in outcomes:
        if not outcome.accepted:
            log(error_line(" ".join(str(outcome.to_error()).split())))
        else:
            print(outcome)
        for message in outcome.warnings:
            log(f"{outcome.folder}: CalculiX warned: {message}")
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
