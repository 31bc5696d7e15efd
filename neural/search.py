"""Search of a fit: NSGA-II over a model's free parameters (section 3.2), by pymoo.

A rule selects one candidate of the Pareto front. The paper states only: "a combination
with the smaller difference in the observed value and the closest approximation of the
frequency response was selected" (section 3.2). Leaving out one group of stimuli at a time
tests a model on stimuli that it was not fitted to.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from fembridge.errors import MissingError, ParameterError
from fembridge.typing import FloatArray
from neural.fit_problem import FitProblem
from neural.models import Free

if TYPE_CHECKING:
    from pymoo.core.problem import Problem

# Section 3.2: "10,000 function evaluations".
EVALUATIONS = 10_000

# Candidates per generation, among which the cost of a NumPy or pymoo call is divided.
POPULATION = 200


# Rules other than the total error select among candidates whose total error is at most this
# share above the smallest: "the smaller difference in the observed value" comes first.
NEAR_SHARE = 0.10

# The same for the rule `balanced`, which gives timing and thresholds more weight.
BALANCED_SHARE = 0.25


@dataclass(frozen=True, slots=True, eq=False)
class Front:
    """Pareto front: no candidate is better than another in every objective.

    `candidates` ``(candidate, free)`` in the units of `free`; `errors_ips2`
    ``(candidate, group)``; `target_errors` ``(candidate, target)`` of the other targets;
    sorted by the total error of the rates, smallest first. `finished` is False where the
    search was stopped before its last evaluation.
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
class SearchProgress:
    """Progress of a search."""

    evaluations: int
    total_evaluations: int
    front_size: int
    least_rmse_ips: float


def search_front(
    problem: FitProblem,
    *,
    evaluations: int = EVALUATIONS,
    seed: int = 1,
    population: int = POPULATION,
    on_progress: Callable[[SearchProgress], None] | None = None,
) -> Front:
    """Pareto front of `problem`; the same seed gives the same front.

    Only complete generations are evaluated, so that the last may exceed `evaluations`. Each
    is evaluated in one call in single precision; the returned errors are in full precision.
    After Ctrl-C the front of the last complete generation is returned, not `finished`.

    Parameters
    ----------
    problem
        Objectives and free parameters.
    evaluations
        Number of candidates evaluated. Default: 10 000.
    seed
        Seed of the search. Default: 1.
    population
        Candidates per generation. Default: 200.
    on_progress
        Called after each generation. Default: None.

    Raises
    ------
    ParameterError
        Fewer evaluations than candidates of a generation.
    MissingError
        pymoo is not installed.
    KeyboardInterrupt
        Before the first generation was complete.
    """
    if population < 4 or evaluations < population:
        raise ParameterError(
            argument="evaluations" if population >= 4 else "population",
            found=evaluations if population >= 4 else population,
            expected=f"{population} or more" if population >= 4 else "4 or more",
        )
    try:
        from pymoo.algorithms.moo.nsga2 import NSGA2
    except ImportError as error:  # it has no wheel for Windows on ARM
        raise MissingError(f"{error}; fitting needs it: pip install pymoo") from error

    algorithm = NSGA2(pop_size=population)
    algorithm.setup(_as_pymoo(problem), termination=("n_eval", evaluations), seed=seed)
    total_evaluations = -(-evaluations // population) * population
    finished = True
    try:
        while algorithm.has_next():
            algorithm.next()
            if on_progress:
                front = _front(problem, algorithm, seed)
                least_rmse_ips = float(total_rmse_ips(problem, front.errors_ips2).min())
                front_size = len(front.candidates)
                on_progress(
                    SearchProgress(front.evaluations, total_evaluations, front_size, least_rmse_ips)
                )
    except KeyboardInterrupt:
        if algorithm.opt is None:
            raise
        finished = not algorithm.has_next()
    return _sorted(problem, _front(problem, algorithm, seed), finished)


def total_rmse_ips(problem: FitProblem, errors_ips2: FloatArray) -> FloatArray:
    """RMSE over all stimuli in impulses/s, ``(candidate,)``, from the errors of the groups."""
    sizes = np.array([problem.groups.count(name) for name in problem.group_names])
    rmse: FloatArray = np.sqrt(errors_ips2 @ sizes / sizes.sum())
    return rmse


def _front(problem: FitProblem, algorithm: Any, seed: int) -> Front:  # noqa: ANN401
    best = algorithm.opt
    values = from_unit(np.atleast_2d(best.get("X")), problem.free)
    objectives = np.atleast_2d(best.get("F"))
    errors = problem.errors_ips2(values, single=True) if problem.targets else objectives
    return Front(
        free=problem.free,
        groups=problem.group_names,
        candidates=values,
        errors_ips2=errors,
        target_errors=objectives[:, 1:] if problem.targets else np.empty((len(values), 0)),
        evaluations=int(algorithm.evaluator.n_eval),
        seed=seed,
        finished=False,
    )


def _sorted(problem: FitProblem, front: Front, finished: bool) -> Front:
    """Front sorted by total error, without duplicates, errors in full precision.

    Candidates that are dominated in full precision are left out.
    """
    values = np.unique(front.candidates, axis=0)
    errors, target_errors = problem.errors_ips2(values), problem.target_errors(values)
    objectives = _objectives(problem, errors, target_errors)
    differences = objectives[:, np.newaxis] - objectives
    is_dominated = np.all(differences >= 0, axis=2) & np.any(differences > 0, axis=2)
    non_dominated = np.flatnonzero(~is_dominated.any(axis=1))
    order = non_dominated[np.argsort(total_rmse_ips(problem, errors[non_dominated]), kind="stable")]
    return replace(
        front,
        candidates=values[order],
        errors_ips2=errors[order],
        target_errors=target_errors[order],
        finished=finished,
    )


def _objectives(problem: FitProblem, errors: FloatArray, others: FloatArray) -> FloatArray:
    """Errors of the groups; with targets, the total error of the rates and those of the targets.

    With six objectives almost no candidate dominates another, and the search stops improving.
    """
    if not problem.targets:
        return errors
    return np.column_stack([total_rmse_ips(problem, errors) ** 2, others])


def from_unit(unit: FloatArray, free: tuple[Free, ...]) -> FloatArray:
    """Scale ``(candidate, free)`` from 0 to 1 into the units of the parameters."""
    columns = [
        parameter.low + (parameter.high - parameter.low) * unit[:, k]
        if parameter.even
        else parameter.low * (parameter.high / parameter.low) ** unit[:, k]
        for k, parameter in enumerate(free)
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
    """Row of the front that a rule selected, with the reason as a sentence."""

    row: int
    why: str
    rule: str


def choose(problem: FitProblem, front: Front, rule: str = "smallest_error") -> Choice:
    """Candidate of `front` that the rule `rule` of `RULES` selects (default: smallest_error).

    Raises
    ------
    ParameterError
        Unknown rule.
    """
    if rule not in RULES:
        raise ParameterError(argument="rule", found=rule, expected=f"one of {', '.join(RULES)}")
    return Choice(*_RULE_FUNCTIONS[rule](problem, front), rule)


def _choose_smallest_error(
    problem: FitProblem, front: Front, share: float = NEAR_SHARE
) -> tuple[int, str]:
    """Row with the smallest RMSE; with targets, see `RULES`.

    Errors of different targets have no common unit; their product needs no weights.
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


_choose_balanced = partial(_choose_smallest_error, share=BALANCED_SHARE)


def _choose_tolerant(problem: FitProblem, front: Front) -> tuple[int, str]:
    limits = np.array([target.tolerated for target in problem.targets])
    passing = np.flatnonzero(np.all(front.target_errors <= limits, axis=1))
    if not problem.targets or not passing.size:
        return _choose_balanced(problem, front)
    totals = total_rmse_ips(problem, front.errors_ips2[passing])
    row = int(passing[np.argmin(totals)])
    names = " and ".join(target.name for target in problem.targets)
    return row, (
        f"smallest RMSE of rates, {totals.min():.3g} ips, of the {passing.size} candidates with "
        f"tolerable errors of {names}"
    )


def _choose_frequency_response(problem: FitProblem, front: Front) -> tuple[int, str]:
    totals = total_rmse_ips(problem, front.errors_ips2)
    near = np.flatnonzero(totals <= (1.0 + NEAR_SHARE) * totals.min())
    difference_ips = frequency_response_error_ips(problem, front.candidates[near])
    best = int(np.argmin(difference_ips))
    return int(near[best]), (
        f"mean rates of the {len(problem.group_names)} groups closest to the observed "
        f"ones, {difference_ips[best]:.3g} ips RMS, of the {near.size} candidates within "
        f"{NEAR_SHARE:.0%} of the smallest total RMSE, {totals.min():.3g} ips"
    )


def frequency_response_error_ips(problem: FitProblem, values: FloatArray) -> FloatArray:
    """RMS over groups of mean predicted minus mean observed rate, ``(candidate,)``."""
    rates_ips = problem.rates_ips(values)
    names = np.array(problem.groups)
    differences = [
        rates_ips[:, names == name].mean(axis=1) - problem.observed_ips[names == name].mean()
        for name in problem.group_names
    ]
    error: FloatArray = np.sqrt(np.mean(np.square(differences), axis=0))
    return error


RULES: Mapping[str, str] = MappingProxyType(
    {
        "smallest_error": "smallest RMSE over all stimuli; with thresholds or spikes: smallest "
        "product of those errors among candidates within a tenth of the smallest RMSE",
        "balanced": "as smallest_error, among candidates within a quarter of the smallest RMSE",
        "tolerant": "smallest RMSE of the candidates with every threshold within a factor of 3 "
        "and vector strengths within 0.15 (RMS); without such candidates as balanced",
        "frequency_response": "mean rate at each frequency closest to the observed, among "
        "candidates within a tenth of the smallest RMSE",
    }
)
"""Description of each rule that selects a candidate."""

_RULE_FUNCTIONS: Mapping[str, Callable[[FitProblem, Front], tuple[int, str]]] = {
    "smallest_error": _choose_smallest_error,
    "balanced": _choose_balanced,
    "tolerant": _choose_tolerant,
    "frequency_response": _choose_frequency_response,
}


def held_out_ips(
    problem: FitProblem,
    rule: str = "smallest_error",
    on_progress: Callable[[str, SearchProgress], None] | None = None,
    **search: int,
) -> FloatArray:
    """Rate of each stimulus ``(stimulus,)`` by a fit without the stimuli of its group.

    `search` are options of `search_front`; `on_progress` is called with a label and progress.

    Raises
    ------
    ParameterError
        A single group, without which no stimulus remains.
    KeyboardInterrupt
        A search was interrupted.
    """
    names = problem.group_names
    if len(names) < 2:
        raise ParameterError(
            argument="groups", found=names[0], expected="two or more groups to leave one out"
        )
    rates_ips = np.empty_like(problem.observed_ips)
    for name in names:
        in_group = np.array([group == name for group in problem.groups])
        part, label = problem.part(~in_group), f"{problem.model.afferent} without {name}"
        progress = partial(on_progress, label) if on_progress else None
        front = search_front(part, on_progress=progress, **search)
        if not front.finished:
            raise KeyboardInterrupt
        values = front.candidates[choose(part, front, rule).row]
        rates_ips[in_group] = problem.part(in_group).rates_ips(values)[0]
    return rates_ips
