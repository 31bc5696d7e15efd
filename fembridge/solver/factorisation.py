"""Cholesky factors of a stiffness matrix: nested dissection, then dense fronts.

The nodes are halved by their positions, again and again; between two halves lie the nodes of one
that touch the other, and these are eliminated after both (George 1973). Each part is a dense
front with the nodes of later parts around it (Duff & Reid 1983), so almost all work is that of
the BLAS. Loads on few nodes and displacements of few nodes take the fronts on their way alone.

100 000 unknowns of solid elements take 20 to 60 s of one core and 1 to 2 GB.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fembridge.errors import ResultError
from fembridge.host.memory import check_memory
from fembridge.typing import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from scipy.sparse import csr_array

_LOGGER = logging.getLogger(__name__)

# Parts of so few nodes are not halved again.
_LEAF_NODES = 48
_BYTES = 8
_COLUMNS_AT_ONCE = 512


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """Unknowns that are eliminated together: `columns`, and `border` of later parts, both rising.

    `children` are the numbers of the parts whose updates it takes.
    """

    columns: IntArray
    border: IntArray
    children: tuple[int, ...]


class Factors:
    """Cholesky factors of a symmetric positive definite matrix.

    Parameters
    ----------
    matrix
        The whole matrix, ``(n, n)``.
    node
        Number of the node of each unknown, from 0, rising, ``(n,)``.
    position
        Position of each node, ``(N, 3)``.
    progress
        Called with the share of the work that is done. Default: None.

    Raises
    ------
    numpy.linalg.LinAlgError
        The matrix is not positive definite.
    ResultError
        The factors take more memory than is available.
    """

    def __init__(
        self,
        matrix: "csr_array",
        node: IntArray,
        position: FloatArray,
        progress: Callable[[float], None] | None = None,
    ) -> None:
        self.size = node.size
        self._parts = _dissect(matrix, node, position)
        _LOGGER.info(
            f"factors of {self.size} unknowns: {self.stored_bytes / 1e9:.2g} GB, "
            f"{self.operations / 1e9:.3g} billion operations"
        )
        check_memory(int(1.3 * self.stored_bytes), "factors of the stiffness matrix", ResultError)
        self._factors = list(self._factorise(matrix, progress))

    @property
    def stored_bytes(self) -> int:
        """Memory of the factors in bytes."""
        return _BYTES * sum(p.columns.size * (p.columns.size + p.border.size) for p in self._parts)

    @property
    def operations(self) -> float:
        """Floating-point operations of the factorisation."""
        return float(sum(_operations(part) for part in self._parts))

    def solve(self, loads: FloatArray, required: BoolArray) -> FloatArray:
        """Displacements ``(n, L)`` under `loads` ``(n, L)``; 0 where they are not `required`.

        Parameters
        ----------
        loads
            Loads on all unknowns, a column a load case.
        required
            Unknowns whose displacement is required, ``(n,)``.
        """
        from scipy.linalg import solve_triangular

        moved = np.array(loads, dtype=np.float64)
        for part, (corner, side) in zip(self._parts, self._factors, strict=True):
            values = moved[part.columns]
            if values.any():
                values = solve_triangular(corner, values, lower=True, check_finite=False)
                moved[part.columns] = values
                moved[part.border] -= side @ values
        needed = np.array([bool(required[part.columns].any()) for part in self._parts])
        for number, part in enumerate(self._parts):  # above a part that is needed all are
            if needed[list(part.children)].any():
                needed[number] = True
        for number in range(len(self._parts) - 1, -1, -1):
            part, (corner, side) = self._parts[number], self._factors[number]
            if not needed[number]:
                moved[part.columns] = 0.0
                continue
            values = moved[part.columns] - side.T @ moved[part.border]
            moved[part.columns] = solve_triangular(
                corner, values, lower=True, trans="T", check_finite=False
            )
        return moved

    def _factorise(
        self, matrix: "csr_array", progress: Callable[[float], None] | None
    ) -> "list[tuple[FloatArray, FloatArray]]":
        from scipy.linalg import cholesky, solve_triangular

        factors, updates = [], dict[int, FloatArray]()
        local = np.full(self.size, -1)
        done, total = 0.0, self.operations
        for number, part in enumerate(self._parts):
            unknowns = np.concatenate([part.columns, part.border])
            local[unknowns] = np.arange(unknowns.size)
            front = np.zeros((unknowns.size, unknowns.size))
            rows = matrix[part.columns].tocoo()
            row, column = np.arange(part.columns.size)[rows.coords[0]], local[rows.coords[1]]
            later = column >= 0  # others were eliminated: they are in the updates
            front[column[later], row[later]] = rows.data[later]
            for child in part.children:
                at = local[self._parts[child].border]
                front[np.ix_(at, at)] += updates.pop(child)
            width = part.columns.size
            corner = cholesky(front[:width, :width], lower=True, check_finite=False)
            side = solve_triangular(
                corner, front[width:, :width].T, lower=True, check_finite=False
            ).T
            side = np.ascontiguousarray(side)
            update = front[width:, width:]
            for first in range(0, len(update), _COLUMNS_AT_ONCE):  # no second front in memory
                columns = slice(first, first + _COLUMNS_AT_ONCE)
                update[:, columns] -= side @ side[columns].T
            updates[number] = update.copy()
            del front, update
            factors.append((corner, side))
            local[unknowns] = -1
            done += _operations(part)
            if progress is not None:
                progress(done / total)
        return factors


def _operations(part: _Part) -> float:
    width, border = float(part.columns.size), float(part.border.size)
    return width**3 / 3 + width**2 * border + 2 * width * border**2


def _dissect(matrix: "csr_array", node: IntArray, position: FloatArray) -> list[_Part]:
    """Parts in the order of their elimination."""
    from scipy.sparse import csr_array

    count = len(position)
    entries = matrix.tocoo()
    pairs = node[entries.coords[0]], node[entries.coords[1]]
    graph = csr_array((np.ones(entries.nnz, dtype=np.int8), pairs), shape=(count, count))
    graph.sum_duplicates()
    start, neighbour = graph.indptr, graph.indices
    first = np.searchsorted(node, np.arange(count))
    unknowns = np.diff(np.append(first, node.size))
    side = np.zeros(count, dtype=np.int8)
    parts: list[_Part] = []
    eliminated = np.zeros(count, dtype=bool)

    def neighbours(nodes: IntArray) -> tuple[IntArray, IntArray]:
        """Row in `nodes` and neighbour, a pair an edge."""
        lengths = start[nodes + 1] - start[nodes]
        row = np.repeat(np.arange(nodes.size), lengths)
        offset = np.arange(row.size) - np.repeat(np.cumsum(lengths) - lengths, lengths)
        return row, neighbour[np.repeat(start[nodes], lengths) + offset]

    def split(nodes: IntArray) -> tuple[IntArray, IntArray, IntArray]:
        """Two halves and the nodes between them."""
        points = position[nodes]
        axis = int(np.ptp(points, axis=0).argmax())
        order = np.argsort(points[:, axis], kind="stable")
        lower, upper = nodes[order[: nodes.size // 2]], nodes[order[nodes.size // 2 :]]
        side[lower], side[upper] = 1, 2
        row, other = neighbours(lower)
        below = np.unique(row[side[other] == 2])
        row, other = neighbours(upper)
        above = np.unique(row[side[other] == 1])
        side[nodes] = 0
        if below.size <= above.size:
            return np.delete(lower, below), upper, lower[below]
        return lower, np.delete(upper, above), upper[above]

    def eliminate(nodes: IntArray) -> int | None:
        """Number of the part that eliminates `nodes` last; None of none."""
        if not nodes.size:
            return None
        children: tuple[int, ...] = ()
        if nodes.size > _LEAF_NODES:
            lower, upper, nodes_between = split(nodes)
            if nodes_between.size and lower.size and upper.size:
                halves = (eliminate(lower), eliminate(upper))
                children = tuple(half for half in halves if half is not None)
                nodes = nodes_between
            elif not nodes_between.size:  # not connected
                halves = (eliminate(lower), eliminate(upper))
                children = tuple(half for half in halves if half is not None)
                nodes = nodes[:0]
        border = [borders[child] for child in children]
        around = neighbours(nodes)[1] if nodes.size else nodes
        eliminated[nodes] = True
        outside = np.unique(np.concatenate([around, *border]))
        outside = outside[~eliminated[outside]]
        borders[len(parts)] = outside
        parts.append(_Part(numbers(np.sort(nodes)), numbers(outside), children))
        return len(parts) - 1

    def numbers(nodes: IntArray) -> IntArray:
        """Unknowns of nodes."""
        lengths = unknowns[nodes]
        offset = np.arange(lengths.sum()) - np.repeat(np.cumsum(lengths) - lengths, lengths)
        unknown: IntArray = np.repeat(first[nodes], lengths) + offset
        return unknown

    borders: dict[int, IntArray] = {}
    eliminate(np.arange(count))
    return parts
