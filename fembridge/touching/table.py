"""Tables that a touch reads: populations, paths and pins.

Every column counts, so a misspelt one is refused; and a table without a line end is named.
"""

import os
import warnings
from collections.abc import Sequence
from pathlib import Path

from fembridge.errors import FembridgeWarning
from fembridge.tables import TextTable, read_table


def read_touch_table(path: Path, columns: Sequence[str], optional: Sequence[str]) -> TextTable:
    """A CSV table that has `columns`, may have `optional` ones, and no others.

    Raises
    ------
    TableError
        As `read_table`; an unknown column, with the nearest known one.

    Warns
    -----
    FembridgeWarning
        No line end behind the last cell, which may be cut.
    """
    table = read_table(path, columns, optional)
    if path.is_file():  # a pipe is read once
        with path.open("rb") as file:
            file.seek(-1, os.SEEK_END)
            check_line_end(path, file.read(1))
    return table


def check_line_end(path: Path, last_byte: bytes) -> None:
    """Warn of a text that does not end in a line end."""
    if last_byte not in (b"\n", b"\r"):
        warnings.warn(
            f"{path}: no line end behind the last cell, which may be cut",
            FembridgeWarning,
            stacklevel=4,
        )
