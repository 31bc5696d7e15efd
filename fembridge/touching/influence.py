"""Stress of places in a prism under unit forces, kept from touch to touch.

Which nodes touch changes from touch to touch, the places where afferents sit do not: kept are
columns of the influence, a node each, of the places that were asked for last, up to
`MOST_BYTES` in all.
"""

from collections import OrderedDict
from collections.abc import Callable
from hashlib import sha256
from threading import Lock
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from fembridge.touching.pad import Pad, SkinNodes
from fembridge.touching.prism_pad import LatticeNodes, PrismPad
from fembridge.touching.ridged_pad import RidgedPad
from fembridge.typing import FloatArray, IntArray, SingleArray

MOST_BYTES = 256_000_000
"""Memory of all that is kept."""


Places: TypeAlias = tuple[NDArray[np.str_], FloatArray, FloatArray, FloatArray]
"""Layer, x, z and depth in mm of places, ``(place,)`` each, as for `Pad.influence_pa`."""


def read_influence(
    pad: Pad,
    nodes: SkinNodes,
    places: Places,
    drag: tuple[float, float],
    read: Callable[[SingleArray, FloatArray], SingleArray],
) -> SingleArray:
    """What `read` takes from the stress under unit forces, ``(node, K x place)``.

    `read` is a function of the influence ``(6, place, node)`` and of the normals ``(place, 3)``
    that returns ``(K, place, node)``. Of a prism, what was computed for the same places and by the
    same function is not computed again.
    """
    if isinstance(pad, RidgedPad):
        pad = pad.smooth_pad

    def computed(some: SkinNodes) -> SingleArray:
        influence = pad.influence_pa(some, *places, drag)
        values = read(influence, pad.normal_at(*places[1:3]))
        return np.ascontiguousarray(values.reshape(-1, some.size).T, dtype=np.float32)

    if not (isinstance(pad, PrismPad) and isinstance(nodes, LatticeNodes) and nodes.size):
        return computed(nodes)
    digest = sha256()
    for values in places:
        digest.update(np.ascontiguousarray(values).tobytes())
    key = pad, drag, read, digest.digest()
    with _lock:
        columns = _kept.pop(key, None) or _Columns(pad)
        missing = np.flatnonzero(columns.slots(nodes) < 0)
        if missing.size:
            some = nodes.subset(missing)
            columns.add(some, computed(some))
        table = columns.of(columns.slots(nodes))
        _kept[key] = columns  # the last one goes last
        while _kept and kept_bytes() > MOST_BYTES:
            _kept.popitem(last=False)
    return table


def kept_bytes() -> int:
    """Memory of all that is kept."""
    return sum(columns.values.nbytes for columns in _kept.values())


def drop_influence() -> None:
    """Let all go that is kept."""
    with _lock:
        _kept.clear()


class _Columns:
    """What is kept of some nodes of a pad: `values` ``(node, ...)``, in order of arrival."""

    def __init__(self, pad: PrismPad) -> None:
        self._rows = 2 * pad.end_row + 1
        self._slot = np.full(pad.x_mm.size * self._rows, -1)
        self.values: SingleArray = np.empty((0, 0), dtype=np.float32)

    def _number(self, nodes: LatticeNodes) -> IntArray:
        return np.asarray(nodes.column * self._rows + nodes.row + self._rows // 2)

    def slots(self, nodes: LatticeNodes) -> IntArray:
        """Row of `values` of each node, -1 where it is missing."""
        return self._slot[self._number(nodes)]

    def add(self, nodes: LatticeNodes, rows: SingleArray) -> None:
        """Keep `rows` ``(node, ...)``."""
        first = len(self.values)
        self.values = np.concatenate([self.values, rows]) if first else rows
        self._slot[self._number(nodes)] = first + np.arange(nodes.size)

    def of(self, slots: IntArray) -> SingleArray:
        """Rows of `values`; without a copy where they follow each other."""
        first = int(slots[0])
        if np.array_equal(slots, np.arange(first, first + slots.size)):
            return self.values[first : first + slots.size]
        return self.values[slots]


_kept: "OrderedDict[tuple[object, ...], _Columns]" = OrderedDict()
_lock = Lock()
