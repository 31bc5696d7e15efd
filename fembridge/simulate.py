"""From stimuli to spikes: the whole pipeline, by response map or by transients.

``map``        one indentation is solved (or a stored one taken); every stimulus is
               an interpolation in it.
``transient``  the indentation shows which contact model is to be trusted; then the
               solver follows each whole waveform.
``auto``       the map, unless stress depends on more than the probe's depth: see
               `fembridge.response.path_dependence`.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from decks.analysis import Contact
from fembridge import __version__
from fembridge.build import Model
from fembridge.errors import MissingError, ResponseError, UsageError
from fembridge.machine import SOLVER_INSTALL_LINE, find_ccx
from fembridge.response.accepted import Tell, accepted
from fembridge.response.driving_stress import driving_stress, reading_energy
from fembridge.response.path_dependence import FrictionSlipError, why_no_map
from fembridge.response.response_map import ResponseMap
from fembridge.response.solve import LADDER
from fembridge.response.stored import stored_response
from fembridge.simulation import Simulation, encode_all
from fembridge.solvers.settings import SolverSettings
from fembridge.stimulus import Stimulus
from fembridge.transients import RESPONSE_FOLDER, contacts_of, solve_transients
from fembridge.typing import Table
from neural import PUBLISHED, Parameters, parameters_to_table

METHODS = ("map", "transient")
AUTO = "auto"


def simulate(
    stimuli: Sequence[Stimulus],
    model: Model,
    folder: Path,
    *,
    method: str = AUTO,
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
    method
        One of `METHODS`, or "auto": a map where there can be one.
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
    if method not in (AUTO, *METHODS):
        raise UsageError(f"method {method!r}, expected {AUTO}, {' or '.join(METHODS)}")
    if not stimuli:
        raise UsageError("no stimulus to simulate")
    reason = why_no_map(model, stimuli)
    if stored and (reason or method == "transient"):
        raise UsageError(f"a stored response answers no transient: {reason or 'leave one out'}")
    method = _possible(method, reason, parameters, tell)
    settings = settings or SolverSettings()
    deepest = max(stimuli, key=lambda stimulus: stimulus.deepest_um)
    closure_percent: float | None = None
    origin: Table = {"source": "CalculiX"}
    if response is not None:
        origin = {"source": "response given"}
    elif stored or find_ccx() is None:
        if method == "transient":
            raise MissingError(
                f"{reason or '--method transient'}: that takes a solver, and there is "
                f"no ccx on the PATH; install it: {SOLVER_INSTALL_LINE}"
            )
        response = _stored(model, deepest, stored, tell)
        origin = {"source": "stored response"}
    else:
        place = folder / RESPONSE_FOLDER
        try:
            model, response = accepted(model, place, deepest.deepest_um, settings, tell, ladder)
        except FrictionSlipError as slip:
            reason = "; ".join(why for why in (reason, str(slip)) if why)
            method = _possible(method, reason, parameters, tell)
            model = replace(model, contact=ladder[slip.rung - 1])
            closure_percent = slip.closure_percent
    if response is None or method == "transient":
        traces = solve_transients(
            stimuli, model, folder, settings, tell, ladder, rough=isinstance(closure_percent, float)
        )
        origin = {**origin, "contacts": contacts_of(stimuli, folder)}
    else:
        method = "map"
        traces = [driving_stress(response, each, parameters) for each in stimuli]
    if response is not None:
        closure_percent = response.closure_percent
        origin = {**origin, "response": dict(response.origin)}
    return encode_all(
        stimuli,
        traces,
        parameters,
        {
            "fembridge": __version__,
            "method": method,
            **origin,
            **({"no_map": reason} if reason else {}),
            "closure_percent": closure_percent,
            **({"parameter_set": parameters_name} if parameters_name else {}),
            "parameters": parameters_to_table(parameters),
        },
    )


def _possible(method: str, reason: str | None, parameters: Parameters, tell: Tell) -> str:
    """Give the method that is possible: there is no map where there is a `reason`."""
    if method == "map" and reason is not None:
        raise UsageError(f"no response map: {reason}; take --method transient")
    if method == AUTO and reason is not None:
        tell(f"{reason}; so there is no response map: each waveform is solved")
        method = "transient"
    if method == "transient" and (other := reading_energy(parameters)):
        way_out = "take other parameters" if reason else "take --method map"
        raise UsageError(
            f"drive {parameters[other].drive!r} of {other} reads strain energy, "
            f"--method transient gives von Mises stress alone: {way_out}"
        )
    return method


def _stored(model: Model, deepest: Stimulus, asked_for: bool, tell: Tell) -> ResponseMap:
    install = "" if asked_for else f"; install the solver: {SOLVER_INSTALL_LINE}"
    try:
        response = stored_response(model.finger, model.probe, model.element)
        if deepest.deepest_um > response.deepest_um:
            raise ResponseError(
                f"{deepest.id} goes {deepest.deepest_um:.9g} um deep, the stored "
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
