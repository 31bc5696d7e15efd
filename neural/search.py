"""The search of a fit: NSGA-II over a model's free parameters (section 3.2), by pymoo.

One candidate of the Pareto front is taken by a rule that can be switched. The paper
says only: "a combination with the smaller difference in the observed value and the
closest approximation of the frequency response was selected" (section 3.2). How well a
model does on what it was not fitted to is found by leaving out one group at a time.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from fembridge.errors import ParameterError
from fembridge.typing import FloatArray
from neural.fit_problem import FitProblem
from neural.models import Free

if TYPE_CHECKING:
    from pymoo.core.problem import Problem

# Section 3.2: "10,000 function evaluations".
EVALUATIONS = 10_000

# Candidates of a generation: what NumPy and pymoo cost a call is shared by so many.
POPULATION = 200


# The second rule looks among candidates whose total error is at most this much above
# the smallest: "the smaller difference in the observed value" comes first.
NEAR_SHARE = 0.10

# And the third rule, where timing or thresholds are worth some of the rates.
BALANCED_SHARE = 0.25


@dataclass(frozen=True, slots=True, eq=False)
class Front:
    """Candidates of which none is better than another in every objective.

    `candidates` ``(candidate, free)`` in the units of `free`; `errors_ips2`
    ``(candidate, group)``; `target_errors` ``(candidate, target)`` of what is fitted
    beside rates; sorted by the total error of the rates, smallest first. `finished` is
    False where the search was stopped before its last evaluation.
    """

    free: tuple[Free, ...]
    groups: tuple[str, ...]
    candidates: FloatArray
    errors_ips2: FloatArray
    evaluations: int
    seed: int
    finished: bool
    target_errors: FloatArray = field(default_factory=lambda: np.empty((0, 0)))


@dataclass(frozen=True, slots=True)
class Progress:
    """Where a search stands: for a bar."""

    evaluations: int
    of: int
    front_size: int
    least_rmse_ips: float


def search_front(
    problem: FitProblem,
    *,
    evaluations: int = EVALUATIONS,
    seed: int = 1,
    population: int = POPULATION,
    on_progress: Callable[[Progress], None] | None = None,
) -> Front:
    """Search the Pareto front of `problem`; the same seed gives the same front.

    Whole generations are tried, so that the last may go beyond `evaluations`. Each
    is evaluated in one call, in single precision; the errors that are given are of
    full precision. An interrupt from the keyboard ends the
    search at the last whole generation: what was found is given, not `finished`.

    Raises
    ------
    ParameterError
        Fewer evaluations than candidates of a generation.
    KeyboardInterrupt
        Before the first generation was whole.
    """
    if population < 4 or evaluations < population:
        raise ParameterError(
            f"{evaluations} evaluations in populations of {population}, expected 4 or "
            "more in a population and one population or more"
        )
    from pymoo.algorithms.moo.nsga2 import NSGA2

    algorithm = NSGA2(pop_size=population)
    algorithm.setup(_as_pymoo(problem), termination=("n_eval", evaluations), seed=seed)
    whole = -(-evaluations // population) * population
    finished = True
    try:
        while algorithm.has_next():
            algorithm.next()
            if on_progress:
                front = _front(problem, algorithm, seed)
                least = float(total_rmse_ips(problem, front.errors_ips2).min())
                size = len(front.candidates)
                on_progress(Progress(front.evaluations, whole, size, least))
    except KeyboardInterrupt:
        if algorithm.opt is None:
            raise
        finished = not algorithm.has_next()
    return _sorted(problem, _front(problem, algorithm, seed), finished)


def total_rmse_ips(problem: FitProblem, errors_ips2: FloatArray) -> FloatArray:
    """RMSE over all stimuli ``(candidate,)``, from the errors of the groups."""
    sizes = np.array([problem.groups.count(name) for name in problem.group_names])
    rmse: FloatArray = np.sqrt(errors_ips2 @ sizes / sizes.sum())
    return rmse


def _front(problem: FitProblem, algorithm: Any, seed: int) -> Front:  # noqa: ANN401
    best = algorithm.opt
    values = from_unit(np.atleast_2d(best.get("X")), problem.free)
    found = np.atleast_2d(best.get("F"))
    errors = problem.errors_ips2(values, single=True) if problem.targets else found
    return Front(
        free=problem.free,
        groups=problem.group_names,
        candidates=values,
        errors_ips2=errors,
        target_errors=found[:, 1:] if problem.targets else np.empty((len(values), 0)),
        evaluations=int(algorithm.evaluator.n_eval),
        seed=seed,
        finished=False,
    )


def _sorted(problem: FitProblem, front: Front, finished: bool) -> Front:
    """Order a front by total error, each candidate once, errors in full precision.

    In full precision one candidate may turn out worse than another: it is left out.
    """
    values = np.unique(front.candidates, axis=0)
    errors, others = problem.errors_ips2(values), problem.target_errors(values)
    objectives = _objectives(problem, errors, others)
    apart = objectives[:, np.newaxis] - objectives
    worse = np.all(apart >= 0, axis=2) & np.any(apart > 0, axis=2)
    kept = np.flatnonzero(~worse.any(axis=1))
    order = kept[np.argsort(total_rmse_ips(problem, errors[kept]), kind="stable")]
    return replace(
        front,
        candidates=values[order],
        errors_ips2=errors[order],
        target_errors=others[order],
        finished=finished,
    )


def _objectives(problem: FitProblem, errors: FloatArray, others: FloatArray) -> FloatArray:
    """Errors of the groups; with targets that of all rates is one objective beside theirs.

    With six objectives nearly no candidate is worse than another, and a search goes nowhere.
    """
    if not problem.targets:
        return errors
    return np.column_stack([total_rmse_ips(problem, errors) ** 2, others])


def from_unit(unit: FloatArray, free: tuple[Free, ...]) -> FloatArray:
    """Scale ``(candidate, free)`` from 0 to 1 into the units of the parameters."""
    columns = [
        one.low + (one.high - one.low) * unit[:, k]
        if one.even
        else one.low * (one.high / one.low) ** unit[:, k]
        for k, one in enumerate(free)
    ]
    return np.stack(columns, axis=1)


def _as_pymoo(problem: FitProblem) -> "Problem":
    from pymoo.core.problem import Problem

    class Rates(Problem):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__(
                n_var=len(problem.free),
                n_obj=1 + len(problem.targets) if problem.targets else len(problem.group_names),
                xl=0.0,
                xu=1.0,
            )

        def _evaluate(self, unit: FloatArray, out: dict[str, Any], *_: object) -> None:
            values = from_unit(unit, problem.free)
            errors = problem.errors_ips2(values, single=True)
            others = problem.target_errors(values, single=True)
            out["F"] = _objectives(problem, errors, others)

    return Rates()


@dataclass(frozen=True, slots=True)
class Choice:
    """Row of the front that a rule took, and why, in a sentence."""

    row: int
    why: str
    rule: str


def choose(problem: FitProblem, front: Front, rule: str = "smallest_error") -> Choice:
    """One candidate of `front` by the rule of that name, one of `RULES`.

    Raises
    ------
    ParameterError
        No such rule.
    """
    if rule not in RULES:
        raise ParameterError(f"rule {rule!r}, expected one of {', '.join(RULES)}")
    return Choice(*_TAKEN_BY[rule](problem, front), rule)


def _smallest_error(
    problem: FitProblem, front: Front, share: float = NEAR_SHARE
) -> tuple[int, str]:
    """With targets, of candidates with near the smallest RMSE that with the smallest other errors.

    Errors of different kinds have no common unit: their product has no weights.
    """
    totals = total_rmse_ips(problem, front.errors_ips2)
    if not problem.targets:
        row = int(np.argmin(totals))
        return row, (
            f"smallest RMSE over all {problem.observed_ips.size} stimuli, "
            f"{totals[row]:.3g} ips, of {totals.size} candidates"
        )
    near = np.flatnonzero(totals <= (1.0 + share) * totals.min())
    others = np.sqrt(front.target_errors)
    row = int(near[np.argmin(np.log(np.maximum(others[near], 1e-9)).sum(axis=1))])
    parts = [
        f"{target.name} {error:.3g}"
        for target, error in zip(problem.targets, others[row], strict=True)
    ]
    return row, (
        f"smallest RMS error of {', '.join(parts)}, of the {near.size} candidates within "
        f"{share:.0%} of the smallest RMSE of rates, {totals.min():.3g} ips"
    )


_balanced = partial(_smallest_error, share=BALANCED_SHARE)


def _tolerant(problem: FitProblem, front: Front) -> tuple[int, str]:
    limits = np.array([target.tolerated for target in problem.targets])
    passing = np.flatnonzero(np.all(front.target_errors <= limits, axis=1))
    if not problem.targets or not passing.size:
        return _balanced(problem, front)
    totals = total_rmse_ips(problem, front.errors_ips2[passing])
    row = int(passing[np.argmin(totals)])
    names = " and ".join(target.name for target in problem.targets)
    return row, (
        f"smallest RMSE of rates, {totals.min():.3g} ips, of the {passing.size} candidates with "
        f"tolerable errors of {names}"
    )


def _frequency_response(problem: FitProblem, front: Front) -> tuple[int, str]:
    totals = total_rmse_ips(problem, front.errors_ips2)
    near = np.flatnonzero(totals <= (1.0 + NEAR_SHARE) * totals.min())
    away_ips = frequency_response_error_ips(problem, front.candidates[near])
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


RULES: Mapping[str, str] = MappingProxyType(
    {
        "smallest_error": "the smallest RMSE over all stimuli together; with thresholds or spikes, "
        "of candidates within a tenth of it the one with the smallest of those errors",
        "balanced": "the same with thresholds or spikes, of candidates within a quarter of it",
        "tolerant": "the smallest RMSE of those with no threshold off by more than 3 times and "
        "vector strengths off by 0.15 at most (RMS); where there is none, as balanced",
        "frequency_response": "of candidates within a tenth of the smallest RMSE, the one whose "
        "mean rate at each frequency is closest to the observed",
    }
)
"""Rules that take a candidate, in words."""

_TAKEN_BY: Mapping[str, Callable[[FitProblem, Front], tuple[int, str]]] = {
    "smallest_error": _smallest_error,
    "balanced": _balanced,
    "tolerant": _tolerant,
    "frequency_response": _frequency_response,
}


def held_out_ips(
    problem: FitProblem,
    rule: str = "smallest_error",
    on_progress: Callable[[str, Progress], None] | None = None,
    **search: int,
) -> FloatArray:
    """Rate of each stimulus ``(stimulus,)`` by a fit that saw no stimulus of its group.

    `search` are options of `search_front`; `on_progress` is called with the words for it.

    Raises
    ------
    ParameterError
        A single group: nothing would be left to fit on.
    KeyboardInterrupt
        A search was interrupted.
    """
    names = problem.group_names
    if len(names) < 2:
        raise ParameterError(f"only the group {names[0]}, expected two or more to leave one out")
    found = np.empty_like(problem.observed_ips)
    for name in names:
        inside = np.array([group == name for group in problem.groups])
        part, words = problem.part(~inside), f"{problem.model.afferent} without {name}"
        progress = partial(on_progress, words) if on_progress else None
        front = search_front(part, on_progress=progress, **search)
        if not front.finished:
            raise KeyboardInterrupt
        values = front.candidates[choose(part, front, rule).row]
        found[inside] = problem.part(inside).rates_ips(values)[0]
    return found
