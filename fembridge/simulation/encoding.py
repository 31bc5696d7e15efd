"""Spikes and firing rates of stress traces from a table, a simulation or a run folder.

Traces may have any number of units and any even step. The run that they belong to
(`fembridge.trace.Origin`) gives the default parameters and the window in which spikes count.
"""

import logging
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from decks.stimuli import resolve
from fembridge.errors import ResultError, StimulusError, TraceError, UsageError, warn
from fembridge.host.store import (
    filling,
    read_toml,
    replacing,
    sha256_of,
    structure,
    unstructure,
    write_toml,
)
from fembridge.io.column_units import ms_per
from fembridge.io.npz import NpzFile
from fembridge.io.run_folder import RUN_FILE, RunFolder
from fembridge.io.sensor_table import SensorTable, deaf_above, sensor_table
from fembridge.io.spike_table import (
    Rate,
    SpikeTrain,
    rates_frame,
    read_spikes,
    spikes_frame,
    write_rates,
    write_spikes,
)
from fembridge.io.trace_table import read_traces
from fembridge.plots.shown import Shown
from fembridge.response.response_map import reading_energy
from fembridge.results import read
from fembridge.simulation.folder import (
    RASTER_FILE,
    RATES_FILE,
    SPIKES_FILE,
    TRACES_FILE,
    find_file,
    read_arrays,
    stimuli_in,
)
from fembridge.simulation.simulation import Simulation
from fembridge.simulation.spikes import encode_traces, spike_trains
from fembridge.solver.mechanics import check_mechanics, fit_mismatch
from fembridge.trace import (
    Origin,
    StressTrace,
    Traces,
    check_growth,
    doubt_of_step,
    resample,
    stacked,
)
from fembridge.typing import FloatArray, Table
from fembridge.version import __version__
from neural import Parameters, ParameterSet, mean_rate_ips, parameter_set
from neural.parameters import DT_MS
from neural.time_step import STEP_TOLERANCE, fits_step

if TYPE_CHECKING:
    import matplotlib.figure
    import pandas

    from fembridge.io.recording import Recording
    from fembridge.plots.style import Panels
    from fembridge.simulation.calibrate import Calibration

_LOGGER = logging.getLogger(__name__)

# Typical stress of each class under a 1 mm probe; a stress that differs by more than this
# factor has another unit.
_TYPICAL_PA = {"SA": 3e4, "RA": 3e4, "PC": 1e3}
_UNIT_FACTOR = 300.0
_MAX_PA = 1.0e30  # beyond, sums in the equations of an afferent may be infinite
_MAX_ROWS = 60  # largest number of units with a row each in the raster
_EXPECTED = (
    "a path, a RunFolder, a Simulation, a DataFrame time_ms,afferent,node,von_mises_pa, a "
    "StressTrace, or a list of StressTrace"
)

STRESS_FILE, RECORD_FILE = "stress.npz", "encoding.toml"
_TEXT_ARRAYS = ("stimulus", "afferent", "unit")
_TRACE_ARRAYS = ("node", *_TEXT_ARRAYS, "dt_ms", "start_ms")
"""Arrays of `STRESS_FILE` with a value per trace: fields of `StressTrace`."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Encoding(Shown):
    """Spikes and firing rates of stress traces, the result of `encode`.

    Parameters
    ----------
    traces
        The traces that were encoded, with class, stimulus and the step of `parameters`, and
        their run.
    parameters
        The parameter set.
    cells_ms
        Spike times in ms of each cell of each trace, ``(spikes,)`` each.
    window_ms
        Requested start and end in ms of the window in which spikes count. Default: None, that
        of the run or of the stimulus, else the whole trace.
    stimulus
        Requested name of the stimulus. Default: None.
    derivative
        Scheme of the stress derivatives. Default: ``backward``.

    Examples
    --------
    >>> import fembridge as fb
    >>> encoding = fb.encode(fb.read(fb.sample("frd")))
    >>> encoding.rates["rate_ips"].tolist()
    [41.0, 108.0, 110.0]
    >>> encoding.write("encoded")
    >>> fb.Encoding.read("encoded").spikes.equals(encoding.spikes)
    True
    """

    traces: Traces
    parameters: ParameterSet
    cells_ms: list[list[FloatArray]]
    window_ms: tuple[float, float] | None = None
    stimulus: str | None = None
    derivative: str = "backward"

    def _lines(self) -> list[str]:
        spikes = sum(times_ms.size for cells in self.cells_ms for times_ms in cells)
        classes = ", ".join(dict.fromkeys(str(trace.afferent) for trace in self.traces))
        return [
            f"Encoding of {len(self.traces)} stress traces of {classes}",
            f"  parameters {self.parameters.name}, {spikes} spikes",
            "  .rates, .spikes, .traces, .plot(), .write(folder)",
        ]

    @property
    def provenance(self) -> dict[str, object]:
        """Version, run of the traces, parameters, options, and checksum of each trace."""
        return {
            **self._record(),
            "traces": [
                {
                    "stimulus": trace.stimulus,
                    "afferent": trace.afferent,
                    "unit": trace.unit,
                    "node": trace.node,
                    "sha256": sha256(trace.stress_pa.tobytes()).hexdigest(),
                }
                for trace in self.traces
            ],
        }

    def _record(self) -> Table:
        """Version, run of the traces, parameters and options, as tables of TOML."""
        origin = self.traces.origin
        options = {
            "stimulus": self.stimulus,
            "window_ms": None
            if self.window_ms is None
            else [float(time_ms) for time_ms in self.window_ms],
        }
        return {
            "fembridge": __version__,
            "derivative": self.derivative,
            **{name: value for name, value in options.items() if value is not None},
            "windows_ms": {name: list(window) for name, window in self.traces.windows_ms.items()},
            "parameters": self.parameters.to_table(),
            **({} if origin is None else {"run": unstructure(origin)}),
        }

    @property
    def windows_ms(self) -> list[tuple[float, float]]:
        """Window in ms in which the spikes of each trace count.

        The requested window, else that of the run or of the catalogue stimulus `stimulus`,
        else the whole trace.

        Raises
        ------
        UsageError
            A trace does not cover its window.
        """
        return [
            _resolve_window_ms(trace, self.window_ms, self.stimulus, self.traces)
            for trace in self.traces
        ]

    @property
    def trains(self) -> list[SpikeTrain]:
        """One train for each cell, trace after trace."""
        return [
            train
            for trace, cells_ms in zip(self.traces, self.cells_ms, strict=True)
            for train in spike_trains(trace.stimulus, str(trace.afferent), cells_ms, trace.unit)
        ]

    @property
    def mean_rates(self) -> list[Rate]:
        """Firing rate of each trace in its window, the mean over its cells."""
        return [
            Rate(
                trace.stimulus,
                str(trace.afferent),
                mean_rate_ips(cells_ms, window_ms),
                trace.unit,
            )
            for trace, cells_ms, window_ms in zip(
                self.traces, self.cells_ms, self.windows_ms, strict=True
            )
        ]

    @property
    def spikes(self) -> "pandas.DataFrame":
        """Spikes, one row each: the table ``spikes.csv`` of `fembridge encode`."""
        return spikes_frame(self.trains)

    @property
    def rates(self) -> "pandas.DataFrame":
        """Firing rates in impulses/s, one row a trace: ``stimulus, afferent[, unit], rate_ips``."""
        return rates_frame(self.mean_rates)

    @property
    def span_ms(self) -> tuple[float, float]:
        """First and last time in ms of all traces."""
        starts_ms = [trace.start_ms for trace in self.traces]
        return min(starts_ms), max(float(trace.times_ms[-1]) for trace in self.traces)

    def plot(
        self, kind: str | None = None, ax: "Panels | None" = None
    ) -> "matplotlib.figure.Figure":
        """Picture of the spikes, a panel for each class.

        Parameters
        ----------
        kind
            ``raster``, ``psth`` or ``isi``. Default: None, ``raster``.
        ax
            Axes to draw into, one per panel. Default: None, a new figure.

        Raises
        ------
        UsageError
            An unknown kind, or another number of axes than panels.
        """
        from fembridge.plots.spike_figures import isi_figure, psth_figure, raster_figure

        trains = _raster_rows(self.trains)
        if kind == "isi":
            return isi_figure(trains, axes=ax)
        if kind not in (None, "raster", "psth"):
            raise UsageError(argument="kind", found=kind, expected="raster, psth or isi")
        common_ms = set(self.windows_ms).pop() if len(set(self.windows_ms)) == 1 else None
        window_ms = None if common_ms == self.span_ms else common_ms
        if kind == "psth":
            return psth_figure(trains, window_ms=window_ms, axes=ax)
        return raster_figure(trains, span_ms=self.span_ms, window_ms=window_ms, axes=ax)

    def to_recording(self) -> "Recording":
        """Recording for other programs."""
        from fembridge.io.recording import Recording

        nodes = {(str(trace.afferent), trace.unit): trace.node for trace in self.traces}
        return Recording.from_trains(self.trains, self.traces[0].dt_ms, self.span_ms[1], nodes)

    def write(
        self,
        folder: str | os.PathLike[str],
        *,
        plot: bool = False,
        more: Mapping[str, Callable[[Path], object]] | None = None,
    ) -> None:
        """Write ``rates.csv``, ``spikes.csv``, ``stress.npz`` and ``encoding.toml``.

        The NPZ has ``stimulus``, ``afferent``, ``unit``, ``node``, ``dt_ms`` and ``start_ms``
        of each trace, ``(N,)``, and ``von_mises_pa`` ``(N, T)``, NaN after the end of a shorter
        trace. All files are replaced, or none; `read` reads them.

        Parameters
        ----------
        folder
            Folder of the files, which is made.
        plot
            Whether to draw ``raster.png``. Default: False.
        more
            Functions that write further files, by name. Default: None.

        Raises
        ------
        OutputError
            The folder cannot be written.
        """
        with filling(Path(folder), last=RECORD_FILE) as draft:
            self._write_stress(draft / STRESS_FILE)
            write_spikes(draft / SPIKES_FILE, self.trains)
            if plot:
                from fembridge.plots.style import save_figure

                save_figure(self.plot(), draft / RASTER_FILE)
            for name, write in (more or {}).items():
                write(draft / name)
            write_rates(draft / RATES_FILE, self.mean_rates)
            checksums = {
                f"{Path(name).stem}_sha256": sha256_of(draft / name)
                for name in (STRESS_FILE, SPIKES_FILE)
            }
            write_toml(draft / RECORD_FILE, {**checksums, **self._record()})

    def _write_stress(self, path: Path) -> None:
        arrays: dict[str, Any] = {
            name: [getattr(trace, name) for trace in self.traces] for name in _TRACE_ARRAYS
        }
        arrays["von_mises_pa"] = stacked([trace.stress_pa for trace in self.traces])
        with replacing(path) as draft, draft.open("wb") as file:
            np.savez_compressed(file, **arrays)

    @classmethod
    def read(cls, folder: str | os.PathLike[str]) -> "Encoding":
        """The encoding that `write` or ``fembridge encode`` wrote.

        Parameters
        ----------
        folder
            Folder with ``encoding.toml``, ``stress.npz`` and ``spikes.csv``.

        Raises
        ------
        ResultError, TableError, ParameterError
            A file is absent, cut short, changed or of another kind.

        Examples
        --------
        >>> import fembridge as fb
        >>> encoding = fb.encode(fb.simulate("sine_20_250", stored=True))
        >>> encoding.write("encoded")
        >>> fb.Encoding.read("encoded").spikes.equals(encoding.spikes)
        True
        """
        path = Path(folder) / RECORD_FILE
        failed = ResultError.at(path)
        record = structure(read_toml(path, failed), _Record, failed)
        for name, stated in (
            (STRESS_FILE, record.stress_sha256),
            (SPIKES_FILE, record.spikes_sha256),
        ):
            if not path.with_name(name).is_file():
                raise ResultError(f"no {name} in this folder", path.parent, expected=name)
            if (sha256 := sha256_of(path.with_name(name))) != stated:
                raise ResultError(
                    f"another file than the one that {RECORD_FILE} describes",
                    path.with_name(name),
                    found=sha256,
                    expected=stated,
                )
        parameters = ParameterSet.from_table(record.parameters, path.stem, str(path))
        traces = Traces(_read_stress(path.with_name(STRESS_FILE)), record.run, record.windows_ms)
        times_ms = {
            (train.stimulus, train.afferent, train.unit, train.cell): train.times_ms
            for train in read_spikes(path.with_name(SPIKES_FILE))
        }
        cells_ms = []
        for trace in traces:
            afferent = str(trace.afferent)
            if afferent not in parameters.parameters:
                raise failed(f"no parameters of {afferent}")
            silent = spike_trains(
                trace.stimulus,
                afferent,
                [np.zeros(0)] * parameters.parameters[afferent].cells,
                trace.unit,
            )
            cells_ms.append(
                [
                    times_ms.get((train.stimulus, afferent, train.unit, train.cell), train.times_ms)
                    for train in silent
                ]
            )
        return cls(
            traces, parameters, cells_ms, record.window_ms, record.stimulus, record.derivative
        )


@dataclass(frozen=True, slots=True)
class _Record:
    """Content of `RECORD_FILE`."""

    fembridge: str
    stress_sha256: str
    spikes_sha256: str
    derivative: str
    parameters: Table
    windows_ms: dict[str, tuple[float, float]]
    window_ms: tuple[float, float] | None = None
    stimulus: str | None = None
    run: Origin | None = None


def _read_stress(path: Path) -> Traces:
    """Traces of an NPZ that `Encoding.write` wrote."""
    failed = ResultError.at(path)
    with NpzFile(path, failed) as archive:
        if missing := [n for n in (*_TRACE_ARRAYS, "von_mises_pa") if n not in archive.headers]:
            raise failed(f"no array {missing[0]}")
        stress_pa = archive.read_reals("von_mises_pa")
        columns = [
            archive.read_texts(name) if name in _TEXT_ARRAYS else archive.read_reals(name).tolist()
            for name in _TRACE_ARRAYS
        ]
    try:
        return Traces(
            StressTrace(
                row_pa[: np.count_nonzero(~np.isnan(row_pa))],
                node=int(node),
                **dict(zip(_TRACE_ARRAYS[1:], values, strict=True)),
            )
            for row_pa, node, *values in zip(stress_pa, *columns, strict=True)
        )
    except (TraceError, TypeError, ValueError) as error:
        raise failed(f"not the stress of an encoding: {error}") from error


def encode_stress(
    traces: object,
    parameters: ParameterSet | None,
    stimulus: str | None,
    default_name: str,
    afferents: str | Sequence[str] | None,
    window_ms: tuple[float, float] | None,
    derivative: str,
    columns: Mapping[str, str | Sequence[str]] | None,
    gain_pa: float | Mapping[str, float] | None,
    calibration: "str | os.PathLike[str] | Calibration | None",
    resample_ms: float | None,
) -> Encoding:
    """Spikes and rates of `traces`; arguments and errors are those of `fembridge.encode`."""
    if isinstance(afferents, str):
        afferents = [afferents]
    gains = _gains(gain_pa, calibration)
    source, sensor = _load_traces(traces, columns, gain_pa, gains, resample_ms)
    if gains is not None:
        source = gains.to_stress(source, sensor.value_names if sensor else [], afferents)
        parameters = parameters or (parameter_set(gains.parameters) if gains.parameters else None)
    selected = _select_parameters(source, parameters)
    prepared = _prepare_traces(source, selected.parameters, stimulus, default_name, afferents)
    if window_ms is not None:
        for trace in prepared:
            _resolve_window_ms(trace, window_ms, stimulus, source)
    cells_ms = encode_traces(prepared, selected.parameters, derivative)
    has_spikes = any(times_ms.size for cells in cells_ms for times_ms in cells)
    if warning := _stress_warning(source, prepared, has_spikes):
        warn(warning)
    has_pc = any(trace.afferent == "PC" for trace in prepared)
    if has_pc and sensor and sensor.step_ms and (loss := deaf_above(sensor.step_ms)):
        warn(loss)
    _report_mismatch(source, selected)
    encoded = Traces(prepared, source.origin, source.windows_ms)
    return Encoding(encoded, selected, cells_ms, window_ms, stimulus, derivative)


def _gains(
    gain_pa: float | Mapping[str, float] | None,
    calibration: "str | os.PathLike[str] | Calibration | None",
) -> "Calibration | None":
    """Gains by class; None for one gain of all classes, or none."""
    from fembridge.simulation.calibrate import Calibration

    if calibration is None:
        return Calibration(gain_pa=gain_pa) if isinstance(gain_pa, Mapping) else None
    if gain_pa is not None:
        raise UsageError("has a gain already: leave out gain_pa", argument="calibration")
    return (
        Calibration.read(calibration) if not isinstance(calibration, Calibration) else calibration
    )


def _load_traces(
    traces: object,
    columns: Mapping[str, str | Sequence[str]] | None,
    gain_pa: float | Mapping[str, float] | None,
    gains: "Calibration | None",
    resample_ms: float | None,
) -> tuple[Traces, SensorTable | None]:
    """The traces of a path, a run, a simulation, a table, a trace or a list of traces.

    And the columns of a table that is not ours. With `gains` the stress is the sensor's value.
    """
    if isinstance(traces, RunFolder):
        traces = traces.folder
    factor = 1.0 if gains is not None else gain_pa
    assert not isinstance(factor, Mapping)
    if isinstance(traces, str | os.PathLike) or hasattr(traces, "columns"):
        table: Any = Path(traces) if isinstance(traces, str | os.PathLike) else traces
        is_table = not isinstance(table, Path) or (
            table.is_file() and table.suffix != ".npz" and table.name != RUN_FILE
        )
        sensor = None
        if is_table:
            sensor = sensor_table(table, columns, has_gain=factor is not None)
        if sensor is not None and columns is None:
            name = table if isinstance(table, Path) else "the table"
            [(key, time), *_] = sensor.columns.items()
            assumed: list[str] = []
            ms_per(str(time), key == "time_ms", assumed.append)
            unit = f" (taken as s; time_ms={time} takes it as ms)" if assumed else ""
            values = ", ".join(sensor.value_names)
            _LOGGER.info(
                f"{name}: time in {time}{unit}, values in {values}; --columns names others"
            )
        chosen = columns if sensor is None else sensor.columns
        options: dict[str, Any] = {"columns": chosen, "resample_ms": resample_ms}
        options |= {"gain_pa": factor}
        if isinstance(table, Path):
            return read_stress(table, **options, is_sensor=sensor is not None)[0], sensor
        return read_traces(table, **options, is_sensor=sensor is not None), sensor
    if isinstance(traces, Simulation):
        traces = traces.to_traces()
    items = [traces] if isinstance(traces, StressTrace) else traces
    if not isinstance(items, Sequence) or not items:
        raise UsageError(argument="traces", found=traces, expected=_EXPECTED)
    for item in items:
        if not isinstance(item, StressTrace):
            raise UsageError(
                f"has a {type(item).__name__}, expected {_EXPECTED}",
                argument="traces",
                found=item,
                expected=_EXPECTED,
            )
    options = {"columns": columns, "gain_pa": factor, "resample_ms": resample_ms}
    for name, option in options.items():
        if option is not None:
            raise UsageError("is for a table of traces only", argument=name)
    return (items if isinstance(items, Traces) else Traces(items)), None


def read_stress(
    source: Path,
    columns: Mapping[str, str | Sequence[str]] | None = None,
    gain_pa: float | None = None,
    resample_ms: float | None = None,
    is_sensor: bool = False,
) -> tuple[Traces, Path]:
    """Traces of a table, a simulation or a run folder, with their run; and the file.

    The options are those of `fembridge.io.trace_table.read_traces`, for a table. Traces of a
    simulation name their stimulus.

    Raises
    ------
    ResultError, TableError
        A file that is absent, cut short or of another kind.
    """
    made_by = "simulate and run leave stress in a folder, `ingest -o traces.csv` in a table"
    path = find_file(source, (TRACES_FILE, "traces.csv", RUN_FILE), made_by)
    if path.suffix != ".npz" and path.name != RUN_FILE:
        traces = read_traces(
            path,
            columns=columns,
            gain_pa=gain_pa,
            resample_ms=resample_ms,
            is_sensor=is_sensor,
        )
        return traces, path
    for name, option in (("columns", columns), ("gain_pa", gain_pa), ("resample_ms", resample_ms)):
        if option is not None:
            raise UsageError("is for a table of traces only", path, argument=name)
    if path.name == RUN_FILE:
        return read(path.parent), path
    stored_traces = stimuli_in(path.parent).traces if path.name == TRACES_FILE else None
    return stored_traces or read_arrays(path)[1], path


def _select_parameters(traces: Traces, parameters: ParameterSet | None) -> ParameterSet:
    """The requested set, else that of the run of `traces`, else ``fitted``."""
    origin = traces.origin
    if parameters is not None:
        return parameters
    if origin and origin.parameters:
        return ParameterSet.from_table(origin.parameters, origin.stimulus, "the run of the traces")
    return parameter_set("fitted")


def _report_mismatch(traces: Traces, selected: ParameterSet) -> None:
    """Report that `selected` was fitted on other mechanics than those of `traces`."""
    origin = traces.origin
    # In an unknown run, a trace that starts without stress had no pre-indentation.
    is_pressed = any(trace.stress_pa[0] > 0 for trace in traces)
    depths_um = {origin.preindent_um} if origin else set() if is_pressed else {0.0}
    if origin:
        check_mechanics(selected, origin.finger, depths_um)
    elif mismatch := fit_mismatch(selected, {}, depths_um):
        _LOGGER.info(mismatch)  # unknown mechanics contradict nothing


def _prepare_traces(
    traces: Traces,
    parameters: Parameters,
    stimulus: str | None,
    default_name: str,
    afferents: Sequence[str] | None,
) -> list[StressTrace]:
    """Each trace with its class, its stimulus and, if its class has several, its unit.

    `afferents` are the classes to keep, and the classes of a trace without one. `stimulus`
    selects one of several, or names the traces without a name (None: that of their run, else
    `default_name`). Traces whose step does not fit that of the parameters are resampled by PCHIP.
    """
    name = stimulus or (traces.origin.stimulus if traces.origin else default_name)
    stimulus_ids = dict.fromkeys(trace.stimulus or name for trace in traces)
    if stimulus is not None and stimulus not in stimulus_ids:
        raise UsageError(
            argument="stimulus",
            found=stimulus,
            expected=f"one of {', '.join(stimulus_ids)[:80]}",
        )
    classes = [
        (trace, afferent)
        for trace in traces
        if stimulus is None or (trace.stimulus or name) == stimulus
        for afferent in ([trace.afferent] if trace.afferent else afferents or parameters)
        if not afferents or afferent in afferents
    ]
    if not afferents and any(not trace.afferent for trace in traces):
        names = ", ".join(parameters)
        _LOGGER.info(f"no class of an afferent is named: encoded as {names}; --afferent selects")
    if not classes:
        expected = " or ".join(dict.fromkeys(str(trace.afferent) for trace in traces))
        raise UsageError(argument="afferents", found=afferents, expected=expected or "a trace")
    lengths = [
        (trace.stress_pa.size, int(trace.stress_pa.size * trace.dt_ms / parameters[afferent].dt_ms))
        for trace, afferent in classes
        if afferent in parameters
    ]
    check_growth(
        sum(before for before, _ in lengths),
        sum(after for _, after in lengths),
        max((after for _, after in lengths), default=0),
    )
    keys = [(trace.stimulus or name, afferent, trace.unit) for trace, afferent in classes]
    has_unique_keys = len(set(keys)) == len(keys)
    prepared: list[StressTrace] = []
    used_keys: set[tuple[str, str, str]] = set()
    other_steps: dict[tuple[float, float], list[str | None]] = {}
    for trace, afferent in classes:
        if afferent not in parameters:
            trace_name = trace.unit or (f"node {trace.node}" if trace.node else "the trace")
            expected = " or ".join(parameters)
            raise UsageError(
                f"{trace_name} is of class {afferent}, expected {expected}: "
                "set --afferent (afferents)",
                found=afferent,
                expected=expected,
            )
        if reading_energy({afferent: parameters[afferent]}):
            raise UsageError(
                f"has the drive {parameters[afferent].drive!r} of {afferent}, which reads strain "
                "energy; traces are von Mises stress: use simulate",
                argument="parameters",
                found=parameters[afferent].drive,
                expected="drives that read von Mises stress",
            )
        unit = (
            trace.unit if has_unique_keys else " ".join(filter(None, (trace.unit, str(trace.node))))
        )
        key = (trace.stimulus or name, afferent, unit)
        if key in used_keys:
            raise UsageError(
                f"has two of {' '.join(filter(None, key))}: a column unit distinguishes them",
                argument="traces",
                found=key,
            )
        used_keys.add(key)
        step_ms, stress_pa, dt_ms = parameters[afferent].dt_ms, trace.stress_pa, trace.dt_ms
        if (peak_pa := float(np.abs(stress_pa).max())) > _MAX_PA:
            raise TraceError(
                f"{' '.join(filter(None, key))} peaks at {peak_pa:g} Pa, expected at most "
                f"{_MAX_PA:g}: its unit (--gain-pa, gain_pa) or a number is wrong",
                found=peak_pa,
                expected=f"at most {_MAX_PA:g} Pa",
            )
        fits = fits_step(parameters[afferent], dt_ms)
        # Between samples of 0.5 ms, the step of the paper, the encoder interpolates well.
        is_fine = fits and step_ms < dt_ms <= DT_MS
        if abs(dt_ms - step_ms) > STEP_TOLERANCE * step_ms and not is_fine:
            warning = doubt_of_step(stress_pa, dt_ms, step_ms)
            other_steps.setdefault((dt_ms, step_ms), []).append(warning)
            if not fits:
                _, stress_pa = resample(trace.times_ms, stress_pa, step_ms)
                dt_ms = step_ms
        prepared.append(
            StressTrace(stress_pa, dt_ms, trace.node, afferent, trace.start_ms, unit, key[0])
        )
    for (dt_ms, step_ms), step_warnings in other_steps.items():
        subject = f"{len(step_warnings)} traces have" if len(step_warnings) > 1 else "the trace has"
        line = f"{subject} a sample every {dt_ms:g} ms: resampled to every {step_ms:g} ms"
        if warning := next(filter(None, step_warnings), None):
            warn(f"{line}; {warning}")
        else:
            _LOGGER.info(line)
    return prepared


def _resolve_window_ms(
    trace: StressTrace, requested: tuple[float, float] | None, stimulus: str | None, source: Traces
) -> tuple[float, float]:
    """The requested window, else that of the run or of the catalogue, else the whole trace."""
    first_ms, last_ms = float(trace.times_ms[0]), float(trace.times_ms[-1])
    slack_ms = 1e-3 * trace.dt_ms
    run_window_ms = source.windows_ms.get(trace.stimulus)
    if run_window_ms is None and source.origin is not None:  # renamed
        run_window_ms = source.origin.window_ms
    elif run_window_ms is None and stimulus is not None:
        with suppress(StimulusError, ValueError):
            [entry] = resolve(stimulus)
            run_window_ms = entry.window_ms if entry.window_ms[1] <= last_ms + slack_ms else None
    if requested is not None and np.shape(requested) != (2,):
        raise UsageError(argument="window_ms", found=requested, expected="(start, end) in ms")
    start_ms, end_ms = requested or run_window_ms or (first_ms, last_ms)
    # The first sample may be one increment after the start of the stimulus.
    if not (first_ms - trace.dt_ms - slack_ms <= start_ms < end_ms <= last_ms + slack_ms):
        raise UsageError(
            f"is {start_ms:g} to {end_ms:g} ms, expected start < end inside "
            f"{first_ms:g} to {last_ms:g} ms, the {trace.afferent} trace",
            argument="window_ms",
            found=(start_ms, end_ms),
            expected=f"start < end inside {first_ms:g} to {last_ms:g} ms",
        )
    return start_ms, end_ms


def _stress_warning(source: Traces, traces: Sequence[StressTrace], has_spikes: bool) -> str | None:
    """Warning of stress unlike that of skin, or of traces without spikes; None for neither."""
    peaks_pa = [float(np.abs(trace.stress_pa).max()) for trace in traces]
    shares = [
        peak_pa / _TYPICAL_PA[str(trace.afferent)]
        for peak_pa, trace in zip(peaks_pa, traces, strict=True)
    ]
    strongest = int(np.argmax(shares))
    trace, share = traces[strongest], shares[strongest]
    is_plausible = 1 / _UNIT_FACTOR < share < _UNIT_FACTOR
    if is_plausible and has_spikes:
        return None
    if not share:
        return "no spikes: all stress is 0"
    line = (
        f"the strongest trace ({trace.afferent}) peaks at {peaks_pa[strongest]:.3g} Pa, where a "
        f"probe 250 um deep gives about {_TYPICAL_PA[str(trace.afferent)]:g} Pa"
    )
    if is_plausible:
        return f"no spikes: {line}: too weak, too short or too slow for these parameters?"
    if source.origin is not None:  # the unit of a run is known
        return f"{line}: too weak, too deep, or another position?"
    power = 3 * round(-np.log10(share) / 3)
    return f"{line}: another unit? --gain-pa 1e{power} (gain_pa) converts it"


def _raster_rows(trains: Sequence[SpikeTrain]) -> Sequence[SpikeTrain]:
    """Trains named after their row in a raster: each unit has a row if they are few."""
    rows = [" ".join(filter(None, (train.stimulus, train.unit))) for train in trains]
    if not any(train.unit for train in trains) or len(set(rows)) > _MAX_ROWS:
        return trains
    if len({train.stimulus for train in trains}) == 1:
        rows = [train.unit for train in trains]
    return [replace(train, stimulus=row) for train, row in zip(trains, rows, strict=True)]
