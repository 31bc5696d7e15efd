"""The pad of any mesh: stiffness by CalculiX, unit forces on the skin, stress of each element.

CalculiX writes the stiffness matrix of the user's model, undeformed or about the state after some
of its steps, and solves three unit forces itself. The matrix is factorised once
(`fembridge.solver.factorisation`); displacements under those three forces must agree with
CalculiX', and then all forces are solved, some at a time. What was solved is kept in the folder of
the run, so that an interrupted pad goes on there.

Stress is that at the points of elements where it is most accurate, by the law of their material
about the state (`decks.material_law`), and between them a moving quadratic fit within a layer:
nothing is averaged over two layers.
"""

import hashlib
import logging
import threading
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from decks.dialects import JOB
from decks.inp import folder_resolver, normalized_name, read_inp
from decks.material_law import STRESS_PAIRS, Law, read_law, stress_change
from decks.perturbation import LinearState, linear_state, stiffness_deck, unit_force_deck
from decks.solid_model import CORNERS, EDGES, Skin, SolidModel, read_solid_model
from fembridge.errors import DeckError, ResponseError, ResultError, UsageError
from fembridge.host.process import signals_as_exits
from fembridge.host.store import MAX_DECK_BYTES, make_folder, read_bytes, replacing
from fembridge.io.run_folder import SOLVER_FILE, RunFolder
from fembridge.results import read_fields
from fembridge.results.fields import rows_of
from fembridge.solver.ccx import solve_once
from fembridge.solver.factorisation import Factors
from fembridge.solver.settings import Solver
from fembridge.solver.verdict import MATRIX_SUFFIX
from fembridge.touching.make_pad import SiteRequest, SkinMap
from fembridge.touching.mesh_pad import MappedSkin, MeshPad, MeshSite, fit_weights, tangents
from fembridge.typing import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from scipy.sparse import csr_array

_LOGGER = logging.getLogger(__name__)

# Displacements under unit forces agree with CalculiX' to this share of the largest.
AGREEMENT = 1e-6
# Unit forces that are solved at once.
_FORCES_AT_ONCE = 96
# Points of elements around a place whose stress counts; how far from one of them a place has
# stress, by their distance.
_FIT_ELEMENTS, _FIT_DISTANCES = 32, 1.5
# Points of a layer lie below nodes of the skin that are at least so far apart, by the spacing.
_POINT_DISTANCES = 0.9
# Points are thinned for a file of this size; bytes of a stored number of stress, and of
# displacement, as measured.
_MOST_BYTES, _STRESS_BYTES, _DISPLACEMENT_BYTES = 95e6, 1.5, 3.7
_LEAST_POINTS = 200
# Skin that is steeper than this (66 degrees) is not on the map.
_LEAST_MAP_COSINE = 0.4
_PROGRESS_S = 10.0
_AXES = 3
# Cards of a material, after which another part of the deck begins.
_OF_A_MATERIAL = (
    "CONDUCTIVITY", "CREEP", "DAMPING", "DENSITY", "DEPVAR", "ELASTIC", "EXPANSION",
    "HYPERELASTIC", "HYPERFOAM", "PLASTIC", "SPECIFICHEAT", "USERMATERIAL", "VISCOELASTIC",
)  # fmt: skip


class _LinearModel:
    """A model about a state: its stiffness, its nodes as they are there, and its sections.

    `position_mm` ``(N, 3)`` in the model's axes; `unknown` ``(N, 3)`` numbers the displacements
    that are free, -1 for others.
    """

    def __init__(self, model: SolidModel, state: LinearState, run: RunFolder) -> None:
        from scipy.sparse import coo_array

        self.model, self.units = model, model.units
        self.moved = np.zeros_like(model.position)
        if state.steps:
            *_, last = read_fields(run.results, "DISP")
            at = rows_of(model.node, last.nodes)
            self.moved[at >= 0] = last.values[at[at >= 0], :_AXES]
        self.position_mm = (model.position + self.moved) * self.units.length_mm
        freedoms = (run.folder / f"{JOB}.dof").read_text(encoding="ascii").split()
        node, axis = np.array([text.split(".") for text in freedoms], dtype=np.int64).T
        entries = np.fromfile(run.folder / f"{JOB}{MATRIX_SUFFIX}", sep=" ").reshape(-1, 3)
        order = np.argsort(node, kind="stable")  # unknowns of a node in a row
        rank = np.argsort(order)
        row, column = rank[entries[:, :2].astype(np.int64) - 1].T
        upper = coo_array((entries[:, 2], (row, column)), shape=(node.size, node.size)).tocsr()
        diagonal = row == column
        lower = coo_array(
            (entries[~diagonal, 2], (column[~diagonal], row[~diagonal])), shape=upper.shape
        ).tocsr()
        self.matrix: csr_array = upper + lower
        self.node_row = np.searchsorted(model.node, node[order])
        is_of_model = model.node[np.minimum(self.node_row, model.node.size - 1)] == node[order]
        self.unknown = np.full(model.position.shape, -1)
        self.unknown[self.node_row[is_of_model], axis[order][is_of_model] - 1] = np.flatnonzero(
            is_of_model
        )
        # Displacements that are neither free nor held follow those of other nodes.
        dependent = (self.unknown < 0) & ~model.prescribed(state.boundaries)
        self.follows: BoolArray = np.asarray(dependent.any(axis=1))

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return int(self.matrix.shape[0])

    def factorise(self) -> Factors:
        """Factors of the stiffness, with a line of progress every ten seconds."""
        own_rows, first = np.unique(self.node_row, return_inverse=True)
        position = self.model.position[np.minimum(own_rows, self.model.node.size - 1)]
        progress = _Progress("factors of the stiffness")
        try:
            return Factors(self.matrix, first, position, progress)
        except np.linalg.LinAlgError as error:
            raise ResponseError(
                "the stiffness is not positive definite: a part of the model is not held, or the "
                "state is not stable"
            ) from error

    def compare(self, factors: Factors, check: RunFolder, node: int) -> float:
        """Largest difference from CalculiX' displacement under unit forces, as a share.

        Raises
        ------
        ResponseError
            It is larger than `AGREEMENT`.
        """
        row = int(np.searchsorted(self.model.node, node))
        free = self.unknown[row] >= 0
        loads = np.zeros((self.size, _AXES))
        loads[self.unknown[row][free], np.flatnonzero(free)] = 1.0
        moved = factors.solve(loads, np.ones(self.size, dtype=bool))
        largest = 0.0
        fields = list(read_fields(check.results, "DISP"))
        for axis, field in enumerate(fields[-_AXES:]):
            at = rows_of(self.model.node, field.nodes)
            available = (at[:, None] >= 0) & (self.unknown >= 0)
            expected_mm = field.values[at, :_AXES][available]
            computed_mm = moved[self.unknown[available], axis]
            scale = max(float(np.abs(expected_mm).max(initial=0.0)), 1e-300)
            largest = max(
                largest, float(np.abs(computed_mm - expected_mm).max(initial=0.0)) / scale
            )
        if not largest <= AGREEMENT:
            raise ResponseError(
                f"displacements under a unit force differ from CalculiX' by {largest:.2g} of the "
                f"largest, expected {AGREEMENT:g}"
            )
        return largest

    def stress_rows(self, elements: IntArray, axes: FloatArray) -> "tuple[csr_array, FloatArray]":
        """Stress at the best points of `elements` by displacement, and these points in mm.

        The first is ``(6 P, n)`` in the deck's unit of stress by that of length, in the directions
        `axes`; the second ``(P, 3)``.
        """
        from scipy.sparse import coo_array, csr_array, vstack

        parts: list[csr_array] = []
        middles = []
        for block in self.model.elements:
            selected = np.isin(block.number, elements)
            if not selected.any():
                continue
            rows = block.rows[selected]
            start = self.model.position[rows]
            for point in BEST_POINTS[block.kind]:
                share, slope = shape_functions(block.kind, point)
                by_start = np.einsum("ka,eab->ekb", slope, np.linalg.inv(_jacobian(start, slope)))
                gradient = np.eye(3) + np.einsum("eki,ekj->eij", self.moved[rows], by_start)
                by_now = np.einsum("ekb,ebc->ekc", by_start, np.linalg.inv(gradient))
                change = np.empty((len(rows), 6, 3, 3))
                for section, law in self.laws(block.number[selected]):
                    change[section] = stress_change(law, gradient[section])
                tensor = _full(change)  # (E, 3, 3, 3, 3)
                turned = np.einsum("ai,bj,eijkl->eabkl", axes, axes, tensor)
                six = np.stack([turned[:, a, b] for a, b in STRESS_PAIRS], axis=1)
                values = np.einsum("ecij,ekj->ecki", six, by_now)
                unknown = np.broadcast_to(self.unknown[rows][:, None], values.shape)
                line = np.arange(6 * len(rows)).reshape(-1, 6, 1, 1)
                free = unknown >= 0
                entries = values[free], (np.broadcast_to(line, values.shape)[free], unknown[free])
                shape = 6 * len(rows), self.size
                parts.append(coo_array(entries, shape=shape).tocsr())
                middles.append(np.einsum("k,eki->ei", share, self.position_mm[rows]))
            if self.follows[rows].any():
                node = self.model.node[rows[self.follows[rows]]][0]
                raise DeckError(
                    f"node {node} of an element with stress follows other nodes (*TIE, *EQUATION, "
                    "*MPC or a coupling), which is not computed"
                )
        if not parts:
            raise DeckError("no solid element in a layer of the afferents")
        return csr_array(vstack(parts)), np.concatenate(middles)

    def laws(self, numbers: IntArray) -> "Iterator[tuple[BoolArray, Law]]":
        """Elements of each section, ``(E,)``, and their law."""
        blocks = self.model.deck.blocks
        materials = {
            block.value_of("NAME"): n
            for n, block in enumerate(blocks)
            if block.keyword == "MATERIAL"
        }
        for section in self.model.sections:
            selected = np.isin(numbers, section.elements)
            if not selected.any():
                continue
            if section.oriented:
                raise DeckError(f"section {section.set_name} has an orientation: expected none")
            first = materials.get(section.material)
            if first is None:
                raise DeckError(f"material {section.material} is nowhere in the deck")
            following = []
            for block in blocks[first + 1 :]:
                if block.keyword not in _OF_A_MATERIAL:
                    break
                following.append(block)
            yield selected, read_law(blocks[first], following)


# Points at which strain is most accurate (Barlow 1976), in natural coordinates: the middle of
# linear elements, the points of reduced integration of quadratic ones.
_GAUSS = 3**-0.5
_TET = (0.5854101966249685, 0.1381966011250105)
BEST_POINTS: Mapping[str, FloatArray] = {
    "tet4": np.full((1, 3), 0.25),
    "tet10": np.array([[_TET[0] if axis == k else _TET[1] for axis in range(3)] for k in range(4)]),
    "wedge6": np.array([[1 / 3, 1 / 3, 0.0]]),
    "wedge15": np.array(
        [
            [x, y, z]
            for z in (-_GAUSS, _GAUSS)
            for x, y in ((1 / 6, 1 / 6), (2 / 3, 1 / 6), (1 / 6, 2 / 3))
        ]
    ),
    "hex8": np.zeros((1, 3)),
    "hex20": np.array(list(product((-_GAUSS, _GAUSS), repeat=3))),
}


def shape_functions(kind: str, point: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Shape functions ``(n,)`` of an element and their slopes ``(n, 3)`` at a natural `point`.

    Parameters
    ----------
    kind
        ``tet4``, ``tet10``, ``wedge6``, ``wedge15``, ``hex8`` or ``hex20``, nodes in the order of
        CalculiX and Abaqus.
    point
        Three coordinates: of tetrahedra and wedges from 0 to 1 along edges, else from -1 to 1.
    """
    family = kind.rstrip("0123456789")
    quadratic = int(kind.removeprefix(family)) > CORNERS[family]
    first, second = np.array(EDGES[family]).T
    if family == "tet":
        area = np.append(1 - point.sum(), point)
        slope = np.concatenate([-np.ones((1, 3)), np.eye(3)])
        if not quadratic:
            return area, slope
        corner = area * (2 * area - 1), (4 * area - 1)[:, None] * slope
        side = (
            4 * area[first] * area[second],
            4 * (area[first, None] * slope[second] + area[second, None] * slope[first]),
        )
        return np.concatenate([corner[0], side[0]]), np.concatenate([corner[1], side[1]])
    if family == "wedge":
        area = np.tile(np.append(1 - point[:2].sum(), point[:2]), 2)
        flat = np.zeros((6, 3))
        flat[:, :2] = np.tile([[-1.0, -1], [1, 0], [0, 1]], (2, 1))
        up = np.repeat([-1.0, 1.0], 3)
        half = (1 + up * point[2]) / 2
        rise = np.zeros((6, 3))
        rise[:, 2] = up / 2
        if not quadratic:
            return area * half, flat * half[:, None] + area[:, None] * rise
        bubble, fall = 1 - point[2] ** 2, np.array([0.0, 0.0, -2 * point[2]])
        corner = (
            area * (2 * area - 1) * half - area * bubble / 2,
            (4 * area - 1)[:, None] * flat * half[:, None]
            + (area * (2 * area - 1))[:, None] * rise
            - 0.5 * (flat * bubble + area[:, None] * fall),
        )
        a, b = first[:6], second[:6]
        product_of = (area[a] * area[b])[:, None]
        turned = area[a, None] * flat[b] + area[b, None] * flat[a]
        side = 4 * product_of[:, 0] * half[a], 4 * (turned * half[a, None] + product_of * rise[a])
        upright = area[:3] * bubble, flat[:3] * bubble + area[:3, None] * fall
        return (
            np.concatenate([corner[0], side[0], upright[0]]),
            np.concatenate([corner[1], side[1], upright[1]]),
        )
    sign = np.array([[x, y, z] for z in (-1, 1) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
    if not quadratic:
        factor = 1 + sign * point
        return factor.prod(axis=1) / 8, sign * _others(factor) / 8
    corner_factor = 1 + sign * point
    excess = (sign * point).sum(axis=1) - 2
    corner = corner_factor.prod(axis=1) / 8
    corner_slope = sign * (_others(corner_factor) * excess[:, None] + 8 * corner[:, None]) / 8
    middle = (sign[first] + sign[second]) / 2
    factor = np.where(middle == 0, 1 - point**2, 1 + middle * point)
    rate = np.where(middle == 0, -2 * point, middle)
    return (
        np.concatenate([corner * excess, factor.prod(axis=1) / 4]),
        np.concatenate([corner_slope, rate * _others(factor) / 4]),
    )


def _others(factor: FloatArray) -> FloatArray:
    """Products ``(n, 3)`` of the other two of three factors."""
    others: FloatArray = np.stack(
        [factor[:, 1] * factor[:, 2], factor[:, 2] * factor[:, 0], factor[:, 0] * factor[:, 1]], -1
    )
    return others


def _jacobian(position: FloatArray, slope: FloatArray) -> FloatArray:
    """Derivatives of position by natural coordinates, ``(E, 3, natural)``."""
    jacobian: FloatArray = np.einsum("eki,ka->eia", position, slope)
    return jacobian


def _full(six: FloatArray) -> FloatArray:
    """Tensors ``(E, 3, 3, ...)`` of their six components ``(E, 6, ...)``."""
    full = np.empty((len(six), 3, 3, *six.shape[2:]))
    for row, (a, b) in enumerate(STRESS_PAIRS):
        full[:, a, b] = full[:, b, a] = six[:, row]
    return full


class _Progress:
    """Logs the share of a task that is done, every ten seconds, with an estimate of the rest."""

    def __init__(self, task: str) -> None:
        self._task, self._begin_s = task, time.monotonic()
        self._last_s = self._begin_s

    def __call__(self, share: float) -> None:
        """Log `share`, if it is time."""
        now_s = time.monotonic()
        if now_s - self._last_s > _PROGRESS_S and share > 0:
            left_s = (now_s - self._begin_s) * (1 - share) / share
            _LOGGER.info(f"{self._task}: {share:.0%}, about {left_s:.0f} s left")
            self._last_s = now_s


# ---- The skin


@dataclass(frozen=True, eq=False)
class _Surface:
    """Nodes that may touch: `row` of the model, and their skin in the frame of the map."""

    row: IntArray
    axes: FloatArray
    middle_mm: FloatArray
    position_mm: FloatArray
    normal: FloatArray
    area_mm2: FloatArray
    triangles: IntArray

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


def _surface(linear: _LinearModel, skin: Skin, skin_map: SkinMap) -> _Surface:
    """Nodes of the skin that may touch, in the frame of the map."""
    position_mm = linear.position_mm[skin.rows]
    corner = position_mm[skin.triangles]
    twice = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal, area_mm2 = np.zeros_like(position_mm), np.zeros(len(position_mm))
    for place in range(3):
        np.add.at(normal, skin.triangles[:, place], twice)
        np.add.at(area_mm2, skin.triangles[:, place], np.linalg.norm(twice, axis=1) / 6)
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    axes = _axes(position_mm, area_mm2, normal, skin_map)
    if skin_map.apex is None:
        mean_mm = area_mm2 @ position_mm / area_mm2.sum()
        offset = position_mm - mean_mm
        aside_mm = np.linalg.norm(offset - (offset @ axes[1])[:, None] * axes[1], axis=1)
        above = normal @ axes[1] > 0
        middle_mm = mean_mm + axes[1] * float(
            offset[np.where(above, aside_mm, np.inf).argmin()] @ axes[1]
        )
    else:
        middle_mm = linear.position_mm[_row_of(linear.model, skin_map.apex)]
    mapped = (position_mm - middle_mm) @ axes.T
    free = np.asarray((linear.unknown[skin.rows] >= 0).any(axis=1) & ~linear.follows[skin.rows])
    near = np.linalg.norm(mapped, axis=1) <= (skin_map.reach_mm or np.inf)
    selected: BoolArray = np.asarray(free & near)
    if following := int(linear.follows[skin.rows].sum()):
        _LOGGER.info(f"{following} nodes of the skin follow others (*TIE, *EQUATION): not touched")
    number = np.cumsum(selected) - 1
    triangles = number[skin.triangles[selected[skin.triangles].all(axis=1)]]
    if not len(triangles):
        problem = "no triangle of the skin has three nodes that may touch: a larger reach_mm?"
        raise DeckError(problem, argument="skin")
    return _Surface(
        row=skin.rows[selected],
        axes=axes,
        middle_mm=middle_mm,
        position_mm=mapped[selected],
        normal=(normal @ axes.T)[selected],
        area_mm2=area_mm2[selected],
        triangles=triangles,
    )


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


def _row_of(model: SolidModel, node: int) -> int:
    rows = model.rows_of(np.array([node]))
    if not rows.size:
        raise DeckError(f"no *NODE of the deck defines node {node}", argument="apex", found=node)
    return int(rows[0])


# ---- Points with stress


@dataclass(frozen=True, eq=False)
class _Points:
    """Points with stress: `stress` ``(6 P, n)`` by displacement, in the deck's units."""

    position_mm: FloatArray
    depth_mm: FloatArray
    layer: IntArray
    layers: tuple[str, ...]
    sites: dict[str, MeshSite]
    stress: "csr_array"


def _points(
    linear: _LinearModel, surface: _Surface, afferents: Mapping[str, SiteRequest]
) -> _Points:
    """Points of all classes; two classes at the same depth of a layer share them."""
    from scipy.sparse import csr_array, kron, vstack
    from scipy.spatial import cKDTree

    layers: list[str] = []
    sites: dict[str, MeshSite] = {}
    site_of: dict[SiteRequest, MeshSite] = {}
    positions, depths, layer, operators = [], [], [], []
    left_bytes = _MOST_BYTES - _DISPLACEMENT_BYTES * 3 * surface.row.size**2
    requests = len(set(afferents.values()))
    share = left_bytes / (_STRESS_BYTES * 3 * 6 * surface.row.size * requests)
    for afferent, request in afferents.items():
        if request in site_of:
            sites[afferent] = site_of[request]
            continue
        elements, name, position_mm, depth_mm = _places(linear, surface, request, share)
        operator, middle_mm = linear.stress_rows(elements, surface.axes)
        tree = cKDTree(middle_mm)
        apart_mm = float(np.median(tree.query(middle_mm, k=2)[0][:, 1])) if tree.n > 1 else 1.0
        # The size of an element, not only the distance across a thin layer.
        away_mm, _ = tree.query(position_mm)
        inside = away_mm <= _FIT_DISTANCES * max(apart_mm, surface.spacing_mm)
        if not inside.any():
            raise UsageError(
                f"{request.set_name or name} has no element at a depth of {request.depth_mm:g} mm",
                argument="afferents",
                found=afferent,
            )
        position_mm, depth_mm = position_mm[inside], depth_mm[inside]
        near, weight = fit_weights(tree, position_mm, _FIT_ELEMENTS)
        place = np.repeat(np.arange(len(near)), near.shape[1])
        weights = csr_array((weight.ravel(), (place, near.ravel())), shape=(len(near), tree.n))
        operators.append(csr_array(kron(weights, np.eye(6))) @ operator)
        if name not in layers:
            layers.append(name)
        positions.append(position_mm)
        depths.append(depth_mm)
        layer.append(np.full(len(depth_mm), layers.index(name)))
        site_of[request] = sites[afferent] = MeshSite(name, float(np.median(depth_mm)))
    return _Points(
        np.concatenate(positions),
        np.concatenate(depths),
        np.concatenate(layer),
        tuple(layers),
        sites,
        csr_array(vstack(operators)),
    )


def _places(
    linear: _LinearModel, surface: _Surface, request: SiteRequest, most: float
) -> tuple[IntArray, str, FloatArray, FloatArray]:
    """Elements of the layer, its name, positions of points in the model, and their depths."""
    model, name = linear.model, normalized_name(request.set_name)
    if request.depth_mm is None:
        if name not in model.node_sets:
            available = ", ".join(model.node_sets) or "none"
            problem = f"no node set {request.set_name!r}; the deck has {available}"
            raise DeckError(problem, argument="afferents", found=request.set_name)
        rows = model.rows_of(model.node_sets[name])
        position_mm = linear.position_mm[rows]
        _, depth_mm = MappedSkin(surface.position_mm, surface.normal).below(
            surface.to_map(position_mm)
        )
        return _section_of_nodes(model, rows), name, position_mm, np.maximum(depth_mm, 0.0)
    facing = np.flatnonzero(surface.normal[:, 1] > _LEAST_MAP_COSINE)
    selected = _thinned(
        surface.position_mm[facing][:, [0, 2]], surface.spacing_mm, max(int(most), _LEAST_POINTS)
    )
    facing = facing[selected]
    position_mm = surface.to_model(
        surface.position_mm[facing] - request.depth_mm * surface.normal[facing]
    )
    depth_mm = np.full(facing.size, request.depth_mm)
    if name:
        if name not in model.element_sets:
            available = ", ".join(model.element_sets) or "none"
            problem = f"no element set {request.set_name!r}; the deck has {available}"
            raise DeckError(problem, argument="afferents", found=request.set_name)
        return model.element_sets[name], name, position_mm, depth_mm
    below = position_mm[np.linalg.norm(surface.position_mm[facing], axis=1).argmin()]
    nearest = min(
        (float(away.min()), int(block.number[away.argmin()]))
        for block in model.elements
        for away in [np.linalg.norm(linear.position_mm[block.rows].mean(axis=1) - below, axis=1)]
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


# ---- Unit forces


def _solve_forces(
    linear: _LinearModel, surface: _Surface, points: _Points, factors: Factors, folder: Path
) -> tuple[FloatArray, FloatArray]:
    """Displacement into the skin ``(F, n)`` and stress ``(F, 6 P)`` under all unit forces.

    Forces are ordered by node, then along the tangent across, into the skin, along. What was solved
    before in a part of `folder` is not solved again.
    """
    from scipy.sparse import coo_array, csr_array, vstack

    across, along = tangents(surface.normal)
    directions = np.stack([across, -surface.normal, along], axis=1) @ surface.axes
    unknown = linear.unknown[surface.row]
    count = surface.row.size
    node, axis = np.nonzero(unknown >= 0)
    inward = coo_array(
        (directions[node, 1, axis], (node, unknown[node, axis])), shape=(count, linear.size)
    ).tocsr()
    output = csr_array(vstack([inward, points.stress]))
    required = np.zeros(linear.size, dtype=bool)
    required[np.unique(output.indices)] = True
    responses = np.empty((3 * count, output.shape[0]), dtype=np.float32)
    progress, reported = _Progress("unit forces"), False
    digest = hashlib.sha256(np.ascontiguousarray(linear.matrix.data).data)
    for array in (output.indices, output.data, directions, unknown):
        digest.update(np.ascontiguousarray(array).data)
    parts = folder / f"forces_{digest.hexdigest()[:16]}"
    make_folder(parts)
    solved_before = 0
    # Nodes that are near each other load the same fronts.
    order = np.argsort(unknown.max(axis=1), kind="stable")
    nodes_at_once = _FORCES_AT_ONCE // 3
    for number, first in enumerate(range(0, count, nodes_at_once)):
        nodes = order[first : first + nodes_at_once]
        rows = (3 * nodes[:, None] + np.arange(3)).ravel()
        path = parts / f"part_{number:04d}.npy"
        if path.is_file():
            responses[rows] = np.load(path)
            solved_before += 1
            continue
        begin_s = time.monotonic()
        loads = np.zeros((linear.size, rows.size))
        for place, index in enumerate(nodes.tolist()):
            free = unknown[index] >= 0
            loads[unknown[index][free], 3 * place : 3 * place + 3] = directions[index][:, free].T
        responses[rows] = (output @ factors.solve(loads, required)).T
        with replacing(path) as draft, draft.open("wb") as file:
            np.save(file, responses[rows])
        if not reported:
            each_s = time.monotonic() - begin_s
            left_s = each_s * (count - first) / nodes_at_once
            _LOGGER.info(
                f"{3 * count} unit forces, {3 * solved_before * nodes_at_once} of them solved "
                f"before: about {left_s:.0f} s"
            )
            reported = True
        progress((first + nodes.size) / count)
    responses[:, :count] *= linear.units.length_mm / linear.units.force_n
    responses[:, count:] *= linear.units.stress_pa / linear.units.force_n
    return responses[:, :count], responses[:, count:]


def solve_mesh_pad(
    folder: Path,
    base_deck: Path,
    skin: str,
    afferents: Mapping[str, SiteRequest],
    skin_map: SkinMap,
    settings: Solver,
    *,
    after_step: int = 0,
    length_unit: str | None = None,
) -> MeshPad:
    """The pad of the model of `base_deck`, see `fembridge.touching.make_pad`.

    Raises
    ------
    DeckError
        A deck that is not read, without the skin or a set, or that cannot be linearised.
    SolverError, MissingError
        CalculiX failed, or is not installed.
    ResponseError
        The factors disagree with CalculiX.
    """
    from threadpoolctl import threadpool_limits

    deck_bytes = read_bytes(base_deck, MAX_DECK_BYTES, DeckError)
    deck = read_inp(deck_bytes, resolver=folder_resolver(base_deck))
    model = read_solid_model(deck, length_unit)
    state = linear_state(deck, after_step)
    for remark in state.remarks:
        _LOGGER.info(remark)
    model_skin = model.skin(skin)
    prescribed = model.prescribed(state.boundaries)[model_skin.rows].any(axis=1)
    inner = np.flatnonzero(~(prescribed | model_skin.border))
    row = model_skin.rows[inner[inner.size // 2] if inner.size else 0]
    check_node = int(model.node[row])
    run, version = _run(folder / "stiffness", stiffness_deck(state), settings)
    matrix = run.folder / f"{JOB}{MATRIX_SUFFIX}"
    if not matrix.is_file():
        raise ResultError("CalculiX wrote no stiffness matrix", matrix)
    check, _ = _run(folder / "unit_force", unit_force_deck(state, check_node), settings)
    linear = _LinearModel(model, state, run)
    surface = _surface(linear, model_skin, skin_map)
    points = _points(linear, surface, afferents)
    _LOGGER.info(
        f"{surface.row.size} nodes of skin, {len(points.depth_mm)} points with stress, "
        f"{linear.size} unknowns"
    )
    with threadpool_limits(settings.threads or 1, user_api="blas"):
        factors = linear.factorise()
        difference = linear.compare(factors, check, check_node)
        down_mm, stress_pa = _solve_forces(linear, surface, points, factors, folder)
    nodes, count = surface.row.size, len(points.depth_mm)
    del factors
    by_direction = stress_pa.reshape(nodes, 3, count, 6).transpose(1, 3, 2, 0)
    scale_pa = np.empty((3, 1, count, 1))
    stress = np.empty(by_direction.shape, dtype=np.float16)
    for direction, table in enumerate(by_direction):  # one after the other for less memory
        largest = np.maximum(np.abs(table).max(axis=(0, 2)), 1e-9)
        scale_pa[direction, 0, :, 0] = largest
        stress[direction] = table / largest[:, None]
    return MeshPad(
        name=base_deck.stem,
        spacing_mm=surface.spacing_mm,
        node=model.node[surface.row],
        position_mm=surface.position_mm,
        normal=surface.normal,
        area_mm2=surface.area_mm2,
        triangles=surface.triangles,
        is_end=surface.is_end,
        down_mm=np.ascontiguousarray(down_mm.reshape(nodes, 3, nodes).transpose(1, 2, 0)),
        point_mm=surface.to_map(points.position_mm),
        point_layer=points.layer,
        point_depth_mm=points.depth_mm,
        stress=stress,
        stress_scale_pa=scale_pa,
        layers=points.layers,
        sites=points.sites,
        origin={
            "solver": f"CalculiX {version}".strip(),
            "deck": base_deck.name,
            "deck_sha256": hashlib.sha256(deck_bytes).hexdigest(),
            "skin": normalized_name(skin),
            "after_step": after_step,
            "elements": int(sum(block.number.size for block in model.elements)),
            "unknowns": linear.size,
            "unit_forces": 3 * nodes,
            "difference": difference,
            "apex_mm": surface.middle_mm.tolist(),
            "outward": surface.axes[1].tolist(),
            "along": surface.axes[2].tolist(),
        },
    )


def _run(folder: Path, text: bytes, settings: Solver) -> tuple[RunFolder, str]:
    """The run of a deck in `folder`, solved unless its results are there, and CalculiX' version."""
    run = RunFolder(
        folder=folder,
        solver="calculix",
        increments=0,
        dt_ms=1.0,
        start_ms=0.0,
        afferents=(),
        deck_sha256=hashlib.sha256(text).hexdigest(),
        inputs={"base_deck": ""},
    )
    make_folder(run.folder)
    if not (run.deck.is_file() and run.deck.read_bytes() == text):
        with replacing(run.deck) as draft:
            draft.write_bytes(text)
        (run.folder / SOLVER_FILE).unlink(missing_ok=True)
    halt = threading.Event()
    with signals_as_exits():
        try:
            outcome = solve_once(run, replace(settings, cache=False), halt)
        finally:
            halt.set()
    if not outcome.accepted:
        raise outcome.to_error()
    _LOGGER.info(f"{folder.name} by CalculiX in {outcome.wall_s:.0f} s")
    return run, outcome.version or ""
