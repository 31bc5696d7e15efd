"""From stimuli to spikes: the whole pipeline, by response map or by transients.

``map``        one indentation is solved (or a stored one taken); every stimulus is
               an interpolation in it.
``transient``  the indentation shows which contact model is to be trusted; then the
               solver follows each whole waveform.
"""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from decks.analysis import Contact
from fembridge import __version__
from fembridge.build import Model, build_run_folder
from fembridge.errors import MissingError, ResponseError, UsageError
from fembridge.machine import SOLVER_INSTALL_LINE, find_ccx
from fembridge.response.driving_stress import driving_stress, reading_energy
from fembridge.response.indentation import depth_for
from fembridge.response.response_map import ResponseMap
from fembridge.response.solve import CONTACT_CAUSES, LADDER, solve_response
from fembridge.response.stored import stored_response
from fembridge.results import read
from fembridge.run_folder import read_run_folder
from fembridge.simulation import Simulation, encode_all
from fembridge.solvers.batch import run_folders
from fembridge.solvers.outcome import Outcome
from fembridge.solvers.process import THREAD_VARIABLE
from fembridge.solvers.watchdog import Limits, OnProgress
from fembridge.stimulus import Stimulus
from fembridge.trace import StressTrace
from fembridge.typing import Table
from neural import PUBLISHED, Parameters, parameters_to_table

METHODS = ("map", "transient")
RESPONSE_FOLDER = "response"
RUNS_FOLDER = "runs"

Tell = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class SolverSettings:
    """How the solver is run: its threads, how many runs at once, when to give up.

    Without `threads` the environment says (``OMP_NUM_THREADS``), or else the cores
    are shared by the runs that are made at once.

    Raises
    ------
    UsageError
        `threads` or `jobs` below 1.
    """

    threads: int | None = None
    jobs: int = 1
    limits: Limits | None = None
    on_progress: OnProgress | None = None

    def __post_init__(self) -> None:
        for name in ("threads", "jobs"):
            number = getattr(self, name)
            if number is not None and number < 1:
                raise UsageError(f"{name} is {number}, expected 1 or more")

    def threads_each(self, runs: int) -> int | None:
        """Threads of each of `runs` that are made at once; None: the environment's."""
        if self.threads is not None or os.environ.get(THREAD_VARIABLE):
            return self.threads
        return max(1, _cores() // runs)


def simulate(
    stimuli: Sequence[Stimulus],
    model: Model,
    folder: Path,
    *,
    method: str = "map",
    stored: bool = False,
    parameters: Parameters = PUBLISHED,
    parameters_name: str = "",
    ladder: Sequence[Contact] = LADDER,
    response: ResponseMap | None = None,
    settings: SolverSettings | None = None,
    tell: Tell = lambda line: None,
) -> Simulation:
    """Compute stress and spikes; what a solver makes is kept below `folder`.

    Parameters
    ----------
    parameters
        Of all classes; by default those of the paper. A set such as
        ``neural.parameter_set("fitted")``, which the command takes, also tells the
        pre-indentation that `stimuli` should have.
    parameters_name
        What the record calls them.
    stored
        Take the stored response of a reference finger even where a solver is.
    ladder
        The contact models to try, in this order.
    response
        What was accepted for `model` with its contact before: taken, not solved.
    tell
        Hears in one line each where the stress comes from.

    Raises
    ------
    MissingError
        No solver, and no stored response that would do; the message names the
        line that installs one.
    SolverError, ResponseError
        The solver failed, or no contact model is to be trusted.
    """
    if method not in METHODS:
        raise UsageError(f"method {method!r}, expected {' or '.join(METHODS)}")
    if not stimuli:
        raise UsageError("no stimulus to simulate")
    if stored and method == "transient":
        raise UsageError("a stored response answers no transient: leave one out")
    if method == "transient" and (other := reading_energy(parameters)):
        raise UsageError(
            f"drive {parameters[other].drive!r} of {other} reads strain energy, "
            "--method transient gives von Mises stress alone: take --method map"
        )
    settings = settings or SolverSettings()
    deepest = max(stimuli, key=_depth_um)
    if response is not None:
        origin: Table = {"source": "response given"}
    elif stored or find_ccx() is None:
        response = _stored(model, deepest, method, stored, tell)
        origin = {"source": "stored response"}
    else:
        depth_um, place = _depth_um(deepest), folder / RESPONSE_FOLDER
        model, response = _solved(model, depth_um, place, settings, tell, ladder)
        origin = {"source": "CalculiX"}
    if method == "transient":
        traces = _transients(stimuli, model, folder, settings, tell, ladder)
        origin = {**origin, "contacts": _contacts(stimuli, folder)}
    else:
        traces = [driving_stress(response, each, parameters) for each in stimuli]
    return encode_all(
        stimuli,
        traces,
        parameters,
        {
            "fembridge": __version__,
            "method": method,
            **origin,
            "closure_percent": response.closure_percent,
            "response": dict(response.origin),
            **({"parameter_set": parameters_name} if parameters_name else {}),
            "parameters": parameters_to_table(parameters),
        },
    )


def _stored(
    model: Model, deepest: Stimulus, method: str, asked_for: bool, tell: Tell
) -> ResponseMap:
    if method == "transient":
        raise MissingError(
            f"--method transient takes a solver, and there is no ccx on the PATH; "
            f"install it: {SOLVER_INSTALL_LINE}"
        )
    install = "" if asked_for else f"; install the solver: {SOLVER_INSTALL_LINE}"
    try:
        response = stored_response(model.finger, model.probe, model.element)
        if _depth_um(deepest) > response.deepest_um:
            raise ResponseError(
                f"{deepest.id} goes {_depth_um(deepest):.9g} um deep, the stored "
                f"response of finger {model.finger.name!r} reaches "
                f"{response.deepest_um:g} um"
            )
    except ResponseError as error:
        if asked_for:
            raise
        raise MissingError(f"no ccx on the PATH, and {error}{install}") from error
    if asked_for:
        tell(f"stored response of finger {model.finger.name!r}")
    else:
        tell(
            f"no ccx on the PATH: stored response of finger {model.finger.name!r}; "
            f"to solve it here: {SOLVER_INSTALL_LINE}"
        )
    return response


def _solved(
    model: Model,
    needed_um: float,
    folder: Path,
    settings: SolverSettings,
    tell: Tell,
    ladder: Sequence[Contact],
) -> tuple[Model, ResponseMap]:
    """Give the model with the contact that was accepted, and its response."""
    solved = solve_response(
        folder,
        model,
        depth_um=depth_for(needed_um),
        ladder=ladder,
        threads=settings.threads_each(1),
        limits=settings.limits,
        on_progress=settings.on_progress,
        tell=tell,
    )
    contact, outcome = solved.rungs[-1].contact, solved.outcome
    how = "read again" if outcome.skipped else f"solved in {outcome.wall_s:.0f} s"
    tell(
        f"response of finger {model.finger.name!r} {how}: "
        f"{outcome.increments} increments, contact {contact}, unloading within "
        f"{solved.response.closure_percent:.2g} % of loading"
    )
    return replace(model, contact=contact), solved.response


def _transients(
    stimuli: Sequence[Stimulus],
    model: Model,
    folder: Path,
    settings: SolverSettings,
    tell: Tell,
    ladder: Sequence[Contact],
) -> list[list[StressTrace]]:
    """Solve each waveform; one that does not converge gets the next contact model.

    A contact model of the ladder is tried only after its own indentation was
    accepted.
    """
    deepest_um = max(map(_depth_um, stimuli))
    waiting = {folder / RUNS_FOLDER / stimulus.id: stimulus for stimulus in stimuli}
    places, failure = list(waiting), None
    for number, contact in enumerate(_from(model.contact, ladder), start=1):
        if contact != model.contact:
            again = folder / f"{RESPONSE_FOLDER}_{number}"
            try:
                model, _ = _solved(model, deepest_um, again, settings, tell, (contact,))
            except ResponseError as error:
                tell(f"left {contact}: {error}")
                continue
        outcomes = _solve_transients(waiting, model, settings)
        wall_s = sum(outcome.wall_s for outcome in outcomes)
        for outcome in outcomes:
            if outcome.failure is None:
                del waiting[outcome.folder]
                continue
            failure = outcome.to_error()
            if outcome.failure.cause not in CONTACT_CAUSES:
                raise failure
            tell(f"left {contact} for {outcome.folder.name}: {outcome.failure}")
        solved = sum(outcome.accepted for outcome in outcomes)
        if solved:
            tell(f"{solved} transients solved in {wall_s:.0f} s, contact {contact}")
        if not waiting:
            return [read(place) for place in places]
    raise failure or ResponseError(f"{folder}: no contact model was accepted")


def _solve_transients(
    waiting: Mapping[Path, Stimulus], model: Model, settings: SolverSettings
) -> list[Outcome]:
    for place, stimulus in waiting.items():
        build_run_folder(place, model, stimulus)
    return run_folders(
        waiting,
        jobs=settings.jobs,
        threads=settings.threads_each(min(settings.jobs, len(waiting))),
        limits=settings.limits,
        on_progress=settings.on_progress,
    )


def _contacts(stimuli: Sequence[Stimulus], folder: Path) -> Table:
    """Give the contact that each transient was solved with, as its folder has it."""
    return {
        stimulus.id: read_run_folder(folder / RUNS_FOLDER / stimulus.id).inputs[
            "contact"
        ]
        for stimulus in stimuli
    }


def _from(contact: Contact, ladder: Sequence[Contact]) -> tuple[Contact, ...]:
    """Give `contact` and what comes after it on the ladder."""
    below = ladder[ladder.index(contact) + 1 :] if contact in ladder else ()
    return (contact, *below)


def _depth_um(stimulus: Stimulus) -> float:
    return float(stimulus.displacement_um.max())


def _cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
