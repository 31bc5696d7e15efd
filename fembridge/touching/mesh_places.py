"""Where the pad of a mesh has nodes of skin and points with stress, whoever solves its unit forces.

The skin is laid on a map: x across and z along the finger, y outwards. Points lie at a depth below
the skin, or at nodes of the model. Stress there is a moving quadratic fit to samples of stress at
the elements of one layer: nothing is averaged over two layers.
"""

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from decks.inp import normalized_name
from decks.solid_model import Skin, SolidModel
from fembridge.errors import DeckError, UsageError
from fembridge.touching.mesh_pad import MappedSkin, MeshPad, MeshSite, fit_weights
from fembridge.touching.pad_request import SiteRequest, SkinMap
from fembridge.typing import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from scipy.sparse import csr_array

_LOGGER = logging.getLogger(__name__)

# Samples around a place whose stress counts, of linear tetrahedra, in which stress is constant and
# jumps more, and of others; how far from one of them a place has stress, by their distance.
_FIT_OF_TETRAHEDRA, _FIT_SAMPLES, _FIT_DISTANCES = 64, 32, 1.5
# Points of a layer lie below nodes of the skin that are at least so far apart, by the spacing.
_POINT_DISTANCES = 0.9
# Points are thinned for a file of this size; bytes of a stored number of stress, and of
# displacement, as measured.
_MOST_BYTES, _STRESS_BYTES, _DISPLACEMENT_BYTES = 95e6, 1.27, 1.9
_LEAST_POINTS = 200
# Skin that is steeper than this (66 degrees) is not on the map.
_LEAST_MAP_COSINE = 0.4
# A node of a set lies below the skin if the way to its foot ends at it, to this share of the depth.
_FOOT_SHARE = 0.05
# A node set of one node at the middle of the map.
_APEX_SET = "APEX"
# Faces that are steeper than this (cosine, nearly upright) do not look outwards.
_UPRIGHT_COSINE = 1e-6

Sampled = TypeVar("Sampled")


# ---- The skin


@dataclass(frozen=True, eq=False)
class PadSkin:
    """Nodes that may touch: `row` in the model, and their skin in the frame of the map.

    `axes` ``(3, 3)`` are across, outwards and along in the model; the map begins at `middle_mm`.
    `outline_mm` ``(L, 4)`` is the outline of the whole model on the map.
    """

    row: IntArray
    axes: FloatArray
    middle_mm: FloatArray
    position_mm: FloatArray
    normal: FloatArray
    area_mm2: FloatArray
    triangles: IntArray
    outline_mm: FloatArray

    def to_map(self, position_mm: FloatArray) -> FloatArray:
        """Positions ``(P, 3)`` in the axes of the model, in the frame of the map."""
        mapped: FloatArray = (position_mm - self.middle_mm) @ self.axes.T
        return mapped

    def to_model(self, position_mm: FloatArray) -> FloatArray:
        """Positions ``(P, 3)`` in the frame of the map, in the axes of the model."""
        back: FloatArray = position_mm @ self.axes + self.middle_mm
        return back

    @property
    def spacing_mm(self) -> float:
        """Median length of the edges of triangles in mm."""
        corner = self.position_mm[self.triangles]
        return float(np.median(np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2)))

    @property
    def is_end(self) -> BoolArray:
        """Nodes on an edge of one triangle alone, ``(n,)``."""
        return Skin(self.row, self.triangles).border


def pad_skin(
    model: SolidModel, position_mm: FloatArray, free: BoolArray, skin: Skin, skin_map: SkinMap
) -> PadSkin:
    """Nodes of the skin that may touch, in the frame of the map.

    Parameters
    ----------
    model
        The model.
    position_mm
        Its nodes in the state about which the pad is linear, ``(N, 3)``.
    free
        Nodes of `skin` that may be touched, ``(S,)``.
    skin
        The surface.
    skin_map
        Middle, directions and reach of the map.

    Raises
    ------
    DeckError, UsageError
        No node may touch; a direction along the normal; a closed skin, which has no mean normal.
    """
    skin_mm = position_mm[skin.rows]
    corner = skin_mm[skin.triangles]
    twice = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal, area_mm2 = np.zeros_like(skin_mm), np.zeros(len(skin_mm))
    for place in range(3):
        np.add.at(normal, skin.triangles[:, place], twice)
        np.add.at(area_mm2, skin.triangles[:, place], np.linalg.norm(twice, axis=1) / 6)
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    apex = _apex(model, skin_map)
    if apex is not None and skin_map.outward is None and apex in skin.rows:
        x, y, z = normal[np.searchsorted(skin.rows, apex)].tolist()
        skin_map = replace(skin_map, outward=(x, y, z))
    axes = _axes(skin_mm, area_mm2, normal, skin_map)
    if apex is None:
        mean_mm = area_mm2 @ skin_mm / area_mm2.sum()
        offset = skin_mm - mean_mm
        aside_mm = np.linalg.norm(offset - (offset @ axes[1])[:, None] * axes[1], axis=1)
        above = normal @ axes[1] > 0
        middle_mm = mean_mm + axes[1] * float(
            offset[np.where(above, aside_mm, np.inf).argmin()] @ axes[1]
        )
    else:
        middle_mm = position_mm[apex]
    mapped = (skin_mm - middle_mm) @ axes.T
    near = np.linalg.norm(mapped, axis=1) <= (skin_map.reach_mm or np.inf)
    selected: BoolArray = np.asarray(free & near)
    number = np.cumsum(selected) - 1
    triangles = number[skin.triangles[selected[skin.triangles].all(axis=1)]]
    if not len(triangles):
        problem = "no triangle of the skin has three nodes that may touch: a larger reach_mm?"
        raise DeckError(problem, argument="skin")
    return PadSkin(
        row=skin.rows[selected],
        axes=axes,
        middle_mm=middle_mm,
        position_mm=mapped[selected],
        normal=(normal @ axes.T)[selected],
        area_mm2=area_mm2[selected],
        triangles=triangles,
        outline_mm=_outline(model.whole_skin(), (position_mm - middle_mm) @ axes.T),
    )


def _outline(whole: Skin, mapped_mm: FloatArray) -> FloatArray:
    """Edges between faces that look outwards and others, ``(L, 4)``: x, z of both ends."""
    corner = mapped_mm[whole.rows][whole.triangles]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    length = np.maximum(np.linalg.norm(normal, axis=1), 1e-300)
    outwards = normal[:, 1] > _UPRIGHT_COSINE * length
    edges = np.concatenate(
        [whole.triangles[outwards][:, pair] for pair in ((0, 1), (1, 2), (2, 0))]
    )
    edges.sort(axis=1)
    single, count = np.unique(edges, axis=0, return_counts=True)
    ends_mm = mapped_mm[whole.rows[single[count == 1]]]
    outline: FloatArray = ends_mm[:, :, [0, 2]].reshape(-1, 4)
    return outline


def _axes(
    position_mm: FloatArray, area_mm2: FloatArray, normal: FloatArray, skin_map: SkinMap
) -> FloatArray:
    """Axes of the map ``(3, 3)`` in the model: across, outwards, along."""
    outward = np.array(skin_map.outward or area_mm2 @ normal, dtype=np.float64)
    if not np.linalg.norm(outward) > 1e-6 * area_mm2.sum() ** (skin_map.outward is None):
        raise UsageError(
            "is missing: the skin is closed, it has no mean normal", argument="outward"
        )
    outward /= np.linalg.norm(outward)
    if skin_map.along is not None:
        along = np.array(skin_map.along, dtype=np.float64)
    else:
        offset = position_mm - area_mm2 @ position_mm / area_mm2.sum()
        offset -= (offset @ outward)[:, None] * outward
        spread, directions = np.linalg.eigh(offset.T * area_mm2 @ offset)
        along = directions[:, -1]
        if spread[-1] < 1.1 * spread[-2]:  # as long as wide: an axis of the model
            along = np.eye(3)[np.abs(outward).argmin() if abs(outward[2]) > 0.9 else 2]
        along = along * np.sign(along[np.abs(along).argmax()])
    along = along - (along @ outward) * outward
    if not np.linalg.norm(along) > 1e-6:
        raise UsageError("points out of the skin", argument="along", found=skin_map.along)
    along /= np.linalg.norm(along)
    return np.stack([np.cross(outward, along), outward, along])


def _apex(model: SolidModel, skin_map: SkinMap) -> int | None:
    """Row of the node at the middle of the map: of `skin_map`, or of the node set APEX."""
    named = model.node_sets.get(_APEX_SET, np.zeros(0, dtype=np.int64))
    node = int(named[0]) if skin_map.apex is None and named.size == 1 else skin_map.apex
    if node is None:
        return None
    rows = model.rows_of(np.array([node]))
    if not rows.size:
        raise DeckError(f"no *NODE of the deck defines node {node}", argument="apex", found=node)
    return int(rows[0])


# ---- Points with stress


@dataclass(frozen=True, eq=False)
class StressPoints(Generic[Sampled]):
    """Points with stress ``(P,)`` in the model, and how it follows from samples of each layer.

    `samples` has for each request the weights ``(points, samples)`` and what was sampled.
    """

    position_mm: FloatArray
    depth_mm: FloatArray
    layer: IntArray
    layers: tuple[str, ...]
    sites: dict[str, MeshSite]
    samples: "tuple[tuple[csr_array, Sampled], ...]"


def stress_points(
    model: SolidModel,
    position_mm: FloatArray,
    skin: PadSkin,
    afferents: Mapping[str, SiteRequest],
    sample: Callable[[IntArray], tuple[FloatArray, Sampled]],
) -> StressPoints[Sampled]:
    """Points of all classes; two classes at the same depth of a layer share them.

    Parameters
    ----------
    model
        The model.
    position_mm
        Its nodes in the state about which the pad is linear, ``(N, 3)``.
    skin
        Nodes that may touch.
    afferents
        Request of each class.
    sample
        Positions in mm at which the stress of elements is known, ``(M, 3)``, and anything about
        them.

    Raises
    ------
    DeckError, UsageError
        A set that the deck does not have, nodes in two layers, or no element at a depth.
    """
    from scipy.sparse import csr_array
    from scipy.spatial import cKDTree

    layers: list[str] = []
    sites: dict[str, MeshSite] = {}
    site_of: dict[SiteRequest, MeshSite] = {}
    positions, depths, layer, samples = [], [], [], []
    left_bytes = _MOST_BYTES - _DISPLACEMENT_BYTES * 3 * skin.row.size**2
    requests = len(set(afferents.values()))
    share = left_bytes / (_STRESS_BYTES * 3 * 6 * skin.row.size * requests)
    for afferent, request in afferents.items():
        if request in site_of:
            sites[afferent] = site_of[request]
            continue
        elements, name, place_mm, depth_mm = _places(model, position_mm, skin, request, share)
        middle_mm, sampled = sample(elements)
        tree = cKDTree(middle_mm)
        apart_mm = float(np.median(tree.query(middle_mm, k=2)[0][:, 1])) if tree.n > 1 else 1.0
        # The size of an element, not only the distance across a thin layer.
        away_mm, _ = tree.query(place_mm)
        inside = away_mm <= _FIT_DISTANCES * max(apart_mm, skin.spacing_mm)
        if not inside.any():
            raise UsageError(
                f"{request.set_name or name} has no element at a depth of {request.depth_mm:g} mm",
                argument="afferents",
                found=afferent,
            )
        place_mm, depth_mm = place_mm[inside], depth_mm[inside]
        near, weight = fit_weights(tree, place_mm, fit_size(model, elements))
        row = np.repeat(np.arange(len(near)), near.shape[1])
        weights = csr_array((weight.ravel(), (row, near.ravel())), shape=(len(near), tree.n))
        samples.append((weights, sampled))
        if name not in layers:
            layers.append(name)
        positions.append(place_mm)
        depths.append(depth_mm)
        layer.append(np.full(len(depth_mm), layers.index(name)))
        site_of[request] = sites[afferent] = MeshSite(name, float(np.median(depth_mm)))
    return StressPoints(
        np.concatenate(positions),
        np.concatenate(depths),
        np.concatenate(layer),
        tuple(layers),
        sites,
        tuple(samples),
    )


def fit_size(model: SolidModel, elements: IntArray) -> int:
    """Number of samples of a fit to the stress of `elements`."""
    for block in model.elements:
        if block.kind == "tet4" and np.isin(block.number, elements).any():
            return _FIT_OF_TETRAHEDRA
    return _FIT_SAMPLES


def _places(
    model: SolidModel,
    model_mm: FloatArray,
    skin: PadSkin,
    request: SiteRequest,
    most: float,
) -> tuple[IntArray, str, FloatArray, FloatArray]:
    """Elements of the layer, its name, positions of points in the model, and their depths."""
    name = normalized_name(request.set_name)
    if request.depth_mm is None:
        if name not in model.node_sets:
            available = ", ".join(model.node_sets) or "none"
            problem = f"no node set {request.set_name!r}; the deck has {available}"
            raise DeckError(problem, argument="afferents", found=request.set_name)
        rows = model.rows_of(model.node_sets[name])
        mapped = MappedSkin(skin.position_mm, skin.normal)
        below, depth_mm = mapped.places_below(skin.to_map(model_mm[rows]), _FOOT_SHARE)
        if not below.any():
            problem = f"no node of {request.set_name} lies below the skin that may be touched"
            raise DeckError(problem, argument="afferents", found=request.set_name)
        if not below.all():
            _LOGGER.info(
                f"{request.set_name}: {(~below).sum()} of {rows.size} nodes are not below the skin "
                "that may be touched, or below its steep part: left out"
            )
        rows, depth_mm = rows[below], np.maximum(depth_mm[below], 0.0)
        return _section_of_nodes(model, rows), name, model_mm[rows], depth_mm
    facing = np.flatnonzero(skin.normal[:, 1] > _LEAST_MAP_COSINE)
    selected = _thinned(
        skin.position_mm[facing][:, [0, 2]], skin.spacing_mm, max(int(most), _LEAST_POINTS)
    )
    facing = facing[selected]
    position_mm = skin.to_model(skin.position_mm[facing] - request.depth_mm * skin.normal[facing])
    depth_mm = np.full(facing.size, request.depth_mm)
    if name:
        if name not in model.element_sets:
            available = ", ".join(model.element_sets) or "none"
            problem = f"no element set {request.set_name!r}; the deck has {available}"
            raise DeckError(problem, argument="afferents", found=request.set_name)
        return model.element_sets[name], name, position_mm, depth_mm
    below = position_mm[np.linalg.norm(skin.position_mm[facing], axis=1).argmin()]
    nearest = min(
        (float(away.min()), int(block.number[away.argmin()]))
        for block in model.elements
        for away in [np.linalg.norm(model_mm[block.rows].mean(axis=1) - below, axis=1)]
    )
    for section in model.sections:
        if nearest[1] in section.elements:
            return section.elements, section.set_name, position_mm, depth_mm
    raise DeckError(f"element {nearest[1]} has no *SOLID SECTION")


def _section_of_nodes(model: SolidModel, rows: IntArray) -> IntArray:
    """Elements of the one section in which nodes lie."""
    inside = np.zeros(model.node.size, dtype=bool)
    inside[rows] = True
    around = np.concatenate(
        [block.number[inside[block.rows].any(axis=1)] for block in model.elements]
    )
    sections = [s for s in model.sections if np.isin(around, s.elements).any()]
    if len(sections) != 1:
        names = ", ".join(section.set_name for section in sections) or "no section"
        problem = f"nodes of the afferents lie in {names}: expected one layer, and none at its edge"
        raise DeckError(problem, argument="afferents")
    return sections[0].elements


def _thinned(places: FloatArray, spacing_mm: float, most: int) -> IntArray:
    """Rows of `places` ``(P, 2)`` that are apart by the spacing, or by more to be `most`."""
    from scipy.spatial import cKDTree

    step_mm = _POINT_DISTANCES * spacing_mm
    order = np.argsort(np.linalg.norm(places, axis=1), kind="stable")  # the middle first
    tree = cKDTree(places)
    while True:
        left = np.ones(len(places), dtype=bool)
        selected = []
        for row in order.tolist():
            if left[row]:
                selected.append(row)
                left[tree.query_ball_point(places[row], step_mm)] = False
        if len(selected) <= most:
            return np.array(selected)
        step_mm *= 1.1


# ---- The pad


def pad_of_responses(
    name: str,
    model: SolidModel,
    skin: PadSkin,
    points: StressPoints[Any],
    down_mm: NDArray[np.floating[Any]],
    stress_pa: NDArray[np.floating[Any]],
    origin: Mapping[str, Any],
) -> MeshPad:
    """The pad of responses to 1 N on each node: across, into the skin, along; node by node.

    Parameters
    ----------
    name, origin
        Name of the model, and how the pad was computed.
    model, skin, points
        The model, nodes that may touch, and points with stress.
    down_mm
        Displacement of the nodes into the skin in mm, ``(3 N, N)``, a row a force.
    stress_pa
        Stress at the points in Pa and the axes of the map, ``(3 N, 6 P)``.
    """
    nodes, count = skin.row.size, len(points.depth_mm)
    by_direction = stress_pa.reshape(nodes, 3, count, 6).transpose(1, 3, 2, 0)
    scale_pa = np.empty((3, 1, count, 1))
    stress = np.empty(by_direction.shape, dtype=np.float16)
    for direction, table in enumerate(by_direction):  # one after the other for less memory
        largest = np.maximum(np.abs(table).max(axis=(0, 2)), 1e-9)
        scale_pa[direction, 0, :, 0] = largest
        stress[direction] = table / largest[:, None]
    return MeshPad(
        name=name,
        spacing_mm=skin.spacing_mm,
        node=model.node[skin.row],
        position_mm=skin.position_mm,
        normal=skin.normal,
        area_mm2=skin.area_mm2,
        triangles=skin.triangles,
        outline_mm=skin.outline_mm,
        is_end=skin.is_end,
        down_mm=np.ascontiguousarray(
            down_mm.reshape(nodes, 3, nodes).transpose(1, 2, 0), dtype=np.float32
        ),
        point_mm=skin.to_map(points.position_mm),
        point_layer=points.layer,
        point_depth_mm=points.depth_mm,
        stress=stress,
        stress_scale_pa=scale_pa,
        layers=points.layers,
        sites=points.sites,
        origin={
            **origin,
            "unit_forces": 3 * nodes,
            "apex_mm": skin.middle_mm.tolist(),
            "outward": skin.axes[1].tolist(),
            "along": skin.axes[2].tolist(),
        },
    )
