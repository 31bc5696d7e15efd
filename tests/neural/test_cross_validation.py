"""Predictions of a group come from fits that did not see it."""

import numpy as np
import pytest

from fembridge.errors import ParameterError
from neural.agreement import agreement
from neural.fit_problem import FitProblem
from neural.models import model_named
from neural.search import choose, cross_validate, search_front

DT_MS = 0.5
TIMES_MS = DT_MS * np.arange(101)
GROUPS = ("20", "90", "20", "90", "50")
OBSERVED_IPS = (40.0, 60.0, 100.0, 140.0, 80.0)
EVALUATIONS = 400


def problem_of(observed_ips=OBSERVED_IPS, groups=GROUPS):
    stress = np.array([8e3, 3e3, 2e4, 1e4, 9e3]) * (
        1.0 + np.sin(2e-3 * np.pi * np.outer(TIMES_MS, [20, 90, 20, 90, 50]))
    )
    return FitProblem(
        model=model_named("rising", "RA"),
        stress_pa=stress,
        observed_ips=np.array(observed_ips),
        groups=groups,
        windows_ms=((0.0, 50.0),) * 5,
        dt_ms=DT_MS,
        cells=2,
    )


def trial_of(problem, **options):
    return cross_validate(problem, 5, **{"evaluations": EVALUATIONS, **options})


@pytest.fixture(scope="module")
def trial():
    return trial_of(problem_of())


@pytest.mark.parametrize("group", ["20", "50"])
def test_a_held_out_prediction_does_not_know_what_was_observed(trial, group):
    """Rates of one group change: its predictions stay, the fit and others move."""
    inside = np.array([name == group for name in GROUPS])
    changed = np.where(inside, 15.0, OBSERVED_IPS)

    other = trial_of(problem_of(changed))

    np.testing.assert_array_equal(other.held_out_ips[inside], trial.held_out_ips[inside])
    assert (other.held_out_ips[~inside] != trial.held_out_ips[~inside]).any()
    assert (other.fitted_ips != trial.fitted_ips).any()


@pytest.mark.parametrize("rule", ["smallest_error", "frequency_response"])
def test_predictions_are_those_of_searches_done_apart(rule):
    problem = problem_of()
    trial = trial_of(problem, rule=rule, evaluations=200)

    def best(part):
        front = search_front(part, seed=5, evaluations=200)
        return front.values[choose(part, front, rule).row]

    fitted = best(problem)
    assert trial.seed == 5
    assert trial.parameters == problem.parameters(fitted)
    np.testing.assert_array_equal(trial.fitted_ips, problem.rates_ips(fitted)[0])
    for name in ("20", "90", "50"):
        inside = np.array([group == name for group in GROUPS])
        without = best(problem.part(~inside))
        np.testing.assert_array_equal(
            trial.held_out_ips[inside], problem.rates_ips(without)[0, inside]
        )


def test_a_trial_is_judged_on_all_stimuli(trial):
    assert trial.fitted_ips.shape == trial.held_out_ips.shape == (5,)
    for judged, rates_ips in (
        (trial.fitted, trial.fitted_ips),
        (trial.held_out, trial.held_out_ips),
    ):
        assert judged == agreement(OBSERVED_IPS, rates_ips)
        assert judged.regression.count == 5


def test_the_same_seed_gives_the_same_trial(trial):
    again = trial_of(problem_of())

    assert again.parameters == trial.parameters
    np.testing.assert_array_equal(again.held_out_ips, trial.held_out_ips)


def test_two_groups_leave_one_objective_each():
    problem = problem_of(groups=("a", "b", "a", "b", "b"))
    heard = []

    trial = trial_of(problem, evaluations=200, on_fit=heard.append)

    assert heard == ["all groups", "without a", "without b"]
    assert np.isfinite(trial.held_out_ips).all()


def test_a_single_group_leaves_nothing_to_fit_on():
    with pytest.raises(ParameterError, match="only the group all, expected two or more"):
        trial_of(problem_of(groups=("all",) * 5))
