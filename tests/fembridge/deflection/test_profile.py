"""The profile as a value and as a file."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from fembridge.deflection.profile import Deflection, read_profile, write_profile
from fembridge.errors import ResponseError

DISTANCE_MM = np.array([0.0, 0.1, 0.4, 1.0, 2.5, 6.0])


def profile(**changes):
    fields = {
        "name": "µ-mesh",
        "elements": 3698,
        "distance_mm": DISTANCE_MM,
        "deflection_mm": 1.0 - DISTANCE_MM / 8,
        "depth_mm": 1.0,
        "loading_mm": np.array([0.0, 0.25, 1.0]),
        "loading_n_per_mm": np.array([0.0, 0.008, 0.035]),
        "origin": {"solver": "calculix", "finger": {"name": "µ-mesh"}},
    }
    return Deflection(**(fields | changes))


@given(st.lists(st.floats(0, 6), min_size=1, max_size=20))
def test_between_nodes_the_profile_is_straight(distances_mm):
    found_mm = profile().at(np.array(distances_mm))
    assert_allclose(found_mm, 1.0 - np.array(distances_mm) / 8, rtol=0, atol=1e-12)


def test_at_a_node_it_is_that_of_the_node():
    bent_mm = np.array([1.0, 0.97, 0.98, 0.8, 0.4, 0.1])
    assert_array_equal(profile(deflection_mm=bent_mm).at(DISTANCE_MM), bent_mm)


@pytest.mark.parametrize("distance_mm", [-0.01, 6.01, [0.0, 7.0], np.nan])
def test_beyond_its_ends_nothing_is_known(distance_mm):
    with pytest.raises(ResponseError, match="the profile has 0 to 6 mm"):
        profile().at(np.array(distance_mm))


def test_the_force_is_that_at_the_full_depth():
    assert profile().force_n_per_mm == 0.035


def test_it_cannot_be_written_to_nor_does_it_share_what_it_was_made_of():
    made_of = 1.0 - DISTANCE_MM / 8
    made = profile(deflection_mm=made_of)
    made_of[0] = 7.0
    assert made.deflection_mm[0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        made.deflection_mm[0] = 7.0


@pytest.mark.parametrize(
    "changes",
    [
        {"distance_mm": DISTANCE_MM[1:]},
        {"distance_mm": DISTANCE_MM + 0.1},
        {"distance_mm": DISTANCE_MM[[0, 2, 1, 3, 4, 5]]},
        {"deflection_mm": np.full(6, np.nan)},
        {"deflection_mm": np.zeros((6, 1))},
        {"loading_n_per_mm": [0.0, 1.0]},
        {"depth_mm": 0.9},
        {"elements": 0},
    ],
)
def test_what_is_no_profile_is_refused(changes):
    with pytest.raises(ResponseError):
        profile(**changes)


def test_a_profile_comes_back_from_its_file_bit_by_bit(tmp_path):
    made = profile(deflection_mm=np.sqrt(np.arange(6.0)) / 3)
    path = tmp_path / "deflection.toml"
    write_profile(path, made)
    found = read_profile(path)
    for name in ("distance_mm", "deflection_mm", "loading_mm", "loading_n_per_mm"):
        assert_array_equal(getattr(found, name), getattr(made, name))
    for name in ("name", "elements", "depth_mm", "origin"):
        assert getattr(found, name) == getattr(made, name)
    first = path.read_bytes()
    write_profile(path, found)
    assert path.read_bytes() == first


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("elements = 3698", "elements = 3699", "edited or cut"),
        ("format = 1", "format = 9", "format 9, expected 1"),
        ("format = 1", "format = ", "not readable as a profile"),
    ],
)
def test_a_file_that_was_altered_is_refused(tmp_path, old, new, words):
    path = tmp_path / "deflection.toml"
    write_profile(path, profile())
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(ResponseError, match=words):
        read_profile(path)


def test_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(ResponseError, match=r"none\.toml: not readable: No such file"):
        read_profile(tmp_path / "none.toml")
