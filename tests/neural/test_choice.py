"""Which candidate of a front is taken, on fronts made by hand."""

import numpy as np
import pytest

from fembridge.errors import ParameterError
from neural.fit_problem import FitProblem
from neural.models import model_named
from neural.search import (
    NEAR_SHARE,
    RULES,
    Front,
    choose,
    frequency_response_error_ips,
    search_front,
)

# Rises of steps of 1000 Pa, each in two rows, before the window ends at 100 ms.
RISES = (3, 9, 2, 6)
TIMES = np.arange(201)


def problem_of(observed_ips, groups=("a", "a", "b", "b")):
    """One spike for each 600 Pa in a row: with step 500 Pa, rate 10 a rise."""
    stress = np.zeros((201, 4))
    for column, rises in enumerate(RISES):
        stress[:, column] = 600.0 * np.minimum(TIMES // 16, rises)
    return FitProblem(
        model=model_named("rising", "RA"),
        stress_pa=stress,
        observed_ips=np.array(observed_ips),
        groups=groups,
        windows_ms=((0.0, 100.0),) * 4,
        dt_ms=0.5,
        cells=1,
    )


# Rates 10 x (3, 9, 2, 6) with a step below 600 Pa; with one above 600 Pa every other
# rise fires: 10 x (1, 4, 1, 3); above 1200 Pa every third: 10 x (1, 3, 0, 2).
EVERY, OTHER, THIRD = [1000.0, 500.0], [1e9, 700.0], [1e9, 1300.0]


def front_of(problem, *candidates):
    values = np.array(candidates)
    return Front(
        free=problem.free,
        groups=problem.group_names,
        values=values,
        errors_ips2=problem.errors_ips2(values),
        evaluations=len(values),
        seed=1,
        finished=True,
    )


def test_the_candidates_fire_what_is_said_of_them():
    rates_ips = problem_of([0.0] * 4).rates_ips(np.array([EVERY, OTHER, THIRD]))

    np.testing.assert_allclose(
        rates_ips, [[30, 90, 20, 60], [10, 40, 10, 30], [10, 30, 0, 20]], rtol=1e-12
    )


@pytest.mark.parametrize(
    ("observed_ips", "row"), [((30, 80, 20, 60), 0), ((10, 45, 10, 30), 1), ((10, 30, 5, 20), 2)]
)
def test_the_smallest_error_is_taken_wherever_it_stands(observed_ips, row):
    problem = problem_of(observed_ips)
    candidates = [EVERY, OTHER, THIRD]

    for shift in range(3):
        turned = candidates[shift:] + candidates[:shift]
        choice = choose(problem, front_of(problem, *turned))
        assert (choice.row, choice.rule) == ((row - shift) % 3, "smallest_error")
        assert "smallest RMSE over all 4 stimuli" in choice.why
        assert "of 3 candidates" in choice.why


def test_the_response_is_the_mean_rate_of_each_group():
    """EVERY: means 60 and 40 against 50 and 10: away by 10 and 30, RMS √500."""
    problem = problem_of([20.0, 80.0, 0.0, 20.0])

    away_ips = frequency_response_error_ips(problem, np.array([EVERY, OTHER]))

    np.testing.assert_allclose(away_ips, np.sqrt([500.0, (25.0**2 + 10.0**2) / 2]), rtol=1e-12)


def test_groups_weigh_alike_in_the_response_whatever_their_size():
    """Means of OTHER: 10 of one stimulus, 80/3 of three."""
    problem = problem_of([0.0, 0.0, 0.0, 0.0], groups=("a", "b", "b", "b"))

    [away_ips] = frequency_response_error_ips(problem, np.array([OTHER]))

    assert away_ips == pytest.approx(np.sqrt((10.0**2 + (80 / 3) ** 2) / 2))


def test_near_the_smallest_error_the_response_decides():
    """Observed 20, 35, 5, 25. OTHER is off by −10, 5, 5, 5: RMS √43.75 = 6.61.

    THIRD is off by −10, −5, −5, −5, as far, with both means low. Means of OTHER are
    off by −2.5 and 5, of THIRD by −7.5 and −5.
    """
    problem = problem_of([20.0, 35.0, 5.0, 25.0])

    for candidates, row in (([THIRD, OTHER], 1), ([OTHER, THIRD], 0)):
        front = front_of(problem, *candidates)
        assert choose(problem, front).row == 0  # a tie: the first
        choice = choose(problem, front, "frequency_response")
        assert choice.row == row
        assert "of the 2 candidates within 10%" in choice.why


@pytest.mark.parametrize(("near_ips", "row"), [(21.9, 1), (22.1, 0)])
def test_beyond_a_tenth_the_smaller_error_wins(near_ips, row):
    """The total of row 1 is just inside or outside 1.1 times 20 ips."""
    problem = problem_of([20.0, 80.0, 0.0, 20.0])
    front = front_of(problem, EVERY, OTHER)  # OTHER has the closer response
    made = Front(
        free=front.free,
        groups=front.groups,
        values=front.values,
        errors_ips2=np.array([[400.0, 400.0], [near_ips**2, near_ips**2]]),
        evaluations=2,
        seed=1,
        finished=True,
    )

    assert NEAR_SHARE == 0.10
    assert choose(problem, made, "smallest_error").row == 0
    assert choose(problem, made, "frequency_response").row == row


def test_a_front_without_error_is_near_itself():
    rates_ips = problem_of([0.0] * 4).rates_ips(np.array([OTHER]))[0]
    problem = problem_of(rates_ips)
    front = front_of(problem, EVERY, OTHER, THIRD)

    assert [choose(problem, front, rule).row for rule in RULES] == [1, 1]


@pytest.mark.parametrize("rule", RULES)
def test_every_rule_takes_a_row_of_a_searched_front_and_says_why(rule):
    problem = problem_of([30.0, 50.0, 10.0, 50.0])
    front = search_front(problem, seed=1, evaluations=60, population=20)

    choice = choose(problem, front, rule)

    assert 0 <= choice.row < len(front.values)
    assert choice.rule == rule
    assert "ips" in choice.why
    assert RULES[rule]


def test_an_unknown_rule_is_refused():
    problem = problem_of([0.0] * 4)

    with pytest.raises(
        ParameterError, match="rule 'best', expected one of smallest_error, frequency"
    ):
        choose(problem, front_of(problem, EVERY), "best")
