"""Times of a post file without the rounding they are stored with.

A binary file has times in single precision, a formatted one with six digits: at 0.25 s
an even step of 0.5 ms looks uneven in the latter.
"""

import numpy as np

from fembridge.trace import MS_PER_S
from fembridge.typing import FloatArray

_DIGITS = 6


def unrounded_ms(times_ms: FloatArray, kind: str, precision: str) -> FloatArray:
    """Take the rounding out of an even time axis, ``(T,)`` in ms.

    If all times are even within their last stored digit, give the even ones;
    otherwise what was there. `kind` is "t16" or "t19", `precision` "single" or
    "double" as `PostFile` says.
    """
    if times_ms.size < 2:
        return times_ms
    even: FloatArray = np.linspace(times_ms[0], times_ms[-1], times_ms.size)
    times_s = np.abs(times_ms) / MS_PER_S
    if kind == "t19":
        tiny = np.maximum(times_s, np.finfo(np.float64).tiny)
        digit_s = 10.0 ** (np.floor(np.log10(tiny)) + 1 - _DIGITS)
    elif precision == "single":
        digit_s = np.spacing(times_s.astype(np.float32)).astype(np.float64)
    else:
        return times_ms
    digit_ms = digit_s * MS_PER_S
    share = np.linspace(0.0, 1.0, times_ms.size)  # the ends are rounded too
    rounding_ms = digit_ms + (1 - share) * digit_ms[0] + share * digit_ms[-1]
    return even if (np.abs(even - times_ms) <= rounding_ms).all() else times_ms
