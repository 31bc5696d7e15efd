"""Checks that a finger, a probe and a contact share: one number of a value each."""

import math

from fembridge.errors import FembridgeError, FingerError

# Above this an integer is no size of anything, and 10**400 is no float at all.
_LARGEST = 10**15

_Kind = type[FembridgeError]


def finite(value: object, name: str, error: _Kind = FingerError) -> float:
    """Give the number that `value` has under `name`; not a boolean, not NaN."""
    number = getattr(value, name)
    if isinstance(number, bool) or not isinstance(number, int | float):
        raise error(f"{name} must be a number, got {number!r}")
    if isinstance(number, int) and abs(number) > _LARGEST:
        raise error(f"{name} must be at most 1e15, got a larger whole number")
    if not math.isfinite(number):
        raise error(f"{name} must be finite, got {number}")
    return float(number)


def positive(value: object, *names: str, error: _Kind = FingerError) -> None:
    """Refuse a number that is zero or less."""
    for name in names:
        if not (number := finite(value, name, error)) > 0:
            raise error(f"{name} must be > 0, got {number:g}")


def not_negative(value: object, *names: str, error: _Kind = FingerError) -> None:
    """Refuse a number below zero."""
    for name in names:
        if not (number := finite(value, name, error)) >= 0:
            raise error(f"{name} must be >= 0, got {number:g}")


def between(
    value: object, name: str, least: float, most: float, error: _Kind = FingerError
) -> None:
    """Refuse a number outside `least` to `most`; both belong to the range."""
    if not least <= (number := finite(value, name, error)) <= most:
        raise error(f"{name} must be {least:g} to {most:g}, got {number:g}")
