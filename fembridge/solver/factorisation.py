"""Cholesky factors of a stiffness matrix: nested dissection, then dense fronts.

The nodes are divided in two, again and again, by as few nodes as possible: the smallest cut that
lies between the first and the last 30 % of the nodes along an axis, which is a maximum flow (Ford
& Fulkerson 1956). The nodes between two parts are eliminated after both (George 1973). Each part
is a dense front with the nodes of later parts around it (Duff & Reid 1983), so almost all work is
that of the BLAS. Loads on few nodes and displacements of few nodes take the fronts on their way
alone.

The factors of 85 000 unknowns of a round fingertip take 0.7 GB and 17 s of one core. They have 6 %
more numbers than by METIS, with 4 % less work (`benchmarks/pad_memory.py`).
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

# Parts of so few nodes are not divided again.
_LEAF_NODES = 32
# A cut lies between these shares of the nodes along an axis; unequal parts count as a larger cut.
_BAND, _UNEQUAL = (0.3, 0.7), 0.5
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
            update = front[width:, width:].copy()
            del front
            for first in range(0, len(update), _COLUMNS_AT_ONCE):  # symmetric: half is computed
                rows, below = slice(first, first + _COLUMNS_AT_ONCE), slice(first, None)
                update[below, rows] -= side[below] @ side[rows].T
                update[rows, below] = update[below, rows].T
            updates[number] = update
            factors.append((corner, side))
            local[unknowns] = -1
            done += _operations(part)
            if progress is not None:
                progress(done / total)
        return factors


def _operations(part: _Part) -> float:
    width, border = float(part.columns.size), float(part.border.size)
    return width**3 / 3 + width**2 * border + width * border**2


def _dissect(matrix: "csr_array", node: IntArray, position: FloatArray) -> list[_Part]:
    """Parts in the order of their elimination."""
    from scipy.sparse import csr_array

    count = len(position)
    entries = matrix.tocoo()
    pairs = node[entries.coords[0]], node[entries.coords[1]]
    graph = csr_array((np.ones(entries.nnz, dtype=np.int8), pairs), shape=(count, count))
    graph.sum_duplicates()
    graph.data[:] = 1
    first = np.searchsorted(node, np.arange(count))
    unknowns = np.diff(np.append(first, node.size))
    parts: list[_Part] = []
    borders: list[IntArray] = []
    eliminated = np.zeros(count, dtype=bool)

    def eliminate(nodes: IntArray) -> int:
        """Number of the part that eliminates `nodes` last."""
        children: tuple[int, ...] = ()
        if nodes.size > _LEAF_NODES and (cut := _smallest_cut(graph, nodes, position)):
            children = tuple(eliminate(nodes[half]) for half in cut)
            nodes = nodes[~(cut[0] | cut[1])]
        around = [graph[nodes].indices, *(borders[child] for child in children)]
        eliminated[nodes] = True
        outside = np.unique(np.concatenate(around))
        outside = outside[~eliminated[outside]]
        borders.append(outside)
        parts.append(_Part(numbers(np.sort(nodes)), numbers(outside), children))
        return len(parts) - 1

    def numbers(nodes: IntArray) -> IntArray:
        """Unknowns of nodes."""
        lengths = unknowns[nodes]
        offset = np.arange(lengths.sum()) - np.repeat(np.cumsum(lengths) - lengths, lengths)
        unknown: IntArray = np.repeat(first[nodes], lengths) + offset
        return unknown

    eliminate(np.arange(count))
    return parts


def _smallest_cut(
    graph: "csr_array", nodes: IntArray, position: FloatArray
) -> tuple[BoolArray, BoolArray] | None:
    """Two parts of `nodes`, ``(n,)`` each, that no edge joins; the other nodes lie between them.

    None where a part is empty along all axes.
    """
    edges = graph[nodes][:, nodes]
    best, least = None, np.inf
    for coordinate in position[nodes].T:
        lower, upper = _cut_along(edges, np.argsort(coordinate, kind="stable"))
        sizes = int(lower.sum()), int(upper.sum())
        between = nodes.size - sum(sizes)
        cost = between * (1 + _UNEQUAL * abs(sizes[0] - sizes[1]) / nodes.size)
        if min(sizes) > 0 and cost < least:
            best, least = (lower, upper), cost
    return best


def _cut_along(edges: "csr_array", order: IntArray) -> tuple[BoolArray, BoolArray]:
    """Nodes below and above the smallest cut in the middle of `order`, ``(n,)`` each.

    A node of the middle is an edge of capacity 1 from its entry to its exit, so that the maximum
    flow from the nodes before it to those after it is the size of the smallest cut.
    """
    from scipy.sparse import coo_array, csr_matrix
    from scipy.sparse.csgraph import breadth_first_order, maximum_flow

    begin, end = (int(share * order.size) for share in _BAND)
    upper = np.zeros(order.size, dtype=bool)
    upper[order[end:]] = True
    lower = np.zeros(order.size, dtype=bool)
    lower[order[:begin]] = True
    next_to_upper = (edges @ upper.astype(np.int64)) > 0
    lower &= ~next_to_upper  # those are in every cut
    next_to_lower = np.asarray((edges @ lower.astype(np.int64)) > 0)
    next_to_lower[order[:begin]] = True
    middle = np.flatnonzero(~(lower | upper))
    count = middle.size
    row = np.full(order.size, -1)
    row[middle] = np.arange(count)
    links = edges[middle][:, middle].tocoo()
    node, other = (axis.astype(np.int64) for axis in links.coords)
    before, after = row[middle[next_to_lower[middle]]], row[middle[next_to_upper[middle]]]
    source, sink = 2 * count, 2 * count + 1
    entry = np.arange(count)
    start = np.concatenate([entry, node + count, np.full(before.size, source), after + count])
    stop = np.concatenate([entry + count, other, before, np.full(after.size, sink)])
    capacity = np.full(start.size, count + 1, dtype=np.int32)
    capacity[:count] = 1
    network = csr_matrix(coo_array((capacity, (start, stop)), shape=(sink + 1, sink + 1)))
    network.sort_indices()
    left = network - maximum_flow(network, source, sink).flow
    left.eliminate_zeros()
    reached = np.zeros(sink + 1, dtype=bool)
    reached[breadth_first_order(left, source, return_predecessors=False)] = True
    lower[middle[reached[count:source]]] = True  # its exit is reached
    upper[middle[~reached[:count]]] = True
    return lower, upper
