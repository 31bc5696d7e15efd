"""Lines of a Marc deck in extended format: whole numbers in 10 columns, reals in 20.

Marc reads by column and fields touch, so that a number too wide for its field
would change its neighbours: it is refused. A keyword is left in 20 columns, so
are the words after it; numbers after a keyword have 10, as everywhere.
"""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from fembridge.errors import DeckError
from fembridge.typing import FloatArray, IntArray

INTEGER_WIDTH = 10
REAL_WIDTH = 20
WORD_WIDTH = 20
# A list of nodes or elements: columns an item, items a line, as Mentat writes it.
LIST_WIDTH = 12
LIST_ITEMS = 13
# A line that the list goes on after.
_GOES_ON = "   c"
# Blocks of values take as many a line: reals 8, whole numbers 16.
REALS_A_LINE = 8
INTEGERS_A_LINE = 16
_DECIMALS = 15
# How an exponent of one digit begins as Python writes it.
_ONE_DIGIT = ("E+0", "E-0")
_COMMENT = "$...."
_COMMENT_TEXT = 74


def real(number: float) -> str:
    """Give 20 columns: one digit, 15 decimals, a signed exponent without a letter.

    An exponent of two digits takes the place of one decimal, of three of two.
    Zero has no sign.

    Raises
    ------
    DeckError
        The number is not finite.
    """
    text = f"{number + 0.0:.{_DECIMALS}E}"
    if text[-4:-1] in _ONE_DIGIT:
        return f"{text[:-4]}{text[-3]}{text[-1]}".rjust(REAL_WIDTH)
    mantissa, _, exponent = text.partition("E")
    if not exponent:
        raise DeckError(f"a number of the deck is {number}, expected a finite one")
    decimals = _DECIMALS + 1 - len(exponent[1:])
    mantissa, _, exponent = f"{number:.{decimals}E}".partition("E")
    return f"{mantissa}{exponent[0]}{exponent[1:].lstrip('0')}".rjust(REAL_WIDTH)


def reals(numbers: Iterable[float]) -> str:
    """Put reals side by side, 20 columns each."""
    return "".join(map(real, numbers))


def integers(numbers: Iterable[int]) -> str:
    """Put whole numbers side by side, 10 columns each.

    Raises
    ------
    DeckError
        A number has more than ten digits.
    """
    fields = [f"{number:{INTEGER_WIDTH}d}" for number in numbers]
    for field in fields:
        if len(field) > INTEGER_WIDTH:
            raise DeckError(
                f"{field} is wider than {INTEGER_WIDTH} columns, which is what a "
                "Marc deck has for a whole number"
            )
    return "".join(fields)


def zeros(count: int, **fields: float) -> list[float]:
    """Give `count` zeros, but for fields by number from 1: ``zeros(8, f3=0.4)``."""
    numbers = [0.0] * count
    for name, number in fields.items():
        numbers[int(name[1:]) - 1] = number
    return numbers


def option(keyword: str, *numbers: int) -> str:
    """Give a keyword line with numbers from column 21 on."""
    return (f"{keyword:<{WORD_WIDTH}}" + integers(numbers)).rstrip()


def named(*words: str) -> str:
    """Give a keyword line of words, 20 columns each."""
    return "".join(f"{word:<{WORD_WIDTH}}" for word in words).rstrip()


def comment(text: str) -> Iterator[str]:
    """Give `text` as comment lines, in printable ASCII and short enough to read."""
    line = ""
    for word in text.encode("unicode_escape").decode("ascii").split():
        if line and len(line) + 1 + len(word) > _COMMENT_TEXT:
            yield _COMMENT + line
            line = ""
        line = f"{line} {word}" if line else word
    yield _COMMENT + line


def list_lines(numbers: Sequence[int] | IntArray) -> Iterator[str]:
    """List nodes or elements, as a set does."""
    flat = np.asarray(numbers).tolist()
    for start in range(0, len(flat), LIST_ITEMS):
        row = flat[start : start + LIST_ITEMS]
        line = "".join(f"{number:{LIST_WIDTH}d}" for number in row)
        yield line + (_GOES_ON if start + LIST_ITEMS < len(flat) else "")


def node_lines(node_mm: FloatArray, first: int) -> Iterator[str]:
    """List nodes in the plane, numbered from `first`; z is 0."""
    flat_z = real(0.0)
    for number, (x_mm, y_mm) in enumerate(node_mm.tolist(), start=first):
        yield f"{number:{INTEGER_WIDTH}d}{real(x_mm)}{real(y_mm)}{flat_z}"


def element_lines(numbers: Iterable[int], element_type: int, nodes: IntArray) -> Iterator[str]:
    """List elements by their `numbers`; `nodes` ``(E, n)`` are numbers, n up to 14."""
    kind = f"{element_type:{INTEGER_WIDTH}d}"
    row_format = f"%{INTEGER_WIDTH}d" * nodes.shape[1]
    for number, row in zip(numbers, nodes.tolist(), strict=True):
        yield f"{number:{INTEGER_WIDTH}d}{kind}{row_format % tuple(row)}"
