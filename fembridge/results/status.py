"""What a solver writes while it runs: ``.sta`` and ``.cvg`` of CalculiX, ``.sts`` of Marc.

A ``.sta`` has one line an attempt at an increment, a ``.cvg`` one an iteration, a ``.sts`` one an
increment, and how the job ended::

    case   inc  cycl  sepa cut   cycl   separ   cut  rmesh time step   total time ...
      1     17    2    0    0      34       0     0     0  1.2558E-01  1.0000E+00 ...

All are flushed line by line, so they may be read while the run goes on; a last line without its
end is still being written and is left out. Columns have fixed widths and may touch; a count that
outgrew its column is stars, here None. The layout of a ``.sts`` is that of Marc 2019 to 2021, from
real files. Time is taken as s, length as mm.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import astuple, dataclass, fields
from functools import cache
from itertools import accumulate, islice, pairwise
from pathlib import Path
from typing import Any

from fembridge.errors import ResultError
from fembridge.number import parse_number
from fembridge.results.byte_file import suffix_of, text_lines
from fembridge.results.read_options import ReadOptions
from fembridge.trace import seconds_to_ms

SUCCESS = 3004
"""The exit number of a job of Marc that reached its end."""

_REAL = re.compile(r" *[+-]?\d?\.\d{4,}(?:[Ee][+-]\d{2,3}|[+-]\d{3}) *")
_WORD = re.compile(r"[^\sU]+")  # U behind an attempt that failed
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
_AFTER = re.compile(r"total (?:wall|cpu) +time *:.*", re.IGNORECASE)


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


@dataclass(frozen=True, slots=True)
class CvgRow:
    """One iteration: active contact springs, residuals and corrections in percent.

    `iteration` is None beyond 9999. Residuals may be NaN or infinite: a run that diverges says
    so here first.
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
    """One increment that ended.

    `cycles`, `separations` and `cut_backs` are of the increment, `total_...` those since the
    job began; `displacement_min_mm` and `displacement_max_mm` the least and greatest length
    of a displacement.
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
    """A ``.sts``: the increments so far; `exit_number` is None as long as the job runs."""

    rows: tuple[StsRow, ...]
    exit_number: int | None

    @property
    def problem(self) -> str | None:
        """Why the job is not one that reached its end; None if it is."""
        if self.exit_number == SUCCESS:
            return None
        last = self.rows[-1] if self.rows else None
        reached = last and f"increment {last.increment} at {last.total_time_ms:g} ms"
        if self.exit_number is None:
            return "the job has not ended, or was killed" + (f", {reached}" if reached else "")
        where = f"after {reached}" if reached else "before any increment"
        return f"the job ended {where} with exit number {self.exit_number}, {SUCCESS} is success"


def _count(field: str) -> int:
    """An integer ≥ 0 with blanks around; not what Python calls an integer, as ``1_0``."""
    text = field.strip(" ")
    if not (text.isascii() and text.isdigit()):
        raise ValueError(f"{field.strip()!r} is no count")
    return int(text)


def _long_count(field: str) -> int | None:
    return None if _OVERFLOW.fullmatch(field) else _count(field)


def fortran(text: str) -> float:
    """A finite number as Fortran prints it: ``1.000000-101`` has lost its E.

    Raises
    ------
    ValueError
        It is no number, or out of the range of float64.
    """
    value = parse_number(_NO_LETTER.sub("E", text))
    if value == 0.0 and _NOT_ZERO.match(text):
        raise ValueError(f"{text.strip()!r} is too small for a number of float64")
    return value


def _real(field: str) -> float:
    """A Fortran number with a decimal point."""
    if not (field.isascii() and _REAL.fullmatch(field)):
        raise ValueError(f"{field.strip()!r} is no number")
    return fortran(field)


def _real_of_marc(field: str) -> float:
    """A number of a ``.sts``, which has five digits."""
    if not _REAL_OF_MARC.fullmatch(field):
        raise ValueError(f"{field.strip()!r} is no number of five digits")
    return _real(field)


def _ms(field: str) -> float:
    return seconds_to_ms(_real(field))


def _ms_of_marc(field: str) -> float:
    return seconds_to_ms(_real_of_marc(field))


def _percent(field: str) -> float:
    if _OVERFLOW.fullmatch(field) or _NOT_FINITE.fullmatch(field):
        return float("inf") if "inf" in field.lower() else float("nan")
    return _real(field)


def _is_failed(field: str) -> bool:
    if field not in ("U", " "):
        raise ValueError(f"{field!r} where U or a blank is expected")
    return field == "U"


_Columns = Sequence[tuple[int, Callable[[str], object]]]
# Width, and what is there; the first column of a .sta is a blank.
_STA: _Columns = (
    (6, _count), (11, _count), (6, _count), (1, _is_failed), (5, _count), (14, _ms), (14, _ms),
    (14, _ms),
)  # fmt: skip
_CVG: _Columns = (
    (6, _count), (6, _count), (6, _count), (6, _long_count), (9, _long_count),
    *[(12, _percent)] * 4,
)  # fmt: skip
_STS: _Columns = (
    *((width, _long_count) for width in (7, 7, 5, 5, 5, 8, 8, 6, 6)),
    (12, _ms_of_marc), (12, _ms_of_marc), (12, _real_of_marc), (12, _real_of_marc),
)  # fmt: skip


@cache
def _ends(widths: tuple[int, ...]) -> list[int]:
    return list(accumulate(widths))


def _row(kind: Callable[..., Any], columns: _Columns, line: str, path: Path, number: int) -> Any:  # noqa: ANN401
    """A `kind` of a line; by words, where the columns do not stand where they are known to."""
    ends = _ends(tuple(width for width, _ in columns))
    cells = [line[end - width : end] for end, (width, _) in zip(ends, columns, strict=True)]
    if kind is StsRow and len(line.split()) == len(columns):
        cells, line = line.split(), ""
    try:
        if rest := line[ends[-1] :].strip():
            raise ValueError(f"{rest[:20]!r} behind the last column")
        return kind(*(of(cell) for cell, (_, of) in zip(cells, columns, strict=True)))
    except ValueError as error:
        raise ResultError(f"no row: {error}: {line[:80]!r}", path, number) from error


def _rows(
    kind: Callable[..., Any], columns: _Columns, path: Path, header_lines: int, known: int
) -> list[Any]:
    """A `kind` of each ended, not blank line under the header but the first `known`."""
    lines = (
        (number, line)
        for number, line, ended in text_lines(path)
        if number > header_lines and ended and line.strip()
    )
    return [_row(kind, columns, line, path, number) for number, line in islice(lines, known, None)]


def read_sta(path: Path, known: int = 0) -> list[StaRow]:
    """The attempts so far, without the first `known`; an empty list before the first."""
    return _rows(StaRow, _STA, path, 2, known)


def read_cvg(path: Path, known: int = 0) -> list[CvgRow]:
    """The iterations so far, without the first `known`."""
    return _rows(CvgRow, _CVG, path, 4, known)


def read_sts(path: Path) -> Sts:
    """The increments so far and the exit number."""
    rows: list[StsRow] = []
    exit_number: int | None = None
    has_columns = False
    for count, line, ended in text_lines(path):
        text = line.strip()
        if not ended and not (_EXIT.fullmatch(text) or _AFTER.fullmatch(text)):
            continue  # it is still being written
        if count == 1:
            if text != _FIRST_LINE:
                words = f"begins with {line[:40]!r}, a .sts of Marc with {_FIRST_LINE!r}"
                raise ResultError(words, path, 1)
        elif not has_columns:
            has_columns = text.startswith("case")
            if has_columns and text.split() != _HEADER.split():
                words = f"columns {' '.join(text.split())!r}, only {_HEADER!r} is known"
                raise ResultError(words, path, count)
        elif found := _EXIT.fullmatch(text):
            exit_number = int(found[1])
        elif exit_number is not None:
            if text and not _AFTER.fullmatch(text):
                raise ResultError(f"after the end: {line[:80]!r}", path, count)
        elif text and (rows or not text.startswith(_UNDER_HEADER)):
            rows.append(_row(StsRow, _STS, line, path, count))
    if not has_columns:
        raise ResultError("no line of column names: cut, or no .sts of Marc", path)
    return Sts(tuple(rows), exit_number)


def status_rows(path: Path, options: ReadOptions) -> Iterator[Sequence[object]]:
    """A status file as a table: its columns, with units in their names, then row by row.

    None is empty, a truth 0 or 1. What is wrong with the run, or its last line, is noted.
    """
    suffix, problem = suffix_of(path), None
    kind: type = {".sta": StaRow, ".cvg": CvgRow, ".sts": StsRow}[suffix]
    rows: Sequence[Any]
    if suffix == ".sts":
        found = read_sts(path)
        rows, problem = found.rows, found.problem
    else:
        rows = read_sta(path) if kind is StaRow else read_cvg(path)
        header_lines, ends, doubt = 2 if kind is StaRow else 4, list[int](), ""
        for number, line, ended in text_lines(path):
            if number > header_lines and ended and line.strip() and not doubt:
                now = [word.end() for word in _WORD.finditer(line)]
                if len(now) == len(ends) and now != ends:
                    doubt = f"line {number}: its columns are not those of the lines above"
                ends = now
            if not ended:
                problem = f"line {number} has no end yet and is left out: {line[:40]!r}"
        if doubt:
            options.note(doubt)
    if message := _out_of_order(rows):
        options.refuse(message, path)
    elif message := _contradiction(rows):
        options.note(message)
    if problem is not None:
        options.note(problem)
    yield tuple(column.name for column in fields(kind))
    for row in rows:
        cells = ("" if cell is None else cell for cell in astuple(row))
        yield tuple(int(cell) if isinstance(cell, bool) else cell for cell in cells)


def _out_of_order(rows: Sequence[Any]) -> str:
    """Which row does not follow the one before it; "" where all do.

    Increments, attempts at one and iterations of one are counted from 1 without a gap; a
    ``.sts`` counts its increments over all load cases.
    """
    for number, (before, row) in enumerate(pairwise([None, *rows]), start=1):
        names = ["step", "increment", "attempt", "iteration"][: 3 + isinstance(row, CvgRow)]
        if isinstance(row, StsRow):
            names = ["increment"]
        at = [getattr(row, name) for name in names]
        was = at if before is None else [getattr(before, name) for name in names]
        if None in (*at, *was) or (before is None and isinstance(row, StsRow)):
            continue  # a count that outgrew its column; a restart
        ways = [was[:k] + [was[k] + 1] + [1] * (len(was) - k - 1) for k in range(len(was))]
        if before is None:
            ways = [[at[0], *[1] * (len(at) - 1)]]
        elif isinstance(row, StaRow):
            ways = [ways[2]] if before.failed else ways[:2]
        if at not in ways:
            last = "nothing" if before is None else f"increment {before.increment}"
            return (
                f"row {number}, of increment {row.increment}, cannot follow {last}: rows are "
                "missing, duplicate or not in order"
            )
    return ""


def _contradiction(rows: Sequence[Any]) -> str:
    """Which row has a time or a sum that does not follow from the row before; "" where all do.

    Within a step, the times of a ``.sta`` grow by each increment that converged; a ``.sts`` sums
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
                    f"{getattr(row, name):g}, the row before and the increment make "
                    f"{expected_ms:g}"
                )
        if isinstance(row, StsRow):
            if None not in (row.load_case, before.load_case):
                cases = before.load_case, before.load_case + 1
                if row.load_case not in cases:
                    return f"row {number}: load case {row.load_case} comes after {cases[0]}"
            if (
                None not in (row.remeshings, before.remeshings)
                and row.remeshings < before.remeshings
            ):
                return f"row {number}, of increment {row.increment}: remeshings become fewer"
            for name in ("cycles", "separations", "cut_backs"):
                total, last = getattr(row, f"total_{name}"), getattr(before, f"total_{name}")
                count = getattr(row, name)
                if None not in (total, last, count) and total != last + count:
                    return (
                        f"row {number}, of increment {row.increment}: total_{name} is {total}, "
                        f"the row before and {name} make {last + count}"
                    )
    return ""
