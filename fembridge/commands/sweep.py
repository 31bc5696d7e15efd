"""Many stimuli on many fingers: solve what is not solved yet, give one table.

STUDY.toml lists stimuli, fingers, probes and methods; every combination is a point
(docs/sweeps.md). Each solve has a folder named by the digest of all that goes into
it, so nothing is solved twice: a sweep that was killed resumes, and a
study that grew solves what is new. An item that fails is listed with its cause and
does not stop the others; the exit code is then 1.
"""

import argparse
from typing import Any

from fembridge.commands.options import Use, add_from, add_output_option, words_of
from fembridge.solver.settings import SolverSettings
from fembridge.terminal import error_line, log

EXAMPLE = "fembridge sweep study.toml -o sweep --jobs 4"

USES = (
    Use("--scheduler", "--executor dask", lambda args: args.executor == "dask"),
    Use("--jobs", "processes made here, not for --scheduler", lambda args: args.scheduler is None),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    parser.add_argument("study", metavar="STUDY.toml", help="what is to be swept")
    add_output_option(parser, default="sweep")
    threads = "threads of each solver (default: OMP_NUM_THREADS, or the cores are shared; 1 with "
    threads += "--scheduler)"
    jobs = "processes on this machine"
    add_from(parser, SolverSettings, jobs=("N", jobs), threads=("N", threads))
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
    from fembridge.sweeps.sweep import sweep

    done = sweep(**words_of(args, sweep), shows=True)
    failed, items = done.failed, len(done.plan.items)
    if failed:
        first = failed[0]
        cause = f"{len(failed)} of {items} items failed, first {first}: {done.causes[first.key]}"
        log(error_line(cause))
    before = f", {done.before} of them before" if done.before else ""
    print(
        f"{items - len(failed)} of {items} items done{before}; "
        f"{done.results.name} ({done.rows} rows): {args.output}"
    )
    return {
        "output": args.output,
        "results": args.output / done.results.name,
        "rows": done.rows,
        "items": items,
        "done": items - len(failed),
        "finished_before": done.before,
        "failed": [
            {"item": str(item), "run": item.place, "cause": done.causes[item.key]}
            for item in failed
        ],
        "exit_code": 1 if failed else 0,
    }
