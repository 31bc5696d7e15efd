"""The fit of one class, or of several: settings, search, the choice, and the files.

``fitted.toml`` says how its parameters came about: no rate, no path, no host and no
clock time, so that the same fit gives the same bytes.
"""

import math
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from itertools import chain
from pathlib import Path
from typing import TypeAlias

import numpy as np

from decks.stimuli import Entry
from fembridge import __version__
from fembridge.errors import UsageError
from fembridge.fitting.problem import ResponseSource, fit_problem, group_of, observed_entries
from fembridge.observed import FAMILIES, ObservedRates
from fembridge.progress import Bars
from fembridge.response.response_map import ResponseMap
from fembridge.store import write_text
from fembridge.tables import AFFERENTS, Rate, write_rates, write_table
from fembridge.typing import FloatArray, Table
from neural.agreement import Agreement, agreement
from neural.fit_problem import FitProblem
from neural.models import Model, model_named
from neural.parameter_sets import parameters_to_table
from neural.parameters import PUBLISHED, AfferentParameters
from neural.search import (
    EVALUATIONS,
    POPULATION,
    Choice,
    Front,
    Progress,
    choose,
    search_front,
    total_rmse_ips,
)

EVERY = "all"
_PUBLISHED = "published"
_LEAST_POPULATION = 4
_MOST_POPULATION = 10_000
_MOST_CELLS = 1000


@dataclass(frozen=True, slots=True, kw_only=True)
class FitSettings:
    """How long is searched, in which stimuli, and which candidate is taken.

    `families` of stimuli are fitted; the others are judged only. `cells` is None
    for as many as each drive has.

    Raises
    ------
    UsageError
        A number or a word that no fit can be made with.
    """

    families: tuple[str, ...] = FAMILIES[:1]
    preindent_um: float = 0.0
    cells: int | None = None
    evaluations: int = EVALUATIONS
    population: int = POPULATION
    seed: int = 1
    rule: str = "smallest_error"

    def __post_init__(self) -> None:
        if not (math.isfinite(self.preindent_um) and self.preindent_um >= 0):
            raise UsageError(f"preindent_um is {self.preindent_um}, expected >= 0")
        if self.cells is not None and not 1 <= self.cells <= _MOST_CELLS:
            raise UsageError(f"cells is {self.cells}, expected 1 to {_MOST_CELLS}")
        if not _LEAST_POPULATION <= self.population <= _MOST_POPULATION:
            raise UsageError(
                f"population is {self.population}, expected {_LEAST_POPULATION} to "
                f"{_MOST_POPULATION}"
            )
        if self.evaluations < self.population:
            raise UsageError(
                f"{self.evaluations} evaluations, expected at least one population of "
                f"{self.population}"
            )
        if self.seed < 0:
            raise UsageError(f"seed is {self.seed}, expected 0 or more")


@dataclass(frozen=True, slots=True)
class AgreementRow:
    """Agreement over one group of a family, over a family, or over all (``all``)."""

    family: str
    group: str
    agreement: Agreement


@dataclass(frozen=True, slots=True, eq=False)
class JudgedRates:
    """`predicted_ips` of a model beside `observed_ips`, ``(S,)``, stimuli `entries`.

    `seen` are stimuli that the model was fitted to.
    """

    entries: tuple[Entry, ...]
    observed_ips: FloatArray
    predicted_ips: FloatArray
    seen: bool

    @property
    def groups(self) -> tuple[str, ...]:
        """Group of each stimulus."""
        return tuple(map(group_of, self.entries))

    @property
    def total(self) -> Agreement:
        """Agreement over all stimuli."""
        return agreement(self.observed_ips, self.predicted_ips)

    def rows(self) -> list[AgreementRow]:
        """Give the agreement of each group, each family, and of all families."""
        families = [entry.family for entry in self.entries]
        found = []
        for family in dict.fromkeys(families):
            mine = [k for k, name in enumerate(families) if name == family]
            for group in dict.fromkeys(self.groups[k] for k in mine):
                inside = [k for k in mine if self.groups[k] == group]
                found.append(AgreementRow(family, group, self._over(inside)))
            found.append(AgreementRow(family, EVERY, self._over(mine)))
        if len(set(families)) > 1:
            found.append(AgreementRow(EVERY, EVERY, self.total))
        return found

    def of_group(self, group: str) -> "JudgedRates":
        """Give the stimuli of one group, in their order."""
        inside = [k for k, name in enumerate(self.groups) if name == group]
        return JudgedRates(
            tuple(self.entries[k] for k in inside),
            self.observed_ips[inside],
            self.predicted_ips[inside],
            self.seen,
        )

    def _over(self, rows: Sequence[int]) -> Agreement:
        inside = list(rows)
        return agreement(self.observed_ips[inside], self.predicted_ips[inside])


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
        return self.problem.model.afferent

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
    models: Mapping[str, Model],
    settings: FitSettings | None = None,
    *,
    on_progress: OnProgress | None = None,
    on_fit: Callable[[Fit], None] | None = None,
) -> FitRun:
    """Fit each class of `models` to its observed rates, one after the other.

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
    if not models:
        raise UsageError("no class to fit, expected some of SA, RA, PC")
    problems = [_problem(observed, response, model, settings) for model in models.values()]
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
    return FitRun(tuple(fits), tuple(models), settings)


def _problem(
    observed: ObservedRates, response: ResponseMap, model: Model, settings: FitSettings
) -> FitProblem:
    return fit_problem(
        observed,
        response,
        model,
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
    afferent = problem.model.afferent
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
    if not observed_entries(observed, problem.model.afferent, others):
        return None
    other = fit_problem(
        observed,
        response,
        problem.model,
        families=others,
        preindent_um=settings.preindent_um,
        cells=problem.cells,
    )
    return _judged(observed, other, others, values, seen=False)


def _published(
    observed: ObservedRates, response: ResponseMap, afferent: str, settings: FitSettings
) -> JudgedRates:
    model = model_named(_PUBLISHED, afferent)
    problem = fit_problem(observed, response, model, families=settings.families)
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
        observed_entries(observed, problem.model.afferent, families),
        problem.observed_ips,
        problem.rates_ips(values)[0],
        seen,
    )


PARAMETERS_FILE = "fitted.toml"
RATES_FILE = "fitted_rates.csv"


def front_file(afferent: str) -> str:
    """Give the name of the file with the front of a class."""
    return f"pareto_{afferent}.csv"


FRONT_FILES = tuple(map(front_file, AFFERENTS))


def write_fit(folder: Path, run: FitRun, name: str, provenance: Table) -> None:
    """Write ``pareto_*.csv``, ``fitted.toml`` and ``fitted_rates.csv`` into `folder`.

    Parameters
    ----------
    name
        What the parameters are called.
    provenance
        The section ``fit`` of the file of parameters; see `fit_table`.

    Raises
    ------
    OutputError
        `folder` cannot be written.
    """
    import tomli_w

    for fit in run.fits:
        _write_front(folder / front_file(fit.afferent), fit)
    write_rates(folder / RATES_FILE, fitted_rates(run))
    table = parameter_table(run, name, provenance)
    write_text(folder / PARAMETERS_FILE, tomli_w.dumps(table))


def parameter_table(run: FitRun, name: str, provenance: Mapping[str, object]) -> Table:
    """Give what ``fitted.toml`` holds: a file of parameters for every verb."""
    parameters = {fit.afferent: fit.parameters for fit in run.fits}
    return {
        "name": name,
        "preindent_um": float(run.settings.preindent_um),
        **parameters_to_table(parameters),
        "fit": dict(provenance),
    }


def fitted_rates(run: FitRun) -> list[Rate]:
    """Give the rates that the chosen candidates predict, of all observed stimuli."""
    return [
        Rate(entry.id, fit.afferent, rate_ips)
        for fit in run.fits
        for judged in fit.judged
        for entry, rate_ips in zip(judged.entries, judged.predicted_ips.tolist(), strict=True)
    ]


def _write_front(path: Path, fit: Fit) -> None:
    """Write a front as CSV: a row a candidate, the smallest total error first.

    Columns are the candidate's number from 1, whether it was chosen, its free
    parameters, the RMSE of each group and that of all stimuli.
    """
    front = fit.front
    groups = [f"rmse_{name.replace(' ', '_')}_ips" for name in front.groups]
    parameters = [one.field for one in front.free]
    header = ["afferent", "candidate", "chosen", *parameters, *groups, "rmse_all_ips"]
    totals = total_rmse_ips(fit.problem, front.errors_ips2).tolist()
    values, rmse = front.values.tolist(), (front.errors_ips2**0.5).tolist()
    rows = [
        [
            fit.afferent,
            row + 1,
            "yes" if row == fit.choice.row else "no",
            *values[row],
            *rmse[row],
            total,
        ]
        for row, total in enumerate(totals)
    ]
    write_table(path, header, rows)


_FAMILY_WORDS = {"sine": "sinusoids", "diharm": "diharmonics", "noise": "noises"}


def fit_table(
    run: FitRun,
    observed: ObservedRates,
    source: ResponseSource,
    options: Mapping[str, object] | None = None,
) -> Table:
    """Give the section ``fit`` of a file of fitted parameters.

    Parameters
    ----------
    options
        What was asked for on the command line, without paths.
    """
    settings = run.settings
    table: Table = {
        "source": _source(run),
        "finished": run.finished,
        "seed": settings.seed,
        "evaluations": settings.evaluations,
        "population": settings.population,
        "rule": settings.rule,
        "families": list(settings.families),
        "afferents": [fit.afferent for fit in run.fits],
        "left_out": list(run.asked[len(run.fits) :]),
        "versions": {
            "fembridge": __version__,
            "numpy": version("numpy"),
            "pymoo": version("pymoo"),
        },
        "observed": {"file": observed.path.name, "sha256": observed.sha256},
        "response": source.to_table(),
    }
    if options:
        table["options"] = {k: v for k, v in options.items() if v is not None}
    return table | {fit.afferent: _class_table(fit) for fit in run.fits}


def agreement_rows(fit: Fit) -> list[tuple[JudgedRates, AgreementRow]]:
    """Give every row of agreement of a fit, each with the rates it is of."""
    return list(
        chain.from_iterable(((judged, row) for row in judged.rows()) for judged in fit.judged)
    )


def _source(run: FitRun) -> str:
    words = " and ".join(_FAMILY_WORDS[name] for name in run.settings.families)
    classes = ", ".join(fit.afferent for fit in run.fits)
    state = "" if run.finished else ", interrupted"
    return f"fembridge fit: NSGA-II on observed rates of {classes}, {words}{state}"


def _class_table(fit: Fit) -> Table:
    """Give how one class was fitted."""
    model, free = fit.problem.model, fit.problem.free
    return {
        "drive": model.name,
        "equation": model.equation,
        "stress": model.quantity,
        "cells": fit.problem.cells,
        "finished": fit.front.finished,
        "evaluations": fit.front.evaluations,
        "front_size": len(fit.front.values),
        "candidate": fit.choice.row + 1,
        "rule": fit.choice.rule,
        "why": fit.choice.why,
        "free_parameters": len(free),
        "free": {
            one.field: {
                "low": one.low,
                "high": one.high,
                "unit": one.unit,
                "scale": "even" if one.even else "logarithmic",
            }
            for one in free
        },
        "observed_rates": {
            "fitted" if judged.seen else "unseen": dict(Counter(judged.groups))
            for judged in fit.judged
        },
        "agreement": [
            {
                "family": row.family,
                "group": row.group,
                "seen": judged.seen,
                "count": row.agreement.regression.count,
                "r_squared": row.agreement.regression.r_squared,
                "rmse_ips": row.agreement.rmse_ips,
                "bias_ips": row.agreement.bias_ips,
            }
            for judged, row in agreement_rows(fit)
        ],
    }


class SearchBar(Bars):
    """A bar for the search of each class, called with how far it is."""

    def __call__(self, afferent: str, progress: Progress) -> None:
        """Move the bar of this class."""
        self.show(afferent, progress.evaluations / progress.of, words_of(progress))


def words_of(progress: Progress) -> str:
    """Evaluations, the size of the front and its least RMSE, in a line."""
    return (
        f"{progress.evaluations}/{progress.of} evaluations, front of "
        f"{progress.front_size}, best RMSE {progress.least_rmse_ips:.3g} ips"
    )
