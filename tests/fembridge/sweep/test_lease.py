"""One owner of a folder at a time: over threads, processes, machines and deaths."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections import Counter

import pytest

from fembridge.errors import OutputError
from fembridge.sweep import lease as module
from fembridge.sweep.lease import BusyError, Owner, leased

ROUNDS = 20 if os.environ.get("CI") == "true" else 6
HOLDER = """
import sys, time
from pathlib import Path
from fembridge.sweep.lease import leased
with leased(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(600)
"""
CROWD = """
import sys, time
from pathlib import Path
from fembridge.sweep.lease import leased
folder = Path(sys.argv[1])
for _ in range(int(sys.argv[2])):
    with leased(folder / "place"):
        with (folder / "inside").open("x"):
            with (folder / "log").open("a") as log:
                log.write(".")
        (folder / "inside").unlink()
"""


def lease_files(folder):
    return sorted(path.name for path in folder.glob(f"{module.PREFIX}*"))


def is_at_work(folder):
    try:
        with leased(folder, patient=False):
            return False
    except BusyError:
        return True


def put_owner(folder, machine="elsewhere", pid=1, start="7", number=1):
    path = folder / f"{module.PREFIX}{number}"
    owner = {"machine": machine, "pid": pid, "start": start, "token": "t"}
    path.write_text(json.dumps(owner))
    return path


@pytest.fixture
def holder(tmp_path):
    """A process that holds `tmp_path` until it is killed."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(tmp_path)], stdout=subprocess.PIPE
    )
    assert process.stdout.readline() == b"held\n"
    yield process
    process.kill()
    process.communicate()


def test_a_folder_that_is_given_back_can_be_had_again(tmp_path):
    for number in (1, 2, 3):
        with leased(tmp_path) as lease:
            assert lease.is_held()
            assert is_at_work(tmp_path)
            assert lease_files(tmp_path) == [f"{module.PREFIX}{number}"]
        assert not lease.is_held()


def test_it_is_given_back_after_an_error_too(tmp_path):
    with pytest.raises(ZeroDivisionError), leased(tmp_path):
        _ = 1 / 0
    assert not is_at_work(tmp_path)


def test_of_many_processes_one_is_inside_at_a_time(tmp_path):
    crowd = [
        subprocess.Popen([sys.executable, "-c", CROWD, str(tmp_path), str(ROUNDS)])
        for _ in range(3)
    ]
    assert [process.wait() for process in crowd] == [0, 0, 0]
    assert (tmp_path / "log").read_text() == "." * 3 * ROUNDS
    assert len(lease_files(tmp_path / "place")) == 1


def test_of_many_threads_one_takes_over_from_the_dead(tmp_path):
    inside, worst = Counter(), Counter()

    def go():
        for _ in range(10):
            with leased(tmp_path):
                inside["now"] += 1
                worst[inside["now"]] += 1
                inside["now"] -= 1

    put_owner(tmp_path, module._machine(), 2**22 + 1)  # no such process
    threads = [threading.Thread(target=go) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert worst == {1: 40}


def test_who_is_killed_loses_it_at_once(tmp_path, holder):
    assert is_at_work(tmp_path)
    os.kill(holder.pid, signal.SIGKILL)
    with leased(tmp_path) as lease:  # its parent has not even asked after it
        assert lease.is_held()


def test_who_lives_is_waited_for(tmp_path, holder):
    taken = threading.Event()

    def take():
        with leased(tmp_path):
            taken.set()

    thread = threading.Thread(target=take)
    thread.start()
    assert not taken.wait(0.5)
    holder.kill()
    thread.join()
    assert taken.is_set()


def test_a_process_that_got_a_dead_one_s_number_is_not_taken_for_it(tmp_path):
    put_owner(tmp_path, module._machine(), os.getpid(), start="1")
    with leased(tmp_path) as lease:
        assert lease.is_held()


def test_an_owner_elsewhere_is_dead_when_silent_for_long_enough(tmp_path):
    put_owner(tmp_path)
    begin_s = time.monotonic()
    with leased(tmp_path, silence_s=0.6):
        assert time.monotonic() - begin_s > 0.6


def test_an_owner_elsewhere_that_beats_is_alive_whatever_its_clock_says(tmp_path):
    path = put_owner(tmp_path)
    over, taken = threading.Event(), threading.Event()

    def beat():
        wrong_s = 1e9  # a clock far in the past
        while not over.wait(0.05):
            wrong_s += 1
            os.utime(path, (wrong_s, wrong_s))

    def take():
        with leased(tmp_path, silence_s=0.5):
            taken.set()

    threads = [threading.Thread(target=one) for one in (beat, take)]
    for thread in threads:
        thread.start()
    assert not taken.wait(1.5)
    over.set()
    for thread in threads:
        thread.join()
    assert taken.is_set()


def test_our_own_heart_beats(tmp_path, wait_until):
    with leased(tmp_path, heartbeat_s=0.01):
        path = tmp_path / lease_files(tmp_path)[0]
        os.utime(path, (1e9, 1e9))
        wait_until(lambda: path.stat().st_mtime > 1.5e9)


def test_who_was_thought_dead_sees_that_it_lost_the_folder(tmp_path):
    with leased(tmp_path) as lease:
        put_owner(tmp_path, number=2)
        assert not lease.is_held()
    assert (tmp_path / f"{module.PREFIX}2").read_text()  # and takes nothing away


def test_a_number_that_was_cleared_away_makes_no_owner(tmp_path, monkeypatch):
    """Who looked before two others came and went must not win with an old number."""
    real, seen = module._last, []

    def stale(folder):
        seen.append(folder)
        return None if len(seen) == 1 else real(folder)

    put_owner(tmp_path, module._machine(), os.getpid(), Owner.here().start, number=3)
    monkeypatch.setattr(module, "_last", stale)
    watch = module._Watch(1.0)
    assert module._take(tmp_path, Owner.here(), watch) is None
    assert lease_files(tmp_path) == [f"{module.PREFIX}3"]


@pytest.mark.parametrize("text", ["", "{", "[]", '{"pid": 1}'])
def test_what_is_no_owner_owns_nothing(tmp_path, text):
    (tmp_path / f"{module.PREFIX}1").write_text(text)
    with leased(tmp_path):
        assert lease_files(tmp_path) == [f"{module.PREFIX}2"]


def test_a_folder_that_cannot_be_made_is_told(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="a file stands where"), leased(tmp_path / "file"):
        pass
