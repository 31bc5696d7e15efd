"""A process that does tasks for a sweep on this machine, one after the other.

It reads pickled tasks from its standard input and writes what comes of them to its
standard output. It stands outside the terminal's group, so Ctrl-C reaches the sweep
alone; when its input ends, by an order or because the sweep was killed, it stops
the solver and goes.
"""

import os
import pickle
import queue
import signal
import threading
from pathlib import Path
from typing import IO, TypeAlias

from fembridge.solver.ccx import Progress, signals_as_exits
from fembridge.sweep.task import Task
from fembridge.sweep.work import Finding, work

Order: TypeAlias = tuple[Task, Path, int | None, bool]
"""A task, the sweep's folder, the solver's threads, and whether to be patient."""

Word: TypeAlias = Progress | Finding


def main() -> None:
    """Work until the input ends."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints is no answer
    orders: queue.SimpleQueue[Order] = queue.SimpleQueue()
    source = os.fdopen(os.dup(0), "rb")
    threading.Thread(target=_listen, args=(source, orders), daemon=True).start()

    def say(word: Word) -> None:
        pickle.dump(word, answers)
        answers.flush()

    with signals_as_exits():
        while True:
            task, folder, threads, patient = orders.get()
            found = work(task, folder, threads=threads, patient=patient, on_progress=say)
            say(found)


def _listen(source: IO[bytes], orders: "queue.SimpleQueue[Order]") -> None:
    """Hand on each order; at the end of them, end this process as SIGTERM would."""
    try:
        while True:
            orders.put(pickle.load(source))
    except (EOFError, pickle.UnpicklingError, OSError):
        os.kill(os.getpid(), signal.SIGTERM)


if __name__ == "__main__":
    main()
