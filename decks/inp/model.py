"""The parts of a keyword deck on which CalculiX and Abaqus agree.

Nodes, elements, sets. Materials and steps stand in the modules beside; how the bodies
touch and the output are each solver's own.
"""

from collections.abc import Iterator

from decks.analysis import Analysis
from decks.inp.lines import element_lines, list_lines, numbered_node_lines, plain

# The set whose stress and displacement the solver writes.
OUTPUT_SET = "OUTPUT_NODES"
# Our name of a contact formulation, and the keyword's.
CONTACT_TYPES = {"node-to-surface": "NODE TO SURFACE", "surface-to-surface": "SURFACE TO SURFACE"}

# Why the probe is rigid, unless a solver has another way to make it so.
PRESCRIBED = "each of its nodes is prescribed"

_HEADING_WIDTH = 78


def heading(model: Analysis) -> Iterator[str]:
    """Title, units and axes."""
    yield "*HEADING"
    yield plain(f"fembridge: {model.title}")[:_HEADING_WIDTH]
    thick = f"{model.thickness_mm:g} mm thick"
    yield f"** Units: mm, N, s, MPa. Plane strain, {thick}."
    yield "** x runs across the finger, y out of its pad; the ridge under the probe"
    yield "** has its top at the origin."
    for note in (*model.notes, f"contact: {model.contact}"):
        yield f"** {plain(note)}"


def finger(model: Analysis) -> Iterator[str]:
    """Nodes, and an element set a layer."""
    yield "**"
    yield "** ---- The finger: one element set a layer"
    yield "*NODE, NSET=FINGER"
    node = model.node
    yield from numbered_node_lines(node.tolist(), model.node_mm[node - 1])
    for layer in model.layers:
        yield f"*ELEMENT, TYPE={model.element}, ELSET={layer.name.upper()}"
        yield from element_lines(layer.number.tolist(), layer.node)


def probe(model: Analysis, why_rigid: str = PRESCRIBED) -> Iterator[str]:
    """Give the probe's nodes and elements."""
    yield "**"
    yield f"** ---- The probe: rigid, since {why_rigid}"
    yield "*NODE, NSET=PROBE"
    node = model.probe_node
    rows = node - model.first_probe_node
    yield from numbered_node_lines(node.tolist(), model.probe_node_mm[rows])
    yield "*ELEMENT, TYPE=CPE4, ELSET=PROBE_BODY"
    yield from element_lines(model.probe.number.tolist(), model.probe.node)


def sets(model: Analysis) -> Iterator[str]:
    """Who is held, where the afferents sit, whose results are written."""
    yield "**"
    yield "** ---- Bone and the nail's outer side do not move"
    yield "*NSET, NSET=HELD"
    yield from list_lines(model.fixed)
    yield "** ---- Where the afferents sit, and the skin under the probe"
    for name, words in model.sites.items():
        yield f"** {name}: {words}"
        yield f"*NSET, NSET=AFFERENT_{name.upper()}"
        yield f"{model.afferent[name]},"
    yield "*NSET, NSET=SKIN_APEX"
    yield f"{model.apex},"
    yield f"*NSET, NSET={OUTPUT_SET}"
    yield from list_lines(model.watched)


def probe_surface(model: Analysis) -> Iterator[str]:
    """Face 1 of each of the probe's elements is its lower side."""
    yield "*SURFACE, NAME=PROBE_SURFACE, TYPE=ELEMENT"
    for number in model.probe.number.tolist():
        yield f"{number}, S1"


def skin_surface(model: Analysis) -> Iterator[str]:
    """Give the faces of the skin that the probe can reach."""
    yield "*SURFACE, NAME=SKIN_SURFACE, TYPE=ELEMENT"
    for element, face in model.contact_face.tolist():
        yield f"{element}, S{face}"


def contact_pair(
    model: Analysis, slave: str = "SKIN_SURFACE", interaction: str = "TOUCH"
) -> Iterator[str]:
    """Name the two sides: the skin is the slave, the probe the master."""
    kind = CONTACT_TYPES[model.contact.formulation]
    yield f"*CONTACT PAIR, INTERACTION={interaction}, TYPE={kind}"
    yield f"{slave}, PROBE_SURFACE"
