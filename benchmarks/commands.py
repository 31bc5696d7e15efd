"""How long the commands take with process start: ``python -m benchmarks.commands``.

Each is run several times in a fresh process; the median, the extremes and the
goal are printed as a Markdown table. Needs fembridge installed beside this Python.
"""

import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

RUNS = 5
_NOISE = ("--stimulus", "noise_25_250_10")
# Name, words after `fembridge`, goal in seconds, and whether ccx may be seen.
COMMANDS = (
    ("--help", ["--help"], 0.25, True),
    ("stimuli", ["stimuli"], 0.25, True),
    ("build-deck, five decks", ["build-deck", "--stimulus", "noise_25_250"], 2, True),
    (
        "build-deck, Marc, paper",
        ["build-deck", *_NOISE, "--solver", "marc", "--finger", "paper"],
        2,
        True,
    ),
    ("simulate all, stored", ["simulate", "--stimulus", "all", "--stored"], 5, False),
    ("simulate all, solved", ["simulate", "--stimulus", "all"], 60, True),
)


def seconds(words: list[str], with_ccx: bool) -> float:
    """Wall time of one run in an empty folder."""
    environment = dict(os.environ)
    environment["PYTHONPATH"] = str(Path(__file__).parents[1])
    if not with_ccx:
        environment["PATH"] = str(Path(sys.executable).parent)
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        subprocess.run(
            [sys.executable, "-m", "fembridge.cli", *words],
            cwd=folder,
            env=environment,
            check=True,
            capture_output=True,
        )
        return time.perf_counter() - start


def main() -> None:
    """Time every command and print the table."""
    print("| command | median s | least | most | goal s |")
    print("|---|---|---|---|---|")
    for name, words, goal_s, with_ccx in COMMANDS:
        if name.endswith("solved") and shutil.which("ccx") is None:
            print(f"| {name} | no ccx on the PATH | | | {goal_s} |")
            continue
        times = [seconds(words, with_ccx) for _ in range(RUNS)]
        print(
            f"| {name} | {statistics.median(times):.2f} | {min(times):.2f} | "
            f"{max(times):.2f} | {goal_s} |"
        )


if __name__ == "__main__":
    main()
