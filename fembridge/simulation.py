"""From stimuli to spikes: stress, spikes and rates of each stimulus, and their files.

``map``        one indentation is solved (or a stored one taken); every stimulus is
               an interpolation in it.
``transient``  the indentation shows which contact model is to be trusted; then the
               solver follows each whole waveform.
``auto``       the map, unless stress depends on more than the probe's depth: see
               `fembridge.response.indentation.why_no_map`.
"""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from decks.analysis import Contact, Model
from decks.motion import SUBSTEPS
from decks.presets import PRESETS, finger_table
from fembridge.build import build_run_folder, stimulus_inputs
from fembridge.errors import (
    FembridgeError,
    MissingError,
    OutputError,
    ResponseError,
    ResultError,
    TraceError,
    UsageError,
)
from fembridge.machine import SOLVER_INSTALL_LINE, find_ccx
from fembridge.memory import check_memory
from fembridge.npz import ArrayHeader, NpzFile
from fembridge.response.indentation import (
    CONTACT_CAUSES,
    LADDER,
    RESPONSE_FOLDER,
    FrictionSlipError,
    Log,
    in_words,
    increment_s,
    solve_response,
    why_no_map,
)
from fembridge.response.response_map import ResponseMap, reading_energy, stored_response
from fembridge.results import read
from fembridge.run_folder import RUN_FILE, RunFolder, read_run_folder, read_waveform
from fembridge.solver.ccx import finished_outcome, run_folders
from fembridge.solver.settings import DEFAULTS, SolverSettings
from fembridge.stimulus import Stimulus
from fembridge.store import (
    filling,
    near_hint,
    read_toml,
    remove_file,
    replacing,
    sha256_of,
    write_toml,
)
from fembridge.tables import Rate, SpikeTrain, spikes_frame, write_rates, write_spikes
from fembridge.trace import Origin, StressTrace, Traces, finger_id, stacked
from fembridge.typing import FloatArray, Table
from fembridge.version import __version__
from neural import Parameters, encode_afferents, mean_rate_ips
from neural.parameter_sets import (
    SET_NAMES,
    ParameterSet,
    parameter_set,
    parameters_to_table,
)

if TYPE_CHECKING:
    import matplotlib.figure
    import pandas

PUBLISHED_SET = parameter_set("published")
METHODS = ("map", "transient")
AUTO = "auto"
RATES_FILE = "rates.csv"
SPIKES_FILE = "spikes.csv"
TRACES_FILE = "traces.npz"
RECORD_FILE = "simulation.toml"
RASTER_FILE = "raster.png"
FINGER_FILE = "finger.toml"
RUNS_FOLDER = "runs"
LONG_S = 600.0
"""What takes longer is only begun when somebody says so."""
_ARRAYS = ("stimulus", "afferent", "dt_ms", "displacement_um", "von_mises_pa")
_TRACE_BYTES = 1 << 10  # of the objects of a trace, beside its samples
_COPIES = 2  # of the samples: those of the file, and those of its traces
PICTURES = ("raster", "psth", "isi", "rates")
# A file that is asked for is looked for so many folders below; so many are named.
_DEPTH, _MAX_NAMED = 2, 3


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Simulation:
    """One entry a stimulus: its stress `traces`, one an afferent; its spikes, rates.

    `trains` and `mean_rates` run over stimuli, then afferents; a population has a
    train a cell, its `repeat` from 1, the most sensitive first, and its rate is their
    mean. `origin` is how the stress was computed.
    """

    stimuli: tuple[Stimulus, ...]
    traces: tuple[tuple[StressTrace, ...], ...]
    trains: tuple[SpikeTrain, ...]
    mean_rates: tuple[Rate, ...]
    origin: Mapping[str, object] = field(default_factory=dict)

    def __repr__(self) -> str:
        first_id, more_count = self.stimuli[0].id, len(self.stimuli) - 1
        others = f" and {more_count} more" if more_count else ""
        return f"Simulation({first_id}{others}: .rates, .spikes, .plot())"

    @property
    def rates(self) -> "pandas.DataFrame":
        """Firing rates: ``stimulus``, ``afferent``, ``rate_ips``, a row a rate."""
        import pandas

        return pandas.DataFrame(list(self.mean_rates), columns=["stimulus", "afferent", "rate_ips"])

    @property
    def spikes(self) -> "pandas.DataFrame":
        """Spikes: ``stimulus``, ``afferent``, ``repeat``, ``spike_time_ms``, a row a spike."""
        return spikes_frame(self.trains)

    def plot(self, picture: str = "raster") -> "matplotlib.figure.Figure":
        """``raster``, ``psth`` or ``isi`` of the spikes, or ``rates``, as a Matplotlib figure.

        As `fembridge plot` draws them: a panel a class, a row a stimulus; rates against
        amplitude, a column a frequency.
        """
        from fembridge.plots.spikes import isi_figure, psth_figure, raster_figure

        if picture not in PICTURES:
            raise UsageError(f"picture {picture!r}, expected {', '.join(PICTURES)}")
        if picture == "rates":
            from fembridge.plots.rates import rates_figure

            return rates_figure(self.mean_rates)
        rows: dict[str, Any] = {
            "stimuli": [stimulus.id for stimulus in self.stimuli],
            "afferents": [str(trace.afferent) for trace in self.traces[0]],
        }
        if picture == "isi":
            return isi_figure(self.trains, **rows)
        windows_ms = {stimulus.window_ms for stimulus in self.stimuli}
        rows["window_ms"] = windows_ms.pop() if len(windows_ms) == 1 else None
        rows["waveform"] = self.stimuli[0] if len(self.stimuli) == 1 else None
        draw = raster_figure if picture == "raster" else psth_figure
        return draw(self.trains, **rows)

    def write(
        self,
        folder: Path | str,
        *,
        plot: bool = False,
        more: Mapping[str, Callable[[Path], object]] | None = None,
    ) -> None:
        """Write ``rates.csv``, ``spikes.csv``, ``traces.npz``, ``simulation.toml``.

        The finger of a response has a file of its own, ``finger.toml``, which the record
        names. The NPZ holds ``stimulus`` ``(S,)``, ``afferent`` ``(A,)``, ``dt_ms``,
        ``displacement_um`` ``(S, T)`` and ``von_mises_pa`` ``(S, T, A)``, NaN behind the end of
        a shorter stimulus. All of them, with `plot` ``raster.png``, and `more` by what writes
        each, are replaced, or, after an `OutputError`, none: a ``finger.toml`` of the user's own
        is not.
        """
        stimuli = {stimulus.id: stimulus_inputs(stimulus) for stimulus in self.stimuli}
        for table in stimuli.values():
            del table["id"]
        stress_pa = [
            stacked([row[k].stress_pa for row in self.traces]) for k in range(len(self.traces[0]))
        ]
        record: dict[str, Any] = {**self.origin, "stimuli": stimuli}
        response = record.get("response", {})
        finger = response.get("finger")
        has_file = isinstance(finger, Mapping)  # not of a finger that is but named
        folder = Path(folder)
        is_left_over = not has_file and has_finger(folder)
        if has_file:
            check_finger(folder, finger)
        with filling(folder, last=RECORD_FILE) as draft:
            with replacing(draft / TRACES_FILE) as path, path.open("wb") as file:
                np.savez(
                    file,
                    stimulus=np.array([stimulus.id for stimulus in self.stimuli]),
                    afferent=np.array([trace.afferent for trace in self.traces[0]]),
                    dt_ms=np.array(self.stimuli[0].dt_ms),
                    displacement_um=stacked(
                        [stimulus.displacement_um for stimulus in self.stimuli]
                    ),
                    von_mises_pa=np.stack(stress_pa, -1),
                )
            write_spikes(draft / SPIKES_FILE, self.trains)
            write_rates(draft / RATES_FILE, self.mean_rates)
            if has_file:
                write_toml(draft / FINGER_FILE, finger)
                record["response"] = {
                    **response,
                    "finger": finger.get("name", ""),
                    "finger_file": FINGER_FILE,
                    "finger_file_sha256": sha256_of(draft / FINGER_FILE),
                }
            write_toml(draft / RECORD_FILE, record)
            if plot:
                from fembridge.plots.style import save_figure

                save_figure(self.plot(), draft / RASTER_FILE)
            for name, write in (more or {}).items():
                write(draft / name)
        if is_left_over:
            remove_file(folder / FINGER_FILE)


def check_finger(folder: Path, finger: Mapping[str, Any]) -> None:
    """Refuse to write `finger` over another ``finger.toml`` than the simulation in `folder` left.

    Versions that kept no checksum left it as this one writes it.
    """
    import tomli_w

    path = folder / FINGER_FILE
    if not path.is_file() or has_finger(folder):
        return
    if path.read_bytes() != tomli_w.dumps(finger).encode():
        raise OutputError(
            "a finger of your own, or edited since, which that of this run would replace: choose "
            "another -o, or rename it",
            path,
        )


def has_finger(folder: Path) -> bool:
    """Whether the file of a finger is in `folder` as the simulation there left it."""
    try:
        response = read_toml(folder / RECORD_FILE, FembridgeError).get("response")
    except FembridgeError:
        return False
    path = folder / FINGER_FILE
    written = response.get("finger_file_sha256") if isinstance(response, dict) else None
    return path.is_file() and written == sha256_of(path)


def simulate(
    stimuli: Sequence[Stimulus],
    model: Model,
    folder: Path,
    *,
    method: str = AUTO,
    stored: bool = False,
    parameters: ParameterSet = PUBLISHED_SET,
    settings: SolverSettings = DEFAULTS,
    yes: bool = True,
    log: Log = lambda line: None,
) -> Simulation:
    """Compute stress and spikes; what a solver makes is kept below `folder`.

    Arguments and errors are those of `fembridge.simulate`.
    """
    if method not in (AUTO, *METHODS):
        raise UsageError(f"method {method!r}, expected {AUTO}, {' or '.join(METHODS)}")
    reason = why_no_map(model, stimuli)
    if stored and (reason or method == "transient"):
        raise UsageError(f"a stored response answers no transient: {reason or 'leave one out'}")
    method = _select_method(method, reason, parameters.parameters, log)
    deepest = max(stimuli, key=attrgetter("deepest_um"))
    response: ResponseMap | None = None
    slip_percent: float | None = None  # by which unloading differs where skin slips
    origin: Table = {"source": "CalculiX"}
    parameter_table = parameters.to_table()
    if stored or find_ccx() is None:
        if method == "transient":
            raise MissingError(
                f"{reason or '--method transient'}: that takes a solver, and there is "
                f"no ccx on the PATH; install it: {SOLVER_INSTALL_LINE}"
            )
        response = _read_stored_response(model, deepest, stored, log)
        origin["source"] = "stored response"
    else:
        response_folder = folder / RESPONSE_FOLDER
        if method == "transient":
            check_cost(stimuli, model, settings, log, yes=yes)
        try:
            model, response = solve_response(
                response_folder, model, deepest.deepest_um, settings, log=log
            )
        except FrictionSlipError as slip:
            reason = "; ".join(text for text in (reason, str(slip)) if text)
            if method != "transient":
                method = _select_method(method, reason, parameters.parameters, log)
                check_cost(stimuli, model, settings, log, yes=yes)
            model, slip_percent = replace(model, contact=slip.contact), slip.closure_percent
    if response is None or method == "transient":
        slips = slip_percent is not None
        traces, origin["contacts"] = solve_transients(
            stimuli, model, folder, settings, log, slips=slips, parameters=parameter_table
        )
    else:
        method = "map"
        traces = [response.traces(stimulus, parameters.parameters) for stimulus in stimuli]
    if response is not None:
        origin["response"] = dict(response.origin)
    record = {
        "fembridge": __version__,
        "method": method,
        **origin,
        "no_map": reason,
        "closure_percent": slip_percent if response is None else response.closure_percent,
        "parameter_set": parameters.name,
        "parameters": parameters_to_table(parameters.parameters),
        "fit": parameter_table.get("fit"),
    }
    stated = {key: value for key, value in record.items() if value is not None}
    return encode_all(stimuli, traces, parameters.parameters, stated)


def check_cost(
    stimuli: Sequence[Stimulus],
    model: Model,
    settings: SolverSettings,
    log: Log,
    *,
    yes: bool,
) -> None:
    """Log how long the transients of `stimuli` take; refuse what is long without `yes`.

    Raises
    ------
    UsageError
        More than `LONG_S`, and neither `yes` nor a time limit.
    """
    share = 0.5 if model.section == "half" and not model.inertia else 1.0
    samples = sum(stimulus.displacement_um.size for stimulus in stimuli)
    increments = samples * (SUBSTEPS if model.inertia else 1)
    total_s = increments * increment_s(share * len(model.mesh.quad)) / settings.jobs
    count = f"{len(stimuli)} transient{'s' if len(stimuli) > 1 else ''}"
    line = f"{count} of {increments} increments in all: about {in_words(total_s)}"
    if total_s > LONG_S and not yes and settings.time_limit_s is None:
        raise UsageError(
            f"{line}: say --yes, or --time-limit S for each; cheaper are fewer stimuli, --jobs, "
            "--finger quick, or --method map where stress depends on depth alone"
        )
    log(line)


def solve_transients(
    stimuli: Sequence[Stimulus],
    model: Model,
    folder: Path,
    settings: SolverSettings,
    log: Log,
    ladder: Sequence[Contact] = LADDER,
    *,
    slips: bool = False,
    parameters: Table | None = None,
) -> tuple[list[list[StressTrace]], Table]:
    """Traces of each waveform, and by stimulus the contact that it was solved with.

    `model` has a contact that was accepted; a waveform that does not converge gets the
    next one of the ladder, after an indentation accepted that. What skin that slips
    under friction makes of an indentation speaks against a map, not against the
    contact. Where skin is known to slip (`slips`) or the probe slides, contacts of
    another friction are no choice. `parameters` is for the ``run.toml`` of each.
    """
    deepest_um = max(stimulus.deepest_um for stimulus in stimuli)
    failure: FembridgeError | None = None
    solved: dict[str, RunFolder] = {}  # by stimulus
    slips = slips or any(stimulus.aside_um is not None for stimulus in stimuli)
    remaining_contacts = (
        ladder[ladder.index(model.contact) + 1 :] if model.contact in ladder else ()
    )
    for number, contact in enumerate((model.contact, *remaining_contacts), start=1):
        if slips and contact.friction != model.contact.friction:
            continue
        if contact != model.contact:
            retry_folder = folder / f"{RESPONSE_FOLDER}_{number}"
            try:
                model, _ = solve_response(
                    retry_folder, model, deepest_um, settings, ladder=(contact,), log=log
                )
            except FrictionSlipError:
                slips = True
                model = replace(model, contact=contact)
            except ResponseError as error:
                log(f"left {contact}: {error}")
                continue
        runs = {
            stimulus.id: build_run_folder(
                folder / RUNS_FOLDER / stimulus.id, model, stimulus, parameters=parameters
            )
            for stimulus in stimuli
            if stimulus.id not in solved
        }
        try:
            shared = settings.shared_by(min(settings.jobs, len(runs)))
            outcomes = run_folders(runs.values(), shared)
        except KeyboardInterrupt:
            finished_count = len(solved) + sum(
                finished_outcome(run) is not None for run in runs.values()
            )
            log(
                f"{finished_count} of {len(stimuli)} transients are kept; the same command goes on "
                "with them"
            )
            raise
        for (name, run), outcome in zip(runs.items(), outcomes, strict=True):
            if outcome.failure is None:
                solved[name] = run
                continue
            failure = outcome.to_error()
            if outcome.failure.cause not in CONTACT_CAUSES:
                raise failure
            log(f"left {contact} for {name}: {outcome.failure}")
        count = sum(outcome.accepted for outcome in outcomes)
        if count:
            wall_s = sum(outcome.wall_s for outcome in outcomes)
            log(f"{count} transients solved in {wall_s:.0f} s, contact {contact}")
        if len(solved) == len(stimuli):
            contacts = {stimulus.id: solved[stimulus.id].inputs["contact"] for stimulus in stimuli}
            return [list(read(solved[stimulus.id])) for stimulus in stimuli], contacts
    raise failure or ResponseError(f"{folder}: no contact model was accepted")


def encode_all(
    stimuli: Sequence[Stimulus],
    traces: Sequence[Sequence[StressTrace]],
    parameters: Parameters,
    origin: Mapping[str, object],
) -> Simulation:
    """Turn the stress of all stimuli into spikes, those of one length together.

    Raises
    ------
    TraceError, ParameterError
        A class without parameters, samples at other times than the stimulus's; a time
        step that the parameters were not made for.
    """
    pairs = [
        (stimulus, trace) for stimulus, row in zip(stimuli, traces, strict=True) for trace in row
    ]
    for stimulus, trace in pairs:
        size, expected = trace.stress_pa.size, stimulus.displacement_um.size
        if trace.afferent not in parameters or size != expected:
            raise TraceError(
                f"{stimulus.id}: {size} samples of {trace.afferent}, expected {expected} of "
                f"{', '.join(parameters)}"
            )
    trains, rates = [], []
    cells = fired([trace for _, trace in pairs], parameters)
    for (stimulus, trace), spikes_ms in zip(pairs, cells, strict=True):
        afferent = str(trace.afferent)
        trains.extend(trains_of(stimulus.id, afferent, spikes_ms))
        rate = mean_rate_ips(spikes_ms, stimulus.window_ms)
        rates.append(Rate(stimulus.id, afferent, rate))
    rows = tuple(tuple(row) for row in traces)
    return Simulation(tuple(stimuli), rows, tuple(trains), tuple(rates), origin)


# Samples of a class that are encoded at a time: 220 bytes each with ten cells.
_BATCH_SAMPLES = 1_000_000


def fired(
    traces: Sequence[StressTrace], parameters: Parameters, derivative: str = "backward"
) -> list[list[FloatArray]]:
    """Spike times in ms of each cell of each trace; traces of one length are one batch."""
    cells_by_row: dict[int, list[FloatArray]] = {}
    by_grid: dict[tuple[int, float, float], dict[str, list[int]]] = {}
    for row, trace in enumerate(traces):
        batch = by_grid.setdefault((trace.stress_pa.size, trace.dt_ms, trace.start_ms), {})
        batch.setdefault(str(trace.afferent), []).append(row)
    for (samples, dt_ms, start_ms), classes in by_grid.items():
        most = max(1, _BATCH_SAMPLES // samples)
        for begin in range(0, max(map(len, classes.values())), most):
            chosen = {
                name: part for name, rows in classes.items() if (part := rows[begin : begin + most])
            }
            stress_pa = {
                name: np.stack([traces[row].stress_pa for row in rows], -1)
                for name, rows in chosen.items()
            }
            cells = encode_afferents(stress_pa, dt_ms, parameters, start_ms, derivative)
            for name, rows in chosen.items():
                cells_by_row |= dict(zip(rows, cells[name], strict=True))
    return [cells_by_row[row] for row in range(len(traces))]


def unlike_the_fit(
    chosen: ParameterSet,
    finger: Mapping[str, str],
    depths_um: Collection[float],
) -> str:
    """What was otherwise where the numbers of `chosen` were fitted, in a line; "": nothing.

    `finger` has ``name`` and ``sha256`` of the model that gave the stress, `depths_um` are
    those of its probe before time 0; empty: not known.
    """
    differences, fitted = [], chosen.finger
    if fitted:
        preset = PRESETS.get(fitted["name"])
        reference = {**(finger_id(finger_table(preset)) if preset else {}), **fitted}
        if any(finger.get(key) != reference[key] for key in reference):
            actual_name = finger.get("name", "not known")
            actual_name = "another of that name" if actual_name == fitted["name"] else actual_name
            differences.append(f"on finger {fitted['name']!r} (here: {actual_name})")
    if set(depths_um) != {chosen.preindent_um} and (depths_um or chosen.preindent_um):
        actual_depths = ", ".join(f"{depth_um:g}" for depth_um in sorted(depths_um))
        actual_depths = f"{actual_depths} um" if actual_depths else "not known"
        depth = f"{chosen.preindent_um:g} um deep"
        differences.append(f"with the probe {depth} before time 0 (here: {actual_depths})")
    return f"parameters {chosen.name} were fitted {', '.join(differences)}" if differences else ""


def trains_of(
    stimulus: str, afferent: str, cells_ms: Sequence[FloatArray], unit: str = ""
) -> list[SpikeTrain]:
    """A train a cell; `repeat` counts them from 1, and is 0 for a single one."""
    first = 1 if len(cells_ms) > 1 else 0
    return [
        SpikeTrain(stimulus, afferent, times_ms, repeat, unit)
        for repeat, times_ms in enumerate(cells_ms, start=first)
    ]


def _select_method(method: str, reason: str | None, parameters: Parameters, log: Log) -> str:
    """The method that is possible: there is no map where there is a `reason`."""
    if method == "map" and reason is not None:
        raise UsageError(f"no response map: {reason}; take --method transient")
    if method == AUTO and reason is not None:
        log(f"{reason}; so there is no response map: each waveform is solved")
        method = "transient"
    if method == "transient" and (energy_class := reading_energy(parameters)):
        remedy = "take other parameters" if reason else "take --method map"
        raise UsageError(
            f"drive {parameters[energy_class].drive!r} of {energy_class} reads strain energy, "
            f"--method transient gives von Mises stress alone: {remedy}"
        )
    return method


def _read_stored_response(
    model: Model, deepest: Stimulus, is_requested: bool, log: Log
) -> ResponseMap:
    try:
        response = stored_response(
            model.finger, model.probe, model.element, depth_um=deepest.deepest_um, law=model.law
        )
        if deepest.deepest_um > response.deepest_um:
            raise ResponseError(
                f"{deepest.id} goes {deepest.deepest_um:.9g} um deep, the stored "
                f"response of finger {model.finger.name!r} reaches "
                f"{response.deepest_um:g} um"
            )
    except ResponseError as error:
        if is_requested:
            raise
        install = f"install the solver: {SOLVER_INSTALL_LINE}"
        raise MissingError(f"no ccx on the PATH, and {error}; {install}") from error
    line = f"stored response of finger {model.finger.name!r}"
    fallback_line = f"no ccx on the PATH: {line}; to solve it here: {SOLVER_INSTALL_LINE}"
    log(line if is_requested else fallback_line)
    return response


def find_file(place: Path, names: Sequence[str], made_by: str) -> Path:
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
        subfolders = "*/" * depth
        matches = sorted(
            {path.parent: path for n in names for path in place.glob(subfolders + n)}.values()
        )
        if len(matches) == 1:
            return matches[0]
        if matches:
            listed = ", ".join(str(path) for path in matches[:_MAX_NAMED])
            ellipsis = ", ..." if len(matches) > _MAX_NAMED else ""
            raise UsageError(
                f"{place}: {len(matches)} folders in it have one, name it: {listed}{ellipsis}"
            )
    raise ResultError(f"no {' or '.join(names)} in this folder: {made_by}", place)


@dataclass(frozen=True, slots=True, eq=False)
class FolderStimuli:
    """Stimuli as a folder has them, with its file `path`; `traces` and `cells` where known.

    `traces` are those of all, with their origin; `cells` is how many each class has.
    """

    path: Path
    stimuli: tuple[Stimulus, ...] = ()
    traces: Traces = field(default_factory=Traces)
    cells: Mapping[str, int] = field(default_factory=dict)

    def of(self, stimulus: str) -> Stimulus | None:
        """The stimulus of that id, None where there is none."""
        return next((candidate for candidate in self.stimuli if candidate.id == stimulus), None)

    def with_silent(self, trains: Sequence[SpikeTrain]) -> list[SpikeTrain]:
        """`trains`, and an empty one for each cell that has no row in a table of spikes."""
        present = {(train.stimulus, train.afferent, train.repeat) for train in trains}
        silent = [
            SpikeTrain(stimulus.id, afferent, np.empty(0), repeat)
            for stimulus in self.stimuli
            for afferent, count in self.cells.items()
            for repeat in (range(1, count + 1) if count > 1 else [0])
            if (stimulus.id, afferent, repeat) not in present
        ]
        return [*trains, *silent]


def stimuli_in(folder: Path) -> FolderStimuli:
    """Stimuli of a simulation's folder, or of a run folder; none of any other folder.

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


def arrays_in(path: Path) -> tuple[dict[str, FloatArray], Traces]:
    """Of a simulation's NPZ: waveforms in um by their ids, and the traces of all.

    Raises
    ------
    ResultError
        An array is unknown, missing or of another shape, or is not finite before its end.
    """
    failed = ResultError.at(path)
    with NpzFile(path, failed) as archive:
        _check_arrays(archive.headers, failed)
        names, afferents = archive.read_texts("stimulus"), archive.read_texts("afferent")
        for kind, texts in (("stimulus", names), ("afferent", afferents)):
            if len(set(texts)) != len(texts) or not all(texts):
                raise failed(f"{kind} has names that are empty or duplicate")
        dt_ms = float(archive.read_reals("dt_ms"))
        depth_um = archive.read_reals("displacement_um", _COPIES)
        stress_pa = archive.read_reals("von_mises_pa", _COPIES)
    if not (math.isfinite(dt_ms) and dt_ms > 0):
        raise failed(f"dt_ms is {dt_ms:g}, expected more than 0")
    if (stress_pa < 0).any():
        raise failed(f"von_mises_pa is {stress_pa[stress_pa < 0][0]:g}, expected 0 or more")
    rows: dict[str, FloatArray] = {}
    traces = Traces()
    for row, name in enumerate(names):
        size = int((~np.isnan(depth_um[row])).sum())
        arrays = {"displacement_um": depth_um[row][:, None], "von_mises_pa": stress_pa[row]}
        for key, array in arrays.items():  # NaN behind the end of a shorter stimulus alone
            if size < 2 or not np.isfinite(array[:size]).all() or not np.isnan(array[size:]).all():
                raise failed(f"{key} of {name} is not finite in all its {size} samples")
        rows[name] = depth_um[row][:size]
        traces.extend(
            StressTrace(stress_pa[row, :size, column], dt_ms, 0, afferent, stimulus=name)
            for column, afferent in enumerate(afferents)
        )
    return rows, traces


def _check_arrays(
    headers: Mapping[str, ArrayHeader | None], failed: Callable[[str], ResultError]
) -> None:
    """Refuse arrays of a simulation's NPZ that are missing, unknown or of other shapes."""
    for name in headers:
        if name not in _ARRAYS:
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
        "dt_ms": (),
        "displacement_um": (stimuli, samples),
    }
    for name, shape in expected.items():
        if shapes[name] != shape:
            raise failed(f"{name} has shape {shapes[name]}, expected {shape} as von_mises_pa has")
    check_memory(_TRACE_BYTES * stimuli * afferents, f"{stimuli} stimuli", failed)


def _read_simulation(folder: Path) -> FolderStimuli:
    """Waveforms and stress of ``traces.npz``, windows of ``simulation.toml``."""
    path, record = folder / TRACES_FILE, folder / RECORD_FILE
    failed = ResultError.at(record)
    table = read_toml(record, failed)
    depth_um, traces = arrays_in(path)
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
    name = str(table.get("parameter_set", RECORD_FILE))
    parameter_table: Table = {"name": name}
    if name not in SET_NAMES or parameters_to_table(parameter_set(name).parameters) != parameters:
        parameter_table |= {
            "preindent_um": stimuli[0].preindent_um,
            **parameters,
            "fit": table.get("fit", {}),
        }
    finger = finger_id(read_toml(folder / FINGER_FILE, failed)) if has_finger(folder) else {}
    first, windows_ms = stimuli[0], {stimulus.id: stimulus.window_ms for stimulus in stimuli}
    origin = Origin(first.id, first.window_ms, first.preindent_um, parameter_table, finger)
    return FolderStimuli(record, stimuli, Traces(traces, origin, windows_ms), cells)
