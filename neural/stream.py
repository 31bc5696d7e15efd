"""Spikes sample by sample: `encode` for a sensor that is still measuring.

A stream runs the loop of `neural.encoder` while the samples arrive, with the same filters and the
same membranes. So its spikes are those of `encode_cells` on all samples, to the last bit, whatever
the sizes of the parts. Its state is the last samples, the states of the recursive filters and the
membranes; it needs NumPy alone.

A spike is reported when no later sample can change it. Models whose filters look back only, as
those of ``fitted``, report it at the sample at which it is; `Stream.look_ahead_ms` has the delay of
each class. A sensor that is slower than the time step of the parameters is interpolated, which
delays by up to three of its samples.
"""

import math
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from fembridge.errors import TraceError, UsageError
from fembridge.typing import FloatArray
from neural import filters
from neural.filters import M1, M2, Past
from neural.lif import Membrane, State, spiking
from neural.models import AfferentModel, Coefficients, Filter, averaged_level, level, model_of
from neural.parameter_sets import ParameterSet, parameter_set
from neural.parameters import AfferentParameters, Parameters, finest_step_ms, quantiles
from neural.time_step import AFTER, BEFORE, read_at_step, step_ratio

# Samples before and after one that a filter reads (backward differences), its recursion apart.
_REACH: Mapping[Filter, tuple[int, int]] = {
    level: (0, 0),
    filters.stress_rate: (1, 0),
    filters.slow_rate: (1, 0),
    filters.faded: (0, 0),
    filters.corpuscle: (0, 0),
    filters.rate_change: (2, 0),
    filters.acceleration_change: (3, 0),
    averaged_level: (M2, M1),
    filters.sa_rate: (M2, M1),
}

Samples: TypeAlias = ArrayLike | Mapping[str, ArrayLike]
"""Stress of one signal for all classes, or of each class by name."""


class StreamSpike(NamedTuple):
    """A spike of a cell: its time in ms, class, channel from 0, and cell from 0.

    Cell 0 is the most sensitive of its class.

    Examples
    --------
    >>> from neural import Stream
    >>> stream = Stream("fitted", dt_ms=0.1)
    >>> [spike, *_] = stream.push([0.0, 20_000.0] * 50)
    >>> spike.afferent, spike.channel
    ('PC', 0)
    """

    time_ms: float
    afferent: str
    channel: int
    cell: int


class Stream:
    """Spikes of afferents from a stress that comes in parts.

    Parameters
    ----------
    parameters
        Name of a parameter set (``"fitted"``, ``"published"``), a TOML file, a `ParameterSet`,
        parameters by class, or those of one class, such as ``PUBLISHED["RA"]``. Default:
        ``"fitted"``.
    dt_ms
        Time between two samples in ms; a multiple or divisor of the step of the parameters.
        Default: None, the smallest step of the parameters.
    afferents
        Class or classes. Default: None, all.
    channels
        Number of signals, such as the taxels of a skin, each of which drives cells of its own.
        Default: 1.
    start_ms
        Time of the first sample in ms. Default: 0.

    Attributes
    ----------
    look_ahead_ms
        Largest delay in ms from a spike to the sample that reports it, by class: 0 for ``fitted``
        at its own step, 4 ms for SA of ``published``, whose averages look ahead. `flush` reports
        the spikes that still wait when the signal ends.
    samples
        Number of samples so far.

    Raises
    ------
    ParameterError
        A `dt_ms` that does not fit the step of the parameters, or is coarser than that of
        parameters whose equation contains it (``published``).
    UsageError
        `channels` below 1, an unknown class, or neither the name of a set nor a file.

    Examples
    --------
    >>> import numpy as np
    >>> from neural import Stream
    >>> stream = Stream("fitted", dt_ms=1.0)
    >>> stream.look_ahead_ms
    {'SA': 2.9, 'RA': 2.9, 'PC': 2.9}
    >>> times_ms = np.arange(200)
    >>> stress_pa = 5000 * (1 - np.cos(2 * np.pi * times_ms / 50))
    >>> spikes = [spike for sample in stress_pa for spike in stream.step(sample)]
    >>> spikes += stream.flush()
    >>> sorted({spike.afferent for spike in spikes})
    ['PC', 'RA', 'SA']
    """

    def __init__(
        self,
        parameters: str | ParameterSet | Parameters | AfferentParameters = "fitted",
        dt_ms: float | None = None,
        *,
        afferents: str | Sequence[str] | None = None,
        channels: int = 1,
        start_ms: float = 0.0,
    ) -> None:
        if isinstance(channels, bool) or not isinstance(channels, int) or channels < 1:
            raise UsageError(argument="channels", found=channels, expected="a whole number >= 1")
        if isinstance(parameters, AfferentParameters):
            parameters = {parameters.afferent: parameters}
        elif not isinstance(parameters, Mapping):
            parameters = parameter_set(parameters).parameters
        names = [afferents] if isinstance(afferents, str) else list(afferents or parameters)
        for name in names:
            if name not in parameters:
                expected = f"one of {', '.join(parameters)}"
                raise UsageError(argument="afferents", found=name, expected=expected)
        self._parameters = {name: parameters[name] for name in parameters if name in names}
        step_ms = finest_step_ms(self._parameters)
        self.dt_ms = step_ms if dt_ms is None else float(dt_ms)
        self.channels, self.start_ms = channels, float(start_ms)
        self.reset()
        delays_ms = {name: group.look_ahead_ms for group in self._groups for name in group.members}
        self.look_ahead_ms = {name: delays_ms[name] for name in self._parameters}

    def __repr__(self) -> str:
        names = ", ".join(self._parameters)
        channels = "1 channel" if self.channels == 1 else f"{self.channels} channels"
        return f"Stream({names}, every {self.dt_ms:g} ms, {channels}, {self.samples} samples)"

    def reset(self) -> None:
        """Return to the state before the first sample."""
        self.samples, self._has_ended = 0, False
        alike: dict[tuple[float, int], dict[str, _ClassInput]] = {}
        for name, values in self._parameters.items():  # in a group all advance by the same samples
            member = _ClassInput.of(values, self.dt_ms, self.channels)
            alike.setdefault((values.dt_ms, member.ahead), {})[name] = member
        self._groups = [_Group(members, self.channels) for members in alike.values()]

    def step(self, stress_pa: Samples) -> list[StreamSpike]:
        """Spikes that one more sample completes, by time.

        Parameters
        ----------
        stress_pa
            Stress in Pa: a number, or ``(channel,)``; for all classes, or a dict by class.

        Raises
        ------
        TraceError
            A number that is not finite or another number of channels (the stream is unchanged),
            or a stream that has ended.
        """
        return self._take(self._checked(stress_pa, is_sample=True))

    def push(self, stress_pa: Samples) -> list[StreamSpike]:
        """Spikes that further samples complete, by time.

        Parameters
        ----------
        stress_pa
            Stress in Pa: ``(T,)``, or ``(T, channel)``; for all classes, or a dict by class.

        Raises
        ------
        TraceError
            As of `step`.
        """
        return self._take(self._checked(stress_pa, is_sample=False))

    def flush(self) -> list[StreamSpike]:
        """End the stream; the spikes that waited for later samples, by time.

        After the last sample the stress keeps its value, as in `encode`.
        """
        self._has_ended = True
        return self._spikes({}, is_end=True)

    def _checked(self, stress_pa: Samples, is_sample: bool) -> dict[str, FloatArray]:
        """Samples ``(T, channel)`` of each class, all finite."""
        if self._has_ended:
            raise TraceError("the stream has ended; reset() begins a new one")
        if isinstance(stress_pa, Mapping):
            if stress_pa.keys() != self._parameters.keys():
                raise TraceError(
                    argument="stress_pa",
                    found=", ".join(map(str, stress_pa)),
                    expected=f"a stress of each class: {', '.join(self._parameters)}",
                )
            by_class = {name: self._rows(stress_pa[name], is_sample) for name in self._parameters}
        else:
            by_class = dict.fromkeys(self._parameters, self._rows(stress_pa, is_sample))
        if len({len(rows) for rows in by_class.values()}) > 1:
            raise TraceError("stress of unequal lengths, expected one time axis")
        return by_class

    def _rows(self, stress_pa: ArrayLike, is_sample: bool) -> FloatArray:
        values = np.array(stress_pa, dtype=np.float64)
        shape = values.shape
        rows = values[np.newaxis] if is_sample else values
        if rows.ndim == 1:
            rows = rows[:, np.newaxis]
        if rows.ndim != 2 or rows.shape[1] != self.channels:
            single = "a number" if is_sample else "(T,)"
            many = f"({self.channels},)" if is_sample else f"(T, {self.channels})"
            expected = single if self.channels == 1 else many
            raise TraceError(argument="stress_pa", found=shape, expected=expected)
        if not np.isfinite(rows).all():
            row, channel = np.argwhere(~np.isfinite(rows))[0].tolist()
            raise TraceError(
                f"stress is {rows[row, channel]} at sample {self.samples + row}, channel {channel}"
            )
        return rows

    def _take(self, by_class: dict[str, FloatArray]) -> list[StreamSpike]:
        self.samples += len(next(iter(by_class.values())))
        return self._spikes(by_class, is_end=False)

    def _spikes(self, by_class: Mapping[str, FloatArray], is_end: bool) -> list[StreamSpike]:
        return sorted(
            # The current of row k acts until sample k + 1.
            StreamSpike(self.start_ms + (row + 1.0) * group.step_ms, name, channel, cell)
            for group in self._groups
            for row, (name, channel, cell) in group.spikes(by_class, is_end)
        )


@dataclass(slots=True)
class _ClassInput:
    """From samples to the currents of a class.

    `samples` are those of the sensor that are still needed, from number `begin` on,
    ``(n, channel)``; `done` is the number of rows whose currents are computed. A row is a time
    step of the parameters. `behind` and `ahead` are the reach of the filters in rows.
    """

    parameters: AfferentParameters
    model: AfferentModel
    coefficients: Coefficients
    finer: int
    coarser: int
    behind: int
    ahead: int
    samples: FloatArray
    pasts: list[Past]
    begin: int = 0
    done: int = 0
    dt_ms: float = 0.0

    @classmethod
    def of(cls, parameters: AfferentParameters, dt_ms: float, channels: int) -> "_ClassInput":
        """A class before the first sample."""
        model = model_of(parameters)
        finer, coarser = step_ratio(parameters, dt_ms)
        reaches = [_REACH[filter_] for filter_ in model.filters]
        return cls(
            parameters=parameters,
            model=model,
            coefficients=_cell_coefficients(parameters, model),
            finer=finer,
            coarser=coarser,
            behind=max(behind for behind, _ in reaches),
            ahead=max(ahead for _, ahead in reaches),
            samples=np.empty((0, channels)),
            pasts=[Past() for _ in model.filters],
            dt_ms=dt_ms,
        )

    @property
    def look_ahead_ms(self) -> float:
        """Longest time from a spike to the sample that brings it."""
        if self.finer > 1:
            return AFTER * self.dt_ms - self.parameters.dt_ms
        return max(self.ahead - 1, 0) * self.parameters.dt_ms

    def currents(self, more: FloatArray | None, is_end: bool) -> FloatArray | None:
        """Currents ``(row, membrane, cell, channel)`` that `more` samples complete.

        None where there are none. The current of the last sample is never computed: it would act
        after it.
        """
        if more is not None:
            self.samples = np.concatenate([self.samples, more])
        count = self.begin + len(self.samples)
        if count < 2:
            return None
        if self.finer > 1:
            end = ready = (count - (1 if is_end else AFTER)) * self.finer
        else:
            arrived = (count - 1) // self.coarser + 1
            # A current waits for the sample at which its spikes are.
            ready = arrived - (1 if is_end else max(self.ahead, 1))
            end = min(arrived, ready + max(self.ahead, 1))
        if ready <= self.done:
            return None
        first = max(0, self.done - self.behind)
        begin = self.begin
        read, _ = read_at_step(
            lambda start, stop: self.samples[start - begin : stop - begin],
            count,
            self.parameters,
            self.dt_ms,
        )
        for past in self.pasts:
            past.before, past.count = self.done - first, ready - self.done
        filtered = self.model.filtered(
            read(first, end), self.parameters.dt_ms, "backward", self.pasts
        )
        rows = slice(self.done - first, ready - first)
        current = self.coefficients.current([x[rows, np.newaxis, np.newaxis] for x in filtered])
        self.done = ready
        self._discard()
        return current

    def _discard(self) -> None:
        """Drop the samples that no later row reads."""
        row = max(0, self.done - self.behind)
        needed = row * self.coarser if self.finer == 1 else max(0, row // self.finer - BEFORE + 1)
        if needed > self.begin:
            self.samples = self.samples[needed - self.begin :].copy()
            self.begin = needed


def _cell_coefficients(parameters: AfferentParameters, model: AfferentModel) -> Coefficients:
    """Coefficients of all membranes and cells, arrays ``(membrane, cell, 1)``."""
    values = parameters.by_name()
    factors = np.exp(parameters.spread * quantiles(parameters.cells))
    rows = [
        [part.scaled_for_cell(factor) for factor in factors]
        for part in model.membrane_coefficients(values)
    ]
    [first, *_] = rows[0]

    def stacked(rows: list[list[ArrayLike]]) -> FloatArray:
        return np.array(rows, dtype=np.float64)[..., np.newaxis]

    alpha = stacked([[cell.alpha_mv_per_ms for cell in row] for row in rows])
    halves = first.halves and tuple(
        stacked([[(cell.halves or ())[term] for cell in row] for row in rows])
        for term in range(len(first.halves))
    )
    return replace(first, alpha_mv_per_ms=alpha, halves=halves)


class _Group:
    """Classes whose rows advance by the same samples, with all their membranes in one array."""

    def __init__(self, members: Mapping[str, _ClassInput], channels: int) -> None:
        self.members = members
        parts = list(members.values())
        self.step_ms, self.look_ahead_ms = parts[0].parameters.dt_ms, parts[0].look_ahead_ms
        shapes = [(1 + part.model.two_way, part.parameters.cells, channels) for part in parts]
        sizes = [math.prod(shape) for shape in shapes]
        membranes = [part.model.membrane(part.parameters.by_name(), self.step_ms) for part in parts]
        # Class, channel and cell of each membrane.
        self._labels = [
            (name, channel, cell)
            for name, shape in zip(members, shapes, strict=True)
            for _, cell, channel in np.ndindex(shape)
        ]
        self._row = 0
        self._currents: deque[FloatArray] = deque()
        # A generator that waits for rows: setting it up takes longer than a row.
        self._firing = spiking(
            self._next_currents(), Membrane.joined(membranes, sizes), State.at_rest(sum(sizes))
        )

    def _next_currents(self) -> Iterator[FloatArray]:
        while True:
            yield self._currents.popleft()

    def spikes(
        self, by_class: Mapping[str, FloatArray], is_end: bool
    ) -> Iterator[tuple[int, tuple[str, int, int]]]:
        """Row, and class, channel and cell, of each spike that further samples complete."""
        currents = [
            member.currents(by_class.get(name), is_end) for name, member in self.members.items()
        ]
        parts = [part.reshape(len(part), -1) for part in currents if part is not None]
        if not parts:
            return
        rows = np.concatenate(parts, axis=1)
        if not np.isfinite(rows.sum()):
            raise TraceError("a current that is not finite reached the membrane")
        first, self._row = self._row, self._row + len(rows)
        self._currents.extend(rows)
        for row in range(first, self._row):
            membranes, _ = next(self._firing)
            for membrane in membranes.tolist():
                yield row, self._labels[membrane]
