"""How well a drive does on what it was not fitted on: one group left out at a time."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fembridge.errors import ParameterError
from fembridge.typing import FloatArray
from neural.agreement import Agreement, agreement
from neural.choice import check_rule, choose
from neural.fit_problem import FitProblem
from neural.parameters import AfferentParameters
from neural.search import EVALUATIONS, POPULATION, search_front


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """One seed: the fit on all groups, and predictions of each from the others.

    `fitted_ips` and `held_out_ips` are ``(stimulus,)``; a held-out rate is of a fit
    that saw no stimulus of its group.
    """

    seed: int
    parameters: AfferentParameters
    fitted_ips: FloatArray
    held_out_ips: FloatArray
    fitted: Agreement
    held_out: Agreement


def cross_validate(
    problem: FitProblem,
    seed: int,
    *,
    evaluations: int = EVALUATIONS,
    population: int = POPULATION,
    rule: str = "smallest_error",
    on_fit: Callable[[str], None] = lambda name: None,
) -> Trial:
    """Fit on all groups, then once without each; the seed is that of every search.

    Raises
    ------
    ParameterError
        A single group: nothing would be left to fit on; no such rule; or what
        `search_front` refuses.
    """
    check_rule(rule)
    names = problem.group_names
    if len(names) < 2:
        raise ParameterError(f"only the group {names[0]}, expected two or more to leave one out")
    settings = (seed, evaluations, population, rule)
    best = _best(problem, *settings)
    on_fit("all groups")
    held_out = np.empty_like(problem.observed_ips)
    for name in names:
        inside = np.array([group == name for group in problem.groups])
        values = _best(problem.part(~inside), *settings)
        held_out[inside] = problem.part(inside).rates_ips(values)[0]
        on_fit(f"without {name}")
    fitted = problem.rates_ips(best)[0]
    return Trial(
        seed=seed,
        parameters=problem.parameters(best),
        fitted_ips=fitted,
        held_out_ips=held_out,
        fitted=agreement(problem.observed_ips, fitted),
        held_out=agreement(problem.observed_ips, held_out),
    )


def _best(
    problem: FitProblem, seed: int, evaluations: int, population: int, rule: str
) -> FloatArray:
    front = search_front(problem, seed=seed, evaluations=evaluations, population=population)
    best: FloatArray = front.values[choose(problem, front, rule).row]
    return best
