"""A crew of processes on this machine: one task each, a dead one is replaced."""

import contextlib
import os
import pickle
import queue
import subprocess
import sys
import threading
import time
from collections import deque
from pathlib import Path

import fembridge
from fembridge.solver.ccx import GRACE_S
from fembridge.sweep.crew import Begun, Ended, Event, PutOff
from fembridge.sweep.task import Item, Task
from fembridge.sweep.work import Finding

GOES = 2
"""A task whose process died is begun once more: the next death is its own doing."""

# A solver is given `GRACE_S` to end; then its process some time to notice.
_PATIENCE_S = GRACE_S + 2.0


class LocalCrew:
    """`jobs` processes for the sweep in `folder`, each solver with its `threads`."""

    def __init__(self, folder: Path, jobs: int, threads: int | None) -> None:
        self._folder, self._threads = folder, threads
        self._first: deque[Task] = deque()
        self._waiting: deque[Task] = deque()
        self._put_off: set[str] = set()
        self._news = threading.Condition()
        self._events: queue.SimpleQueue[Event] = queue.SimpleQueue()
        self._processes: set[subprocess.Popen[bytes]] = set()
        self._closed = False
        self._foremen = [threading.Thread(target=self._lead, daemon=True) for _ in range(jobs)]
        for foreman in self._foremen:
            foreman.start()

    def submit(self, task: Task) -> None:
        """Put `task` behind the others; an item before the responses that wait.

        So it is known early what comes of the first fingers, and how long all take.
        """
        with self._news:
            first = isinstance(task, Item) and task.key not in self._put_off
            (self._first if first else self._waiting).append(task)
            self._news.notify()

    def next_event(self) -> Event:
        """Wait for the next thing to be told."""
        return self._events.get()

    def close(self) -> None:
        """Have every process stop its solver and go; kill those that do not."""
        with self._news:
            self._closed = True
            self._first.clear()
            self._waiting.clear()
            processes = list(self._processes)
            self._news.notify_all()
        try:
            for process in processes:
                process.terminate()
            until_s = time.monotonic() + _PATIENCE_S
            for process in processes:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(max(0.0, until_s - time.monotonic()))
        finally:  # a second Ctrl-C does not wait
            for process in processes:
                process.kill()
        for foreman in self._foremen:
            foreman.join()

    def _lead(self) -> None:
        """Keep one process at work until the crew is closed."""
        process: subprocess.Popen[bytes] | None = None
        while (task := self._next_task()) is not None:
            self._events.put(Begun(task))
            finding = None
            for _ in range(GOES):
                process = process or self._start()
                if process is None:
                    return
                finding = self._done(process, task)
                if finding is not None:
                    break
                code = self._end(process)
                process = None
            if self._closed:
                break
            if finding is not None and finding.busy:
                self._put_off.add(task.key)
                self._events.put(PutOff(task))
                self.submit(task)
                continue
            told = f"its process died {GOES} times, the last time with exit code "
            self._events.put(Ended(task, finding or Finding(task.key, f"{told}{code}")))
        if process is not None:
            self._end(process)

    def _next_task(self) -> Task | None:
        """Wait for a task; None: closed."""
        with self._news:
            while not (self._first or self._waiting or self._closed):
                self._news.wait()
            return None if self._closed else (self._first or self._waiting).popleft()

    def _start(self) -> subprocess.Popen[bytes] | None:
        above = str(Path(fembridge.__file__).parents[1])
        paths = [above, *filter(None, [os.environ.get("PYTHONPATH")])]
        with self._news:
            if self._closed:
                return None
            process = subprocess.Popen(
                [sys.executable, "-P", "-m", "fembridge.sweep.worker"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
                start_new_session=True,
            )
            self._processes.add(process)
        return process

    def _done(self, process: subprocess.Popen[bytes], task: Task) -> Finding | None:
        """Have `process` do `task`; None: it died.

        A task that another sweep is at goes behind the others once; then it is
        waited for.
        """
        patient = task.key in self._put_off
        assert process.stdin is not None and process.stdout is not None
        try:
            pickle.dump((task, self._folder, self._threads, patient), process.stdin)
            process.stdin.flush()
            while True:
                word = pickle.load(process.stdout)
                if isinstance(word, Finding):
                    return word
                self._events.put(word)
        except (EOFError, OSError, pickle.UnpicklingError):
            return None

    def _end(self, process: subprocess.Popen[bytes]) -> int:
        """Close its input, at which it goes; give its exit code."""
        for stream in (process.stdin, process.stdout):
            if stream is not None:
                with contextlib.suppress(OSError):
                    stream.close()
        code = process.wait()
        with self._news:
            self._processes.discard(process)
        return code
