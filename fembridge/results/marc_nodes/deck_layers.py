"""The material of each element as the deck beside a post file says it.

From input version 14 on the ``connectivity`` header has the material; before, a
material lists its elements. A deck that does not have all elements of the file is
another model's, and is not asked.
"""

from pathlib import Path

import numpy as np

from fembridge.errors import DeckError
from fembridge.typing import IntArray

_LARGEST_BYTES = 200_000_000


def deck_materials(path: Path, element_ids: IntArray) -> tuple[IntArray, list[str]]:
    """Give the material ``(E,)`` of each element, from 0, and their names.

    Parameters
    ----------
    path
        The post file; its deck has the same stem and the suffix ``.dat``.

    Returns
    -------
    tuple
        Empty names where there is no such deck, or it does not tell all materials.
    """
    from decks.marc.contents import read_marc_deck
    from decks.marc.grammar import looks_like_marc

    nothing = np.zeros(element_ids.size, dtype=np.int64), list[str]()
    beside = path.with_suffix(".dat")
    try:
        if not beside.is_file() or beside.stat().st_size > _LARGEST_BYTES:
            return nothing
        text = beside.read_bytes()
        if not looks_like_marc(text):
            return nothing
        deck = read_marc_deck(text, beside)
        known = deck.materials()
    except (OSError, DeckError):
        return nothing
    number_of: dict[int, int] = {}
    for block in deck.elements:
        number_of.update(dict.fromkeys(block.number.tolist(), block.material))
    for one in known:
        number_of.update(dict.fromkeys(one.elements, one.number))
    numbers = np.array([number_of.get(e, 0) for e in element_ids.tolist()])
    if not numbers.size or (numbers == 0).any():
        return nothing
    held, layer = np.unique(numbers, return_inverse=True)
    names = {one.number: one.name for one in known}
    return layer.reshape(-1), [names.get(n) or f"material {n}" for n in held.tolist()]
