"""Our reader of ``.frd`` files beside others, in one run.

``python -m benchmarks.result_readers`` makes a 300 MB ASCII file and its binary
twins from a recorded run, reads them in several ways, each in a fresh process and all
in turn, several rounds, and prints ratios, times, peak memory and which goals are
met, in Markdown. pyvista-frd-reader and ccx2paraview are timed where installed.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path

from benchmarks.reading_jobs import JOBS
from benchmarks.reading_table import Measured, report
from benchmarks.result_files import ABOUT

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "results.md"
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
            out = python("benchmarks.reading_process", name, str(folder))
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
        help="write the output into docs/results.md, or PAGE",
    )
    args = parser.parse_args()
    if find_spec("resource") is None:
        raise SystemExit("peak memory comes from getrusage, which this system lacks")
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
