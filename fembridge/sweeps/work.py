"""What a sweep does: responses to be solved once, and items that read them.

Both are values that a worker on any machine can do. Their key is the digest of all
that goes into them, so the same work has the same folder, and `work` may be begun
anywhere any number of times: one process at a time has the folder, the others find it
finished. The folder of a finished item::

    answers.csv  rate, spikes and peak stress by stimulus and afferent
    spikes.csv   every spike, as in the other verbs
    item.toml    what it was made of and how, with the checksums of the two

The record is written last and carries a checksum of its own: where all agree, the
item is finished and whole.
"""

import threading
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, suppress
from dataclasses import asdict, dataclass
from functools import cache, cached_property
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, cast

from decks.analysis import Contact, Model
from decks.finger import Finger
from decks.mesh import Mesh, read_mesh, write_mesh
from decks.presets import finger_table, mesh_of
from decks.probe import Probe
from decks.stimuli import Entry
from decks.waveform import make_stimulus
from fembridge.build import stimulus_inputs
from fembridge.errors import (
    FembridgeError,
    FingerError,
    LockedError,
    MissingError,
    OutputError,
    ResponseError,
)
from fembridge.executor import send
from fembridge.machine import SOLVER_INSTALL_LINE, find_ccx, version_of
from fembridge.response.indentation import solve_response
from fembridge.response.response_map import MAP_FILE, ResponseMap, read_map, stored_response
from fembridge.simulation import SPIKES_FILE, Simulation, encode_all, solve_transients
from fembridge.solver.settings import Progress, SolverSettings
from fembridge.stimulus import Stimulus
from fembridge.store import (
    SHORT,
    digest,
    filling,
    folder_lock,
    make_folder,
    read_sealed,
    sha256_of,
    write_sealed,
    write_text,
)
from fembridge.sweeps.study import Asked, ladder_of
from fembridge.tables import write_spikes, write_table
from fembridge.typing import Table
from fembridge.version import __version__
from neural import Parameters
from neural.parameter_sets import parameters_to_table
from neural.rates import spikes_inside

if TYPE_CHECKING:
    import pandas as pd

FORMAT = 1
"""Of what a key is made of; another number, and all is done again."""

STORED = "stored"
"""In the place of a solver: the responses that are shipped."""

STUDY_FILE = "study.toml"
ANSWERS_FILE = "answers.csv"
RECORD_FILE = "item.toml"
MESH_FILE = "mesh.npz"

ANSWER_COLUMNS = ("stimulus", "afferent", "rate_ips", "spikes", "peak_stress_pa")
"""`spikes` are those inside the counting window, of all cells of a population;
`peak_stress_pa` is the largest stress that the afferent's drive reads."""

BUG_FILE = "failed.txt"

_SOLVES, _RUNS, _LOCK = "solves", "runs", ".lock"
_FILES = (ANSWERS_FILE, SPIKES_FILE)
# What makes a transient another one than those before: see decision 0014.
_HOW_SOLVED = {"drive": "spring", "section": "half"}

# gmsh has one state a process.
_meshing = threading.Lock()


class _Keyed:
    """What is known, and has its folder, by the digest of all that goes into it."""

    below: ClassVar[str]

    def inputs(self) -> Table:
        """What it is made of."""
        raise NotImplementedError

    @cached_property
    def key(self) -> str:
        """Digest of all that goes into it."""
        return digest(self.inputs())

    @property
    def place(self) -> Path:
        """Its folder, below that of the sweep."""
        return Path(self.below, self.key[:SHORT])


@dataclass(frozen=True, eq=False)
class Response(_Keyed):
    """The indentation of one finger with one probe, to be solved once.

    `solver` is its name and version; ``stored`` takes a shipped response.
    """

    finger: Finger
    probe: Probe
    asked: Asked
    element: str
    depth_um: float
    solver: str
    label: str = ""
    below: ClassVar[str] = _SOLVES

    def inputs(self) -> Table:
        """What it is made of."""
        return {
            "format": FORMAT,
            "fembridge": __version__,
            "solver": self.solver,
            "element": self.element,
            "depth_um": self.depth_um,
            "contact": dict(self.asked),
            "probe": asdict(self.probe),
            "finger": finger_table(self.finger),
        }

    def read(self, folder: Path) -> ResponseMap:
        """What it came to in the sweep's `folder`, or what is stored for it."""
        if self.solver == STORED:
            return stored_response(self.finger, self.probe, self.element, depth_um=self.depth_um)
        return read_map(folder / self.place / MAP_FILE)

    def is_finished(self, folder: Path) -> bool:
        """Whether nothing has to be solved for it in the sweep's `folder`."""
        with suppress(ResponseError):
            return self.solver == STORED or bool(self.read(folder))
        return False

    def __str__(self) -> str:
        return f"response {self.label}"


@dataclass(frozen=True, eq=False)
class Item(_Keyed):
    """One row of work: `entries` on a response, by one method, with one set of cells.

    By map it holds all stimuli of the study, as a transient one. `parameters_name`
    is no part of its key: the numbers are.
    """

    response: Response
    method: str
    entries: tuple[Entry, ...]
    preindent_um: float
    seed: int | None
    parameters: Parameters
    parameters_name: str = ""
    label: str = ""
    below: ClassVar[str] = _RUNS

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", dict(self.parameters))  # it pickles

    @property
    def solve_place(self) -> Path:
        """Where a transient is solved: the folder of its motion, whatever the cells."""
        waves = [stimulus_inputs(each) for each in self.stimuli()]
        key = digest({"response": self.response.key, "transient": waves})
        return Path(_SOLVES, key[:SHORT])

    def stimuli(self) -> list[Stimulus]:
        """Samples of its stimuli."""
        return [
            make_stimulus(entry, preindent_um=self.preindent_um, seed=self.seed)
            for entry in self.entries
        ]

    def inputs(self) -> Table:
        """What it is made of, its response by key."""
        # Seeds may be longer than any float is exact for.
        seed = {} if self.seed is None else {"seed": str(self.seed)}
        return {
            "format": FORMAT,
            "method": self.method,
            "stimuli": [
                {"id": one.id, "preindent_um": self.preindent_um, **one.numbers(), **seed}
                for one in sorted(self.entries, key=lambda entry: entry.id)
            ],
            **(_HOW_SOLVED if self.method == "transient" else {}),
            "parameters": parameters_to_table(self.parameters),
            "response": self.response.key,
        }

    def is_finished(self, folder: Path) -> bool:
        """Whether the sweep's `folder` has all of it, as it was written."""
        place = folder / self.place
        try:
            record = read_sealed(place / RECORD_FILE, "record of an item", FORMAT)
            return record["key"] == self.key and all(
                sha256_of(place / name) == record["files"][name] for name in _FILES
            )
        except (FembridgeError, OSError, KeyError, TypeError):
            return False

    def __str__(self) -> str:
        return self.label


Task = Response | Item


@dataclass(frozen=True, slots=True)
class Ended:
    """How a task ended: `cause` is "" when it is finished.

    `before` says that it was finished before, `busy` that another process is at it.
    """

    cause: str = ""
    before: bool = False
    busy: bool = False
    wall_s: float = 0.0


def work(task: Task, folder: Path, threads: int | None = None, *, waits: bool = True) -> Ended:
    """Do `task` in the sweep's `folder`; what is wrong with it is its cause.

    Where another process is at it, wait if it `waits`, or else say so. A response has
    to be finished before an item that reads it. How far the solver is, is sent to who
    began the task, with the task's label.
    """
    begin_s = time.monotonic()
    cause, before = "", False

    def on_progress(progress: Progress) -> None:
        send((task.label, progress))

    try:
        if not (folder / STUDY_FILE).is_file():
            raise OutputError("not there on this machine: all need to share it", folder)
        before = task.is_finished(folder)
        if not before:
            with _alone(folder / task.place, waits):
                before = task.is_finished(folder)
                if not before:
                    do: Callable[..., None] = _solve if isinstance(task, Response) else _answer
                    do(task, folder, SolverSettings(threads, on_progress=on_progress))
    except LockedError as error:
        return Ended(str(error), busy=True)
    except FembridgeError as error:
        cause = " ".join(str(error).replace(f"{folder}/", "").splitlines())
    except OSError as error:
        cause = f"{error.filename or 'cannot read or write'}: {error.strerror or error}"
    except Exception as error:  # a bug of ours in one item is no end of the others
        with suppress(OutputError):
            write_text(folder / task.place / BUG_FILE, traceback.format_exc())
        found = " ".join(f"{type(error).__name__}: {error}".splitlines())
        cause = f"a bug of fembridge, {BUG_FILE} in its folder has it all: {found}"
    return Ended(cause, before, wall_s=round(time.monotonic() - begin_s, 3))


def read_answers(place: Path) -> "pd.DataFrame":
    """Answers of a finished item: rate, spikes and peak stress by stimulus and afferent."""
    import pandas as pd

    exact = {"rate_ips": float, "spikes": int, "peak_stress_pa": float}
    return pd.read_csv(place / ANSWERS_FILE, converters=exact)


@cache
def solver_version() -> str:
    """Name and version of the solver on this machine, as ``calculix 2.20``."""
    program = find_ccx()
    if program is None:
        raise MissingError(
            f"no ccx on the PATH; install it: {SOLVER_INSTALL_LINE}; or say "
            "'stored = true' in the study: the reference fingers have stored responses"
        )
    return f"calculix {version_of(program)[0] or 'of no known version'}"


def _solve(task: Response, folder: Path, settings: SolverSettings) -> None:
    _check_solver(task.solver)
    place = folder / task.place
    solve_response(
        place,
        Model(task.finger, _mesh(task, place), task.probe, element=task.element),
        task.depth_um,
        settings,
        ladder=ladder_of(task.asked),
    )


def _answer(item: Item, folder: Path, settings: SolverSettings) -> None:
    """Simulate an item and write its three files, the record last."""
    place, begin_s = folder / item.place, time.monotonic()
    response = item.response.read(folder)
    simulation = _simulate(item, response, folder, settings)
    how = {
        "solver": item.response.solver,
        "wall_s": round(time.monotonic() - begin_s, 3),
        "closure_percent": response.closure_percent,
        "contact": response.origin.get("contact", {}),
        "response": str(item.response.place),
    }
    with filling(place, last=RECORD_FILE) as draft:
        write_table(draft / ANSWERS_FILE, ANSWER_COLUMNS, _answers_of(simulation))
        write_spikes(draft / SPIKES_FILE, simulation.trains)
        record = {
            "format": FORMAT,
            "key": item.key,
            "parameter_set": item.parameters_name,
            "how": how,
            "files": {name: sha256_of(draft / name) for name in _FILES},
            "inputs": {**item.inputs(), "response": item.response.inputs()},
        }
        write_sealed(draft / RECORD_FILE, record)
    with suppress(OSError):
        (place / BUG_FILE).unlink(missing_ok=True)


def _simulate(
    item: Item, response: ResponseMap, folder: Path, settings: SolverSettings
) -> Simulation:
    """Spikes of all stimuli of an item: by the map, or each waveform solved."""
    task, stimuli = item.response, item.stimuli()
    if item.method == "map":
        traces = [response.traces(each, item.parameters) for each in stimuli]
    else:
        accepted = Contact(**cast("dict[str, Any]", response.origin["contact"]))
        mesh = _mesh(task, folder / task.place)
        model = Model(task.finger, mesh, task.probe, accepted, task.element)
        place, ladder = folder / item.solve_place, ladder_of(task.asked)
        with _alone(place):
            _check_solver(task.solver)
            traces, _ = solve_transients(stimuli, model, place, settings, lambda line: None, ladder)
    return encode_all(stimuli, traces, item.parameters, {})


def _answers_of(simulation: Simulation) -> Iterator[tuple[str, str, float, int, float]]:
    """A row for each stimulus and afferent, of `ANSWER_COLUMNS`."""
    spikes: Counter[tuple[str, str]] = Counter()
    windows = {each.id: each.window_ms for each in simulation.stimuli}
    for train in simulation.trains:
        inside = spikes_inside(train.times_ms, windows[train.stimulus])
        spikes[train.stimulus, train.afferent] += inside
    traces = chain.from_iterable(simulation.traces)
    for rate, trace in zip(simulation.mean_rates, traces, strict=True):
        key = rate.stimulus, rate.afferent
        yield (*key, rate.rate_ips, spikes[key], float(trace.stress_pa.max()))


def _mesh(task: Response, place: Path) -> Mesh:
    """Mesh beside the response, made where there is none: all that follows shares it."""
    with suppress(FingerError):
        return read_mesh(place / MESH_FILE)
    with _meshing:
        mesh = mesh_of(task.finger)
    write_mesh(place / MESH_FILE, mesh)
    return mesh


def _alone(place: Path, waits: bool = True) -> AbstractContextManager[None]:
    return folder_lock(make_folder(place), _LOCK, wait=waits)


def _check_solver(planned: str) -> None:
    """Refuse another solver than the one that the key speaks of."""
    if (here := solver_version()) != planned:
        raise MissingError(f"{here} is here, the sweep was laid out for {planned}")
