"""One job, timed alone in a process of its own.

``python -m benchmarks.reading_process JOB FOLDER`` prints one line of JSON: wall and
processor seconds, bytes gone through for that, and the peak of resident memory
(``ru_maxrss``) after warming up and at the end. Before the clock starts the job does
the same with a file of two increments, so that imports and first calls are done, and
the file it is timed on is read once, so that it lies in the page cache. What a reader
gives at five nodes is held against what the file was made of: a wrong number ends
the benchmark.
"""

import json
import resource
import sys
import time
from pathlib import Path

import numpy as np

from benchmarks.reading_jobs import JOBS, Answer, Held, storage_of
from benchmarks.result_files import ABOUT

RTOL = 1e-3  # of the largest component: tells a wrong record, not a rounding
SETTLE_S = 0.2  # NumPy's threads spin for a while before they sleep
_BLOCK_BYTES = 1 << 16
_KB_PER_MB = 1e6 / 1024


def measured(name: str, folder: Path) -> dict[str, float]:
    """Do the job once, after warming up."""
    job, held = JOBS[name], json.loads((folder / ABOUT).read_text(encoding="utf-8"))
    path = folder / f"{job.file}.frd"
    check(job.prepare(folder / f"first_{storage_of(job.file)}.frd", held)(), held)
    with path.open("rb", buffering=0) as file:
        while file.read(_BLOCK_BYTES):
            pass
    time.sleep(SETTLE_S)
    warm_mb = peak_mb()
    task = job.prepare(path, held)
    wall, cpu = time.perf_counter(), processor_s()
    answer = task()
    wall, cpu = time.perf_counter() - wall, processor_s() - cpu
    check(answer, held)
    return {
        "wall_s": wall,
        "cpu_s": cpu,
        "bytes": job.bytes_read(held, path),
        "warm_mb": warm_mb,
        "peak_mb": peak_mb(),
    }


def check(answer: Answer, held: Held) -> None:
    """Hold what a reader gave against what the file was made of."""
    for row, found in answer:
        tensor = np.array(held["stress_mpa"][row])
        expected = tensor if found.ndim == 2 else von_mises(tensor)
        allowed = RTOL * np.abs(tensor).max(axis=1)
        wrong = np.abs(found - expected).reshape(len(tensor), -1).max(axis=1) > allowed
        if wrong.any():
            node = held["nodes"][int(np.flatnonzero(wrong)[0])]
            raise ValueError(f"node {node}, increment {row + 1}: a wrong number")


def von_mises(tensor: np.ndarray) -> np.ndarray:
    """Give von Mises stress of ``(N, 6)``, order xx yy zz xy yz zx."""
    xx, yy, zz, *shear = tensor.T
    normal = (xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2
    return np.sqrt(normal / 2 + 3 * sum(each**2 for each in shear))


def processor_s() -> float:
    """Seconds that the processors gave to this process and its children."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def peak_mb() -> float:
    """Peak of resident memory, of this process or a child of it."""
    who = resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN
    peak = max(resource.getrusage(each).ru_maxrss for each in who)
    return peak / 1e6 if sys.platform == "darwin" else peak / _KB_PER_MB


if __name__ == "__main__":
    print(json.dumps(measured(sys.argv[1], Path(sys.argv[2]))))
