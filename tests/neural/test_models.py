"""Every model by name: what it does to stress worked by hand."""

import math
from dataclasses import asdict, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fembridge.errors import ParameterError
from neural.encoder import encode
from neural.filters import (
    CORPUSCLE_HIGH_HZ,
    CORPUSCLE_LOW_HZ,
    CORPUSCLE_POWER,
    NEGATIVE_SHARE,
)
from neural.models import Coefficients, model_named, model_of
from neural.parameters import (
    CorpusclePcParameters,
    FadingSaParameters,
    RisingRaParameters,
    RisingSaParameters,
    TwoWayRaParameters,
)

DT_MS = 0.5

# A membrane so slow that no leak shows, at steps that are powers of two.
LEAKLESS_MS = 1e12
RA = RisingRaParameters(dt_ms=DT_MS, tau_ms=LEAKLESS_MS, step_pa=4096.0, refractory_ms=0.0)
positive = st.floats(1e-3, 1e3)


def membrane_current(stress_pa, dt_ms, parameters):
    model = model_of(parameters)
    filtered = model.filtered(stress_pa, dt_ms, "backward")
    return model.coefficients(asdict(parameters)).current(filtered)


def stress_of(steps_pa):
    """Stress that stands still for four samples, then changes by each of `steps_pa`."""
    return np.concatenate([np.zeros(4), np.cumsum(steps_pa, dtype=np.float64)])


def spike_samples(stress_pa, parameters):
    [times_ms] = encode(stress_pa, DT_MS, parameters)
    return (times_ms / DT_MS).tolist()


@pytest.mark.parametrize(
    ("name", "afferent"), [("rapid", "RA"), ("rising", "PC"), ("rising", "Ruffini")]
)
def test_a_row_that_is_not_there_is_refused(name, afferent):
    with pytest.raises(ParameterError) as caught:
        model_named(name, afferent)
    assert (caught.value.argument, caught.value.found) == ("drive", name)


def test_a_rise_of_two_and_a_half_steps_fires_twice():
    """A step in 16 samples: 0.625 mV a row, so 10 mV is reached by 16, passed by 17.

    With no pause rows 17 and 34 of the rise fire. Row 1 is that of sample 4, where a
    spike would stand a sample later; the 40th would act after the trace, so five
    rows are left.
    """
    rise = stress_of([256.0] * 40)
    assert spike_samples(rise, RA) == [4 + 17, 4 + 34]


def test_a_refractory_period_takes_its_share_of_a_rise():
    """One row of pause: rows 17 and 18 + 17 fire; of 34 rows just the first would."""
    paused = replace(RA, refractory_ms=0.5)
    assert spike_samples(stress_of([256.0] * 40), paused) == [21, 39]
    assert spike_samples(stress_of([256.0] * 34), paused) == [21]


def test_a_fall_empties_but_leaves_no_debt():
    """Three quarters of a step, a fall of five, then five quarters: the 5th fires."""
    stress = stress_of([1024.0] * 3 + [-1024.0] * 20 + [1024.0] * 5 + [0.0] * 3)
    assert spike_samples(stress, RA) == [4 + 3 + 20 + 5]


def test_held_stress_fires_sa_with_the_period_of_the_recurrence():
    """At twice `held_pa` Iτ is twice the gap: ln(1/2) / ln(1 − 0.5/20) = 27.4 rows.

    Two rows of pause make the period 30 rows. At `held_pa` v only nears the gap.
    """
    sa = RisingSaParameters(dt_ms=DT_MS, tau_ms=20.0, step_pa=4096.0, held_pa=5000.0)
    assert spike_samples(np.full(120, 1e4), sa) == [28, 58, 88, 118]
    assert spike_samples(np.full(2000, 5000.0), sa) == []


TWO_WAY = TwoWayRaParameters(
    dt_ms=DT_MS,
    tau_ms=LEAKLESS_MS,
    step_pa=4096.0,
    retraction=0.5,
    refractory_ms=0.0,
    recovery_ms=6.0,
    fatigue_mv=0.0,
)


def test_further_steps_of_one_rise_are_four_times_as_large_until_it_turns():
    """A jump of 30 mV that stays, but for its last digits: 10 mV, then 40: 17 and 64 rows.

    A fall starts anew. It must be longer than the four rows that were left of the rise.
    """
    up = [256.0] * 86
    stress = stress_of([*up, *[-256.0] * 5, *up])
    stays = replace(TWO_WAY, retraction=1e-6, jump_mv=30.0, recovery_ms=LEAKLESS_MS)
    assert spike_samples(stress, stays) == [4 + 17, 4 + 17 + 64, 4 + 91 + 17, 4 + 91 + 17 + 64]


def test_a_slow_rise_fires_more_than_a_fast_one_and_a_rise_less_than_one_in_steps():
    """The jump of 80 mV has faded to 10 after 2.1 recoveries, 12.5 ms."""
    fast, slow = ([65536.0 / rows] * rows for rows in (8, 256))
    counts = [len(spike_samples(stress_of(rise), TWO_WAY)) for rise in (fast, slow)]
    assert counts[0] < counts[1] <= 65536 // 4096
    apart = round(TWO_WAY.recovery_ms / DT_MS * math.log(8.0))
    steps = ([4097.0, *[0.0] * (apart + 1)] * 3)[:-1]
    assert len(spike_samples(stress_of(np.multiply(steps, 2)), TWO_WAY)) == 3
    assert len(spike_samples(stress_of(np.multiply([4097.0] * 3, 2)), TWO_WAY)) == 1


@pytest.mark.parametrize("period", [10, 40, 160])
def test_after_a_spike_the_next_sweep_needs_more_stress_the_sooner_it_comes(period):
    """A step of stress fires each time if it exceeds the gap and what is left of the fatigue.

    A spike adds no jump, and falls do not fire. Of weaker steps above the gap every second fires,
    or one in more.
    """
    tired = replace(TWO_WAY, jump_mv=0.0, retraction=1e-6, fatigue_mv=15.0)
    left_mv = 15.0 * (1.0 - DT_MS / tired.fatigue_ms) ** period
    sweep = np.zeros(period)
    sweep[0], sweep[5] = 1.0, -1.0
    enough_mv = 10.0 + left_mv
    for size_mv, fewest, most in (
        (9.99, 0, 0),
        (10.01, 1, 6),
        (0.98 * enough_mv, 1, 6),
        (1.02 * enough_mv, 12, 12),
    ):
        steps = np.tile(sweep * tired.step_pa * size_mv / 10.0, 12)
        assert fewest <= len(spike_samples(stress_of(steps), tired)) <= most


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1))
def test_two_way_is_two_cells_that_count_rises_of_stress_and_of_its_negative(seed):
    stress = np.cumsum(np.random.default_rng(seed).normal(0, 3e3, 300))
    one_way = replace(TWO_WAY, retraction=1e-9)
    falls = replace(one_way, step_pa=TWO_WAY.step_pa / TWO_WAY.retraction)
    both = spike_samples(stress, TWO_WAY)
    assert both == sorted(spike_samples(stress, one_way) + spike_samples(-stress, falls))


def test_a_held_stress_fires_fading_ever_more_slowly_and_on():
    """A stress s falls to a quarter of itself within a second, and to a fifth in the end."""
    sa = FadingSaParameters(dt_ms=DT_MS, tau_ms=20.0, step_pa=1e9, held_pa=5000.0)
    times_ms = DT_MS * np.arange(4000)
    for peak_pa, fires_on in ((40_000.0, True), (18_000.0, False)):
        spikes_ms = DT_MS * np.array(spike_samples(peak_pa * (times_ms >= 5), sa))
        assert (np.diff(spikes_ms)[1:] >= np.diff(spikes_ms)[:-1] - DT_MS).all()
        assert np.diff(spikes_ms)[-1] > 1.3 * np.diff(spikes_ms)[0]
        assert (spikes_ms[-1] > 1900) == fires_on
    assert spike_samples(np.full(4000, 24_000.0), sa) == []  # it has faded before the trace


@pytest.mark.parametrize("dt_ms", [0.05, 0.1])
def test_a_corpuscle_passes_a_sine_as_its_five_poles_do(dt_ms):
    """``(r / √(1 + r²))³ / (1 + q²)`` of the amplitude, r and q the shares of both poles."""
    pc = CorpusclePcParameters(dt_ms=dt_ms, tau_ms=100.0, beta_mv_per_ms=1.0)
    times_ms = dt_ms * np.arange(round(200 / dt_ms))
    for frequency_hz in (20.0, 100.0, 250.0, 500.0):
        sine = 1e4 * np.sin(2e-3 * np.pi * frequency_hz * times_ms)
        passed = membrane_current(sine, dt_ms, pc)[len(times_ms) // 2 :]
        high, low = frequency_hz / CORPUSCLE_HIGH_HZ, frequency_hz / CORPUSCLE_LOW_HZ
        gain = (high / math.hypot(1.0, high)) ** 3 / (1.0 + low**2)
        np.testing.assert_allclose(passed.max(), (1e4 * gain) ** CORPUSCLE_POWER, rtol=0.03)
        np.testing.assert_allclose(passed.min() / -NEGATIVE_SHARE, passed.max(), rtol=0.03)


def test_a_corpuscle_is_a_plain_loop_over_its_passes():
    stress = np.random.default_rng(5).uniform(0, 2e4, 80)
    halves = [math.pi * 1e-3 * hz * DT_MS for hz in (CORPUSCLE_HIGH_HZ, CORPUSCLE_LOW_HZ)]
    before, lows, passed = [0.0] * 5, [0.0] * 5, []
    for value in stress - stress[0]:
        for stage in range(5):
            half = halves[stage > 2]
            leak = (1 - half) * lows[stage] + half * (value + before[stage])
            before[stage], lows[stage] = value, leak / (1 + half)
            value = value - lows[stage] if stage < 3 else lows[stage]
        passed.append(value)
    ahead, behind = (
        np.maximum(each, 0) ** CORPUSCLE_POWER for each in (passed, np.negative(passed))
    )
    expected = ahead - NEGATIVE_SHARE * behind
    parameters = CorpusclePcParameters(dt_ms=DT_MS, tau_ms=9, beta_mv_per_ms=1)

    current = membrane_current(stress, DT_MS, parameters)

    np.testing.assert_allclose(current, expected, rtol=1e-7, atol=1e-5)


def test_a_still_finger_is_silent(row):
    """No stress at all; and a stress that is held, for all but SA."""
    named = {one.field: math.sqrt(one.low * one.high) for one in row.free(1)}
    parameters = row.parameters(**named, drive=row.name)
    assert spike_samples(np.zeros(80), parameters) == []
    if row.afferent != "SA":
        assert spike_samples(np.full(80, 1e6), parameters) == []


def two_drives(seed, shape=(50, 3)):
    return list(np.random.default_rng(seed).uniform(0, 100, (2, *shape)))


def test_shares_have_one_half_at_their_half_or_are_weighted_keep_their_sign_and_add():
    drives = [np.array([3.0, 0.0, 3.0]), np.array([0.0, 5.0, 15.0])]
    current = Coefficients(4.0, halves=(3.0, 5.0)).current(drives)
    np.testing.assert_allclose(current, [2.0, 2.0, 2.0 + 3.0], rtol=1e-15)
    drives = [np.array([1.0, -2.0]), np.array([10.0, 10.0])]
    coefficients = Coefficients(2.0, weights=(3.0, 0.5))
    assert coefficients.current(drives).tolist() == [6.0 + 10.0, -12.0 + 10.0]
    assert [float(gain) for gain in coefficients.gains()] == [6.0, 1.0]
    assert Coefficients(2.0, weights=(3.0,)).current(drives[:1]).tolist() == [6, -12]


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1), need=st.floats(0.05, 20), half=positive)
def test_a_cell_of_greater_need_sees_the_stress_divided_by_it(seed, need, half):
    drives = two_drives(seed)
    smaller = [drive / need for drive in drives]
    for median in (Coefficients(7.0, halves=(half, 2.0)), Coefficients(7.0, weights=(half, 2.0))):
        np.testing.assert_allclose(
            median.scaled_for_cell(need).current(drives), median.current(smaller), rtol=1e-12
        )


@settings(max_examples=20)
@given(need=st.floats(0.05, 20), degree=st.sampled_from([1.0, 0.5, 1 / 3]))
def test_a_filter_that_grows_with_a_power_of_the_stress_shrinks_by_it(need, degree):
    stress = np.linspace(0.0, 1e4, 9)
    median = Coefficients(3.0, weights=(2.0,), degree=degree)
    cell = median.scaled_for_cell(need).current([stress**degree])
    np.testing.assert_allclose(cell, median.current([(stress / need) ** degree]), rtol=1e-12)
