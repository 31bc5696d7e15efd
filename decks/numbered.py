"""An analysis with the numbers that a deck gives its nodes and elements, from 1.

This is what every deck writer takes: nodes, sections, sets, the two sides of the
contact. The finger's nodes come first, then the probe's; elements alike. What is
not about numbers (motion, contact, title) stays in `analysis`. A half keeps the
numbers of the whole; those of what is left out do not occur.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from decks.analysis import Analysis
from decks.finger import LAYERS
from decks.half_section import HalfSection, on_axis
from decks.material import Material
from fembridge.typing import BoolArray, FloatArray, IntArray

# Elements of eight nodes; all others have four.
QUADRATIC = ("CPE8", "CPE8R")
# Layers that are strained strongly: what `Analysis.law` is about.
_SOFT = ("stratum_corneum", "epidermis", "dermis", "subcutaneous_tissue")
# A stiff placeholder: every node of the probe is prescribed, so that its
# elements carry no unknown; a solver still wants a material.
_PROBE_MATERIAL = Material(2.1e5, 0.3)


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """Elements of one material: `number` ``(E,)``, and their nodes, `node` ``(E, k)``.

    Four corners counter-clockwise; of eight nodes the mid-sides 1-2, 2-3, 3-4, 4-1
    follow. `law` is "linear" or "neo-hookean", see `decks.analysis.LAWS`.
    """

    name: str
    number: IntArray
    node: IntArray
    material: Material
    law: str


@dataclass(frozen=True, slots=True, eq=False)
class NumberedAnalysis:
    """An analysis as decks write it; node ``n`` of the finger is row ``n - 1``.

    `node_mm` ``(N, 2)`` are the finger's nodes, mid-sides last, `layers` its
    sections, none empty. The probe is `probe`, on the nodes `probe_node_mm`
    ``(P, 2)`` from number `first_probe_node` on; the first ``Q + 1`` of them are its
    lower side from left to right. `held` do not move. `contact_node` are the skin's
    nodes that the probe can reach, `contact_face` ``(K, 2)`` (element, face from 1).
    `watched` are the nodes whose results are wanted, no node twice.

    `node` and `probe_node` are the numbers of the nodes that elements use: of a half
    fewer than there are rows. `axis` are the finger's nodes at x = 0 of a half.
    """

    analysis: Analysis
    node_mm: FloatArray
    node: IntArray
    layers: tuple[Section, ...]
    first_probe_node: int
    probe_node_mm: FloatArray
    probe_node: IntArray
    probe: Section
    held: IntArray
    afferent: Mapping[str, int]
    apex: int
    watched: IntArray
    contact_node: IntArray
    contact_face: IntArray
    axis: IntArray

    @property
    def is_half(self) -> bool:
        """Whether the left half is left out."""
        return self.axis.size > 0

    @property
    def thickness_mm(self) -> float:
        """Of the section: a half stands for both, so that forces are the whole's."""
        return 2.0 if self.is_half else 1.0

    @property
    def lower_side_mm(self) -> FloatArray:
        """The probe's lower side ``(Q + 1, 2)``, from left to right."""
        side: FloatArray = self.probe_node_mm[self.analysis.probe.lower_node]
        return side

    @property
    def sites(self) -> dict[str, str]:
        """Tell in words where each afferent sits."""
        mesh, finger = self.analysis.mesh, self.analysis.finger
        words = {}
        for name, number in self.afferent.items():
            x, y = mesh.node_mm[number - 1]
            layer = finger.afferents[name].layer
            words[name] = f"{layer}, x = {x:.4f} mm, depth = {-y:.4f} mm"
        return words


def numbered(analysis: Analysis, half: HalfSection | None = None) -> NumberedAnalysis:
    """Give `analysis`, or a `half` of it, with numbers of its nodes and elements."""
    mesh = analysis.mesh
    node_mm, element = mesh.node_mm, mesh.quad
    if analysis.element in QUADRATIC:
        node_mm, element = mesh.with_midsides()
    first_node, first_element = len(node_mm) + 1, len(element) + 1
    quad = analysis.probe.quad
    watched = [*analysis.afferent.values(), analysis.apex, *analysis.watched.tolist()]
    whole = NumberedAnalysis(
        analysis=analysis,
        node_mm=node_mm,
        node=np.arange(1, first_node),
        layers=tuple(_layers(analysis, element)),
        first_probe_node=first_node,
        probe_node_mm=analysis.probe.node_mm,
        probe_node=np.arange(first_node, first_node + len(analysis.probe.node_mm)),
        probe=Section(
            "probe_body",
            np.arange(first_element, first_element + len(quad)),
            quad + first_node,
            _PROBE_MATERIAL,
            "linear",
        ),
        held=_held(analysis, element) + 1,
        afferent={name: row + 1 for name, row in analysis.afferent.items()},
        apex=analysis.apex + 1,
        watched=np.array(list(dict.fromkeys(watched)), dtype=np.int64) + 1,
        contact_node=_contact_nodes(analysis, element) + 1,
        contact_face=analysis.contact_edge + 1,
        axis=np.zeros(0, dtype=np.int64),
    )
    return whole if half is None else _reduced(whole, half)


def _reduced(whole: NumberedAnalysis, half: HalfSection) -> NumberedAnalysis:
    """Leave out what `half` has not: elements, and nodes that these alone use."""
    layers = [_kept(layer, half.element[layer.number - 1]) for layer in whole.layers]
    probe = _kept(whole.probe, half.probe_quad)
    node = np.unique(np.concatenate([np.unique(layer.node) for layer in layers]))
    return replace(
        whole,
        node=node,
        layers=tuple(layer for layer in layers if layer.number.size),
        probe_node=np.unique(probe.node),
        probe=probe,
        held=np.intersect1d(whole.held, node),
        contact_node=np.intersect1d(whole.contact_node, node),
        contact_face=whole.contact_face[half.element[whole.contact_face[:, 0] - 1]],
        axis=node[on_axis(whole.node_mm[node - 1])],
    )


def _kept(section: Section, which: BoolArray) -> Section:
    return replace(section, number=section.number[which], node=section.node[which])


def _layers(analysis: Analysis, element: IntArray) -> list[Section]:
    sections = []
    for index, layer in enumerate(LAYERS):
        rows = np.flatnonzero(analysis.mesh.layer == index)
        if rows.size:
            law = analysis.law if layer in _SOFT else "linear"
            material = analysis.finger.materials[layer]
            sections.append(Section(layer, rows + 1, element[rows] + 1, material, law))
    return sections


def _held(analysis: Analysis, element: IntArray) -> IntArray:
    """Rows of the nodes that do not move."""
    held = np.isin(element, analysis.held)
    if element.shape[1] == 8:  # a mid-side node is held where both its ends are
        held[:, 4:] = held[:, :4] & np.roll(held[:, :4], -1, axis=1)
        bone = analysis.mesh.in_layer("bone")
        held[~bone, 4:] &= _on_outline(analysis)[~bone]
    return np.unique(element[held])


def _contact_nodes(analysis: Analysis, element: IntArray) -> IntArray:
    """Rows of the skin's nodes that the probe can reach."""
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
