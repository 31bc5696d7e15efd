"""Isotropic materials of a Marc deck.

             1von mises           isotropic                   10         0         0
     E, Poisson's ratio, density, thermal expansion, yield stress, three more
             0         0 ...                      table of each of the eight

Up to input version 11 the list of its elements follows; later the mesh says them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from decks.marc_grammar.deck import MarcDeck
from decks.marc_grammar.layout import Layout, cut, fields, integers, reals
from decks.marc_grammar.line import Line
from decks.marc_grammar.number_list import read_list
from decks.marc_grammar.option import Option, Section, blocks

_ID = "iwwiiiit"
_LIST_IN_MATERIAL = 11  # the last input version, of those seen, with lists here
_TABLES = 8


@dataclass(frozen=True, slots=True)
class Isotropic:
    """A material: eight `values`, in the deck's units, and the table of each.

    `elements` are those that the option lists, none where the mesh says them.
    """

    number: int
    name: str
    criterion: str
    hardening: str
    values: tuple[float, ...]
    tables: tuple[int, ...]
    elements: tuple[int, ...]
    line: Line

    @property
    def young(self) -> float:
        """Young's modulus, before its table."""
        return self.values[0]

    @property
    def poisson(self) -> float:
        """Poisson's ratio, before its table."""
        return self.values[1]


def isotropic(deck: MarcDeck) -> tuple[Isotropic, ...]:
    """Read all isotropic materials.

    Raises
    ------
    DeckError
        A material without its numbers.
    """
    listed = (deck.version or 0) <= _LIST_IN_MATERIAL
    driven = bool(deck.find("table", Section.PARAMETER))
    return tuple(
        material
        for option in deck.find("isotropic", Section.MODEL)
        for material in _read(option, listed, driven)
    )


def _read(option: Option, listed: bool, driven: bool) -> list[Isotropic]:
    rows = option.data
    starts = [row for row in range(len(rows)) if _is_id(rows[row], option.layout)]
    if not starts and not all(line.blank for line in rows):
        raise option.head.refuse("`isotropic` without a line that names a material")
    return [_material(option, block, listed, driven) for block in blocks(rows, starts)]


def _is_id(line: Line, layout: Layout) -> bool:
    number, criterion = cut(line.text, layout, "iw")
    return number.isdigit() and criterion[:1].isalpha()


def _material(option: Option, rows: Sequence[Line], listed: bool, driven: bool) -> Isotropic:
    layout = option.layout
    before_list = 3 if driven else 2  # decks without tables have none here
    if len(rows) < before_list:
        raise rows[0].refuse("a material without its values and their tables")
    number, criterion, hardening, *_, name = fields(rows[0], layout, _ID)
    values = reals(rows[1], layout)
    if len(values) < 2:
        raise rows[1].refuse("expected Young's modulus, Poisson's ratio, ...")
    elements = [each for each in rows[before_list:] if not each.blank] if listed else []
    return Isotropic(
        int(number),
        str(name),
        str(criterion).lower(),
        str(hardening).lower(),
        tuple(values),
        tuple(integers(rows[2], layout)) if driven else (0,) * _TABLES,
        tuple(each for each in read_list(elements) if isinstance(each, int)),
        rows[0],
    )
