"""Progress of a solver run and of long computations; imports nothing heavy.

A computation that may take seconds calls `advance`; whoever wants to show it, as the command line
does, names a function by `showing`. Without one `advance` does nothing.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Progress:
    """Progress of the run in `folder`.

    `increment` of `increments` have converged, up to `time_ms` of `end_ms`;
    `iterations` counts all iterations, `iterations_here` those of the current attempt.
    `has_ended` marks the last report of a run, accepted or not.
    """

    folder: Path
    increment: int
    increments: int
    time_ms: float
    end_ms: float
    iterations: int
    iterations_here: int
    elapsed_s: float
    has_ended: bool = False

    @property
    def fraction(self) -> float:
        """Share of the simulated time that is solved, 0 to 1."""
        return min(1.0, max(0.0, self.time_ms / self.end_ms)) if self.end_ms else 0.0

    @property
    def left_s(self) -> float | None:
        """Estimated seconds to the end at the pace so far; None before the first increment."""
        done = self.fraction
        return self.elapsed_s * (1.0 - done) / done if done > 0 else None


OnProgress = Callable[[Progress], None]
"""Called with the progress of a run, from the thread that runs it."""


Show = Callable[[str, float], None]
"""Called with the name of a task and its finished share, 0 to 1."""

_show: ContextVar[Show | None] = ContextVar("show", default=None)


def advance(task: str, share: float) -> None:
    """Report that `share` of `task`, 0 to 1, is done."""
    show = _show.get()
    if show is not None:
        show(task, share)


@contextmanager
def showing(show: Show) -> Iterator[None]:
    """Pass the progress of all tasks in the block to `show`."""
    token = _show.set(show)
    try:
        yield
    finally:
        _show.reset(token)
