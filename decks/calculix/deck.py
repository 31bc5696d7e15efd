"""CalculiX: an analysis as the text of an input deck.

A deck is meant to be read: a heading with units, named sets, a comment before
each part. The same analysis gives the same bytes, ASCII with LF line ends.
"""

from collections.abc import Iterator

import numpy as np

from decks.analysis import Analysis
from decks.calculix.lines import (
    element_lines,
    fixed,
    list_lines,
    node_lines,
    pair_lines,
    plain,
    real,
)
from decks.finger import LAYERS, Material
from fembridge.errors import DeckError
from fembridge.typing import BoolArray, FloatArray, IntArray

# Sets whose stress and displacement the solver writes.
OUTPUT_SET = "OUTPUT_NODES"

_HEADING_WIDTH = 78
# A stiff placeholder: every node of the probe is prescribed, so that its
# elements carry no unknown; ccx still wants a material.
_PROBE_MPA = 2.1e5
_TENSION_MPA = 0.001
# Layers that are strained strongly: what `Analysis.law` is about.
_SOFT = ("stratum_corneum", "epidermis", "dermis", "subcutaneous_tissue")


def calculix_deck(analysis: Analysis, *, binary: bool = True) -> str:
    """Write `analysis` as a deck for ccx 2.20.

    `binary` asks for float64 results at the watched nodes; without it ccx
    writes ASCII, whose six digits add noise to a second derivative.
    """
    blocks = (
        _heading(analysis),
        _finger(analysis),
        _probe(analysis),
        _sets(analysis),
        _materials(analysis),
        _contact(analysis),
        _waveform(analysis),
        _step(analysis, binary),
    )
    return "\n".join(line for block in blocks for line in block) + "\n"


def _heading(analysis: Analysis) -> Iterator[str]:
    yield "*HEADING"
    yield plain(f"fembridge: {analysis.title}")[:_HEADING_WIDTH]
    yield "** Units: mm, N, s, MPa. Plane strain, 1 mm thick."
    yield "** x runs across the finger, y out of its pad; the ridge under the probe"
    yield "** has its top at the origin."
    for note in analysis.notes:
        yield f"** {plain(note)}"


def _finger(analysis: Analysis) -> Iterator[str]:
    node_mm, element = _elements(analysis)
    yield "**"
    yield "** ---- The finger: one element set a layer"
    yield "*NODE, NSET=FINGER"
    yield from node_lines(node_mm, first=1)
    for index, layer in enumerate(LAYERS):
        rows = np.flatnonzero(analysis.mesh.layer == index)
        if rows.size:
            yield f"*ELEMENT, TYPE={analysis.element}, ELSET={layer.upper()}"
            yield from element_lines((rows + 1).tolist(), element[rows] + 1)


def _probe(analysis: Analysis) -> Iterator[str]:
    first_node, first_element = _probe_start(analysis)
    yield "**"
    yield "** ---- The probe: rigid, since each of its nodes is prescribed"
    yield "*NODE, NSET=PROBE"
    yield from node_lines(analysis.probe.node_mm, first=first_node)
    yield "*ELEMENT, TYPE=CPE4, ELSET=PROBE_BODY"
    quad = analysis.probe.quad + first_node
    yield from element_lines(range(first_element, first_element + len(quad)), quad)


def _sets(analysis: Analysis) -> Iterator[str]:
    _, element = _elements(analysis)
    held = np.isin(element, analysis.held)
    if element.shape[1] == 8:  # a mid-side node is held where both its ends are
        held[:, 4:] = held[:, :4] & np.roll(held[:, :4], -1, axis=1)
        bone = analysis.mesh.in_layer("bone")
        held[~bone, 4:] &= _on_outline(analysis)[~bone]
    yield "**"
    yield "** ---- Bone and the nail's outer side do not move"
    yield "*NSET, NSET=HELD"
    yield from list_lines(np.unique(element[held]) + 1)
    yield "** ---- Where the afferents sit, and the skin under the probe"
    for name, row in analysis.afferent.items():
        x, y = analysis.mesh.node_mm[row]
        site = analysis.finger.afferents[name]
        yield f"** {name}: {site.layer}, x = {x:.4f} mm, depth = {-y:.4f} mm"
        yield f"*NSET, NSET=AFFERENT_{name.upper()}"
        yield f"{row + 1},"
    yield "*NSET, NSET=SKIN_APEX"
    yield f"{analysis.apex + 1},"
    yield f"*NSET, NSET={OUTPUT_SET}"
    yield from list_lines(np.array(watched_nodes(analysis)))


def _materials(analysis: Analysis) -> Iterator[str]:
    yield "**"
    yield "** ---- Materials: Young's modulus in MPa, Poisson's ratio"
    for index, layer in enumerate(LAYERS):
        if not (analysis.mesh.layer == index).any():
            continue
        material = analysis.finger.materials[layer]
        yield f"*MATERIAL, NAME={layer.upper()}"
        if analysis.law == "neo-hookean" and layer in _SOFT:
            yield from _neo_hookean(material)
        else:
            yield "*ELASTIC"
            yield f"{real(material.young_mpa)}, {real(material.poisson)}"
        yield f"*SOLID SECTION, ELSET={layer.upper()}, MATERIAL={layer.upper()}"
        yield "1.0"
    yield "*MATERIAL, NAME=PROBE_BODY"
    yield "*ELASTIC"
    yield f"{real(_PROBE_MPA)}, 0.3"
    yield "*SOLID SECTION, ELSET=PROBE_BODY, MATERIAL=PROBE_BODY"
    yield "1.0"


def _neo_hookean(material: Material) -> Iterator[str]:
    """``U = C10 (I1 − 3) + (J − 1)²/D1``, I1 of the strain without its volume part.

    Equal to Hooke's law for small strain: C10 = G/2, D1 = 2/K.
    """
    shear_mpa = material.young_mpa / (2 * (1 + material.poisson))
    bulk_mpa = material.young_mpa / (3 * (1 - 2 * material.poisson))
    yield (
        f"** C10 in MPa, D1 in 1/MPa: E = {material.young_mpa:g}, "
        f"nu = {material.poisson:g} at rest"
    )
    yield "*HYPERELASTIC, NEO HOOKE"
    yield f"{real(shear_mpa / 2)}, {real(2 / bulk_mpa)}"


def _contact(analysis: Analysis) -> Iterator[str]:
    contact = analysis.contact
    _, first_element = _probe_start(analysis)
    by_node = contact.formulation == "node-to-surface"
    yield "**"
    yield "** ---- Contact: the skin is the slave, the probe the master"
    if by_node:
        yield "*NSET, NSET=SKIN_CONTACT"
        yield from list_lines(_contact_nodes(analysis) + 1)
        yield "*SURFACE, NAME=SKIN_SURFACE, TYPE=NODE"
        yield "SKIN_CONTACT"
    else:
        yield "*SURFACE, NAME=SKIN_SURFACE, TYPE=ELEMENT"
        for element, face in analysis.contact_edge.tolist():
            yield f"{element + 1}, S{face + 1}"
    yield "*SURFACE, NAME=PROBE_SURFACE, TYPE=ELEMENT"
    for row in range(len(analysis.probe.quad)):
        yield f"{first_element + row}, S1"
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
    yield f"*CONTACT PAIR, INTERACTION=TOUCH, TYPE={_type(contact.formulation)}"
    yield "SKIN_SURFACE, PROBE_SURFACE"


def _waveform(analysis: Analysis) -> Iterator[str]:
    motion = analysis.motion
    yield "**"
    yield "** ---- The probe's way into the skin: time in s, depth in mm"
    if motion.ramp:
        start_s = motion.time_s[motion.ramp]
        yield f"** up to {start_s:g} s: the ramp to the pre-indentation"
    yield "*AMPLITUDE, NAME=DEPTH, TIME=TOTAL TIME"
    yield from pair_lines(
        (fixed(time_s, 7), f"{depth_mm:.9f}")
        for time_s, depth_mm in zip(
            motion.time_s.tolist(), (motion.depth_mm + 0.0).tolist(), strict=True
        )
    )


def _step(analysis: Analysis, binary: bool) -> Iterator[str]:
    motion = analysis.motion
    kind, double = ("OUTPUT", ", DOUBLE") if binary else ("FILE", "")
    large = ", NLGEOM" if analysis.large_strain else ""
    yield "**"
    yield "** ---- One step of equal increments: no inertia, no viscosity"
    yield f"*STEP{large}, INC=100000"
    yield "*STATIC, DIRECT"
    yield f"{fixed(motion.dt_s, 7)}, {fixed(motion.increments * motion.dt_s, 7)}"
    yield "*BOUNDARY"
    yield "HELD, 1, 2"
    yield "PROBE, 1, 1"
    yield "** into the skin is -y"
    yield "*BOUNDARY, AMPLITUDE=DEPTH"
    yield "PROBE, 2, 2, -1.0"
    yield f"*NODE {kind}, NSET={OUTPUT_SET}{double}"
    yield "U"
    yield f"*{'ELEMENT' if binary else 'EL'} {kind}, NSET={OUTPUT_SET}{double}"
    yield "S"
    yield "** force of the skin on the probe"
    yield "*NODE PRINT, NSET=PROBE, TOTALS=ONLY"
    yield "RF"
    yield "*END STEP"


def watched_nodes(analysis: Analysis) -> list[int]:
    """Solver's numbers of the nodes whose results are written, no node twice."""
    rows = [*analysis.afferent.values(), analysis.apex, *analysis.watched.tolist()]
    return [row + 1 for row in dict.fromkeys(rows)]


def _elements(analysis: Analysis) -> tuple[FloatArray, IntArray]:
    mesh = analysis.mesh
    if analysis.element == "CPE8R":
        return mesh.with_midsides()
    return mesh.node_mm, mesh.quad


def _probe_start(analysis: Analysis) -> tuple[int, int]:
    """Numbers of the probe's first node and first element."""
    node_mm, element = _elements(analysis)
    return len(node_mm) + 1, len(element) + 1


def _contact_nodes(analysis: Analysis) -> IntArray:
    _, element = _elements(analysis)
    owner, face = analysis.contact_edge.T
    nodes = [element[owner, face], element[owner, (face + 1) % 4]]
    if element.shape[1] == 8:
        nodes.append(element[owner, face + 4])
    return np.unique(np.concatenate(nodes))


def _on_outline(analysis: Analysis) -> BoolArray:
    """Which faces ``(E, 4)`` of the elements belong to one element alone."""
    _, owner, face = analysis.mesh.outline()
    alone = np.zeros(analysis.mesh.quad.shape, dtype=bool)
    alone[owner, face] = True
    return alone


def _type(formulation: str) -> str:
    types = {
        "node-to-surface": "NODE TO SURFACE",
        "surface-to-surface": "SURFACE TO SURFACE",
    }
    if formulation not in types:
        raise DeckError(f"ccx has no contact {formulation!r} for plane elements")
    return types[formulation]
