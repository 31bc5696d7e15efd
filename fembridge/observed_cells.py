"""Header and cells of a table of observed rates: what is taken, what is told.

Such tables come out of spreadsheets and figure digitisers. Each check here answers a
way in which they go wrong; the error says what stands there and what is expected.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from decks.stimuli import resolve
from fembridge.errors import StimulusError, TableError
from fembridge.table_rows import Row
from fembridge.tables import AFFERENTS, RATE_COLUMNS

MAX_RATE_IPS = 2000.0
"""One impulse each 0.5 ms, the shortest refractory period of Table 2's afferents."""

LEAST_TOP_RATE_IPS = 0.5
"""A class with nothing above this is taken to be in impulses a ms, where it would be
500 ips: more than the paper's stimuli drive out of any afferent."""

_SEPARATORS = {";": "semicolons", "\t": "tabs", "|": "bars"}
_RATE_WORDS = re.compile(r"rate|freq|spike|impulse|ips|hz|sps")
_NO_NUMBER = ("nan", "na", "n/a", "#n/a", "null", "none", "nil", "-", "--", "?")
_NAMES_ELSEWHERE = {
    "SA1": "SA",
    "MERKEL": "SA",
    "RA1": "RA",
    "FA": "RA",
    "FA1": "RA",
    "QA": "RA",
    "MEISSNER": "RA",
    "RA2": "PC",
    "FA2": "PC",
    "PACINI": "PC",
    "PACINIAN": "PC",
}
"""Classes of afferents as other papers name them, without blanks and signs."""


def check_header(header: Sequence[str], path: Path) -> None:
    """Refuse a header that is not the three columns of a table of rates.

    Raises
    ------
    TableError
        Another separator, another name for the rate, one column a class, no header
        at all, a column that is missing, or one too many.
    """
    expected = ",".join(RATE_COLUMNS)
    text = ",".join(header)
    for separator, name in _SEPARATORS.items():
        if len(header) == 1 and separator in text:
            raise TableError(f"{text!r} is parted by {name}, expected commas: {expected}", path, 1)
    extra = [name for name in header if name not in RATE_COLUMNS]
    missing = [name for name in RATE_COLUMNS if name not in header]
    if missing == list(RATE_COLUMNS) and any(map(_is_number, header)):
        raise TableError(f"{text!r} is no header, expected {expected} on the first line", path, 1)
    classes = [name for name in extra if _class_of(name)]
    if len(classes) > 1 and "afferent" in missing:
        raise TableError(
            f"one column a class ({', '.join(classes)}), expected one row a rate: {expected}",
            path,
            1,
        )
    if missing:
        _refuse_missing(missing, extra, text, path)
    if extra:
        named = [name or "without a name" for name in extra]
        raise TableError(
            f"column {', '.join(named)} in {text!r}, expected {expected} and no other", path, 1
        )


def stimulus_of(row: Row) -> str:
    """Give the id of the stimulus of `row` as the catalogue spells it.

    Raises
    ------
    TableError
        An id with a blank, one that names nothing, or one that names several levels.
    """
    id_ = row.text("stimulus")
    if len(id_.split()) > 1:
        close = re.sub(r"[\s_]+", "_", id_)
        example = close if _names_one(close) else "sine_20_250"
        raise row.error(f"stimulus {id_!r} has a blank in it, expected as {example}")
    try:
        entries = resolve(id_)
    except StimulusError as error:
        raise row.error(str(error)) from error
    if len(entries) > 1:
        some = ", ".join(entry.id for entry in entries[:3])
        raise row.error(
            f"stimulus {id_!r} names {len(entries)} stimuli, expected one row a level: "
            f"{some}{', ...' if len(entries) > 3 else ''}"
        )
    return entries[0].id


def afferent_of(row: Row) -> str:
    """Give the class of the afferent of `row`.

    Raises
    ------
    TableError
        Another word; tells which class it is here where other papers use it.
    """
    word = row.cells["afferent"]
    if word in AFFERENTS:
        return word
    problem = f"afferent is {word!r}, expected one of {', '.join(AFFERENTS)}"
    if near := _class_of(word):
        problem = f"{problem}; {word} is {near} here"
    elif _plain(word) == "SA2":
        problem = f"{problem}; there is no model of SA2, SA is SA1"
    raise row.error(problem)


def rate_of(row: Row) -> float:
    """Give the rate of `row` in impulses a second.

    Raises
    ------
    TableError
        Empty, no number, negative, not finite, or faster than an afferent can fire.
    """
    cell = row.cells["rate_ips"]
    if not cell or cell.lower() in _NO_NUMBER:
        found = "empty" if not cell else repr(cell)
        raise row.error(
            f"rate_ips is {found}, expected a number; a rate that was not measured has no row"
        )
    if "%" in cell:
        raise row.error(f"rate_ips is {cell!r}, a share; expected impulses a second")
    if "," in cell:
        raise row.error(f"rate_ips is {cell!r}, expected a number with a decimal point")
    rate_ips = row.number("rate_ips", least=0)
    if rate_ips > MAX_RATE_IPS:
        raise row.error(
            f"rate_ips is {rate_ips:g}, expected impulses a second: an afferent that "
            f"rests 0.5 ms after each has at most {MAX_RATE_IPS:g}"
        )
    return rate_ips


def check_units(afferent: str, placed_ips: Sequence[tuple[float, int]], path: Path) -> None:
    """Refuse rates of one class that by their size are impulses a millisecond.

    Parameters
    ----------
    placed_ips
        Each rate with the line that it stands on.

    Raises
    ------
    TableError
        Some are more than 0, none more than `LEAST_TOP_RATE_IPS`.
    """
    top_ips, line = max(placed_ips)
    if 0 < top_ips <= LEAST_TOP_RATE_IPS:
        raise TableError(
            f"the highest rate of {afferent} is {top_ips:g}, as if in impulses a ms; "
            f"expected impulses a second (if it is right, leave {afferent} out)",
            path,
            line,
        )


def _refuse_missing(
    missing: Sequence[str], extra: Sequence[str], text: str, path: Path
) -> NoReturn:
    """Say which column stands where one is missing, if that can be told."""
    for name in missing:
        near = [other for other in extra if other.lower() == name]
        unit = ""
        if name == "rate_ips":
            near += [other for other in extra if _RATE_WORDS.search(other.lower())]
            unit = ", impulses a second"
        if near:
            raise TableError(f"column {near[0]}, expected {name}{unit}", path, 1)
    raise TableError(
        f"no column {', '.join(missing)} in {text!r}, expected {','.join(RATE_COLUMNS)}", path, 1
    )


def _class_of(word: str) -> str | None:
    plain = _plain(word)
    return plain if plain in AFFERENTS else _NAMES_ELSEWHERE.get(plain)


def _plain(word: str) -> str:
    """Spell a class without blanks and signs, its type as a digit."""
    letters = re.sub(r"[\s_.-]", "", word).upper()
    letters = re.sub(r"^(SA|RA|FA)II$", r"\g<1>2", letters)
    return re.sub(r"^(SA|RA|FA)I$", r"\g<1>1", letters)


def _names_one(id_: str) -> bool:
    try:
        return len(resolve(id_)) == 1
    except StimulusError:
        return False


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
