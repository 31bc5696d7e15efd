"""Keyword decks for CalculiX and Abaqus: number lines and the values of the templates.

``keyword_deck.inp.j2`` is common to both; ``abaqus.inp.j2`` has the parts for Abaqus, and
`decks.calculix` those for CalculiX. The Abaqus deck follows the keyword reference of Abaqus; it
was parsed back, but not run, because no Abaqus was available. ccx truncates a number at 20
characters without a warning and reads at most 16 entries a line, in an amplitude four pairs.
"""

from collections.abc import Iterable, Sequence
from itertools import chain
from typing import Any

import numpy as np

from decks.contact_analysis import ContactAnalysis, ElementSet
from decks.dialects import DeckOptions, template
from decks.motion import Phase
from fembridge.typing import FloatArray, IntArray

LONGEST_NUMBER = 20
_PER_LINE = 12
_PAIRS_PER_LINE = 4
_HEADING_WIDTH = 78


# ---- Lines


def real(number: float) -> str:
    """The shortest exact text of a number, or 13 digits if that is too long."""
    text = repr(float(number))
    return text if len(text) <= LONGEST_NUMBER else f"{float(number):.12E}"


def fixed(number: float, digits: int) -> str:
    """A number with `digits` decimals, or `real` if these are not exact."""
    text = f"{number:.{digits}f}"
    exact = abs(float(text) - number) <= 1e-12 * abs(number)
    return text if exact and len(text) <= LONGEST_NUMBER else real(number)


def node_lines(numbers: Sequence[int] | IntArray, node_mm: FloatArray) -> str:
    """Nodes in the plane by their `numbers`."""
    rows = zip(np.asarray(numbers).tolist(), (node_mm + 0.0).tolist(), strict=True)
    return "\n".join(f"{number}, {x:.9f}, {y:.9f}, 0.0" for number, (x, y) in rows)


def element_lines(numbers: Sequence[int] | IntArray, nodes: IntArray) -> str:
    """Elements by their `numbers`; `nodes` ``(E, n)`` are numbers as well."""
    rows = zip(np.asarray(numbers).tolist(), nodes.tolist(), strict=True)
    return "\n".join(f"{number}, {', '.join(map(str, row))}" for number, row in rows)


def list_lines(numbers: Sequence[int] | IntArray) -> str:
    """Lines of integers, as in a set."""
    texts = list(map(str, np.asarray(numbers).tolist()))
    starts = range(0, len(texts), _PER_LINE)
    return "\n".join(f"{', '.join(texts[start : start + _PER_LINE])}," for start in starts)


def numbers_line(numbers: Iterable[float]) -> str:
    """Numbers in one line."""
    return ", ".join(map(real, numbers))


def axis_lines(elements: Sequence[int] | IntArray, tangent: FloatArray) -> str:
    """Local axes of elements in the plane: the points `tangent` ``(E, 2)`` and a right angle on."""
    rows = zip(np.asarray(elements).tolist(), (tangent + 0.0).tolist(), strict=True)
    return "\n".join(
        f"{number}, {x:.9f}, {y:.9f}, 0.0, {0.0 - y:.9f}, {x:.9f}, 0.0" for number, (x, y) in rows
    )


def pair_lines(pairs: Iterable[tuple[str, str]]) -> str:
    """Lines of times and values, as in an amplitude."""
    texts = list(chain.from_iterable(pairs))
    starts = range(0, len(texts), 2 * _PAIRS_PER_LINE)
    return "\n".join(", ".join(texts[start : start + 2 * _PAIRS_PER_LINE]) for start in starts)


# ---- A deck


def keyword_deck(
    template_name: str,
    model: ContactAnalysis,
    sections: Sequence[ElementSet],
    steps: Sequence[tuple[Phase, bool]],
    branches: Sequence[tuple[ElementSet, float]] = (),
    **values: Any,  # noqa: ANN401 - variables of the template
) -> str:
    """The deck of `model` from a template of this folder, with `sections` and `steps`.

    A step is a phase of the motion, and whether it writes all nodes. `branches` are element
    sets over their layers and their creep rate, per MPa and s.
    """
    title, *notes = (
        text.encode("unicode_escape").decode("ascii")  # one line of ASCII
        for text in (f"fembridge: {model.title}", *model.notes, f"contact: {model.contact}")
    )
    node = np.unique(model.probe.node)
    probe_mm = model.probe_mesh.node_mm[node - model.first_probe_node]
    times = [fixed(time_s, 7) for time_s in model.motion.time_s.tolist()]

    def amplitude(travel_mm: FloatArray) -> str:
        depths = (f"{mm:.9f}" for mm in (travel_mm + 0.0).tolist())
        return pair_lines(zip(times, depths, strict=True))

    return template(template_name).render(
        model=model,
        title=title[:_HEADING_WIDTH],
        notes=notes,
        probe_node=node,
        probe_mm=probe_mm,
        amplitude=amplitude,
        sections=sections,
        steps=steps,
        branches=branches,
        **LINES,
        **values,
    )


def abaqus_deck(analysis: ContactAnalysis, options: DeckOptions = DeckOptions()) -> str:  # noqa: B008 - frozen
    """Write `analysis` as a deck for Abaqus/Standard.

    Displacement and stress go to the ``.odb`` in every increment; von Mises
    stress, averaged at the nodes around each afferent, is printed to the ``.dat``. Every
    `options.frames` samples the whole field goes to the ``.odb`` too.
    """
    model = analysis.full_section()
    around = {
        name: np.concatenate(
            [layer.number[(layer.node == node).any(axis=1)] for layer in model.layers]
        )
        for name, node in model.afferent.items()
    }
    steps = [(phase, False) for phase in model.motion.phases]
    sections = (*model.layers, model.probe)
    return keyword_deck(
        "abaqus.inp.j2",
        model,
        sections,
        steps,
        abaqus=True,
        around=around,
        frames=options.frames,
    )


LINES = {
    "real": real,
    "fixed": fixed,
    "node_lines": node_lines,
    "element_lines": element_lines,
    "list_lines": list_lines,
    "numbers_line": numbers_line,
    "axis_lines": axis_lines,
    "t_per_mm3": 1.0e-12,  # in one kg/m3
}
"""Functions and factors with which the templates write numbers."""
