"""Files that a deck includes: looked for by their names, beside it."""

from collections.abc import Callable
from pathlib import Path

from fembridge.errors import DeckError
from fembridge.store import MAX_DECK_BYTES, read_bytes

Resolver = Callable[[str], bytes | None]
"""Bytes of a file by the name under which a deck includes it; None: it is absent."""

MOST_FILES = 1000
"""In all: one file may be included by many lines."""


def beside(path: Path) -> Resolver:
    """What reads the files that the deck at `path` includes."""

    def resolve(name: str) -> bytes | None:
        try:
            return read_bytes(path.parent / name, MAX_DECK_BYTES, DeckError)
        except (DeckError, ValueError):
            return None

    return resolve
