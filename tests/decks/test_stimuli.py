"""The catalogue against the appendix and a user's spelling; waveforms against closed forms."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from decks.stimuli import (
    CATALOGUE,
    MISPRINTS_UM,
    SINE_AMPLITUDES_UM,
    Diharmonic,
    Noise,
    Ramp,
    Sine,
    resolve,
)
from decks.synthesis import MARGIN_SAMPLES, at_step, band_noise, make_stimulus
from fembridge.errors import StimulusError
from fembridge.stimulus import Stimulus


def ids_of(words):
    return [entry.id for entry in resolve(words)]


def test_only_the_two_misprints_leave_the_geometric_series_of_their_frequency():
    for frequency_hz, printed_um in SINE_AMPLITUDES_UM.items():
        steps = len(printed_um) - 1
        ratio = (printed_um[-1] / printed_um[0]) ** (1 / steps)
        for step, amplitude_um in enumerate(printed_um):
            entry = Sine(frequency_hz, amplitude_um)
            fitting_um = MISPRINTS_UM.get(entry.id, amplitude_um)
            assert_allclose(fitting_um, printed_um[0] * ratio**step, rtol=2e-3)
    for misprint, series_um in MISPRINTS_UM.items():
        (entry,) = resolve(misprint)
        assert abs(entry.amplitude_um / series_um - 1) > 0.01


@pytest.mark.parametrize(
    ("word", "count"),
    [
        ("all", 82),
        ("sine", 37),
        ("sine_20", 12),
        ("sine_20_250", 1),
        ("diharm", 20),
        ("diharm_10_50", 5),
        ("noise", 25),
        ("noise_25_250", 5),
    ],
)
def test_a_word_names_all_ids_that_begin_with_it(word, count):
    named = ids_of(word)
    assert len(named) == count
    if word != "all":
        assert named == [i for i in ids_of("all") if f"{i}_".startswith(f"{word}_")]


def test_words_keep_their_order_and_each_stimulus_comes_once():
    assert ids_of(["noise_5_25_50, sine_20_250", "sine_20_250.00"]) == [
        "noise_5_25_50",
        "sine_20_250",
    ]
    assert ids_of(["sine_20_250", "sine_20"])[:2] == ["sine_20_250", "sine_20_6.71"]


@pytest.mark.parametrize(
    ("spelled", "canonical"),
    [
        ("sine_20_250.00", "sine_20_250"),
        ("sine_20.0_6.710", "sine_20_6.71"),
        ("SINE_50_113.60", "sine_50_113.6"),
        (" diharm_10_50_125. ", "diharm_10_50_125"),
        ("noise_25_250_.25", "noise_25_250_0.25"),
        ("diharm_10_100_5.62_5.32", "diharm_10_100_5.62"),
    ],
)
def test_another_spelling_of_the_numbers_is_the_same_stimulus(spelled, canonical):
    (entry,) = resolve(spelled)
    assert entry.id == canonical
    assert entry in CATALOGUE


@pytest.mark.parametrize(
    ("word", "entry"),
    [
        ("sine_40_100", Sine(40, 100)),
        ("noise_30_200_7", Noise(30, 200, 7)),
        ("diharm_10_50_20_20", Diharmonic(10, 50, 20, 20)),
        ("diharm_10_100_125_125", Diharmonic(10, 100, 125, 125)),
    ],
)
def test_numbers_of_ones_own_are_welcome_where_they_are_complete(word, entry):
    assert resolve(word) == (entry,)
    assert entry.id == word
    assert not entry.in_appendix


@pytest.mark.parametrize(
    ("word", "shown"),
    [
        ("sin_20_250", "did you mean sine_20_250"),
        ("nois_25_250", "noise_25_250"),
        ("zzz", "fembridge stimuli"),
        ("sine_40", "sine_20, sine_50, sine_100, sine_300"),
        ("diharm_10_60", "diharm_10_50, diharm_10_100"),
        ("diharm_10_50_20", "diharm_F1_F2_A1_A2"),
        ("noise_5_25_1_2", "too many numbers"),
        ("sine_20_0", "amplitude_um is 0.0"),
        ("sine_20_nan", "amplitude_um is nan"),
        ("sine_1000_5", "frequency_hz is 1000.0"),
        ("diharm_10_2000_5_5", "frequency2_hz"),
        ("sine_20_20000", "at most 10000"),
        ("sine_20_0.1234567", "6 decimals"),
        ("noise_300_20_5", "high_hz is 20.0"),
        ("noise_0.5_20_5", "low_hz is 0.5"),
        ("", "no stimulus named"),
        ("ramp", "ramp_DEPTH_UP_HOLD_DOWN"),
        ("ramp_300_100_200_0", "down_ms is 0.0"),
        ("ramp_300_100_200_0.7", "multiple of 0.5"),
        ("ramp_300_100_99900_100", "100250 ms"),
        ("rmp_300_100_200_100", "did you mean ramp"),
        ("ramp_3\u0660\u0660_100_200_100", "no stimulus"),
        ("sine_\uff12\uff10_250", "no stimulus"),
        ("sine_" + "9" * 5000 + "_5", "9..."),
    ],
)
def test_an_invalid_id_is_refused_in_one_line_as_misuse(word, shown):
    with pytest.raises(StimulusError) as refusal:
        resolve(word)
    assert shown in str(refusal.value)
    assert refusal.value.found in (word, None) or len(word) > 1000
    assert "\n" not in str(refusal.value)
    assert refusal.value.exit_code == 2


@pytest.mark.parametrize(
    ("family", "numbers", "argument"),
    [
        (Sine, (0.0, 5.0), "frequency_hz"),
        (Sine, (20.0, math.nan), "amplitude_um"),
        (Noise, (0.5, 20.0, 5.0), "low_hz"),
        (Noise, (300.0, 20.0, 5.0), "high_hz"),
        (Ramp, (300.0, 100.0, 200.0, 0.7), "down_ms"),
    ],
)
def test_a_number_that_no_stimulus_has_is_refused_by_its_name(family, numbers, argument):
    with pytest.raises(StimulusError) as caught:
        family(*numbers)
    assert caught.value.argument == argument
    assert caught.value.found in numbers


def test_each_noise_has_a_seed_of_its_own_that_its_id_gives():
    noises = [entry for entry in CATALOGUE if isinstance(entry, Noise)]
    assert len({entry.seed for entry in noises}) == 25
    # CRC-32 as a shell gives it: printf noise_25_250_10 | gzip -c | tail -c8 | od -tu4
    assert Noise(25, 250, 10).seed == 1588730578


amounts = st.integers(1, 999_999_999).map(lambda millionths: millionths / 1e6)
frequencies = st.integers(1_000_000, 999_999_999).map(lambda micro_hz: micro_hz / 1e6)


@given(frequencies, frequencies, amounts, amounts)
def test_an_id_tells_all_of_its_stimulus(f1_hz, f2_hz, a1_um, a2_um):
    assert resolve(Sine(f1_hz, a1_um).id) == (Sine(f1_hz, a1_um),)
    diharmonic = Diharmonic(f1_hz, f2_hz, a1_um, a2_um)
    assert resolve(diharmonic.id) == (diharmonic,)
    assume(f2_hz - f1_hz > 1.0)
    noise = Noise(f1_hz, f2_hz, a1_um)
    assert resolve(noise.id) == (noise,)


def test_a_ramp_is_named_by_depth_up_hold_and_down():
    (ramp,) = resolve("ramp_300_100_200_50")
    assert ramp == Ramp(depth_um=300, up_ms=100, hold_ms=200, down_ms=50)
    assert ramp.id == "ramp_300_100_200_50"
    assert ramp.corners_ms == (50, 150, 350, 400)
    assert ramp.window_ms == (0, 500)
    assert not ramp.in_appendix


# ---- Waveforms

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
    ("entry", "argument", "value"),
    [
        (Noise(5, 25, 1), "seed", -1),
        *((Sine(20, 250), "preindent_um", um) for um in (-1.0, math.nan, math.inf, 2e4)),
    ],
)
def test_a_seed_or_a_depth_out_of_range_is_refused(entry, argument, value):
    with pytest.raises(StimulusError) as caught:
        make_stimulus(entry, **{argument: value})
    assert (caught.value.argument, caught.value.found) == (argument, value)


def test_a_stimulus_that_rounds_to_nothing_is_refused():
    with pytest.raises(StimulusError, match="all samples"):
        make_stimulus(Sine(0.001, 0.0001))


def test_a_ramp_goes_straight_from_corner_to_corner():
    """At 1.5 um a sample in, 3 um a sample out, and at rest before and behind."""
    (entry,) = resolve("ramp_300_100_200_50")
    wave = make_stimulus(entry, preindent_um=75.0)
    steps = np.diff(wave.displacement_um)
    assert_allclose(steps[:100], 0.0)
    assert_allclose(steps[100:300], 1.5)
    assert_allclose(steps[300:700], 0.0)
    assert_allclose(steps[700:800], -3.0)
    assert_allclose(steps[800:], 0.0)
    assert (wave.displacement_um[0], wave.deepest_um, steps.size) == (75.0, 375.0, 1000)


@pytest.mark.parametrize("name", ["sine_300_50", "diharm_50_500_125", "noise_25_250_10"])
def test_a_finer_stimulus_of_the_catalogue_is_computed_and_has_the_same_samples(name):
    coarse = make_stimulus(name, 75.0)
    fine = at_step(coarse, 0.1)
    assert (fine.dt_ms, fine.displacement_um.size) == (0.1, 2501)
    np.testing.assert_array_equal(fine.displacement_um[::5], coarse.displacement_um)
    np.testing.assert_array_equal(
        fine.displacement_um, make_stimulus(name, 75.0, dt_ms=0.1).displacement_um
    )


def test_a_finer_waveform_goes_no_deeper_than_its_samples():
    step_um = np.where(np.arange(101) > 50, 250.0, 0.0)
    coarse = Stimulus("step", step_um, 0.5, (0.0, 50.0), aside_um=np.arange(101.0))
    fine = at_step(coarse, 0.1)
    assert (fine.displacement_um.min(), fine.displacement_um.max()) == (0.0, 250.0)
    np.testing.assert_array_equal(fine.displacement_um[::5], step_um)
    np.testing.assert_allclose(fine.aside_um, np.arange(501) / 5.0, atol=1e-9)
    assert at_step(coarse, 0.5) is coarse
