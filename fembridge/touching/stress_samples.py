"""Points of elements at which another solver's stress is taken for the pad of a mesh.

Of quadratic tetrahedra and bricks of reduced integration these are the integration points, where
stress is most accurate; of others the middle, whose stress is the mean of the integration points.
"""

from functools import cached_property

import numpy as np

from decks.shape_functions import BEST_POINTS, MIDDLE, shape_functions
from decks.solid_model import ElementBlock, SolidModel
from fembridge.typing import FloatArray, IntArray

# Types of Marc of reduced integration; names of CalculiX and Abaqus have an R.
_REDUCED_BRICKS = ("57", "61")


def natural_points(block: ElementBlock) -> FloatArray:
    """Natural coordinates of the sampled points of each element of a block, ``(K, 3)``."""
    is_reduced = "R" in block.name.removeprefix("C3D") or block.name in _REDUCED_BRICKS
    if block.kind == "tet10" or (block.kind == "hex20" and is_reduced):
        return BEST_POINTS[block.kind]
    return MIDDLE[block.family][None]


class StressSamples:
    """Sampled points of some elements, in the order of their numbers.

    `elements` ``(E,)`` are the numbers, rising; `owner` ``(S,)`` the row in it of each sample;
    `first` ``(E,)`` the first sample of each element and `count` how many it has.
    """

    def __init__(self, model: SolidModel, elements: IntArray) -> None:
        self.elements: IntArray = np.unique(elements)
        self.count = np.zeros(self.elements.size, dtype=np.int64)
        self._parts: list[tuple[ElementBlock, IntArray, IntArray]] = []
        for block in model.elements:
            selected = np.flatnonzero(np.isin(block.number, self.elements))
            rows = np.searchsorted(self.elements, block.number[selected])
            self.count[rows] = len(natural_points(block))
            self._parts.append((block, selected, rows))
        self.first: IntArray = np.cumsum(self.count) - self.count
        self.owner: IntArray = np.repeat(np.arange(self.elements.size), self.count)

    @property
    def size(self) -> int:
        """Number of samples."""
        return int(self.owner.size)

    @cached_property
    def natural(self) -> FloatArray:
        """Natural coordinates of the samples, ``(S, 3)``."""
        natural = np.zeros((self.size, 3))
        for block, _, rows in self._parts:
            for number, point in enumerate(natural_points(block)):
                natural[self.first[rows] + number] = point
        return natural

    def positions(self, position: FloatArray) -> FloatArray:
        """Positions of the samples, ``(S, 3)``, from those of all nodes of the model ``(N, 3)``."""
        places = np.zeros((self.size, 3))
        for block, selected, rows in self._parts:
            for number, point in enumerate(natural_points(block)):
                share, _ = shape_functions(block.kind, point)
                at = np.einsum("k,eki->ei", share, position[block.rows[selected]])
                places[self.first[rows] + number] = at
        return places

    def samples_of(self, elements: IntArray) -> IntArray:
        """Samples of some elements; those without samples are left out."""
        samples: IntArray = np.flatnonzero(np.isin(self.elements, elements)[self.owner])
        return samples
