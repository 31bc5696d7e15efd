"""A specification, ``bar:width_mm=1,length_mm=8``, as the call that it stands for, or a file."""

import inspect
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from fembridge.errors import UsageError
from fembridge.host.store import near_hint
from fembridge.io.number import parse_number, parse_whole_number

_Value = TypeVar("_Value")


def _parse_flag(text: str) -> bool:
    if text not in ("true", "false"):
        raise ValueError(text)
    return text == "true"


_PARSERS: Mapping[type, tuple[Callable[[str], Any], str]] = {
    int: (parse_whole_number, "a whole number"),
    float: (parse_number, "a number"),
    str: (str, "a text"),
    bool: (_parse_flag, "true or false"),
}


def from_specification(
    specification: str,
    argument: str,
    makers: Mapping[str, Callable[..., _Value]],
    read: Callable[[Path], _Value] | None = None,
    suffixes: str = "",
    **fixed: Any,  # noqa: ANN401
) -> _Value:
    """The value that one of `makers` makes of the settings after its name, or that `read` reads.

    Parameters
    ----------
    specification
        A name of `makers`, with settings as in ``bar:width_mm=1,length_mm=8``, or a path.
    argument
        Argument of the public function, for errors.
    makers
        Functions by name; their arguments with a number, a text or a flag as default are settings.
    read
        Reads a file. Default: None, there are none.
    suffixes
        Suffixes of the files that `read` reads, for errors. Default: none.
    fixed
        Further arguments of the maker.

    Raises
    ------
    UsageError
        Neither a name nor a file, with near names; an unknown setting or a value of another type.
    """
    name, path = specification.partition(":")[0], Path(specification)
    if name in makers:
        return _call(specification, argument, makers[name], **fixed)
    if read is not None and (path.suffix or _exists(path)):
        return read(path)
    expected = ", ".join(makers) + (f" or a file {suffixes}" if read is not None else "")
    problem = f"is {name!r}, expected {expected}{near_hint(name, makers)}"
    raise UsageError(problem, argument=argument, found=name, expected=expected)


def _exists(path: Path) -> bool:
    """Whether `path` is a file, folder or pipe; False if its name is too long for a file."""
    try:
        return path.exists()
    except OSError:
        return False


def _call(
    specification: str,
    argument: str,
    make: Callable[..., _Value],
    **fixed: Any,  # noqa: ANN401
) -> _Value:
    """The value that `make` makes of `fixed` and the settings after the colon."""
    _, _, settings = specification.partition(":")
    types = {
        name: type(parameter.default)
        for name, parameter in inspect.signature(make).parameters.items()
        if isinstance(parameter.default, int | float | str)
    }

    def error(problem: str, found: str, expected: str) -> UsageError:
        text = f"is {specification!r}: {problem}"
        return UsageError(text, argument=argument, found=found, expected=expected)

    values: dict[str, Any] = {}
    for setting in filter(None, settings.split(",")):
        name, equals, text = setting.partition("=")
        name = name.strip()
        if not equals or name not in types:
            expected = ", ".join(f"{option}=..." for option in types) or "no setting"
            hint = near_hint(name, types)
            raise error(f"{setting!r}, expected {expected}{hint}", setting, expected)
        if name in values:
            raise error(f"{name} twice", setting, "each setting once")
        parse, expected = _PARSERS[types[name]]
        try:
            values[name] = parse(text)
        except ValueError as problem:
            raise error(f"{name} is {text!r}, expected {expected}", text, expected) from problem
    return make(**values, **fixed)
