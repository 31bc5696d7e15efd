"""Files that are cut, changed or foreign: an error with words, never a number.

All cuts and 600 changes where ``CI`` is set, a part of them elsewhere.
"""

import os
import re
import struct

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from fembridge.errors import ResultError
from fembridge.results import frd
from fembridge.results.read_options import ReadOptions

CUT_STEP, CHANGES = (1, 600) if os.environ.get("CI") == "true" else (7, 120)
PRINTED = re.compile(rb"(?=([+-]?\d\.\d{5}[Ee][+-]\d{2}))")  # they may overlap
LENIENT = ReadOptions(partial=True, across_materials=True, stress_unit="Pa")


def small_run(block, flag, increments=2):
    """DISP and STRESS of two nodes, every number another."""
    blocks, number = [], 0.0
    for k in range(1, increments + 1):
        for name, count in (("DISP", 3), ("STRESS", 6)):
            records = []
            for node in (3, 1):
                sign = -1.0 if node == 3 else 1.0
                row = [sign * (number + 1.25 * j + 0.5) for j in range(count)]
                records.append((node, row))
                number += 16.0
            blocks.append(block(name, k, k * 5e-4, records, flag=flag))
    return blocks


@pytest.mark.parametrize("flag", [1, 2, 3])
def test_a_cut_at_any_byte_gives_an_error_or_a_true_beginning(block, write_frd, flag):
    blocks = small_run(block, flag)
    path = write_frd(blocks, f"cut{flag}.frd", mesh_flag=min(flag, 2))
    times_ms, tensor = frd.read_stress_tensor(path, [1, 3], LENIENT)
    _, moved = frd.read_displacement(path, [1, 3], LENIENT)
    seen, whole_size = set(), path.stat().st_size
    ending = range(whole_size - 1, whole_size - 30, -1)
    for size in [*ending, *range(whole_size - 30, -1, -CUT_STEP)]:
        os.truncate(path, size)
        if size < whole_size - 1:  # without its last line end nothing is lost
            with pytest.raises(ResultError):
                frd.read_stress_tensor(path, [1, 3])
        for reader, whole in ((frd.read_stress_tensor, tensor), (frd.read_displacement, moved)):
            try:
                some_ms, some = reader(path, [1, 3], LENIENT)
            except ResultError as error:
                assert str(path) in str(error)
                continue
            seen.add(some_ms.size)
            assert_array_equal(some_ms, times_ms[: some_ms.size])
            assert_array_equal(some, whole[: some_ms.size])
    assert seen == {1, 2}


@pytest.mark.parametrize("flag", [1, 2, 3])
def test_changed_bytes_never_make_a_number_that_is_not_in_the_file(block, write_frd, flag):
    blocks = small_run(block, flag, increments=2)
    path = write_frd(blocks, f"fuzz{flag}.frd", mesh_flag=min(flag, 2))
    whole, rng = path.read_bytes(), np.random.default_rng(flag)
    read = refused = 0
    for _ in range(CHANGES):
        changed = bytearray(whole)
        for place in rng.integers(0, len(whole), rng.integers(1, 4)):
            at, kind = min(place, len(changed) - 1), rng.integers(3)
            if kind == 0:
                changed[at] = rng.integers(256)
            elif kind == 1:
                changed[at] ^= 1 << rng.integers(8)
            else:
                changed[at : at + rng.integers(1, 9)] = b""
        path.unlink()  # else the disk is waited for
        path.write_bytes(changed)
        try:
            _, values = frd.read_stress_tensor(path, [1, 3], LENIENT)
        except ResultError:
            refused += 1
            continue
        read += 1
        for value in values.ravel():
            assert in_file(float(value), bytes(changed), flag)
    assert read > CHANGES // 15
    assert refused > CHANGES // 15


def in_file(value, content, flag):
    if flag == 1:
        return value in {float(number[1]) for number in PRINTED.finditer(content)}
    return struct.pack("<f" if flag == 2 else "<d", value) in content


def test_a_count_beyond_the_file_is_told_before_anything_is_allocated(block, write_frd):
    lying = block("STRESS", 1, 1e-3, [(1, [1.0] * 6)], flag=3, count=2_000_000_000)
    with pytest.raises(ResultError, match=r"after \d+ of 2000000000 records"):
        frd.read_stress_tensor(write_frd([lying]), [1])


@pytest.mark.parametrize("flag", [1, 2])
@pytest.mark.parametrize("count", [1, 3])
def test_a_count_that_lies_is_no_shift_of_records(block, write_frd, flag, count):
    records = [(1, [1.0] * 6), (2, [2.0] * 6)]
    blocks = [block("STRESS", k, k * 1e-3, records, flag=flag) for k in (1, 2)]
    blocks[0] = block("STRESS", 1, 1e-3, records, flag=flag, count=count)
    with pytest.raises(ResultError, match="STRESS of step 1, increment 1"):
        frd.read_stress_tensor(write_frd(blocks), [1, 2])


@pytest.mark.parametrize("kept", [0, 40, 86, 100])
def test_increments_appended_behind_a_cut_are_found_again(block, write_frd, kept):
    """A disk that was full and had room again: text goes on within a line."""
    blocks = [block("STRESS", k, k * 1e-3, [(1, [k] * 6), (2, [k] * 6)]) for k in (1, 2, 3)]
    path = write_frd(blocks)
    whole = path.read_bytes()
    start = whole.index(b" -1         1", whole.index(b" 2.00000E-03")) + kept
    end = whole.index(b"    1PSTEP", start)
    path.write_bytes(whole[:start] + whole[end:])
    with pytest.raises(ResultError, match="STRESS of step 1, increment 2 is cut"):
        frd.read_stress_tensor(path, [1])
    times_ms, tensor = frd.read_stress_tensor(path, [1], LENIENT)
    assert times_ms.tolist() == [1.0, 3.0]
    assert tensor[:, 0, 0].tolist() == [1.0, 3.0]


def test_markers_inside_binary_records_are_numbers_there(block, write_frd):
    text = b"    1PSTEP -3\n 9999\n\n"
    values = struct.unpack("<5f", text[:20])
    records = [(1, [*values, 1.0]), (2, [2.0] * 6)]
    blocks = [block("STRESS", k, k * 1e-3, records, flag=2) for k in (1, 2)]
    _, tensor = frd.read_stress_tensor(write_frd(blocks), [2], LENIENT)
    assert tensor[:, 0, 0].tolist() == [2.0, 2.0]


@pytest.mark.parametrize("flag", [1, 2, 3])
@pytest.mark.parametrize("bad", [float("nan"), float("inf"), float("-inf")])
def test_a_value_that_is_no_number_is_named_by_node_and_time(block, write_frd, flag, bad):
    blocks = [
        block("STRESS", 1, 5e-4, [(4, [1.0] * 6)], flag=flag),
        block("STRESS", 2, 1e-3, [(4, [1.0, bad, 1, 1, 1, 1])], flag=flag),
    ]
    path = write_frd(blocks)
    with pytest.raises(ResultError, match=r"node 4 at 1 ms: STRESS SYY is -?(nan|inf)"):
        frd.read_stress_tensor(path, [4])
    heard = []
    options = ReadOptions(partial=True, tell=heard.append)
    assert frd.read_stress_tensor(path, [4], options)[0].tolist() == [0.5]
    assert heard[0].startswith("dropped step 1, increment 2: node 4 at 1 ms")


def test_times_that_go_back_are_refused(block, write_frd):
    blocks = [
        block("STRESS", k, time_s, [(1, [1.0] * 6)])
        for k, time_s in ((1, 1e-3), (2, 3e-3), (3, 2e-3))
    ]
    words = "increment 3 at 2 ms comes after 3 ms"
    with pytest.raises(ResultError, match=words):
        frd.read_stress_tensor(write_frd(blocks), [1])


def test_a_quantity_that_is_absent_is_named_beside_what_is_there(block, write_frd):
    path = write_frd([block("DISP", 1, 1e-3, [(1, [1.0] * 3)])])
    with pytest.raises(ResultError, match="no STRESS in it, it holds DISP"):
        frd.read_stress_tensor(path, [1])


def test_an_increment_without_its_twin_is_refused_or_told(block, write_frd):
    blocks = [
        block("DISP", 1, 1e-3, [(1, [1.0] * 3)]),
        block("STRESS", 1, 1e-3, [(1, [1.0] * 6)]),
        block("DISP", 2, 2e-3, [(1, [2.0] * 3)]),
    ]
    path = write_frd(blocks)
    with pytest.raises(ResultError, match="step 1, increment 2 has no STRESS"):
        frd.read_stress_and_displacement(path, [1], [1])
    both = frd.read_stress_and_displacement(path, [1], [1], LENIENT)
    assert both.times_ms.tolist() == [1.0]


def test_bytes_behind_the_end_line_are_told(block, write_frd):
    path = write_frd([block("STRESS", 1, 1e-3, [(1, [1.0] * 6)])])
    path.write_bytes(path.read_bytes() + b"    1C\n")
    with pytest.raises(ResultError, match="bytes after the end line"):
        frd.read_stress_tensor(path, [1])


def test_a_file_that_shrinks_while_it_is_read_is_an_error(block, write_frd):
    from fembridge.results.byte_file import ByteFile

    path = write_frd([block("STRESS", 1, 1e-3, [(1, [1.0] * 6)])])
    with ByteFile(path) as file:
        os.truncate(path, 100)
        with pytest.raises(ResultError, match="something else is writing it"):
            file.take(90, 40)
