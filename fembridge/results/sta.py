"""The ``.sta`` file: one line for each increment or failed attempt.

CalculiX flushes it line by line, so it may be read while the run goes on; a
last line without its end is still being written and is left out.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from fembridge.errors import ResultError
from fembridge.trace import MS_PER_S

_HEADER_LINES = 2


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
            rows.append(
                StaRow(
                    step=int(line[1:6]),
                    increment=int(line[6:17]),
                    attempt=int(line[17:23]),
                    failed=line[23:24] == "U",
                    iterations=int(line[24:29]),
                    total_time_ms=float(line[29:43]) * MS_PER_S,
                    step_time_ms=float(line[43:57]) * MS_PER_S,
                    increment_time_ms=float(line[57:71]) * MS_PER_S,
                )
            )
        except ValueError as error:
            raise ResultError(f"no increment: {line!r}", path, number) from error
    return rows


def whole_lines(path: Path, skip: int) -> Iterator[tuple[int, str]]:
    """Yield number and text of each ended, not blank line after the first `skip`."""
    try:
        file = path.open("rb")
    except FileNotFoundError as error:
        raise ResultError("no such file", path) from error
    except OSError as error:
        raise ResultError(f"cannot be opened: {error.strerror}", path) from error
    with file:
        for number, line in enumerate(file, start=1):
            if number > skip and line.endswith(b"\n") and line.strip():
                yield number, line.decode("latin-1").rstrip("\r\n")
