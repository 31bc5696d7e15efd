"""Compute many stimuli on many fingers, and write one table.

STUDY.toml lists stimuli, fingers, probes and methods; every combination is a point
(docs/sweeps.md). Each response is solved once, in a folder named by the digest of its
inputs: a stopped sweep resumes, and an extended study solves only the new points. A failed
item is listed with its cause and does not stop the others; the exit code is then 1.
"""

import argparse
from typing import Any

from fembridge.commands.options import Use, add_from, add_output_option, words_of
from fembridge.host.terminal import error_line, log
from fembridge.solver.settings import Solver

EXAMPLE = "fembridge sweep study.toml -o sweep --jobs 4"

USES = (
    Use("--scheduler", "--executor dask", lambda args: args.executor == "dask"),
    Use("--jobs", "processes made here, not for --scheduler", lambda args: args.scheduler is None),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    parser.add_argument("study", metavar="STUDY.toml", help="stimuli, fingers, probes and methods")
    add_output_option(parser, default="sweep")
    threads = "threads of each solver (default: OMP_NUM_THREADS, or the cores are shared; 1 with "
    threads += "--scheduler)"
    jobs = "processes on this machine"
    add_from(parser, Solver, jobs=("N", jobs), threads=("N", threads))
    parser.add_argument(
        "--executor",
        choices=("local", "dask"),
        default="local",
        help="processes here, or workers of dask.distributed (default: local)",
    )
    parser.add_argument(
        "--scheduler",
        metavar="tcp://HOST:PORT",
        help="of a dask cluster (default: a cluster of --jobs processes, made here)",
    )


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Sweep; the summary counts, and lists what failed."""
    from fembridge.sweeps.sweep import RESULTS_FILE, sweep

    result = sweep(**words_of(args, sweep), show_progress=True)
    failed, items = result.failed, result.items
    if failed:
        first = failed[0]
        cause = f"{len(failed)} of {items} items failed, first {first.item}: {first.cause}"
        log(error_line(cause))
    earlier = result.finished_before
    before = f", {earlier} of them earlier" if earlier else ""
    print(
        f"{items - len(failed)} of {items} items done{before}; "
        f"{RESULTS_FILE} ({len(result.results)} rows): {args.output}"
    )
    return {
        "output": args.output,
        "results": args.output / RESULTS_FILE,
        "rows": len(result.results),
        "items": items,
        "done": items - len(failed),
        "finished_before": earlier,
        "failed": [
            {"item": failure.item, "run": failure.run, "cause": failure.cause} for failure in failed
        ],
        "exit_code": 1 if failed else 0,
    }
