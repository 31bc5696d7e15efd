"""Whether nodes and quads are one whole section: nothing unused, no gap, no overlap.

A mesh covers a section exactly once if all its quads run counter-clockwise, no two
of them run along an edge in the same direction, and the edges that one quad alone
has are a single line that nowhere meets itself: each point inside such a line then
lies in as many quads as the line goes around it, which is one. (That the quads'
areas add up to the area inside the line would show nothing: by Green's theorem
they always do.)
"""

import numpy as np

from decks.finger import LAYERS
from fembridge.errors import FingerError
from fembridge.typing import BoolArray, FloatArray, IntArray

# Nodes closer than this are one place: coordinates are stored to 1e-9 mm.
_SAME_PLACE_MM = 1e-7

MIN_SCALED_JACOBIAN = 0.3
# Pairs of edges that are compared at one time; bounds the memory that takes.
_PAIRS = 2_000_000


def check_tables(node_mm: FloatArray, quad: IntArray, layer: IntArray) -> None:
    """Refuse tables of the wrong shape, nodes that nobody uses or that coincide."""
    if node_mm.ndim != 2 or node_mm.shape[1] != 2:
        raise FingerError(f"expected nodes (N, 2), got {node_mm.shape}")
    if quad.ndim != 2 or quad.shape[1] != 4 or not len(quad):
        raise FingerError(f"expected quads (E, 4), got {quad.shape}")
    if layer.shape != (len(quad),):
        raise FingerError(f"expected a layer for {len(quad)} quads, got {layer.shape}")
    if layer.min() < 0 or layer.max() >= len(LAYERS):
        raise FingerError(f"layers {layer.min()} to {layer.max()}, expected 0 to 5")
    bad = np.flatnonzero(~np.isfinite(node_mm).all(axis=1))
    if bad.size:
        raise FingerError(f"node {bad[0] + 1} is at {node_mm[bad[0]]}")
    if quad.min() < 0 or quad.max() >= len(node_mm):
        raise FingerError(
            f"quads name nodes {quad.min() + 1} to {quad.max() + 1}, there are 1 to {len(node_mm)}"
        )
    unused = np.flatnonzero(np.bincount(quad.ravel(), minlength=len(node_mm)) == 0)
    if unused.size:
        raise FingerError(f"node {unused[0] + 1} belongs to no element")
    _check_places(node_mm)


def check_cover(node_mm: FloatArray, quad: IntArray) -> None:
    """Refuse counter-clockwise quads that leave a gap or lie on each other."""
    edge = np.stack([quad, np.roll(quad, -1, axis=1)], -1).reshape(-1, 2)
    start, end = edge.T
    directed = start * len(node_mm) + end
    if len(np.unique(directed)) < len(directed):
        raise FingerError("two elements on the same side of an edge: layers overlap")
    alone = edge[~np.isin(directed, end * len(node_mm) + start)]
    following = dict(alone.tolist())
    ring = _ring(following, start=int(alone[0, 0]))
    if len(ring) != len(alone) or len(following) != len(alone):
        raise FingerError("the outline is not one closed line: layers leave a gap")
    if (node := _crossing(node_mm[ring])) is not None:
        x, y = node_mm[ring[node]]
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


def _check_places(node_mm: FloatArray) -> None:
    place = np.round(node_mm / _SAME_PLACE_MM)
    _, first, count = np.unique(place, axis=0, return_index=True, return_counts=True)
    if count.max() > 1:
        x, y = node_mm[first[count.argmax()]]
        raise FingerError(f"two nodes in one place, at ({x:.6f}, {y:.6f}) mm")


def _ring(following: dict[int, int], start: int) -> list[int]:
    ring = [start]
    while (node := following.get(ring[-1], start)) != start:
        ring.append(node)
        if len(ring) > len(following):
            break
    return ring


def _crossing(point_mm: FloatArray) -> int | None:
    """Give the row of an edge of a closed line that meets another, if one does.

    Edges that share a point are left out: with quads whose corners are open,
    two neighbours can only meet there.
    """
    count = len(point_mm)
    ahead = np.roll(point_mm, -1, axis=0)
    step = max(1, _PAIRS // count)
    for first in range(0, count, step):
        rows = np.arange(first, min(first + step, count))
        meets = _meet(point_mm[rows, None], ahead[rows, None], point_mm, ahead)
        apart = (np.arange(count) - rows[:, None]) % count
        meets &= (apart > 1) & (apart < count - 1)
        if meets.any():
            return int(rows[meets.any(axis=1).argmax()])
    return None


def _meet(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> BoolArray:
    """Whether the lines from `a` to `b` and from `c` to `d` have a point in common."""
    boxes = (np.maximum(a, b) >= np.minimum(c, d)) & (np.maximum(c, d) >= np.minimum(a, b))
    sides = (_side(a, b, c) * _side(a, b, d) <= 0) & (_side(c, d, a) * _side(c, d, b) <= 0)
    meeting: BoolArray = boxes.all(axis=-1) & sides
    return meeting


def _side(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Side of the line from `a` to `b` on which `c` lies: 1 left, -1 right, 0 on it."""
    ab, ac = b - a, c - a
    side: FloatArray = np.sign(ab[..., 0] * ac[..., 1] - ab[..., 1] * ac[..., 0])
    return side
