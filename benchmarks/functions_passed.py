"""How many functions of ours a command passes, from the start of its process to its exit.

``python benchmarks/functions_passed.py [--list]``, with ccx on the PATH for the first
row: what was solved before comes from the cache, ``FEMBRIDGE_CACHE=off`` has it solved.
Counted is every distinct body of a function, method or lambda that is called and
whose file is in ``fembridge``, ``decks`` or ``neural``, on any thread. Not counted:
module top levels, class bodies, comprehensions and generator expressions, what
`dataclass` generates, and what runs in other processes.
"""

import argparse
import inspect
import json
import os
import shutil
import subprocess
import sys
import tempfile
import threading
from collections import Counter
from pathlib import Path
from types import CodeType, FrameType

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("fembridge", "decks", "neural")
RUN = ROOT / "fixtures" / "transient_sine" / "job.frd"
COMMANDS = {
    "simulate": ["simulate", "--stimulus", "noise_25_250", "-o", "out"],
    "simulate --stored": ["simulate", "--stimulus", "noise_25_250", "-o", "out", "--stored"],
    "ingest": ["ingest", str(RUN), "-o", "traces.csv"],
}
COMPREHENSIONS = {"<genexpr>", "<listcomp>", "<setcomp>", "<dictcomp>"}
PASSED = "FEMBRIDGE_FUNCTIONS_PASSED"
"""Environment of the traced process: the file that takes what it passed."""


def main() -> int:
    """Print a row a command; with ``--list`` the functions by file as well."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--list", action="store_true", help="name the functions too")
    asked = parser.parse_args()
    for name, words in COMMANDS.items():
        if name == "simulate" and shutil.which("ccx") is None:
            print(f"{name:<20} no ccx on the PATH")
            continue
        passed = functions_passed(words)
        files = Counter(function.split(":")[0] for function in passed)
        print(f"{name:<20} {len(passed):4d} functions in {len(files)} files")
        if asked.list:
            print(*(f"    {function}" for function in passed), sep="\n")
    return 0


def functions_passed(words: list[str]) -> list[str]:
    """``file:line name`` of each function that ``fembridge WORDS`` passes, sorted."""
    with tempfile.TemporaryDirectory() as folder:
        record = Path(folder) / "passed.json"
        subprocess.run(
            [sys.executable, str(Path(__file__).resolve()), *words],
            cwd=folder,
            env={**os.environ, PASSED: str(record), "PYTHONPATH": str(ROOT)},
            check=True,
            capture_output=True,
        )
        found: list[str] = json.loads(record.read_text())
    return found


def traced(words: list[str], record: Path) -> int:
    """Exit code of ``fembridge WORDS`` in this process; `record` takes what it passed."""
    seen: set[CodeType] = set()

    def note(frame: FrameType, event: str, arg: object) -> None:
        if event == "call":
            seen.add(frame.f_code)

    threading.setprofile(note)
    sys.setprofile(note)
    from fembridge.cli import main as command

    code = command(words)
    sys.setprofile(None)
    threading.setprofile(None)
    places = tuple(f"{ROOT / package}{os.sep}" for package in PACKAGES)
    passed = {
        f"{os.path.relpath(one.co_filename, ROOT)}:{one.co_firstlineno} {one.co_qualname}"
        for one in seen
        if one.co_filename.startswith(places)
        and one.co_filename.endswith(".py")
        and _is_function(one)
    }
    record.write_text(json.dumps(sorted(passed)))
    return code


def _is_function(code: CodeType) -> bool:
    of_its_own = code.co_flags & inspect.CO_OPTIMIZED  # neither a module nor a class body
    return bool(of_its_own) and code.co_name not in {
        "<genexpr>",
        "<listcomp>",
        "<setcomp>",
        "<dictcomp>",
    }


if __name__ == "__main__":
    sys.exit(traced(sys.argv[1:], Path(os.environ[PASSED])) if PASSED in os.environ else main())
