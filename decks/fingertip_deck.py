"""The deck of a round fingertip for CalculiX and Abaqus: parts, sets, surfaces, materials.

Without a plate it has no step: a model for others to load. With one, a flat rigid plate is
pressed into the pad, without friction.
"""

import numpy as np

from decks.contact_analysis import ElementSet
from decks.dialects import template
from decks.finger import LAYERS
from decks.fingertip import Fingertip
from decks.fingertip_mesh import FACE_NODES, TipMesh, mesh_fingertip
from decks.keyword_deck import LINES
from fembridge.typing import FloatArray

_PLATE_THICKNESS_MM = 1.0
# Increments of the plate's way: so many forces against depth are written.
_INCREMENTS = 4
# The plate is this far from the pad at first.
_GAP_MM = 1.0e-4
# Skin that is farther below the plate at its full depth than this is never touched.
_REACH_MM = 1.0
# ccx gives each node the area of the face that it touches, the whole plate: the spring of a node
# is stiff enough that it is less than 0.1 um inside the plate.
_STIFFNESS_MPA_PER_MM = 1.0


def space_lines(node_mm: FloatArray, first: int) -> str:
    """Nodes in space ``(N, 3)``, numbered from `first`."""
    rows = enumerate((node_mm + 0.0).tolist(), start=first)
    return "\n".join(f"{number}, {x:.9f}, {y:.9f}, {z:.9f}" for number, (x, y, z) in rows)


def fingertip_deck(
    tip: Fingertip, mesh: TipMesh | None = None, plate_mm: float | None = None
) -> str:
    """Text of the deck of `tip`; the same fingertip gives the same bytes.

    Element sets are named after the layers. Surfaces: SKIN, outside the nail, and PAD. Node sets:
    HELD (bone and the nail's outer side), END (towards the joint), APEX, and AFFERENTS_SA and so
    on at the depth of each class.

    Parameters
    ----------
    tip
        The fingertip.
    mesh
        Its mesh. Default: None, it is made by gmsh.
    plate_mm
        Depth in mm to which a flat plate is pressed into the pad. Default: None, no plate and no
        step.

    Raises
    ------
    MissingError, FingerError
        As `decks.fingertip_mesh.mesh_fingertip`.
    """
    mesh = mesh or mesh_fingertip(tip)
    count = len(mesh.node_mm)
    layers = []
    for index, name in enumerate(LAYERS):
        rows = np.flatnonzero(mesh.layer == index)
        layers.append(ElementSet(name, rows + 1, mesh.tet[rows] + 1, tip.materials[name], "linear"))
    faces = mesh.tet[mesh.skin]
    skin = np.unique(faces[:, list(FACE_NODES[: 3 * tip.resolution.order])])
    touchable = skin[mesh.node_mm[skin, 1] > -(plate_mm or 0.0) - _REACH_MM]
    half = tip.outline.half_width_mm
    ends_mm = (-tip.outline.shaft_mm, tip.outline.tip_mm)
    low_mm, high_mm = _GAP_MM, _GAP_MM + _PLATE_THICKNESS_MM
    # The first face, S1, is the lower one.
    plate_mm_nodes = np.array(
        [
            (x, y, z)
            for y in (low_mm, high_mm)
            for x, z in (
                (-half, ends_mm[0]),
                (-half, ends_mm[1]),
                (half, ends_mm[1]),
                (half, ends_mm[0]),
            )
        ]
    )
    return template("fingertip.inp.j2").render(
        title=tip.name.encode("unicode_escape").decode("ascii"),
        tip=tip,
        mesh=mesh,
        layers=layers,
        element=f"C3D{mesh.tet.shape[1]}",
        apex=mesh.apex + 1,
        surfaces={"SKIN": mesh.skin + 1, "PAD": mesh.pad + 1},
        plate_mm=plate_mm,
        plate_node_mm=plate_mm_nodes,
        plate_first_node=count + 1,
        plate_node_number=np.arange(count + 1, count + 9)[None],
        plate_element=len(mesh.tet) + 1,
        stiffness_mpa_per_mm=_STIFFNESS_MPA_PER_MM,
        increments=_INCREMENTS,
        touchable=touchable + 1,
        space_lines=space_lines,
        **LINES,
    )
