"""The numbers of a report as long CSV tables, the unit in each column's name."""

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fembridge.errors import UsageError
from fembridge.store import write_text


@dataclass(frozen=True, slots=True)
class LongTable:
    """One row an observation. NaN, a number that is not known, is an empty cell."""

    name: str
    columns: tuple[str, ...]
    rows: tuple[Sequence[object], ...]

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise UsageError(f"{self.name}: {len(row)} cells, expected {len(self.columns)}")

    def write(self, folder: Path) -> None:
        """Write it as `name` into `folder`."""
        out = io.StringIO(newline="")
        table = csv.writer(out, lineterminator="\n")
        table.writerow(self.columns)
        for row in self.rows:
            table.writerow([_cell(value) for value in row])
        write_text(folder / self.name, out.getvalue())


def _cell(value: object) -> object:
    return "" if isinstance(value, float) and math.isnan(value) else value
