"""What many touches cost: processor time, memory and disk, two processes, kills, a scheduler.

Run it from the root of the repository: ``python -m benchmarks.many_touches``; the words after it
select measurements: ``loop``, ``presses [ROWS]``, ``linear``, ``two [ROWS]``, ``kills [ROWS]``,
``scheduler`` and ``table``. Each process uses one thread. The table in ``docs/how_to/touches.md``
has the results of ``presses 10000`` and of the others without a number.
"""

import os

os.environ["OMP_NUM_THREADS"] = "1"

import hashlib
import resource
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections import deque
from pathlib import Path

import numpy as np

import fembridge as fb
from fembridge.host.executor import dask_executor, finished
from fembridge.sweeps.dataset import MemoryStore, write_part
from fembridge.sweeps.touch_study import read_touches
from fembridge.sweeps.touch_work import Batch, Outcome
from fembridge.sweeps.touches import Plan, _part_tables, _PartWork

SLIDE = {"shape": "grating", "slide_mm_per_s": 40, "press_n": 0.3, "duration_ms": 200}
SHARED = [{**SLIDE, "population_seed": seed} for seed in range(8)]
OWN = [{"press_um": 100.0 + 10 * number} for number in range(16)]

NO_OPS = 20_000
SPIKES, SAMPLES, UNITS = 600, 26, 888  # of a press of 250 ms


def presses(rows: int) -> list[dict]:
    """Presses of 250 ms of a pin on 888 units; no two share a contact."""
    rng = np.random.default_rng(1)
    drawn = rng.uniform([100, -2, -2], [300, 2, 2], (rows, 3)).round(4)
    names = ("press_um", "x_mm", "z_mm")
    motion = {"ramp_ms": 50, "hold_ms": 130}
    return [{**dict(zip(names, row, strict=True)), **motion} for row in drawn.tolist()]


def write_csv(rows: list[dict], path: Path) -> Path:
    lines = [",".join(rows[0]), *(",".join(map(str, row.values())) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def cpu_s() -> float:
    """Processor time of this process and of those that have ended."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def peak_mb(who: int) -> float:
    return resource.getrusage(who).ru_maxrss / 1e3


def size_of(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def digests(folder: Path) -> dict[str, str]:
    """SHA-256 of every Parquet file, by its name."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*.parquet"))
    }


# ---- Measurements


def loop(_: int) -> None:
    """A loop over `fembridge.touch` that writes its folders, and one data set."""
    fb.touch(press_um=100)  # what is computed once for a pad
    for name, rows in (("one contact, 8 populations", SHARED), ("16 contacts", OWN)):
        with tempfile.TemporaryDirectory() as folder:
            begin_s = time.process_time()
            one_by_one(rows, Path(folder, "loop"))
            middle_s = time.process_time()
            fb.touch_many(rows, Path(folder, "set"), jobs=1)
            end_s = time.process_time()
            loop_s, many_s = middle_s - begin_s, end_s - middle_s
            sizes = [size_of(Path(folder, part)) for part in ("loop", "set")]
            print(
                f"{name}: loop {loop_s:.1f} s, touch_many {many_s:.1f} s of processor time, "
                f"ratio {many_s / loop_s:.2f}; {sizes[0] / 1e3:.0f} kB, {sizes[1] / 1e3:.0f} kB, "
                f"ratio {sizes[1] / sizes[0]:.2f}"
            )


def one_by_one(rows: list[dict], folder: Path) -> None:
    for number, row in enumerate(rows):
        if "slide_mm_per_s" in row:
            path = fb.Trajectory.slide(40, press_n=0.3, duration_ms=200)
            population = f"fingertip:seed={row['population_seed']}"
            result = fb.touch("grating", path, population=population)
        else:
            result = fb.touch(press_um=row["press_um"])
        result.write(folder / str(number))


def many(rows: int, jobs: int = 2) -> tuple[float, float]:
    """Time and processor time of a data set of presses by the command, in its own process."""
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder, "set")
        table = write_csv(presses(rows), Path(folder, "touches.csv"))
        words = ["sweep", str(table), "-o", str(output), "--jobs", str(jobs), "--yes"]
        begin_s, wall_s = cpu_s(), time.monotonic()
        subprocess.run(
            [sys.executable, "-m", "fembridge.cli", *words],
            check=True,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        used_s, wall_s = cpu_s() - begin_s, time.monotonic() - wall_s
        data = fb.read(output)
        largest_mb = peak_mb(resource.RUSAGE_CHILDREN)
        bytes_each, spikes_each = size_of(output) / rows, data.spikes_count / rows
        print(
            f"{rows} presses, {jobs} processes: {wall_s:.0f} s, {used_s:.0f} s of processor time, "
            f"{used_s / rows:.3f} s a touch; largest process {largest_mb:.0f} MB; "
            f"{bytes_each:.0f} bytes and {spikes_each:.0f} spikes a touch",
            flush=True,
        )
        return wall_s, used_s


def linear(_: int) -> None:
    """Processor time and memory against the number of rows."""
    for rows in (250, 500, 1000, 2000):
        many(rows)


def two(rows: int) -> None:
    """Two processes against one, in pairs; on a busy machine others take part of the second core.

    So processor times count beside the clock: what two processes take more than one is lost.
    """
    ratios, more = [], []
    for _pair in range(3):
        (one_s, one_used_s), (two_s, two_used_s) = many(rows, 1), many(rows, 2)
        ratios.append(one_s / two_s)
        more.append(two_used_s / one_used_s)
    print(f"one process / two processes: median {statistics.median(ratios):.2f} of", end=" ")
    print(", ".join(f"{ratio:.2f}" for ratio in ratios), end="; ")
    print(f"processor time of two {statistics.median(more):.2f} times that of one")


def kills(rows: int) -> None:
    """SIGKILL at ten random moments, then the same command to its end: the same bytes."""
    rng = np.random.default_rng()
    with tempfile.TemporaryDirectory() as folder:
        table = write_csv(presses(rows), Path(folder, "touches.csv"))

        def start(name: str) -> "subprocess.Popen[bytes]":
            words = ["sweep", str(table), "-o", str(Path(folder, name)), "--jobs", "2", "--yes"]
            return subprocess.Popen(
                [sys.executable, "-m", "fembridge.cli", *words],
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )

        begin_s = time.monotonic()
        assert start("whole").wait() == 0
        whole_s = time.monotonic() - begin_s
        done = []
        for _kill in range(10):
            process = start("killed")
            time.sleep(rng.uniform(1, max(2.0, whole_s / 6)))
            os.killpg(process.pid, signal.SIGKILL)
            done.append("over" if process.wait() == 0 else str(parts_done(Path(folder, "killed"))))
        assert start("killed").wait() == 0
        whole, killed = digests(Path(folder, "whole")), digests(Path(folder, "killed"))
        print(
            f"{rows} presses, parts written at each of ten kills: {', '.join(done)} of "
            f"{len(whole) // 4}; {len(whole)} files, equal: {whole == killed}"
        )


def parts_done(folder: Path) -> int:
    return len(list((folder / "touches").glob("*.parquet")))


def nothing(batch: Batch) -> list[Outcome]:
    """Outcomes of the size of those of a press, without its work."""
    spike = np.zeros(SPIKES, dtype=np.int64)
    names = tuple(f"unit {number}" for number in range(UNITS))
    forces = {name: np.zeros(SAMPLES) for name in ("time_ms", "x_mm", "z_mm", "depth_um", "force")}
    classes = ("SA",) * UNITS
    return [
        Outcome(touch, {}, classes, names, spike, spike + 1, spike * 1.0, forces)
        for touch in batch.rows
    ]


def scheduler(_: int) -> None:
    """Rows per second that a scheduler of dask and the writing process handle at most."""
    plan = Plan(read_touches(presses(NO_OPS)))
    for workers in (1, 2):
        with dask_executor(None, workers) as executor:
            batches = deque(plan.batch((touch,)) for touch in range(NO_OPS // 10))
            for _ in finished(lambda batch: executor.submit(nothing, batch), batches, 2000):
                pass  # the workers import once
            batches = deque(plan.batch((touch,)) for touch in range(NO_OPS))
            begin_s, cpu = time.monotonic(), time.process_time()
            for _, future in finished(lambda b: executor.submit(nothing, b), batches, 2000):
                future.result()
            duration_s, used_s = time.monotonic() - begin_s, time.process_time() - cpu
        print(
            f"dask, {workers} workers, {NO_OPS} rows that compute nothing: "
            f"{NO_OPS / duration_s:.0f} rows/s; of this process, with the scheduler in it, "
            f"{1e3 * used_s / NO_OPS:.2f} ms of processor time a row",
            flush=True,
        )


def table(_: int) -> None:
    """Processor time and memory of the table itself, and of writing parts."""
    rows = presses(100_000)
    begin_s, before_mb = time.process_time(), peak_mb(resource.RUSAGE_SELF)
    plan = Plan(read_touches(rows))
    plan.check()
    parts = plan.parts
    plan.about()
    used_s, more_mb = time.process_time() - begin_s, peak_mb(resource.RUSAGE_SELF) - before_mb
    print(f"table of 100000 rows: {used_s:.1f} s, {more_mb * 1e6 / 1e5:.0f} bytes a row")
    store, written = MemoryStore(), 0
    begin_s = time.process_time()
    for number in range(20):
        touches = [touch for group in parts[number] for touch in group]
        outcomes = {item.touch: item for item in nothing(plan.batch(touches))}
        work = _PartWork(set(touches), outcomes)
        write_part(store, number, _part_tables(plan, number, work))
        written += len(touches)
    used_s = time.process_time() - begin_s
    print(f"writing: {written / used_s:.0f} rows/s")


def ten_thousand(rows: int) -> None:
    many(rows)


MEASUREMENTS = {
    "loop": (loop, 0),
    "presses": (ten_thousand, 1000),
    "linear": (linear, 0),
    "two": (two, 1000),
    "kills": (kills, 1000),
    "scheduler": (scheduler, 0),
    "table": (table, 0),
}


def main() -> None:
    words = sys.argv[1:] or list(MEASUREMENTS)
    for position, word in enumerate(words):
        if word in MEASUREMENTS:
            measure, rows = MEASUREMENTS[word]
            following = words[position + 1 : position + 2]
            measure(int(following[0]) if following and following[0].isdigit() else rows)


if __name__ == "__main__":
    main()
