"""A recorded run with all its fields: what the benchmark's files are made of.

With ccx on the PATH the deck of ``fixtures/response_paper`` is solved for a few
increments, its output no longer restricted to the afferents' nodes: 18 000 nodes,
displacement, stress and ccx's own error estimate. Without ccx the recorded results
of those few nodes are dealt out over the mesh, each node's by a factor of its own:
no field of a finger, but digits as real ones. The files are read here by a plain
walk that shares no line with fembridge, so that what is timed is not what made it.
"""

import re
import shutil
import struct
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

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
