"""From a finger's section to a mesh of quadrilaterals.

The right half is meshed with gmsh and mirrored, so that the mesh is symmetric to
the last bit. No physical groups are used (pygmsh mixes up the cells of lines and
surfaces once there are both): each surface is asked for its elements.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from decks.finger import LAYERS, Finger
from decks.meshing.columns import columns_of
from decks.meshing.gmsh_session import gmsh_session
from decks.meshing.half_mesh import DIGITS, HalfMesh
from decks.meshing.mesh import Mesh
from decks.meshing.section_drawing import SectionDrawing, Surface
from decks.section import Section, section_of
from fembridge.errors import FingerError

# More than a solver can take in a day, and than gmsh makes in minutes.
MOST_ELEMENTS = 200_000

# Where the free quads come out too skewed, other widths far from the probe often
# help; these are tried in turn.
_STRETCHES = (1.0, 0.95, 1.05, 0.9, 1.1, 0.85, 1.15, 0.8, 1.2, 0.75, 1.3, 0.7)
# gmsh's number for a quadrilateral of four nodes.
_QUAD = 3


def mesh_finger(finger: Finger) -> Mesh:
    """Mesh `finger`; the same finger and gmsh version give the same mesh.

    Raises
    ------
    MissingError
        gmsh or one of the system's libraries that it opens is not installed.
    FingerError
        The resolution asks for too many elements, gmsh cannot mesh this finger,
        or the mesh fails `Mesh`'s checks.
    """
    section = section_of(finger)
    count = _expected_elements(section)
    if count > MOST_ELEMENTS:
        raise FingerError(
            f"this resolution makes about {count:.0f} elements, expected at most "
            f"{MOST_ELEMENTS}: use wider columns or fewer rows"
        )
    problem = ""
    for stretch in _STRETCHES:
        try:
            return _mesh(section, stretch)
        except FingerError as error:
            problem = problem or str(error)
    raise FingerError(f"{problem}; another resolution.far_mm may help")


def _mesh(section: Section, stretch: float) -> Mesh:
    with gmsh_session() as (geometry, gmsh):
        far_mm = section.finger.resolution.far_mm * stretch
        surfaces = SectionDrawing(geometry, section, far_mm).draw()
        geometry.generate_mesh(dim=2, algorithm=8)
        gmsh.model.mesh.optimize("UntangleMeshGeometry", niter=10)
        half = _collect(gmsh, surfaces)
    return half.snapped(section.finger.afferents.values()).mirrored()


def _expected_elements(section: Section) -> float:
    """About how many elements the whole section will have."""
    finger, resolution = section.finger, section.finger.resolution
    rows = resolution.stratum_corneum_rows + resolution.epidermis_rows + resolution.dermis_rows
    depth_mm = finger.skin.dermis_depth_mm
    inside_mm2 = (
        np.pi
        * (finger.outline.half_width_mm - depth_mm)
        * (finger.outline.half_height_mm - depth_mm)
    )
    in_skin = 2 * columns_of(section, resolution.far_mm).count * rows
    return float(in_skin + inside_mm2 / resolution.far_mm**2)


def _collect(
    gmsh: Any,  # noqa: ANN401 - untyped library
    surfaces: Sequence[Surface],
) -> HalfMesh:
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    row_of = np.full(int(max(tags)) + 1, -1, dtype=np.int64)
    row_of[tags.astype(np.int64)] = np.arange(len(tags))
    quads, layers = [], []
    for surface, layer in surfaces:
        kinds, _, nodes = gmsh.model.mesh.getElements(2, surface)
        if list(kinds) != [_QUAD]:
            raise FingerError(f"gmsh left triangles in {LAYERS[layer]}: choose another resolution")
        quads.append(row_of[nodes[0].astype(np.int64)].reshape(-1, 4))
        layers.append(np.full(len(quads[-1]), layer, dtype=np.int64))
    used, compact = np.unique(np.concatenate(quads), return_inverse=True)
    node_mm = np.asarray(coordinates, dtype=np.float64).reshape(-1, 3)[used, :2]
    return HalfMesh(np.round(node_mm, DIGITS) + 0.0, compact.reshape(-1, 4), np.concatenate(layers))
