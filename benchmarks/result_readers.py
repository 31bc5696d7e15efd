"""Our reader of ``.frd`` files beside others, in one run.

``python -m benchmarks.result_readers`` makes a 300 MB ASCII file and its binary
twins from a recorded run, reads them in several ways, each in a fresh process and all
in turn, several rounds, and prints ratios, times, peak memory and which goals are
met, in Markdown. pyvista-frd-reader and ccx2paraview are timed where installed.

A ratio is taken within each round, so that a busy moment of the machine falls on
both sides; its median is held against the goal. Rates count the bytes a reader has
to go through: of the STRESS blocks where it can leave out the rest, of a whole
increment or the whole file where it cannot.
"""

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from benchmarks.reading_jobs import JOBS, Held
from benchmarks.result_files import ABOUT

PEAK_GOAL_MB = 150.0
GOALS_FROM_MB = 300.0
Measured = dict[str, float]
Rounds = Mapping[str, Sequence[Measured]]


def seconds(held: Held, clock: str, ours: Measured, theirs: Measured) -> float:
    """How many times as long theirs takes."""
    return theirs[clock] / ours[clock]


def seconds_for_all(held: Held, clock: str, ours: Measured, theirs: Measured) -> float:
    """`seconds`, where theirs did the short file: as if for every increment."""
    increments = held["increments"]
    share = increments["ascii"] / increments["short"]
    return share * theirs[clock] / ours[clock]


def rates(held: Held, clock: str, ours: Measured, theirs: Measured) -> float:
    """How many times as many bytes a second ours goes through."""
    own, other = (each["bytes"] / each[clock] for each in (ours, theirs))
    return own / other


@dataclass(frozen=True, slots=True)
class Ratio:
    """Two jobs, how they are set against each other, and the least that is wanted."""

    says: str
    ours: str
    theirs: str
    of: Callable[[Held, str, Measured, Measured], float]
    goal: float | None = None


RATIOS = (
    Ratio(
        "five nodes, all increments, ASCII: time of pyvista-frd-reader / ours",
        "nodes",
        "nodes_pyvista",
        seconds,
        100.0,
    ),
    Ratio(
        "five nodes, whole processes, ASCII: time of pyvista-frd-reader / ours",
        "nodes_command",
        "nodes_pyvista_command",
        seconds,
        20.0,
    ),
    Ratio(
        "five nodes, all increments, ASCII: time of ccx2paraview's conversion / ours",
        "nodes",
        "convert_ccx2paraview",
        seconds_for_all,
    ),
    Ratio(
        "all increments to .vtu, ASCII: time of ccx2paraview / ours",
        "convert",
        "convert_ccx2paraview",
        seconds,
        10.0,
    ),
    Ratio(
        "STRESS fields, ASCII: our MB/s / pyvista-frd-reader's at the last increment",
        "fields",
        "step_pyvista",
        rates,
        2.0,
    ),
    Ratio(
        "STRESS fields, ASCII: our MB/s / ccx2paraview's",
        "fields",
        "convert_ccx2paraview",
        rates,
        30.0,
    ),
    *(
        Ratio(
            f"STRESS fields, {storage}: our MB/s / {what}",
            f"fields_{storage}",
            f"{job}_{storage}",
            rates,
            goal,
        )
        for storage in ("float32", "float64")
        for job, what, goal in (
            ("read", "`read()` of the file into memory, 4 MB at a time", 0.5),
            ("pass", "`readinto()` of one block, nothing kept", None),
        )
    ),
)


def report(rounds: Rounds, held: Held, facts: Mapping[str, Any]) -> str:
    """Give the whole output."""
    absent = sorted({job.package for job in JOBS.values() if job.absent} - {None})
    repeats = len(rounds["nothing"])
    turns = "1 round" if repeats == 1 else f"{repeats} rounds"
    size_mb = rounds["list"][0]["bytes"] / 1e6
    parts = [
        f"{size_mb:.0f} MB in ASCII, {held['increments']['ascii']} increments of "
        f"{held['mesh_nodes']} nodes ({held['origin']}); "
        f"{turns}; the readers alternate, each in a new process, with the file in the page "
        "cache. Three numbers in a cell are median, minimum and maximum. "
        "pyvista-frd-reader and ccx2paraview also derive von Mises and principal "
        "stress, as our .vtu hold, and ccx2paraview writes files; neither has an option to "
        "omit this.",
        "; ".join(f"{name} {value}" for name, value in facts.items()) + ".",
    ]
    if size_mb < GOALS_FROM_MB:
        parts.append(f"The goals are for files of {GOALS_FROM_MB:g} MB and more.")
    if absent:
        parts.append(f"Not here: {', '.join(absent)}; `pip install {' '.join(absent)}`.")
    parts += [_ratios(rounds, held), _jobs(rounds)]
    return "\n\n".join(parts) + "\n"


def peak_mb(rounds: Rounds, name: str) -> float:
    """Peak memory of a job in any round, over the interpreter's own with NumPy."""
    own = statistics.median(each["peak_mb"] for each in rounds["nothing"])
    return max(each["peak_mb"] for each in rounds[name]) - own


def _ratios(rounds: Rounds, held: Held) -> str:
    lines = ["| ratio | wall time | CPU time | goal | |", "|---|---|---|---|---|"]
    for ratio in RATIOS:
        goal = "" if ratio.goal is None else f"≥ {ratio.goal:g}"
        if ratio.theirs not in rounds:
            lines.append(f"| {ratio.says} | not measured | | {goal} | |")
            continue
        pairs = list(zip(rounds[ratio.ours], rounds[ratio.theirs], strict=True))
        wall, cpu = (
            [ratio.of(held, clock, *pair) for pair in pairs] for clock in ("wall_s", "cpu_s")
        )
        verdict = ""
        if ratio.goal is not None:
            verdict = _verdict(statistics.median(wall) >= ratio.goal)
        lines.append(f"| {ratio.says} | {_three(wall)} | {_three(cpu)} | {goal} | {verdict} |")
    ours = [name for name in rounds if JOBS[name].reader == "fembridge"]
    worst = max(peak_mb(rounds, name) for name in ours)
    lines.append(
        f"| our peak memory over that of Python with NumPy, MB | {worst:.0f} | | "
        f"< {PEAK_GOAL_MB:g} | {_verdict(worst < PEAK_GOAL_MB)} |"
    )
    return "\n".join(lines)


def _jobs(rounds: Rounds) -> str:
    lines = [
        "| reader | reads | file | MB | ms | processor ms | MB/s | peak MB |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, times in rounds.items():
        if name == "nothing":
            continue
        job, megabytes = JOBS[name], times[0]["bytes"] / 1e6
        wall_ms = [1e3 * each["wall_s"] for each in times]
        cpu_ms = statistics.median(1e3 * each["cpu_s"] for each in times)
        # What seeks goes through next to nothing of the file: no rate.
        rate = job.quantities or job.reader not in ("fembridge", "pyvista-frd-reader")
        rate_mb_s = megabytes / statistics.median(wall_ms) * 1e3
        lines.append(
            f"| {job.reader} | {job.does} | {job.file} | {megabytes:.1f} | "
            f"{_three(wall_ms)} | {_digits(cpu_ms)} | "
            f"{_digits(rate_mb_s) if rate else ''} | {peak_mb(rounds, name):.0f} |"
        )
    return "\n".join(lines)


def _three(values: Sequence[float]) -> str:
    middle = statistics.median(values)
    return f"{_digits(middle)} ({_digits(min(values))}–{_digits(max(values))})"


def _digits(value: float) -> str:
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def _verdict(met: bool) -> str:
    return "met" if met else "**not met**"


ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "science" / "reading_speed.md"
MARKS = ("<!-- benchmark -->", "<!-- /benchmark -->")
MEGABYTES, QUICK_MEGABYTES = 300.0, 30.0
ROUNDS, QUICK_ROUNDS = 7, 3
_PACKAGES = ("numpy", "pyvista-frd-reader", "pyvista", "vtk", "ccx2paraview")


def python(*words: str) -> str:
    """Run this Python on a module of the repository; give what it printed."""
    paths = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    done = subprocess.run(
        [sys.executable, "-m", *words],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    return done.stdout


def measure(folder: Path, rounds: int, alone: bool) -> dict[str, list[Measured]]:
    """Do every job whose reader is here, in turn, `rounds` times."""
    names = [name for name, job in JOBS.items() if not (job.absent or (alone and job.package))]
    measured: dict[str, list[Measured]] = {name: [] for name in names}
    for number in range(1, rounds + 1):
        for name in names:
            print(f"round {number} of {rounds}: {name}", file=sys.stderr)
            out = python("benchmarks.reading_jobs", name, str(folder))
            measured[name].append(json.loads(out.splitlines()[-1]))
    return measured


def facts() -> dict[str, str]:
    """Tell the machine and the versions."""
    found = {
        "Machine:": f"{os.cpu_count()} cores, {platform.machine()}, {platform.system()}",
        "Python": platform.python_version(),
    }
    if hasattr(os, "getloadavg"):
        found["Machine:"] += f", load {os.getloadavg()[0]:.1f} before"
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def update_page(page: Path, text: str) -> None:
    """Put `text` between the marks of `page`; at its end, if it has none."""
    old = page.read_text(encoding="utf-8")
    before, opening, rest = old.partition(MARKS[0])
    _, closing, after = rest.partition(MARKS[1])
    if not opening:
        before, after = old.rstrip("\n") + "\n\n", "\n"
    elif not closing:
        raise SystemExit(f"{page}: {MARKS[0]} without {MARKS[1]}")
    new = f"{before}{MARKS[0]}\n{text.strip()}\n{MARKS[1]}{after}"
    page.write_text(new, encoding="utf-8", newline="\n")


def main() -> None:
    """Make the files, measure, print; write into the page if asked."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--megabytes", type=float, help="size of the ASCII file")
    parser.add_argument("--rounds", type=int, help=f"default {ROUNDS}")
    parser.add_argument(
        "--folder", type=Path, help="keep the files here, and take those that are here"
    )
    parser.add_argument("--source", help="a float64 result of ccx (DOUBLE) to make the files from")
    parser.add_argument("--alone", action="store_true", help="leave the readers of others out")
    parser.add_argument(
        "--quick", action="store_true", help=f"{QUICK_MEGABYTES:g} MB and {QUICK_ROUNDS} rounds"
    )
    parser.add_argument(
        "--update-docs",
        nargs="?",
        type=Path,
        const=PAGE,
        metavar="PAGE",
        help="write the output into docs/science/reading_speed.md, or PAGE",
    )
    args = parser.parse_args()
    megabytes = args.megabytes or (QUICK_MEGABYTES if args.quick else MEGABYTES)
    rounds = args.rounds or (QUICK_ROUNDS if args.quick else ROUNDS)
    with tempfile.TemporaryDirectory() as temporary:
        folder = args.folder or Path(temporary)
        print(f"making {megabytes:g} MB and twins", file=sys.stderr)
        source = ["--source", args.source] if args.source else []
        words = [str(folder), "--megabytes", str(megabytes), *source]
        python("benchmarks.result_files", *words)
        held = json.loads((folder / ABOUT).read_text(encoding="utf-8"))
        about = facts()  # the load among them, before our own
        text = report(measure(folder, rounds, args.alone), held, about)
    print(text)
    if args.update_docs:
        update_page(args.update_docs, text)


if __name__ == "__main__":
    main()
