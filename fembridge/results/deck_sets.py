"""Sets of nodes in a CalculiX deck: which nodes a name stands for.

    *NSET, NSET=PROBES
    11, 18, 25
    *NSET, NSET=ROW, GENERATE
    1, 35, 7

Read as ccx reads it: keywords and names are case-blind, blanks do not count, a set
may be spread over the deck and over ``*INCLUDE`` files, and may name sets before it.
A deck that stands beside a result file is somebody's: it is read line by line, in
bounded memory, and what is not understood is an error where it touches the set.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from fembridge.errors import ResultError, UsageError
from fembridge.results.printed.text_lines import text_lines

_DEEPEST_INCLUDE = 10
_MOST_PIECES = 1_000_000  # runs of consecutive numbers, over all sets
_MOST_NODES = 2_000_000  # in the one that is asked for
_LONGEST_NUMBER = 16  # characters


@dataclass(slots=True)
class _Deck:
    """What has been read so far: pieces of each set, in deck order."""

    sets: dict[str, list[range]] = field(default_factory=dict)
    pieces: int = 0

    def add(self, name: str, piece: range, path: Path, line: int) -> None:
        """Append a piece to the set `name`."""
        pieces = self.sets.setdefault(name, [])
        last = pieces[-1] if pieces else None
        if last is not None and last.step == piece.step and last.stop == piece.start:
            pieces[-1] = range(last.start, piece.stop, last.step)
        else:
            pieces.append(piece)
            self.pieces += 1
        if self.pieces > _MOST_PIECES:
            words = f"set {name}: more than {_MOST_PIECES} entries in the deck's sets"
            raise ResultError(words, path, line)


def read_node_set(deck: Path, name: str) -> list[int]:
    """Give the nodes of the set `name` of `deck`, in its order, each once.

    Raises
    ------
    UsageError
        There is no such set; the message names those there.
    ResultError
        There is no such deck, or a set in it cannot be read.
    """
    found = read_node_sets(deck)
    nodes = found.get(name.strip().upper())
    if nodes is None:
        held = ", ".join(found) or "none"
        raise UsageError(f"{deck}: no node set {name!r}; it has {held}")
    if sum(map(len, nodes)) > _MOST_NODES:
        raise ResultError(
            f"set {name} has {sum(map(len, nodes))} nodes, {_MOST_NODES} are the most "
            "to read one by one",
            deck,
        )
    return list(dict.fromkeys(node for piece in nodes for node in piece))


def read_node_sets(deck: Path) -> dict[str, list[range]]:
    """Give the node sets of `deck` by name, in capitals, as ranges of numbers.

    Raises
    ------
    ResultError
        There is no such deck, or a set in it cannot be read.
    """
    found = _Deck()
    _read(deck, found, ())
    return found.sets


def deck_beside(result: Path) -> Path:
    """Give the deck with the stem of `result`, beside it.

    Raises
    ------
    UsageError
        There is none.
    """
    deck = result.with_suffix(".inp")
    if not deck.is_file():
        raise UsageError(f"{result}: no deck {deck.name} beside it; name one: --deck")
    return deck


def _read(path: Path, deck: _Deck, above: tuple[Path, ...]) -> None:
    if len(above) > _DEEPEST_INCLUDE or path in above:
        raise ResultError(f"*INCLUDE {len(above)} deep: it includes itself", path)
    card = _Card("", {})
    for line, text in _cards(path):
        if text.startswith("*"):
            card = _card(text)
            if card.keyword == "*INCLUDE":
                name = card.options.get("INPUT", "")
                if not name:
                    raise ResultError("*INCLUDE without INPUT=", path, line)
                top = above[0] if above else path
                _read(top.parent / name, deck, (*above, path))
            elif card.keyword == "*NSET" and not card.set_name:
                raise ResultError("*NSET without NSET=", path, line)
            elif card.keyword == "*NSET":
                _check_known(card, path, line)
                deck.sets.setdefault(card.set_name, [])
        elif card.set_name:
            for piece in _pieces(card, text, deck, path, line):
                deck.add(card.set_name, piece, path, line)


@dataclass(frozen=True, slots=True)
class _Card:
    keyword: str
    options: dict[str, str]

    @property
    def set_name(self) -> str:
        """Name of the node set that the card's lines belong to; "" for none."""
        if self.keyword not in ("*NSET", "*NODE"):
            return ""
        return self.options.get("NSET", "").upper()


def _card(text: str) -> _Card:
    keyword, *words = text.split(",")
    options = {}
    for word in words:
        key, _, value = word.partition("=")
        options["".join(key.split()).upper()] = value.strip()
    return _Card("".join(keyword.split()).upper(), options)


def _check_known(card: _Card, path: Path, line: int) -> None:
    foreign = [key for key in card.options if key in ("ELSET", "INSTANCE")]
    if foreign:
        raise ResultError(f"*NSET with {foreign[0]}= is not of CalculiX, and not read", path, line)


def _pieces(card: _Card, text: str, deck: _Deck, path: Path, line: int) -> Iterator[range]:
    words = [word.strip() for word in text.split(",")]
    if card.keyword == "*NODE":
        yield _one(words[0], path, line)
        return
    words = [word for word in words if word]
    if "GENERATE" in card.options:
        numbers = [_number(word, path, line) for word in words]
        if len(numbers) not in (2, 3) or numbers[-1] < 1 or numbers[1] < numbers[0]:
            raise ResultError(
                f"GENERATE with {text.strip()[:60]!r}, expected first, last, step", path, line
            )
        yield range(numbers[0], numbers[1] + 1, numbers[2] if len(numbers) > 2 else 1)
        return
    for word in words:
        if word.isascii() and word.isdigit():
            yield _one(word, path, line)
            continue
        pieces = deck.sets.get(word.upper())
        if pieces is None:
            raise ResultError(
                f"set {card.set_name} names {word!r}, no node and no set before it", path, line
            )
        yield from list(pieces)


def _one(word: str, path: Path, line: int) -> range:
    number = _number(word, path, line)
    return range(number, number + 1)


def _number(word: str, path: Path, line: int) -> int:
    if not (word.isascii() and word.isdigit() and len(word) < _LONGEST_NUMBER):
        raise ResultError(f"{word[:40]!r} where a node is expected", path, line)
    return int(word)


def _cards(path: Path) -> Iterator[tuple[int, str]]:
    """Yield lines without comments; a keyword that goes on is one line."""
    held, first = "", 0
    for line, text, _ in text_lines(path):
        if text.startswith("**") or not text.strip():
            continue
        if held:
            text = held + text
        if text.lstrip().startswith("*") and text.rstrip().endswith(","):
            held, first = text.rstrip(), first or line
            if len(held) > 4096:
                raise ResultError("a card without end", path, first)
            continue
        yield first or line, text.strip()
        held, first = "", 0
