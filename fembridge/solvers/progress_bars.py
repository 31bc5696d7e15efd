"""Bars on a terminal: one line a run, from its third second on."""

import sys
import threading
from types import TracebackType
from typing import TYPE_CHECKING

from fembridge.bars import start_bars
from fembridge.solvers.watchdog import Progress

if TYPE_CHECKING:
    import rich.progress

PATIENCE_S = 2.0
LONGEST_NAME = 28


class ProgressBars:
    """Shows each `Progress` it is called with; nothing where there is no terminal.

    A context manager: a bar goes when its run ends, all go at its end. Calls may
    come from several threads. rich is imported when the first bar is due.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._bars: rich.progress.Progress | None = None
        self._rows: dict[str, rich.progress.TaskID] = {}
        self._shows = sys.stderr.isatty()

    def __enter__(self) -> "ProgressBars":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        with self._lock:
            self._shows = False
            if self._bars is not None:
                self._bars.stop()

    def __call__(self, progress: Progress) -> None:
        """Move the bar of this run."""
        with self._lock:
            if progress.ended:
                self._forget(progress)
            elif self._shows and progress.elapsed_s >= PATIENCE_S:
                self._show(progress)

    @property
    def shown(self) -> tuple[str, ...]:
        """Folders that have a bar now."""
        return tuple(self._rows)

    def _show(self, progress: Progress) -> None:
        if self._bars is None:
            self._bars = start_bars()
        name = str(progress.folder)
        if name not in self._rows:
            short = name if len(name) <= LONGEST_NAME else f"…{name[1 - LONGEST_NAME :]}"
            self._rows[name] = self._bars.add_task(short, total=1.0, told="")
        self._bars.update(self._rows[name], completed=progress.fraction, told=words_of(progress))

    def _forget(self, progress: Progress) -> None:
        row = self._rows.pop(str(progress.folder), None)
        if self._bars is not None and row is not None:
            self._bars.remove_task(row)


def words_of(progress: Progress) -> str:
    """Tell increments, iterations and the time left, in a line."""
    told = (
        f"{progress.increment}/{progress.increments} increments, {progress.iterations} iterations"
    )
    left_s = progress.left_s
    if left_s is None:
        return told
    minutes, seconds = divmod(round(left_s), 60)
    hours, minutes = divmod(minutes, 60)
    clock = f"{hours}:{minutes:02d}:{seconds:02d}" if hours else f"{minutes}:{seconds:02d}"
    return f"{told}, {clock} left"
