"""The work of many touches: what a worker process does with rows that share their contact.

Everything here can be pickled, and what comes out depends on the row alone: neither on the
rows beside it nor on the process, whose linear algebra is kept to one thread.
"""

import threading
import time
import traceback
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np

from fembridge.errors import FembridgeError, FembridgeWarning, OutputError, UsageError
from fembridge.host.store import digest, sha256_of
from fembridge.io.waveform import resolve_stimuli
from fembridge.response.response_map import ResponseMap, map_file, read_map
from fembridge.simulation.simulate import simulate
from fembridge.simulation.simulation import Simulation
from fembridge.sweeps.touch_study import FILES
from fembridge.touching.contact_history import ContactHistory, solve_contact
from fembridge.touching.influence import drop_influence
from fembridge.touching.pad import Pad
from fembridge.touching.pad_file import resolve_pad
from fembridge.touching.population import POPULATIONS, Population, resolve_population
from fembridge.touching.shape import Shape, resolve_shape
from fembridge.touching.touch import (
    PAD,
    SHAPE,
    TouchInputs,
    parameters_on,
    resolve_touch,
    touch_skin,
)
from fembridge.touching.trajectory import Trajectory
from fembridge.typing import FloatArray, IntArray
from fembridge.version import __version__
from neural.compiled import compile_for
from neural.parameter_sets import ParameterSet, parameter_set, parameters_to_table

POPULATION = "fingertip"
_LONG_S = 5.0
_MANY_NUMBERS = 10_000_000

_ALWAYS_FILES = ("path", "pins", "map", "finger")
# A worker of dask may have several threads, and a process has one filter of warnings.
_one_at_a_time = threading.Lock()
_SUFFIXES = (".csv", ".dat", ".npy", ".npz", ".png", ".toml", ".txt", ".wav")

Settings = Mapping[str, Any]


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """Touches of one part that share their contact: their settings by number.

    File names are relative to `folder`; forces are kept every `forces_step_ms`, at 0 never.
    """

    rows: Mapping[int, Settings]
    folder: Path
    forces_step_ms: float


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """What came of a touch.

    Parameters
    ----------
    touch
        Number of the touch.
    record
        Columns of ``touches``: settings with their defaults, digests and warnings.
    afferent, unit
        Class and name of each unit, ``(U,)``.
    spike_unit, trial, time_ms
        Row of the unit, trial from 1 and time in ms of each spike, ``(spike,)``.
    forces
        Columns of ``forces``, ``(sample,)``.
    cause
        Cause of a failure; "" if there is none.
    may_pass
        Whether another attempt may succeed.
    contact_s, encode_s
        Time in s of the contact, and of the rest.
    """

    touch: int
    record: Mapping[str, Any] = field(default_factory=dict)
    afferent: tuple[str, ...] = ()
    unit: tuple[str, ...] = ()
    spike_unit: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    trial: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    time_ms: FloatArray = field(default_factory=lambda: np.zeros(0))
    forces: Mapping[str, FloatArray] = field(default_factory=dict)
    cause: str = ""
    may_pass: bool = False
    contact_s: float = 0.0
    encode_s: float = 0.0


@dataclass(slots=True)
class _Shared:
    """What the rows of a batch share: contacts by the digest of their trajectory.

    The stress that `fembridge.touching.influence` keeps was computed with other nodes or units
    beside it, which changes last bits of its sums. So it serves only rows that read it in the same
    way, as those do which differ in their seed: `reading` is all that decides it.
    """

    contacts: dict[str, ContactHistory] = field(default_factory=dict)
    reading: tuple[object, ...] = ()

    def read_as(self, *reading: object) -> None:
        """Keep the stress of the row before only if it was read in the same way."""
        if reading != self.reading:
            drop_influence()
        self.reading = reading


def run_batch(batch: Batch) -> list[Outcome]:
    """Outcome of each row of `batch`; an error becomes its cause."""
    from threadpoolctl import threadpool_limits

    shared = _Shared()
    with _one_at_a_time, threadpool_limits(1, user_api="blas"):
        return [_outcome(touch, row, batch, shared) for touch, row in batch.rows.items()]


def run_trial(batch: Batch) -> list[Outcome]:
    """Outcomes of `batch` at a time that has no cost of a first call in it.

    Rows that take long are run once, since that cost is a few seconds at most.
    """
    outcomes = run_batch(batch)
    if sum(outcome.contact_s + outcome.encode_s for outcome in outcomes) > _LONG_S:
        return outcomes
    compile_for(_MANY_NUMBERS)  # as it will be after some touches
    return run_batch(batch)


def _outcome(touch: int, row: Settings, batch: Batch, shared: _Shared) -> Outcome:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            settings = _located(row, batch.folder)
            compute = _map_outcome if "map" in settings else _pad_outcome
            outcome = compute(touch, settings, batch.forces_step_ms, shared)
        except OutputError as error:
            return Outcome(touch, cause=_line(error), may_pass=True)
        except FembridgeError as error:
            return Outcome(touch, cause=_line(error), may_pass=isinstance(error.__cause__, OSError))
        except (OSError, MemoryError) as error:
            return Outcome(touch, cause=f"{type(error).__name__}: {_line(error)}", may_pass=True)
        except Exception as error:  # a bug in one row does not stop the others
            line = traceback.extract_tb(error.__traceback__)[-1]
            cause = f"a bug in fembridge, {Path(line.filename).name}:{line.lineno}: "
            cause += f"{type(error).__name__}: {_line(error)}"
            return Outcome(touch, cause=cause)
    texts = [str(item.message) for item in caught if issubclass(item.category, FembridgeWarning)]
    assert isinstance(outcome.record, dict)
    outcome.record["warnings"] = list(dict.fromkeys(texts))
    return outcome


def _line(error: object) -> str:
    return " ".join(str(error).splitlines())


def located(name: str, value: object, folder: Path) -> Path | None:
    """File or folder that the `value` of a setting names; None if it names none."""
    if name not in FILES or not isinstance(value, str) or not value:
        return None
    path = folder / value
    try:
        is_there = path.exists() if name == "map" else path.is_file()
    except (OSError, ValueError):  # a name too long for a file
        return None
    return path if is_there else None


def check_setting(name: str, row: Settings, folder: Path) -> None:
    """Refuse the setting `name` of a row, a text, as far as it can be known without its pad.

    Raises
    ------
    FembridgeError
        An unknown name, or a file that is absent.
    """
    value: str = row[name]
    path = located(name, value, folder)
    is_file = name in _ALWAYS_FILES or Path(value).suffix.lower() in _SUFFIXES
    if is_file and path is None:
        raise UsageError("is not found", folder / value, argument=name, found=value)
    settings = _located(row, folder)
    if name == "shape":
        _shape_of(settings)
    elif name == "parameters":
        parameter_set(settings[name])
    elif name == "stimulus":
        resolve_stimuli(settings[name])
    elif name == "pad" and path is None:
        resolve_pad(value)
    elif name == "population" and path is None:
        maker = POPULATIONS.get(value.partition(":")[0])
        if maker is None:
            expected = f"{', '.join(POPULATIONS)} or a file .csv"
            raise UsageError(argument=name, found=value, expected=expected)
        if "population_seed" in row and "seed" not in signature(maker).parameters:
            problem = f"is for a population that is drawn, not for {value}"
            raise UsageError(problem, argument="population_seed", found=row["population_seed"])


def _located(row: Settings, folder: Path) -> dict[str, Any]:
    """Settings with full paths of their files."""
    paths = {name: located(name, value, folder) for name, value in row.items()}
    return {name: value if paths[name] is None else str(paths[name]) for name, value in row.items()}


# ---- Touches of a pad


def inputs_of(settings: Settings) -> TouchInputs:
    """Resolved arguments of a touch of a pad."""
    pad = _pad_of(settings.get("pad", PAD))
    parameters = parameters_on(pad, settings.get("parameters"))
    preindent_um = settings.get("preindent_um")
    depth_um = parameters.preindent_um if preindent_um is None else preindent_um
    arguments: dict[str, Any] = {
        "pad": pad,
        "parameters": parameters,
        "preindent_um": preindent_um,
        "population": population_of(settings, pad),
        "at_mm": (settings.get("x_mm", 0.0), settings.get("z_mm", 0.0)),
        "tilt_deg": (settings.get("tilt_across_deg", 0.0), settings.get("tilt_along_deg", 0.0)),
        "angle_deg": settings.get("angle_deg", 0.0),
        **{name: settings.get(name) for name in ("finger", "ridges", "friction")},
    }
    if "pins" not in settings or "shape" in settings:
        arguments["shape"] = _shape_of(settings)
    if "stimulus" in settings:
        arguments["stimulus"] = settings["stimulus"]
    else:
        arguments["trajectory"] = _trajectory_of(settings, depth_um)
    return resolve_touch(**arguments)


def population_of(settings: Settings, pad: Pad) -> Population:
    """The units of a row on its pad."""
    population = settings.get("population", POPULATION)
    if (seed := settings.get("population_seed")) is not None:
        if not isinstance(population, str):
            raise UsageError("is for a population by name", argument="population_seed", found=seed)
        population = f"{population}{',' if ':' in population else ':'}seed={seed}"
    units = resolve_population(population, pad)
    if not {"endings_mm", "sa_von_mises"} & set(settings):
        return units
    return units.with_endings(
        settings.get("endings_mm", units.endings_mm),
        sa_von_mises=settings.get("sa_von_mises", units.sa_von_mises),
    )


def _pad_of(pad: str | Path | Pad) -> Pad:
    if isinstance(pad, Pad):
        return pad
    path = Path(pad)
    if path.is_file():
        status = path.stat()
        return _pad_file(path, status.st_mtime_ns, status.st_size)
    return resolve_pad(pad)


@lru_cache(maxsize=4)
def _pad_file(path: Path, changed_ns: int, size: int) -> Pad:
    """Pad of a file, read once; another one if the file changes."""
    return resolve_pad(path)


def _shape_of(settings: Settings) -> Shape:
    return resolve_shape(
        settings.get("shape", SHAPE),
        settings.get("pixel_mm"),
        settings.get("relief_mm"),
        tile=settings.get("tile", False),
    )


def _trajectory_of(settings: Settings, preindent_um: float) -> Trajectory:
    if "trajectory" in settings:
        trajectory: Trajectory = settings["trajectory"]
        return trajectory
    if "path" in settings:
        return Trajectory.from_table(settings["path"])
    if "pins" in settings:
        return Trajectory.from_pins(settings["pins"], preindent_um=preindent_um)
    slides = "slide_mm_per_s" in settings
    names = ("slide_mm_per_s", "duration_ms", "direction_deg") if slides else ("ramp_ms", "hold_ms")
    arguments = {
        name: settings[name] for name in (*names, "press_um", "press_n") if name in settings
    }
    return Trajectory.slide(**arguments) if slides else Trajectory.press(**arguments)


def _pad_outcome(touch: int, settings: Settings, step_ms: float, shared: _Shared) -> Outcome:
    begin_s = time.perf_counter()
    inputs = inputs_of(settings)
    motion = inputs.trajectory.to_table()
    key = str(motion["sha256"])  # all else that the contact depends on is that of the batch
    if key not in shared.contacts:
        shared.contacts[key] = solve_contact(
            inputs.pad, inputs.shape, inputs.trajectory, inputs.friction
        )
    solved_s = time.perf_counter()
    trials, noise_mv = settings.get("trials", 1), settings.get("noise_mv", 0.0)
    units, parameters_sha256 = inputs.population, _parameters_sha256(inputs.parameters)
    population_sha256 = str(units.to_table()["sha256"])
    endings = units.endings_mm, units.sa_von_mises
    shared.read_as(key, population_sha256, endings, parameters_sha256, trials, noise_mv > 0)
    result = touch_skin(
        *inputs[:5],
        friction=inputs.friction,
        trials=trials,
        noise_mv=noise_mv,
        seed=settings.get("seed", 0),
        contact=shared.contacts[key],
    )
    trajectory = inputs.trajectory
    shape = None if inputs.shape is None else inputs.shape.to_table()
    defaults = {
        **{name: motion[name] for name in _OF_MOTION if name in motion},
        "pad": PAD,
        "population": POPULATION,
        "x_mm": 0.0,
        "z_mm": 0.0,
        "angle_deg": 0.0,
        "tilt_across_deg": 0.0,
        "tilt_along_deg": 0.0,
        "trials": 1,
        "noise_mv": 0.0,
        "seed": 0,
        "endings_mm": float(units.endings_mm),
        "sa_von_mises": bool(units.sa_von_mises),
        "parameters": inputs.parameters.name,
        "preindent_um": trajectory.preindent_um,
    }
    if shape is not None:
        defaults["shape"] = SHAPE
    if trajectory.slides:
        defaults["friction"] = float(inputs.friction)
    if "slide_mm_per_s" in settings:
        defaults["duration_ms"] = float(trajectory.times_ms[-1])
    record = {
        **defaults,
        "units": len(units),
        "spikes": int(result.fired.time_ms.size),
        "end_ms": float(trajectory.times_ms[-1]),
        "window_start_ms": float(trajectory.window_ms[0]),
        "window_end_ms": float(trajectory.window_ms[1]),
        "depth_max_um": float(result.depth_um.max()),
        "force_max": float(result.force_n.max()),
        "force_unit": result.force_unit,
        "pad_sha256": inputs.pad.sha256,
        "shape_sha256": None if shape is None else digest(_plain(shape)),
        "trajectory_sha256": key,
        "population_sha256": population_sha256,
        "parameters_sha256": parameters_sha256,
        "fembridge": __version__,
    }
    rows = _sampled(trajectory.level.size, trajectory.dt_ms, step_ms)
    still = np.zeros(rows.size)
    forces = {
        "time_ms": trajectory.times_ms[rows],
        "x_mm": still if trajectory.x_mm is None else trajectory.x_mm[rows],
        "z_mm": still if trajectory.z_mm is None else trajectory.z_mm[rows],
        "depth_um": result.depth_um[rows],
        "force": result.force_n[rows],
    }
    return Outcome(
        touch,
        record,
        units.afferent,
        units.unit,
        result.fired.unit,
        result.fired.trial,
        result.fired.time_ms,
        forces,
        contact_s=solved_s - begin_s,
        encode_s=time.perf_counter() - solved_s,
    )


_OF_MOTION = ("ramp_ms", "hold_ms", "slide_mm_per_s", "direction_deg")


def _plain(table: Mapping[str, Any]) -> dict[str, Any]:
    """A record with every value as text, of which a digest can be made."""
    return {name: repr(value) for name, value in table.items()}


def _parameters_sha256(parameters: ParameterSet) -> str:
    return digest(parameters_to_table(parameters.parameters))


def _sampled(samples: int, dt_ms: float, step_ms: float) -> IntArray:
    """Samples every `step_ms`, at least one sample apart; none at 0."""
    if not step_ms:
        return np.zeros(0, dtype=np.int64)
    step_ms, last_ms = max(step_ms, dt_ms), (samples - 1) * dt_ms
    times_ms = np.arange(int(last_ms / step_ms + 1e-9) + 1) * step_ms
    return np.unique(np.rint(times_ms / dt_ms).astype(np.int64))


# ---- Stimuli of a map


def _map_outcome(touch: int, settings: Settings, step_ms: float, shared: _Shared) -> Outcome:
    begin_s = time.perf_counter()
    path = map_file(settings["map"])
    response, sha256 = _map_of(path, path.stat().st_mtime_ns)
    parameters = parameter_set(settings.get("parameters", "fitted"))
    result: Simulation = simulate(
        settings["stimulus"],
        response=response,
        parameters=parameters,
        preindent_um=settings.get("preindent_um"),
    )
    if len(result.stimuli) != 1:
        problem = f"names {len(result.stimuli)} stimuli, expected one"
        raise UsageError(problem, argument="stimulus", found=settings["stimulus"])
    [wave] = result.stimuli
    units = [_unit_name(train.afferent, train.unit, train.cell) for train in result.trains]
    sizes = [train.times_ms.size for train in result.trains]
    spike_unit = np.repeat(np.arange(len(units)), sizes)
    time_ms = np.concatenate([train.times_ms for train in result.trains] or [np.zeros(0)])
    depth_um = np.asarray(wave.displacement_um, dtype=np.float64)
    record = {
        "parameters": parameters.name,
        "preindent_um": float(wave.preindent_um),
        "trials": 1,
        "units": len(units),
        "spikes": int(time_ms.size),
        "end_ms": float((depth_um.size - 1) * wave.dt_ms),
        "window_start_ms": float(wave.window_ms[0]),
        "window_end_ms": float(wave.window_ms[1]),
        "depth_max_um": float(depth_um.max()),
        "pad_sha256": sha256,
        "trajectory_sha256": Trajectory.from_waveform(wave).to_table()["sha256"],
        "population_sha256": digest(units),
        "parameters_sha256": _parameters_sha256(parameters),
        "fembridge": __version__,
    }
    rows = _sampled(depth_um.size, wave.dt_ms, step_ms)
    times_ms: FloatArray = np.arange(depth_um.size, dtype=np.float64) * wave.dt_ms
    forces: dict[str, FloatArray] = {
        "time_ms": times_ms[rows],
        "depth_um": depth_um[rows],
    }
    return Outcome(
        touch,
        record,
        tuple(train.afferent for train in result.trains),
        tuple(units),
        spike_unit,
        np.ones(spike_unit.size, dtype=np.int64),
        time_ms,
        forces,
        encode_s=time.perf_counter() - begin_s,
    )


@lru_cache(maxsize=4)
def _map_of(path: Path, changed_ns: int) -> tuple[ResponseMap, str]:
    return read_map(path), sha256_of(path)


def _unit_name(afferent: str, unit: str, cell: int) -> str:
    """Name of a unit of a map: class, unit and cell, as far as there are several."""
    return ".".join(filter(None, (afferent, unit, str(cell) if cell else "")))


# ---- Units


def units_of(row: Settings, folder: Path) -> dict[str, Any]:
    """Columns of ``units`` of the population of a row, but for its number.

    Raises
    ------
    FembridgeError
        The population cannot be made.
    """
    settings = _located(row, folder)
    if "map" in settings:
        path = map_file(settings["map"])
        response, _ = _map_of(path, path.stat().st_mtime_ns)
        parameters = parameter_set(settings.get("parameters", "fitted")).parameters
        units = [
            (_unit_name(site.afferent, site.unit, cell if cells > 1 else 0), site)
            for site in response.places
            for cells in [parameters[site.afferent].cells]
            for cell in range(1, cells + 1)
        ]
        nothing = [None] * len(units)
        return {
            "unit": [name for name, _ in units],
            "afferent": [site.afferent for _, site in units],
            "x_mm": [float(site.x_mm) for _, site in units],
            "z_mm": [site.z_mm for _, site in units],
            "depth_mm": [site.depth_mm for _, site in units],
            "deviate": nothing,
            "endings_seed": nothing,
        }
    population = population_of(settings, _pad_of(settings.get("pad", PAD)))
    return {
        "unit": list(population.unit),
        "afferent": list(population.afferent),
        **{
            name: getattr(population, name)
            for name in ("x_mm", "z_mm", "depth_mm", "deviate", "endings_seed")
        },
    }
