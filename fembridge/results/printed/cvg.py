"""The ``.cvg`` file: one line for each iteration, flushed as it is written."""

import re
from dataclasses import dataclass
from pathlib import Path

from fembridge.errors import ResultError
from fembridge.results.printed.sta import count, real, whole_lines

_HEADER_LINES = 4
_OVERFLOW = re.compile(r" *\*+ *")
_ODD = re.compile(r" *[+-]?(nan|inf|infinity) *", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class CvgRow:
    """One iteration: active contact springs, residuals and corrections in percent.

    `iteration` is None beyond 9999, where CalculiX prints asterisks. Residuals
    may be NaN or infinite: a run that diverges says so here first.
    """

    step: int
    increment: int
    attempt: int
    iteration: int | None
    contact_springs: int | None
    force_residual_percent: float
    displacement_correction_percent: float
    flux_residual_percent: float
    temperature_correction_percent: float


def read_cvg(path: Path) -> list[CvgRow]:
    """Read the iterations so far; a last line without its end is left out.

    Raises
    ------
    ResultError
        There is no such file, or a whole line is no iteration.
    """
    rows = []
    for number, line in whole_lines(path, skip=_HEADER_LINES):
        try:
            rows.append(
                CvgRow(
                    count(line[0:6]),
                    count(line[6:12]),
                    count(line[12:18]),
                    _count(line[18:24]),
                    _count(line[24:33]),
                    *(_percent(line[at : at + 12]) for at in (33, 45, 57, 69)),
                )
            )
        except ValueError as error:
            raise ResultError(f"no iteration: {line[:80]!r}", path, number) from error
    return rows


def _count(field: str) -> int | None:
    return None if _OVERFLOW.fullmatch(field) else count(field)


def _percent(field: str) -> float:
    if _OVERFLOW.fullmatch(field) or _ODD.fullmatch(field):
        return float("inf") if "inf" in field.lower() else float("nan")
    return real(field)
