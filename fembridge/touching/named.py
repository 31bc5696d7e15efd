"""A word with sizes, ``bar:width_mm=1,length_mm=8``, as the call that it stands for, or a file."""

import inspect
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from fembridge.errors import UsageError
from fembridge.store import near_hint

_Made = TypeVar("_Made")


def named(
    word: str,
    kind: str,
    known: Mapping[str, Callable[..., _Made]],
    read: Callable[[Path], _Made],
    suffixes: str,
    **fixed: Any,  # noqa: ANN401
) -> _Made:
    """What a `known` name, with the sizes after its colon, makes; else the file is `read`.

    `kind` and `suffixes` say what was expected.

    Raises
    ------
    UsageError
        Neither a name nor a file; near names are named.
    """
    name, path = word.partition(":")[0], Path(word)
    if name in known:
        return _made_of(word, known[name], **fixed)
    if path.suffix or path.exists():
        return read(path)
    raise UsageError(
        f"{kind} {name!r}, expected {', '.join(known)} or a file {suffixes}"
        + near_hint(name, known)
    )


def _made_of(word: str, make: Callable[..., _Made], **fixed: Any) -> _Made:  # noqa: ANN401
    """What `make` makes of the sizes after the colon of `word`; `fixed` are not the user's."""
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
