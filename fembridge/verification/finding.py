"""What a study found: tables, charts, checks against bounds, and words.

All of it is plain numbers and text, so that it can be stored, and a page can be made
of it on a machine without a solver.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from fembridge.errors import ResponseError
from fembridge.typing import Table
from fembridge.verification.bench import Cost

Cell = str | int | float

AT_MOST, AT_LEAST = "at most", "at least"
MARKS = ("line", "dots", "both", "dashed")


@dataclass(frozen=True, slots=True)
class NumberTable:
    """A table: `columns`, and `rows` of as many cells, words or numbers.

    `formats` has a Python format for the numbers of each column; a CSV has them with
    all digits. A cell that is NaN is one that could not be had.
    """

    name: str
    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    formats: tuple[str, ...]

    def __post_init__(self) -> None:
        lengths = {len(self.columns), len(self.formats), *map(len, self.rows)}
        if len(lengths) != 1:
            raise ResponseError(
                f"table {self.name}: {len(self.columns)} columns, rows and formats of "
                f"{sorted(lengths)}"
            )


@dataclass(frozen=True, slots=True)
class Line:
    """One series of a panel: `mark` is one of `MARKS`; `label` goes into the legend."""

    label: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    mark: str = "both"

    def __post_init__(self) -> None:
        if self.mark not in MARKS or len(self.x) != len(self.y):
            raise ResponseError(
                f"line {self.label!r}: {len(self.x)} x, {len(self.y)} y, mark {self.mark!r}"
            )


@dataclass(frozen=True, slots=True)
class Panel:
    """One pair of axes; `log` names those that are logarithmic: "", "x", "y", "xy"."""

    along: str
    up: str
    lines: tuple[Line, ...]
    log: str = ""
    title: str = ""


@dataclass(frozen=True, slots=True)
class Chart:
    """A picture: panels side by side, and what it shows."""

    name: str
    caption: str
    panels: tuple[Panel, ...]


@dataclass(frozen=True, slots=True)
class Check:
    """A number that was found, in `unit`, and the bound that it has to keep."""

    what: str
    found: float
    bound: float
    unit: str = ""
    side: str = AT_MOST

    def __post_init__(self) -> None:
        if self.side not in (AT_MOST, AT_LEAST) or not math.isfinite(self.bound):
            raise ResponseError(f"check {self.what!r}: {self.side} {self.bound}")

    @property
    def passed(self) -> bool:
        """Whether the bound is kept; what could not be found keeps none."""
        if self.side == AT_MOST:
            return self.found <= self.bound
        return self.found >= self.bound


@dataclass(frozen=True, slots=True)
class Finding:
    """What one study found.

    `question` is what it asks and how; `words` what the numbers say. `reduced` tells
    what a quick run left out, and is empty for a whole one. `skipped` tells why there
    are no numbers, where something that the study needs is not installed.
    """

    name: str
    title: str
    question: str
    words: tuple[str, ...]
    checks: tuple[Check, ...]
    tables: tuple[NumberTable, ...]
    charts: tuple[Chart, ...] = ()
    reduced: str = ""
    skipped: str = ""
    cost: Cost = Cost()  # noqa: RUF009 - frozen

    @property
    def passed(self) -> bool:
        """Whether every check keeps its bound."""
        return all(check.passed for check in self.checks)

    def to_table(self) -> Table:
        """Turn into what TOML can hold."""
        return asdict(self)

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> "Finding":
        """Make it of what `to_table` gave; what is wrong in it is a `KeyError`, a
        `TypeError` or a `ResponseError`.
        """  # noqa: D205 - one sentence
        return cls(
            name=table["name"],
            title=table["title"],
            question=table["question"],
            words=tuple(table["words"]),
            checks=tuple(Check(**check) for check in table["checks"]),
            tables=tuple(_number_table(each) for each in table["tables"]),
            charts=tuple(_chart(each) for each in table["charts"]),
            reduced=table["reduced"],
            skipped=table["skipped"],
            cost=Cost(**table["cost"]),
        )


def _number_table(table: Mapping[str, Any]) -> NumberTable:
    return NumberTable(
        name=table["name"],
        caption=table["caption"],
        columns=tuple(table["columns"]),
        rows=tuple(tuple(row) for row in table["rows"]),
        formats=tuple(table["formats"]),
    )


def _chart(table: Mapping[str, Any]) -> Chart:
    return Chart(
        name=table["name"],
        caption=table["caption"],
        panels=tuple(
            Panel(
                along=panel["along"],
                up=panel["up"],
                lines=tuple(
                    Line(line["label"], tuple(line["x"]), tuple(line["y"]), line["mark"])
                    for line in panel["lines"]
                ),
                log=panel["log"],
                title=panel["title"],
            )
            for panel in table["panels"]
        ),
    )
