"""The files that the readers are timed on: one run, long, in three storages.

``python -m benchmarks.result_files FOLDER --megabytes 300`` writes ``ascii.frd`` of
that size and its binary twins ``float32.frd`` and ``float64.frd``, with the same
increments; ``short.frd``, the first increments in ASCII, for readers that are slow;
``first_*.frd``, two increments of each, for warming up; and ``files.json``, which
prints what they hold. Increments beyond the recorded ones repeat them at new times,
by a factor that differs from turn to turn, so that no two have the same numbers.

The run: with ccx on the PATH the deck of ``fixtures/response_paper`` is solved for a few
increments, its output no longer restricted to the afferents' nodes: 18 000 nodes,
displacement, stress and ccx's own error estimate. Without ccx the recorded results
of those few nodes are dealt out over the mesh, each node's by a factor of its own:
no field of a finger, but digits as real ones. The files are read here by a plain
walk that shares no line with fembridge, so that what is timed is not what made it.
"""

import argparse
import hashlib
import json
import math
import re
import shutil
import struct
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

FIXTURE = Path(__file__).parents[1] / "fixtures" / "response_paper"
INCREMENTS = 8
NODES_OF_TYPE = {1: 8, 2: 6, 3: 4, 4: 20, 5: 15, 6: 10, 7: 3, 8: 6, 9: 4, 10: 8}
NODES_OF_TYPE |= {11: 2, 12: 3}
_RESTRICTED = ", NSET=OUTPUT_NODES, DOUBLE"
_STEP = re.compile(r"(?m)^(\*STATIC, DIRECT\n)([\d.]+), [\d.]+$")
_NODE = np.dtype([("node", "<i4"), ("xyz_mm", "<f8", (3,))])


@dataclass(frozen=True, slots=True, eq=False)
class Element:
    """Type and material as ccx numbers them, and the nodes."""

    number: int
    type: int
    material: int
    nodes: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Quantity:
    """One block: the text of its ``-4`` and ``-5`` lines, and ``(N, C)``."""

    name: str
    lines: bytes
    values: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class RecordedRun:
    """Heading lines, mesh, and the quantities of each increment.

    `nodes` is ``(N,)``, `xyz_mm` ``(N, 3)``; `times_s` has a time an increment.
    """

    heading: bytes
    nodes: NDArray[np.int32]
    xyz_mm: NDArray[np.float64]
    elements: tuple[Element, ...]
    times_s: tuple[float, ...]
    increments: tuple[tuple[Quantity, ...], ...]

    def inner_nodes(self, count: int) -> list[int]:
        """Choose nodes inside one material, evenly over the mesh."""
        materials: dict[int, set[int]] = {}
        for element in self.elements:
            for node in element.nodes:
                materials.setdefault(node, set()).add(element.material)
        inner = sorted(node for node, held in materials.items() if len(held) == 1)
        return [inner[(2 * k + 1) * len(inner) // (2 * count)] for k in range(count)]


def record(folder: Path, source: Path | None = None) -> tuple[RecordedRun, str]:
    """Give the run and a sentence on its origin: `source`, or solved in `folder`."""
    if source is not None:
        return read_run(source), f"the increments of {source.name}"
    if shutil.which("ccx") is None:
        return read_run(FIXTURE / "job.frd"), (
            "no ccx on the PATH: the results at the afferents' nodes of "
            "fixtures/response_paper, dealt out over its mesh"
        )
    run = read_run(_solved(folder / "solved", _deck_with_all_output()))
    return run, (
        f"{len(run.times_s)} increments of the deck of fixtures/response_paper, "
        "solved with output at every node"
    )


def read_run(path: Path) -> RecordedRun:
    """Read a run that ccx wrote with ``DOUBLE``: every block binary, float64."""
    content = path.read_bytes()
    at = content.index(b"\n    2C") + 1
    heading = content[:at]
    count, at = _count_and_start(content, at)
    table = np.frombuffer(content, _NODE, count, at)
    count, at = _count_and_start(content, at + table.nbytes)
    elements = []
    for _ in range(count):
        number, kind, _, material = struct.unpack_from("<4i", content, at)
        nodes = struct.unpack_from(f"<{NODES_OF_TYPE[kind]}i", content, at + 16)
        elements.append(Element(number, kind, material, nodes))
        at += 16 + 4 * len(nodes)
    times_s: list[float] = []
    increments: list[tuple[Quantity, ...]] = []
    for increment, time_s, quantity in _quantities(content, at, table["node"]):
        if increment > len(increments):
            times_s.append(time_s)
            increments.append(())
        increments[-1] += (quantity,)
    return RecordedRun(
        heading=heading,
        nodes=table["node"].copy(),
        xyz_mm=table["xyz_mm"].copy(),
        elements=tuple(elements),
        times_s=tuple(times_s),
        increments=tuple(increments),
    )


def _quantities(
    content: bytes, at: int, nodes: NDArray[np.int32]
) -> Iterator[tuple[int, float, Quantity]]:
    while content[at : at + 5] != b" 9999":
        step, at = _line(content, at)
        header, at = _line(content, at)
        start = at
        name, at = _line(content, at)
        stored = 0
        for _ in range(int(name[13:18])):
            component, at = _line(content, at)
            stored += component[33:38].strip() != b"1"
        if header[73:75].strip() != b"3":
            raise ValueError(f"{name!r}: flag {header[73:75]!r}, expected 3 (DOUBLE)")
        record = np.dtype([("node", "<i4"), ("values", "<f8", (stored,))])
        lines = content[start:at]
        table = np.frombuffer(content, record, int(header[24:36]), at)
        at += table.nbytes
        values = table["values"]
        if not np.array_equal(table["node"], nodes):
            rows = np.arange(nodes.size)
            values = values[rows % len(table)] * (1.0 + rows[:, None] / 8191.0)
        quantity = Quantity(name[5:13].decode().strip(), lines, values.copy())
        yield int(step[36:48]), float(header[12:24]), quantity


def _line(content: bytes, at: int) -> tuple[bytes, int]:
    end = content.index(b"\n", at)
    return content[at:end], end + 1


def _count_and_start(content: bytes, at: int) -> tuple[int, int]:
    line, start = _line(content, at)
    return int(line[24:36]), start


def _deck_with_all_output() -> str:
    """Give the recorded deck with output at every node, and few increments."""
    path = FIXTURE / "job.inp"
    deck = path.read_text(encoding="ascii")
    if _RESTRICTED not in deck:
        raise ValueError(f"{path}: no {_RESTRICTED!r}, expected in it")
    deck = deck.replace(_RESTRICTED, ", DOUBLE")
    deck, changed = _STEP.subn(
        lambda found: f"{found[1]}{found[2]}, {INCREMENTS * float(found[2]):.7f}", deck
    )
    if changed != 1:
        raise ValueError(f"{path}: {changed} steps, expected 1")
    return deck


def _solved(folder: Path, deck: str) -> Path:
    """Give the result of `deck`, solved in `folder` unless it was before."""
    inputs, result = folder / "job.inp", folder / "job.frd"
    if not (
        result.exists()
        and result.read_bytes().endswith(b" 9999\n")
        and inputs.read_text(encoding="ascii") == deck
    ):
        folder.mkdir(parents=True, exist_ok=True)
        inputs.write_text(deck, encoding="ascii", newline="\n")
        subprocess.run(["ccx", "-i", "job"], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    return result


STORAGES = {"ascii": 1, "float32": 2, "float64": 3}
ABOUT = "files.json"
LAYOUT = 1  # layout of the files: another number makes those of other programs again
SHORT_INCREMENTS = 10
WARMING_INCREMENTS = 2
PROBED_NODES = 5
_VALUES_A_LINE = 6
_NODES_A_LINE = 10


def make_files(run: RecordedRun, origin: str, folder: Path, megabytes: float) -> None:
    """Write all files, and what they hold, unless `folder` has them already."""
    wanted = {
        "layout": LAYOUT,
        "origin": origin,
        "megabytes": megabytes,
        "mesh_nodes": run.nodes.size,
        "run_sha256": _sha256(run),
    }
    about = folder / ABOUT
    if about.exists():
        if wanted.items() <= json.loads(about.read_text(encoding="utf-8")).items():
            return
        about.unlink()
    folder.mkdir(parents=True, exist_ok=True)
    increments = increments_of(run, megabytes)
    short = min(SHORT_INCREMENTS, increments)
    for storage in STORAGES:
        write_run(run, folder / f"{storage}.frd", storage, increments)
        write_run(run, folder / f"first_{storage}.frd", storage, WARMING_INCREMENTS)
    write_run(run, folder / "short.frd", "ascii", short)
    nodes = run.inner_nodes(PROBED_NODES)
    rows = np.searchsorted(run.nodes, nodes)
    held = wanted | {
        "increments": {
            "first": WARMING_INCREMENTS,
            "short": short,
            **dict.fromkeys(STORAGES, increments),
        },
        "record_bytes": {name: record_bytes(run, name) for name in STORAGES},
        "nodes": nodes,
        "rows": rows.tolist(),
        "stress_mpa": [
            quantity.values[rows].tolist()
            for _, quantities in history(run, increments)
            for quantity in quantities
            if quantity.name == "STRESS"
        ],
    }
    about.write_text(json.dumps(held), encoding="utf-8")


def record_bytes(run: RecordedRun, storage: str) -> dict[str, int]:
    """Bytes of each quantity's records at one increment."""
    sizes = {}
    for quantity in run.increments[0]:
        columns = quantity.values.shape[1]
        if storage == "ascii":
            size = 14 * math.ceil(columns / _VALUES_A_LINE) + 12 * columns
        else:
            size = 4 + {"float32": 4, "float64": 8}[storage] * columns
        sizes[quantity.name] = size * run.nodes.size
    return sizes


def increments_of(run: RecordedRun, megabytes: float) -> int:
    """How many increments an ASCII file of `megabytes` (10^6 bytes) has."""
    mesh = 49 * run.nodes.size + sum(
        29 + 14 * math.ceil(len(each.nodes) / _NODES_A_LINE) + 10 * len(each.nodes)
        for each in run.elements
    )
    one = sum(record_bytes(run, "ascii").values())
    return max(2, math.ceil((megabytes * 1e6 - mesh) / one))


def history(run: RecordedRun, increments: int) -> Iterator[tuple[float, list[Quantity]]]:
    """Yield time in s and quantities of each increment."""
    dt_s = run.times_s[1] - run.times_s[0]
    for row in range(increments):
        turn, recorded = divmod(row, len(run.increments))
        time_s = run.times_s[recorded] + turn * len(run.increments) * dt_s
        factor = 1.0 + turn / 127.0
        yield (
            time_s,
            [
                Quantity(each.name, each.lines, each.values * factor)
                for each in run.increments[recorded]
            ],
        )


def write_run(run: RecordedRun, path: Path, storage: str, increments: int) -> None:
    """Write a ``.frd`` as ccx does: the same bytes for the increments it solved."""
    flag = STORAGES[storage]
    with path.open("wb") as file:
        file.write(run.heading)
        _write_mesh(run, file, flag)
        block = 0
        for row, (time_s, quantities) in enumerate(history(run, increments), start=1):
            for quantity in quantities:
                block += 1
                file.write(
                    f"    1PSTEP{'':14}{block:12d}{row:12d}{1:12d}          \n"
                    f"  100CL{100 + row:5d}{_time(time_s)}{run.nodes.size:12d}{'':20}"
                    f" 0{row:5d}{'':10}{flag:2d}\n".encode("ascii")
                )
                file.write(quantity.lines)
                _write_records(run, quantity, file, storage)
        file.write(b" 9999\n")


def _sha256(run: RecordedRun) -> str:
    parts = [run.heading, run.nodes.tobytes(), run.xyz_mm.tobytes()]
    for quantities in run.increments:
        parts += [each.values.tobytes() for each in quantities]
    return hashlib.sha256(b"".join(parts)).hexdigest()


def _time(time_s: float) -> str:
    if time_s < 1.0:
        return f"{time_s:12.5E}"
    return f"{time_s:12.{10 - len(str(int(time_s)))}f}"


def _write_mesh(run: RecordedRun, file: BinaryIO, flag: int) -> None:
    mesh_flag = 1 if flag == 1 else 3
    file.write(_mesh_header("2C", run.nodes.size, mesh_flag))
    if flag == 1:
        lines = (
            f" -1{node:10d}{x:12.5E}{y:12.5E}{z:12.5E}\n"
            for node, (x, y, z) in zip(run.nodes.tolist(), run.xyz_mm.tolist(), strict=True)
        )
        file.write("".join(lines).encode("ascii") + b" -3\n")
    else:
        table = np.empty(run.nodes.size, [("node", "<i4"), ("xyz_mm", "<f8", (3,))])
        table["node"], table["xyz_mm"] = run.nodes, run.xyz_mm
        file.write(table.tobytes())
    file.write(_mesh_header("3C", len(run.elements), 1 if flag == 1 else 2))
    for each in run.elements:
        if flag == 1:
            text = f" -1{each.number:10d}{each.type:5d}{0:5d}{each.material:5d}\n"
            for first in range(0, len(each.nodes), _NODES_A_LINE):
                some = each.nodes[first : first + _NODES_A_LINE]
                text += " -2" + "".join(f"{node:10d}" for node in some) + "\n"
            file.write(text.encode("ascii"))
        else:
            numbers = (each.number, each.type, 0, each.material, *each.nodes)
            file.write(np.array(numbers, "<i4").tobytes())
    if flag == 1:
        file.write(b" -3\n")


def _mesh_header(mark: str, count: int, flag: int) -> bytes:
    return f"    {mark}{'':18}{count:12d}{'':37}{flag}\n".encode("ascii")


def _write_records(run: RecordedRun, quantity: Quantity, file: BinaryIO, storage: str) -> None:
    columns = quantity.values.shape[1]
    if storage != "ascii":
        kind = {"float32": "<f4", "float64": "<f8"}[storage]
        table = np.empty(run.nodes.size, [("node", "<i4"), ("values", kind, (columns,))])
        table["node"], table["values"] = run.nodes, quantity.values
        file.write(table.tobytes())
        return
    form = " -1%10d"
    for column in range(columns):
        if column and column % _VALUES_A_LINE == 0:
            form += "\n -2          "
        form += "%12.5E"
    table = np.empty((run.nodes.size, 1 + columns))
    table[:, 0] = run.nodes
    table[:, 1:] = quantity.values.astype(np.float32)  # as ccx does before it prints
    file.write(((form + "\n") * len(table) % tuple(table.ravel().tolist())).encode())
    file.write(b" -3\n")


def main() -> None:
    """Make the files."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--megabytes", type=float, default=300.0)
    parser.add_argument(
        "--source",
        type=Path,
        metavar="FRD",
        help="a float64 result of ccx (DOUBLE) with all fields, instead of the recorded run",
    )
    args = parser.parse_args()
    run, origin = record(args.folder, args.source)
    make_files(run, origin, args.folder, args.megabytes)


if __name__ == "__main__":
    main()
