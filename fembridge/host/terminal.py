r"""What goes to a terminal: an error in one line, how far it is, and nothing that steers it.

How far it is are bars, which go at the end; elsewhere a line now and then.

A file that somebody sent may have a title with escape sequences, which a terminal
would obey: it could be renamed, cleared, or made to show what is not there. What is
printed passes through `PlainStream`, which shows them as ``\x1b``.
"""

import logging
import re
import shutil
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import timedelta
from time import perf_counter
from typing import TYPE_CHECKING, Any, Self, TextIO

if TYPE_CHECKING:
    import rich.progress

    from fembridge.host.progress import Progress

MOST_LINES = 30
"""Of a table on the screen; the rest is in a file."""

LONGEST_ERROR = 10_000
"""Characters of an error that are printed."""

WIDEST_TEXT = 100
"""Columns of a help page, at most."""

PATIENCE_S = 2.0
# Of a batch system's log: how long nothing is written about a run.
QUIET_S = 30.0
LONGEST_NAME = 28

# C0 but tab and line feed, DEL, C1, line separators, and what turns text around.
_STEERING = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069]")


def plain(text: str) -> str:
    """`text` with control characters shown, not sent."""
    return _STEERING.sub(lambda match: match[0].encode("unicode_escape").decode(), text)


def error_line(problem: object) -> str:
    """``fembridge: ...`` in one line, whole.

    Only of what no message says, more than `LONGEST_ERROR` characters, the middle is left
    out, and counted: a file that somebody sent may have quoted itself into it.
    """
    line = plain(f"fembridge: {' '.join(str(problem).splitlines())}")
    omitted_count = len(line) - LONGEST_ERROR
    if omitted_count <= 0:
        return line
    half = LONGEST_ERROR // 2
    return f"{line[:half]} ... {omitted_count} characters left out ... {line[-half:]}"


def text_width() -> int:
    """Columns for running text: those of the terminal, or COLUMNS, at most 100, less two."""
    return max(20, min(shutil.get_terminal_size((100, 24)).columns, WIDEST_TEXT) - 2)


def wrapped(text: str, width: int) -> str:
    """`text` in lines of at most `width` characters.

    Paragraphs are filled anew. An indented line begins an item of a list, deeper lines continue
    it; a command, indented or after ``example:``, continues in lines that end in a backslash.
    """
    import textwrap

    lines: list[str] = []
    for paragraph in text.split("\n\n"):
        items: list[str] = []
        for line in paragraph.split("\n"):
            indent, command = re.match(r"( *)((?:example: |(?<= ))fembridge )?", line).groups()  # type: ignore[union-attr]
            before = items[-1] if items else ""
            depth = len(before) - len(before.lstrip())
            continues = len(indent) > depth if depth else not indent
            is_open = before and not before.endswith("\n") and not command
            if is_open and continues and (depth or not before.startswith(" ")):
                items[-1] += f" {line.strip()}"
            else:
                items.append(f"{line}\n" if command else line)
        for item in items:
            if item.endswith("\n"):
                lines += _wrapped_command(item[:-1], width)
                continue
            indent = re.match(r" *", item)[0]  # type: ignore[index]
            head = re.match(r" +\S+(?: \S+)*  +", item)
            hanging = head.end() if head else len(f"{indent}  ") if indent else 0
            hanging = min(hanging, width // 2)
            lines += textwrap.wrap(
                item,
                width,
                subsequent_indent=" " * hanging,
                break_long_words=False,
                break_on_hyphens=False,
            ) or [""]
        lines.append("")
    return "\n".join(lines[:-1])


def _wrapped_command(line: str, width: int) -> list[str]:
    """A command in lines of at most `width` characters, that a shell reads as one.

    An option stays in one line with its first value.
    """
    arguments = re.findall(r"""(?:[^\s'"]|'[^']*'|"[^"]*")+""", line)
    parts: list[str] = []
    for before, argument in zip(["", *arguments], arguments, strict=False):
        is_value = before.startswith("-") and not argument.startswith("-")
        parts[len(parts) - is_value :] = [f"{before} {argument}" if is_value else argument]
    indent = " " * (len(line) - len(line.lstrip()))
    lines = [indent + parts[0]]
    for rest, part in zip(range(len(parts) - 2, -1, -1), parts[1:], strict=True):
        if len(lines[-1]) + 1 + len(part) + (2 if rest else 0) > width:
            lines[-1] += " \\"
            lines.append(f"{indent}    {part}")
        else:
            lines[-1] += f" {part}"
    return lines


def log(line: object) -> None:
    """A line on stderr, beside what a verb prints."""
    print(line, file=sys.stderr, flush=True)


def print_table(
    head: Sequence[str], rows: Sequence[Sequence[str]], *, text_columns: int = 1, rest: str = ""
) -> None:
    """Print a table: its first `text_columns` columns are left-aligned, the others right-aligned.

    Of many rows the first are shown, and the `rest` is in a file.
    """
    lines = [head, *rows[: MOST_LINES if rest else None]]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    for line in lines:
        cells = zip(line, widths, "<" * text_columns + ">" * len(widths), strict=False)
        print("  ".join(f"{cell:{side}{width}}" for cell, width, side in cells).rstrip())
    if len(rows) >= len(lines):
        print(f"... {len(rows) + 1 - len(lines)} more in {rest}")


_is_quiet = False


@contextmanager
def quiet_terminal() -> Iterator[None]:
    """Show no bars of progress in the block."""
    global _is_quiet
    before, _is_quiet = _is_quiet, True
    try:
        yield
    finally:
        _is_quiet = before


class _LineHandler(logging.Handler):
    """Keeps each record as a line, and prints it on stderr if it `shows`."""

    def __init__(self, shows: bool) -> None:
        super().__init__(logging.INFO)
        self.shows = shows
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Print the record's message."""
        line = record.getMessage()
        self.lines.append(line)
        if self.shows or record.levelno >= logging.WARNING:
            log(line)


@contextmanager
def logged_lines(*, shows: bool = True) -> Iterator[list[str]]:
    """Print what the package logs in the block as lines on stderr; the lines so far.

    Without `shows`, only warnings and errors are printed.
    """
    logger, handler = logging.getLogger("fembridge"), _LineHandler(shows)
    level, propagates = logger.level, logger.propagate
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    logger.propagate = False
    try:
        yield handler.lines
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)
        logger.propagate = propagates


class PrintError(OSError):
    """What we print cannot be written to the stream of this `number`."""

    number: int


class PlainStream:
    """The text stream `stream`, to which only `plain` text is written.

    What keeps it from being written is a `PrintError`.
    """

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream

    def write(self, text: str) -> int:
        """Write `text`, control characters shown."""
        self._do(self.stream.write, plain(text))
        return len(text)

    def flush(self) -> None:
        """Write what is in the buffer."""
        self._do(self.stream.flush)

    def _do(self, write: Callable[..., object], *text: str) -> None:
        try:
            write(*text)
        except OSError as error:
            problem = PrintError(error.errno, error.strerror)
            problem.number = self.stream.fileno()
            raise problem from error

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - whatever the stream can
        return getattr(self.stream, name)


class Bars:
    """Bars on stderr, from `patience_s` on; without a terminal a line each `quiet_s`.

    A context manager. Calls may come from several threads. rich is imported when the
    first bar is due.
    """

    def __init__(
        self, patience_s: float = PATIENCE_S, *, quiet_s: float = QUIET_S, shows: bool = True
    ) -> None:
        shows = shows and not _is_quiet
        self.on_terminal = shows and sys.stderr.isatty()
        self._shows = shows
        self._quiet_s = quiet_s
        self._begin_s = perf_counter()
        self._due_s = self._begin_s + patience_s
        self._line_s: dict[str, float] = {}
        self._lock = threading.Lock()
        self._bars: rich.progress.Progress | None = None
        self._rows: dict[str, rich.progress.TaskID] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        with self._lock:
            self._shows = False
            if self._bars is not None:
                self._bars.stop()

    def show(self, name: str, share: float, details: str = "") -> None:
        """Move the bar `name` to `share`, 0 to 1; a new one where there is none."""
        with self._lock:
            now_s = perf_counter()
            if not self._shows or now_s < self._due_s:
                return
            if not self.on_terminal:
                if now_s >= self._line_s.get(name, self._begin_s) + self._quiet_s:
                    self._line_s[name] = now_s
                    self.print(f"{name}: {share:.0%}{details and ', '}{details}")
                return
            if self._bars is None:
                self._bars = _start()
            if name not in self._rows:
                short = name if len(name) <= LONGEST_NAME else f"…{name[1 - LONGEST_NAME :]}"
                self._rows[name] = self._bars.add_task(short, total=1.0, details="")
            self._bars.update(self._rows[name], completed=share, details=details)

    def remove(self, name: str) -> None:
        """Remove the bar `name`, if there is one."""
        with self._lock:
            row = self._rows.pop(name, None)
            if self._bars is not None and row is not None:
                self._bars.remove_task(row)

    def print(self, line: str) -> None:
        """Write a line on stderr, above the bars."""
        if self._bars is not None:
            self._bars.console.print(plain(line), markup=False, highlight=False)
        else:
            log(line)


class TaskBars(Bars):
    """A bar for each task of a computation, called as `fembridge.host.progress.Show`.

    Without a terminal nothing is written: tasks are many and short, unlike runs of the solver.
    """

    def __call__(self, task: str, share: float) -> None:
        """Move the bar of `task`; take it away when it is done."""
        if not self.on_terminal:
            return
        if share < 1:
            self.show(task, share)
        else:
            self.remove(task)


class SolverBars(Bars):
    """A bar for each run of the solver, called with how far it is."""

    def __call__(self, progress: "Progress") -> None:
        """Move the bar of a run of the solver; take it away when the run ends."""
        if progress.has_ended:
            self.remove(str(progress.folder))
        else:
            self.show(str(progress.folder), progress.fraction, how_far(progress))


def how_far(progress: "Progress") -> str:
    """Simulated time, increments, iterations and the time left of a run of the solver.

    The share of a bar is that of the simulated time: how many increments a run takes is known
    in advance only where they are fixed and no step comes before.
    """
    counts_text = (
        f"{progress.time_ms:g} of {progress.end_ms:g} ms, {progress.increment} increments, "
        f"{progress.iterations} iterations"
    )
    left_s = progress.left_s
    return (
        counts_text if left_s is None else f"{counts_text}, {timedelta(seconds=round(left_s))} left"
    )


def _start() -> "rich.progress.Progress":
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

    bars = Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=24),
        TaskProgressColumn(),
        TextColumn("{task.fields[details]}", markup=False),
        console=Console(file=getattr(sys.stderr, "stream", sys.stderr)),  # bars do steer
        transient=True,
    )
    bars.start()
    return bars
