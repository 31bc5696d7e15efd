"""From stress to spikes: what follows from Table 2, and what must not matter."""

import math
import subprocess
import sys
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fembridge.errors import ParameterError, TraceError
from neural.drive import DERIVATIVES
from neural.encoder import afferent_drives, encode, membrane_current, membrane_potential
from neural.parameters import PUBLISHED, AfferentParameters

DT_MS = 0.5
TIMES_MS = DT_MS * np.arange(501)


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


def test_rest_stays_at_rest():
    for parameters in PUBLISHED.values():
        potential_mv = membrane_potential(np.zeros(50), DT_MS, parameters)
        np.testing.assert_array_equal(potential_mv, -65.0)


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
@pytest.mark.parametrize("derivative", DERIVATIVES)
@settings(max_examples=15)
@given(later=st.integers(1, 100), frequency_hz=st.sampled_from([20, 50, 100, 300]))
def test_a_later_stimulus_fires_the_same_spikes_later(name, derivative, later, frequency_hz):
    rest = np.zeros(20)
    early = np.concatenate([rest, half_sine_pa(frequency_hz), np.zeros(120)])
    late = np.concatenate([np.zeros(later), early[:-later]])

    [first] = encode(early, DT_MS, PUBLISHED[name], derivative=derivative)
    [second] = encode(late, DT_MS, PUBLISHED[name], derivative=derivative)

    end_ms = (early.size - 1) * DT_MS
    shifted = first + later * DT_MS
    np.testing.assert_array_equal(second, shifted[shifted <= end_ms])


@pytest.mark.parametrize("name", PUBLISHED)
def test_a_clock_that_starts_elsewhere_moves_the_spikes_with_it(name):
    stress_pa = half_sine_pa(50)

    [at_zero] = encode(stress_pa, DT_MS, PUBLISHED[name])
    [at_minus_40] = encode(stress_pa, DT_MS, PUBLISHED[name], start_ms=-40.0)

    assert at_zero.size > 2
    np.testing.assert_array_equal(at_minus_40, at_zero - 40.0)


@pytest.mark.parametrize("name", PUBLISHED)
def test_traces_encoded_together_fire_as_they_do_alone(name):
    together = np.column_stack([half_sine_pa(hz) for hz in (20, 50, 100, 300)])

    runs = encode(together, DT_MS, PUBLISHED[name])

    assert len(runs) == 4
    for column, times_ms in zip(together.T, runs, strict=True):
        [alone] = encode(column, DT_MS, PUBLISHED[name])
        np.testing.assert_array_equal(times_ms, alone)


@pytest.mark.parametrize("name", PUBLISHED)
def test_the_potential_is_at_rest_on_a_spike_and_under_the_threshold_elsewhere(name):
    parameters = PUBLISHED[name]
    [times_ms] = encode(half_sine_pa(50), DT_MS, parameters)

    potential_mv = membrane_potential(half_sine_pa(50), DT_MS, parameters)

    rows = np.round(times_ms / DT_MS).astype(int)
    assert rows.size > 2
    assert potential_mv[0] == -65.0
    np.testing.assert_array_equal(potential_mv[rows], -65.0)
    assert potential_mv.max() <= parameters.threshold_mv
    assert potential_mv.min() >= -65.0


def test_a_spike_stands_on_a_sample_of_the_trace_but_not_on_the_first():
    """A current that fires every row: α' dt above the gap, no pause, σ held."""
    eager = replace(PUBLISHED["SA"], alpha_mv_per_ms=1e4, refractory_ms=0.0)

    [times_ms] = encode(np.full(20, 1e4), DT_MS, eager)

    np.testing.assert_array_equal(times_ms, DT_MS * np.arange(1, 20))


def test_the_current_stays_under_its_greatest():
    for name, most in (("SA", 2 * 1.79), ("RA", 10.23), ("PC", 4.14)):
        current = membrane_current(half_sine_pa(300, 1e9), DT_MS, PUBLISHED[name])
        assert 0.9 * most < current.max() < most


def test_sa_alone_has_two_drives():
    drives = {name: afferent_drives(name, half_sine_pa(50), DT_MS) for name in PUBLISHED}

    assert {name: len(each) for name, each in drives.items()} == {"SA": 2, "RA": 1, "PC": 1}
    with pytest.raises(ParameterError, match="'Ruffini', expected SA, RA or PC"):
        afferent_drives("Ruffini", half_sine_pa(50), DT_MS)


def test_a_step_that_the_parameters_were_not_fitted_at_is_refused():
    with pytest.raises(ParameterError, match=r"every 1 ms, .* hold for 0\.5 ms"):
        encode(np.zeros(50), 1.0, PUBLISHED["RA"])
    with pytest.raises(ParameterError, match="nan ms"):
        encode(np.zeros(50), math.nan, PUBLISHED["RA"])


def test_a_step_printed_with_six_digits_is_the_step():
    [exact] = encode(half_sine_pa(50), DT_MS, PUBLISHED["PC"])
    [printed] = encode(half_sine_pa(50), 0.500001, PUBLISHED["PC"])

    np.testing.assert_array_equal(printed, exact)


def test_own_parameters_may_have_a_step_of_their_own():
    finer = replace(PUBLISHED["SA"], dt_ms=0.25)

    [times_ms] = encode(np.full(1001, 1926.32), 0.25, finer)

    assert times_ms[0] == pytest.approx(23.5, abs=0.5)


def test_samples_that_are_no_stress_history_are_refused():
    with pytest.raises(TraceError, match="nan at sample 0"):
        encode([np.nan, 0.0], DT_MS, PUBLISHED["SA"])


def test_parameters_of_no_drive_have_no_current():
    @dataclass(frozen=True, slots=True, kw_only=True)
    class Ruffini(AfferentParameters):
        afferent: ClassVar[str] = "SA"
        drives: ClassVar[tuple[str, ...]] = ("stretch",)

    ending = Ruffini(tau_ms=9.0, threshold_mv=-50.0, refractory_ms=1.0)

    with pytest.raises(ParameterError, match="drive 'stretch', expected one of"):
        membrane_current(np.zeros(9), DT_MS, ending)


def test_importing_neural_loads_numpy_and_nothing_heavier():
    heavy = "{'pandas', 'scipy', 'matplotlib', 'meshio', 'pymoo', 'rich', 'decks'}"
    program = (
        "import sys, neural; "
        "assert all(hasattr(neural, name) for name in neural.__all__); "
        f"print(sorted({heavy} & set(sys.modules)), 'numpy' in sys.modules)"
    )

    answer = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )

    assert answer.stdout.strip() == "[] True"
