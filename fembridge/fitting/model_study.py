"""Model study: models fitted to the same rates and compared on held-out frequencies.

A case is a model with a number of cells at a pre-indentation. Each case is fitted to all
sinusoids, and without each frequency in turn, which is then predicted; both with several
seeds. The results are a CSV file with one row per case and seed, and a Markdown summary.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from fembridge.errors import ResultError, UsageError
from fembridge.fitting.fit import FitSettings, Search
from fembridge.fitting.problem import checked_model, fit_problem
from fembridge.fitting.response_source import response_source
from fembridge.host.executor import executor_of, finished
from fembridge.host.progress import advance
from fembridge.host.store import check_output, filling, read_toml, write_text, write_toml
from fembridge.io.formatting import markdown
from fembridge.io.observed_rates import ObservedRates, read_observed
from fembridge.plots.shown import Shown
from fembridge.response.response_map import ResponseLike, ResponseMap
from fembridge.typing import Table
from fembridge.version import __version__
from neural.agreement import Agreement, Regression, agreement
from neural.encoder import encode_cells
from neural.models import DEFAULT_MODELS, MODELS, model_named
from neural.parameter_sets import DEFAULT_SET, parameter_set
from neural.parameters import PUBLISHED
from neural.rates import mean_rate_ips
from neural.search import EVALUATIONS, choose, held_out_ips, search_front

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from decks.finger import Finger
    from fembridge.plots.style import Panels
    from fembridge.touching.pad import Pad
    from fembridge.touching.pad_probe import PadProbe

_LOGGER = logging.getLogger(__name__)

PathLike: TypeAlias = str | Path

CASES_FILE = "study.csv"
SUMMARY_FILE = "study.md"
RECORD_FILE = "study.toml"
PICTURE_FILE = "study.png"
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


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ModelStudy(Shown):
    """Comparison of models, the result of `study`.

    After an interrupt it is not `finished`, and later cases are absent.

    Parameters
    ----------
    trials
        A row per case and seed: `CASE`, ``seed``, R² and RMSE in impulses/s over the stimuli
        of the fit (``fitted_*``) and of held-out predictions, each by a fit without the group
        of the stimulus (``held_out_*``), and ``parameters``.
    unfitted
        Agreement of Table 2 as printed, by class.
    finished
        Whether all cases are present. Default: True.
    provenance
        Version, observed rates, response and search. Default: empty.

    Examples
    --------
    >>> import fembridge as fb
    >>> rates = fb.simulate(["sine_20", "sine_50"], stored=True).rates.query("afferent == 'RA'")
    >>> study = fb.study(rates, drive="rising", seeds=[1], evaluations=200)
    >>> study.finished
    True
    """

    trials: pd.DataFrame
    unfitted: dict[str, Agreement]
    finished: bool = True
    provenance: Table = field(default_factory=dict)

    def _lines(self) -> list[str]:
        lines = [f"ModelStudy of {len(self.cases)} cases{'' if self.finished else ', interrupted'}"]
        for afferent in self.unfitted:
            best = self.ranked(afferent)[0]
            rmse_ips = best["held_out_rmse_ips"].median()
            lines.append(
                f"  {afferent}: best model {best['drive'].iloc[0]}, RMSE on held-out groups "
                f"{rmse_ips:.1f} impulses/s"
            )
        return lines

    @property
    def summary(self) -> str:
        """Medians over seeds as Markdown tables."""
        return summary_text(self)

    def plot(self, kind: str | None = None, ax: Panels | None = None) -> Figure:
        """Picture of fitted and held-out errors of every case, one panel per class.

        Parameters
        ----------
        kind
            ``errors``, the only kind. Default: ``errors``.
        ax
            Axes to draw into, one per class. Default: a new figure.

        Raises
        ------
        UsageError
            Another kind, or another number of axes.
        """
        from fembridge.plots.fit_result import study_figure

        if kind not in (None, "errors"):
            raise UsageError(argument="kind", found=kind, expected="errors")
        return study_figure(self, ax)

    def write(self, folder: PathLike) -> None:
        """Write cases (CSV), record (TOML), picture and summary (Markdown) into `folder`.

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

        with filling(Path(folder), last=SUMMARY_FILE) as draft:
            cases = self.trials.to_csv(index=False, lineterminator="\n")
            write_text(draft / CASES_FILE, cases)
            unfitted = {name: agreement.to_row() for name, agreement in self.unfitted.items()}
            record = {**self.provenance, "finished": self.finished, "unfitted": unfitted}
            write_toml(draft / RECORD_FILE, record)
            save_figure(self.plot(), draft / PICTURE_FILE)
            write_text(draft / SUMMARY_FILE, self.summary)

    @classmethod
    def read(cls, folder: PathLike) -> ModelStudy:
        """Study from the files of `write`.

        Parameters
        ----------
        folder
            Folder that `write` or ``fembridge study`` wrote.

        Raises
        ------
        ResultError
            A file is missing or is not one of `write`.
        """
        import pandas as pd

        path = Path(folder) / RECORD_FILE
        provenance = read_toml(path, ResultError.at(path))
        unfitted = {}
        try:
            for name, row in provenance.pop("unfitted").items():
                rmse_ips, bias_ips = row.pop("rmse_ips"), row.pop("bias_ips")
                unfitted[name] = Agreement(Regression(**row), rmse_ips, bias_ips)
            is_finished = provenance.pop("finished")
            trials = pd.read_csv(Path(folder) / CASES_FILE)
        except OSError as error:
            raise ResultError(f"cannot be read: {error.strerror}", Path(folder)) from error
        except (KeyError, TypeError, ValueError) as error:
            raise ResultError("was not written by `fembridge study`", path) from error
        return cls(trials, unfitted, is_finished, provenance)

    @property
    def cases(self) -> list[pd.DataFrame]:
        """Trials of each case."""
        return [part for _, part in self.trials.groupby(list(CASE), sort=False)]

    def ranked(self, afferent: str) -> list[pd.DataFrame]:
        """Trials of each case of a class, the smallest median held-out RMSE first.

        Parameters
        ----------
        afferent
            Name of the class, as ``"SA"``.
        """
        cases = [part for part in self.cases if part["afferent"].iloc[0] == afferent]
        return sorted(cases, key=lambda part: part["held_out_rmse_ips"].median())


def study(
    observed: PathLike | pd.DataFrame,
    *,
    drive: Sequence[str] | str | None = None,
    cells: int | None = None,
    preindent_um: Sequence[float] | float | None = None,
    seeds: Sequence[int] = SEEDS,
    evaluations: int = EVALUATIONS,
    jobs: int = 1,
    finger: str | Finger | None = None,
    response: ResponseLike | None = None,
    pad: str | Path | Pad | PadProbe | None = None,
    output: PathLike | None = None,
) -> ModelStudy:
    """Comparison of afferent models fitted to the same observed rates.

    Each model is fitted to the sinusoids of the table, and again without each frequency,
    which is then predicted; both with several seeds. Ctrl-C keeps the finished cases.

    Parameters
    ----------
    observed
        Observed rates in impulses/s: a DataFrame or the path of a table with the columns
        ``stimulus, afferent, rate_ips``.
    drive
        Names of models, for all classes that have them. Default: None, the complete study of
        all models with several pre-indentations and numbers of cells, most of an hour on
        one core.
    cells
        Cells of each model of `drive`, 1 to 1000. Default: None, the number of the model.
    preindent_um
        Depths of the probe before time 0, in um, for the models of `drive`. Default: None, 0.
    seeds
        Seeds of the search. Default: 1, 2 and 3.
    evaluations
        Candidates evaluated per search. Default: 10 000.
    jobs
        Number of processes. Default: 1.
    finger
        Preset finger whose stored response gives the stress, ``quick`` or ``paper``.
        Default: None, ``quick``.
    response
        Response map, or its file or folder, instead of `finger`, see `fit`. Default: None.
    pad
        Pad under whose default probe afferents are fitted, or a `PadProbe`, see `fit`. Default:
        None.
    output
        Folder for the result, see `ModelStudy.write`. Default: None, nothing is written.

    Returns
    -------
    ModelStudy
        ``trials`` has a row per case and seed, ``summary`` is Markdown.

    Raises
    ------
    UsageError
        An unknown model, `cells` or `preindent_um` without `drive`, or a number out of range.
    TableError
        A row of `observed` that is not a rate, with its line.

    Examples
    --------
    >>> import fembridge as fb
    >>> observed = fb.simulate(["sine_20", "sine_50"], stored=True).rates
    >>> rates = observed[observed["afferent"] == "RA"]
    >>> result = fb.study(rates, drive="rising", seeds=[1], evaluations=200)
    >>> result.trials["drive"].tolist()
    ['rising']
    """
    rates = read_observed(Path(observed) if isinstance(observed, str) else observed)
    cases = _cases_of(rates, drive, cells, preindent_um)
    Search(evaluations=evaluations)  # checks its range
    source = response_source(finger, response, (), pad)
    if output is not None:
        check_output(Path(output), CASES_FILE, RECORD_FILE, PICTURE_FILE, SUMMARY_FILE)
    number = count(1)

    def log_case(trials: pd.DataFrame) -> None:
        case, median = trials.iloc[0], trials.median(numeric_only=True)
        _LOGGER.info(
            f"fitted case {next(number)} of {len(cases)}: {case['afferent']} {case['drive']}, "
            f"{case['cells']} cells, pre-indentation {case['preindent_um']:g} um: RMSE "
            f"{median['fitted_rmse_ips']:.1f} impulses/s, held out "
            f"{median['held_out_rmse_ips']:.1f}"
        )

    result = study_models(
        rates,
        source.response,
        cases,
        seeds=seeds,
        evaluations=evaluations,
        jobs=jobs,
        on_case=log_case,
    )
    if not result.finished:
        _LOGGER.warning(f"interrupted: kept {len(result.cases)} of {len(cases)} cases")
    provenance = {
        "fembridge": __version__,
        "observed": {"file": rates.path.name, "sha256": rates.sha256},
        "response": source.to_table(),
        "seeds": list(seeds),
        "evaluations": evaluations,
    }
    result = replace(result, provenance=provenance)
    if output is not None:
        result.write(output)
    return result


def _cases_of(
    observed: ObservedRates,
    drive: Sequence[str] | str | None,
    cells: int | None,
    preindent_um: Sequence[float] | float | None,
) -> tuple[Case, ...]:
    """Cases of the models `drive`, or the default ones."""
    if not drive:
        for name, value in (("cells", cells), ("preindent_um", preindent_um)):
            if value is not None:
                raise UsageError("requires drive", argument=name)
        return default_cases(observed.afferents)
    drives = [drive] if isinstance(drive, str) else drive
    depths_um = np.atleast_1d(0.0 if preindent_um is None else preindent_um).tolist()
    for depth_um in depths_um:
        FitSettings(cells=cells, preindent_um=depth_um)  # checks both ranges
    return tuple(
        Case(
            name,
            afferent,
            MODELS[name][afferent].cells if cells is None else cells,
            float(depth_um),
        )
        for name in dict.fromkeys(map(checked_model, drives))
        for depth_um in dict.fromkeys(depths_um)
        for afferent in observed.afferents
        if afferent in MODELS[name]
    )


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
    import pandas as pd

    if not cases:
        raise UsageError(argument="cases", found=cases, expected="one or more")
    if not seeds or min(seeds) < 0:
        raise UsageError(
            argument="seeds", found=list(seeds), expected="one or more, each 0 or more"
        )
    if jobs < 1:
        raise UsageError(argument="jobs", found=jobs, expected="1 or more")
    cases = tuple(dict.fromkeys(cases))
    trials_of = partial(_trials_of, observed, response, tuple(seeds), evaluations)
    trials_by_case: dict[Case, pd.DataFrame] = {}
    try:
        with executor_of(jobs) as executor:
            submit = partial(executor.submit, trials_of)
            for case, trials in finished(submit, deque(cases), jobs):
                trials_by_case[case] = trials.result()
                on_case(trials_by_case[case])
                advance("fits", len(trials_by_case) / len(cases))
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
    import pandas as pd

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
    columns = problem.stress_pa.reshape(len(problem.stress_pa), -1)
    runs = encode_cells(columns, problem.dt_ms, PUBLISHED[afferent])
    windows_ms = [window for window in problem.windows_ms for _ in range(problem.positions)]
    rates = [mean_rate_ips(cells, window) for cells, window in zip(runs, windows_ms, strict=True)]
    by_position = np.array(rates).reshape(-1, problem.positions)
    return agreement(problem.observed_ips, by_position.mean(axis=1))


def summary_text(study: ModelStudy) -> str:
    """Markdown with a table per class, the smallest held-out error first; medians over seeds."""
    import pandas as pd

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
