"""Lines of a keyword deck: numbers that ccx reads whole, and lists of them.

ccx cuts a number at 20 characters without a word and takes at most 16 entries a
line, of an amplitude four pairs.
"""

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain

import numpy as np

from fembridge.typing import FloatArray, IntArray

LONGEST_NUMBER = 20
_PER_LINE = 12
_PAIRS_PER_LINE = 4


def real(number: float) -> str:
    """Give the shortest text of a number, or 13 digits where that is too long."""
    text = repr(float(number))
    return text if len(text) <= LONGEST_NUMBER else f"{float(number):.12E}"


def fixed(number: float, digits: int) -> str:
    """Give a number with `digits` decimals; where they are too few for it, `real`."""
    text = f"{number:.{digits}f}"
    exact = abs(float(text) - number) <= 1e-12 * abs(number)
    return text if exact and len(text) <= LONGEST_NUMBER else real(number)


def plain(text: str) -> str:
    """Give text as printable ASCII on one line, whatever was in it."""
    return text.encode("unicode_escape").decode("ascii")


def node_lines(node_mm: FloatArray, first: int) -> Iterator[str]:
    """List nodes in the plane, numbered from `first`."""
    yield from numbered_node_lines(range(first, first + len(node_mm)), node_mm)


def numbered_node_lines(numbers: Iterable[int], node_mm: FloatArray) -> Iterator[str]:
    """List nodes in the plane by their `numbers`."""
    for number, (x, y) in zip(numbers, (node_mm + 0.0).tolist(), strict=True):
        yield f"{number}, {x:.9f}, {y:.9f}, 0.0"


def element_lines(numbers: Iterable[int], nodes: IntArray) -> Iterator[str]:
    """List elements by their `numbers`; `nodes` ``(E, n)`` are numbers as well."""
    for number, row in zip(numbers, nodes.tolist(), strict=True):
        yield f"{number}, {', '.join(map(str, row))}"


def list_lines(numbers: Sequence[int] | IntArray) -> Iterator[str]:
    """List whole numbers, as a set does."""
    flat = np.asarray(numbers).tolist()
    for start in range(0, len(flat), _PER_LINE):
        yield ", ".join(map(str, flat[start : start + _PER_LINE])) + ","


def pair_lines(pairs: Iterable[tuple[str, str]]) -> Iterator[str]:
    """List times and values, as an amplitude does."""
    flat = list(chain.from_iterable(pairs))
    for start in range(0, len(flat), 2 * _PAIRS_PER_LINE):
        yield ", ".join(flat[start : start + 2 * _PAIRS_PER_LINE])
