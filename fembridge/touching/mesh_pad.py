"""The pad of any mesh: what unit forces on its skin do to the skin and to points with afferents.

A map shows the skin from above: x across and z along the finger, y outwards; the middle of the
pad is at 0. Forces and displacements of contact are those along the inward normal of each node,
and friction drags along its two tangents.

A shape comes from above or from any other direction (`MeshPad.seen_from`). Along the direction
of the shape a node with the normal n carries ``f cos`` of its force f, and the shape is at the
node after ``gap cos`` along n, with cos between n and the direction. With forces along the shape
as unknowns, contact is that of a flat skin with the compliance ``C_ij / (cos_i cos_j)``.

Stress is known at points of some layers, and between them by a moving quadratic fit.
"""

import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fembridge.errors import UsageError
from fembridge.touching.compliance import DenseCompliance
from fembridge.touching.pad import Pad, SkinCells, SkinMargin, SkinNodes
from fembridge.touching.shape import Shape
from fembridge.typing import BoolArray, FloatArray, IntArray, SingleArray

if TYPE_CHECKING:
    from scipy.sparse import csr_array
    from scipy.spatial import cKDTree

# Skin that is steeper to a shape than this (cosine, 84 degrees) is not touched by it.
_LEAST_COSINE = 0.1
# Skin that is steeper than this (66 degrees) is not on the map.
_LEAST_MAP_COSINE = 0.4
# Points of a fit, and how far from one of them a fit is used, by the distance of points.
_FIT_POINTS, _FIT_DISTANCES = 24, 1.5
# With fewer points a fit is linear; a point itself counts this much more than its neighbours.
_LEAST_QUADRATIC, _NEAREST, _RIDGE = 15, 0.02, 1e-7
# Directions in which the points of a fit lie closer than this share of their spread do not count.
_FLAT_SHARE = 0.15
# Steps to the place of the skin over a point.
_FOOT_STEPS, _ON_SKIN_MM = 12, 1e-6
# A unit may be this share of its depth above or below the points with stress.
_DEPTH_SHARE = 0.1
# Triangles are sampled at so many places along an edge to find the first touch.
_SAMPLES = 8


@dataclass(frozen=True, slots=True)
class MeshSite:
    """Where the afferents of a class are: `layer`, and `depth_mm` below the skin at `x_mm`."""

    layer: str
    depth_mm: float
    x_mm: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """Direction from which a shape comes: `axes` ``(3, 3)`` are its x, outwards, and z.

    `middle_mm` ``(3,)`` is the point of the map's frame at the middle of the shape's plane;
    `tilt_deg` and `at_mm` are the arguments of `MeshPad.seen_from`.
    """

    axes: FloatArray
    middle_mm: FloatArray
    tilt_deg: tuple[float, float] = (0.0, 0.0)
    at_mm: tuple[float, float] = (0.0, 0.0)


_ABOVE = View(np.eye(3), np.zeros(3))


@dataclass(frozen=True, eq=False, repr=False)
class MeshPad(Pad):
    """Responses of the skin of any mesh to unit forces on it.

    `make_pad(base_deck=...)` computes one; `Pad.read` and `write` are its file.

    Parameters
    ----------
    name
        Name of the model.
    spacing_mm
        Median distance of neighbouring nodes of the skin in mm.
    node
        Numbers of the nodes of the skin that may touch, in the model, ``(N,)``.
    position_mm, normal
        Their positions in the frame of the map, and outward normals, ``(N, 3)``.
    area_mm2
        Skin that each node stands for in mm², ``(N,)``.
    triangles
        Triangles of the skin by rows of nodes, ``(F, 3)``.
    is_end
        Nodes at the end of the skin that may be touched, ``(N,)``.
    down_mm
        Displacement into the skin in mm, ``(3, N, N)``, of node i under 1 N on node j along its
        tangent across, into the skin, and along its tangent along the finger.
    point_mm
        Points with stress in the frame of the map, ``(P, 3)``.
    point_layer
        Layer of each point by its number in `layers`, ``(P,)``.
    point_depth_mm
        Depth of each point below the skin in mm, ``(P,)``.
    stress
        Stress at the points under these forces over `stress_scale_pa`, ``(3, 6, P, N)``.
    stress_scale_pa
        Largest stress in Pa of each direction and point, ``(3, 1, P, 1)``.
    layers
        Names of the layers.
    sites
        Sites of the afferents by class.
    outline_mm
        Outline of the model on the map: x and z in mm of both ends of each piece, ``(L, 4)``.
        Default: none.
    origin
        How the pad was computed. Default: nothing.
    source, sha256
        Name or path of its file, and the checksum. Default: empty, without a file.
    view, above
        Direction from which shapes come, and the pad for shapes from above. Default: from above.
    """

    name: str
    spacing_mm: float
    node: IntArray
    position_mm: FloatArray
    normal: FloatArray
    area_mm2: FloatArray
    triangles: IntArray
    is_end: BoolArray
    down_mm: SingleArray
    point_mm: FloatArray
    point_layer: IntArray
    point_depth_mm: FloatArray
    stress: NDArray[np.float16]
    stress_scale_pa: FloatArray
    layers: tuple[str, ...]
    sites: Mapping[str, MeshSite]
    outline_mm: FloatArray = field(default_factory=lambda: np.zeros((0, 4)))
    origin: Mapping[str, Any] = field(default_factory=dict)
    source: str = ""
    sha256: str = ""
    view: View = _ABOVE
    above: "MeshPad | None" = None

    def __repr__(self) -> str:
        return (
            f"MeshPad({self.name!r}, {self.skin_text}, stress at {len(self.point_mm)} points of "
            f"{', '.join(self.layers)})"
        )

    def write(self, path: "str | os.PathLike[str]") -> None:
        """Write the pad with its checksum; stress in half precision, rounded to 1 in 250.

        Parameters
        ----------
        path
            File in ``.npz``.

        Raises
        ------
        OutputError
            The file cannot be written.
        """
        from fembridge.touching.mesh_pad_file import write_mesh_pad

        write_mesh_pad(Path(path), self)

    def seen_from(self, tilt_deg: tuple[float, float], at_mm: tuple[float, float]) -> "MeshPad":
        """The pad for a shape from another direction, see `Pad`."""
        across, along = np.radians(tilt_deg)
        outward = np.array(
            [np.sin(across) * np.cos(along), np.cos(across) * np.cos(along), np.sin(along)]
        )
        right = np.array([1.0, 0.0, 0.0]) - outward[0] * outward
        right /= np.linalg.norm(right)
        axes = np.stack([right, outward, np.cross(right, outward)])
        middle_mm = self._surface.at(np.array([at_mm]))[0][0]
        return replace(self, view=View(axes, middle_mm, tilt_deg, at_mm), above=self.from_above)

    @property
    def pose(self) -> dict[str, list[float]]:
        """Direction and aim of shapes for a record; empty from above."""
        if self.above is None:
            return {}
        return {"tilt_deg": list(self.view.tilt_deg), "at_mm": list(self.view.at_mm)}

    @property
    def from_above(self) -> "MeshPad":
        """The pad for shapes from above."""
        return self if self.above is None else self.above

    def tilt_deg_at(self, at_mm: tuple[float, float]) -> tuple[float, float]:
        """Direction of the normal of the skin at a position on the map, as in `seen_from`.

        Parameters
        ----------
        at_mm
            Position on the map in mm.
        """
        x, y, z = self.normal_at(*(np.array([at]) for at in at_mm))[0].tolist()
        return math.degrees(math.atan2(x, y)), math.degrees(math.asin(z))

    # ---- The skin

    @property
    def skin_text(self) -> str:
        """Number and distance of the nodes that may touch."""
        return f"{self.node.size} nodes of skin about {self.spacing_mm:.2g} mm apart"

    @property
    def remedy_for_narrow(self) -> str:
        """A pad for narrower shapes, for a message."""
        return "a model with a finer mesh of the skin"

    @property
    def reach_mm(self) -> float:
        """How far from the middle, across the finger, skin may be touched."""
        return float(np.abs(self.position_mm[self._mapped, 0]).max())

    @property
    def half_length_mm(self) -> float:
        """How far from the middle, along the finger, skin may be touched."""
        return float(np.abs(self.position_mm[self._mapped, 2]).max())

    @property
    def limits(self) -> str:
        """The ends of the skin that may be touched, for a message."""
        return "the border of the skin of the model"

    @cached_property
    def _mapped(self) -> BoolArray:
        """Nodes that the map shows, ``(N,)``."""
        return np.asarray(self.normal[:, 1] > _LEAST_MAP_COSINE)

    def skin_nodes(self) -> "MeshNodes":
        """All nodes that a shape from this direction may touch."""
        cosine = self.normal @ self.view.axes[1]
        return MeshNodes(self, np.flatnonzero(cosine > _LEAST_COSINE))

    def nodes_from(self, arrays: Mapping[str, IntArray]) -> "MeshNodes":
        """Nodes of rows, see `Pad`."""
        row = arrays["node_row"]
        if row.size and not (row.min() >= 0 and row.max() < self.node.size):
            raise ValueError("nodes beyond the pad")
        return MeshNodes(self, row)

    def end_nodes(self, nodes: SkinNodes) -> Mapping[str, BoolArray]:
        """Nodes at the border of the skin, see `Pad`."""
        return {"the border": self.is_end[_rows(nodes)]}

    def first_touch_mm(self, shape: Shape) -> float:
        """How far `shape` is over the skin where it touches first, see `Pad`."""
        nodes = self.skin_nodes()
        inside = np.zeros(self.node.size, dtype=bool)
        inside[nodes.row] = True
        triangles = self.triangles[inside[self.triangles].all(axis=1)]
        gap = np.full(self.node.size, np.inf)
        gap[nodes.row] = nodes.gaps_mm(shape)
        if np.isfinite(gap).any():  # only around the node that touches first
            seen = (self.position_mm - self.view.middle_mm) @ self.view.axes.T
            away = np.hypot(*(seen[:, [0, 2]] - seen[gap.argmin(), [0, 2]]).T)
            triangles = triangles[(away[triangles] < 2 * self.spacing_mm).any(axis=1)]
        first, second = np.meshgrid(*2 * [np.arange(_SAMPLES + 1) / _SAMPLES])
        within = first + second <= 1 + 1e-9
        share = np.stack([first[within], second[within], 1 - first[within] - second[within]], -1)
        sampled = (share @ self.position_mm[triangles]).reshape(-1, 3)
        x_mm, height_mm, z_mm = self.view.axes @ (sampled - self.view.middle_mm).T
        least = float((shape.height_mm(x_mm, z_mm) - height_mm).min(initial=np.inf))
        least = min(least, float(gap.min()))
        if not np.isfinite(least):
            raise UsageError(f"{shape.name} is beside the skin of the pad", argument="at_mm")
        return least

    # ---- The map

    @cached_property
    def _surface(self) -> "MappedSkin":
        return MappedSkin(self.position_mm, self.normal)

    def normal_at(self, x_mm: FloatArray, z_mm: FloatArray) -> FloatArray:
        """Outward normal of the skin, ``(P, 3)``, see `Pad`."""
        return self._surface.at(np.stack([x_mm, z_mm], -1))[1]

    def outline(self) -> FloatArray:
        """Outline of the model on the map, see `Pad`."""
        return self.outline_mm

    # ---- Afferents

    @property
    def afferents(self) -> Mapping[str, MeshSite]:
        """Sites of the afferents by class."""
        return self.sites

    @property
    def mechanics(self) -> dict[str, str]:
        """Name of the model, and the checksum of its deck."""
        return {"name": self.name, "sha256": str(self.origin.get("deck_sha256", ""))}

    @property
    def model_table(self) -> dict[str, Any]:
        """Name of the model, and the checksum of its deck."""
        return dict(self.mechanics)

    def extent_mm(self) -> tuple[FloatArray, FloatArray, float, float]:
        """Skin for a population: arcs along the profile across the middle, see `Pad`."""
        x_mm, z_mm = np.abs(self._stress_map_mm).max(axis=0)
        across = np.linspace(0.0, float(x_mm), 65)
        height = self._surface.at(np.stack([across, np.zeros_like(across)], -1))[0][:, 1]
        arc_mm = np.append(0.0, np.cumsum(np.hypot(np.diff(across), np.diff(height))))
        return arc_mm, across, float(x_mm), float(z_mm)

    @cached_property
    def _stress_map_mm(self) -> FloatArray:
        """Positions on the map of the points with stress, ``(P, 2)``."""
        return self._surface.below(self.point_mm)[0]

    @cached_property
    def _trees(self) -> "dict[str, tuple[IntArray, cKDTree]]":
        """Of each layer: its points, and a tree of them."""
        from scipy.spatial import cKDTree

        by_layer = {
            name: np.flatnonzero(self.point_layer == number)
            for number, name in enumerate(self.layers)
        }
        return {name: (points, cKDTree(self.point_mm[points])) for name, points in by_layer.items()}

    def _tree(self, layer: str) -> "tuple[IntArray, cKDTree]":
        if layer not in self._trees:
            layers = ", ".join(self.layers)
            raise UsageError(f"the pad holds no stress in {layer}, but in {layers}")
        return self._trees[layer]

    def margins(self, x_mm: FloatArray, z_mm: FloatArray) -> Iterator[SkinMargin]:
        """Positions away from all points with stress."""
        from scipy.spatial import cKDTree

        away_mm, _ = cKDTree(self._stress_map_mm).query(np.stack([x_mm, z_mm], -1))
        most_mm = _FIT_DISTANCES * self.spacing_mm
        yield SkinMargin(
            np.asarray(away_mm > most_mm),
            lambda row: (
                f"at x = {x_mm[row]:g} mm, z = {z_mm[row]:g} mm is {away_mm[row]:.2g} mm beside "
                "the points with stress"
            ),
        )

    def clipped(self, x_mm: FloatArray, z_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The position of the nearest point with stress, if it is far away, see `Pad`."""
        from scipy.spatial import cKDTree

        tree = cKDTree(self._stress_map_mm)
        at = np.stack([x_mm, z_mm], -1)
        away_mm, nearest = tree.query(at)
        far = away_mm > self.spacing_mm
        at[far] = self._stress_map_mm[nearest[far]]
        return at[:, 0], at[:, 1]

    def depth_range_mm(
        self, layer: str, x_mm: FloatArray, z_mm: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Least and largest depth of the points of a layer around each position, see `Pad`."""
        from scipy.spatial import cKDTree

        points, _ = self._tree(layer)
        tree = cKDTree(self._stress_map_mm[points])
        _, near = tree.query(np.stack([x_mm, z_mm], -1), k=min(_FIT_POINTS, points.size))
        depth_mm = self.point_depth_mm[points][near.reshape(x_mm.size, -1)]
        return (1 - _DEPTH_SHARE) * depth_mm.min(axis=1), (1 + _DEPTH_SHARE) * depth_mm.max(axis=1)

    def columns_per_place(self, nodes: SkinNodes) -> int:
        """Numbers of `influence_pa` for each place and component, see `Pad`."""
        return 4 * _rows(nodes).size

    def influence_pa(
        self,
        nodes: SkinNodes,
        layer: NDArray[np.str_],
        x_mm: FloatArray,
        z_mm: FloatArray,
        depth_mm: FloatArray,
        drag: tuple[float, float] = (0.0, 0.0),
    ) -> SingleArray:
        """Stress ``(6, place, node)`` in Pa under unit forces, see `Pad`."""
        row = _rows(nodes)
        point_mm, outward = self._surface.at(np.stack([x_mm, z_mm], -1))
        places_mm = point_mm - depth_mm[:, None] * outward
        weights = self._weights(layer, places_mm)
        used = np.unique(weights.indices)
        shares = self._shares(row, drag)
        table = np.zeros((6, used.size, row.size), dtype=np.float32)
        for direction, share in enumerate(shares):
            if share.any():
                scale = self.stress_scale_pa[direction, :, used].astype(np.float32)
                stress = self.stress[direction][:, used][:, :, row].astype(np.float32)
                table += scale.reshape(1, -1, 1) * stress * share.astype(np.float32)
        few = weights[:, used].astype(np.float32)
        influence: SingleArray = np.stack([few @ component for component in table])
        return influence

    def _shares(self, row: IntArray, drag: tuple[float, float]) -> FloatArray:
        """Force along the tangent across, into the skin, and along, under 1 N of the shape."""
        axes, normal = self.view.axes, self.normal[row]
        dragged = drag[0] * axes[0] + drag[1] * axes[2]
        across, along = tangents(normal)
        shares = np.stack([across @ dragged, np.ones(row.size), along @ dragged])
        shares /= normal @ axes[1]
        return shares

    def _weights(self, layer: NDArray[np.str_], places_mm: FloatArray) -> "csr_array":
        """Weights ``(place, P)`` of the points around each place."""
        from scipy.sparse import csr_array

        entries = []
        for name in np.unique(layer):
            points, tree = self._tree(str(name))
            chosen = np.flatnonzero(layer == name)
            near, weight = fit_weights(tree, places_mm[chosen])
            entries.append((np.repeat(chosen, near.shape[1]), points[near].ravel(), weight.ravel()))
        place, point, weight = (np.concatenate([entry[k] for entry in entries]) for k in range(3))
        return csr_array((weight, (place, point)), shape=(len(places_mm), len(self.point_mm)))


@dataclass(frozen=True, slots=True, eq=False)
class MeshNodes(SkinNodes):
    """Nodes of the skin of a mesh by `row` ``(n,)`` of the pad."""

    pad: MeshPad
    row: IntArray

    @property
    def size(self) -> int:
        """Number of nodes."""
        return self.row.size

    @property
    def x_mm(self) -> FloatArray:
        """Positions across the finger in mm, ``(n,)``."""
        x_mm: FloatArray = self.pad.position_mm[self.row, 0]
        return x_mm

    @property
    def z_mm(self) -> FloatArray:
        """Positions along the finger in mm, ``(n,)``."""
        z_mm: FloatArray = self.pad.position_mm[self.row, 2]
        return z_mm

    @property
    def _seen(self) -> FloatArray:
        view = self.pad.view
        seen: FloatArray = view.axes @ (self.pad.position_mm[self.row] - view.middle_mm).T
        return seen

    @property
    def seen_mm(self) -> tuple[FloatArray, FloatArray]:
        """Positions in the plane of the shape in mm, two ``(n,)``."""
        x_mm, _, z_mm = self._seen
        return x_mm, z_mm

    @property
    def height_mm(self) -> FloatArray:
        """Heights towards the shape in mm, ``(n,)``."""
        height_mm: FloatArray = self._seen[1]
        return height_mm

    @property
    def area_mm2(self) -> FloatArray:
        """Skin that each node stands for in mm², as the shape sees it, ``(n,)``."""
        area: FloatArray = self.pad.area_mm2[self.row] * self._cosine
        return area

    @property
    def _cosine(self) -> FloatArray:
        """Cosine between the normals and the direction of the shape, ``(n,)``."""
        cosine: FloatArray = self.pad.normal[self.row] @ self.pad.view.axes[1]
        return cosine

    def subset(self, rows: BoolArray | IntArray) -> "MeshNodes":
        """Nodes of a mask ``(n,)`` or of numbers from 0."""
        return MeshNodes(self.pad, self.row[rows])

    def compliance(self, drag: tuple[float, float] = (0.0, 0.0)) -> DenseCompliance:
        """Displacement towards the skin under forces of the shape, see `SkinNodes`."""
        shares = self.pad._shares(self.row, drag)
        at = np.ix_(self.row, self.row)
        matrix = np.zeros((self.size, self.size))
        for table, share in zip(self.pad.down_mm, shares, strict=True):
            if share.any():
                matrix += table[at] * share
        matrix /= self._cosine[:, None]
        return DenseCompliance(matrix)

    def cells(self) -> SkinCells:
        """Triangles of the skin that the map shows, see `SkinNodes`."""
        pad = self.pad
        shown = pad.triangles[pad._mapped[pad.triangles].all(axis=1)]

        def values(pressure: FloatArray) -> FloatArray:
            at_nodes = np.zeros(pad.node.size)
            at_nodes[self.row] = pressure
            mean = at_nodes[shown].mean(axis=1)
            return np.where(mean > 0, mean, np.nan)

        return SkinCells(pad.position_mm[:, 0], pad.position_mm[:, 2], shown, values)

    def to_arrays(self) -> dict[str, IntArray]:
        """Rows of the nodes."""
        return {"node_row": self.row}


class MappedSkin:
    """Skin between the nodes that the map shows.

    Parameters
    ----------
    position_mm, normal
        Positions of nodes in the frame of the map, and outward normals, ``(N, 3)``.
    """

    def __init__(self, position_mm: FloatArray, normal: FloatArray) -> None:
        from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator

        shown = normal[:, 1] > _LEAST_MAP_COSINE
        at = position_mm[shown][:, [0, 2]]
        values = np.column_stack([position_mm[shown, 1], normal[shown]])
        self._inside = LinearNDInterpolator(at, values)
        self._beside = NearestNDInterpolator(at, values)

    def at(self, places_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Points of the skin and outward normals ``(P, 3)`` at places on the map ``(P, 2)``."""
        found: FloatArray = self._inside(places_mm)
        outside = np.isnan(found[:, 0])
        if outside.any():
            found[outside] = self._beside(places_mm[outside])
        height_mm, normal = found[:, 0], found[:, 1:]
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        return np.stack([places_mm[:, 0], height_mm, places_mm[:, 1]], -1), normal

    def below(self, points_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Places on the map ``(P, 2)`` under which points ``(P, 3)`` lie, and how deep in mm."""
        places_mm = points_mm[:, [0, 2]].copy()
        for _ in range(_FOOT_STEPS):
            skin_mm, normal = self.at(places_mm)
            depth_mm = np.einsum("pi,pi->p", skin_mm - points_mm, normal)
            places_mm += (points_mm - (skin_mm - depth_mm[:, None] * normal))[:, [0, 2]]
        return places_mm, depth_mm

    def places_below(self, points_mm: FloatArray, share: float) -> tuple[BoolArray, FloatArray]:
        """Whether points ``(P, 3)`` lie below the skin that the map shows, and how deep in mm.

        Parameters
        ----------
        points_mm
            Points in the frame of the map.
        share
            Largest distance of the foot's normal from the point, by its depth.
        """
        places_mm, depth_mm = self.below(points_mm)
        skin_mm, normal = self.at(places_mm)
        away_mm = np.linalg.norm(skin_mm - depth_mm[:, None] * normal - points_mm, axis=1)
        inside = ~np.isnan(self._inside(places_mm)[:, 0])
        return np.asarray(inside & (away_mm <= share * np.abs(depth_mm) + _ON_SKIN_MM)), depth_mm


def _rows(nodes: SkinNodes) -> IntArray:
    """Rows of `nodes`, which are those of a mesh."""
    if not isinstance(nodes, MeshNodes):
        raise TypeError(f"{type(nodes).__name__}, expected nodes of a mesh")
    return nodes.row


def tangents(normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit tangents across and along the finger ``(n, 3)`` of a skin with this outward normal."""
    across = np.array([1.0, 0.0, 0.0]) - normal[:, :1] * normal
    across /= np.linalg.norm(across, axis=1)[:, None]
    return across, np.cross(across, normal)


def fit_weights(
    tree: "cKDTree", places: FloatArray, points: int = _FIT_POINTS
) -> tuple[IntArray, FloatArray]:
    """Points around each place and their weights ``(P, k)``: a moving quadratic fit.

    Near points count more. Where the points lie on a surface or line, values are the same across
    it. Of few points the fit is linear.

    Parameters
    ----------
    tree
        Tree of the points.
    places
        Places, ``(P, 3)``.
    points
        Largest number of points of a fit.
    """
    count = min(points, tree.n)
    away, near = tree.query(places, k=count)
    away, near = away.reshape(len(places), count), near.reshape(len(places), count)
    reach = np.maximum(1.1 * away[:, -1:], 1e-9)
    apart = np.median(away, axis=1, keepdims=True) + 1e-12
    importance = (1 - away / reach) ** 2 / ((away / apart) ** 2 + _NEAREST)
    importance /= importance.sum(axis=1)[:, None]
    offset = (tree.data[near] - places[:, None]) / reach[..., None]
    centred = offset - offset.mean(axis=1)[:, None]
    spread, axes = np.linalg.eigh(np.einsum("pki,pkj->pij", centred, centred) / count)
    wide = spread > _FLAT_SHARE**2 * spread[:, -1:]
    along = np.einsum("pki,pij->pkj", offset, axes) * wide[:, None]
    first, second = np.triu_indices(3)
    squares = along[..., first] * along[..., second]
    if count < _LEAST_QUADRATIC:
        squares = squares[..., :0]
    terms = np.concatenate([np.ones((*away.shape, 1)), along, squares], axis=2)
    moments = np.einsum("pk,pki,pkj->pij", importance, terms, terms, optimize=True)
    moments += _RIDGE * np.eye(terms.shape[2])
    value = np.zeros((len(places), terms.shape[2], 1))
    value[:, 0] = 1.0
    weight = importance * np.einsum("pki,pi->pk", terms, np.linalg.solve(moments, value)[..., 0])
    return near, weight / weight.sum(axis=1)[:, None]
