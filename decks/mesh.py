"""A mesh of quadrilaterals in layers, checked when made.

Rows count from 0 here; a deck numbers nodes and elements from 1.

A mesh covers a section exactly once if all its quads run counter-clockwise, no two
of them run along an edge in the same direction, and the edges that one quad alone
has are a single line that nowhere meets itself: each point inside such a line then
lies in as many quads as the line goes around it, which is one. (That the quads'
areas add up to the area inside the line would show nothing: by Green's theorem
they always do.)
"""

import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from decks.finger import LAYERS, AfferentSite
from fembridge.errors import FingerError
from fembridge.store import replacing
from fembridge.typing import BoolArray, FloatArray, IntArray

# Coordinates are stored to a picometre: below what arithmetic differs by
# between processors, above what matters.
DIGITS = 9
# Nodes closer than this are one place: coordinates are stored to 1e-9 mm.
_SAME_PLACE_MM = 1e-7

MIN_SCALED_JACOBIAN = 0.3
# Pairs of edges that are compared at one time; bounds the memory that takes.
_PAIRS = 2_000_000
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

    `layer` indexes `decks.finger.LAYERS`. Quads run counter-clockwise. One that is made
    of a user's finger is `checked`; a stored one was.
    """

    node_mm: FloatArray
    quad: IntArray
    layer: IntArray

    def __post_init__(self) -> None:
        for name, kind in (("node_mm", float), ("quad", np.int64), ("layer", np.int64)):
            array = np.array(getattr(self, name), dtype=kind)
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    def scaled_jacobian(self) -> FloatArray:
        """Worst corner of each quad ``(E,)``: 1 is a rectangle, <= 0 is folded."""
        return scaled_jacobian(self.node_mm, self.quad)

    def area_mm2(self) -> FloatArray:
        """Area of each quad, ``(E,)``."""
        corner = self.node_mm[self.quad]
        (ax, ay), (bx, by) = (corner[:, 2] - corner[:, 0]).T, (corner[:, 3] - corner[:, 1]).T
        area: FloatArray = 0.5 * (ax * by - ay * bx)
        return area

    def edges(self) -> tuple[IntArray, IntArray, IntArray]:
        """All element edges: nodes ``(4E, 2)``, element and face (0 to 3)."""
        nodes = np.stack([self.quad, np.roll(self.quad, -1, axis=1)], -1).reshape(-1, 2)
        count = len(self.quad)
        return nodes, np.repeat(np.arange(count), 4), np.tile(np.arange(4), count)

    def outline(self) -> tuple[IntArray, IntArray, IntArray]:
        """The edges that one element alone has, as `edges` does."""
        nodes, element, face = self.edges()
        _, first, count = np.unique(
            np.sort(nodes, axis=1), axis=0, return_index=True, return_counts=True
        )
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

    def node_at(self, site: AfferentSite) -> int:
        """Row of the node that lies nearest to `site`, all of its elements in that layer.

        Raises
        ------
        FingerError
            The layer has no inner node, or none within 0.3 mm of the site.
        """
        inside = self.in_layer(site.layer)
        rows = np.setdiff1d(self.quad[inside], self.quad[~inside])
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

    def checked(self) -> "Mesh":
        """The mesh itself, if it covers a section exactly once with sound quads.

        Raises
        ------
        FingerError
            A quad that is clockwise, folded or too skewed, a node that no element
            uses, two nodes in one place, or a section with a gap or an overlap.
        """
        unused = np.setdiff1d(np.arange(len(self.node_mm)), self.quad)
        if unused.size:
            raise FingerError(f"node {unused[0] + 1} belongs to no element")
        place = np.round(self.node_mm / _SAME_PLACE_MM)
        _, first, count = np.unique(place, axis=0, return_index=True, return_counts=True)
        if count.max() > 1:
            x, y = self.node_mm[first[count.argmax()]]
            raise FingerError(f"two nodes in one place, at ({x:.6f}, {y:.6f}) mm")
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
        _check_cover(self.node_mm, self.edges()[0])
        return self


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
        There is none, or it is damaged.
    """
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            arrays = [stored[name] for name in ("node_mm", "quad", "layer")]
        return Mesh(*arrays)
    except _DAMAGE as error:
        raise FingerError(f"{path}: not a stored mesh: {error}") from error


# ---- Checks


def _check_cover(node_mm: FloatArray, edge: IntArray) -> None:
    """Refuse `edge` of counter-clockwise quads that leave a gap or lie on each other."""
    start, end = edge.T
    directed = start * len(node_mm) + end
    if len(np.unique(directed)) < len(directed):
        raise FingerError("two elements on the same side of an edge: layers overlap")
    alone = edge[~np.isin(directed, end * len(node_mm) + start)]
    following = dict(alone.tolist())
    start_node = int(alone[0, 0])
    ring = [start_node]
    while (node := following.get(ring[-1], start_node)) != start_node:
        ring.append(node)
        if len(ring) > len(following):
            break
    if len(ring) != len(alone) or len(following) != len(alone):
        raise FingerError("the outline is not one closed line: layers leave a gap")
    if (row := _crossing(node_mm[ring])) is not None:
        x, y = node_mm[ring[row]]
        raise FingerError(f"the outline crosses itself near ({x:.3f}, {y:.3f}) mm: layers overlap")


def scaled_jacobian(node_mm: FloatArray, quad: IntArray) -> FloatArray:
    """Worst corner of each quad ``(E,)``: 1 is a rectangle, <= 0 is folded."""
    corner = node_mm[quad]
    ahead = np.roll(corner, -1, axis=1) - corner
    back = np.roll(corner, 1, axis=1) - corner
    cross = ahead[..., 0] * back[..., 1] - ahead[..., 1] * back[..., 0]
    length = np.linalg.norm(ahead, axis=2) * np.linalg.norm(back, axis=2)
    with np.errstate(invalid="ignore", divide="ignore"):
        worst: FloatArray = np.nan_to_num(cross / length, nan=-1.0).min(axis=1)
    return worst


def _crossing(point_mm: FloatArray) -> int | None:
    """The row of an edge of a closed line that meets another, if one does.

    Edges that share a point are left out: with quads whose corners are open,
    two neighbours can only meet there.
    """

    def side(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
        """Side of the line from `a` to `b` on which `c` lies: 1 left, -1 right, 0 on it."""
        ab, ac = b - a, c - a
        return np.sign(ab[..., 0] * ac[..., 1] - ab[..., 1] * ac[..., 0])

    count = len(point_mm)
    ahead = np.roll(point_mm, -1, axis=0)
    step = max(1, _PAIRS // count)
    for first in range(0, count, step):
        rows = np.arange(first, min(first + step, count))
        a, b, c, d = point_mm[rows, None], ahead[rows, None], point_mm, ahead
        boxes = (np.maximum(a, b) >= np.minimum(c, d)) & (np.maximum(c, d) >= np.minimum(a, b))
        crossed = (side(a, b, c) * side(a, b, d) <= 0) & (side(c, d, a) * side(c, d, b) <= 0)
        meets = boxes.all(axis=-1) & crossed
        apart = (np.arange(count) - rows[:, None]) % count
        meets &= (apart > 1) & (apart < count - 1)
        if meets.any():
            return int(rows[meets.any(axis=1).argmax()])
    return None
