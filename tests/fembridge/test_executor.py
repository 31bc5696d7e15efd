"""Processes that do tasks: answers, errors, messages, and what kills them."""

import io
import math
import operator
import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
import time
from contextlib import nullcontext
from types import SimpleNamespace

import pytest

from fembridge.errors import MissingError
from fembridge.host import executor as module
from fembridge.host.executor import LocalExecutor, WorkerDiedError


def test_answers_come_from_other_processes():
    with LocalExecutor(2) as executor:
        assert executor.submit(math.gcd, 12, 18).result() == 6
        assert executor.submit(os.getpid).result() != os.getpid()
        assert list(executor.map(abs, [-1, 2])) == [1, 2]


def test_the_error_of_a_task_is_its_own():
    with LocalExecutor(1) as executor:
        with pytest.raises(ZeroDivisionError):
            executor.submit(operator.truediv, 1, 0).result()
        with pytest.raises(RuntimeError):
            executor.submit(threading.Lock).result()  # an answer that does not pickle
        assert executor.submit(abs, -1).result() == 1


def test_messages_come_on_the_way():
    logged = []
    with LocalExecutor(1, logged.append) as executor:
        executor.submit(module.send, "half").result()
    assert logged == ["half"]
    module.send("nobody listens here")


def test_a_process_that_is_killed_is_replaced_and_its_task_begun_again():
    with LocalExecutor(1) as executor:
        first = executor.submit(os.getpid).result()
        sleeping = executor.submit(time.sleep, 0.5)
        other = executor.submit(os.getpid)
        time.sleep(0.1)
        os.kill(first, signal.SIGKILL)
        assert sleeping.result() is None
        assert other.result() != first


def test_a_task_that_kills_its_process_every_time_is_given_up_and_harms_nobody():
    with LocalExecutor(2) as executor:
        assert executor.submit(os.getpgid, 0).result() != os.getpgid(0)
        bad = executor.submit(os.kill, 0, signal.SIGKILL)  # the group: the process alone
        good = [executor.submit(abs, -k) for k in range(5)]
        with pytest.raises(WorkerDiedError, match="-9"):
            bad.result()
        assert [each.result() for each in good] == list(range(5))


def test_an_exception_in_the_block_ends_tasks_and_their_processes():
    with pytest.raises(KeyboardInterrupt), LocalExecutor(2) as executor:
        pid = executor.submit(os.getpid).result()
        tasks = [executor.submit(time.sleep, 60) for _ in range(3)]
        raise KeyboardInterrupt
    assert all(task.done() for task in tasks)
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_a_process_goes_though_its_signal_comes_before_it_waits(monkeypatch):
    """Then nothing wakes it but the end of its tasks; without that, one sweep in many hung."""
    logged, tasks = [], queue.SimpleQueue()
    monkeypatch.setattr(os, "kill", lambda *words: logged.append(words))
    module._read_tasks(io.BytesIO(pickle.dumps("task")), tasks)
    assert logged == [(os.getpid(), signal.SIGTERM)]
    assert tasks.get(timeout=1) == "task"
    assert tasks.get(timeout=1) is None


OWNER = """
import os, time
from fembridge.host.executor import LocalExecutor
executor = LocalExecutor(1)
print(executor.submit(os.getpid).result(), flush=True)
executor.submit(time.sleep, 60)
time.sleep(60)
"""


def test_processes_go_when_their_owner_is_killed():
    """Without ``if __name__ == "__main__"`` in the owner's script, too."""
    owner = subprocess.Popen([sys.executable, "-c", OWNER], stdout=subprocess.PIPE, text=True)
    pid = int(owner.stdout.readline())
    owner.kill()
    owner.communicate()
    until_s = time.monotonic() + 60
    while True:
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            break
        assert time.monotonic() < until_s
        time.sleep(0.05)


def test_a_machine_without_loopback_gets_the_way_out_in_one_line(monkeypatch):
    """What `LocalCluster` raises there."""

    def no_network(**options):
        raise RuntimeError("Cluster failed to start: Timed out trying to connect")

    config = SimpleNamespace(set=nullcontext)
    dask = SimpleNamespace(LocalCluster=no_network, config=config)
    monkeypatch.setattr(module, "import_module", lambda name: dask)
    with (
        pytest.raises(MissingError, match=r"Timed out .*; --executor local needs no network"),
        module.dask_executor(None, 2),
    ):
        pass
