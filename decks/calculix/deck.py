"""CalculiX: an analysis as the text of an input deck.

A deck is meant to be read: a heading with units, named sets, a comment before
each part. The same analysis gives the same bytes, ASCII with LF line ends.
"""

from collections.abc import Iterator
from functools import partial

from decks.analysis import Analysis
from decks.calculix import inertia
from decks.calculix.contact import contact_blocks
from decks.calculix.drive import drive_blocks, moved, sprung
from decks.calculix.relaxation import branch_blocks, branches, lasting
from decks.dialects import DIALECTS, DeckOptions
from decks.inp import materials
from decks.inp import model as parts
from decks.inp.lines import list_lines
from decks.inp.model import OUTPUT_SET
from decks.inp.steps import steps, waveform

_DIALECT = DIALECTS["calculix"]
_RIGID = "all of its nodes are tied to one"
# Fixed increments make nothing of CETOL, a bound of creep; ccx wants it all the same.
_CARDS = {
    "static": "*STATIC, DIRECT",
    "viscous": "*VISCO, DIRECT, CETOL=1.0E6",
    "dynamic": inertia.CARD,
}


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
    model = analysis
    moves = inertia.moved(model) if analysis.inertia else moved(model)
    blocks = (
        _heading(model),
        parts.finger(model),
        parts.probe(model, _RIGID if sprung(model) else parts.PRESCRIBED),
        parts.sets(model),
        _axis(model),
        _materials(model),
        contact_blocks(model),
        _drive(model),
        waveform(model),
        steps(model, _CARDS, _large_strain(model), partial(_output, binary), moves),
    )
    return "\n".join(line for block in blocks for line in block) + "\n"


def _materials(model: Analysis) -> Iterator[str]:
    yield from materials.heading()
    has_mass, thickness_mm = model.inertia, model.thickness_mm
    for section in (*map(lasting, model.layers), model.probe):
        yield from materials.material(section, inertia=has_mass, thickness_mm=thickness_mm)
    first = int(model.probe.number.max()) + 1
    found = branches(model.layers, first, model.motion.phases[-1].dt_s)
    yield from branch_blocks(found, model.element, inertia=has_mass, thickness_mm=thickness_mm)


def _drive(model: Analysis) -> Iterator[str]:
    """Give what the probe hangs on, or what lets dynamics with contact through."""
    return inertia.store(model) if model.inertia else drive_blocks(model)


def _heading(model: Analysis) -> Iterator[str]:
    """Say what is in the deck, and of a half what is not."""
    yield from parts.heading(model)
    if model.is_half:
        yield "**"
        yield "** Of this section the right half alone, x >= 0: finger, probe and"
        yield "** motion are mirror images about x = 0. Numbers are those of the whole;"
        yield "** those of the left half do not occur. The half is 2 mm thick, for both"
        yield "** halves of 1 mm: forces are those of the whole."


def _axis(model: Analysis) -> Iterator[str]:
    """Name the nodes on the axis of a half."""
    if model.is_half:
        yield "** ---- On the axis of the half nothing moves aside, and shear is 0; the"
        yield "** SXY that is written there is a mean over one half, not over both"
        yield "*NSET, NSET=AXIS"
        yield from list_lines(model.axis)


def _large_strain(model: Analysis) -> str:
    return ", NLGEOM" if model.large_strain else ""


def _output(binary: bool, model: Analysis) -> Iterator[str]:
    kind, double = ("OUTPUT", ", DOUBLE") if binary else ("FILE", "")
    every = model.motion.phases[-1].every
    often = f", FREQUENCY={every}" if every > 1 else ""
    double += often
    yield f"*NODE {kind}, NSET={OUTPUT_SET}{double}"
    yield "U"
    yield f"*{'ELEMENT' if binary else 'EL'} {kind}, NSET={OUTPUT_SET}{double}"
    yield "S"
    if model.inertia:
        yield from inertia.energies(every)
    yield "** force of the skin on the probe"
    yield f"*NODE PRINT, NSET=PROBE, TOTALS=ONLY{often}"
    yield "RF"
