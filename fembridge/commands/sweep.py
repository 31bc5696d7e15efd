"""Many stimuli on many fingers: solve what is not solved yet, give one table.

STUDY.toml tells stimuli, fingers, probes and methods; every combination is a point
(docs/sweeps.md). Each solve has a folder named by the digest of all that goes into
it, so nothing is solved twice: a sweep that was killed goes on where it was, and a
study that grew solves what is new. An item that fails is listed with its cause and
does not stop the others; the exit code is then 1.
"""

import argparse
import sys
from typing import TYPE_CHECKING, Any

from fembridge.commands.options import add_output_option

if TYPE_CHECKING:
    from fembridge.sweeps import Sweep

EXAMPLE = "fembridge sweep study.toml -o sweep --jobs 4"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    parser.add_argument("study", metavar="STUDY.toml", help="what is to be swept")
    add_output_option(parser, default="sweep")
    parser.add_argument(
        "--jobs", type=int, default=1, metavar="N", help="processes on this machine (default: 1)"
    )
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
    parser.add_argument(
        "--threads",
        type=int,
        metavar="N",
        help="threads of each solver (default: OMP_NUM_THREADS, or the cores are "
        "shared; 1 with --scheduler)",
    )


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Sweep; the summary counts, and lists what failed."""
    from pathlib import Path

    from fembridge.sweeps import run_sweep

    sweep = run_sweep(
        Path(args.study),
        Path(args.output),
        jobs=args.jobs,
        executor=args.executor,
        scheduler=args.scheduler,
        threads=args.threads,
        shows=True,
    )
    failed = sweep.failed
    if failed:
        first = failed[0]
        print(
            f"fembridge: {len(failed)} of {len(sweep.plan.items)} items failed, first "
            f"{first}: {sweep.causes[first.key]}",
            file=sys.stderr,
        )
    if not args.json:
        print(_told(sweep, args.output))
    return {
        "output": args.output,
        "results": str(Path(args.output) / sweep.results.name),
        "rows": sweep.rows,
        "items": len(sweep.plan.items),
        "done": len(sweep.plan.items) - len(failed),
        "finished_before": sweep.before,
        "failed": [
            {"item": str(item), "run": str(item.place), "cause": sweep.causes[item.key]}
            for item in failed
        ],
        "exit_code": 1 if failed else 0,
    }


def _told(sweep: "Sweep", output: str) -> str:
    items = len(sweep.plan.items)
    before = f", {sweep.before} of them before" if sweep.before else ""
    return (
        f"{items - len(sweep.failed)} of {items} items done{before}; "
        f"{sweep.results.name} ({sweep.rows} rows): {output}"
    )
