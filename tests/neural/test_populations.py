"""Cells of one class that differ in their need of stress, and the rate they share."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fembridge.errors import ParameterError
from neural import (
    PUBLISHED,
    AfferentParameters,
    RisingRaParameters,
    encode,
    encode_cells,
    mean_rate_ips,
    membrane_current,
    membrane_potential,
    rate_ips,
)
from neural.drive_table import DRIVES
from neural.parameters import quantiles

DT_MS = 0.5
TIMES_MS = DT_MS * np.arange(161)
STRESS_PA = 2e4 + 1.5e4 * np.sin(2e-3 * np.pi * np.outer(TIMES_MS, [20, 60, 100, 300]))

# One of each model, in which half a dozen spikes and more follow from `STRESS_PA`.
VALUES = {
    "tau_ms": 37.0,
    "a1_pa": 2.1e4,
    "a2_pa_per_ms": 9.3e3,
    "a3_pa_per_ms": 4.7e3,
    "a4_pa_per_ms2": 3.1e3,
    "a5_pa_per_ms": 6.1e3,
    "alpha_mv_per_ms": 7.3,
    "beta_mv_per_ms": 0.43,
    "step_pa": 5.9e3,
    "held_pa": 1.7e4,
    "jump_mv": 2.3,
    "recovery_ms": 41.0,
}
ROWS = [row for models in DRIVES.values() for row in models.values()]
ALL = pytest.mark.parametrize("row", ROWS, ids=[f"{row.name}-{row.afferent}" for row in ROWS])


def parameters_of(row, **changes) -> AfferentParameters:
    named = {one.field: VALUES[one.field] for one in row.free(1)}
    return row.parameters(**{**named, "drive": row.name, **changes})


def spikes_of(cells):
    return [times_ms.tolist() for times_ms in cells]


@ALL
@pytest.mark.parametrize("cells", [2, 3, 5])
def test_a_cell_is_a_single_one_under_stress_divided_by_its_need(row, cells):
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


@ALL
def test_cells_without_spread_fire_as_one(row):
    [single] = encode(STRESS_PA[:, 3], DT_MS, parameters_of(row))

    [cells] = encode_cells(STRESS_PA[:, 3], DT_MS, parameters_of(row, cells=4))

    assert spikes_of(cells) == [single.tolist()] * 4
    assert single.size > 1


@ALL
def test_the_middle_of_an_odd_number_is_the_cell_that_potential_and_current_show(row):
    """Its need is exp(0) = 1, so its spikes are those of a single cell."""
    population, single = parameters_of(row, cells=3, spread=0.9), parameters_of(row)

    runs = encode_cells(STRESS_PA, DT_MS, population)

    for shown in (membrane_current, membrane_potential):
        np.testing.assert_array_equal(
            shown(STRESS_PA, DT_MS, population), shown(STRESS_PA, DT_MS, single)
        )
    potential_mv = membrane_potential(STRESS_PA, DT_MS, population)
    for condition, times_ms in enumerate(encode(STRESS_PA, DT_MS, single)):
        np.testing.assert_array_equal(runs[condition][1], times_ms)
        rows = np.round(times_ms / DT_MS).astype(int)
        np.testing.assert_array_equal(potential_mv[rows, condition], -65.0)


@pytest.mark.parametrize("row", [row for row in ROWS if not row.adaptive])
def test_the_most_sensitive_cell_stands_first(row):
    """Every filter is monotone in the stress; so is the count of a steady drive."""
    population = parameters_of(row, cells=5, spread=1.1)

    runs = encode_cells(STRESS_PA, DT_MS, population)

    counts = [sum(run[k].size for run in runs) for k in range(5)]
    assert counts == sorted(counts, reverse=True)
    assert counts[0] > counts[-1]


def test_needs_are_worked_by_hand_for_two_cells():
    """q of two halves is ∓0.6745; with spread ln(2)/0.6745 the needs are 1/2 and 2.

    A rise of 5 steps in steps of a thirty-second, next to no leak, no pause: the
    first cell sees 10 steps, 16 rows pass its gap once 16/16 is exceeded: each 17th
    row, 9 times in 160; the other sees 2.5 steps: rows 65 and 130.
    """
    spread = math.log(2.0) / quantiles(2)[1]
    ra = RisingRaParameters(tau_ms=1e12, step_pa=4096.0, refractory_ms=0.0, cells=2, spread=spread)
    rise = np.concatenate([np.zeros(4), 128.0 * np.arange(1, 162)])

    [[keen, dull]] = encode_cells(rise, DT_MS, ra)

    assert (keen / DT_MS).tolist() == [4.0 + 17 * k for k in range(1, 10)]
    assert (dull / DT_MS).tolist() == [4.0 + 65, 4.0 + 130]


@settings(max_examples=30)
@given(cells=st.integers(1, 200))
def test_quantiles_rise_evenly_about_the_median(cells):
    q = quantiles(cells)
    shares = [0.5 * (1 + math.erf(each / math.sqrt(2))) for each in q]

    assert q.shape == (cells,)
    np.testing.assert_allclose(shares, (np.arange(cells) + 0.5) / cells, rtol=1e-9)
    np.testing.assert_allclose(q, -q[::-1], atol=1e-12)


def test_a_trace_alone_and_traces_together_have_an_entry_a_condition_and_cell():
    population = replace(PUBLISHED["SA"], cells=3, spread=0.4)

    together = encode_cells(STRESS_PA, DT_MS, population, start_ms=-20.0)

    assert [len(run) for run in together] == [3, 3, 3, 3]
    for column, run in zip(STRESS_PA.T, together, strict=True):
        [alone] = encode_cells(column, DT_MS, population, start_ms=-20.0)
        assert spikes_of(alone) == spikes_of(run)
        [later] = encode_cells(column, DT_MS, population)
        assert spikes_of(later) == [(times_ms + 20.0).tolist() for times_ms in run]


def test_one_cell_is_what_encode_gives():
    runs = encode_cells(STRESS_PA, DT_MS, PUBLISHED["SA"])

    for [cell], times_ms in zip(runs, encode(STRESS_PA, DT_MS, PUBLISHED["SA"]), strict=True):
        np.testing.assert_array_equal(cell, times_ms)
    with pytest.raises(ParameterError, match="SA: 3 cells, expected one; encode_cells"):
        encode(STRESS_PA, DT_MS, replace(PUBLISHED["SA"], cells=3))


def test_a_mean_rate_is_impulses_a_second_and_cell():
    """Three spikes of two cells in a tenth of a second: 15 a second each."""
    assert mean_rate_ips([[10.0, 20.0, 200.0], [30.0]], (0.0, 100.0)) == 15.0
    assert mean_rate_ips([[], []], (0.0, 100.0)) == 0.0
    assert mean_rate_ips([[5.0, 5.5, 250.0]], (5.0, 250.0)) == pytest.approx(2 / 0.245)


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), cells=st.integers(1, 6))
def test_a_mean_rate_is_the_mean_of_the_rates(seed, cells):
    rng = np.random.default_rng(seed)
    runs = [np.sort(rng.uniform(0, 300, rng.integers(0, 40))) for _ in range(cells)]
    window_ms = (5.0, 250.0)

    expected = sum(rate_ips(run, window_ms) for run in runs) / cells

    assert mean_rate_ips(runs, window_ms) == pytest.approx(expected, rel=1e-12)


def test_a_mean_over_no_cell_or_no_time_is_refused():
    with pytest.raises(ParameterError, match="no cell, expected one or more"):
        mean_rate_ips([], (0.0, 100.0))
    with pytest.raises(ParameterError, match="expected start < end"):
        mean_rate_ips([[1.0]], (9.0, 9.0))


@pytest.mark.parametrize("cells", [0, -1, 1001, 2.0, True, "3", None])
def test_a_number_of_cells_is_whole_and_not_endless(cells):
    with pytest.raises(ParameterError, match="SA: cells must be a whole number from 1"):
        replace(PUBLISHED["SA"], cells=cells)


def test_a_spread_is_not_negative():
    with pytest.raises(ParameterError, match=r"SA: spread must be >= 0, got -0\.1"):
        replace(PUBLISHED["SA"], spread=-0.1)
