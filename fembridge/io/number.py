"""Numbers in texts: ASCII digits, finite, nothing else.

Python's ``float`` also accepts ``1_000``, digits of every script, ``nan`` and ``inf``, and
turns ``1e999`` into infinity. No program that we read writes a number that way: such a word
is damage or another column.
"""

import math


def parse_number(text: str) -> float:
    """The finite number that `text` states.

    Raises
    ------
    ValueError
        Anything else: other scripts, underscores, NaN, infinity, a number beyond 1.8e308.
    """
    value = float(text)
    if "_" in text or not text.isascii() or not math.isfinite(value):
        raise ValueError(f"{text!r} is not a finite number in ASCII digits")
    return value


def parse_whole_number(text: str) -> int:
    """The whole number that `text` states in ASCII digits.

    Raises
    ------
    ValueError
        Anything else, such as ``1.0`` or ``1_000``.
    """
    value = int(text)
    if "_" in text or not text.isascii():
        raise ValueError(f"{text!r} is not a whole number in ASCII digits")
    return value
