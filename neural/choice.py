"""Which candidate of a Pareto front is taken, by rules that can be switched.

The paper says only: "a combination with the smaller difference in the observed value
and the closest approximation of the frequency response was selected" (section 3.2).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from fembridge.errors import ParameterError
from fembridge.typing import FloatArray
from neural.fit_problem import FitProblem
from neural.search import Front, total_rmse_ips

# The second rule looks among candidates whose total error is at most this much above
# the smallest: "the smaller difference in the observed value" comes first.
NEAR_SHARE = 0.10


@dataclass(frozen=True, slots=True)
class Choice:
    """Row of the front that a rule took, and why, in a sentence."""

    row: int
    rule: str
    why: str


@dataclass(frozen=True, slots=True)
class _Rule:
    sentence: str
    take: Callable[[FitProblem, Front], tuple[int, str]]


def choose(problem: FitProblem, front: Front, rule: str = "smallest_error") -> Choice:
    """Take one candidate of `front` by the rule of that name, one of `RULES`.

    Raises
    ------
    ParameterError
        No such rule.
    """
    check_rule(rule)
    row, why = _RULES[rule].take(problem, front)
    return Choice(row, rule, why)


def check_rule(rule: str) -> None:
    """Refuse a name that is not in `RULES`, with a `ParameterError`."""
    if rule not in _RULES:
        raise ParameterError(f"rule {rule!r}, expected one of {', '.join(_RULES)}")


def _smallest_error(problem: FitProblem, front: Front) -> tuple[int, str]:
    totals = total_rmse_ips(problem, front.errors_ips2)
    row = int(np.argmin(totals))
    return row, (
        f"smallest RMSE over all {problem.observed_ips.size} stimuli, "
        f"{totals[row]:.3g} ips, of {totals.size} candidates"
    )


def _frequency_response(problem: FitProblem, front: Front) -> tuple[int, str]:
    totals = total_rmse_ips(problem, front.errors_ips2)
    near = np.flatnonzero(totals <= (1.0 + NEAR_SHARE) * totals.min())
    away_ips = frequency_response_error_ips(problem, front.values[near])
    best = int(np.argmin(away_ips))
    return int(near[best]), (
        f"mean rates of the {len(problem.group_names)} groups closest to the observed "
        f"ones, {away_ips[best]:.3g} ips RMS, of the {near.size} candidates within "
        f"{NEAR_SHARE:.0%} of the smallest total RMSE, {totals.min():.3g} ips"
    )


def frequency_response_error_ips(problem: FitProblem, values: FloatArray) -> FloatArray:
    """RMS over groups of mean predicted minus mean observed rate, ``(candidate,)``."""
    rates_ips = problem.rates_ips(values)
    names = np.array(problem.groups)
    away = [
        rates_ips[:, names == name].mean(axis=1) - problem.observed_ips[names == name].mean()
        for name in problem.group_names
    ]
    error: FloatArray = np.sqrt(np.mean(np.square(away), axis=0))
    return error


_RULES: Mapping[str, _Rule] = MappingProxyType(
    {
        "smallest_error": _Rule("the smallest RMSE over all stimuli together", _smallest_error),
        "frequency_response": _Rule(
            "of candidates within a tenth of the smallest RMSE, the one whose mean "
            "rate at each frequency is closest to the observed",
            _frequency_response,
        ),
    }
)

RULES: Mapping[str, str] = MappingProxyType({name: rule.sentence for name, rule in _RULES.items()})
