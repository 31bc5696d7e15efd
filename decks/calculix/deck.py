"""CalculiX: an analysis as the text of an input deck.

A deck is meant to be read: a heading with units, named sets, a comment before
each part. The same analysis gives the same bytes, ASCII with LF line ends.
"""

from collections.abc import Iterator

from decks.analysis import Analysis
from decks.dialects import DIALECTS, DeckOptions
from decks.inp import model as parts
from decks.inp.lines import list_lines, real
from decks.inp.model import OUTPUT_SET
from decks.numbered import NumberedAnalysis, numbered
from fembridge.errors import DeckError

_DIALECT = DIALECTS["calculix"]
_TENSION_MPA = 0.001


def calculix_files(analysis: Analysis, options: DeckOptions) -> dict[str, str]:
    """Give the deck under its name in a run folder."""
    binary = options.results != "text"
    return {_DIALECT.deck: calculix_deck(analysis, binary=binary)}


def calculix_deck(analysis: Analysis, *, binary: bool = True) -> str:
    """Write `analysis` as a deck for ccx 2.20.

    `binary` asks for float64 results at the watched nodes; without it ccx
    writes ASCII, whose six digits add noise to a second derivative.

    Raises
    ------
    DeckError
        An element or a contact that ccx has not.
    """
    _DIALECT.element_named(analysis.element)
    model = numbered(analysis)
    blocks = (
        parts.heading(model),
        parts.finger(model),
        parts.probe(model),
        parts.sets(model),
        parts.materials(model),
        _contact(model),
        parts.waveform(model),
        _step(model, binary),
    )
    return "\n".join(line for block in blocks for line in block) + "\n"


def _contact(model: NumberedAnalysis) -> Iterator[str]:
    contact = model.analysis.contact
    if contact.formulation not in parts.CONTACT_TYPES:
        raise DeckError(
            f"ccx has no contact {contact.formulation!r} for plane elements"
        )
    by_node = contact.formulation == "node-to-surface"
    yield "**"
    yield "** ---- Contact: the skin is the slave, the probe the master"
    if by_node:
        yield "*NSET, NSET=SKIN_CONTACT"
        yield from list_lines(model.contact_node)
        yield "*SURFACE, NAME=SKIN_SURFACE, TYPE=NODE"
        yield "SKIN_CONTACT"
    else:
        yield from parts.skin_surface(model)
    yield from parts.probe_surface(model)
    yield "*SURFACE INTERACTION, NAME=TOUCH"
    yield "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR"
    yield "** stiffness in MPa/mm" + (", tension at infinity in MPa" if by_node else "")
    stiffness = real(contact.stiffness_mpa_per_mm)
    yield f"{stiffness}, {real(_TENSION_MPA)}" if by_node else stiffness
    if contact.friction > 0:
        yield "*FRICTION"
        yield "** coefficient, stick stiffness in MPa/mm"
        stick = contact.stiffness_mpa_per_mm * contact.stick_share
        yield f"{real(contact.friction)}, {real(stick)}"
    yield from parts.contact_pair(model)


def _step(model: NumberedAnalysis, binary: bool) -> Iterator[str]:
    kind, double = ("OUTPUT", ", DOUBLE") if binary else ("FILE", "")
    large = ", NLGEOM" if model.analysis.large_strain else ""
    yield from parts.fixed_step(model, large)
    yield f"*NODE {kind}, NSET={OUTPUT_SET}{double}"
    yield "U"
    yield f"*{'ELEMENT' if binary else 'EL'} {kind}, NSET={OUTPUT_SET}{double}"
    yield "S"
    yield "** force of the skin on the probe"
    yield "*NODE PRINT, NSET=PROBE, TOTALS=ONLY"
    yield "RF"
    yield "*END STEP"
