"""Compliance of skin nodes: how far each moves under the forces on all.

`DenseCompliance` is a matrix, for nodes of any mesh. On a prism an entry depends on two columns
and on the distance along the axis, so `LatticeCompliance` is a convolution along it. Contact
(`fembridge.touching.contact`) uses either without a difference.
"""

from abc import ABC, abstractmethod
from functools import cached_property
from typing import Any

import numpy as np

from fembridge.typing import FloatArray, IntArray, SingleArray


class Compliance(ABC):
    """Displacements in mm of nodes, as the contact counts them, under forces in N on them."""

    @property
    @abstractmethod
    def size(self) -> int:
        """Number of nodes."""

    @abstractmethod
    def block(self, rows: IntArray, columns: IntArray) -> FloatArray:
        """Displacement of `rows` in mm under 1 N on each of `columns`, ``(rows, columns)``."""

    @property
    def matrix(self) -> FloatArray:
        """Displacement of all nodes in mm under 1 N on each, ``(node, force)``."""
        rows = np.arange(self.size)
        return self.block(rows, rows)

    @cached_property
    def _by_force(self) -> SingleArray:
        """All entries by the node of the force, ``(force, node)``, in single precision."""
        return np.ascontiguousarray(self.matrix.T, dtype=np.float32)

    def moved_mm(self, rows: IntArray, forces_n: FloatArray) -> FloatArray:
        """Displacement of all nodes ``(n,)`` in single precision.

        Parameters
        ----------
        rows
            Nodes that have a force.
        forces_n
            Forces on all nodes in N, ``(n,)``.
        """
        single = forces_n.astype(np.float32)
        if 3 * rows.size < forces_n.size:
            moved = single[rows] @ self._by_force[rows]
        else:
            moved = single @ self._by_force
        return moved.astype(np.float64)


class DenseCompliance(Compliance):
    """Compliance as a matrix.

    Parameters
    ----------
    matrix
        Displacement in mm under 1 N, ``(node, force)``.
    """

    def __init__(self, matrix: FloatArray) -> None:
        self._matrix = matrix

    @property
    def size(self) -> int:
        """Number of nodes."""
        return len(self._matrix)

    def block(self, rows: IntArray, columns: IntArray) -> FloatArray:
        """Entries of the matrix."""
        entries: FloatArray = self._matrix[np.ix_(rows, columns)]
        return entries


class LatticeCompliance(Compliance):
    """Compliance of nodes in columns along the axis of a prism.

    Parameters
    ----------
    table
        Displacement in mm under 1 N along x, into the skin, or along z, of a node in one column
        under a force in another, some nodes apart: ``(3, force, node, apart)``.
    column, row
        Column of each node, and its number along the axis, ``(n,)``.
    drag
        Force along x and z that comes with 1 N into the skin.
    """

    def __init__(
        self,
        table: FloatArray,
        column: IntArray,
        row: IntArray,
        drag: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        self._table, self._column, self._row, self._drag = table, column, row, drag

    @property
    def size(self) -> int:
        """Number of nodes."""
        return self._column.size

    def block(self, rows: IntArray, columns: IntArray) -> FloatArray:
        """Entries of the table for the distances of the nodes."""
        apart = self._row[rows, None] - self._row[columns]
        across = self._column[columns][None, :], self._column[rows][:, None]
        entries: tuple[Any, ...] = (*across, np.abs(apart))
        table, drag = self._table, self._drag
        block: FloatArray = table[1][entries]
        if drag[0]:
            block = block + drag[0] * table[0][entries]
        if drag[1]:
            block = block + drag[1] * np.where(apart < 0, -1.0, 1.0) * table[2][entries]
        return block
