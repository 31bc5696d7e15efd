"""Marc: an analysis as the text of an input deck, and the procedure for Mentat beside it.

The deck is the template ``job.dat.j2`` of this folder, the procedure ``job.proc.j2``:
input version 15, as Mentat 2020 to 2023 write it. Here is what fills them: mesh, sets, the
table of depths, the probe's curve. The composition was never run in Marc. The same analysis
gives the same bytes, ASCII with LF line ends.

Elements keep the numbers of the model. A rigid probe has no mesh: its nodes and elements
are left out. Pressure nodes come after all nodes that have a place: that of element n is
n behind the last of them.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from decks.contact_analysis import ContactAnalysis, ElementSet
from decks.dialects import DIALECTS, JOB, REWRITTEN, DeckOptions, template
from decks.marc.contents import NODES, POINTS, POST_KINDS, TIME
from decks.marc.grammar import format_real, integers_line, reals_line
from fembridge.errors import DeckError
from fembridge.typing import FloatArray, IntArray

DECK = DIALECTS["marc"].deck
(PROCEDURE,) = DIALECTS["marc"].extra_files
# Mentat names the job that it makes of a deck by the deck's title.
TITLE = "job1"
WAVEFORM = "waveform"

# Numbers of elements are those of `DIALECTS`. Four and eight nodes are as in the decks
# of DAMASK (11, 27, 54) and PFLigthart (118). Type 80 was in no deck that could be read:
# its one pressure node an element is that of 118, its reduced form; its four points are
# those of 11. The node count of the paper's model, 36 346 of 17 815 elements, is that of
# 80 or 118. The pressure nodes of the Herrmann formulation have no place.
_WITH_PRESSURE = (80, 118)
_PLAIN_QUAD = 11

# Contact bodies: deformable ones come first, and in a pair of two of these the first
# one's nodes are held off the second one's edges.
_FINGER, _PROBE = 1, 2
_COMMENT_TEXT = 74  # characters
_LIST_ITEMS = 13  # a line of 12 columns each, as Mentat writes sets


def marc_deck(analysis: ContactAnalysis, options: DeckOptions = DeckOptions()) -> str:  # noqa: B008 - frozen
    """Write `analysis`, all of the section, as a deck for Marc.

    The probe is "rigid", a curve that a table moves, or "meshed", elements of a second
    contact body whose nodes a table moves. Results are "binary" for ``job.t16``, "text"
    for ``job.t19``, or "both".

    Raises
    ------
    DeckError
        A motion or a law that it cannot express.
    """
    for requested, feature in (
        (analysis.motion.aside_mm is not None, "sliding probe"),
        (analysis.finger.relaxing_s > 0, "relaxing skin"),
        (analysis.inertia, "inertia"),
    ):
        if requested:
            raise DeckError(
                f"is 'marc', for which fembridge writes no {feature}",
                argument="target",
                found="marc",
            )
    model, results = analysis.full_section(), options.results or "both"
    meshed, kind = options.probe == "meshed", int(DIALECTS["marc"].elements[model.element])
    quadratic, probe_mm = NODES[kind] == 8, model.probe_mesh.node_mm
    # A section, its type of element, its contact body; materials count from 1. The probe's
    # quads have no mid-sides.
    sections = [(layer, kind, _FINGER) for layer in model.layers]
    if meshed:
        sections.append((model.probe, _PLAIN_QUAD if quadratic else kind, _PROBE))
    mesh_nodes = len(model.node_mm) + meshed * len(probe_mm)
    edges, _, _ = model.mesh.outline()
    lower_mm = probe_mm[model.probe_mesh.lower_node]
    numbers = [section.number for section, _, _ in sections]
    pressures = sum(
        len(section.number) for section, element, _ in sections if element in _WITH_PRESSURE
    )
    node_lines = [*_node_lines(model.node_mm, 1)]
    if meshed:
        node_lines += _node_lines(probe_mm, model.first_probe_node)
    return template(f"marc/{DECK}.j2").render(
        model=model,
        comment=_comment,
        members=_members,
        ints=lambda *numbers: integers_line(numbers),
        reals=lambda *numbers: reals_line(numbers),
        title=TITLE,
        results=results,
        # Whether 2 stands for both is inferred from Mentat's three choices.
        post_kind=POST_KINDS[results],
        meshed=meshed,
        quadratic=quadratic,
        plain_quad=kind == _PLAIN_QUAD,
        friction=model.contact.friction,
        parts=[_part(*part, mesh_nodes) for part in sections],
        kinds=dict.fromkeys(element for _, element, _ in sections),
        elements=len(np.concatenate(numbers)),
        mesh_nodes=mesh_nodes,
        nodes=mesh_nodes + pressures,
        coordinates="\n".join(node_lines),
        # Most of one deformable body; each node of the probe's single row is on its outline.
        boundary_nodes=max(len(np.unique(edges)) + quadratic * len(edges), meshed * len(probe_mm)),
        waveform="\n".join(time_table(WAVEFORM, model.motion.time_s, model.motion.depth_mm)),
        # The lower side from left to right: a curve has its inside on its left.
        pieces=np.stack([lower_mm[:-1], lower_mm[1:]], axis=1).tolist(),
    )


def mentat_procedure(analysis: ContactAnalysis, options: DeckOptions) -> str:
    """The procedure for a deck of `analysis` that was written with these `options`."""
    return template(f"marc/{PROCEDURE}.j2").render(
        deck=DECK,
        rewritten=f"{JOB}{REWRITTEN}.dat",
        title=TITLE,
        results=options.results or "both",
        friction=analysis.contact.friction > 0,
    )


def time_table(name: str, time_s: FloatArray, value: FloatArray) -> Iterator[str]:
    """Table 1, of time alone: a line a sample; both arrays are ``(T,)``."""
    extrapolate, unused = 2, (0, 0, 2)
    yield f"{'table':<20}{name}"
    yield integers_line([1, 1, 0, 0, POINTS])
    yield integers_line([TIME, len(time_s), extrapolate, *unused * 3, *[0] * 4])
    for sample in zip(time_s.tolist(), value.tolist(), strict=True):
        yield reals_line(sample)


def _part(section: ElementSet, kind: int, body: int, mesh_nodes: int) -> dict[str, Any]:
    """A layer or the probe: its name, material, contact body, and lines of elements."""
    if section.law != "linear":
        raise DeckError(
            f"of {section.name} is {section.law!r}, expected 'linear': no Marc deck of that "
            "material with a known meaning of its numbers was available",
            argument="law",
            found=section.law,
            expected="linear",
        )
    if section.axes is not None:
        raise DeckError(
            f"of {section.name}: expected an isotropic layer, since no Marc deck of an "
            "anisotropic material with a known meaning of its numbers was available",
            argument="anisotropy",
            found=section.name,
            expected="an isotropic layer",
        )
    node, note = section.node, ""
    if kind in _WITH_PRESSURE:
        node = np.column_stack([node, mesh_nodes + section.number])
        note = ", the last node of each its pressure"
    row_format = "%10d" * (2 + node.shape[1])
    rows = np.column_stack([section.number, np.full(len(node), kind), node]).tolist()
    return {
        "name": section.name,
        "material": section.material,
        "body": body,
        "numbers": section.number,
        "words": note,
        "elements": "\n".join(row_format % tuple(row) for row in rows),
    }


def _comment(text: str) -> str:
    """`text` as comment lines, in printable ASCII and short enough to read."""
    lines = [""]
    for text_part in text.encode("unicode_escape").decode("ascii").split():
        if lines[-1] and len(lines[-1]) + 1 + len(text_part) > _COMMENT_TEXT:
            lines.append("")
        lines[-1] += f" {text_part}" if lines[-1] else text_part
    return "\n".join(f"$....{line}" for line in lines)


def _members(numbers: Sequence[int] | IntArray) -> str:
    """The members of a set; a line that ends in ``c`` goes on."""
    flat = np.asarray(numbers).tolist()
    rows = [flat[start : start + _LIST_ITEMS] for start in range(0, len(flat), _LIST_ITEMS)]
    return "   c\n".join("".join(f"{number:12d}" for number in row) for row in rows)


def _node_lines(node_mm: FloatArray, first: int) -> Iterator[str]:
    """Nodes in the plane, numbered from `first`; z is 0."""
    flat_z = format_real(0.0)
    for number, (x_mm, y_mm) in enumerate(node_mm.tolist(), start=first):
        yield f"{number:10d}{format_real(x_mm)}{format_real(y_mm)}{flat_z}"
