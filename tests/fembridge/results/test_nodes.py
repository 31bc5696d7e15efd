"""Nodes by place, by set and by any mixture of choices."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fembridge.errors import ResultError, UsageError
from fembridge.results.nodes import choose_nodes, near_nodes
from fembridge.results.read_options import ReadOptions

KINDS = ["cpe4_ascii", "cpe4_bin_f32", "cpe4_bin_f64", "cpe4_2step_mixed"]


@pytest.mark.parametrize("name", KINDS)
def test_the_nearest_node_is_said_with_its_distance(samples, name):
    """Node 11 of the 6 x 4 grid of 3 x 1 mm stands at 1.5, 0.25."""
    [(node, words)] = near_nodes(samples / f"{name}.frd", [(1.5, 0.3)])
    assert node == 11
    assert words == "near 1.5, 0.3: node 11 at 1.5, 0.25, 0.05 mm away"


def test_a_nearer_node_without_results_is_named(samples):
    path = samples / "cpe8r_nset_bin_f32.frd"
    [(node, words)] = near_nodes(path, [(0.0, 0.0, 0.0)])
    assert node == 27
    assert words.endswith("(node 1 is nearer and has no results)")


@pytest.mark.parametrize("place", [(1.0,), (1.0, 2.0, 3.0, 4.0), (1.0, float("nan"))])
def test_a_place_that_is_none_is_misuse(samples, place):
    with pytest.raises(UsageError):
        near_nodes(samples / "cpe4_ascii.frd", [place])


def test_a_deep_mesh_needs_z(block, write_frd):
    import struct

    path = write_frd([block("STRESS", 1, 1e-3, [(1, [1.0] * 6)])], mesh_flag=3)
    content = path.read_bytes()
    old, new = struct.pack("<i3d", 2, 2, 0, 0), struct.pack("<i3d", 2, 2, 0, 1.5)
    path.write_bytes(content.replace(old, new))
    with pytest.raises(UsageError, match=r"z from 0 to 1\.5: name a place as x,y,z"):
        near_nodes(path, [(1, 0)])
    assert near_nodes(path, [(1, 0, 0)])[0][0] == 1


def test_without_results_there_is_no_nearest_node(samples):
    with pytest.raises(ResultError):
        near_nodes(samples / "cpe4_negjac.frd", [(0, 0)])


@settings(max_examples=30)
@given(seed=st.integers(0, 99), mesh_flag=st.sampled_from([1, 3]), count=st.integers(1, 40))
def test_any_place_gives_what_a_plain_search_gives(block, write_frd, seed, mesh_flag, count):
    """The writer puts node n at x = n."""
    rng = np.random.default_rng(seed)
    mesh = sorted(rng.choice(np.arange(1, 200), count + 5, replace=False).tolist())
    held = sorted(rng.choice(mesh, count, replace=False).tolist())
    path = write_frd(
        [block("STRESS", 1, 1e-3, [(n, [1.0] * 6) for n in held])],
        nodes=mesh,
        elements=[(9, 1, mesh[:4])],
        mesh_flag=mesh_flag,
    )
    x_mm = float(rng.uniform(-5, 205))
    [(node, words)] = near_nodes(path, [(x_mm, 0.0)])
    assert node == min(held, key=lambda n: (abs(n - x_mm), n))
    assert f"{abs(node - x_mm):.3g} mm away" in words


def test_numbers_sets_and_places_go_together_each_node_once(samples):
    logged = []
    path = samples / "cpe4_ascii.frd"
    options = ReadOptions(log=logged.append)
    found = choose_nodes(path, [25, 1], ["probes"], [(1.5, 0.3)], options=options)
    assert found == [25, 1, 11, 18]
    assert logged[0] == "set probes of cpe4_ascii.inp: 3 nodes, 11, 18, 25"
    assert logged[1].startswith("near 1.5, 0.3: node 11")


def test_a_deck_elsewhere_can_be_named(samples, tmp_path):
    deck = tmp_path / "mine.inp"
    deck.write_text("*NSET, NSET=MINE\n25, 11\n*NSET, NSET=NONE\n")
    path = samples / "cpe4_ascii.frd"
    assert choose_nodes(path, sets=["mine"], deck=deck) == [25, 11]
    with pytest.raises(ResultError):
        choose_nodes(path, sets=["NONE"], deck=deck)
