"""Who does the tasks of a sweep: what it is told, and what it tells."""

from dataclasses import dataclass
from typing import Protocol, TypeAlias

from fembridge.solver.ccx import Progress
from fembridge.sweep.task import Task
from fembridge.sweep.work import Finding


@dataclass(frozen=True, slots=True, eq=False)
class Begun:
    """Somebody has begun `task`."""

    task: Task


@dataclass(frozen=True, slots=True, eq=False)
class Ended:
    """`task` is over, with what was found."""

    task: Task
    finding: Finding


@dataclass(frozen=True, slots=True, eq=False)
class PutOff:
    """Another sweep is at `task`: it is looked at again later."""

    task: Task


Event: TypeAlias = Begun | Ended | PutOff | Progress


class Crew(Protocol):
    """Processes here or elsewhere; a task that is lost with one is done by another."""

    def submit(self, task: Task) -> None:
        """Take a task on, to be done when somebody is free."""

    def next_event(self) -> Event:
        """Wait for the next thing to be told."""

    def close(self) -> None:
        """End all that is still going on, and its solvers."""
