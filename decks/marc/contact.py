"""Contact of a Marc deck: bodies, their interaction, and which pairs may touch.

Field by field as Mentat 2021.4 writes them. What a field means is known of those
that are named here; the others are what Mentat puts there. Which of them asks for
segment-to-segment contact is not known: `decks.marc.procedure`.
"""

from collections.abc import Iterator

import numpy as np

from decks.marc.layout import FINGER_BODY, PROBE_BODY, Layout
from decks.marc.lines import (
    INTEGERS_A_LINE,
    REALS_A_LINE,
    comment,
    integers,
    named,
    option,
    real,
    reals,
    zeros,
)
from decks.marc.motion import INTO_SKIN_MM, WAVEFORM
from fembridge.typing import FloatArray

FINGER = "finger"
PROBE = "probe"
INTERACTION = 1
INTERACTION_NAME = "touch"
TABLE = 1
TABLE_NAME = "contact_pairs"

# Friction types; 0 is none.
_BILINEAR_COULOMB = 6
_BY_NODAL_FORCE = 1
_MOST_SEPARATIONS = 9999
_ITERATIVE_PENETRATION_CHECK = 3
_MIDSIDES_TOUCH = -1
_BIAS = 0.95
_FRICTION_FORCE_TOLERANCE = 0.05
_STRESS_LIMIT = 1.0e20

# Types of body: its second line, and the two first of an interaction.
_DEFORMABLE = (1, 1, 0, 0)
_RIGID = (2, 0, 0, 0)
_COLOURS = {FINGER_BODY: (1, 230, 0, 0), PROBE_BODY: (1, 236, 236, 0)}
_POSITION_CONTROL = -1
_NO_CONTROL = 0
_NURBS = 9


def contact(layout: Layout) -> Iterator[str]:
    """Write the two bodies, how they touch, and the table that says so."""
    friction = layout.model.contact.friction
    yield from _heading(layout)
    yield option("contact", 5, 0, 0)
    yield integers(
        [
            PROBE_BODY,  # number of bodies
            0,
            layout.boundary_nodes,
            _BILINEAR_COULOMB if friction else 0,
            _BY_NODAL_FORCE if friction else 0,
            _MOST_SEPARATIONS,
            _ITERATIVE_PENETRATION_CHECK,
            *[0] * 6,
            _MIDSIDES_TOUCH if layout.element.nodes == 8 else 0,
            0,
            0,
        ]
    )
    yield integers([0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 1, 0])
    yield reals(zeros(REALS_A_LINE, f3=1.0, f6=_BIAS, f8=_FRICTION_FORCE_TOLERANCE))
    yield reals([1.0, 0.0])
    yield from _deformable(FINGER_BODY, FINGER)
    if layout.meshed:
        yield from _deformable(PROBE_BODY, PROBE)
    else:
        yield from _rigid(layout.model.lower_side_mm)
    yield from _interaction(friction, layout.meshed)
    yield from _table()


def contact_table() -> Iterator[str]:
    """Write which table of pairs holds from here on."""
    yield from comment(f"allowed contact is defined by contact table {TABLE} ({TABLE_NAME})")
    yield named("contact table")
    yield integers([0, 4])
    yield integers([TABLE])


def _heading(layout: Layout) -> Iterator[str]:
    friction = layout.model.contact.friction
    law = f"friction {friction:g} (Coulomb, bilinear)" if friction else "no friction"
    yield from comment(
        f"contact with {law}. Marc has no contact springs, so that their stiffness is not here"
    )
    yield from comment(
        "which number of the option asks for segment-to-segment contact is not "
        "known; this deck leaves what Mentat 2021.4 writes by default. The Mentat "
        "procedure beside it sets segment-to-segment and writes the deck again"
    )


def _deformable(body: int, name: str) -> Iterator[str]:
    """Its elements are those whose ``connectivity`` block names it."""
    yield from comment(f"contact body {body}: {name}")
    yield integers([body, 0, 0, 0, 0, _NO_CONTROL, 0, -1]) + name
    yield integers([*_DEFORMABLE, *_COLOURS[body]])
    yield from _placed(zeros(8), [0] * 8)
    yield ""


def _rigid(side_mm: FloatArray) -> Iterator[str]:
    """Write the lower side from left to right: a curve has its inside on its left.

    All curves of real decks that were read run so. A straight piece is a curve of
    two points, which was seen there; a curve of many points was not.
    """
    pieces = np.stack([side_mm[:-1], side_mm[1:]], axis=1).tolist()
    yield from comment(
        f"contact body {PROBE_BODY}: {PROBE}; its position is the table times "
        f"{INTO_SKIN_MM:g} mm along y"
    )
    yield integers([PROBE_BODY, len(pieces), 0, 0, 1, _POSITION_CONTROL, 0, -1]) + PROBE
    yield integers([*_RIGID, *_COLOURS[PROBE_BODY]])
    yield from _placed(zeros(8, f2=INTO_SKIN_MM), [0, WAVEFORM, *[0] * 6])
    for start_mm, end_mm in pieces:
        yield integers([_NURBS, 2, 2, 1])  # points, order, pieces it is cut into
        yield reals(start_mm)
        yield reals(end_mm)
        for number in (1.0, 1.0, 0.0, 0.0, 1.0, 1.0):  # weights, then knots
            yield real(number)


def _placed(motion: list[float], tables: list[int]) -> Iterator[str]:
    """Write the lines that all bodies have: where, and how moved by which table."""
    yield reals(zeros(7, f7=1.0))  # centre and axis of rotation
    yield reals(zeros(4))
    yield reals(motion)
    yield integers(tables)
    yield integers([0] * 4)


def _interaction(friction: float, meshed: bool) -> Iterator[str]:
    yield from comment(f"contact interaction {INTERACTION}: {INTERACTION_NAME}")
    yield option("con intera", 3)
    yield integers([INTERACTION, 0]) + INTERACTION_NAME
    yield integers(_DEFORMABLE)
    yield integers(_DEFORMABLE if meshed else _RIGID)
    yield integers([0] * INTEGERS_A_LINE)
    yield integers([0] * 11)
    # Pairs of lines: reals, and the tables that multiply them.
    for numbers in (
        zeros(8, f3=friction),
        zeros(8),
        zeros(8, f6=_STRESS_LIMIT),
        zeros(8),
        zeros(8, f3=1.0),
        zeros(8),
        zeros(8),
        zeros(8),
        zeros(1),
    ):
        yield reals(numbers)
        yield integers([0] * len(numbers))


def _table() -> Iterator[str]:
    yield from comment(f"contact table {TABLE}: {TABLE_NAME}")
    yield option("con table", 1)
    yield integers([TABLE, 1, 0]) + TABLE_NAME
    yield from comment(f"the only pair: {FINGER_BODY} ({FINGER}), {PROBE_BODY} ({PROBE})")
    yield integers([FINGER_BODY, PROBE_BODY, INTERACTION, 0, 0])
    yield integers([0] * 8)
    yield reals(zeros(8, f1=2.0))
    yield integers([0] * 8)
    yield reals(zeros(3))
    yield integers([0] * 3)
