"""The ``.sta`` file: one line for each increment or failed attempt.

CalculiX flushes it line by line, so it may be read while the run goes on; a
last line without its end is still being written and is left out.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from fembridge.errors import ResultError
from fembridge.results.printed.text_lines import text_lines
from fembridge.trace import MS_PER_S

_HEADER_LINES = 2
_REAL = re.compile(r" *[+-]?\d*\.\d+(?:[Ee][+-]?\d{2,3}|[+-]\d{3})? *")


@dataclass(frozen=True, slots=True)
class StaRow:
    """One attempt at an increment.

    If it `failed`, `total_time_ms` and `step_time_ms` are those at the start of
    the increment and `increment_time_ms` is the size that was tried.
    """

    step: int
    increment: int
    attempt: int
    failed: bool
    iterations: int
    total_time_ms: float
    step_time_ms: float
    increment_time_ms: float


def read_sta(path: Path) -> list[StaRow]:
    """Read the attempts so far; an empty list before the first.

    Raises
    ------
    ResultError
        There is no such file, or a whole line is no attempt.
    """
    rows = []
    for number, line in whole_lines(path, skip=_HEADER_LINES):
        try:
            if line[23:24] not in ("U", " "):
                raise ValueError(f"{line[23:24]!r} where U or a blank is expected")
            rows.append(
                StaRow(
                    step=count(line[1:6]),
                    increment=count(line[6:17]),
                    attempt=count(line[17:23]),
                    failed=line[23:24] == "U",
                    iterations=count(line[24:29]),
                    total_time_ms=real(line[29:43]) * MS_PER_S,
                    step_time_ms=real(line[43:57]) * MS_PER_S,
                    increment_time_ms=real(line[57:71]) * MS_PER_S,
                )
            )
        except ValueError as error:
            raise ResultError(f"no increment: {line[:80]!r}", path, number) from error
    return rows


def whole_lines(path: Path, skip: int) -> Iterator[tuple[int, str]]:
    """Yield number and text of each ended, not blank line after the first `skip`."""
    for number, line, ended in text_lines(path):
        if number > skip and ended and line.strip():
            yield number, line


def count(field: str) -> int:
    """Read an integer ≥ 0; the whole of `field`, which may have blanks around.

    Raises
    ------
    ValueError
        It is none: not what Python calls an integer, as ``1_0``, either.
    """
    text = field.strip(" ")
    if not (text.isascii() and text.isdigit()):
        raise ValueError(f"{field!r} is no count")
    return int(text)


def real(field: str) -> float:
    """Read a Fortran number with a decimal point.

    Raises
    ------
    ValueError
        It is none.
    """
    if not _REAL.fullmatch(field):
        raise ValueError(f"{field!r} is no number")
    return float(re.sub(r"(?<=\d)(?=[+-]\d{3})", "E", field))  # 1.000000-101
