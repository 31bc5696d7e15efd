"""Changes of a text by its bytes: all else stays what it was."""

from dataclasses import dataclass

from decks.own_model.inp_text import Card, InpText, Row


@dataclass(frozen=True, slots=True)
class Edit:
    """Put `new` in the place of the bytes from `start` to `stop`."""

    start: int
    stop: int
    new: bytes = b""


def edited(data: bytes, edits: list[Edit]) -> bytes:
    """Make all `edits`; those at one place in the order they are given in."""
    pieces, done = [], 0
    for edit in sorted(edits, key=lambda edit: (edit.start, edit.stop)):
        pieces += [data[done : edit.start], edit.new]
        done = edit.stop
    return b"".join([*pieces, data[done:]])


def inserted(text: InpText, place: int, lines: list[str]) -> Edit:
    """Put `lines` where a line begins, with line ends as the deck has them."""
    new = b"".join(line.encode("latin-1") + text.newline for line in lines)
    if place and text.data[place - 1 : place] != b"\n":  # after a last line without end
        new = text.newline + new.removesuffix(text.newline)
    return Edit(place, place, new)


def in_place_of(text: InpText, card: Card, rows: list[Row], lines: list[str]) -> list[Edit]:
    """Put `lines` where the first of a card's `rows` is; the others go.

    Comments between them stay. Without rows the lines follow the keyword line.
    """
    if not rows:
        return [inserted(text, card.body, lines)]
    first, *others = rows
    said = text.data[first.start : first.stop]
    end = said[len(said.rstrip(b"\r\n")) :]
    joined = (end or text.newline).join(line.encode("ascii") for line in lines) + end
    if rows[-1].stop == len(text.data) and not text.data.endswith(b"\n"):
        joined = joined.removesuffix(end)  # the deck's last line had no end
    gone = [Edit(row.start, row.stop) for row in others]
    return [Edit(first.start, first.stop, joined), *gone]


def without(text: InpText, card: Card, rows: list[Row]) -> list[Edit]:
    """Take a card out: its keyword line and data; comments under it stay."""
    return [Edit(card.start, card.body), *(Edit(row.start, row.stop) for row in rows)]
