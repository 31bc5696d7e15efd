"""The parts of a keyword deck on which CalculiX and Abaqus agree.

Nodes, elements, sets, materials, the waveform. How the bodies touch, the step and
the output are each solver's own.
"""

from collections.abc import Iterator

from decks.finger import Material
from decks.inp.lines import (
    element_lines,
    fixed,
    list_lines,
    node_lines,
    pair_lines,
    plain,
    real,
)
from decks.numbered import NumberedAnalysis, Section

# The set whose stress and displacement the solver writes.
OUTPUT_SET = "OUTPUT_NODES"
# Our name of a contact formulation, and the keyword's.
CONTACT_TYPES = {
    "node-to-surface": "NODE TO SURFACE",
    "surface-to-surface": "SURFACE TO SURFACE",
}

_HEADING_WIDTH = 78


def heading(model: NumberedAnalysis) -> Iterator[str]:
    """Title, units and axes."""
    yield "*HEADING"
    yield plain(f"fembridge: {model.analysis.title}")[:_HEADING_WIDTH]
    yield "** Units: mm, N, s, MPa. Plane strain, 1 mm thick."
    yield "** x runs across the finger, y out of its pad; the ridge under the probe"
    yield "** has its top at the origin."
    for note in (*model.analysis.notes, f"contact: {model.analysis.contact}"):
        yield f"** {plain(note)}"


def finger(model: NumberedAnalysis) -> Iterator[str]:
    """Nodes, and an element set a layer."""
    yield "**"
    yield "** ---- The finger: one element set a layer"
    yield "*NODE, NSET=FINGER"
    yield from node_lines(model.node_mm, first=1)
    for layer in model.layers:
        yield f"*ELEMENT, TYPE={model.analysis.element}, ELSET={layer.name.upper()}"
        yield from element_lines(layer.number.tolist(), layer.node)


def probe(model: NumberedAnalysis) -> Iterator[str]:
    """Give the probe's nodes and elements."""
    yield "**"
    yield "** ---- The probe: rigid, since each of its nodes is prescribed"
    yield "*NODE, NSET=PROBE"
    yield from node_lines(model.probe_node_mm, first=model.first_probe_node)
    yield "*ELEMENT, TYPE=CPE4, ELSET=PROBE_BODY"
    yield from element_lines(model.probe.number.tolist(), model.probe.node)


def sets(model: NumberedAnalysis) -> Iterator[str]:
    """Who is held, where the afferents sit, whose results are written."""
    yield "**"
    yield "** ---- Bone and the nail's outer side do not move"
    yield "*NSET, NSET=HELD"
    yield from list_lines(model.held)
    yield "** ---- Where the afferents sit, and the skin under the probe"
    for name, words in model.sites.items():
        yield f"** {name}: {words}"
        yield f"*NSET, NSET=AFFERENT_{name.upper()}"
        yield f"{model.afferent[name]},"
    yield "*NSET, NSET=SKIN_APEX"
    yield f"{model.apex},"
    yield f"*NSET, NSET={OUTPUT_SET}"
    yield from list_lines(model.watched)


def materials(model: NumberedAnalysis) -> Iterator[str]:
    """Materials of the layers and of the probe, with their sections."""
    yield "**"
    yield "** ---- Materials: Young's modulus in MPa, Poisson's ratio"
    for section in (*model.layers, model.probe):
        yield from _material(section)


def _material(section: Section) -> Iterator[str]:
    name, material = section.name.upper(), section.material
    yield f"*MATERIAL, NAME={name}"
    if section.law == "neo-hookean":
        yield from _neo_hookean(material)
    else:
        yield "*ELASTIC"
        yield f"{real(material.young_mpa)}, {real(material.poisson)}"
    yield f"*SOLID SECTION, ELSET={name}, MATERIAL={name}"
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


def probe_surface(model: NumberedAnalysis) -> Iterator[str]:
    """Face 1 of each of the probe's elements is its lower side."""
    yield "*SURFACE, NAME=PROBE_SURFACE, TYPE=ELEMENT"
    for number in model.probe.number.tolist():
        yield f"{number}, S1"


def skin_surface(model: NumberedAnalysis) -> Iterator[str]:
    """Give the faces of the skin that the probe can reach."""
    yield "*SURFACE, NAME=SKIN_SURFACE, TYPE=ELEMENT"
    for element, face in model.contact_face.tolist():
        yield f"{element}, S{face}"


def waveform(model: NumberedAnalysis) -> Iterator[str]:
    """Give the probe's way as an amplitude over total time."""
    motion = model.analysis.motion
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


def contact_pair(model: NumberedAnalysis) -> Iterator[str]:
    """Name the two sides: the skin is the slave, the probe the master."""
    kind = CONTACT_TYPES[model.analysis.contact.formulation]
    yield f"*CONTACT PAIR, INTERACTION=TOUCH, TYPE={kind}"
    yield "SKIN_SURFACE, PROBE_SURFACE"


def fixed_step(model: NumberedAnalysis, large_strain: str) -> Iterator[str]:
    """Begin the step: equal increments, who is held, how the probe moves.

    `large_strain` is the solver's word for it, with its comma, or "".
    """
    motion = model.analysis.motion
    end_s = motion.increments * motion.dt_s
    yield "**"
    yield "** ---- One step of equal increments: no inertia, no viscosity"
    yield f"*STEP{large_strain}, INC=100000"
    yield "*STATIC, DIRECT"
    yield f"{fixed(motion.dt_s, 7)}, {fixed(end_s, 7)}"
    yield "*BOUNDARY"
    yield "HELD, 1, 2"
    yield "PROBE, 1, 1"
    yield "** into the skin is -y"
    yield "*BOUNDARY, AMPLITUDE=DEPTH"
    yield "PROBE, 2, 2, -1.0"
