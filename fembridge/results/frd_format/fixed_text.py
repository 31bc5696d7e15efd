"""Fixed-width numbers of Fortran and C, as arrays of characters.

Values touch when they are negative (``2.69215E-03-1.37387E-03``): a field is
cut by its columns, never split at blanks.
"""

import re

import numpy as np
from numpy.typing import NDArray

from fembridge.typing import BoolArray, FloatArray, IntArray

CharArray = NDArray[np.uint8]

FIELD = 12  # E12.5
_BLANK, _ZERO, _NINE = ord(" "), ord("0"), ord("9")
_DIGITS = (1, 3, 4, 5, 6, 7, 10, 11)
_NUMBER = re.compile(rb" *[+-]?\d\.\d{5}[Ee][+-]\d{2,3} *")
_NOT_A_NUMBER = re.compile(rb" *[+-]?(nan.*|1\.#(ind|qnan|snan).*)", re.IGNORECASE)
_INFINITE = re.compile(rb" *([+-]?)(inf|infinity|1\.#inf.*) *", re.IGNORECASE)


def to_characters(text: bytes, width: int) -> CharArray:
    """View `text` as rows of `width` characters, ``(row, width)``."""
    return np.frombuffer(text, dtype=np.uint8).reshape(-1, width)


def integers(characters: CharArray) -> tuple[IntArray, BoolArray]:
    """Read right-justified integers ≥ 0, ``(row, width)`` -> ``(row,)``.

    The second array says which rows are such integers; elsewhere the value
    means nothing.
    """
    digit = (characters >= _ZERO) & (characters <= _NINE)
    fine = (digit | (characters == _BLANK)).all(axis=1) & digit[:, -1]
    fine &= (digit[:, :-1] <= digit[:, 1:]).all(axis=1)  # no blank after a digit
    value = np.zeros(len(characters), dtype=np.int64)
    for column in range(characters.shape[1]):
        value *= 10
        value += np.where(digit[:, column], characters[:, column] - _ZERO, 0)
    return value, fine


def floats(fields: CharArray) -> FloatArray:
    """Read E12.5 fields, ``(row, column, 12)`` -> ``(row, column)``.

    Raises
    ------
    ValueError
        A field is no number; the message shows it. ``NAN`` and ``INF`` are read
        as such: the caller knows the node and the time to name.
    """
    usual = np.isin(fields[..., 0], (_BLANK, ord("+"), ord("-")))
    usual &= (fields[..., 2] == ord(".")) & ((fields[..., 8] | 32) == ord("e"))
    usual &= np.isin(fields[..., 9], (ord("+"), ord("-")))
    for column in _DIGITS:
        usual &= (fields[..., column] >= _ZERO) & (fields[..., column] <= _NINE)
    texts = np.ascontiguousarray(fields).view(f"S{FIELD}")[..., 0]
    if usual.all():
        values: FloatArray = texts.astype(np.float64)
        return values
    values = np.empty(texts.shape, dtype=np.float64)
    values[usual] = texts[usual].astype(np.float64)
    for place in zip(*np.nonzero(~usual), strict=True):
        values[place] = number(fields[place].tobytes())
    return values


def number(field: bytes) -> float:
    """Read one field that may be a NaN, infinite or with a long exponent."""
    if _NUMBER.fullmatch(field):
        return float(field)
    if _NOT_A_NUMBER.fullmatch(field):
        return float("nan")
    infinite = _INFINITE.fullmatch(field)
    if infinite:
        return float(infinite[1] + b"inf")
    raise ValueError(f"{field.decode('latin-1')!r} is no number")
