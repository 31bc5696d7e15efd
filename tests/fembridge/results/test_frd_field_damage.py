"""Whole fields of files that are damaged, unfinished, or change while read."""

import numpy as np
import pytest

from fembridge import read_fields
from fembridge.errors import ResultError


def test_a_file_that_did_not_end_well_is_refused_at_once(samples):
    with pytest.raises(ResultError, match=r"no end line 9999.*--partial"):
        read_fields(samples / "cpe4_incmax.frd")


def test_a_quantity_that_is_not_there_is_named_with_those_that_are(samples):
    with pytest.raises(ResultError, match="no HEAT in it, it holds DISP, STRESS"):
        read_fields(samples / "cpe4_ascii.frd", "HEAT")


def test_blocks_without_records_are_explained(samples):
    with pytest.raises(ResultError, match=r"0 records.*OUTPUT=2D"):
        list(read_fields(samples / "cpe8r_3d_nset_zero.frd"))


@pytest.mark.parametrize("flag", [1, 2, 3])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_number_that_is_not_finite_is_refused_or_left_out(write_frd, block, flag, value):
    good = [(n, [1.0] * 6) for n in (1, 2)]
    bad = [(1, [1.0] * 6), (2, [1.0, value, 1.0, 1.0, 1.0, 1.0])]
    path = write_frd(
        [block("STRESS", k, k * 1e-3, bad if k == 2 else good, flag) for k in (1, 2, 3)]
    )
    words = f"node 2 at 2 ms: STRESS SYY is {value}"
    with pytest.raises(ResultError, match=words):
        list(read_fields(path))
    said = []
    fields = list(read_fields(path, partial=True, tell=said.append))
    assert [field.increment for field in fields] == [1, 3]
    assert said == [f"dropped step 1, increment 2: {words}"]


def test_a_number_too_large_in_pascal_is_no_number(write_frd, block):
    path = write_frd([block("STRESS", 1, 1e-3, [(1, [1e305] * 6)], 3)])
    with pytest.raises(ResultError, match="node 1 at 1 ms: STRESS SXX is inf"):
        list(read_fields(path))
    (field,) = read_fields(path, stress_unit="Pa")
    assert field.values.tolist() == [[1e305] * 6]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (b"1.00000E+00", b"1.0000xE+00", r"node 2, SYY: ' 1.0000xE\+00' is no number"),
        (b" -1         2", b" -1       2 x", "record 2 of 2 begins with"),
        (b" -1         2", b" -5         2", "record 2 of 2 begins with"),
    ],
)
def test_a_damaged_record_is_named(write_frd, block, old, new, words):
    records = [(1, [2.0] * 6), (2, [3.0, 1.0, 3.0, 3.0, 3.0, 3.0])]
    path = write_frd([block("STRESS", 1, 1e-3, records)])
    content = path.read_bytes()
    at = content.rindex(old)
    path.write_bytes(content[:at] + new + content[at + len(old) :])
    with pytest.raises(ResultError, match=words):
        list(read_fields(path, partial=True))


@pytest.mark.parametrize("records", [1, 500])
def test_a_file_that_shrinks_while_it_is_read_is_told(write_frd, block, records):
    rows = [(node, range(6)) for node in range(1, records + 1)]
    path = write_frd([block("STRESS", k, k * 1e-3, rows) for k in range(1, 9)])
    fields = read_fields(path)
    next(fields)
    path.write_bytes(path.read_bytes()[:-1000])
    with pytest.raises(ResultError, match=r"shrank|it had \d+ bytes when it was opened"):
        list(fields)


def test_a_file_that_grows_is_read_as_far_as_it_was_with_partial(write_frd, block):
    rows = [(node, range(6)) for node in range(1, 9)]
    path = write_frd([block("STRESS", k, k * 1e-3, rows) for k in (1, 2)])
    said = []
    strict, lenient = (read_fields(path), read_fields(path, partial=True, tell=said.append))
    next(strict), next(lenient)
    with path.open("ab") as file:
        file.write(b"more")
    assert len(list(lenient)) == 1
    assert "grew" in said[0]
    with pytest.raises(ResultError, match="it grew"):
        list(strict)
