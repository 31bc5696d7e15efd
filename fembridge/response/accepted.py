"""A model with the contact that its indentation showed to be trusted."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from decks.analysis import Contact
from fembridge.build import Model
from fembridge.response.indentation import depth_for
from fembridge.response.response_map import ResponseMap
from fembridge.response.solve import solve_response
from fembridge.solvers.settings import SolverSettings

Tell = Callable[[str], None]
"""Hears a line of what goes on."""


def accepted(
    model: Model,
    folder: Path,
    needed_um: float,
    settings: SolverSettings,
    tell: Tell,
    ladder: Sequence[Contact],
) -> tuple[Model, ResponseMap]:
    """Give the model with the contact that was accepted, and its response.

    Of a model whose stress depends on time it is the response that it has at once.

    Raises
    ------
    SolverError, ResponseError
        See `fembridge.response.solve.solve_response`.
    """
    solved = solve_response(
        folder,
        model.at_once(),
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
