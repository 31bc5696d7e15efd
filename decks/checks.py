"""Checks that the parts of a finger and of a probe share."""

import math

from fembridge.errors import FingerError


def finite(value: object, name: str) -> float:
    number = getattr(value, name)
    if isinstance(number, bool) or not isinstance(number, int | float):
        raise FingerError(f"{name} must be a number, got {number!r}")
    if not math.isfinite(number):
        raise FingerError(f"{name} must be finite, got {number}")
    return float(number)


def positive(value: object, *names: str) -> None:
    for name in names:
        if not finite(value, name) > 0:
            raise FingerError(f"{name} must be > 0, got {getattr(value, name)}")


def not_negative(value: object, *names: str) -> None:
    for name in names:
        if not finite(value, name) >= 0:
            raise FingerError(f"{name} must be >= 0, got {getattr(value, name)}")
