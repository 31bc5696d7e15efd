"""Fingers of a study: a base, and what is different about each, by dotted names.

``skin.epidermis_mm`` is the key ``epidermis_mm`` in the section ``[skin]`` of a
finger file; a grid gives every combination of its lists, rows give one finger each.
Two names are no keys of a finger file: ``contact.friction`` (and what else is asked of
a contact model), and ``afferents.SA.to_boundary_mm``, how far the afferent is from the
boundary of its layer that it is nearest to (`fembridge.sweep.site`).
"""

import itertools
import math
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeAlias

from decks.finger import Finger
from decks.finger_file import finger_from, read_finger
from decks.presets import PRESETS
from fembridge.errors import FingerError
from fembridge.sweep.site import SKIN, Anchor, anchor_of, anchored
from fembridge.typing import Table

Value: TypeAlias = float | int | str

CONTACT = "contact."
"""What the names of a contact model begin with."""

_TO_BOUNDARY = re.compile(r"afferents\.([^.]+)\.to_boundary_mm")


@dataclass(frozen=True, slots=True, eq=False)
class Variant:
    """One finger of a study; `label` tells its base and `changes` what is different.

    The keys of `changes` are dotted names, as ``materials.dermis.young_mpa``;
    `contact` holds what it asks of the contact model, without the first word.
    `told` is what tells it from others where its changes would be many words.
    """

    label: str
    finger: Finger
    changes: Mapping[str, Value] = field(default_factory=dict)
    contact: Mapping[str, Value] = field(default_factory=dict)
    told: str = ""

    def value(self, name: str) -> Value | None:
        """Give what this finger has under the dotted `name`; None: no such thing."""
        if name.startswith(CONTACT):
            return self.contact.get(name.removeprefix(CONTACT))
        if (match := _TO_BOUNDARY.fullmatch(name)) is not None:
            own = self.changes.get(name)
            return anchor_of(self.finger, match[1]).distance_mm if own is None else own
        found: object = self.finger
        for word in name.split("."):
            found = found.get(word) if isinstance(found, Mapping) else getattr(found, word, None)
        return found if isinstance(found, float | int | str) else None

    def __str__(self) -> str:
        told = [f"{name}={_short(value)}" for name, value in self.changes.items()]
        return " ".join([self.label, *([self.told] if self.told else told)])


def variants_of(
    base: str,
    changes: Sequence[Mapping[str, Value]],
    folder: Path,
    *,
    follows: bool = False,
    told: Sequence[str] = (),
) -> list[Variant]:
    """Give one finger for each of `changes` to `base`, a preset or a file.

    A file's name is counted from `folder`. With `follows` afferents keep their
    distance to the boundary of their layer that they are nearest to; or else they
    stay at their depth, unless it is changed. `told` names each where its changes
    would be many words.

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
    anchors = _anchors(finger_from(start, label), changes, follows)
    names = told or [""] * len(changes)
    return [
        _variant(label, start, row, anchors, follows, name)
        for row, name in zip(changes, names, strict=True)
    ]


def grid_size(grid: Mapping[str, Sequence[Value]]) -> int:
    """Count the combinations of a grid, without making them."""
    return math.prod(len(values) for values in grid.values())


def grid_rows(grid: Mapping[str, Sequence[Value]]) -> Iterator[dict[str, Value]]:
    """Give every combination; the last name changes fastest."""
    for values in itertools.product(*grid.values()):
        yield dict(zip(grid, values, strict=True))


def _anchors(
    base: Finger, changes: Sequence[Mapping[str, Value]], follows: bool
) -> dict[str, Anchor]:
    """Give where the afferents of the base keep to, those that are asked for."""
    asked = {match[1] for row in changes for match in map(_TO_BOUNDARY.fullmatch, row) if match}
    if follows:
        asked |= {name for name, site in base.afferents.items() if site.layer in SKIN}
    return {name: anchor_of(base, name) for name in sorted(asked)}


def _variant(
    label: str,
    start: Table,
    row: Mapping[str, Value],
    anchors: Mapping[str, Anchor],
    follows: bool,
    name: str,
) -> Variant:
    contact = {
        key.removeprefix(CONTACT): value for key, value in row.items() if key.startswith(CONTACT)
    }
    distances = {
        match[1]: value
        for key, value in row.items()
        if (match := _TO_BOUNDARY.fullmatch(key)) is not None
    }
    plain = {
        key: value
        for key, value in row.items()
        if not key.startswith(CONTACT) and not _TO_BOUNDARY.fullmatch(key)
    }
    try:
        finger = finger_from(_merged(start, _nested(plain)), label)
        kept = _kept(anchors, distances, plain, follows)
        return Variant(label, anchored(finger, kept), row, contact, name)
    except FingerError as error:
        told = name or ", ".join(f"{key} = {value!r}" for key, value in row.items())
        raise FingerError(f"{told}: {error}" if told else str(error)) from error


def _kept(
    anchors: Mapping[str, Anchor],
    distances: Mapping[str, Value],
    plain: Mapping[str, Value],
    follows: bool,
) -> dict[str, Anchor]:
    """Give where the afferents of one finger keep to; `distances` are told."""
    kept = {}
    for name, anchor in anchors.items():
        placed = {f"afferents.{name}.{key}" for key in ("depth_mm", "layer")} & {*plain}
        if name not in distances:
            if follows and not placed:
                kept[name] = anchor
            continue
        distance_mm = distances[name]
        if placed:
            raise FingerError(
                f"afferents.{name}.to_boundary_mm beside {placed.pop()}, expected one"
            )
        if not isinstance(distance_mm, float | int) or distance_mm <= 0:
            raise FingerError(
                f"afferents.{name}.to_boundary_mm: {distance_mm!r}, expected a number > 0"
            )
        kept[name] = replace(anchor, distance_mm=float(distance_mm))
    return kept


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
