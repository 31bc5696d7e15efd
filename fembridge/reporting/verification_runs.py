"""Solver runs and findings of the studies of the finite-element model.

Each run is solved once and its cost is stored in its folder; most runs are an indentation to
one depth in equal steps (`indent`). A run folder with matching checksums of deck and results is
not solved again, so a killed study resumes. Runs are sequential and use one thread: only then
does the processor time of a child process belong to one run.
"""

import hashlib
import math
import re
from collections.abc import Mapping
from dataclasses import astuple, dataclass, field, replace
from operator import add
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from pandas import DataFrame

from decks.contact_analysis import Model
from decks.dialects import JOB
from fembridge.errors import ResponseError
from fembridge.host.executor import send
from fembridge.host.store import filling, read_toml, write_text
from fembridge.host.system import children_s
from fembridge.io.run_folder import RUN_FILE, RunFolder
from fembridge.plots.style import (
    AFFERENT_COLOURS,
    FAINT,
    HAIR_PT,
    INK,
    MARKERS,
    PAGE_WIDTH_IN,
    SERIES_COLOURS,
    SMALL_TEXT_PT,
    new_figure,
)
from fembridge.response.deflection import richardson
from fembridge.response.indentation import read_pressed
from fembridge.results.von_mises import von_mises_pa
from fembridge.solver.build import build_run_folder
from fembridge.solver.ccx import LOG_FILE, finished_outcome, run_ccx
from fembridge.solver.settings import Solver
from fembridge.solver.verdict import Failure, Outcome
from fembridge.stimulus import Stimulus
from fembridge.typing import FloatArray, Table

COST_FILE = "cost.toml"
RUNS_FOLDER = "runs"
THREADS = 1

DEPTH_UM = 200.0
STEPS, STEPS_QUICK = 10, 4

_STEP_MS = 1000.0
# Line of CalculiX's log.
_SPRINGS = re.compile(r"Number of contact spring elements=(\d+)")
_DT_MS = 0.5
_UM_PER_MM = 1000.0

AT_MOST, AT_LEAST = "at most", "at least"
SAFETY = 1.25

_HEIGHT_IN, _PANEL_IN = 2.6, 3.4
_DOT_PT = 3.2
# Largest number of steps between labels of a logarithmic axis, so that labels do not overlap.
_MOST_STEPS = 4


@dataclass(frozen=True, slots=True)
class Cost:
    """Cost of a run; `cpu_s` is its processor time."""

    increments: int = 0
    iterations: int = 0
    cpu_s: float = 0.0

    def __add__(self, other: "Cost") -> "Cost":
        return Cost(*map(add, astuple(self), astuple(other)))


@dataclass(frozen=True, slots=True)
class RunAttempt:
    """A run with its cost; `failure` is the reason why it was not accepted, if any."""

    run: RunFolder
    cost: Cost
    failure: Failure | None = None

    def accepted(self) -> "RunAttempt":
        """The attempt itself; raises SolverError with folder and cause if it failed."""
        if self.failure is not None:
            raise Outcome(self.run.folder, self.failure).to_error()
        return self


@dataclass(slots=True)
class Runs:
    """Runs of one study under `folder`; `quick` requests fewer and shorter runs."""

    folder: Path
    quick: bool = False
    spent: Cost = Cost()

    def log(self, line: str) -> None:
        """Send a log line to the process that started the study."""
        send(line)

    def attempt(self, name: str, model: Model, stimulus: Stimulus) -> RunAttempt:
        """Run of `model` under `stimulus` in the folder `name`; a failure is not raised."""
        return self._solved(build_run_folder(self.folder / RUNS_FOLDER / name, model, stimulus))

    def solve_deck(
        self, name: str, deck: str, increments: int = 1, dt_ms: float = _STEP_MS
    ) -> Path:
        """Folder with the results of a deck of `increments` equal increments of `dt_ms`.

        Raises SolverError: the run is not accepted.
        """
        run = RunFolder(
            folder=self.folder / RUNS_FOLDER / name,
            solver="calculix",
            increments=increments,
            dt_ms=dt_ms,
            start_ms=0.0,
            afferents=(),
            deck_sha256=hashlib.sha256(deck.encode()).hexdigest(),
        )
        with filling(run.folder, last=RUN_FILE) as draft:
            write_text(draft / f"{JOB}.inp", deck)
            replace(run, folder=draft).write()
        return self._solved(run).accepted().run.folder

    def _solved(self, run: RunFolder) -> RunAttempt:
        """Result of a run; a complete result in its folder is reused."""
        outcome = finished_outcome(run)
        cpu_s = None if outcome is None else _stored_cpu_s(run)
        if outcome is None or cpu_s is None:
            before_s = children_s()
            settings = Solver(THREADS, on_progress=send, cache=False)
            outcome = run_ccx(run, settings)
            cpu_s = children_s() - before_s
            if outcome.accepted:
                text = f'deck_sha256 = "{run.deck_sha256}"\ncpu_s = {cpu_s:.3f}\n'
                write_text(run.folder / COST_FILE, text)
        cost = Cost(outcome.increments, outcome.iterations, cpu_s)
        self.spent += cost
        return RunAttempt(run, cost, outcome.failure)


@dataclass(frozen=True, slots=True, eq=False)
class Indented:
    """Von Mises stress `stress_pa` ``(T, afferent)`` at `depth_um` ``(T,)``.

    Afferents are in the order of the finger; `apex_um` ``(T,)`` is the displacement of the skin
    under the probe. The first row is the state at rest. `touching` is the number of skin nodes in
    contact with the probe at the end.
    """

    elements: int
    depth_um: FloatArray
    stress_pa: FloatArray
    force_n_per_mm: FloatArray
    apex_um: FloatArray
    touching: int
    cost: Cost

    @property
    def last_pa(self) -> FloatArray:
        """Stress ``(afferent,)`` at the end."""
        last: FloatArray = self.stress_pa[-1]
        return last


def depth_stimulus(depths_um: FloatArray, name: str) -> Stimulus:
    """Stimulus that moves the probe through `depths_um` ``(T,)``, starting at 0."""
    return Stimulus(name, depths_um, _DT_MS, (0.0, (depths_um.size - 1) * _DT_MS))


def indentation_stimulus(depth_um: float = DEPTH_UM, steps: int = STEPS) -> Stimulus:
    """Stimulus that moves the probe down to `depth_um` in equal steps."""
    return depth_stimulus(np.linspace(0.0, depth_um, steps + 1), f"down_{depth_um:g}")


def indent(
    runs: Runs, name: str, model: Model, stimulus: Stimulus | None = None, *, law: str = "linear"
) -> Indented:
    """Stress and force of one indentation.

    Raises SolverError: the run is not accepted.
    """
    stimulus = stimulus or indentation_stimulus(steps=STEPS_QUICK if runs.quick else STEPS)
    model = replace(model, support="prescribed", law=law)
    return read_indented(runs.attempt(name, model, stimulus).accepted(), model, stimulus)


def read_indented(attempt: RunAttempt, model: Model, stimulus: Stimulus) -> Indented:
    """Result of an accepted run; the first row is the state at rest."""
    run = attempt.run
    nodes = [afferent.node for afferent in run.afferents]
    pressed = read_pressed(run, stimulus, [*nodes, run.apex_node])
    touching = _SPRINGS.findall((run.folder / LOG_FILE).read_text("utf-8", "replace"))
    return Indented(
        elements=len(model.mesh.quad),
        depth_um=stimulus.displacement_um,
        stress_pa=von_mises_pa(pressed.tensor_pa[:, :-1]),
        force_n_per_mm=pressed.force_n_per_mm,
        apex_um=-_UM_PER_MM * pressed.moved_mm[:, -1, 1],
        touching=int(touching[-1]) if touching else 0,
        cost=attempt.cost,
    )


def _stored_cpu_s(run: RunFolder) -> float | None:
    """Stored processor time of this deck, None if there is none."""
    try:
        table = read_toml(run.folder / COST_FILE, ResponseError)
        return float(table["cpu_s"]) if table["deck_sha256"] == run.deck_sha256 else None
    except (ResponseError, KeyError, TypeError, ValueError):
        return None


class BoundCheck(NamedTuple):
    """A number in `unit`, and the bound that it must keep."""

    title: str
    value: float
    bound: float
    unit: str = ""
    side: str = AT_MOST

    @property
    def passed(self) -> bool:
        """Whether the bound is kept; False for NaN."""
        return self.value <= self.bound if self.side == AT_MOST else self.value >= self.bound

    def to_table(self) -> Table:
        """Fields under the keys of ``verification.json``, and `passed`."""
        return {
            "what": self.title,
            "found": self.value,
            "bound": self.bound,
            "unit": self.unit,
            "side": self.side,
            "passed": self.passed,
        }


@dataclass(frozen=True, slots=True, eq=False)
class Finding:
    """Result of one study.

    `tables` are by name, with all digits; NaN is an undefined number. `numbers` are used in the
    text of the page. `skipped` is the reason if the study could not run, for example a
    missing package.
    """

    checks: tuple[BoundCheck, ...] = ()
    tables: Mapping[str, DataFrame] = field(default_factory=dict)
    numbers: Mapping[str, Any] = field(default_factory=dict)
    figure: Figure | None = None
    skipped: str = ""
    cost: Cost = Cost()


def extrapolated(width: FloatArray, value: FloatArray) -> tuple[float, float, float]:
    """Limit, order and uncertainty of the last three of `value` ``(K,)``; widths decrease.

    The uncertainty of the finest value in percent is Roache's grid convergence index (J. Fluids
    Eng. 116:405, 1994), 1.25 times its estimated error. If the values do not converge from one
    side, limit and order are NaN and the uncertainty is their spread.
    """
    last = value[-3:]
    limit, order = richardson(width[-3:], last)
    error = last.max() - last.min() if math.isnan(limit) else SAFETY * abs(limit - last[-1])
    return limit, order, 100 * float(error / abs(last[-1]))


def largest_difference_percent(values: FloatArray, expected: FloatArray) -> float:
    """Largest difference in percent of the largest value."""
    return 100 * float(np.abs(values - expected).max() / np.abs(expected).max())


def panels(count: int) -> tuple[Figure, list[Axes]]:
    """Figure of `count` panels side by side."""
    width_in = min(PAGE_WIDTH_IN, _PANEL_IN * count + 0.6)
    figure, [row] = new_figure(_HEIGHT_IN, columns=count, width_in=width_in)
    return figure, list(row)


def line(row: int, *, name: str = "", mark: str = "both") -> dict[str, Any]:
    """Style of series `row` of a panel: "line", "dots", "both" or "dashed".

    Each afferent class has its colour.
    """
    colour = AFFERENT_COLOURS.get(name, SERIES_COLOURS[row % len(SERIES_COLOURS)])
    style: dict[str, Any] = {"color": colour, "markersize": _DOT_PT}
    if mark in ("dots", "both"):
        style["marker"] = MARKERS[row]
    if mark == "dots":
        style["linestyle"] = "none"
    return {**style, "dashes": (4, 2)} if mark == "dashed" else style


def exact(*, dashed: bool = False) -> dict[str, Any]:
    """Style of a closed form; dashed for a limit."""
    style: dict[str, Any] = {"color": FAINT if dashed else INK, "linewidth": 2 * HAIR_PT}
    return {**style, "dashes": (4, 2)} if dashed else style


def finish(panel: Axes, x: str, y: str, *, title: str = "", log: str = "") -> None:
    """Label axes and series; `log` lists the logarithmic axes: "", "x" or "xy"."""
    panel.set_xscale("log" if "x" in log else "linear")
    panel.set_yscale("log" if "y" in log else "linear")
    panel.set(xlabel=x, ylabel=y, title=title)
    if log:
        _label_samples(panel)
    panel.legend(fontsize=SMALL_TEXT_PT - 1, handlelength=1.8)


def _label_samples(panel: Axes) -> None:
    """Label a logarithmic x axis at the sample positions."""
    samples = np.unique(np.concatenate([curve.get_xdata() for curve in panel.lines])).tolist()
    labelled, step = samples[:1], (samples[-1] / samples[0]) ** (1 / _MOST_STEPS)
    for sample in samples[1:]:
        if sample >= 0.99 * step * labelled[-1]:
            labelled.append(sample)
    panel.set_xticks(labelled, [f"{sample:g}" for sample in labelled])
    panel.minorticks_off()
