"""Solve a deflection: build the run, let ccx do it, judge it, keep the profile."""

from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from fembridge.build import build_analysis_folder
from fembridge.deflection.measured import measured_deflection
from fembridge.deflection.press import Press
from fembridge.deflection.profile import Deflection
from fembridge.deflection.profile_file import PROFILE_FILE, write_profile
from fembridge.errors import OutputError, ResultError
from fembridge.run_folder import RunFolder
from fembridge.solvers.calculix import attempt_calculix
from fembridge.solvers.outcome import Outcome
from fembridge.solvers.record import finished_outcome
from fembridge.solvers.watchdog import Limits, OnProgress


def solve_deflection(
    folder: Path,
    press: Press,
    *,
    threads: int | None = None,
    limits: Limits | None = None,
    on_progress: OnProgress | None = None,
) -> Deflection:
    """Solve `press` in `folder` and write ``deflection.toml`` there.

    A run that was solved there before, with the same deck, is read again as long as
    its files are whole.

    Raises
    ------
    SolverError
        The run did not reach its depth.
    ResponseError
        It did, but the probe did not push the skin down: see `measured`.
    OutputError
        `folder` cannot be written.
    """
    run = build_analysis_folder(folder, press.analysis(), press.stimulus(), press.inputs())
    deflection = None
    outcome = finished_outcome(run)
    if outcome is not None:
        with suppress(ResultError):  # not all of its files are whole: solve it again
            deflection = _told(run, press, outcome)
    if deflection is None:
        _remove(folder / PROFILE_FILE)  # of a run that is not there any more
        outcome = attempt_calculix(folder, threads=threads, limits=limits, on_progress=on_progress)
        if not outcome.accepted:
            raise outcome.to_error()
        deflection = _told(run, press, outcome)
    write_profile(folder / PROFILE_FILE, deflection)
    return deflection


def _remove(path: Path) -> None:
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"cannot be replaced: {error.strerror}", path) from error


def _told(run: RunFolder, press: Press, outcome: Outcome) -> Deflection:
    """Give the profile, with what made it in its origin."""
    found = measured_deflection(run, press)
    made = {"version": outcome.version or "", "iterations": outcome.iterations}
    return replace(found, origin={**made, **found.origin})
