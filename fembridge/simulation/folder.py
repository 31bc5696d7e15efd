"""Files that `fembridge simulate` writes into a folder: how they are found and read."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from fembridge.errors import (
    FembridgeError,
    OutputError,
    ResultError,
    UsageError,
)
from fembridge.host.memory import check_memory
from fembridge.host.store import (
    near_hint,
    read_toml,
    sha256_of,
)
from fembridge.io.npz import ArrayHeader, NpzFile
from fembridge.io.run_folder import RUN_FILE, read_run_folder, read_waveform
from fembridge.io.spike_table import SpikeTrain
from fembridge.stimulus import Stimulus
from fembridge.trace import Origin, StressTrace, Traces, afferent_key, finger_id, model_id
from fembridge.typing import FloatArray, Table
from neural.parameter_sets import (
    SET_NAMES,
    parameter_set,
    parameters_to_table,
)

RATES_FILE = "rates.csv"
SPIKES_FILE = "spikes.csv"
TRACES_FILE = "traces.npz"
RECORD_FILE = "simulation.toml"
RASTER_FILE = "raster.png"
FINGER_FILE = "finger.toml"
_ARRAYS = ("stimulus", "afferent", "dt_ms", "displacement_um", "von_mises_pa")
_OPTIONAL_ARRAYS = ("node", "unit")  # of earlier versions; of one unit a class
_TRACE_BYTES = 1 << 10  # size of the objects of a trace, without its samples
_COPIES = 2  # copies of the samples in memory: those of the file and those of the traces
_MAX_DEPTH = 2  # levels of folders in which a file is searched
_MAX_NAMED = 3  # number of matches that an error lists


def check_finger(folder: Path, finger: Mapping[str, Any]) -> None:
    """Refuse to replace a ``finger.toml`` that the simulation in `folder` did not write.

    Earlier versions kept no checksum; their file has the bytes that this version writes.
    """
    import tomli_w

    path = folder / FINGER_FILE
    if not path.is_file() or has_finger(folder):
        return
    if path.read_bytes() != tomli_w.dumps(finger).encode():
        raise OutputError(
            "is your own finger, or was edited since the run, and would be replaced: choose "
            "another -o, or rename it",
            path,
        )


def has_finger(folder: Path) -> bool:
    """Whether `folder` has the finger file that its simulation wrote, unchanged."""
    try:
        response = read_toml(folder / RECORD_FILE, FembridgeError).get("response")
    except FembridgeError:
        return False
    path = folder / FINGER_FILE
    written = response.get("finger_file_sha256") if isinstance(response, dict) else None
    return path.is_file() and written == sha256_of(path)


def find_file(source: Path, names: Sequence[str], made_by: str) -> Path:
    """`source` itself, or, if it is a folder, the file in it with one of `names`.

    The first of `names` that exists; if none does, the only match in folders at most two
    levels below.

    Raises
    ------
    ResultError
        The folder has no such file; `made_by` names the verbs that write it.
    UsageError
        Several folders below have one.
    """
    if not source.is_dir():
        return source
    for name in names:
        if (source / name).is_file():
            return source / name
    for depth in range(1, _MAX_DEPTH + 1):
        subfolders = "*/" * depth
        matches = sorted(
            {
                path.parent: path for name in names for path in source.glob(subfolders + name)
            }.values()
        )
        if len(matches) == 1:
            return matches[0]
        if matches:
            listed = ", ".join(str(path) for path in matches[:_MAX_NAMED])
            ellipsis = ", ..." if len(matches) > _MAX_NAMED else ""
            raise UsageError(
                f"{len(matches)} folders in it have one, name it: {listed}{ellipsis}", source
            )
    raise ResultError(f"no {' or '.join(names)} in this folder: {made_by}", source)


@dataclass(frozen=True, slots=True, eq=False)
class FolderStimuli:
    """Stimuli of a folder, read from its file `path`.

    `traces` are the traces of all stimuli, with their origin; `cells` is the number of cells of
    each class. Both are empty if unknown.
    """

    path: Path
    stimuli: tuple[Stimulus, ...] = ()
    traces: Traces = field(default_factory=Traces)
    cells: Mapping[str, int] = field(default_factory=dict)

    def stimulus(self, stimulus_id: str) -> Stimulus | None:
        """The stimulus with this id; None if there is none."""
        return next((candidate for candidate in self.stimuli if candidate.id == stimulus_id), None)

    def with_silent(self, trains: Sequence[SpikeTrain]) -> list[SpikeTrain]:
        """`trains`, and an empty train for each cell without a row in a table of spikes."""
        present = {(train.stimulus, train.afferent, train.unit, train.cell) for train in trains}
        units = dict.fromkeys((str(trace.afferent), trace.unit) for trace in self.traces)
        silent = [
            SpikeTrain(stimulus.id, afferent, np.empty(0), cell, unit)
            for stimulus in self.stimuli
            for afferent, unit in units
            for cell in (range(1, self.cells[afferent] + 1) if self.cells[afferent] > 1 else [0])
            if (stimulus.id, afferent, unit, cell) not in present
        ]
        return [*trains, *silent]


def stimuli_in(folder: Path) -> FolderStimuli:
    """Stimuli of the folder of a simulation or of a run folder; none for another folder.

    Raises
    ------
    ResultError
        A file of the folder is cut short or of another kind.
    """
    if (folder / RECORD_FILE).is_file() and (folder / TRACES_FILE).is_file():
        return _read_simulation(folder)
    if (folder / RUN_FILE).is_file():
        run, (times_ms, depth_um) = read_run_folder(folder), read_waveform(folder)
        stimulus_table = run.inputs.get("stimulus", {})
        try:
            stimulus = Stimulus(
                str(stimulus_table.get("id", folder.name)),
                depth_um,
                float(times_ms[1] - times_ms[0]),
                tuple(stimulus_table.get("window_ms", times_ms[[0, -1]])),
                float(stimulus_table.get("preindent_um", 0.0)),
                stimulus_table,
            )
        except (AttributeError, TypeError, ValueError, FembridgeError) as error:
            raise ResultError(f"inputs.stimulus: {error}", folder / RUN_FILE) from error
        return FolderStimuli(folder / RUN_FILE, (stimulus,))
    return FolderStimuli(folder)


def read_arrays(path: Path) -> tuple[dict[str, FloatArray], Traces]:
    """Waveforms in um by stimulus, and traces of all stimuli, of a simulation's NPZ.

    Raises
    ------
    ResultError
        An array is unknown, missing or of another shape, or is not finite before its end.
    """
    failed = ResultError.at(path)
    with NpzFile(path, failed) as archive:
        _check_arrays(archive.headers, failed)
        names, afferents = archive.read_texts("stimulus"), archive.read_texts("afferent")
        units = [""] * len(afferents)
        if "unit" in archive.headers:
            units = archive.read_texts("unit")
        labels = [
            text and afferent_key(text, unit) for text, unit in zip(afferents, units, strict=True)
        ]
        for kind, texts in (("stimulus", names), ("afferent", labels)):
            if len(set(texts)) != len(texts) or not all(texts):
                raise failed(f"{kind} has names that are empty or duplicate")
        dt_ms = float(archive.read_reals("dt_ms"))
        depth_um = archive.read_reals("displacement_um", _COPIES)
        stress_pa = archive.read_reals("von_mises_pa", _COPIES)
        nodes = np.zeros(len(afferents))
        if "node" in archive.headers:
            nodes = archive.read_reals("node")
    if not (math.isfinite(dt_ms) and dt_ms > 0):
        raise failed(f"dt_ms is {dt_ms:g}, expected more than 0")
    if (stress_pa < 0).any():
        raise failed(f"von_mises_pa is {stress_pa[stress_pa < 0][0]:g}, expected 0 or more")
    rows: dict[str, FloatArray] = {}
    traces = Traces()
    for row, name in enumerate(names):
        size = int((~np.isnan(depth_um[row])).sum())
        arrays = {"displacement_um": depth_um[row][:, None], "von_mises_pa": stress_pa[row]}
        for key, array in arrays.items():  # NaN only after the end of a shorter stimulus
            if size < 2 or not np.isfinite(array[:size]).all() or not np.isnan(array[size:]).all():
                raise failed(f"{key} of {name} is not finite in all its {size} samples")
        rows[name] = depth_um[row][:size]
        traces.extend(
            StressTrace(
                stress_pa[row, :size, column],
                dt_ms,
                int(nodes[column]),
                afferent,
                unit=unit,
                stimulus=name,
            )
            for column, (afferent, unit) in enumerate(zip(afferents, units, strict=True))
        )
    return rows, traces


def _check_arrays(
    headers: Mapping[str, ArrayHeader | None], failed: Callable[[str], ResultError]
) -> None:
    """Refuse arrays of a simulation's NPZ that are missing, unknown or of other shapes."""
    for name in headers:
        if name not in (*_ARRAYS, *_OPTIONAL_ARRAYS):
            hint = near_hint(name, _ARRAYS)
            raise failed(f"unknown array {name}, expected {', '.join(_ARRAYS)}{hint}")
    shapes = {name: header.shape for name, header in headers.items() if header is not None}
    if missing := [name for name in _ARRAYS if name not in shapes]:
        raise failed(f"no array {missing[0]}: not as fembridge simulate writes it")
    stress_shape = shapes["von_mises_pa"]
    if len(stress_shape) != 3 or 0 in stress_shape:
        raise failed(f"von_mises_pa has shape {stress_shape}, expected (stimulus, T, afferent)")
    stimuli, samples, afferents = stress_shape
    expected = {
        "stimulus": (stimuli,),
        "afferent": (afferents,),
        **{name: (afferents,) for name in _OPTIONAL_ARRAYS if name in shapes},
        "dt_ms": (),
        "displacement_um": (stimuli, samples),
    }
    for name, shape in expected.items():
        if shapes[name] != shape:
            raise failed(f"{name} has shape {shapes[name]}, expected {shape} from von_mises_pa")
    check_memory(_TRACE_BYTES * stimuli * afferents, f"{stimuli} stimuli", failed)


def read_origin(folder: Path) -> Table:
    """How the stress of the simulation in `folder` was computed, with its finger.

    Raises
    ------
    ResultError
        The record or the finger cannot be read.
    """
    record = folder / RECORD_FILE
    origin = read_toml(record, ResultError.at(record))
    origin.pop("stimuli", None)
    response = origin.get("response")
    if isinstance(response, dict) and has_finger(folder):
        path = folder / FINGER_FILE
        origin["response"] = {
            key: read_toml(path, ResultError.at(path)) if key == "finger" else value
            for key, value in response.items()
            if key not in ("finger_file", "finger_file_sha256")
        }
    return origin


def _read_simulation(folder: Path) -> FolderStimuli:
    """Waveforms and stress of ``traces.npz``, windows of ``simulation.toml``."""
    path, record = folder / TRACES_FILE, folder / RECORD_FILE
    failed = ResultError.at(record)
    table = read_toml(record, failed)
    depth_um, traces = read_arrays(path)
    dt_ms, afferents = traces[0].dt_ms, {trace.afferent for trace in traces}
    parameters = table.get("parameters", {})
    try:
        entries = [(name, row, table["stimuli"][name]) for name, row in depth_um.items()]
        stimuli = tuple(
            Stimulus(
                name, row, dt_ms, tuple(entry["window_ms"]), float(entry["preindent_um"]), entry
            )
            for name, row, entry in entries
        )
        cells = {
            name: int(values["cells"]) for name, values in parameters.items() if name in afferents
        }
    except (AttributeError, KeyError, TypeError, ValueError, FembridgeError) as error:
        raise failed(f"stimuli or parameters: {error}") from error
    finger = model_id(table.get("response", {}))
    if has_finger(folder):
        finger = finger_id(read_toml(folder / FINGER_FILE, failed))
    return FolderStimuli(record, stimuli, with_origin(traces, stimuli, table, finger), cells)


def with_origin(
    traces: Iterable[StressTrace],
    stimuli: Sequence[Stimulus],
    record: Mapping[str, Any],
    finger: dict[str, str],
) -> Traces:
    """`traces` with the windows of `stimuli`, the parameter set of a `record`, and `finger`."""
    name, parameters = str(record.get("parameter_set", RECORD_FILE)), record.get("parameters", {})
    parameter_table: Table = {"name": name}
    if name not in SET_NAMES or parameters_to_table(parameter_set(name).parameters) != parameters:
        parameter_table |= {
            "preindent_um": record.get("fitted_at_um", stimuli[0].preindent_um),
            **parameters,
            "fit": record.get("fit", {}),
        }
    first, windows_ms = stimuli[0], {stimulus.id: stimulus.window_ms for stimulus in stimuli}
    origin = Origin(first.id, first.window_ms, first.preindent_um, parameter_table, finger)
    return Traces(traces, origin, windows_ms)
