"""A Marc deck among results: it has the suffix of CalculiX's prints, ``.dat``."""

from pathlib import Path

from fembridge.errors import DeckError, ResultError
from fembridge.typing import Table

SUFFIX = ".dat"
_FIRST_BYTES = 1 << 16


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
    """Tell what the deck holds.

    Raises
    ------
    ResultError
        It cannot be read as a deck.
    """
    from decks.marc.contents import describe_marc_deck

    try:
        held: Table = describe_marc_deck(path)
    except DeckError as error:
        raise ResultError(f"a Marc deck that cannot be read: {error}", path) from error
    return held
