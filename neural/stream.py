"""Spikes sample by sample: `encode` for a sensor that is still measuring.

A stream keeps what the encoder keeps between two parts of a trace: the states of the recursive
filters, the membranes, and the last samples. So its spikes are those of `encode_cells` on all
samples so far, to the last bit, whatever the sizes of the parts.

A spike is reported when no later sample can change it. Models whose filters look back only, as
those of ``fitted``, report it at the sample at which it is; `Stream.look_ahead_ms` has the delay of
each class. A sensor that is slower than the time step of the parameters is interpolated, which
delays by two of its samples.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from fembridge.errors import TraceError, UsageError
from fembridge.typing import FloatArray
from neural.encoder import membrane_currents
from neural.filters import M1, M2, M3, Past, sa_rate
from neural.lif import Membrane, State, fire
from neural.models import averaged_level, model_of
from neural.parameter_sets import ParameterSet, parameter_set
from neural.parameters import AfferentParameters, Parameters, quantiles
from neural.time_step import AFTER, BEFORE, read_at_step, step_ratio

# Samples before and after one that a filter may read, except recursions: the average of SA.
_AROUND = M1 + M2 + 4
# Later samples that the averages of the published SA read.
_AHEAD = {averaged_level: M1, sa_rate: M3}

Samples: TypeAlias = ArrayLike | Mapping[str, ArrayLike]
"""Stress of one signal for all classes, or of each class by name."""


class StreamSpike(NamedTuple):
    """A spike of a cell: its time in ms, class, channel from 0, and cell from 0.

    Cell 0 is the most sensitive of its class.
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
        parameters by class, or those of one class, such as ``PUBLISHED["RA"]``.
    dt_ms
        Time between two samples in ms; a multiple or divisor of the step of the parameters.
    channels
        Number of signals, each of which drives cells of its own. Default: 1.
    start_ms
        Time of the first sample in ms. Default: 0.

    Attributes
    ----------
    look_ahead_ms
        Delay in ms with which a spike is reported, by class: 0 for ``fitted`` at its own step.
        `flush` reports the spikes that still wait when the signal ends.
    samples
        Number of samples so far.

    Raises
    ------
    ParameterError
        A `dt_ms` that does not fit the step of the parameters, or is coarser than that of
        parameters whose equation contains it (``published``).
    UsageError
        `channels` below 1, or neither the name of a set nor a file.

    Examples
    --------
    >>> import numpy as np
    >>> from neural import Stream
    >>> stream = Stream("fitted", dt_ms=1.0)
    >>> stream.look_ahead_ms
    {'SA': 2.0, 'RA': 2.0, 'PC': 2.0}
    >>> times_ms = np.arange(200)
    >>> stress_pa = 5000 * (1 - np.cos(2 * np.pi * times_ms / 50))
    >>> spikes = [spike for sample in stress_pa for spike in stream.step(sample)]
    >>> spikes += stream.flush()
    >>> sorted({spike.afferent for spike in spikes})
    ['PC', 'RA', 'SA']
    """

    def __init__(
        self,
        parameters: str | ParameterSet | Parameters | AfferentParameters,
        dt_ms: float,
        *,
        channels: int = 1,
        start_ms: float = 0.0,
    ) -> None:
        if isinstance(channels, bool) or not isinstance(channels, int) or channels < 1:
            raise UsageError(argument="channels", found=channels, expected="a whole number >= 1")
        if isinstance(parameters, AfferentParameters):
            parameters = {parameters.afferent: parameters}
        elif not isinstance(parameters, Mapping):
            parameters = parameter_set(parameters).parameters
        self.dt_ms, self.channels, self.start_ms = float(dt_ms), channels, float(start_ms)
        self._parameters = dict(parameters)
        self.reset()
        self.look_ahead_ms = {name: part.look_ahead_ms for name, part in self._classes.items()}

    def __repr__(self) -> str:
        names = ", ".join(self._parameters)
        channels = "1 channel" if self.channels == 1 else f"{self.channels} channels"
        return f"Stream({names}, every {self.dt_ms:g} ms, {channels}, {self.samples} samples)"

    def reset(self) -> None:
        """Return to the state before the first sample."""
        self.samples, self._has_ended = 0, False
        self._classes = {
            name: _ClassStream(values, self.dt_ms, self.channels)
            for name, values in self._parameters.items()
        }

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
        spikes = [
            spike
            for name, part in self._classes.items()
            for spike in part.spikes(name, self.start_ms, is_end=True)
        ]
        return sorted(spikes)

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
            one = "a number" if is_sample else "(T,)"
            many = f"({self.channels},)" if is_sample else f"(T, {self.channels})"
            expected = one if self.channels == 1 else many
            raise TraceError(argument="stress_pa", found=shape, expected=expected)
        if not np.isfinite(rows).all():
            row, channel = np.argwhere(~np.isfinite(rows))[0].tolist()
            raise TraceError(
                f"stress is {rows[row, channel]} at sample {self.samples + row}, channel {channel}"
            )
        return rows

    def _take(self, by_class: dict[str, FloatArray]) -> list[StreamSpike]:
        spikes = []
        for name, rows in by_class.items():
            part = self._classes[name]
            part.append(rows)
            spikes += part.spikes(name, self.start_ms, is_end=False)
        self.samples += len(next(iter(by_class.values()), ()))
        return sorted(spikes)


@dataclass(slots=True)
class _Window:
    """The last rows of a growing array; row numbers are those of the whole array."""

    values: FloatArray
    first: int = 0

    @property
    def end(self) -> int:
        return self.first + len(self.values)

    def append(self, rows: FloatArray) -> None:
        self.values = np.concatenate([self.values, rows])

    def read(self, begin: int, end: int) -> FloatArray:
        return self.values[begin - self.first : end - self.first]

    def forget_before(self, row: int) -> None:
        dropped = max(0, min(row, self.end) - self.first)
        self.values, self.first = self.values[dropped:], self.first + dropped


@dataclass(slots=True)
class _ClassStream:
    """The encoder of one class between two parts of a trace."""

    values: AfferentParameters
    dt_ms: float
    channels: int
    look_ahead_ms: float = field(init=False)
    _sensor: _Window = field(init=False)
    _stress: _Window = field(init=False)
    _pasts: list[Past] = field(init=False)
    _factors: FloatArray = field(init=False)
    _membrane: Membrane = field(init=False)
    _state: State = field(init=False)
    _ratio: tuple[int, int] = field(init=False)
    _ahead: int = field(init=False)
    _done: int = 0

    def __post_init__(self) -> None:
        model = model_of(self.values)
        self._ratio = finer, coarser = step_ratio(self.values, self.dt_ms)
        self._ahead = max(_AHEAD.get(filter_, 0) for filter_ in model.filters)
        if finer > 1:
            self.look_ahead_ms = (AFTER - 1) * self.dt_ms + self._ahead * self.values.dt_ms
        else:
            self.look_ahead_ms = max(0, self._ahead - 1) * coarser * self.dt_ms
        self._sensor = _Window(np.empty((0, self.channels)))
        self._stress = _Window(np.empty((0, self.channels)))
        self._pasts = [Past() for _ in model.filters]
        self._factors = np.exp(self.values.spread * quantiles(self.values.cells))
        self._membrane = model.membrane(self.values.by_name(), self.values.dt_ms)
        members = 1 + model.two_way
        self._state = State.at_rest(members * self.values.cells * self.channels)

    def append(self, rows: FloatArray) -> None:
        self._sensor.append(rows)

    def spikes(self, name: str, start_ms: float, is_end: bool) -> list[StreamSpike]:
        """Spikes of all rows whose current no later sample changes; of all rows at the end."""
        finer, coarser = self._ratio
        count = self._sensor.end
        if count < 2:
            return []
        rows_so_far = (count - 1) * finer // coarser + 1
        ready = rows_so_far
        if finer > 1 and not is_end:
            ready = max(0, (count - AFTER) * finer)
        read, _ = read_at_step(self._sensor.read, count, self.values, self.dt_ms)
        if ready > self._stress.end:
            self._stress.append(read(self._stress.end, ready))
        # The current of the last sample would act after the trace.
        last = rows_so_far - 1 if is_end else min(rows_so_far - 1, ready - self._ahead)
        first, self._done = self._done, max(self._done, last)
        if last <= first:
            return []
        begin, end = max(0, first - _AROUND), min(ready, last + 1 + _AROUND)
        for past in self._pasts:
            past.before, past.count = first - begin, last - first
        stress = self._stress.read(begin, end)
        currents = membrane_currents(stress, self.values, "backward", self._factors, self._pasts)
        part = currents[first - begin : last - begin].reshape(last - first, -1)
        rows, membranes = fire(part, self._membrane, self._state)
        self._forget(last)
        channel, cell = membranes % self.channels, membranes // self.channels % self.values.cells
        times_ms = start_ms + (first + rows + 1.0) * self.values.dt_ms
        return [
            StreamSpike(time_ms, name, *place)
            for time_ms, *place in zip(
                times_ms.tolist(), channel.tolist(), cell.tolist(), strict=True
            )
        ]

    def _forget(self, row: int) -> None:
        """Drop what no later row needs."""
        finer, coarser = self._ratio
        self._stress.forget_before(row - _AROUND)
        if finer > 1:
            self._sensor.forget_before(self._stress.end // finer - BEFORE)
        else:
            self._sensor.forget_before(self._stress.end * coarser)
