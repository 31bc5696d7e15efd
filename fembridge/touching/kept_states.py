"""What touches have in common, kept from one touch to the next: states of contact and their stress.

A touch of a shape that goes in and out at one place is read from states at levels that all touches
of a rung share (`fembridge.touching.press_levels`). What is kept has the bits of what would be
computed anew, so that no result depends on the touches before.
"""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from functools import partial
from threading import Lock
from typing import Any, TypeVar

from fembridge.touching.shape import Shape

MOST_BYTES = 128_000_000
"""Memory of all that is kept; of the states of a deep press, 10 MB."""

_Value = TypeVar("_Value")
_kept: OrderedDict[Hashable, tuple[Any, int]] = OrderedDict()
_lock = Lock()


def kept(
    key: Hashable | None, make: Callable[[], _Value], size_of: Callable[[_Value], int]
) -> _Value:
    """The value of `key`, made by `make` unless it is kept.

    Parameters
    ----------
    key
        All that the value depends on. None: the value is made, and not kept.
    make
        Makes the value; what it raises is not kept.
    size_of
        Bytes of a value. What was used longest ago goes first once all is more than `MOST_BYTES`.
    """
    if key is None:
        return make()
    with _lock:
        if key in _kept:
            _kept.move_to_end(key)
            value: _Value = _kept[key][0]
            return value
    value = make()
    with _lock:
        _kept[key] = value, size_of(value)
        _kept.move_to_end(key)
        while kept_bytes() > MOST_BYTES:
            _kept.popitem(last=False)
    return value


def kept_bytes() -> int:
    """Memory of all that is kept."""
    return sum(size for _, size in _kept.values())


def drop_states() -> None:
    """Let all go that is kept."""
    with _lock:
        _kept.clear()


def shape_key(shape: Shape) -> Hashable:
    """What the heights of `shape` at its place depend on.

    Shapes of the same sizes have the same key; of a height map or a function of a user it is that
    object itself.
    """
    height: Hashable = shape.height
    if isinstance(height, partial) and not height.args:
        sizes = height.func, *sorted(height.keywords.items())
        try:
            hash(sizes)
        except TypeError:  # a height map
            pass
        else:
            height = sizes
    return shape.name, shape.x_mm, shape.z_mm, shape.angle_deg, height
