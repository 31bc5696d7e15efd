"""Files that Marc wrote, against the listings of the same runs."""

import re

import numpy as np
import pytest
from numpy.testing import assert_allclose

# Printed with five digits (E10.4), from single precision.
RTOL = 6e-5


def status_rows(path):
    """Read rows of a status file: increment, recycles, cut-backs, time, maximum."""
    rows = []
    for line in path.read_text(encoding="latin-1").splitlines():
        words = line.split()
        if len(words) == 13 and words[0].isdigit():
            numbers = [float(word) for word in words]
            rows.append((numbers[1], numbers[2], numbers[7], numbers[10], numbers[12]))
    return np.array(rows)


@pytest.mark.parametrize(
    ("name", "increments", "nodes", "elements", "codes"),
    [("nour_linear", 2, 18, 8, 0), ("nour_plastic", 24, 85, 64, 6)],
)
def test_every_byte_of_a_run_is_read_and_agrees_with_its_status_file(
    name, increments, nodes, elements, codes, marc_samples, open_post
):
    listed = status_rows(marc_samples / f"{name}.sts")
    assert len(listed) == increments
    with open_post(marc_samples / f"{name}.t16") as post:
        assert (post.problem, post.remarks, post.unread_bytes) == (None, (), 0)
        assert (post.kind, post.revision, post.byte_order) == ("t16", 14, "little")
        assert (post.precision, post.points, len(post.codes)) == ("single", 1, codes)
        mesh = post.meshes[0]
        assert mesh.node_ids.shape == (nodes,)
        assert mesh.coordinates_mm.shape == (nodes, 3)
        assert mesh.connectivity.shape == (elements, 4)
        assert set(mesh.element_types) == {114}
        assert np.isin(mesh.connectivity, mesh.node_ids).all()
        for row, (number, recycles, cut_backs, time_s, maximum) in enumerate(listed):
            increment = post.increments[row]
            assert increment.increment == number
            assert increment.recycles == recycles
            assert increment.cut_backs == cut_backs
            assert_allclose(increment.time_s, time_s, rtol=RTOL)
            moved = np.linalg.norm(post.nodal_values(row, "Displacement"), axis=1)
            assert_allclose(moved.max(), maximum, rtol=RTOL)


def test_energies_and_sets_are_those_of_the_listing_of_the_run(marc_samples, open_post):
    """Strain, plastic and elastic energy, external work: printed in the run's .out."""
    with open_post(marc_samples / "nour_plastic.t16") as post:
        energies = post.energies(23)
        assert_allclose(
            energies[[8, 9, 15, 13]], [1.24112e5, 1.06038e5, 1.80735e4, 1.37551e5], rtol=RTOL
        )
        assert [(s.name, s.kind, s.members.tolist()) for s in post.meshes[0].sets] == [
            ("fixed_nodes", "node", [1, 10, 20, 21, 22]),
            ("tip_load_nodes", "node", [18]),
        ]
        assert [code.code for code in post.codes] == [*range(431, 437)]
        values = post.global_values(23)
        assert [*values] == ["Loadcase Percentage Completion", "fixed", "tip_load"]
        assert_allclose(values["Loadcase Percentage Completion"], 100.0)
        strain = post.element_values(23, np.arange(64))
        assert strain.shape == (64, 1, 6)
        assert not post.element_values(0, np.arange(64)).any()
        in_plane = [0, 1, 3]  # plane stress: 11, 22 and 12, nothing else is stored
        assert strain[..., in_plane].any(axis=(0, 1)).all()
        assert not np.delete(strain, in_plane, axis=-1).any()


def test_the_mesh_is_that_of_the_deck(marc_samples, open_post):
    deck = (marc_samples / "nour_plastic.dat").read_text(encoding="latin-1")
    block = deck.split("coordinates", 1)[1].splitlines()
    count = int(block[1].split()[1])
    places = {}
    for line in block[2 : 2 + count]:
        words = [line[at : at + 20] for at in (10, 30, 50)]
        real = [float(re.sub(r"(\d)([+-]\d+)$", r"\1e\2", w.strip())) for w in words]
        places[int(line[:10])] = real
    with open_post(marc_samples / "nour_plastic.t16") as post:
        mesh = post.meshes[0]
        assert sorted(places) == sorted(mesh.node_ids.tolist())
        expected = np.array([places[node] for node in mesh.node_ids.tolist()])
        assert_allclose(mesh.coordinates_mm, expected, rtol=1e-6, atol=1e-6)
