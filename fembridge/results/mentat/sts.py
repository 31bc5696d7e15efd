"""The ``.sts`` of Marc: one line for each increment, and how the job ended.

    case   inc  cycl  sepa cut   cycl   separ   cut  rmesh time step   total time ...
      1     17    2    0    0      34       0     0     0  1.2558E-01  1.0000E+00 ...

Marc writes it while it runs, so it may be read then: a last line without its end is
left out. Time is taken as s and length as mm, as everywhere. The layout is that of
Marc 2019 to 2021, from real files; programs that contain Marc print other columns.
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fembridge.errors import ResultError
from fembridge.results.printed.text_lines import text_lines
from fembridge.trace import MS_PER_S

SUCCESS = 3004
"""The exit number of a job that reached its end."""

_FIRST_LINE = "style=1"
_JOB = "information summary of job"
_UNDER_HEADER = ("#", "|--")  # two more lines of names
_HEADER = "case inc cycl sepa cut cycl separ cut rmesh time step total time displ-mag"
_WIDTHS = (7, 7, 5, 5, 5, 8, 8, 6, 6, 12, 12, 12, 12)
_COUNTS = 9  # of the thirteen, the others are reals
_COUNT = re.compile(r"\d+")
_REAL = re.compile(r"[+-]?\d+\.\d*(?:[Ee][+-]?\d{1,3}|[+-]\d{2,3})?")
_EXIT = re.compile(r"job ends with exit number *:? *(\d+)", re.IGNORECASE)
_AFTER = re.compile(r"total (?:wall|cpu) +time *:.*", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class StsRow:
    """One increment that ended.

    `cycles`, `separations` and `cut_backs` are of the increment, `total_...` those
    since the job began; `displacement_min_mm` and `displacement_max_mm` the least and
    greatest length of a displacement. A count that outgrew its column is None.
    """

    load_case: int | None
    increment: int | None
    cycles: int | None
    separations: int | None
    cut_backs: int | None
    total_cycles: int | None
    total_separations: int | None
    total_cut_backs: int | None
    remeshings: int | None
    increment_time_ms: float
    total_time_ms: float
    displacement_min_mm: float
    displacement_max_mm: float


@dataclass(frozen=True, slots=True)
class Sts:
    """A whole ``.sts``: what its first lines say, its `rows`, its exit number.

    `exit_number` is None as long as the job has not ended; `unfinished` are the
    number and the text of a last line that has no end yet.
    """

    job: str
    version: str
    rows: tuple[StsRow, ...]
    exit_number: int | None
    unfinished: tuple[int, str] | None

    @property
    def problem(self) -> str | None:
        """Why the job is not one that reached its end; None if it is."""
        if self.exit_number is None:
            where = f", {self._reached}" if self.rows else ""
            return f"the job has not ended, or was killed{where}"
        if self.exit_number != SUCCESS:
            where = f" after {self._reached}" if self.rows else " before any increment"
            return f"the job ended{where} with exit number {self.exit_number}, {SUCCESS} is success"
        return None

    @property
    def _reached(self) -> str:
        row = self.rows[-1]
        return f"increment {row.increment} at {row.total_time_ms:g} ms"


def read_sts(path: Path) -> Sts:
    """Read the increments so far and the exit number.

    Raises
    ------
    ResultError
        There is no such file, it does not begin like a ``.sts``, it has columns that
        are not those above, or a line is neither an increment nor the end.
    """
    said: dict[str, str] = {}
    rows: list[StsRow] = []
    exit_number: int | None = None
    unfinished: tuple[int, str] | None = None
    has_header = False
    for number, line, ended in text_lines(path):
        text = line.strip()
        if not ended and not (_EXIT.fullmatch(text) or _AFTER.fullmatch(text)):
            unfinished = number, line
        elif number == 1:
            _check_first(line, path)
        elif not has_header:
            has_header = _is_header(text, path, number)
            name, _, value = text.partition(":")
            said[name] = value.strip()
        elif found := _EXIT.fullmatch(text):
            exit_number = int(found[1])
        elif exit_number is not None:
            if text and not _AFTER.fullmatch(text):
                raise ResultError(f"after the end: {line[:80]!r}", path, number)
        elif text and (rows or not text.startswith(_UNDER_HEADER)):
            rows.append(_row(line, path, number))
    if not has_header:
        raise ResultError("no line of column names: cut, or no .sts of Marc", path)
    job, version = (said.get(name, "") for name in (_JOB, "version"))
    return Sts(job, version, tuple(rows), exit_number, unfinished)


def sts_rows(path: Path) -> list[StsRow]:
    """Read the increments alone: see `read_sts`."""
    return list(read_sts(path).rows)


def _check_first(line: str, path: Path) -> None:
    if line.strip() != _FIRST_LINE:
        raise ResultError(
            f"begins with {line[:40]!r}, a .sts of Marc with {_FIRST_LINE!r}", path, 1
        )


def _is_header(text: str, path: Path, number: int) -> bool:
    if not text.startswith("case"):
        return False
    if text.split() != _HEADER.split():
        raise ResultError(
            f"columns {' '.join(text.split())!r}, only {_HEADER!r} is known", path, number
        )
    return True


def _row(line: str, path: Path, number: int) -> StsRow:
    """Read a line by words, or by columns where neighbours touch."""
    fields = line.split()
    if len(fields) != len(_WIDTHS):
        fields, at = [], 0
        for width in _WIDTHS:
            fields.append(line[at : at + width].strip())
            at += width
        if line[at:].strip():
            raise ResultError(f"no increment: {line[:120]!r}", path, number)
    try:
        step_s, time_s, *lengths_mm = map(_real, fields[_COUNTS:])
        cells: list[Any] = [_count(field) for field in fields[:_COUNTS]]
        cells += [step_s * MS_PER_S, time_s * MS_PER_S, *lengths_mm]
        return StsRow(*cells)
    except ValueError as error:
        raise ResultError(f"no increment: {error} in {line[:120]!r}", path, number) from error


def _count(field: str) -> int | None:
    if field and not field.strip("*"):
        return None
    if not (field.isascii() and _COUNT.fullmatch(field)):
        raise ValueError(f"{field!r} is no count")
    return int(field)


def _real(field: str) -> float:
    if not (field.isascii() and _REAL.fullmatch(field)):
        raise ValueError(f"{field!r} is no number")
    return float(re.sub(r"(?<=[\d.])(?=[+-]\d)", "E", field))  # 1.0000-101
