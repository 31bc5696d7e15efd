"""Stress at a node as each layer has it: the two sides of a layer boundary.

A ``.frd`` holds one stress a node, the mean over all elements there. What the
solver computed is in the ``.dat``, at integration points inside elements
(``*EL PRINT, ELSET=...`` with S): here they are extrapolated to the node, element
by element, and averaged over the elements of one material, never over two.

The points of an element are those of the brick that CalculiX makes of it: x
fastest, then y, then z. In a plane element the layers through the thickness are
equal but for rounding, and their mean is taken. Values are the element's own
system where it has one (``*ORIENTATION``); without one they are global.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fembridge.errors import ResultError
from fembridge.results.extrapolation import brick_weights
from fembridge.results.frd_fields import read_mesh
from fembridge.results.printed import read_point_stress
from fembridge.results.read_options import ReadOptions
from fembridge.results.readers import result_file
from fembridge.results.stress import TENSOR, von_mises_pa
from fembridge.tables import write_table
from fembridge.typing import FloatArray, IntArray

_DEFAULTS = ReadOptions()
_SHAPES = {"qu4": "quad4", "qu8": "quad8", "he8": "hex8", "he20": "hex20"}


@dataclass(frozen=True, slots=True, eq=False)
class OneSidedStress:
    """Stress at `node` in one material: `tensor_pa` ``(T, 6)`` in Pa.

    At `times_ms` ``(T,)``, in the order xx yy zz xy yz zx; it is the mean over the
    `elements` of that material at the node.
    """

    node: int
    material: int
    name: str
    elements: tuple[int, ...]
    times_ms: FloatArray
    tensor_pa: FloatArray

    @property
    def von_mises_pa(self) -> FloatArray:
        """Von Mises stress on this side, ``(T,)`` in Pa."""
        return von_mises_pa(self.tensor_pa)


def write_sides(path: Path, sides: Iterable[OneSidedStress]) -> None:
    """Write a long CSV, one row a time and side; floats come back exactly."""
    stresses = ["von_mises_pa", *(f"{name}_pa" for name in TENSOR)]
    rows = (
        (time_ms, side.node, side.name, *stress_pa)
        for side in sides
        for time_ms, stress_pa in zip(
            side.times_ms.tolist(),
            np.column_stack([side.von_mises_pa, side.tensor_pa]).tolist(),
            strict=True,
        )
    )
    write_table(path, ("time_ms", "node", "material", *stresses), rows)


def one_sided_stress(
    path: Path | str,
    node: int,
    set_name: str,
    *,
    dat: Path | str | None = None,
    options: ReadOptions = _DEFAULTS,
) -> tuple[OneSidedStress, ...]:
    """Read the stress at `node`, for each material there, lowest number first.

    Parameters
    ----------
    path
        The ``.frd``, which has the mesh, or a run folder.
    set_name
        The set of elements whose points the ``.dat`` has.
    dat
        The ``.dat``; None takes the one beside `path`.

    Raises
    ------
    ResultError
        A file is absent or damaged; the node is not in the mesh; an element there
        is not in the set, or of a kind whose points are not extrapolated here.
    """
    path = result_file(path)
    mesh = read_mesh(path)
    around = [
        (int(cells.ids[row]), int(cells.material[row]), cells.kind, corner)
        for cells in mesh.cells
        for row, corner in np.argwhere(mesh.nodes[cells.rows] == node).tolist()
    ]
    if not around:
        raise ResultError(f"node {node} is at no element of the mesh", path)
    beside = path.with_suffix(".dat") if dat is None else Path(dat)
    times_ms, points, tensor_pa = read_point_stress(beside, set_name, options)
    sides: dict[int, list[tuple[int, FloatArray]]] = {}
    for element, material, kind, corner in around:
        rows = np.flatnonzero(points[:, 0] == element)
        if not rows.size:
            raise ResultError(
                f"set {set_name} has no stress of element {element}, which is at node "
                f"{node}: its side would be a guess",
                beside,
            )
        weights = _weights(kind, corner, points[rows, 1], element, beside)
        there = np.einsum("p,tpc->tc", weights, tensor_pa[:, rows])
        sides.setdefault(material, []).append((element, there))
    return tuple(
        OneSidedStress(
            node=node,
            material=material,
            name=mesh.materials.get(material, f"material {material}"),
            elements=tuple(element for element, _ in sides[material]),
            times_ms=times_ms,
            tensor_pa=np.mean([tensor for _, tensor in sides[material]], axis=0),
        )
        for material in sorted(sides)
    )


def _weights(kind: str, corner: int, order: IntArray, element: int, path: Path) -> FloatArray:
    """Weights in the order in which the points of an element are printed."""
    if not np.array_equal(np.sort(order), np.arange(1, order.size + 1)):
        raise ResultError(
            f"element {element} has the integration points "
            f"{', '.join(map(str, order.tolist()))}, expected 1 to {order.size}",
            path,
        )
    try:
        return brick_weights(_SHAPES.get(kind, kind), order.size, corner)[order - 1]
    except ValueError as error:
        raise ResultError(f"element {element}: {error}", path) from error
