"""Marc: an analysis as the text of an input deck.

Input version 15, as Mentat 2020 to 2023 write it, field by field as in real decks; the
numbers that no one here chose are Mentat's. The composition was never run in Marc. The
same analysis gives the same bytes, ASCII with LF line ends.
"""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from decks.analysis import Analysis, ElementSet
from decks.dialects import DIALECTS, JOB, REWRITTEN, DeckOptions
from decks.marc.contents import (
    COULOMB_BILINEAR,
    DEFORMABLE,
    FIXED,
    FIXED_DISPLACEMENT,
    NODES,
    POINTS,
    POSITION,
    POST_KINDS,
    RIGID,
    STRESS,
    TIME,
    VELOCITY,
    VON_MISES,
    post_lines,
)
from decks.marc.grammar import Layout, format_real, integers_line, keyword_line, reals_line
from fembridge.errors import DeckError
from fembridge.typing import FloatArray, IntArray

DECK = DIALECTS["marc"].deck
PROCEDURE = f"{JOB}.proc"
# Mentat names the job that it makes of a deck by the deck's title.
TITLE = "job1"

# Numbers of elements are those of `DIALECTS`. Four and eight nodes are as in the decks
# of DAMASK (11, 27, 54) and PFLigthart (118). Type 80 was in no deck that could be read:
# its one pressure node an element is that of 118, its reduced form; its four points are
# those of 11. The node count of the paper's model, 36 346 of 17 815 elements, is that of
# 80 or 118. The pressure nodes of the Herrmann formulation have no place.
_WITH_PRESSURE = (80, 118)
# Four-node elements are too stiff where Poisson's ratio is near 0.5, as the dermis' 0.48,
# unless the change of volume is the same in the whole element.
_PLAIN_QUAD = 11

# Contact bodies: deformable ones come first, and in a pair of two of these the first
# one's nodes are held off the second one's edges.
_FINGER, _PROBE = 1, 2
_COLOURS = {_FINGER: (1, 230, 0, 0), _PROBE: (1, 236, 236, 0)}
_KINDS = {DEFORMABLE: (DEFORMABLE, 1, 0, 0), RIGID: (RIGID, 0, 0, 0)}

WAVEFORM = "waveform"
_WAVEFORM_TABLE = 1
# A table's value multiplies the number that names it: the table holds the depth in mm,
# this is the number. y points out of the pad.
_INTO_SKIN_MM = -1.0
_PRESS = "press"
_GEOMETRY = 1
_TOLERANCE = 1.0e-3
"""Of the force left over, relative to the largest reaction, and of the last correction,
relative to the increment's displacement."""

# Under the updated Lagrange formulation, which Marc's listing names for decks of this
# kind with large strain, code 311 is Cauchy stress. There is no nodal von Mises stress.
_ELEMENT_CODES = (STRESS, VON_MISES)
_NODAL_CODES = (1, 5, 35, 38)  # displacement, reaction, contact normal force and status

# What Mentat writes for every job; Marc's listing names most numbers: predictor,
# penalties, dynamic operators, sharp angles, physical constants, limits. It leaves out
# the one that is -2 before the first load case and -1 in each.
_BEFORE, _WITHIN = -2.0, -1.0
_MEGABYTES = 25
# Chosen by Mentat's "large strain": procedures by kind of material, among them updated
# Lagrange with additive decomposition.
_LARGE_STRAIN = (4, 213, 123, 130, 230, 123, 1, 0)
_PARAMETERS = (
    (1.0, 1.0e9, 1.0e2, 1.0e6, 0.25, 0.5, 1.5, -0.5),
    (8.625, 20.0, 1.0e-4, 1.0e-6, 1.0, 1.0e-4),
    (8.314, 273.15, 0.5, 0.0, 5.67051e-8, 1.438769e-2, 2.9979e8, 1.0e30),
    (0.0, 0.0, 100.0, 0.0, 1.0, None, 1.0e6, 3.0),
    (0.0, 0.0, 1.256637061e-6, 8.854187817e-12, 120.0, 1.0e-3, 160.0, 0.0),
    (3.0, 0.4),
)

_RULE = "$..................."
_COMMENT_TEXT = 74  # characters
_LIST_ITEMS = 13  # a line of 12 columns each, as Mentat writes sets

_Lines = Iterable[str]


def marc_files(analysis: Analysis, options: DeckOptions) -> dict[str, str]:
    """Deck and Mentat procedure by their names in a run folder.

    Raises
    ------
    DeckError
        A law that a Marc deck of ours cannot express.
    """
    results = options.results or "both"
    friction = analysis.contact.friction > 0
    return {
        DECK: marc_deck(analysis.whole(), probe=options.probe or "rigid", results=results),
        PROCEDURE: mentat_procedure(results=results, friction=friction),
    }


def marc_deck(model: Analysis, *, probe: str = "rigid", results: str = "both") -> str:
    """`model` as a deck for Marc.

    Parameters
    ----------
    model
        What is computed; all of the section.
    probe
        "rigid": a curve that a table moves; "meshed": elements of a second contact body
        whose nodes a table moves.
    results
        "binary" for ``job.t16``, "text" for ``job.t19``, or "both".

    Raises
    ------
    DeckError
        A law that it cannot express.
    """
    return "\n".join(_Writer(model, probe == "meshed", results).deck()) + "\n"


def time_table(name: str, time_s: FloatArray, value: FloatArray) -> Iterator[str]:
    """Table 1, of time alone: a line a sample; both arrays are ``(T,)``."""
    extrapolate, unused = 2, (0, 0, 2)
    yield keyword_line("table", name)
    yield integers_line([_WAVEFORM_TABLE, 1, 0, 0, POINTS])
    yield integers_line([TIME, len(time_s), extrapolate, *unused * 3, *[0] * 4])
    for sample in zip(time_s.tolist(), value.tolist(), strict=True):
        yield reals_line(sample)


class _Writer:
    """The options of a deck of `model`, in their order.

    Elements keep the numbers of the model. A rigid probe has no mesh: its nodes and
    elements are left out. Pressure nodes come after all nodes that have a place: that of
    element n is `mesh_nodes` + n.
    """

    def __init__(self, model: Analysis, meshed: bool, results: str) -> None:
        self.model, self.meshed, self.results = model, meshed, results
        self.element = int(DIALECTS["marc"].elements[model.element])
        # A section, its type of element, its contact body; materials count from 1.
        self.parts = [(layer, self.element, _FINGER) for layer in model.layers]
        if meshed:
            # The probe's quads have no mid-sides.
            quad = self.element if not self.quadratic else _PLAIN_QUAD
            self.parts.append((model.probe, quad, _PROBE))
        self.mesh_nodes = len(model.node_mm) + (len(model.probe_mesh.node_mm) if meshed else 0)
        for section, _, _ in self.parts:
            if section.law != "linear":
                raise DeckError(
                    f"{section.name} is {section.law}: a Marc deck of it cannot be written "
                    "with certainty, since no deck with that material and a known meaning "
                    "of its numbers was at hand; expected linear"
                )

    @property
    def quadratic(self) -> bool:
        """Whether the finger's elements have mid-side nodes."""
        return NODES[self.element] == 8

    def deck(self) -> Iterator[str]:
        """All lines."""
        yield from self.parameters()
        yield from self.model_definition()
        yield _RULE
        yield from self.history()
        yield _RULE

    def parameters(self) -> Iterator[str]:
        """Up to ``end``."""
        analysis = self.model
        yield keyword_line("title", TITLE)
        yield from _comment(f"fembridge: {analysis.title}")
        yield from _comment("units: mm, N, s, MPa; plane strain, 1 mm thick")
        yield from _comment(
            "x runs across the finger, y out of its pad; the ridge under the probe has "
            "its top at the origin"
        )
        for note in analysis.notes:
            yield from _comment(note)
        yield from _comment(
            "written option by option after decks of Marc Mentat 2020 to 2023; this deck "
            "was not run in Marc"
        )
        yield from _comment("input file using extended precision")
        elements = sum(len(section.number) for section, _, _ in self.parts)
        pressures = sum(len(s.number) for s, kind, _ in self.parts if kind in _WITH_PRESSURE)
        yield keyword_line("extended")
        sizes = integers_line([0, elements, self.mesh_nodes + pressures, 0])
        yield f"{'sizing':<30}{sizes}"
        yield keyword_line("alloc", _MEGABYTES)
        for number in dict.fromkeys(kind for _, kind, _ in self.parts):
            yield keyword_line("elements", number)
        yield keyword_line("version", 15, 2, 0, 0)
        yield keyword_line("table", 0, 0, 2, 1, 1, 0, 0, 1)
        yield keyword_line("processor", 1, 1, 1, 0)
        yield "$no list"
        if analysis.large_strain:
            yield keyword_line("large stra", *_LARGE_STRAIN)
        yield keyword_line("all points")
        yield keyword_line("no echo", 1, 2, 3, 4)
        yield keyword_line("end")
        yield _RULE

    def model_definition(self) -> Iterator[str]:
        """From the solver to ``end option``."""
        multifrontal, nested_dissection = 8, 11
        yield from _option("solver", [multifrontal, *[0] * 15])
        yield keyword_line("optimize", nested_dissection)
        yield from self.mesh()
        yield from self.sets()
        yield from self.materials()
        yield from self.waveform()
        yield from self.geometry()
        yield from self.conditions()
        # Mentat repeats the job's name as that of the load case before the first increment.
        yield from self.active(TITLE)
        yield from self.contact()
        yield from _contact_table()
        yield keyword_line("no print")
        yield from self.post()
        yield from _job_parameters(_BEFORE)
        yield keyword_line("end option")

    def mesh(self) -> Iterator[str]:
        """Elements, a block a layer, and nodes.

        Since input version 14 an element's geometry, material and contact body are in
        the header of its ``connectivity`` block.
        """
        print_it, coordinates = 1, 3
        for material, (section, kind, body) in enumerate(self.parts, start=1):
            node = section.node
            pressure = kind in _WITH_PRESSURE
            if pressure:
                node = np.column_stack([node, self.mesh_nodes + section.number])
            words = ", the last node of each its pressure" * pressure
            yield from _comment(f"elements of {section.name}{words}")
            header = [0, 0, print_it, 0, _GEOMETRY, material, 0, body, 0]
            yield from _option("connectivity", header)
            yield from _element_lines(section, kind, node)
        if any(kind in _WITH_PRESSURE for _, kind, _ in self.parts):
            first = self.mesh_nodes + 1
            yield from _comment(f"nodes from {first} on hold a pressure and have no place")
        yield from _option("coordinates", [coordinates, self.mesh_nodes, 0, 1])
        yield from _node_lines(self.model.node_mm, 1)
        if self.meshed:
            yield from _node_lines(self.model.probe_mesh.node_mm, self.model.first_probe_node)

    def sets(self) -> Iterator[str]:
        """A set a layer, of what does not move, of each afferent and of the apex."""
        model = self.model
        for section, _, _ in self.parts:
            yield from _set("element", section.name, section.number)
        yield from _comment("bone and the nail's outer side, which do not move")
        yield from _set("node", "held_nodes", model.fixed)
        if self.meshed:
            first = model.first_probe_node
            numbers = np.arange(first, first + len(model.probe_mesh.node_mm))
            yield from _set("node", "probe_nodes", numbers)
        for name, words in model.sites.items():
            yield from _comment(f"{name}: {words}")
            yield from _set("node", f"afferent_{name.lower()}", [model.afferent[name]])
        yield from _comment("the skin's node that the probe touches first")
        yield from _set("node", "skin_apex", [model.apex])

    def materials(self) -> Iterator[str]:
        """Young's modulus in MPa and Poisson's ratio, one option a part.

        Real decks that could be read hold one material each; each option is theirs.
        """
        yield from _comment(
            "materials: Young's modulus in MPa, Poisson's ratio; the density is 0, since "
            "nothing here has inertia"
        )
        for number, (section, _, _) in enumerate(self.parts, start=1):
            material = section.material
            law = f"{number:10d}{'elastic':<40}{integers_line([10, 0, 0, 0])}{section.name}"
            numbers = [material.young_mpa, material.poisson, *[0.0] * 6]
            yield keyword_line("isotropic", "structural")
            yield from _rows([0, 0, 0, 2], law, numbers, [0] * 8, [0.0], [0], "")

    def waveform(self) -> Iterator[str]:
        """The table of depths, a line a sample."""
        motion = self.model.motion
        yield from _comment(
            "the probe's way into the skin: time in s, depth in mm from first touch"
        )
        if motion.ramp:
            start_s = motion.time_s[motion.ramp]
            yield from _comment(f"up to {start_s:g} s: the ramp to the pre-indentation")
        yield from time_table(WAVEFORM, motion.time_s, motion.depth_mm)

    def geometry(self) -> Iterator[str]:
        """Plane strain and a thickness, of all elements."""
        plane_strain, thickness_mm = 2, 1.0
        dilatation = float(self.element == _PLAIN_QUAD)
        if dilatation:
            yield from _comment("the second parameter asks for constant dilatation")
        kind = [_GEOMETRY, plane_strain, *_COLOURS[_FINGER]]
        numbers = [thickness_mm, dilatation, *[0.0] * 5]
        yield from _option("geometry", [0, 0, 2], kind, "plane_strain", numbers, "")

    def conditions(self) -> Iterator[str]:
        """What does not move and, of a meshed probe, how all its nodes move."""
        relative, node_set = 1, 2
        conditions = [("held", 0.0, 0, "held_nodes")]
        if self.meshed:
            conditions.append(("probe_motion", _INTO_SKIN_MM, _WAVEFORM_TABLE, "probe_nodes"))
            yield from _comment(
                "every node of the probe is moved: it is as stiff as if it were rigid"
            )
        yield from _option(FIXED_DISPLACEMENT, "")
        for name, y_mm, table, nodes in conditions:
            head = integers_line([1, 0, 0, 0, relative, 0]) + name
            yield from _rows(head, [0.0, y_mm], [0, table], [1, 2], [node_set], nodes)

    def active(self, load_case: str) -> Iterator[str]:
        """Which conditions act in a load case."""
        names = ["held", *["probe_motion"] * self.meshed]
        yield keyword_line("loadcase", load_case)
        yield from _rows([len(names)], *names)

    def contact(self) -> Iterator[str]:
        """The two bodies, how they touch, and the table that says so.

        What a field means is known of those that are named here.
        """
        friction = self.model.contact.friction
        by_nodal_force, most_separations, iterative_penetration_check = 1, 9999, 3
        bias, friction_force_tolerance = 0.95, 0.05
        words = f"friction {friction:g} (Coulomb, bilinear)" if friction else "no friction"
        yield from _comment(
            f"contact with {words}. Marc has no contact springs, so that their stiffness is "
            "not here"
        )
        yield from _comment(
            "which number of the option asks for segment-to-segment contact is not "
            "known; this deck leaves what Mentat 2021.4 writes by default. The Mentat "
            "procedure beside it sets segment-to-segment and writes the deck again"
        )
        law = [COULOMB_BILINEAR, by_nodal_force] if friction else [0, 0]
        limits = [most_separations, iterative_penetration_check]
        midsides_touch = -1 if self.quadratic else 0
        yield keyword_line("contact", 5, 0, 0)
        yield from _rows(
            [_PROBE, 0, self.boundary_nodes(), *law, *limits, *[0] * 6, midsides_touch, 0, 0],
            [0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 1, 0],
            [0.0, 0.0, 1.0, 0.0, 0.0, bias, 0.0, friction_force_tolerance],
            [1.0, 0.0],
        )
        yield from _body(_FINGER, "finger")
        if self.meshed:
            yield from _body(_PROBE, "probe")
        else:
            yield from self.rigid_probe()
        yield from self.interaction(friction)
        yield from _contact_pairs()

    def boundary_nodes(self) -> int:
        """Most nodes on the outline of one deformable body, mid-sides included."""
        edges, _, _ = self.model.mesh.outline()
        finger = len(np.unique(edges)) + self.quadratic * len(edges)
        # Each node of the probe's single row of elements is on its outline.
        return max(finger, len(self.model.probe_mesh.node_mm) if self.meshed else 0)

    def rigid_probe(self) -> Iterator[str]:
        """The lower side from left to right: a curve has its inside on its left.

        All curves of real decks that were read run so. A straight piece is a curve of
        two points, which was seen there; a curve of many points was not.
        """
        probe = self.model.probe_mesh
        side_mm = probe.node_mm[probe.lower_node]
        nurbs, pieces = 9, np.stack([side_mm[:-1], side_mm[1:]], axis=1).tolist()
        yield from _comment(
            f"contact body {_PROBE}: probe; its position is the table times "
            f"{_INTO_SKIN_MM:g} mm along y"
        )
        yield integers_line([_PROBE, len(pieces), 0, 0, 1, POSITION, 0, -1]) + "probe"
        yield integers_line([*_KINDS[RIGID], *_COLOURS[_PROBE]])
        yield from _placed([0.0, _INTO_SKIN_MM, *[0.0] * 6], [0, _WAVEFORM_TABLE, *[0] * 6])
        weights, knots = [[1.0], [1.0]], [[0.0], [0.0], [1.0], [1.0]]
        for start_mm, end_mm in pieces:
            # Points, order, pieces it is cut into.
            yield from _rows([nurbs, 2, 2, 1], start_mm, end_mm, *weights, *knots)

    def interaction(self, friction: float) -> Iterator[str]:
        """How finger and probe touch: pairs of reals and the tables that multiply them."""
        stress_limit, zeros = 1.0e20, [0.0] * 8
        second = DEFORMABLE if self.meshed else RIGID
        yield from _comment("contact interaction 1: touch")
        yield keyword_line("con intera", 3)
        yield integers_line([1, 0]) + "touch"
        yield from _rows(_KINDS[DEFORMABLE], _KINDS[second], [0] * 16, [0] * 11)
        for numbers in (
            [0.0, 0.0, friction, *[0.0] * 5],
            zeros,
            [*[0.0] * 5, stress_limit, 0.0, 0.0],
            zeros,
            [0.0, 0.0, 1.0, *[0.0] * 5],
            *(zeros, zeros, zeros, [0.0]),
        ):
            yield from _rows(numbers, [0] * len(numbers))

    def post(self) -> Iterator[str]:
        """What goes on the post files, of all elements and nodes at every increment."""
        kind = {"text": "formatted"}.get(self.results, self.results)
        yield from _comment(
            f"post file, {kind}: stress ({STRESS}) and von Mises stress ({VON_MISES}) at "
            "the integration points; at nodes displacement, reaction, contact force and "
            "contact status"
        )
        if kind == "both":
            yield from _comment(
                "the fourth number is 2 for both kinds, which no deck was seen with: 0 is binary"
            )
        number = POST_KINDS[self.results]
        yield from post_lines(_ELEMENT_CODES, number, Layout.EXTENDED, _NODAL_CODES)

    def history(self) -> Iterator[str]:
        """The load case in which the probe moves, in equal increments."""
        motion = self.model.motion
        yield from _comment(f"start of loadcase {_PRESS}")
        yield keyword_line("title", _PRESS)
        yield from self.active(_PRESS)
        yield from _contact_table()
        yield from _comment(
            f"full Newton until force and displacement are within {_TOLERANCE:g}; Marc "
            "tests one alone where the other is too small, as with the probe off the skin"
        )
        limits = [99_999, 40]  # increments, recycles of one
        force_and_displacement, full_newton = 5, 1
        method = [0, force_and_displacement, 0, full_newton]
        within = [_TOLERANCE, *[0.0] * 5, -1.0, 0.0]  # of the force, of the displacement
        yield keyword_line("control", "structural")
        yield from _rows([*limits, *method, 0, 0, 1, 0, 1, 0, 0, 0, 0], within, within)
        yield from _job_parameters(_WITHIN)
        yield from _comment(
            "an increment a sample, none cut back: results are wanted at these times"
        )
        yield from _option(FIXED, [motion.increments, 0, 0, 0, 0])
        yield from _option("time step", [motion.dt_s])
        yield keyword_line("continue")
        yield from _comment(f"end of loadcase {_PRESS}")


def _rows(*rows: str | Sequence[float]) -> Iterator[str]:
    """Lines of text, of integers or, where one is a float, of reals."""
    for row in rows:
        if isinstance(row, str):
            yield row
        elif all(isinstance(number, int) for number in row):
            yield integers_line([int(number) for number in row])
        else:
            yield reals_line(row)


def _option(keyword: str, *rows: str | Sequence[float]) -> Iterator[str]:
    """An option that has nothing but its name on its keyword's line."""
    return _rows(keyword_line(keyword), *rows)


def _body(number: int, name: str) -> Iterator[str]:
    """A deformable body: its elements are those whose block names it."""
    yield from _comment(f"contact body {number}: {name}")
    yield integers_line([number, 0, 0, 0, 0, VELOCITY, 0, -1]) + name
    yield integers_line([*_KINDS[DEFORMABLE], *_COLOURS[number]])
    yield from _placed([0.0] * 8, [0] * 8)
    yield ""


def _contact_pairs() -> Iterator[str]:
    """The contact table: finger and probe touch by interaction 1."""
    yield from _comment("contact table 1: contact_pairs")
    yield keyword_line("con table", 1)
    yield integers_line([1, 1, 0]) + "contact_pairs"
    yield from _comment(f"the only pair: {_FINGER} (finger), {_PROBE} (probe)")
    first = [2.0, *[0.0] * 7]
    yield from _rows([_FINGER, _PROBE, 1, 0, 0], [0] * 8, first, [0] * 8, [0.0] * 3, [0] * 3)


def _contact_table() -> Iterator[str]:
    """Which contact table holds from here on."""
    yield from _comment("allowed contact is defined by contact table 1 (contact_pairs)")
    yield from _option("contact table", [0, 4], [1])


def _job_parameters(state: float) -> Iterator[str]:
    yield keyword_line("parameters")
    for numbers in _PARAMETERS:
        yield reals_line(state if number is None else number for number in numbers)


def _placed(motion: Sequence[float], tables: Sequence[int]) -> Iterator[str]:
    """The lines that all bodies have: where, and how moved by which table."""
    centre_and_axis = [*[0.0] * 6, 1.0]
    yield from _rows(centre_and_axis, [0.0] * 4, motion, tables, [0] * 4)


def _comment(text: str) -> Iterator[str]:
    """`text` as comment lines, in printable ASCII and short enough to read."""
    line = ""
    for word in text.encode("unicode_escape").decode("ascii").split():
        if line and len(line) + 1 + len(word) > _COMMENT_TEXT:
            yield f"$....{line}"
            line = ""
        line = f"{line} {word}" if line else word
    yield f"$....{line}"


def _set(kind: str, name: str, numbers: Sequence[int] | IntArray) -> Iterator[str]:
    yield keyword_line("define", kind, "set", name)
    flat = np.asarray(numbers).tolist()
    for start in range(0, len(flat), _LIST_ITEMS):
        goes_on = "   c" if start + _LIST_ITEMS < len(flat) else ""
        yield "".join(f"{each:12d}" for each in flat[start : start + _LIST_ITEMS]) + goes_on


def _node_lines(node_mm: FloatArray, first: int) -> Iterator[str]:
    """Nodes in the plane, numbered from `first`; z is 0."""
    flat_z = format_real(0.0)
    for number, (x_mm, y_mm) in enumerate(node_mm.tolist(), start=first):
        yield f"{number:10d}{format_real(x_mm)}{format_real(y_mm)}{flat_z}"


def _element_lines(section: ElementSet, kind: int, node: IntArray) -> Iterator[str]:
    row_format = "%10d" * node.shape[1]
    for number, row in zip(section.number.tolist(), node.tolist(), strict=True):
        yield f"{number:10d}{kind:10d}{row_format % tuple(row)}"


# ---- The procedure

# A Mentat procedure sets segment-to-segment contact and writes the deck again: which number
# of a deck asks for that is not known; the command of Mentat that does is. Each command is
# one of public procedures, two of them from their comments; none was run here.

_READ = f"""\
| Segment-to-segment contact for {DECK}, of fembridge.
| In the deck's folder: mentat -bg with this file, or in Mentat.
| Each command is one of public Mentat procedures; none was run here. Where
| it stands in a comment there, this is said: look at Mentat's answer to it.
|
| An empty model; what is open and not saved is lost.
| Seen in: PFLigthart/Marc_Mentat_Scripting (Mentat 2021).
*new_model yes
|
| Read the deck.
| Seen in: public scripts that write decks for Mentat 2021.
*import marc_read "{DECK}"
|
| The job that Mentat makes of it is named by the deck's title.
| Seen in: the same scripts, after an import; Nour-ept (Mentat 2020).
*edit_job {TITLE}
|
| Segment-to-segment contact; node_segment is the other one.
| Seen in: stabix, in a comment there (Mentat 2010 and later).
*job_option contact_method:segment_segment
"""
_FRICTION = """\
|
| As the deck has it already. Older releases know it as
| *job_option frictype:coulomb_bilinear
| Seen in: a public script, in a comment there; stabix for the older word.
*job_option friction_model:coulomb_bilinear
"""
# No command was seen for binary results alone, which is Mentat's own choice.
_RESULTS = {
    "binary": "",
    "text": """\
|
| Formatted post file (.t19).
| Seen in: public scripts.
*job_option post:ascii
""",
    "both": """\
|
| Formatted post file (.t19) and binary one (.t16).
| Seen in: public scripts.
*job_option post:both
""",
}
_WRITE = f"""\
|
| Take the job's options over.
| Seen in: Nour-ept (Mentat 2020).
*update_job
|
| Write the deck that Marc is to run.
| Seen in: PFLigthart/Marc_Mentat_Scripting (Mentat 2021).
*write_marc "{JOB}{REWRITTEN}.dat" yes
|
| Compare the option contact of both decks: what differs is the flag.
"""


def mentat_procedure(*, results: str = "both", friction: bool = True) -> str:
    """The procedure for a deck that was written with these `results` and this `friction`.

    Lines that start with ``|`` are comments.
    """
    return _READ + (_FRICTION if friction else "") + _RESULTS[results] + _WRITE
