"""How time and memory grow with the input: python benchmarks/growth.py.

Each case runs in a process of its own, at a size and at four times that: the ratio of
both is what counts; a machine's seconds do not.
"""

import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path

import numpy as np

GROWTH = 4
CASES = {"trace": 250_000, "membranes": 5_000, "mentat": 100_000, "dat": 10_000}
_TRACE_HEADER = "time_ms,afferent,node,von_mises_pa\n"
_DAT_HEADER = (
    "\n stresses (elem, integ.pnt.,sxx,syy,szz,sxy,sxz,syz) for set E and time  {:.7E}\n\n"
)


def run(case: str, size: int, folder: Path) -> None:
    """One case: seconds and megabytes beside what was there before."""
    path = folder / "job.txt"
    if case == "trace":
        rows = (f"{k * 0.5},SA,7,{k * 37 % 9000 + 1000.25}\n" for k in range(size))
        write(path, _TRACE_HEADER, rows)
    elif case == "mentat":
        write(path, "Time\tMises Node 2\n", (f"{k}\t{k % 99}.5\n" for k in range(size)))
    elif case == "dat":
        path = folder / "job.dat"
        line = "{:10d}   1" + 6 * "  1.234567E-03" + "\n"
        rows = (line.format(k) for k in range(1, size + 1))
        write(path, _DAT_HEADER.format(0.5), rows)
    from fembridge.results.mentat import read_plot_tables
    from fembridge.results.printed import read_sections
    from fembridge.tables import read_traces
    from neural import PUBLISHED, encode

    waves = np.abs(np.sin(np.arange(400)[:, None] * 0.3 + np.arange(size))) * 3e4
    if case != "membranes":
        waves = waves[:0]
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    begin = time.process_time()
    if case == "trace":
        (trace,) = read_traces(path)
        encode(trace.stress_pa, trace.dt_ms, PUBLISHED["SA"])
    elif case == "membranes":
        encode(waves, 0.5, PUBLISHED["RA"])
    elif case == "mentat":
        read_plot_tables(path)
    else:
        read_sections(path, "stresses")
    seconds = time.process_time() - begin
    print(seconds, (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1e3)


def write(path: Path, head: str, rows: Iterable[str]) -> None:
    """Write a file without having it in memory."""
    with path.open("w") as out:
        out.write(head)
        out.writelines(rows)


def main() -> None:
    """Print a line a case."""
    print(f"{'case':<10}{'size':>9}{'s':>8}{'MB':>8}   at {GROWTH} times the size: s, MB")
    for case, size in CASES.items():
        found = []
        for count in (size, GROWTH * size):
            with tempfile.TemporaryDirectory() as folder:
                words = [sys.executable, __file__, case, str(count), folder]
                said = subprocess.run(words, check=True, capture_output=True, text=True).stdout
                found.append([float(word) for word in said.split()])
        (first_s, first_mb), (more_s, more_mb) = found
        ratio = f"x {more_s / first_s:.1f}, x {more_mb / max(first_mb, 1.0):.1f}"
        print(f"{case:<10}{size:>9}{first_s:>8.2f}{first_mb:>8.0f}   {ratio}")


if __name__ == "__main__":
    if len(sys.argv) > 1:
        run(sys.argv[1], int(sys.argv[2]), Path(sys.argv[3]))
    else:
        main()
