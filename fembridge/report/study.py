"""What a study of the finite-element model works with: runs of the solver, and what it finds.

Each run is made once, its cost kept beside it; most press a probe into a finger to one
depth, in equal steps: `indent`. A run folder whose deck and results have the checksums on
record is not run again, so that a study that was killed resumes. Runs follow each other,
on one thread: only then is the processor time of a child process that of one run.
"""

import hashlib
import math
import re
import resource
from collections.abc import Mapping
from dataclasses import astuple, dataclass, field, replace
from operator import add
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from pandas import DataFrame

from decks.analysis import Model
from decks.dialects import JOB
from fembridge.build import build_run_folder
from fembridge.errors import ResponseError
from fembridge.executor import send
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
from fembridge.results.stress import von_mises_pa
from fembridge.run_folder import RUN_FILE, RunFolder
from fembridge.solver.ccx import LOG_FILE, finished_outcome, run_ccx
from fembridge.solver.settings import SolverSettings
from fembridge.solver.verdict import Failure, Outcome
from fembridge.stimulus import Stimulus
from fembridge.store import filling, read_toml, write_text
from fembridge.typing import FloatArray

COST_FILE = "cost.toml"
RUNS_FOLDER = "runs"
THREADS = 1

DEPTH_UM = 200.0
STEPS, STEPS_QUICK = 10, 4

_STEP_MS = 1000.0
# In CalculiX's log.
_SPRINGS = re.compile(r"Number of contact spring elements=(\d+)")
_DT_MS = 0.5
_UM_PER_MM = 1000.0

AT_MOST, AT_LEAST = "at most", "at least"
SAFETY = 1.25

_HEIGHT_IN, _PANEL_IN = 2.6, 3.4
_DOT_PT = 3.2
# Names on a logarithmic axis that do not run into each other, less one.
_MOST_STEPS = 4


@dataclass(frozen=True, slots=True)
class Cost:
    """What a run cost: `cpu_s` of processor time."""

    increments: int = 0
    iterations: int = 0
    cpu_s: float = 0.0

    def __add__(self, other: "Cost") -> "Cost":
        return Cost(*map(add, astuple(self), astuple(other)))


@dataclass(frozen=True, slots=True)
class Attempt:
    """One `run`: its cost, and why it is not accepted, if it is not."""

    run: RunFolder
    cost: Cost
    failure: Failure | None = None

    def accepted(self) -> "Attempt":
        """The run itself, or the `SolverError` that names folder and cause."""
        if self.failure is not None:
            raise Outcome(self.run.folder, self.failure).to_error()
        return self


@dataclass(slots=True)
class Runs:
    """The runs of one study under `folder`; `quick` asks for fewer and shorter ones."""

    folder: Path
    quick: bool = False
    spent: Cost = Cost()

    def log(self, line: str) -> None:
        """Send `line`, and of a run how far it is, to who began the study."""
        send(line)

    def attempt(self, name: str, model: Model, stimulus: Stimulus) -> Attempt:
        """Solve `model` under `stimulus` in the folder `name`; a failure is in the attempt."""
        return self._made(build_run_folder(self.folder / RUNS_FOLDER / name, model, stimulus))

    def solve_deck(
        self, name: str, deck: str, increments: int = 1, dt_ms: float = _STEP_MS
    ) -> Path:
        """Folder with the results of a deck's text, of `increments` equal increments of `dt_ms`.

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
        return self._made(run).accepted().run.folder

    def _made(self, run: RunFolder) -> Attempt:
        """Make a run, or take the one in its folder if that is whole."""
        outcome = finished_outcome(run)
        cpu_s = None if outcome is None else _kept_cpu_s(run)
        if outcome is None or cpu_s is None:
            before_s = _children_s()
            settings = SolverSettings(THREADS, on_progress=send, cache=False)
            outcome = run_ccx(run, settings)
            cpu_s = _children_s() - before_s
            if outcome.accepted:
                text = f'deck_sha256 = "{run.deck_sha256}"\ncpu_s = {cpu_s:.3f}\n'
                write_text(run.folder / COST_FILE, text)
        cost = Cost(outcome.increments, outcome.iterations, cpu_s)
        self.spent += cost
        return Attempt(run, cost, outcome.failure)


@dataclass(frozen=True, slots=True, eq=False)
class Indented:
    """Von Mises stress `stress_pa` ``(T, afferent)`` at `depth_um` ``(T,)``.

    Afferents are those of the finger, in its order; `apex_um` ``(T,)`` is how far the
    skin under the probe moved in. The state at rest comes first. `touching` nodes of
    the skin touch the probe at the end.
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


def through(depths_um: FloatArray, name: str) -> Stimulus:
    """Stimulus that moves the probe through `depths_um` ``(T,)``, the first of them 0."""
    return Stimulus(name, depths_um, _DT_MS, (0.0, (depths_um.size - 1) * _DT_MS))


def down(depth_um: float = DEPTH_UM, steps: int = STEPS) -> Stimulus:
    """Stimulus that moves the probe down to `depth_um` in equal steps."""
    return through(np.linspace(0.0, depth_um, steps + 1), f"down_{depth_um:g}")


def indent(
    runs: Runs, name: str, model: Model, stimulus: Stimulus | None = None, *, law: str = "linear"
) -> Indented:
    """Solve and read one indentation.

    Raises SolverError: the run is not accepted.
    """
    stimulus = stimulus or down(steps=STEPS_QUICK if runs.quick else STEPS)
    model = replace(model, support="prescribed", law=law)
    return read_indented(runs.attempt(name, model, stimulus).accepted(), model, stimulus)


def read_indented(attempt: Attempt, model: Model, stimulus: Stimulus) -> Indented:
    """Result of an accepted run, with the state at rest in front."""
    run = attempt.run
    nodes = [place.node for place in run.afferents]
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


def _children_s() -> float:
    """Processor time of all child processes that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _kept_cpu_s(run: RunFolder) -> float | None:
    """Processor time on record; None where there is none of this deck."""
    try:
        table = read_toml(run.folder / COST_FILE, ResponseError)
        return float(table["cpu_s"]) if table["deck_sha256"] == run.deck_sha256 else None
    except (ResponseError, KeyError, TypeError, ValueError):
        return None


class Check(NamedTuple):
    """A number that was found, in `unit`, and the bound that it has to keep."""

    what: str
    found: float
    bound: float
    unit: str = ""
    side: str = AT_MOST

    @property
    def passed(self) -> bool:
        """Whether the bound is kept; what could not be found keeps none."""
        return self.found <= self.bound if self.side == AT_MOST else self.found >= self.bound


@dataclass(frozen=True, slots=True, eq=False)
class Finding:
    """What one study found.

    `tables` are by name, with all digits; NaN is a number that could not be had.
    `numbers` are those that the words of the page hold. `skipped` says why there are
    none of these, where something that the study needs is not installed.
    """

    checks: tuple[Check, ...] = ()
    tables: Mapping[str, DataFrame] = field(default_factory=dict)
    numbers: Mapping[str, Any] = field(default_factory=dict)
    figure: Figure | None = None
    skipped: str = ""
    cost: Cost = Cost()


def extrapolated(width: FloatArray, value: FloatArray) -> tuple[float, float, float]:
    """Limit and order of the last three of `value` ``(K,)`` at falling element widths.

    Third what the finest is worth in percent: Roache's grid convergence index (J. Fluids Eng.
    116:405, 1994), 1.25 times its estimated error. Where the values do not close in from one
    side, limit and order are NaN and that is their spread.
    """
    last = value[-3:]
    limit, order = richardson(width[-3:], last)
    off = last.max() - last.min() if math.isnan(limit) else SAFETY * abs(limit - last[-1])
    return limit, order, 100 * float(off / abs(last[-1]))


def off_percent(found: FloatArray, expected: FloatArray) -> float:
    """Largest difference in percent of the largest value."""
    return 100 * float(np.abs(found - expected).max() / np.abs(expected).max())


def panels(count: int) -> tuple[Figure, list[Axes]]:
    """Figure of `count` panels side by side."""
    width_in = min(PAGE_WIDTH_IN, _PANEL_IN * count + 0.6)
    figure, [row] = new_figure(_HEIGHT_IN, columns=count, width_in=width_in)
    return figure, list(row)


def line(row: int, *, name: str = "", mark: str = "both") -> dict[str, Any]:
    """Style of series `row` of a panel: "line", "dots", "both" or "dashed".

    A class of afferents has its own colour.
    """
    colour = AFFERENT_COLOURS.get(name, SERIES_COLOURS[row % len(SERIES_COLOURS)])
    style: dict[str, Any] = {"color": colour, "markersize": _DOT_PT}
    if mark in ("dots", "both"):
        style["marker"] = MARKERS[row]
    if mark == "dots":
        style["linestyle"] = "none"
    return {**style, "dashes": (4, 2)} if mark == "dashed" else style


def exact(*, dashed: bool = False) -> dict[str, Any]:
    """Style of a closed form or, dashed, of a limit."""
    style: dict[str, Any] = {"color": FAINT if dashed else INK, "linewidth": 2 * HAIR_PT}
    return {**style, "dashes": (4, 2)} if dashed else style


def finish(panel: Axes, x: str, y: str, *, title: str = "", log: str = "") -> None:
    """Name axes and series; `log` names the logarithmic axes: "", "x" or "xy"."""
    panel.set_xscale("log" if "x" in log else "linear")
    panel.set_yscale("log" if "y" in log else "linear")
    panel.set(xlabel=x, ylabel=y, title=title)
    if log:
        _name_samples(panel)
    panel.legend(fontsize=SMALL_TEXT_PT - 1, handlelength=1.8)


def _name_samples(panel: Axes) -> None:
    """Name a logarithmic x axis where the samples are: there are few."""
    places = np.unique(np.concatenate([each.get_xdata() for each in panel.lines])).tolist()
    kept, step = places[:1], (places[-1] / places[0]) ** (1 / _MOST_STEPS)
    for place in places[1:]:
        if place >= 0.99 * step * kept[-1]:
            kept.append(place)
    panel.set_xticks(kept, [f"{place:g}" for place in kept])
    panel.minorticks_off()
