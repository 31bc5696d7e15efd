"""Who has which number in a Marc deck: parts, materials, contact bodies, nodes.

Elements keep the numbers of the neutral model. A rigid probe has no mesh: its
nodes and elements are left out. Pressure nodes of Herrmann elements come after
all nodes that have a place: that of element n is `mesh_nodes` + n.
"""

from dataclasses import dataclass

import numpy as np

from decks.analysis import Analysis, ElementSet
from decks.marc.element_types import MARC_TYPES, MarcElement, marc_type
from fembridge.errors import DeckError
from fembridge.typing import IntArray

PROBES = ("rigid", "meshed")

# Contact bodies: deformable ones come first, and in a pair of two of these the
# first one's nodes are held off the second one's edges.
FINGER_BODY = 1
PROBE_BODY = 2


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A section with its type of element, material and contact body."""

    section: ElementSet
    element: MarcElement
    material: int
    body: int


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """What a deck of `model` holds; `meshed` is whether its probe has elements."""

    model: Analysis
    meshed: bool
    element: MarcElement
    parts: tuple[Part, ...]

    @property
    def elements(self) -> int:
        """Number of elements."""
        return sum(len(part.section.number) for part in self.parts)

    @property
    def mesh_nodes(self) -> int:
        """Number of nodes that have a place."""
        probe_nodes = len(self.model.probe_node_mm) if self.meshed else 0
        return len(self.model.node_mm) + probe_nodes

    @property
    def nodes(self) -> int:
        """Number of all nodes, those that hold a pressure alone included."""
        pressures = sum(len(part.section.number) for part in self.parts if part.element.pressure)
        return self.mesh_nodes + pressures

    @property
    def probe_nodes(self) -> IntArray:
        """Numbers of the probe's nodes."""
        first = self.model.first_probe_node
        return np.arange(first, first + len(self.model.probe_node_mm))

    @property
    def boundary_nodes(self) -> int:
        """Most nodes on the outline of one deformable body, mid-sides included."""
        edges, _, _ = self.model.mesh.outline()
        finger = len(np.unique(edges))
        if self.element.nodes == 8:
            finger += len(edges)
        # Each node of the probe's single row of elements is on its outline.
        return max(finger, len(self.probe_nodes) if self.meshed else 0)

    def connected(self, part: Part) -> IntArray:
        """Nodes of each element of `part`, its pressure node last, ``(E, n)``."""
        section = part.section
        if not part.element.pressure:
            return section.node
        pressure = self.mesh_nodes + section.number
        return np.concatenate([section.node, pressure[:, None]], axis=1)


def lay_out(model: Analysis, probe: str) -> Layout:
    """Give each part of `model` its place in a deck.

    Raises
    ------
    DeckError
        An unknown element or probe, or a material that is no linear one.
    """
    if probe not in PROBES:
        raise DeckError(f"probe {probe!r}, expected {' or '.join(PROBES)}")
    element = marc_type(model.element)
    parts = [
        Part(layer, element, material, FINGER_BODY)
        for material, layer in enumerate(model.layers, start=1)
    ]
    if probe == "meshed":
        # The probe's quads have no mid-sides.
        quad = element if element.nodes == 4 else MARC_TYPES["CPE4"]
        parts.append(Part(model.probe, quad, len(parts) + 1, PROBE_BODY))
    for part in parts:
        if part.section.law != "linear":
            raise DeckError(
                f"{part.section.name} is {part.section.law}: a Marc deck of it cannot "
                "be written with certainty, since no deck with that material and a "
                "known meaning of its numbers was at hand; expected linear"
            )
    return Layout(model, probe == "meshed", element, tuple(parts))
