"""The mesh as a value: every kind of element, every storage, and damage."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from fembridge.errors import ResultError
from fembridge.results.frd_format.element import NODES_OF_TYPE
from fembridge.results.frd_format.grid import KIND_OF_TYPE, read_grid

ELEMENTS = st.lists(
    st.tuples(st.sampled_from(sorted(NODES_OF_TYPE)), st.integers(1, 3)), min_size=1, max_size=40
)


@settings(deadline=None)
@given(
    kinds=ELEMENTS,
    mesh_flag=st.sampled_from([1, 2]),
    line_end=st.sampled_from(["\n", "\r\n"]),
    runs=st.integers(1, 40),
    seed=st.integers(0, 99),
)
def test_any_mix_of_elements_is_read_as_it_was_written(
    write_frd, kinds, mesh_flag, line_end, runs, seed
):
    rng, nodes = np.random.default_rng(seed), [3, 1, *range(7, 50)]
    elements = [
        (kind, material, rng.choice(nodes, NODES_OF_TYPE[kind]).tolist())
        for kind, material in kinds
        for _ in range(1 + runs // len(kinds))
    ]
    if mesh_flag == 2:
        line_end = "\n"  # among packed numbers it would be one of them
    path = write_frd([], nodes=nodes, elements=elements, mesh_flag=mesh_flag, line_end=line_end)
    grid = read_grid(path)
    assert grid.nodes.tolist() == nodes
    assert grid.coordinates_mm.tolist() == [[node, 0, 0] for node in nodes]
    assert grid.materials == {1: "EPI", 2: "DER"}
    numbered = [(number, *row) for number, row in enumerate(elements, start=1)]
    assert [cells.kind for cells in grid.cells] == [
        KIND_OF_TYPE[kind] for kind in sorted({kind for kind, _, _ in elements})
    ]
    for cells in grid.cells:
        mine = [row for row in numbered if KIND_OF_TYPE[row[1]] == cells.kind]
        assert cells.ids.tolist() == [number for number, *_ in mine]
        assert cells.material.tolist() == [material for _, _, material, _ in mine]
        assert cells.corners.tolist() == [corners for *_, corners in mine]
    met = [
        len({material for _, material, corners in elements if node in corners}) for node in nodes
    ]
    assert grid.materials_met().tolist() == met
    assert grid.materials_of(7) == tuple(
        sorted({material for _, material, corners in elements if 7 in corners})
    )


@pytest.mark.parametrize("mesh_flag", [1, 2])
@pytest.mark.parametrize("chunk_bytes", [300, 997, 5000])
def test_a_mesh_larger_than_a_chunk_is_read_whole(write_frd, mesh_flag, chunk_bytes, monkeypatch):
    monkeypatch.setattr("fembridge.results.frd_format.element.CHUNK_BYTES", chunk_bytes)
    monkeypatch.setattr("fembridge.results.frd_format.table.CHUNK_BYTES", chunk_bytes)
    nodes = list(range(1, 130))
    elements = [(9, 1, range(k, k + 4)) for k in range(1, 99)]
    elements[50:50] = [(4, 2, range(k, k + 20)) for k in range(1, 77)]
    path = write_frd([], nodes=nodes, elements=elements, mesh_flag=mesh_flag)
    he20, qu4 = read_grid(path).cells
    assert (he20.kind, qu4.kind) == ("he20", "qu4")
    assert he20.corners.tolist() == [list(range(k, k + 20)) for k in range(1, 77)]
    assert qu4.corners.tolist() == [list(range(k, k + 4)) for k in range(1, 99)]
    assert qu4.ids.tolist() == [*range(1, 51), *range(127, 175)]


def test_all_storages_of_one_run_have_the_same_mesh(samples):
    text, single, double = (
        read_grid(samples / f"cpe4_{how}.frd") for how in ("ascii", "bin_f32", "bin_f64")
    )
    for other in (single, double):
        assert_array_equal(other.nodes, text.nodes)
        assert_allclose(other.coordinates_mm, text.coordinates_mm, rtol=5.1e-6)
        assert_array_equal(other.cells[0].corners, text.cells[0].corners)
        assert_array_equal(other.cells[0].material, text.cells[0].material)
        assert other.materials == text.materials


def test_the_mesh_of_a_sample_is_that_of_its_deck(samples):
    deck = (samples / "interface_cpe8r.inp").read_text().splitlines()
    start = deck.index("*NODE, NSET=NALL") + 1
    nodes, elements, section = {}, {}, "*NODE"
    for line in deck[start:]:
        number, *words = line.split(",")
        if line.startswith("*"):
            section = number
        elif section == "*NODE":
            nodes[int(number)] = [float(word) for word in words]
        elif section == "*ELEMENT":
            elements[int(number)] = [int(word) for word in words]
    grid = read_grid(samples / "interface_cpe8r.frd")
    places = grid.coordinates_mm.tolist()
    assert dict(zip(grid.nodes.tolist(), places, strict=True)) == nodes
    (cells,) = grid.cells
    assert cells.kind == "qu8"
    assert dict(zip(cells.ids.tolist(), cells.corners.tolist(), strict=True)) == elements
    on_boundary = grid.coordinates_mm[:, 1] == 0.5
    assert_array_equal(grid.materials_met() == 2, on_boundary)


def test_blank_counts_and_beams_are_read(samples):
    """As in the file of the last iterations: contact springs are two-node beams."""
    grid = read_grid(samples / "cpe4_lastiter_ResultsForLastIterations.frd")
    assert grid.nodes.size == 188
    assert [(c.kind, c.corners.shape) for c in grid.cells] == [("he8", (30, 8)), ("be2", (112, 2))]


def test_arrays_are_read_only(samples):
    grid = read_grid(samples / "cpe4_ascii.frd")
    with pytest.raises(ValueError, match="read-only"):
        grid.coordinates_mm[0, 0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        grid.cells[0].corners[0, 0] = 1


def test_a_file_without_a_mesh_is_told(samples):
    with pytest.raises(ResultError, match="no whole block of nodes"):
        read_grid(samples / "cpe4_nosolver.frd")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (b" -2         1         2", b" -2         1         x", "is no element"),
        (b" -2         1         2", b" -2         1        77", "has node 77, which"),
        (b"    9    0    1", b"   10    0    1", "type 10 has 4 nodes, expected 8"),
        (b"    9    0    1", b"   19    0    1", "type 19 has 4 nodes"),
        (b" -1         1    9", b" -1         x    9", "is no element"),
        (b"2 2.00000E+00", b"2 2.0O000E+00", "node block, node 2, x: "),
        (b"2 2.00000E+00", b"2         NAN", "node 2: node block x is nan"),
        (b" -1         2 2.0", b" -1         1 2.0", "a node is there twice"),
    ],
)
def test_a_damaged_mesh_is_told(write_frd, old, new, words):
    path = write_frd([])
    content = path.read_bytes()
    assert content.count(old) == 1
    path.write_bytes(content.replace(old, new))
    with pytest.raises(ResultError, match=words):
        read_grid(path)


def test_a_packed_element_of_unknown_type_is_told(write_frd):
    path = write_frd([], mesh_flag=2)
    content = bytearray(path.read_bytes())
    at = content.index(b"    3C")
    first = content.index(b"\n", at) + 1
    content[first + 4] = 77
    path.write_bytes(content)
    with pytest.raises(ResultError, match="element type 77 at byte"):
        read_grid(path)
