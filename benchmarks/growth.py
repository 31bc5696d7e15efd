"""How time and memory grow with the input: python benchmarks/growth.py [CASE SIZE].

Each case runs in a process of its own, at a size and at four times that: the ratio of
both is what counts; a machine's seconds do not. Memory is what a process has at most
beyond what it had before, as Linux counts it. On one core of 2026: `encode` of 10^7 samples
36 s and 1.2 GB, 10^5 membranes 2.1 s and 140 MB.
"""

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path

import numpy as np

GROWTH = 4
CASES = {"encode": 250_000, "trace": 250_000, "membranes": 5_000, "mentat": 100_000, "dat": 10_000}
_TRACE_HEADER = "time_ms,afferent,node,von_mises_pa\n"
_DAT_HEADER = (
    "\n stresses (elem, integ.pnt.,sxx,syy,szz,sxy,sxz,syz) for set E and time  {:.7E}\n\n"
)


def run(case: str, size: int, folder: Path) -> None:
    """One case: seconds and megabytes beside what was there before."""
    path = folder / "job.txt"
    if case in ("trace", "encode"):
        rows = (f"{k * 0.5},SA,7,{k * 37 % 9000 + 1000.25}\n" for k in range(size))
        write(path, _TRACE_HEADER, rows)
    elif case == "mentat":
        write(path, "Time\tMises Node 2\n", (f"{k}\t{k % 99}.5\n" for k in range(size)))
    elif case == "dat":
        path = folder / "job.dat"
        line = "{:10d}   1" + 6 * "  1.234567E-03" + "\n"
        rows = (line.format(k) for k in range(1, size + 1))
        write(path, _DAT_HEADER.format(0.5), rows)
    from fembridge.cli import main as fembridge
    from fembridge.io.trace_table import read_traces
    from fembridge.results.mentat import read_plot_tables
    from fembridge.results.printed import read_point_stress
    from neural import PUBLISHED, encode

    cells = size if case == "membranes" else 0
    waves = np.abs(np.sin(np.arange(400)[:, None] * 0.3 + np.arange(cells))) * 3e4
    Path("/proc/self/clear_refs").write_text("5")  # the most is what it is now
    before = resident_mb("VmRSS")
    begin = time.process_time()
    if case == "encode":
        words = [str(path), "--parameters", "published", "-o", str(folder / "out")]
        sys.stdout = sys.stderr
        assert fembridge(["encode", *words]) == 0
        sys.stdout = sys.__stdout__
    elif case == "trace":
        (trace,) = read_traces(path)
        encode(trace.stress_pa, trace.dt_ms, PUBLISHED["SA"])
    elif case == "membranes":
        encode(waves, 0.5, PUBLISHED["RA"])
    elif case == "mentat":
        read_plot_tables(path)
    else:
        read_point_stress(path)
    seconds = time.process_time() - begin
    print(seconds, resident_mb("VmHWM") - before)


def resident_mb(name: str) -> float:
    """Memory of this process: ``VmRSS`` now, ``VmHWM`` at most."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(float(line.split()[1]) for line in lines if line.startswith(name)) / 1e3


def write(path: Path, head: str, rows: Iterable[str]) -> None:
    """Write a file without having it in memory."""
    with path.open("w") as out:
        out.write(head)
        out.writelines(rows)


def measured(case: str, size: int) -> list[float]:
    """Seconds and megabytes of a case in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        words = [sys.executable, __file__, case, str(size), folder]
        said = subprocess.run(words, check=True, stdout=subprocess.PIPE, text=True).stdout
    return [float(word) for word in said.split()]


def main() -> None:
    """Print a line a case."""
    print(f"{'case':<10}{'size':>9}{'s':>8}{'MB':>8}   at {GROWTH} times the size: s, MB")
    for case, size in CASES.items():
        first_s, first_mb = measured(case, size)
        more_s, more_mb = measured(case, GROWTH * size)
        ratio = f"x {more_s / first_s:.1f}, x {more_mb / max(first_mb, 1.0):.1f}"
        print(f"{case:<10}{size:>9}{first_s:>8.2f}{first_mb:>8.0f}   {ratio}")


if __name__ == "__main__":
    if len(sys.argv) == 3:
        print("{:.1f} s, {:.0f} MB".format(*measured(sys.argv[1], int(sys.argv[2]))))
    elif len(sys.argv) > 3:
        run(sys.argv[1], int(sys.argv[2]), Path(sys.argv[3]))
    else:
        main()
