"""The fingers of a study: one, a grid, rows, or a design of ranges, about a base.

::

    [[fingers]]
    base = "quick"
    design = "latin-hypercube"
    samples = 50
    seed = 1
    [fingers.ranges]
    skin.dermis_mm = [0.9, 1.3]
    materials.dermis.young_mpa = "factor 2"
    contact.friction = "20 %"
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from decks.presets import PRESETS
from fembridge.errors import FembridgeError, UsageError
from fembridge.response.solve import LADDER
from fembridge.sweep.design import (
    DESIGNS,
    LATIN_HYPERCUBE,
    ONE_AT_A_TIME,
    Range,
    latin_hypercube,
    one_at_a_time,
    range_of,
)
from fembridge.sweep.study import MOST_POINTS, check_points
from fembridge.sweep.toml_value import (
    below,
    check_keys,
    list_of,
    table_of,
    value_of,
    values_of,
    word_of,
)
from fembridge.sweep.variant import CONTACT, Value, Variant, grid_rows, grid_size, variants_of
from fembridge.typing import Table

FINGER_KEYS = ("base", "grid", "rows", "design", "ranges", "samples", "seed", "sites")
CONTACT_KEYS = ("formulation", "stiffness_mpa_per_mm", "friction", "stick_share")
SITES = ("fixed", "follow")
"""Whether afferents stay at their depth or with the boundary of their layer."""


@dataclass(frozen=True, slots=True, eq=False)
class _Asked:
    """One entry of ``fingers``: its base, and how many rows it has.

    `rows` are what is different; with a `design` they come of `ranges`.
    """

    where: str
    base: str
    count: int
    rows: Iterable[Mapping[str, Value]] = ()
    design: str = ""
    ranges: Mapping[str, object] | None = None
    seed: int = 0
    follows: bool = False


def fingers_of(entries: Sequence[object], folder: Path, rest: int) -> Iterable[Variant]:
    """Make the fingers; their number is checked before the first is made.

    `rest` is how many points each finger has.

    Raises
    ------
    UsageError
        What cannot be understood or be made: the entry and its row are named.
    """
    asked = [_asked(entry, f"fingers {k}") for k, entry in enumerate(entries, 1)]
    check_points(rest * sum(each.count for each in asked))
    for each in asked:
        try:
            if each.base not in PRESETS:
                below(each.base, "base")
            if each.ranges is not None:
                yield from _designed(each, folder)
            else:
                rows = list(each.rows)
                yield from variants_of(each.base, rows, folder, follows=each.follows)
        except FembridgeError as error:
            raise UsageError(f"{each.where}: {error}") from error


def _asked(entry: object, where: str) -> _Asked:
    if isinstance(entry, str):
        return _Asked(where, entry, 1, [{}])
    table = table_of(entry, where)
    check_keys(table, FINGER_KEYS, where)
    base = word_of(table.get("base", "quick"), f"{where}: base")
    given = [key for key in ("grid", "rows", "ranges") if key in table]
    if len(given) > 1:
        raise UsageError(f"{where}: {' and '.join(given)}, expected one of them")
    designed = "ranges" in table
    sites = word_of(table.get("sites", "follow" if designed else "fixed"), f"{where}: sites")
    if sites not in SITES:
        raise UsageError(f"{where}: sites: {sites!r}, expected {' or '.join(SITES)}")
    follows = sites == "follow"
    if designed:
        return _asked_design(table, where, base, follows)
    if strays := [key for key in ("design", "samples", "seed") if key in table]:
        raise UsageError(f"{where}: {strays[0]}, but no ranges")
    if "rows" in table:
        rows = []
        for k, each in enumerate(list_of(table["rows"], f"{where}: rows"), start=1):
            here = f"{where}: row {k}"
            flat = _flat(table_of(each, here), here)
            rows.append({n: value_of(v, f"{here}: {n}") for n, v in flat.items()})
        if not rows:
            raise UsageError(f"{where}: rows: none, expected one or more")
        return _Asked(where, base, len(rows), rows, follows=follows)
    flat = _flat(table_of(table.get("grid", {}), f"{where}: grid"), f"{where}: grid")
    grid = {n: values_of(v, f"{where}: grid: {n}") for n, v in flat.items()}
    return _Asked(where, base, grid_size(grid), grid_rows(grid), follows=follows)


def _asked_design(table: Mapping[str, object], where: str, base: str, follows: bool) -> _Asked:
    design = word_of(table.get("design", ""), f"{where}: design")
    if design not in DESIGNS:
        raise UsageError(f"{where}: design: {design!r}, expected {' or '.join(DESIGNS)}")
    here = f"{where}: ranges"
    ranges = _flat(table_of(table["ranges"], here), here)
    if not ranges:
        raise UsageError(f"{here}: none, expected one or more")
    if design == ONE_AT_A_TIME:
        if strays := [key for key in ("samples", "seed") if key in table]:
            raise UsageError(f"{where}: {strays[0]} is for a {LATIN_HYPERCUBE}")
        count, seed = 1 + 2 * len(ranges), 0
    else:
        if "samples" not in table:
            raise UsageError(f"{where}: samples: absent, expected how many fingers")
        count = _whole(table["samples"], f"{where}: samples", 2)
        seed = _whole(table.get("seed", 0), f"{where}: seed", 0)
    return _Asked(where, base, count, design=design, ranges=ranges, seed=seed, follows=follows)


def _designed(asked: _Asked, folder: Path) -> list[Variant]:
    """Make the fingers of a design; one that cannot be is named."""
    assert asked.ranges is not None
    [start] = variants_of(asked.base, [{}], folder)
    base = {name: _base_value(start, name) for name in asked.ranges}
    ranges = {
        name: range_of(span, base[name], f"ranges: {name}") for name, span in asked.ranges.items()
    }
    told, rows = zip(*_rows(asked, base, ranges), strict=True)
    try:
        return variants_of(asked.base, rows, folder, follows=asked.follows, told=told)
    except FembridgeError as error:
        raise UsageError(f"choose narrower ranges: {error}") from error


def _rows(
    asked: _Asked, base: Mapping[str, float | None], ranges: Mapping[str, Range]
) -> list[tuple[str, dict[str, float]]]:
    """Give what each finger of a design is called, and what is different."""
    if asked.design == LATIN_HYPERCUBE:
        drawn = latin_hypercube(ranges, asked.count, asked.seed)
        return [(f"sample {k} of {asked.count}", row) for k, row in enumerate(drawn, 1)]
    start = {}
    for name, value in base.items():
        if value is None:
            raise UsageError(f"ranges: {name}: the base has no such number")
        start[name] = value
    told = []
    for row in one_at_a_time(start, ranges):
        moved = [name for name, value in row.items() if value != start[name]]
        told.append((f"{moved[0]}={row[moved[0]]:g}" if moved else "base", row))
    return told


def _base_value(base: Variant, name: str) -> float | None:
    """Give the base's number under a dotted name; a contact's is the ladder's first."""
    if name.startswith(CONTACT):
        key = name.removeprefix(CONTACT)
        check_keys({key: None}, CONTACT_KEYS, "contact")
        found: Value | None = getattr(LADDER[0], key)
    else:
        found = base.value(name)
    return None if found is None or isinstance(found, str) else float(found)


def _whole(value: object, where: str, least: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise UsageError(f"{where}: {value!r}, expected a whole number")
    if not least <= value <= MOST_POINTS:
        raise UsageError(f"{where}: {value}, expected {least} to {MOST_POINTS}")
    return value


def _flat(table: Mapping[str, object], where: str, above: str = "") -> Table:
    """Turn nested sections into dotted names; quoted dotted names stay."""
    flat: Table = {}
    for key, value in table.items():
        name = f"{above}{key}"
        inner = _flat(value, where, f"{name}.") if isinstance(value, Mapping) else {name: value}
        for one, content in inner.items():
            if "." not in one:
                raise UsageError(f"{where}: {one!r}, expected section.key, as skin.epidermis_mm")
            if any(_overlap(one, other) for other in flat):
                raise UsageError(f"{where}: {one} stands there twice")
            flat[one] = content
    return flat


def _overlap(one: str, other: str) -> bool:
    """Whether they are the same, or one is a section that holds the other."""
    return f"{one}.".startswith(f"{other}.") or f"{other}.".startswith(f"{one}.")
