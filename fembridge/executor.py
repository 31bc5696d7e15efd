"""Many runs of one function, here or in other processes: `finished` has them as they end.

Behind it is an executor of `concurrent.futures`. `HereExecutor` does each task at once.
`LocalExecutor` has worker processes on this machine: one that is killed costs its own
task a second beginning, and nobody else anything. `dask_executor` has the workers of a
dask cluster. A task is a function that can be imported, with arguments that pickle.
"""

import contextlib
import os
import pickle
import queue
import re
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    CancelledError,
    Executor,
    Future,
    ThreadPoolExecutor,
    wait,
)
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import IO, Any, TypeVar

from fembridge.errors import MissingError, UsageError
from fembridge.solver.process import GRACE_S, signals_as_exits
from fembridge.store import temporary_folder

ATTEMPTS = 2
"""A task whose process died is begun once more: the next death is its own doing."""

INSTALL_LINE = "pip install 'fembridge[dask]'"

# A solver is given `GRACE_S` to end; then its process some time to notice.
_PATIENCE_S = GRACE_S + 2.0
_ADDRESS = re.compile(r"(tcp|tls|ucx|wss?)://\S+")
_DASK_PATIENCE = "20s"
_MESSAGE, _RESULT, _ERROR = range(3)

OnMessage = Callable[[Any], object]
"""Called with what tasks `send` on their way, from any thread."""

_Task = TypeVar("_Task")
_Answer = TypeVar("_Answer")


def _unheard(message: object) -> None:
    """Outside of a task nobody listens."""


_listener: OnMessage = _unheard


class WorkerDiedError(Exception):
    """The process of a task died, and that of its second attempt too."""


def finished(
    submit: Callable[[_Task], Future[_Answer]], ready: deque[_Task], at_once: int
) -> Iterator[tuple[_Task, Future[_Answer]]]:
    """Tasks of `ready` with what came of each, as they end; `at_once` are under way.

    `submit` gives one to an executor. Who takes one may put others into `ready`: in front,
    or behind all.
    """
    running: dict[Future[_Answer], _Task] = {}
    while ready or running:
        while ready and len(running) < at_once:
            task = ready.popleft()
            running[submit(task)] = task
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            yield running.pop(future), future


def executor_of(jobs: int, on_message: OnMessage = _unheard) -> Executor:
    """Processes for `jobs` tasks at a time; a single one is done in this process."""
    return HereExecutor(on_message) if jobs == 1 else LocalExecutor(jobs, on_message)


class HereExecutor(Executor):
    """Does each task in this process, when it is submitted; what it raises is raised there."""

    def __init__(self, on_message: OnMessage = _unheard) -> None:
        self._on_message = on_message

    def submit(
        self, function: Callable[..., Any], /, *args: object, **kwargs: object
    ) -> Future[Any]:
        """Result of ``function(*args, **kwargs)``, which is there."""
        global _listener
        future: Future[Any] = Future()
        before, _listener = _listener, self._on_message
        try:
            future.set_result(function(*args, **kwargs))
        finally:
            _listener = before
        return future


class LocalExecutor(Executor):
    """`jobs` processes on this machine, each with one task at a time.

    They stand outside the terminal's group, so Ctrl-C reaches us alone; when we die,
    even by ``kill -9``, each stops its solver and goes. Left by an exception, the block
    ``with LocalExecutor(...)`` does not wait for tasks: it ends them.
    """

    def __init__(self, jobs: int, on_message: OnMessage = _unheard) -> None:
        self._threads = ThreadPoolExecutor(jobs)
        self._own = threading.local()
        self._on_message = on_message
        self._workers: set[subprocess.Popen[bytes]] = set()
        self._lock = threading.Lock()
        self._stopped = False

    def submit(
        self, function: Callable[..., Any], /, *args: object, **kwargs: object
    ) -> Future[Any]:
        """Result of ``function(*args, **kwargs)`` in one of the processes, when it is there.

        Its exception is `WorkerDiedError` when the process died `ATTEMPTS` times.
        """
        return self._threads.submit(self._attempt, pickle.dumps((function, args, kwargs)))

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        self.shutdown(cancel_futures=kind is not None)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Let the processes go when all tasks are done, or at once with `cancel_futures`."""
        if cancel_futures:
            self._threads.shutdown(wait=False, cancel_futures=True)
            self._stop()
        self._threads.shutdown(wait)
        for worker in list(self._workers):
            self._end(worker)

    def _attempt(self, task: bytes) -> Any:  # noqa: ANN401 - of any function
        code: int | None = None
        for _ in range(ATTEMPTS):
            worker = self._worker()
            assert worker.stdin is not None and worker.stdout is not None
            kind: int = _MESSAGE
            value: Any = None
            try:
                worker.stdin.write(task)
                worker.stdin.flush()
                while kind == _MESSAGE:
                    kind, value = pickle.load(worker.stdout)
                    if kind == _MESSAGE:
                        self._on_message(value)
            except (EOFError, OSError, pickle.UnpicklingError):  # it died
                self._own.worker = None
                code = self._end(worker)
                continue
            if kind == _ERROR:
                raise value
            return value
        raise WorkerDiedError(
            f"its process died {ATTEMPTS} times, the last time with exit code {code}"
        )

    def _worker(self) -> subprocess.Popen[bytes]:
        """The process of this thread; a new one where there is none."""
        worker: subprocess.Popen[bytes] | None = getattr(self._own, "worker", None)
        if worker is not None:
            return worker
        above = str(Path(__file__).parents[1])
        paths = [above, *filter(None, [os.environ.get("PYTHONPATH")])]
        with self._lock:
            if self._stopped:
                raise CancelledError
            worker = subprocess.Popen(
                [sys.executable, "-P", "-c", "from fembridge.executor import serve; serve()"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
                start_new_session=True,
            )
            self._workers.add(worker)
        self._own.worker = worker
        return worker

    def _stop(self) -> None:
        """Have every process stop its solver and go; kill those that do not."""
        with self._lock:
            self._stopped = True
            workers = list(self._workers)
        try:
            for worker in workers:
                worker.terminate()
            until_s = time.monotonic() + _PATIENCE_S
            for worker in workers:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    worker.wait(max(0.0, until_s - time.monotonic()))
        finally:  # a second Ctrl-C does not wait
            for worker in workers:
                worker.kill()

    def _end(self, worker: subprocess.Popen[bytes]) -> int:
        """Exit code of a process whose input is closed, at which it goes."""
        for stream in (worker.stdin, worker.stdout):
            if stream is not None:
                with contextlib.suppress(OSError):
                    stream.close()
        code = worker.wait()
        with self._lock:
            self._workers.discard(worker)
        return code


def send(message: object) -> None:
    """Send `message` to who began the task; of a cluster, nowhere."""
    _listener(message)


def serve() -> None:
    """Do tasks in this process until its input ends."""
    global _listener
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints is no answer

    def answer(kind: int, value: object) -> None:
        answers.write(pickle.dumps((kind, value)))
        answers.flush()

    _listener = partial(answer, _MESSAGE)
    tasks: queue.SimpleQueue[Any] = queue.SimpleQueue()
    source = os.fdopen(os.dup(0), "rb")
    threading.Thread(target=_listen, args=(source, tasks), daemon=True).start()
    with signals_as_exits():
        while task := tasks.get():
            function, args, kwargs = task
            try:
                kind, value = _RESULT, function(*args, **kwargs)
            except Exception as error:
                kind, value = _ERROR, error
            try:
                answer(kind, value)
            except Exception as error:  # it does not pickle
                answer(_ERROR, RuntimeError(f"{value!r}: {error}"))


def _listen(source: IO[bytes], tasks: "queue.SimpleQueue[Any]") -> None:
    """Pass on each task; at the end of them, end this process as SIGTERM would.

    A signal on the brink of ``tasks.get()`` does not wake who waits there: None does.
    """
    try:
        while True:
            tasks.put(pickle.load(source))
    except (EOFError, pickle.UnpicklingError, OSError):
        tasks.put(None)
        os.kill(os.getpid(), signal.SIGTERM)


@contextlib.contextmanager
def dask_executor(scheduler: str | None, jobs: int) -> Iterator[Executor]:
    """Workers of the cluster at `scheduler`; without one, of `jobs` processes made here.

    A task that is lost with its worker is given to another by the scheduler. Left by an
    exception, tasks that have not begun are taken back.

    Raises
    ------
    MissingError
        dask.distributed is not installed, or starts no cluster here.
    UsageError
        No scheduler answers at this address.
    """
    try:
        distributed = import_module("distributed")
    except ImportError as error:
        raise MissingError(f"--executor dask needs dask.distributed: {INSTALL_LINE}") from error
    if scheduler is not None and not _ADDRESS.fullmatch(scheduler):
        raise UsageError(f"scheduler {scheduler!r}, expected tcp://HOST:PORT")
    with contextlib.ExitStack() as stack:
        cluster: Any = scheduler
        if scheduler is None:
            dask = import_module("dask")
            folder = str(stack.enter_context(temporary_folder()))  # dask leaves its own behind
            stack.enter_context(dask.config.set({"temporary-directory": folder}))
            try:
                cluster = distributed.LocalCluster(
                    n_workers=jobs,
                    threads_per_worker=1,
                    processes=True,
                    dashboard_address="127.0.0.1:0",  # ":0" would be all interfaces
                    local_directory=folder,
                )
            except (OSError, RuntimeError) as error:  # as without a loopback interface
                raise MissingError(
                    f"dask starts no cluster on this machine: {error}; --executor local "
                    "needs no network"
                ) from error
            stack.enter_context(cluster)
        try:
            client = distributed.Client(cluster, timeout=_DASK_PATIENCE, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:  # TypeError: tls without certificates
            raise UsageError(f"no dask scheduler at {scheduler}: {error}") from error
        stack.enter_context(client)
        executor = client.get_executor(pure=False)
        try:
            yield executor
        finally:
            executor.shutdown(wait=False)
