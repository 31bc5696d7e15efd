"""How one number is written in a post file: packed, or 13 characters of text.

Formatted files have integers as I13 and reals as E13.6, six a line; negative
numbers touch what stands before them, so that a field is cut by its columns. An
exponent of three digits has no letter (``0.100000-100``): Fortran writes it so.
"""

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

FIELD_CHARACTERS = 13
FIELDS_A_LINE = 6
# What numpy reads and a number of Fortran does not hold: 1_000, an early end.
_FOREIGN = np.frombuffer(b"_\0", dtype=np.uint8)
_REAL = re.compile(rb" *([+-]?(?:\d+\.?\d*|\.\d+))(?:[EeDd]?([+-]\d+))? *")


@dataclass(frozen=True, slots=True)
class NumberFormat:
    """A number of `width` bytes; `dtype` of numpy if packed, "" if it is text."""

    width: int
    integer: bool
    dtype: str = ""

    def decode(self, characters: NDArray[np.uint8]) -> NDArray[Any]:
        """Read rows of fields side by side, ``(row, C * width)`` -> ``(row, C)``.

        The result is int64 or float64.

        Raises
        ------
        ValueError
            A field is no number; the message shows it.
        """
        kind = np.int64 if self.integer else np.float64
        packed = np.ascontiguousarray(characters)
        if self.dtype:
            with np.errstate(invalid="ignore"):  # of a signalling NaN
                return packed.view(self.dtype).astype(kind)
        if np.isin(packed, _FOREIGN).any():
            raise ValueError("bytes that belong to no number among numbers")
        fields = packed.view(f"S{self.width}")
        if self.integer:
            return fields.astype(np.int64)
        try:
            return fields.astype(np.float64)
        except ValueError:
            values = [_real(field) for field in fields.ravel().tolist()]
            return np.array(values).reshape(fields.shape)


INTEGER_TEXT = NumberFormat(FIELD_CHARACTERS, integer=True)
REAL_TEXT = NumberFormat(FIELD_CHARACTERS, integer=False)


def packed(width: int, integer: bool, big_endian: bool) -> NumberFormat:
    """Give the format of packed numbers of `width` bytes, 4 or 8."""
    order, kind = ">" if big_endian else "<", "i" if integer else "f"
    return NumberFormat(width, integer, f"{order}{kind}{width}")


def _real(field: bytes) -> float:
    match = _REAL.fullmatch(field)
    if match:
        return float(match[1] + b"e" + (match[2] or b"0"))
    try:
        return float(field)  # NaN and Infinity
    except ValueError:
        raise ValueError(f"{field!r} where a real is expected") from None
