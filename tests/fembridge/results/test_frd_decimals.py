"""Decimal fields and numbers of nodes: equal to ``float`` and ``int``, bit for bit."""

import os

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from fembridge.results.frd_format.decimals import decimals, odd_number, whole_numbers

STEP = 97 if os.environ.get("CI") == "true" else 1009
PRINTED = st.builds(
    "{}{}.{:05d}{}{}{:02d}".format,
    st.sampled_from(" -"),
    st.integers(0, 9),
    st.integers(0, 99_999),
    st.sampled_from("Ee"),
    st.sampled_from("+-"),
    st.integers(0, 99),
)


def bits_of(values):
    return np.asarray(values, dtype=np.float64).view(np.int64).ravel().tolist()


@given(fields=st.lists(PRINTED, min_size=1, max_size=40))
@example(fields=["-0.00000E+00", " 0.00000E-99", " 9.99999E+99", "-9.99999E-99"])
@example(fields=[" 9.00719E+15", " 1.00000E+23", " 8.41000E+21", " 5.49450E-04"])
def test_every_field_is_the_float_of_its_text(fields):
    text = "".join(f"#{field}\n" for field in fields).encode()
    values, odd = decimals(text, len(fields), 14, 1, 1)
    assert odd is None
    assert bits_of(values) == bits_of([float(field) for field in fields])


@pytest.mark.parametrize("exponent", range(-99, 100))
def test_the_hardest_digits_of_each_power_of_ten_are_rounded_as_float_does(exponent):
    """Those whose exact value lies nearest to the middle of two doubles."""
    digits = np.arange(0, 1_000_000, STEP)
    fields = [
        f" {number // 100_000}.{number % 100_000:05d}E{exponent:+03d}" for number in digits.tolist()
    ]
    values, odd = decimals("".join(fields).encode(), len(fields), 12, 0, 1)
    assert odd is None
    assert bits_of(values) == bits_of([float(field) for field in fields])


def test_columns_of_a_record_are_cut_where_they_stand():
    text = b" -1         7 1.00000E+00-2.50000E-01\n -1         8-0.00000E+00 3.00000E+00\n"
    values, odd = decimals(text, 2, 38, 13, 2)
    assert odd is None
    assert bits_of(values) == bits_of([1.0, -0.25, -0.0, 3.0])


@pytest.mark.parametrize("at", range(12))
def test_a_field_with_any_other_character_anywhere_is_called_odd(at):
    usual = b"-1.37387E-03"
    allowed = {0: b" -", 8: b"Ee", 9: b"+-", 2: b"."}.get(at, b"0123456789")
    for byte in range(256):
        field = usual[:at] + bytes([byte]) + usual[at + 1 :]
        _, odd = decimals(field + usual, 2, 12, 0, 1)
        expected = None if byte in allowed else [True, False]
        assert (None if odd is None else odd.ravel().tolist()) == expected


@pytest.mark.parametrize(
    ("field", "value"),
    [(b"3.06745E-003", 3.06745e-3), (b"+1.50000E+00", 1.5), (b"        -INF", -np.inf)],
)
def test_what_is_odd_and_a_number_is_read_one_by_one(field, value):
    text = b"-1.37387E-03" + field
    values, odd = decimals(text, 1, 24, 0, 2)
    assert odd.tolist() == [[False, True]]
    assert values[0, 0] == -1.37387e-03
    assert odd_number(text, 24, 0, (0, 1)) == value


def test_what_is_no_number_is_shown():
    with pytest.raises(ValueError, match=r"'-1.3x387E-03' is no number"):
        odd_number(b"-1.3x387E-03", 12, 0, (0, 0))


@given(numbers=st.lists(st.integers(0, 9_999_999_999), min_size=1, max_size=50))
def test_every_node_number_is_the_int_of_its_text(numbers):
    text = "".join(f" -1{number:10d}\n" for number in numbers).encode()
    found, fine = whole_numbers(text, len(numbers), 14, 3)
    assert fine.all()
    assert found.tolist() == numbers


@given(field=st.text(" 0123456789-+.E\x00", min_size=10, max_size=10))
def test_only_blanks_and_then_digits_are_a_node_number(field):
    _, fine = whole_numbers(field.encode(), 1, 10, 0)
    assert bool(fine[0]) == (field.lstrip(" ").isdigit() and len(field) == 10)


@pytest.mark.parametrize("at", range(10))
def test_a_node_number_with_any_other_byte_is_none(at):
    usual = b"1234567890"
    for byte in range(256):
        field = usual[:at] + bytes([byte]) + usual[at + 1 :]
        _, fine = whole_numbers(field, 1, 10, 0)
        digit = byte in b"0123456789"
        blank = at == 0 and byte == ord(" ")
        assert bool(fine[0]) == (digit or blank)
