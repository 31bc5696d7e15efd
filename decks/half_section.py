"""The right half of a section whose left half is its mirror image.

Where finger, probe and motion are mirror images about ``x = 0``, so is what happens,
and the half with ``x >= 0`` tells all of it: on the axis nothing moves aside, and
there is no shear. That is half of the unknowns. Whether it is so is checked node by
node and element by element; what was found against it is told in words.
"""

from dataclasses import dataclass

import numpy as np

from decks.analysis import DRIVES, SECTIONS, Analysis
from fembridge.typing import BoolArray, FloatArray, IntArray

# How far a node may be from the mirror image of another, or from the axis.
SAME_MM = 1.0e-9
# Nodes are paired by places rounded so; no two nodes of a mesh are as near.
_DIGITS = 6
_MIRROR = np.array([-1.0, 1.0])


@dataclass(frozen=True, slots=True, eq=False)
class HalfSection:
    """What is left of an analysis: which elements ``(E,)`` and quads of the probe."""

    element: BoolArray
    probe_quad: BoolArray


def half_section(analysis: Analysis) -> HalfSection | None:
    """Give the right half of `analysis`; None where all of it must be computed."""
    if why_whole(analysis) is not None:
        return None
    mesh, probe = analysis.mesh, analysis.probe
    return HalfSection(
        _on_the_right(mesh.node_mm, mesh.quad), _on_the_right(probe.node_mm, probe.quad)
    )


def why_whole(analysis: Analysis) -> str | None:
    """Tell why all of the section must be computed; None where half of it will do."""
    if analysis.section == SECTIONS[0]:
        return "the whole section was asked for"
    if analysis.drive == DRIVES[0]:  # the reference: nothing in its decks is left out
        return "each of the probe's nodes is prescribed"
    if analysis.inertia:
        return "inertia counts"
    if analysis.contact.formulation != "node-to-surface":
        return "contact is surface to surface"
    if analysis.motion.aside_mm is not None:
        return "the probe slides"
    mesh, probe = analysis.mesh, analysis.probe
    for name, row in watched_rows(analysis).items():
        if mesh.node_mm[row, 0] < -SAME_MM:
            return f"{name} is at x = {mesh.node_mm[row, 0]:g} mm"
    if not _is_mirrored(probe.node_mm, probe.quad, np.zeros_like(probe.quad[:, 0])):
        return "the probe is no mirror image of itself"
    if not _is_mirrored(mesh.node_mm, mesh.quad, mesh.layer):
        return "the mesh is no mirror image of itself"
    if not _are_mirrored(mesh.node_mm, analysis.held):
        return "what is held is no mirror image of itself"
    element, face = analysis.contact_edge.T
    ends = mesh.quad[element, face], mesh.quad[element, (face + 1) % 4]
    if not _are_mirrored(mesh.node_mm, np.unique(ends)):
        return "the skin that may touch is no mirror image of itself"
    return None


def nodes_on_axis(analysis: Analysis) -> tuple[int, ...]:
    """Give the watched nodes on the axis of a half, by number; none of a whole.

    A solver writes the mean of the stress of the elements there. Those of the left
    half are missing, which matters to shear alone: its sign is the other one there.
    """
    if half_section(analysis) is None:
        return ()
    at = analysis.mesh.node_mm
    rows = dict.fromkeys(watched_rows(analysis).values())
    return tuple(row + 1 for row in rows if on_axis(at[row]))


def watched_rows(analysis: Analysis) -> dict[str, int]:
    """Give the rows of the nodes whose results are wanted, by what to call them."""
    return {
        **{f"afferent {name}": row for name, row in analysis.afferent.items()},
        "the skin under the probe": analysis.apex,
        **{f"watched node {row + 1}": row for row in analysis.watched.tolist()},
    }


def on_axis(node_mm: FloatArray) -> BoolArray:
    """Whether places ``(..., 2)`` lie on the axis."""
    there: BoolArray = np.abs(node_mm[..., 0]) <= SAME_MM
    return there


def _on_the_right(node_mm: FloatArray, quad: IntArray) -> BoolArray:
    right: BoolArray = (node_mm[quad, 0] >= -SAME_MM).all(axis=1)
    return right


def _is_mirrored(node_mm: FloatArray, quad: IntArray, layer: IntArray) -> bool:
    """Whether each quad has its image, of the same layer, and none is its own."""
    image = _images(node_mm)
    if image is None:
        return False
    right, left = (_on_the_right(at, quad) for at in (node_mm, node_mm * _MIRROR))
    return not (right == left).any() and np.array_equal(
        _sorted(quad[right], layer[right]), _sorted(image[quad[left]], layer[left])
    )


def _are_mirrored(node_mm: FloatArray, rows: IntArray) -> bool:
    """Whether the image of each of these nodes, of a mirrored mesh, is among them."""
    image = _images(node_mm)
    return image is not None and np.array_equal(np.unique(rows), np.unique(image[rows]))


def _images(node_mm: FloatArray) -> IntArray | None:
    """Give the row of each node's mirror image; None where one has none."""
    image_mm = node_mm * _MIRROR
    rows, image_rows = (np.lexsort(np.round(at, _DIGITS).T) for at in (node_mm, image_mm))
    if not np.abs(node_mm[rows] - image_mm[image_rows]).max() <= SAME_MM:
        return None
    image = np.empty_like(rows)
    image[image_rows] = rows
    return image


def _sorted(quad: IntArray, layer: IntArray) -> IntArray:
    """Give quads ``(E, 4)`` and layers as rows that do not depend on any order."""
    rows = np.column_stack([np.sort(quad, axis=1), layer])
    ordered: IntArray = rows[np.lexsort(rows.T)]
    return ordered
