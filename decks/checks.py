"""Checks that a finger, a probe and a contact share: numbers of a value by their names."""

import math

from fembridge.errors import FembridgeError, FingerError

_Kind = type[FembridgeError]


def finite(value: object, name: str, error: _Kind = FingerError) -> float:
    """The number that `value` has under `name`."""
    number: float = getattr(value, name)
    if not math.isfinite(number):
        raise error(f"{name} must be finite, got {number}")
    return number


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


def between(value: object, name: str, least: float, most: float) -> None:
    """Refuse a number outside `least` to `most`; both belong to the range."""
    if not least <= (number := finite(value, name)) <= most:
        raise FingerError(f"{name} must be {least:g} to {most:g}, got {number:g}")
