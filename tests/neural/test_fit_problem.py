"""What a fit minimises, beside `encode_cells` and plain loops."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fembridge.errors import ParameterError
from neural import encode_cells, mean_rate_ips
from neural.fit_problem import FitProblem
from neural.models import model_named
from neural.search import from_unit

DT_MS = 0.5
TIMES_MS = DT_MS * np.arange(121)
FREQUENCIES_HZ = (20.0, 90.0, 300.0, 20.0)
PEAKS_PA = (2e4, 1e4, 4e3, 5e3)
STRESS_PA = np.array(PEAKS_PA) * (1.3 + np.sin(2e-3 * np.pi * np.outer(TIMES_MS, FREQUENCIES_HZ)))
WINDOWS_MS = ((5.0, 60.0), (20.0, 40.0), (0.0, 60.0), (7.3, 59.9))
GROUPS = ("20", "90", "300", "20")
OBSERVED_IPS = np.array([31.0, 80.0, 5.5, 0.0])
seeds = st.integers(0, 2**32 - 1)


def problem_of(row=None, **changes):
    return FitProblem(
        **{
            "model": row or model_named("rising", "RA"),
            "stress_pa": STRESS_PA,
            "observed_ips": OBSERVED_IPS,
            "groups": GROUPS,
            "windows_ms": WINDOWS_MS,
            "dt_ms": DT_MS,
            **changes,
        }
    )


def random_values(problem, seed, candidates=2):
    """Parameters inside the searched bounds, those of a lively cell more often."""
    unit = np.random.default_rng(seed).beta(2, 2, (candidates, len(problem.free)))
    return from_unit(unit, problem.free)


def counts_of(problem, rates_ips):
    spans_ms = np.array([end - start for start, end in problem.windows_ms])
    spikes = np.asarray(rates_ips) * problem.cells * spans_ms / 1000.0
    np.testing.assert_allclose(spikes, np.round(spikes), atol=1e-9)
    return np.round(spikes).astype(int).tolist()


def encoded_rates(problem, values):
    runs = encode_cells(problem.stress_pa, DT_MS, problem.parameters(values))
    return [
        mean_rate_ips(run, window_ms)
        for run, window_ms in zip(runs, problem.windows_ms, strict=True)
    ]


@pytest.mark.parametrize("cells", [1, 3])
def test_a_candidate_fires_what_its_parameters_encode(row, cells):
    """To the last spike; the rates are the same quotients, divided in another order."""
    problem = problem_of(row, cells=cells)
    lively = 0

    for seed in range(3):
        values = random_values(problem, seed)
        rates_ips = problem.rates_ips(values)
        assert rates_ips.shape == (2, 4)
        for each, found in zip(values, rates_ips, strict=True):
            expected = encoded_rates(problem, each)
            assert counts_of(problem, found) == counts_of(problem, expected)
            np.testing.assert_allclose(found, expected, rtol=1e-15)
            lively += sum(expected) > 0
    assert lively >= 2


@settings(max_examples=15)
@given(seed=seeds)
def test_objectives_are_those_of_a_plain_loop(seed):
    problem = problem_of(cells=2)
    values = random_values(problem, seed, candidates=3)
    rates_ips = problem.rates_ips(values)

    errors = problem.errors_ips2(values)

    assert problem.group_names == ("20", "90", "300")
    for k in range(3):
        for column, group in enumerate(("20", "90", "300")):
            squares = [
                (rates_ips[k, each] - OBSERVED_IPS[each]) ** 2
                for each in range(4)
                if GROUPS[each] == group
            ]
            mean = sum(squares) / len(squares)
            np.testing.assert_allclose(errors[k, column], mean, rtol=1e-13)
    np.testing.assert_array_equal(problem.group_errors(rates_ips), errors)


@pytest.mark.parametrize("cells", [1, 3])
def test_single_precision_differs_by_a_few_spikes_at_most(row, cells):
    problem = problem_of(row, cells=cells)
    values = random_values(problem, 11, candidates=120)  # `fading` fires seldom

    double = np.array(counts_of(problem, problem.rates_ips(values)))
    single = np.array(counts_of(problem, problem.rates_ips(values, single=True)))

    assert double.sum() > 200
    assert np.abs(single - double).sum() <= 0.005 * double.sum()
    assert np.abs(single - double).max() <= 2


@pytest.mark.parametrize("flags", [[1, 0, 0, 1], [0, 1, 0, 0], [1, 1, 1, 1]])
def test_a_part_is_the_problem_of_its_stimuli(flags):
    whole = problem_of(cells=3)
    kept = np.flatnonzero(flags)
    values = random_values(whole, 6)

    part = whole.part(np.array(flags, dtype=bool))

    assert part.groups == tuple(GROUPS[k] for k in kept)
    assert part.windows_ms == tuple(WINDOWS_MS[k] for k in kept)
    assert part.observed_ips.tolist() == OBSERVED_IPS[kept].tolist()
    assert (part.cells, part.dt_ms, part.model) == (3, DT_MS, whole.model)
    np.testing.assert_array_equal(part.rates_ips(values), whole.rates_ips(values)[:, kept])


def test_the_last_sample_acts_after_the_trace():
    """A rise at the last sample feeds a step that no sample ends."""
    stress = np.zeros((20, 2))
    stress[19, 0] = stress[18, 1] = 1e5
    problem = problem_of(
        stress_pa=stress,
        observed_ips=[0.0, 0.0],
        groups=("a", "b"),
        windows_ms=((0.0, 9.5), (0.0, 9.5)),
        cells=1,
    )

    assert counts_of(problem, problem.rates_ips([[100.0, 1e4]])) == [[0, 1]]


def test_a_window_ends_with_the_trace_or_before():
    """121 samples every 0.5 ms end at 60 ms; 120 steps lie between them."""
    until_the_end = ((0.0, 60.0),) * 4
    a_step_more = ((0.0, 60.0),) * 3 + ((0.0, 60.5),)

    problem_of(windows_ms=until_the_end).rates_ips([[9.0, 1e4, 0.5]])
    with pytest.raises(ParameterError, match="121"):
        problem_of(windows_ms=a_step_more).rates_ips([[9.0, 1e4, 0.5]])
