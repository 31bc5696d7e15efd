"""Objectives of a fit: errors of the rates of many candidates, and of other targets.

The objectives are the paper's (section 3.2): for each group of stimuli, such as the
sinusoids of one frequency, the mean squared difference of rates. Further objectives are
threshold amplitudes, spike times or vector strengths.
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
from neural.models import AfferentModel, Coefficients, Free
from neural.parameters import AfferentParameters, quantiles
from neural.rates import window_rows
from neural.timing import van_rossum_distance, victor_purpura_distance


class Target(Protocol):
    """Observation other than rates, fitted as a separate objective `name`.

    `free` are parameters of this objective alone, such as a latency.
    """

    @property
    def name(self) -> str:
        """Name of the objective."""

    @property
    def free(self) -> tuple[Free, ...]:
        """Parameters that the search adds for this objective."""

    @property
    def tolerated(self) -> float:
        """Largest error that the rule ``tolerant`` accepts."""

    def errors(self, problem: "FitProblem", values: FloatArray, single: bool) -> FloatArray:
        """Error >= 0 of each candidate, ``(candidate,)``."""


@dataclass(frozen=True, slots=True, eq=False)
class FitProblem:
    """Fit of one model of one class to observed rates.

    Parameters
    ----------
    model
        Row of `neural.models`.
    stress_pa
        Stress at the afferent, ``(T, stimulus)`` in Pa; row 0 is at time 0. With several
        positions of the probe, ``(T, stimulus, position)``: each has the cells of a candidate,
        and rates are means over them.
    observed_ips
        Observed rates, ``(stimulus,)``.
    groups
        Name of the group of each stimulus; each group is one objective.
    windows_ms
        Start and end of the counting window of each stimulus, in ms.
    dt_ms
        Time between two samples, in ms.
    cells
        Cells of a candidate. Default: the number of the model.
    targets
        Further objectives. Default: none.
    """

    model: AfferentModel
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
        stress = np.array(self.stress_pa, dtype=np.float64)
        columns = checked_stress(stress.reshape(len(stress), -1))
        observed = np.array(self.observed_ips, dtype=np.float64)
        spans = [
            window_rows(window, self.dt_ms)
            for window in self.windows_ms
            for _ in range(stress.shape[2] if stress.ndim > 2 else 1)
        ]
        edges = tuple(
            np.array(ends) for ends in ([s.start for s in spans], [s.stop for s in spans])
        )
        filtered = self.model.filtered(columns, self.dt_ms, "backward")
        for name, value in (
            ("cells", self.cells or self.model.cells),
            ("stress_pa", stress),
            ("observed_ips", observed),
            ("_filtered", tuple(drive[:-1] for drive in filtered)),
            ("_edges", edges),
        ):
            object.__setattr__(self, name, value)

    @property
    def free(self) -> tuple[Free, ...]:
        """Free parameters, the columns of `values`."""
        model_parameters = self.model.free(self.cells)
        return (
            *model_parameters,
            *(parameter for target in self.targets for parameter in target.free),
        )

    @property
    def positions(self) -> int:
        """Number of positions of the probe."""
        return self.stress_pa.shape[2] if self.stress_pa.ndim > 2 else 1

    @property
    def group_names(self) -> tuple[str, ...]:
        """Names of the objectives, in order of first appearance."""
        return tuple(dict.fromkeys(self.groups))

    def rates_ips(self, values: FloatArray, single: bool = False) -> FloatArray:
        """Rates ``(candidate, stimulus)`` in impulses/s of `values` ``(candidate, free)``.

        `single` precision is for the search.
        """
        spikes = self.counts(values, single).sum(axis=1)
        spans_ms = np.array([end - start for start, end in self.windows_ms])
        rates: FloatArray = spikes * 1000.0 / (self.cells * self.positions * spans_ms)
        return rates

    def counts(self, values: FloatArray, single: bool = False) -> IntArray:
        """Spikes of each cell at each position, ``(candidate, cell x position, stimulus)``."""
        values = np.atleast_2d(values)
        membrane, coefficients = self._membranes(values)
        counts = sum(
            candidate_counts(
                self._filtered, rises_or_falls, membrane, window=self._edges, single=single
            )
            for rises_or_falls in coefficients
        )
        by_position = np.asarray(counts).reshape(len(values), self.cells, -1, self.positions)
        return np.moveaxis(by_position, 3, 2).reshape(len(values), self.cells * self.positions, -1)

    def spikes(
        self, stress_pa: FloatArray, values: FloatArray
    ) -> tuple[FloatArray, IntArray, IntArray, IntArray]:
        """Spikes under stress ``(T, stimulus)`` in Pa: times in ms, candidate, cell, stimulus."""
        membrane, coefficients = self._membranes(values)
        filtered = self.model.filtered(stress_pa, self.dt_ms, "backward")
        columns = [drive[:-1, np.newaxis] for drive in filtered]
        current = np.stack(
            [rises_or_falls.current(columns) for rises_or_falls in coefficients], axis=1
        )
        rows, membranes = fire(current, membrane)
        _, member, stimulus = np.unravel_index(membranes, current.shape[1:])
        times_ms = np.asarray((rows + 1.0) * self.dt_ms, dtype=np.float64)
        return times_ms, member // self.cells, member % self.cells, stimulus

    def _membranes(self, values: FloatArray) -> tuple[Membrane, tuple[Coefficients, ...]]:
        """Constants and coefficients of all membranes, ``(candidate × cell, 1)`` each."""
        free_by_name = {parameter.field: values[:, k] for k, parameter in enumerate(self.free)}
        spread = free_by_name.get("spread", np.zeros(len(values)))
        stress_factor = np.exp(np.multiply.outer(spread, quantiles(self.cells))).reshape(-1, 1)
        values_by_name: dict[str, ArrayLike] = {
            parameter.name: parameter.default
            for parameter in fields(self.model.parameters)
            if isinstance(parameter.default, int | float)
        }
        for name, column in free_by_name.items():
            values_by_name[name] = np.repeat(column, self.cells)[:, np.newaxis]
        coefficients = tuple(
            rises_or_falls.scaled_for_cell(stress_factor)
            for rises_or_falls in self.model.membrane_coefficients(values_by_name)
        )
        return self.model.membrane(values_by_name, self.dt_ms), coefficients

    def part(self, keep: BoolArray) -> "FitProblem":
        """Problem of the stimuli with a true flag in `keep` ``(stimulus,)``."""
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
        """Objectives other than rates, ``(candidate, target)``."""
        errors = np.empty((len(values), len(self.targets)))
        for column, target in enumerate(self.targets):
            errors[:, column] = target.errors(self, values, single)
        return errors

    def group_errors(self, rates_ips: FloatArray) -> FloatArray:
        """`errors_ips2` from rates ``(candidate, stimulus)``."""
        squared = (rates_ips - self.observed_ips) ** 2
        names = np.array(self.groups)
        return np.stack([squared[:, names == name].mean(axis=1) for name in self.group_names], 1)

    def parameters(self, values: Sequence[float] | FloatArray) -> AfferentParameters:
        """Afferent parameters of one candidate, `values` ``(free,)``."""
        free_parameters = self.model.free(self.cells)
        numbers = {
            parameter.field: float(value)
            for parameter, value in zip(free_parameters, values, strict=False)
        }
        return self.model.parameters(
            **numbers, cells=self.cells, drive=self.model.name, dt_ms=self.dt_ms
        )


@dataclass(frozen=True, slots=True, eq=False)
class ThresholdTarget:
    """Observed threshold amplitudes of one class.

    `stress_pa` ``(T, threshold, amplitude)`` or ``(T, threshold, amplitude, position)`` is the
    stress under vibrations of `amplitudes_um` ``(threshold, amplitude)``, ascending, around each
    of `observed_um` ``(threshold,)``. An amplitude reaches the threshold with `needed` spikes in
    its window.
    The threshold of a cell is the geometric mean of the last amplitude below it and the
    first that reaches it; the model's is the geometric mean over cells and positions. The error
    is the largest squared logarithm of model over observed. With the mean error, a search would
    accept a few large errors for many smaller ones.
    """

    stress_pa: FloatArray
    amplitudes_um: FloatArray
    observed_um: FloatArray
    needed: IntArray
    windows_ms: tuple[tuple[float, float], ...]
    name: str = "thresholds"
    free: tuple[Free, ...] = ()
    tolerated: float = math.log(3.0) ** 2  # a factor of 3
    _rate_problems: dict[tuple[str, int], FitProblem] = field(default_factory=dict, repr=False)

    def errors(self, problem: FitProblem, values: FloatArray, single: bool = False) -> FloatArray:
        """Largest squared logarithm of each candidate, ``(candidate,)``."""
        rows, count, levels = self.stress_pa.shape[:3]
        key = problem.model.name, problem.cells
        if key not in self._rate_problems:
            self._rate_problems[key] = FitProblem(
                model=problem.model,
                stress_pa=self.stress_pa.reshape(rows, count * levels, -1),
                observed_ips=np.zeros(count * levels),
                groups=("",) * (count * levels),
                windows_ms=tuple(window for window in self.windows_ms for _ in range(levels)),
                dt_ms=problem.dt_ms,
                cells=problem.cells,
            )
        rate_problem = self._rate_problems[key]
        model_values = values[:, : len(rate_problem.free)]
        spikes = rate_problem.counts(model_values, single).reshape(len(values), -1, count, levels)
        below = (np.cumsum(spikes >= self.needed[:, np.newaxis], axis=-1) == 0).sum(axis=-1)
        logs = np.log(self.amplitudes_um)
        step = logs[:, 1:2] - logs[:, :1]
        edges = np.hstack([logs[:, :1] - step / 2, (logs[:, 1:] + logs[:, :-1]) / 2])
        edges = np.hstack([edges, logs[:, -1:] + step / 2])
        thresholds_log = edges[np.arange(count), below].mean(axis=1)
        errors: FloatArray = np.max((thresholds_log - np.log(self.observed_um)) ** 2, axis=-1)
        return errors


# Distances between two spike trains.
DISTANCES = ("van_rossum", "victor_purpura")

# Conduction time between a receptor of a fingertip and an electrode at the arm.
LATENCY = Free("latency_ms", 0.0, 20.0, "ms", even=True)


@dataclass(frozen=True, slots=True, eq=False)
class TimingTarget:
    """Observed spike times of one class.

    `trains_ms` has the recorded trains of each stimulus of `stress_pa` ``(T, stimulus)`` or
    ``(T, stimulus, position)``. Each train is compared with the nearest cell at any position,
    whose spikes are delayed by `latency_ms`. The error is the sum of distances per recorded
    spike: van Rossum's squared (1/2 where no spike has a match within `tau_ms`), or that of
    Victor and Purpura (1 there), with a cost of 1 to move a spike by `tau_ms`.
    """

    stress_pa: FloatArray
    trains_ms: tuple[tuple[FloatArray, ...], ...]
    tau_ms: float
    distance: str = DISTANCES[0]
    name: str = "spikes"
    free: tuple[Free, ...] = (LATENCY,)
    tolerated: float = math.inf

    def errors(self, problem: FitProblem, values: FloatArray, single: bool = False) -> FloatArray:
        """Distance per recorded spike, ``(candidate,)``."""
        column = [parameter.field for parameter in problem.free].index(LATENCY.field)
        recorded_spikes = sum(times.size for trains in self.trains_ms for times in trains)
        errors = np.empty(len(values))
        for row, candidate in enumerate(values):
            columns = self.stress_pa.reshape(len(self.stress_pa), -1)
            spikes_ms = encode_cells(columns, problem.dt_ms, problem.parameters(candidate))
            positions = columns.shape[1] // len(self.trains_ms)
            errors[row] = sum(
                min(
                    self._apart(times, cell + candidate[column])
                    for cells in spikes_ms[stimulus * positions : (stimulus + 1) * positions]
                    for cell in cells
                )
                for stimulus, trains in enumerate(self.trains_ms)
                for times in trains
            )
        return errors / max(recorded_spikes, 1)

    def _apart(self, times_ms: FloatArray, others_ms: FloatArray) -> float:
        if self.distance == "victor_purpura":
            return victor_purpura_distance(times_ms, others_ms, 1.0 / self.tau_ms)
        return van_rossum_distance(times_ms, others_ms, self.tau_ms) ** 2


@dataclass(frozen=True, slots=True, eq=False)
class PhaseTarget:
    """Observed vector strengths of one class under vibrations.

    `stress_pa` is ``(T, stimulus)`` or ``(T, stimulus, position)`` under vibrations of
    `frequencies_hz`; `strengths` ``(stimulus, 2)`` are at the frequency and its double, over the
    spikes of all cells at all positions.
    The error is the mean squared difference, 1 without spikes.
    """

    stress_pa: FloatArray
    frequencies_hz: FloatArray
    strengths: FloatArray
    name: str = "timing"
    free: tuple[Free, ...] = ()
    tolerated: float = 0.15**2  # then nearly all differences are within 0.25

    def errors(self, problem: FitProblem, values: FloatArray, single: bool = False) -> FloatArray:
        """Mean squared difference of each candidate, ``(candidate,)``."""
        columns = self.stress_pa.reshape(len(self.stress_pa), -1)
        times_ms, candidate, _, column = problem.spikes(columns, values)
        shape = len(values), self.frequencies_hz.size
        stimulus = column // (columns.shape[1] // shape[1])
        cell_index = candidate * shape[1] + stimulus
        count = np.bincount(cell_index, minlength=shape[0] * shape[1]).reshape(shape)
        squared = np.empty((*shape, 2))
        for order in (1, 2):
            turns = np.exp(2e-3j * np.pi * order * self.frequencies_hz[stimulus] * times_ms)
            sums = [
                np.bincount(cell_index, part, minlength=count.size).reshape(shape)
                for part in (turns.real, turns.imag)
            ]
            strength = np.hypot(*sums) / np.maximum(count, 1)
            squared[..., order - 1] = (strength - self.strengths[:, order - 1]) ** 2
        squared[count == 0] = 1.0
        errors: FloatArray = squared.mean(axis=(1, 2))
        return errors
