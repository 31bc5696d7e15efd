"""The fit of one class, or of several: settings, search, the choice, and the files.

``fitted.toml`` says how its parameters came about: no rate, no path, no host and no
clock time, so that the same fit gives the same bytes.
"""

import math
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import version
from itertools import compress
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
from neural.parameters import MOST_CELLS, PUBLISHED, AfferentParameters
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
_LEAST_POPULATION = 4
_MOST_POPULATION = 10_000
_FAMILY_WORDS = {"sine": "sinusoids", "diharm": "diharmonics", "noise": "noises"}

# Called with the class and where its search stands.
OnProgress: TypeAlias = Callable[[str, Progress], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class FitSettings:
    """How long is searched, in which stimuli, and which candidate is taken.

    `families` of stimuli are fitted; the others are judged only. `cells` is None
    for as many as each model has.

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
        if self.cells is not None and not 1 <= self.cells <= MOST_CELLS:
            raise UsageError(f"cells is {self.cells}, expected 1 to {MOST_CELLS}")
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
    seen: bool
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
        """Agreement over each group, over each family, and over all families."""
        found = []
        for family in dict.fromkeys(entry.family for entry in self.entries):
            mine = self._part([entry.family == family for entry in self.entries])
            for group in dict.fromkeys(mine.groups):
                found.append(AgreementRow(family, group, self.seen, mine.of_group(group).total))
            found.append(AgreementRow(family, EVERY, self.seen, mine.total))
        if len({row.family for row in found}) > 1:
            found.append(AgreementRow(EVERY, EVERY, self.seen, self.total))
        return found

    def of_group(self, group: str) -> "JudgedRates":
        """The stimuli of one group, in their order."""
        return self._part([name == group for name in self.groups])

    def _part(self, kept: list[bool]) -> "JudgedRates":
        return JudgedRates(
            tuple(compress(self.entries, kept)),
            self.observed_ips[kept],
            self.predicted_ips[kept],
            self.seen,
        )


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

    def agreement_rows(self) -> list[AgreementRow]:
        """Agreement with all observed rates: those of the fit, then the others."""
        return [row for judged in self.judged for row in judged.rows()]


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
    on_fit: Callable[[Fit], None] = lambda fit: None,
) -> FitRun:
    """Fit each class of `models` to its observed rates, one after the other.

    The same seed gives the same fits. An interrupt from the keyboard ends the search
    at its last whole generation and leaves later classes out. `on_progress` is called
    with each generation, `on_fit` with each fit.

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
    problems = [
        fit_problem(
            observed,
            response,
            model,
            families=settings.families,
            preindent_um=settings.preindent_um,
            cells=settings.cells or 0,
        )
        for model in models.values()
    ]
    fits: list[Fit] = []
    for problem in problems:
        try:
            fits.append(_fit(observed, response, problem, settings, on_progress))
        except KeyboardInterrupt:
            if not fits:
                raise
            break
        on_fit(fits[-1])
        if not fits[-1].front.finished:
            break
    return FitRun(tuple(fits), tuple(models), settings)


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

    def judged(
        by: FitProblem, families: tuple[str, ...], values: FloatArray, seen: bool
    ) -> JudgedRates:
        entries = observed_entries(observed, afferent, families)
        return JudgedRates(entries, by.observed_ips, by.rates_ips(values)[0], seen)

    unseen = None
    others = tuple(name for name in FAMILIES if name not in settings.families)
    if observed_entries(observed, afferent, others):
        other = fit_problem(
            observed,
            response,
            problem.model,
            families=others,
            preindent_um=settings.preindent_um,
            cells=problem.cells,
        )
        unseen = judged(other, others, values, seen=False)
    as_printed = fit_problem(
        observed, response, model_named("published", afferent), families=settings.families
    )
    table_2 = np.array([getattr(PUBLISHED[afferent], one.field) for one in as_printed.free])
    return Fit(
        problem=problem,
        front=front,
        choice=choice,
        parameters=problem.parameters(values),
        fitted=judged(problem, settings.families, values, seen=True),
        unseen=unseen,
        published=judged(as_printed, settings.families, table_2, seen=False),
        seconds=seconds,
    )


PARAMETERS_FILE = "fitted.toml"
RATES_FILE = "fitted_rates.csv"


def front_file(afferent: str) -> str:
    """Name of the file with the front of a class."""
    return f"pareto_{afferent}.csv"


FRONT_FILES = tuple(map(front_file, AFFERENTS))


def write_fit(folder: Path, run: FitRun, name: str, provenance: Mapping[str, object]) -> None:
    """Write ``pareto_*.csv``, ``fitted.toml`` and ``fitted_rates.csv`` into `folder`.

    `name` is what the parameters are called, `provenance` the section ``fit`` of their
    file; see `fit_table`.

    Raises
    ------
    OutputError
        `folder` cannot be written.
    """
    import tomli_w

    for fit in run.fits:
        _write_front(folder / front_file(fit.afferent), fit)
    rates = [
        Rate(entry.id, fit.afferent, rate_ips)
        for fit in run.fits
        for judged in fit.judged
        for entry, rate_ips in zip(judged.entries, judged.predicted_ips.tolist(), strict=True)
    ]
    write_rates(folder / RATES_FILE, rates)
    table = {
        "name": name,
        "preindent_um": float(run.settings.preindent_um),
        **parameters_to_table({fit.afferent: fit.parameters for fit in run.fits}),
        "fit": dict(provenance),
    }
    write_text(folder / PARAMETERS_FILE, tomli_w.dumps(table))


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


def fit_table(
    run: FitRun,
    observed: ObservedRates,
    source: ResponseSource,
    options: Mapping[str, object] | None = None,
) -> Table:
    """The section ``fit`` of a file of fitted parameters.

    `options` are what was asked for on the command line, without paths.
    """
    settings = run.settings
    words = " and ".join(_FAMILY_WORDS[name] for name in settings.families)
    classes = ", ".join(fit.afferent for fit in run.fits)
    state = "" if run.finished else ", interrupted"
    table: Table = {
        "source": f"fembridge fit: NSGA-II on observed rates of {classes}, {words}{state}",
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


def _class_table(fit: Fit) -> Table:
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
                "seen": row.seen,
                "count": row.agreement.regression.count,
                "r_squared": row.agreement.regression.r_squared,
                "rmse_ips": row.agreement.rmse_ips,
                "bias_ips": row.agreement.bias_ips,
            }
            for row in fit.agreement_rows()
        ],
    }


class SearchBar(Bars):
    """A bar for the search of each class, called with how far it is."""

    def __call__(self, afferent: str, progress: Progress) -> None:
        """Move the bar of this class."""
        words = (
            f"{progress.evaluations}/{progress.of} evaluations, front of "
            f"{progress.front_size}, best RMSE {progress.least_rmse_ips:.3g} ips"
        )
        self.show(afferent, progress.evaluations / progress.of, words)
