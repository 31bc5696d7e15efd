"""Each waveform solved for itself, with the first contact model that carries it."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from decks.analysis import Contact
from fembridge.build import Model, build_run_folder
from fembridge.errors import ResponseError
from fembridge.response.accepted import Tell, accepted
from fembridge.response.path_dependence import FrictionSlipError
from fembridge.response.solve import CONTACT_CAUSES
from fembridge.results import read
from fembridge.run_folder import read_run_folder
from fembridge.solvers.batch import run_folders
from fembridge.solvers.outcome import Outcome
from fembridge.solvers.settings import SolverSettings
from fembridge.stimulus import Stimulus
from fembridge.trace import StressTrace
from fembridge.typing import Table

RESPONSE_FOLDER = "response"
RUNS_FOLDER = "runs"


def solve_transients(
    stimuli: Sequence[Stimulus],
    model: Model,
    folder: Path,
    settings: SolverSettings,
    tell: Tell,
    ladder: Sequence[Contact],
    *,
    rough: bool = False,
) -> list[list[StressTrace]]:
    """Solve each waveform; one that does not converge gets the next contact model.

    `model` has a contact that was accepted; another one of the ladder is tried only
    after its own indentation was. What skin that slips under friction makes of an
    indentation speaks against a map, not against the contact. Where skin is known to
    slip (`rough`) or the probe slides, contacts of another friction are no choice.

    Raises
    ------
    SolverError, ResponseError
        A run ended for another reason than its contact, or no contact carried it.
    """
    deepest_um = max(stimulus.deepest_um for stimulus in stimuli)
    waiting = {folder / RUNS_FOLDER / stimulus.id: stimulus for stimulus in stimuli}
    places, failure = list(waiting), None
    rough = rough or any(stimulus.aside_um is not None for stimulus in stimuli)
    for number, contact in enumerate(_from(model.contact, ladder), start=1):
        if rough and contact.friction != model.contact.friction:
            continue
        if contact != model.contact:
            again = folder / f"{RESPONSE_FOLDER}_{number}"
            try:
                model, _ = accepted(model, again, deepest_um, settings, tell, (contact,))
            except FrictionSlipError:
                rough = True
                model = replace(model, contact=contact)
            except ResponseError as error:
                tell(f"left {contact}: {error}")
                continue
        outcomes = _solve(waiting, model, settings)
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


def contacts_of(stimuli: Sequence[Stimulus], folder: Path) -> Table:
    """Give the contact that each transient was solved with, as its folder has it."""
    return {
        stimulus.id: read_run_folder(folder / RUNS_FOLDER / stimulus.id).inputs["contact"]
        for stimulus in stimuli
    }


def _solve(
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


def _from(contact: Contact, ladder: Sequence[Contact]) -> tuple[Contact, ...]:
    """Give `contact` and what comes after it on the ladder."""
    below = ladder[ladder.index(contact) + 1 :] if contact in ladder else ()
    return (contact, *below)
