"""Mesh and sets of a Marc deck: ``connectivity``, ``coordinates``, ``define``.

Since input version 14 an element's geometry, material and contact body stand in the
header of its ``connectivity`` block, so there is one block a layer.
"""

from collections.abc import Iterator, Sequence

from decks.marc.layout import Layout
from decks.marc.lines import comment, element_lines, integers, list_lines, named, node_lines
from decks.marc.properties import GEOMETRY
from fembridge.typing import IntArray

HELD = "held_nodes"
PROBE_NODES = "probe_nodes"
APEX = "skin_apex"
AFFERENT = "afferent_"

# Of a header; the third number prints the elements in the listing.
_PRINT = 1
# Three coordinates a node, also in the plane.
_COORDINATES = 3


def mesh(layout: Layout) -> Iterator[str]:
    """Write elements, a block a layer, and nodes."""
    for part in layout.parts:
        section = part.section
        pressure = ", the last node of each its pressure" * part.element.pressure
        yield from comment(f"elements of {section.name}{pressure}")
        yield named("connectivity")
        # 5 geometry, 6 material, 8 contact body; 9 would be a CAD body.
        yield integers([0, 0, _PRINT, 0, GEOMETRY, part.material, 0, part.body, 0])
        yield from element_lines(
            section.number.tolist(), part.element.number, layout.connected(part)
        )
    if layout.nodes > layout.mesh_nodes:
        yield from comment(
            f"nodes from {layout.mesh_nodes + 1} on hold a pressure and have no place"
        )
    yield named("coordinates")
    yield integers([_COORDINATES, layout.mesh_nodes, 0, 1])
    yield from node_lines(layout.model.node_mm, first=1)
    if layout.meshed:
        yield from node_lines(layout.model.probe_node_mm, first=layout.model.first_probe_node)


def sets(layout: Layout) -> Iterator[str]:
    """Write a set a layer, of what is held, of each afferent and of the apex."""
    model = layout.model
    for part in layout.parts:
        yield from _set("element", part.section.name, part.section.number)
    yield from comment("bone and the nail's outer side, which do not move")
    yield from _set("node", HELD, model.fixed)
    if layout.meshed:
        yield from _set("node", PROBE_NODES, layout.probe_nodes)
    for name, words in model.sites.items():
        yield from comment(f"{name}: {words}")
        yield from _set("node", AFFERENT + name.lower(), [model.afferent[name]])
    yield from comment("the skin's node that the probe touches first")
    yield from _set("node", APEX, [model.apex])


def _set(kind: str, name: str, numbers: Sequence[int] | IntArray) -> Iterator[str]:
    yield named("define", kind, "set", name)
    yield from list_lines(numbers)
