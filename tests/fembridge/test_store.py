"""Files that are whole or not there, locks, digests, and TOML to values and back."""

import errno
import fcntl
import hashlib
import os
import stat
import subprocess
import sys
import tempfile
import tracemalloc
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fembridge.errors import FembridgeError, LockedError, OutputError, UsageError
from fembridge.host.store import (
    changed,
    check_output,
    digest,
    filling,
    folder_lock,
    read_sealed,
    read_toml,
    replacing,
    structure,
    unstructure,
    working_folder,
    write_text,
)

HOLD = """
from pathlib import Path
from time import sleep
from fembridge.host.store import folder_lock
with folder_lock(Path({folder!r}), ".lock"):
    print("held", flush=True)
    sleep(60)
"""

WRITE = """
import os, signal, sys
from pathlib import Path
from fembridge.host.store import filling, replacing, write_text
with filling(Path({folder!r}), last="a") as draft, replacing(Path({folder!r}, "b.csv")) as one:
    write_text(draft / "a", "half")
    print("half", flush=True)
    sys.stdin.read()
"""


def names_in(folder):
    return sorted(path.name for path in folder.iterdir())


def permissions(path):
    return stat.S_IMODE(path.stat().st_mode)


@pytest.fixture
def umask():
    """Set the umask, and put it back."""
    before = os.umask(0o022)
    yield os.umask
    os.umask(before)


@pytest.mark.parametrize("error", [ValueError("ours"), KeyboardInterrupt()])
def test_a_failure_inside_leaves_the_old_content_and_no_draft(tmp_path, error):
    path = tmp_path / "rates.csv"
    path.write_text("old")
    with pytest.raises(type(error)), replacing(path) as draft:
        draft.write_text("half")
        raise error
    assert path.read_text() == "old"
    assert names_in(tmp_path) == ["rates.csv"]


def test_a_full_disk_is_an_error_that_names_the_file(tmp_path):
    path = tmp_path / "rates.csv"
    path.write_text("old")

    with (
        pytest.raises(OutputError, match=r"rates\.csv: cannot write: No space left"),
        replacing(path) as draft,
        open("/dev/full", "w") as full,  # noqa: PTH123 - a device, no file of ours
    ):
        draft.write_text("half")
        full.write("x")
        full.flush()

    assert path.read_text() == "old"
    assert names_in(tmp_path) == ["rates.csv"]


@pytest.mark.parametrize("name", ["pipe", "link"])
def test_a_pipe_or_a_device_is_not_replaced(tmp_path, name):
    """Else root's ``-o /dev/null`` would leave the machine without one."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to("pipe")
    with pytest.raises(OutputError) as refused:
        write_text(tmp_path / name, "new")
    assert refused.value.path == tmp_path / name
    assert (tmp_path / "pipe").is_fifo()
    assert (tmp_path / "link").is_symlink()
    assert names_in(tmp_path) == ["link", "pipe"]


def test_what_a_link_points_to_is_replaced_and_the_link_stays(tmp_path):
    (tmp_path / "real").mkdir()
    (tmp_path / "real" / "rates.csv").write_text("old")
    (tmp_path / "link.csv").symlink_to("real/rates.csv")
    write_text(tmp_path / "link.csv", "new")
    assert (tmp_path / "link.csv").is_symlink()
    assert (tmp_path / "real" / "rates.csv").read_text() == "new"
    assert names_in(tmp_path / "real") == ["rates.csv"]


def test_a_file_where_a_folder_is_wanted_is_named(file):
    path = file("file", "mine")
    with pytest.raises(OutputError) as caught:
        write_text(path / "a/b/rates.csv", "new")
    assert caught.value.path == path
    assert path.read_text() == "mine"


@pytest.mark.parametrize(("mask", "expected"), [(0o022, 0o644), (0o077, 0o600)])
def test_a_file_has_the_permissions_of_any_new_one(tmp_path, umask, mask, expected):
    umask(mask)
    write_text(tmp_path / "a.csv", "new")
    with filling(tmp_path / "full", last="b.csv") as draft:
        write_text(draft / "b.csv", "new")
    assert permissions(tmp_path / "a.csv") == expected
    assert permissions(tmp_path / "full" / "b.csv") == expected


def test_the_last_file_is_never_beside_files_of_two_kinds(tmp_path, monkeypatch):
    """Stopped between two renames: the old last one is gone, the new one not there."""
    for name in ("a", "b", "last"):
        write_text(tmp_path / name, "old")
    moved, replace = [], Path.replace

    def stop_at_second(self, target):
        if target.parent == tmp_path:
            moved.append(target.name)
            if len(moved) == 2:
                raise KeyboardInterrupt
        return replace(self, target)

    with pytest.raises(KeyboardInterrupt), filling(tmp_path, last="last") as draft:
        for name in ("last", "b", "a"):
            write_text(draft / name, "new")
        monkeypatch.setattr(Path, "replace", stop_at_second)
    monkeypatch.undo()

    assert moved == ["a", "b"]
    assert names_in(tmp_path) == ["a", "b"]


@pytest.mark.parametrize("write", [filling, replacing])
def test_drafts_of_the_dead_are_removed_and_those_of_the_living_stay(tmp_path, write):
    """The next who writes there finds them, whatever it writes."""
    (tmp_path / ".fembridge-draft-link").symlink_to(tmp_path.parent)
    start = [sys.executable, "-c", WRITE.format(folder=str(tmp_path))]
    one = subprocess.Popen(start, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert one.stdout.readline() == b"half\n"
    of_one = names_in(tmp_path)
    assert len(of_one) == 3
    with write(tmp_path, "x") if write is filling else write(tmp_path / "x.csv"):
        assert set(of_one) < set(names_in(tmp_path))
    one.kill()
    one.communicate()
    assert set(of_one) <= set(names_in(tmp_path))

    write_text(tmp_path / "c.csv", "new")

    assert set(names_in(tmp_path)) - {"x.csv"} == {".fembridge-draft-link", "c.csv"}


def test_a_draft_that_is_taken_for_left_over_before_it_is_locked_is_made_again(
    tmp_path, monkeypatch
):
    made, opened = [], os.open

    def remove_first(path, *flags, **words):
        if "draft" in str(path) and not made:
            made.append(path)
            path.rmdir()
        return opened(path, *flags, **words)

    monkeypatch.setattr(os, "open", remove_first)
    write_text(tmp_path / "a.csv", "new")

    assert made
    assert names_in(tmp_path) == ["a.csv"]


def test_an_output_that_cannot_be_written_is_known_before(tmp_path):
    (tmp_path / "b.csv").mkdir()
    (tmp_path / "file").write_text("mine")
    check_output(tmp_path, "a.csv", "file")
    check_output(tmp_path / "new" / "below")
    for folder, names in ((tmp_path / "file", ()), (tmp_path, ("a.csv", "b.csv"))):
        with pytest.raises(OutputError) as caught:
            check_output(folder, *names)
        assert caught.value.path == folder / "/".join(names[-1:])
    assert names_in(tmp_path) == ["b.csv", "file"]
    assert (tmp_path / "file").read_text() == "mine"


@pytest.mark.parametrize("link", [Path.symlink_to, Path.hardlink_to])
def test_a_link_for_a_lock_file_is_refused_and_its_target_stays(tmp_path, monkeypatch, link):
    """Also one that is put there after we have looked."""
    (tmp_path / "mine").write_text("mine")
    link(tmp_path / ".lock", tmp_path / "mine")
    for _ in range(2):
        with pytest.raises(OutputError), folder_lock(tmp_path, ".lock"):
            pytest.fail("locked by a link")
        monkeypatch.setattr(Path, "is_symlink", lambda path: False)
    assert (tmp_path / "mine").read_text() == "mine"


def test_a_lock_file_that_becomes_a_link_while_it_is_locked_is_not_followed(tmp_path, monkeypatch):
    from filelock import FileLock

    (tmp_path / "mine").write_text("mine")
    acquire = FileLock.acquire

    def swap(lock, **words):
        found = acquire(lock, **words)
        (tmp_path / ".lock").unlink()
        (tmp_path / ".lock").symlink_to("mine")
        return found

    monkeypatch.setattr(FileLock, "acquire", swap)
    with pytest.raises(OutputError), folder_lock(tmp_path, ".lock"):
        pytest.fail("locked by a link")
    assert (tmp_path / "mine").read_text() == "mine"


def test_a_second_is_refused_and_learns_who_is_at_work(tmp_path):
    with folder_lock(tmp_path, ".lock"):
        for _ in range(2):  # one refused does not take the lock away
            with (
                pytest.raises(LockedError, match=f"process {os.getpid()} "),
                folder_lock(tmp_path, ".lock", wait=False),
            ):
                pytest.fail("two at work")
    assert names_in(tmp_path) == []


def test_the_lock_of_a_process_ends_when_it_is_killed(tmp_path):
    other = subprocess.Popen(
        [sys.executable, "-c", HOLD.format(folder=str(tmp_path))], stdout=subprocess.PIPE
    )
    assert other.stdout.readline() == b"held\n"
    with pytest.raises(LockedError), folder_lock(tmp_path, ".lock", wait=False):
        pytest.fail("two at work")
    other.kill()
    other.communicate()
    with folder_lock(tmp_path, ".lock", wait=False):
        pass


def test_a_file_system_without_locks_says_so_and_goes_on(tmp_path, monkeypatch):
    def no_lock(*_, **__):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", no_lock)
    with pytest.warns(UserWarning, match="No locks"), folder_lock(tmp_path, ".lock"):
        pass


@dataclass(frozen=True)
class Layer:
    name: str
    young_mpa: float = 1.0
    rows: int | None = None


@dataclass(frozen=True)
class Skin:
    layers: list[Layer]
    sizes_mm: tuple[float, ...] = ()
    marks: dict[str, Any] = field(default_factory=dict)
    named: Mapping[str, Layer] = field(default_factory=dict)
    fixed: bool = False
    seed: int | None = None


def test_a_table_becomes_a_value_and_a_table_again():
    table = {"layers": [{"name": "dermis", "young_mpa": 2}], "sizes_mm": [1, 0.5], "seed": 3}
    skin = structure(table, Skin, UsageError)
    assert skin == Skin([Layer("dermis", 2.0)], (1.0, 0.5), {}, seed=3)
    assert structure(unstructure(skin), Skin, UsageError) == skin
    assert "rows" not in unstructure(skin)["layers"][0]


def test_what_a_table_says_is_put_over_a_value():
    skin = Skin([Layer("dermis")], marks={"a": {"x": 1, "y": 2}})
    assert changed(skin, {"marks": {"a": {"y": 3}}, "fixed": True}, UsageError) == Skin(
        [Layer("dermis")], marks={"a": {"x": 1, "y": 3}}, fixed=True
    )


@pytest.mark.parametrize(
    ("table", "key", "found", "expected"),
    [
        ({}, "layers", None, None),
        ({"layers": "dermis"}, "layers", "dermis", "a list"),
        ({"layers": [{"name": "x"}, {"name": 7}]}, "layers 2.name", 7, "a word"),
        ({"layers": [{"name": "x", "young_mpa": "2"}]}, "layers 1.young_mpa", "2", "a number"),
        ({"layers": [{"name": "x", "young_mpa": True}]}, "layers 1.young_mpa", True, "a number"),
        ({"layers": [{"name": "x", "rows": 1.5}]}, "layers 1.rows", 1.5, "a whole number"),
        ({"layers": [], "sizes_mm": [1, "b"]}, "sizes_mm 2", "b", "a number"),
        ({"layers": [], "named": {"top": {"name": 3}}}, "named.top.name", 3, "a word"),
        ({"layers": [], "sizes_mm": [10**400]}, "sizes_mm 1", 10**400, "a number below 1e308"),
        (3, None, 3, "a table"),
    ],
)
def test_a_table_of_another_kind_is_an_error_with_key_and_value(table, key, found, expected):
    with pytest.raises(UsageError) as caught:
        structure(table, Skin, UsageError)
    error = caught.value
    assert (error.key, error.found, error.expected) == (key, found, expected)
    assert "\n" not in str(error)
    assert len(str(error)) < 200


def test_an_unknown_key_is_reported_before_other_errors_and_with_a_similar_one():
    with pytest.raises(UsageError, match="layers") as caught:
        structure({"layer": [], "seed": "x"}, Skin, UsageError)
    assert (caught.value.key, caught.value.found) == ("layer", "layer")


@pytest.mark.parametrize(
    ("content", "found"),
    [
        (None, "No such file"),
        (b"a = ", "a.toml"),
        (b"a = '\xff'", "0xff"),
        (b"a = " + b"[" * 5000, "a.toml"),
        (b"a = 1 # " + b"x" * 100, "50 bytes"),
    ],
)
def test_a_file_that_is_no_toml_is_one_line_with_its_name(tmp_path, content, found):
    path = tmp_path / "a.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(UsageError, match=found) as caught:
        read_toml(path, UsageError, 50 if found == "50 bytes" else 10_000)
    assert str(caught.value).startswith(f"{path}: ")


LETTERS = 'ab"\\\n é€😀'  # not all of Unicode, whose table takes seconds
KEYS = st.text(LETTERS, min_size=1, max_size=5)
NUMBERS = st.one_of(st.integers(-(2**70), 2**70), st.floats(allow_nan=False, allow_infinity=False))
LEAVES = st.one_of(NUMBERS, st.text(LETTERS, max_size=5), st.booleans(), st.none())


@given(st.dictionaries(KEYS, LEAVES, max_size=4), KEYS, NUMBERS, NUMBERS)
def test_any_other_number_makes_a_difference_and_no_order_does(table, key, one, other):
    """Of a number inside a table, too."""
    first = digest({**table, "in": {key: [one]}})
    second = digest({**dict(reversed(table.items())), "in": {key: [other]}})
    assert (first == second) == (one == other)


def test_a_text_that_can_be_worked_out_by_hand():
    table = {"b": (1, -0.0, 0.5), "a": {"x": True, "w": None}}
    text = '{"a":{"w":null,"x":true},"b":[1.0,0.0,0.5]}'
    assert digest(table) == hashlib.sha256(text.encode()).hexdigest()


BOMBS = {
    "dotted": b"ok = 1\n" + b".".join([b"a"] * 30_000) + b" = 1\n",
    "quoted": b'ok = 1\n"a". "b" .' + b'"a". ' * 9_000 + b"b = 1\n",
    "head": b"ok = 1\n[" + b".".join([b"a"] * 30_000) + b"]\n",
    "inline": b"ok = 1\nx = {" + b".".join([b"a"] * 30_000) + b" = 1}\n",
    "keys": b"".join(b"k%d = 1\n" % k for k in range(20_000)),
    "tables": b"".join(b"[k%d]\n" % k for k in range(20_000)),
    "inner": b"x = [" + b"{a=1}," * 20_000 + b"]",
    "arrays": b"x = " + b"[" * 100_000,
    "bytes": b"#" * 1_000_001,
}


@pytest.mark.parametrize(
    ("bomb", "reader"), [*((bomb, "read_toml") for bomb in BOMBS), ("dotted", "read_sealed")]
)
def test_a_toml_that_would_fill_the_memory_is_refused_before_it_is_parsed(tmp_path, bomb, reader):
    path = tmp_path / "run.toml"
    path.write_bytes(BOMBS[bomb])
    tracemalloc.start()
    try:
        with pytest.raises(FembridgeError, match=r"run\.toml") as refused:
            if reader == "read_toml":
                read_toml(path, FembridgeError)
            else:
                read_sealed(path, "map", 1)
        assert tracemalloc.get_traced_memory()[1] < 20e6
    finally:
        tracemalloc.stop()
    if bomb in ("dotted", "quoted", "head", "inline"):
        assert f"{path}:2: " in str(refused.value)


def test_dots_in_words_and_numbers_are_no_deep_key(file):
    path = file("run.toml", 'a.b.c.d.e.f.g.h = "x.1.2.3 a/b.c/d"\nn = [1.5, 2.5]\n')
    assert read_toml(path, FembridgeError)["n"] == [1.5, 2.5]


def test_a_folder_made_for_work_goes_with_it_where_nothing_was_written(tmp_path):
    folder = tmp_path / "new" / "folder"
    with pytest.raises(ValueError, match="no"), working_folder(folder) as draft:
        (draft / "a.txt").touch()
        raise ValueError("no")
    assert not list(tmp_path.iterdir())
    with working_folder(folder):
        write_text(folder / "a.txt", "kept")
    assert [path.name for path in folder.iterdir()] == ["a.txt"]


def test_a_folder_that_another_removes_before_the_draft_is_in_it_is_made_again(
    tmp_path, monkeypatch
):
    folder, make = tmp_path / "new", tempfile.mkdtemp
    removals = iter([True, True, False])

    def removed_first(**options):
        if next(removals):
            folder.rmdir()
        return make(**options)

    monkeypatch.setattr(tempfile, "mkdtemp", removed_first)
    with working_folder(folder) as draft:
        assert draft.parent == folder
