"""Doing one task, in whatever process and on whatever machine: finished, or a cause.

A task may be begun anywhere any number of times; who owns its folder does it, the
others find it finished.
"""

import threading
import time
import traceback
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from decks.analysis import Contact
from decks.mesh import Mesh, read_mesh, write_mesh
from decks.presets import mesh_of
from fembridge.build import Model
from fembridge.errors import FembridgeError, FingerError, MissingError, OutputError, ResponseError
from fembridge.response.response_map import MAP_FILE, ResponseMap, read_map, stored_response
from fembridge.response.solve import Log as Tell
from fembridge.response.solve import solve_response
from fembridge.simulation import Simulation, simulate
from fembridge.solver.ccx import OnProgress, SolverSettings
from fembridge.store import write_text
from fembridge.sweep.answers import is_finished, write_item
from fembridge.sweep.lease import BusyError, leased
from fembridge.sweep.solver_version import solver_version
from fembridge.sweep.study import ladder_of
from fembridge.sweep.task import STORED, Item, Response, Task

STUDY_FILE = "study.toml"
MESH_FILE = "mesh.npz"
BUG_FILE = "failed.txt"

# gmsh has one state a process.
_meshing = threading.Lock()


@dataclass(frozen=True, slots=True)
class Finding:
    """How a task ended: `cause` is "" when it is finished.

    `again` says that it was finished before, `busy` that somebody else is at it.
    `notes` are lines about the solver.
    """

    key: str
    cause: str = ""
    again: bool = False
    busy: bool = False
    wall_s: float = 0.0
    notes: tuple[str, ...] = ()

    @property
    def finished(self) -> bool:
        """Whether its answers are there."""
        return not self.cause


def work(
    task: Task,
    folder: Path,
    *,
    threads: int | None = None,
    patient: bool = True,
    on_progress: OnProgress | None = None,
) -> Finding:
    """Do `task` in the sweep's `folder`; what is wrong with it is its cause.

    Where somebody else is at it, wait for him if `patient`, or else say so. A response
    has to be finished before an item that reads it.
    """
    begin_s = time.monotonic()
    settings = SolverSettings(threads=threads, on_progress=on_progress)
    notes: list[str] = []
    again = False
    try:
        if not (folder / STUDY_FILE).is_file():
            raise OutputError("not there on this machine: all need to share it", folder)
        if isinstance(task, Response):
            again = _do_response(task, folder, patient, settings, notes.append)
        else:
            again = _do_item(task, folder, patient, settings, notes.append)
    except BusyError:
        return Finding(task.key, "somebody else is at it", busy=True)
    except FembridgeError as error:
        cause = " ".join(str(error).replace(f"{folder}/", "").splitlines())
    except Exception as error:  # a bug of ours in one item is no end of the others
        with suppress(OutputError):
            write_text(folder / task.place / BUG_FILE, traceback.format_exc())
        told = " ".join(f"{type(error).__name__}: {error}".splitlines())
        cause = f"a bug of fembridge, {BUG_FILE} in its folder has it all: {told}"
    else:
        cause = ""
    wall_s = round(time.monotonic() - begin_s, 3)
    return Finding(task.key, cause, again, wall_s=wall_s, notes=tuple(notes))


def known_response(task: Response, folder: Path) -> ResponseMap | None:
    """Give the response that was solved for `task` before, if it is whole."""
    try:
        return read_map(folder / task.place / MAP_FILE)
    except ResponseError:
        return None


def _do_response(
    task: Response, folder: Path, patient: bool, settings: SolverSettings, tell: Tell
) -> bool:
    """Solve it, unless it is solved; tell which."""
    if known_response(task, folder) is not None:
        return True
    place = folder / task.place
    with leased(place, patient=patient):
        if known_response(task, folder) is not None:
            return True
        _check_solver(task.solver)
        model = Model(task.finger, _mesh(task, place), task.probe, element=task.element)
        solve_response(
            place,
            model.at_once(),
            settings.shared_by(1),
            depth_um=task.depth_um,
            ladder=ladder_of(task.asked),
            log=tell,
        )
    return False


def _do_item(item: Item, folder: Path, patient: bool, settings: SolverSettings, tell: Tell) -> bool:
    """Simulate it, unless it is finished; tell which."""
    place = folder / item.place
    while not is_finished(place, item):
        with leased(place, patient=patient) as lease:
            if is_finished(place, item):
                break
            begin_s = time.monotonic()
            response = _response(item.response, folder)
            simulation = _simulate(item, response, folder, settings, tell)
            if not lease.is_held():  # somebody thought us dead and does it, or did
                continue
            how = {
                "solver": item.response.solver,
                "wall_s": round(time.monotonic() - begin_s, 3),
                "closure_percent": response.closure_percent,
                "contact": response.origin.get("contact", {}),
                "response": str(item.response.place),
            }
            write_item(place, item, simulation, how)
            with suppress(OSError):
                (place / BUG_FILE).unlink(missing_ok=True)
            return False
    return True


def _simulate(
    item: Item, response: ResponseMap, folder: Path, settings: SolverSettings, tell: Tell
) -> Simulation:
    task = item.response
    place = folder / task.place
    mesh = mesh_of(task.finger) if task.solver == STORED else _mesh(task, place)
    contact = response.origin.get("contact")
    model = Model(
        task.finger,
        mesh,
        task.probe,
        Contact(**contact) if isinstance(contact, dict) else Contact(),
        task.element,
    )

    def simulated(where: Path) -> Simulation:
        return simulate(
            item.stimuli(),
            model,
            where,
            method=item.method,
            parameters=item.parameters,
            parameters_name=item.parameters_name,
            ladder=ladder_of(task.asked),
            response=response,
            settings=settings,
            log=tell,
        )

    if item.method == "map":
        return simulated(folder / item.place)  # which writes nothing there
    with leased(folder / item.solve_place):
        _check_solver(task.solver)
        return simulated(folder / item.solve_place)


def _response(task: Response, folder: Path) -> ResponseMap:
    if task.solver == STORED:
        return stored_response(task.finger, task.probe, task.element)
    return read_map(folder / task.place / MAP_FILE)


def _mesh(task: Response, place: Path) -> Mesh:
    """Take the mesh beside the response, or make it: all that follows shares it."""
    with suppress(FingerError):
        return read_mesh(place / MESH_FILE)
    with _meshing:
        mesh = mesh_of(task.finger)
    write_mesh(place / MESH_FILE, mesh)
    return mesh


def _check_solver(planned: str) -> None:
    """Refuse another solver than the one that the key speaks of."""
    if (here := _version_here()) != planned:
        raise MissingError(f"{here} is here, the sweep was laid out for {planned}")


@cache
def _version_here() -> str:
    return solver_version()
