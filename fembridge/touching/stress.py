"""Stress where afferents sit: CalculiX' unit forces, superposed.

The stress tensor at a unit is linear in the contact's forces. Between rows of elements
it is linear in depth, as in a bent layer; along the skin and along the finger it is
cubic. RA and PC read von Mises stress of the sum, as in the paper. SA reads::

    k (nu (sigma_tt + sigma_zz) - sigma_nn)

n is the skin's normal, t and z lie along the skin. At nu = 1/2 that is Young's modulus
times the compressive strain along n, and where skin is bent by a pin it is von Mises
stress, with a sign: skin that bends the other way, beside a bar or into a gap, is silent.
At nu = 0 it is the pressure alone, which a bar's plateau has and bending hides. `SA_NU`
lies between (decision 0029). k makes it von Mises stress under the pin that parameters
are fitted under, so that they hold for it as they are: the flat one of 1 mm that observed
rates were recorded with. `pad_response` is the answer to it as a response map: what
`fitted_pad` was fitted on, see ``docs/model_study.md``.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from decks.presets import finger_table
from fembridge.errors import UsageError
from fembridge.response.response_map import ResponseMap
from fembridge.run_folder import AfferentNode
from fembridge.touching.contact import SkinNodes, press_to
from fembridge.touching.pad import FORCE_FLIP, STRESS_FLIP, Pad, cubic_weights
from fembridge.touching.population import Population
from fembridge.touching.shape import Shape
from fembridge.typing import FloatArray, IntArray, SingleArray

if TYPE_CHECKING:
    from scipy.sparse import csr_array

SA_NU = 0.1
# The pin, and how deep it is where k is found.
PIN_MM, _PIN_UM = 1.0, 200.0
# Depths of the response map: few enough that nodes which come into contact one by one leave
# no kinks.
DEEPEST_UM, _LEVELS = 600.0, 21
# A unit may be this share of a row's thickness outside of the middles of rows.
_BEYOND = Pad.BEYOND_ROWS
# Numbers that a block of endings takes at a time.
_BLOCK = 4_000_000
# Of a contact of so few states the stress of all of them is kept, and interpolated as needed.
_FEW_STATES = 64


@dataclass(frozen=True, slots=True, eq=False)
class Solved:
    """Forces ``(S, node)`` on `nodes` at the states that were solved, and those of the shape.

    `total_n` and `depth_um` ``(S,)`` are the shape's force and depth. Sample n of the touch
    lies at `at` ``(T,)`` among their rising `knots` ``(S,)``. `drag` ``(S, 2)`` is the force
    along x and z that comes with 1 N into the skin; None where nothing slips.
    """

    nodes: SkinNodes
    forces_n: FloatArray | SingleArray
    total_n: FloatArray
    depth_um: FloatArray
    knots: FloatArray
    at: FloatArray
    drag: FloatArray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class UnitStress:
    """Stress of `units` in a contact, some units and samples at a time.

    All of it may be larger than the memory: `neural.encoder.encode_units` asks for parts.
    """

    pad: Pad
    units: Population
    contact: Solved

    @property
    def samples(self) -> int:
        """How many samples there are."""
        return self.contact.at.size

    def of(self, rows: IntArray) -> Callable[[int, int], FloatArray]:
        """What makes the stress ``(sample, unit)`` of the units `rows`, from sample to sample."""
        knots, at = self.contact.knots, self.contact.at
        units = _some(self.units, rows)
        if knots.size <= _FEW_STATES:
            few = self._at_states(units, 0, knots.size)
            return lambda first, last: between(knots, few, at[first:last])

        def part(first: int, last: int) -> FloatArray:
            # A cubic between two states takes the slopes there, and these one more on each side.
            begin = max(int(np.searchsorted(knots, at[first:last].min(), "right")) - 3, 0)
            end = int(np.searchsorted(knots, at[first:last].max(), "left")) + 3
            stress = self._at_states(units, begin, end)
            return between(knots[begin:end], stress, at[first:last])

        return part

    def whole(self, rows: IntArray) -> FloatArray:
        """Stress ``(T, unit)`` of the units `rows`."""
        whole = np.empty((self.samples, rows.size))
        width = max(1, _BLOCK // self.samples)
        for first in range(0, rows.size, width):
            chosen = slice(first, first + width)
            whole[:, chosen] = self.of(rows[chosen])(0, self.samples)
        return whole

    def _at_states(self, units: Population, begin: int, end: int) -> FloatArray:
        states, contact = slice(begin, end), self.contact
        drag, forces = contact.drag, contact.forces_n[states]
        if drag is None:
            return driving_stress_pa(self.pad, contact.nodes, forces, units)
        return driving_stress_pa(
            self.pad, contact.nodes, forces, units, drag[states], turns=_turns(drag)
        )


def _turns(drag: FloatArray) -> bool:
    """Whether drag ``(S, 2)`` changes its direction or size."""
    return bool(np.abs(drag - drag[0]).max() >= 1e-6)


def _some(units: Population, rows: IntArray) -> Population:
    """The units `rows` of a population."""
    columns = (units.unit, units.afferent, units.layer)
    unit, afferent, layer = (tuple(column[row] for row in rows.tolist()) for column in columns)
    return replace(
        units,
        unit=unit,
        afferent=afferent,
        layer=layer,
        x_mm=units.x_mm[rows],
        z_mm=units.z_mm[rows],
        depth_mm=units.depth_mm[rows],
        deviate=units.deviate[rows],
    )


def between(knots: FloatArray, values: FloatArray | SingleArray, at: FloatArray) -> FloatArray:
    """Values ``(S, ...)`` at rising `knots`, read at `at` along a monotone cubic."""
    if np.array_equal(knots, at):
        return np.asarray(values, dtype=np.float64)
    from scipy.interpolate import PchipInterpolator

    found: FloatArray = PchipInterpolator(knots, values, axis=0)(at)
    return found


def driving_stress_pa(
    pad: Pad,
    nodes: SkinNodes,
    forces_n: FloatArray | SingleArray,
    units: Population,
    drag: FloatArray | None = None,
    *,
    turns: bool = False,
) -> FloatArray:
    """Stress that drives each unit ``(S, unit)`` in Pa under `forces_n` ``(S, node)``.

    `drag` ``(S, 2)`` is the force along x and z that comes with 1 N into the skin, the same in
    all states unless it `turns`. Of
    the endings of a unit that counts whose stress, times its sensitivity, is largest.

    Raises
    ------
    UsageError
        A unit in a layer or at a depth of which the pad holds no stress.
    """
    driving = np.zeros((len(forces_n), len(units)))
    touched = np.asarray(forces_n.any(axis=1))
    if not touched.any():
        return driving
    forces_n, drag = forces_n[touched], None if drag is None else drag[touched]
    unit, x_mm, z_mm, sensitivity = units.endings()
    layer, depth_mm = np.array(units.layer)[unit], units.depth_mm[unit]
    reads_sa = (np.array(units.afferent) == "SA")[unit] & (not units.sa_von_mises)
    straight = drag is None or not turns
    forces = np.ascontiguousarray(forces_n, dtype=np.float32)
    if drag is not None and not straight:
        forces = np.concatenate([forces, forces * drag[:, :1], forces * drag[:, 1:]], axis=1)
    steady = (float(drag[0, 0]), float(drag[0, 1])) if drag is not None and straight else (0.0, 0.0)
    columns = np.unique(nodes.column).size * 2 * pad.stress_z_mm.size
    step = max(1, _BLOCK // (6 * max(*forces.shape, columns)))
    # Blocks end with the last ending of a unit.
    starts = np.append(np.flatnonzero(np.diff(unit, prepend=-1)), unit.size)
    first = 0
    while first < len(units):
        last = max(int(np.searchsorted(starts, starts[first] + step, "right")) - 1, first + 1)
        block = slice(int(starts[first]), int(starts[last]))
        places = layer[block], x_mm[block], z_mm[block], depth_mm[block]
        influence = influence_pa(pad, nodes, *places, drag=steady)
        if not straight:  # along a curve the drag turns: tensors of all three directions
            aside = [influence_pa(pad, nodes, *places, drag=one) for one in ((1, 0), (0, 1))]
            influence = np.concatenate([influence, *(each - influence for each in aside)], axis=2)
        sa = reads_sa[block]
        stress = np.empty((len(forces), sa.size), dtype=np.float32)
        stress[:, ~sa] = von_mises_pa(influence[:, ~sa], forces)
        if sa.any():
            normal = pad.normal_at(x_mm[block][sa])
            stress[:, sa] = _sa_scale(pad) * sa_stress_pa(influence[:, sa], forces, normal)
        stress *= sensitivity[block].astype(np.float32)
        own = starts[first:last] - starts[first]
        driving[touched, first:last] = np.maximum.reduceat(stress, own, axis=1)
        first = last
    return driving


def influence_pa(
    pad: Pad,
    nodes: SkinNodes,
    layer: NDArray[np.str_],
    x_mm: FloatArray,
    z_mm: FloatArray,
    depth_mm: FloatArray,
    drag: tuple[float, float] = (0.0, 0.0),
) -> SingleArray:
    """Stress ``(6, place, node)`` in Pa under 1 N into the skin on each of `nodes`.

    `layer`, `x_mm`, `z_mm` and `depth_mm` are by place: the layer it lies in, where on
    the skin, and how deep under it. `drag` comes with the force, along x and z.

    Raises
    ------
    UsageError
        A place in a layer or at a depth of which the pad holds no stress.
    """
    columns, column = np.unique(nodes.column, return_inverse=True)
    rows, row = np.unique(nodes.row, return_inverse=True)
    middle = pad.stress_z_mm
    along = middle if pad.plane else np.concatenate([-middle[::-1], middle])
    held = np.flatnonzero(np.isin([row.layer for row in pad.rows], layer))
    weights = _section_weights(pad, held, layer, x_mm, depth_mm)
    # Stress at the places in the section, along the finger: (place, 6 x column, K).
    in_section = weights @ _table(pad, held, columns - pad.x_mm.size // 2, (drag[0], 1.0, drag[1]))
    here = in_section.reshape(x_mm.size, 6 * columns.size, along.size)
    away_mm = z_mm[:, None] - rows * pad.spacing_mm  # (place, row)
    weight = np.ones((away_mm.size, along.size), dtype=np.float32)
    if not pad.plane:
        at, share = cubic_weights(along, away_mm.ravel())
        share[np.abs(away_mm.ravel()) > middle[-1]] = 0.0
        weight[:] = 0.0
        np.put_along_axis(weight, at, share.astype(np.float32), axis=1)
    stress = here @ weight.reshape(x_mm.size, rows.size, along.size).transpose(0, 2, 1)
    whole = stress.reshape(x_mm.size, 6, columns.size, rows.size)
    found: SingleArray = np.moveaxis(whole[:, :, column, row], 1, 0)
    return found


def von_mises_pa(
    influence: SingleArray | FloatArray, forces_n: SingleArray | FloatArray
) -> FloatArray:
    """Von Mises stress ``(S, place)`` in Pa under `forces_n` ``(S, node)``."""
    _, places, nodes = influence.shape
    stress = (forces_n @ influence.reshape(-1, nodes).T).reshape(len(forces_n), 6, places)
    xx, yy, zz, xy, yz, zx = np.moveaxis(stress, 1, 0)
    square = 0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2)
    square += 3 * (xy**2 + yz**2 + zx**2)
    found: FloatArray = np.sqrt(square)
    return found


def sa_stress_pa(
    influence: SingleArray | FloatArray,
    forces_n: SingleArray | FloatArray,
    normal: FloatArray,
) -> FloatArray:
    """What SA reads but for k, ``(S, place)`` >= 0; `normal` ``(place, 2)``, see the module."""
    x, y = normal.T[:, :, None].astype(influence.dtype)
    xx, yy, zz, xy, *_ = influence
    along_normal = x * x * xx + y * y * yy + 2 * x * y * xy
    read = SA_NU * (xx + yy + zz) - (1 + SA_NU) * along_normal
    found: FloatArray = np.maximum(forces_n @ read.T, 0.0)
    return found


@lru_cache(maxsize=4)
def _sa_scale(pad: Pad) -> float:
    """Von Mises stress over what SA reads where it sits under a flat pin of 1 mm: k."""
    nodes, forces, _ = press_to(pad, Shape.punch(PIN_MM), np.array([_PIN_UM]))
    unit = Population.one_each(afferents=("SA",), finger=pad.finger)
    places = np.array(unit.layer), unit.x_mm, unit.z_mm, unit.depth_mm
    influence = influence_pa(pad, nodes, *places)
    read = sa_stress_pa(influence, forces, pad.normal_at(unit.x_mm))
    return float(von_mises_pa(influence, forces)[0, 0] / read[0, 0])


def pad_response(pad: Pad) -> ResponseMap:
    """Stress tensors at each site of the pad's finger under the pin, over the apex."""
    depth_um = DEEPEST_UM * (np.arange(_LEVELS) / (_LEVELS - 1)) ** 1.5
    nodes, forces, _ = press_to(pad, Shape.punch(PIN_MM), depth_um)
    sites = pad.finger.afferents
    layer, x_mm, depth_mm = zip(
        *((s.layer, s.x_mm, s.depth_mm) for s in sites.values()), strict=True
    )
    places = np.array(layer), np.array(x_mm), np.zeros(len(sites)), np.array(depth_mm)
    influence = influence_pa(pad, nodes, *places)
    tensor = np.einsum("cun,kn->kuc", influence, forces, dtype=np.float64)
    tensor[..., 4:] = 0.0  # yz and zx, by symmetry about z = 0, but for rounding
    return ResponseMap(
        depth_um=depth_um,
        tensor_pa=tensor,
        force_n_per_mm=forces.sum(axis=1),
        places=tuple(
            AfferentNode(name, n, site.layer, site.x_mm, -site.depth_mm, site.depth_mm)
            for n, (name, site) in enumerate(sites.items(), start=1)
        ),
        closure_percent=0.0,
        origin={"finger": finger_table(pad.finger), "pad": dict(pad.origin), "pin_mm": PIN_MM},
    )


def _table(
    pad: Pad, held: IntArray, columns: IntArray, force: tuple[float, float, float]
) -> SingleArray:
    """Stress in the pad's rows `held` under `force` on `columns`, counted from the apex.

    ``(R x 2 M, 6 x column x 2 K)``: rows and middles of elements, places along z from -z.
    Columns to the left of the apex, and places behind, are mirror images.
    """
    parts = []
    for direction, share in enumerate(force):
        if not share:
            continue
        chosen = np.ix_(held, np.array([direction]), np.arange(6), np.abs(columns))
        ahead = share * pad.stress_pa[chosen][:, 0]  # (R, 6, column, 2 M, K)
        flip_x, flip_z = (
            (FORCE_FLIP[axis][direction] * STRESS_FLIP[axis]).astype(np.float32)[
                :, None, None, None
            ]
            for axis in ("x", "z")
        )
        left = columns < 0
        ahead[:, :, left] = flip_x * ahead[:, :, left, ::-1]
        behind = flip_z * ahead[..., ::-1]
        parts.append(ahead if pad.plane else np.concatenate([behind, ahead], axis=-1))
    whole: SingleArray = sum(parts[1:], parts[0])
    rows, _, _, middles, _ = whole.shape
    return np.moveaxis(whole, 3, 1).reshape(rows * middles, -1)


def _section_weights(
    pad: Pad,
    held: IntArray,
    layer: NDArray[np.str_],
    x_mm: FloatArray,
    depth_mm: FloatArray,
) -> "csr_array":
    """Weights ``(place, R x 2 M)`` of the middles of elements of rows `held` around each place."""
    from scipy.sparse import csr_array

    arc_mm = pad.arc_at(x_mm)
    middles = pad.stress_pa.shape[4]
    entries = []
    rows = [pad.rows[n] for n in held]
    for name in np.unique(layer):
        own = [n for n, row in enumerate(rows) if row.layer == name]
        if not own:
            known = ", ".join(dict.fromkeys(row.layer for row in pad.rows))
            raise UsageError(f"the pad holds no stress in {name}, but in {known}")
        mine = np.flatnonzero(layer == name)
        arcs = [np.concatenate([-rows[n].arc_mm[::-1], rows[n].arc_mm]) for n in own]
        deep = [np.concatenate([rows[n].depth_mm[::-1], rows[n].depth_mm]) for n in own]
        depths = np.stack([np.interp(arc_mm[mine], a, d) for a, d in zip(arcs, deep, strict=True)])
        wanted, thick = depth_mm[mine], np.diff(depths, axis=0)
        low, high = depths[0] - _BEYOND * thick[0], depths[-1] + _BEYOND * thick[-1]
        for one in np.flatnonzero((wanted < low) | (wanted > high)):
            raise UsageError(
                f"a unit {wanted[one]:g} mm deep in {name} at x = {x_mm[mine[one]]:g} mm: the "
                f"pad holds stress from {low[one]:.3g} to {high[one]:.3g} mm there"
            )
        upper = np.clip((depths < wanted).sum(axis=0) - 1, 0, len(own) - 2)
        each = np.arange(mine.size)
        share = (wanted - depths[upper, each]) / thick[upper, each]
        for n, (row, arcs_mm) in enumerate(zip(own, arcs, strict=True)):
            by_depth = np.where(upper == n, 1 - share, np.where(upper == n - 1, share, 0.0))
            at, weight = cubic_weights(arcs_mm, arc_mm[mine])
            entries.append((np.repeat(mine, 4), row * middles + at, by_depth[:, None] * weight))
    place, middle, weight = (np.concatenate([one[k].ravel() for one in entries]) for k in range(3))
    shape = arc_mm.size, len(rows) * middles
    return csr_array((weight.astype(np.float32), (place, middle)), shape=shape)
