"""Marc's numbers for elements: plane strain, by the names that decks here use."""

from dataclasses import dataclass

from fembridge.errors import DeckError


@dataclass(frozen=True, slots=True)
class MarcElement:
    """A type of element: its `number` in Marc and its integration `points`.

    With `pressure` each element has one node more, of its own, which holds the
    pressure of the Herrmann formulation and has no place. `constant_dilatation`
    asks by the second geometric parameter for a change of volume that is the same
    in the whole element: without it four-node elements are too stiff where
    Poisson's ratio is near 0.5, as the dermis' 0.48.
    """

    number: int
    nodes: int
    points: int
    pressure: bool = False
    constant_dilatation: bool = False


# Four and eight nodes as in the decks of DAMASK (11, 27, 54) and PFLigthart (118).
# Type 80 was in no deck that could be read: its one pressure node an element is that
# of 118, its reduced form; its four points are those of 11. The node count of the
# paper's model, 36 346 of 17 815 elements, is that of 80 or 118.
MARC_TYPES: dict[str, MarcElement] = {
    "CPE4H": MarcElement(80, nodes=4, points=4, pressure=True),
    "CPE4": MarcElement(11, nodes=4, points=4, constant_dilatation=True),
    "CPE8": MarcElement(27, nodes=8, points=9),
    "CPE8R": MarcElement(54, nodes=8, points=4),
    "CPE4RH": MarcElement(118, nodes=4, points=1, pressure=True),
}


def marc_type(name: str) -> MarcElement:
    """Give Marc's type for the element `name`.

    Raises
    ------
    DeckError
        Marc has it, but no deck was seen that shows how, or it is unknown.
    """
    if name not in MARC_TYPES:
        known = ", ".join(f"{key} ({MARC_TYPES[key].number})" for key in MARC_TYPES)
        raise DeckError(f"no Marc element for {name!r}, expected one of {known}")
    return MARC_TYPES[name]
