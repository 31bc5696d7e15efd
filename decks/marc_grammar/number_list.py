"""Marc's lists: ``1 to 15 by 2 and 40 except inner``, on lines that end in ``c``."""

import re
from collections.abc import Mapping, Sequence

from decks.marc_grammar.line import Line
from decks.marc_grammar.names import continues

NumberList = list[int] | list[tuple[int, int]]

_PAIR = re.compile(r"([+-]?\d{1,18}):(\d{1,9})\Z")
_NUMBER = re.compile(r"[+-]?\d{1,18}\Z")
_JOINING = ("and", "except", "intersect")
_TO = ("to", "through")
_MOST = 20_000_000  # members of a list

_Item = tuple[int, ...]


def read_list(
    lines: Sequence[Line], *, paired: bool = False, earlier: Mapping[str, NumberList] | None = None
) -> NumberList:
    """Read a list from `lines`: numbers, or pairs ``element:side`` if `paired`.

    `earlier` are sets by name that the list may name. No member comes twice.

    Raises
    ------
    DeckError
        A word that is no part of a list; names its line.
    """
    words = _words(lines)
    names = {name.lower(): members for name, members in (earlier or {}).items()}
    found: dict[_Item, None] = {}
    joining, row = "and", 0
    while row < len(words):
        line, word = words[row]
        if word.lower() in _JOINING:
            joining, row = word.lower(), row + 1
            continue
        if word.lower() in names:
            items: list[_Item] = [
                (each,) if isinstance(each, int) else each for each in names[word.lower()]
            ]
            row += 1
        else:
            items, row = _span(words, row, paired)
        if len(found) + len(items) > _MOST:
            raise line.refuse(f"a list of more than {_MOST} members")
        found = _joined(found, items, joining)
        joining = "and"
    if paired:
        return [(each[0], each[1]) for each in found]
    return [each[0] for each in found]


def _words(lines: Sequence[Line]) -> list[tuple[Line, str]]:
    words = []
    for line in lines:
        parts = line.text.replace(",", " ").split()
        if parts and continues(line.text):
            parts.pop()
        words += [(line, part) for part in parts]
    return words


def _span(words: Sequence[tuple[Line, str]], row: int, paired: bool) -> tuple[list[_Item], int]:
    """Read ``a``, ``a to b`` or ``a to b by n``."""
    first, row = _item(words, row, paired), row + 1
    if row >= len(words) or words[row][1].lower() not in _TO:
        return [first], row
    last, row = _item(words, row + 1, paired), row + 2
    line = words[row - 1][0]
    step = 1
    if row < len(words) and words[row][1].lower() == "by":
        step, row = abs(_item(words, row + 1, paired=False)[0]) or 1, row + 2
    if first[1:] != last[1:]:
        raise line.refuse("a list goes from one side of an element to another")
    forward = 1 if last[0] >= first[0] else -1
    if abs(last[0] - first[0]) // step > _MOST:
        raise line.refuse(f"a list of more than {_MOST} members")
    span = range(first[0], last[0] + forward, forward * step)
    return [(number, *first[1:]) for number in span], row


def _item(words: Sequence[tuple[Line, str]], row: int, paired: bool) -> _Item:
    if row >= len(words):
        raise words[-1][0].refuse(f"a list ends in {words[-1][1]!r}")
    line, word = words[row]
    found = (_PAIR if paired else _NUMBER).match(word)
    if found is None:
        what = "element:side" if paired else "a number or the name of a set before"
        raise line.refuse(f"{word!r} in a list, expected {what}")
    return (int(found[1]), int(found[2])) if paired else (int(found[0]),)


def _joined(found: dict[_Item, None], items: Sequence[_Item], joining: str) -> dict[_Item, None]:
    if joining == "and":
        found.update(dict.fromkeys(items))
        return found
    other = set(items)
    keep = joining == "intersect"
    return {each: None for each in found if (each in other) == keep}
