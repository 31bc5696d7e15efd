"""Factors of a stiffness matrix, compared with dense algebra and with cuts known by hand."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.sparse import coo_array, csr_array

from fembridge.solver.factorisation import Factors, _smallest_cut


def lattice(*sizes):
    """Positions ``(N, 3)`` and edges ``(E, 2)`` of a lattice with neighbours along its axes."""
    position = np.stack(np.meshgrid(*(np.arange(n) for n in sizes), indexing="ij"), -1)
    number = np.arange(np.prod(sizes)).reshape(sizes)
    edges = [
        np.stack([number.take(range(n - 1), axis).ravel(), number.take(range(1, n), axis).ravel()])
        for axis, n in enumerate(sizes)
        if n > 1
    ]
    return position.reshape(-1, 3).astype(float), np.concatenate(edges, axis=1).T


def graph_of(count, edges):
    pairs = np.concatenate([edges, edges[:, ::-1], np.repeat(np.arange(count)[:, None], 2, axis=1)])
    return csr_array(coo_array((np.ones(len(pairs), np.int8), tuple(pairs.T)), shape=(count,) * 2))


def stiffness_of(count, edges, rng, unknowns=3):
    """A positive definite matrix with a full block of `unknowns` a node and an edge."""
    graph = graph_of(count, edges).tocoo()
    blocks = rng.normal(size=(graph.nnz, unknowns, unknowns))
    rows = unknowns * graph.coords[0][:, None, None] + np.arange(unknowns)[:, None]
    columns = unknowns * graph.coords[1][:, None, None] + np.arange(unknowns)
    shape = (unknowns * count,) * 2
    places = [np.broadcast_to(axis, blocks.shape).ravel() for axis in (rows, columns)]
    half = coo_array((blocks.ravel(), tuple(places)), shape=shape).tocsr()
    matrix = half + half.T
    dominant = abs(matrix).sum(axis=1)
    return csr_array(matrix + coo_array((dominant, 2 * (np.arange(dominant.size),)), shape=shape))


@pytest.mark.parametrize("sizes", [(6, 5, 7), (40, 1, 3), (2, 2, 2)], ids=str)
def test_displacements_are_those_of_dense_algebra(sizes):
    rng = np.random.default_rng(1)
    position, edges = lattice(*sizes)
    apart = edges[position[edges[:, 0], 0] != 1]  # two bodies that no edge joins
    matrix = stiffness_of(len(position), apart, rng)
    node = np.repeat(np.arange(len(position)), 3)
    shares = []
    factors = Factors(matrix, node, position, shares.append)
    loads = rng.normal(size=(node.size, 4))
    expected = np.linalg.solve(matrix.toarray(), loads)
    assert_allclose(factors.solve(loads, np.ones(node.size, bool)), expected, atol=1e-12)
    required = np.zeros(node.size, bool)
    required[[0, node.size // 2]] = True
    assert_allclose(factors.solve(loads, required)[required], expected[required], atol=1e-12)
    assert_allclose(shares[-1], 1.0)
    assert np.all(np.diff(shares) >= 0)


def test_unknowns_of_a_node_may_be_fewer_than_three():
    rng = np.random.default_rng(2)
    position, edges = lattice(5, 5, 5)
    matrix = stiffness_of(len(position), edges, rng)
    free = np.flatnonzero(rng.random(matrix.shape[0]) < 0.7)
    rows, node = np.unique(free // 3, return_inverse=True)
    matrix = matrix[free][:, free]
    loads = rng.normal(size=(free.size, 2))
    found = Factors(matrix, node, position[rows]).solve(loads, np.ones(free.size, bool))
    assert_allclose(found, np.linalg.solve(matrix.toarray(), loads), atol=1e-12)


def test_a_matrix_that_is_not_positive_definite_is_refused():
    position, edges = lattice(4, 4, 4)
    matrix = -stiffness_of(len(position), edges, np.random.default_rng(3))
    with pytest.raises(np.linalg.LinAlgError):
        Factors(matrix, np.repeat(np.arange(len(position)), 3), position)


def test_the_cut_of_two_blocks_with_a_bridge_is_one_node_of_the_bridge():
    position, edges = lattice(11, 4, 4)
    x, y, z = position.T
    kept = (np.abs(x - 5) > 1) | ((y == 1) & (z == 2))
    number = np.cumsum(kept) - 1
    edges = number[edges[kept[edges].all(axis=1)]]
    cut = _smallest_cut(graph_of(kept.sum(), edges), np.arange(kept.sum()), position[kept])
    (between,) = np.flatnonzero(~(cut[0] | cut[1]))
    assert position[kept][between].tolist() in [[x, 1, 2] for x in (3, 4, 5, 6, 7)]


@pytest.mark.parametrize("reach", [1, 3, 12])
def test_no_edge_joins_the_parts_of_a_cut_however_far_it_reaches(reach):
    """Edges that span the middle leave their nodes to the cut."""
    count = 40
    position = np.zeros((count, 3))
    position[:, 0] = np.arange(count)
    edges = np.array(
        [(a, b) for a in range(count) for b in range(a + 1, min(a + reach + 1, count))]
    )
    graph = graph_of(count, edges)
    lower, upper = _smallest_cut(graph, np.arange(count), position)
    assert graph[np.flatnonzero(lower)][:, np.flatnonzero(upper)].nnz == 0
    assert (~(lower | upper)).sum() == reach


def test_a_clique_has_no_cut():
    count = 40
    edges = np.array([(a, b) for a in range(count) for b in range(a + 1, count)])
    position = np.random.default_rng(4).normal(size=(count, 3))
    assert _smallest_cut(graph_of(count, edges), np.arange(count), position) is None
    matrix = stiffness_of(count, edges, np.random.default_rng(5), unknowns=1)
    loads = np.eye(count)
    found = Factors(matrix, np.arange(count), position).solve(loads, np.ones(count, bool))
    assert_allclose(found, np.linalg.inv(matrix.toarray()), atol=1e-12)
