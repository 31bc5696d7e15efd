"""Stress where afferents sit: CalculiX' unit forces, superposed.

Each unit has a place on the skin and a depth below it, within a layer. The stress tensor
there is linear in the contact's forces; von Mises stress is taken of the sum.

Between rows of elements stress is linear in depth, as in a bent layer; along the skin
and along the finger it is cubic.
"""

import numpy as np

from fembridge.errors import UsageError
from fembridge.touching.contact import SkinNodes
from fembridge.touching.pad import FORCE_FLIP, STRESS_FLIP, Pad, cubic_weights
from fembridge.typing import FloatArray, IntArray, SingleArray

# A unit may be this share of a row's thickness outside of the middles of rows.
_BEYOND = 0.75
# Numbers that a block of units takes at a time.
_BLOCK = 4_000_000


def influence_pa(
    pad: Pad,
    nodes: SkinNodes,
    layers: list[str],
    x_mm: FloatArray,
    z_mm: FloatArray,
    depth_mm: FloatArray,
    drag: tuple[float, float] = (0.0, 0.0),
) -> SingleArray:
    """Stress ``(6, unit, node)`` in Pa at units under 1 N into the skin on each of `nodes`.

    `layers`, `x_mm`, `z_mm` and `depth_mm` are by unit: the layer it lies in, its place
    on the skin, and how deep under it. `drag` comes with the force, along x and z.

    Raises
    ------
    UsageError
        A unit in a layer or at a depth of which the pad holds no stress.
    """
    columns, column = np.unique(nodes.column, return_inverse=True)
    rows, row = np.unique(nodes.row, return_inverse=True)
    half = pad.x_mm.size // 2
    forces = [(1, 1.0), *((d, share) for d, share in zip((0, 2), drag, strict=True) if share)]
    found = np.empty((6, len(layers), nodes.column.size), dtype=np.float32)
    if not found.size:
        return found
    # Middles of elements along z, mirrored: a cubic needs two on the other side.
    middle = pad.stress_z_mm
    along = np.concatenate([-middle[1::-1], middle])
    block = max(1, _BLOCK // (6 * columns.size * along.size))
    for first in range(0, len(layers), block):
        mine = slice(first, first + block)
        place, weight = _section_weights(pad, layers[mine], x_mm[mine], depth_mm[mine])
        away = z_mm[mine, None] - rows * pad.spacing_mm  # (unit, row)
        at, share = cubic_weights(along, np.abs(away).ravel())
        share[(np.abs(away) > middle[-1]).ravel()] = 0.0
        at, share = at.reshape(*away.shape, 4), share.reshape(*away.shape, 4)
        total = np.zeros((6, *away.shape, columns.size), dtype=np.float32)
        for direction, scale in forces:
            flip = (FORCE_FLIP["z"][direction] * STRESS_FLIP["z"]).astype(np.float32)
            # (unit, 6, column, K) of the places of units in the section.
            here = _in_section(pad, direction, columns - half, place, weight)
            tail = here[..., 1::-1] * flip[None, :, None, None]
            table = np.concatenate([tail, here], axis=-1)
            side = np.where(away < 0, flip[:, None, None], np.float32(1.0)) * np.float32(scale)
            unit = np.arange(len(table))[:, None]
            for k in range(4):
                # Advanced indices around slices come first: (unit, row, 6, column).
                part = table[unit, :, :, at[..., k]] * share[..., k, None, None].astype(np.float32)
                total += np.moveaxis(part, 2, 0) * side[..., None]
        found[:, mine] = total[:, :, row, column]
    return found


def von_mises_pa(
    influence: SingleArray | FloatArray, forces_n: SingleArray | FloatArray
) -> FloatArray:
    """Von Mises stress ``(T, unit)`` in Pa under `forces_n` ``(T, node)``."""
    times, units = len(forces_n), influence.shape[1]
    found = np.empty((times, units))
    forces = np.ascontiguousarray(forces_n, dtype=np.float32)
    flat = influence.reshape(6 * units, -1)
    step = max(1, _BLOCK // max(1, 6 * units))
    for first in range(0, times, step):
        stress = (forces[first : first + step] @ flat.T).reshape(-1, 6, units)
        xx, yy, zz, xy, yz, zx = np.moveaxis(stress, 1, 0)
        square = 0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2)
        square += 3 * (xy**2 + yz**2 + zx**2)
        np.sqrt(square, out=found[first : first + step], casting="unsafe")
    return found


def compression_pa(
    influence: SingleArray | FloatArray, forces_n: SingleArray | FloatArray, normal: FloatArray
) -> FloatArray:
    """Compression ``(T, unit)`` in Pa along `normal` ``(unit, 2)`` in the section, >= 0."""
    x, y = normal.T[:, :, None].astype(np.float32)
    along = x * x * influence[0] + y * y * influence[1] + 2 * x * y * influence[3]
    pressed = -(np.asarray(forces_n, dtype=np.float32) @ along.T)
    return np.asarray(np.maximum(pressed, 0.0), dtype=np.float64)


def _in_section(
    pad: Pad, direction: int, columns: IntArray, place: IntArray, weight: SingleArray
) -> SingleArray:
    """Stress ``(unit, 6, column, K)`` under forces on `columns`, counted from the apex."""
    count = pad.stress_pa.shape[4]
    rows, middles = place // count, place % count
    right = columns >= 0
    sign = (FORCE_FLIP["x"][direction] * STRESS_FLIP["x"]).astype(np.float32)
    found = np.zeros((len(place), 6, columns.size, pad.stress_z_mm.size), dtype=np.float32)
    table = pad.stress_pa[:, direction]  # (R, 6, N', 2 M, K)
    for side, chosen in ((1, right), (-1, ~right)):
        if not chosen.any():
            continue
        at = np.abs(columns[chosen])
        for k in range(place.shape[1]):
            middle = middles[:, k] if side > 0 else count - 1 - middles[:, k]
            part = table[rows[:, k], :, :, middle][:, :, at] * weight[:, k, None, None, None]
            found[:, :, chosen] += part if side > 0 else part * sign[None, :, None, None]
    return found


def _section_weights(
    pad: Pad, layers: list[str], x_mm: FloatArray, depth_mm: FloatArray
) -> tuple[IntArray, SingleArray]:
    """Middles of elements around each unit and their weights, ``(unit, 8)``.

    A middle's place counts through rows and middles of the pad's stress.
    """
    arc_mm = pad.arc_at(x_mm)
    middles = pad.stress_pa.shape[4]
    place = np.zeros((arc_mm.size, 8), dtype=np.int64)
    weight = np.zeros((arc_mm.size, 8), dtype=np.float32)
    names = np.array(layers)
    for layer in dict.fromkeys(layers):
        held = [n for n, row in enumerate(pad.rows) if row.layer == layer]
        if not held:
            known = ", ".join(dict.fromkeys(row.layer for row in pad.rows))
            raise UsageError(f"the pad holds no stress in {layer}, but in {known}")
        units = np.flatnonzero(names == layer)
        arcs = [np.concatenate([-pad.rows[n].arc_mm[::-1], pad.rows[n].arc_mm]) for n in held]
        deep = [np.concatenate([pad.rows[n].depth_mm[::-1], pad.rows[n].depth_mm]) for n in held]
        depths = np.stack([np.interp(arc_mm[units], a, d) for a, d in zip(arcs, deep, strict=True)])
        wanted = depth_mm[units]
        thick = np.diff(depths, axis=0)
        low, high = depths[0] - _BEYOND * thick[0], depths[-1] + _BEYOND * thick[-1]
        out = np.flatnonzero((wanted < low) | (wanted > high))
        if out.size:
            one = out[0]
            raise UsageError(
                f"a unit {wanted[one]:g} mm deep in {layer} at x = {x_mm[units[one]]:g} mm: the "
                f"pad holds stress from {low[one]:.3g} to {high[one]:.3g} mm there"
            )
        upper = np.clip((depths < wanted).sum(axis=0) - 1, 0, len(held) - 2)
        each = np.arange(units.size)
        share = (wanted - depths[upper, each]) / thick[upper, each]
        for n in range(2):
            row = upper + n
            for here in np.unique(row):
                chosen = row == here
                at, by = cubic_weights(arcs[here], arc_mm[units[chosen]])
                along = share[chosen] if n else 1 - share[chosen]
                columns = slice(4 * n, 4 * n + 4)
                place[units[chosen], columns] = held[here] * middles + at
                weight[units[chosen], columns] = by * along[:, None]
    return place, weight
