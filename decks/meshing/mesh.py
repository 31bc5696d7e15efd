"""A mesh of quadrilaterals in layers, checked when made.

Rows count from 0 here; a deck numbers nodes and elements from 1.
"""

import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from decks.finger import LAYERS, AfferentSite
from decks.meshing.mesh_checks import (
    MIN_SCALED_JACOBIAN,
    check_cover,
    check_tables,
    scaled_jacobian,
)
from fembridge.errors import FingerError
from fembridge.store import replacing
from fembridge.typing import BoolArray, FloatArray, IntArray

# What NumPy raises on a file that is no whole archive of arrays.
_DAMAGE = (
    OSError,
    EOFError,
    KeyError,
    TypeError,
    ValueError,
    zipfile.BadZipFile,
    zlib.error,
    NotImplementedError,
)


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """`node_mm` ``(N, 2)``, `quad` ``(E, 4)`` rows of nodes, `layer` ``(E,)``.

    `layer` indexes `decks.finger.LAYERS`. Quads run counter-clockwise.

    Raises
    ------
    FingerError
        A quad that is clockwise, folded or too skewed, a node that no element
        uses, two nodes in one place, or a section with a gap or an overlap.
    """

    node_mm: FloatArray
    quad: IntArray
    layer: IntArray

    def __post_init__(self) -> None:
        for name, kind in (("node_mm", float), ("quad", np.int64), ("layer", np.int64)):
            array = np.array(getattr(self, name), dtype=kind)
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        check_tables(self.node_mm, self.quad, self.layer)
        self._check_shapes()
        check_cover(self.node_mm, self.quad)

    def scaled_jacobian(self) -> FloatArray:
        """Worst corner of each quad ``(E,)``: 1 is a rectangle, <= 0 is folded."""
        return scaled_jacobian(self.node_mm, self.quad)

    def area_mm2(self) -> FloatArray:
        """Area of each quad, ``(E,)``."""
        corner = self.node_mm[self.quad]
        diagonal = corner[:, 2] - corner[:, 0], corner[:, 3] - corner[:, 1]
        area: FloatArray = 0.5 * (
            diagonal[0][:, 0] * diagonal[1][:, 1] - diagonal[0][:, 1] * diagonal[1][:, 0]
        )
        return area

    def edges(self) -> tuple[IntArray, IntArray, IntArray]:
        """Give all element edges: nodes ``(4E, 2)``, element and face (0 to 3)."""
        nodes = np.stack([self.quad, np.roll(self.quad, -1, axis=1)], -1).reshape(-1, 2)
        count = len(self.quad)
        return nodes, np.repeat(np.arange(count), 4), np.tile(np.arange(4), count)

    def outline(self) -> tuple[IntArray, IntArray, IntArray]:
        """Give the edges that one element alone has, as `edges` does."""
        nodes, element, face = self.edges()
        key = np.sort(nodes, axis=1)
        _, first, count = np.unique(key, axis=0, return_index=True, return_counts=True)
        rows = np.sort(first[count == 1])
        return nodes[rows], element[rows], face[rows]

    def with_midsides(self) -> tuple[FloatArray, IntArray]:
        """Nodes ``(M, 2)`` and quads of eight nodes ``(E, 8)``, mid-sides last."""
        nodes, _, _ = self.edges()
        key, which = np.unique(np.sort(nodes, axis=1), axis=0, return_inverse=True)
        middle_mm = self.node_mm[key].mean(axis=1)
        midside = len(self.node_mm) + which.reshape(-1, 4)
        return np.concatenate([self.node_mm, middle_mm]), np.concatenate(
            [self.quad, midside], axis=1
        )

    def in_layer(self, layer: str) -> BoolArray:
        """Which elements ``(E,)`` belong to `layer`."""
        inside: BoolArray = self.layer == LAYERS.index(layer)
        return inside

    def nodes_inside(self, layer: str) -> IntArray:
        """Nodes whose every element belongs to `layer`."""
        inside = self.in_layer(layer)
        wanted = np.zeros(len(self.node_mm), dtype=bool)
        wanted[self.quad[inside]] = True
        wanted[self.quad[~inside]] = False
        return np.flatnonzero(wanted)

    def node_at(self, site: AfferentSite) -> int:
        """Row of the node inside `site`'s layer that lies nearest to it.

        Raises
        ------
        FingerError
            The layer has no inner node, or none within 0.3 mm of the site.
        """
        rows = self.nodes_inside(site.layer)
        if not rows.size:
            raise FingerError(f"no node lies inside {site.layer}: use more rows there")
        wanted = np.array([site.x_mm, -site.depth_mm])
        distance_mm = np.linalg.norm(self.node_mm[rows] - wanted, axis=1)
        nearest = int(distance_mm.argmin())
        if distance_mm[nearest] > 0.3:
            raise FingerError(
                f"the node of {site.layer} nearest ({site.x_mm:g}, {-site.depth_mm:g}) "
                f"mm is {distance_mm[nearest]:.2f} mm away, expected within 0.3 mm"
            )
        return int(rows[nearest])

    def _check_shapes(self) -> None:
        worst = self.scaled_jacobian()
        row = int(worst.argmin())
        if not worst[row] >= MIN_SCALED_JACOBIAN:
            x, y = self.node_mm[self.quad[row]].mean(axis=0)
            fault = "too skewed"
            if worst[row] <= 0:
                fault = "clockwise" if self.area_mm2()[row] < 0 else "folded"
            raise FingerError(
                f"element {row + 1} at ({x:.3f}, {y:.3f}) mm is {fault}: scaled "
                f"Jacobian {worst[row]:.2f}, expected {MIN_SCALED_JACOBIAN} or more"
            )


def write_mesh(path: Path, mesh: Mesh) -> None:
    """Store `mesh` as NPZ; the same mesh gives the same bytes."""
    with replacing(path) as draft, draft.open("wb") as file:
        np.savez_compressed(
            file,
            node_mm=mesh.node_mm,
            quad=mesh.quad.astype(np.int32),
            layer=mesh.layer.astype(np.int8),
        )


def read_mesh(path: Path) -> Mesh:
    """Read a mesh that `write_mesh` stored.

    Raises
    ------
    FingerError
        There is none, it is damaged, or it is a mesh that `Mesh` refuses.
    """
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            arrays = [stored[name] for name in ("node_mm", "quad", "layer")]
        return Mesh(*arrays)
    except FingerError as error:
        raise FingerError(f"{path}: {error}") from error
    except _DAMAGE as error:
        raise FingerError(f"{path}: not a stored mesh: {error}") from error
