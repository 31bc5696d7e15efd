"""The pad of a finger: what a unit force anywhere on its skin does to skin and afferents.

The finger is a prism along z, so a response depends on where across the finger force and
place are, ``x'`` and ``x``, and on ``z - z'``. It is a mirror image of itself about
``x = 0`` and about ``z = 0``: stored are forces with ``x' >= 0`` and places with
``z >= 0``, signs give the rest.

A plane pad is a slice of 1 mm in plane strain: what touches it has no end along z.

Stress is that in the middle of elements, from displacements and the material of that
element alone: nothing is averaged over two layers. `stress_rows` are rows of elements of
one layer, along the skin.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from decks.finger import Finger
from decks.section import Section, section_of
from fembridge.errors import ResponseError, UsageError
from fembridge.memory import check_memory
from fembridge.typing import FloatArray, IntArray, SingleArray

COMPONENTS = ("xx", "yy", "zz", "xy", "yz", "zx")
# What becomes of a stress or a force component under a mirror.
STRESS_FLIP = {"x": np.array([1, 1, 1, -1, 1, -1]), "z": np.array([1, 1, 1, 1, -1, -1])}
FORCE_FLIP = {"x": np.array([-1, 1, 1]), "z": np.array([1, 1, -1])}

# Nodes that may touch lie within half of this of the pad's middle, along the finger.
LATTICE_LENGTH_MM = 24.0


@dataclass(frozen=True, slots=True, eq=False)
class StressRow:
    """Middles of a row of elements of `layer`, from the apex to the right.

    `arc_mm` and `depth_mm` ``(M,)``: along the smooth skin, and below it.
    """

    layer: str
    arc_mm: FloatArray
    depth_mm: FloatArray


@dataclass(frozen=True, eq=False)
class Pad:
    """Responses of the skin of `finger` to unit forces on it.

    `x_mm` ``(N,)`` and `y_mm` ``(N,)`` are the nodes that may touch, from left to right;
    on the finger they are `spacing_mm` apart along z. `z_mm` ``(K,)`` >= 0 are places of
    displacements, `stress_z_mm` ``(K - 1,)`` those of stresses.

    `down_mm` ``(3, N', N, K)`` is how far node n, z away, goes into the skin under 1 N
    on node n' along x, into the skin, along z; n' counts the nodes with x >= 0.
    `stress_pa` ``(R, 3, 6, N', 2 M, K - 1)`` is the stress in the middle of element m of
    `rows` ``R``, from left to right.
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

    BEYOND_ROWS: ClassVar[float] = 0.75
    """A unit may be this share of a row's thickness above or below the middles of rows."""

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
        place, weight = cubic_weights(mirrored, at_mm)
        weight[at_mm > self.z_mm[-1]] = 0.0
        spread = np.zeros((mirrored.size, at_mm.size))
        np.add.at(spread, (place, np.arange(at_mm.size)[:, None]), weight)
        far = self.z_mm.size - 1
        found = [
            table @ (spread[far:] + flip * np.pad(spread[far - 1 :: -1], ((1, 0), (0, 0))))
            for table, flip in zip(self.compliance, FORCE_FLIP["z"], strict=True)
        ]
        return np.stack(found)

    def depth_range_mm(self, layer: str, x_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Least and largest depth of which stress is held in `layer` under skin at `x_mm`.

        Raises
        ------
        UsageError
            The pad holds no stress in this layer.
        """
        rows = [row for row in self.rows if row.layer == layer]
        if len(rows) < 2:
            layers = ", ".join(dict.fromkeys(row.layer for row in self.rows))
            raise UsageError(f"the pad holds no stress in {layer}, but in {layers}")
        arc_mm = np.abs(self.arc_at(x_mm))
        upper, *_, lower = depths = [np.interp(arc_mm, row.arc_mm, row.depth_mm) for row in rows]
        least_mm = upper - self.BEYOND_ROWS * (depths[1] - upper)
        most_mm = lower + self.BEYOND_ROWS * (lower - depths[-2])
        return least_mm, most_mm

    def arc_at(self, x_mm: FloatArray) -> FloatArray:
        """Way along the smooth skin from the apex to `x_mm`, signed as it is."""
        section = self.section
        widest = int(section.point_mm[:, 0].argmax())
        x, arc = section.point_mm[: widest + 1, 0], section.arc_mm[: widest + 1]
        found: FloatArray = np.sign(x_mm) * np.interp(np.abs(x_mm), x, arc)
        return found

    def normal_at(self, x_mm: FloatArray) -> FloatArray:
        """Normal of the smooth skin in the section ``(place, 2)`` at `x_mm`."""
        right = self.section.point_mm[: int(self.section.point_mm[:, 0].argmax())]
        slope = np.sign(x_mm) * np.interp(
            np.abs(x_mm), right[:, 0], np.gradient(right[:, 1], right[:, 0])
        )
        return np.stack([-slope, np.ones_like(slope)], -1) / np.hypot(slope, 1.0)[:, None]


def cubic_weights(grid: FloatArray, at: FloatArray) -> tuple[IntArray, FloatArray]:
    """Four places of a rising `grid` around each of `at` ``(A,)``, and Lagrange's weights.

    Both ``(A, 4)``. Beyond the grid it is its end.
    """
    inside = np.clip(at, grid[0], grid[-1])
    first = np.clip(np.searchsorted(grid, inside) - 2, 0, grid.size - 4)
    place = first[:, None] + np.arange(4)
    knots = grid[place]
    weight = np.ones(place.shape)
    for one in range(4):
        for other in range(4):
            if one != other:
                weight[:, one] *= (inside - knots[:, other]) / (knots[:, one] - knots[:, other])
    return place, weight
