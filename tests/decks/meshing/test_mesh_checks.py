"""What is no mesh is refused with the reason, in memory and as a stored file."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from decks.finger import AfferentSite
from decks.mesh import Mesh, read_mesh, write_mesh
from decks.presets import stored_mesh
from fembridge.errors import FingerError


def grid(columns, count=3, step=1.0):
    """Squares in the epidermis, `columns` x `count`."""
    x, y = np.meshgrid(np.arange(columns + 1), -np.arange(count + 1))
    node_mm = np.stack([x.ravel(), y.ravel()], -1) * step
    upper = (np.arange(count)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    lower = upper + columns + 1
    quad = np.stack([lower, lower + 1, upper + 1, upper], -1)
    return Mesh(node_mm, quad, np.ones(len(quad), dtype=int))


def refused(words, node_mm, quad, layer=None):
    layer = np.ones(len(quad), dtype=int) if layer is None else layer
    with pytest.raises(FingerError, match=words):
        Mesh(node_mm, quad, layer)


SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float)
ONE = np.array([[0, 1, 2, 3]])


def test_a_clockwise_quad_is_refused():
    refused(r"element 1 at \(0\.500, 0\.500\) mm is clockwise", SQUARE, ONE[:, ::-1])


def test_a_folded_quad_is_refused():
    arrow = np.array([[0, 0], [1, 0], [0.2, 0.2], [0, 1]], dtype=float)
    refused("element 1 .* is folded: scaled Jacobian -0", arrow, ONE)


def test_a_quad_whose_edges_cross_is_refused():
    refused("is folded", SQUARE[[0, 1, 3, 2]], ONE)


def test_a_quad_with_a_flat_corner_is_refused():
    triangle = np.array([[0, 0], [1, 0], [0.5, 0.5], [0, 1]], dtype=float)
    refused("is folded: scaled Jacobian 0.00", triangle, ONE)


def test_a_skewed_quad_is_refused_and_a_less_skewed_one_taken():
    lean = np.array([0.0, 0.0, 1.0, 1.0])[:, None] * [1.0, 0.0]
    refused("too skewed: scaled Jacobian 0.27", SQUARE + 3.5 * lean, ONE)
    assert_allclose(Mesh(SQUARE + lean, ONE, [1]).scaled_jacobian(), 0.5**0.5)


def test_a_hole_is_a_gap():
    whole = grid(3)
    holed = np.delete(whole.quad, 4, axis=0)
    refused("not one closed line: layers leave a gap", whole.node_mm, holed)


def test_two_pieces_are_a_gap():
    apart = np.concatenate([SQUARE, SQUARE + 5])
    refused("layers leave a gap", apart, np.concatenate([ONE, ONE + 4]))


def test_two_pieces_that_share_one_node_are_a_gap():
    nodes = np.concatenate([SQUARE, [[2, 1], [2, 2], [1, 2]]])
    refused("layers leave a gap", nodes, [[0, 1, 2, 3], [2, 4, 5, 6]])


def test_a_hanging_node_is_a_gap():
    """A large square beside two small ones: their common node is in nobody's edge."""
    nodes = [[0, 0], [2, 0], [2, 2], [0, 2], [3, 0], [3, 1], [2, 1], [3, 2]]
    quads = [[0, 1, 2, 3], [1, 4, 5, 6], [6, 5, 7, 2]]
    refused(r"layers leave a gap|layers overlap", nodes, quads)


def test_two_elements_on_the_same_side_of_an_edge_overlap():
    nodes = np.concatenate([SQUARE, [[1.2, 1.5], [-0.2, 1.5]]])
    refused("same side of an edge: layers overlap", nodes, [[0, 1, 2, 3], [0, 1, 4, 5]])


def test_elements_that_go_around_and_over_the_first_overlap():
    """A ring that closes on itself without a common edge: every quad is sound."""
    angle = np.radians(np.linspace(0, 410, 21))
    around = np.stack([np.cos(angle), np.sin(angle)], -1)
    nodes = np.concatenate([around, 2 * around])
    start = np.arange(20)
    quads = np.stack([start, start + 21, start + 22, start + 1], -1)
    refused(r"the outline crosses itself near .* layers overlap", nodes, quads)


def test_a_strip_may_go_around_without_touching_itself():
    angle = np.radians(np.linspace(0, 340, 18))
    around = np.stack([np.cos(angle), np.sin(angle)], -1)
    start = np.arange(17)
    quads = np.stack([start, start + 18, start + 19, start + 1], -1)
    mesh = Mesh(np.concatenate([around, 2 * around]), quads, np.ones(17))
    assert len(mesh.outline()[0]) == 36


def test_a_node_that_no_element_uses_is_refused():
    nodes = np.concatenate([SQUARE, [[9, 9]]])
    refused("node 5 belongs to no element", nodes, ONE)


def test_two_nodes_in_one_place_are_refused():
    """Two squares side by side that do not share their nodes: a slit."""
    nodes = np.concatenate([SQUARE, SQUARE + np.array([1, 0])])
    words = r"two nodes in one place, at \(1\.0+, 0\.0+\) mm"
    refused(words, nodes, np.concatenate([ONE, ONE + 4]))


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_node_without_a_place_is_refused(value):
    nodes = SQUARE.copy()
    nodes[2, 1] = value
    refused("node 3 is at", nodes, ONE)


def test_tables_that_do_not_belong_together_are_refused():
    refused(r"expected nodes \(N, 2\), got \(4, 3\)", np.zeros((4, 3)), ONE)
    refused(r"expected quads \(E, 4\), got \(1, 3\)", SQUARE, ONE[:, :3])
    refused(r"expected quads \(E, 4\), got \(0, 4\)", SQUARE, ONE[:0])
    refused("quads name nodes 1 to 5, there are 1 to 4", SQUARE, [[0, 1, 2, 4]])
    refused("quads name nodes 0 to 3", SQUARE, ONE - 1)
    refused("expected a layer for 1 quads, got", SQUARE, ONE, [1, 1])
    refused("layers 6 to 6, expected 0 to 5", SQUARE, ONE, [6])
    refused("layers -1 to -1", SQUARE, ONE, [-1])


@given(st.integers(2, 6), st.integers(2, 6), st.integers(0, 2**32 - 1))
def test_a_shaken_grid_is_a_mesh(columns, count, seed):
    still = grid(columns, count)
    shaken = np.random.default_rng(seed).uniform(-0.2, 0.2, still.node_mm.shape)
    mesh = Mesh(still.node_mm + shaken, still.quad, still.layer)
    assert len(mesh.outline()[0]) == 2 * (columns + count)


def test_a_layer_of_one_row_has_no_node_inside():
    rows = grid(4, 3)
    flat = Mesh(rows.node_mm, rows.quad, np.repeat([0, 1, 2], 4))
    with pytest.raises(FingerError, match="no node lies inside epidermis: use more"):
        flat.node_at(AfferentSite("epidermis", 0.0, 0.0))


def test_a_mesh_cannot_be_changed_and_keeps_its_own_arrays():
    with pytest.raises(ValueError, match="read-only"):
        grid(2).node_mm[0, 0] = 1.0
    nodes = SQUARE.copy()
    own = Mesh(nodes, ONE, [1])
    nodes[0, 0] = 99.0
    assert own.node_mm[0, 0] == 0.0


def test_a_mesh_may_be_stored_under_any_name(tmp_path):
    write_mesh(tmp_path / "mine.mesh", grid(2))
    assert_array_equal(read_mesh(tmp_path / "mine.mesh").quad, grid(2).quad)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.mesh"]


@pytest.mark.parametrize("kind", ["absent", "empty", "cut", "text", "array", "folder"])
def test_what_is_no_stored_mesh_is_refused(kind, tmp_path):
    path = tmp_path / "mesh.npz"
    whole = stored_mesh("quick").read_bytes()
    if kind == "folder":
        path.mkdir()
    elif kind == "array":
        with path.open("wb") as file:
            np.save(file, np.zeros(3))
    elif kind != "absent":
        path.write_bytes({"empty": b"", "cut": whole[:9000], "text": b"mesh"}[kind])
    with pytest.raises(FingerError, match="not a stored mesh"):
        read_mesh(path)


def test_a_flipped_bit_in_a_stored_mesh_is_noticed(tmp_path):
    whole = bytearray(stored_mesh("quick").read_bytes())
    whole[5000] ^= 0x10
    path = tmp_path / "mesh.npz"
    path.write_bytes(whole)
    with pytest.raises(FingerError, match=r"mesh\.npz"):
        read_mesh(path)


def test_a_stored_mesh_that_is_not_sound_is_refused_by_its_name(tmp_path):
    path = tmp_path / "mesh.npz"
    np.savez(path, node_mm=SQUARE, quad=ONE[:, ::-1], layer=[1])
    with pytest.raises(FingerError, match=r"mesh\.npz: element 1 .* clockwise"):
        read_mesh(path)
