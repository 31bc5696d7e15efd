"""Ranges of numeric arguments: one table for the Python functions and the options of commands."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Real

from fembridge.errors import UsageError

ABOVE_ZERO = math.ulp(0.0)
"""Lower end of a range that excludes 0."""


@dataclass(frozen=True, slots=True)
class Range:
    """Finite numbers from `low` to `high`, both included.

    Parameters
    ----------
    low, high
        Ends of the range, in the unit of the argument. Default: no limit.
    is_whole
        Whether only whole numbers belong to the range. Default: False.
    """

    low: float = -math.inf
    high: float = math.inf
    is_whole: bool = False

    def contains(self, value: object) -> bool:
        """Whether `value` is a number in the range; NaN, infinity, True and False never are."""
        if not isinstance(value, Real) or isinstance(value, bool):
            return False
        number = value if isinstance(value, int) else float(value)
        is_inside = self.low <= number <= self.high and math.isfinite(number)
        return is_inside and (not self.is_whole or number == int(number))

    def __str__(self) -> str:
        kind = "a whole number" if self.is_whole else "a number"
        low, high = (
            str(end) if isinstance(end, int) else f"{end:.15g}" for end in (self.low, self.high)
        )
        if self.low == ABOVE_ZERO:
            return f"{kind} more than 0" + (f", at most {high}" if self.high < math.inf else "")
        if self.low > -math.inf and self.high < math.inf:
            return f"{kind} from {low} to {high}"
        return f"{kind}, {low} or more" if self.low > -math.inf else f"{kind} that is finite"


# Above every length, time and count of a finger, and within the range of NumPy and timers.
_HIGH = 10**9
_HIGH_WHOLE = 2**63 - 1
_HIGH_PARALLEL = 4096
_COUNT = Range(1, _HIGH, is_whole=True)
_POSITIVE = Range(ABOVE_ZERO, _HIGH)
_ANGLE_DEG = Range(-3600, 3600)

NODE = Range(1, 10**15, is_whole=True)
"""Numbers of nodes and elements, of any solver."""

RANGES: Mapping[str, Range] = {
    "angle_deg": _ANGLE_DEG,
    "force_n": Range(ABOVE_ZERO, 1000),
    "forces_per_deck": _COUNT,
    "tilt_deg": Range(-85, 85),
    "at_mm": Range(-1000, 1000),
    "background_um": Range(0, 1900),
    "bin_ms": _POSITIVE,
    "cells": Range(1, 1000, is_whole=True),
    "criterion": Range(ABOVE_ZERO, 1),
    "deepest_um": Range(ABOVE_ZERO, 2000),
    "depth_mm": Range(ABOVE_ZERO, 10),
    "depth_um": Range(ABOVE_ZERO, 10_000),
    "direction_deg": _ANGLE_DEG,
    "dt_ms": Range(ABOVE_ZERO, 1e6),
    "duration_ms": Range(10, 60_000),
    "endings_mm": Range(0, 3),
    "evaluations": _COUNT,
    "event_grid_mm": Range(ABOVE_ZERO, 1000),
    "forces_step_ms": Range(0, 60_000),
    "frames": Range(0, _HIGH, is_whole=True),
    "frequency_hz": Range(ABOVE_ZERO, 1000),
    "friction": Range(0, 10),
    "full_scale_um": _POSITIVE,
    "gain_pa": Range(-1e30, 1e30),
    "hold_ms": Range(0.5, 60_000),
    "iteration_limit": _COUNT,
    "jobs": Range(1, _HIGH_PARALLEL, is_whole=True),
    "longest_ms": _POSITIVE,
    "mpa_per_um": Range(ABOVE_ZERO, 1000),
    "near_mm": Range(-_HIGH, _HIGH),
    "newton_per_um": Range(ABOVE_ZERO, 1000),
    "noise_mv": Range(0, 1000),
    "percent": Range(ABOVE_ZERO, 100),
    "pixel_mm": Range(ABOVE_ZERO, 1000),
    "population": Range(4, 10_000, is_whole=True),
    "plate_mm": Range(ABOVE_ZERO, 10),
    "positions": Range(1, 20, is_whole=True),
    "preindent_um": Range(0, 10_000),
    "press_n": Range(0, 1000),
    "press_um": Range(0, 10_000),
    "probe_diameter_mm": Range(0.01, 20),
    "probe_fillet_mm": Range(0, 10),
    "probe_x_mm": Range(-1000, 1000),
    "ramp_ms": Range(0.5, 10_000),
    "reach_mm": Range(1, 20),
    "relief_mm": Range(-1000, 1000),
    "resample_ms": Range(ABOVE_ZERO, 1e6),
    "sensor_ms": Range(ABOVE_ZERO, 1e6),
    "retract_um": Range(0, 10_000),
    "seed": Range(0, _HIGH_WHOLE, is_whole=True),
    "slide_mm_per_s": Range(-10_000, 10_000),
    "spacing_mm": Range(0.05, 1),
    "stall_limit_s": _POSITIVE,
    "step_mm": Range(0.1, 2),
    "steps": Range(6, 400, is_whole=True),
    "stiffness_mpa_per_mm": _POSITIVE,
    "threads": Range(1, _HIGH_PARALLEL, is_whole=True),
    "time_limit_s": _POSITIVE,
    "times_threshold": Range(ABOVE_ZERO, 10_000),
    "trials": Range(1, 10_000, is_whole=True),
    "units": Range(1, 200, is_whole=True),
    "window_ms": Range(-_HIGH, _HIGH),
}
"""Range of each numeric argument of the public functions; a function may accept less."""


def check_range(argument: str, value: float, limits: Range | None = None) -> None:
    """Check that the `value` of an `argument` lies within `limits`.

    Parameters
    ----------
    argument
        Name of the argument of a public function.
    value
        Its value, in the unit of its name.
    limits
        Range to check. Default: that of the argument in `RANGES`.

    Raises
    ------
    UsageError
        The value lies outside; `argument`, `found` and `expected` are set.
    """
    limits = limits or RANGES[argument]
    if not limits.contains(value):
        raise UsageError(argument=argument, found=value, expected=str(limits))
