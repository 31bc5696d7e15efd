"""One holder at a time, and no trace of it afterwards."""

import os
import threading

import pytest

from fembridge.errors import OutputError
from fembridge.solvers.folder_lock import LOCK_FILE, folder_lock
from fembridge.solvers.outcome import Cause


def test_the_second_is_told_who_holds_the_folder(tmp_path):
    with folder_lock(tmp_path) as first, folder_lock(tmp_path) as second:
        assert first is None
        assert second.cause is Cause.BUSY
        assert f"process {os.getpid()} holds it" in second.found
    assert list(tmp_path.iterdir()) == []


def test_one_refused_does_not_take_the_lock_away(tmp_path):
    with folder_lock(tmp_path):
        with folder_lock(tmp_path) as second:
            assert second is not None
        assert (tmp_path / LOCK_FILE).exists()
        with folder_lock(tmp_path) as third:
            assert third is not None


def test_a_folder_can_be_held_again(tmp_path):
    for _ in range(2):
        with folder_lock(tmp_path) as busy:
            assert busy is None


def test_the_file_of_a_holder_that_was_killed_is_no_lock(tmp_path):
    (tmp_path / LOCK_FILE).write_text("4194304999\n")
    with folder_lock(tmp_path) as busy:
        assert busy is None
        assert (tmp_path / LOCK_FILE).read_text() == f"{os.getpid()}\n"


def test_never_two_hold_it_however_many_try(tmp_path):
    inside, most, held = [], [], []

    def attempt():
        for _ in range(50):
            with folder_lock(tmp_path) as busy:
                if busy is None:
                    inside.append(1)
                    most.append(len(inside))
                    held.append(1)
                    inside.pop()

    threads = [threading.Thread(target=attempt) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()

    assert held
    assert max(most) == 1


def test_a_folder_that_is_not_there_cannot_be_held(tmp_path):
    with pytest.raises(OutputError, match="cannot write here"), folder_lock(tmp_path / "absent"):
        pass
