"""The three ways Marc lays out numbers on a line: fixed, extended, free.

Fixed takes 5 columns for an integer and 10 for a real or a word; extended, after the
parameter of that name, twice as many; free is what a comma stands in, on any line.
A blank field is zero. A real may lack the letter of its exponent: ``5.0-1``; where a
field ends behind the sign, the exponent is zero (one deck that was run has that).
"""

import math
import re
from collections.abc import Sequence
from enum import Enum

from decks.marc_grammar.line import Line

_REAL = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+))(?:[eEdD]([+-]?\d+)|([+-]\d*))?\Z")
_INTEGER = re.compile(r"[+-]?\d+\Z")
_PLAIN = re.compile(r"[ \d+-]*")
_LONGEST_REAL, _LONGEST_INTEGER = 40, 18  # characters; longer ones are no numbers

Field = int | float | str


class Layout(Enum):
    """Columns of an integer; reals and words take twice as many."""

    FIXED = 5
    EXTENDED = 10

    def __init__(self, columns: int) -> None:
        self.integer = columns
        self.real = 2 * columns

    def columns(self, kind: str) -> int:
        """Columns of a field of `kind`: ``i`` integer, ``r`` real, ``w`` word."""
        return self.integer if kind == "i" else self.real


def is_free(text: str) -> bool:
    """Whether commas divide the fields of a line."""
    return "," in text


def real(text: str) -> float:
    """Read a real as Fortran does, with or without the letter of its exponent.

    Raises
    ------
    ValueError
        It is none, or too large.
    """
    found = _REAL.match(text) if len(text) <= _LONGEST_REAL else None
    if found is None:
        raise ValueError(text)
    exponent = (found[2] or found[3] or "").rstrip("+-") or "0"
    value = float(f"{found[1]}e{exponent}")
    if not math.isfinite(value):
        raise ValueError(text)
    return value


def integer(text: str) -> int:
    """Read an integer.

    Raises
    ------
    ValueError
        It is none.
    """
    if len(text) > _LONGEST_INTEGER or not _INTEGER.match(text):
        raise ValueError(text)
    return int(text)


def cut(text: str, layout: Layout, kinds: str) -> list[str]:
    """Cut a line into one text a letter of `kinds`, and the rest where that is ``t``.

    A last ``*`` repeats the letter before it to the end of the line. Fields that the
    line is too short for are empty texts, but for repeated ones, which end there.
    """
    endless = kinds.endswith("*")
    kinds = kinds.rstrip("*")
    if is_free(text):
        return _cut_free(text, kinds, endless)
    texts: list[str] = []
    place = 0
    body = text.rstrip()
    for kind in kinds:
        end = len(text) if kind == "t" else place + layout.columns(kind)
        if not (endless and place >= len(body) and len(texts) >= len(kinds) - 1):
            texts.append(text[place:end].strip())
        place = end
    width = layout.columns(kinds[-1])
    while endless and place < len(body):
        texts.append(text[place : place + width].strip())
        place += width
    return texts


def fields(line: Line, layout: Layout, kinds: str) -> list[Field]:
    """Read the fields of a line: ``i`` int, ``r`` float, ``w`` and ``t`` text.

    Raises
    ------
    DeckError
        A field is not what `kinds` says; the message names line and field.
    """
    texts = cut(line.text, layout, kinds)
    letters = kinds.rstrip("*")
    letters += letters[-1] * (len(texts) - len(letters))
    found: list[Field] = []
    for position, (text, kind) in enumerate(zip(texts, letters, strict=False), start=1):
        found.append(_value(line, text, kind, position))
    return found


def integers(line: Line, layout: Layout) -> list[int]:
    """Read all fields of a line as integers."""
    text, width = line.text.rstrip(), layout.integer
    if _PLAIN.fullmatch(text):  # the usual case, and most of a deck
        try:
            return [int(text[at : at + width]) for at in range(0, len(text), width)]
        except ValueError:
            pass  # blank fields, or digits out of their columns
    return [int(value) for value in fields(line, layout, "i*")]


def node_fields(line: Line, layout: Layout, width: int) -> tuple[int, list[float]]:
    """Read a number and `width` reals: ``fields`` of what most of a deck is."""
    text = line.text
    place = layout.integer
    if "," not in text:
        stop = place + width * layout.real
        try:
            places = range(place, stop, layout.real)
            return int(text[:place]), [
                _short_exponent(text[at : at + layout.real]) for at in places
            ]
        except ValueError:
            pass  # written in another way
    number, *reals_there = fields(line, layout, "i" + "r" * width)
    return int(number), [float(each) for each in reals_there]


def _short_exponent(text: str) -> float:
    """Read ``1.500000000000000+1``, the way Mentat writes reals; ValueError else."""
    if not (text[-2:-1] in ("+", "-") and text[-3:-2].isdigit() and "." in text):
        raise ValueError(text)
    return float(f"{text[:-2]}e{text[-2:]}")


def reals(line: Line, layout: Layout) -> list[float]:
    """Read all fields of a line as reals."""
    return [float(value) for value in fields(line, layout, "r*")]


def at_least(line: Line, values: Sequence[int], count: int, what: str) -> None:
    """Make sure that a line has `count` fields."""
    if len(values) < count:
        raise line.refuse(f"{len(values)} fields, expected {count}: {what}")


def only_integers(text: str, layout: Layout) -> int:
    """Count the fields of a line that is integers alone; 0 when it is not."""
    texts = cut(text, layout, "i*")
    if not texts or not all(_INTEGER.match(each) for each in texts if each):
        return 0
    return len(texts) if any(texts) else 0


def with_integer(text: str, layout: Layout, row: int, value: int) -> str:
    """Put `value` into field `row`, from 0, of a line of integers.

    Raises
    ------
    ValueError
        The value has more digits than the field has columns.
    """
    written = str(value)
    if is_free(text):
        items = text.split(",")
        items += [""] * (row + 1 - len(items))
        old = items[row]
        lead = old[: len(old) - len(old.lstrip())]
        items[row] = lead + written + (old[len(old.rstrip()) :] if old.strip() else "")
        return ",".join(items)
    width = layout.integer
    if len(written) > width:
        raise ValueError(written)
    padded = text.ljust((row + 1) * width)
    return padded[: row * width] + written.rjust(width) + padded[(row + 1) * width :]


def _cut_free(text: str, kinds: str, endless: bool) -> list[str]:
    items = [item.strip() for item in text.split(",")]
    if items[-1] == "":
        items.pop()  # a lone item is followed by a comma
    if kinds.endswith("t"):
        count = len(kinds) - 1
        items += [""] * (count - len(items))
        items = [*items[:count], ",".join(items[count:])]
    elif not endless:
        items = items[: len(kinds)]
    short = len(kinds) - endless - len(items)
    return items + [""] * short


def _value(line: Line, text: str, kind: str, position: int) -> Field:
    if kind in "wt":
        return text
    try:
        if kind == "i":
            return integer(text) if text else 0
        return real(text) if text else 0.0
    except ValueError:
        what = "an integer" if kind == "i" else "a real"
        raise line.refuse(f"field {position} is {text!r}, expected {what}") from None
