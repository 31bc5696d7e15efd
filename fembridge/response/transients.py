"""Each waveform solved for itself, with the first contact model that carries it."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from decks.analysis import Contact, Model
from decks.motion import SUBSTEPS
from fembridge.build import build_run_folder
from fembridge.errors import ResponseError, UsageError
from fembridge.response.solve import CONTACT_CAUSES, FrictionSlipError, Log, solve_response
from fembridge.results import read
from fembridge.run_folder import RunFolder
from fembridge.solver.batch import run_folders
from fembridge.solver.ccx import finished_outcome
from fembridge.solver.forecast import in_words, increment_s
from fembridge.solver.settings import SolverSettings
from fembridge.stimulus import Stimulus
from fembridge.trace import StressTrace
from fembridge.typing import Table

RESPONSE_FOLDER = "response"
RUNS_FOLDER = "runs"
LONG_S = 600.0
"""What takes longer is only begun when somebody says so."""


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
    all_s = increments * increment_s(share * len(model.mesh.quad)) / settings.jobs
    count = f"{len(stimuli)} transient{'s' if len(stimuli) > 1 else ''}"
    line = f"{count} of {increments} increments in all: about {in_words(all_s)}"
    if all_s > LONG_S and not yes and settings.time_limit_s is None:
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
    ladder: Sequence[Contact],
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
    waiting = {folder / RUNS_FOLDER / stimulus.id: stimulus for stimulus in stimuli}
    places, failure = dict(waiting), None
    solved: dict[Path, RunFolder] = {}
    slips = slips or any(stimulus.aside_um is not None for stimulus in stimuli)
    below = ladder[ladder.index(model.contact) + 1 :] if model.contact in ladder else ()
    for number, contact in enumerate((model.contact, *below), start=1):
        if slips and contact.friction != model.contact.friction:
            continue
        if contact != model.contact:
            again = folder / f"{RESPONSE_FOLDER}_{number}"
            try:
                model, _ = solve_response(
                    again, model, deepest_um, settings, ladder=(contact,), log=log
                )
            except FrictionSlipError:
                slips = True
                model = replace(model, contact=contact)
            except ResponseError as error:
                log(f"left {contact}: {error}")
                continue
        runs = [
            build_run_folder(place, model, each, parameters=parameters)
            for place, each in waiting.items()
        ]
        try:
            outcomes = run_folders(runs, settings.shared_by(min(settings.jobs, len(runs))))
        except KeyboardInterrupt:
            kept = len(solved) + sum(finished_outcome(run) is not None for run in runs)
            log(f"{kept} of {len(stimuli)} transients are kept; the same command goes on with them")
            raise
        for run, outcome in zip(runs, outcomes, strict=True):
            if outcome.failure is None:
                solved[run.folder] = run
                del waiting[run.folder]
                continue
            failure = outcome.to_error()
            if outcome.failure.cause not in CONTACT_CAUSES:
                raise failure
            log(f"left {contact} for {run.folder.name}: {outcome.failure}")
        count = sum(outcome.accepted for outcome in outcomes)
        if count:
            wall_s = sum(outcome.wall_s for outcome in outcomes)
            log(f"{count} transients solved in {wall_s:.0f} s, contact {contact}")
        if not waiting:
            contacts = {each.id: solved[place].inputs["contact"] for place, each in places.items()}
            return [list(read(solved[place])) for place in places], contacts
    raise failure or ResponseError(f"{folder}: no contact model was accepted")
