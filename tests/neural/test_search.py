"""The Pareto front of a small problem: reproducible, undominated, interruptible."""

from itertools import pairwise

import numpy as np
import pytest

from fembridge.errors import ParameterError
from neural.fit_problem import FitProblem
from neural.models import Free, model_named
from neural.search import from_unit, search_front, total_rmse_ips

DT_MS = 0.5
TIMES_MS = DT_MS * np.arange(101)
SMALL = {"evaluations": 120, "population": 24}


def problem_of(groups=("20", "20", "90", "90"), name="published", cells=1):
    """Two stimuli at each of two frequencies, observed so that no cell fits both."""
    stress = np.array([8e3, 2e4, 3e3, 1e4]) * (
        1.0 + np.sin(2e-3 * np.pi * np.outer(TIMES_MS, [20, 20, 90, 90]))
    )
    return FitProblem(
        model=model_named(name, "RA"),
        stress_pa=stress,
        observed_ips=np.array([60.0, 150.0, 20.0, 45.0]),
        groups=groups,
        windows_ms=((0.0, 50.0),) * 4,
        dt_ms=DT_MS,
        cells=cells,
    )


PROBLEM = problem_of()


@pytest.fixture(scope="module")
def front():
    return search_front(PROBLEM, seed=3, **SMALL)


def test_the_same_seed_gives_the_same_front_and_another_another(front):
    same = search_front(PROBLEM, seed=3, **SMALL)
    other = search_front(PROBLEM, seed=4, **SMALL)

    np.testing.assert_array_equal(same.values, front.values)
    np.testing.assert_array_equal(same.errors_ips2, front.errors_ips2)
    assert (same.seed, other.seed) == (3, 4)
    assert not np.array_equal(other.values, front.values)


def test_who_watches_does_not_change_what_is_found(front):
    seen = []
    watched = search_front(PROBLEM, seed=3, on_progress=seen.append, **SMALL)

    np.testing.assert_array_equal(watched.values, front.values)
    assert [each.evaluations for each in seen] == [24, 48, 72, 96, 120]
    assert {each.of for each in seen} == {120}
    assert all(1 <= each.front_size <= 24 for each in seen)
    least = [each.least_rmse_ips for each in seen]
    found = total_rmse_ips(PROBLEM, front.errors_ips2).min()
    assert least[-1] == pytest.approx(found, rel=0.05)


def test_a_front_tells_what_was_searched(front):
    assert front.free == PROBLEM.free
    assert front.groups == ("20", "90")
    assert front.values.shape == (len(front.values), 3)
    assert front.errors_ips2.shape == (len(front.values), 2)
    assert (front.evaluations, front.finished) == (120, True)
    assert len(front.values) > 1


def assert_undominated(found):
    rows = found.errors_ips2.tolist()
    for one in rows:
        for other in rows:
            nowhere_worse = all(a <= b for a, b in zip(other, one, strict=True))
            somewhere_better = any(a < b for a, b in zip(other, one, strict=True))
            assert not (nowhere_worse and somewhere_better)


@pytest.mark.parametrize("cells", [1, 3])
def test_no_row_of_a_front_is_worse_than_another(cells):
    assert_undominated(search_front(problem_of(cells=cells), seed=5, **SMALL))


def test_a_candidate_stands_once(monkeypatch):
    """Parameters rounded to powers of two: many candidates are the same."""

    def rounded(unit, free):
        return 2.0 ** np.ceil(np.log2(from_unit(unit, free)))

    monkeypatch.setattr("neural.search.from_unit", rounded)
    found = search_front(PROBLEM, seed=3, **SMALL)

    rows = [tuple(row) for row in found.values.tolist()]
    assert len(set(rows)) == len(rows) > 1


def test_a_front_is_sorted_by_the_error_of_all_stimuli(front):
    """Every group has two stimuli, so the total is the mean of both objectives."""
    totals = total_rmse_ips(PROBLEM, front.errors_ips2)

    np.testing.assert_allclose(totals, np.sqrt(front.errors_ips2.mean(axis=1)), rtol=1e-13)
    assert all(a <= b for a, b in pairwise(totals.tolist()))
    assert totals[0] < totals[-1]


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

    np.testing.assert_array_equal(found.errors_ips2, true_errors(problem, found.values))
    assert_undominated(found)


def test_what_is_found_lies_inside_what_is_searched(front):
    low = [one.low for one in front.free]
    high = [one.high for one in front.free]

    assert (front.values >= low).all()
    assert (front.values <= high).all()


def test_more_evaluations_find_no_worse():
    few = search_front(PROBLEM, seed=6, evaluations=24, population=24)
    many = search_front(PROBLEM, seed=6, evaluations=384, population=24)

    assert (
        total_rmse_ips(PROBLEM, many.errors_ips2)[0] < total_rmse_ips(PROBLEM, few.errors_ips2)[0]
    )


def test_one_group_has_a_front_of_its_best():
    problem = problem_of(groups=("all",) * 4)

    found = search_front(problem, seed=1, **SMALL)

    assert found.errors_ips2.shape[1] == 1
    assert len(set(found.errors_ips2.ravel().tolist())) == 1


def interrupt_after(evaluations):
    def watch(progress):
        if progress.evaluations >= evaluations:
            raise KeyboardInterrupt

    return watch


def test_an_interrupt_gives_what_was_found_by_then():
    stopped = search_front(PROBLEM, seed=3, on_progress=interrupt_after(48), **SMALL)
    by_then = search_front(PROBLEM, seed=3, evaluations=48, population=24)

    assert (stopped.finished, by_then.finished) == (False, True)
    assert stopped.evaluations == by_then.evaluations == 48
    np.testing.assert_array_equal(stopped.values, by_then.values)
    np.testing.assert_array_equal(stopped.errors_ips2, by_then.errors_ips2)


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
    np.testing.assert_array_equal(stopped.values, by_then.values)


def test_another_error_is_not_swallowed():
    def watch(progress):
        raise RuntimeError("the bar broke")

    with pytest.raises(RuntimeError, match="the bar broke"):
        search_front(PROBLEM, seed=3, on_progress=watch, **SMALL)


def test_the_unit_square_spans_what_is_searched():
    """Evenly in the logarithm: half of 1 to 10 000 is 100; or in themselves: 1."""
    free = (Free("tau_ms", 1.0, 1e4, "ms"), Free("spread", 0.0, 2.0, "1", even=True))
    unit = np.array([[0.0, 0.0], [0.5, 0.5], [0.25, 0.25], [1.0, 1.0]])

    values = from_unit(unit, free)

    np.testing.assert_allclose(
        values, [[1.0, 0.0], [100.0, 1.0], [10.0, 0.5], [1e4, 2.0]], rtol=1e-12
    )


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"evaluations": 23}, "23 evaluations in populations of 24, expected 4"),
        ({"evaluations": 0}, "0 evaluations in populations of 24"),
        ({"population": 3}, "in populations of 3, expected 4 or more"),
        ({"population": 200}, "120 evaluations in populations of 200"),
    ],
)
def test_a_search_that_cannot_be_is_refused(change, words):
    with pytest.raises(ParameterError, match=words):
        search_front(PROBLEM, **{**SMALL, **change})
