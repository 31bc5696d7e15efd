"""What our decks for CalculiX and Abaqus have in common: lines, model, materials, steps.

How the bodies touch and the output are each solver's own. A deck is meant to be read: a
heading with units, named sets, a comment before each part.

ccx cuts a number at 20 characters without a word and takes at most 16 entries a line, of
an amplitude four pairs.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from decks.analysis import Analysis, ElementSet
from fembridge.typing import FloatArray, IntArray

LONGEST_NUMBER = 20
_PER_LINE = 12
_PAIRS_PER_LINE = 4
_HEADING_WIDTH = 78
_T_PER_MM3 = 1.0e-12  # in one kg/m3

# The set whose stress and displacement the solver writes.
OUTPUT_SET = "OUTPUT_NODES"
# Our name of a contact formulation, and the keyword's.
CONTACT_TYPES = {"node-to-surface": "NODE TO SURFACE", "surface-to-surface": "SURFACE TO SURFACE"}
# Why the probe is rigid, unless a solver has another way to make it so.
PRESCRIBED = "each of its nodes is prescribed"
_PROCEDURES = {
    "static": "no inertia, no viscosity",
    "viscous": "the skin relaxes, no inertia",
    "dynamic": "inertia counts",
}


# ---- Lines


def real(number: float) -> str:
    """The shortest text of a number, or 13 digits where that is too long."""
    text = repr(float(number))
    return text if len(text) <= LONGEST_NUMBER else f"{float(number):.12E}"


def fixed(number: float, digits: int) -> str:
    """A number with `digits` decimals; where they are too few for it, `real`."""
    text = f"{number:.{digits}f}"
    exact = abs(float(text) - number) <= 1e-12 * abs(number)
    return text if exact and len(text) <= LONGEST_NUMBER else real(number)


def node_lines(numbers: Iterable[int], node_mm: FloatArray) -> Iterator[str]:
    """Nodes in the plane by their `numbers`."""
    for number, (x, y) in zip(numbers, (node_mm + 0.0).tolist(), strict=True):
        yield f"{number}, {x:.9f}, {y:.9f}, 0.0"


def element_lines(numbers: Iterable[int], nodes: IntArray) -> Iterator[str]:
    """Elements by their `numbers`; `nodes` ``(E, n)`` are numbers as well."""
    for number, row in zip(numbers, nodes.tolist(), strict=True):
        yield f"{number}, {', '.join(map(str, row))}"


def list_lines(numbers: Sequence[int] | IntArray) -> Iterator[str]:
    """Whole numbers, as a set lists them."""
    flat = np.asarray(numbers).tolist()
    for start in range(0, len(flat), _PER_LINE):
        yield ", ".join(map(str, flat[start : start + _PER_LINE])) + ","


def pair_lines(pairs: Iterable[tuple[str, str]]) -> Iterator[str]:
    """Times and values, as an amplitude lists them."""
    flat = list(chain.from_iterable(pairs))
    for start in range(0, len(flat), 2 * _PAIRS_PER_LINE):
        yield ", ".join(flat[start : start + 2 * _PAIRS_PER_LINE])


# ---- The model


def model_lines(
    model: Analysis, remarks: Sequence[str] = (), why_rigid: str = PRESCRIBED
) -> Iterator[str]:
    """Heading with `remarks`, finger, probe, and sets: fixed, afferents' and output nodes."""
    title, *notes = (
        text.encode("unicode_escape").decode("ascii")  # on one line, whatever was in it
        for text in (f"fembridge: {model.title}", *model.notes, f"contact: {model.contact}")
    )
    yield "*HEADING"
    yield title[:_HEADING_WIDTH]
    yield f"** Units: mm, N, s, MPa. Plane strain, {model.thickness_mm:g} mm thick."
    yield "** x runs across the finger, y out of its pad; the ridge under the probe"
    yield "** has its top at the origin."
    yield from (f"** {note}" for note in notes)
    yield from remarks
    yield "**"
    yield "** ---- The finger: one element set a layer"
    yield "*NODE, NSET=FINGER"
    yield from node_lines(model.node.tolist(), model.node_mm[model.node - 1])
    for layer in model.layers:
        yield f"*ELEMENT, TYPE={model.element}, ELSET={layer.name.upper()}"
        yield from element_lines(layer.number.tolist(), layer.node)
    yield "**"
    yield f"** ---- The probe: rigid, since {why_rigid}"
    yield "*NODE, NSET=PROBE"
    node = np.unique(model.probe.node)
    yield from node_lines(node.tolist(), model.probe_mesh.node_mm[node - model.first_probe_node])
    yield "*ELEMENT, TYPE=CPE4, ELSET=PROBE_BODY"
    yield from element_lines(model.probe.number.tolist(), model.probe.node)
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


def contact_lines(
    model: Analysis, interaction: Iterable[str], slave: Iterable[str] = ()
) -> Iterator[str]:
    """Both sides, what is between them, and the pair; `slave` is the skin's, if not faces."""
    yield "**"
    yield "** ---- Contact: the skin is the slave, the probe the master"
    yield from slave
    if not slave:
        yield "*SURFACE, NAME=SKIN_SURFACE, TYPE=ELEMENT"
        yield from (f"{element}, S{face}" for element, face in model.contact_face.tolist())
    yield "*SURFACE, NAME=PROBE_SURFACE, TYPE=ELEMENT"
    yield from (f"{number}, S1" for number in model.probe.number.tolist())  # its lower side
    yield from interaction
    kind = CONTACT_TYPES[model.contact.formulation]
    yield f"*CONTACT PAIR, INTERACTION=TOUCH, TYPE={kind}"
    yield "SKIN_SURFACE, PROBE_SURFACE"


# ---- Materials


MATERIALS_HEADING = ("**", "** ---- Materials: Young's modulus in MPa, Poisson's ratio")


def material(
    section: ElementSet,
    *,
    inertia: bool,
    moduli: str = "",
    relaxation: Iterable[str] = (),
    thickness_mm: float = 1.0,
) -> Iterator[str]:
    """The material of `section`, and the section, `thickness_mm` thick.

    `moduli` is the solver's option for the elastic moduli, with its comma; `relaxation`
    are its lines on how the material relaxes. Neo-Hookean is
    ``U = C10 (I1 − 3) + (J − 1)²/D1``, I1 of the strain without its volume part; equal
    to Hooke's law for small strain: C10 = G/2, D1 = 2/K.
    """
    name, values = section.name.upper(), section.material
    yield f"*MATERIAL, NAME={name}"
    if inertia:
        yield "*DENSITY"
        yield f"{values.density_kg_m3 * _T_PER_MM3:.9E}"
    young, poisson = values.young_mpa, values.poisson
    if section.law == "neo-hookean":
        yield f"** C10 in MPa, D1 in 1/MPa: E = {young:g}, nu = {poisson:g} at rest"
        yield f"*HYPERELASTIC, NEO HOOKE{moduli}"
        yield f"{real(values.shear_mpa / 2)}, {real(2 / values.bulk_mpa)}"
    else:
        yield f"*ELASTIC{moduli}"
        yield f"{real(young)}, {real(poisson)}"
    yield from relaxation
    yield f"*SOLID SECTION, ELSET={name}, MATERIAL={name}"
    yield f"{thickness_mm}"


# ---- Waveform and steps: stress that depends on depth alone takes one static step. Where
# it depends on time, what leads up to the waveform is a step, or two, of its own.


@dataclass(frozen=True, slots=True)
class Moved:
    """The set that the waveform moves, and what else is said in each step."""

    name: str = "PROBE"
    controls: tuple[str, ...] = ()
    fixed: tuple[str, ...] = ()
    loads: tuple[str, ...] = ()


def steps(
    model: Analysis,
    cards: Mapping[str, str],
    large_strain: str,
    output: Callable[[bool], Iterator[str]],
    moved: Moved,
    frames: int = 0,
) -> Iterator[str]:
    """The probe's way over total time, and each phase of it as a step.

    All steps have the same conditions. `output` is what each writes, of all nodes or not;
    with `frames` every so many samples are a step of their own that writes all. `cards`
    are the solver's words for `decks.motion.PROCEDURES`, `large_strain` its word for that,
    with its comma, or "".
    """
    motion, phases = model.motion, model.motion.phases
    yield "**"
    yield "** ---- The probe's way into the skin: time in s, depth in mm"
    if motion.ramp:
        words = "the ramp to" if len(phases) == 1 else "the way to"
        yield f"** up to {motion.start_s:g} s: {words} the pre-indentation"
    for name, way_mm in (("DEPTH", motion.depth_mm), ("ASIDE", motion.aside_mm)):
        if way_mm is None:
            continue
        if name == "ASIDE":
            yield "** ---- and its way across the finger, along x, in mm"
        yield f"*AMPLITUDE, NAME={name}, TIME=TOTAL TIME"
        pairs = zip(motion.time_s.tolist(), (way_mm + 0.0).tolist(), strict=True)
        yield from pair_lines((fixed(at_s, 7), f"{mm:.9f}") for at_s, mm in pairs)
    parts = [(phase, frames == 1) for phase in phases]
    if frames > 1:
        waveform = phases[-1]
        between = replace(waveform, increments=(frames - 1) * waveform.every)
        whole = replace(waveform, increments=waveform.every)
        count, rest = divmod(waveform.increments, frames * waveform.every)
        parts[-1:] = [(between, False), (whole, True)] * count
        if rest:
            parts.append((replace(waveform, increments=rest), False))
    for count, (phase, all_nodes) in enumerate(parts, start=1):
        which = "One step" if len(parts) == 1 else f"Step {count}"
        yield "**"
        yield f"** ---- {which} of equal increments: {_PROCEDURES[phase.procedure]}"
        yield f"*STEP{large_strain}, INC=100000"
        yield cards[phase.procedure]
        yield f"{fixed(phase.dt_s, 7)}, {fixed(phase.length_s, 7)}"
        yield from moved.controls
        yield "*BOUNDARY"
        yield "HELD, 1, 2"
        yield from moved.fixed
        if motion.aside_mm is None:
            yield f"{moved.name}, 1, 1"
        else:
            yield "*BOUNDARY, AMPLITUDE=ASIDE"
            yield f"{moved.name}, 1, 1, 1.0"
        yield "** into the skin is -y"
        yield "*BOUNDARY, AMPLITUDE=DEPTH"
        yield f"{moved.name}, 2, 2, -1.0"
        yield from moved.loads
        yield from output(all_nodes)
        yield "*END STEP"
