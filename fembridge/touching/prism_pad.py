"""The pad of a prism: a section of a finger that is swept along its axis.

The finger is a prism along z, so a response depends on where across the finger force and
place are, ``x'`` and ``x``, and on ``z - z'``. It is a mirror image of itself about
``x = 0`` and about ``z = 0``: stored are forces with ``x' >= 0`` and places with
``z >= 0``, signs give the rest.

A plane pad is a slice of 1 mm in plane strain: what touches it has no end along z.

Stress is that in the middle of elements, from displacements and the material of that
element alone: nothing is averaged over two layers. `stress_rows` are rows of elements of
one layer, along the skin.
"""

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from decks.finger import AfferentSite, Finger
from decks.presets import finger_table
from decks.section import Section, section_of
from fembridge.errors import ResponseError, UsageError
from fembridge.host.memory import check_memory
from fembridge.touching.compliance import Compliance, LatticeCompliance
from fembridge.touching.pad import Pad, SkinCells, SkinMargin, SkinNodes
from fembridge.touching.shape import Shape
from fembridge.trace import finger_id
from fembridge.typing import BoolArray, FloatArray, IntArray, SingleArray

if TYPE_CHECKING:
    from scipy.sparse import csr_array

# What becomes of a stress or a force component under a mirror.
STRESS_FLIP = {"x": np.array([1, 1, 1, -1, 1, -1]), "z": np.array([1, 1, 1, 1, -1, -1])}
FORCE_FLIP = {"x": np.array([-1, 1, 1]), "z": np.array([1, 1, -1])}

# Nodes that may touch lie within half of this of the pad's middle, along the finger.
LATTICE_LENGTH_MM = 24.0
# A fingertip is round along the finger too: its radius is so many half widths, about twice that
# across (20 mm of 8 x 6.5 mm half axes). Its curve counts for what touches; what yields is the
# prism.
_TIP_RADIUS_HALF_WIDTHS = 2.5
# A fingertip reaches so far from its middle, across and along, if it is so wide: of a narrower one
# units fill nine tenths of its width, and 1.5 half widths of its length.
_HALF_WIDTH_MM, _HALF_LENGTH_MM = 7.0, 12.0
_HALF_LENGTH_HALF_WIDTHS = 1.5
_ROUNDING_MM = 1e-6
# Beyond the prism stress fades by e in so many mm, about as it does before.
_TAIL_MM = 5.0


@dataclass(frozen=True, slots=True, eq=False)
class StressRow:
    """Middles of a row of elements of `layer`, from the apex to the right.

    `arc_mm` and `depth_mm` ``(M,)``: along the smooth skin, and below it.
    """

    layer: str
    arc_mm: FloatArray
    depth_mm: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class PrismPad(Pad):
    """Responses of the skin of a finger, a prism along z, to unit forces on it.

    `make_pad` computes one; `Pad.read` and `write` are its file.

    Parameters
    ----------
    finger
        Finger with its layers.
    spacing_mm
        Distance of two nodes that may touch, along z, in mm.
    x_mm, y_mm
        Positions of the nodes that may touch, from left to right, in mm, ``(N,)``.
    z_mm
        Positions >= 0 along the finger at which displacements are known, in mm, ``(K,)``.
    stress_z_mm
        Positions along the finger at which stress is known, in mm, ``(K - 1,)``.
    down_mm
        Displacement into the skin in mm, ``(3, N', N, K)``, of node n, at z, under 1 N on node n'
        along x, into the skin, or along z; n' counts the nodes with x >= 0.
    stress_pa
        Stress in Pa, ``(R, 3, 6, N', 2 M, K - 1)``, in the middle of element m of each row, from
        left to right.
    rows
        Rows of elements with stress, ``(R,)``.
    origin
        How the pad was computed. Default: nothing.
    source, sha256
        Name or path of its file, and the checksum. Default: empty, without a file.
    """

    finger: Finger
    spacing_mm: float
    x_mm: FloatArray
    y_mm: FloatArray
    z_mm: FloatArray
    stress_z_mm: FloatArray
    down_mm: FloatArray
    stress_pa: FloatArray | SingleArray
    rows: tuple[StressRow, ...]
    origin: Mapping[str, Any] = field(default_factory=dict)
    source: str = ""
    sha256: str = ""

    uniform_along: ClassVar[bool] = True

    BEYOND_ROWS: ClassVar[float] = 0.75
    """A unit may be this share of a row's thickness above or below the middles of rows."""

    def __repr__(self) -> str:
        kind = "plane section" if self.plane else "fingertip"
        return (
            f"PrismPad({kind} of finger {self.finger.name!r}, {self.x_mm.size} columns of nodes "
            f"{self.spacing_mm:g} mm apart, to {self.reach_mm:.3g} mm on both sides)"
        )

    def write(self, path: "str | os.PathLike[str]") -> None:
        """Write the pad with its checksum; stress in half precision (1 in 2000).

        Parameters
        ----------
        path
            File in ``.npz``.

        Raises
        ------
        OutputError
            The file cannot be written.
        """
        from fembridge.touching.pad_file import write_pad

        write_pad(Path(path), self)

    @cached_property
    def section(self) -> Section:
        """The section of the finger, with its outline."""
        return section_of(self.finger)

    @property
    def plane(self) -> bool:
        """Whether it is the section alone: what touches is endless along z, forces are by mm."""
        return self.z_mm.size == 1

    @property
    def node_mm2(self) -> FloatArray:
        """Skin that a node of each column stands for, ``(N,)``."""
        return np.gradient(self.x_mm) * (1.0 if self.plane else self.spacing_mm)

    @property
    def reach_mm(self) -> float:
        """How far from the apex, across the finger, skin may be touched."""
        return float(self.x_mm[-1])

    @property
    def widest_mm(self) -> float:
        """How far from the apex, across the finger, stress is held."""
        arc_mm = min(float(row.arc_mm[-1]) for row in self.rows)
        section = self.section
        return float(np.interp(arc_mm, section.arc_mm, section.point_mm[:, 0]))

    @cached_property
    def compliance(self) -> FloatArray:
        """`down_mm` with all forces, ``(3, N, N, K)`` in mm/N."""
        mirrored = self.down_mm[:, :0:-1, ::-1, :] * FORCE_FLIP["x"][:, None, None, None]
        return np.concatenate([mirrored, self.down_mm], axis=1)

    @cached_property
    def lattice_compliance(self) -> FloatArray:
        """`compliance` ``(3, N', N, J)`` for nodes of the lattice, j times the spacing apart."""
        if self.plane:
            return self.compliance
        at_mm = np.arange(int(LATTICE_LENGTH_MM / self.spacing_mm) + 1.0) * self.spacing_mm
        check_memory(
            2 * 8 * 3 * self.x_mm.size**2 * at_mm.size, "the compliance of this pad", ResponseError
        )
        mirrored = np.concatenate([-self.z_mm[:0:-1], self.z_mm])
        index, weight = cubic_weights(mirrored, at_mm)
        weight[at_mm > self.z_mm[-1]] = 0.0
        spread = np.zeros((mirrored.size, at_mm.size))
        np.add.at(spread, (index, np.arange(at_mm.size)[:, None]), weight)
        far = self.z_mm.size - 1
        tables = [
            table @ (spread[far:] + flip * np.pad(spread[far - 1 :: -1], ((1, 0), (0, 0))))
            for table, flip in zip(self.compliance, FORCE_FLIP["z"], strict=True)
        ]
        return np.stack(tables)

    def depth_range_mm(
        self, layer: str, x_mm: FloatArray, z_mm: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Least and largest depth in mm with stress in a layer, see `Pad`."""
        del z_mm  # the same everywhere along the finger
        rows = [row for row in self.rows if row.layer == layer]
        if len(rows) < 2:
            raise self._no_stress_in(layer)
        arc_mm = np.abs(self.arc_at(x_mm))
        upper, *_, lower = depths = [np.interp(arc_mm, row.arc_mm, row.depth_mm) for row in rows]
        least_mm = upper - self.BEYOND_ROWS * (depths[1] - upper)
        most_mm = lower + self.BEYOND_ROWS * (lower - depths[-2])
        return least_mm, most_mm

    def _no_stress_in(self, layer: str) -> UsageError:
        layers = ", ".join(dict.fromkeys(row.layer for row in self.rows))
        return UsageError(f"the pad holds no stress in {layer}, but in {layers}")

    def arc_at(self, x_mm: FloatArray) -> FloatArray:
        """Signed length of the smooth skin from the apex in mm, ``(P,)``.

        Parameters
        ----------
        x_mm
            Positions across the finger in mm, ``(P,)``.
        """
        section = self.section
        widest = int(section.point_mm[:, 0].argmax())
        x, arc = section.point_mm[: widest + 1, 0], section.arc_mm[: widest + 1]
        arc_mm: FloatArray = np.sign(x_mm) * np.interp(np.abs(x_mm), x, arc)
        return arc_mm

    def normal_at(self, x_mm: FloatArray, z_mm: FloatArray) -> FloatArray:
        """Outward normal of the smooth skin, ``(P, 3)``, see `Pad`."""
        right = self.section.point_mm[: int(self.section.point_mm[:, 0].argmax())]
        slope = np.sign(x_mm) * np.interp(
            np.abs(x_mm), right[:, 0], np.gradient(right[:, 1], right[:, 0])
        )
        outward = np.stack([-slope, np.ones_like(slope), np.zeros_like(z_mm)], -1)
        normal: FloatArray = outward / np.hypot(slope, 1.0)[:, None]
        return normal

    # ---- The skin

    @property
    def skin_text(self) -> str:
        """Number and distance of the columns of nodes."""
        return f"{self.x_mm.size} columns of skin {self.spacing_mm:g} mm apart"

    @property
    def half_length_mm(self) -> float:
        """How far from the middle, along the finger, skin may be touched."""
        return 0.5 * LATTICE_LENGTH_MM

    @property
    def limits(self) -> str:
        """The ends of the skin that may be touched, for a message."""
        limits = f"x = {self.reach_mm:.3g} mm"
        if not self.plane:
            limits += f" and z = {self.end_row * self.spacing_mm:.3g} mm"
        return f"{limits} to both sides"

    @property
    def end_row(self) -> int:
        """The last row of nodes along the finger that a shape may touch."""
        return 0 if self.plane else int(0.5 * LATTICE_LENGTH_MM / self.spacing_mm)

    def skin_nodes(self, half_length_mm: float = 0.5 * LATTICE_LENGTH_MM) -> "LatticeNodes":
        """All nodes that a shape may touch, up to so far from the middle along the finger."""
        most = 0 if self.plane else int(half_length_mm / self.spacing_mm)
        column, row = np.meshgrid(
            np.arange(self.x_mm.size), np.arange(-most, most + 1), indexing="ij"
        )
        return LatticeNodes(self, column.ravel(), row.ravel())

    def nodes_from(self, arrays: Mapping[str, IntArray]) -> "LatticeNodes":
        """Nodes of columns and rows, see `Pad`."""
        column, row = arrays["column"], arrays["row"]
        if column.shape != row.shape:
            raise ValueError("arrays of different lengths")
        if column.size and not (column.min() >= 0 and column.max() < self.x_mm.size):
            raise ValueError("columns beyond the pad")
        return LatticeNodes(self, column, row)

    def end_nodes(self, nodes: SkinNodes) -> Mapping[str, BoolArray]:
        """Nodes at each end of the skin that may be touched, see `Pad`."""
        lattice = _lattice(nodes)
        reach_mm, along_mm = self.reach_mm, self.end_row * self.spacing_mm
        ends: dict[str, BoolArray] = {
            f"x = {-reach_mm:.3g} mm": lattice.column == 0,
            f"x = {reach_mm:.3g} mm": lattice.column == self.x_mm.size - 1,
        }
        if not self.plane:
            ends[f"z = {-along_mm:.3g} mm"] = lattice.row == -self.end_row
            ends[f"z = {along_mm:.3g} mm"] = lattice.row == self.end_row
        return ends

    def skin_height_mm(self, x_mm: FloatArray, z_mm: FloatArray) -> FloatArray:
        """The skin over its apex, <= 0: the section's outline, and a fingertip's curve along z.

        Parameters
        ----------
        x_mm, z_mm
            Positions across and along the finger in mm, ``(P,)`` or any shapes that broadcast.
        """
        outline: FloatArray = np.interp(x_mm, self.x_mm, self.y_mm)
        return outline - np.square(z_mm) / (2 * self.tip_radius_mm)

    @property
    def tip_radius_mm(self) -> float:
        """Radius of the skin along the finger in mm."""
        return _TIP_RADIUS_HALF_WIDTHS * self.finger.outline.half_width_mm

    def height_of_nodes_mm(self, nodes: "LatticeNodes") -> FloatArray:
        """Heights of nodes over the apex in mm, ``(n,)``.

        Parameters
        ----------
        nodes
            Nodes of this pad.
        """
        return self.skin_height_mm(nodes.x_mm, nodes.z_mm)

    def compliance_of(self, nodes: "LatticeNodes", drag: tuple[float, float]) -> Compliance:
        """How far each of `nodes` goes into the skin under 1 N on each.

        Parameters
        ----------
        nodes
            Nodes of this pad.
        drag
            Force along x and z that comes with 1 N into the skin.
        """
        return LatticeCompliance(self.lattice_compliance, nodes.column, nodes.row, drag)

    def spread_on_pad(
        self, nodes: "LatticeNodes", forces_n: FloatArray | SingleArray
    ) -> tuple["LatticeNodes", FloatArray | SingleArray]:
        """Nodes with known stress, and the forces on them, see `SkinNodes`.

        Parameters
        ----------
        nodes
            Nodes of this pad.
        forces_n
            Forces in N, ``(S, node)``.
        """
        return nodes, forces_n

    def weights_on_pad(self, nodes: "LatticeNodes") -> tuple["csr_array", "LatticeNodes"]:
        """Nodes of known stress near some nodes, and weights ``(n, node)`` that read between them.

        Parameters
        ----------
        nodes
            Nodes of this pad.
        """
        from scipy.sparse import csr_array

        one = np.arange(nodes.size)
        weights = csr_array((np.ones(nodes.size, dtype=np.float32), (one, one)))
        return weights, nodes

    def first_touch_mm(self, shape: Shape) -> float:
        """How far `shape` is over the skin where it touches first, see `Pad`."""
        nodes = self.skin_nodes()
        gap = nodes.gaps_mm(shape)
        lowest = int(gap.argmin())
        if not np.isfinite(gap[lowest]):
            # Smaller than the grid, or beside it: look between the nodes.
            lowest = -1
        fine = np.arange(-8, 9) / 8 * self.spacing_mm
        if lowest >= 0:
            x = self.x_mm[nodes.column[lowest]] + fine
            z = nodes.row[lowest] * self.spacing_mm + fine
        else:
            x = np.arange(self.x_mm[0], self.x_mm[-1], self.spacing_mm / 8)
            z = np.arange(nodes.z_mm.min(), nodes.z_mm.max(), self.spacing_mm / 8)
        x, z = x[np.abs(x) <= self.reach_mm], np.zeros(1) if self.plane else z
        height = shape.height_mm(*np.meshgrid(x, z, indexing="ij"))
        least = float((height - self.skin_height_mm(*np.meshgrid(x, z, indexing="ij"))).min())
        if not np.isfinite(least):
            raise UsageError(
                f"{shape.name} is beside the pad, which reaches {self.reach_mm:.3g} mm across and "
                f"{nodes.z_mm.max():.3g} mm along to both sides"
            )
        return least

    outline_ends: ClassVar[bool] = False

    def outline(self) -> FloatArray:
        """The sides of the finger, see `Pad`."""
        half_width_mm, end_mm = self.finger.outline.half_width_mm, 2 * self.half_length_mm
        return np.array([[x, -end_mm, x, end_mm] for x in (-half_width_mm, half_width_mm)])

    # ---- Afferents

    @property
    def afferents(self) -> Mapping[str, AfferentSite]:
        """Sites of the afferents of the finger by class."""
        return self.finger.afferents

    @property
    def mechanics(self) -> dict[str, str]:
        """Name and digest of the finger; ``ridges`` is ``none`` where it has none of its own."""
        ridges = {} if self.plane or self.finger.ridges.height_mm else {"ridges": "none"}
        return {**self._finger_id, **ridges}

    @cached_property
    def _finger_id(self) -> dict[str, str]:
        return finger_id(self.model_table)

    @property
    def model_table(self) -> dict[str, Any]:
        """The finger in TOML types."""
        return finger_table(self.finger)

    def extent_mm(self) -> tuple[FloatArray, FloatArray, float, float]:
        """Half the skin for a population, see `Pad`."""
        return _extent_mm(self.section)

    def margins(self, x_mm: FloatArray, z_mm: FloatArray) -> Iterator[SkinMargin]:
        """Positions without skin or stress; a pad that is plane has no ends along z."""
        half_width_mm = float(self.section.point_mm[:, 0].max())
        reach_mm = min(self.widest_mm + self.spacing_mm, half_width_mm)
        yield SkinMargin(
            np.abs(x_mm) > reach_mm + _ROUNDING_MM,
            lambda row: (
                f"at x = {x_mm[row]:g} mm is beside the skin, which reaches {reach_mm:.3g} mm to "
                "both sides"
            ),
        )
        if self.plane:
            return
        held_mm, lattice_mm = float(self.stress_z_mm[-1]), 0.5 * LATTICE_LENGTH_MM
        yield SkinMargin(
            np.abs(z_mm) > held_mm + lattice_mm,
            lambda row: (
                f"at z = {z_mm[row]:g} mm is beyond the pad: it may be touched up to "
                f"{lattice_mm:g} mm along the finger, and stress is held {held_mm:.3g} mm further"
            ),
        )

    def far_margin(self, x_mm: FloatArray, z_mm: FloatArray) -> SkinMargin | None:
        """Positions along the finger that a force in the middle of the pad does not reach."""
        if self.plane:
            return None
        held_mm = float(self.stress_z_mm[-1])
        return SkinMargin(
            np.abs(z_mm) > held_mm,
            lambda row: (
                f"at z = {z_mm[row]:g} mm is more than {held_mm:.3g} mm from the middle of the "
                "pad: a force there gives it no stress"
            ),
        )

    def clipped(self, x_mm: FloatArray, z_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The nearest positions with stress, see `Pad`."""
        return np.clip(x_mm, -self.widest_mm, self.widest_mm), z_mm

    def columns_per_place(self, nodes: SkinNodes) -> int:
        """Numbers of `influence_pa` for each place and component, see `Pad`."""
        columns = np.unique(nodes.column).size if isinstance(nodes, LatticeNodes) else nodes.size
        return columns * 2 * self.stress_z_mm.size

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
        known = nodes.own_influence_pa(layer, x_mm, z_mm, depth_mm)
        if known is not None:
            return known
        lattice = _lattice(nodes)
        columns, column = np.unique(lattice.column, return_inverse=True)
        rows, row = np.unique(lattice.row, return_inverse=True)
        middle = self.stress_z_mm
        along = middle if self.plane else np.concatenate([-middle[::-1], middle])
        row_numbers = np.flatnonzero(np.isin([row.layer for row in self.rows], layer))
        weights = self.section_weights(row_numbers, layer, x_mm, depth_mm)
        # Stress at the places in the section, along the finger: (place, 6 x column, K).
        in_section = weights @ self.stress_table_pa(
            row_numbers, columns - self.x_mm.size // 2, (drag[0], 1.0, drag[1])
        )
        in_slice = in_section.reshape(x_mm.size, 6 * columns.size, along.size)
        away_mm = z_mm[:, None] - rows * self.spacing_mm  # (place, row)
        weight = np.ones((away_mm.size, along.size), dtype=np.float32)
        if not self.plane:
            at, share = cubic_weights(along, away_mm.ravel())
            # The prism ends there: stress that did, too, would step as forces move.
            beyond_mm = np.maximum(np.abs(away_mm.ravel()) - middle[-1], 0.0)
            share *= np.exp(-beyond_mm / _TAIL_MM)[:, None]
            weight[:] = 0.0
            np.put_along_axis(weight, at, share.astype(np.float32), axis=1)
        stress = in_slice @ weight.reshape(x_mm.size, rows.size, along.size).transpose(0, 2, 1)
        by_column = stress.reshape(x_mm.size, 6, columns.size, rows.size)
        influence: SingleArray = np.moveaxis(by_column[:, :, column, row], 1, 0)
        return influence

    def stress_table_pa(
        self, row_numbers: IntArray, columns: IntArray, force: tuple[float, float, float]
    ) -> SingleArray:
        """Stress in the pad's `row_numbers` under `force` on `columns`, counted from the apex.

        ``(R x 2 M, 6 x column x 2 K)``: rows and middles of elements, places along z from -z.
        Columns to the left of the apex, and places behind, are mirror images.
        """
        parts = []
        for direction, share in enumerate(force):
            if not share:
                continue
            selection = np.ix_(row_numbers, np.array([direction]), np.arange(6), np.abs(columns))
            ahead = share * self.stress_pa[selection][:, 0]  # (R, 6, column, 2 M, K)
            flip_x, flip_z = (
                (FORCE_FLIP[axis][direction] * STRESS_FLIP[axis]).astype(np.float32)[
                    :, None, None, None
                ]
                for axis in ("x", "z")
            )
            left = columns < 0
            ahead[:, :, left] = flip_x * ahead[:, :, left, ::-1]
            behind = flip_z * ahead[..., ::-1]
            parts.append(ahead if self.plane else np.concatenate([behind, ahead], axis=-1))
        table: SingleArray = sum(parts[1:], parts[0])
        rows, _, _, middles, _ = table.shape
        return np.moveaxis(table, 3, 1).reshape(rows * middles, -1)

    def section_weights(
        self,
        row_numbers: IntArray,
        layer: NDArray[np.str_],
        x_mm: FloatArray,
        depth_mm: FloatArray,
    ) -> "csr_array":
        """Weights ``(place, R x 2 M)`` of the elements of rows `row_numbers` around each place."""
        from scipy.sparse import csr_array

        arc_mm = self.arc_at(x_mm)
        middles = self.stress_pa.shape[4]
        entries = []
        rows = [self.rows[n] for n in row_numbers]
        for name in np.unique(layer):
            layer_rows = [n for n, row in enumerate(rows) if row.layer == name]
            if not layer_rows:
                raise self._no_stress_in(str(name))
            selected = np.flatnonzero(layer == name)
            arcs = [np.concatenate([-rows[n].arc_mm[::-1], rows[n].arc_mm]) for n in layer_rows]
            deep = [np.concatenate([rows[n].depth_mm[::-1], rows[n].depth_mm]) for n in layer_rows]
            depths = np.stack(
                [np.interp(arc_mm[selected], a, d) for a, d in zip(arcs, deep, strict=True)]
            )
            depths_mm, thick = depth_mm[selected], np.diff(depths, axis=0)
            low, high = (
                depths[0] - self.BEYOND_ROWS * thick[0],
                depths[-1] + self.BEYOND_ROWS * thick[-1],
            )
            for entry in np.flatnonzero((depths_mm < low) | (depths_mm > high)):
                raise UsageError(
                    f"a unit {depths_mm[entry]:g} mm deep in {name} at x = "
                    f"{x_mm[selected[entry]]:g} mm: the pad holds stress from {low[entry]:.3g} to "
                    f"{high[entry]:.3g} mm there"
                )
            upper = np.clip((depths < depths_mm).sum(axis=0) - 1, 0, len(layer_rows) - 2)
            column = np.arange(selected.size)
            share = (depths_mm - depths[upper, column]) / thick[upper, column]
            for n, (row, arcs_mm) in enumerate(zip(layer_rows, arcs, strict=True)):
                by_depth = np.where(upper == n, 1 - share, np.where(upper == n - 1, share, 0.0))
                at, weight = cubic_weights(arcs_mm, arc_mm[selected])
                entries.append(
                    (np.repeat(selected, 4), row * middles + at, by_depth[:, None] * weight)
                )
        index, middle, weight = (
            np.concatenate([entry[k].ravel() for entry in entries]) for k in range(3)
        )
        shape = arc_mm.size, len(rows) * middles
        return csr_array((weight.astype(np.float32), (index, middle)), shape=shape)


@dataclass(frozen=True, slots=True, eq=False)
class LatticeNodes(SkinNodes):
    """Nodes of a prism: `column` ``(n,)`` of the pad, `row` ``(n,)`` along the finger."""

    pad: PrismPad
    column: IntArray
    row: IntArray

    @property
    def size(self) -> int:
        """Number of nodes."""
        return self.column.size

    @property
    def x_mm(self) -> FloatArray:
        """Positions across the finger in mm, ``(n,)``."""
        return self.pad.x_mm[self.column]

    @property
    def z_mm(self) -> FloatArray:
        """Positions along the finger in mm, ``(n,)``."""
        return np.asarray(self.row * self.pad.spacing_mm, dtype=np.float64)

    @property
    def height_mm(self) -> FloatArray:
        """Heights of the skin over its apex in mm, ``(n,)``."""
        return self.pad.height_of_nodes_mm(self)

    @property
    def area_mm2(self) -> FloatArray:
        """Skin that each node stands for in mm², ``(n,)``."""
        return self.pad.node_mm2[self.column]

    def subset(self, rows: BoolArray | IntArray) -> "LatticeNodes":
        """Nodes of a mask ``(n,)`` or of numbers from 0."""
        return LatticeNodes(self.pad, self.column[rows], self.row[rows])

    def compliance(self, drag: tuple[float, float] = (0.0, 0.0)) -> Compliance:
        """How far each goes into the skin under 1 N on each, see `SkinNodes`."""
        return self.pad.compliance_of(self, drag)

    def spread_on_pad(
        self, forces_n: FloatArray | SingleArray
    ) -> tuple["SkinNodes", FloatArray | SingleArray]:
        """Nodes with known stress, and the forces on them, see `SkinNodes`."""
        return self.pad.spread_on_pad(self, forces_n)

    def cells(self) -> SkinCells:
        """All columns, and the rows from the first of these nodes to the last, see `SkinNodes`."""
        pad, first, last = self.pad, int(self.row.min()), int(self.row.max())
        middle = 0.5 * (pad.x_mm[1:] + pad.x_mm[:-1])
        edge_mm = np.concatenate(
            [2 * pad.x_mm[:1] - middle[:1], middle, 2 * pad.x_mm[-1:] - middle[-1:]]
        )
        edge_rows = first + np.arange(last - first + 2) - 0.5

        def values(pressure: FloatArray) -> FloatArray:
            grid = np.full((last - first + 1, pad.x_mm.size), np.nan)
            grid[self.row - first, self.column] = np.where(pressure > 0, pressure, np.nan)
            return grid

        along_mm = np.asarray(edge_rows * pad.spacing_mm, dtype=np.float64)
        return SkinCells(edge_mm, along_mm, None, values)

    def to_arrays(self) -> dict[str, IntArray]:
        """Columns and rows of the nodes."""
        return {"column": self.column, "row": self.row}


def _lattice(nodes: SkinNodes) -> LatticeNodes:
    """`nodes`, which are those of a prism."""
    if not isinstance(nodes, LatticeNodes):
        raise TypeError(f"{type(nodes).__name__}, expected nodes of a prism")
    return nodes


def finger_extent_mm(finger: Finger) -> tuple[FloatArray, FloatArray, float, float]:
    """Half the skin of a finger for a population, see `Pad.extent_mm`."""
    return _extent_mm(section_of(finger))


def _extent_mm(section: Section) -> tuple[FloatArray, FloatArray, float, float]:
    widest = int(section.point_mm[:, 0].argmax())
    outline_mm = section.finger.outline.half_width_mm
    half_mm = min(_HALF_WIDTH_MM, 0.9 * outline_mm)
    half_length_mm = min(_HALF_LENGTH_MM, _HALF_LENGTH_HALF_WIDTHS * outline_mm)
    arc_mm, x_mm = section.arc_mm[: widest + 1], section.point_mm[: widest + 1, 0]
    return arc_mm, x_mm, half_mm, half_length_mm


def cubic_weights(grid: FloatArray, at: FloatArray) -> tuple[IntArray, FloatArray]:
    """Four places of a rising `grid` around each of `at` ``(A,)``, and Lagrange's weights.

    Both ``(A, 4)``. Beyond the grid it is its end.
    """
    inside = np.clip(at, grid[0], grid[-1])
    first = np.clip(np.searchsorted(grid, inside) - 2, 0, grid.size - 4)
    index = first[:, None] + np.arange(4)
    knots = grid[index]
    weight = np.ones(index.shape)
    for knot in range(4):
        for other in range(4):
            if knot != other:
                weight[:, knot] *= (inside - knots[:, other]) / (knots[:, knot] - knots[:, other])
    return index, weight
