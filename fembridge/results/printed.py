"""What CalculiX prints into its ``.dat``, and long tables of all that solvers print.

A ``.dat`` has what ``*NODE PRINT`` and ``*EL PRINT`` asked for, in sections: one
quantity of one set at one time.

 stresses (elem, integ.pnt.,sxx,syy,szz,sxy,sxz,syz) for set EP and time  0.5000000E-03

         1   1  1.082338E-03  1.031436E-03  9.281549E-04 -1.290587E-03 ...

A section does not say how long it is. One that was cut shows itself by a last line
without an end, or by fewer records than the section before it had. Headers are Fortran
texts that have grown over the years (``forset X``, ``pe)for set X``, ``eneset X``, no
columns at all); values are the last fields of a line, 14 characters each, and touch each
other. Tensors are printed xx yy zz xy xz yz and leave here in the order of the ``.frd``,
xx yy zz xy yz zx.
"""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import NoReturn

import numpy as np

from fembridge.errors import ResultError
from fembridge.results.byte_file import (
    ByteFile,
    Characters,
    fixed_floats,
    fixed_integers,
    suffix_of,
    text_runs,
)
from fembridge.results.dat_section import TABLE, DatSection, Wanted, of_set
from fembridge.results.history import History
from fembridge.results.read_options import ReadOptions, in_pa
from fembridge.results.source import Source
from fembridge.results.status import fortran, status_rows
from fembridge.trace import MS_PER_S
from fembridge.typing import FloatArray, IntArray, Table

STRESSES = "stresses"
POINTS_AN_ELEMENT = 100  # no element has more; makes one number of element and point
_FRD_ORDER = [0, 1, 2, 3, 5, 4]  # xx yy zz xy yz zx of xx yy zz xy xz yz
_DEFAULTS = ReadOptions()
_LOOK_BYTES = 1 << 14

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
    "elem": "element",
    "element": "element",
    "integ.pnt.": "point",
    "slave element+face": "element face",
    "slave node": "node",
}
_PARTS_OF_STATISTICS = {
    "total surface force": ("fx", "fy", "fz", "mx", "my", "mz"),
    "center of gravity": ("x", "y", "z", "nx", "ny", "nz"),
    "moment about": ("mx", "my", "mz"),
    "area": ("area", "normal force", "shear force", "torque", "bending moment"),
}
_LONGEST_HEADER = 400
_VALUE_WIDTH = 14
_LONGEST_LABEL = 18
_VALUE = re.compile(r" +[+-]?\d?\.\d+(E[+-]\d{2}|[+-]\d{3})")
_ODD_VALUE = re.compile(r" +[+-]?(nan|inf|infinity)", re.IGNORECASE)
_LABEL = re.compile(r"\d{1,18}")
_TIME = re.compile(r"-?\d*\.\d+(E[+-]\d{2,3}|[+-]\d{3})?")


def is_abaqus(path: Path) -> bool:
    """Whether a ``.dat`` is one of Abaqus."""
    with ByteFile(path) as file:
        start = file.peek(0, _LOOK_BYTES)
    return b"ABAQUS" in start.upper() or TABLE.encode() in start


def dat_sections(
    path: Path,
    wanted: Wanted,
    options: ReadOptions,
) -> Iterator[DatSection]:
    """The sections that are wanted, in file order.

    Tables of another kind (eigenvalues, participation factors, knots) are left out
    and noted in `options`.
    """
    if is_abaqus(path):
        from fembridge.results.abaqus_dat import abaqus_sections

        yield from abaqus_sections(path, wanted, options)
        return
    now: DatSection | None = None  # the wanted section that is being read
    records: list[tuple[int, str | Characters]] = []
    statistics: re.Match[str] | None = None
    mode, over_time, foreign = None, True, ""
    for number, line, ended in text_runs(path):
        if isinstance(line, str) and not ended:
            options.refuse(f"cut inside a line: {line[:40]!r}", path, number)
            break
        if not isinstance(line, str) or _is_record(line):
            if now is not None:
                records.append((number, line))
            continue
        text = line.rstrip()
        if not text:
            continue
        if now is not None:
            yield _filled(now, records, path)
        now, records = None, []
        eigen = _MODE.match(line)
        if eigen or _FREQUENCY.fullmatch(line):
            mode, over_time = int(eigen[1]) if eigen else None, False
        head = _STATISTICS.fullmatch(text[:_LONGEST_HEADER])
        if head is not None:
            statistics = head
            continue
        if not line.startswith("   "):
            statistics = None
        opened = _opened(text) if statistics is None else _part(text.strip(), statistics)
        if opened is None:
            foreign = foreign or f"from line {number}: {text.strip()[:60]}"
            continue
        quantity, of, columns, labels, time = opened
        if not _TIME.fullmatch(time):
            raise ResultError(f"time of a section: {time!r} is no number", path, number)
        found = DatSection(
            quantity, of, columns, fortran(time) * MS_PER_S, labels, over_time=over_time, mode=mode
        )
        if wanted(found.quantity, found.set_name):
            now = found
    if now is not None:
        yield _filled(now, records, path)
    if foreign:
        options.note(f"tables of another kind are left out, {foreign}")


def _is_record(line: str) -> bool:
    """Whether a line begins with a number, or ends in NaN."""
    first = line.lstrip()[:1]
    return bool(first) and (not first.isalpha() or bool(_ODD_VALUE.match(line[-_VALUE_WIDTH:])))


Opened = tuple[str, str, tuple[str, ...], tuple[str, ...], str]
"""Quantity, set, columns, names of the labels and time of a section."""


def _opened(line: str) -> Opened | None:
    """The section of a header; None if the line is none."""
    header = _HEADER.fullmatch(line) if len(line) <= _LONGEST_HEADER else None
    if header is None:
        return None
    what = header["what"].partition("(")[0]
    lists = re.findall(r"\(([^()]*)", header["what"])
    names = [name.strip() for part in lists for name in part.split(",")]
    labels = [label for name in names for label in _LABELS.get(name, "").split()]
    if any(" " in name and name not in _LABELS for name in names):
        names = []  # a remark in brackets, no list of columns
    if not labels and not what.startswith(("total", "center of gravity")):
        labels = ["node"]
    columns = tuple(name for name in names if name not in _LABELS)
    of = header["set"] or header["near"] or header["contact"] or ""
    return what.strip(), of, columns, tuple(labels), header["time"]


def _part(text: str, head: re.Match[str]) -> Opened | None:
    """The section of a line under the header of surface statistics."""
    for start, names in _PARTS_OF_STATISTICS.items():
        if text.startswith(start):
            quantity = f"surface {start.removeprefix('total surface ')}"
            return quantity, head["set"], names, (), head["time"]
    return None


def _filled(
    section: DatSection, pieces: Sequence[tuple[int, str | Characters]], path: Path
) -> DatSection:
    """`section` with the records of `pieces`, each with the number of its first line."""
    names, count = len(section.label_names), None
    labels = [np.empty((0, names), dtype=np.int64)]
    values: list[FloatArray] = []
    for number, piece in pieces:
        regular = None if isinstance(piece, str) or not count else _regular(piece, section, count)
        if regular is None:
            text = piece if isinstance(piece, str) else piece.tobytes().decode("latin-1")
            rows = []
            for at, line in enumerate(text.splitlines()):
                if line.strip():
                    rows.append(_record(line, section, count))
                    if rows[-1] is None:
                        problem = f"no record of {section.quantity}: {line[:80]!r}"
                        raise ResultError(problem, path, number + at)
                    count = len(rows[-1][1])
            found = [row for row in rows if row is not None]
            regular = np.array([row[0] for row in found]), np.array([row[1] for row in found])
        labels.append(regular[0].astype(np.int64).reshape(len(regular[1]), names))
        values.append(regular[1].reshape(-1, count or 1))
    together = np.concatenate(values) if values else np.empty((0, 1))
    return section.filled(np.concatenate(labels), together)


def _regular(
    records: Characters, section: DatSection, count: int
) -> tuple[IntArray, FloatArray] | None:
    """Labels and values of records with `count` numbers of the usual form each; else None."""
    head, names = records.shape[1] - 1 - count * _VALUE_WIDTH, len(section.label_names)
    if head < 0 or section.quantity.startswith("total number"):
        return None
    fields, front = records[:, head:-1].reshape(-1, _VALUE_WIDTH), records[:, :head]
    values, usual = fixed_floats(fields[:, 1:])
    usual &= fields[:, 0] == ord(" ")
    # Labels end where those of the first record do.
    ends = [word.end() for word in _LABEL.finditer(front[0].tobytes().decode("latin-1"))]
    if not usual.all() or len(ends) != names or (front[:, max([0, *ends]) :] != ord(" ")).any():
        return None
    labels = np.empty((len(records), names), dtype=np.int64)
    for column, (begin, end) in enumerate(pairwise([0, *ends])):
        labels[:, column], fine = fixed_integers(front[:, begin:end])
        if end - begin > _LONGEST_LABEL or not fine.all():
            return None
    return labels, values.reshape(-1, count)


def _record(
    line: str, section: DatSection, expected: int | None
) -> tuple[list[int], list[float]] | None:
    """Labels and values of a record with `expected` values; None if it is none."""
    values: list[float] = []
    rest = line
    while rest and (_VALUE.fullmatch(rest[-_VALUE_WIDTH:]) or _ODD_VALUE.fullmatch(rest[-14:])):
        values.insert(0, fortran(rest[-_VALUE_WIDTH:]))
        rest = rest[:-_VALUE_WIDTH]
    words = rest.split()
    labels = [int(word) for word in words if _LABEL.fullmatch(word)]
    if section.quantity.startswith("total number") and not values and len(labels) == 1:
        values, labels, words = [float(labels[0])], [], []
    fits = len(labels) == len(words) == len(section.label_names)
    if len(section.columns) > 1 and section.quantity != "surface area":
        fits &= len(values) == len(section.columns)
    return (labels, values) if fits and values and expected in (None, len(values)) else None


def _named(quantity: str, set_name: str) -> str:
    return f"{quantity} for {of_set(set_name)}"


def read_node_print(
    path: Path, quantity: str, set_name: str, options: ReadOptions = _DEFAULTS
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Nodal values of a set: ``(T,)`` in ms, ``(node,)``, ``(T, node, column)``.

    A ``total force`` is of no node, and has one row.
    """
    times_ms, labels, values = _history(path, quantity, set_name, options)
    if labels.shape[1] > 1:
        raise ResultError(f"{quantity} is not printed by node", path)
    return times_ms, labels.ravel(), values


def read_point_stress(
    path: Path, set_name: str | None = None, options: ReadOptions = _DEFAULTS
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Stress at integration points, which no averaging has touched.

    Returns
    -------
    times_ms, points, tensor_pa
        ``(T,)``; element and point ``(point, 2)``; ``(T, point, 6)`` in Pa,
        order xx yy zz xy yz zx.
    """
    times_ms, points, values = _history(path, STRESSES, set_name, options)
    if values.shape[2] != 6 or points.shape[1] != 2:
        raise ResultError(f"{values.shape[2]} stress components, expected 6", path)
    return times_ms, points, in_pa(values[:, :, _FRD_ORDER], options, path)


def read_point_history(
    path: Path,
    points: Sequence[tuple[int, int]],
    set_name: str | None = None,
    options: ReadOptions = _DEFAULTS,
) -> History:
    """Stress at integration points ``(element, point)``, in that order, as it is printed.

    A point has one number: its `node` is element times 100 plus point.
    """
    times_ms, held, tensor_pa = read_point_stress(path, set_name, options)
    taken = []
    for element, point in points:
        rows = np.flatnonzero((held == (element, point)).all(axis=1))
        if not rows.size:
            of_element = held[held[:, 0] == element, 1]
            words = f"elements are {held[:, 0].min()} to {held[:, 0].max()}"
            if of_element.size:
                words = f"it has {of_element.min()} to {of_element.max()}"
            problem = f"element {element}, point {point} is not printed: {words}"
            raise ResultError(problem, path)
        taken.append(int(rows[0]))
    nodes = (element * POINTS_AN_ELEMENT + point for element, point in points)
    return History.of_stress(nodes, times_ms, tensor_pa[:, taken], path)


def _history(
    path: Path, quantity: str, set_name: str | None, options: ReadOptions
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Times ``(T,)`` in ms, labels, and values ``(T, record, column)`` of one set."""
    held: dict[str, None] = {}
    asked = None if set_name is None else set_name.casefold()

    def wanted(name: str, of: str) -> bool:
        held[_named(name, of)] = None
        return name == quantity and asked in (None, of.casefold())

    sections = list(dat_sections(path, wanted, options))
    if not sections:
        words = quantity if set_name is None else f"{quantity} for set {set_name}"
        raise ResultError(f"no {words} in it, it holds {'; '.join(held) or 'nothing'}", path)
    first = sections[0]
    sets = list(dict.fromkeys(section.set_name for section in sections))
    if len(sets) > 1:
        names = ", ".join(sets)
        raise ResultError(
            f"{quantity} are there for {len(sets)} sets, {names}: name one (--print-set)", path
        )
    if not first.over_time:
        raise ResultError(f"{quantity} of modes or frequencies, no history over time", path)
    if not len(first.values):
        raise ResultError(f"{first}: no records", path)
    sections = list(_whole(sections, path, options))
    if not sections:
        raise ResultError(f"{quantity}: no section with all records of the first", path)
    times_ms = np.array([section.time_ms for section in sections])
    return times_ms, first.labels, np.stack([section.values for section in sections])


DAT_COLUMNS = (
    "time_ms", "mode", "quantity", "set", "node", "element", "point", "face",
    "component", "value", "unit",
)  # fmt: skip
_VARYING = ("contact", "relative contact")  # as many records as springs are active
_PA, _DECK = "Pa", "deck"
_UNITS = {
    "displacements": "mm", "velocities": "mm/s", "global coordinates": "mm",
    "center of gravity": "mm", "relative contact displacement": "mm",
    "forces": "N", "total force": "N",
    "stresses": _PA, "viscous stresses": _PA, "contact stress": _PA,
    "internal energy density": _PA,
    "stresses at nodes": _PA, "von mises stress": _PA, "von mises stress at nodes": _PA,
    "total forces": "N",
    "strains": "1", "mechanical strains": "1", "equivalent plastic strain": "1",
    "internal state variables": "", "total number of contact elements": "1",
    "internal energy": "mJ", "total internal energy": "mJ",
    "kinetic energy": "mJ", "total kinetic energy": "mJ",
    "contact print energy": "mJ", "total contact spring energy": "mJ",
    "volume": "mm3", "total volume": "mm3", "total mass": "t",
}  # fmt: skip
_OF_ANY_DECK = (_PA, "1", "")
Row = Sequence[object]


def print_rows(path: Path, options: ReadOptions, quantity: str | None = None) -> Iterator[Row]:
    """What `path` holds as a long table: its columns, then row by row.

    A ``.dat`` gives one row a number, with its unit beside it. Stress is in Pa, and so
    are energy densities (1 Pa is 1 J/m³). Other units follow from a deck in mm, N and s;
    of a deck in other units (``--stress-unit``) they are called "deck", and the number
    is the deck's. Of status files see `status_rows`. `quantity` takes one of a ``.dat``
    alone.
    """
    if suffix_of(path) == ".dat":
        yield DAT_COLUMNS
        yield from _dat_rows(path, options, quantity)
        return
    yield from status_rows(path, options)


class PrintSource(Source):
    """What a solver prints: a ``.dat`` of CalculiX or Abaqus, or a status file."""

    def describe(self) -> Table:
        """Rows and the last of them, or the sections of a ``.dat``."""
        path = self.path
        described = super().describe()
        remarks: list[str] = []
        if suffix_of(path) != ".dat":
            columns, *rows = status_rows(path, ReadOptions(log=remarks.append))
            last = dict(zip(map(str, columns), rows[-1], strict=True)) if rows else None
            return described | {"rows": len(rows), "last": last, "problem": (*remarks, None)[0]}
        held = Counter[str]()
        options = ReadOptions(partial=True, log=remarks.append)
        list(dat_sections(path, lambda *of: held.update([_named(*of)]), options))
        if self._of_abaqus:
            described["format"] = "abaqus-dat"
        cut = [words for words in remarks if words.startswith("cut")]
        others = [words for words in remarks if words not in cut]
        return described | {"sections": dict(held), "remarks": others, "problem": (*cut, None)[0]}

    def table(self, quantity: str | None = None) -> Iterator[Row]:
        """Its long table, see `print_rows`."""
        return print_rows(self.path, self.options, quantity)

    @property
    def _of_abaqus(self) -> bool:
        return suffix_of(self.path) == ".dat" and is_abaqus(self.path)

    def named_nodes(self) -> Sequence[int]:
        """None; without any there is nothing at nodes but in prints of Abaqus."""
        return () if self._of_abaqus else self._refuse_fields()

    def stress(self, nodes: Sequence[int] | None) -> History:
        """Von Mises stress at `nodes`, which Abaqus prints."""
        if not self._of_abaqus:
            self._refuse_fields()
        from fembridge.results.abaqus_dat import nodal_stress

        return nodal_stress(self.path, nodes, self.options)

    def _refuse_fields(self) -> NoReturn:
        raise ResultError(
            "prints of a solver, no nodal results: fembridge ingest makes a table of "
            "them, and --point traces of a .dat's integration points",
            self.path,
        )


def _dat_rows(path: Path, options: ReadOptions, quantity: str | None) -> Iterator[Row]:
    """Rows of all sections; a time with other sections than the one before is noted.

    Which springs of a contact are active changes; what else is printed does not, but for
    other requests of another step.
    """
    held: dict[float, list[str]] = {}  # of each time, but for the springs
    wanted = dat_sections(path, lambda name, _: quantity in (None, name), options)
    for section in _whole(wanted, path, options):
        if not section.quantity.startswith(_VARYING) and section.over_time:
            named = _named(section.quantity, section.set_name)
            held.setdefault(section.time_ms, []).append(named)
        yield from _section_rows(section, path, options)
    for (first_ms, was), (time_ms, now) in pairwise(held.items()):
        if was != now:
            lost = [named for named in was if named not in now]
            words = f"no {lost[0]}" if lost else "more sections"
            options.note(f"at {time_ms:g} ms there is {words}, unlike at {first_ms:g} ms")
            break


def _whole(
    sections: Iterable[DatSection], path: Path, options: ReadOptions
) -> Iterator[DatSection]:
    """The sections that are like the first of their kind; a cut or damaged one is refused."""
    firsts: dict[tuple[str, str], DatSection] = {}
    lasts: dict[tuple[str, str], DatSection] = {}
    for section in sections:
        key = section.quantity, section.set_name
        varies = section.quantity.startswith(_VARYING)
        first = section if varies else firsts.get(key, section)
        words = _damage(section, first, lasts.get(key))
        lasts[key] = section
        if not words:
            firsts.setdefault(key, section)
            yield section
        else:
            options.refuse(words, path, noted=f"dropped the section: {words}")


def _damage(section: DatSection, first: DatSection, before: DatSection | None) -> str:
    """What is wrong with a section after the `first` of its kind and the one `before`; or ""."""
    if words := section.not_finite():
        return words
    count, usual = len(section.labels), len(first.labels)
    if count != usual:
        return f"{section} is {'cut' if count < usual else 'damaged'}: {count} of {usual} records"
    if not np.array_equal(section.labels, first.labels):
        return f"{section} has not the {section.label_names[0]}s of {first.time_ms:g} ms"
    if section.label_names == ("element", "point") and count:
        # Points of an element are counted from 1.
        element, point = section.labels.T
        begins = np.diff(element, prepend=-1) != 0
        if not (np.diff(point, prepend=0)[~begins] == 1).all() or (point[begins] != 1).any():
            return f"{section} is damaged: points of an element are missing or duplicate"
    if before is None or not (section.over_time and before.over_time):
        return ""
    if section.time_ms < before.time_ms:
        return f"{section} comes after {before.time_ms:g} ms"
    same = section.time_ms == before.time_ms and np.array_equal(section.values, before.values)
    return f"{section} is duplicate" if same and count else ""


def _section_rows(section: DatSection, path: Path, options: ReadOptions) -> Iterator[Row]:
    unit = _UNITS.get(section.quantity, _DECK)
    if unit not in _OF_ANY_DECK and options.stress_unit != "MPa":
        unit = _DECK
    stored = in_pa(section.values, options, path) if unit == _PA else section.values
    time_ms = section.time_ms if section.over_time else ""
    mode = "" if section.mode is None else section.mode
    quantity, of, columns = section.quantity, section.set_name, section.columns
    for labels, values in zip(section.labels.tolist(), stored.tolist(), strict=True):
        held = dict(zip(section.label_names, labels, strict=True))
        front = (time_ms, mode, quantity, of, *(held.get(name, "") for name in DAT_COLUMNS[4:8]))
        for name, value in zip(columns, values, strict=True):
            yield (*front, name, value, unit)
