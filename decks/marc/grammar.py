"""The grammar of Marc's input decks: lines, numbers, keywords, options.

A deck is parameters up to ``end``, the model definition up to ``end option``, then load
cases that each end with ``continue``. An option is a keyword, in column 1, and all lines
up to the next keyword. `read_options` cuts a deck into options without losing a byte;
the `*_line` functions write the same numbers. Nothing here was checked with Marc: the
rules come from decks that Mentat 2014 to 2024 wrote and from what third parties state.
What cannot be read is a DeckError with its line; a text that is no number a ValueError.
"""

import math
import re
from bisect import bisect_left
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import cache
from itertools import accumulate
from pathlib import Path
from typing import Any, NamedTuple

from fembridge.errors import DeckError

# ---- Numbers: fixed columns, extended columns, or between commas

_REAL = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+))(?:[eEdD]([+-]?\d+)|([+-]\d+)|[+-])?\Z")
_MENTAT_REAL = re.compile(r"-?\d\.\d{15}[+-]\d\Z")
_INTEGER = re.compile(r"[+-]?\d{1,18}\Z")
_PLAIN_INTEGERS = re.compile(r"[ \d+-]*")
_MAX_REAL_LENGTH = 40  # characters; longer ones are no numbers
_DECIMALS = 15


class Layout(Enum):
    """Columns of an integer; reals and words take twice as many.

    Extended columns hold after the parameter ``extended``. A line with a comma is free
    of columns in either layout.
    """

    FIXED = 5
    EXTENDED = 10

    def __init__(self, columns: int) -> None:
        self.integer = columns
        self.real = 2 * columns

    def columns(self, kind: str) -> int:
        """Columns of a field: ``i`` integer, ``r`` real, ``w`` word."""
        return self.integer if kind == "i" else self.real


def parse_real(text: str) -> float:
    """A real as Fortran reads it: ``5.0-1`` lacks the letter of its exponent.

    Where a field ends behind the sign, the exponent is zero (one deck that was run has
    that).
    """
    if _MENTAT_REAL.match(text):  # most of a deck
        return float(f"{text[:-2]}e{text[-2:]}")
    match = _REAL.match(text) if len(text) <= _MAX_REAL_LENGTH else None
    value = float(f"{match[1]}e{match[2] or match[3] or 0}") if match else math.inf
    if abs(value) == math.inf:
        raise ValueError(text)
    return value


def _parse_integer(text: str) -> int:
    if not _INTEGER.match(text):
        raise ValueError(text)
    return int(text)


_FIELDS: dict[str, tuple[Callable[[str], Any], str, str]] = {
    "i": (_parse_integer, "0", "an integer"),
    "r": (parse_real, "0", "a real"),
    "w": (str, "", "a word"),
    "t": (str, "", "text"),
}
"""By letter of a field: how it is read, what a blank one stands for, and its name."""


def format_real(value: float) -> str:
    """A real in 20 columns as Mentat writes it: ``5.000000000000000-4``.

    15 decimals and an exponent of one digit without a letter; a longer exponent takes
    the place of decimals. Zero has no sign.
    """
    value = value or 0.0
    mantissa, _, exponent = f"{value:.{_DECIMALS}e}".partition("e")
    digits = len(exponent[1:].lstrip("0")) or 1
    if digits > 1:
        mantissa, _, exponent = f"{value:.{_DECIMALS + 1 - digits}e}".partition("e")
    text = f"{mantissa}{exponent[0]}{exponent[1:].lstrip('0') or '0'}"
    return text.rjust(Layout.EXTENDED.real)


def format_free(value: float) -> str:
    """A real to stand between commas, with all its digits."""
    text = repr(value or 0.0).upper()
    return text if "." in text else text.replace("E", ".0E")


def reals_line(
    values: Iterable[float], layout: Layout = Layout.EXTENDED, *, free: bool = False
) -> str:
    """A line of reals; fixed columns hold too few digits, so they become commas."""
    if free or layout is Layout.FIXED:
        return _between_commas(map(format_free, values))
    return "".join(map(format_real, values))


def integers_line(
    values: Iterable[int], layout: Layout = Layout.EXTENDED, *, free: bool = False
) -> str:
    """A line of integers."""
    if free:
        return _between_commas(map(str, values))
    return "".join([f"{value:{layout.integer}d}" for value in values])


def _between_commas(texts: Iterable[str]) -> str:
    first, *others = texts
    return ", ".join([first, *others]) if others else f"{first},"


def cut(text: str, layout: Layout, kinds: str) -> list[str]:
    """Cut a line into one text a letter of `kinds`, and the rest where that is ``t``.

    ``i*`` is all of the line. Fields that the line is too short for are empty texts.
    """
    endless, count = kinds.endswith("*"), len(kinds)
    if "," in text:
        items = [item.strip() for item in text.split(",")]
        if items[-1] == "":
            items.pop()  # a lone item is followed by a comma
        if endless:
            return items
        if kinds.endswith("t"):
            items[count - 1 :] = [",".join(items[count - 1 :])]
        return [*items, *[""] * count][:count]
    if endless:
        text, width = text.rstrip(), layout.columns(kinds[0])
        return [text[start : start + width].strip() for start in range(0, len(text), width)]
    return [text[start:end].strip() for start, end in _spans(layout, kinds)]


@cache
def _spans(layout: Layout, kinds: str) -> list[tuple[int, int | None]]:
    """First and last column of each field."""
    *begins, end = accumulate(map(layout.columns, kinds), initial=0)
    return list(zip(begins, [*begins[1:], None if kinds.endswith("t") else end], strict=True))


# ---- Lines


class Line(NamedTuple):
    """A line: `text` without its end, and the bytes `start` to `stop` with it.

    Bytes stand for characters one to one (Latin-1), so that nothing is lost.
    """

    number: int
    text: str
    start: int = 0
    stop: int = 0
    layout: Layout = Layout.FIXED

    @property
    def comment(self) -> bool:
        """Whether it holds no data."""
        return self.text.lstrip().startswith("$")

    @property
    def blank(self) -> bool:
        """Whether it is empty; such a line can still mean zeros."""
        return not self.text.strip()

    @property
    def lettered(self) -> bool:
        """Whether it starts in column 1 with a letter, as keywords and names do."""
        return self.text[:1].isalpha()

    @property
    def free(self) -> bool:
        """Whether commas divide its fields."""
        return "," in self.text

    @property
    def only_word(self) -> str:
        """The only word on it, such as the name of a set."""
        return self.text.strip().rstrip(",").strip()

    @property
    def location(self) -> str:
        """Number of the line, for an error."""
        return f"line {self.number}"

    def error(self, problem: str) -> DeckError:
        """The error that names this line."""
        return DeckError(f"{self.location}: {problem}")

    def check(self, good: bool, problem: str) -> None:
        """Refuse the deck at this line where it is not `good`."""
        if not good:
            raise self.error(problem)

    def cut(self, kinds: str) -> list[str]:
        """Texts of the fields of the line."""
        return cut(self.text, self.layout, kinds)

    def fields(self, kinds: str) -> list[Any]:
        """Values of the fields of the line, 0 for a blank field.

        `kinds` has a letter per field: ``i`` int, ``r`` float, ``w`` and ``t`` text.
        """
        texts, values = self.cut(kinds), list[Any]()
        if kinds.endswith("*"):
            kinds = kinds[0] * len(texts)
        for text, kind in zip(texts, kinds, strict=True):
            parse, blank, expected = _FIELDS[kind]
            try:
                values.append(parse(text or blank))
            except ValueError:
                message = f"field {len(values) + 1} is {text!r}, expected {expected}"
                raise self.error(message) from None
        return values

    def integers(self) -> list[int]:
        """All its fields as integers."""
        text, width = self.text.rstrip(), self.layout.integer
        if _PLAIN_INTEGERS.fullmatch(text):  # the usual case, and most of a deck
            try:
                return [int(text[at : at + width]) for at in range(0, len(text), width)]
            except ValueError:
                pass  # blank fields, or digits out of their columns
        return self.fields("i*")

    def first_integer(self) -> int:
        """Its first field, 0 for an empty line."""
        return (self.integers() or [0])[0]

    def reals(self) -> list[float]:
        """All its fields as reals."""
        return self.fields("r*")

    def with_integer(self, row: int, value: int) -> str:
        """Its text with `value` in field `row`, from 0, of a line of integers."""
        text, digits, width = self.text, str(value), self.layout.integer
        if self.free:
            items = text.split(",")
            items += [""] * (row + 1 - len(items))
            old = items[row]
            lead = old[: len(old) - len(old.lstrip())]
            items[row] = lead + digits + (old[len(old.rstrip()) :] if old.strip() else "")
            return ",".join(items)
        if len(digits) > width:
            raise self.error(f"{value} does not fit into field {row + 1}, of {width} columns")
        padded = text.ljust((row + 1) * width)
        return padded[: row * width] + digits.rjust(width) + padded[(row + 1) * width :]


# ---- Keywords: what ends the option before

_SIGNIFICANT = 10  # characters of a keyword, in any case

# What a deck starts with; a parameter that is missing here is read all the same.
_OPENING = ("title", "extended", "sizing", "elements", "version", "alloc", "table")

# Options that this grammar knows the inside of: no line of theirs is a mere name but
# where a rule below says so.
_KNOWN_TEXT = """
auto load, auto step, con intera, con table, connectivity, contact, contact table,
continue, control, coordinates, end option, isotropic, mat color, no print, optimize,
parameters, post, post increment, solver, table, time step, title
"""

# Conditions: all in one shape.
_CONDITIONS = """
dist charges, dist current, dist fluxes, dist loads, dist sources, films, fixed acce,
fixed disp, fixed potential, fixed pressure, fixed temperature, fixed velo, foundation,
init stress, initial density, initial disp, initial pc, initial plastic strain,
initial porosity, initial pressure, initial state, initial temp, initial vel,
point charge, point current, point flux, point load, point source, point temp,
press film, thermal loads, weld flux
"""

# What else real decks hold and Marc's users know. An option that is in none of the lists
# is still read: as its own where no name can stand, else as part of the one before.
_OTHERS = """
acoustic, activate, actuator, adapt global, adaptive, anisotropic, approach, arrhenius,
attach edge, attach face, attach node, auto creep, auto increment, auto therm, auto time,
b-h relation, begin sequence, buckle, cad bodies, case combin, cavity, cfast,
change porosity, change state, channel, circuit, cohesive, composite, conn fill,
conn gener, constraint, contact node, contact exclude, convert, coord system,
coupling region, crack data, creep, creep increment, cross-section, cure rate,
cure shrinkage, cweld, cyclic symmetry, cylindrical, damage, damping, deactivate, define,
delamination, design objective, design variables, discrete, disp change, dynamic change,
elem sort, emissivity, end sequence, error estimate, excel, exclude, fail data, flow line,
fluid drag, fluid solid, foam, forcdt, forcem, forming limit, fourier, fxord, gap data,
gasket, gent, geometry, global local, grain size, harmonic, hypoelastic, inertia relief,
insert, j-integral, joule, latent heat, loadcase, lorenzi, magnetostatic, mass, masses,
mixture, modal increment, modal shape, mooney, motion change, nlelast, no element sort,
no node sort, no print spring, no summary, nodal thickness, node circle, node fill,
node generation, node merge, node sort, ogden, orientation, orthotropic, permanent,
phi-coefficients, piezoelectric, pin code, points, pore, powder, pre state, print choice,
print contact, print element, print node, print spring, print vmass,
proportional increment, qvect, radiating cavity, rbe2, rbe3, rebar, recover, release,
relative density, response spectrum, restart, rezone, rotation axis, rrod, servo link,
shape memory, shell transformation, shift function, soil, spectrum, spline, springs,
start number, steady state, strain rate, summary, superelement, suppress, surfaces,
synchronized, temp change, temperature effects, thermal contact, thermal expansion,
thickness, time-temp, transformation, transient, tying, tying change, udump, ufconn,
ufxord, uhtcoef, uhtcon, umotion, usdata, utransform, vcct, velocity, velocity change,
view factor, viscelexp, viscelfoam, viscelmoon, viscelogden, viscelorth, viscelprop, wear,
weld fill, weld path, work hard
"""


def names(text: str) -> tuple[str, ...]:
    """The names in a text, between commas."""
    return tuple(name.strip() for name in text.replace("\n", " ").split(","))


KNOWN_OPTIONS = names(_KNOWN_TEXT)
CONDITIONS = names(_CONDITIONS)


def significant(text: str) -> str:
    """The significant part of a keyword: ten characters, up to the first comma, in lower case."""
    return text.partition(",")[0].expandtabs(8)[:_SIGNIFICANT].rstrip().lower()


_NAMES = {significant(name): name for name in (*KNOWN_OPTIONS, *CONDITIONS, *names(_OTHERS))}


# ---- Options


class FileSection(Enum):
    """The part of a deck that contains an option."""

    PARAMETER = "parameter"
    MODEL = "model definition"
    HISTORY = "history"


@dataclass(frozen=True, slots=True)
class MarcOption:
    """A keyword and what belongs to it, comments too.

    `lines` starts with the keyword's; comments before the first keyword of a deck are an
    option without one. `data` are its lines after that, without comments. `case` is the
    load case, from 1, and 0 before the history.
    """

    keyword: str
    lines: tuple[Line, ...]
    data: tuple[Line, ...]
    section: FileSection
    case: int

    @property
    def head(self) -> Line:
        """The keyword's line."""
        return self.lines[0]

    @property
    def filled(self) -> list[Line]:
        """Its data without the blank lines at their end."""
        rows = list(self.data)
        while rows and rows[-1].blank:
            rows.pop()
        return rows

    @property
    def name(self) -> str:
        """What follows the keyword on its line: the name of a table, a title."""
        text, width = self.head.text, self.head.layout.real
        if self.head.free:
            first, _, rest = text.partition(",")
            return rest.strip().rstrip(",").strip() or first[width:].strip()
        return text[width:].strip() or text[_SIGNIFICANT:].strip()

    @property
    def numbers(self) -> list[int]:
        """Integers on the keyword's line; other fields there are 0."""
        head = self.head
        texts = cut(head.text[0 if head.free else head.layout.real :], head.layout, "i*")
        return [int(text) if _INTEGER.match(text) else 0 for text in texts[head.free :]]


def blocks(rows: Sequence[Line], starts: Sequence[int]) -> list[Sequence[Line]]:
    """`rows` cut at the rows `starts`; what lies before the first is left out."""
    stops = [*starts[1:], len(rows)]
    return [rows[start:stop] for start, stop in zip(starts, stops, strict=False)]


# ---- Lists: ``1 to 15 by 2 and 40``, ``and`` or none, on lines that end in ``c``

Member = int | tuple[int, int]

_SIDE = re.compile(r"\d{1,9}\Z")
_CONTINUED = re.compile(r"(?:^|[\s,\d])c(?:ontinue)?\s*\Z", re.IGNORECASE)
_ITEM = re.compile(
    r"(?P<first>\S+)(?: +(?:to|through) +(?P<last>\S+)(?: +by +(?P<step>\S+))?)?", re.IGNORECASE
)
_MAX_MEMBERS = 20_000_000  # members of a list


def read_list(lines: Iterable[Line], *, paired: bool = False) -> list[Member]:
    """The members of a list: numbers, or pairs ``element:side`` if `paired`, none twice."""
    owners, texts = list(lines), list[str]()
    for line in owners:
        parts = line.text.replace(",", " ").split()
        if parts and _CONTINUED.search(line.text):
            parts.pop()
        texts.append("".join(f"{part} " for part in parts if part.lower() != "and"))
    ends = list(accumulate(map(len, texts)))
    members_seen: dict[Member, None] = {}
    for item in _ITEM.finditer("".join(texts)):
        line = owners[bisect_left(ends, item.end())]
        members = _span(line, item, paired)
        line.check(
            len(members_seen) + len(members) <= _MAX_MEMBERS,
            f"a list of more than {_MAX_MEMBERS} members",
        )
        members_seen.update(dict.fromkeys(members))
    return list(members_seen)


def _span(line: Line, item: re.Match[str], paired: bool) -> Sequence[Member]:
    """``a``, ``a to b`` or ``a to b by n``."""
    first, side = _member(line, item["first"], paired)
    if not item["last"]:
        return [(first, side) if paired else first]
    last, last_side = _member(line, item["last"], paired)
    step = abs(_member(line, item["step"] or "1", False)[0]) or 1
    line.check(side == last_side, "a list goes from one side of an element to another")
    line.check(
        abs(last - first) // step <= _MAX_MEMBERS, f"a list of more than {_MAX_MEMBERS} members"
    )
    forward = 1 if last >= first else -1
    span = range(first, last + forward, forward * step)
    return [(number, side) for number in span] if paired else span


def _member(line: Line, item: str, paired: bool) -> tuple[int, int]:
    number, _, side = item.partition(":") if paired else (item, "", "0")
    if _INTEGER.match(number) and _SIDE.match(side):
        return int(number), int(side)
    side, expected = (":0", "element:side") if paired else ("", "a number")
    raise line.error(
        f"{item!r} in a list, expected {expected}, as in `7{side}` or `1{side} to 9{side}`; a line "
        "that goes on ends in `c`"
    )


# ---- Names: lines that start with a letter as keywords do

# Mentat writes names of sets, geometries and conditions from column 1. Most are no
# keyword; of one that is (a condition called ``control``), its place decides.

_NODAL = re.compile(r"nodal\b", re.IGNORECASE)
_FORMULA = "3"
_BEFORE_SET = 4  # lines of a condition before its set, at least


def condition_name(line: Line) -> str:
    """The name behind the six numbers that start a condition, or nothing."""
    name = line.cut("iiiiiit")[6]
    return name if name[:1].isalpha() else ""


def _in_condition(data: Sequence[Line], _line: Line) -> bool:
    """A set's name: it follows the kind of list of a named condition."""
    if not data or not _INTEGER.match(data[-1].only_word):
        return False
    for row, before in enumerate(reversed(data[:-1]), start=2):
        if before.lettered:
            return False
        if condition_name(before):
            return row >= _BEFORE_SET
    return False


def _in_table(data: Sequence[Line], _line: Line) -> bool:
    """A formula: the value of a table can be one."""
    if len(data) < 2 or any(line.lettered for line in data):
        return False
    return data[0].cut("iiiii")[4] == _FORMULA


def _in_post(_data: Sequence[Line], line: Line) -> bool:
    """``nodal``, before the code of a nodal quantity."""
    return _NODAL.match(line.text) is not None and significant(line.text) not in _NAMES


_RULES: dict[str, Callable[[Sequence[Line], Line], bool]] = {
    **dict.fromkeys(CONDITIONS, _in_condition),
    "post": _in_post,
    "table": _in_table,
}


# ---- The deck cut into options

_INCLUDE = re.compile(r"include(?:\s*,\s*|\s+)\S", re.IGNORECASE)
_CASE_STARTS = re.compile(r"\$\.*start of loadcase\b", re.IGNORECASE)  # Mentat's comment
_HEAD_BYTES = 4096  # bytes in which a deck's first keyword stands
_END, _END_OPTION, _CONTINUE = "end", "end option", "continue"


def read_options(data: bytes) -> list[MarcOption]:
    """The options of a deck, every line in one of them."""
    if b"\0" in data:
        raise _not_marc_error("zero bytes, expected text")
    reader = _Reader()
    reader.read(data)
    options = reader.options
    keywords = {option.keyword for option in options}
    if _END not in keywords or not keywords.intersection(_OPENING):
        raise _not_marc_error("no parameters such as `sizing` that end with `end`")
    if (missing := _missing_keyword(options)) is not None:
        last = options[-1]
        raise last.lines[-1].error(
            f"the deck ends in `{last.keyword}`, which starts on {last.head.location}; "
            f"expected `{missing}` before the end: the file is cut short"
        )
    return options


def is_marc_deck(path: Path) -> bool:
    """Whether a ``.dat``, which CalculiX's prints are too, opens as a Marc deck does.

    Its first line that is no comment says so; False where it cannot be read.
    """
    if path.suffix.lower() != ".dat":
        return False
    try:
        with path.open("rb") as file:
            lines = file.read(_HEAD_BYTES).decode("latin-1").split("\n")
    except OSError:
        return False
    data_lines = (line for line in lines if line.strip() and not line.lstrip().startswith("$"))
    return significant(next(data_lines, "").removesuffix("\r")) in _OPENING


@dataclass(slots=True)
class _Reader:
    """The options so far, and the one that is being read: `lines` and its `rows` of data."""

    options: list[MarcOption] = field(default_factory=list)
    section: FileSection = FileSection.PARAMETER
    case: int = 0
    layout: Layout = Layout.FIXED
    keyword: str = ""
    lines: list[Line] = field(default_factory=list)
    rows: list[Line] = field(default_factory=list)
    conditions: set[str] = field(default_factory=set)

    def read(self, data: bytes) -> None:
        """Take the lines of a deck."""
        start = 0
        for number, text in enumerate(data.decode("latin-1").split("\n"), start=1):
            stop = min(start + len(text) + 1, len(data))
            if stop > start:
                self._take(Line(number, text.removesuffix("\r"), start, stop, self.layout))
            start = stop
        self.close()

    def close(self) -> None:
        """End the open option."""
        if not self.lines:
            return
        lines, rows = tuple(self.lines), tuple(self.rows)
        self.options.append(MarcOption(self.keyword, lines, rows, self.section, self.case))
        if self.keyword in CONDITIONS:
            self.conditions.update(filter(None, map(condition_name, self.rows)))
        if self.section is FileSection.PARAMETER:
            if self.keyword == _END:
                self.section = FileSection.MODEL
        elif self.keyword == _END_OPTION:
            self.section, self.case = FileSection.HISTORY, 1
        elif self.keyword == _CONTINUE:
            self.case += 1

    def _take(self, line: Line) -> None:
        """Add a line: it opens an option or belongs to the open one."""
        if line.comment:
            self.lines.append(line)
        elif _INCLUDE.match(line.text):
            raise line.error(
                "an included file is not read; replace this line by the lines of that file"
            )
        elif line.lettered and self._opens(line):
            self.close()
            keyword = significant(line.text)
            self.keyword = (
                keyword if self.section is FileSection.PARAMETER else _NAMES.get(keyword, keyword)
            )
            self.lines, self.rows = [line], []
            if self.section is FileSection.PARAMETER and keyword == "extended":
                self.layout = Layout.EXTENDED
        else:
            if not (self.keyword or line.blank or line.lettered):
                raise line.error(
                    f"no Marc deck: starts with {line.text.strip()[:40]!r}, expected a "
                    "parameter such as `title`, from column 1"
                )
            self.lines.append(line)
            self.rows.append(line)

    def _opens(self, line: Line) -> bool:
        """Whether `line`, which starts with a letter, is no name within the open option."""
        if self.section is FileSection.PARAMETER and self.keyword != _END:
            return True
        rows = self.rows
        if rows and _CONTINUED.search(rows[-1].text):
            return False
        if self.keyword == "loadcase" and line.text.strip().rstrip(", ") in self.conditions:
            return not _more_conditions_follow(rows)
        rule = _RULES.get(self.keyword)
        if rule is not None and rule(rows, line):
            return False
        if significant(line.text) in _NAMES:
            return True
        # A name can stand in each option but those known, and those nobody knows.
        return self.keyword in KNOWN_OPTIONS


def _more_conditions_follow(rows: Sequence[Line]) -> bool:
    """Whether a load case has more conditions to come, as its first line counts."""
    count = rows[0].only_word if rows else ""
    return bool(_INTEGER.match(count)) and len(rows) <= int(count)


def _missing_keyword(options: Sequence[MarcOption]) -> str | None:
    """The keyword that is missing at the end of a deck; None if the deck is complete."""
    last = options[-1]
    if last.section is FileSection.PARAMETER:
        return None if last.keyword == _END and _is_root(options) else _END_OPTION
    final = _END_OPTION if last.section is FileSection.MODEL else _CONTINUE
    if last.keyword != final:
        return final
    announced = any(_CASE_STARTS.match(line.text) for line in last.lines)
    return _CONTINUE if announced else None


def _is_root(options: Sequence[MarcOption]) -> bool:
    """Whether this is the first deck of several domains, which holds no mesh."""
    return not any(any(option.numbers) for option in options if option.keyword == "sizing")


def _not_marc_error(problem: str) -> DeckError:
    return DeckError(f"no Marc deck: {problem}")
