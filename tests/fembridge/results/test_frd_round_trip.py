"""What is written to a ``.frd`` is what is read from it, whatever the storage."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from fembridge.errors import ResultError
from fembridge.results import frd
from fembridge.results.byte_file import ByteFile
from fembridge.results.frd_format.index import index_frd
from fembridge.results.frd_format.records import NodeRecords, node_ids
from fembridge.results.read_options import ReadOptions

AS_IS = ReadOptions(stress_unit="Pa")
PRINTED = "{:12.5E}".format
IDS = st.lists(st.integers(1, 99_999), min_size=1, max_size=40)
FLAGS = st.sampled_from([0, 1, 2, 3])


def stored(values, flag):
    """Give `values` as the storage `flag` keeps them."""
    if flag == 2:
        return values.astype(np.float32).astype(np.float64)
    if flag < 2:
        flat = [float(PRINTED(value)) for value in values.ravel()]
        return np.array(flat).reshape(values.shape)
    return values


def random_blocks(block, ids, flags, seed, count=6, name="STRESS", components=()):
    """Blocks of random values: of `ids` in that order, one flag an increment."""
    rng = np.random.default_rng(seed)
    sizes = 10.0 ** rng.integers(-30, 30, (len(flags), len(ids), count))
    values = rng.standard_normal((len(flags), len(ids), count)) * sizes
    blocks = [
        block(
            name,
            increment,
            increment * 5e-4,
            [(node, row.tolist()) for node, row in zip(ids, table, strict=True)],
            flag=flag,
            components=components,
        )
        for increment, (flag, table) in enumerate(zip(flags, values, strict=True), 1)
    ]
    return blocks, [stored(table, f) for table, f in zip(values, flags, strict=True)]


@settings(max_examples=60, deadline=None)
@given(ids=IDS, flags=st.lists(FLAGS, min_size=1, max_size=4), seed=st.integers(0, 99))
def test_values_come_back_for_any_order_duplicates_and_mixed_storage(
    block, write_frd, ids, flags, seed
):
    blocks, expected = random_blocks(block, ids, flags, seed)
    path = write_frd(blocks)
    wanted = list(dict.fromkeys(reversed(ids)))
    rows = [ids.index(node) for node in wanted]  # of duplicates the first

    times_ms, tensor_pa = frd.read_stress_tensor(path, wanted, AS_IS)

    assert_array_equal(tensor_pa, np.stack(expected)[:, rows])
    assert_array_equal(times_ms, [0.5 * (k + 1) for k in range(len(flags))])


@settings(deadline=None)
@given(count=st.integers(1, 20), flag=FLAGS, seed=st.integers(0, 99))
def test_any_number_of_components_fits_the_record_length(block, write_frd, count, flag, seed):
    """Beyond six, ASCII continues on further lines; few and many nodes agree."""
    names = tuple(f"C{k}" for k in range(count))
    ids = list(range(100, 0, -1))
    blocks, (expected,) = random_blocks(block, ids, [flag], seed, count, "SDV", names)
    with ByteFile(write_frd(blocks)) as file:
        (found,) = index_frd(file).blocks
        assert found.components == names
        assert_array_equal(node_ids(file, found), ids)
        assert_array_equal(NodeRecords(file, ids).read(found), expected)
        few = NodeRecords(file, ids[7:9])
        few.read(found)
        assert_array_equal(few.read(found), expected[7:9])  # the remembered rows


def test_rows_that_move_between_blocks_are_found_again(block, write_frd):
    tables = [{1: 1.0, 2: 2.0, 3: 3.0}, {3: 30.0, 1: 10.0}, {2: 200.0, 1: 100.0}]
    blocks = [
        block("STRESS", k, k * 1e-3, [(n, [x] * 6) for n, x in table.items()])
        for k, table in enumerate(tables, start=1)
    ]
    _, tensor_pa = frd.read_stress_tensor(write_frd(blocks), [1], AS_IS)
    assert_array_equal(tensor_pa[:, 0, 0], [1, 10, 100])


def test_a_node_that_leaves_the_output_is_missed_by_name_and_increment(block, write_frd):
    tables = [{1: 1.0, 2: 2.0}, {1: 10.0}]
    blocks = [
        block("STRESS", k, k * 1e-3, [(n, [x] * 6) for n, x in table.items()])
        for k, table in enumerate(tables, start=1)
    ]
    with pytest.raises(ResultError, match=r"node 2 .* STRESS of step 1, increment 2"):
        frd.read_stress_tensor(write_frd(blocks), [2])


def test_components_in_another_order_are_taken_by_name(block, write_frd):
    names = ("SZX", "SXX", "SYY", "SZZ", "SXY", "SYZ")
    only = block("STRESS", 1, 1e-3, [(1, [6, 1, 2, 3, 4, 5])], components=names)
    _, tensor_pa = frd.read_stress_tensor(write_frd([only]), [1], AS_IS)
    assert tensor_pa[0, 0].tolist() == [1, 2, 3, 4, 5, 6]


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_exponents_of_three_digits_are_read(block, write_frd, sign):
    """Some Windows builds print -5.28012E-003: lines of unequal length."""

    def three_digits(value):
        text = f"{value:.5E}"
        return f"{text[:-2]}0{text[-2:]}".rjust(12)

    values = [5.28012e-3 * sign, 3.06745e-3, -1.0, 0.0, 2.0e10, -1e-12]
    blocks = [
        block("STRESS", k, k * 1e-3, [(7, values), (8, values[::-1])], number=three_digits)
        for k in (1, 2)
    ]
    _, tensor_pa = frd.read_stress_tensor(write_frd(blocks), [8, 7], AS_IS)
    assert_array_equal(tensor_pa[1], [values[::-1], values])


def test_lines_that_end_as_in_windows_are_read(block, write_frd):
    blocks = [block("STRESS", k, k * 1e-3, [(1, [k] * 6)]) for k in (1, 2)]
    path = write_frd(blocks, line_end="\r\n")
    _, tensor_pa = frd.read_stress_tensor(path, [1], AS_IS)
    assert tensor_pa[:, 0, 0].tolist() == [1, 2]


def test_a_lower_case_exponent_is_read(block, write_frd):
    only = block("STRESS", 1, 1e-3, [(1, [-1.5] * 6)], 0, number="{:12.5e}".format)
    _, tensor_pa = frd.read_stress_tensor(write_frd([only]), [1], AS_IS)
    assert tensor_pa[0, 0].tolist() == [-1.5] * 6


def test_stress_is_scaled_by_the_unit_of_the_file(block, write_frd):
    path = write_frd([block("STRESS", 1, 1e-3, [(1, [2.0] * 6)])])
    found = {
        unit: frd.read_stress_tensor(path, [1], ReadOptions(stress_unit=unit))[1]
        for unit in ("MPa", "kPa", "Pa")
    }
    assert {unit: value[0, 0, 0] for unit, value in found.items()} == {
        "MPa": 2.0e6,
        "kPa": 2.0e3,
        "Pa": 2.0,
    }


@settings(deadline=None)
@given(dt_ms=st.floats(0.05, 2.0), samples=st.integers(3, 400), start=st.integers(1, 50))
def test_rounding_of_printed_times_does_not_make_an_even_step_uneven(dt_ms, samples, start):
    times_s = (np.arange(samples) + start) * dt_ms / 1e3
    printed = [f"{t:.5E}" if t < 1 else f"{t:.9f}" for t in times_s]
    times_ms = frd.unrounded(np.array([float(text) for text in printed]) * 1e3)
    steps_ms = np.diff(times_ms)
    assert steps_ms.max() - steps_ms.min() <= 1e-9 * times_ms[-1]


def test_an_uneven_step_stays_uneven():
    times_ms = np.array([0.5, 1.0, 1.75, 2.0])
    assert_array_equal(frd.unrounded(times_ms), times_ms)
