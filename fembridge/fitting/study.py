"""Model study: models fitted to the same rates and compared on held-out frequencies.

A case is a model with a number of cells at a pre-indentation. Each case is fitted to all
sinusoids, and without each frequency in turn, which is then predicted; both with several
seeds. The results are a CSV file with one row per case and seed, and a Markdown summary.
"""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from fembridge.errors import UsageError
from fembridge.executor import executor_of, finished
from fembridge.fitting.problem import fit_problem
from fembridge.observed import ObservedRates
from fembridge.response.response_map import ResponseMap
from fembridge.store import write_text
from fembridge.words import markdown
from neural.agreement import Agreement, agreement
from neural.encoder import encode_cells
from neural.models import DEFAULT_MODELS, MODELS, model_named
from neural.parameter_sets import DEFAULT_SET, parameter_set
from neural.parameters import PUBLISHED
from neural.rates import mean_rate_ips
from neural.search import EVALUATIONS, choose, held_out_ips, search_front

CASES_FILE = "study.csv"
SUMMARY_FILE = "study.md"
SEEDS = (1, 2, 3)
CASE = ("afferent", "drive", "cells", "preindent_um", "free_parameters")
"""Columns of the trials that identify a case."""

# Pre-indentations at which the default models are compared.
_DEPTHS_UM = (0.0, 25.0, 50.0, 75.0, 100.0, 125.0, 150.0)
_MANY_CELLS = 5


@dataclass(frozen=True, slots=True)
class Case:
    """Model of one class, its number of cells, and the depth of the probe before time 0 in um."""

    model: str
    afferent: str
    cells: int
    preindent_um: float


@dataclass(frozen=True, slots=True, eq=False)
class ModelStudy:
    """Trials of all cases; `unfitted` is the agreement of Table 2 as printed, by class.

    After an interrupt it is not `finished`, and later cases are absent.

    `trials` has a row per case and seed: `CASE`, ``seed``, R² and RMSE over the stimuli of
    the fit (``fitted_*``) and of held-out predictions, each by a fit without the group of the
    stimulus (``held_out_*``), and ``parameters``.
    """

    trials: pd.DataFrame
    unfitted: dict[str, Agreement]
    finished: bool = True

    @property
    def cases(self) -> list[pd.DataFrame]:
        """Trials of each case."""
        return [part for _, part in self.trials.groupby(list(CASE), sort=False)]

    def ranked(self, afferent: str) -> list[pd.DataFrame]:
        """Trials of each case of a class, the smallest median held-out RMSE first."""
        cases = [part for part in self.cases if part["afferent"].iloc[0] == afferent]
        return sorted(cases, key=lambda part: part["held_out_rmse_ips"].median())


def default_cases(afferents: Sequence[str]) -> tuple[Case, ...]:
    """Cases of the model study for the classes `afferents`.

    Every model with its own number of cells, with and without pre-indentation; the default
    models at several pre-indentations and with one cell; the published model with five.
    """
    default_um = parameter_set(DEFAULT_SET).preindent_um
    cases = [
        Case(name, afferent, rows[afferent].cells, depth_um)
        for depth_um in (0.0, default_um)
        for name, rows in MODELS.items()
        for afferent in afferents
        if afferent in rows
    ]
    for afferent in afferents:
        name = DEFAULT_MODELS[afferent]
        cells = MODELS[name][afferent].cells
        cases += [Case(name, afferent, cells, depth_um) for depth_um in _DEPTHS_UM]
        cases.append(Case(name, afferent, 1, default_um))
        cases += [
            Case("published", afferent, _MANY_CELLS, preindent_um)
            for preindent_um in (0.0, default_um)
        ]
    return tuple(dict.fromkeys(cases))


def study_models(
    observed: ObservedRates,
    response: ResponseMap,
    cases: Sequence[Case],
    *,
    seeds: Sequence[int] = SEEDS,
    evaluations: int = EVALUATIONS,
    jobs: int = 1,
    on_case: Callable[[pd.DataFrame], None] = lambda trials: None,
) -> ModelStudy:
    """Trials of every case, fitted and cross-validated; duplicates are fitted once.

    Ctrl-C keeps the finished cases.

    Parameters
    ----------
    observed
        Observed rates.
    response
        Response map with the stress of each class.
    cases
        Cases of the study.
    seeds
        Seeds of the search. Default: 1, 2 and 3.
    evaluations
        Candidates evaluated per search. Default: 10 000.
    jobs
        Number of processes. Default: 1.
    on_case
        Called with the trials of each finished case. Default: nothing.

    Raises
    ------
    KeyboardInterrupt
        Before the first case was finished.
    """
    if not cases or not seeds or min(seeds) < 0 or jobs < 1:
        raise UsageError(
            f"{len(cases)} cases, seeds {list(seeds)} and {jobs} jobs, expected one or more of "
            "each, and no seed below 0"
        )
    cases = tuple(dict.fromkeys(cases))
    trials_of = partial(_trials_of, observed, response, tuple(seeds), evaluations)
    trials_by_case: dict[Case, pd.DataFrame] = {}
    try:
        with executor_of(jobs) as executor:
            submit = partial(executor.submit, trials_of)
            for case, trials in finished(submit, deque(cases), jobs):
                trials_by_case[case] = trials.result()
                on_case(trials_by_case[case])
    except KeyboardInterrupt:
        if not trials_by_case:
            raise
    table = pd.concat(
        [trials_by_case[case] for case in cases if case in trials_by_case], ignore_index=True
    )
    unfitted = {name: _unfitted(observed, response, name) for name in table["afferent"].unique()}
    return ModelStudy(table, unfitted, len(trials_by_case) == len(cases))


def _trials_of(
    observed: ObservedRates,
    response: ResponseMap,
    seeds: tuple[int, ...],
    evaluations: int,
    case: Case,
) -> pd.DataFrame:
    """Rows of one case, one per seed."""
    model = model_named(case.model, case.afferent)
    depth_um, cells = case.preindent_um, case.cells
    problem = fit_problem(observed, response, model, preindent_um=depth_um, cells=cells)
    free = [parameter.field for parameter in problem.free]
    rows = []
    for seed in seeds:
        front = search_front(problem, seed=seed, evaluations=evaluations)
        if not front.finished:
            raise KeyboardInterrupt
        values = front.candidates[choose(problem, front).row]
        held_out_rates_ips = held_out_ips(problem, seed=seed, evaluations=evaluations)
        fitted = agreement(problem.observed_ips, problem.rates_ips(values)[0])
        held_out = agreement(problem.observed_ips, held_out_rates_ips)
        rows.append(
            {
                "afferent": case.afferent,
                "drive": case.model,
                "cells": cells,
                "preindent_um": depth_um,
                "free_parameters": len(free),
                "seed": seed,
                "fitted_r_squared": fitted.regression.r_squared,
                "fitted_rmse_ips": fitted.rmse_ips,
                "held_out_r_squared": held_out.regression.r_squared,
                "held_out_rmse_ips": held_out.rmse_ips,
                "parameters": " ".join(
                    f"{name}={value:.6g}" for name, value in zip(free, values, strict=True)
                ),
            }
        )
    return pd.DataFrame(rows)


def _unfitted(observed: ObservedRates, response: ResponseMap, afferent: str) -> Agreement:
    """Agreement of Table 2 as printed, without pre-indentation."""
    problem = fit_problem(observed, response, model_named("published", afferent))
    runs = encode_cells(problem.stress_pa, problem.dt_ms, PUBLISHED[afferent])
    rates = [
        mean_rate_ips(cells, window) for cells, window in zip(runs, problem.windows_ms, strict=True)
    ]
    return agreement(problem.observed_ips, np.array(rates))


def write_cases(path: Path, study: ModelStudy) -> None:
    """Write a CSV file with one row per case and seed; ``parameters`` are ``name=value``."""
    table = study.trials.copy()
    for end, text in (("preindent_um", "{:g}"), ("r_squared", "{:.4f}"), ("rmse_ips", "{:.3f}")):
        for name in table.columns[table.columns.str.endswith(end)]:
            table[name] = table[name].map(text.format)
    write_text(path, table.to_csv(index=False, lineterminator="\n"))


def summary_text(study: ModelStudy) -> str:
    """Markdown with a table per class, the smallest held-out error first; medians over seeds."""
    errors = ("R² fitted", "RMSE fitted", "R² held out", "RMSE held out (range)")
    blocks = []
    for afferent, unfitted in study.unfitted.items():
        rows = []
        for trials in study.ranked(afferent):
            case, median = trials.iloc[0], trials.median(numeric_only=True)
            held_out_ips = trials["held_out_rmse_ips"]
            range_text = f"{held_out_ips.min():.1f}–{held_out_ips.max():.1f}"
            held_out_text = f"{held_out_ips.median():.1f} ({range_text})"
            rows.append(
                [
                    *(case["drive"], case["cells"], f"{case['preindent_um']:g}"),
                    case["free_parameters"],
                    f"{median['fitted_r_squared']:.3f}",
                    f"{median['fitted_rmse_ips']:.1f}",
                    f"{median['held_out_r_squared']:.3f}",
                    held_out_text,
                ]
            )
        published_cells = [
            f"{unfitted.regression.r_squared:.3f}",
            f"{unfitted.rmse_ips:.1f}",
            "",
            "",
        ]
        rows.append(["published, Table 2 as printed", 1, 0, 0, *published_cells])
        head = ["model", "cells", "pre-indented (µm)", "free", *errors]
        blocks.append(
            f"### {afferent}\n\n{markdown(pd.DataFrame(rows, columns=head).astype(str))}\n"
        )
    return "\n".join(blocks)
