"""Run many tasks in this or other processes: `finished` yields them as they complete.

The tasks run on an executor of `concurrent.futures`. `HereExecutor` runs each task at once in
this process. `LocalExecutor` has worker processes on this machine: if one is killed, only its
task is restarted. `dask_executor` has the workers of a dask cluster. A task is an importable
function with arguments that can be pickled.
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
from fembridge.host.process import GRACE_S, signals_as_exits
from fembridge.host.store import temporary_folder

ATTEMPTS = 2
"""Times that a task is started; if its process dies each time, the task fails."""

INSTALL_LINE = "pip install 'fembridge[dask]'"

# A solver has `GRACE_S` to stop, its process 2 s more.
_STOP_TIMEOUT_S = GRACE_S + 2.0
_ADDRESS = re.compile(r"(tcp|tls|ucx|wss?)://\S+")
_DASK_TIMEOUT = "20s"
_MESSAGE, _RESULT, _ERROR = range(3)

OnMessage = Callable[[Any], object]
"""Called with each message that a running task `send`s, from any thread."""

_Task = TypeVar("_Task")
_Result = TypeVar("_Result")


def _ignore_message(message: object) -> None:
    """Discard a message: no task is running."""


_listener: OnMessage = _ignore_message


class WorkerDiedError(Exception):
    """The process of a task died in every attempt."""


def finished(
    submit: Callable[[_Task], Future[_Result]], ready: deque[_Task], limit: int
) -> Iterator[tuple[_Task, Future[_Result]]]:
    """Tasks of `ready` with their futures as they complete; at most `limit` run at a time.

    `submit` passes a task to an executor. The caller may add tasks to either end of `ready`
    between two results.
    """
    running: dict[Future[_Result], _Task] = {}
    while ready or running:
        while ready and len(running) < limit:
            task = ready.popleft()
            running[submit(task)] = task
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            yield running.pop(future), future


def executor_of(jobs: int, on_message: OnMessage = _ignore_message) -> Executor:
    """Executor of `jobs` worker processes; for one job, this process."""
    return HereExecutor(on_message) if jobs == 1 else LocalExecutor(jobs, on_message)


class HereExecutor(Executor):
    """Runs each task in this process on submission; its error is raised by `submit`."""

    def __init__(self, on_message: OnMessage = _ignore_message) -> None:
        self._on_message = on_message

    def submit(
        self, function: Callable[..., Any], /, *args: object, **kwargs: object
    ) -> Future[Any]:
        """Completed future of ``function(*args, **kwargs)``."""
        global _listener
        future: Future[Any] = Future()
        previous, _listener = _listener, self._on_message
        try:
            future.set_result(function(*args, **kwargs))
        finally:
            _listener = previous
        return future


class LocalExecutor(Executor):
    """`jobs` processes on this machine, each with one task at a time.

    They are outside the terminal's process group, so Ctrl-C reaches only this process. When it
    dies, even by ``kill -9``, each worker stops its solver and exits. An exception in the block
    ``with LocalExecutor(...)`` stops all tasks without waiting.
    """

    def __init__(
        self, jobs: int, on_message: OnMessage = _ignore_message, attempts: int = ATTEMPTS
    ) -> None:
        self._attempts = attempts
        self._threads = ThreadPoolExecutor(jobs)
        self._thread_state = threading.local()
        self._on_message = on_message
        self._workers: set[subprocess.Popen[bytes]] = set()
        self._lock = threading.Lock()
        self._stopped = False

    def submit(
        self, function: Callable[..., Any], /, *args: object, **kwargs: object
    ) -> Future[Any]:
        """Future of ``function(*args, **kwargs)`` in one of the worker processes.

        Its exception is `WorkerDiedError` if the process died in all attempts.
        """
        return self._threads.submit(self._run_task, pickle.dumps((function, args, kwargs)))

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        self.shutdown(cancel_futures=kind is not None)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Stop the processes when all tasks are done, or at once with `cancel_futures`."""
        if cancel_futures:
            self._threads.shutdown(wait=False, cancel_futures=True)
            self._stop_workers()
        self._threads.shutdown(wait)
        for worker in list(self._workers):
            self._close_worker(worker)

    def _run_task(self, task: bytes) -> Any:  # noqa: ANN401 - result of any function
        code: int | None = None
        for _ in range(self._attempts):
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
            except (EOFError, OSError, pickle.UnpicklingError):  # the worker died
                self._thread_state.worker = None
                code = self._close_worker(worker)
                continue
            if kind == _ERROR:
                raise value
            return value
        times = "" if self._attempts == 1 else f" {self._attempts} times"
        raise WorkerDiedError(f"worker process died{times}, last exit code {code}")

    def _worker(self) -> subprocess.Popen[bytes]:
        """Worker process of this thread, started if there is none."""
        worker: subprocess.Popen[bytes] | None = getattr(self._thread_state, "worker", None)
        if worker is not None:
            return worker
        package_parent = str(Path(__file__).parents[2])
        paths = [package_parent, *filter(None, [os.environ.get("PYTHONPATH")])]
        with self._lock:
            if self._stopped:
                raise CancelledError
            worker = subprocess.Popen(
                [sys.executable, "-P", "-c", "from fembridge.host.executor import serve; serve()"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
                start_new_session=True,
            )
            self._workers.add(worker)
        self._thread_state.worker = worker
        return worker

    def _stop_workers(self) -> None:
        """Stop every worker and its solver; kill workers that do not exit in time."""
        with self._lock:
            self._stopped = True
            workers = list(self._workers)
        try:
            for worker in workers:
                worker.terminate()
            deadline_s = time.monotonic() + _STOP_TIMEOUT_S
            for worker in workers:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    worker.wait(max(0.0, deadline_s - time.monotonic()))
        finally:  # a second Ctrl-C does not wait
            for worker in workers:
                worker.kill()

    def _close_worker(self, worker: subprocess.Popen[bytes]) -> int:
        """Exit code of a worker after closing its input, which ends it."""
        for stream in (worker.stdin, worker.stdout):
            if stream is not None:
                with contextlib.suppress(OSError):
                    stream.close()
        code = worker.wait()
        with self._lock:
            self._workers.discard(worker)
        return code


def send(message: object) -> None:
    """Send `message` to the process that submitted the task; lost on a dask cluster."""
    _listener(message)


def serve() -> None:
    """Run tasks from standard input until it ends."""
    global _listener
    output = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # prints of libraries must not mix with results

    def reply(kind: int, value: object) -> None:
        output.write(pickle.dumps((kind, value)))
        output.flush()

    _listener = partial(reply, _MESSAGE)
    tasks: queue.SimpleQueue[Any] = queue.SimpleQueue()
    source = os.fdopen(os.dup(0), "rb")
    threading.Thread(target=_read_tasks, args=(source, tasks), daemon=True).start()
    with signals_as_exits():
        while task := tasks.get():
            function, args, kwargs = task
            try:
                kind, value = _RESULT, function(*args, **kwargs)
            except Exception as error:
                kind, value = _ERROR, error
            try:
                reply(kind, value)
            except Exception as error:  # the value cannot be pickled
                reply(_ERROR, RuntimeError(f"{value!r}: {error}"))


def _read_tasks(source: IO[bytes], tasks: "queue.SimpleQueue[Any]") -> None:
    """Queue each task; at the end of input, end this process as SIGTERM does.

    A signal just before ``tasks.get()`` does not interrupt the wait, hence the None.
    """
    try:
        while True:
            tasks.put(pickle.load(source))
    except (EOFError, pickle.UnpicklingError, OSError):
        tasks.put(None)
        os.kill(os.getpid(), signal.SIGTERM)


@contextlib.contextmanager
def dask_executor(scheduler: str | None, jobs: int) -> Iterator[Executor]:
    """Workers of the cluster at `scheduler`; if None, of a new cluster of `jobs` processes.

    The scheduler restarts a lost task on another worker. An exception in the block cancels tasks
    that have not started.

    Raises
    ------
    MissingError
        dask.distributed is not installed or cannot start a cluster on this machine.
    UsageError
        No scheduler responds at `scheduler`.
    """
    try:
        distributed = import_module("distributed")
    except ImportError as error:
        raise MissingError(f"--executor dask needs dask.distributed: {INSTALL_LINE}") from error
    if scheduler is not None and not _ADDRESS.fullmatch(scheduler):
        raise UsageError(argument="scheduler", found=scheduler, expected="tcp://HOST:PORT")
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
            except (OSError, RuntimeError) as error:  # for example without a loopback interface
                raise MissingError(
                    f"dask starts no cluster on this machine: {error}; --executor local "
                    "needs no network"
                ) from error
            stack.enter_context(cluster)
        try:
            client = distributed.Client(cluster, timeout=_DASK_TIMEOUT, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:  # TypeError: tls without certificates
            problem = f"is {scheduler}, where no scheduler of dask responds: {error}"
            raise UsageError(problem, argument="scheduler", found=scheduler) from error
        stack.enter_context(client)
        executor = client.get_executor(pure=False)
        try:
            yield executor
        finally:
            executor.shutdown(wait=False)
