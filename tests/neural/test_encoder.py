"""From stress to spikes: what follows from Table 2, what must not matter, and populations."""

import math
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from fembridge.errors import ParameterError, TraceError
from neural import encoder, lif
from neural.encoder import encode, encode_afferents, encode_cells, encode_units
from neural.filters import DERIVATIVES
from neural.parameter_sets import parameter_set
from neural.parameters import PUBLISHED, quantiles

DT_MS = 0.5
TIMES_MS = DT_MS * np.arange(501)

STRESS_PA = 2e4 + 1.5e4 * np.sin(2e-3 * np.pi * np.outer(TIMES_MS[:161], [20, 60, 100, 300]))


def half_sine_pa(frequency_hz, peak_pa=2e4):
    return peak_pa * np.maximum(np.sin(2e-3 * np.pi * frequency_hz * TIMES_MS), 0.0)


def test_a_held_stress_fires_sa_with_the_period_that_table_2_gives():
    """At σ = a1 the current is α'1 / 2 = 0.895 mV/ms, so Iτ = 28.77 mV.

    v exceeds 15 mV after ln(1 − 15 / 28.77) / ln(1 − 0.5 / 32.14) = 47.01 rows, so
    48 of them; with two rows of pause the period is 50 rows, 25 ms.
    """
    [times_ms] = encode(np.full(501, 1926.32), DT_MS, PUBLISHED["SA"])
    assert times_ms.tolist() == (24.0 + 25.0 * np.arange(10)).tolist()


def test_a_held_stress_fires_neither_ra_nor_pc():
    for name in ("RA", "PC"):
        [times_ms] = encode(np.full(501, 1e5), DT_MS, PUBLISHED[name])
        assert times_ms.size == 0


def test_stress_of_constant_jerk_fires_pc_with_the_period_of_the_recurrence():
    """σ = j t³ / 6: σ″ changes by j dt a sample. j dt = a4 gives α'3 / 2 = 2.07 mV/ms.

    Iτ = 1324.5 mV; ln(1 − 10 / 1324.5) / ln(1 − 0.5 / 639.85) = 9.69: ten rows, and
    one of pause. The first current is that of sample 3, so the first spike is at
    13 dt = 6.5 ms.
    """
    jerk = 16.34 / DT_MS
    [times_ms] = encode(jerk * TIMES_MS**3 / 6, DT_MS, PUBLISHED["PC"])
    np.testing.assert_array_equal(times_ms[:10], 6.5 + 5.5 * np.arange(10))


def test_stress_of_constant_acceleration_fires_ra_with_the_period_of_the_recurrence():
    """σ = c t² / 2: σ′ changes by c dt a sample. c dt = a3 gives α'2 / 2 = 5.115 mV/ms.

    2.5575 mV a row and next to no leak: 10 mV is exceeded at the 4th row, and one
    row of pause follows. The first current is that of sample 2.
    """
    acceleration = 17191.87 / DT_MS
    [times_ms] = encode(acceleration * TIMES_MS**2 / 2, DT_MS, PUBLISHED["RA"])
    np.testing.assert_array_equal(times_ms[:10], 3.0 + 2.5 * np.arange(10))


@pytest.mark.parametrize("name", PUBLISHED)
def test_a_clock_that_starts_elsewhere_moves_the_spikes_with_it(name):
    stress_pa = half_sine_pa(50)
    [at_zero] = encode(stress_pa, DT_MS, PUBLISHED[name])
    [at_minus_40] = encode(stress_pa, DT_MS, PUBLISHED[name], start_ms=-40.0)
    assert at_zero.size > 2
    np.testing.assert_array_equal(at_minus_40, at_zero - 40.0)


def test_a_step_printed_with_six_digits_is_the_step():
    [exact] = encode(half_sine_pa(50), DT_MS, PUBLISHED["PC"])
    [printed] = encode(half_sine_pa(50), 0.500001, PUBLISHED["PC"])
    np.testing.assert_array_equal(printed, exact)


@pytest.mark.parametrize("cells", [2, 5])
def test_a_cell_is_a_single_one_under_stress_divided_by_its_need(parameters_of, row, cells):
    """Need is exp(spread q): it takes that many times the stress for the same."""
    spread = 0.7
    population = parameters_of(row, cells=cells, spread=spread)
    single = parameters_of(row)

    runs = encode_cells(STRESS_PA, DT_MS, population)

    for k, q in enumerate(quantiles(cells)):
        alone = encode(STRESS_PA / math.exp(spread * q), DT_MS, single)
        for condition in range(4):
            np.testing.assert_array_equal(runs[condition][k], alone[condition])
    assert sum(times_ms.size for run in runs for times_ms in run) > 6 * cells


@pytest.mark.parametrize("name", ["published", "fitted"])
def test_classes_together_fire_as_each_alone(name):
    parameters = parameter_set(name).parameters
    rng = np.random.default_rng(3)
    steps = rng.normal(0, 400, (501, 3, 4)).cumsum(axis=0)
    stress_pa = {c: np.abs(steps[:, k]) for k, c in enumerate(parameters)}

    together = encode_afferents(stress_pa, DT_MS, parameters)

    total = 0
    for afferent, stress in stress_pa.items():
        alone = encode_cells(stress, DT_MS, parameters[afferent])
        assert len(together[afferent]) == 4
        for mine, its in zip(together[afferent], alone, strict=True):
            assert len(mine) == parameters[afferent].cells
            for one, other in zip(mine, its, strict=True):
                np.testing.assert_array_equal(one, other)
                total += one.size
    assert total > 100


@pytest.mark.parametrize(
    ("derivative", "refractory_ms"), list(zip(DERIVATIVES, (0.0, 1.0, 60.0), strict=True))
)
def test_parts_of_a_trace_fire_as_the_whole(
    parameters_of, row, derivative, refractory_ms, monkeypatch
):
    """To the last spike, of every model: one whose filters see farther would show here.

    One by one, as few are, and at once.
    """
    rng = np.random.default_rng(17)
    walk_pa = np.abs(np.cumsum(rng.normal(0, 3e3, (251, 3)), axis=0))
    population = replace(parameters_of(row, cells=3, spread=0.7), refractory_ms=refractory_ms)

    def fired():
        runs = encode_cells(walk_pa, DT_MS, population, 7.0, derivative)
        return [[one.tolist() for one in cells] for cells in runs]

    whole = fired()
    assert sum(len(one) for cells in whole for one in cells) > 5
    monkeypatch.setattr(encoder, "_ROWS", 1)
    monkeypatch.setattr(encoder, "_MEMBRANES", 4)
    for few in (0, 20):
        monkeypatch.setattr(lif, "_MAX_ONE_BY_ONE", few)
        assert fired() == whole


def test_many_membranes_and_long_traces_take_little_memory(monkeypatch):
    """Beside the stress and the spikes: before, ten times the stress. In small parts of small."""
    monkeypatch.setattr(encoder, "_ROWS", 250)
    monkeypatch.setattr(encoder, "_MEMBRANES", 10)
    pa = np.abs(np.sin(np.arange(20)[:, None] * 0.3 + np.arange(800))) * 3e4
    for stress_pa in (pa, pa[:10].ravel()):
        encode(stress_pa, 0.5, PUBLISHED["RA"])  # what a first call imports is not of the encoder
        tracemalloc.start()
        try:
            encode(stress_pa, 0.5, PUBLISHED["RA"])
            assert tracemalloc.get_traced_memory()[1] < 3 * pa.nbytes
        finally:
            tracemalloc.stop()


# ---- Units of a population

FITTED = parameter_set("fitted").parameters
WAVE_PA = 20_000 * (1 + np.sin(2 * np.pi * 0.03 * TIMES_MS)) ** 1.3


@pytest.mark.parametrize("name", ["SA", "RA", "PC"])
@pytest.mark.parametrize("parameters", ["published", "fitted"])
def test_units_at_the_cells_quantiles_fire_as_the_cells_do(name, parameters):
    chosen = parameter_set(parameters).parameters
    one = chosen[name]
    deviate = quantiles(one.cells)
    stress = np.tile(WAVE_PA[:, None], (1, one.cells))
    fired = encode_units(stress, [name] * one.cells, 0.5, chosen, deviate)
    [cells] = encode_cells(WAVE_PA, 0.5, one)
    for unit, times_ms in enumerate(cells):
        np.testing.assert_array_equal(fired.time_ms[fired.unit == unit], times_ms)


def test_classes_share_a_pass_and_keep_their_order():
    names = ["PC", "SA", "RA", "SA"]
    stress = np.stack([WAVE_PA, WAVE_PA, WAVE_PA, 0.5 * WAVE_PA], -1)
    together = encode_units(stress, names, 0.5, FITTED)
    for unit, name in enumerate(names):
        alone = encode_units(stress[:, unit : unit + 1], [name], 0.5, FITTED)
        np.testing.assert_array_equal(together.time_ms[together.unit == unit], alone.time_ms)


def test_a_unit_of_negative_sign_fires_as_if_its_stress_were_turned_over():
    """SA and RA have no sign: von Mises stress drives them whatever `sign` is."""
    names, sign = ["PC", "SA", "RA", "PC"], np.array([-1.0, -1.0, -1.0, 1.0])
    press_pa = (
        4e3 * np.clip(np.arange(900) / 60.0, 0, 1) * np.clip((900 - np.arange(900)) / 9, 0, 1)
    )
    stress = np.tile(press_pa[:, np.newaxis], (1, 4))
    fired = encode_units(stress, names, 0.5, FITTED, sign=sign)
    for unit, (name, turn) in enumerate(zip(names, (-1, 1, 1, 1), strict=True)):
        alone = encode_units(turn * stress[:, unit : unit + 1], [name], 0.5, FITTED)
        np.testing.assert_array_equal(fired.time_ms[fired.unit == unit], alone.time_ms)
    pressed, released = (fired.time_ms[fired.unit == unit] for unit in (3, 0))
    assert pressed.size and released.size and not np.array_equal(pressed, released)
    plain = encode_units(stress, names, 0.5, FITTED, sign=np.ones(4))
    np.testing.assert_array_equal(plain.time_ms, encode_units(stress, names, 0.5, FITTED).time_ms)


@pytest.mark.parametrize("sign", [[1.0], [1.0, 0.5], [1.0, np.nan]])
def test_a_sign_that_is_none_is_refused(sign):
    with pytest.raises(ParameterError) as error:
        encode_units(np.ones((9, 2)), ["PC", "PC"], 0.5, FITTED, sign=np.array(sign))
    assert error.value.argument == "sign"


def test_trials_are_alike_without_noise_and_repeat_with_their_seed():
    stress = np.stack([WAVE_PA, 0.7 * WAVE_PA], -1)
    still = encode_units(stress, ["RA", "SA"], 0.5, FITTED, trials=3)
    first = still.time_ms[still.trial == 1]
    for trial in (2, 3):
        np.testing.assert_array_equal(still.time_ms[still.trial == trial], first)

    def noisy(seed):
        rng = np.random.default_rng(seed)
        return encode_units(stress, ["RA", "SA"], 0.5, FITTED, trials=5, noise_mv=1.0, rng=rng)

    np.testing.assert_array_equal(noisy(1).time_ms, noisy(1).time_ms)
    assert (
        noisy(1).time_ms.size != noisy(2).time_ms.size
        or (noisy(1).time_ms != noisy(2).time_ms).any()
    )


@pytest.mark.parametrize("name", ["published", "fitted", "fitted_pad"])
@pytest.mark.parametrize("units", [3, 30])
def test_units_in_parts_of_the_time_fire_as_in_one(monkeypatch, name, units):
    """Recursive filters go on from part to part; few columns and many go different ways."""
    chosen = parameter_set(name).parameters
    rng = np.random.default_rng(1)
    wave = np.cumsum(rng.normal(size=(900, units)), axis=0)
    stress = 2e3 * np.abs(wave)
    names = (["SA", "RA", "PC"] * units)[:units]
    trials = {"trials": 2, "noise_mv": 0.4}

    def fired():
        return encode_units(stress, names, 0.5, chosen, rng=np.random.default_rng(2), **trials)

    whole = fired()
    monkeypatch.setattr("neural.encoder._UNIT_NUMBERS", 2_000)
    parts = fired()
    assert whole.time_ms.size > 20
    np.testing.assert_array_equal(parts.time_ms, whole.time_ms)
    np.testing.assert_array_equal(parts.unit, whole.unit)


def test_noise_has_the_size_that_it_says():
    """Without leak and without a threshold the potential spreads by noise_mv sqrt(t)."""
    fitted = parameter_set("fitted_pad").parameters["RA"]
    plain = {"RA": replace(fitted, tau_ms=1e9, jump_mv=0.0, fatigue_mv=0.0)}
    rng = np.random.default_rng(0)
    fired = encode_units(np.zeros((201, 400)), ["RA"] * 400, 0.5, plain, noise_mv=2.0, rng=rng)
    # A walk of 2 mV in 1 ms, clamped at rest, passes 10 mV after 25 ms on average, and a little
    # later in steps of 0.1 ms; a cell has two membranes.
    rate = fired.time_ms.size / 400 / 100
    assert 0.75 * 2 / 25 < rate < 2 / 25


def test_what_does_not_fit_is_refused():
    for dt_ms in (1.0, math.nan):
        with pytest.raises(ParameterError) as caught:
            encode(np.zeros(50), dt_ms, PUBLISHED["RA"])
        assert caught.value.argument == "dt_ms"
        assert caught.value.found is dt_ms
    with pytest.raises(TraceError):
        encode_afferents({"SA": np.zeros(10), "RA": np.zeros(12)}, DT_MS, PUBLISHED)
    for afferents, dt_ms, argument, found in (
        (["SA", "RA"], 0.5, "stress_pa", WAVE_PA[:, None].shape),
        (["SA"], 0.33, "dt_ms", 0.33),
        (["XX"], 0.5, "afferent", "XX"),
    ):
        with pytest.raises((TraceError, ParameterError)) as caught:
            encode_units(WAVE_PA[:, None], afferents, dt_ms, FITTED)
        assert (caught.value.argument, caught.value.found) == (argument, found)
    with pytest.raises(ParameterError):
        encode_units(WAVE_PA[:, None], ["SA"], 0.5, FITTED, noise_mv=1.0)


def test_two_samples_of_a_finer_trace_are_too_short_for_a_spike():
    """They are one sample at the step of the parameters."""
    parameters = parameter_set("fitted").parameters["RA"]
    [cells] = encode_cells([0.0, 1e6], 0.05, parameters)
    assert [times.size for times in cells] == [0] * parameters.cells
