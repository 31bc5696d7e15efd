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
rates were recorded with. `fembridge.touching.pad_probe` has the map of it that sets are fitted on.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from fembridge.touching.contact import blas_threads, press_to
from fembridge.touching.contact_history import ContactHistory
from fembridge.touching.influence import read_influence
from fembridge.touching.kept_states import kept
from fembridge.touching.pad import Pad, SkinNodes
from fembridge.touching.population import Population
from fembridge.touching.shape import Shape
from fembridge.typing import FloatArray, IntArray, SingleArray

if TYPE_CHECKING:
    from scipy.interpolate import PchipInterpolator

SA_NU = 0.07
# The pin, and how deep it is where k is found.
PIN_MM, _PIN_UM = 1.0, 200.0
# Numbers that a block of endings takes at a time.
_BLOCK = 4_000_000
# States of which tensors are computed at a time: these stay in the cache.
_STATES = 128
# Of a contact of so few states the stress of all of them is kept, and interpolated as needed.
_FEW_STATES = 64
# Values of states are copied where a shape stands if it has so few places of all its samples.
_FEW_PLACES = 0.6


@dataclass(frozen=True, slots=True, eq=False)
class ContactStress:
    """Stress of `units` in a contact, some units and samples at a time.

    All of it may be larger than the memory: `neural.encoder.encode_units` asks for parts.
    """

    pad: Pad
    units: Population
    contact: ContactHistory

    @property
    def samples(self) -> int:
        """Number of samples."""
        return self.contact.position.size

    def reader(self, rows: IntArray) -> Callable[[int, int], FloatArray]:
        """Function of a first and an end sample that returns the stress of the units `rows`."""
        knots, position, key = self.contact.knots, self.contact.position, self.contact.key
        if knots.size <= _FEW_STATES:
            curve = kept(
                key and (key, self.pad, self.units, rows.tobytes()),
                lambda: StateCurve(knots, self._at_states(self.units[rows], 0, knots.size)),
                lambda made: made.nbytes,
            )
            return lambda first, last: curve(position[first:last])
        units = self.units[rows]

        def part(first: int, last: int) -> FloatArray:
            # A cubic between two states takes the slopes there, and these one more on each side.
            samples = position[first:last]
            begin = max(int(np.searchsorted(knots, samples.min(), "right")) - 3, 0)
            end = int(np.searchsorted(knots, samples.max(), "left")) + 3
            stress = self._at_states(units, begin, min(end, knots.size))
            return interpolate_states(knots[begin:end], stress, samples)

        return part

    def stress_pa(self, rows: IntArray) -> FloatArray:
        """Stress ``(T, unit)`` of the units `rows`."""
        stress_pa = np.empty((self.samples, rows.size))
        width = max(1, _BLOCK // self.samples)
        for first in range(0, rows.size, width):
            block = slice(first, first + width)
            stress_pa[:, block] = self.reader(rows[block])(0, self.samples)
        return stress_pa

    def _at_states(self, units: Population, begin: int, end: int) -> FloatArray:
        # Products of blocks of states: a second thread waits longer than it works.
        with blas_threads():
            return self._stress_at(units, begin, end)

    def _stress_at(self, units: Population, begin: int, end: int) -> FloatArray:
        states, layers = slice(begin, end), np.array(units.layer)
        if not self.contact.layer_forces_n:
            return self._stress(units, self.contact.forces_n[states], states)
        stress_pa = np.zeros((end - begin, len(units)))
        for layer in np.unique(layers).tolist():
            rows = np.flatnonzero(layers == layer)
            forces_n = self.contact.forces_in(layer)[states]
            stress_pa[:, rows] = self._stress(units[rows], forces_n, states)
        return stress_pa

    def _stress(
        self, units: Population, forces: FloatArray | SingleArray, states: slice
    ) -> FloatArray:
        contact, drag = self.contact, self.contact.drag
        if contact.large_strain is not None:
            return driving_stress_pa(self.pad, *contact.large_strain.stressed(states), units)
        if drag is None:
            return driving_stress_pa(self.pad, contact.nodes, forces, units)
        return driving_stress_pa(
            self.pad, contact.nodes, forces, units, drag[states], turns=_turns(drag)
        )


def _turns(drag: FloatArray) -> bool:
    """Whether drag ``(S, 2)`` changes its direction or size."""
    return bool(np.abs(drag - drag[0]).max() >= 1e-6)


class StateCurve:
    """Values ``(S, ...)`` of states along a monotone cubic through them at rising `knots`."""

    def __init__(self, knots: FloatArray, values: FloatArray | SingleArray) -> None:
        self._knots, self._values = knots, values

    @property
    def nbytes(self) -> int:
        """Memory of the values and of the cubics between them."""
        return 5 * self._values.nbytes

    @cached_property
    def _cubic(self) -> "PchipInterpolator":
        from scipy.interpolate import PchipInterpolator

        return PchipInterpolator(self._knots, self._values, axis=0)

    def __call__(self, position: FloatArray) -> FloatArray:
        """Values at each `position` ``(T,)``, one after the other; where a shape stands, once."""
        if np.array_equal(self._knots, position):
            return np.asarray(self._values, dtype=np.float64)
        places, number = np.unique(position, return_inverse=True)
        if places.size > _FEW_PLACES * position.size:
            samples: FloatArray = self._cubic(position)
            return samples
        at_places: FloatArray = self._cubic(places)
        return at_places[number]


def interpolate_states(
    knots: FloatArray, values: FloatArray | SingleArray, position: FloatArray
) -> FloatArray:
    """Values ``(S, ...)`` at rising `knots`, read at `position` along a monotone cubic."""
    return StateCurve(knots, values)(position)


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
    pressed = np.asarray(forces_n.any(axis=0))  # a node without a force costs as much as others
    nodes, forces_n = nodes.subset(pressed).spread_on_pad(forces_n[touched][:, pressed])
    drag = None if drag is None else drag[touched]
    unit, x_mm, z_mm, sensitivity = units.endings()
    layer, depth_mm = np.array(units.layer)[unit], units.depth_mm[unit]
    reads_sa = (np.array(units.afferent) == "SA")[unit] & (not units.sa_von_mises)
    straight = drag is None or not turns
    forces = np.ascontiguousarray(forces_n, dtype=np.float32)
    if drag is not None and not straight:
        aside = drag.astype(np.float32)
        forces = np.concatenate([forces, forces * aside[:, :1], forces * aside[:, 1:]], axis=1)
    steady = (float(drag[0, 0]), float(drag[0, 1])) if drag is not None and straight else (0.0, 0.0)
    columns = pad.columns_per_place(nodes)
    step = max(1, _BLOCK // (6 * max(*forces.shape, columns)))
    # Blocks end with the last ending of a unit.
    starts = np.append(np.flatnonzero(np.diff(unit, prepend=-1)), unit.size)
    first = 0
    while first < len(units):
        last = max(int(np.searchsorted(starts, starts[first] + step, "right")) - 1, first + 1)
        block = slice(int(starts[first]), int(starts[last]))
        places = layer[block], x_mm[block], z_mm[block], depth_mm[block]
        sa = reads_sa[block]
        stress = np.empty((len(forces), sa.size), dtype=np.float32)
        for selected, read in ((~sa, _deviator), (sa, _sa_reading)):
            if not selected.any():
                continue
            some = tuple(values[selected] for values in places)
            table = read_influence(pad, nodes, some, steady, read)
            if not straight:  # along a curve the drag turns: tensors of all three directions
                sideways = [
                    read_influence(pad, nodes, some, direction, read)
                    for direction in ((1.0, 0.0), (0.0, 1.0))
                ]
                table = np.concatenate([table, *(rows - table for rows in sideways)])
            if read is _deviator:
                stress[:, selected] = _lengths(forces, table)
            else:
                scale = _sa_scale(pad.from_above)
                stress[:, selected] = scale * np.maximum(forces @ table, 0.0)
        stress *= sensitivity[block].astype(np.float32)
        first_ending = starts[first:last] - starts[first]
        driving[touched, first:last] = np.maximum.reduceat(stress, first_ending, axis=1)
        first = last
    return driving


def von_mises_pa(
    influence: SingleArray | FloatArray, forces_n: SingleArray | FloatArray
) -> FloatArray:
    """Von Mises stress ``(S, place)`` in Pa under `forces_n` ``(S, node)``."""
    _, places, nodes = influence.shape
    stress = (forces_n @ influence.reshape(-1, nodes).T).reshape(len(forces_n), 6, places)
    xx, yy, zz, xy, yz, zx = np.moveaxis(stress, 1, 0)
    square = 0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2)
    square += 3 * (xy**2 + yz**2 + zx**2)
    stress_pa: FloatArray = np.sqrt(square)
    return stress_pa


def sa_stress_pa(
    influence: SingleArray | FloatArray,
    forces_n: SingleArray | FloatArray,
    normal: FloatArray,
) -> FloatArray:
    """What SA reads but for k, ``(S, place)`` >= 0; `normal` ``(place, 3)``, see the module."""
    [read] = _sa_reading(influence, normal)
    stress_pa: FloatArray = np.maximum(forces_n @ read.T, 0.0)
    return stress_pa


def _sa_reading(influence: SingleArray | FloatArray, normal: FloatArray) -> SingleArray:
    """What SA reads of unit forces, with its sign, ``(1, place, node)``."""
    x, y, z = normal.T[:, :, None].astype(influence.dtype)
    xx, yy, zz, xy, yz, zx = influence
    along_normal = x * x * xx + y * y * yy + 2 * x * y * xy
    if z.any():
        along_normal += z * z * zz + 2 * y * z * yz + 2 * z * x * zx
    read: SingleArray = SA_NU * (xx + yy + zz) - (1 + SA_NU) * along_normal
    return read[np.newaxis]


def _deviator(influence: SingleArray | FloatArray, normal: FloatArray) -> SingleArray:
    """Five numbers whose root of squares is von Mises stress, of unit forces, ``(5, place, node)``.

    They are linear in the tensor: what depends on the size of the pressure alone is gone.
    """
    del normal
    xx, yy, zz, xy, yz, zx = influence
    root = math.sqrt(3.0)
    parts = [0.5 * root * (xx - yy), zz - 0.5 * (xx + yy), root * xy, root * yz, root * zx]
    return np.stack(parts)


def _lengths(forces_n: SingleArray, deviator: SingleArray) -> SingleArray:
    """Von Mises stress ``(S, place)`` in Pa; `deviator` is ``(node, 5 x place)``."""
    stress = np.empty((len(forces_n), deviator.shape[1] // 5), dtype=np.float32)
    for first in range(0, len(stress), _STATES):
        states = slice(first, first + _STATES)
        parts = (forces_n[states] @ deviator).reshape(-1, 5, stress.shape[1])
        np.einsum("skp,skp->sp", parts, parts, out=stress[states])
    return np.sqrt(stress, out=stress)


@lru_cache(maxsize=4)
def _sa_scale(pad: Pad) -> float:
    """Von Mises stress over what SA reads where it sits under a flat pin of 1 mm: k."""
    nodes, forces, _ = press_to(pad, Shape.punch(PIN_MM), np.array([_PIN_UM]))
    unit = Population.one_each(afferents=("SA",), finger=pad)
    places = np.array(unit.layer), unit.x_mm, unit.z_mm, unit.depth_mm
    influence = pad.influence_pa(nodes, *places)
    read = sa_stress_pa(influence, forces, pad.normal_at(unit.x_mm, unit.z_mm))
    return float(von_mises_pa(influence, forces)[0, 0] / read[0, 0])
