"""How skin and probe touch, in CalculiX's words.

Of a slave that is a set of nodes ccx gives each node the area of the face that it
touches, not its own share of the skin. So in a half of the section the node on the
axis, whose skin is left of it as well, gets a contact pair of its own, with springs
half as stiff; without it the error is 0.3 % of the stress.
"""

from collections.abc import Iterator

import numpy as np

from decks.analysis import Analysis, Contact
from decks.inp import model as parts
from decks.inp.lines import list_lines, real
from fembridge.errors import DeckError
from fembridge.typing import IntArray

_TENSION_MPA = 0.001
_AXIS_SHARE = 0.5


def contact_blocks(model: Analysis) -> Iterator[str]:
    """Give the two sides, what is between them, and the pair.

    Raises
    ------
    DeckError
        A contact that ccx has not.
    """
    contact = model.contact
    if contact.formulation not in parts.CONTACT_TYPES:
        raise DeckError(f"ccx has no contact {contact.formulation!r} for plane elements")
    by_node = contact.formulation == "node-to-surface"
    yield "**"
    yield "** ---- Contact: the skin is the slave, the probe the master"
    if by_node:
        yield from _slave("SKIN", np.setdiff1d(model.contact_node, model.axis))
    else:
        yield from parts.skin_surface(model)
    yield from parts.probe_surface(model)
    yield from _interaction("TOUCH", contact)
    yield from parts.contact_pair(model)
    if by_node and model.is_half:
        yield "** The skin on the axis: half of its springs: they are half as stiff"
        yield from _slave("AXIS", np.intersect1d(model.contact_node, model.axis))
        yield from _interaction("TOUCH_ON_AXIS", contact, _AXIS_SHARE)
        yield from parts.contact_pair(model, "AXIS_SURFACE", "TOUCH_ON_AXIS")


def _slave(name: str, nodes: IntArray) -> Iterator[str]:
    yield f"*NSET, NSET={name}_CONTACT"
    yield from list_lines(nodes)
    yield f"*SURFACE, NAME={name}_SURFACE, TYPE=NODE"
    yield f"{name}_CONTACT"


def _interaction(name: str, contact: Contact, share: float = 1.0) -> Iterator[str]:
    """Give the springs between the two sides, `share` of their stiffness."""
    by_node = contact.formulation == "node-to-surface"
    yield f"*SURFACE INTERACTION, NAME={name}"
    yield "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR"
    yield "** stiffness in MPa/mm" + (", tension at infinity in MPa" if by_node else "")
    stiffness = real(share * contact.stiffness_mpa_per_mm)
    tension = real(share * _TENSION_MPA)
    yield f"{stiffness}, {tension}" if by_node else stiffness
    if contact.friction > 0:
        yield "*FRICTION"
        yield "** coefficient, stick stiffness in MPa/mm"
        stick = contact.stiffness_mpa_per_mm * contact.stick_share * share
        yield f"{real(contact.friction)}, {real(stick)}"
