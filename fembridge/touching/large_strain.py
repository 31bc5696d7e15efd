"""Large strain under a deep touch: skin and contact that turn, and pulp that stiffens.

Superposition of unit forces is that of small strain. What a deep touch adds is computed as further
loads on the same Green's functions, so that a pad needs no more numbers:

- *Rotation of the skin.* Stratum corneum and epidermis, 80 times as stiff as the tissue below,
  are a sheet of thickness h whose tangents t, z and normal n turn by ``omega = n . du/ds``. With
  ``epsilon = t . du/ds`` its strain is Green's, ``epsilon + (epsilon^2 + omega^2) / 2``: a plate
  that flattens skin compresses it by half of what small strain says. The quadratic part is an
  initial strain E0 of stress S0; the virtual work of the membrane forces N is that of

      h S0 t + N (epsilon t + omega n),    N = h (S0 + stress of the superposed forces)

  on the gradients of displacement, exact for a sheet of Hooke's law of Green's strain
  (von Karman's plate with all of its terms). S0 acts in the middle of the sheet.
- *Contact that turns.* A shape without friction presses along the normal of the pressed skin: with
  each force into the skin come forces along x and z, its slope times as large. A ball pushes the
  skin below it outward and stretches it.
- *Pulp that stiffens.* A column of tissue of height H between skin and bone, compressed by w,
  pushes back by the pressure ``PRESSURE M e^PRESSURE_POWER`` more than superposition says; e is
  w / H, averaged over `SPREAD_MM`, M the modulus of the tissue that cannot move aside. Within the
  tissue its compression adds ``STRESS M (w / H)^STRESS_POWER`` along the normal. The constants are
  those of a first-order Ogden law with the moduli of the finger and ``alpha = 6.82`` (heel pad,
  Erdemir et al. 2006, J. Biomech. 39:1279), fitted to whole contact runs of CalculiX with a
  plate and a ball (decision 0058).

These loads depend on displacements and these on the loads: contact and loads are solved in turn,
with Anderson's acceleration. Up to `SMALL_UM` all of it is left out, so that touches that
parameters are fitted on stay what they are; from `FULL_UM` on it counts in full.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, TypeGuard

import numpy as np
from numpy.typing import NDArray

from fembridge.errors import UsageError
from fembridge.host.progress import advance
from fembridge.touching.compliance import Compliance
from fembridge.touching.contact import (
    DEEPEST_UM,
    MM_PER_UM,
    STRONGEST_N,
    ContactSolver,
    blas_threads,
    depth_of_force_mm,
    press_to,
)
from fembridge.touching.pad import Pad, SkinCells, SkinNodes
from fembridge.touching.prism_pad import (
    FORCE_FLIP,
    LatticeNodes,
    PrismPad,
    cubic_weights,
)
from fembridge.touching.ridged_pad import RidgedPad
from fembridge.touching.shape import Shape
from fembridge.trace import PA_PER_MPA
from fembridge.typing import BoolArray, FloatArray, IntArray, SingleArray

if TYPE_CHECKING:
    from fembridge.touching.grid_contact import GridContactSolver

# Up to here touches are those of small strain; from the second depth on, large strain in full.
SMALL_UM, FULL_UM = 300.0, 800.0
# Pressure of the compressed pulp, and stress within it: shares of its modulus, and powers.
PRESSURE, PRESSURE_POWER, SPREAD_MM = 10.0, 3.5, 2.0
STRESS, STRESS_POWER = 13.0, 4.0
# Loads and rotations are averaged over this standard deviation: shorter waves bend a sheet of
# 0.65 mm less than a sheet that is thin.
EVEN_MM = 0.3
# Skin that bulges comes this far towards the shape.
_BULGE_MM = 0.3
# Contact and loads are solved in turn until the loads change by the first share of themselves;
# after the most rounds by the second: nodes at the rim of a contact come and go, by which its force
# changes by less than 0.1 %. So many changes are remembered, and this share of a change is taken.
_SETTLED, _TOLERABLE, _MOST_ROUNDS = 0.003, 0.05, 40
_REMEMBERED, _TAKEN = 5, 0.6
# Memory of the stress by wave number that is kept of a pad.
MOST_BYTES = 256_000_000
_LAYER, _TISSUE = "epidermis", "subcutaneous_tissue"


@dataclass(frozen=True, eq=False)
class LargeStrain:
    """Loads on the nodes of a pad that stand for contact and large strain, in the states solved.

    Parameters
    ----------
    pad
        Pad of the nodes, without ridges.
    loads_n
        Forces in N along x, into the skin and along z, ``(S, 3, column, row)``.
    depth_um
        Depths of the shape in um, ``(S,)``.
    """

    pad: PrismPad
    loads_n: SingleArray
    depth_um: FloatArray

    @cached_property
    def fields(self) -> "_Fields":
        """Stress on the lattice of the pad."""
        return _Fields(sheet_of(self.pad), self.loads_n, self.depth_um)

    def stressed(self, states: slice | IntArray) -> tuple["StressedStates", SingleArray]:
        """States as nodes whose unit forces have the stress of these states, and unit forces.

        Parameters
        ----------
        states
            States from the first to the last, or their numbers from 0.
        """
        numbers = np.arange(len(self.loads_n))[states]
        return StressedStates(self, numbers), np.eye(numbers.size, dtype=np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class StressedStates(SkinNodes):
    """States of a deep touch instead of nodes: a unit force on one is the state itself."""

    large_strain: LargeStrain
    states: IntArray

    @property
    def pad(self) -> Pad:  # type: ignore[override]  # a property in the place of an attribute
        """Pad of the states."""
        return self.large_strain.pad

    @property
    def size(self) -> int:
        """Number of states."""
        return self.states.size

    @property
    def x_mm(self) -> FloatArray:
        """The middle of the pad."""
        return np.zeros(self.size)

    z_mm = height_mm = area_mm2 = x_mm

    def subset(self, rows: BoolArray | IntArray) -> "StressedStates":
        """States of a mask ``(n,)`` or of numbers from 0."""
        return StressedStates(self.large_strain, self.states[rows])

    def compliance(self, drag: tuple[float, float] = (0.0, 0.0)) -> Compliance:
        """States have none."""
        raise NotImplementedError

    def cells(self) -> SkinCells:
        """States have none."""
        raise NotImplementedError

    def to_arrays(self) -> dict[str, IntArray]:
        """Numbers of the states."""
        return {"states": self.states}

    def own_influence_pa(
        self, layer: NDArray[np.str_], x_mm: FloatArray, z_mm: FloatArray, depth_mm: FloatArray
    ) -> SingleArray:
        """Stress ``(6, place, state)`` in Pa of the states, see `SkinNodes`."""
        return self.large_strain.fields.stress_pa(layer, x_mm, z_mm, depth_mm)[..., self.states]


def has_large_strain(pad: Pad) -> TypeGuard[PrismPad]:
    """Whether large strain can be computed on `pad`: the prism of a smooth finger."""
    if not isinstance(pad, PrismPad) or pad.plane or pad.finger.ridges.height_mm:
        return False
    layers = [row.layer for row in pad.rows]
    return layers.count(_LAYER) > 1 and _TISSUE in pad.finger.materials


def is_deep(pad: Pad, shape: Shape, level: FloatArray, *, by_force: bool) -> bool:
    """Whether `shape` is pressed deeper than small strain goes, by `level` um, or N by force.

    Raises
    ------
    UsageError
        A shape beside the pad.
    """
    most = float(level.max())
    if not by_force:
        return most > SMALL_UM
    if most <= 0:
        return False
    pad.first_touch_mm(shape)
    try:
        return float(press_to(pad, shape, np.array([most]), by_force=True)[2][0]) > SMALL_UM
    except UsageError:  # deeper than small strain is solved for
        return True


def share_of_large_strain(depth_um: float) -> float:
    """Share of the further loads that counts at a depth: 0 up to `SMALL_UM`, 1 from `FULL_UM`."""
    part = min(max((depth_um - SMALL_UM) / (FULL_UM - SMALL_UM), 0.0), 1.0)
    return part * part * (3.0 - 2.0 * part)


def press_deep(
    pad: PrismPad, shape: Shape, level: FloatArray, *, by_force: bool = False
) -> tuple[LatticeNodes, FloatArray, FloatArray, LargeStrain]:
    """Nodes that `shape` touches, forces ``(S, node)``, depths ``(S,)`` in um, and large strain.

    `level` ``(S,)`` rises: depths in um from first touch, or with `by_force` forces.

    Raises
    ------
    UsageError
        A shape beside the pad, deeper than `DEEPEST_UM` or with more than `STRONGEST_N`.
    """
    if by_force and level.max() > STRONGEST_N:
        raise UsageError(
            argument="press_n",
            found=float(level.max()),
            expected=f"at most {DEEPEST_UM:g} um and {STRONGEST_N:g} N",
        )
    sheet = sheet_of(pad.smooth_pad if isinstance(pad, RidgedPad) else pad)
    nodes = pad.skin_nodes()
    gap_mm = nodes.gaps_mm(shape) - pad.first_touch_mm(shape)
    reached = np.asarray(gap_mm < _reach_mm(nodes, gap_mm, float(level.max()), by_force=by_force))
    nodes, gap_mm = nodes.subset(reached), gap_mm[reached]
    touch = _DeepTouch(sheet, nodes, gap_mm)
    forces = np.empty((level.size, gap_mm.size))
    loads = np.empty((level.size, *sheet.shape), dtype=np.float32)
    depth_um = np.empty(level.size)
    with blas_threads(touch.contact.nodes_at_once):
        for step, pressed in enumerate(level.tolist()):
            forces[step], depth_um[step], loads[step] = touch.press(pressed, by_force=by_force)
            advance("contact", (step + 1) / level.size)
    return nodes, forces, depth_um, LargeStrain(sheet.pad, loads, depth_um)


def _reach_mm(nodes: SkinNodes, gap_mm: FloatArray, most: float, *, by_force: bool) -> float:
    """Gap up to which nodes may touch at the level `most`."""
    reach_mm = DEEPEST_UM * MM_PER_UM
    if not by_force:
        reach_mm = min(most * MM_PER_UM, reach_mm)
    else:
        with suppress(UsageError):  # deeper than small strain is solved for
            reach_mm = min(reach_mm, 1.5 * depth_of_force_mm(nodes, gap_mm, most))
    return reach_mm + _BULGE_MM


class _DeepTouch:
    """Contact of nodes with their large strain, level after level."""

    def __init__(self, sheet: "SkinSheet", nodes: LatticeNodes, gap_mm: FloatArray) -> None:
        self._sheet, self._nodes, self._gap_mm = sheet, nodes, gap_mm
        self.contact: ContactSolver | GridContactSolver = ContactSolver.on_nodes(nodes)
        self._further = np.zeros(sheet.shape)
        self._between = _Between(sheet, nodes)

    def press(self, level: float, *, by_force: bool) -> tuple[FloatArray, float, FloatArray]:
        """Forces in N, depth in um and loads ``(3, column, row)`` at a level."""
        sheet, further = self._sheet, self._further
        solution, least = _Anderson(), np.inf
        best: tuple[FloatArray, FloatArray, float, FloatArray] | None = None
        for number in range(_MOST_ROUNDS):
            gap_mm = self._gap_mm
            if further.any():
                gap_mm = gap_mm + self._between.at_nodes(sheet.down_mm(further))
            forces, depth_mm = self.contact.press_by(gap_mm, level, by_force=by_force)
            total_n, depth_um = float(forces.sum()), max(depth_mm / MM_PER_UM, 0.0)
            _check_range(total_n, depth_um, 1.3)  # on the way it may be deeper
            contact = self._between.on_pad(forces)
            loads = further + contact
            share = share_of_large_strain(depth_um)
            change = (share * sheet.further_loads(loads, contact[1]) if share else 0.0) - further
            scale_n = max(total_n, float(np.abs(further).sum()))
            error = float(np.abs(change).sum()) / max(scale_n, 1e-300)
            if error < least:
                least, best = error, (further, forces, depth_um, loads)
            if best and least <= (_SETTLED if number < _MOST_ROUNDS - 1 else _TOLERABLE):
                self._further, forces, depth_um, loads = best
                _check_range(float(forces.sum()), depth_um, 1.001)
                return forces, depth_um, loads
            further = solution.next(further, change)
        raise UsageError(
            "the skin under the shape did not settle: expected less depth or a rounder shape",
            found=level,
            expected=f"at most {DEEPEST_UM:g} um and {STRONGEST_N:g} N",
        )


class _Between:
    """Between the nodes that may touch and those of the pad, among which values are read."""

    def __init__(self, sheet: "SkinSheet", nodes: LatticeNodes) -> None:
        self._shape = sheet.shape
        self._weights, on_pad = nodes.pad.weights_on_pad(nodes)
        self._on_pad = on_pad.column, on_pad.row + sheet.pad.end_row

    def on_pad(self, forces_n: FloatArray) -> FloatArray:
        """Loads of forces ``(n,)`` on nodes that touch."""
        loads = np.zeros(self._shape)
        loads[1][self._on_pad] = self._weights.T @ forces_n
        return loads

    def at_nodes(self, values: FloatArray) -> FloatArray:
        """Values ``(N, R)`` of the pad's nodes at nodes that touch, ``(n,)``."""
        return np.asarray(self._weights @ values[self._on_pad])


def _check_range(total_n: float, depth_um: float, share: float) -> None:
    """Refuse a touch beyond a share of the range."""
    if depth_um > share * DEEPEST_UM or total_n > share * STRONGEST_N:
        expected = f"at most {DEEPEST_UM:g} um and {STRONGEST_N:g} N"
        raise UsageError(
            f"the shape would be {depth_um:.0f} um deep with {total_n:.3g} N, expected {expected}",
            found=depth_um if depth_um > DEEPEST_UM else total_n,
            expected=expected,
        )


class _Anderson:
    """Anderson's acceleration of a fixed point (Anderson 1965, J. ACM 12:547)."""

    def __init__(self) -> None:
        self._past: list[tuple[FloatArray, FloatArray]] = []

    def next(self, point: FloatArray, change: FloatArray) -> FloatArray:
        """The next point from one and its change."""
        past = self._past
        past.append((point.ravel(), change.ravel()))
        del past[: -_REMEMBERED - 1]
        following = point + _TAKEN * change
        if len(past) > 1:
            pairs = list(pairwise(past))
            points = np.stack([after[0] - before[0] for before, after in pairs], -1)
            changes = np.stack([after[1] - before[1] for before, after in pairs], -1)
            weights = np.linalg.lstsq(changes, change.ravel(), rcond=1e-6)[0]
            following -= ((points + _TAKEN * changes) @ weights).reshape(point.shape)
        return following


@dataclass(frozen=True, eq=False)
class SkinSheet:
    """The stiff skin of a pad as a sheet, and the loads that its large strain stands for.

    Nodes are those of the pad, ``(N, R)`` columns and rows; cells lie between four of them. `n` is
    the outward normal, `t` the direction along the skin to the right.
    """

    pad: PrismPad

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape of loads: directions, columns and rows."""
        return 3, self.pad.x_mm.size, 2 * self.pad.end_row + 1

    @cached_property
    def thickness_mm(self) -> float:
        """Thickness of stratum corneum and epidermis in mm."""
        return self.pad.finger.skin.epidermis_depth_mm

    @cached_property
    def arc_mm(self) -> FloatArray:
        """Position of the columns along the skin in mm, ``(N,)``."""
        return self.pad.arc_at(self.pad.x_mm)

    @cached_property
    def cell_arc_mm(self) -> FloatArray:
        """Position of the middles of the cells along the skin in mm, ``(N - 1,)``."""
        return 0.5 * (self.arc_mm[1:] + self.arc_mm[:-1])

    @cached_property
    def _normal(self) -> FloatArray:
        """Normal, x and y, in the middle of the cells, ``(2, N - 1, 1)``."""
        return self.normal_at(self.cell_arc_mm)

    def normal_at(self, arc_mm: FloatArray) -> FloatArray:
        """Normal, x and y, at positions along the skin, ``(2, P, 1)``."""
        section = self.pad.section
        x_mm = np.sign(arc_mm) * np.interp(np.abs(arc_mm), section.arc_mm, section.point_mm[:, 0])
        normal: FloatArray = self.pad.normal_at(x_mm, np.zeros_like(x_mm)).T[:2, :, None]
        return normal

    @cached_property
    def bone_mm(self) -> FloatArray:
        """Distance of the columns from the bone in mm, ``(N, 1)``: height of the pulp and skin."""
        bone = self.pad.finger.bone
        angle = np.linspace(0.0, 2 * np.pi, 2_000)
        x_mm = bone.half_width_mm * np.cos(angle) - self.pad.x_mm[:, None]
        y_mm = bone.half_height_mm * np.sin(angle) - bone.depth_mm - self.pad.y_mm[:, None]
        return np.asarray(np.hypot(x_mm, y_mm).min(axis=1, keepdims=True))

    @property
    def column_mpa(self) -> float:
        """Modulus of pulp that cannot move aside, in MPa."""
        tissue = self.pad.finger.materials[_TISSUE]
        return tissue.bulk_mpa + 4 / 3 * tissue.shear_mpa

    # ---- Displacement and stress under loads

    @cached_property
    def _length(self) -> int:
        return 2 * self.shape[2]

    @cached_property
    def _down(self) -> SingleArray:
        """Displacement into the skin by wave number, see `_even_waves`: ``(K, N, 3 N')``."""
        table = self.pad.lattice_compliance[..., : self.shape[2]]
        around = np.zeros((*table.shape[:3], self._length), dtype=np.float32)
        around[..., : table.shape[3]] = table
        flip = FORCE_FLIP["z"][:, None, None, None]
        around[..., self._length - table.shape[3] + 1 :] = flip * table[..., :0:-1]
        waves = np.fft.rfft(around, axis=-1).astype(np.complex64)
        by_wave = np.ascontiguousarray(waves.transpose(3, 2, 0, 1))
        return self._even_waves(by_wave.reshape(len(by_wave), 1, self.shape[1], -1), [])

    @cached_property
    def _membrane(self) -> SingleArray:
        """Stress tt, zz, nn, tz in the middle of the sheet by wave number, ``(K, 4 C, 3 N')``."""
        row = next(n for n, row in enumerate(self.pad.rows) if row.layer == _LAYER)
        middles = self.pad.rows[row].arc_mm
        waves = self._stress_waves(row).reshape(-1, 6, 2 * middles.size, 3 * self.shape[1])
        at, weight = cubic_weights(np.concatenate([-middles[::-1], middles]), self.cell_arc_mm)
        xx, yy, zz, xy, yz, zx = (
            np.einsum("kcqn,cq->kcn", waves[:, part][:, at], weight) for part in range(6)
        )
        nx, ny = self._normal.astype(np.float32)
        tt = ny * ny * xx + nx * nx * yy - 2 * nx * ny * xy
        nn = nx * nx * xx + ny * ny * yy + 2 * nx * ny * xy
        tensor = np.stack([tt, zz, nn, ny * zx - nx * yz], axis=1).astype(np.complex64)
        return self._even_waves(tensor, [3])

    def _even_waves(self, by_wave: NDArray[np.complex64], odd: Sequence[int]) -> SingleArray:
        """Waves ``(K, part, place, 3 N')`` as real numbers, ``(K, part x place, 3 N')``.

        The pad is its own mirror image along z: a wave is real or imaginary. These are the real
        ones of forces times i along z, and of the `odd` parts divided by i.
        """
        by_wave[..., 2 * self.shape[1] :] /= 1j
        by_wave[:, odd] /= 1j
        return np.ascontiguousarray(by_wave.real).reshape(len(by_wave), -1, by_wave.shape[-1])

    def _even_stress_waves(self, row: int) -> SingleArray:
        """`_stress_waves` as real numbers (`_even_waves`), kept for the touches to come."""
        kept = self._kept_waves
        if row in kept:
            return kept[row]
        by_wave = self._stress_waves(row)
        by_part = by_wave.reshape(len(by_wave), 6, -1, 3 * self.shape[1])
        waves = self._even_waves(by_part, [4, 5])
        # Touches take the rows in turn: dropping the one used longest ago would drop each.
        if sum(table.nbytes for table in kept.values()) + waves.nbytes <= MOST_BYTES:
            kept[row] = waves
        return waves

    @cached_property
    def _kept_waves(self) -> dict[int, SingleArray]:
        return {}

    def _stress_waves(self, row: int) -> NDArray[np.complex64]:
        """Stress in MPa in a row of elements by wave number, ``(K, 6 x 2 M, 3 N')``."""
        pad, (_, columns, rows) = self.pad, self.shape
        middle = pad.stress_z_mm
        along = np.concatenate([-middle[::-1], middle])
        apart_mm: FloatArray = np.asarray(
            np.arange(-rows + 1, rows) * pad.spacing_mm, dtype=np.float64
        )
        at, weight = cubic_weights(along, apart_mm)
        spread = np.zeros((along.size, apart_mm.size), dtype=np.float32)
        np.add.at(spread, (at, np.arange(apart_mm.size)[:, None]), weight)
        beyond = np.abs(apart_mm) > middle[-1]
        spread[:, beyond] *= np.exp((middle[-1] - np.abs(apart_mm[beyond])) / 5.0)
        parts = []
        for direction in range(3):
            force = (float(direction == 0), float(direction == 1), float(direction == 2))
            table = pad.stress_table_pa(np.array([row]), np.arange(columns) - columns // 2, force)
            table = table.reshape(-1, along.size) @ spread / np.float32(PA_PER_MPA)
            around = np.zeros((len(table), self._length), dtype=np.float32)
            around[:, :rows] = table[:, rows - 1 :]
            around[:, self._length - rows + 1 :] = table[:, : rows - 1]
            waves = np.fft.rfft(around, axis=-1).astype(np.complex64)
            parts.append(waves.T.reshape(waves.shape[-1], -1, 6, columns))
        waves = np.concatenate(parts, axis=-1).transpose(0, 2, 1, 3)
        return np.ascontiguousarray(waves).reshape(len(waves), -1, 3 * columns)

    def _waves(self, loads: FloatArray | SingleArray) -> NDArray[np.complex64]:
        """Loads ``(..., 3, N, R)`` by wave number, ``(K, 3 N, ...)``."""
        from scipy.fft import rfft

        waves = rfft(np.asarray(loads, dtype=np.float32), self._length, axis=-1)
        flat = waves.reshape(*waves.shape[:-3], -1, waves.shape[-1])
        return np.ascontiguousarray(np.moveaxis(flat, (-1, -2), (0, 1)))

    def _rows(self, waves: NDArray[np.complex64]) -> SingleArray:
        """Values ``(R, ...)`` of values by wave number ``(K, ...)``."""
        from scipy.fft import irfft

        values: SingleArray = irfft(waves, self._length, axis=0)
        return values[: self.shape[2]]

    def down_mm(self, loads: FloatArray) -> FloatArray:
        """Displacement into the skin in mm, ``(N, R)``, under `loads` ``(3, N, R)``."""
        waves = np.matmul(self._down, self.real_waves(loads[None])).view(np.complex64)
        return self._rows(waves[..., 0]).T.astype(np.float64)

    def _membrane_mpa(self, loads: FloatArray) -> FloatArray:
        """Stress tt, zz, nn, tz in the middle of the sheet in the cells, ``(4, N - 1, R - 1)``."""
        waves = np.matmul(self._membrane, self.real_waves(loads[None])).view(np.complex64)[..., 0]
        waves[:, waves.shape[1] * 3 // 4 :] *= 1j
        at_nodes = self._rows(waves).T.astype(np.float64).reshape(4, -1, self.shape[2])
        return 0.5 * (at_nodes[..., 1:] + at_nodes[..., :-1])

    def real_waves(self, loads: FloatArray | SingleArray) -> SingleArray:
        """Loads ``(S, 3, N, R)`` by wave number, for `_even_waves`: ``(K, 3 N, 2 S)``.

        Real parts of all loads come first, then the imaginary parts.
        """
        waves = self._waves(loads)
        waves[:, 2 * self.shape[1] :] *= 1j
        return np.concatenate([waves.real, waves.imag], axis=-1)

    @cached_property
    def _back(self) -> tuple[SingleArray, SingleArray]:
        """Cosines and sines ``(R, K)`` by which values are the sum of their waves.

        With 25 states that product takes half the time of a fast transform.
        """
        count = self._length // 2 + 1
        angle = 2 * np.pi / self._length * np.outer(np.arange(self.shape[2]), np.arange(count))
        twice = np.full(count, 2.0 / self._length)
        twice[[0, -1]] /= 2  # the length is even
        cosine, sine = np.cos(angle) * twice, -np.sin(angle) * twice
        return cosine.astype(np.float32), sine.astype(np.float32)

    def row_mpa(self, row: int, waves: SingleArray) -> SingleArray:
        """Stress in a row of elements in MPa, ``(2 M, R, 6, S)``, under loads by wave number."""
        product = np.matmul(self._even_stress_waves(row), waves)
        count, states = len(product), waves.shape[-1] // 2
        by_part = product.reshape(count, 6, -1, 2, states)
        real, imaginary = by_part[..., 0, :].copy(), by_part[..., 1, :].copy()
        real[:, 4:], imaginary[:, 4:] = -by_part[:, 4:, :, 1], by_part[:, 4:, :, 0]  # times i
        cosine, sine = self._back
        values = cosine @ real.reshape(count, -1)
        values += sine @ imaginary.reshape(count, -1)
        return np.ascontiguousarray(
            values.reshape(-1, 6, real.shape[2], states).transpose(2, 0, 1, 3)
        )

    # ---- Large strain

    def further_loads(self, loads: FloatArray, contact_n: FloatArray) -> FloatArray:
        """Loads ``(3, N, R)`` in N that stand for the large strain under `loads` of that shape.

        `contact_n` ``(N, R)`` is the part of the loads into the skin that the shape presses with.
        """
        loads = self._even(loads)
        down_mm = self.down_mm(loads)
        initial, membrane, strain, turn = self._sheet_strain(loads, down_mm)
        h = self.thickness_mm
        own, total = h * initial, h * (initial + membrane)
        nx, ny = self._normal
        # Tractions on gradients along the skin (s) and along the finger (z).
        along_s = own[0] + total[0] * strain[0], own[2] + total[2] * strain[1]
        along_z = own[2] + total[2] * strain[0], own[1] + total[1] * strain[1]
        up_s = total[0] * turn[0] + total[2] * turn[1]
        up_z = total[2] * turn[0] + total[1] * turn[1]
        tangential = self._divergence(along_s[0], along_z[0])
        axial = self._divergence(along_s[1], along_z[1])
        # These act in the middle of the sheet: on its surface they come with a moment.
        moment_s, moment_z = 0.5 * h * self._density(tangential), 0.5 * h * self._density(axial)
        up_s, up_z = up_s - moment_s, up_z - moment_z
        x_n = self._divergence(along_s[0] * ny + up_s * nx, along_z[0] * ny + up_z * nx)
        y_n = self._divergence(-along_s[0] * nx + up_s * ny, -along_z[0] * nx + up_z * ny)
        pressed_n = self.pressure_mpa(down_mm) * self._node_mm2
        beside_n = self.beside_n(contact_n, down_mm)
        further = self._even(np.stack([x_n + beside_n[0], -y_n, axial + beside_n[1]]))
        further[1] -= pressed_n
        return further

    def beside_n(self, contact_n: FloatArray, down_mm: FloatArray) -> FloatArray:
        """Forces along x and z, ``(2, N, R)``, that come with forces into the pressed skin.

        Without friction a shape presses along the normal of the pressed skin: with 1 N into the
        skin comes its slope in N, outward in a hollow.
        """
        rise_mm = self.pad.y_mm[:, None] - down_mm
        slope_x = np.gradient(rise_mm, self.pad.x_mm, axis=0)
        slope_z = np.gradient(rise_mm, self.pad.spacing_mm, axis=1)
        return np.stack([contact_n * slope_x, contact_n * slope_z])

    def _even(self, loads: FloatArray) -> FloatArray:
        """Loads ``(3, N, R)`` without waves that are too short for a sheet."""
        from scipy.ndimage import gaussian_filter

        width = EVEN_MM / self.pad.spacing_mm
        return np.asarray(gaussian_filter(loads, (0.0, width, width), mode="reflect"))

    def initial_stress_mpa(self, loads: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Initial stress tt, zz, tz in the cells, ``(3, N - 1, R - 1)``, and displacement."""
        loads = self._even(loads)
        down_mm = self.down_mm(loads)
        return self._sheet_strain(loads, down_mm)[0], down_mm

    def _sheet_strain(
        self, loads: FloatArray, down_mm: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Initial and superposed stress tt, zz, tz, strain and rotation along s and z, in cells."""
        material = self.pad.finger.materials[_LAYER]
        young, poisson = material.young_mpa, material.poisson
        tt, zz, nn, tz = self._membrane_mpa(loads)
        nx, ny = self._normal
        along_s = (tt - poisson * (zz + nn)) / young
        along_z = (zz - poisson * (tt + nn)) / young
        slope_s, slope_z = self._slopes(down_mm)
        turn_s, turn_z = (along_s * nx - slope_s) / ny, -slope_z / ny
        green_s = 0.5 * (along_s**2 + turn_s**2)
        green_z = 0.5 * (along_z**2 + turn_z**2)
        plane = young / (1 - poisson**2)
        initial = plane * np.stack(
            [
                green_s + poisson * green_z,
                green_z + poisson * green_s,
                0.5 * (1 - poisson) * turn_s * turn_z,
            ]
        )
        superposed = np.stack([tt, zz, tz])
        return initial, superposed, np.stack([along_s, along_z]), np.stack([turn_s, turn_z])

    def pressure_mpa(self, down_mm: FloatArray) -> FloatArray:
        """Pressure of compressed pulp besides that of small strain in MPa, ``(N, R)``."""
        from scipy.ndimage import gaussian_filter

        compressed = np.maximum(down_mm, 0.0) / self.bone_mm
        even = gaussian_filter(compressed, SPREAD_MM / self.pad.spacing_mm)
        return np.asarray(PRESSURE * self.column_mpa * even**PRESSURE_POWER)

    def tissue_stress_mpa(self, down_mm: FloatArray) -> FloatArray:
        """Compressive stress within compressed pulp besides that of small strain, ``(N, R)``."""
        compressed = np.maximum(down_mm, 0.0) / self.bone_mm
        return np.asarray(STRESS * self.column_mpa * compressed**STRESS_POWER)

    # ---- Differences on the lattice

    @cached_property
    def _node_mm2(self) -> FloatArray:
        return np.gradient(self.arc_mm)[:, None] * self.pad.spacing_mm

    @cached_property
    def _width_mm(self) -> FloatArray:
        return np.diff(self.arc_mm)[:, None]

    def _slopes(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Derivatives along the skin and along the finger in the cells."""
        across, along = np.diff(values, axis=0), np.diff(values, axis=1)
        return (
            0.5 * (across[:, 1:] + across[:, :-1]) / self._width_mm,
            0.5 * (along[1:] + along[:-1]) / self.pad.spacing_mm,
        )

    def _divergence(self, along_s: FloatArray, along_z: FloatArray) -> FloatArray:
        """Forces ``(N, R)`` whose work is minus that of tractions on `_slopes`."""
        step_mm = self.pad.spacing_mm
        by_s, by_z = 0.5 * step_mm * along_s, 0.5 * self._width_mm * along_z
        forces = np.zeros((len(by_s) + 1, by_s.shape[1] + 1))
        forces[1:, 1:] -= by_s + by_z
        forces[1:, :-1] -= by_s - by_z
        forces[:-1, 1:] += by_s - by_z
        forces[:-1, :-1] += by_s + by_z
        return forces

    def _density(self, forces: FloatArray) -> FloatArray:
        """Forces at nodes by area, in the cells."""
        mean = 0.25 * (forces[1:, 1:] + forces[1:, :-1] + forces[:-1, 1:] + forces[:-1, :-1])
        return np.asarray(mean / (self._width_mm * self.pad.spacing_mm))


sheet_of = lru_cache(maxsize=2)(SkinSheet)
"""The sheet of a pad, kept."""


def _between(
    arc_mm: FloatArray, z_mm: FloatArray, values: FloatArray, at_arc: FloatArray, at_z: FloatArray
) -> FloatArray:
    """Values ``(arc, z, S)`` at places, ``(P, S)``: linear between, 0 beyond."""
    from scipy.interpolate import RegularGridInterpolator

    read = RegularGridInterpolator((arc_mm, z_mm), values, bounds_error=False, fill_value=0.0)
    return np.asarray(read((at_arc, at_z)))


class _Fields:
    """Stress of the states of a deep touch on the lattice of the pad.

    `initial_pa` ``(3, C, R - 1, S)`` is the initial stress tt, zz, tz of the sheet in the cells,
    `pressure_pa` and `tissue_pa` ``(N, R, S)`` the compressive stress in the skin and in the pulp.
    """

    def __init__(self, sheet: SkinSheet, loads: SingleArray, depth_um: FloatArray) -> None:
        self._sheet, self._count = sheet, len(loads)
        self._waves = np.float32(PA_PER_MPA) * sheet.real_waves(loads)
        self._rows: dict[int, SingleArray] = {}
        _, columns, rows = sheet.shape
        self.initial_pa = np.zeros((3, columns - 1, rows - 1, self._count))
        self.pressure_pa, self.tissue_pa = np.zeros((2, columns, rows, self._count))
        for number, (state, depth) in enumerate(zip(loads, depth_um.tolist(), strict=True)):
            if share := PA_PER_MPA * share_of_large_strain(depth):
                stress, down_mm = sheet.initial_stress_mpa(state.astype(np.float64))
                self.initial_pa[..., number] = share * stress
                self.pressure_pa[..., number] = share * sheet.pressure_mpa(down_mm)
                self.tissue_pa[..., number] = share * sheet.tissue_stress_mpa(down_mm)

    def row_pa(self, row: int) -> SingleArray:
        """Superposed stress in a row of elements in Pa, ``(2 M, R, 6, S)``."""
        if row not in self._rows:
            self._rows[row] = self._sheet.row_mpa(row, self._waves)
        return self._rows[row]

    def stress_pa(
        self,
        layer: NDArray[np.str_],
        x_mm: FloatArray,
        z_mm: FloatArray,
        depth_mm: FloatArray,
    ) -> SingleArray:
        """Stress ``(6, place, S)`` in Pa at places."""
        from scipy.sparse import csr_array

        sheet, pad, count = self._sheet, self._sheet.pad, self._count
        row_numbers = np.flatnonzero(np.isin([row.layer for row in pad.rows], layer))
        across = pad.section_weights(row_numbers, layer, x_mm, depth_mm)
        lattice_mm = np.arange(-pad.end_row, pad.end_row + 1.0) * pad.spacing_mm
        at, weight = cubic_weights(lattice_mm, z_mm)
        table = np.concatenate([self.row_pa(int(row)) for row in row_numbers])
        table = table.reshape(-1, 6 * count)
        place = np.repeat(np.arange(z_mm.size), np.diff(across.indptr))
        index = across.indices[:, None] * lattice_mm.size + at[place]
        share = (across.data[:, None] * weight[place]).astype(np.float32)
        weights = csr_array(
            (share.ravel(), (np.repeat(place, 4), index.ravel())), shape=(z_mm.size, len(table))
        )
        stress: SingleArray = (weights @ table).reshape(-1, 6, count).transpose(1, 0, 2)
        arc_mm, in_skin = pad.arc_at(x_mm), (layer == _LAYER)[:, None]
        nx, ny = sheet.normal_at(arc_mm)
        cell_z_mm = lattice_mm[1:] - 0.5 * pad.spacing_mm
        tt, zz, tz = (
            np.where(in_skin, _between(sheet.cell_arc_mm, cell_z_mm, part, arc_mm, z_mm), 0.0)
            for part in self.initial_pa
        )
        column = np.where(
            in_skin,
            _between(sheet.arc_mm, lattice_mm, self.pressure_pa, arc_mm, z_mm),
            _between(sheet.arc_mm, lattice_mm, self.tissue_pa, arc_mm, z_mm),
        )
        further = [
            ny * ny * tt - nx * nx * column,
            nx * nx * tt - ny * ny * column,
            zz,
            -nx * ny * (tt + column),
            -nx * tz,
            ny * tz,
        ]
        return np.asarray(stress + np.stack(further), dtype=np.float32)
