"""Steps of a simulation: the method, the stored response, and transients with their cost."""

import logging
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from decks.contact_analysis import Contact, Model
from decks.finger import Finger
from decks.motion import SUBSTEPS
from decks.probe import Probe
from fembridge.errors import (
    FembridgeError,
    MissingError,
    ResponseError,
    UsageError,
)
from fembridge.host.machine import SOLVER_INSTALL_LINE
from fembridge.io.run_folder import RunFolder
from fembridge.response.indentation import (
    CONTACT_CAUSES,
    LADDER,
    FrictionSlipError,
    format_duration,
    increment_s,
    solve_response,
)
from fembridge.response.response_map import (
    RESPONSE_FOLDER,
    ResponseMap,
    reading_energy,
    stored_response,
)
from fembridge.results import read
from fembridge.simulation import AUTO
from fembridge.solver.analysis import DEFAULT_ELEMENT, Analysis
from fembridge.solver.build import build_run_folder
from fembridge.solver.ccx import finished_outcome, run_folders
from fembridge.solver.settings import Solver
from fembridge.stimulus import Stimulus
from fembridge.trace import StressTrace
from fembridge.typing import Table
from neural import Parameters

_LOGGER = logging.getLogger(__name__)

RUNS_FOLDER = "runs"
LONG_S = 600.0
"""Transients that take longer, in s, need a confirmation."""


def check_cost(
    stimuli: Sequence[Stimulus],
    model: Model,
    settings: Solver,
    *,
    yes: bool,
) -> None:
    """Log the expected duration of the transients of `stimuli`.

    Raises
    ------
    UsageError
        They take more than `LONG_S`, without `yes` or a time limit.
    """
    share = 0.5 if model.section == "half" and not model.inertia else 1.0
    samples = sum(stimulus.displacement_um.size for stimulus in stimuli)
    increments = samples * (SUBSTEPS if model.inertia else 1)
    total_s = increments * increment_s(share * len(model.mesh.quad)) / settings.jobs
    count = f"{len(stimuli)} transient{'s' if len(stimuli) > 1 else ''}"
    line = f"{count} of {increments} increments in all: about {format_duration(total_s)}"
    if total_s > LONG_S and not yes and settings.time_limit_s is None:
        raise UsageError(
            f"{line}: confirm with --yes, or limit each with --time-limit S; less work are fewer "
            "stimuli, --jobs, --finger quick, or --method map where stress depends on depth alone",
            found=total_s,
            expected=f"at most {LONG_S:g} s",
        )
    _LOGGER.info(line)


def solve_transients(
    stimuli: Sequence[Stimulus],
    model: Model,
    folder: Path,
    settings: Solver,
    ladder: Sequence[Contact] = LADDER,
    *,
    slips: bool = False,
    parameters: Table | None = None,
) -> tuple[list[list[StressTrace]], Table]:
    """Traces of each waveform, and the contact model of each by stimulus.

    The contact of `model` was accepted. A waveform that does not converge is solved again
    with the next contact of the ladder, after an indentation accepted that contact. Slip of
    the skin under friction rules out a map, not the contact. If the skin slips (`slips`) or
    the probe slides, contacts with another friction are skipped. `parameters` is written to
    the ``run.toml`` of each run.
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
                    retry_folder, model, deepest_um, settings, ladder=(contact,)
                )
            except FrictionSlipError:
                slips = True
                model = replace(model, contact=contact)
            except ResponseError as error:
                _LOGGER.info(f"rejected contact {contact}: {error}")
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
            _LOGGER.info(
                f"interrupted: {finished_count} of {len(stimuli)} transients are solved and kept, "
                "the same command continues"
            )
            raise
        for (name, run), outcome in zip(runs.items(), outcomes, strict=True):
            if outcome.failure is None:
                solved[name] = run
                continue
            failure = outcome.to_error()
            if outcome.failure.cause not in CONTACT_CAUSES:
                raise failure
            _LOGGER.info(f"rejected contact {contact} for {name}: {outcome.failure}")
        count = sum(outcome.accepted for outcome in outcomes)
        if count:
            wall_s = sum(outcome.wall_s for outcome in outcomes)
            _LOGGER.info(f"solved {count} transients in {wall_s:.0f} s, contact {contact}")
        if len(solved) == len(stimuli):
            contacts = {stimulus.id: solved[stimulus.id].inputs["contact"] for stimulus in stimuli}
            return [list(read(solved[stimulus.id])) for stimulus in stimuli], contacts
    raise failure or ResponseError("no contact model was accepted", folder)


def select_method(
    method: str,
    reason: str | None,
    parameters: Parameters,
) -> str:
    """The possible method: ``transient`` if `reason` rules out a map."""
    if method == "map" and reason is not None:
        raise UsageError(
            f"is 'map', no response map exists: {reason}; use transient",
            argument="method",
            found=method,
            expected="transient",
        )
    if method == AUTO and reason is not None:
        _LOGGER.info(f"method transient, each waveform is solved: {reason}")
        method = "transient"
    if method == "transient" and (energy_class := reading_energy(parameters)):
        remedy = "choose other parameters" if reason else "use map"
        raise UsageError(
            f"is 'transient', which gives von Mises stress; drive "
            f"{parameters[energy_class].drive!r} of {energy_class} reads strain energy: {remedy}",
            argument="method",
            found=method,
            expected="map",
        )
    return method


def read_stored_response(
    finger: Finger,
    probe: Probe,
    analysis: Analysis,
    deepest: Stimulus,
    is_requested: bool,
) -> ResponseMap:
    """The stored response of `finger`, which must reach the depth of the `deepest` stimulus."""
    try:
        element = analysis.element or DEFAULT_ELEMENT
        response = stored_response(
            finger, probe, element, depth_um=deepest.deepest_um, law=analysis.law
        )
        if deepest.deepest_um > response.deepest_um:
            raise ResponseError(
                f"{deepest.id} goes {deepest.deepest_um:.9g} um deep, the stored "
                f"response of finger {finger.name!r} reaches "
                f"{response.deepest_um:g} um",
                found=deepest.deepest_um,
                expected=f"at most {response.deepest_um:g} um",
            )
    except ResponseError as error:
        if is_requested:
            raise
        install = f"install the solver: {SOLVER_INSTALL_LINE}"
        raise MissingError(f"no ccx on the PATH, and {error}; {install}") from error
    line = f"response: stored response of finger {finger.name!r}"
    reason = "" if is_requested else f"; no ccx on the PATH, install it: {SOLVER_INSTALL_LINE}"
    _LOGGER.info(f"{line}{reason}")
    return response
