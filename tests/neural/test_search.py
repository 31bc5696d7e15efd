"""The search, which candidate is taken, and predictions of groups that were left out."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from fembridge.errors import MissingError, ParameterError
from neural.fit_problem import FitProblem
from neural.models import Free, model_named
from neural.search import (
    NEAR_SHARE,
    Front,
    choose,
    frequency_response_error_ips,
    from_unit,
    held_out_ips,
    search_front,
    total_rmse_ips,
)

DT_MS = 0.5
TIMES_MS = DT_MS * np.arange(101)
SMALL = {"evaluations": 120, "population": 24}


def problem_with(stress_pa, observed_ips, groups, name="rising", cells=1, window_ms=(0.0, 50.0)):
    return FitProblem(
        model=model_named(name, "RA"),
        stress_pa=stress_pa,
        observed_ips=np.array(observed_ips),
        groups=groups,
        windows_ms=(window_ms,) * len(groups),
        dt_ms=DT_MS,
        cells=cells,
    )


def sines(peaks_pa, frequencies_hz):
    return np.array(peaks_pa) * (1 + np.sin(2e-3 * np.pi * np.outer(TIMES_MS, frequencies_hz)))


def problem_of(groups=("20", "20", "90", "90"), name="published"):
    """Two stimuli at each of two frequencies, observed so that no cell fits both."""
    stress_pa = sines([8e3, 2e4, 3e3, 1e4], [20, 20, 90, 90])
    return problem_with(stress_pa, [60.0, 150.0, 20.0, 45.0], groups, name)


PROBLEM = problem_of()


@pytest.fixture(scope="module")
def front():
    return search_front(PROBLEM, seed=3, **SMALL)


def test_the_same_seed_gives_the_same_front_and_another_another(front):
    same = search_front(PROBLEM, seed=3, **SMALL)
    other = search_front(PROBLEM, seed=4, **SMALL)
    np.testing.assert_array_equal(same.candidates, front.candidates)
    np.testing.assert_array_equal(same.errors_ips2, front.errors_ips2)
    assert (same.seed, other.seed) == (3, 4)
    assert not np.array_equal(other.candidates, front.candidates)


def test_who_watches_does_not_change_what_is_found(front):
    seen = []
    watched = search_front(PROBLEM, seed=3, on_progress=seen.append, **SMALL)

    np.testing.assert_array_equal(watched.candidates, front.candidates)
    assert [each.evaluations for each in seen] == [24, 48, 72, 96, 120]
    assert {each.total_evaluations for each in seen} == {120}
    assert all(1 <= each.front_size <= 24 for each in seen)
    least = [each.least_rmse_ips for each in seen]
    found = total_rmse_ips(PROBLEM, front.errors_ips2).min()
    assert least[-1] == pytest.approx(found, rel=0.05)


def test_a_total_weighs_groups_by_their_stimuli():
    problem = problem_of(groups=("a", "b", "b", "b"))
    total = total_rmse_ips(problem, np.array([[16.0, 0.0], [4.0, 4.0]]))
    assert total.tolist() == [2.0, 2.0]
    rates_ips = problem.rates_ips(np.array([[30.0, 4e3, 7.0]]))
    by_hand = np.sqrt(np.mean((rates_ips[0] - problem.observed_ips) ** 2))
    np.testing.assert_allclose(
        total_rmse_ips(problem, problem.group_errors(rates_ips)), by_hand, rtol=1e-13
    )


@pytest.mark.parametrize("name", ["published", "rising"])
def test_the_errors_of_a_front_are_of_full_precision(name, monkeypatch):
    """A search that single precision leads to the worst of one group: true errors.

    What turns out worse than another candidate is left out.
    """
    problem = problem_of(name=name)
    true_errors = FitProblem.errors_ips2

    def lying(self, values, single=False):
        errors = true_errors(self, values, single)
        return errors * [-1.0, 1.0] if single else errors

    monkeypatch.setattr(FitProblem, "errors_ips2", lying)
    found = search_front(problem, seed=2, evaluations=48, population=24)

    np.testing.assert_array_equal(found.errors_ips2, true_errors(problem, found.candidates))
    rows = found.errors_ips2
    for one in rows:
        assert not ((rows <= one).all(axis=1) & (rows < one).any(axis=1)).any()


@pytest.mark.parametrize("generations", [0, 1, 3])
def test_an_interrupt_inside_a_generation_gives_the_whole_ones_before(monkeypatch, generations):
    calls = []
    true_errors = FitProblem.errors_ips2

    def interrupted(self, values, single=False):
        calls.append(single)
        if single and calls.count(True) > generations:
            raise KeyboardInterrupt
        return true_errors(self, values, single)

    monkeypatch.setattr(FitProblem, "errors_ips2", interrupted)
    if not generations:
        with pytest.raises(KeyboardInterrupt):
            search_front(PROBLEM, seed=3, **SMALL)
        return

    stopped = search_front(PROBLEM, seed=3, **SMALL)

    assert (stopped.finished, stopped.evaluations) == (False, 24 * generations)
    monkeypatch.undo()
    by_then = search_front(PROBLEM, seed=3, evaluations=24 * generations, population=24)
    np.testing.assert_array_equal(stopped.candidates, by_then.candidates)


def test_the_unit_square_spans_what_is_searched():
    """Evenly in the logarithm: half of 1 to 10 000 is 100; or in themselves: 1."""
    free = (Free("tau_ms", 1.0, 1e4, "ms"), Free("spread", 0.0, 2.0, "1", even=True))
    unit = np.array([[0.0, 0.0], [0.5, 0.5], [0.25, 0.25], [1.0, 1.0]])
    values = from_unit(unit, free)
    np.testing.assert_allclose(
        values, [[1.0, 0.0], [100.0, 1.0], [10.0, 0.5], [1e4, 2.0]], rtol=1e-12
    )


# Rises of steps of 1000 Pa, each in two rows, before the window ends at 100 ms.
RISES = (3, 9, 2, 6)
ROWS = np.arange(201)


def choice_problem(observed_ips, groups=("a", "a", "b", "b")):
    """One spike for each 600 Pa in a row: with step 500 Pa, rate 10 a rise."""
    stress = np.zeros((201, 4))
    for column, rises in enumerate(RISES):
        stress[:, column] = 600.0 * np.minimum(ROWS // 16, rises)
    return problem_with(stress, observed_ips, groups, window_ms=(0.0, 100.0))


# Rates 10 x (3, 9, 2, 6) with a step below 600 Pa; with one above 600 Pa every other
# rise fires: 10 x (1, 4, 1, 3); above 1200 Pa every third: 10 x (1, 3, 0, 2).
EVERY, OTHER, THIRD = [1000.0, 500.0], [1e9, 700.0], [1e9, 1300.0]


def front_of(problem, *candidates):
    values = np.array(candidates)
    return Front(
        free=problem.free,
        groups=problem.group_names,
        candidates=values,
        errors_ips2=problem.errors_ips2(values),
        evaluations=len(values),
        seed=1,
        finished=True,
    )


@pytest.mark.parametrize(
    ("observed_ips", "row"), [((30, 80, 20, 60), 0), ((10, 45, 10, 30), 1), ((10, 30, 5, 20), 2)]
)
def test_the_smallest_error_is_taken_wherever_it_stands(observed_ips, row):
    problem = choice_problem(observed_ips)
    candidates = [EVERY, OTHER, THIRD]
    for shift in range(3):
        turned = candidates[shift:] + candidates[:shift]
        choice = choose(problem, front_of(problem, *turned))
        assert (choice.row, choice.rule) == ((row - shift) % 3, "smallest_error")
        assert "smallest RMSE over all 4 stimuli" in choice.why
        assert "of 3 candidates" in choice.why


def test_the_response_is_the_mean_rate_of_each_group():
    """EVERY: means 60 and 40 against 50 and 10: away by 10 and 30, RMS √500."""
    problem = choice_problem([20.0, 80.0, 0.0, 20.0])
    away_ips = frequency_response_error_ips(problem, np.array([EVERY, OTHER]))
    np.testing.assert_allclose(away_ips, np.sqrt([500.0, (25.0**2 + 10.0**2) / 2]), rtol=1e-12)


def test_near_the_smallest_error_the_response_decides():
    """Observed 20, 35, 5, 25. OTHER is off by −10, 5, 5, 5: RMS √43.75 = 6.61.

    THIRD is off by −10, −5, −5, −5, as far, with both means low. Means of OTHER are
    off by −2.5 and 5, of THIRD by −7.5 and −5.
    """
    problem = choice_problem([20.0, 35.0, 5.0, 25.0])
    for candidates, row in (([THIRD, OTHER], 1), ([OTHER, THIRD], 0)):
        front = front_of(problem, *candidates)
        assert choose(problem, front).row == 0  # a tie: the first
        choice = choose(problem, front, "frequency_response")
        assert choice.row == row
        assert "of the 2 candidates within 10%" in choice.why


@pytest.mark.parametrize(("near_ips", "row"), [(21.9, 1), (22.1, 0)])
def test_beyond_a_tenth_the_smaller_error_wins(near_ips, row):
    """The total of row 1 is just inside or outside 1.1 times 20 ips."""
    problem = choice_problem([20.0, 80.0, 0.0, 20.0])
    front = front_of(problem, EVERY, OTHER)  # OTHER has the closer response
    made = replace(front, errors_ips2=np.array([[400.0, 400.0], [near_ips**2, near_ips**2]]))
    assert NEAR_SHARE == 0.10
    assert choose(problem, made, "smallest_error").row == 0
    assert choose(problem, made, "frequency_response").row == row


GROUPS = ("20", "90", "20", "90", "50")
OBSERVED_IPS = (40.0, 60.0, 100.0, 140.0, 80.0)
EVALUATIONS = 400


def grouped_problem(observed_ips=OBSERVED_IPS, groups=GROUPS):
    stress_pa = sines([8e3, 3e3, 2e4, 1e4, 9e3], [20, 90, 20, 90, 50])
    return problem_with(stress_pa, observed_ips, groups, cells=2)


@pytest.fixture(scope="module")
def held_out():
    return held_out_ips(grouped_problem(), seed=5, evaluations=EVALUATIONS)


def test_a_held_out_prediction_does_not_know_what_was_observed(held_out):
    """Rates of one group change: its predictions stay, others move."""
    inside = np.array([name == "20" for name in GROUPS])
    changed = np.where(inside, 15.0, OBSERVED_IPS)
    other = held_out_ips(grouped_problem(changed), seed=5, evaluations=EVALUATIONS)
    np.testing.assert_array_equal(other[inside], held_out[inside])
    assert (other[~inside] != held_out[~inside]).any()


def test_predictions_are_those_of_searches_done_apart():
    problem, rule = grouped_problem(), "frequency_response"
    found = held_out_ips(problem, rule, seed=5, evaluations=200)
    for name in ("20", "90", "50"):
        inside = np.array([group == name for group in GROUPS])
        part = problem.part(~inside)
        front = search_front(part, seed=5, evaluations=200)
        without = front.candidates[choose(part, front, rule).row]
        np.testing.assert_array_equal(found[inside], problem.rates_ips(without)[0, inside])


@pytest.mark.parametrize(("argument", "value"), [("evaluations", 23), ("population", 3)])
def test_a_search_that_cannot_be_is_refused(argument, value):
    with pytest.raises(ParameterError) as caught:
        search_front(PROBLEM, **{**SMALL, argument: value})
    assert (caught.value.argument, caught.value.found) == (argument, value)
    with pytest.raises(ParameterError) as caught:
        held_out_ips(grouped_problem(groups=("all",) * 5))
    assert (caught.value.argument, caught.value.found) == ("groups", "all")
    problem = choice_problem([0.0] * 4)
    with pytest.raises(ParameterError) as caught:
        choose(problem, front_of(problem, EVERY), "best")
    assert (caught.value.argument, caught.value.found) == ("rule", "best")


def test_without_pymoo_a_search_names_it(monkeypatch):
    """Windows on ARM has no wheel of it."""
    monkeypatch.setitem(sys.modules, "pymoo.algorithms.moo.nsga2", None)
    with pytest.raises(MissingError, match="pip install pymoo"):
        search_front(PROBLEM, seed=3, **SMALL)
