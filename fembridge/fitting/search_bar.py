"""A bar on a terminal while a search runs: its evaluations, and the front's best."""

import sys
from time import perf_counter
from types import TracebackType
from typing import TYPE_CHECKING

from fembridge.bars import start_bars
from neural.search import Progress

if TYPE_CHECKING:
    import rich.progress

PATIENCE_S = 1.0


class SearchBar:
    """Shows each `Progress` it is called with; nothing where there is no terminal.

    A context manager: the bar goes at its end. rich is imported when it is due.
    """

    def __init__(self) -> None:
        self._bars: rich.progress.Progress | None = None
        self._rows: dict[str, rich.progress.TaskID] = {}
        self._shows = sys.stderr.isatty()
        self._start_s = perf_counter()

    def __enter__(self) -> "SearchBar":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._shows = False
        if self._bars is not None:
            self._bars.stop()

    def __call__(self, afferent: str, progress: Progress) -> None:
        """Move the bar of this class."""
        if not self._shows or perf_counter() - self._start_s < PATIENCE_S:
            return
        if self._bars is None:
            self._bars = start_bars()
        told = words_of(progress)
        if afferent not in self._rows:
            self._rows[afferent] = self._bars.add_task(afferent, total=progress.of, told=told)
        self._bars.update(self._rows[afferent], completed=progress.evaluations, told=told)

    def end(self, afferent: str) -> None:
        """Take away the bar of a class that is done."""
        row = self._rows.pop(afferent, None)
        if self._bars is not None and row is not None:
            self._bars.remove_task(row)


def words_of(progress: Progress) -> str:
    """Tell evaluations, the size of the front and its least RMSE, in a line."""
    return (
        f"{progress.evaluations}/{progress.of} evaluations, front of "
        f"{progress.front_size}, best RMSE {progress.least_rmse_ips:.3g} ips"
    )
