"""The catalogue against the appendix, its own arithmetic, and a user's spelling."""

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

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
from fembridge.errors import StimulusError


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
        ("sine_20_0", "amplitude_um of a sine must be > 0"),
        ("sine_20_nan", "got nan"),
        ("sine_1000_5", "below 1000"),
        ("diharm_10_2000_5_5", "frequency2_hz"),
        ("sine_20_20000", "at most 10000"),
        ("sine_20_0.1234567", "6 decimals"),
        ("noise_300_20_5", "got 300 to 20 Hz"),
        ("noise_0.5_20_5", "1 Hz or above"),
        ("", "no stimulus named"),
        ("ramp", "needs all its numbers: ramp_DEPTH_UP_HOLD_DOWN"),
        ("ramp_300_100_200_0", "down_ms of a ramp must be > 0"),
        ("ramp_300_100_200_0.7", "multiple of 0.5"),
        ("ramp_300_100_99900_100", "must end within 100000 ms"),
        ("rmp_300_100_200_100", "did you mean ramp"),
    ],
)
def test_what_is_no_stimulus_is_refused_in_one_line_as_misuse(word, shown):
    with pytest.raises(StimulusError) as refusal:
        resolve(word)
    assert shown in str(refusal.value)
    assert "\n" not in str(refusal.value)
    assert refusal.value.exit_code == 2


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
