"""From a fingertip to tetrahedra, by gmsh.

gmsh meshes the half of the skin at ``x >= 0``. Its triangles are copied inwards along the normals
to each level of the fingertip, and the prisms between two levels are cut into three tetrahedra
each: so layers are conformal and as thick as requested, and below every node of the skin there is
one at the depth of each afferent. gmsh fills the tissue below the lowest level, and the bone.
The half is mirrored, so that the mesh is symmetric to the last bit.

Skin and bone are meshed as a capsule, a half ball on a cylinder of radius 1, and then mapped; the
outline of the nail is a cut of the capsule with two planes.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from decks.finger import LAYERS
from decks.fingertip import Fingertip
from decks.mesher import gmsh_session
from fembridge.errors import FingerError
from fembridge.typing import BoolArray, FloatArray, IntArray

# Above this number, a solver needs more memory than most machines have.
MAX_ELEMENTS = 400_000
# Corners of each edge with a node in its middle, in the order of C3D10.
TET_EDGES = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))
# Nodes of the first face, S1: corners, then middles.
FACE_NODES = (0, 1, 2, 4, 5, 6)
# Order of the nodes in the mirror image of an element; its first face stays the first.
_MIRRORED = (1, 0, 2, 3, 4, 6, 5, 8, 7, 9)
# The stratum corneum grows to the thickness of the nail over this share of the half height.
_NAIL_BLEND = 0.25
# Width of an element grows by this share of the distance to the pad.
_GROWTH = 0.25
# Elements around the bone: their width as a share of `far_mm`.
_BONE_SHARE = 0.75
# Afferents lie this many elements or more away from the end of the model.
_END_ELEMENTS = 1.0
_DIGITS = 9
_ON_PLANE = 1e-7
_TRIANGLE, _TETRAHEDRON = 2, 4  # gmsh's numbers
_OPTIONS = {
    "General.Verbosity": 1,
    "General.NumThreads": 1,
    "Mesh.Algorithm": 6,
    "Mesh.Algorithm3D": 1,
    "Mesh.MeshSizeFromPoints": 0,
    "Mesh.MeshSizeExtendFromBoundary": 1,
    "Mesh.Optimize": 1,
    "Mesh.OptimizeNetgen": 1,
}


@dataclass(frozen=True, slots=True, eq=False)
class TipMesh:
    """Tetrahedra of a fingertip.

    Parameters
    ----------
    node_mm
        Positions in mm, ``(N, 3)``.
    tet
        Rows of the nodes of each element, ``(E, 10)`` or ``(E, 4)``, in the order of C3D10.
    layer
        Index of `decks.finger.LAYERS` of each element, ``(E,)``.
    skin, nail
        Elements whose first face is on the outer side of the skin or the nail, ``(S,)``.
    pad
        Those of `skin` on the pad, where elements are small.
    fixed
        Nodes of the bone and of the nail's outer side, ``(H,)``, which do not move.
    end
        Nodes at the end of the model towards the joint, ``(M,)``, which stay in their plane.
    afferents
        Nodes at the depth of each class of afferents, below the skin outside the nail.
    pad_afferents
        Those of them below `pad`.
    """

    node_mm: FloatArray
    tet: IntArray
    layer: IntArray
    skin: IntArray
    nail: IntArray
    pad: IntArray
    fixed: IntArray
    end: IntArray
    afferents: Mapping[str, IntArray]
    pad_afferents: Mapping[str, IntArray]

    @property
    def apex(self) -> int:
        """Row of the node at the apex of the pad, the origin."""
        return int(np.linalg.norm(self.node_mm, axis=1).argmin())

    def scaled_jacobian(self) -> FloatArray:
        """Quality of each element by its corners, ``(E,)``: 1 if regular, 0 or less if folded."""
        return scaled_jacobian(self.node_mm[self.tet[:, :4]])

    def corner_jacobian(self) -> FloatArray:
        """Smallest determinant at the corners of each element over that of its chords, ``(E,)``.

        1 without curved edges; 0 or less where a curved edge folds the element.
        """
        corner = self.node_mm[self.tet[:, :4]]
        straight = _determinant(corner)
        if self.tet.shape[1] == 4:
            return np.ones_like(straight)
        middle = self.node_mm[self.tet[:, 4:]]
        column = {frozenset(edge): k for k, edge in enumerate(TET_EDGES)}
        worst = np.full(len(corner), np.inf)
        for corner_row, others in ((0, (1, 2, 3)), (1, (0, 3, 2)), (2, (0, 1, 3)), (3, (0, 2, 1))):
            tangents = [
                4 * middle[:, column[frozenset((corner_row, other))]]
                - 3 * corner[:, corner_row]
                - corner[:, other]
                for other in others
            ]
            volume = np.linalg.det(np.stack(tangents, axis=1))
            worst = np.minimum(worst, volume / straight)
        return worst

    def volume_mm3(self) -> FloatArray:
        """Volume of each element by its corners, ``(E,)``."""
        volume: FloatArray = _determinant(self.node_mm[self.tet[:, :4]]) / 6
        return volume


def scaled_jacobian(corner_mm: FloatArray) -> FloatArray:
    """Quality of tetrahedra with corners ``(E, 4, 3)``: 1 if regular, 0 or less if folded."""
    length = {
        edge: np.linalg.norm(corner_mm[:, edge[1]] - corner_mm[:, edge[0]], axis=1)
        for edge in TET_EDGES
    }
    largest = np.zeros(len(corner_mm))
    for corner in range(4):
        three = [length[edge] for edge in TET_EDGES if corner in edge]
        largest = np.maximum(largest, three[0] * three[1] * three[2])
    quality: FloatArray = math.sqrt(2.0) * _determinant(corner_mm) / largest
    return quality


def _determinant(corner_mm: FloatArray) -> FloatArray:
    sides = corner_mm[:, 1:] - corner_mm[:, :1]
    determinant: FloatArray = np.linalg.det(sides)
    return determinant


def mesh_fingertip(tip: Fingertip) -> TipMesh:
    """Mesh `tip`; the same fingertip and gmsh version give the same mesh.

    Raises
    ------
    MissingError
        gmsh or one of the system's libraries that it opens is not installed.
    FingerError
        Too many elements, a fingertip that gmsh cannot mesh, or folded elements.
    """
    with gmsh_session(_OPTIONS) as (_, gmsh):
        capsule, triangle, on_nail = _skin_capsule(gmsh, tip)
        count = 6 * len(triangle) * len(tip.levels())
        if count > MAX_ELEMENTS:
            raise FingerError(
                f"makes {count} elements in the layers of the skin, expected at most "
                f"{MAX_ELEMENTS}: use wider elements",
                argument="resolution",
                found=count,
                expected=f"at most {MAX_ELEMENTS} elements",
            )
        stack = _Stack(tip, capsule, triangle, on_nail)
        inner_mm = stack.at_level(len(stack.layers))
        bone_capsule, bone_triangle = _bone_capsule(gmsh, tip)
        bone_mm = _exact(tip, tip.bone_mm(bone_capsule))
        core_mm, core, bone_mm, bone = _fill(
            gmsh, tip, (inner_mm, triangle), (bone_mm, bone_triangle)
        )
    return _assembled(tip, stack, (core_mm, core), (bone_mm, bone))


# ---- The skin and the bone as triangles


def _skin_capsule(gmsh: Any, tip: Fingertip) -> tuple[FloatArray, IntArray, BoolArray]:  # noqa: ANN401 - untyped
    """Nodes ``(S, 3)`` and triangles ``(F, 3)`` of half the capsule; whether each is nail."""
    occ, mesh, outline = gmsh.model.occ, tip.resolution, tip.outline
    gmsh.model.add("skin")
    solids = _half_capsule(occ, 1.0)
    root = -tip.nail.root_mm / outline.shaft_mm
    level = occ.addRectangle(-3, -3, 0, 6, 6)
    occ.rotate([(2, level)], 0, 0, 0, 1, 0, 0, math.pi / 2)
    occ.translate([(2, level)], 0, tip.nail_height, 0)
    across = occ.addRectangle(-3, -3, root, 6, 6)
    occ.fragment(solids, [(2, level), (2, across)])
    occ.synchronize()
    scale_mm = math.sqrt(outline.half_width_mm * outline.tip_mm)

    def width(dim: int, tag: int, x: float, y: float, z: float, size: float) -> float:
        point_mm = tip.skin_mm(np.array([[x, y, z]]))[0]
        beyond_mm = max(float(np.linalg.norm(point_mm)) - mesh.pad_radius_mm, 0.0)
        return min(mesh.pad_mm + _GROWTH * beyond_mm, mesh.far_mm) / scale_mm

    points, triangles = _round_faces(gmsh, width)
    middle = points[triangles].mean(axis=1)
    on_nail = (middle[:, 1] < tip.nail_height) & (middle[:, 2] > root)
    return points, triangles, on_nail


def _bone_capsule(gmsh: Any, tip: Fingertip) -> tuple[FloatArray, IntArray]:  # noqa: ANN401 - untyped
    """Nodes and triangles of half the capsule of the bone."""
    gmsh.model.add("bone")
    _half_capsule(gmsh.model.occ, tip.bone_length)
    gmsh.model.occ.synchronize()
    size_mm = _BONE_SHARE * tip.resolution.far_mm
    size = size_mm / max(tip.bone.tuft_half_width_mm, tip.bone.base_half_width_mm)
    return _round_faces(gmsh, lambda *_: min(size, 0.6))


def _half_capsule(occ: Any, length: float) -> list[tuple[int, int]]:  # noqa: ANN401 - untyped
    """Solids of half a capsule at ``x >= 0``: a quarter of a ball, half a cylinder of `length`."""
    ball = occ.addSphere(0, 0, 0, 1, angle3=math.pi / 2)
    occ.rotate([(3, ball)], 0, 0, 0, 1, 0, 0, math.pi / 2)
    shaft = occ.addCylinder(0, 0, -length, 0, 0, length, 1, angle=math.pi)
    occ.rotate([(3, shaft)], 0, 0, 0, 0, 0, 1, -math.pi / 2)
    solids: list[tuple[int, int]] = occ.fragment([(3, ball)], [(3, shaft)])[0]
    return solids


def _round_faces(gmsh: Any, width: Any) -> tuple[FloatArray, IntArray]:  # noqa: ANN401 - untyped
    """Mesh the faces that are not plane; nodes and triangles of all of them."""
    gmsh.model.mesh.setSizeCallback(width)
    faces = gmsh.model.getEntities(2)
    is_round = [face for face in faces if gmsh.model.getType(*face) != "Plane"]
    gmsh.option.setNumber("Mesh.MeshOnlyVisible", 1)
    gmsh.model.setVisibility(gmsh.model.getEntities(), 0)
    gmsh.model.setVisibility(is_round, 1, True)
    gmsh.model.mesh.generate(2)
    gmsh.model.mesh.removeSizeCallback()
    gmsh.option.setNumber("Mesh.MeshOnlyVisible", 0)
    points, triangles = _elements_of(gmsh, [face for _, face in is_round], 2, _TRIANGLE)
    gmsh.model.remove()
    return points, triangles


def _elements_of(
    gmsh: Any,  # noqa: ANN401 - untyped
    entities: Sequence[int],
    dimension: int,
    kind: int,
) -> tuple[FloatArray, IntArray]:
    """Nodes of the elements of `entities` and the elements by rows of these nodes."""
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    order = np.argsort(tags)
    tags, position = tags[order], coordinates.reshape(-1, 3)[order]
    blocks = []
    for entity in entities:
        kinds, _, nodes = gmsh.model.mesh.getElements(dimension, entity)
        blocks += [block for name, block in zip(kinds, nodes, strict=True) if name == kind]
    if not blocks:
        raise FingerError("gmsh made no elements: choose another resolution")
    flat = np.searchsorted(tags, np.concatenate(blocks))
    used, rows = np.unique(flat, return_inverse=True)
    corners = kind if kind == _TETRAHEDRON else 3
    return position[used].astype(np.float64), rows.reshape(-1, corners).astype(np.int64)


def _exact(tip: Fingertip, point_mm: FloatArray) -> FloatArray:
    """Points rounded, and exactly on the planes of symmetry and of the end."""
    exact = np.round(point_mm, _DIGITS) + 0.0
    exact[np.abs(exact[:, 0]) < _ON_PLANE, 0] = 0.0
    end_mm = -tip.outline.shaft_mm
    exact[np.abs(exact[:, 2] - end_mm) < _ON_PLANE, 2] = end_mm
    return exact


# ---- The layers of the skin: levels below the triangles


class _Stack:
    """Tetrahedra of the half of the layers; node `i` of level `k` has the row ``k S + i``."""

    def __init__(
        self, tip: Fingertip, capsule: FloatArray, triangle: IntArray, on_nail: BoolArray
    ) -> None:
        self.tip, self.capsule = tip, capsule
        self.triangle, self.on_nail = triangle, on_nail
        levels = tip.levels()
        self.layers = [LAYERS.index(level.layer) for level in levels]
        size = len(capsule)
        self.depth_mm = np.zeros((len(levels) + 1, size))
        self.depth_mm[1:] = np.array([level.depth_mm for level in levels])[:, None]
        # Under the nail the rows of the epidermis are thinner, with the same lower side.
        corneum_mm, epidermis_mm = tip.skin.stratum_corneum_mm, tip.skin.epidermis_depth_mm
        self.nail_share = self._nail_share()
        shift_mm = (tip.nail.thickness_mm - corneum_mm) * self.nail_share
        above = np.clip((epidermis_mm - self.depth_mm[1:]) / (epidermis_mm - corneum_mm), 0.0, 1.0)
        self.depth_mm[1:] += above * shift_mm
        ordered = np.sort(triangle, axis=1)  # one diagonal for both prisms at a side
        tets, layer = [], []
        for k, of_row in enumerate(self.layers):
            a, b, c = (ordered + k * size).T
            below_a, below_b, below_c = (ordered + (k + 1) * size).T
            tets.append(np.stack([a, b, c, below_c], axis=1))
            tets.append(np.stack([a, b, below_b, below_c], axis=1))
            tets.append(np.stack([a, below_a, below_b, below_c], axis=1))
            first = np.where(on_nail, LAYERS.index("nail"), of_row) if k == 0 else of_row
            layer += [np.broadcast_to(first, len(triangle))] * 3
        self.tet = np.concatenate(tets)
        self.layer = np.concatenate(layer)
        self.node_mm = np.concatenate([self.at_level(k) for k in range(len(levels) + 1)])

    def _nail_share(self) -> FloatArray:
        """1 at nodes of the nail, falling to 0 around it."""
        share = np.ones(len(self.capsule))
        root = -self.tip.nail.root_mm / self.tip.outline.shaft_mm
        for beyond, reach in (
            (self.capsule[:, 1] - self.tip.nail_height, _NAIL_BLEND),
            (root - self.capsule[:, 2], _NAIL_BLEND),
        ):
            share *= 0.5 * (1 + np.cos(np.pi * np.clip(beyond / reach, 0.0, 1.0)))
        return share

    def at_level(self, level: int) -> FloatArray:
        """Nodes of a level in mm, ``(S, 3)``."""
        return self._below(self.capsule, self.depth_mm[level])

    def middles(self, edge: IntArray) -> FloatArray:
        """Middles of edges ``(M, 2)``: at the mean depth below the middle of the skin's edge."""
        level, column = np.divmod(edge, len(self.capsule))
        point = self.capsule[column].mean(axis=1)
        ahead = point[:, 2] > 0
        point[ahead] /= np.linalg.norm(point[ahead], axis=1)[:, None]
        point[~ahead, :2] /= np.linalg.norm(point[~ahead, :2], axis=1)[:, None]
        return self._below(point, self.depth_mm[level, column].mean(axis=1))

    def _below(self, capsule: FloatArray, depth_mm: FloatArray) -> FloatArray:
        skin_mm = self.tip.skin_mm(capsule)
        return _exact(self.tip, skin_mm - depth_mm[:, None] * self.tip.normal(skin_mm))


# ---- The tissue below the layers, and the bone


def _fill(
    gmsh: Any,  # noqa: ANN401 - untyped
    tip: Fingertip,
    inner: tuple[FloatArray, IntArray],
    bone: tuple[FloatArray, IntArray],
) -> tuple[FloatArray, IntArray, FloatArray, IntArray]:
    """Nodes and tetrahedra between the triangles `inner` and `bone`, and inside `bone`."""
    far_mm = tip.resolution.far_mm
    (inner_axis, inner_end), (bone_axis, bone_end) = (
        _borders(tip, *triangles) for triangles in (inner, bone)
    )
    # Both borders run from the pad to the back; lines in the plane x = 0 join them.
    pad_line, back_line = (
        _line(inner_axis[k], bone_axis[k], far_mm * _BONE_SHARE) for k in (0, -1)
    )
    bone_line = _line(bone_axis[0], bone_axis[-1], far_mm)
    planes = [
        [inner_axis, back_line, bone_axis[::-1], pad_line[::-1]],
        [inner_end, back_line, bone_end[::-1], pad_line[::-1]],
    ]
    bone_planes = [[bone_axis, bone_line[::-1]], [bone_end, bone_line[::-1]]]
    bone_mm, bone_tet = _filled(gmsh, [bone, *(_plane(gmsh, ring) for ring in bone_planes)])
    core_mm, core_tet = _filled(gmsh, [inner, bone, *(_plane(gmsh, ring) for ring in planes)])
    return core_mm, core_tet, bone_mm, bone_tet


def _borders(
    tip: Fingertip, node_mm: FloatArray, triangle: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Borders of half a surface from the pad to the back: at ``x = 0``, and at the end."""
    edges = np.concatenate([triangle[:, pair] for pair in ((0, 1), (1, 2), (2, 0))])
    single, count = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
    single = single[count == 1]
    end_mm = -tip.outline.shaft_mm
    borders = []
    for axis, value_mm in ((0, 0.0), (2, end_mm)):
        rows = single[(node_mm[single, axis] == value_mm).all(axis=1)]
        neighbours: dict[int, list[int]] = {}
        for first, second in rows.tolist():
            neighbours.setdefault(first, []).append(second)
            neighbours.setdefault(second, []).append(first)
        ends = [row for row, others in neighbours.items() if len(others) == 1]
        if len(ends) != 2:
            raise FingerError("gmsh left a gap in the skin: choose another resolution")
        chain = [max(ends, key=lambda row: float(node_mm[row, 1]))]
        while len(chain) <= len(rows):
            chain.append(next(row for row in neighbours[chain[-1]] if row not in chain[-2:]))
        borders.append(node_mm[chain])
    return borders[0], borders[1]


def _line(start_mm: FloatArray, stop_mm: FloatArray, step_mm: float) -> FloatArray:
    """Points of a straight line, about `step_mm` apart."""
    count = max(1, round(float(np.linalg.norm(stop_mm - start_mm)) / step_mm))
    line: FloatArray = np.round(np.linspace(start_mm, stop_mm, count + 1), _DIGITS) + 0.0
    return line


def _plane(gmsh: Any, ring: Sequence[FloatArray]) -> tuple[FloatArray, IntArray]:  # noqa: ANN401 - untyped
    """Triangles of a plane face whose border runs through the points of `ring`, one by one."""
    gmsh.model.add("plane")
    border = np.concatenate([part[:-1] for part in ring])
    points = [gmsh.model.geo.addPoint(*point_mm) for point_mm in border.tolist()]
    lines = [
        gmsh.model.geo.addLine(start, stop)
        for start, stop in zip(points, [*points[1:], points[0]], strict=True)
    ]
    for line in lines:
        gmsh.model.geo.mesh.setTransfiniteCurve(line, 2)
    face = gmsh.model.geo.addPlaneSurface([gmsh.model.geo.addCurveLoop(lines)])
    gmsh.model.geo.synchronize()
    gmsh.model.mesh.generate(2)
    mesh = _elements_of(gmsh, [face], 2, _TRIANGLE)
    gmsh.model.remove()
    return mesh


def _filled(
    gmsh: Any,  # noqa: ANN401 - untyped
    faces: Sequence[tuple[FloatArray, IntArray]],
) -> tuple[FloatArray, IntArray]:
    """Tetrahedra inside the closed surface of `faces`, which keeps its triangles."""
    every_mm = np.concatenate([node_mm for node_mm, _ in faces])
    offset = np.cumsum([0, *(len(node_mm) for node_mm, _ in faces)])
    node_mm, row = _merged(every_mm)
    triangle = np.concatenate(
        [row[face + start] for (_, face), start in zip(faces, offset, strict=False)]
    )
    gmsh.model.add("inside")
    surface = gmsh.model.addDiscreteEntity(2)
    tags = np.arange(1, len(node_mm) + 1)
    gmsh.model.mesh.addNodes(2, surface, tags, node_mm.ravel())
    gmsh.model.mesh.addElementsByType(surface, _TRIANGLE, [], (triangle + 1).ravel())
    loop = gmsh.model.geo.addSurfaceLoop([surface])
    volume = gmsh.model.geo.addVolume([loop])
    gmsh.model.geo.synchronize()
    gmsh.model.mesh.generate(3)
    mesh = _elements_of(gmsh, [volume], 3, _TETRAHEDRON)
    gmsh.model.remove()
    return mesh


def _merged(node_mm: FloatArray) -> tuple[FloatArray, IntArray]:
    """Each position once, ``(N, 3)``, and the row of every given one there."""
    key = np.round(node_mm / _ON_PLANE).astype(np.int64)
    _, first, row = np.unique(key, axis=0, return_index=True, return_inverse=True)
    return node_mm[first], row.reshape(-1).astype(np.int64)


# ---- The whole mesh


def _assembled(
    tip: Fingertip,
    stack: _Stack,
    core: tuple[FloatArray, IntArray],
    bone: tuple[FloatArray, IntArray],
) -> TipMesh:
    """The mesh of both halves, of its parts' halves."""
    parts = [(stack.node_mm, stack.tet), core, bone]
    offset = np.cumsum([0, *(len(node_mm) for node_mm, _ in parts)])
    every_mm = _exact(tip, np.concatenate([node_mm for node_mm, _ in parts]))
    merged_mm, row = _merged(every_mm)
    tet = np.concatenate(
        [row[part + start] for (_, part), start in zip(parts, offset, strict=False)]
    )
    layer = np.concatenate(
        [
            stack.layer,
            np.full(len(core[1]), LAYERS.index("subcutaneous_tissue")),
            np.full(len(bone[1]), LAYERS.index("bone")),
        ]
    )
    inverted = _determinant(merged_mm[tet]) < 0
    tet[inverted] = tet[inverted][:, [1, 0, 2, 3]]
    quality = scaled_jacobian(merged_mm[tet])
    if not quality.min() > 0:
        worst = int(quality.argmin())
        x, y, z = merged_mm[tet[worst]].mean(axis=0)
        raise FingerError(
            f"an element at ({x:.2f}, {y:.2f}, {z:.2f}) mm is flat; another resolution may help"
        )
    stack_row = row[: len(stack.node_mm)]
    node_mm = merged_mm
    if tip.resolution.order == 2:
        node_mm, tet = _with_middles(tip, stack, stack_row, merged_mm, tet)
    count = len(stack.triangle)
    outer = np.arange(count)
    size = len(stack.capsule)
    nail_faces = outer[stack.on_nail]
    skin_faces = outer[~stack.on_nail]
    distance_mm = np.linalg.norm(stack.node_mm[stack.triangle].mean(axis=1), axis=1)
    pad_faces = skin_faces[distance_mm[skin_faces] <= tip.resolution.pad_radius_mm]
    # Both halves
    on_axis = node_mm[:, 0] == 0
    half = len(node_mm)
    image = np.where(on_axis, np.arange(half), half + np.cumsum(~on_axis) - 1)
    both_halves_mm = np.concatenate([node_mm, node_mm[~on_axis] * [-1.0, 1.0, 1.0]])
    mirrored = image[tet][:, _MIRRORED[: tet.shape[1]]]
    both_halves = np.concatenate([tet, mirrored])

    def both(elements: IntArray) -> IntArray:
        return np.concatenate([elements, elements + len(tet)])

    def nodes(rows: IntArray) -> IntArray:
        return np.unique(np.concatenate([rows, image[rows]]))

    face = list(FACE_NODES[: 3 * tip.resolution.order])
    in_bone = np.unique(tet[layer == LAYERS.index("bone")])
    fixed = np.union1d(in_bone, np.unique(tet[nail_faces][:, face]))
    end = np.flatnonzero(node_mm[:, 2] == -tip.outline.shaft_mm)
    margin_mm = _END_ELEMENTS * tip.resolution.far_mm
    below_skin = np.unique(stack.triangle[skin_faces])
    below_skin = below_skin[stack.node_mm[below_skin, 2] > margin_mm - tip.outline.shaft_mm]
    below_skin = below_skin[stack.nail_share[below_skin] == 0]
    depths = [0.0, *(level.depth_mm for level in tip.levels())]

    def at_depths(columns: IntArray) -> dict[str, IntArray]:
        return {
            name: nodes(stack_row[depths.index(site.depth_mm) * size + columns])
            for name, site in tip.afferents.items()
        }

    mesh = TipMesh(
        node_mm=both_halves_mm,
        tet=both_halves,
        layer=np.concatenate([layer, layer]),
        skin=both(skin_faces),
        nail=both(nail_faces),
        pad=both(pad_faces),
        fixed=nodes(fixed),
        end=nodes(end),
        afferents=at_depths(below_skin),
        pad_afferents=at_depths(np.intersect1d(below_skin, stack.triangle[pad_faces])),
    )
    if not mesh.corner_jacobian().min() > 0:
        raise FingerError("a curved edge folds an element; another resolution may help")
    return mesh


def _with_middles(
    tip: Fingertip, stack: _Stack, stack_row: IntArray, node_mm: FloatArray, tet: IntArray
) -> tuple[FloatArray, IntArray]:
    """Nodes and elements with nodes in the middle of edges, on curves in the layers."""
    edges = np.sort(np.concatenate([tet[:, list(edge)] for edge in TET_EDGES]), axis=1)
    edge, row = np.unique(edges, axis=0, return_inverse=True)
    middle_mm = node_mm[edge].mean(axis=1)
    to_stack = np.full(len(node_mm), -1)
    to_stack[stack_row] = np.arange(len(stack_row))
    in_stack = np.zeros(len(edge), dtype=bool)
    in_stack[np.unique(row.reshape(len(TET_EDGES), -1)[:, : len(stack.tet)])] = True
    middle_mm[in_stack] = stack.middles(to_stack[edge[in_stack]])
    middles = row.reshape(len(TET_EDGES), -1).T + len(node_mm)
    return np.concatenate([node_mm, _exact(tip, middle_mm)]), np.concatenate([tet, middles], axis=1)
