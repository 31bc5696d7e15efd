"""Friction of a shape that sticks to the skin before it slips over it.

Skin under a shape that begins to move goes along at first: its resistance grows with the way of
the shape until it reaches the coefficient of friction times the force into the skin, and the
shape slips. Where the shape stops the resistance stays; where it turns the skin is pulled over to
the other side. The model is that of Dahl (1968, Aerospace Corporation TOR-0158(3107-18)-1) in two
directions: over a way ds in the direction e the resistance t, as a share of the largest, becomes::

    dt = (e - t) ds / slip_mm

At first the resistance grows as that of a ball which sticks (Cattaneo 1938, Mindlin 1949): on
an incompressible half-space it would reach friction times force after `slip_mm`, friction times
the depth of the ball.

A probe that jumps forward by itself, since it is moved through a spring and friction falls as it
slips, is not part of this: the path is given.
"""

import numpy as np
from numpy.typing import NDArray

from fembridge.typing import BoolArray, FloatArray

# The shape slipped before time 0 if over its first slip length it goes so straight, and begins so
# fast relative to its mean speed there.
_STRAIGHT, _FAST = 0.9, 0.5


def friction_shares(
    x_mm: FloatArray, z_mm: FloatArray, slip_mm: FloatArray, touches: BoolArray
) -> FloatArray:
    """Resistance ``(T, 2)`` along x and z, as a share of friction times force, at most 1 long.

    It points along the way of the shape, as the force on the skin does. Of a shape that has
    `slid_before` it is whole at time 0.

    Parameters
    ----------
    x_mm, z_mm
        Position of the shape in mm, ``(T,)``.
    slip_mm
        Way over which it comes to slip, in mm, ``(T,)``.
    touches
        Whether it touches the skin, ``(T,)``; without touch nothing resists.
    """
    way_mm = _way_mm(x_mm, z_mm)
    length_mm = np.abs(way_mm)
    direction = (way_mm / np.maximum(length_mm, 1e-12)).tolist()
    stuck = np.exp(-length_mm / np.maximum(slip_mm[1:], 1e-9)).tolist()
    slides = touches[0] and slid_before(x_mm, z_mm, float(slip_mm[0]))
    shares = [direction[0] if slides else 0j]
    for along, share, touched in zip(direction, stuck, touches[1:].tolist(), strict=True):
        shares.append(along + (shares[-1] - along) * share if touched else 0j)
    resistance = np.array(shares)
    return np.stack([resistance.real, resistance.imag], axis=-1)


def slid_before(x_mm: FloatArray, z_mm: FloatArray, slip_mm: float = np.inf) -> bool:
    """Whether a shape slid before time 0: its way begins straight and at full speed.

    Parameters
    ----------
    x_mm, z_mm
        Position of the shape in mm, ``(T,)``.
    slip_mm
        Length in mm of the beginning. Default: all of the way.
    """
    way_mm = _way_mm(x_mm, z_mm)
    if not way_mm.size:
        return False
    run_mm = np.cumsum(np.abs(way_mm))
    count = min(int(np.searchsorted(run_mm, slip_mm)) + 1, way_mm.size)
    straight = abs(complex(way_mm[:count].sum())) >= _STRAIGHT * run_mm[count - 1]
    return bool(straight and abs(way_mm[0]) * count >= _FAST * run_mm[count - 1] > 0)


def _way_mm(x_mm: FloatArray, z_mm: FloatArray) -> NDArray[np.complex128]:
    """Way from each sample to the next in mm: x + i z, ``(T - 1,)``."""
    return np.diff(x_mm) + 1j * np.diff(z_mm)
