"""NSGA-II over the free parameters of a drive (section 3.2 of the paper), by pymoo."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fembridge.errors import ParameterError
from fembridge.typing import FloatArray
from neural.drive_model import Free
from neural.fit_problem import FitProblem

if TYPE_CHECKING:
    from pymoo.core.problem import Problem

# Section 3.2: "10,000 function evaluations".
EVALUATIONS = 10_000

# Candidates of a generation: what NumPy and pymoo cost a call is shared by so many.
POPULATION = 200


@dataclass(frozen=True, slots=True, eq=False)
class Front:
    """Candidates of which none is better than another in every objective.

    `values` ``(candidate, free)`` in the units of `free`; `errors_ips2`
    ``(candidate, group)``; sorted by the total error, smallest first. `finished` is
    False where the search was stopped before its last evaluation.
    """

    free: tuple[Free, ...]
    groups: tuple[str, ...]
    values: FloatArray
    errors_ips2: FloatArray
    evaluations: int
    seed: int
    finished: bool


@dataclass(frozen=True, slots=True)
class Progress:
    """Where a search stands: for a bar, and for whoever watches the front."""

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
        Fewer evaluations than candidates of a generation, or a seed below 0.
    KeyboardInterrupt
        Before the first generation was whole.
    """
    if population < 4 or evaluations < population:
        raise ParameterError(
            f"{evaluations} evaluations in populations of {population}, expected 4 or "
            "more in a population and one population or more"
        )
    if seed < 0:
        raise ParameterError(f"seed is {seed}, expected 0 or more")
    algorithm = _algorithm(problem, evaluations, seed, population)
    whole = -(-evaluations // population) * population
    finished = True
    try:
        while algorithm.has_next():
            algorithm.next()
            if on_progress:
                front = _front(problem, algorithm, seed)
                least = float(total_rmse_ips(problem, front.errors_ips2).min())
                size = len(front.values)
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
    return Front(
        free=problem.free,
        groups=problem.group_names,
        values=from_unit(np.atleast_2d(best.get("X")), problem.free),
        errors_ips2=np.atleast_2d(best.get("F")),
        evaluations=int(algorithm.evaluator.n_eval),
        seed=seed,
        finished=False,
    )


def _sorted(problem: FitProblem, front: Front, finished: bool) -> Front:
    """Order a front by total error, each candidate once, errors in full precision.

    In full precision one candidate may turn out worse than another: it is left out.
    """
    from dataclasses import replace

    values = np.unique(front.values, axis=0)
    errors = problem.errors_ips2(values)
    apart = errors[:, np.newaxis] - errors
    worse = np.all(apart >= 0, axis=2) & np.any(apart > 0, axis=2)
    kept = np.flatnonzero(~worse.any(axis=1))
    order = kept[np.argsort(total_rmse_ips(problem, errors[kept]), kind="stable")]
    return replace(front, values=values[order], errors_ips2=errors[order], finished=finished)


def from_unit(unit: FloatArray, free: tuple[Free, ...]) -> FloatArray:
    """Scale ``(candidate, free)`` from 0 to 1 into the units of the parameters."""
    columns = [
        one.low + (one.high - one.low) * unit[:, k]
        if one.even
        else one.low * (one.high / one.low) ** unit[:, k]
        for k, one in enumerate(free)
    ]
    return np.stack(columns, axis=1)


def _algorithm(problem: FitProblem, evaluations: int, seed: int, population: int) -> Any:  # noqa: ANN401 - pymoo is untyped
    from pymoo.algorithms.moo.nsga2 import NSGA2

    algorithm = NSGA2(pop_size=population)
    algorithm.setup(_as_pymoo(problem), termination=("n_eval", evaluations), seed=seed)
    return algorithm


def _as_pymoo(problem: FitProblem) -> "Problem":
    from pymoo.core.problem import Problem

    class Rates(Problem):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__(
                n_var=len(problem.free), n_obj=len(problem.group_names), xl=0.0, xu=1.0
            )

        def _evaluate(self, unit: FloatArray, out: dict[str, Any], *_: object) -> None:
            out["F"] = problem.errors_ips2(from_unit(unit, problem.free), single=True)

    return Rates()
