"""A model study: models fitted to the same rates, and judged on what they did not see.

A case is a model with a number of cells at a pre-indentation. Each is fitted to all
sinusoids, and then without each frequency in turn, which is predicted; both again
with other seeds. Written are a row a seed as CSV, and the summary as Markdown.
"""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from fembridge.errors import UsageError
from fembridge.executor import LocalExecutor
from fembridge.fitting.problem import fit_problem
from fembridge.observed import ObservedRates
from fembridge.response.response_map import ResponseMap
from fembridge.tables import write_table
from neural.agreement import Agreement, agreement
from neural.encoder import encode_cells
from neural.models import DEFAULT_MODELS, MODELS, model_named
from neural.parameter_sets import fitted_preindent_um
from neural.parameters import PUBLISHED
from neural.rates import mean_rate_ips
from neural.search import EVALUATIONS, Trial, cross_validate

SEEDS = (1, 2, 3)

# Pre-indentations at which the default models are compared.
_DEPTHS_UM = (0.0, 25.0, 50.0, 75.0, 100.0, 125.0, 150.0)
_MANY_CELLS = 5


@dataclass(frozen=True, slots=True)
class Case:
    """One model of one class, and how deep the probe is before time 0."""

    model: str
    afferent: str
    cells: int
    preindent_um: float

    @property
    def free_parameters(self) -> int:
        """How many parameters a fit searches."""
        return len(model_named(self.model, self.afferent).free(self.cells))


@dataclass(frozen=True, slots=True, eq=False)
class Finding:
    """What the seeds gave of one case."""

    case: Case
    trials: tuple[Trial, ...]

    def median(self, measure: Callable[[Trial], float]) -> float:
        """Median over seeds of a number of a trial."""
        return float(np.median([measure(trial) for trial in self.trials]))


@dataclass(frozen=True, slots=True, eq=False)
class ModelStudy:
    """Findings in the order of their cases; `unfitted` is Table 2 as printed."""

    findings: tuple[Finding, ...]
    unfitted: dict[str, Agreement]
    seeds: tuple[int, ...]
    evaluations: int

    def best(self, afferent: str) -> Finding:
        """The finding with the smallest held-out error of a class."""
        mine = [one for one in self.findings if one.case.afferent == afferent]
        return min(mine, key=lambda one: one.median(held_out_rmse_ips))


def fitted_rmse_ips(trial: Trial) -> float:
    """RMSE over the stimuli of the fit."""
    return trial.fitted.rmse_ips


def held_out_rmse_ips(trial: Trial) -> float:
    """RMSE over all stimuli, each predicted by a fit without its group."""
    return trial.held_out.rmse_ips


def default_cases(afferents: Sequence[str]) -> tuple[Case, ...]:
    """Cases of the whole study.

    Every model with its own cells, with and without pre-indentation; the default models
    over a range of pre-indentations, and with one cell; the published model with many.
    """
    cases = [
        Case(name, afferent, rows[afferent].cells, depth_um)
        for depth_um in (0.0, fitted_preindent_um())
        for name, rows in MODELS.items()
        for afferent in afferents
        if afferent in rows
    ]
    for afferent in afferents:
        name = DEFAULT_MODELS[afferent]
        cells = MODELS[name][afferent].cells
        cases += [Case(name, afferent, cells, depth_um) for depth_um in _DEPTHS_UM]
        cases.append(Case(name, afferent, 1, fitted_preindent_um()))
        cases += [
            Case("published", afferent, _MANY_CELLS, depth_um)
            for depth_um in (0.0, fitted_preindent_um())
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
    on_finding: Callable[[Finding], None] = lambda finding: None,
) -> ModelStudy:
    """Fit and cross-validate every case; `jobs` processes share them.

    Raises
    ------
    UsageError
        No case or no seed, a seed below 0, or `jobs` below 1.
    """
    if not cases or not seeds or min(seeds) < 0:
        raise UsageError(
            f"{len(cases)} cases and seeds {list(seeds)}, expected one of each or more"
        )
    if jobs < 1:
        raise UsageError(f"jobs is {jobs}, expected 1 or more")
    finding_of = partial(_finding, observed, response, tuple(seeds), evaluations)
    findings = []
    with ExitStack() as stack:
        each = map if jobs == 1 else stack.enter_context(LocalExecutor(jobs)).map
        for finding in each(finding_of, cases):
            findings.append(finding)
            on_finding(finding)
    classes = dict.fromkeys(case.afferent for case in cases)
    return ModelStudy(
        findings=tuple(findings),
        unfitted={name: _unfitted(observed, response, name) for name in classes},
        seeds=tuple(seeds),
        evaluations=evaluations,
    )


def _finding(
    observed: ObservedRates,
    response: ResponseMap,
    seeds: tuple[int, ...],
    evaluations: int,
    case: Case,
) -> Finding:
    problem = fit_problem(
        observed,
        response,
        model_named(case.model, case.afferent),
        preindent_um=case.preindent_um,
        cells=case.cells,
    )
    return Finding(
        case, tuple(cross_validate(problem, seed, evaluations=evaluations) for seed in seeds)
    )


def _unfitted(observed: ObservedRates, response: ResponseMap, afferent: str) -> Agreement:
    """Agreement of Table 2 as it is printed, without pre-indentation."""
    problem = fit_problem(observed, response, model_named("published", afferent))
    runs = encode_cells(problem.stress_pa, problem.dt_ms, PUBLISHED[afferent])
    rates = [
        mean_rate_ips(cells, window) for cells, window in zip(runs, problem.windows_ms, strict=True)
    ]
    return agreement(problem.observed_ips, np.array(rates))


CASES_FILE = "study.csv"
SUMMARY_FILE = "study.md"

_COLUMNS = (
    "afferent",
    "drive",
    "cells",
    "preindent_um",
    "free_parameters",
    "seed",
    "fitted_r_squared",
    "fitted_rmse_ips",
    "held_out_r_squared",
    "held_out_rmse_ips",
    "parameters",
)


def write_cases(path: Path, study: ModelStudy) -> None:
    """Write a row a case and seed; ``parameters`` as ``name=value`` with blanks."""
    rows = []
    for finding in study.findings:
        case = finding.case
        free = model_named(case.model, case.afferent).free(case.cells)
        for trial in finding.trials:
            rows.append(
                [
                    case.afferent,
                    case.model,
                    case.cells,
                    f"{case.preindent_um:g}",
                    len(free),
                    trial.seed,
                    f"{trial.fitted.regression.r_squared:.4f}",
                    f"{trial.fitted.rmse_ips:.3f}",
                    f"{trial.held_out.regression.r_squared:.4f}",
                    f"{trial.held_out.rmse_ips:.3f}",
                    " ".join(
                        f"{one.field}={getattr(trial.parameters, one.field):.6g}" for one in free
                    ),
                ]
            )
    write_table(path, _COLUMNS, rows)


def summary_text(study: ModelStudy) -> str:
    """A table a class, the smallest held-out error first; medians over seeds."""
    lines = []
    for afferent, unfitted in study.unfitted.items():
        lines += [
            f"### {afferent}",
            "",
            "| model | cells | pre-indented (µm) | free | R² fitted | RMSE fitted | "
            "R² held out | RMSE held out (range) |",
            "|---|---|---|---|---|---|---|---|",
        ]
        mine = [one for one in study.findings if one.case.afferent == afferent]
        for finding in sorted(mine, key=lambda one: one.median(held_out_rmse_ips)):
            case = finding.case
            errors = [held_out_rmse_ips(trial) for trial in finding.trials]
            r_squared = finding.median(lambda trial: trial.fitted.regression.r_squared)
            held_out = finding.median(lambda trial: trial.held_out.regression.r_squared)
            lines.append(
                f"| {case.model} | {case.cells} | {case.preindent_um:g} | "
                f"{case.free_parameters} | {r_squared:.3f} | "
                f"{finding.median(fitted_rmse_ips):.1f} | {held_out:.3f} | "
                f"{finding.median(held_out_rmse_ips):.1f} "
                f"({min(errors):.1f}–{max(errors):.1f}) |"
            )
        lines += [
            "| published, Table 2 as printed | 1 | 0 | 0 | "
            f"{unfitted.regression.r_squared:.3f} | {unfitted.rmse_ips:.1f} | | |",
            "",
        ]
    return "\n".join(lines)
