"""A finding as a sealed TOML file: a finished study is not made again.

It is taken only where it answers the same question: the same versions, the same
extent, the same source of the study's module. One that was edited or cut is refused.
"""

import hashlib
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path

from fembridge.errors import ResponseError
from fembridge.store import read_sealed, write_sealed
from fembridge.typing import Table
from fembridge.verification.finding import Finding

FORMAT = 1
FINDINGS_FOLDER = "findings"


def finding_path(folder: Path, name: str) -> Path:
    """Where the finding of a study stands."""
    return folder / FINDINGS_FOLDER / f"{name}.toml"


def inputs_of_study(module: str, *, quick: bool, versions: Mapping[str, str]) -> Table:
    """Tell what a finding depends on: extent, versions, source of the study."""
    source = Path(str(import_module(module).__file__)).read_bytes()
    return {
        "quick": quick,
        "versions": dict(versions),
        "source_sha256": hashlib.sha256(source).hexdigest(),
    }


def write_finding(path: Path, finding: Finding, inputs: Table) -> None:
    """Write `finding`, which was made from `inputs`."""
    write_sealed(path, {"format": FORMAT, "inputs": inputs, "finding": finding.to_table()})


def read_finding(path: Path, inputs: Table | None = None) -> Finding | None:
    """Read it; None where there is none, or one that other `inputs` were made into.

    Raises
    ------
    ResponseError
        The file was edited or cut, or is no finding.
    """
    if not path.exists():
        return None
    table = read_sealed(path, "finding", FORMAT)
    if inputs is not None and table.get("inputs") != inputs:
        return None
    try:
        return Finding.from_table(table["finding"])
    except (KeyError, TypeError) as error:
        raise ResponseError(f"{path}: not a finding: {error}") from error
