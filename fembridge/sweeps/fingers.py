"""Fingers of a study: a base, and the changes of each finger by dotted names.

``skin.epidermis_mm`` is the key ``epidermis_mm`` in the section ``[skin]`` of a
finger file. A grid has every combination of its lists, each row is one finger, and a
design draws fingers from ranges::

    [[fingers]]
    base = "quick"
    design = "latin-hypercube"
    samples = 50
    seed = 1
    [fingers.ranges]
    skin.dermis_mm = [0.9, 1.3]
    materials.dermis.young_mpa = "factor 2"
    contact.friction = "20 %"

A range is given by two values or relative to the base: 20 % less to 20 % more, or half
of it to twice (evenly in the logarithm).

Two kinds of names are not keys of a finger file: options of the contact model, as
``contact.friction``, and ``afferents.SA.to_boundary_mm``, the distance of the afferent
from the nearest boundary of its layer (`Anchor`).
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

MAX_POINTS = 100_000
"""Most points of a study; a larger study is usually a mistake."""

ONE_AT_A_TIME = "one-at-a-time"
LATIN_HYPERCUBE = "latin-hypercube"

# Significant digits of a drawn value.
_SIGNIFICANT_DIGITS = 6
# Optimisation is slow for more samples, whose chance correlations are small anyway.
_MAX_OPTIMISED_SAMPLES = 200

_NUMBER = r"(\d+(?:\.\d+)?)"
_RELATIVE_RANGE = re.compile(rf"(?:±|\+/?-)?\s*{_NUMBER}\s*%|factor\s+{_NUMBER}", re.ASCII)

CONTACT_PREFIX = "contact."
"""Prefix of the names of contact options."""

_SITES = ("fixed", "follow")
"""Afferents stay at their depth, or at their distance to the boundary of their layer."""

_SKIN_LAYERS = ("stratum_corneum", "epidermis", "dermis", "subcutaneous_tissue")
"""Layers in which afferents can follow a boundary."""

_TO_BOUNDARY = re.compile(r"afferents\.([^.]+)\.to_boundary_mm")
# Decimals of a distance in mm: 1 nm.
_DECIMALS = 6
# Sampling of the boundaries along the skin.
_STEP_MM = 0.005


@dataclass(frozen=True, slots=True, eq=False)
class Variant:
    """One finger of a study: `label` is its base, `changes` its values by dotted names.

    A dotted name is ``materials.dermis.young_mpa``. `called` replaces the changes in the text of
    the variant, by default none.
    """

    label: str
    finger: Finger
    changes: Mapping[str, Value] = field(default_factory=dict)
    called: str = ""

    @property
    def contact(self) -> dict[str, Value]:
        """Contact options of this finger, without the prefix."""
        names = [name for name in self.changes if name.startswith(CONTACT_PREFIX)]
        return {name.removeprefix(CONTACT_PREFIX): self.changes[name] for name in names}

    def value(self, name: str) -> Value | None:
        """Value of this finger under the dotted `name`; None if it has none."""
        match = _TO_BOUNDARY.fullmatch(name)
        if name.startswith(CONTACT_PREFIX) or (match and name in self.changes):
            return self.changes.get(name)
        if match:
            return anchor_of(self.finger, match[1]).distance_mm
        item: object = self.finger
        for key in name.split("."):
            item = item.get(key) if isinstance(item, Mapping) else getattr(item, key, None)
        return item if isinstance(item, float | int | str) else None

    def __str__(self) -> str:
        changes = [
            f"{name}={value if isinstance(value, str) else format(value, 'g')}"
            for name, value in self.changes.items()
        ]
        return " ".join([self.label, *([self.called] if self.called else changes)])


@dataclass(frozen=True, slots=True)
class FingersTable:
    """One entry of ``fingers`` in a study file."""

    base: str = "quick"
    grid: dict[str, Any] | None = None
    rows: list[dict[str, Any]] | None = None
    ranges: dict[str, Any] | None = None
    design: str | None = None
    samples: int | None = None
    seed: int | None = None
    sites: str | None = None


def fingers_of(
    entries: Sequence[FingersTable], folder: Path, points_per_finger: int
) -> tuple[Variant, ...]:
    """All fingers of `entries`; their number is checked before the first is made.

    File names are relative to `folder`; each finger has `points_per_finger` points.
    """
    plans = []
    for number, entry in enumerate(entries, start=1):
        with located_errors(f"fingers {number}"):
            base = _read_base(entry, folder)
            plans.append((entry, base, *_entry_rows(entry, base)))
    check_points(points_per_finger * sum(len(rows) for _, _, rows, _ in plans))
    variants: list[Variant] = []
    for number, plan in enumerate(plans, start=1):
        with located_errors(f"fingers {number}"):
            variants += _variants(*plan)
    return tuple(variants)


def combinations(tables: Mapping[str, Mapping[str, object]]) -> list[dict[str, Value]]:
    """Each combination of the lists in each of `tables`; the last list varies fastest.

    A key of `tables` is the section of the study that has the table, as ``probes 1``.
    """
    grids = []
    for section, table in tables.items():
        with located_errors(section):
            grids.append({name: _values(name, value) for name, value in table.items()})
    check_points(sum(math.prod(map(len, grid.values())) for grid in grids))
    return [
        dict(zip(grid, row, strict=True))
        for grid in grids
        for row in itertools.product(*grid.values())
    ]


def numbered(section: str, tables: Sequence[Table]) -> dict[str, Table]:
    """`tables` of a list by their place in the study, as ``probes 1``."""
    return {f"{section} {number}": table for number, table in enumerate(tables, start=1)}


def check_points(count: int) -> None:
    """Raise UsageError for more than `MAX_POINTS` points."""
    if count > MAX_POINTS:
        raise UsageError(
            f"{count} points (stimuli x fingers x probes x contacts x depths x "
            f"methods), expected at most {MAX_POINTS}",
            found=count,
            expected=f"at most {MAX_POINTS}",
        )


def check_below(key: str, name: str) -> None:
    """Raise UsageError for a file, of a `key`, that is not below the study's folder."""
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts or "\0" in name or not name:
        expected = "a built-in name or a file below the folder of the study"
        raise UsageError(key=key, found=name, expected=expected)


@contextmanager
def located_errors(location: str) -> Iterator[None]:
    """Errors raised in the block are about keys below `location`, a section of the study."""
    try:
        yield
    except FembridgeError as error:
        raise UsageError.from_error(error, section=location) from error


def _entry_rows(entry: FingersTable, base: Variant) -> tuple[Sequence[Table], Sequence[str]]:
    """Changes of each finger of an entry, and for a design their names."""
    keys = [key for key in ("grid", "rows", "ranges") if getattr(entry, key) is not None]
    if len(keys) > 1:
        raise UsageError(f"cannot be combined with {keys[0]}", key=keys[1])
    if entry.sites not in (None, *_SITES):
        raise UsageError(key="sites", found=entry.sites, expected=" or ".join(_SITES))
    if entry.ranges is not None:
        with located_errors("ranges"):
            ranges = _flattened(entry.ranges)
        return _design_rows(entry, ranges, base)
    for key in ("design", "samples", "seed"):
        if getattr(entry, key) is not None:
            raise UsageError("is for ranges only", key=key)
    tables = {"grid": entry.grid or {}} if entry.rows is None else numbered("rows", entry.rows)
    if not tables:
        raise UsageError(key="rows", found=[], expected="one or more")
    flat_tables = {}
    for section, table in tables.items():
        with located_errors(section):
            flat_tables[section] = _flattened(table)
    return combinations(flat_tables), ()


def _design_rows(
    entry: FingersTable, spans: Table, finger: Variant
) -> tuple[Sequence[Table], Sequence[str]]:
    """Changes of each finger of a design, and their names."""
    one_by_one = entry.design == ONE_AT_A_TIME and entry.samples is entry.seed is None
    if not one_by_one and entry.design != LATIN_HYPERCUBE:
        raise UsageError(
            key="design",
            found=entry.design or "",
            expected=f"{ONE_AT_A_TIME} without samples and seed or {LATIN_HYPERCUBE}",
        )
    samples, seed = entry.samples or 0, entry.seed or 0
    for key, count, lowest in (("samples", samples, 2), ("seed", seed, 0)):
        if not one_by_one and not lowest <= count <= MAX_POINTS:
            raise UsageError(key=key, found=count, expected=f"{lowest} to {MAX_POINTS}")
    if not spans:
        raise UsageError(key="ranges", found={}, expected="one or more")
    base, ranges = {}, {}
    for name, span in spans.items():
        with located_errors("ranges"):
            value = finger.value(name)
            if name.startswith(CONTACT_PREFIX):
                value = getattr(LADDER[0], name.removeprefix(CONTACT_PREFIX), None)
            number = float(value) if isinstance(value, int | float) else None
            ranges[name] = range_of(name, span, number)
            if number is not None:
                base[name] = number
            elif one_by_one:
                raise UsageError("is no number of the base", key=name)
    if not one_by_one:
        rows = latin_hypercube(ranges, samples, seed)
        return rows, [f"sample {k} of {samples}" for k in range(1, samples + 1)]
    rows = one_at_a_time(base, ranges)
    changes = [
        [f"{name}={value:g}" for name, value in row.items() if value != base[name]] for row in rows
    ]
    return rows, [change[0] if change else "base" for change in changes]


def _read_base(entry: FingersTable, folder: Path) -> Variant:
    """Base finger of an entry, a preset or a file."""
    if entry.base in PRESETS:
        return Variant(entry.base, PRESETS[entry.base])
    check_below("base", entry.base)
    path = folder / entry.base
    try:
        return Variant(path.stem, read_finger(str(path)))
    except UsageError as error:
        raise UsageError(key="base", found=entry.base, expected=error.expected) from error


def _variants(
    entry: FingersTable,
    base: Variant,
    rows: Sequence[Mapping[str, Value]],
    labels: Sequence[str],
) -> list[Variant]:
    """One finger for each of `rows`, which are changes to `base`.

    Afferents that follow keep their distance to the nearest boundary of their layer; others
    stay at their depth, unless it is changed.
    """
    finger = base.finger
    follows = entry.sites == "follow" or (entry.ranges is not None and entry.sites is None)
    anchored_names = {
        match[1] for row in rows for match in map(_TO_BOUNDARY.fullmatch, row) if match
    }
    if follows:
        anchored_names |= {
            label for label, site in finger.afferents.items() if site.layer in _SKIN_LAYERS
        }
    anchors = {label: anchor_of(finger, label) for label in sorted(anchored_names)}
    variants = []
    for row, label in zip(rows, labels or [""] * len(rows), strict=True):
        try:
            varied = finger_with(finger, _nested(row))
            varied = anchored(varied, _anchors_of_row(anchors, row, follows))
        except FingerError as error:
            changes = label or ", ".join(f"{key} = {value!r}" for key, value in row.items())
            failure = FingerError.from_error(error, section="")
            failure.problem += f" ({changes})" if changes else ""
            failure.problem += "; choose narrower ranges" if label else ""
            raise failure from error
        variants.append(Variant(base.label, varied, row, label))
    return variants


def _anchors_of_row(
    anchors: Mapping[str, "Anchor"], row: Mapping[str, Value], follows: bool
) -> dict[str, "Anchor"]:
    """Anchors of the afferents of one finger, with the distances set in `row`."""
    selected = {}
    for name, anchor in anchors.items():
        key = f"afferents.{name}.to_boundary_mm"
        positioned = {f"afferents.{name}.{key_name}" for key_name in ("depth_mm", "layer")} & {*row}
        if key not in row:
            if follows and not positioned:
                selected[name] = anchor
            continue
        distance_mm = row[key]
        if positioned:
            raise FingerError(f"cannot be combined with {positioned.pop()}", key=key)
        if not isinstance(distance_mm, float | int) or distance_mm <= 0:
            raise FingerError(key=key, found=distance_mm, expected="a number > 0")
        selected[name] = replace(anchor, distance_mm=float(distance_mm))
    return selected


def _nested(row: Mapping[str, Value]) -> Table:
    """Sections of a finger file with the values of `row`, which has dotted names."""
    table: Table = {}
    for name, value in row.items():
        if not (name.startswith(CONTACT_PREFIX) or _TO_BOUNDARY.fullmatch(name)):
            *sections, key = name.split(".")
            section_table = table
            for section in sections:
                section_table = section_table.setdefault(section, {})
            section_table[key] = value
    return table


def _flattened(table: Mapping[str, object], prefix: str = "") -> Table:
    """Values by dotted names from nested sections; dotted keys are kept."""
    flat: Table = {}
    for key, value in table.items():
        name = f"{prefix}{key}"
        if value == {}:
            raise UsageError("is an empty section, expected a key", key=name)
        inner = _flattened(value, f"{name}.") if isinstance(value, Mapping) else {name: value}
        for dotted, leaf in inner.items():
            if "." not in dotted:
                raise UsageError("lacks a section, as skin.epidermis_mm has", key=dotted)
            for other in flat:  # equal, or one is a section of the other
                if f"{dotted}.".startswith(f"{other}.") or f"{other}.".startswith(f"{dotted}."):
                    raise UsageError(f"is a duplicate of {other}", key=dotted)
            flat[dotted] = leaf
    return flat


def _values(name: str, value: object) -> list[Value]:
    """Distinct finite numbers or strings of a list or a single value."""
    values: list[Any] = value if isinstance(value, list) else [value]
    for item in values:
        if type(item) not in (int, float, str) or item in (math.inf, -math.inf) or item != item:
            raise UsageError(key=name, found=item, expected="a finite number or a string")
    if not values or len(set(values)) < len(values):
        raise UsageError(
            key=name, found=values, expected="one or more values, none of them a duplicate"
        )
    return values


@dataclass(frozen=True, slots=True)
class Interval:
    """Values from `low` to `high`, even in the value or in its logarithm."""

    low: float
    high: float
    logarithmic: bool = False

    def at(self, share: float) -> float:
        """Value at `share` of the range, 0 to 1."""
        if self.logarithmic:
            return _rounded(self.low * (self.high / self.low) ** share)
        return _rounded(self.low + share * (self.high - self.low))


def range_of(name: str, span: object, base: float | None) -> Interval:
    """Range of a study's `span` for the parameter `name` with the value `base`."""
    if isinstance(span, list) and all(type(limit) in (int, float) for limit in span):
        if len(span) == 2 and -math.inf < span[0] < span[1] < math.inf:
            return Interval(float(span[0]), float(span[1]))
    elif base is not None and base > 0 and (match := _RELATIVE_RANGE.fullmatch(str(span))):
        share, factor = float(match[1] or 0) / 100, float(match[2] or 0)
        if 0 < share < 1:
            return Interval(_rounded(base * (1 - share)), _rounded(base * (1 + share)))
        if factor > 1:
            return Interval(_rounded(base / factor), _rounded(base * factor), logarithmic=True)
    expected = (
        "[from, to], as [0.9, 1.3]; for a base above 0 also '20 %', below 100 %, or 'factor 2', "
        "above 1"
    )
    problem = f"is {span!r} for a base of {base}, expected {expected}"
    raise UsageError(problem, key=name, found=span, expected=expected)


def one_at_a_time(
    base: Mapping[str, float], ranges: Mapping[str, Interval]
) -> list[dict[str, float]]:
    """The base, then each parameter at its low and high value, the others as in the base.

    A value equal to the base's is left out.
    """
    rows = [dict(base)]
    for name, span in ranges.items():
        rows += [{**base, name: value} for value in (span.low, span.high) if value != base[name]]
    return rows


def latin_hypercube(
    ranges: Mapping[str, Interval], samples: int, seed: int
) -> list[dict[str, float]]:
    """Fingers of a Latin hypercube: one in each of `samples` slices of each range.

    Up to 200 samples, correlation between parameters is minimised (``random-cd`` of SciPy). The
    same seed draws the same fingers with the same version of SciPy.
    """
    from scipy.stats import qmc

    sampler = qmc.LatinHypercube(
        len(ranges),
        optimization="random-cd" if samples <= _MAX_OPTIMISED_SAMPLES else None,
        seed=np.random.default_rng(seed),
    )
    return [
        {name: span.at(share) for (name, span), share in zip(ranges.items(), row, strict=True)}
        for row in sampler.random(samples).tolist()
    ]


def _rounded(value: float) -> float:
    return float(f"{value:.{_SIGNIFICANT_DIGITS}g}")


@dataclass(frozen=True, slots=True)
class Anchor:
    """Distance of an afferent from the upper or lower boundary of its layer.

    Merkel cells sit at the bottom of the epidermis and Meissner corpuscles hang on it,
    however thick the skin above is. So the position of an afferent is better described by its
    distance to a boundary than by its depth: for SA and RA the boundary between epidermis
    and dermis, for PC the one above the subcutaneous tissue. The boundary is taken at the
    afferent's ``x``, with ridges and papillae; `distance_mm` is measured into the layer.
    """

    upper: bool
    distance_mm: float


def anchor_of(finger: Finger, name: str) -> Anchor:
    """Nearest boundary of afferent `name` of `finger`, and its distance."""
    if name not in finger.afferents:
        expected = f"one of {', '.join(finger.afferents)}"
        raise FingerError(
            f"is an unknown afferent, expected {expected}",
            key=f"afferents.{name}",
            found=name,
            expected=expected,
        )
    site = finger.afferents[name]
    top_mm, bottom_mm = _span_mm(section_of(finger), site)
    _check_inside(name, site, top_mm, bottom_mm)
    below_top_mm, above_bottom_mm = site.depth_mm - top_mm, bottom_mm - site.depth_mm
    upper = below_top_mm <= above_bottom_mm
    return Anchor(upper, round(min(below_top_mm, above_bottom_mm), _DECIMALS))


def anchored(finger: Finger, anchors: Mapping[str, Anchor]) -> Finger:
    """`finger` with its afferents moved to their anchors."""
    if not anchors:
        return finger
    section, sites = section_of(finger), dict(finger.afferents)
    for name, anchor in anchors.items():
        top_mm, bottom_mm = _span_mm(section, sites[name])
        depth_mm = top_mm + anchor.distance_mm if anchor.upper else bottom_mm - anchor.distance_mm
        sites[name] = replace(sites[name], depth_mm=round(max(depth_mm, 0.0), _DECIMALS))
        _check_inside(name, sites[name], top_mm, bottom_mm)
    return replace(finger, afferents=sites)


def _check_inside(name: str, site: AfferentSite, top_mm: float, bottom_mm: float) -> None:
    if not top_mm < site.depth_mm < bottom_mm:
        expected = f"inside the {site.layer}, {top_mm:.4g} to {bottom_mm:.4g} mm deep there"
        raise FingerError(
            f"is {site.depth_mm:g} mm, expected {expected}",
            key=f"afferents.{name}.depth_mm",
            found=site.depth_mm,
            expected=expected,
        )


def _span_mm(section: Section, site: AfferentSite) -> tuple[float, float]:
    """Upper and lower depth of the site's layer at the site's ``x``."""
    if site.layer not in _SKIN_LAYERS:
        raise FingerError(f"an afferent in the {site.layer} has no boundary of the skin to follow")
    boundaries = (section.surface, section.corneum, section.epidermis, section.dermis)
    upper = _SKIN_LAYERS.index(site.layer)
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
        raise FingerError(
            argument="x_mm", found=x_mm, expected=f"within {pad_mm[-1, 0]:.3g} mm of the middle"
        )
    return float(np.interp(abs(x_mm), pad_mm[:, 0], -pad_mm[:, 1]))
