"""Progress of a solver run, as its monitor reports it; imports nothing heavy."""

from collections.abc import Callable
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
