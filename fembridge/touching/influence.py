"""Stress of places in a prism under unit forces, kept from touch to touch.

Which nodes touch changes from touch to touch, the places where afferents sit do not: kept are
columns of the influence, a node each, of the places that were asked for last, up to
`MOST_BYTES` in all.
"""

from collections import OrderedDict
from hashlib import sha256
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from fembridge.touching.pad import Pad, SkinNodes
from fembridge.touching.prism_pad import LatticeNodes, PrismPad
from fembridge.touching.ridged_pad import RidgedPad
from fembridge.typing import FloatArray, IntArray, SingleArray

MOST_BYTES = 256_000_000
"""Memory of all that is kept."""


def influence_pa(
    pad: Pad,
    nodes: SkinNodes,
    layer: NDArray[np.str_],
    x_mm: FloatArray,
    z_mm: FloatArray,
    depth_mm: FloatArray,
    drag: tuple[float, float] = (0.0, 0.0),
) -> SingleArray:
    """Stress ``(6, place, node)`` in Pa under unit forces, as that of `Pad.influence_pa`.

    Of a prism, what was computed for these places before is not computed again.
    """
    if isinstance(pad, RidgedPad):
        pad = pad.smooth_pad
    if not (isinstance(pad, PrismPad) and isinstance(nodes, LatticeNodes) and nodes.size):
        return pad.influence_pa(nodes, layer, x_mm, z_mm, depth_mm, drag)
    digest = sha256(layer.tobytes())
    for values in (x_mm, z_mm, depth_mm):
        digest.update(np.ascontiguousarray(values).tobytes())
    key = pad, drag, digest.digest()
    with _lock:
        columns = _kept.pop(key, None) or _Columns(pad)
        column_of = columns.slots(nodes)
        missing = np.flatnonzero(column_of < 0)
        if missing.size:
            computed = pad.influence_pa(nodes.subset(missing), layer, x_mm, z_mm, depth_mm, drag)
            columns.add(nodes.subset(missing), computed)
            column_of = columns.slots(nodes)
        _kept[key] = columns  # the last one goes last
        while len(_kept) > 1 and kept_bytes() > MOST_BYTES:
            _kept.popitem(last=False)
        influence = columns.of(column_of).reshape(nodes.size, 6, x_mm.size)
        if kept_bytes() > MOST_BYTES:
            _kept.clear()
    return influence.transpose(1, 2, 0)


def kept_bytes() -> int:
    """Memory of all that is kept."""
    return sum(columns.values.nbytes for columns in _kept.values())


def drop_influence() -> None:
    """Let all go that is kept."""
    with _lock:
        _kept.clear()


class _Columns:
    """Influence of some nodes of a pad: `values` ``(node, 6 x place)``, in order of arrival."""

    def __init__(self, pad: PrismPad) -> None:
        self._rows = 2 * pad.end_row + 1
        self._slot = np.full(pad.x_mm.size * self._rows, -1)
        self.values: SingleArray = np.empty((0, 0), dtype=np.float32)

    def _number(self, nodes: LatticeNodes) -> IntArray:
        return np.asarray(nodes.column * self._rows + nodes.row + self._rows // 2)

    def slots(self, nodes: LatticeNodes) -> IntArray:
        """Row of `values` of each node, -1 where it is missing."""
        return self._slot[self._number(nodes)]

    def add(self, nodes: LatticeNodes, influence: SingleArray) -> None:
        """Keep `influence` ``(6, place, node)``."""
        first = len(self.values)
        new = influence.reshape(-1, nodes.size).T
        self.values = np.concatenate([self.values, new]) if first else np.ascontiguousarray(new)
        self._slot[self._number(nodes)] = first + np.arange(nodes.size)

    def of(self, slots: IntArray) -> SingleArray:
        """Rows of `values`; without a copy where they follow each other."""
        first = int(slots[0])
        if np.array_equal(slots, np.arange(first, first + slots.size)):
            return self.values[first : first + slots.size]
        return self.values[slots]


_kept: "OrderedDict[tuple[Pad, tuple[float, float], bytes], _Columns]" = OrderedDict()
_lock = Lock()
