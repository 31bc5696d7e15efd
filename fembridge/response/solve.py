"""The indentation, with the first contact model that is to be trusted; whole waveforms.

To 400 um each of the probe's nodes is prescribed, so all that was measured of contacts
was measured; deeper it hangs on a stiff spring (see ``decks/calculix.inp.j2``): prescribed, ccx
loses all contact on the way back. With a spring the linear law reaches 1.5 mm, and at
every depth to 400 um the stress is that of the prescribed probe within 0.01 %.

The ladder is tried from the top; its first contact also on a spring and in smaller
steps. Node-to-surface with friction came back to its loading curve in every run to 400 um
and takes two iterations an increment; what follows is for meshes on which it does not
converge, in the order of what it changes: softer stick springs, then no friction (0.3 %
of stress at most), softer springs (2 %), and last surface-to-surface contact, which is
path-dependent. A contact model that runs but does not come back is not taken: see
`acceptance`.

A map is one indentation, read at the depth of each sample, so time and place must not
matter: no layer relaxes, no mass is accelerated, the probe does not slide. That is
known before anything is solved. Friction is not: skin that slips under the probe on
its way in does not slip back on the same way out. Where the indentation comes back
without friction, it is not the contact that is path-dependent but the skin that slips.

Where no map holds, each waveform is solved for itself, a transient, with the contact that
the indentation accepted, or the next of the ladder.
"""

import statistics
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from decks.analysis import Contact, Model
from decks.motion import SUBSTEPS
from fembridge.build import build_run_folder
from fembridge.cache import entries
from fembridge.errors import ResponseError, UsageError
from fembridge.response.acceptance import (
    CLOSURE_PERCENT,
    DEEP_UM,
    DEFAULT_DEPTH_UM,
    STEPS,
    HysteresisError,
    depth_for,
    indentation,
    measured_response,
)
from fembridge.response.response_map import MAP_FILE, ResponseMap, write_map
from fembridge.results import read
from fembridge.run_folder import RunFolder
from fembridge.solver.batch import run_folders
from fembridge.solver.ccx import finished_outcome, solve_once
from fembridge.solver.settings import DEFAULTS, SolverSettings
from fembridge.solver.verdict import Cause, Outcome
from fembridge.stimulus import Stimulus
from fembridge.store import make_folder, write_text
from fembridge.trace import StressTrace
from fembridge.typing import Table

LADDER = (
    Contact("node-to-surface", stiffness_mpa_per_mm=200.0),
    Contact("node-to-surface", stiffness_mpa_per_mm=200.0, stick_share=0.01),
    Contact("node-to-surface", stiffness_mpa_per_mm=200.0, friction=0.0),
    Contact("node-to-surface", stiffness_mpa_per_mm=50.0),
    Contact("surface-to-surface", stiffness_mpa_per_mm=1000.0),
    Contact("surface-to-surface", stiffness_mpa_per_mm=3000.0),
)

# Ends of a run that another contact model may avoid. A missing solver, a full
# disk or an interrupt are no reason to try the next.
CONTACT_CAUSES = frozenset(
    {Cause.DIVERGED, Cause.ENDLESS_ITERATION, Cause.STALLED, Cause.NEGATIVE_JACOBIAN}
)

ATTEMPTS_FILE = "contacts.txt"
RESPONSE_FOLDER = "response"
RUNS_FOLDER = "runs"
LONG_S = 600.0
"""What takes longer is only begun when somebody says so."""
# An increment costs two iterations, each a factorisation: of a plane mesh about the 1.15th
# power of its elements, as `fembridge verify` measured from 1 600 to 39 700 of them.
_ELEMENTS, _INCREMENT_S, _POWER = 3100, 0.45, 1.15
_DECK_BYTES = 69.4
"""Of a deck of the reference fingers, an element."""

Log = Callable[[str], None]
"""Called with each line about what goes on."""


class FrictionSlipError(HysteresisError):
    """Friction is what unloading differs by: without it the same contact comes back.

    The contact model `contact` is sound; the stress of a waveform takes the whole way
    of the probe, a transient.
    """

    def __init__(self, problem: str, closure_percent: float, contact: Contact) -> None:
        super().__init__(problem, closure_percent)
        self.args = (problem, closure_percent, contact)  # these rebuild it after pickling
        self.contact = contact


class Attempt(NamedTuple):
    """One way to solve the indentation."""

    contact: Contact
    support: str
    steps: int = STEPS

    def __str__(self) -> str:
        steps = "" if self.steps == STEPS else f", {self.steps} steps"
        spring = ", probe on a spring" if self.support == "spring" else ""
        return f"{self.contact}{spring}{steps}"


def why_no_map(model: Model, stimuli: Sequence[Stimulus]) -> str | None:
    """Why stress is no function of depth alone; None: nothing is known.

    Friction is not judged here: see `solve_response`.
    """
    relaxing = [layer for layer, one in model.finger.materials.items() if one.prony]
    if relaxing:
        verb = "relaxes" if len(relaxing) == 1 else "relax"
        return f"{', '.join(relaxing)} {verb}: stress depends on time, not on depth alone"
    if model.inertia:
        return "inertia counts: stress depends on acceleration, not on depth alone"
    sliding = [stimulus.id for stimulus in stimuli if stimulus.aside_um is not None]
    if sliding:
        return (
            f"{sliding[0]}: the probe slides across the skin: stress depends on its "
            "place, not on depth alone"
        )
    return None


def solve_response(
    folder: Path,
    model: Model,
    needed_um: float = DEFAULT_DEPTH_UM,
    settings: SolverSettings = DEFAULTS,
    *,
    ladder: Sequence[Contact] = LADDER,
    log: Log = lambda line: None,
) -> tuple[Model, ResponseMap]:
    """`model` with the first contact of the `ladder` that is accepted, and its response.

    The response answers stimuli down to `needed_um`; of a model whose stress depends on
    time it is the one that it has at once. It is solved in `folder`, one run folder a
    contact model. One that was solved before, with the same deck, there or as the cache
    has it, is read again as long as its files are whole. The accepted map is written as
    ``response.toml``.

    Raises
    ------
    SolverError
        A run ended for a reason that another contact model does not cure.
    FrictionSlipError
        One is not accepted for the friction alone: no map holds for it.
    ResponseError
        None was accepted: each with its reason.
    """
    depth_um, settings, still = depth_for(needed_um), settings.shared_by(1), model.at_once()

    def solved(name: str, attempt: Attempt) -> tuple[Outcome, ResponseMap | ResponseError]:
        """The response that was accepted, or why the attempt is left."""
        stimulus = indentation(depth_um, attempt.steps)
        moved = replace(still, support=attempt.support, contact=attempt.contact)
        run = build_run_folder(folder / name, moved, stimulus)
        outcome = solve_once(run, settings)
        if outcome.failure is not None:
            if outcome.failure.cause not in CONTACT_CAUSES:
                raise outcome.to_error()
            return outcome, ResponseError(str(outcome.failure))
        try:
            return outcome, measured_response(run, stimulus.times_ms, stimulus.displacement_um)
        except ResponseError as error:
            return outcome, error

    attempts = attempts_for(depth_um, ladder)
    increments = indentation(depth_um).displacement_um.size - 1
    half = attempts[0].support == "spring" and still.section == "half"
    elements = len(model.mesh.quad) * (0.5 if half else 1.0)
    about = in_words(increments * increment_s(elements))
    log(f"indentation to {depth_um:g} um: {increments} increments, about {about}")
    make_folder(folder)
    left: list[str] = []
    for number, attempt in enumerate(attempts, start=1):
        if left:
            log(f"contact model {number} of {len(attempts)}: {attempt}")
        outcome, found = solved(f"contact_{number}", attempt)
        if isinstance(found, ResponseMap):
            write_map(folder / MAP_FILE, found)
            how = "read again" if outcome.skipped else f"solved in {outcome.wall_s:.0f} s"
            how = "taken from the cache" if outcome.cached else how
            log(
                f"response of finger {model.finger.name!r} {how}: "
                f"{outcome.increments} increments, contact {attempt.contact}, unloading within "
                f"{found.closure_percent:.2g} % of loading"
            )
            return replace(model, contact=attempt.contact), found
        if isinstance(found, HysteresisError) and attempt.contact.friction > 0:
            without = replace(attempt.contact, friction=0.0)
            _, smooth = solved(f"frictionless_{number}", attempt._replace(contact=without))
            if isinstance(smooth, ResponseMap):
                raise FrictionSlipError(
                    f"skin slips under the probe: with {attempt.contact}, unloading differs "
                    f"from loading by {found.closure_percent:.3g} % at the same depth, without "
                    f"friction by {smooth.closure_percent:.2g} %, expected at most "
                    f"{CLOSURE_PERCENT} %: stress depends on the probe's way, not on depth "
                    "alone",
                    found.closure_percent,
                    attempt.contact,
                )
        problem = str(found).removeprefix(f"{folder / f'contact_{number}'}: ")
        left.append(f"{attempt}: {problem}")
        log(f"left {left[-1]}")
    write_text(folder / ATTEMPTS_FILE, "\n".join(left) + "\n")
    raise ResponseError(
        f"{folder}: none of {len(left)} contact models was accepted to {depth_um:g} um, each "
        f"with its reason in {ATTEMPTS_FILE}; take a smaller amplitude, or --law neo-hookean"
    )


def attempts_for(depth_um: float, ladder: Sequence[Contact]) -> list[Attempt]:
    """What is tried in turn; no contact model is a cure for more than `DEEP_UM`."""
    support = "prescribed" if depth_um <= DEFAULT_DEPTH_UM else "spring"
    first, *others = (Attempt(contact, support) for contact in ladder)
    spring = Attempt(first.contact, "spring")
    firsts = [first] if support == "spring" else [first, spring]
    firsts.append(spring._replace(steps=2 * STEPS))
    return firsts if depth_um > DEEP_UM else [*firsts, *others]


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


def increment_s(elements: float) -> float:
    """Seconds of an increment of a mesh of so many `elements`, as runs in the cache took here."""
    shares: list[float] = [
        record["wall_s"] / record["increments"] / (record["deck_bytes"] / _DECK_BYTES) ** _POWER
        for record in (entry.record for entry in entries())
        if record.get("wall_s") and record.get("increments")
    ]
    share = statistics.median(shares) if shares else _INCREMENT_S / _ELEMENTS**_POWER
    return float(share * elements**_POWER)


def in_words(seconds: float) -> str:
    """A time of which the first figure may be right: ``20 s``, ``4 min``, ``6 h``."""
    size, unit = next(
        (each for each in ((3600.0, "h"), (60.0, "min")) if seconds >= 1.5 * each[0]), (1.0, "s")
    )
    count = max(seconds, 1.0) / size
    figures = 1 if unit == "s" and count < 10 else 2
    return f"{float(f'{count:.{figures}g}'):g} {unit}"


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
