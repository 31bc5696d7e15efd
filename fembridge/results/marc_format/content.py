"""What a Marc post file holds, as values: post codes, mesh, sets, increments.

Source: blocks 50600 to 53600 and 51600 to 52900 of post revisions 12 to 14, as
they stand in real files; the names of the verification integers are Marc's own.
"""

from dataclasses import dataclass, field

import numpy as np

from fembridge.typing import FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class PostCode:
    """One value that is stored at each integration point.

    `code` is Marc's element post code (17 von Mises, 311 to 316 the stress tensor
    11 22 33 12 23 31); `layer` 0 where the deck names none.
    """

    code: int
    layer: int
    label: str


@dataclass(frozen=True, slots=True, eq=False)
class PostSet:
    """A named set: `kind` is "node", "element", "edge", "face" or "type N".

    `members` ``(M,)`` are numbers of nodes, or of elements; of edges and faces
    `sides` ``(M,)`` says which one of its element, from 0.
    """

    name: str
    kind: str
    members: IntArray
    sides: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.int64))


@dataclass(frozen=True, slots=True, eq=False)
class PostMesh:
    """A model: `node_ids` ``(N,)``, `coordinates_mm` ``(N, 3)``, elements.

    `element_ids` and `element_types` are ``(E,)``; `connectivity` ``(E, K)`` has
    numbers of nodes, 0 where an element has fewer. `extras` ``(E, X)`` are what
    block 50702 adds to an element: geometry, material and body ids by all signs.
    Pressure nodes of Herrmann elements are nodes too, with coordinates of zero.
    """

    node_ids: IntArray
    coordinates_mm: FloatArray
    element_ids: IntArray
    element_types: IntArray
    connectivity: IntArray
    extras: IntArray
    sets: tuple[PostSet, ...] = field(default_factory=tuple)


@dataclass(frozen=True, slots=True)
class NodalQuantity:
    """A quantity at all nodes in one increment: `has_values` False means all zero.

    `is_complex` marks one with an imaginary part, which is not read.
    """

    name: str
    code: int
    components: int
    has_values: bool
    is_complex: bool = False


@dataclass(frozen=True, slots=True)
class PostIncrement:
    """One increment: Marc's numbers, the solver's time in s, what it holds.

    `row` counts increments in the file from 0; `mesh` is the row of the model that
    holds here (more than one after remeshing). `cut_backs` counts since the
    start, `recycles` those of this increment. `harmonic` is Marc's IHRESP, 0 where
    the increment is one of time; elsewhere `frequency` belongs to it.
    """

    row: int
    increment: int
    sub_increment: int
    time_s: float
    title: str
    mesh: int
    recycles: int
    cut_backs: int
    has_element_values: bool
    nodal: tuple[NodalQuantity, ...]
    harmonic: int = 0
    frequency: float = 0.0
