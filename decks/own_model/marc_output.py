"""The output that traces need, asked of an own Marc deck: stress, every increment."""

from decks.marc_grammar.deck import MarcDeck
from decks.marc_grammar.layout import fields, with_integer
from decks.marc_grammar.option import Option, Section
from decks.marc_grammar.post import BOTH, COUNT, EVERY, FORMATTED, Post, post
from decks.own_model.marc_edits import Edits, integers_line, set_integer

STRESS, VON_MISES = 311, 17
"""Codes of the stress tensor and of von Mises stress."""
_WANTED = (VON_MISES, STRESS)
_FORMATTED = {"binary": 0, "text": 1, "both": BOTH}
# A new option: units of the files as Mentat writes them, every increment.
_HEAD = (len(_WANTED), 16, 17, 0, 0, 19, 20, 0, 1, 0, 0, 0, 0, 0, 0, 0)


def set_output(edits: Edits, deck: MarcDeck, case: int, results: str | None) -> list[str]:
    """Ask for stress and von Mises stress at every increment; tell what was done.

    `case` is the load case of the waveform. `results` is "binary", "text", "both" or
    None: as the deck has it. Other quantities stay as they are.

    Raises
    ------
    DeckError
        The request that is there cannot be read.
    """
    found = post(deck)
    if found is None:
        told = [_new(edits, deck, _FORMATTED[results or "binary"])]
    else:
        wanted = found.head[FORMATTED] if results is None else _FORMATTED[results]
        told = _changed(edits, found, wanted)
    return told + _every_increment(edits, deck, case)


def _new(edits: Edits, deck: MarcDeck, formatted: int) -> str:
    (end,) = deck.find("end option", Section.MODEL)[:1]
    layout = end.layout
    head = [*_HEAD[:FORMATTED], formatted, *_HEAD[FORMATTED + 1 :]]
    lines = [integers_line(each, layout, "") for each in (head, *_codes(_WANTED))]
    edits.insert(end.head, "post", *lines)
    return f"{end.head.place}: `post` put before it, with codes {_listed(_WANTED)}"


def _changed(edits: Edits, found: Post, formatted: int) -> list[str]:
    layout, line = found.option.layout, found.head_line
    there = {each.code for each in found.codes}
    missing = tuple(code for code in _WANTED if code not in there)
    changes = {
        COUNT: (len(found.codes) + len(missing), found.head[COUNT]),
        FORMATTED: (formatted, found.head[FORMATTED]),
        EVERY: (1, found.head[EVERY]),
    }
    text = line.text
    for row, (new, old) in changes.items():
        if new != old:
            text = with_integer(text, layout, row, new)
    last = found.codes[-1].line if found.codes else line
    added = [integers_line(each, layout, last.text) for each in _codes(missing)]
    if last is line:
        edits.replace(line, text, *added)
    else:
        edits.replace(line, text)
        if added:
            edits.replace(last, last.text, *added)
    told = []
    if missing:
        told.append(f"{line.place}: `post` also asks for codes {_listed(missing)}")
    if found.head[EVERY] not in (0, 1):
        told.append(f"{line.place}: `post` every increment, not every {found.every}")
    if found.head[FORMATTED] != formatted:
        told.append(
            f"{line.place}: field 4 of `post`, the kind of results, is {formatted}, "
            f"was {found.head[FORMATTED]}"
        )
    return told


def _every_increment(edits: Edits, deck: MarcDeck, case: int) -> list[str]:
    """Undo a ``post increment`` that leaves increments out."""
    found: list[Option] = [
        option
        for option in deck.find("post increment", Section.HISTORY)
        if option.case <= case and option.data
    ]
    if not found:
        return []
    option = found[-1]
    line = option.data[0]
    (every,) = fields(line, option.layout, "i")
    if every in (0, 1):
        return []
    set_integer(edits, line, option.layout, 0, 1)
    return [f"{line.place}: `post increment` every increment, not every {every}"]


def _codes(codes: tuple[int, ...]) -> list[tuple[int, int]]:
    return [(code, 0) for code in codes]  # layer 0: of a solid there is no other


def _listed(codes: tuple[int, ...]) -> str:
    return ", ".join(map(str, codes))
