"""Receptive fields."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import fembridge as fb
from fembridge.errors import UsageError


@pytest.mark.parametrize("name", ["SA", "RA", "PC"])
def test_a_field_grows_with_depth_around_the_afferent(name):
    field = fb.receptive_field(name, depth_um=[100, 200, 400], step_mm=0.5)
    areas = field.areas["area_mm2"].to_numpy()
    assert (np.diff(areas) >= 0).all() and areas[-1] > 0
    # Mirrored about both axes, but for RA, which sits beside the middle.
    assert_allclose(field.impulses, field.impulses[:, :, ::-1])
    hot = np.argwhere(field.impulses[-1] == field.impulses[-1].max())
    assert np.abs(field.x_mm[hot[:, 0]]).min() <= 0.5
    assert field.threshold_um < 400


def test_a_threshold_is_where_the_first_impulse_is():
    field = fb.receptive_field("SA", depth_um=[100], step_mm=1.0)
    below, above = (
        fb.receptive_field("SA", depth_um=[share * field.threshold_um], step_mm=1.0)
        for share in (0.98, 1.02)
    )
    assert below.areas["area_mm2"].item() == 0 < above.areas["area_mm2"].item()


def test_a_multiple_of_threshold_is_a_depth():
    field = fb.receptive_field("RA", depth_um=[], times_threshold=[2.0], step_mm=1.0)
    assert_allclose(field.depth_um, [2 * field.threshold_um])


def test_fields_at_a_multiple_of_threshold_are_about_as_large_as_in_man():
    """Medians of Vallbo & Johansson 1980 at 4 to 5 times threshold: SA 11.0, RA 12.6 mm2."""
    shared = {"depth_um": [], "times_threshold": [4.5]}
    for name, human_mm2 in (("SA", 11.0), ("RA", 12.6)):
        branched = fb.receptive_field(name, **shared, step_mm=0.38)
        assert 0.7 * human_mm2 < branched.areas["area_mm2"].item() < 1.1 * human_mm2
    point = fb.receptive_field("RA", **shared, endings_mm=0.0, step_mm=0.5)
    assert 1.5 * point.areas["area_mm2"].item() < branched.areas["area_mm2"].item()
    assert_allclose(branched.threshold_um, point.threshold_um, rtol=0.05)


@pytest.mark.parametrize(
    "arguments", [{"afferent": "XX"}, {"criterion": 0.0}, {"depth_um": [-1.0]}, {"step_mm": 0.0}]
)
def test_what_means_nothing_is_refused(arguments):
    with pytest.raises(UsageError):
        fb.receptive_field(**{"afferent": "SA", **arguments})
