"""A word with sizes, ``bar:width_mm=1,length_mm=8``, as the call that it stands for, or a file."""

import inspect
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from fembridge.errors import UsageError
from fembridge.number import parse_number, parse_whole_number
from fembridge.store import near_hint

_Made = TypeVar("_Made")
_PARSERS: Mapping[type, tuple[Callable[[str], Any], str]] = {
    int: (parse_whole_number, "a whole number"),
    float: (parse_number, "a number"),
    str: (str, "a text"),
}


def named(
    word: str,
    kind: str,
    makers: Mapping[str, Callable[..., _Made]],
    read: Callable[[Path], _Made],
    suffixes: str,
    **fixed: Any,  # noqa: ANN401
) -> _Made:
    """The value that one of `makers` makes of the sizes after its name, or that `read` reads.

    `kind` and `suffixes` say what was expected.

    Raises
    ------
    UsageError
        Neither a name nor a file; near names are named.
    """
    name, path = word.partition(":")[0], Path(word)
    if name in makers:
        return _call(word, makers[name], **fixed)
    if path.suffix or _exists(path):
        return read(path)
    raise UsageError(
        f"{kind} {name!r}, expected {', '.join(makers)} or a file {suffixes}"
        + near_hint(name, makers)
    )


def _exists(path: Path) -> bool:
    """Whether `path` is a file, folder or pipe; not where its name is too long for one."""
    try:
        return path.exists()
    except OSError:
        return False


def _call(word: str, make: Callable[..., _Made], **fixed: Any) -> _Made:  # noqa: ANN401
    """The value that `make` makes of the sizes after the colon of `word` and of `fixed`."""
    _, _, sizes = word.partition(":")
    kinds = {
        key: type(parameter.default)
        for key, parameter in inspect.signature(make).parameters.items()
        if isinstance(parameter.default, int | float | str)
    }
    arguments: dict[str, Any] = {}
    for part in filter(None, sizes.split(",")):
        key, equals, text = part.partition("=")
        key = key.strip()
        if not equals or key not in kinds:
            expected = ", ".join(f"{name}=..." for name in kinds) or "no size"
            raise UsageError(f"{word!r}: {part!r}, expected {expected}{near_hint(key, kinds)}")
        if key in arguments:
            raise UsageError(f"{word!r}: {key} twice")
        parse, expected = _PARSERS[kinds[key]]
        try:
            arguments[key] = parse(text)
        except ValueError as error:
            raise UsageError(f"{word!r}: {key} is {text!r}, expected {expected}") from error
    return make(**arguments, **fixed)
