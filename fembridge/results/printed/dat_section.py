"""Sections of a ``.dat`` file: one quantity of one set at one time.

 stresses (elem, integ.pnt.,sxx,syy,szz,sxy,sxz,syz) for set EP and time  0.5000000E-03

         1   1  1.082338E-03  1.031436E-03  9.281549E-04 -1.290587E-03 ...

A section does not say how long it is. Headers are Fortran texts that have grown
over the years (``forset X``, ``pe)for set X``, ``eneset X``, no columns at all);
values are the last fields of a line, 14 characters each, and touch each other.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fembridge.errors import ResultError
from fembridge.results.printed.text_lines import text_lines
from fembridge.results.read_options import ReadOptions
from fembridge.trace import MS_PER_S
from fembridge.typing import FloatArray, IntArray

ALL_CONTACT = "all contact elements"
_HEADER = re.compile(
    r" (?P<what>[A-Za-z].*?) ?"
    r"(?:for ?set *(?P<set>\S.*?) and|(?<=[a-z(,])set +(?P<near>\S.*?) and"
    r"|for (?P<contact>all contact elements) and|for) time +(?P<time>\S+)"
)
_STATISTICS = re.compile(
    r" statistics for (?:surface|slave) set +(?P<set>\S.*?) and time +(?P<time>\S+)"
)
_MODE = re.compile(r" *E I G E N V A L U E +N U M B E R +(\d{1,9})")
_FREQUENCY = re.compile(r" *P A R T I C I P A T I O N .* F O R +F R E Q U E N C Y .*")
_LABELS = {
    "elem": ("element",),
    "element": ("element",),
    "integ.pnt.": ("point",),
    "slave element+face": ("element", "face"),
    "slave node": ("node",),
}
_PARTS_OF_STATISTICS = {
    "total surface force": ("fx", "fy", "fz", "mx", "my", "mz"),
    "center of gravity": ("x", "y", "z", "nx", "ny", "nz"),
    "moment about": ("mx", "my", "mz"),
    "area": ("area", "normal force", "shear force", "torque", "bending moment"),
}
_LONGEST_HEADER = 400
_VALUE_WIDTH = 14
_VALUE = re.compile(r" +[+-]?\d?\.\d+(E[+-]\d{2}|[+-]\d{3})")
_ODD_VALUE = re.compile(r" +[+-]?(nan|inf|infinity)", re.IGNORECASE)
_LABEL = re.compile(r"\d{1,18}")
_TIME = re.compile(r"-?\d*\.\d+(E[+-]\d{2,3}|[+-]\d{3})?")


@dataclass(frozen=True, slots=True, eq=False)
class DatSection:
    """One quantity of one set at one time.

    `label_names` says what `labels` ``(record, 0 to 2)`` are: nothing, a node,
    an element, an element and a point or face. `values` ``(record, column)`` are
    as printed, in units of the deck. `over_time` is False for sections of an
    eigenmode (`mode` is its number) and of a frequency: these have no time, and
    `time_ms` is that frequency times 1000.
    """

    quantity: str
    set_name: str
    columns: tuple[str, ...]
    time_ms: float
    labels: IntArray
    values: FloatArray
    label_names: tuple[str, ...] = ()
    over_time: bool = True
    mode: int | None = None

    def __str__(self) -> str:
        return f"{self.quantity} for {_of(self.set_name)} at {self.time_ms:g} ms"


@dataclass(slots=True)
class _Open:
    """A section that is being read: its header, and the records so far."""

    quantity: str
    set_name: str
    names: tuple[str, ...]
    label_names: tuple[str, ...]
    time_ms: float
    mode: int | None = None
    over_time: bool = True
    wanted: bool = True
    labels: list[list[int]] = field(default_factory=list)
    values: list[list[float]] = field(default_factory=list)

    def close(self) -> DatSection:
        """Give the section as a value."""
        count = len(self.values[0]) if self.values else 0
        labels = np.array(self.labels, dtype=np.int64)
        values = np.array(self.values, dtype=np.float64)
        return DatSection(
            quantity=self.quantity,
            set_name=self.set_name,
            columns=_column_names(self.names, self.quantity, count),
            time_ms=self.time_ms,
            labels=labels.reshape(len(self.values), len(self.label_names)),
            values=values.reshape(len(self.values), count),
            label_names=self.label_names,
            over_time=self.over_time,
            mode=self.mode,
        )


def dat_sections(
    path: Path,
    wanted: Callable[[str, str], bool],
    options: ReadOptions,
    held: dict[str, int] | None = None,
) -> Iterator[DatSection]:
    """Yield the sections for which ``wanted(quantity, set)``, in file order.

    Tables of another kind (eigenvalues, participation factors, knots) are left out
    and told to `options`. `held` counts all sections by quantity and set.

    Raises
    ------
    ResultError
        There is no such file; a wanted record is not one; the file is cut inside
        a line, and `options.partial` is not set.
    """
    now: _Open | None = None
    statistics: re.Match[str] | None = None
    mode, over_time, foreign = None, True, list[tuple[int, str]]()
    for number, line, ended in text_lines(path):
        if not ended:
            words = f"cut inside a line: {line[:40]!r}"
            if not options.partial:
                raise ResultError(words, path, number)
            options.note(words)
            break
        if not line.strip():
            continue
        if not line.lstrip()[0].isalpha() or _ODD_VALUE.match(line[-_VALUE_WIDTH:]):
            if now is not None and now.wanted:
                _record(line, now, path, number)
            continue
        if now is not None and now.wanted:
            yield now.close()
        now = None
        eigen = _MODE.match(line)
        if eigen or _FREQUENCY.fullmatch(line):
            mode, over_time = int(eigen[1]) if eigen else None, False
        head = _STATISTICS.fullmatch(line.rstrip()[:_LONGEST_HEADER])
        if head is not None:
            statistics = head
            continue
        if statistics is not None and line.startswith("   "):
            now = _part(line.strip(), statistics, path, number)
        else:
            statistics = None
            now = _opened(line.rstrip(), path, number)
        if now is None:
            foreign = foreign or [(number, line.strip()[:60])]
            continue
        now.mode, now.over_time = mode, over_time
        now.wanted = wanted(now.quantity, now.set_name)
        if held is not None:
            name = f"{now.quantity} for {_of(now.set_name)}"
            held[name] = held.get(name, 0) + 1
    if now is not None and now.wanted:
        yield now.close()
    for first, text in foreign:
        options.note(f"tables of another kind are left out, from line {first}: {text}")


def _of(set_name: str) -> str:
    return set_name if set_name in (ALL_CONTACT, "") else f"set {set_name}"


def _opened(line: str, path: Path, number: int) -> _Open | None:
    header = _HEADER.fullmatch(line) if len(line) <= _LONGEST_HEADER else None
    if header is None:
        return None
    what = header["what"].partition("(")[0]
    lists = re.findall(r"\(([^()]*)", header["what"])
    names = [name.strip() for part in lists for name in part.split(",")]
    labels = [label for name in names for label in _LABELS.get(name, ())]
    if any(" " in name and name not in _LABELS for name in names):
        names = []  # a remark in brackets, no list of columns
    whole = what.startswith(("total", "center of gravity"))
    if not labels and not whole:
        labels = ["node"]
    return _Open(
        quantity=what.strip(),
        set_name=header["set"] or header["near"] or header["contact"] or "",
        names=tuple(name for name in names if name not in _LABELS),
        label_names=tuple(labels),
        time_ms=_time_ms(header["time"], path, number),
    )


def _part(text: str, head: re.Match[str], path: Path, number: int) -> _Open | None:
    for start, names in _PARTS_OF_STATISTICS.items():
        if text.startswith(start):
            time_ms = _time_ms(head["time"], path, number)
            quantity = f"surface {start.removeprefix('total surface ')}"
            return _Open(quantity, head["set"], names, (), time_ms)
    return None


def _time_ms(text: str, path: Path, number: int) -> float:
    if not _TIME.fullmatch(text):
        raise ResultError(f"time of a section: {text!r} is no number", path, number)
    return _float(text) * MS_PER_S


def _column_names(names: tuple[str, ...], quantity: str, count: int) -> tuple[str, ...]:
    if len(names) == count or (len(names) > count and quantity == "surface area"):
        return names[:count]
    if not names:
        names = ("x", "y", "z") if count == 3 else (quantity,)
    if len(names) == 1:
        return names if count == 1 else tuple(f"{names[0]}{k + 1}" for k in range(count))
    return names if not count else names[:count]


def _record(line: str, now: _Open, path: Path, number: int) -> None:
    values: list[float] = []
    rest = line
    while rest and (_VALUE.fullmatch(rest[-_VALUE_WIDTH:]) or _ODD_VALUE.fullmatch(rest[-14:])):
        values.append(_float(rest[-_VALUE_WIDTH:]))
        rest = rest[:-_VALUE_WIDTH]
    values.reverse()
    words = rest.split()
    labels = [int(word) for word in words if _LABEL.fullmatch(word)]
    if now.quantity.startswith("total number") and not values and len(labels) == 1:
        values, labels, words = [float(labels[0])], [], []
    count = len(now.values[0]) if now.values else len(values)
    fits = len(labels) == len(words) == len(now.label_names)
    if len(now.names) > 1 and now.quantity != "surface area":
        fits &= len(values) == len(now.names)
    if not fits or not values or len(values) != count:
        raise ResultError(f"no record of {now.quantity}: {line[:80]!r}", path, number)
    now.labels.append(labels)
    now.values.append(values)


def _float(field_text: str) -> float:
    return float(re.sub(r"(?<=\d)(?=[+-])", "E", field_text))  # 1.000000-101
