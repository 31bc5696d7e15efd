"""Spikes in the formats of other programs: NWB, Neo, SONATA, MATLAB, NumPy, events, simulators.

A recording holds the spikes of units in trials. All trials share one clock: time 0 is that of
the tables, no spike is at 0, and `t_stop_ms` is the last sample of the stress trace. Formats
with a single time axis (NWB, SONATA, events) store the trials one after another.

Each function imports the library that it needs.
"""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fembridge.errors import MissingError, UsageError
from fembridge.host.store import near_hint, replacing
from fembridge.io.spike_table import SpikeTrain
from fembridge.typing import FloatArray, IntArray
from fembridge.version import __version__

if TYPE_CHECKING:
    from collections.abc import Iterator

    import h5py


_S_PER_MS = 1.0e-3
_MM_PER_UM = 1.0e-3
_COLUMNS = {
    "unit": "name of the unit",
    "afferent": "class of the afferent: SA, RA or PC",
    "cell": "cell of the class, from 1 (the most sensitive); 0: a single cell",
    "node": "node of the finite-element model from which its stress is read",
    "x_mm": "position across the finger, mm, 0 in the middle of the pad",
    "z_mm": "position along the finger towards the tip, mm",
    "depth_mm": "depth below the skin surface, mm",
    "deviate": "deviate of its threshold: exp(spread deviate) times the stress of the median unit",
}
# Names of the classes in TouchSim.
_TOUCHSIM = {"SA": "SA1", "RA": "RA", "PC": "PC"}
_MOST_PIXELS = 2**15 - 1
_SONATA_MAGIC, _SONATA_VERSION = 0x0A7A, (0, 1)


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """Spikes of U units in K trials, in order of trial, unit, time.

    Unit u in trial k has ``time_ms[start[k U + u] : start[k U + u + 1]]``. `to_recording` of a
    result, `from_trains` and `from_units` make recordings.

    Parameters
    ----------
    unit
        Name of each unit, ``(U,)``.
    afferent
        Class of each unit, ``(U,)``.
    stimulus
        Stimulus of each trial, ``(K,)``.
    trial
        Number of each trial of a stimulus, ``(K,)`` from 1; 0: a single trial.
    time_ms
        Spike times in ms from the start of the trial, ``(spikes,)``.
    start
        First row of each unit's spikes in `time_ms`, ``(K U + 1,)``.
    dt_ms
        Time step in ms of the traces and of `depth_um`.
    t_stop_ms
        Time in ms of the last sample of the longest trial.
    columns
        Further properties of the units by name, ``(U,)`` each. Default: none.
    depth_um
        Depth of the probe in um, ``(K, T)`` from time 0, NaN after the end of a shorter
        stimulus. Default: None.

    Raises
    ------
    UsageError
        A spike at or before time 0, or after `t_stop_ms`.

    Examples
    --------
    >>> import fembridge as fb
    >>> recording = fb.simulate("sine_20_250", stored=True).to_recording()
    >>> recording.dt_ms, len(recording.unit)
    (0.1, 30)
    """

    unit: tuple[str, ...]
    afferent: tuple[str, ...]
    stimulus: tuple[str, ...]
    trial: tuple[int, ...]
    time_ms: FloatArray
    start: IntArray
    dt_ms: float
    t_stop_ms: float
    columns: Mapping[str, FloatArray | IntArray] = field(default_factory=dict)
    depth_um: FloatArray | None = None

    def __post_init__(self) -> None:
        if self.time_ms.size and not 0 < self.time_ms.min() <= self.time_ms.max() <= self.t_stop_ms:
            raise UsageError(
                f"spikes from {self.time_ms.min():g} to {self.time_ms.max():g} ms, expected after "
                f"0 and up to {self.t_stop_ms:g} ms"
            )

    def __repr__(self) -> str:
        classes = ", ".join(dict.fromkeys(self.afferent))
        return (
            f"Recording({len(self.unit)} units of {classes} in {len(self.stimulus)} trials of "
            f"{self.t_stop_ms:g} ms, {self.time_ms.size} spikes)"
        )

    # ---- From spikes

    @classmethod
    def from_units(
        cls,
        unit: Sequence[str],
        afferent: Sequence[str],
        stimulus: str,
        trials: int,
        spikes: tuple[IntArray, IntArray, FloatArray],
        columns: Mapping[str, FloatArray],
        depth_um: FloatArray,
        dt_ms: float,
    ) -> "Recording":
        """Recording of trials of one stimulus.

        Parameters
        ----------
        unit, afferent, columns
            Name, class and properties of each unit, ``(U,)``.
        stimulus
            Name of the stimulus.
        trials
            Number of trials.
        spikes
            Trial from 1, unit from 0 and time in ms of each spike, ``(N,)`` each.
        depth_um
            Depth of the stimulus in um, ``(T,)``.
        dt_ms
            Time step of `depth_um` in ms.
        """
        trial, unit_row, time_ms = spikes
        return cls(
            unit=tuple(unit),
            afferent=tuple(afferent),
            stimulus=(stimulus,) * trials,
            trial=tuple(range(1, trials + 1)) if trials > 1 else (0,),
            **_sorted_spikes((trial - 1) * len(unit) + unit_row, time_ms, len(unit) * trials),
            dt_ms=dt_ms,
            t_stop_ms=(depth_um.size - 1) * dt_ms,
            columns=columns,
            depth_um=np.tile(depth_um, (trials, 1)),
        )

    @classmethod
    def from_trains(
        cls,
        trains: Sequence[SpikeTrain],
        dt_ms: float,
        t_stop_ms: float,
        nodes: Mapping[tuple[str, str], int] | None = None,
        depth_um: FloatArray | None = None,
    ) -> "Recording":
        """Recording of spike trains: one trial per stimulus, one unit per cell of a class.

        Parameters
        ----------
        trains
            Spike trains; their times in ms.
        dt_ms, t_stop_ms
            Time step in ms, and time in ms of the last sample of the longest trial.
        nodes
            Node of each unit, by class and name of the unit. Default: None, none is stored.
        depth_um
            Depth of the probe in each trial in um, ``(K, T)``. Default: None, none is stored.
        """
        cell_keys = [(train.afferent, train.unit, train.cell) for train in trains]
        cells = list(dict.fromkeys(cell_keys))
        stimuli = list(dict.fromkeys(train.stimulus for train in trains))
        row = [
            stimuli.index(train.stimulus) * len(cells) + cells.index(key)
            for train, key in zip(trains, cell_keys, strict=True)
        ]
        rows = np.repeat(row, [train.times_ms.size for train in trains]).astype(np.int64)
        time_ms = np.concatenate([np.zeros(0), *(train.times_ms for train in trains)])
        columns = {"cell": np.array([cell for *_, cell in cells])}
        if nodes:
            columns["node"] = np.array([nodes[name, unit] for name, unit, _ in cells])
        return cls(
            unit=tuple(f"{unit and unit + '_'}{name}{cell or ''}" for name, unit, cell in cells),
            afferent=tuple(name for name, *_ in cells),
            stimulus=tuple(stimuli),
            trial=(0,) * len(stimuli),
            **_sorted_spikes(rows, time_ms, len(cells) * len(stimuli)),
            dt_ms=dt_ms,
            t_stop_ms=t_stop_ms,
            columns=columns,
            depth_um=depth_um,
        )

    def spikes_ms(self, unit: int, trial: int = 0) -> FloatArray:
        """Spike times of a unit in a trial in ms, ``(spikes,)``.

        Parameters
        ----------
        unit
            Row of the unit, from 0.
        trial
            Row of the trial, from 0. Default: 0.
        """
        row = trial * len(self.unit) + unit
        return self.time_ms[self.start[row] : self.start[row + 1]]

    @property
    def trial_ms(self) -> FloatArray:
        """Start of each trial ``(K,)`` when trials follow one another."""
        return np.arange(len(self.stimulus), dtype=np.float64) * (self.t_stop_ms + self.dt_ms)

    @property
    def end_ms(self) -> FloatArray:
        """Last sample of each trial ``(K,)``; a shorter waveform ends earlier."""
        if self.depth_um is None:
            return np.full(len(self.stimulus), self.t_stop_ms)
        last = np.isfinite(self.depth_um).sum(axis=1) - 1
        return np.asarray(last * self.dt_ms, dtype=np.float64)

    def _unit_properties(self, unit: int) -> dict[str, Any]:
        """Properties of a unit, by name."""
        properties = {name: values[unit].item() for name, values in self.columns.items()}
        return {"unit": self.unit[unit], "afferent": self.afferent[unit], **properties}

    def _continuous_times_ms(self, unit: int) -> FloatArray:
        trials = [start + self.spikes_ms(unit, k) for k, start in enumerate(self.trial_ms)]
        return np.concatenate(trials)

    # ---- To files

    def write(self, path: Path | str, event_grid_mm: float | None = None) -> Path:
        """Write a file and return its path.

        Parameters
        ----------
        path
            Path of the file. Its suffix selects the format: ``.npz``, ``.mat``, ``.nwb``,
            ``.pkl`` (Neo), ``.h5`` (SONATA), ``.npy`` (events) or ``.aedat4`` (events).
        event_grid_mm
            Pixel of events in mm, as in `to_events`. Default: None, a pixel for each unit.

        Raises
        ------
        UsageError
            Another suffix, or an error of `to_events`.
        MissingError
            The library of the format is not installed.
        """
        path = Path(path)
        writers = {entry.suffix: entry.write for entry in FORMATS.values()}
        if path.suffix not in writers:
            hint = near_hint(path.suffix, writers)
            expected = f"a name in {', '.join(writers)}"
            problem = f"is {str(path)!r}, expected {expected}{hint}"
            raise UsageError(problem, argument="path", found=str(path), expected=expected)
        if event_grid_mm is not None and path.suffix not in EVENT_SUFFIXES:
            expected = f"a file of events: {' or '.join(EVENT_SUFFIXES)}"
            raise UsageError(argument="event_grid_mm", found=event_grid_mm, expected=expected)
        options = {} if event_grid_mm is None else {"event_grid_mm": event_grid_mm}
        with replacing(path) as draft:
            writers[path.suffix](self, draft, **options)
        return path

    def _write_npz(self, path: Path) -> None:
        names = ("unit", "afferent", "stimulus", "trial", "time_ms", "start", "dt_ms", "t_stop_ms")
        arrays: dict[str, Any] = {name: np.array(getattr(self, name)) for name in names}
        arrays.update(self.columns)
        if self.depth_um is not None:
            arrays["depth_um"] = self.depth_um
        with path.open("wb") as file:
            np.savez_compressed(file, **arrays)

    def _write_mat(self, path: Path) -> None:
        """Struct `response` with the fields of TouchSim's ResponseCollection; times in seconds."""
        from scipy.io import savemat

        count, seconds = len(self.unit), self.end_ms * _S_PER_MS
        kinds = [(name, object) for name in ("spikes", "rate", "duration")]
        responses = np.empty((len(self.stimulus), count), dtype=kinds)
        for k, unit in np.ndindex(responses.shape):
            spikes_s = self.spikes_ms(unit, k) * _S_PER_MS
            responses[k, unit] = spikes_s, spikes_s.size / seconds[k], seconds[k]
        unknown = np.full(count, np.nan)
        location = [self.columns.get(name, unknown) for name in ("x_mm", "z_mm")]
        classes = [_TOUCHSIM.get(name, name) for name in self.afferent]
        afferents = {
            "num": count,
            "class": np.array(classes, dtype=object),
            "unit": np.array(self.unit, dtype=object),
            "location": np.stack(location, -1),
            "depth": self.columns.get("depth_mm", unknown),
            **{f"i{name}": np.array([item == name for item in classes]) for name in ("SA1", "RA")},
            "iPC": np.array([item == "PC" for item in classes]),
        }
        stimulus = {
            "name": np.array(self.stimulus, dtype=object),
            "trial": np.array(self.trial),
            "sampling_frequency": 1.0 / (self.dt_ms * _S_PER_MS),
            "duration": self.t_stop_ms * _S_PER_MS,
        }
        if self.depth_um is not None:
            stimulus["trace"] = self.depth_um.T * _MM_PER_UM
        response = {
            "affpop": afferents,
            "responses": responses,
            "rate": np.vectorize(float)(responses["rate"].T),
            "duration": self.t_stop_ms * _S_PER_MS,
            "stimulus": stimulus,
        }
        savemat(path, {"response": response}, oned_as="column", do_compression=True)

    def _write_nwb(self, path: Path) -> None:
        with _require_library("nwb"):
            from pynwb import NWBHDF5IO
        with _hdf5_in_memory(path) as file, NWBHDF5IO(mode="w", file=file) as writer:
            writer.write(self.to_nwb())
            _copy_to_disk(file, path)

    def _write_neo(self, path: Path) -> None:
        block = self.to_neo()
        with _require_library("neo"):
            from neo.io import PickleIO
        PickleIO(path).write_block(block)

    def _write_sonata(self, path: Path) -> None:
        """Spikes and nodes of one population, `afferents`; trials follow one another."""
        with _require_library("sonata"):
            import h5py

        time_ms = [self._continuous_times_ms(unit) for unit in range(len(self.unit))]
        with _hdf5_in_memory(path) as file:
            file.attrs["magic"] = np.uint32(_SONATA_MAGIC)
            file.attrs["version"] = np.array(_SONATA_VERSION, dtype=np.uint32)
            spikes = file.create_group("spikes/afferents")
            ids = np.repeat(np.arange(len(self.unit)), [unit_ms.size for unit_ms in time_ms])
            sorted_ms = np.concatenate(time_ms)
            order = np.lexsort((ids, sorted_ms))
            spikes["timestamps"] = sorted_ms[order]
            spikes["timestamps"].attrs["units"] = "ms"
            spikes["node_ids"] = ids[order].astype(np.uint64)
            kinds = h5py.enum_dtype({"none": 0, "by_id": 1, "by_time": 2}, basetype="u1")
            spikes.attrs.create("sorting", 2, dtype=kinds)
            nodes = file.create_group("nodes/afferents")
            nodes["node_type_id"] = np.zeros(len(self.unit), dtype=np.int64)
            nodes["node_group_id"] = np.zeros(len(self.unit), dtype=np.uint64)
            nodes["node_group_index"] = np.arange(len(self.unit), dtype=np.uint64)
            texts = {"unit": list(self.unit), "afferent": list(self.afferent)}
            for name, values in {**texts, **self.columns}.items():
                nodes[f"0/{name}"] = values
            trials = file.create_group("trials")
            trials["stimulus"] = list(self.stimulus)
            trials["trial"] = np.array(self.trial)
            trials["start_ms"] = self.trial_ms
            trials["stop_ms"] = self.trial_ms + self.end_ms
            _copy_to_disk(file, path)

    def _write_events(self, path: Path, event_grid_mm: float | None = None) -> None:
        with path.open("wb") as file:
            np.save(file, self.to_events(event_grid_mm))

    def _write_aedat4(self, path: Path, event_grid_mm: float | None = None) -> None:
        """Events as those of an event camera."""
        from fembridge.io.aedat4 import write_aedat4

        column, row = self._pixels(event_grid_mm)
        size = int(column.max(initial=0)) + 1, int(row.max(initial=0)) + 1
        write_aedat4(path, self.to_events(event_grid_mm), size)

    # ---- To other libraries

    def to_events(self, event_grid_mm: float | None = None) -> Any:  # noqa: ANN401 - records
        """Events ``(t, x, y, p)`` as of an event camera, ``(spikes,)``, by time.

        Fields are those of Tonic and of AEDAT4: ``t`` in us, pixel ``x`` and ``y``, polarity ``p``,
        which is True. Trials follow one another, from `trial_ms` on.

        Parameters
        ----------
        event_grid_mm
            Pixel in mm. The units are then pixels by their position, seen from outside with the
            tip above, the classes side by side; units of a class in one pixel are not
            distinguished. Default: None: ``y`` is the class (0 SA, 1 RA, 2 PC), ``x`` the unit in
            the order of its class.

        Raises
        ------
        UsageError
            `event_grid_mm` without positions, not above 0, or with more pixels than 32 767 in a
            direction.
        """
        column, row = self._pixels(event_grid_mm)
        counts = np.diff(self.start)
        units = np.tile(np.arange(len(self.unit)), len(self.stimulus))
        trial_ms = np.repeat(self.trial_ms, len(self.unit))
        spike_units = np.repeat(units, counts)
        time_us = np.rint(1000.0 * (self.time_ms + np.repeat(trial_ms, counts))).astype(np.int64)
        order = np.lexsort((spike_units, time_us))
        events = np.empty(
            time_us.size, dtype=[("t", np.int64), ("x", np.int16), ("y", np.int16), ("p", np.bool_)]
        )
        events["t"], events["p"] = time_us[order], True
        events["x"], events["y"] = column[spike_units[order]], row[spike_units[order]]
        return events

    def _pixels(self, event_grid_mm: float | None) -> tuple[IntArray, IntArray]:
        """Column and row of each unit, ``(U,)``."""
        classes = list(dict.fromkeys([*_TOUCHSIM, *self.afferent]))
        number = np.array([classes.index(name) for name in self.afferent], dtype=np.int64)
        if event_grid_mm is None:
            column, row = np.zeros_like(number), number
            for k in set(number.tolist()):
                column[number == k] = np.arange((number == k).sum())
        else:
            if not 0 < event_grid_mm < np.inf:
                raise UsageError(
                    argument="event_grid_mm", found=event_grid_mm, expected="a number more than 0"
                )
            if not {"x_mm", "z_mm"} <= self.columns.keys():
                raise UsageError(
                    "requires positions of the units, as those of a touch",
                    argument="event_grid_mm",
                    found=event_grid_mm,
                )
            x_mm, z_mm = self.columns["x_mm"], self.columns["z_mm"]
            column = np.floor((x_mm - x_mm.min()) / event_grid_mm).astype(np.int64)
            row = np.floor((z_mm.max() - z_mm) / event_grid_mm).astype(np.int64)
            shown = sorted(set(number.tolist()))
            column += (column.max() + 1) * np.searchsorted(shown, number)
        if (most := int(max(column.max(initial=0), row.max(initial=0)))) > _MOST_PIXELS:
            problem = f"gives {most + 1} pixels in a direction, expected at most {_MOST_PIXELS + 1}"
            raise UsageError(problem, argument="event_grid_mm", found=event_grid_mm)
        return column, row

    def to_neo(self) -> Any:  # noqa: ANN401 - a neo.Block
        """A `neo.Block`: one segment per trial, one annotated spike train per unit."""
        with _require_library("neo"):
            import neo
            import quantities
        ms = quantities.ms
        block = neo.Block(name="fembridge", fembridge_version=__version__)
        for k, (name, trial) in enumerate(zip(self.stimulus, self.trial, strict=True)):
            segment = neo.Segment(name=f"{name} {trial}", stimulus=name, trial=trial, index=k)
            for u, unit in enumerate(self.unit):
                train = neo.SpikeTrain(
                    self.spikes_ms(u, k) * ms,
                    t_stop=self.end_ms[k] * ms,
                    name=unit,
                    **self._unit_properties(u),
                )
                segment.spiketrains.append(train)
            if self.depth_um is not None:
                segment.analogsignals.append(
                    neo.AnalogSignal(
                        self.depth_um[k, np.isfinite(self.depth_um[k]), None] * quantities.um,
                        sampling_period=self.dt_ms * ms,
                        name="depth",
                    )
                )
            block.segments.append(segment)
        return block

    def to_nwb(self, **session_fields: Any) -> Any:  # noqa: ANN401 - pynwb's own
        """A `pynwb.NWBFile`, whose subject is described as simulated.

        Parameters
        ----------
        **session_fields
            Fields of the file instead of ours: ``institution``, ``session_start_time``,
            ``experimenter``, or ``subject``, a `pynwb.file.Subject`.

        Raises
        ------
        MissingError
            pynwb is not installed.
        """
        with _require_library("nwb"):
            from pynwb import NWBFile, TimeSeries
            from pynwb.file import Subject
            from pynwb.misc import Units
        seconds = _S_PER_MS * np.stack([self.trial_ms, self.trial_ms + self.end_ms], -1)
        digest = hashlib.sha256(self.time_ms.tobytes() + self.start.tobytes())
        digest.update(repr((self.unit, self.stimulus, self.trial)).encode())
        stimuli = ", ".join(dict.fromkeys(self.stimulus))
        session = {
            "session_description": f"Simulated afferents of a fingertip under {stimuli}",
            "identifier": digest.hexdigest(),
            "session_start_time": datetime.now(UTC),
            "experimenter": ["Fembridge, simulation"],
            "institution": "none: simulated",
            "experiment_description": f"Computed by fembridge {__version__}: stress in the skin "
            "from finite elements, spikes from models of SA, RA and PC afferents",
            "keywords": ["touch", "tactile afferents", "simulation"],
            "subject": Subject(
                subject_id="simulated",
                species="Homo sapiens",
                sex="U",
                age="P0D/",
                description="a model of a fingertip; no subject was recorded",
            ),
        }
        file = NWBFile(**{**session, **session_fields})
        file.units = Units(
            name="units", description="simulated afferents", resolution=self.dt_ms * _S_PER_MS
        )
        for name in ("unit", "afferent", *self.columns):
            file.add_unit_column(name, _COLUMNS[name])
        for u in range(len(self.unit)):
            times_s = self._continuous_times_ms(u) * _S_PER_MS
            file.add_unit(spike_times=times_s, obs_intervals=seconds, **self._unit_properties(u))
        if len(self.stimulus) > 1:  # the inspector reports a table of one row
            file.add_trial_column("stimulus", "name of the stimulus")
            file.add_trial_column("trial", "trial of the stimulus, from 1; 0: a single trial")
            for k, (start_s, stop_s) in enumerate(seconds):
                file.add_trial(start_s, stop_s, stimulus=self.stimulus[k], trial=self.trial[k])
        if self.depth_um is not None:
            file.add_stimulus(
                TimeSeries(
                    name="depth",
                    data=self.depth_um.ravel() * 1e-6,
                    unit="m",
                    rate=1.0 / (self.dt_ms * _S_PER_MS),
                    starting_time=0.0,
                    description=f"depth of the probe or shape, 0 at first touch: {stimuli}",
                )
            )
        return file

    def to_brian2(self, trial: int = 0) -> Any:  # noqa: ANN401 - untyped
        """A `brian2.SpikeGeneratorGroup` of all units in one trial.

        Parameters
        ----------
        trial
            Row of the trial, from 0. Default: 0.

        Raises
        ------
        MissingError
            Brian 2 is not installed.
        """
        with _require_library("brian2"):
            from brian2 import SpikeGeneratorGroup, ms
        unit, step = self._steps(trial)
        times = step * self.dt_ms * ms
        return SpikeGeneratorGroup(len(self.unit), unit, times, sorted=False)

    def to_nest(self, trial: int = 0) -> Any:  # noqa: ANN401 - untyped
        """A NEST NodeCollection with one `spike_generator` per unit, for one trial.

        NEST's resolution has to divide `dt_ms`.

        Parameters
        ----------
        trial
            Row of the trial, from 0. Default: 0.

        Raises
        ------
        MissingError
            NEST is not installed.
        """
        with _require_library("nest"):
            import nest
        times = [{"spike_times": self.spikes_ms(u, trial)} for u in range(len(self.unit))]
        return nest.Create("spike_generator", len(self.unit), params=times)

    def to_torch(self) -> Any:  # noqa: ANN401 - untyped
        """A float tensor ``(T, K, U)``, 1 where a unit fires, for snnTorch and Norse.

        Time is the first axis, trials are the batch; row n is the step that ends at ``n dt_ms``.
        """
        with _require_library("torch"):
            import torch
        return torch.from_numpy(self.to_dense())

    def to_dense(self) -> Any:  # noqa: ANN401 - an array of float32
        """The array of `to_torch`, ``(T, K, U)``, as float32."""
        trials = len(self.stimulus)
        last = round(self.t_stop_ms / self.dt_ms)
        dense = np.zeros((last + 1, trials, len(self.unit)), dtype=np.float32)
        for k in range(trials):
            unit, step = self._steps(k)
            dense[step, k, unit] = 1.0
        return dense

    def _steps(self, trial: int) -> tuple[IntArray, IntArray]:
        """Unit and time step of each spike of a trial."""
        first, end = trial * len(self.unit), (trial + 1) * len(self.unit)
        counts = np.diff(self.start[first : end + 1])
        time_ms = self.time_ms[self.start[first] : self.start[end]]
        return np.repeat(np.arange(counts.size), counts), np.rint(time_ms / self.dt_ms).astype(int)


class Format(NamedTuple):
    """A format of ``--export``: file suffix, function that writes it, library that it needs."""

    suffix: str
    write: Callable[..., None]
    library: str


FORMATS: Mapping[str, Format] = {
    "npz": Format(".npz", Recording._write_npz, "numpy"),
    "mat": Format(".mat", Recording._write_mat, "scipy"),
    "nwb": Format(".nwb", Recording._write_nwb, "pynwb"),
    "neo": Format(".pkl", Recording._write_neo, "neo"),
    "sonata": Format(".h5", Recording._write_sonata, "h5py"),
    "events": Format(".npy", Recording._write_events, "numpy"),
    "aedat4": Format(".aedat4", Recording._write_aedat4, "numpy"),
}
EVENT_SUFFIXES = (".npy", ".aedat4")
EXPORTED = tuple(f"spikes{entry.suffix}" for entry in FORMATS.values())
"""Files of ``--export``."""


def require_libraries(formats: Sequence[str]) -> None:
    """Check that the libraries of `formats` are installed.

    Raises MissingError: a library is not installed.
    """
    for name in formats:
        with _require_library(name):
            import_module(FORMATS[name].library)


def exports(
    recording: Recording, formats: Sequence[str], event_grid_mm: float | None = None
) -> dict[str, Callable[[Path], Path]]:
    """File names ``spikes.*`` of `formats`, each with the function that writes it to a path."""
    suffixes = [FORMATS[name].suffix for name in formats]
    on_grid = partial(recording.write, event_grid_mm=event_grid_mm)
    return {
        f"spikes{suffix}": on_grid if suffix in EVENT_SUFFIXES else recording.write
        for suffix in suffixes
    }


@contextmanager
def _require_library(name: str) -> "Iterator[None]":
    try:
        yield
    except ImportError as error:
        line = f"'fembridge[{name}]'" if name in FORMATS else name
        raise MissingError(f"{error}: install {name} first, pip install {line}") from error


def _hdf5_in_memory(path: Path) -> "h5py.File":
    """An open HDF5 file in memory, to be copied to `path`.

    On a full disk HDF5 prints its error stack and may crash.
    """
    import h5py

    return h5py.File(path.name, "w", driver="core", backing_store=False)


def _copy_to_disk(file: "h5py.File", path: Path) -> None:
    """Write an open HDF5 file of `_hdf5_in_memory` to `path`."""
    file.flush()
    path.write_bytes(file.id.get_file_image())


def _sorted_spikes(row: IntArray, time_ms: FloatArray, count: int) -> dict[str, Any]:
    """Spike times sorted by `row` and time, and the start index of each of `count` rows."""
    start = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=count))])
    return {"time_ms": time_ms[np.lexsort((time_ms, row))], "start": start.astype(np.int64)}
