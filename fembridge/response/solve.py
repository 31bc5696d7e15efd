"""Solve the indentation: the first contact model that is to be trusted.

The ladder is tried from the top. Node-to-surface with friction came back to its
loading curve in every run to 400 um and takes two iterations an increment; what
follows is for meshes and depths on which it does not converge, in the order of
what it changes: softer stick springs, then no friction (0.3 % of stress at most),
softer springs (2 %), and last surface-to-surface contact, which remembers. A rung
that runs but does not come back is not taken: see `acceptance`. Where it comes back
without friction, it is not the contact that remembers but the skin that slips: see
`path_dependence`.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from decks.analysis import Contact
from fembridge.build import Model, build_run_folder
from fembridge.errors import ResponseError, ResultError
from fembridge.response.indentation import DEFAULT_DEPTH_UM, indentation
from fembridge.response.map_file import MAP_FILE, write_map
from fembridge.response.measured import measured_response
from fembridge.response.path_dependence import (
    FrictionSlipError,
    RemembersError,
    slip_words,
    why_no_map,
)
from fembridge.response.response_map import ResponseMap
from fembridge.run_folder import RunFolder
from fembridge.solvers.calculix import attempt_calculix
from fembridge.solvers.outcome import Cause, Outcome
from fembridge.solvers.record import finished_outcome
from fembridge.solvers.watchdog import Limits, OnProgress
from fembridge.store import make_folder

LADDER = (
    Contact("node-to-surface", stiffness_mpa_per_mm=200.0),
    Contact("node-to-surface", stiffness_mpa_per_mm=200.0, stick_share=0.01),
    Contact("node-to-surface", stiffness_mpa_per_mm=200.0, friction=0.0),
    Contact("node-to-surface", stiffness_mpa_per_mm=50.0),
    Contact("surface-to-surface", stiffness_mpa_per_mm=1000.0),
    Contact("surface-to-surface", stiffness_mpa_per_mm=3000.0),
)

# Ends of a run that another contact model may avoid. A missing solver, a full
# disk or an interrupt are no reason to try the next rung.
CONTACT_CAUSES = frozenset(
    {Cause.DIVERGED, Cause.ENDLESS_ITERATION, Cause.STALLED, Cause.NEGATIVE_JACOBIAN}
)


@dataclass(frozen=True, slots=True)
class Rung:
    """One rung that was tried: its contact model, and why it was left, if it was."""

    contact: Contact
    problem: str | None

    def __str__(self) -> str:
        return f"{self.contact}: {self.problem or 'accepted'}"


@dataclass(frozen=True, slots=True, eq=False)
class Solved:
    """An accepted response, what it cost, and the rungs tried until then."""

    response: ResponseMap
    rungs: tuple[Rung, ...]
    outcome: Outcome


def solve_response(
    folder: Path,
    model: Model,
    *,
    depth_um: float = DEFAULT_DEPTH_UM,
    ladder: Sequence[Contact] = LADDER,
    threads: int | None = None,
    limits: Limits | None = None,
    on_progress: OnProgress | None = None,
    tell: Callable[[str], None] | None = None,
) -> Solved:
    """Solve the response of `model` in `folder`, one run folder a rung.

    A rung that was solved there before, with the same deck, is read again as long
    as its files are whole. The accepted map is written as ``response.toml``.

    Raises
    ------
    SolverError
        A run ended for a reason that another contact model does not cure.
    FrictionSlipError
        A rung is not accepted for the friction alone: no map holds for it.
    ResponseError
        No rung was accepted; the message lists each with its reason. Or stress
        depends on time: no map holds for such a model.
    OutputError
        `folder` cannot be written.
    """
    if (reason := why_no_map(model, ())) is not None:
        raise ResponseError(f"{folder}: no response map: {reason}")
    # Each node prescribed: so all that was measured of contacts was measured.
    model = replace(model, support="prescribed")
    stimulus = indentation(depth_um)
    make_folder(folder)
    climb = partial(_climb, threads=threads, limits=limits, on_progress=on_progress)
    rungs: list[Rung] = []
    for number, contact in enumerate(ladder, start=1):
        place = folder / f"contact_{number}"
        run = build_run_folder(place, replace(model, contact=contact), stimulus)
        outcome, found = climb(run)
        if isinstance(found, ResponseMap):
            write_map(folder / MAP_FILE, found)
            return Solved(found, (*rungs, Rung(contact, None)), outcome)
        if isinstance(found, RemembersError) and contact.friction > 0:
            smooth = replace(model, contact=replace(contact, friction=0.0))
            place = folder / f"frictionless_{number}"
            _, without = climb(build_run_folder(place, smooth, stimulus))
            if isinstance(without, ResponseMap):
                words = slip_words(contact, found.closure_percent, without.closure_percent)
                raise FrictionSlipError(words, found.closure_percent, number)
        rungs.append(Rung(contact, str(found).removeprefix(f"{run.folder}: ")))
        if tell is not None:
            tell(f"left {rungs[-1]}")
    listed = "; ".join(str(rung) for rung in rungs)
    raise ResponseError(f"{folder}: no contact model was accepted: {listed}")


def _climb(
    run: RunFolder, *, threads: int | None, limits: Limits | None, on_progress: OnProgress | None
) -> tuple[Outcome, ResponseMap | ResponseError]:
    """Give the response that was accepted, or why the rung is left."""
    finished = finished_outcome(run)
    if finished is not None:
        with suppress(ResultError):  # not all of its files are whole: solve it again
            return finished, _judged(run.folder)
    outcome = attempt_calculix(run.folder, threads=threads, limits=limits, on_progress=on_progress)
    if outcome.failure is None:
        return outcome, _judged(run.folder)
    if outcome.failure.cause not in CONTACT_CAUSES:
        raise outcome.to_error()
    return outcome, ResponseError(str(outcome.failure))


def _judged(folder: Path) -> ResponseMap | ResponseError:
    try:
        return measured_response(folder)
    except ResponseError as error:
        return error
