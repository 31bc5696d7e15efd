"""Fingers of a study: a base, and what is different about each, by dotted names.

``skin.epidermis_mm`` is the key ``epidermis_mm`` in the section ``[skin]`` of a
finger file; a grid gives every combination of its lists, rows give one finger each.
"""

import itertools
import math
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias

from decks.finger import Finger
from decks.finger_file import finger_from, read_finger
from decks.presets import PRESETS
from fembridge.errors import FingerError
from fembridge.typing import Table

Value: TypeAlias = float | int | str


@dataclass(frozen=True, slots=True, eq=False)
class Variant:
    """One finger of a study; `label` tells its base and `changes` what is different.

    The keys of `changes` are dotted names, as ``materials.dermis.young_mpa``.
    """

    label: str
    finger: Finger
    changes: Mapping[str, Value] = field(default_factory=dict)

    def value(self, name: str) -> Value | None:
        """Give what this finger has under the dotted `name`; None: no such thing."""
        found: object = self.finger
        for word in name.split("."):
            if isinstance(found, Mapping):
                found = found.get(word)
            else:
                found = getattr(found, word, None)
        return found if isinstance(found, float | int | str) else None

    def __str__(self) -> str:
        told = [f"{name}={_short(value)}" for name, value in self.changes.items()]
        return " ".join([self.label, *told])


def variants_of(
    base: str, changes: Sequence[Mapping[str, Value]], folder: Path
) -> list[Variant]:
    """Give one finger for each of `changes` to `base`, a preset or a file.

    A file's name is counted from `folder`.

    Raises
    ------
    FingerError
        No such base, an unknown name, or a value that cannot be.
    """
    if base in PRESETS:
        label, start = base, {"base": base}
    else:
        path = folder / base
        read_finger(str(path))  # tells what is wrong with it, with its name
        label, start = path.stem, tomllib.loads(path.read_text("utf-8-sig"))
    return [_variant(label, start, row) for row in changes]


def grid_size(grid: Mapping[str, Sequence[Value]]) -> int:
    """Count the combinations of a grid, without making them."""
    return math.prod(len(values) for values in grid.values())


def grid_rows(grid: Mapping[str, Sequence[Value]]) -> Iterator[dict[str, Value]]:
    """Give every combination; the last name changes fastest."""
    for values in itertools.product(*grid.values()):
        yield dict(zip(grid, values, strict=True))


def _variant(label: str, start: Table, row: Mapping[str, Value]) -> Variant:
    try:
        return Variant(label, finger_from(_merged(start, _nested(row)), label), row)
    except FingerError as error:
        told = ", ".join(f"{name} = {value!r}" for name, value in row.items())
        raise FingerError(f"{told}: {error}" if told else str(error)) from error


def _nested(row: Mapping[str, Value]) -> Table:
    table: Table = {}
    for name, value in row.items():
        *sections, key = name.split(".")
        place = table
        for section in sections:
            place = place.setdefault(section, {})
        place[key] = value
    return table


def _merged(below: Mapping[str, object], above: Mapping[str, object]) -> Table:
    """Put `above` over `below`, section by section."""
    table = dict(below)
    for key, value in above.items():
        old = table.get(key)
        if isinstance(value, Mapping) and isinstance(old, Mapping):
            table[key] = _merged(old, value)
        else:
            table[key] = value
    return table


def _short(value: Value) -> str:
    return value if isinstance(value, str) else f"{value:g}"
