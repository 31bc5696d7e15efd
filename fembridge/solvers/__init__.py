"""Running a solver: one table of solvers, by the name that ``run.toml`` holds.

A solver's module is imported when a run asks for it. Another package adds a
solver under the entry point group ``fembridge.solvers``: the entry's name is
the solver's, its object is an `Attempt`.
"""

import threading
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from decks.dialects import DIALECTS
from fembridge.errors import MissingError

if TYPE_CHECKING:
    from fembridge.solvers.outcome import Outcome
    from fembridge.solvers.watchdog import Limits, OnProgress

ENTRY_POINTS = "fembridge.solvers"

SOLVERS = {"calculix": "fembridge.solvers.calculix:attempt_calculix"}
"""Where the function of each solver of ours is."""


class Attempt(Protocol):
    """What a solver's function is: run one folder, give the outcome."""

    def __call__(
        self,
        folder: Path,
        *,
        threads: int | None = None,
        limits: "Limits | None" = None,
        on_progress: "OnProgress | None" = None,
        halt: threading.Event | None = None,
    ) -> "Outcome":
        """Solve; a run that is not accepted is an outcome, not an exception."""


def load_solver(name: str) -> Attempt:
    """Import the function that runs the solver `name`.

    Raises
    ------
    MissingError
        No solver of ours nor of an installed package has this name, or it is
        one that only its owner can run.
    """
    if name in SOLVERS:
        module, _, function = SOLVERS[name].partition(":")
        ours: Attempt = getattr(import_module(module), function)
        return ours
    rows = entry_points(group=ENTRY_POINTS)
    for row in rows.select(name=name):
        loaded: Attempt = row.load()
        return loaded
    if name in DIALECTS:
        raise MissingError(
            f"{name.capitalize()} is run by its owner, in the run folder: "
            f"{DIALECTS[name].how_to_run}"
        )
    known = ", ".join(sorted({*SOLVERS, *rows.names}))
    raise MissingError(f"no solver {name!r} here; there is {known}")
