"""Post file of a Marc deck: what is written, of all elements and nodes.

Under the updated Lagrange formulation, which Marc's listing names for decks of this
kind with large strain, code 311 is Cauchy stress: one tensor is enough. Stress is
written at integration points; there is no nodal von Mises stress.
"""

from collections.abc import Iterator

from decks.marc.lines import comment, integers, named, option
from fembridge.errors import DeckError

STRESS = 311
VON_MISES = 17
ELEMENT_CODES = (STRESS, VON_MISES)

DISPLACEMENT = 1
REACTION_FORCE = 5
CONTACT_NORMAL_FORCE = 35
CONTACT_STATUS = 38
NODAL_CODES = (DISPLACEMENT, REACTION_FORCE, CONTACT_NORMAL_FORCE, CONTACT_STATUS)

# The fourth number of the option. 0 was seen, 1 is told by a reader of such decks;
# that 2 is both follows from Mentat's three choices, not from a deck.
KINDS = {"binary": 0, "formatted": 1, "both": 2}

_BINARY_UNITS = (16, 17)
_FORMATTED_UNITS = (19, 20)
_EVERY_INCREMENT = 1
_ALL_LAYERS = 0


def post(kind: str) -> Iterator[str]:
    """Write what goes on the post files, ``job.t16`` (binary), ``job.t19`` or both.

    Raises
    ------
    DeckError
        `kind` is none of `KINDS`.
    """
    if kind not in KINDS:
        raise DeckError(f"post {kind!r}, expected one of {', '.join(KINDS)}")
    yield from comment(
        f"post file, {kind}: stress ({STRESS}) and von Mises stress ({VON_MISES}) at "
        "the integration points; at nodes displacement, reaction, contact force and "
        "contact status"
    )
    if kind == "both":
        yield from comment(
            "the fourth number is 2 for both kinds, which no deck was seen with: 0 is binary"
        )
    yield named("post")
    yield integers(
        [
            len(ELEMENT_CODES),
            *_BINARY_UNITS,
            KINDS[kind],
            0,
            *_FORMATTED_UNITS,
            0,
            _EVERY_INCREMENT,
            *[0] * 3,
            len(NODAL_CODES),
            *[0] * 3,
        ]
    )
    for code in ELEMENT_CODES:
        yield integers([code, _ALL_LAYERS])
    for code in NODAL_CODES:
        yield option("nodal", code)
