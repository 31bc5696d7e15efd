"""Levels at which contact is solved for a shape that only goes in and out.

Levels end at the top of a rung, which touches of about the same depth or force share: what is
solved for one of them is kept for the others (`fembridge.touching.kept_states`).
"""

import math
from functools import partial
from sys import getsizeof

import numpy as np

from fembridge.touching.contact import DEEPEST_UM, MOST_UM, STRONGEST_N, press_to
from fembridge.touching.kept_states import kept, shape_key
from fembridge.touching.large_strain import SMALL_UM, has_large_strain, is_deep
from fembridge.touching.pad import Pad
from fembridge.touching.shape import Shape
from fembridge.typing import FloatArray

# A shape that goes in and out is solved at so many levels up to the top of a rung: 300 um, or 1 N,
# times a power of 2. All touches of a rung share its states, and fall between the last of them.
LEVELS = 27
RUNGS_PER_DOUBLING = 5
# Below these levels, um or N, states are those of a touch alone.
LEAST_UM, LEAST_N = 0.1, 1e-5
_RUNG = 2.0 ** (1 / RUNGS_PER_DOUBLING)


def levels_up_to(top: float) -> FloatArray:
    """Rising levels ``(LEVELS,)`` from 0 to `top`, closer where contact begins.

    Parameters
    ----------
    top
        The last level, in um or N.
    """
    shares: FloatArray = (np.arange(LEVELS) / (LEVELS - 1)) ** 1.5
    return top * shares


def rung_of(pad: Pad, shape: Shape, highest: float, *, by_force: bool) -> tuple[float, bool]:
    """Top of the rung of `highest` um, or N by force, and whether its states have large strain.

    A depth of `SMALL_UM` ends a rung, as does the force at that depth: no rung has touches of both
    kinds.

    Parameters
    ----------
    pad, shape
        What is touched, and the shape at its place.
    highest
        Largest depth in um, or force in N, of a touch.
    by_force
        Whether it is a force.
    """
    is_possible = has_large_strain(pad)
    if not by_force:
        top, most_um = _above(highest / SMALL_UM) * SMALL_UM, DEEPEST_UM if is_possible else MOST_UM
        return (
            min(top, most_um) if highest <= most_um else highest
        ), is_possible and top > SMALL_UM
    top = _above(highest)
    if not is_possible:
        return top, False
    top = min(top, STRONGEST_N) if highest <= STRONGEST_N else highest
    touched = None if pad.pose else (pad, shape_key(shape))

    def is_deep_at(force_n: float) -> bool:
        make = partial(is_deep, pad, shape, np.array([force_n]), by_force=True)
        return kept(touched and (*touched, force_n, "is deep"), make, getsizeof)

    if not is_deep_at(top):
        return top, False
    if is_deep_at(top / _RUNG) or is_deep_at(highest):
        return top, True
    most_n = kept(
        touched and (*touched, "most of small strain"),
        lambda: float(press_to(pad, shape, np.array([SMALL_UM]))[1].sum()),
        getsizeof,
    )
    return max(highest, most_n), False


def _above(share: float) -> float:
    """The least power of `_RUNG` that is not below `share`."""
    number = math.ceil(math.log2(share) * RUNGS_PER_DOUBLING - 1e-9)
    return max(float(2.0 ** (number / RUNGS_PER_DOUBLING)), share)
