"""The fit of one class, or of several: problem, front, the candidate that is taken."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from fembridge.errors import UsageError
from fembridge.fitting.judged_rates import JudgedRates
from fembridge.fitting.problem import fit_problem, observed_entries
from fembridge.fitting.settings import FitSettings
from fembridge.observed import FAMILIES, ObservedRates
from fembridge.response.response_map import ResponseMap
from fembridge.typing import FloatArray
from neural.choice import Choice, choose
from neural.drive_model import Drive
from neural.drive_table import drive_named
from neural.fit_problem import FitProblem
from neural.parameters import PUBLISHED, AfferentParameters
from neural.search import Front, Progress, search_front

OnProgress: TypeAlias = Callable[[str, Progress], None]
"""Hears the class and where its search stands."""

_PUBLISHED = "published"


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Fit of one class: what was minimised, what was found, what was taken and why.

    `fitted` are its rates under the stimuli of the fit, `unseen` those under the
    others that were observed (None where there are none), `published` those of
    Table 2 under the stimuli of the fit, with no pre-indentation: as the paper has
    it. `seconds` is how long the search took.
    """

    problem: FitProblem
    front: Front
    choice: Choice
    parameters: AfferentParameters
    fitted: JudgedRates
    unseen: JudgedRates | None
    published: JudgedRates
    seconds: float

    @property
    def afferent(self) -> str:
        """The class."""
        return self.problem.drive.afferent

    @property
    def judged(self) -> tuple[JudgedRates, ...]:
        """Rates under all observed stimuli: those of the fit, then the others."""
        return (self.fitted,) if self.unseen is None else (self.fitted, self.unseen)


@dataclass(frozen=True, slots=True, eq=False)
class FitRun:
    """Fits of the classes that were asked for, in that order.

    After an interrupt the last one may not be `finished`, and later ones absent.
    """

    fits: tuple[Fit, ...]
    asked: tuple[str, ...]
    settings: FitSettings

    @property
    def finished(self) -> bool:
        """Whether every class is there and was searched to the end."""
        return len(self.fits) == len(self.asked) and all(fit.front.finished for fit in self.fits)


def fit_afferents(
    observed: ObservedRates,
    response: ResponseMap,
    drives: Mapping[str, Drive],
    settings: FitSettings | None = None,
    *,
    on_progress: OnProgress | None = None,
    on_fit: Callable[[Fit], None] | None = None,
) -> FitRun:
    """Fit each class of `drives` to its observed rates, one after the other.

    The same seed gives the same fits. An interrupt from the keyboard ends the search
    at its last whole generation and leaves later classes out.

    Parameters
    ----------
    on_progress
        Hears of each generation.
    on_fit
        Hears of each fit when it is made.

    Raises
    ------
    UsageError
        No class, or one without observed rates of the families to fit.
    ResponseError
        A stimulus that goes deeper than the response.
    KeyboardInterrupt
        Before the first generation of the first class was whole.
    """
    settings = settings or FitSettings()
    if not drives:
        raise UsageError("no class to fit, expected some of SA, RA, PC")
    problems = [_problem(observed, response, drive, settings) for drive in drives.values()]
    fits: list[Fit] = []
    for problem in problems:
        try:
            fits.append(_fit(observed, response, problem, settings, on_progress))
        except KeyboardInterrupt:
            if not fits:
                raise
            break
        if on_fit is not None:
            on_fit(fits[-1])
        if not fits[-1].front.finished:
            break
    return FitRun(tuple(fits), tuple(drives), settings)


def _problem(
    observed: ObservedRates, response: ResponseMap, drive: Drive, settings: FitSettings
) -> FitProblem:
    return fit_problem(
        observed,
        response,
        drive,
        families=settings.families,
        preindent_um=settings.preindent_um,
        cells=settings.cells or 0,
    )


def _fit(
    observed: ObservedRates,
    response: ResponseMap,
    problem: FitProblem,
    settings: FitSettings,
    on_progress: OnProgress | None,
) -> Fit:
    afferent = problem.drive.afferent
    start_s = time.perf_counter()
    front = search_front(
        problem,
        evaluations=settings.evaluations,
        seed=settings.seed,
        population=settings.population,
        on_progress=(lambda now: on_progress(afferent, now)) if on_progress else None,
    )
    seconds = time.perf_counter() - start_s
    choice = choose(problem, front, settings.rule)
    values = front.values[choice.row]
    return Fit(
        problem=problem,
        front=front,
        choice=choice,
        parameters=problem.parameters(values),
        fitted=_judged(observed, problem, settings.families, values, seen=True),
        unseen=_unseen(observed, response, problem, settings, values),
        published=_published(observed, response, afferent, settings),
        seconds=seconds,
    )


def _unseen(
    observed: ObservedRates,
    response: ResponseMap,
    problem: FitProblem,
    settings: FitSettings,
    values: FloatArray,
) -> JudgedRates | None:
    """Judge the chosen candidate by the observed rates that it was not fitted to."""
    others = tuple(name for name in FAMILIES if name not in settings.families)
    if not observed_entries(observed, problem.drive.afferent, others):
        return None
    other = fit_problem(
        observed,
        response,
        problem.drive,
        families=others,
        preindent_um=settings.preindent_um,
        cells=problem.cells,
    )
    return _judged(observed, other, others, values, seen=False)


def _published(
    observed: ObservedRates, response: ResponseMap, afferent: str, settings: FitSettings
) -> JudgedRates:
    drive = drive_named(_PUBLISHED, afferent)
    problem = fit_problem(observed, response, drive, families=settings.families)
    known = PUBLISHED[afferent]
    values = np.array([getattr(known, one.field) for one in problem.free])
    return _judged(observed, problem, settings.families, values, seen=False)


def _judged(
    observed: ObservedRates,
    problem: FitProblem,
    families: tuple[str, ...],
    values: FloatArray,
    *,
    seen: bool,
) -> JudgedRates:
    return JudgedRates(
        observed_entries(observed, problem.drive.afferent, families),
        problem.observed_ips,
        problem.rates_ips(values)[0],
        seen,
    )
