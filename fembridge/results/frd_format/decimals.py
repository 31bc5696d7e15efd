"""Decimal numbers of a ``.frd`` at the speed of memory, each equal to ``float``.

A field is twelve characters, ``-1.37387E-03``: six digits and a power of ten. It
is taken as three words of four bytes, and digits are weighed four at a time with
integer arithmetic on whole arrays. A power of ten is kept as a sum of two
doubles, the first of 33 bits: its product with six digits (20 bits) is exact, and
the error of the second one's is below 2^-86 of the whole, so that their sum
rounds as the exact product does. All 199 million numbers of this form were
held against ``float``: equal to the bit (a test tries a sample of them).

What is not of this form (NaN, INF, a long exponent) goes to `fixed_text`, one by
one.
"""

from fractions import Fraction
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from fembridge.results.frd_format.fixed_text import FIELD, number
from fembridge.typing import BoolArray, FloatArray, IntArray

Words = NDArray[np.uint32]

ID_WIDTH = 10  # I10, the only width that CalculiX writes
_DIGITS = 5  # after the point
_HEAD_BITS = 33  # 53 of a double less the 20 that six digits need
_SIGN_BIT = np.uint64(63)
# Within the last word, from bit 10 up: is it a minus, the tens, the ones.
_TENS, _ONES = 6, 14
_POWER_BITS = 1 | 0xF << _TENS | 0xF << _ONES


def decimals(
    text: bytes, rows: int, width: int, first: int, columns: int
) -> tuple[FloatArray, BoolArray | None]:
    """Read `columns` fields that begin at byte `first` of rows of `width` bytes.

    Returns
    -------
    values, odd
        ``(rows, columns)``; and where a field is not six digits and a power of
        ten, so that its value means nothing: None if there is no such field.
    """
    shape, strides = (rows, columns), (width, FIELD)
    head, middle, tail = (
        np.ndarray(shape, "<u4", text, first + at, strides).flatten() for at in (0, 4, 8)
    )
    odd = _odd(head, middle, tail)
    power = tail  # no longer needed as it was
    power >>= 10
    power &= _POWER_BITS
    index = power.astype(np.intp)
    digits = _digits(head, middle).astype(np.float64)
    large, small = _powers_of_ten()
    values = large.take(index)
    values *= digits
    digits *= small.take(index)
    values += digits
    minus = (head & 1).astype(np.uint64)  # 0x2D is a minus, 0x20 a blank
    minus <<= _SIGN_BIT
    values.view(np.uint64)[...] |= minus  # and not a product: there is a -0.0
    found = None
    if odd.any():
        found = (odd != 0).reshape(shape)
    return values.reshape(shape), found


def whole_numbers(text: bytes, rows: int, width: int, first: int) -> tuple[IntArray, BoolArray]:
    """Read right-justified I10 integers, ``(rows,)``, and tell which are such."""
    high = np.ndarray((rows,), "<u2", text, first, (width,)).astype(np.uint64)
    low = np.ndarray((rows,), "<u8", text, first + 2, (width,)).copy()
    fine = _right_justified(high, low)
    high &= 0x0F0F  # a blank weighs nothing
    high *= 10 << 8 | 1
    high >>= 8
    high &= 0xFF
    low &= 0x0F0F0F0F0F0F0F0F
    low *= 10 << 8 | 1
    low >>= 8
    low &= 0x00FF00FF00FF00FF
    low *= 100 << 16 | 1
    low >>= 16
    low &= 0x0000FFFF0000FFFF
    low *= 10_000 << 32 | 1
    low >>= 32
    high *= 100_000_000
    high += low
    return high.astype(np.int64), fine


def odd_number(text: bytes, width: int, first: int, place: tuple[int, int]) -> float:
    """Read the field at row and column `place`, which `decimals` called odd.

    Raises
    ------
    ValueError
        It is no number; the message shows it.
    """
    at = place[0] * width + first + place[1] * FIELD
    return number(text[at : at + FIELD])


def _odd(head: Words, middle: Words, tail: Words) -> Words:
    """Give 0 where the three words are ``sd.d``, ``dddd``, ``Esdd``."""
    sign: Words = np.bitwise_and(head, 0xFF)
    sign ^= ord(" ")
    odd: Words = np.multiply(sign, sign ^ (ord(" ") ^ ord("-")))
    sign = np.bitwise_and(tail >> 8, 0xFF)
    sign ^= ord("+")
    sign *= sign ^ (ord("+") ^ ord("-"))
    odd |= sign
    odd |= (head & 0xF0FFF000) ^ 0x302E3000
    odd |= (middle & 0xF0F0F0F0) ^ 0x30303030
    odd |= (tail & 0xF0F000DF) ^ 0x30300045  # E, or e which is a bit more
    over_nine: Words = np.add(head & 0x0F000F00, 0x06000600)
    over_nine |= (middle & 0x0F0F0F0F) + 0x06060606
    over_nine |= (tail & 0x0F0F0000) + 0x06060000
    over_nine &= 0xF0F0F0F0
    odd |= over_nine
    return odd


def _digits(head: Words, middle: Words) -> Words:
    """Weigh the digits of ``sd.d`` and ``dddd``: 0 to 999999."""
    two: Words = np.bitwise_and(head, 0x0F000F00)
    two >>= 8
    two *= 10 << 16 | 1
    two >>= 16
    four = middle & 0x0F0F0F0F
    four *= 10 << 8 | 1
    four >>= 8
    four &= 0x00FF00FF
    four *= 100 << 16 | 1
    four >>= 16
    two *= 10_000
    two += four
    return two


def _right_justified(high: NDArray[np.uint64], low: NDArray[np.uint64]) -> BoolArray:
    """Whether two and eight characters are blanks, then one digit or more."""
    fine_high, in_high = _blanks_and_digits(high, 0x0101)
    fine_low, in_low = _blanks_and_digits(low, 0x0101010101010101)
    fine = fine_high & fine_low
    fine &= (in_low >> 56) == 1  # the last is a digit
    fine &= ((in_low << 8) & ~in_low) == 0  # what follows a digit is one
    fine &= (in_high >> 8 & ~in_low & 1) == 0
    fine &= (in_high & ~(in_high >> 8) & 1) == 0
    return fine


def _blanks_and_digits(word: NDArray[np.uint64], ones: int) -> tuple[BoolArray, NDArray[np.uint64]]:
    """Whether all bytes are blanks or digits; and 1 in each byte that is a digit."""
    digit: NDArray[np.uint64] = np.bitwise_and(word >> 4, ones)  # the bit that tells 0x30 from 0x20
    low_half = word & 0x0F * ones
    fine = (word & 0xE0 * ones) == 0x20 * ones
    fine &= (low_half + 0x06 * ones & 0xF0 * ones) == 0  # 9 at most
    fine &= (low_half & ~(digit * 0x0F)) == 0  # a blank is 0x20 and no more
    return fine, digit


@lru_cache(maxsize=1)
def _powers_of_ten() -> tuple[FloatArray, FloatArray]:
    """Give ``10^(e-5)`` as two doubles, by the bits of `e` as they are printed."""
    large = np.zeros(_POWER_BITS + 1)
    small = np.zeros(_POWER_BITS + 1)
    for exponent in range(-99, 100):
        power = Fraction(10) ** (exponent - _DIGITS)
        mantissa, shift = np.frexp(float(power))
        whole = np.floor(np.ldexp(mantissa, _HEAD_BITS))
        head = float(np.ldexp(whole, int(shift) - _HEAD_BITS))
        tens, ones = divmod(abs(exponent), 10)
        signs = (0, 1) if exponent == 0 else (int(exponent < 0),)
        for minus in signs:
            at = minus | tens << _TENS | ones << _ONES
            large[at], small[at] = head, float(power - Fraction(head))
    return large, small
