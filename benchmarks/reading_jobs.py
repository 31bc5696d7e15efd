"""What is timed: each job reads a file in one way, alone in a process of its own.

`Job.prepare` is not timed, what it gives is.
``python -m benchmarks.reading_jobs JOB FOLDER`` prints one line of JSON: wall and
processor seconds, bytes gone through for that, and the peak of resident memory
(``ru_maxrss``) after warming up and at the end. Before the clock starts the job does
the same with a file of two increments, so that imports and first calls are done, and
the file it is timed on is read once, so that it lies in the page cache. What a reader
gives at five nodes is held against what the file was made of: a wrong number ends
the benchmark.
"""

import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.result_files import ABOUT

BLOCK_BYTES = 1 << 22
Held = dict[str, Any]
Answer = list[tuple[int, np.ndarray]]  # row of the increment, (node, 6) or (node,)
Task = Callable[[], Answer]


@dataclass(frozen=True, slots=True)
class Job:
    """`prepare(path, held)` gives what is timed; the file is ``{file}.frd``."""

    reader: str
    does: str
    file: str
    prepare: Callable[[Path, Held], Task]
    quantities: tuple[str, ...] = ()  # whose bytes count; none: the whole file
    one_increment: bool = False
    package: str | None = None
    module: str | None = None

    @property
    def absent(self) -> bool:
        """Whether its reader is not installed."""
        return self.module is not None and find_spec(self.module) is None

    def bytes_read(self, held: Held, path: Path) -> int:
        """Bytes that the job has to go through."""
        if not self.quantities:
            return path.stat().st_size
        size = sum(held["record_bytes"][storage_of(self.file)][name] for name in self.quantities)
        return size if self.one_increment else size * held["increments"][self.file]


def storage_of(file: str) -> str:
    """How the numbers of `file` are stored."""
    return "ascii" if file == "short" else file


def ours_at_nodes(path: Path, held: Held) -> Task:
    """``fembridge.read``: von Mises stress at five nodes."""
    import fembridge

    def task() -> Answer:
        traces = fembridge.read(path, held["nodes"])
        stress_mpa = np.stack([trace.stress_pa for trace in traces], axis=1) / 1e6
        return list(enumerate(stress_mpa))

    return task


def ours_fields(path: Path, held: Held) -> Task:
    """``fembridge.read_fields``: STRESS at every node, an increment at a time."""
    import fembridge

    def task() -> Answer:
        return [
            (row, field.values[held["rows"]] / 1e6)
            for row, field in enumerate(fembridge.read_fields(path, "STRESS"))
        ]

    return task


def ours_list(path: Path, held: Held) -> Task:
    """Describe a file, as ``--list`` does, without the start of a process."""
    from fembridge.results import describe

    def task() -> Answer:
        found = [each["increments"] for each in describe(path)["quantities"]]
        if set(found) != {increments_in(path, held)}:
            raise ValueError(f"{path}: --list finds {found} increments")
        return []

    return task


def list_command(path: Path, held: Held) -> Task:
    """``fembridge ingest --list`` with the start of its process."""
    words = [sys.executable, "-m", "fembridge.cli", "ingest", str(path), "--list"]

    def task() -> Answer:
        subprocess.run(words, check=True, stdout=subprocess.DEVNULL)
        return []

    return task


def ours_at_nodes_command(path: Path, held: Held) -> Task:
    """`ours_at_nodes` with the start of its process and the imports."""
    return _process(f"import fembridge; fembridge.read({str(path)!r}, {held['nodes']})")


def pyvista_at_nodes_command(path: Path, held: Held) -> Task:
    """`pyvista_at_nodes` with the start of its process and the imports."""
    arguments = f"Path({str(path)!r}), {{'rows': {held['rows']}}}"
    return _process(
        "from pathlib import Path; from benchmarks.reading_jobs import pyvista_at_nodes; "
        f"pyvista_at_nodes({arguments})()"
    )


def _process(code: str) -> Task:
    def task() -> Answer:
        subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.DEVNULL)
        return []

    return task


def pyvista_at_nodes(path: Path, held: Held) -> Task:
    """Open, then read each increment and take five rows of its von Mises stress."""
    import pyvista_frd

    def task() -> Answer:
        reader = pyvista_frd.FRDReader(str(path))
        answer = []
        for row in range(reader.number_time_points):
            reader.set_active_time_point(row)
            data = reader.read().point_data
            answer.append((row, np.asarray(data["STRESS_Mises"])[held["rows"]]))
        return answer

    return task


def pyvista_last_step(path: Path, held: Held) -> Task:
    """Read the last increment, the file open and its mesh read before."""
    import pyvista_frd

    reader = pyvista_frd.FRDReader(str(path))
    reader.set_active_time_point(0)
    reader.read()
    last = reader.number_time_points - 1
    reader.set_active_time_point(last)

    def task() -> Answer:
        stress = reader.read().point_data["STRESS"]
        return [(last, np.asarray(stress)[held["rows"]])]

    return task


def ours_conversion(path: Path, held: Held) -> Task:
    """``fembridge.write_vtu_series`` with what ccx2paraview derives, too."""
    import fembridge

    def task() -> Answer:
        with tempfile.TemporaryDirectory() as folder:
            fembridge.write_vtu_series(path, folder, derived=("von_mises", "principal"))
            found = len(list(Path(folder).glob("*.vtu")))
        if found != increments_in(path, held):
            raise ValueError(f"{path}: {found} .vtu files")
        return []

    return task


def ccx2paraview_conversion(path: Path, held: Held) -> Task:
    """Convert all increments to ``.vtu``, in a folder that is removed after."""
    import logging

    from ccx2paraview import Converter

    logging.disable(logging.CRITICAL)

    def task() -> Answer:
        with tempfile.TemporaryDirectory() as folder:
            link = Path(folder) / "job.frd"
            link.symlink_to(path.resolve())
            Converter(str(link), ["vtu"]).run()
            found = len(list(Path(folder).glob("*.vtu")))
        if found != increments_in(path, held):
            raise ValueError(f"{path}: {found} .vtu files")
        return []

    return task


def whole_read(path: Path, held: Held) -> Task:
    """``read()`` of the whole file into memory, block after block."""

    def task() -> Answer:
        with path.open("rb", buffering=0) as file:
            kept = list(iter(lambda: file.read(BLOCK_BYTES), b""))
        if sum(map(len, kept)) != path.stat().st_size:
            raise ValueError(f"{path} changed")
        return []

    return task


def passing_read(path: Path, held: Held) -> Task:
    """``readinto()`` one block that stays in the processor's cache: no new memory."""
    block = bytearray(BLOCK_BYTES)

    def task() -> Answer:
        with path.open("rb", buffering=0) as file:
            while file.readinto(block):
                pass
        return []

    return task


def nothing(path: Path, held: Held) -> Task:
    """Do nothing: the interpreter with NumPy is what peak memory is counted from."""
    return list


PYVISTA = {"package": "pyvista-frd-reader", "module": "pyvista_frd"}
CCX2PARAVIEW = {"package": "ccx2paraview", "module": "ccx2paraview"}
EVERY = ("DISP", "STRESS", "ERROR")
JOBS = {
    "nothing": Job("Python", "NumPy imported", "ascii", nothing),
    "nodes": Job("fembridge", "five nodes", "ascii", ours_at_nodes),
    "nodes_pyvista": Job("pyvista-frd-reader", "five nodes", "ascii", pyvista_at_nodes, **PYVISTA),
    "nodes_command": Job("fembridge", "five nodes, process", "ascii", ours_at_nodes_command),
    "nodes_pyvista_command": Job(
        "pyvista-frd-reader", "five nodes, process", "ascii", pyvista_at_nodes_command, **PYVISTA
    ),
    "nodes_float32": Job("fembridge", "five nodes", "float32", ours_at_nodes),
    "nodes_float64": Job("fembridge", "five nodes", "float64", ours_at_nodes),
    "fields": Job("fembridge", "STRESS", "ascii", ours_fields, ("STRESS",)),
    "step_pyvista": Job(
        "pyvista-frd-reader",
        "last increment",
        "ascii",
        pyvista_last_step,
        EVERY,
        one_increment=True,
        **PYVISTA,
    ),
    "convert": Job("fembridge", "all to .vtu", "short", ours_conversion),
    "convert_ccx2paraview": Job(
        "ccx2paraview", "all to .vtu", "short", ccx2paraview_conversion, **CCX2PARAVIEW
    ),
    "fields_float32": Job("fembridge", "STRESS", "float32", ours_fields, ("STRESS",)),
    "read_float32": Job("`read()`", "into memory", "float32", whole_read),
    "pass_float32": Job("`readinto()`", "one block", "float32", passing_read),
    "fields_float64": Job("fembridge", "STRESS", "float64", ours_fields, ("STRESS",)),
    "read_float64": Job("`read()`", "into memory", "float64", whole_read),
    "pass_float64": Job("`readinto()`", "one block", "float64", passing_read),
    "list": Job("fembridge", "list of contents", "ascii", ours_list),
    "list_float32": Job("fembridge", "list of contents", "float32", ours_list),
    "list_command": Job("fembridge", "`ingest --list`", "ascii", list_command),
}


def increments_in(path: Path, held: Held) -> int:
    """How many increments were written to `path`."""
    found: int = held["increments"][path.stem.partition("_")[0]]
    return found


RTOL = 1e-3  # of the largest component: shows a wrong record, not a rounding
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
