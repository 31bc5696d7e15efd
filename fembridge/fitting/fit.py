"""Fit of one or several afferent classes: settings, search, choice and files.

``fitted.toml`` describes how its parameters were fitted, without rates, paths, host and
clock time, so that the same fit gives the same bytes.
"""

import math
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pandas as pd

from fembridge.errors import UsageError
from fembridge.fitting.problem import (
    EVERY,
    ResponseSource,
    fit_problem,
    observed_entries,
)
from fembridge.observed import FAMILIES, ObservedRates
from fembridge.response.response_map import ResponseMap
from fembridge.store import write_text, write_toml
from fembridge.tables import Rate, write_rates
from fembridge.terminal import Bars
from fembridge.typing import FloatArray, Table
from fembridge.version import __version__
from neural.agreement import Agreement, agreement
from neural.counts import compiled
from neural.fit_problem import FitProblem, Target
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
    held_out_ips,
    search_front,
    total_rmse_ips,
)

PARAMETERS_FILE = "fitted.toml"
RATES_FILE = "fitted_rates.csv"
PICTURE_FILE = "tradeoffs.png"
HELD_OUT = "held_out"
_POPULATIONS = (4, 10_000)
_FAMILY_NAMES = {"sine": "sinusoids", "diharm": "diharmonics", "noise": "noises"}

# Called with the class and the progress of its search.
OnProgress: TypeAlias = Callable[[str, Progress], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class FitSettings:
    """Settings of a fit: stimuli, length of the search, and selection of the candidate.

    Parameters
    ----------
    families
        Families of stimuli that are fitted; the others are predicted. Default: sinusoids.
    preindent_um
        Depth of the probe before time 0, in um. Default: 0.
    cells
        Cells of a candidate. Default: the number of each model.
    evaluations
        Candidates evaluated per search. Default: 10 000.
    population
        Candidates per generation. Default: 200.
    seed
        Seed of the search. Default: 1.
    rule
        Rule of `neural.search.RULES` that selects a candidate. Default: smallest_error.
    held_out
        Predict each group of stimuli by a fit without that group. Default: False.
    """

    families: tuple[str, ...] = FAMILIES[:1]
    preindent_um: float = 0.0
    cells: int | None = None
    evaluations: int = EVALUATIONS
    population: int = POPULATION
    seed: int = 1
    rule: str = "smallest_error"
    held_out: bool = False

    def __post_init__(self) -> None:
        for name, least, most in (
            ("preindent_um", 0, None),
            ("cells", 1, MOST_CELLS),
            ("population", *_POPULATIONS),
            ("evaluations", self.population, None),
            ("seed", 0, None),
        ):
            value = getattr(self, name)
            if value is not None and not least <= value <= (most or sys.float_info.max):
                end = f"to {most}" if most else "or more"
                raise UsageError(f"{name} is {value}, expected {least} {end}")


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Fit of one class: problem, front, choice, parameters and rates.

    `rates` has a row for each observed stimulus, those of the fit (``seen``) first:
    ``stimulus, family, group, level_um, seen, observed_ips, predicted_ips``. Stimuli of the fit
    also have ``published_ips``, the rate with Table 2 and no pre-indentation as in the
    paper, and, where requested, ``held_out_ips``, the rate by a fit without their group;
    otherwise NaN. `seconds` is the duration of the search.
    """

    problem: FitProblem
    front: Front
    choice: Choice
    parameters: AfferentParameters
    rates: pd.DataFrame
    seconds: float

    @property
    def afferent(self) -> str:
        """Afferent class."""
        return self.problem.model.afferent

    @property
    def seen(self) -> pd.DataFrame:
        """Rates under the stimuli of the fit."""
        return self.rates[self.rates["seen"]]

    @property
    def held_out(self) -> bool:
        """Whether each group was also predicted by a fit without it."""
        return bool(self.seen["held_out_ips"].notna().all())

    def agreement(self, column: str = "predicted_ips") -> Agreement:
        """Agreement of a column of `rates` with the observed ones, over the stimuli of the fit."""
        return agreement(self.seen["observed_ips"], self.seen[column])

    def agreement_rows(self) -> list[Table]:
        """Agreement with observed rates by group and family, those of the fit first."""
        return agreement_rows(self.rates)


def agreement_rows(rates: pd.DataFrame) -> list[Table]:
    """Agreement by group, by family and over all families, for fitted and unseen stimuli."""
    parts: list[tuple[Any, Any, pd.DataFrame]] = []
    for _, judged in rates.groupby("seen", sort=False):
        families = judged.groupby("family", sort=False)
        for family, family_rates in families:
            groups = family_rates.groupby("group", sort=False)
            parts += [(family, name, part) for name, part in (*groups, (EVERY, family_rates))]
        if families.ngroups > 1:
            parts.append((EVERY, EVERY, judged))
    return [
        {
            "family": family,
            "group": group,
            "seen": bool(part["seen"].iloc[0]),
            **agreement(part["observed_ips"], part["predicted_ips"]).to_row(),
        }
        for family, group, part in parts
    ]


@dataclass(frozen=True, slots=True, eq=False)
class FitRun:
    """Fits of the `requested` classes, in that order.

    After an interrupt the last fit may be incomplete and later ones absent. `provenance` is
    the section ``fit`` of the parameter file: see `fit_table`.
    """

    fits: tuple[Fit, ...]
    requested: tuple[str, ...]
    settings: FitSettings
    provenance: Table = field(default_factory=dict)

    @property
    def finished(self) -> bool:
        """Whether every requested class has a complete search."""
        return len(self.fits) == len(self.requested) and all(
            fit.front.finished and (fit.held_out or not self.settings.held_out) for fit in self.fits
        )

    @property
    def front_files(self) -> list[str]:
        """Names of the files with the front of each class."""
        return [front_file(fit.afferent) for fit in self.fits]


def fit_afferents(
    observed: ObservedRates,
    response: ResponseMap,
    models: Mapping[str, Model],
    settings: FitSettings | None = None,
    *,
    targets_of: Callable[[Model], Sequence[Target]] = lambda model: (),
    on_progress: OnProgress | None = None,
    log: Callable[[str], None] = lambda line: None,
) -> FitRun:
    """Fits of the classes of `models` to their observed rates, one after the other.

    The same seed gives the same fits. Ctrl-C ends the search at its last complete
    generation and leaves later classes out.

    Parameters
    ----------
    observed
        Observed rates.
    response
        Response map with the stress of each class.
    models
        Model of each class to fit.
    settings
        Settings of the fit. Default: `FitSettings()`.
    targets_of
        Function from a model to its targets other than rates. Default: none.
    on_progress
        Called after each generation. Default: None.
    log
        Called with a line about each fit. Default: no log.

    Raises
    ------
    UsageError, ResponseError
        No class, or one without observed rates; a stimulus deeper than the response.
    KeyboardInterrupt
        Before the first generation of the first class was complete.
    """
    settings = settings or FitSettings()
    if not models:
        raise UsageError("no class to fit, expected some of SA, RA, PC")
    problem_of = partial(
        fit_problem,
        observed,
        response,
        preindent_um=settings.preindent_um,
        cells=settings.cells or 0,
    )
    problems = [
        problem_of(model, families=settings.families, targets=targets_of(model))
        for model in models.values()
    ]
    for problem in problems:
        if settings.held_out and len(problem.group_names) < 2:
            raise UsageError(
                f"{problem.model.afferent}: only rates of {problem.group_names[0]}, expected two "
                "or more groups; fit without --held-out"
            )
    unseen_families = tuple(name for name in FAMILIES if name not in settings.families)
    search = {
        "evaluations": settings.evaluations,
        "seed": settings.seed,
        "population": settings.population,
    }
    fits: list[Fit] = []
    try:
        for problem in problems:
            model, start_s = problem.model, time.perf_counter()
            progress = partial(on_progress, model.afferent) if on_progress else None
            front = search_front(problem, on_progress=progress, **search)
            choice = choose(problem, front, settings.rule)
            seconds = time.perf_counter() - start_s
            values = front.candidates[choice.row]
            published_model = model_named("published", model.afferent)
            published_problem = fit_problem(
                observed, response, published_model, families=settings.families
            )
            table_2 = [
                getattr(PUBLISHED[model.afferent], parameter.field)
                for parameter in published_problem.free
            ]
            rates = _rates(observed, problem, settings.families, values, seen=True).assign(
                published_ips=published_problem.rates_ips(np.array(table_2))[0],
                held_out_ips=math.nan,
            )
            if observed_entries(observed, model.afferent, unseen_families):
                unseen = _rates(
                    observed, problem_of(model, families=unseen_families), unseen_families, values
                )
                rates = pd.concat([rates, unseen], ignore_index=True)
            fit = Fit(problem, front, choice, problem.parameters(values), rates, seconds)
            fits.append(fit)
            log(
                f"{fit.afferent}, model {model.name}: {front.evaluations} evaluations in "
                f"{seconds:.1f} s{'' if front.finished else ', interrupted'}, front of "
                f"{len(front.candidates)}, chosen RMSE {fit.agreement().rmse_ips:.3g} ips"
            )
            if not front.finished:
                break
            if settings.held_out:
                held_out_rates_ips = held_out_ips(problem, settings.rule, on_progress, **search)
                rates.loc[rates["seen"], "held_out_ips"] = held_out_rates_ips
                log(
                    f"{fit.afferent}, held-out groups: RMSE "
                    f"{fit.agreement('held_out_ips').rmse_ips:.3g} ips"
                )
    except KeyboardInterrupt:
        if not fits:
            raise
    return FitRun(tuple(fits), tuple(models), settings)


def front_file(afferent: str) -> str:
    """Name of the file with the front of a class."""
    return f"pareto_{afferent}.csv"


def _rates(
    observed: ObservedRates,
    problem: FitProblem,
    families: tuple[str, ...],
    values: FloatArray,
    *,
    seen: bool = False,
) -> pd.DataFrame:
    """Observed and predicted rates of a candidate under the stimuli of `problem`."""
    entries = observed_entries(observed, problem.model.afferent, families)
    return pd.DataFrame(
        {
            "stimulus": [entry.id for entry in entries],
            "family": [entry.family for entry in entries],
            "group": problem.groups,
            "level_um": [entry.level_um for entry in entries],
            "seen": seen,
            "observed_ips": problem.observed_ips,
            "predicted_ips": problem.rates_ips(values)[0],
        }
    )


def write_fit(folder: Path, run: FitRun, name: str) -> None:
    """Write ``pareto_*.csv``, ``fitted.toml`` and ``fitted_rates.csv`` into `folder`.

    `name` is the name of the parameter set. A front has one row per candidate, the smallest
    total error first: its number from 1, whether it was chosen, its free parameters,
    the RMSE of each group and the RMSE over all stimuli.
    """
    for fit, file in zip(run.fits, run.front_files, strict=True):
        front = fit.front
        free = [parameter.field for parameter in front.free]
        groups = [f"rmse_{name.replace(' ', '_')}_ips" for name in front.groups]
        target_columns = [f"rms_{target.name}_error" for target in fit.problem.targets]
        errors = front.errors_ips2**0.5, front.target_errors**0.5
        table = pd.DataFrame(
            np.hstack([front.candidates, *errors]), columns=[*free, *groups, *target_columns]
        )
        table.insert(0, "afferent", fit.afferent)
        table.insert(1, "candidate", table.index + 1)
        table.insert(2, "chosen", np.where(table.index == fit.choice.row, "yes", "no"))
        table["rmse_all_ips"] = total_rmse_ips(fit.problem, front.errors_ips2)
        write_text(folder / file, table.to_csv(index=False, lineterminator="\n"))
    rates = [
        Rate(stimulus, fit.afferent, rate_ips)
        for fit in run.fits
        for stimulus, rate_ips in zip(
            fit.rates["stimulus"], fit.rates["predicted_ips"].tolist(), strict=True
        )
    ]
    write_rates(folder / RATES_FILE, rates)
    is_complete = len(run.fits) == len(PUBLISHED)
    record = {
        "name": name,
        **({} if is_complete else {"base": "published"}),
        "preindent_um": float(run.settings.preindent_um),
        **parameters_to_table({fit.afferent: fit.parameters for fit in run.fits}),
        "fit": run.provenance,
    }
    write_toml(folder / PARAMETERS_FILE, record)


def fit_table(
    run: FitRun, observed: ObservedRates, source: ResponseSource, options: Mapping[str, object]
) -> Table:
    """Section ``fit`` of a parameter file; `options` are those of the command."""
    settings = run.settings
    family_text = " and ".join(_FAMILY_NAMES[name] for name in settings.families)
    classes = [fit.afferent for fit in run.fits]
    state_text = "" if run.finished else ", interrupted"
    return {
        "source": f"fembridge fit: NSGA-II on observed rates of {', '.join(classes)}, "
        f"{family_text}{state_text}",
        "finished": run.finished,
        "seed": settings.seed,
        "evaluations": settings.evaluations,
        "population": settings.population,
        "rule": settings.rule,
        "families": list(settings.families),
        "afferents": classes,
        "left_out": list(run.requested[len(run.fits) :]),
        "versions": {
            "fembridge": __version__,
            "numpy": version("numpy"),
            "pymoo": version("pymoo"),
            **({"numba": version("numba")} if compiled() else {}),
        },
        "observed": {"file": observed.path.name, "sha256": observed.sha256},
        "response": source.to_table(),
        "options": {name: value for name, value in options.items() if value is not None},
        **{fit.afferent: _class_table(fit) for fit in run.fits},
    }


_AGREEMENT = ("family", "group", "seen", "count", "r_squared", "rmse_ips", "bias_ips")


def _class_table(fit: Fit) -> Table:
    model, free = fit.problem.model, fit.problem.free
    return {
        "drive": model.name,
        "equation": model.equation,
        "stress": model.quantity,
        "cells": fit.problem.cells,
        "finished": fit.front.finished,
        "evaluations": fit.front.evaluations,
        "front_size": len(fit.front.candidates),
        "candidate": fit.choice.row + 1,
        "rule": fit.choice.rule,
        "why": fit.choice.why,
        "free_parameters": len(free),
        **_targets_table(fit),
        "free": {
            parameter.field: {
                "low": parameter.low,
                "high": parameter.high,
                "unit": parameter.unit,
                "scale": "even" if parameter.even else "logarithmic",
            }
            for parameter in free
        },
        "observed_rates": {
            "fitted" if seen else "unseen": dict(Counter(rates["group"]))
            for seen, rates in fit.rates.groupby("seen", sort=False)
        },
        "agreement": [{key: row[key] for key in _AGREEMENT} for row in fit.agreement_rows()],
        **({HELD_OUT: _held_out_table(fit)} if fit.held_out else {}),
    }


def _held_out_table(fit: Fit) -> Table:
    """Predicted rates of held-out stimuli, rounded; no observed rate."""
    row = fit.agreement("held_out_ips").to_row()
    return {
        "r_squared": row["r_squared"],
        "rmse_ips": row["rmse_ips"],
        "rates_ips": fit.seen.set_index("stimulus")["held_out_ips"].round(3).to_dict(),
    }


def _targets_table(fit: Fit) -> Table:
    """RMS error of each target, and the parameters of targets alone."""
    targets, row = fit.problem.targets, fit.choice.row
    if not targets:
        return {}
    errors = np.sqrt(fit.front.target_errors[row]).tolist()
    target_fields = {parameter.field for target in targets for parameter in target.free}
    values = zip(fit.problem.free, fit.front.candidates[row].tolist(), strict=True)
    return {
        "targets": {target.name: error for target, error in zip(targets, errors, strict=True)},
        **{
            parameter.field: value
            for parameter, value in values
            if parameter.field in target_fields
        },
    }


class SearchBar(Bars):
    """Progress bar for the search of each class."""

    def __call__(self, afferent: str, progress: Progress) -> None:
        """Update the bar of `afferent`; remove it at the end of the search."""
        message = (
            f"{progress.evaluations}/{progress.total_evaluations} evaluations, front of "
            f"{progress.front_size}, best RMSE {progress.least_rmse_ips:.3g} ips"
        )
        self.show(afferent, progress.evaluations / progress.total_evaluations, message)
        if progress.evaluations >= progress.total_evaluations:
            self.remove(afferent)
