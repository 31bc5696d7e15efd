"""Stress and displacement at nodes, from a ``.frd`` of CalculiX.

Stress at a node is the mean over the elements there. On a layer boundary that
mean belongs to neither layer (0.011 MPa measured between 0.0005 and 0.022), so
such a node is refused unless ``across_materials`` asks for it.

CalculiX has no units. Lengths are taken as mm, times as s, and stress in
`ReadOptions.stress_unit`; what comes out is mm, ms and Pa.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fembridge.errors import ResultError
from fembridge.results.byte_file import ByteFile
from fembridge.results.frd_format.block import FrdBlock, FrdOutput
from fembridge.results.frd_format.ending import why_not_whole
from fembridge.results.frd_format.history import NodeHistory, Want, read_history
from fembridge.results.frd_format.index import FrdIndex, index_frd
from fembridge.results.frd_format.mesh import MeshBlock, materials_at
from fembridge.results.frd_format.records import node_at, node_ids
from fembridge.results.read_options import ReadOptions, in_pa
from fembridge.results.stress import von_mises_pa
from fembridge.trace import MS_PER_S, StressTrace
from fembridge.typing import FloatArray, Table

STRESS, STRESS_COMPONENTS = "STRESS", ("SXX", "SYY", "SZZ", "SXY", "SYZ", "SZX")
_SXY = STRESS_COMPONENTS.index("SXY")
DISPLACEMENT, DISPLACEMENT_COMPONENTS = "DISP", ("D1", "D2", "D3")
_DEFAULTS = ReadOptions()


@dataclass(frozen=True, slots=True, eq=False)
class StressAndDisplacement:
    """Both at the same increments: `times_ms` ``(T,)``, `tensor_pa`
    ``(T, node, 6)`` in Pa, order xx yy zz xy yz zx, `displacement_mm`
    ``(T, node, 3)``; each in the order in which its nodes were asked for.
    """  # noqa: D205 - one sentence

    times_ms: FloatArray
    tensor_pa: FloatArray
    displacement_mm: FloatArray


def read(path: Path, nodes: Sequence[int], options: ReadOptions = _DEFAULTS) -> list[StressTrace]:
    """Read the von Mises stress at `nodes`, in that order.

    A trace begins with the first increment of the file; what came before it,
    the rest state among it, a ``.frd`` does not hold.
    """
    times_ms, tensor_pa = read_stress_tensor(path, nodes, options)
    kept = options.kept(times_ms)
    times_ms, tensor_pa = times_ms[kept], tensor_pa[kept]
    times_ms = unrounded(times_ms)
    with np.errstate(over="ignore"):  # a trace refuses what is not finite
        stress_pa = von_mises_pa(tensor_pa)
    return [
        StressTrace.on_grid(node, np.stack([times_ms, column], -1), path)
        for node, column in zip(nodes, stress_pa.T, strict=True)
    ]


def read_stress_tensor(
    path: Path, nodes: Sequence[int], options: ReadOptions = _DEFAULTS
) -> tuple[FloatArray, FloatArray]:
    """Cauchy stress at `nodes`: ``(T,)`` in ms and ``(T, node, 6)`` in Pa.

    The order of components is xx yy zz xy yz zx.

    Raises
    ------
    ResultError
        The file is absent, empty, foreign or cut; the run did not end normally;
        no STRESS in it; a node has none, or sits between two materials; a value
        is no finite number.
    """
    history = _read(path, {STRESS: nodes}, options)
    return history.times_ms, _in_pa(history, nodes, options, path)


def read_displacement(
    path: Path, nodes: Sequence[int], options: ReadOptions = _DEFAULTS
) -> tuple[FloatArray, FloatArray]:
    """Displacement of `nodes`: ``(T,)`` in ms and ``(T, node, 3)`` in mm.

    Raises
    ------
    ResultError
        As for `read_stress_tensor`, but for the materials.
    """
    history = _read(path, {DISPLACEMENT: nodes}, options)
    return history.times_ms, history.values[DISPLACEMENT]


def read_stress_and_displacement(
    path: Path,
    stress_nodes: Sequence[int],
    displacement_nodes: Sequence[int],
    options: ReadOptions = _DEFAULTS,
) -> StressAndDisplacement:
    """Read both, joined by step and increment.

    Raises
    ------
    ResultError
        As for `read_stress_tensor`; also an increment that has only one of the
        two (`options.partial` leaves it out).
    """
    wanted = {STRESS: stress_nodes, DISPLACEMENT: displacement_nodes}
    history = _read(path, wanted, options)
    return StressAndDisplacement(
        times_ms=history.times_ms,
        tensor_pa=_in_pa(history, stress_nodes, options, path),
        displacement_mm=history.values[DISPLACEMENT],
    )


def describe(path: Path) -> Table:
    """Tell what the file holds: mesh, quantities, increments, what is wrong.

    Raises
    ------
    ResultError
        There is no file, it is empty, or no ``.frd``.
    """
    with ByteFile(path) as file:
        index = index_frd(file)
        return {
            "format": "ccx-frd",
            "bytes": index.size,
            "mesh_nodes": _count(file, index.nodes),
            "elements": _count(file, index.elements),
            "materials": dict(sorted(index.materials.items())),
            "quantities": [_quantity(file, index, name) for name in index.names],
            "remarks": list(index.remarks),
            "problem": _problem(file, index),
        }


def unrounded(times_ms: FloatArray) -> FloatArray:
    """Take the rounding of the print out of an even time axis, ``(T,)``.

    Below one second a ``.frd`` prints six digits, above it ten: an even step of
    1/3 ms looks uneven. If all times are even within their last printed digit,
    give the even ones; otherwise what was there.
    """
    if times_ms.size < 2:
        return times_ms
    even: FloatArray = np.linspace(times_ms[0], times_ms[-1], times_ms.size)
    times_s = np.maximum(times_ms / MS_PER_S, np.finfo(np.float64).tiny)
    digits = np.where(times_s < 1.0, 5, 9)
    last_digit_ms = 10.0 ** (np.floor(np.log10(times_s)) - digits) * MS_PER_S
    rounding_ms = last_digit_ms + last_digit_ms[-1] * times_s / times_s[-1]
    return even if (np.abs(even - times_ms) <= rounding_ms).all() else times_ms


def _read(path: Path, nodes_of: dict[str, Sequence[int]], options: ReadOptions) -> NodeHistory:
    components = {STRESS: STRESS_COMPONENTS, DISPLACEMENT: DISPLACEMENT_COMPONENTS}
    with ByteFile(path) as file:
        index = index_frd(file)
        wants = [
            Want(name, components[name], tuple(int(node) for node in nodes))
            for name, nodes in nodes_of.items()
        ]
        history = read_history(file, index, wants, options)
        if STRESS in nodes_of and not options.across_materials:
            _check_materials(file, index, nodes_of[STRESS], options.branches)
        return history


def _in_pa(
    history: NodeHistory, nodes: Sequence[int], options: ReadOptions, path: Path
) -> FloatArray:
    """Give stress in Pa; in relaxing skin the sum over branches, not their mean.

    On the axis of a half of a section there is no shear in it: see `ReadOptions`.
    """
    counts = [options.branches.get(int(node), 1) for node in nodes]
    summed = history.values[STRESS] * np.array(counts, dtype=np.float64)[:, None]
    summed[:, [int(node) in options.on_axis for node in nodes], _SXY] = 0.0
    return in_pa(summed, options, path)


def _check_materials(
    file: ByteFile, index: FrdIndex, nodes: Sequence[int], branches: Mapping[int, int]
) -> None:
    if index.elements is None or not nodes:
        return
    for node, numbers in materials_at(file, index.elements, nodes).items():
        if len(numbers) > branches.get(node, 1):
            names = " and ".join(
                index.materials.get(number, f"material {number}") for number in sorted(numbers)
            )
            raise ResultError(
                f"node {node} lies between {names}: its stress is a mean over both "
                "and belongs to neither; take a node inside one layer, or ask for "
                "it with --across-materials (across_materials=True)",
                file.path,
            )


def _count(file: ByteFile, block: MeshBlock | None) -> int | None:
    if block is None or block.records is not None:
        return None if block is None else block.records
    return file.count(b"\n -1", block.offset - 1, block.end)


def _problem(file: ByteFile, index: FrdIndex) -> str | None:
    words = (file.change, why_not_whole(index, file.path))
    return "; ".join(word for word in words if word) or None


def _quantity(file: ByteFile, index: FrdIndex, name: str) -> Table:
    blocks = index.named(name)
    complex_of = {name, f"{name}I", name.removesuffix("I")} & set(index.names)
    timed = [b for b in blocks if b.output.over_time and len(complex_of) == 1]
    others = [] if timed else [b.output for b in blocks]
    if timed:
        others = [b.output for b in blocks if not b.output.over_time]
    lowest, highest, nodes = _span(file, index, blocks[0])
    return {
        "name": name,
        "components": list(blocks[0].components),
        "increments": len(timed),
        "first_ms": timed[0].time_ms if timed else None,
        "last_ms": timed[-1].time_ms if timed else None,
        "modes": len(others),
        "axis": _axis(others),
        "first_value": others[0].value if others else None,
        "last_value": others[-1].value if others else None,
        "steps": sorted({block.step for block in blocks}),
        "nodes": nodes,
        "lowest_node": lowest,
        "highest_node": highest,
        "storage": ("ASCII", "ASCII", "float32", "float64")[blocks[0].flag],
    }


def _axis(others: Sequence[FrdOutput]) -> str:
    """Say what the values of outputs without time are: of steady states, too."""
    if not others:
        return "total time"
    return "frequency in cycles per time" if others[0].over_time else others[0].axis


def _span(file: ByteFile, index: FrdIndex, block: FrdBlock) -> tuple[int | None, int | None, int]:
    """Lowest and highest node and their count, with little reading.

    A block of the whole mesh ascends, so its ends tell; one of a set is in the
    order of the deck, with duplicates, and is read if it is not large.
    """
    mesh = None if index.nodes is None else index.nodes.records
    if not block.free and block.records and block.records == mesh:
        first = node_at(file, block, 0)
        last = node_at(file, block, block.records - 1)
        if first is not None and last is not None and first <= last:
            return first, last, block.records
    ids = node_ids(file, block)
    if not ids.size:
        return None, None, 0
    return int(ids.min()), int(ids.max()), len(np.unique(ids))
