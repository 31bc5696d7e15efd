"""Values of a TOML table, checked one by one: what is there, what was expected, where.

`where` names the place in the file; every error is a `UsageError` that begins with it.
"""

import difflib
import math
from collections.abc import Mapping, Sequence
from pathlib import PurePosixPath

from fembridge.errors import UsageError
from fembridge.sweep.variant import Value


def check_keys(table: Mapping[str, object], keys: Sequence[str], where: str) -> None:
    """Refuse a key that is none of `keys`; near ones are named."""
    for key in table:
        if key not in keys:
            near = difflib.get_close_matches(key, keys, n=2)
            hint = f"; did you mean {' or '.join(near)}?" if near else ""
            raise UsageError(f"{where}: unknown key {key!r}, expected {', '.join(keys)}{hint}")


def list_of(value: object, where: str) -> list[object]:
    """Take a list."""
    if not isinstance(value, list):
        raise UsageError(f"{where}: {value!r}, expected a list")
    return value


def table_of(value: object, where: str) -> Mapping[str, object]:
    """Take a table."""
    if not isinstance(value, Mapping):
        raise UsageError(f"{where}: {value!r}, expected a table")
    return value


def word_of(value: object, where: str) -> str:
    """Take a word."""
    if not isinstance(value, str):
        raise UsageError(f"{where}: {value!r}, expected a word")
    return value


def words_of(value: object, where: str) -> list[str]:
    """Take words, or a single one."""
    values = value if isinstance(value, list) else [value]
    return [word_of(each, where) for each in values]


def truth_of(value: object, where: str) -> bool:
    """Take true or false."""
    if not isinstance(value, bool):
        raise UsageError(f"{where}: {value!r}, expected true or false")
    return value


def number_of(value: object, where: str) -> float:
    """Take one finite number."""
    number = value_of(value, where)
    if isinstance(number, str):
        raise UsageError(f"{where}: {number!r}, expected a number")
    try:
        return float(number)
    except OverflowError as error:
        raise UsageError(f"{where}: a number without measure") from error


def value_of(value: object, where: str) -> Value:
    """Take one number or word; a truth value, NaN or a date is neither."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise UsageError(f"{where}: {value!r}, expected a number or a word")
    if isinstance(value, float) and not math.isfinite(value):
        raise UsageError(f"{where}: {value}, expected a finite number")
    return value


def values_of(value: object, where: str) -> list[Value]:
    """Take a list of different values, or a single one."""
    values = [value_of(each, where) for each in (value if isinstance(value, list) else [value])]
    if not values:
        raise UsageError(f"{where}: an empty list, expected values")
    if len(set(values)) < len(values):
        twice = next(each for each in values if values.count(each) > 1)
        raise UsageError(f"{where}: {twice!r} stands there twice")
    return values


def below(word: str, where: str) -> str:
    """Refuse the name of a file that is not below the study's folder."""
    path = PurePosixPath(word)
    if path.is_absolute() or ".." in path.parts or "\0" in word or not word:
        raise UsageError(
            f"{where}: {word!r}, expected a name known here or a file below the folder of the study"
        )
    return word
