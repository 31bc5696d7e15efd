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

A range is from one value to another, or words about the base's: 20 % less to 20 %
more, half of it to twice (even in its logarithm).

Two names are no keys of a finger file: ``contact.friction`` (and what else is asked of
a contact model), and ``afferents.SA.to_boundary_mm``, how far the afferent is from the
boundary of its layer that it is nearest to (`Anchor`).
"""

import itertools
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath
from typing import Any, TypeAlias

import numpy as np

from decks.finger import AfferentSite, Finger
from decks.presets import PRESETS, finger_with, read_finger
from decks.section import DepthOfArc, Section, section_of
from fembridge.errors import FembridgeError, FingerError, UsageError
from fembridge.response.indentation import LADDER
from fembridge.typing import FloatArray, Table

Value: TypeAlias = float | int | str

MOST_POINTS = 100_000
"""Of a study; a larger one is a slip of the pen more often than a wish."""

ONE_AT_A_TIME = "one-at-a-time"
LATIN_HYPERCUBE = "latin-hypercube"

# Of a drawn value: enough for any size, and short to read.
_FIGURES = 6
# Chance correlations of more samples are small without it, and it takes its time.
_MOST_OPTIMISED = 200

_NUMBER = r"(\d+(?:\.\d+)?)"
_WORDS = re.compile(rf"(?:±|\+/?-)?\s*{_NUMBER}\s*%|factor\s+{_NUMBER}", re.ASCII)

CONTACT = "contact."
"""What the names of a contact model begin with."""

_SITES = ("fixed", "follow")
"""Whether afferents stay at their depth or with the boundary of their layer."""

_SKIN = ("stratum_corneum", "epidermis", "dermis", "subcutaneous_tissue")
"""Layers that have a boundary to keep to."""

_TO_BOUNDARY = re.compile(r"afferents\.([^.]+)\.to_boundary_mm")
# A distance is given to a nanometre: beyond that is rounding.
_DIGITS = 6
# The boundaries are sampled this finely along the skin.
_STEP_MM = 0.005


@dataclass(frozen=True, slots=True, eq=False)
class Variant:
    """One finger of a study: `label` is its base, `changes` is what is different.

    The keys of `changes` are dotted names, as ``materials.dermis.young_mpa``.
    `called` names it where its changes would be many words.
    """

    label: str
    finger: Finger
    changes: Mapping[str, Value] = field(default_factory=dict)
    called: str = ""

    @property
    def contact(self) -> dict[str, Value]:
        """What it asks of the contact model, without the first word."""
        names = [name for name in self.changes if name.startswith(CONTACT)]
        return {name.removeprefix(CONTACT): self.changes[name] for name in names}

    def value(self, name: str) -> Value | None:
        """What this finger has under the dotted `name`; None: no such thing."""
        match = _TO_BOUNDARY.fullmatch(name)
        if name.startswith(CONTACT) or (match and name in self.changes):
            return self.changes.get(name)
        if match:
            return anchor_of(self.finger, match[1]).distance_mm
        found: object = self.finger
        for word in name.split("."):
            found = found.get(word) if isinstance(found, Mapping) else getattr(found, word, None)
        return found if isinstance(found, float | int | str) else None

    def __str__(self) -> str:
        changes = [
            f"{name}={value if isinstance(value, str) else format(value, 'g')}"
            for name, value in self.changes.items()
        ]
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
    """
    asked = []
    for number, entry in enumerate(entries, start=1):
        with naming(f"fingers {number}"):
            start = _base_of(entry, folder)
            asked.append((entry, start, *_rows_of(entry, start)))
    check_points(rest * sum(len(rows) for _, _, rows, _ in asked))
    variants: list[Variant] = []
    for number, each in enumerate(asked, start=1):
        with naming(f"fingers {number}"):
            variants += _variants(*each)
    return tuple(variants)


def combinations(tables: Sequence[Mapping[str, object]]) -> list[dict[str, Value]]:
    """Each combination of the lists in each of `tables`, the last the fastest."""
    grids = []
    for number, table in enumerate(tables, start=1):
        with naming(str(number)):
            grids.append({name: _values(name, value) for name, value in table.items()})
    check_points(sum(math.prod(map(len, grid.values())) for grid in grids))
    return [
        dict(zip(grid, row, strict=True))
        for grid in grids
        for row in itertools.product(*grid.values())
    ]


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


@contextmanager
def naming(where: str) -> Iterator[None]:
    """Name the place in the study in front of what is wrong inside the block."""
    try:
        yield
    except FembridgeError as error:
        raise UsageError(f"{where}: {error}") from error


def _rows_of(entry: FingersTable, start: Variant) -> tuple[Sequence[Table], Sequence[str]]:
    """What is different about each finger of an entry, and of a design what each is called."""
    given = [key for key in ("grid", "rows", "ranges") if getattr(entry, key) is not None]
    if len(given) > 1:
        raise UsageError(f"{' and '.join(given)}, expected one of them")
    if entry.sites not in (None, *_SITES):
        raise UsageError(f"sites: {entry.sites!r}, expected {' or '.join(_SITES)}")
    if entry.ranges is not None:
        return _designed(entry, _flat(entry.ranges), start)
    if any(each is not None for each in (entry.design, entry.samples, entry.seed)):
        raise UsageError("design, samples and seed are for ranges")
    tables = [entry.grid or {}] if entry.rows is None else entry.rows
    if not tables:
        raise UsageError("rows: none, expected one or more")
    return combinations([_flat(table) for table in tables]), ()


def _designed(
    entry: FingersTable, asked: Table, start: Variant
) -> tuple[Sequence[Table], Sequence[str]]:
    """Rows of a design, and what each is called."""
    one_by_one = entry.design == ONE_AT_A_TIME and entry.samples is entry.seed is None
    if not one_by_one and entry.design != LATIN_HYPERCUBE:
        raise UsageError(
            f"design: {entry.design or ''!r}, expected {ONE_AT_A_TIME} without samples and seed "
            f"or {LATIN_HYPERCUBE}"
        )
    samples, seed = entry.samples or 0, entry.seed or 0
    for key, count, least in (("samples", samples, 2), ("seed", seed, 0)):
        if not one_by_one and not least <= count <= MOST_POINTS:
            raise UsageError(f"{key}: {count}, expected {least} to {MOST_POINTS}")
    if not asked:
        raise UsageError("ranges: none, expected one or more")
    base, ranges = {}, {}
    for name, span in asked.items():
        with naming(f"ranges: {name}"):
            found = start.value(name)
            if name.startswith(CONTACT):
                found = getattr(LADDER[0], name.removeprefix(CONTACT), None)
            number = float(found) if isinstance(found, int | float) else None
            ranges[name] = range_of(span, number)
            if number is not None:
                base[name] = number
            elif one_by_one:
                raise UsageError("the base has no such number")
    if not one_by_one:
        rows = latin_hypercube(ranges, samples, seed)
        return rows, [f"sample {k} of {samples}" for k in range(1, samples + 1)]
    rows = one_at_a_time(base, ranges)
    moved = [[f"{n}={v:g}" for n, v in row.items() if v != base[n]] for row in rows]
    return rows, [each[0] if each else "base" for each in moved]


def _base_of(entry: FingersTable, folder: Path) -> Variant:
    """The finger that an entry starts from, a preset or a file."""
    if entry.base in PRESETS:
        return Variant(entry.base, PRESETS[entry.base])
    check_below(entry.base)
    path = folder / entry.base
    return Variant(path.stem, read_finger(str(path)))


def _variants(
    entry: FingersTable,
    start: Variant,
    rows: Sequence[Mapping[str, Value]],
    called: Sequence[str],
) -> list[Variant]:
    """One finger for each of `rows`, changes to `start`, the base of `entry`.

    Where afferents follow, each keeps its distance to the boundary of its layer that
    it is nearest to; or else it stays at its depth, unless that is changed.
    """
    finger = start.finger
    follows = entry.sites == "follow" or (entry.ranges is not None and entry.sites is None)
    asked = {match[1] for row in rows for match in map(_TO_BOUNDARY.fullmatch, row) if match}
    if follows:
        asked |= {name for name, site in finger.afferents.items() if site.layer in _SKIN}
    anchors = {name: anchor_of(finger, name) for name in sorted(asked)}
    variants = []
    for row, name in zip(rows, called or [""] * len(rows), strict=True):
        try:
            made = finger_with(finger, _sections(row))
            made = anchored(made, _kept(anchors, row, follows))
        except FingerError as error:
            where = f"choose narrower ranges: {name}" if name else ""
            where = where or ", ".join(f"{key} = {value!r}" for key, value in row.items())
            raise FingerError(f"{where}: {error}" if where else str(error)) from error
        variants.append(Variant(start.label, made, row, name))
    return variants


def _kept(
    anchors: Mapping[str, "Anchor"], row: Mapping[str, Value], follows: bool
) -> dict[str, "Anchor"]:
    """Where the afferents of one finger keep to, with the distances that `row` asks for."""
    kept = {}
    for name, anchor in anchors.items():
        key = f"afferents.{name}.to_boundary_mm"
        placed = {f"afferents.{name}.{each}" for each in ("depth_mm", "layer")} & {*row}
        if key not in row:
            if follows and not placed:
                kept[name] = anchor
            continue
        distance_mm = row[key]
        if placed:
            raise FingerError(f"{key} beside {placed.pop()}, expected one")
        if not isinstance(distance_mm, float | int) or distance_mm <= 0:
            raise FingerError(f"{key}: {distance_mm!r}, expected a number > 0")
        kept[name] = replace(anchor, distance_mm=float(distance_mm))
    return kept


def _sections(row: Mapping[str, Value]) -> Table:
    """What a finger file says for the sizes in `row`, which have dotted names."""
    table: Table = {}
    for name, value in row.items():
        if not (name.startswith(CONTACT) or _TO_BOUNDARY.fullmatch(name)):
            *sections, key = name.split(".")
            below = table
            for section in sections:
                below = below.setdefault(section, {})
            below[key] = value
    return table


def _flat(table: Mapping[str, object], above: str = "") -> Table:
    """Dotted names for nested sections; quoted dotted names stay."""
    flat: Table = {}
    for key, value in table.items():
        name = f"{above}{key}"
        if value == {}:
            raise UsageError(f"{name}: an empty section, expected a key")
        inner = _flat(value, f"{name}.") if isinstance(value, Mapping) else {name: value}
        for one, content in inner.items():
            if "." not in one:
                raise UsageError(f"{one!r}, expected section.key, as skin.epidermis_mm")
            for other in flat:  # the same, or a section that holds the other
                if f"{one}.".startswith(f"{other}.") or f"{other}.".startswith(f"{one}."):
                    raise UsageError(f"{one}: a duplicate of {other}")
            flat[one] = content
    return flat


def _values(name: str, value: object) -> list[Value]:
    """Different finite numbers or words, of a list or a single one."""
    values: list[Any] = value if isinstance(value, list) else [value]
    for each in values:
        if type(each) not in (int, float, str) or each in (math.inf, -math.inf) or each != each:
            raise UsageError(f"{name}: {each!r}, expected a finite number or a word")
    if not values or len(set(values)) < len(values):
        raise UsageError(f"{name}: expected one or more values, none of them a duplicate")
    return values


@dataclass(frozen=True, slots=True)
class Range:
    """From `low` to `high`, evenly, or evenly in the logarithm."""

    low: float
    high: float
    logarithmic: bool = False

    def at(self, share: float) -> float:
        """Value at `share` of the way, 0 to 1."""
        if self.logarithmic:
            return _rounded(self.low * (self.high / self.low) ** share)
        return _rounded(self.low + share * (self.high - self.low))


def range_of(asked: object, base: float | None) -> Range:
    """Range that the study asks for, of a parameter with the `base` value."""
    if isinstance(asked, list) and all(type(each) in (int, float) for each in asked):
        if len(asked) == 2 and -math.inf < asked[0] < asked[1] < math.inf:
            return Range(float(asked[0]), float(asked[1]))
    elif base is not None and base > 0 and (match := _WORDS.fullmatch(str(asked))):
        share, factor = float(match[1] or 0) / 100, float(match[2] or 0)
        if 0 < share < 1:
            return Range(_rounded(base * (1 - share)), _rounded(base * (1 + share)))
        if factor > 1:
            return Range(_rounded(base / factor), _rounded(base * factor), logarithmic=True)
    raise UsageError(
        f"{asked!r} of the base's {base}, expected [from, to], as [0.9, 1.3]; of a base above 0 "
        "also '20 %', below 100 %, or 'factor 2', above 1"
    )


def one_at_a_time(base: Mapping[str, float], ranges: Mapping[str, Range]) -> list[dict[str, float]]:
    """The base first, then each parameter low and high, the others as in the base.

    A value that is the base's own is left out: it is no other finger.
    """
    rows = [dict(base)]
    for name, span in ranges.items():
        rows += [{**base, name: value} for value in (span.low, span.high) if value != base[name]]
    return rows


def latin_hypercube(ranges: Mapping[str, Range], samples: int, seed: int) -> list[dict[str, float]]:
    """Fingers of which each of `samples` slices of each range has one.

    Of the ways to draw them, one in which parameters hardly go together is searched
    for (``random-cd`` of SciPy). The same seed draws the same fingers, as long as
    SciPy is the same.
    """
    from scipy.stats import qmc

    sampler = qmc.LatinHypercube(
        len(ranges),
        optimization="random-cd" if samples <= _MOST_OPTIMISED else None,
        seed=np.random.default_rng(seed),
    )
    return [
        {name: span.at(share) for (name, span), share in zip(ranges.items(), row, strict=True)}
        for row in sampler.random(samples).tolist()
    ]


def _rounded(value: float) -> float:
    return float(f"{value:.{_FIGURES}g}")


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
    """Boundary that afferent `name` of `finger` is nearest to."""
    if name not in finger.afferents:
        raise FingerError(f"afferent {name!r}, expected one of {', '.join(finger.afferents)}")
    site = finger.afferents[name]
    top_mm, bottom_mm = _span_mm(section_of(finger), site)
    _check_inside(name, site, top_mm, bottom_mm)
    below_top_mm, above_bottom_mm = site.depth_mm - top_mm, bottom_mm - site.depth_mm
    upper = below_top_mm <= above_bottom_mm
    return Anchor(upper, round(min(below_top_mm, above_bottom_mm), _DIGITS))


def anchored(finger: Finger, anchors: Mapping[str, Anchor]) -> Finger:
    """`finger` with afferents where their anchors are."""
    if not anchors:
        return finger
    section, sites = section_of(finger), dict(finger.afferents)
    for name, anchor in anchors.items():
        top_mm, bottom_mm = _span_mm(section, sites[name])
        depth_mm = top_mm + anchor.distance_mm if anchor.upper else bottom_mm - anchor.distance_mm
        sites[name] = replace(sites[name], depth_mm=round(max(depth_mm, 0.0), _DIGITS))
        _check_inside(name, sites[name], top_mm, bottom_mm)
    return replace(finger, afferents=sites)


def _check_inside(name: str, site: AfferentSite, top_mm: float, bottom_mm: float) -> None:
    if not top_mm < site.depth_mm < bottom_mm:
        raise FingerError(
            f"afferent {name} at depth {site.depth_mm:g} mm is not inside the "
            f"{site.layer}, {top_mm:.4g} to {bottom_mm:.4g} mm deep there"
        )


def _span_mm(section: Section, site: AfferentSite) -> tuple[float, float]:
    """Depths between which the site's layer lies at the site's ``x``."""
    if site.layer not in _SKIN:
        raise FingerError(f"a place in the {site.layer} has no boundary of the skin to keep to")
    boundaries = (section.surface, section.corneum, section.epidermis, section.dermis)
    upper = _SKIN.index(site.layer)
    top_mm = _depth_mm(section, boundaries[upper], site.x_mm)
    if upper + 1 < len(boundaries):
        return top_mm, _depth_mm(section, boundaries[upper + 1], site.x_mm)
    bone = section.finger.bone
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
