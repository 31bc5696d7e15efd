"""Fit of one or several afferent classes: `fit`, its arguments and its result.

``fitted.toml`` describes how its parameters were fitted, without rates, paths, host and
clock time, so that the same fit gives the same bytes.
"""

from __future__ import annotations

import logging
import math
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from fembridge.errors import ParameterError, ResultError, UsageError
from fembridge.evidence import THRESHOLDS, published_timing, read_evidence
from fembridge.fitting.problem import (
    ALL,
    fit_problem,
    models_to_fit,
    observed_entries,
    phase_target,
    threshold_target,
    timing_target,
)
from fembridge.fitting.response_source import ResponseSource, response_source
from fembridge.host.store import check_output, filling, read_toml, write_text, write_toml
from fembridge.host.terminal import Bars
from fembridge.io.observed_rates import FAMILIES, ObservedRates, read_observed
from fembridge.io.spike_table import Rate, read_spikes, write_rates
from fembridge.plots.shown import Shown
from fembridge.response.response_map import ResponseLike, ResponseMap
from fembridge.trace import AFFERENTS
from fembridge.typing import FloatArray, Table
from fembridge.version import __version__
from neural.agreement import Agreement, agreement
from neural.counts import compiled
from neural.fit_problem import DISTANCES, FitProblem, Target
from neural.models import AfferentModel, Free, model_named
from neural.parameter_sets import ParameterSet, parameter_set, parameters_to_table
from neural.parameters import MAX_CELLS, PUBLISHED, AfferentParameters
from neural.search import (
    EVALUATIONS,
    POPULATION,
    RULES,
    Choice,
    Front,
    SearchProgress,
    choose,
    held_out_ips,
    search_front,
)

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from decks.finger import Finger
    from fembridge.plots.style import Panels
    from fembridge.touching.pad import Pad
    from fembridge.touching.pad_probe import PadProbe

_LOGGER = logging.getLogger(__name__)

PathLike: TypeAlias = str | Path

PARAMETERS_FILE = "fitted.toml"
RATES_FILE = "fitted_rates.csv"
COMPARISON_FILE = "observed_and_fitted.csv"
PICTURE_FILE = "tradeoffs.png"
HELD_OUT = "held_out"
_POPULATIONS = (4, 10_000)
_FAMILY_NAMES = {"sine": "sinusoids", "diharm": "diharmonics", "noise": "noises"}

# Called with the class and the progress of its search.
OnProgress: TypeAlias = Callable[[str, SearchProgress], None]


def _check_range(
    name: str, value: float | None, minimum: float, maximum: float | None = None
) -> None:
    """Raise UsageError where the argument `name` is outside a range; None is accepted."""
    if value is not None and not minimum <= value <= (maximum or sys.float_info.max):
        end = f"to {maximum}" if maximum else "or more"
        raise UsageError(argument=name, found=value, expected=f"{minimum} {end}")


def _check_choice(name: str, value: str, choices: Sequence[str] | Mapping[str, object]) -> None:
    if value not in choices:
        raise UsageError(argument=name, found=value, expected=f"one of {', '.join(choices)}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Search:
    """Search of a fit by NSGA-II, and the rule that selects a candidate.

    Parameters
    ----------
    evaluations
        Candidates evaluated per search, at least `population`. Default: 10 000.
    population
        Candidates per generation, 4 to 10 000. Default: 200.
    seed
        Seed of the search; the same seed gives the same fit. Default: 1.
    rule
        Rule that selects a candidate of the Pareto front: ``smallest_error``, ``balanced``,
        ``tolerant`` or ``frequency_response``, see `neural.search.RULES`; or rules by class,
        ``"SA=tolerant,RA=balanced"``. Default: ``smallest_error``.

    Raises
    ------
    UsageError
        A number outside its range, or an unknown rule.

    Examples
    --------
    >>> import fembridge as fb
    >>> fb.Search(evaluations=400, seed=2).evaluations
    400
    """

    evaluations: int = EVALUATIONS
    population: int = POPULATION
    seed: int = 1
    rule: str = "smallest_error"

    def __post_init__(self) -> None:
        _check_range("population", self.population, *_POPULATIONS)
        _check_range("evaluations", self.evaluations, self.population)
        _check_range("seed", self.seed, 0)
        for rule in self._rules().values():
            _check_choice("rule", rule, RULES)

    def rule_of(self, afferent: str) -> str:
        """Rule of a class, by default ``smallest_error``.

        Parameters
        ----------
        afferent
            Name of the class.
        """
        rules = self._rules()
        return rules.get(afferent, rules.get("", Search().rule))

    def _rules(self) -> dict[str, str]:
        """Rules by class; that of all classes has the name ""."""
        if "=" not in self.rule:
            return {"": self.rule}
        rules = {}
        for text in self.rule.split(","):
            afferent, _, rule = map(str.strip, text.partition("="))
            if afferent not in AFFERENTS:
                expected = f"a rule, or CLASS=RULE of {', '.join(AFFERENTS)}"
                raise UsageError(argument="rule", found=self.rule, expected=expected)
            rules[afferent] = rule
        return rules


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FitTargets:
    """Observations other than rates that a fit also matches.

    Parameters
    ----------
    thresholds
        Threshold amplitudes: a DataFrame or the path of a table with the columns
        ``afferent, criterion, frequency_hz, amplitude_um``, or the name of a set of
        `fembridge.evidence`. Default: None, not fitted.
    timing
        Fit the published vector strengths at 20 Hz. Default: False.
    spikes
        Recorded spikes: a DataFrame or the path of a table ``stimulus, afferent, trial,
        spike_time_ms``. They add a latency to the free parameters. Default: None, not fitted.
    spike_distance
        Distance between recorded and predicted spikes, ``van_rossum`` or ``victor_purpura``,
        both with 5 ms. Default: ``van_rossum``.

    Raises
    ------
    UsageError
        Another distance.

    Examples
    --------
    >>> import fembridge as fb
    >>> targets = fb.FitTargets(thresholds="thresholds_freeman_johnson_1982", timing=True)
    >>> fb.fit("rates.csv", targets=targets)  # doctest: +SKIP
    """

    thresholds: PathLike | pd.DataFrame | None = None
    timing: bool = False
    spikes: PathLike | pd.DataFrame | None = None
    spike_distance: str = DISTANCES[0]

    def __post_init__(self) -> None:
        _check_choice("spike_distance", self.spike_distance, DISTANCES)


@dataclass(frozen=True, slots=True, kw_only=True)
class FitSettings:
    """Settings of a fit: stimuli, cells and search.

    Parameters
    ----------
    families
        Families of stimuli that are fitted; the others are predicted. Default: sinusoids.
    preindent_um
        Depth of the probe before time 0, in um. Default: 0.
    cells
        Cells of a candidate. Default: the number of each model.
    held_out
        Predict each group of stimuli by a fit without that group. Default: False.
    search
        Length and seed of the search, and the rule of selection. Default: `Search()`.
    """

    families: tuple[str, ...] = FAMILIES[:1]
    preindent_um: float = 0.0
    cells: int | None = None
    held_out: bool = False
    search: Search = Search()

    def __post_init__(self) -> None:
        _check_range("preindent_um", self.preindent_um, 0)
        _check_range("cells", self.cells, 1, MAX_CELLS)


@dataclass(frozen=True, slots=True, eq=False)
class ClassFit:
    """Fit of one class: model, Pareto front, selected candidate, parameters and rates.

    `rates` has a row for each observed stimulus, those of the fit (``seen``) first:
    ``stimulus, family, group, level_um, seen, observed_ips, predicted_ips``. Stimuli of the fit
    also have ``published_ips``, the rate with Table 2 and no pre-indentation as in the
    paper, and, where requested, ``held_out_ips``, the rate by a fit without their group;
    otherwise NaN. `targets` are the names of objectives other than rates; `seconds` is the
    duration of the search, NaN after reading.
    """

    model: AfferentModel
    cells: int
    front: Front
    choice: Choice
    parameters: AfferentParameters
    rates: pd.DataFrame
    targets: tuple[str, ...] = ()
    seconds: float = math.nan

    @property
    def afferent(self) -> str:
        """Afferent class."""
        return self.model.afferent

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

    def group_rmse_ips(self, column: str = "predicted_ips") -> FloatArray:
        """RMSE of a column of `rates` in each group of the front, ``(group,)``."""
        squared = (self.seen[column] - self.seen["observed_ips"]) ** 2
        means = squared.groupby(self.seen["group"], sort=False).mean()
        rmse: FloatArray = np.sqrt(means.loc[list(self.front.groups)].to_numpy(np.float64))
        return rmse


def agreement_rows(rates: pd.DataFrame) -> list[Table]:
    """Agreement by group, by family and over all families, for fitted and unseen stimuli."""
    parts: list[tuple[Any, Any, pd.DataFrame]] = []
    for _, judged in rates.groupby("seen", sort=False):
        families = judged.groupby("family", sort=False)
        for family, family_rates in families:
            groups = family_rates.groupby("group", sort=False)
            parts += [(family, name, part) for name, part in (*groups, (ALL, family_rates))]
        if families.ngroups > 1:
            parts.append((ALL, ALL, judged))
    return [
        {
            "family": family,
            "group": group,
            "seen": bool(part["seen"].iloc[0]),
            **agreement(part["observed_ips"], part["predicted_ips"]).to_row(),
        }
        for family, group, part in parts
    ]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Fit(Shown):
    """Result of `fit`: one `ClassFit` per class, in the order of `requested`.

    After an interrupt the last class may be incomplete and later ones absent: `finished` is
    False.

    Parameters
    ----------
    fits
        Fit of each class.
    requested
        Classes that were to be fitted.
    settings
        Settings of the fit.
    name
        Name of the parameter set. Default: ``fit``.
    provenance
        Section ``fit`` of the parameter file: versions, inputs with SHA-256, options and
        results of each class. Default: empty.

    Examples
    --------
    >>> import fembridge as fb
    >>> observed = fb.simulate("sine_20", stored=True).rates
    >>> search = fb.Search(evaluations=80, population=40)
    >>> fit = fb.fit(observed, afferents=["SA"], search=search)
    >>> predicted = fb.simulate("sine_50_100", parameters=fit.parameters, stored=True)
    >>> fit.finished, predicted.rates["afferent"].tolist()
    (True, ['SA', 'RA', 'PC'])
    """

    fits: Mapping[str, ClassFit]
    requested: tuple[str, ...]
    settings: FitSettings
    name: str = "fit"
    provenance: Table = field(default_factory=dict)

    @property
    def finished(self) -> bool:
        """Whether every requested class has a complete search."""
        return len(self.fits) == len(self.requested) and all(
            class_fit.front.finished and (class_fit.held_out or not self.settings.held_out)
            for class_fit in self.fits.values()
        )

    @property
    def parameters(self) -> ParameterSet:
        """Parameter set for `fembridge.simulate` and others; classes without a fit: Table 2."""
        return ParameterSet.from_table(self._record(), self.name, self.name)

    @property
    def rates(self) -> pd.DataFrame:
        """Observed and predicted rates of all classes.

        The columns are ``afferent`` and those of `ClassFit.rates`.
        """
        import pandas as pd

        frames = [
            class_fit.rates.assign(afferent=name).astype({"held_out_ips": float})
            for name, class_fit in self.fits.items()
        ]
        table = pd.concat(frames, ignore_index=True)
        return table[["afferent", *table.columns.drop("afferent")]]

    @property
    def front_files(self) -> list[str]:
        """Names of the files with the front of each class."""
        return [front_file(name) for name in self.fits]

    def _lines(self) -> list[str]:
        rows = [
            f"  {name}: model {class_fit.model.name}, {class_fit.cells} cells, "
            f"RMSE {class_fit.agreement().rmse_ips:.3g} impulses/s, "
            f"R² {class_fit.agreement().regression.r_squared:.3f}"
            for name, class_fit in self.fits.items()
        ]
        state = "" if self.finished else ", interrupted"
        return [f"Fit {self.name!r} of {', '.join(self.requested)}{state}", *rows]

    def plot(self, kind: str | None = None, ax: Panels | None = None) -> Figure:
        """Picture of the errors of all candidates, and of observed and fitted rates.

        Parameters
        ----------
        kind
            ``tradeoffs``, the only kind. Default: ``tradeoffs``.
        ax
            Axes to draw into: for each class one for the errors, one for the strongest
            trade-off, and one per group of stimuli. Default: a new figure.

        Raises
        ------
        UsageError
            Another kind, or another number of axes.
        """
        from fembridge.plots.fit_result import tradeoffs_figure

        if kind not in (None, "tradeoffs"):
            raise UsageError(argument="kind", found=kind, expected="tradeoffs")
        return tradeoffs_figure(self, ax)

    def write(self, folder: PathLike) -> None:
        """Write ``fitted.toml``, fronts, rates and the picture into `folder`.

        ``fitted.toml`` is a parameter set: ``fb.simulate(..., parameters="FOLDER/fitted.toml")``.

        Parameters
        ----------
        folder
            Folder of the files, which is made.

        Raises
        ------
        OutputError
            The folder cannot be written.
        """
        from fembridge.plots.style import save_figure

        with filling(Path(folder), last=PARAMETERS_FILE) as draft:
            _write_tables(draft, self)
            write_toml(draft / PARAMETERS_FILE, self._record())
            save_figure(self.plot(), draft / PICTURE_FILE)
        for name in set(map(front_file, AFFERENTS)) - set(self.front_files):
            (Path(folder) / name).unlink(missing_ok=True)  # from an earlier fit

    @classmethod
    def read(cls, folder: PathLike) -> Fit:
        """Fit from the files of `write`.

        Parameters
        ----------
        folder
            Folder that `write` or ``fembridge fit`` wrote.

        Raises
        ------
        ResultError, ParameterError, TableError
            A file is missing or was not written by a fit.
        """
        return _read_fit(Path(folder))

    def _record(self) -> Table:
        """Content of the parameter file."""
        is_complete = len(self.fits) == len(PUBLISHED)
        values = {name: class_fit.parameters for name, class_fit in self.fits.items()}
        return {
            "name": self.name,
            **({} if is_complete else {"base": "published"}),
            "preindent_um": float(self.settings.preindent_um),
            **parameters_to_table(values),
            "fit": self.provenance,
        }


def fit(
    observed: PathLike | pd.DataFrame,
    *,
    afferents: str | Sequence[str] | None = None,
    drive: str | None = None,
    cells: int | None = None,
    family: str = "sine",
    targets: FitTargets = FitTargets(),
    search: Search = Search(),
    preindent_um: float | None = None,
    held_out: bool = False,
    complete: bool = False,
    finger: str | Finger | None = None,
    response: ResponseLike | None = None,
    unit: str | Sequence[str] = (),
    pad: str | Path | Pad | PadProbe | None = None,
    name: str | None = None,
    output: PathLike | None = None,
    on_progress: OnProgress | None = None,
) -> Fit:
    """Parameters of each class whose rates come closest to observed rates.

    Ctrl-C keeps the best candidates found so far; the result is then not `finished`.

    Parameters
    ----------
    observed
        Observed rates in impulses/s: a DataFrame or the path of a table with the columns
        ``stimulus, afferent, rate_ips``.
    afferents
        Classes to fit. Default: None, all that have observed rates and a model.
    drive
        Name of the model whose parameters are searched; ``fembridge fit --drive list``
        describes all. Default: None, ``fading`` for SA, ``two_way`` for RA, ``corpuscle`` for
        PC.
    cells
        Cells of the population, 1 to 1000. Default: None, the number of the model.
    family
        Family of stimuli to fit: ``sine``, ``diharm``, ``noise`` or ``all``; the others are
        predicted. Default: ``sine``.
    targets
        Observations other than rates. Default: `FitTargets()`, none.
    search
        Length and seed of the search, and rule of selection. Default: `Search()`.
    preindent_um
        Depth of the probe before time 0, in um. Default: None, 0 for the model ``published`` and
        for a deck of yours, otherwise that of the parameter set ``fitted``, on a pad
        ``fitted_pad``.
    held_out
        Also predict each group of stimuli by a fit without that group. Default: False.
    complete
        Require a rate of each class for each stimulus. Default: False.
    finger
        Preset finger whose stored response gives the stress, ``quick`` or ``paper``.
        Default: None, ``quick``.
    response
        Response map or `DeckResponse`, or its file or folder as `fembridge.simulate` or
        `fembridge.map_response` writes it, instead of `finger`. Default: None.
    unit
        Units of classes that have several in `response`, as ``["SA=12", "RA=40"]``, one of a
        class. Default: (), of each class the one with the largest stress.
    pad
        Pad under whose default probe afferents are fitted, as in `touch`, or a `PadProbe`: another
        probe, position or skin. Instead of `finger`. Default: None.
    name
        Name of the parameter set. Default: None, ``fit``, with `drive` ``fit_DRIVE``.
    output
        Folder for the result, see `Fit.write`. Default: None, nothing is written.
    on_progress
        Called with the class and the progress of its search. Default: None.

    Returns
    -------
    Fit
        ``fits`` by class, ``rates`` and ``parameters`` of all classes.

    Raises
    ------
    TableError
        A row of a table that is not a rate, a spike or a threshold, with its line.
    UsageError, ResponseError
        An argument out of range; a class without rates; a finger without a stored response.

    Examples
    --------
    >>> import fembridge as fb
    >>> observed = fb.simulate("sine_20", stored=True).rates
    >>> search = fb.Search(evaluations=80, population=40)
    >>> result = fb.fit(observed, afferents=["SA"], search=search)
    >>> list(result.fits), result.parameters.preindent_um
    (['SA'], 75.0)
    """
    _check_choice("family", family, (*FAMILIES, ALL))
    source = response_source(finger, response, [unit] if isinstance(unit, str) else unit, pad)
    default_preindent_um = 0.0 if drive == "published" else source.preindent_um
    settings = FitSettings(
        families=FAMILIES if family == ALL else (family,),
        preindent_um=default_preindent_um if preindent_um is None else preindent_um,
        cells=cells,
        held_out=held_out,
        search=search,
    )
    rates = read_observed(
        Path(observed) if isinstance(observed, str) else observed, complete=complete
    )
    if isinstance(afferents, str):
        afferents = [afferents]
    models = models_to_fit(rates, afferents, drive, settings.families)
    if output is not None:
        files = (PARAMETERS_FILE, RATES_FILE, COMPARISON_FILE, PICTURE_FILE)
        check_output(Path(output), *files, *map(front_file, models))
    result = fit_afferents(
        rates,
        source.response,
        models,
        settings,
        targets_of=_targets_reader(targets, source.response, settings.preindent_um),
        on_progress=on_progress,
    )
    options = {
        "afferent": None if afferents is None else list(afferents),
        "drive": drive,
        "cells": cells,
        "family": family,
        "preindent_um": preindent_um,
        "finger": None if finger is None else getattr(finger, "name", finger),
        "thresholds": _table_name(targets.thresholds),
        "timing": targets.timing,
        "spikes": _table_name(targets.spikes),
        "spike_distance": None if targets.spikes is None else targets.spike_distance,
        "held_out": held_out or None,
        "own_response": response is not None,
        "allow_missing": not complete,
    }
    result = replace(
        result,
        name=name or (f"fit_{drive}" if drive else "fit"),
        provenance=fit_table(result, rates, source, options),
    )
    if output is not None:
        result.write(output)
    return result


def _targets_reader(
    targets: FitTargets, response: ResponseMap, preindent_um: float
) -> Callable[[AfferentModel], Sequence[Target]]:
    """Function from a model to its targets; the tables of `targets` are read once."""
    threshold_rows = (
        None if targets.thresholds is None else read_evidence(targets.thresholds, THRESHOLDS).table
    )
    spikes = targets.spikes
    trains = (
        None if spikes is None else read_spikes(Path(spikes) if isinstance(spikes, str) else spikes)
    )

    def targets_of(model: AfferentModel) -> list[Target]:
        model_arguments = (response, model, preindent_um)
        objectives: list[Target | None] = []
        if threshold_rows is not None:
            objectives.append(threshold_target(threshold_rows, *model_arguments))
        if targets.timing:
            objectives.append(phase_target(published_timing(), *model_arguments))
        if trains is not None:
            objectives.append(timing_target(trains, *model_arguments, targets.spike_distance))
        return [objective for objective in objectives if objective is not None]

    return targets_of


def _table_name(table: PathLike | pd.DataFrame | None) -> str | None:
    """Name of a table in the parameter file: that of its file, without folders."""
    if table is None:
        return None
    return Path(table).name if isinstance(table, str | Path) else "DataFrame"


def fit_afferents(
    observed: ObservedRates,
    response: ResponseMap,
    models: Mapping[str, AfferentModel],
    settings: FitSettings | None = None,
    *,
    targets_of: Callable[[AfferentModel], Sequence[Target]] = lambda model: (),
    on_progress: OnProgress | None = None,
) -> Fit:
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

    Raises
    ------
    UsageError, ResponseError
        No class, or one without observed rates; a stimulus deeper than the response.
    KeyboardInterrupt
        Before the first generation of the first class was complete.
    """
    import pandas as pd

    settings = settings or FitSettings()
    if not models:
        raise UsageError(argument="afferents", found=[], expected="SA, RA or PC")
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
                f"requires two or more groups of stimuli, {problem.model.afferent} has only "
                f"{problem.group_names[0]}",
                argument="held_out",
            )
    unseen_families = tuple(name for name in FAMILIES if name not in settings.families)
    search = {
        "evaluations": settings.search.evaluations,
        "seed": settings.search.seed,
        "population": settings.search.population,
    }
    fits: dict[str, ClassFit] = {}
    try:
        for problem in problems:
            model, start_s = problem.model, time.perf_counter()
            progress = partial(on_progress, model.afferent) if on_progress else None
            front = search_front(problem, on_progress=progress, **search)
            rule = settings.search.rule_of(model.afferent)
            choice = choose(problem, front, rule)
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
            class_fit = ClassFit(
                model,
                problem.cells,
                front,
                choice,
                problem.parameters(values),
                rates,
                tuple(target.name for target in problem.targets),
                seconds,
            )
            fits[model.afferent] = class_fit
            _LOGGER.info(
                f"fitted {model.afferent}, model {model.name}: RMSE "
                f"{class_fit.agreement().rmse_ips:.3g} impulses/s, front of "
                f"{len(front.candidates)} candidates, {front.evaluations} evaluations in "
                f"{seconds:.1f} s{'' if front.finished else ', interrupted'}"
            )
            if not front.finished:
                break
            if settings.held_out:
                held_out_rates_ips = held_out_ips(problem, rule, on_progress, **search)
                rates.loc[rates["seen"], "held_out_ips"] = held_out_rates_ips
                _LOGGER.info(
                    f"predicted held-out groups of {model.afferent}: RMSE "
                    f"{class_fit.agreement('held_out_ips').rmse_ips:.3g} impulses/s"
                )
    except KeyboardInterrupt:
        if not fits:
            raise
    return Fit(fits, tuple(models), settings)


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
    import pandas as pd

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


def _write_tables(folder: Path, result: Fit) -> None:
    """Write fronts and rates of each class.

    A front has one row per candidate, the smallest total error first: its number from 1,
    whether it was chosen, its free parameters, the RMSE of each group and the RMSE over all
    stimuli.
    """
    import pandas as pd

    for name, class_fit in result.fits.items():
        front = class_fit.front
        errors = front.errors_ips2**0.5, front.target_errors**0.5
        columns = [*_free_columns(front), *_group_columns(front), *_target_columns(class_fit)]
        table = pd.DataFrame(np.hstack([front.candidates, *errors]), columns=columns)
        table.insert(0, "afferent", name)
        table.insert(1, "candidate", table.index + 1)
        table.insert(2, "chosen", np.where(table.index == class_fit.choice.row, "yes", "no"))
        table["rmse_all_ips"] = _total_rmse_ips(class_fit)
        write_text(folder / front_file(name), table.to_csv(index=False, lineterminator="\n"))
    rates = result.rates
    rows = zip(rates["stimulus"], rates["afferent"], rates["predicted_ips"].tolist(), strict=True)
    write_rates(folder / RATES_FILE, [Rate(*row) for row in rows])
    comparison = rates.assign(seen=np.where(rates["seen"], "yes", "no"))
    text = comparison.to_csv(index=False, lineterminator="\n")
    write_text(folder / COMPARISON_FILE, text)


def _free_columns(front: Front) -> list[str]:
    return [parameter.field for parameter in front.free]


def _group_columns(front: Front) -> list[str]:
    return [f"rmse_{name.replace(' ', '_')}_ips" for name in front.groups]


def _target_columns(class_fit: ClassFit) -> list[str]:
    return [f"rms_{name}_error" for name in class_fit.targets]


def _total_rmse_ips(class_fit: ClassFit) -> FloatArray:
    """RMSE of each candidate over all stimuli of the fit."""
    sizes = class_fit.seen["group"].value_counts()
    counts = sizes.loc[list(class_fit.front.groups)].to_numpy()
    rmse: FloatArray = np.sqrt(class_fit.front.errors_ips2 @ counts / counts.sum())
    return rmse


def _read_fit(folder: Path) -> Fit:
    path = folder / PARAMETERS_FILE
    table = read_toml(path, ParameterError.at(path))
    try:
        provenance = table["fit"]
        settings = FitSettings(
            families=tuple(provenance["families"]),
            preindent_um=table["preindent_um"],
            cells=provenance["options"].get("cells"),
            held_out=provenance["options"].get("held_out", False),
            search=Search(**{key: provenance[key] for key in _SEARCH_KEYS}),
        )
        parameters = parameter_set(path).parameters
        comparison = _read_columns(folder / COMPARISON_FILE)
        comparison["seen"] = comparison["seen"] == "yes"
        fits = {
            name: _read_class(
                folder / front_file(name),
                provenance[name],
                parameters[name],
                comparison[comparison["afferent"] == name].drop(columns="afferent"),
                settings.search.seed,
            )
            for name in provenance["afferents"]
        }
    except OSError as error:
        missing = Path(error.filename or folder)
        raise ResultError(f"cannot be read: {error.strerror}", missing) from error
    except (KeyError, TypeError, ValueError) as error:
        raise ResultError(f"was not written by `fembridge fit`: {error!r}", path) from error
    requested = (*fits, *provenance["left_out"])
    return Fit(fits, requested, settings, table["name"], provenance)


_SEARCH_KEYS = ("evaluations", "population", "seed", "rule")


def _read_columns(path: Path) -> pd.DataFrame:
    """Columns of a file of `_write_tables`, numbers to the last digit."""
    import pandas as pd

    table = pd.read_csv(path, dtype=str, keep_default_na=False)
    for name in table.columns.difference(list(_TEXT_COLUMNS)):
        table[name] = [float(text or "nan") for text in table[name]]
    return table


_TEXT_COLUMNS = ("afferent", "stimulus", "family", "group", "seen", "chosen")


def _read_class(
    path: Path,
    record: Table,
    parameters: AfferentParameters,
    rates: pd.DataFrame,
    seed: int,
) -> ClassFit:
    """Fit of a class from its front file and its section of the parameter file."""
    rates = rates.reset_index(drop=True)
    candidates = _read_columns(path)
    targets = tuple(record.get("targets", ()))
    free = tuple(
        Free(name, row["low"], row["high"], row["unit"], even=row["scale"] == "even")
        for name, row in record["free"].items()
    )
    groups = tuple(dict.fromkeys(rates.loc[rates["seen"], "group"]))
    front = Front(
        free=free,
        groups=groups,
        candidates=candidates[[parameter.field for parameter in free]].to_numpy(np.float64),
        errors_ips2=np.empty((0, 0)),
        evaluations=record["evaluations"],
        seed=seed,
        finished=record["finished"],
    )
    errors_ips = candidates[_group_columns(front)].to_numpy(np.float64)
    target_errors = candidates[[f"rms_{name}_error" for name in targets]].to_numpy(np.float64)
    front = replace(front, errors_ips2=errors_ips**2, target_errors=target_errors**2)
    return ClassFit(
        model_named(record["drive"], parameters.afferent),
        record["cells"],
        front,
        Choice(record["candidate"] - 1, record["why"], record["rule"]),
        parameters,
        rates,
        targets,
    )


def fit_table(
    result: Fit, observed: ObservedRates, source: ResponseSource, options: Mapping[str, object]
) -> Table:
    """Section ``fit`` of a parameter file; `options` are those of the command."""
    settings = result.settings
    family_text = " and ".join(_FAMILY_NAMES[name] for name in settings.families)
    classes = list(result.fits)
    state_text = "" if result.finished else ", interrupted"
    return {
        "source": f"fembridge fit: NSGA-II on observed rates of {', '.join(classes)}, "
        f"{family_text}{state_text}",
        "finished": result.finished,
        "seed": settings.search.seed,
        "evaluations": settings.search.evaluations,
        "population": settings.search.population,
        "rule": settings.search.rule,
        "families": list(settings.families),
        "afferents": classes,
        "left_out": list(result.requested[len(result.fits) :]),
        "versions": {
            "fembridge": __version__,
            "numpy": version("numpy"),
            "pymoo": version("pymoo"),
            **({"numba": version("numba")} if compiled() else {}),
        },
        "observed": {"file": observed.path.name, "sha256": observed.sha256},
        "response": source.to_table(),
        "options": {name: value for name, value in options.items() if value is not None},
        **{name: _class_table(class_fit) for name, class_fit in result.fits.items()},
    }


_AGREEMENT = ("family", "group", "seen", "count", "r_squared", "rmse_ips", "bias_ips")


def _class_table(class_fit: ClassFit) -> Table:
    model, front = class_fit.model, class_fit.front
    return {
        "drive": model.name,
        "equation": model.equation,
        "stress": model.quantity,
        "cells": class_fit.cells,
        "finished": class_fit.front.finished,
        "evaluations": class_fit.front.evaluations,
        "front_size": len(class_fit.front.candidates),
        "candidate": class_fit.choice.row + 1,
        "rule": class_fit.choice.rule,
        "why": class_fit.choice.why,
        "free_parameters": len(front.free),
        **_targets_table(class_fit),
        "free": {
            parameter.field: {
                "low": parameter.low,
                "high": parameter.high,
                "unit": parameter.unit,
                "scale": "even" if parameter.even else "logarithmic",
            }
            for parameter in front.free
        },
        "observed_rates": {
            "fitted" if seen else "unseen": dict(Counter(rates["group"]))
            for seen, rates in class_fit.rates.groupby("seen", sort=False)
        },
        "agreement": [{key: row[key] for key in _AGREEMENT} for row in class_fit.agreement_rows()],
        **({HELD_OUT: _held_out_table(class_fit)} if class_fit.held_out else {}),
    }


def _held_out_table(class_fit: ClassFit) -> Table:
    """Predicted rates of held-out stimuli, rounded; no observed rate."""
    row = class_fit.agreement("held_out_ips").to_row()
    return {
        "r_squared": row["r_squared"],
        "rmse_ips": row["rmse_ips"],
        "rates_ips": class_fit.seen.set_index("stimulus")["held_out_ips"].round(3).to_dict(),
    }


def _targets_table(class_fit: ClassFit) -> Table:
    """RMS error of each target, and the parameters of targets alone."""
    front, row = class_fit.front, class_fit.choice.row
    if not class_fit.targets:
        return {}
    errors = np.sqrt(front.target_errors[row]).tolist()
    model_fields = {parameter.field for parameter in class_fit.model.free(class_fit.cells)}
    values = zip(front.free, front.candidates[row].tolist(), strict=True)
    return {
        "targets": dict(zip(class_fit.targets, errors, strict=True)),
        **{
            parameter.field: value
            for parameter, value in values
            if parameter.field not in model_fields
        },
    }


class SearchBar(Bars):
    """Progress bar for the search of each class."""

    def __call__(self, afferent: str, progress: SearchProgress) -> None:
        """Update the bar of `afferent`; remove it at the end of the search."""
        message = (
            f"{progress.evaluations}/{progress.total_evaluations} evaluations, front of "
            f"{progress.front_size}, best RMSE {progress.least_rmse_ips:.3g} ips"
        )
        self.show(afferent, progress.evaluations / progress.total_evaluations, message)
        if progress.evaluations >= progress.total_evaluations:
            self.remove(afferent)
