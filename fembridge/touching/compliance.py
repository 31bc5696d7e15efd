"""Compliance of skin nodes: how far each moves under the forces on all.

`DenseCompliance` is a matrix, for nodes of any mesh. On a prism an entry depends on two columns
and on the distance along the axis, so `LatticeCompliance` is a convolution along it. Contact
(`fembridge.touching.contact`) uses either without a difference. `GridCompliance` is an operator
for ten thousand nodes (`fembridge.touching.grid_contact`).
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


class GridCompliance(Compliance):
    """Compliance of a fine grid on the skin of a prism: a near part, and a smooth rest.

    The near part is that of flat layered skin (`fembridge.touching.layered_skin`), a convolution
    over the grid. The rest is what the finite-element pad has besides: the curve of the skin, the
    bone, the sides. It is smooth, and so a table of the coarser nodes of the pad: forces
    are spread on them and displacements read from them with the same weights, so that the whole is
    symmetric. Both are applied by FFT in single precision.

    Parameters
    ----------
    kernel_mm
        Near part: displacement in mm under 1 N by the columns and rows between, ``(C, R)``.
    rest_mm
        Rest, of the pad's nodes: ``(force, node, apart)``.
    table_mm
        Both, of the nodes of the grid: ``(column, column, rows apart)``, in single precision.
    drag_mm
        Displacement into the skin by the friction that comes with 1 N, of the pad's nodes:
        ``(force, node, apart)``, for nodes ahead and behind; None without friction.
    drag_table_mm
        The same, of the nodes of the grid: ``(2, force, node, rows apart)``, in single precision.
    across
        Weight of each column of the pad for each column of the grid, ``(C, N)``.
    rows_per_node
        Rows of the grid between two nodes of the pad.
    column, row
        Column of each node of the grid, and its row from the middle, ``(n,)``.
    """

    def __init__(
        self,
        kernel_mm: FloatArray,
        rest_mm: FloatArray,
        table_mm: SingleArray,
        across: FloatArray,
        rows_per_node: int,
        column: IntArray,
        row: IntArray,
        drag_mm: tuple[FloatArray, FloatArray] | None = None,
        drag_table_mm: SingleArray | None = None,
    ) -> None:
        from scipy import fft

        self._column, self._row = column, row
        self._kernel_mm, self._rest_mm = kernel_mm, rest_mm
        self._table_mm, self._drag_table_mm = table_mm, drag_table_mm
        first_column, first_row = int(column.min()), int(row.min())
        self.shape = int(column.max()) - first_column + 1, int(row.max()) - first_row + 1
        """Columns and rows of the smallest window that has all nodes."""
        self.at = (column - first_column) * self.shape[1] + (row - first_row)
        """Number of each node in that window, ``(n,)``."""
        window = across[first_column : first_column + self.shape[0]]
        used = np.flatnonzero(window.any(axis=0))
        self._columns = slice(int(used[0]), int(used[-1]) + 1)
        self._across = np.ascontiguousarray(window[:, self._columns], dtype=np.float32)
        # Nodes of the pad around the rows of the window, one more at each end.
        first_node = first_row // rows_per_node - 1
        last_node = -(-(first_row + self.shape[1] - 1) // rows_per_node) + 1
        row_position = (first_row + np.arange(self.shape[1])) / rows_per_node - first_node
        along = interpolation_weights(row_position, last_node - first_node + 1)
        self._along = along.astype(np.float32)
        self._padded = tuple(fft.next_fast_len(2 * count - 1, real=True) for count in self.shape)
        self._kernel_hat = _even_spectrum(kernel_mm[: self.shape[0], : self.shape[1]], self._padded)
        self._rest = _AlongConvolution(
            rest_mm[self._columns, self._columns], rest_mm[self._columns, self._columns],
            self._along.shape[1],
        )  # fmt: skip
        self._drag = None
        if drag_mm is not None:
            ahead, behind = (table[self._columns, self._columns] for table in drag_mm)
            self._drag = _AlongConvolution(ahead, behind, self._along.shape[1])

    @property
    def size(self) -> int:
        """Number of nodes."""
        return self._column.size

    @property
    def row(self) -> IntArray:
        """Row of each node, ``(n,)``."""
        return self._row

    @property
    def column(self) -> IntArray:
        """Column of each node, ``(n,)``."""
        return self._column

    @property
    def own_mm(self) -> float:
        """Displacement of a node in mm under 1 N on it, by the near part."""
        return float(self._kernel_mm[0, 0])

    def block(self, rows: IntArray, columns: IntArray) -> FloatArray:
        """Entries of the table, without drag."""
        return self.entries_mm(rows, columns).astype(np.float64)

    def entries_mm(self, rows: IntArray, columns: IntArray) -> SingleArray:
        """Entries of the table in single precision, ``(rows, columns)``, without drag."""
        across, _, along = self._table_mm.shape
        index = np.abs(self._row[rows][:, None] - self._row[columns])
        index += (self._column[rows] * (across * along))[:, None] + self._column[columns] * along
        entries: SingleArray = self._table_mm.ravel().take(index)
        return entries

    @property
    def has_drag(self) -> bool:
        """Whether friction moves the nodes."""
        return self._drag_table_mm is not None

    def drag_entries_mm(self, rows: IntArray, columns: IntArray) -> SingleArray:
        """Displacement of `rows` by the friction that comes with 1 N on each of `columns`."""
        assert self._drag_table_mm is not None
        _, across, _, along = self._drag_table_mm.shape
        apart = self._row[rows][:, None] - self._row[columns]
        index = np.abs(apart) + (apart < 0) * (across * across * along)
        index += self._column[columns] * (across * along) + (self._column[rows] * along)[:, None]
        entries: SingleArray = self._drag_table_mm.ravel().take(index)
        return entries

    def apply_mm(self, forces_n: SingleArray) -> SingleArray:
        """Displacements ``(C, R)`` in mm under forces ``(C, R)`` in N on the window."""
        from scipy import fft

        spectrum = fft.rfft2(forces_n, self._padded)
        spectrum *= self._kernel_hat
        near = fft.irfft2(spectrum, self._padded)[: self.shape[0], : self.shape[1]]
        near += self._spread(self._rest, forces_n)
        moved: SingleArray = near
        return moved

    def drag_moved_mm(self, forces_n: SingleArray) -> SingleArray | None:
        """Displacements ``(C, R)`` in mm by the friction of `forces_n`; None without friction."""
        return None if self._drag is None else self._spread(self._drag, forces_n)

    def between_blocks_mm(self, side: int) -> FloatArray:
        """Displacement of square blocks of `side` nodes in the window under 1 N on each, about.

        That between their middles; of a block by itself the mean over its nodes.
        """
        counts = tuple(-(-count // side) for count in self.shape)
        column, row = (side * index.ravel() for index in np.indices(counts))
        first = int(self._column.min())
        middle = first + np.minimum(column + side // 2, self.shape[0] - 1)
        between = self._table_mm[middle[:, None], middle, np.abs(row[:, None] - row)]
        weight = np.convolve(np.ones(side), np.ones(side)) / side**2
        apart = np.abs(np.arange(-side + 1, side))
        near = np.minimum(apart, min(self._kernel_mm.shape) - 1)
        own_mm = weight @ self._kernel_mm[np.ix_(near, near)] @ weight
        between[np.diag_indices_from(between)] += own_mm - self._kernel_mm[0, 0]
        return np.asarray(between, dtype=np.float64)

    def moved_mm(self, rows: IntArray, forces_n: FloatArray) -> FloatArray:
        """Displacement of all nodes ``(n,)``, see `Compliance`."""
        del rows
        grid = np.zeros(self.shape, dtype=np.float32)
        grid.flat[self.at] = forces_n
        moved: FloatArray = self.apply_mm(grid).ravel()[self.at].astype(np.float64)
        return moved

    def _spread(self, convolution: "_AlongConvolution", forces_n: SingleArray) -> SingleArray:
        on_pad = np.linalg.multi_dot([self._across.T, forces_n, self._along])
        moved = np.linalg.multi_dot([self._across, convolution(on_pad), self._along.T])
        return np.asarray(moved, dtype=np.float32)


class _AlongConvolution:
    """A table of the pad's nodes by their distance along the axis, applied by FFT.

    `ahead` and `behind` ``(force, node, apart)`` are for nodes at larger and smaller z than the
    force; `rows` is how many rows the nodes have.
    """

    def __init__(self, ahead: FloatArray, behind: FloatArray, rows: int) -> None:
        from scipy import fft

        self._rows, reach = rows, min(rows, ahead.shape[2])
        self._padded = fft.next_fast_len(2 * rows - 1, real=True)
        around = np.zeros((*ahead.shape[:2], self._padded))
        around[..., :reach] = ahead[..., :reach]
        around[..., self._padded - reach + 1 :] = behind[..., reach - 1 : 0 : -1]
        spectrum = fft.rfft(around)
        self._is_even = np.array_equal(ahead, behind)
        if self._is_even:  # of an even table the spectrum is real
            spectrum = spectrum.real
        # (wave, node, force)
        self._spectrum = np.ascontiguousarray(
            spectrum.transpose(2, 1, 0),
            dtype=np.float32 if self._is_even else np.complex64,
        )

    def __call__(self, forces_n: FloatArray | SingleArray) -> SingleArray:
        from scipy import fft

        waves = np.ascontiguousarray(fft.rfft(forces_n, self._padded).T, dtype=np.complex64)
        if self._is_even:  # real and imaginary parts are two columns
            parts = waves.view(np.float32).reshape(*waves.shape, 2)
            moved = np.matmul(self._spectrum, parts).view(np.complex64)[..., 0]
        else:
            moved = np.matmul(self._spectrum, waves[..., None])[..., 0]
        by_row: SingleArray = fft.irfft(moved.T, self._padded)[:, : self._rows]
        return by_row


def _even_spectrum(kernel: FloatArray, padded: tuple[int, ...]) -> SingleArray:
    """Spectrum of a kernel by distance, ``(C, R)``, that is even along both axes."""
    from scipy import fft

    around = np.zeros(padded)
    columns, rows = kernel.shape
    around[:columns, :rows] = kernel
    around[padded[0] - columns + 1 :, :rows] = kernel[:0:-1]
    around[:, padded[1] - rows + 1 :] = around[:, rows - 1 : 0 : -1]
    return np.ascontiguousarray(fft.rfft2(around).real, dtype=np.float32)


def interpolation_weights(position: FloatArray, count: int) -> FloatArray:
    """Lagrange's cubic weights ``(P, count)`` of nodes at 0, 1, 2 ... for positions ``(P,)``."""
    first = np.clip(np.floor(position).astype(np.int64) - 1, 0, max(count - 4, 0))
    knots = first[:, None] + np.arange(min(4, count))
    weights = np.ones(knots.shape)
    for knot in range(knots.shape[1]):
        for other in range(knots.shape[1]):
            if knot != other:
                weights[:, knot] *= (position - knots[:, other]) / (knot - other)
    table = np.zeros((position.size, count))
    np.put_along_axis(table, knots, weights, axis=1)
    return table
