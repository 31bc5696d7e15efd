"""Status files of a running solver: ``.sta`` and ``.cvg`` of CalculiX, ``.sts`` of Marc.

A ``.sta`` has a line for each attempt at an increment, a ``.cvg`` for each iteration, a ``.sts``
for each increment, and its exit number at the end::

    case   inc  cycl  sepa cut   cycl   separ   cut  rmesh time step   total time ...
      1     17    2    0    0      34       0     0     0  1.2558E-01  1.0000E+00 ...

All are flushed line by line and can be read during the run; an incomplete last line is left out.
Columns have fixed widths and no separators; a count that overflows its column is printed as
stars, here None. The layout of a ``.sts`` comes from real files of Marc 2019 to 2021. Time is
taken as s, length as mm.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import astuple, dataclass, fields
from functools import cache
from itertools import accumulate, islice, pairwise
from pathlib import Path
from typing import Any

from fembridge.errors import ResultError
from fembridge.io.number import parse_number
from fembridge.results.byte_file import suffix_of, text_lines
from fembridge.results.read_options import ReadOptions
from fembridge.trace import seconds_to_ms

SUCCESS = 3004
"""Exit number of a Marc job that reached its end."""

_REAL = re.compile(r" *[+-]?\d?\.\d{4,}(?:[Ee][+-]\d{2,3}|[+-]\d{3}) *")
_FIELD_END = re.compile(r"[^\sU]+")  # U marks a failed attempt
_NO_LETTER = re.compile(r"(?<=[\d.])(?=[+-])")
_NOT_ZERO = re.compile(r" *[+-]?0*\.?0*[1-9]")
_REAL_OF_MARC = re.compile(r" *[+-]?\d\.\d{4}(?:E[+-]\d{2}|[+-]\d{3}) *")
_OVERFLOW = re.compile(r" *\*+ *")
_NOT_FINITE = re.compile(r" *[+-]?(nan|inf|infinity) *", re.IGNORECASE)
_FIRST_LINE = "style=1"  # of a .sts
_UNDER_HEADER = ("#", "|--")  # two more lines of names
_HEADER = "case inc cycl sepa cut cycl separ cut rmesh time step total time displ-mag"
_EXIT = re.compile(r"job ends with exit number *:? *(\d+)", re.IGNORECASE)
_STA_ROUNDING, _STS_ROUNDING = 2.0e-6, 2.0e-4  # share of a sum: seven and five digits are printed
_AFTER_END = re.compile(r"total (?:wall|cpu) +time *:.*", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class StaRow:
    """One attempt at an increment.

    If it `failed`, `total_time_ms` and `step_time_ms` are the times at the start of the
    increment, and `increment_time_ms` is the increment that was tried.
    """

    step: int
    increment: int
    attempt: int
    failed: bool
    iterations: int
    total_time_ms: float
    step_time_ms: float
    increment_time_ms: float


@dataclass(frozen=True, slots=True)
class CvgRow:
    """One iteration: active contact springs, residuals and corrections in percent.

    `iteration` is None beyond 9999. Residuals may be NaN or infinite, the first sign of a run
    that diverges.
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


@dataclass(frozen=True, slots=True)
class StsRow:
    """One completed increment.

    `cycles`, `separations` and `cut_backs` are of the increment, `total_...` since the start of
    the job; `displacement_min_mm` and `displacement_max_mm` are the smallest and largest
    displacement.
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
    """A ``.sts``: completed increments, and the exit number, None while the job runs."""

    rows: tuple[StsRow, ...]
    exit_number: int | None

    @property
    def problem(self) -> str | None:
        """Message if the job did not reach its end; None if it did."""
        if self.exit_number == SUCCESS:
            return None
        last_row = self.rows[-1] if self.rows else None
        reached = last_row and f"increment {last_row.increment} at {last_row.total_time_ms:g} ms"
        if self.exit_number is None:
            return "the job has not ended, or was killed" + (f", {reached}" if reached else "")
        position = f"after {reached}" if reached else "before any increment"
        return f"the job ended {position} with exit number {self.exit_number}, {SUCCESS} is success"


def _parse_count(field: str) -> int:
    """An integer ≥ 0 between blanks; Python's other forms, such as ``1_0``, raise ValueError."""
    text = field.strip(" ")
    if not (text.isascii() and text.isdigit()):
        raise ValueError(f"{field.strip()!r}, expected a count")
    return int(text)


def _parse_long_count(field: str) -> int | None:
    return None if _OVERFLOW.fullmatch(field) else _parse_count(field)


def parse_fortran(text: str) -> float:
    """A finite number printed by Fortran, also without its E: ``1.000000-101``.

    Raises
    ------
    ValueError
        `text` is not a number, or out of the range of float64.
    """
    value = parse_number(_NO_LETTER.sub("E", text))
    if value == 0.0 and _NOT_ZERO.match(text):
        raise ValueError(f"{text.strip()!r} is below the range of float64")
    return value


def _parse_real(field: str) -> float:
    """A Fortran number with a decimal point."""
    if not (field.isascii() and _REAL.fullmatch(field)):
        raise ValueError(f"{field.strip()!r}, expected a number")
    return parse_fortran(field)


def _parse_marc_real(field: str) -> float:
    """A number of a ``.sts``, which has five digits."""
    if not _REAL_OF_MARC.fullmatch(field):
        raise ValueError(f"{field.strip()!r}, expected a number of five digits")
    return _parse_real(field)


def _parse_ms(field: str) -> float:
    return seconds_to_ms(_parse_real(field))


def _parse_marc_ms(field: str) -> float:
    return seconds_to_ms(_parse_marc_real(field))


def _parse_percent(field: str) -> float:
    if _OVERFLOW.fullmatch(field) or _NOT_FINITE.fullmatch(field):
        return float("inf") if "inf" in field.lower() else float("nan")
    return _parse_real(field)


def _parse_failed(field: str) -> bool:
    if field not in ("U", " "):
        raise ValueError(f"{field!r}, expected U or a blank")
    return field == "U"


_Columns = Sequence[tuple[int, Callable[[str], object]]]
# Width and parser of each column; the first character of a .sta is a blank.
_STA: _Columns = (
    (6, _parse_count), (11, _parse_count), (6, _parse_count), (1, _parse_failed), (5, _parse_count),
    (14, _parse_ms), (14, _parse_ms), (14, _parse_ms),
)  # fmt: skip
_CVG: _Columns = (
    (6, _parse_count), (6, _parse_count), (6, _parse_count), (6, _parse_long_count),
    (9, _parse_long_count), *[(12, _parse_percent)] * 4,
)  # fmt: skip
_STS: _Columns = (
    *((width, _parse_long_count) for width in (7, 7, 5, 5, 5, 8, 8, 6, 6)),
    (12, _parse_marc_ms), (12, _parse_marc_ms), (12, _parse_marc_real), (12, _parse_marc_real),
)  # fmt: skip


@cache
def _column_ends(widths: tuple[int, ...]) -> list[int]:
    return list(accumulate(widths))


def _parse_row(
    kind: Callable[..., Any], columns: _Columns, line: str, path: Path, number: int
) -> Any:  # noqa: ANN401
    """Row of type `kind` from a line; a ``.sts`` of another layout is split at blanks."""
    ends = _column_ends(tuple(width for width, _ in columns))
    cells = [line[end - width : end] for end, (width, _) in zip(ends, columns, strict=True)]
    if kind is StsRow and len(line.split()) == len(columns):
        cells, line = line.split(), ""
    try:
        if rest := line[ends[-1] :].strip():
            raise ValueError(f"{rest[:20]!r} after the last column")
        return kind(*(convert(cell) for cell, (_, convert) in zip(cells, columns, strict=True)))
    except ValueError as error:
        raise ResultError(f"invalid row: {error}: {line[:80]!r}", path, number) from error


def _parse_rows(
    kind: Callable[..., Any], columns: _Columns, path: Path, header_lines: int, skipped: int
) -> list[Any]:
    """Row of each complete, non-blank line below the header, without the first `skipped`."""
    lines = (
        (number, line)
        for number, line, closed in text_lines(path)
        if number > header_lines and closed and line.strip()
    )
    return [
        _parse_row(kind, columns, line, path, number)
        for number, line in islice(lines, skipped, None)
    ]


def read_sta(path: Path, skipped: int = 0) -> list[StaRow]:
    """Attempts so far, without the first `skipped`."""
    return _parse_rows(StaRow, _STA, path, 2, skipped)


def read_cvg(path: Path, skipped: int = 0) -> list[CvgRow]:
    """Iterations so far, without the first `skipped`."""
    return _parse_rows(CvgRow, _CVG, path, 4, skipped)


def read_sts(path: Path) -> Sts:
    """Completed increments and the exit number."""
    rows: list[StsRow] = []
    exit_number: int | None = None
    has_columns = False
    for count, line, closed in text_lines(path):
        text = line.strip()
        if not closed and not (_EXIT.fullmatch(text) or _AFTER_END.fullmatch(text)):
            continue  # the line is incomplete
        if count == 1:
            if text != _FIRST_LINE:
                message = f"begins with {line[:40]!r}, expected {_FIRST_LINE!r} in a .sts of Marc"
                raise ResultError(message, path, 1)
        elif not has_columns:
            has_columns = text.startswith("case")
            if has_columns and text.split() != _HEADER.split():
                message = f"columns are {' '.join(text.split())!r}, expected {_HEADER!r}"
                raise ResultError(message, path, count)
        elif exit_match := _EXIT.fullmatch(text):
            exit_number = int(exit_match[1])
        elif exit_number is not None:
            if text and not _AFTER_END.fullmatch(text):
                raise ResultError(f"{line[:80]!r} after the end", path, count)
        elif text and (rows or not text.startswith(_UNDER_HEADER)):
            rows.append(_parse_row(StsRow, _STS, line, path, count))
    if not has_columns:
        raise ResultError("no column names: cut, or not a .sts of Marc", path)
    return Sts(tuple(rows), exit_number)


def status_rows(path: Path, options: ReadOptions) -> Iterator[Sequence[object]]:
    """A status file as a table: column names with units, then row by row.

    None becomes "", a boolean 0 or 1. Problems of the run and an incomplete last line are noted.
    """
    suffix, problem = suffix_of(path), None
    kind: type = {".sta": StaRow, ".cvg": CvgRow, ".sts": StsRow}[suffix]
    rows: Sequence[Any]
    if suffix == ".sts":
        status = read_sts(path)
        rows, problem = status.rows, status.problem
    else:
        rows = read_sta(path) if kind is StaRow else read_cvg(path)
        header_lines, previous_ends, column_warning = 2 if kind is StaRow else 4, list[int](), ""
        for number, line, closed in text_lines(path):
            if number > header_lines and closed and line.strip() and not column_warning:
                field_ends = [match.end() for match in _FIELD_END.finditer(line)]
                if len(field_ends) == len(previous_ends) and field_ends != previous_ends:
                    column_warning = f"line {number}: columns are shifted from the lines above"
                previous_ends = field_ends
            if not closed:
                problem = f"left out: line {number} is incomplete: {line[:40]!r}"
        if column_warning:
            options.note(column_warning)
    if message := _order_problem(rows):
        options.refuse(message, path)
    elif message := _sum_problem(rows):
        options.note(message)
    if problem is not None:
        options.note(problem)
    yield tuple(column.name for column in fields(kind))
    for row in rows:
        cells = ("" if cell is None else cell for cell in astuple(row))
        yield tuple(int(cell) if isinstance(cell, bool) else cell for cell in cells)


def _order_problem(rows: Sequence[Any]) -> str:
    """Message about the first row that is not in order; "" if all are.

    Increments, their attempts and their iterations are numbered from 1 without a gap; a ``.sts``
    numbers its increments over all load cases.
    """
    for number, (before, row) in enumerate(pairwise([None, *rows]), start=1):
        names = ["step", "increment", "attempt", "iteration"][: 3 + isinstance(row, CvgRow)]
        if isinstance(row, StsRow):
            names = ["increment"]
        current = [getattr(row, name) for name in names]
        previous = current if before is None else [getattr(before, name) for name in names]
        if None in (*current, *previous) or (before is None and isinstance(row, StsRow)):
            continue  # a count that overflows its column; a restart
        allowed = [
            previous[:k] + [previous[k] + 1] + [1] * (len(previous) - k - 1)
            for k in range(len(previous))
        ]
        if before is None:
            allowed = [[current[0], *[1] * (len(current) - 1)]]
        elif isinstance(row, StaRow):
            allowed = [allowed[2]] if before.failed else allowed[:2]
        if current not in allowed:
            previous_text = "nothing" if before is None else f"increment {before.increment}"
            return (
                f"row {number}, of increment {row.increment}, cannot follow {previous_text}: "
                "rows are missing, duplicate or not in order"
            )
    return ""


def _sum_problem(rows: Sequence[Any]) -> str:
    """Message about the first row with a wrong time or sum; "" if there is none.

    Within a step the times of a ``.sta`` increase by each converged increment; a ``.sts`` sums
    times and counts over the job.
    """
    for number, (before, row) in enumerate(pairwise(rows), start=2):
        if isinstance(row, CvgRow):
            continue
        share, sums = _STS_ROUNDING, {"total_time_ms": before.total_time_ms}
        growth_ms = row.increment_time_ms
        if isinstance(row, StaRow):
            share, sums = _STA_ROUNDING, {"step_time_ms": before.step_time_ms, **sums}
            growth_ms = 0.0 if row.failed else growth_ms
            if row.step != before.step:
                sums["step_time_ms"] = 0.0
                if row.total_time_ms <= before.total_time_ms:  # TIME RESET
                    del sums["total_time_ms"]
        for name, before_ms in sums.items():
            expected_ms = before_ms + growth_ms
            if abs(getattr(row, name) - expected_ms) > share * abs(expected_ms):
                return (
                    f"row {number}, of increment {row.increment}: {name} is "
                    f"{getattr(row, name):g}, expected {expected_ms:g} from the previous row"
                )
        if isinstance(row, StsRow):
            if None not in (row.load_case, before.load_case):
                allowed_cases = before.load_case, before.load_case + 1
                if row.load_case not in allowed_cases:
                    return f"row {number}: load case {row.load_case} follows {allowed_cases[0]}"
            if (
                None not in (row.remeshings, before.remeshings)
                and row.remeshings < before.remeshings
            ):
                return f"row {number}, of increment {row.increment}: fewer remeshings than before"
            for name in ("cycles", "separations", "cut_backs"):
                total, previous_total = (
                    getattr(row, f"total_{name}"),
                    getattr(before, f"total_{name}"),
                )
                count = getattr(row, name)
                if None not in (total, previous_total, count) and total != previous_total + count:
                    return (
                        f"row {number}, of increment {row.increment}: total_{name} is {total}, "
                        f"expected {previous_total + count} from the previous row"
                    )
    return ""
