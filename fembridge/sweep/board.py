"""How far a sweep is: bars on a terminal, a line an item elsewhere; all on stderr."""

import sys
import time
from types import TracebackType
from typing import TYPE_CHECKING

from fembridge.progress import LONGEST_NAME, words_of
from fembridge.progress import _start as start_bars
from fembridge.solver.ccx import Progress
from fembridge.sweep.crew import Begun, Ended, Event, PutOff
from fembridge.sweep.task import Item, Task
from fembridge.sweep.work import Finding

if TYPE_CHECKING:
    import rich.progress


class Board:
    """Counts the items of a sweep and shows them; quiet where `shows` is False.

    A context manager. `before` of `total` items were finished when it began.
    """

    def __init__(self, total: int, before: int, *, shows: bool = True) -> None:
        self.total, self.done, self.failed = total, before, 0
        self._before, self._shows = before, shows
        self._running: dict[str, Task] = {}
        self._begin_s = time.monotonic()
        self._bars: rich.progress.Progress | None = None
        self._whole: rich.progress.TaskID | None = None
        self._rows: dict[str, rich.progress.TaskID] = {}

    def __enter__(self) -> "Board":
        if self._shows and sys.stderr.isatty():
            self._bars = start_bars()
            self._whole = self._bars.add_task("sweep", total=self.total, words="")
            self._update()
        elif self._shows and self._before:
            self._say(f"{self._before} of {self.total} items are finished already")
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._bars is not None:
            self._bars.stop()

    def __call__(self, event: Event) -> None:
        """Take note of what the crew told."""
        if isinstance(event, Begun):
            self._running[event.task.key] = event.task
        elif isinstance(event, PutOff):
            self._running.pop(event.task.key, None)
        elif isinstance(event, Ended):
            self._running.pop(event.task.key, None)
            if isinstance(event.task, Item):
                self.over(event.task, event.finding)
        elif self._bars is not None:
            self._follow(event)
        self._update()

    def over(self, item: Item, finding: Finding) -> None:
        """Count an item that is finished or failed."""
        if finding.finished:
            self.done += 1
        else:
            self.failed += 1
        if not finding.finished:
            self._say(f"failed: {item}: {finding.cause}")
        elif self._bars is None:
            how = "finished elsewhere" if finding.again else f"{finding.wall_s:.1f} s"
            self._say(f"{self.done + self.failed}/{self.total} {item}: {how}")
        self._update()

    def __str__(self) -> str:
        told = f"{self.done} done, {len(self._running)} running, {self.failed} failed"
        left = self.total - self.done - self.failed
        made = self.done + self.failed - self._before
        if not left or not made:
            return told
        left_s = round((time.monotonic() - self._begin_s) * left / made)
        hours, rest_s = divmod(left_s, 3600)
        return f"{told}, {hours}:{rest_s // 60:02d}:{rest_s % 60:02d} left"

    def _follow(self, progress: Progress) -> None:
        """Move, make or take away the bar of one run of the solver."""
        assert self._bars is not None
        name = str(progress.folder)
        if progress.ended:
            if (row := self._rows.pop(name, None)) is not None:
                self._bars.remove_task(row)
            return
        if name not in self._rows:
            told = self._task_in(progress.folder.as_posix())
            short = told if len(told) <= LONGEST_NAME else f"{told[:LONGEST_NAME]}…"
            self._rows[name] = self._bars.add_task(short, total=1.0, words="")
        self._bars.update(self._rows[name], completed=progress.fraction, words=words_of(progress))

    def _task_in(self, folder: str) -> str:
        """Name the task that is solved in `folder`."""
        for task in self._running.values():
            place = task.solve_place if isinstance(task, Item) else task.place
            if f"/{place.as_posix()}/" in folder:
                return str(task).removeprefix("response ")
        return folder.rpartition("/")[2]

    def _update(self) -> None:
        if self._bars is not None and self._whole is not None:
            completed = self.done + self.failed
            self._bars.update(self._whole, completed=completed, words=str(self))

    def _say(self, line: str) -> None:
        if not self._shows:
            return
        if self._bars is not None:
            self._bars.console.print(line, markup=False, highlight=False)
        else:
            print(line, file=sys.stderr, flush=True)
