"""What a fit minimises: the rates of many candidates against observed ones.

The objectives are the paper's (section 3.2): for each group of stimuli, such as the
sinusoids of one frequency, the mean of the squared differences of rates. Beside them may
stand targets of another kind: threshold amplitudes, or the times of spikes.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from fembridge.typing import BoolArray, FloatArray, IntArray
from neural.counts import candidate_counts
from neural.encoder import encode_cells
from neural.filters import checked_stress
from neural.lif import Membrane, fire
from neural.models import Coefficients, Free, Model
from neural.parameters import AfferentParameters, quantiles
from neural.rates import window_rows
from neural.timing import van_rossum_distance, victor_purpura_distance


class Target(Protocol):
    """What is observed beside rates: an objective of its own, named `name`.

    `free` are parameters that only it has, such as a latency.
    """

    @property
    def name(self) -> str:
        """Name of the objective."""

    @property
    def free(self) -> tuple[Free, ...]:
        """Parameters that the search adds for it."""

    @property
    def tolerated(self) -> float:
        """Largest error that the rule ``tolerant`` lets pass."""

    def errors(self, problem: "FitProblem", values: FloatArray, single: bool) -> FloatArray:
        """Error of each candidate, ``(candidate,)``, 0 or more."""


@dataclass(frozen=True, slots=True, eq=False)
class FitProblem:
    """One class, one model, and the rates that were observed of it.

    Parameters
    ----------
    model
        Row of `neural.models`.
    stress_pa
        Stress at the afferent, ``(T, stimulus)`` in Pa; row 0 is at time 0.
    observed_ips
        Observed rates, ``(stimulus,)``.
    groups
        Name of the group of each stimulus: one objective a group.
    windows_ms
        Where the spikes of each stimulus are counted.
    dt_ms
        Time between two samples.
    cells
        Cells of a candidate; by default the model's own number.
    targets
        What else is observed: an objective each.
    """

    model: Model
    stress_pa: FloatArray
    observed_ips: FloatArray
    groups: tuple[str, ...]
    windows_ms: tuple[tuple[float, float], ...]
    dt_ms: float
    cells: int = 0
    targets: tuple[Target, ...] = ()
    _filtered: tuple[FloatArray, ...] = field(init=False, repr=False)
    _edges: tuple[IntArray, IntArray] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        stress = checked_stress(np.array(self.stress_pa, dtype=np.float64))
        observed = np.array(self.observed_ips, dtype=np.float64)
        rows = [window_rows(window, self.dt_ms) for window in self.windows_ms]
        edges = (np.array([each.start for each in rows]), np.array([each.stop for each in rows]))
        filtered = self.model.filtered(stress, self.dt_ms, "backward")
        for name, value in (
            ("cells", self.cells or self.model.cells),
            ("stress_pa", stress),
            ("observed_ips", observed),
            ("_filtered", tuple(each[:-1] for each in filtered)),
            ("_edges", edges),
        ):
            object.__setattr__(self, name, value)

    @property
    def free(self) -> tuple[Free, ...]:
        """Parameters that are searched, the columns of `values`."""
        own = self.model.free(self.cells)
        return (*own, *(one for target in self.targets for one in target.free))

    @property
    def group_names(self) -> tuple[str, ...]:
        """Names of the objectives, in order of first appearance."""
        return tuple(dict.fromkeys(self.groups))

    def rates_ips(self, values: FloatArray, single: bool = False) -> FloatArray:
        """Rates ``(candidate, stimulus)`` of parameters ``(candidate, free)``.

        `single` precision is for searching.
        """
        spikes = self.counts(values, single).sum(axis=1)
        spans_ms = np.array([end - start for start, end in self.windows_ms])
        rates: FloatArray = spikes * 1000.0 / (self.cells * spans_ms)
        return rates

    def counts(self, values: FloatArray, single: bool = False) -> IntArray:
        """Spikes of each cell in each window, ``(candidate, cell, stimulus)``."""
        values = np.atleast_2d(values)
        membrane, ways = self._membranes(values)
        counts = sum(
            candidate_counts(self._filtered, way, membrane, window=self._edges, single=single)
            for way in ways
        )
        return np.asarray(counts).reshape(len(values), self.cells, -1)

    def spikes(
        self, stress_pa: FloatArray, values: FloatArray
    ) -> tuple[FloatArray, IntArray, IntArray, IntArray]:
        """Spikes under other stress ``(T, stimulus)``: times in ms, candidate, cell, stimulus."""
        membrane, ways = self._membranes(values)
        filtered = self.model.filtered(stress_pa, self.dt_ms, "backward")
        columns = [each[:-1, np.newaxis] for each in filtered]
        current = np.stack([way.current(columns) for way in ways], axis=1)
        rows, membranes = fire(current, membrane)
        _, member, stimulus = np.unravel_index(membranes, current.shape[1:])
        times_ms = np.asarray((rows + 1.0) * self.dt_ms, dtype=np.float64)
        return times_ms, member // self.cells, member % self.cells, stimulus

    def _membranes(self, values: FloatArray) -> tuple[Membrane, tuple[Coefficients, ...]]:
        """Constants and coefficients of all membranes, ``(candidate and cell, 1)`` each."""
        named = {one.field: values[:, k] for k, one in enumerate(self.free)}
        spread = named.get("spread", np.zeros(len(values)))
        need = np.exp(np.multiply.outer(spread, quantiles(self.cells))).reshape(-1, 1)
        known: dict[str, ArrayLike] = {
            one.name: one.default
            for one in fields(self.model.parameters)
            if isinstance(one.default, int | float)
        }
        for name, column in named.items():
            known[name] = np.repeat(column, self.cells)[:, np.newaxis]
        ways = tuple(way.for_need(need) for way in self.model.ways(known))
        return self.model.membrane(known, self.dt_ms), ways

    def part(self, keep: BoolArray) -> "FitProblem":
        """The problem of some of the stimuli, a flag each, ``(stimulus,)``."""
        (rows,) = np.nonzero(keep)
        return replace(
            self,
            stress_pa=self.stress_pa[:, rows],
            observed_ips=self.observed_ips[rows],
            groups=tuple(self.groups[row] for row in rows),
            windows_ms=tuple(self.windows_ms[row] for row in rows),
        )

    def errors_ips2(self, values: FloatArray, single: bool = False) -> FloatArray:
        """Objectives ``(candidate, group)``: mean squared errors in impulses²/s²."""
        return self.group_errors(self.rates_ips(values, single))

    def target_errors(self, values: FloatArray, single: bool = False) -> FloatArray:
        """Objectives beside the rates, ``(candidate, target)``."""
        found = np.empty((len(values), len(self.targets)))
        for column, target in enumerate(self.targets):
            found[:, column] = target.errors(self, values, single)
        return found

    def group_errors(self, rates_ips: FloatArray) -> FloatArray:
        """As `errors_ips2`, of rates ``(candidate, stimulus)`` that are known."""
        squared = (rates_ips - self.observed_ips) ** 2
        names = np.array(self.groups)
        return np.stack([squared[:, names == name].mean(axis=1) for name in self.group_names], 1)

    def parameters(self, values: Sequence[float] | FloatArray) -> AfferentParameters:
        """Parameters of one candidate, ``(free,)``."""
        own = self.model.free(self.cells)
        found = {one.field: float(value) for one, value in zip(own, values, strict=False)}
        return self.model.parameters(
            **found, cells=self.cells, drive=self.model.name, dt_ms=self.dt_ms
        )


@dataclass(frozen=True, slots=True, eq=False)
class ThresholdTarget:
    """Observed threshold amplitudes of one class.

    `stress_pa` ``(T, threshold, amplitude)`` is the stress under vibrations of
    `amplitudes_um` ``(threshold, amplitude)``, rising, around each of `observed_um`
    ``(threshold,)``; `needed` spikes in its window reach it. A cell's threshold is the
    geometric mean of the last amplitude below it and the first that reaches it, the
    model's the geometric mean over cells. The error is the squared logarithm of model over
    observed of the threshold that is farthest off: on average a search would rather have
    many that are closer than none that is far away.
    """

    stress_pa: FloatArray
    amplitudes_um: FloatArray
    observed_um: FloatArray
    needed: IntArray
    windows_ms: tuple[tuple[float, float], ...]
    name: str = "thresholds"
    free: tuple[Free, ...] = ()
    tolerated: float = math.log(3.0) ** 2  # a factor: finer steps in time find more
    _asked: dict[tuple[str, int], FitProblem] = field(default_factory=dict, repr=False)

    def errors(self, problem: FitProblem, values: FloatArray, single: bool = False) -> FloatArray:
        """Largest squared logarithms ``(candidate,)``."""
        rows, count, levels = self.stress_pa.shape
        key = problem.model.name, problem.cells
        if key not in self._asked:
            self._asked[key] = FitProblem(
                model=problem.model,
                stress_pa=self.stress_pa.reshape(rows, -1),
                observed_ips=np.zeros(count * levels),
                groups=("",) * (count * levels),
                windows_ms=tuple(window for window in self.windows_ms for _ in range(levels)),
                dt_ms=problem.dt_ms,
                cells=problem.cells,
            )
        asked = self._asked[key]
        own = values[:, : len(asked.free)]
        spikes = asked.counts(own, single).reshape(len(values), problem.cells, count, levels)
        below = (np.cumsum(spikes >= self.needed[:, np.newaxis], axis=-1) == 0).sum(axis=-1)
        logs = np.log(self.amplitudes_um)
        step = logs[:, 1:2] - logs[:, :1]
        edges = np.hstack([logs[:, :1] - step / 2, (logs[:, 1:] + logs[:, :-1]) / 2])
        edges = np.hstack([edges, logs[:, -1:] + step / 2])
        found = edges[np.arange(count), below].mean(axis=1)
        errors: FloatArray = np.max((found - np.log(self.observed_um)) ** 2, axis=-1)
        return errors


# How far apart two trains are.
DISTANCES = ("van_rossum", "victor_purpura")

# Between a receptor of a fingertip and an electrode at the arm.
LATENCY = Free("latency_ms", 0.0, 20.0, "ms", even=True)


@dataclass(frozen=True, slots=True, eq=False)
class TimingTarget:
    """Observed spike times of one class.

    `trains_ms` has, for each column of `stress_pa` ``(T, stimulus)``, the trains that
    were recorded; each is compared with the cell that comes nearest, `latency_ms` later.
    The error is a distance over the recorded spikes: van Rossum's squared, 1/2 where no
    spike has a twin within `tau_ms`, or Victor's and Purpura's, 1 there, where moving a
    spike by `tau_ms` costs 1.
    """

    stress_pa: FloatArray
    trains_ms: tuple[tuple[FloatArray, ...], ...]
    tau_ms: float
    distance: str = DISTANCES[0]
    name: str = "spikes"
    free: tuple[Free, ...] = (LATENCY,)
    tolerated: float = math.inf

    def errors(self, problem: FitProblem, values: FloatArray, single: bool = False) -> FloatArray:
        """Distances a recorded spike, ``(candidate,)``."""
        column = [one.field for one in problem.free].index(LATENCY.field)
        spikes = sum(times.size for trains in self.trains_ms for times in trains)
        errors = np.empty(len(values))
        for row, candidate in enumerate(values):
            found = encode_cells(self.stress_pa, problem.dt_ms, problem.parameters(candidate))
            errors[row] = sum(
                min(self._apart(times, cell + candidate[column]) for cell in cells)
                for cells, trains in zip(found, self.trains_ms, strict=True)
                for times in trains
            )
        return errors / max(spikes, 1)

    def _apart(self, times_ms: FloatArray, others_ms: FloatArray) -> float:
        if self.distance == "victor_purpura":
            return victor_purpura_distance(times_ms, others_ms, 1.0 / self.tau_ms)
        return van_rossum_distance(times_ms, others_ms, self.tau_ms) ** 2


@dataclass(frozen=True, slots=True, eq=False)
class PhaseTarget:
    """Observed vector strengths of one class under vibrations.

    `stress_pa` is ``(T, stimulus)``, of `frequencies_hz`; `strengths` ``(stimulus, 2)``
    at the frequency and at twice that, over the spikes of all cells. The error is the
    mean squared difference; without spikes it is 1.
    """

    stress_pa: FloatArray
    frequencies_hz: FloatArray
    strengths: FloatArray
    name: str = "timing"
    free: tuple[Free, ...] = ()
    tolerated: float = 0.15**2  # then nearly all are within 0.25

    def errors(self, problem: FitProblem, values: FloatArray, single: bool = False) -> FloatArray:
        """Mean squared differences ``(candidate,)``."""
        times_ms, candidate, _, stimulus = problem.spikes(self.stress_pa, values)
        shape = len(values), self.frequencies_hz.size
        place = candidate * shape[1] + stimulus
        count = np.bincount(place, minlength=shape[0] * shape[1]).reshape(shape)
        squared = np.empty((*shape, 2))
        for order in (1, 2):
            turns = np.exp(2e-3j * np.pi * order * self.frequencies_hz[stimulus] * times_ms)
            sums = [
                np.bincount(place, part, minlength=count.size).reshape(shape)
                for part in (turns.real, turns.imag)
            ]
            strength = np.hypot(*sums) / np.maximum(count, 1)
            squared[..., order - 1] = (strength - self.strengths[:, order - 1]) ** 2
        squared[count == 0] = 1.0
        errors: FloatArray = squared.mean(axis=(1, 2))
        return errors
