"""Fingers of a study: a base, and what is different about each, by dotted names.

``skin.epidermis_mm`` is the key ``epidermis_mm`` in the section ``[skin]`` of a
finger file. A grid has every combination of its lists, rows are one finger each, and
a design draws fingers from ranges::

    [[fingers]]
    base = "quick"
    design = "latin-hypercube"
    samples = 50
    seed = 1
    [fingers.ranges]
    skin.dermis_mm = [0.9, 1.3]
    materials.dermis.young_mpa = "factor 2"
    contact.friction = "20 %"

Two names are no keys of a finger file: ``contact.friction`` (and what else is asked of
a contact model), and ``afferents.SA.to_boundary_mm``, how far the afferent is from the
boundary of its layer that it is nearest to (`Anchor`).
"""

import itertools
import math
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, replace
from pathlib import Path, PurePosixPath
from typing import Any, TypeAlias

import numpy as np

from decks.analysis import Contact
from decks.finger import AfferentSite, Finger
from decks.finger_file import finger_from, read_finger
from decks.presets import PRESETS
from decks.section import DepthOfArc, Section, section_of
from fembridge.errors import FembridgeError, FingerError, UsageError
from fembridge.response.solve import LADDER
from fembridge.store import near_hint
from fembridge.sweeps.design import (
    DESIGNS,
    LATIN_HYPERCUBE,
    ONE_AT_A_TIME,
    latin_hypercube,
    one_at_a_time,
    range_of,
)
from fembridge.typing import FloatArray, Table

Value: TypeAlias = float | int | str

CONTACT = "contact."
"""What the names of a contact model begin with."""

CONTACT_KEYS = tuple(each.name for each in fields(Contact))

MOST_POINTS = 100_000
"""Of a study; a larger one is a slip of the pen more often than a wish."""

SITES = ("fixed", "follow")
"""Whether afferents stay at their depth or with the boundary of their layer."""

SKIN = ("stratum_corneum", "epidermis", "dermis", "subcutaneous_tissue")
"""Layers that have a boundary to keep to."""

_TO_BOUNDARY = re.compile(r"afferents\.([^.]+)\.to_boundary_mm")
# A distance is given to a nanometre: beyond that is rounding.
_DIGITS = 6
# The boundaries are sampled this finely along the skin.
_STEP_MM = 0.005


@dataclass(frozen=True, slots=True, eq=False)
class Variant:
    """One finger of a study: `label` is its base, `changes` is what is different.

    The keys of `changes` are dotted names, as ``materials.dermis.young_mpa``;
    `contact` holds what it asks of the contact model, without the first word.
    `called` names it where its changes would be many words.
    """

    label: str
    finger: Finger
    changes: Mapping[str, Value] = field(default_factory=dict)
    contact: Mapping[str, Value] = field(default_factory=dict)
    called: str = ""

    def value(self, name: str) -> Value | None:
        """What this finger has under the dotted `name`; None: no such thing."""
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
        changes = [f"{name}={_short(value)}" for name, value in self.changes.items()]
        return " ".join([self.label, *([self.called] if self.called else changes)])


@dataclass(frozen=True, slots=True)
class FingersTable:
    """One entry of ``fingers`` as it is written in a study."""

    base: str = "quick"
    grid: dict[str, Any] | None = None
    rows: list[dict[str, Any]] | None = None
    ranges: dict[str, Any] | None = None
    design: str | None = None
    samples: int | None = None
    seed: int | None = None
    sites: str | None = None


def fingers_of(entries: Sequence[FingersTable], folder: Path, rest: int) -> tuple[Variant, ...]:
    """All fingers of the `entries`; their number is checked before the first is made.

    File names count from `folder`; `rest` is how many points each finger has.

    Raises
    ------
    UsageError
        What cannot be understood or be made: the entry and its row are named.
    """
    asked = []
    for number, entry in enumerate(entries, start=1):
        with _place(f"fingers {number}"):
            asked.append(_changes_of(entry))
    check_points(rest * sum(count for count, _ in asked))
    variants: list[Variant] = []
    for number, (entry, (_, changes)) in enumerate(zip(entries, asked, strict=True), start=1):
        with _place(f"fingers {number}"):
            if entry.base not in PRESETS:
                check_below(entry.base)
            if entry.ranges is not None:
                variants += _designed(entry, folder)
            else:
                follows = entry.sites == SITES[1]
                variants += variants_of(entry.base, list(changes), folder, follows=follows)
    return tuple(variants)


def variants_of(
    base: str,
    changes: Sequence[Mapping[str, Value]],
    folder: Path,
    *,
    follows: bool = False,
    called: Sequence[str] = (),
) -> list[Variant]:
    """One finger for each of `changes` to `base`, a preset or a file.

    A file's name is counted from `folder`. With `follows` afferents keep their
    distance to the boundary of their layer that they are nearest to; or else they
    stay at their depth, unless it is changed.

    Raises
    ------
    FingerError
        No such base, an unknown name, or a value that cannot be.
    """
    if base in PRESETS:
        label, start = base, {"base": base}
    else:
        path = folder / base
        read_finger(str(path))  # names the file in what is wrong with it
        label, start = path.stem, tomllib.loads(path.read_text("utf-8-sig"))
    finger = finger_from(start, label)
    asked = {match[1] for row in changes for match in map(_TO_BOUNDARY.fullmatch, row) if match}
    if follows:
        asked |= {name for name, site in finger.afferents.items() if site.layer in SKIN}
    anchors = {name: anchor_of(finger, name) for name in sorted(asked)}
    names = called or [""] * len(changes)
    return [
        _variant(label, start, row, anchors, follows, name)
        for row, name in zip(changes, names, strict=True)
    ]


def combinations(table: Mapping[str, object], where: str) -> tuple[int, Iterator[dict[str, Value]]]:
    """Number of combinations of the lists in `table`, and each; the last changes fastest."""
    lists = {name: _values(value, f"{where}: {name}") for name, value in table.items()}
    rows = (dict(zip(lists, row, strict=True)) for row in itertools.product(*lists.values()))
    return math.prod(map(len, lists.values())), rows


def check_points(count: int) -> None:
    """Refuse a study of more than `MOST_POINTS`."""
    if count > MOST_POINTS:
        raise UsageError(
            f"{count} points (stimuli x fingers x probes x contacts x depths x "
            f"methods), expected at most {MOST_POINTS}"
        )


def check_below(name: str) -> None:
    """Refuse the name of a file that is not below the study's folder."""
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts or "\0" in name or not name:
        raise UsageError(
            f"{name!r}, expected a name known here or a file below the folder of the study"
        )


def check_keys(table: Mapping[str, object], keys: Sequence[str], where: str) -> None:
    """Refuse a key that is none of `keys`; near ones are named."""
    for key in table:
        if key not in keys:
            raise UsageError(
                f"{where}: unknown key {key!r}, expected {', '.join(keys)}{near_hint(key, keys)}"
            )


def _changes_of(entry: FingersTable) -> tuple[int, Iterator[Mapping[str, Value]]]:
    """Number of fingers of an entry, and what is different in each; none yet of a design."""
    given = [key for key in ("grid", "rows", "ranges") if getattr(entry, key) is not None]
    if len(given) > 1:
        raise UsageError(f"{' and '.join(given)}, expected one of them")
    if entry.sites not in (None, *SITES):
        raise UsageError(f"sites: {entry.sites!r}, expected {' or '.join(SITES)}")
    if entry.ranges is not None:
        return _design_size(entry), iter(())
    for key in ("design", "samples", "seed"):
        if getattr(entry, key) is not None:
            raise UsageError(f"{key}, but no ranges")
    if entry.rows is None:
        return combinations(_flat(entry.grid or {}, "grid"), "grid")
    if not entry.rows:
        raise UsageError("rows: none, expected one or more")
    rows = [
        {name: _value(value, f"row {k}: {name}") for name, value in _flat(row, f"row {k}").items()}
        for k, row in enumerate(entry.rows, start=1)
    ]
    return len(rows), iter(rows)


def _design_size(entry: FingersTable) -> int:
    if entry.design not in DESIGNS:
        raise UsageError(f"design: {entry.design or ''!r}, expected {' or '.join(DESIGNS)}")
    if not entry.ranges:
        raise UsageError("ranges: none, expected one or more")
    if entry.design == ONE_AT_A_TIME:
        for key in ("samples", "seed"):
            if getattr(entry, key) is not None:
                raise UsageError(f"{key} is for a {LATIN_HYPERCUBE}")
        return 1 + 2 * len(_flat(entry.ranges, "ranges"))
    if entry.samples is None:
        raise UsageError("samples: absent, expected how many fingers")
    for key, number, least in (("samples", entry.samples, 2), ("seed", entry.seed or 0, 0)):
        if not least <= number <= MOST_POINTS:
            raise UsageError(f"{key}: {number}, expected {least} to {MOST_POINTS}")
    return entry.samples


def _designed(entry: FingersTable, folder: Path) -> list[Variant]:
    """Fingers of a design; one that cannot be is named."""
    asked = _flat(entry.ranges or {}, "ranges")
    [start] = variants_of(entry.base, [{}], folder)
    base, ranges = {}, {}
    for name, span in asked.items():
        with _place(f"ranges: {name}"):
            base[name] = _base_value(start, name)
            ranges[name] = range_of(span, base[name])
    if entry.design == LATIN_HYPERCUBE:
        samples = entry.samples or 0
        rows = latin_hypercube(ranges, samples, entry.seed or 0)
        called = [f"sample {k} of {samples}" for k in range(1, samples + 1)]
    else:
        numbers = {name: value for name, value in base.items() if value is not None}
        if absent := [name for name in base if name not in numbers]:
            raise UsageError(f"ranges: {absent[0]}: the base has no such number")
        rows = one_at_a_time(numbers, ranges)
        moved = [[f"{n}={v:g}" for n, v in row.items() if v != numbers[n]] for row in rows]
        called = [each[0] if each else "base" for each in moved]
    try:
        follows = entry.sites != SITES[0]
        return variants_of(entry.base, rows, folder, follows=follows, called=called)
    except FembridgeError as error:
        raise UsageError(f"choose narrower ranges: {error}") from error


def _base_value(base: Variant, name: str) -> float | None:
    """The base's number under a dotted name; a contact's is the ladder's first."""
    if name.startswith(CONTACT):
        key = name.removeprefix(CONTACT)
        check_keys({key: None}, CONTACT_KEYS, "contact")
        found: Value | None = getattr(LADDER[0], key)
    else:
        found = base.value(name)
    return None if found is None or isinstance(found, str) else float(found)


def _variant(
    label: str,
    start: Table,
    row: Mapping[str, Value],
    anchors: Mapping[str, "Anchor"],
    follows: bool,
    called: str,
) -> Variant:
    contact, distances, sizes = {}, {}, {}
    for key, value in row.items():
        if key.startswith(CONTACT):
            contact[key.removeprefix(CONTACT)] = value
        elif (match := _TO_BOUNDARY.fullmatch(key)) is not None:
            distances[match[1]] = value
        else:
            sizes[key] = value
    try:
        finger = finger_from(_over(start, sizes), label)
        kept = _kept(anchors, distances, sizes, follows)
        return Variant(label, anchored(finger, kept), row, contact, called)
    except FingerError as error:
        name = called or ", ".join(f"{key} = {value!r}" for key, value in row.items())
        raise FingerError(f"{name}: {error}" if name else str(error)) from error


def _kept(
    anchors: Mapping[str, "Anchor"],
    distances: Mapping[str, Value],
    sizes: Mapping[str, Value],
    follows: bool,
) -> dict[str, "Anchor"]:
    """Where the afferents of one finger keep to, with the `distances` that are asked for."""
    kept = {}
    for name, anchor in anchors.items():
        placed = {f"afferents.{name}.{key}" for key in ("depth_mm", "layer")} & {*sizes}
        if name not in distances:
            if follows and not placed:
                kept[name] = anchor
            continue
        distance_mm = distances[name]
        key = f"afferents.{name}.to_boundary_mm"
        if placed:
            raise FingerError(f"{key} beside {placed.pop()}, expected one")
        if not isinstance(distance_mm, float | int) or distance_mm <= 0:
            raise FingerError(f"{key}: {distance_mm!r}, expected a number > 0")
        kept[name] = replace(anchor, distance_mm=float(distance_mm))
    return kept


def _over(start: Table, sizes: Mapping[str, Value]) -> Table:
    """The finger file `start` with values under dotted names in place of its own."""
    table = dict(start)
    for name, value in sizes.items():
        *sections, key = name.split(".")
        place = table
        for section in sections:
            below = place.get(section)
            place[section] = dict(below) if isinstance(below, Mapping) else {}
            place = place[section]
        place[key] = value
    return table


def _flat(table: Mapping[str, object], where: str, above: str = "") -> Table:
    """Dotted names for nested sections; quoted dotted names stay."""
    flat: Table = {}
    for key, value in table.items():
        name = f"{above}{key}"
        inner = _flat(value, where, f"{name}.") if isinstance(value, Mapping) else {name: value}
        for one, content in inner.items():
            if "." not in one:
                raise UsageError(f"{where}: {one!r}, expected section.key, as skin.epidermis_mm")
            for other in flat:  # the same, or a section that holds the other
                if f"{one}.".startswith(f"{other}.") or f"{other}.".startswith(f"{one}."):
                    raise UsageError(f"{where}: {one}: a duplicate of {other}")
            flat[one] = content
    return flat


def _values(value: object, where: str) -> list[Value]:
    """Different values, of a list or a single one."""
    values = [_value(each, where) for each in (value if isinstance(value, list) else [value])]
    if not values:
        raise UsageError(f"{where}: an empty list, expected values")
    if len(set(values)) < len(values):
        duplicate = next(each for each in values if values.count(each) > 1)
        raise UsageError(f"{where}: {duplicate!r}: a duplicate")
    return values


def _value(value: object, where: str) -> Value:
    """One number or word; a truth value, NaN or a date is neither."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise UsageError(f"{where}: {value!r}, expected a number or a word")
    if isinstance(value, float) and not math.isfinite(value):
        raise UsageError(f"{where}: {value}, expected a finite number")
    return value


@contextmanager
def _place(where: str) -> Iterator[None]:
    """Name the place in the study in front of what is wrong inside the block."""
    try:
        yield
    except FembridgeError as error:
        raise UsageError(f"{where}: {error}") from error


def _short(value: Value) -> str:
    return value if isinstance(value, str) else f"{value:g}"


@dataclass(frozen=True, slots=True)
class Anchor:
    """The boundary that an afferent keeps to: its layer's upper or lower one.

    Merkel cells sit at the bottom of the epidermis and Meissner corpuscles hang on it,
    however thick the skin above is. So a depth below the surface says less about an
    afferent than its distance to the boundary that it is seen at: for SA and RA the one
    between epidermis and dermis, for PC the one above the subcutaneous tissue. The
    boundary is that at the afferent's own ``x``, ridges and papillae included;
    `distance_mm` is the way from there into the layer.
    """

    upper: bool
    distance_mm: float


def anchor_of(finger: Finger, name: str) -> Anchor:
    """Boundary that afferent `name` of `finger` is nearest to.

    Raises
    ------
    FingerError
        No such afferent, or one that does not sit in its layer of the skin.
    """
    site = _site(finger, name)
    top_mm, bottom_mm = _span_mm(section_of(finger), site)
    _check_inside(name, site, top_mm, bottom_mm)
    below_top_mm, above_bottom_mm = site.depth_mm - top_mm, bottom_mm - site.depth_mm
    upper = below_top_mm <= above_bottom_mm
    return Anchor(upper, round(min(below_top_mm, above_bottom_mm), _DIGITS))


def anchored(finger: Finger, anchors: Mapping[str, Anchor]) -> Finger:
    """`finger` with afferents where their anchors are.

    Raises
    ------
    FingerError
        The place is not inside the afferent's layer.
    """
    if not anchors:
        return finger
    section, sites = section_of(finger), dict(finger.afferents)
    for name, anchor in anchors.items():
        site = _site(finger, name)
        top_mm, bottom_mm = _span_mm(section, site)
        depth_mm = top_mm + anchor.distance_mm if anchor.upper else bottom_mm - anchor.distance_mm
        sites[name] = replace(site, depth_mm=round(max(depth_mm, 0.0), _DIGITS))
        _check_inside(name, sites[name], top_mm, bottom_mm)
    return replace(finger, afferents=sites)


def _site(finger: Finger, name: str) -> AfferentSite:
    if name not in finger.afferents:
        raise FingerError(f"afferent {name!r}, expected one of {', '.join(finger.afferents)}")
    return finger.afferents[name]


def _check_inside(name: str, site: AfferentSite, top_mm: float, bottom_mm: float) -> None:
    if not top_mm < site.depth_mm < bottom_mm:
        raise FingerError(
            f"afferent {name} at depth {site.depth_mm:g} mm is not inside the "
            f"{site.layer}, {top_mm:.4g} to {bottom_mm:.4g} mm deep there"
        )


def _span_mm(section: Section, site: AfferentSite) -> tuple[float, float]:
    """Depths between which the site's layer lies at the site's ``x``."""
    finger = section.finger
    upper_and_lower: dict[str, tuple[DepthOfArc, DepthOfArc | None]] = {
        "stratum_corneum": (section.surface, section.corneum),
        "epidermis": (section.corneum, section.epidermis),
        "dermis": (section.epidermis, section.dermis),
        "subcutaneous_tissue": (section.dermis, None),
    }
    if site.layer not in upper_and_lower:
        raise FingerError(f"a place in the {site.layer} has no boundary of the skin to keep to")
    upper, lower = upper_and_lower[site.layer]
    top_mm = _depth_mm(section, upper, site.x_mm)
    if lower is not None:
        return top_mm, _depth_mm(section, lower, site.x_mm)
    bone = finger.bone
    inside = max(0.0, 1 - (site.x_mm / bone.half_width_mm) ** 2)
    return top_mm, bone.depth_mm - bone.half_height_mm * inside**0.5


def _depth_mm(section: Section, curve: DepthOfArc, x_mm: float) -> float:
    """Depth of a boundary at `x_mm`, measured down from the pad's apex."""
    arc_mm: FloatArray = np.arange(0.0, section.end_arc_mm, _STEP_MM)
    point_mm = section.curve(curve, arc_mm)
    pad_mm = point_mm[: int(point_mm[:, 0].argmax()) + 1]
    if abs(x_mm) > pad_mm[-1, 0]:
        raise FingerError(f"x = {x_mm:g} mm: expected within {pad_mm[-1, 0]:.3g} mm of the middle")
    return float(np.interp(abs(x_mm), pad_mm[:, 0], -pad_mm[:, 1]))
