"""What verbs leave in a folder, found and read again: the file of a kind, the stimuli."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from fembridge.errors import FembridgeError, ResultError, UsageError
from fembridge.run_folder import RUN_FILE, read_run_folder, read_waveform
from fembridge.simulation import RECORD_FILE, TRACES_FILE
from fembridge.stimulus import Stimulus
from fembridge.store import read_toml
from fembridge.tables import SpikeTrain
from fembridge.trace import StressTrace

_MOST_NAMED = 3
_DEPTH = 2


def find_output(place: Path, names: Sequence[str], made_by: str) -> Path:
    """`place` itself, or where it is a folder the file in it that has one of `names`.

    The first of `names` that is there; where none is, the only one in folders at most
    two levels below.

    Raises
    ------
    ResultError
        The folder has none; the message says what is `made_by` which verb.
    UsageError
        More than one folder below has one.
    """
    if not place.is_dir():
        return place
    for name in names:
        if (place / name).is_file():
            return place / name
    for depth in range(1, _DEPTH + 1):
        below = "*/" * depth
        found = sorted({one.parent: one for n in names for one in place.glob(below + n)}.values())
        if len(found) == 1:
            return found[0]
        if found:
            some = ", ".join(str(one) for one in found[:_MOST_NAMED])
            more = ", ..." if len(found) > _MOST_NAMED else ""
            raise UsageError(f"{place}: {len(found)} folders in it have one, name it: {some}{more}")
    raise ResultError(f"no {' or '.join(names)} in this folder: {made_by}", place)


@dataclass(frozen=True, slots=True, eq=False)
class Written:
    """Stimuli as a folder has them, with its file `path`; `traces` and `cells` where known.

    `traces` has those of each stimulus, `cells` how many each class has.
    """

    path: Path
    stimuli: tuple[Stimulus, ...]
    traces: tuple[tuple[StressTrace, ...], ...] = ()
    cells: Mapping[str, int] = field(default_factory=dict)

    def of(self, stimulus: str) -> Stimulus | None:
        """The stimulus of that id, None where there is none."""
        return next((one for one in self.stimuli if one.id == stimulus), None)

    def with_silent(self, trains: Sequence[SpikeTrain]) -> list[SpikeTrain]:
        """`trains`, and an empty one for each cell that has no row in a table of spikes."""
        there = {(train.stimulus, train.afferent, train.repeat) for train in trains}
        silent = [
            SpikeTrain(stimulus.id, afferent, np.empty(0), repeat)
            for stimulus in self.stimuli
            for afferent, count in self.cells.items()
            for repeat in (range(1, count + 1) if count > 1 else [0])
            if (stimulus.id, afferent, repeat) not in there
        ]
        return [*trains, *silent]


def read_written(folder: Path) -> Written | None:
    """Stimuli of a simulation's folder, or of a run folder; None of any other folder.

    Raises
    ------
    ResultError
        A file of the folder is cut short or of another kind.
    """
    if (folder / RECORD_FILE).is_file() and (folder / TRACES_FILE).is_file():
        return _simulation(folder)
    if (folder / RUN_FILE).is_file():
        run, (times_ms, depth_um) = read_run_folder(folder), read_waveform(folder)
        known = run.inputs.get("stimulus", {})
        try:
            stimulus = Stimulus(
                str(known.get("id", folder.name)),
                depth_um,
                float(times_ms[1] - times_ms[0]),
                tuple(known.get("window_ms", times_ms[[0, -1]])),
                float(known.get("preindent_um", 0.0)),
                known,
            )
        except (AttributeError, TypeError, ValueError, FembridgeError) as error:
            raise ResultError(f"inputs.stimulus: {error}", folder / RUN_FILE) from error
        return Written(folder / RUN_FILE, (stimulus,))
    return None


def _simulation(folder: Path) -> Written:
    """Waveforms and stress of ``traces.npz``, windows of ``simulation.toml``."""
    path, record = folder / TRACES_FILE, folder / RECORD_FILE

    def failed(problem: str) -> ResultError:
        return ResultError(problem.removeprefix(f"{record}: "), record)

    table = read_toml(record, failed)
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
            dt_ms, names = float(arrays["dt_ms"]), arrays["stimulus"].tolist()
            afferents = arrays["afferent"].tolist()
            depth_um, stress_pa = arrays["displacement_um"], arrays["von_mises_pa"]
        if (len(names), len(afferents)) != (len(depth_um), stress_pa.shape[-1]):
            raise ValueError(f"{len(names)} stimuli, {len(depth_um)} waveforms")
        sizes = [int(np.isfinite(row).sum()) for row in depth_um]  # NaN behind the end
        traces = tuple(
            tuple(StressTrace(row[:size, k], dt_ms, 0, name) for k, name in enumerate(afferents))
            for row, size in zip(stress_pa, sizes, strict=True)
        )
    except (OSError, KeyError, ValueError, EOFError, MemoryError, BadZipFile) as error:
        raise ResultError(f"not as fembridge simulate writes it: {error}", path) from error
    try:
        known = [table["stimuli"][name] for name in names]
        stimuli = tuple(
            Stimulus(
                name, row[:size], dt_ms, tuple(one["window_ms"]), float(one["preindent_um"]), one
            )
            for name, row, size, one in zip(names, depth_um, sizes, known, strict=True)
        )
        cells = {
            name: int(one["cells"])
            for name, one in table.get("parameters", {}).items()
            if name in afferents
        }
    except (AttributeError, KeyError, TypeError, ValueError, FembridgeError) as error:
        raise failed(f"stimuli or parameters: {error}") from error
    return Written(record, stimuli, traces, cells)
