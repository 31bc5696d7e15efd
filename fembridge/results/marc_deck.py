"""A Marc deck among results: it has the suffix of CalculiX's prints, ``.dat``.

Beside a post file it says the material of each element. From input version 14 on the
``connectivity`` header has the material; before, a material lists its elements.
"""

from pathlib import Path

import numpy as np

from fembridge.errors import DeckError, ResultError
from fembridge.typing import IntArray, Table

SUFFIX = ".dat"
_FIRST_BYTES = 1 << 16
_LARGEST_BYTES = 200_000_000


def is_marc_deck(path: Path) -> bool:
    """Whether the file opens as a Marc deck does; False where it cannot be read."""
    if path.suffix.lower() != SUFFIX:
        return False
    from decks.marc.grammar import looks_like_marc

    try:
        with path.open("rb") as file:
            return looks_like_marc(file.read(_FIRST_BYTES))
    except (OSError, DeckError):
        return False


def describe(path: Path) -> Table:
    """What the deck holds.

    Raises
    ------
    ResultError
        It cannot be read as a deck.
    """
    from decks.marc.contents import describe_marc_deck

    try:
        return describe_marc_deck(path)
    except DeckError as error:
        raise ResultError(f"a Marc deck that cannot be read: {error}", path) from error


def materials_beside(path: Path, element_ids: IntArray) -> tuple[IntArray, tuple[str, ...]]:
    """Material ``(E,)`` of each element, from 0, and their names.

    The deck has the stem of the post file `path`. Without one, or where it does not have
    all elements of the file (it is another model's), there are no names.
    """
    from decks.marc.contents import read_marc_deck

    nothing = np.zeros(element_ids.size, dtype=np.int64), ()
    beside = path.with_suffix(SUFFIX)
    if not is_marc_deck(beside) or beside.stat().st_size > _LARGEST_BYTES:
        return nothing
    try:
        deck = read_marc_deck(beside.read_bytes(), beside)
        materials = deck.materials()
    except (OSError, DeckError):
        return nothing
    number_of: dict[int, int] = {}
    for block in deck.elements:
        number_of.update(dict.fromkeys(block.number.tolist(), block.material))
    for one in materials:
        number_of.update(dict.fromkeys(one.elements, one.number))
    numbers = np.array([number_of.get(element, 0) for element in element_ids.tolist()])
    if not numbers.size or (numbers == 0).any():
        return nothing
    used, layer = np.unique(numbers, return_inverse=True)
    names = {one.number: one.name for one in materials}
    return layer.reshape(-1), tuple(names.get(n) or f"material {n}" for n in used.tolist())
