"""What is kept of the influence of forces from touch to touch."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from fembridge.touching import influence, stress
from fembridge.touching.influence import drop_influence, kept_bytes, read_influence
from fembridge.touching.pad_file import resolve_pad
from fembridge.touching.ridged_pad import with_ridges

PAD = resolve_pad("reference")
PLACES = np.array(["epidermis"] * 3), np.array([0.0, 1.0, -2.0]), np.array([0.0, 0.5, 3.0]), None
PLACES = (*PLACES[:3], np.full(3, 0.55))


@pytest.fixture(autouse=True)
def nothing_kept():
    drop_influence()
    yield
    drop_influence()


def nodes(*columns):
    return PAD.nodes_from({"column": np.array(columns), "row": np.array(columns) - 18})


def whole(tensors, normal):
    del normal
    return tensors


def test_what_is_kept_is_what_the_pad_computes_whichever_nodes_came_before():
    for some in (nodes(18, 20), nodes(20, 17, 18), nodes(18, 20), nodes(30)):
        expected = PAD.influence_pa(some, *PLACES, (0.0, -0.4))
        for pad in (PAD, with_ridges(PAD, "loop")):
            found = read_influence(pad, some, PLACES, (0.0, -0.4), whole)
            expected_rows = expected.reshape(-1, some.size).T
            assert_allclose(found, expected_rows, rtol=1e-5, atol=1e-4 * np.abs(expected).max())


def test_only_new_nodes_are_computed(monkeypatch):
    asked = []
    compute = type(PAD).influence_pa

    def count(pad, some, *arguments):
        asked.append(some.size)
        return compute(pad, some, *arguments)

    monkeypatch.setattr(type(PAD), "influence_pa", count)
    for some in (nodes(18, 20), nodes(18, 20), nodes(17, 18)):
        read_influence(PAD, some, PLACES, (0.0, 0.0), whole)
    assert asked == [2, 1]
    other = (PLACES[0], PLACES[1] + 0.1, *PLACES[2:])
    read_influence(PAD, nodes(18), other, (0.0, 0.0), whole)  # other places
    read_influence(PAD, nodes(18), PLACES, (0.0, 0.1), whole)  # other friction
    assert asked == [2, 1, 1, 1]


def test_the_memory_is_bounded_and_the_oldest_goes_first(monkeypatch):
    size = 4 * 6 * 3  # bytes of a node
    monkeypatch.setattr(influence, "MOST_BYTES", 5 * size)
    for shift in (0.0, 0.1, 0.2):
        places = (PLACES[0], PLACES[1] + shift, *PLACES[2:])
        read_influence(PAD, nodes(18, 20), places, (0.0, 0.0), whole)
        assert kept_bytes() <= 5 * size
    assert kept_bytes() == 4 * size
    found = read_influence(PAD, nodes(*range(10, 17)), PLACES, (0.0, 0.0), whole)
    assert found.shape == (7, 18)  # larger than all that may be kept
    assert kept_bytes() == 0


def test_five_numbers_have_the_length_of_the_von_mises_stress():
    rng = np.random.default_rng(1)
    tensors = rng.normal(size=(6, 4, 9)).astype(np.float32)
    forces = rng.uniform(0, 1, (300, 9)).astype(np.float32)
    deviator = stress._deviator(tensors, np.zeros((4, 3)))
    found = stress._lengths(forces, deviator.reshape(-1, 9).T)
    assert_allclose(found, stress.von_mises_pa(tensors, forces), rtol=2e-5)
