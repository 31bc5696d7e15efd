"""A word with sizes, ``bar:width_mm=1,length_mm=8``, as the call that it stands for."""

import inspect
from collections.abc import Callable
from typing import Any, TypeVar

from fembridge.errors import UsageError
from fembridge.store import near_hint

_Made = TypeVar("_Made")


def made_of(word: str, make: Callable[..., _Made], **fixed: Any) -> _Made:  # noqa: ANN401
    """What `make` makes of the sizes after the colon of `word`; `fixed` are not the user's.

    Raises
    ------
    UsageError
        A key that `make` has not, or a value of another kind than its default.
    """
    _, _, sizes = word.partition(":")
    known = {
        key: type(one.default)
        for key, one in inspect.signature(make).parameters.items()
        if isinstance(one.default, int | float | str)
    }
    given: dict[str, Any] = {}
    for part in filter(None, sizes.split(",")):
        key, equals, text = part.partition("=")
        key = key.strip()
        if not equals or key not in known:
            expected = ", ".join(f"{each}=..." for each in known) or "no size"
            raise UsageError(f"{word!r}: {part!r}, expected {expected}{near_hint(key, known)}")
        try:
            given[key] = known[key](text)
        except ValueError as error:
            raise UsageError(f"{word!r}: {key} is {text!r}, expected a number") from error
    return make(**given, **fixed)
