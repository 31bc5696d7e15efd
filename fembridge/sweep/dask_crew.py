"""A crew of dask workers: a cluster that is there, or one made on this machine.

A task that is lost with its worker is given to another by dask's scheduler. When a
sweep is broken off, tasks of a foreign cluster that are under way run to their end,
and count: their folders are finished.
"""

import os
import queue
import re
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from fembridge.errors import FembridgeError, MissingError, UsageError
from fembridge.sweep.crew import Begun, Ended, Event
from fembridge.sweep.solver_version import solver_version
from fembridge.sweep.task import Task
from fembridge.sweep.work import Finding, work

INSTALL_LINE = "pip install 'fembridge[dask]'"
_ADDRESS = re.compile(r"(tcp|tls|ucx|wss?)://\S+")
_PATIENCE = "20s"


class DaskCrew:
    """Workers of the cluster at `scheduler`; without one, `jobs` processes here.

    Raises
    ------
    MissingError
        dask.distributed is not installed, here or where a worker is.
    UsageError
        No scheduler answers at this address.
    """

    def __init__(self, folder: Path, scheduler: str | None, jobs: int, threads: int | None) -> None:
        self._folder, self._threads = folder, threads
        self._events: queue.SimpleQueue[Event] = queue.SimpleQueue()
        self._futures: set[Any] = set()
        self._tasks: dict[str, Task] = {}
        self._topic = f"fembridge-{os.urandom(8).hex()}"
        self._cluster: Any = None
        self._closed = False
        distributed = _distributed()
        if scheduler is not None and not _ADDRESS.fullmatch(scheduler):
            raise UsageError(f"scheduler {scheduler!r}, expected tcp://HOST:PORT")
        if scheduler is None:
            self._cluster = distributed.LocalCluster(
                n_workers=jobs, threads_per_worker=1, processes=True, dashboard_address=":0"
            )
        try:
            self._client = distributed.Client(
                scheduler or self._cluster, timeout=_PATIENCE, set_as_default=False
            )
        except (OSError, ValueError) as error:
            self._close_cluster()
            raise UsageError(f"no dask scheduler at {scheduler}: {error}") from error
        self._client.subscribe_topic(self._topic, self._hear)

    def solver(self) -> str:
        """Ask a worker which solver it has; waits for the first to be there.

        Raises
        ------
        MissingError
            None, or a worker without fembridge.
        """
        future = self._client.submit(version_there, pure=False)
        try:
            found = future.result()
        except Exception as error:
            raise MissingError(f"a dask worker cannot begin: {error}") from error
        if isinstance(found, FembridgeError):
            raise found
        version: str = found
        return version

    def submit(self, task: Task) -> None:
        """Give `task` to the scheduler."""
        self._tasks[task.key] = task
        future = self._client.submit(
            work_there,
            task,
            self._folder,
            self._threads,
            self._topic,
            key=f"{self._topic}-{task.key}",
            pure=False,
        )
        self._futures.add(future)
        future.add_done_callback(partial(self._note, task))

    def next_event(self) -> Event:
        """Wait for the next thing to be told."""
        return self._events.get()

    def close(self) -> None:
        """Take back what has not begun; end the processes that were made here."""
        if self._closed:
            return
        self._closed = True
        try:
            self._client.cancel(list(self._futures))
            self._client.close()
        finally:
            self._close_cluster()

    def _hear(self, event: tuple[float, str]) -> None:
        """Hear that a worker has begun a task, in a thread of dask."""
        _, key = event
        self._events.put(Begun(self._tasks[key]))

    def _note(self, task: Task, future: Any) -> None:  # noqa: ANN401 - of dask
        """Hear that `future` is over, in a thread of dask."""
        self._futures.discard(future)
        try:
            finding = future.result()
        except Exception as error:  # a worker that died too often, a cancelled task
            told = " ".join(f"{type(error).__name__}: {error}".splitlines())
            finding = Finding(task.key, f"dask gave it up: {told}")
        self._events.put(Ended(task, finding))

    def _close_cluster(self) -> None:
        if self._cluster is not None:
            self._cluster.close()


def version_there() -> str | FembridgeError:
    """Give the solver of a worker of dask, or why there is none."""
    try:
        return solver_version()
    except FembridgeError as error:
        return error  # raised there, dask would print where


def work_there(task: Task, folder: Path, threads: int | None, topic: str) -> Finding:
    """Do `task` in a worker of dask, and say that it is begun."""
    _distributed().get_worker().log_event(topic, task.key)
    return work(task, folder, threads=threads)


def _distributed() -> Any:  # noqa: ANN401 - a module
    try:
        return import_module("distributed")
    except ImportError as error:
        raise MissingError(f"--executor dask needs dask.distributed: {INSTALL_LINE}") from error
