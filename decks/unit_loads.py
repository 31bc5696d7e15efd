"""The finger as a prism for CalculiX's ``*GREEN``: unit forces on one slice of its skin.

The section of a finger is swept along its axis, z. What a force at ``(x', z')`` does at
``(x, z)`` then depends on ``z - z'`` alone, so forces on the slice ``z = 0`` show all of
it. And the prism is its own mirror image about ``x = 0`` and about ``z = 0``: a force is
the sum of an even and an odd one in x, and a quarter of the prism answers each. So four
small decks stand for one that is four times as large, and each is factorised once:

``x_even`` / ``x_odd``    forces along x and y: nothing leaves ``z = 0``
``z_x_even`` / ``z_x_odd``  forces along z: nothing moves within ``z = 0``

A plane pad is the section alone, in plane strain: a slice so thin that it moves as one,
held along z, which the first two decks answer.

The section is a structured grid: columns across the skin, rows from the skin to the
bone, which no mesher is needed for and whose rows are the layers' own.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from decks.dialects import template
from decks.finger import LAYERS, Finger, Material, Papillae, Ranged, Ridges
from decks.keyword_deck import LINES
from decks.mesh import scaled_jacobian
from decks.section import Section, section_of, skin_tangent
from fembridge.errors import FingerError
from fembridge.typing import FloatArray, IntArray

# Rows of elements across each layer of the skin. Stress is read in the middle of an
# element, so three rows resolve the bending of the epidermis.
SKIN_ROWS = {"stratum_corneum": 2, "epidermis": 3, "dermis": 4}
# Of the layers in which afferents sit all rows of elements are watched, of the tissue so
# many: down to about 2.5 mm.
_TISSUE_ROWS = 2
# Rows of the tissue under it grow from the dermis' by this factor to the bone.
_TISSUE_GROWTH = 1.25
# Columns beyond the contact, and slices beyond the near ones, grow by this factor.
_GROWTH = 1.2
_FAR_MM = 1.5
# Slices are as near as columns up to here: the field of a force is steep there.
_NEAR_MM = 1.0
# A plane pad, which costs little, has so many times the rows: papillae are drawn by them.
PLANE_ROWS = 3
# Of a plane pad a slice is this share of the spacing: what its faces differ by is a
# thousandth of what they move.
_THICKNESS_SHARE = 0.05
# A force is a quarter of what the whole prism would get: see the module.
SHARE = 0.25


@dataclass(frozen=True, slots=True)
class PadMesh(Ranged):
    """How a pad is cut into elements: `spacing_mm` between nodes that may touch.

    They lie within `reach_mm` of the apex, to both sides, along the skin. The prism is
    twice `length_mm` long; `plane` is a thin slice of it. Layers have `rows` times the
    usual rows of elements. Cost grows with the cube of 1 / `spacing_mm`.
    """

    spacing_mm: float = 0.25
    reach_mm: float = 4.5
    length_mm: float = 14.0
    plane: bool = False
    rows: int = 1

    RANGES: ClassVar = {
        "spacing_mm": (0.05, 1.0),
        "reach_mm": (1.0, 20.0),
        "length_mm": (5.0, 50.0),
        "rows": (1, 4),
    }


@dataclass(frozen=True, slots=True, eq=False)
class Prism:
    """A quarter of a finger swept along z: x >= 0, z >= 0.

    `point_mm` ``(R + 1, C + 1, 2)`` is the section's grid of nodes, rows from the skin to
    the bone, columns from the apex to the back; `z_mm` ``(K,)`` are the slices. `row_layer`
    ``(R,)`` indexes `LAYERS`; from column `nail_column` on the stratum corneum is nail.
    The first `contact_columns` columns of nodes may touch.
    """

    finger: Finger
    mesh: PadMesh
    point_mm: FloatArray
    z_mm: FloatArray
    row_layer: IntArray
    nail_column: int
    contact_columns: int

    @property
    def node_rows(self) -> IntArray:
        """Rows of nodes at which displacements are written: skin, epidermis, top of the tissue."""
        rows = [self.layer_rows(layer) for layer in self.watched_layers]
        return np.unique(np.concatenate([[0], *rows, *(layer_rows + 1 for layer_rows in rows)]))

    @property
    def watched_layers(self) -> tuple[str, ...]:
        """Layers in which afferents sit, from the skin inwards."""
        afferent_layers = {site.layer for site in self.finger.afferents.values()}
        return tuple(layer for layer in LAYERS if layer in afferent_layers)

    @property
    def watched_columns(self) -> int:
        """Columns of elements, from the apex, up to where the finger is widest."""
        return int(self.point_mm[0, :, 0].argmax())

    @property
    def section_nodes(self) -> int:
        """Nodes of one slice."""
        return int(self.point_mm[..., 0].size)

    @property
    def elements(self) -> int:
        """Elements of the quarter."""
        rows, columns, _ = self.point_mm.shape
        return int((rows - 1) * (columns - 1) * (len(self.z_mm) - 1))

    def node(self, row: IntArray, column: IntArray, slice_: IntArray) -> IntArray:
        """Numbers of nodes, from 1."""
        columns = self.point_mm.shape[1]
        number: IntArray = 1 + slice_ * self.section_nodes + row * columns + column
        return number

    def layer_rows(self, layer: str) -> IntArray:
        """Rows of elements of `layer` that are watched, from the skin inwards."""
        limit = self.mesh.rows * _TISSUE_ROWS if layer == "subcutaneous_tissue" else None
        return np.flatnonzero(self.row_layer == LAYERS.index(layer))[:limit]


@dataclass(frozen=True, slots=True)
class GreenCase:
    """One of the four decks: `directions` of its forces, and their parity about x = 0.

    `even` is the parity of the vertical (or axial) displacement: 1 or -1.
    """

    name: str
    directions: str
    even: bool

    def loads(self, prism: Prism) -> list[tuple[int, str]]:
        """Column and direction of each force; on the axis those that can move it."""
        return [
            (column, axis)
            for column in range(prism.contact_columns)
            for axis in self.directions
            if column or (axis == "x") != self.even
        ]


CASES = (
    GreenCase("x_even", "xy", even=True),
    GreenCase("x_odd", "xy", even=False),
    GreenCase("z_x_even", "z", even=True),
    GreenCase("z_x_odd", "z", even=False),
)


def smooth(finger: Finger) -> Finger:
    """`finger` without ridges and papillae."""
    flat = Ridges(height_mm=0.0, half_width_mm=finger.ridges.half_width_mm)
    return replace(finger, ridges=flat, papillae=Papillae(0.0))


def prism_of(finger: Finger, mesh: PadMesh = PadMesh()) -> Prism:
    """Sweep the section of `finger`, with its ridges if it has any.

    Raises
    ------
    FingerError
        Too few columns for its ridges, or a section that the grid folds in.
    """
    soft_layers = (*SKIN_ROWS, "subcutaneous_tissue")
    for name, site in finger.afferents.items():
        if site.layer not in soft_layers:
            raise FingerError(
                f"is in {site.layer}, where a pad has no stress", argument=f"afferents.{name}"
            )
        if finger.materials[site.layer].anisotropy is not None:
            raise FingerError(
                f"is in {site.layer}, which is anisotropic: a pad has stress in isotropic layers",
                argument=f"afferents.{name}",
                found=site.layer,
            )
    ridges = finger.ridges
    if ridges.height_mm > 0 or finger.papillae.height_mm > 0:
        max_spacing_mm = 0.25 * ridges.spacing_mm * (1 + 1e-9)
        if mesh.spacing_mm > max_spacing_mm:
            raise FingerError(
                argument="spacing_mm",
                found=mesh.spacing_mm,
                expected=f"at most {max_spacing_mm:.4g} mm, four nodes to a ridge",
            )
    section = section_of(finger)
    side_mm = float(section.arc_mm[section.point_mm[:, 0].argmax()])
    max_reach_mm = 0.9 * min(side_mm, section.nail_arc_mm)
    if mesh.reach_mm > max_reach_mm:
        raise FingerError(
            argument="reach_mm",
            found=mesh.reach_mm,
            expected=f"at most {max_reach_mm:.3g} mm, short of the finger's side",
        )
    arc_mm, nail_column, contact_columns = _columns(section, mesh)
    point_mm, row_layer = _grid(section, arc_mm, mesh.rows)
    _check(point_mm)
    z_mm = np.array([0.0, _THICKNESS_SHARE * mesh.spacing_mm])
    if not mesh.plane:
        near = np.arange(0.0, _NEAR_MM + 1e-9, mesh.spacing_mm)
        beyond = _growing(mesh.length_mm - near[-1], mesh.spacing_mm)
        z_mm = np.concatenate([near, near[-1] + beyond])
    return Prism(finger, mesh, point_mm, z_mm, row_layer, nail_column, contact_columns)


# ---- The grid


def _columns(section: Section, mesh: PadMesh) -> tuple[FloatArray, int, int]:
    """Arcs of the columns, the one where the nail begins, and how many may touch."""
    count = round(mesh.reach_mm / mesh.spacing_mm)
    touching = np.arange(count + 1) * mesh.spacing_mm
    to_nail = _growing(section.nail_arc_mm - touching[-1], mesh.spacing_mm)
    on_nail_mm = section.end_arc_mm - section.nail_arc_mm
    on_nail = np.linspace(0.0, on_nail_mm, max(2, round(on_nail_mm / _FAR_MM)) + 1)[1:]
    arc_mm = np.concatenate([touching, touching[-1] + to_nail, section.nail_arc_mm + on_nail])
    return arc_mm, count + len(to_nail), count + 1


def _growing(length_mm: float, step_mm: float) -> FloatArray:
    """Ends of steps that grow from `step_mm` to `_FAR_MM`, the last at `length_mm`."""
    steps = [min(step_mm * _GROWTH**k, _FAR_MM) for k in range(1, 400)]
    ends = np.cumsum(steps)
    count = int(np.searchsorted(ends, length_mm)) + 1
    scaled: FloatArray = ends[:count] * (length_mm / ends[count - 1])
    return scaled


def _grid(section: Section, arc_mm: FloatArray, factor: int) -> tuple[FloatArray, IntArray]:
    """Nodes ``(R + 1, C + 1, 2)`` from the skin to the bone, and the layer of each row."""
    curves = (section.surface, section.corneum, section.epidermis, section.dermis)
    lines = [section.curve(depth, arc_mm) for depth in curves]
    rows, layers = [lines[0]], []
    for (layer, layer_count), upper, lower in zip(
        SKIN_ROWS.items(), lines, lines[1:], strict=False
    ):
        count = factor * layer_count
        for k in range(1, count + 1):
            rows.append(upper + (lower - upper) * (k / count))
            layers.append(LAYERS.index(layer))
    bone = section.bone(np.pi * arc_mm / section.end_arc_mm)
    depth_mm = float(np.linalg.norm(bone[0] - rows[-1][0]))
    first_mm = section.finger.skin.dermis_mm / (factor * SKIN_ROWS["dermis"])
    steps = first_mm * _TISSUE_GROWTH ** np.arange(1, 400)
    count = int(np.searchsorted(np.cumsum(steps), depth_mm)) + 1
    share = np.cumsum(steps[:count]) / steps[:count].sum()
    dermis = rows[-1]
    rows += [dermis + (bone - dermis) * fraction for fraction in share]
    layers += [LAYERS.index("subcutaneous_tissue")] * count
    return np.stack(rows), np.array(layers)


def _check(point_mm: FloatArray) -> None:
    """Refuse a grid with an element that is folded."""
    rows, columns, _ = point_mm.shape
    node = np.arange(rows * columns).reshape(rows, columns)
    quad = np.stack([node[1:, :-1], node[1:, 1:], node[:-1, 1:], node[:-1, :-1]], -1).reshape(-1, 4)
    flat_mm = point_mm.reshape(-1, 2)
    folded = scaled_jacobian(flat_mm, quad) <= 0
    if folded.any():
        x, y = flat_mm[quad[folded][0, 0]]
        raise FingerError(f"the pad's grid is folded near ({x:.3f}, {y:.3f}) mm")


# ---- The deck


def green_deck(prism: Prism, case: GreenCase) -> str:
    """The deck of `case`; displacements in the prism's `node_rows` are written."""
    quarter = prism_text(prism, even_x=case.even, even_z=case.directions != "z")
    return template("green.inp.j2").render(case=case, prism=quarter, loads=case.loads(prism))


def prism_text(prism: Prism, *, even_x: bool, even_z: bool) -> str:
    """The quarter in a deck: nodes, elements, materials, and what does not move.

    Under forces that are even about ``x = 0`` nothing leaves that plane, under odd ones
    nothing moves within it; about ``z = 0`` likewise.
    """
    nodes_down, nodes_across, _ = prism.point_mm.shape
    slices = np.arange(len(prism.z_mm))
    all_rows, all_columns = np.arange(nodes_down), np.arange(nodes_across)
    free_rows, free_columns = all_rows[:-1], all_columns[: prism.nail_column]

    def numbers(rows: IntArray, columns: IntArray, z_slices: IntArray = slices) -> IntArray:
        return prism.node(rows[None, :, None], columns, z_slices[:, None, None]).ravel()

    def plane(z_slices: IntArray) -> tuple[IntArray, IntArray]:
        return numbers(free_rows[:1], free_columns, z_slices), numbers(
            free_rows[1:], all_columns, z_slices
        )

    flat_mm = (prism.point_mm.reshape(-1, 2) + 0.0).tolist()
    points = ((x, y, z) for z in prism.z_mm.tolist() for x, y in flat_mm)
    sets = {
        "HELD": (
            numbers(all_rows[-1:], all_columns),
            numbers(all_rows[:1], all_columns[prism.nail_column :]),
        ),
        "AXIS": (numbers(free_rows, all_columns[:1]), numbers(free_rows[1:], all_columns[-1:])),
        "MIDDLE": plane(slices[:1]),
        "END": plane(slices[-1:]),
        "OUTPUT_NODES": (numbers(prism.node_rows, all_columns[: prism.watched_columns + 1]),),
    }
    return template("prism.inp.j2").render(
        nodes="\n".join(
            f"{number}, {x:.9f}, {y:.9f}, {z:.9f}" for number, (x, y, z) in enumerate(points, 1)
        ),
        layers=list(_layers(prism)),
        sets=sets,
        even_x=even_x,
        even_z=even_z,
        **LINES,
    )


def _layers(
    prism: Prism,
) -> Iterator[tuple[str, range, IntArray, Material, FloatArray | None]]:
    """Each layer's name, its elements with their nodes, material, and axes; elements count on."""
    columns = prism.point_mm.shape[1]
    layer = np.repeat(prism.row_layer[:, None], columns - 1, axis=1)
    corneum = layer == LAYERS.index("stratum_corneum")
    corneum[:, : prism.nail_column] = False
    layer[corneum] = LAYERS.index("nail")
    first = 1
    for index, name in enumerate(LAYERS):
        row, column = np.nonzero(layer == index)
        if not row.size:
            continue
        corners = [
            np.stack(
                [
                    prism.node(row + down, column + across, np.array(k + ahead))
                    for ahead in (0, 1)
                    for down, across in ((1, 0), (1, 1), (0, 1), (0, 0))
                ],
                -1,
            )
            for k in range(len(prism.z_mm) - 1)
        ]
        nodes = np.concatenate(corners)
        material, tangent = prism.finger.materials[name], None
        if material.anisotropy is not None:
            sides = ((0, 0), (0, 1), (1, 0), (1, 1))
            corner_mm = [prism.point_mm[row + down, column + across] for down, across in sides]
            center_mm = np.mean(corner_mm, axis=0)
            tangent = skin_tangent(prism.finger.outline, center_mm)
            tangent = np.tile(tangent, (len(prism.z_mm) - 1, 1))
        yield name.upper(), range(first, first + len(nodes)), nodes, material, tangent
        first += len(nodes)
