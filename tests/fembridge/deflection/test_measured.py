"""A run in which the probe did not push is refused, whatever the solver says."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from fembridge.deflection.press import both_sides, why_not

FORCE = np.linspace(0.0, 0.035, 41) ** 1.1


def test_a_run_in_which_force_grows_and_the_skin_follows_is_accepted():
    assert why_not(1.0, 0.999, FORCE) is None


@pytest.mark.parametrize(
    ("apex_mm", "force", "words"),
    [
        (0.999, np.zeros(41), "the probe did not push: the force at 1 mm is 0 N/mm"),
        (0.999, -FORCE, "the probe did not push"),
        (0.999, np.where(np.arange(41) == 7, np.nan, FORCE), "the probe did not push"),
        (0.0, FORCE, "slipped between its nodes"),
        (0.94, FORCE, "moved 0.94 mm, expected 0.95 to 1.01 mm"),
        (1.03, FORCE, "slipped between its nodes"),
        (np.nan, FORCE, "slipped between its nodes"),
        (0.999, np.where(np.arange(41) == 30, 0.0, FORCE), "the force fell by"),
    ],
    ids=[
        "no force",
        "pulled",
        "no number",
        "skin at rest",
        "skin lags",
        "skin ahead",
        "skin nowhere",
        "contact lost for one increment",
    ],
)
def test_a_run_in_which_the_probe_did_not_push_is_refused(apex_mm, force, words):
    assert words in why_not(1.0, apex_mm, force)


@given(
    x_mm=st.lists(st.floats(0.01, 8), min_size=2, max_size=30, unique=True),
    slope=st.floats(-0.01, 0.01),
)
def test_folding_gives_the_even_part_and_tells_the_odd_part(x_mm, slope):
    """Of ``cos(x/8) + slope x`` the mean of both sides is the cosine alone."""
    right_mm = np.sort(x_mm)
    all_mm = np.concatenate([-right_mm[::-1], [0.0], right_mm])
    down_mm = np.cos(all_mm / 8) + slope * all_mm
    distance_mm, mean_mm, unlike_mm = both_sides(all_mm, down_mm)
    assert_allclose(distance_mm, [0.0, *right_mm])
    assert_allclose(mean_mm, np.cos(distance_mm / 8), atol=1e-12)
    assert_allclose(unlike_mm, 2 * abs(slope) * right_mm[-1], rtol=1e-9, atol=1e-12)
