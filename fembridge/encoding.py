"""Stress traces that anyone has, read, made ready for afferents, and encoded.

From a table, a simulation or a run folder; of any number of units, in any step. What is
known of their run (`fembridge.trace.Origin`) says by which parameters, and where spikes
count.
"""

import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from decks.stimuli import resolve
from fembridge.errors import FembridgeWarning, StimulusError, TraceError, UsageError
from fembridge.response.response_map import reading_energy
from fembridge.results import read
from fembridge.run_folder import RUN_FILE
from fembridge.simulation import (
    TRACES_FILE,
    arrays_in,
    find_file,
    fired,
    stimuli_in,
    trains_of,
    unlike_the_fit,
)
from fembridge.tables import SpikeTrain, read_traces
from fembridge.trace import StressTrace, Traces, check_growth, doubt_of_step, resample
from fembridge.typing import FloatArray
from neural import Parameters, ParameterSet, parameter_set

if TYPE_CHECKING:
    import pandas

# What a 1 mm probe gives where each class sits; beyond so many times less or more, the
# stress is in another unit.
_TYPICAL_PA = {"SA": 3e4, "RA": 3e4, "PC": 1e3}
_FAR = 300.0
_SAME_STEP = 1.0e-4
_MOST_PA = 1.0e30  # from here on sums of an afferent's equations may be infinite


@dataclass(frozen=True, slots=True, eq=False)
class Encoded:
    """Spikes of `traces` by `parameters`: `cells_ms` has the times of each cell of each trace.

    `source` is what was read, `traces` are those of it that were encoded, with class, stimulus
    and the step of the parameters.
    """

    source: Traces
    traces: list[StressTrace]
    parameters: ParameterSet
    cells_ms: list[list[FloatArray]]

    @property
    def trains(self) -> list[SpikeTrain]:
        """A train a cell, trace after trace."""
        return [
            train
            for trace, cells_ms in zip(self.traces, self.cells_ms, strict=True)
            for train in trains_of(trace.stimulus, str(trace.afferent), cells_ms, trace.unit)
        ]

    def windows_ms(
        self, asked: tuple[float, float] | None = None, stimulus: str | None = None
    ) -> list[tuple[float, float]]:
        """Where spikes of each trace count: as `asked`, else as its run or `stimulus` has it.

        Of a trace of no known run that is named after a stimulus of the catalogue, its own;
        else all of it.

        Raises
        ------
        UsageError
            A window that a trace does not cover.
        """
        return [_resolve_window_ms(trace, asked, stimulus, self.source) for trace in self.traces]


def encode(
    source: "str | Path | pandas.DataFrame | Sequence[StressTrace]",
    *,
    parameters: str | ParameterSet | None,
    derivative: str,
    stimulus: str | None,
    unnamed: str,
    afferents: Sequence[str] | None,
    columns: Mapping[str, str | Sequence[str]] | None,
    gain_pa: float | None,
    resample_ms: float | None,
    log: Callable[[str], None],
    note: Callable[[str], None],
) -> Encoded:
    """Spikes of `source`; arguments and errors as of `fembridge.encode`.

    A stimulus that nobody names is `unnamed`. `log` gets what was done to the traces, `note`
    what was otherwise in the fit of the parameters. Stress that no touch gives, or that drives
    no spikes, is a `FembridgeWarning`.
    """
    if parameters is not None:
        parameters = parameter_set(parameters)  # a wrong name is refused before anything is read
    if isinstance(source, str | Path):
        source_traces, _ = read_stress(Path(source), log, columns, gain_pa, resample_ms)
    elif isinstance(source, Sequence):
        if any(option is not None for option in (columns, gain_pa, resample_ms)):
            raise UsageError("columns, gain_pa and resample_ms are for a table of traces")
        source_traces = source if isinstance(source, Traces) else Traces(source)  # type: ignore[arg-type] # no str
    else:
        source_traces = read_traces(
            source, log, columns=columns, gain_pa=gain_pa, resample_ms=resample_ms
        )
    selected = _select_parameters(source_traces, parameters, note)
    traces = _prepare_traces(source_traces, selected.parameters, stimulus, unnamed, afferents, log)
    cells_ms = fired(traces, selected.parameters, derivative)
    has_spikes = any(times_ms.size for cells in cells_ms for times_ms in cells)
    if warning := _stress_warning(source_traces, traces, has_spikes):
        warnings.warn(warning, FembridgeWarning, stacklevel=3)
    return Encoded(source_traces, traces, selected, cells_ms)


def read_stress(
    place: Path,
    log: Callable[[str], None],
    columns: Mapping[str, str | Sequence[str]] | None = None,
    gain_pa: float | None = None,
    resample_ms: float | None = None,
) -> tuple[Traces, Path]:
    """Traces of a table, of a simulation or of a run folder, what is known of their run; the file.

    Options are those of `fembridge.tables.read_traces`, for a table. Traces of a
    simulation name their stimulus.

    Raises
    ------
    ResultError, TableError
        A file that is absent, cut short or of another kind.
    """
    made_by = "simulate and run leave stress in a folder, `ingest -o traces.csv` in a table"
    path = find_file(place, (TRACES_FILE, "traces.csv", RUN_FILE), made_by)
    if path.suffix != ".npz" and path.name != RUN_FILE:
        traces = read_traces(path, log, columns=columns, gain_pa=gain_pa, resample_ms=resample_ms)
        return traces, path
    if any(option is not None for option in (columns, gain_pa, resample_ms)):
        raise UsageError(f"{path}: columns, gain and resampling are for a table of traces")
    if path.name == RUN_FILE:
        return read(path.parent, log=log), path
    stored_traces = stimuli_in(path.parent).traces if path.name == TRACES_FILE else None
    return stored_traces or arrays_in(path)[1], path


def _select_parameters(
    traces: Traces, parameters: str | ParameterSet | None, note: Callable[[str], None]
) -> ParameterSet:
    """The set that `traces` are encoded by: as asked, else that of their run."""
    origin = traces.origin
    if parameters is None and origin and origin.parameters:
        selected = ParameterSet.from_table(
            origin.parameters, origin.stimulus, "the run of the traces"
        )
    else:
        selected = parameter_set("fitted" if parameters is None else parameters)
    # Of an unknown run: what starts without stress was not pre-indented.
    is_pressed = any(trace.stress_pa[0] > 0 for trace in traces)
    depths_um = {origin.preindent_um} if origin else set() if is_pressed else {0.0}
    if difference := unlike_the_fit(selected, origin.finger if origin else {}, depths_um):
        note(difference)
    return selected


def _prepare_traces(
    traces: Traces,
    parameters: Parameters,
    stimulus: str | None,
    unnamed: str,
    afferents: Sequence[str] | None,
    log: Callable[[str], None],
) -> list[StressTrace]:
    """Each trace with class, stimulus and, where a class has several, a unit of its own.

    `afferents` are the classes to keep, and those that a trace without one is taken for.
    `stimulus` is which of several, or what a trace is called that names none (None: as its
    run, else `unnamed`). Traces of another step than that of the parameters are put on
    theirs by PCHIP.
    """
    name = stimulus or (traces.origin.stimulus if traces.origin else unnamed)
    stimulus_ids = dict.fromkeys(trace.stimulus or name for trace in traces)
    if stimulus is not None and stimulus not in stimulus_ids:
        raise UsageError(
            f"no stimulus {stimulus!r}, expected one of {', '.join(stimulus_ids)[:80]}"
        )
    classes = [
        (trace, afferent)
        for trace in traces
        if stimulus is None or (trace.stimulus or name) == stimulus
        for afferent in ([trace.afferent] if trace.afferent else afferents or ["none"])
        if not afferents or afferent in afferents
    ]
    if not classes:
        raise UsageError(f"no trace of {' or '.join(afferents or ('any class',))}")
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
            raise UsageError(
                f"{trace_name} is of class {afferent}, expected {' or '.join(parameters)}: "
                "--afferent (afferents) says which"
            )
        if reading_energy({afferent: parameters[afferent]}):
            raise UsageError(
                f"model {parameters[afferent].drive!r} of {afferent} reads strain energy, traces "
                "hold von Mises stress: simulate takes it"
            )
        unit = (
            trace.unit if has_unique_keys else " ".join(filter(None, (trace.unit, str(trace.node))))
        )
        key = (trace.stimulus or name, afferent, unit)
        if key in used_keys:
            raise UsageError(
                f"two traces of {' '.join(filter(None, key))}: a column unit distinguishes them"
            )
        used_keys.add(key)
        step_ms, stress_pa = parameters[afferent].dt_ms, trace.stress_pa
        if (most_pa := float(np.abs(stress_pa).max())) > _MOST_PA:
            raise TraceError(
                f"{' '.join(filter(None, key))} peaks at {most_pa:g} Pa, expected at most "
                f"{_MOST_PA:g}: its unit (--gain-pa, gain_pa) or a number is wrong"
            )
        if abs(trace.dt_ms - step_ms) > _SAME_STEP * step_ms:
            _, stress_pa = resample(trace.times_ms, stress_pa, step_ms)
            steps = (trace.dt_ms, step_ms)
            warning = doubt_of_step(trace.stress_pa, *steps)
            other_steps.setdefault(steps, []).append(warning)
        prepared.append(
            StressTrace(stress_pa, step_ms, trace.node, afferent, trace.start_ms, unit, key[0])
        )
    for (dt_ms, step_ms), step_warnings in other_steps.items():
        subject = f"{len(step_warnings)} traces have" if len(step_warnings) > 1 else "the trace has"
        line = f"{subject} a sample every {dt_ms:g} ms: resampled to every {step_ms:g} ms"
        if warning := next(filter(None, step_warnings), None):
            warnings.warn(f"{line}; {warning}", FembridgeWarning, stacklevel=4)
        else:
            log(line)
    return prepared


def _resolve_window_ms(
    trace: StressTrace, requested: tuple[float, float] | None, stimulus: str | None, source: Traces
) -> tuple[float, float]:
    first_ms, last_ms = float(trace.times_ms[0]), float(trace.times_ms[-1])
    slack_ms = 1e-3 * trace.dt_ms
    run_window_ms = source.windows_ms.get(trace.stimulus)
    if run_window_ms is None and source.origin is not None:  # by another name
        run_window_ms = source.origin.window_ms
    elif run_window_ms is None and stimulus is not None:
        with suppress(StimulusError, ValueError):
            [entry] = resolve(stimulus)
            run_window_ms = entry.window_ms if entry.window_ms[1] <= last_ms + slack_ms else None
    start_ms, end_ms = requested or run_window_ms or (first_ms, last_ms)
    # The first sample may be one increment after the start of the stimulus.
    if not (first_ms - trace.dt_ms - slack_ms <= start_ms < end_ms <= last_ms + slack_ms):
        raise UsageError(
            f"window {start_ms:g} to {end_ms:g} ms, expected start < end inside "
            f"{first_ms:g} to {last_ms:g} ms, the {trace.afferent} trace"
        )
    return start_ms, end_ms


def _stress_warning(source: Traces, traces: Sequence[StressTrace], has_spikes: bool) -> str | None:
    """What may be wrong where stress is unlike that of skin, or nothing fires; None: no doubt."""
    peaks_pa = [float(np.abs(trace.stress_pa).max()) for trace in traces]
    shares = [
        peak_pa / _TYPICAL_PA[str(trace.afferent)]
        for peak_pa, trace in zip(peaks_pa, traces, strict=True)
    ]
    strongest = int(np.argmax(shares))
    trace, share = traces[strongest], shares[strongest]
    is_plausible = 1 / _FAR < share < _FAR
    if is_plausible and has_spikes:
        return None
    if not share:
        return "no spikes: all stress is 0"
    line = (
        f"the strongest trace ({trace.afferent}) peaks at {peaks_pa[strongest]:.3g} Pa, where a "
        f"probe 250 um deep gives some {_TYPICAL_PA[str(trace.afferent)]:g} Pa"
    )
    if is_plausible:
        return f"no spikes: {line}: too faint, too short or too slow for these parameters?"
    if source.origin is not None:  # of a run, whose unit is known
        return f"{line}: too faint, too deep, or of another place?"
    power = 3 * round(-np.log10(share) / 3)
    return f"{line}: in another unit? --gain-pa 1e{power} (gain_pa) takes it so"
