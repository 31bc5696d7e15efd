"""``solver.toml``: which deck the results beside it answer, and what they cost.

Written after everything else and removed before anything is replaced: where it
stands and its checksums agree, the results are whole and of that deck.
"""

import tomllib
from pathlib import Path

from decks.dialects import JOB
from fembridge.errors import OutputError
from fembridge.run_folder import SOLVER_FILE, RunFolder
from fembridge.solvers.outcome import Outcome
from fembridge.store import sha256_of, write_text
from fembridge.typing import Table

FORMAT = 1
PRINTED_FILE = f"{JOB}.dat"
"""Forces, where the deck asks for them."""


def write_record(run: RunFolder, outcome: Outcome, deck_sha256: str) -> None:
    """Write the record of an accepted `outcome` whose deck had `deck_sha256`."""
    import tomli_w

    table: Table = {
        "format": FORMAT,
        "solver": run.solver,
        "version": outcome.version or "",
        "exit_code": outcome.exit_code,
        "wall_s": round(outcome.wall_s, 3),
        "increments": outcome.increments,
        "iterations": outcome.iterations,
        "deck_sha256": deck_sha256,
        "results_sha256": sha256_of(run.results),
    }
    printed = run.folder / PRINTED_FILE
    if printed != run.deck and printed.is_file():
        table["printed_sha256"] = sha256_of(printed)
    if outcome.threads is not None:
        table["threads"] = outcome.threads
    write_text(run.folder / SOLVER_FILE, tomli_w.dumps(table))


def remove_record(folder: Path) -> None:
    """Take the record away before the results it speaks of are replaced."""
    path = folder / SOLVER_FILE
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"cannot be replaced: {error.strerror}", path) from error


def finished_outcome(run: RunFolder) -> Outcome | None:
    """Give the outcome on record if the results are whole and of the deck there.

    None when there is no record, or deck or results have changed since.
    """
    try:
        table = tomllib.loads((run.folder / SOLVER_FILE).read_text(encoding="utf-8"))
        if table["format"] != FORMAT:
            return None
        deck_sha256 = sha256_of(run.deck)
        if deck_sha256 != table["deck_sha256"]:
            return None
        if sha256_of(run.results) != table["results_sha256"]:
            return None
        printed = table.get("printed_sha256")  # not in records of earlier versions
        if printed is not None and sha256_of(run.folder / PRINTED_FILE) != printed:
            return None
        return Outcome(
            folder=run.folder,
            skipped=True,
            version=str(table["version"]) or None,
            exit_code=int(table["exit_code"]),
            wall_s=float(table["wall_s"]),
            increments=int(table["increments"]),
            iterations=int(table["iterations"]),
            threads=table.get("threads"),
            as_built=deck_sha256 == run.deck_sha256,
        )
    except (OSError, KeyError, TypeError, ValueError):  # also: no TOML, no UTF-8
        return None
