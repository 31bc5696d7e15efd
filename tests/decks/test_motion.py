"""The probe's way: one step where depth is all, several where time counts."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from decks.motion import HOLD_INCREMENTS, RAMP_INCREMENTS, SUBSTEPS, motion_of
from fembridge.errors import DeckError, StimulusError
from fembridge.stimulus import Stimulus

DT_MS = 0.5


def stimulus(preindent_um=0.0, samples=7):
    wave_um = 40 * np.sin(np.arange(samples))
    wave_um[0] = 0.0
    window_ms = (0.0, (samples - 1) * DT_MS)
    return Stimulus("s", preindent_um + wave_um, DT_MS, window_ms, preindent_um)


@given(
    preindent_um=st.sampled_from([0.0, 300.0]),
    procedure=st.sampled_from(["static", "viscous", "dynamic"]),
    relaxing_s=st.sampled_from([(), (0.02,), (0.001, 0.01, 5.0)]),
    samples=st.integers(2, 40),
)
def test_phases_and_samples_tell_the_same(preindent_um, procedure, relaxing_s, samples):
    wave = stimulus(preindent_um, samples)
    motion = motion_of(wave, procedure, relaxing_s)

    assert sum(one.increments for one in motion.phases) == motion.increments
    ends_s = np.cumsum([one.increments * one.dt_s for one in motion.phases])
    assert_allclose(ends_s[-1], motion.time_s[-1], rtol=1e-12)
    assert_allclose(
        motion.depth_mm[motion.ramp :: motion.phases[-1].sample_increments],
        1e-3 * wave.displacement_um,
        rtol=0,
        atol=1e-15,
    )
    fine_s = 5e-4 / motion.phases[-1].sample_increments
    assert_allclose(np.diff(motion.time_s[motion.ramp :]), fine_s, rtol=1e-9)
    assert motion.phases[-1].procedure == procedure
    assert (motion.depth_mm[0], motion.time_s[0]) == (0.0, 0.0)


def test_relaxation_begins_where_the_way_to_the_pre_indentation_ends():
    motion = motion_of(stimulus(300.0), "viscous", relaxing_s=(0.02,))
    ramp, hold, waves = motion.phases
    assert (ramp.procedure, ramp.increments) == ("static", RAMP_INCREMENTS)
    assert (hold.procedure, hold.increments) == ("viscous", HOLD_INCREMENTS)
    assert (waves.procedure, waves.increments) == ("viscous", 6)
    assert motion.ramp == RAMP_INCREMENTS + HOLD_INCREMENTS
    assert_allclose(motion.start_s, 0.01 + 4 * 5 * 0.02)


def test_a_hold_of_fast_and_slow_branches_has_increments_that_the_fast_ones_stand():
    """As much of the slow branch is left as after four increments of five time constants."""
    motion = motion_of(stimulus(300.0), "viscous", relaxing_s=(0.001, 0.01, 10.0))
    _, hold, _ = motion.phases
    assert_allclose(hold.dt_s, 0.4)
    left = (1 + hold.dt_s / 10.0) ** -hold.increments
    assert 0.95 * 6.0**-4 < left <= 6.0**-4
    few = motion_of(stimulus(300.0), "viscous", relaxing_s=(0.02, 0.5)).phases[1]
    assert (few.dt_s, few.increments) == (2.5, HOLD_INCREMENTS)


def test_where_inertia_counts_the_ramp_is_smooth_and_in_the_same_step():
    motion = motion_of(stimulus(300.0), "dynamic", relaxing_s=(0.02,))

    [only] = motion.phases
    assert (only.procedure, only.sample_increments) == ("dynamic", SUBSTEPS)
    assert_allclose(motion.start_s, 0.02)
    ramp_mm = motion.depth_mm[: motion.ramp + 1]
    assert (np.diff(ramp_mm) > 0).all()
    speed = np.diff(ramp_mm) / np.diff(motion.time_s[: motion.ramp + 1])
    # A cosine's speed is pi/2 of the mean, its ends are at rest.
    assert_allclose(speed.max(), np.pi / 2 * 0.3 / 0.02, rtol=2e-3)
    assert speed[0] < 0.05 * speed.max()


def test_between_samples_the_probe_is_on_the_cubic_through_four_of_them():
    at_ms = np.arange(12) * DT_MS
    cubic_um = 3.0 * at_ms - 2.0 * at_ms**2 + 0.4 * at_ms**3
    wave = Stimulus("c", cubic_um, DT_MS, (0.0, 5.5))
    motion = motion_of(wave, "dynamic")
    fine_ms = 1e3 * motion.time_s[3:-3]
    expected_um = 3.0 * fine_ms - 2.0 * fine_ms**2 + 0.4 * fine_ms**3
    assert_allclose(1e3 * motion.depth_mm[3:-3], expected_um, rtol=1e-12)


@pytest.mark.parametrize("procedure", ["static", "viscous"])
def test_a_slide_begins_with_the_stimulus(procedure):
    slid = stimulus(300.0).sliding(8.0)
    motion = motion_of(slid, procedure, relaxing_s=(0.02,))
    assert (motion.aside_mm[: motion.ramp + 1] == 0).all()
    moved_mm = motion.aside_mm[motion.ramp :]
    assert_allclose(moved_mm, 8.0 * (motion.time_s[motion.ramp :] - motion.start_s))
    assert slid.id == "s_slide_8"
    assert slid.origin["slide_mm_per_s"] == 8.0


def test_a_slide_or_a_way_aside_that_is_none_is_refused():
    """It belongs to the samples and begins at 0."""
    for speed in (0.0, np.nan, np.inf):
        with pytest.raises(StimulusError) as caught:
            stimulus().sliding(speed)
        assert (caught.value.argument, caught.value.found) == ("slide_mm_per_s", speed)
    for aside in (np.zeros(3), np.full(7, 1.0), np.array([0.0] * 6 + [np.nan])):
        with pytest.raises(StimulusError) as caught:
            replace(stimulus(), aside_um=aside)
        assert (caught.value.argument, caught.value.found) == ("aside_um", aside.shape)


@pytest.mark.parametrize(
    ("preindent_um", "first_um"), [(500.0, 0.0), (500.0, 499.0), (500.0, -500.0), (0.0, 3.0)]
)
def test_a_stimulus_that_would_make_the_probe_jump_is_refused(preindent_um, first_um):
    depth_um = np.full(5, preindent_um)
    depth_um[0] = first_um
    with pytest.raises(DeckError, match=f"{first_um:g} um, expected {preindent_um:g} um"):
        motion_of(Stimulus("hold", depth_um, 0.5, (0.0, 1.0), preindent_um))
