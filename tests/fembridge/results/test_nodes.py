"""Nodes by place, by set and by any mixture of choices."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from opened import near_nodes

from fembridge.errors import UsageError


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
