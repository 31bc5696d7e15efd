"""Numbers on the data lines of a keyword deck, as Fortran reads them."""

import math
import re

from decks.own_model.inp_blocks import place_of
from decks.own_model.inp_text import InpText
from fembridge.errors import DeckError

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([ED][+-]?\d+)?", re.IGNORECASE)


def number(word: str, text: InpText, line: int, *, blank: float | None = None) -> float:
    """Read `word` of a line; an empty one is `blank`.

    Raises
    ------
    DeckError
        It is no number.
    """
    packed = "".join(word.split())
    if not packed and blank is not None:
        return blank
    if _NUMBER.fullmatch(packed):
        value = float(packed.upper().replace("D", "E"))
        if math.isfinite(value):
            return value
    raise DeckError(f"{place_of(text, line)}: {word.strip()[:40]!r} where a number is expected")


def whole(word: str, text: InpText, line: int, *, blank: int | None = None) -> int:
    """Read a whole number; an empty word is `blank`.

    Raises
    ------
    DeckError
        It is none.
    """
    packed = "".join(word.split())
    if not packed and blank is not None:
        return blank
    if packed.isascii() and packed.isdigit() and len(packed) <= 10:
        return int(packed)
    raise DeckError(
        f"{place_of(text, line)}: {word.strip()[:40]!r} where a whole number is expected"
    )
