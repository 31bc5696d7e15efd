"""Sizes are compared with a limit before memory is taken."""

import pytest

from fembridge.errors import TableError, UsageError
from fembridge.host.memory import check_memory, check_unpacked, machine_bytes, memory_limit_bytes

GIB = 1 << 30


def test_the_limit_is_a_quarter_of_the_machine_by_default(monkeypatch):
    monkeypatch.delenv("FEMBRIDGE_MEMORY", raising=False)
    assert memory_limit_bytes() == machine_bytes() // 4


@pytest.mark.parametrize(
    ("text", "size_bytes"),
    [("8G", 8 * GIB), ("1.5GiB", 3 * GIB // 2), ("500 MB", 500 << 20), ("4096", 4096)],
)
def test_a_variable_sets_another_limit(monkeypatch, text, size_bytes):
    monkeypatch.setenv("FEMBRIDGE_MEMORY", text)
    assert memory_limit_bytes() == size_bytes


@pytest.mark.parametrize("text", ["much", "-1G", "0", "nan", "8P", "1e300G"])
def test_a_limit_that_is_no_size_is_refused(monkeypatch, text):
    monkeypatch.setenv("FEMBRIDGE_MEMORY", text)
    with pytest.raises(UsageError):
        memory_limit_bytes()


def test_what_needs_more_is_refused_with_both_sizes_and_the_variable(monkeypatch, tmp_path):
    monkeypatch.setenv("FEMBRIDGE_MEMORY", "1G")
    check_memory(GIB, "a picture", TableError.at(tmp_path))
    with pytest.raises(TableError) as refused:
        check_memory(GIB + 1e8, "a picture", TableError.at(tmp_path))
    assert refused.value.path == tmp_path
    assert all(part in str(refused.value) for part in ("1.09 GB", "1 GB", "FEMBRIDGE_MEMORY"))


def test_content_that_grows_a_thousand_times_is_refused_within_the_limit(monkeypatch, tmp_path):
    monkeypatch.setenv("FEMBRIDGE_MEMORY", "8G")
    error = TableError.at(tmp_path)
    check_unpacked(10_000, 10_000_000, "an array", error)  # small, whatever the ratio
    check_unpacked(GIB // 10, GIB, "an array", error, copies=2)
    with pytest.raises(TableError):
        check_unpacked(GIB // 1000, GIB, "an array", error)
    with pytest.raises(TableError):
        check_unpacked(GIB, 3 * GIB, "an array", error, copies=3)
