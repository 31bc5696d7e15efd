"""Waveforms against closed forms, SciPy's filter, and their own promises."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from decks.stimuli import CATALOGUE, Diharmonic, Noise, Sine, resolve
from decks.waveform import MARGIN_SAMPLES, band_noise, make_stimulus
from fembridge.errors import StimulusError

NOISES = [entry for entry in CATALOGUE if isinstance(entry, Noise)]
BANDS = sorted({(entry.low_hz, entry.high_hz) for entry in NOISES})
HALF_ROUNDING_UM = 0.5e-6


def test_a_stimulus_has_501_samples_from_time_0_to_250_ms_and_starts_at_0():
    for entry in CATALOGUE:
        stimulus = make_stimulus(entry)
        assert stimulus.displacement_um.shape == (501,)
        assert (stimulus.times_ms[0], stimulus.times_ms[-1]) == (0.0, 250.0)
        assert stimulus.displacement_um[0] == 0.0
        zeros = stimulus.displacement_um == 0
        assert not np.signbit(stimulus.displacement_um[zeros]).any()
        assert (stimulus.id, stimulus.window_ms) == (entry.id, entry.window_ms)


def test_a_diharmonic_is_the_sum_of_its_two_sinusoids():
    whole = make_stimulus(Diharmonic(50, 250, 125, 37.5)).displacement_um
    first = make_stimulus(Sine(50, 125)).displacement_um
    second = make_stimulus(Sine(250, 37.5)).displacement_um
    assert_allclose(whole, first + second, rtol=0, atol=3 * HALF_ROUNDING_UM)


@given(st.floats(1, 999), st.floats(0.01, 1000))
def test_a_sinusoid_is_the_closed_form_to_half_a_picometre(frequency_hz, amplitude_um):
    entry = Sine(round(frequency_hz, 6), round(amplitude_um, 6))
    stimulus = make_stimulus(entry)
    cycles = entry.frequency_hz * stimulus.times_ms / 1000
    expected_um = entry.amplitude_um * np.sin(2 * np.pi * cycles)
    assert_allclose(stimulus.displacement_um, expected_um, rtol=0, atol=1.001 * HALF_ROUNDING_UM)


@pytest.mark.parametrize(("low_hz", "high_hz"), [*BANDS, (20.0, 40.0), (10.0, 950.0)])
def test_noise_is_what_sosfiltfilt_makes_of_the_same_draw(low_hz, high_hz):
    """Away from its ends; there SciPy guesses what came before."""
    from scipy import signal  # not while tests are collected

    entry = Noise(low_hz, high_hz, 10)
    ours = band_noise(entry, np.random.default_rng(7))
    drawn = np.random.default_rng(7).standard_normal(501 + 2 * MARGIN_SAMPLES)
    sos = signal.butter(4, (low_hz, high_hz), "bandpass", fs=2000, output="sos")
    theirs = signal.sosfiltfilt(sos, drawn)[MARGIN_SAMPLES : MARGIN_SAMPLES + 501]
    untapered = slice(10, None)
    scale = ours[250] / theirs[250]
    assert_allclose(ours[untapered], scale * theirs[untapered], rtol=0, atol=1e-7 * entry.rms_um)


def test_noise_has_its_rms_exactly_before_and_to_a_picometre_after_rounding():
    for entry in NOISES:
        exact_um = band_noise(entry, np.random.default_rng(entry.seed))
        assert_allclose(np.sqrt(np.mean(exact_um**2)), entry.rms_um, rtol=1e-9)
        rounded_um = make_stimulus(entry).displacement_um
        assert_allclose(np.sqrt(np.mean(rounded_um**2)), entry.rms_um, rtol=0, atol=1e-7)


def test_the_noise_of_the_catalogue_has_not_changed_since_it_was_published():
    """First counted samples as NumPy 2.4 drew them; a release note if they move."""
    depth_um = make_stimulus(Noise(25, 250, 10)).displacement_um
    assert_array_equal(depth_um[10:14], [5.099655, 13.87306, 19.025948, 18.983725])


@pytest.mark.parametrize(
    ("entry", "options", "words"),
    [
        (Noise(5, 25, 1), {"seed": -1}, "seed must be >= 0, got -1"),
        (Sine(0.001, 0.0001), {}, "nothing is left"),
        *(
            (Sine(20, 250), {"preindent_um": um}, "sine_20_250: preindent_um must be")
            for um in (-1.0, float("nan"), float("inf"), 2e4)
        ),
    ],
)
def test_what_no_probe_can_do_is_refused(entry, options, words):
    with pytest.raises(StimulusError, match=words):
        make_stimulus(entry, **options)


def test_a_ramp_goes_straight_from_corner_to_corner():
    """At 1.5 um a sample in, 3 um a sample out, and at rest before and behind."""
    (entry,) = resolve("ramp_300_100_200_50")
    wave = make_stimulus(entry, preindent_um=75.0)
    steps = np.diff(wave.displacement_um)
    np.testing.assert_allclose(steps[:100], 0.0)
    np.testing.assert_allclose(steps[100:300], 1.5)
    np.testing.assert_allclose(steps[300:700], 0.0)
    np.testing.assert_allclose(steps[700:800], -3.0)
    np.testing.assert_allclose(steps[800:], 0.0)
    assert (wave.displacement_um[0], wave.deepest_um, steps.size) == (75.0, 375.0, 1000)
