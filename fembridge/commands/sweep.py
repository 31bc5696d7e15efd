"""Compute many stimuli on many fingers, or many touches, and write one table or data set.

STUDY.toml lists stimuli, fingers, probes and methods; every combination is a point
(docs/how_to/sweeps.md). Each response is solved once, in a folder named by the digest of its
inputs: a stopped sweep resumes, and an extended study solves only the new points. A failed
item is listed with its cause and does not stop the others; the exit code is then 1.

A study with [touches], or a table .csv or .parquet with a row per touch, gives a data set of
Parquet files (docs/how_to/touches.md); a longer table adds its further rows. "sweep status DIR"
reports how far it is, "sweep resume DIR" runs what is missing or has failed, "sweep verify DIR"
runs a random part again and compares.
"""

import argparse
from datetime import timedelta
from pathlib import Path
from typing import Any

from fembridge.commands.options import NUMBERS, Use, add_from, words_of
from fembridge.errors import UsageError
from fembridge.host.terminal import error_line, log
from fembridge.solver.settings import Solver

EXAMPLE = "fembridge sweep study.toml -o sweep --jobs 4"

STATUS, VERIFY, RESUME = "status", "verify", "resume"
_OF_DATA_SETS = (STATUS, VERIFY, RESUME)
_MOST_CAUSES = 5

USES = (
    Use(
        "--jobs",
        "processes made here, not for --scheduler or status",
        lambda args: args.scheduler is None and args.study != STATUS,
    ),
    Use("--output", "a study or table", lambda args: args.study not in _OF_DATA_SETS),
    Use(
        "--executor --scheduler",
        "a sweep, not for status or verify",
        lambda args: args.study not in (STATUS, VERIFY),
    ),
    Use("--scheduler", "--executor dask", lambda args: args.executor == "dask"),
    Use("--yes", "touches", lambda args: args.study == RESUME or _is_of_touches(args)),
    Use("--forces-step-ms", "a study or table of touches", lambda args: _is_of_touches(args)),
    Use(
        "--threads",
        "a solver, not for touches",
        lambda args: args.study not in _OF_DATA_SETS and not _is_of_touches(args),
    ),
    Use("--percent", "verify", lambda args: args.study == VERIFY),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    from fembridge.sweeps.touches import FORCES_STEP_MS

    study = "stimuli, fingers, probes and methods, or touches; a table of touches, .csv or "
    study += ".parquet; status, resume or verify"
    parser.add_argument("study", metavar="STUDY.toml", help=study)
    folder = "data set, for status, resume and verify"
    parser.add_argument("folder", metavar="DIR", nargs="?", help=folder)
    output = "folder; of touches also an address, s3://bucket/set (default: sweep)"
    parser.add_argument("-o", "--output", metavar="DIR", default="sweep", help=output)
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
    step = f"of touches: step of the depths and forces; 0: none (default: {FORCES_STEP_MS:g})"
    parser.add_argument(
        "--forces-step-ms",
        type=NUMBERS["forces_step_ms"],
        default=FORCES_STEP_MS,
        metavar="MS",
        help=step,
    )
    yes = "run touches that take more than ten minutes"
    parser.add_argument("--yes", action="store_true", help=yes)
    percent = "share of the touches that verify runs again (default: 1)"
    parser.add_argument(
        "--percent", type=NUMBERS["percent"], default=1.0, metavar="P", help=percent
    )


def _is_of_touches(args: argparse.Namespace) -> bool:
    """Whether the study is one of touches."""
    from fembridge.sweeps.touch_study import is_touch_study

    return args.study not in _OF_DATA_SETS and is_touch_study(Path(args.study))


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Sweep; the summary counts, and lists what failed."""
    if args.study in _OF_DATA_SETS:
        if args.folder is None:
            raise UsageError("is missing", argument="DIR", expected="the folder of a data set")
        if args.study == RESUME:
            return _resume(args)
        return _status(args.folder) if args.study == STATUS else _verify(args)
    if args.folder is not None:
        problem = f"is {args.folder!r}, expected it after status, resume or verify only"
        raise UsageError(problem, argument="DIR", found=args.folder)
    if _is_of_touches(args):
        return _touch_many(args)
    args.output = Path(args.output)
    return _sweep(args)


def _sweep(args: argparse.Namespace) -> dict[str, Any]:
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


def _resume(args: argparse.Namespace) -> dict[str, Any]:
    from fembridge.sweeps.dataset import read_about, store_of
    from fembridge.sweeps.touches import FORCES_STEP_MS

    read_about(store_of(args.folder))  # a path without a data set is no table either
    args.study, args.output, args.forces_step_ms = args.folder, None, FORCES_STEP_MS
    return _touch_many(args)


def _touch_many(args: argparse.Namespace) -> dict[str, Any]:
    from fembridge.sweeps.touches import touch_many

    result = touch_many(args.study, **words_of(args, touch_many), show_progress=True)
    output = args.study if args.output is None else args.output
    failed, rows = result.failed, int(result.about["rows"])
    if failed:
        touch, cause = next(iter(failed.items()))
        log(error_line(f"{len(failed)} of {rows} touches failed, first {touch}: {cause}"))
    spikes = result.spikes_count
    print(f"{rows - len(failed)} of {rows} touches done, {spikes} spikes: {output}")
    return {
        "output": output,
        "rows": rows,
        "done": rows - len(failed),
        "spikes": spikes,
        "failed": [{"touch": touch, "cause": cause} for touch, cause in failed.items()],
        "exit_code": 1 if failed else 0,
    }


def _status(folder: str) -> dict[str, Any]:
    from dataclasses import asdict

    from fembridge.sweeps.dataset import Touches
    from fembridge.sweeps.touches import touches_status

    state = touches_status(folder)
    text = f"{state.done} of {state.rows} touches done, {state.failed} failed; "
    text += f"{state.parts_done} of {state.parts} parts written"
    if state.is_running and state.per_s is not None and state.left_s is not None:
        text += f"; {state.per_s:.3g}/s, {timedelta(seconds=round(state.left_s))} left"
    elif not state.is_running and state.parts_done < state.parts:
        text += f"; no process is at work: fembridge sweep resume {folder}"
    print(text)
    failed = Touches.read(folder).failed if state.failed else {}
    for touch, cause in list(failed.items())[:_MOST_CAUSES]:
        print(f"touch {touch} failed: {cause}")
    if len(failed) > _MOST_CAUSES:
        print(f"{len(failed) - _MOST_CAUSES} more, in the column cause of touches")
    return asdict(state)


def _verify(args: argparse.Namespace) -> dict[str, Any]:
    from fembridge.sweeps.touches import verify_touches

    check = verify_touches(args.folder, args.percent, jobs=args.jobs)
    print(f"{len(check.checked)} touches run again: {', '.join(map(str, check.checked[:20]))}")
    if check.skipped:
        print(f"{check.skipped} selected touches of Python objects cannot run again")
    for touch, problem in check.different.items():
        log(error_line(f"touch {touch}: {problem}"))
    for name in check.damaged:
        log(error_line(f"{args.folder}/{name}: not the file that was written"))
    is_sound = not (check.different or check.damaged)
    if is_sound:
        print("equal, and all files are as they were written")
    return {
        "checked": list(check.checked),
        "different": {str(touch): problem for touch, problem in check.different.items()},
        "damaged": list(check.damaged),
        "skipped": check.skipped,
        "exit_code": 0 if is_sound else 1,
    }
