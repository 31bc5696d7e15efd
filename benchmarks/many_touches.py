"""Processor time and size of many touches, compared with a loop over `fembridge.touch`.

Run it from the root of the repository: ``python -m benchmarks.many_touches``. One core. A grating
slides over the fingertip under eight populations, so that all touches share one contact; and a pin
is pressed at sixteen depths, so that none do.
"""

import os

os.environ["OMP_NUM_THREADS"] = "1"

import tempfile
import time
from pathlib import Path

import fembridge as fb

SLIDE = {"shape": "grating", "slide_mm_per_s": 40, "press_n": 0.3, "duration_ms": 200}
SHARED = [{**SLIDE, "population_seed": seed} for seed in range(8)]
OWN = [{"press_um": 100.0 + 10 * number} for number in range(16)]


def one_by_one(rows: list[dict], folder: Path) -> None:
    for number, row in enumerate(rows):
        if "slide_mm_per_s" in row:
            path = fb.Trajectory.slide(40, press_n=0.3, duration_ms=200)
            population = f"fingertip:seed={row['population_seed']}"
            result = fb.touch("grating", path, population=population)
        else:
            result = fb.touch(press_um=row["press_um"])
        result.write(folder / str(number))


def size_of(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def main() -> None:
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


if __name__ == "__main__":
    main()
