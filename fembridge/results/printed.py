"""What CalculiX prints into its ``.dat``, and long tables of all that solvers print.

A ``.dat`` has what ``*NODE PRINT`` and ``*EL PRINT`` asked for, in sections: one
quantity of one set at one time.

 stresses (elem, integ.pnt.,sxx,syy,szz,sxy,sxz,syz) for set EP and time  0.5000000E-03

         1   1  1.082338E-03  1.031436E-03  9.281549E-04 -1.290587E-03 ...

A section does not say how long it is. One that was cut shows itself by a last line
without an end, or by fewer records than the section before it had; sections of contact,
whose records come and go, agree with each other at each time. One blank line is behind a
header, and one behind the records: records behind another blank line have lost their
header. Headers are Fortran
texts that have grown over the years (``forset X``, ``pe)for set X``, ``eneset X``, no
columns at all); values are the last fields of a line, 14 characters each, and touch each
other. Tensors are printed xx yy zz xy xz yz and leave here in the order of the ``.frd``,
xx yy zz xy yz zx.
"""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
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
from fembridge.trace import seconds_to_ms
from fembridge.typing import FloatArray, IntArray, Table

STRESSES = "stresses"
POINTS_AN_ELEMENT = 100  # no element has more; makes one number of element and point
_FRD_ORDER = [0, 1, 2, 3, 5, 4]  # xx yy zz xy yz zx of xx yy zz xy xz yz
_DEFAULTS = ReadOptions()
_LOOK_BYTES = 1 << 14
_LINES_AT_ONCE = 4096  # of records that are not in a table of equal lines
_MOST_STRANGERS = 200_000  # lines of no section
_MOST_NOTES, _SHOWN_CHANGES = 3, 5

_HEADER = re.compile(
    r" (?P<what>[A-Za-z].*?) ?"
    r"(?:for ?set *(?P<set>\S.*?) and|(?<=[a-z(,])set +(?P<near>\S.*?) and"
    r"|for ?(?P<contact>all contact elements) and|for) time +(?P<time>\S+)"
)
_STATISTICS = re.compile(
    r" statistics for (?:surface|slave) set +(?P<set>\S.*?) and time +(?P<time>\S+)"
)
_MODE = re.compile(r" *E I G E N V A L U E +N U M B E R +(\d{1,9})")
_FREQUENCY = re.compile(r" *P A R T I C I P A T I O N .* F O R +F R E Q U E N C Y .*")
# By quantity its columns, "" where they vary by version: what printout.f of CalculiX writes.
_STRESS_COLUMNS = "sxx syy szz sxy sxz syz"
_STRAIN_COLUMNS = "exx eyy ezz exy exz eyz"
_QUANTITIES = {
    "displacements": "vx vy vz", "velocities": "vx vy vz", "forces": "fx fy fz",
    "total force": "fx fy fz", "stresses": _STRESS_COLUMNS, "viscous stresses": "",
    "strains": _STRAIN_COLUMNS, "mechanical strains": _STRAIN_COLUMNS,
    "contact stress": "press tang1 tang2", "relative contact displacement": "normal tang1 tang2",
    "heat flux": "qx qy qz", "global coordinates": "x y z",
} | dict.fromkeys(
    (
        "temperatures", "heat generation", "total heat generation", "static pressures",
        "network pressures", "mass flows", "equivalent plastic strain", "internal energy density",
        "internal state variables", "internal energy", "total internal energy", "kinetic energy",
        "total kinetic energy", "volume", "total volume", "mass", "total mass",
        "total mass moment of inertia", "total mass moment of inertia about the center of gravity",
        "center of gravity", "body heating", "total body heating", "centrifugal force",
        "contact print energy", "total contact spring energy", "total number of contact elements",
        "total surface flux",
    ),
    "",
)  # fmt: skip
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
_VALUE = re.compile(r" +[+-]?\d?\.\d{6}(E[+-]\d{2}|[+-]\d{3})")
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
    rows: _Rows | None = None  # of the wanted section that is being read
    statistics: re.Match[str] | None = None
    mode, over_time, foreign = None, True, ""
    census: dict[float, list[str]] = {}  # sections of each time
    header, blank_lines, lost = "", 0, False  # of the section that is being read, wanted or not
    odd: dict[str, None] = {}
    strangers = 0
    for number, line, ended in text_runs(path):
        if isinstance(line, str) and not ended:
            options.refuse(f"cut inside a line: {line[:40]!r}", path, number)
            break
        if not (line if isinstance(line, str) else line[0].tobytes()).strip():
            blank_lines += 1 if isinstance(line, str) else len(line)
            continue
        if not isinstance(line, str) or _is_record(line):
            if header and blank_lines > 1 and not lost:
                lost = True
                message = f"records behind {header} and a blank line: a header is lost"
                options.refuse(message, path, number, noted=f"{message}; they are left out")
            if rows is not None and not lost:
                blank_lines = 1
                rows.add(number, line)
            elif header:
                blank_lines = 1
            else:
                strangers += isinstance(line, str)
            continue
        text = line.rstrip()
        if rows is not None:
            yield rows.section()
        rows, header, blank_lines, lost = None, "", 0, False
        eigen = _MODE.match(line) if "N U M B E R" in line else None
        if eigen or ("F R E Q U E N C Y" in line and _FREQUENCY.fullmatch(line)):
            mode, over_time = int(eigen[1]) if eigen else None, False
        head = _STATISTICS.fullmatch(text[:_LONGEST_HEADER]) if "statistics" in text else None
        if head is not None:
            statistics = head
            continue
        if not line.startswith("   "):
            statistics = None
        opened = _opened(text) if statistics is None else _part(text.strip(), statistics)
        if opened is None:
            foreign = foreign or f"from line {number}: {text.strip()[:60]}"
            strangers += 1
            if strangers > _MOST_STRANGERS:
                raise ResultError(f"{strangers} lines are of no section", path, number)
            continue
        quantity, set_name, columns, labels, time = opened
        try:
            time_ms = seconds_to_ms(fortran(time))
            if not _TIME.fullmatch(time):
                raise ValueError
        except ValueError as error:
            problem = f"time of a section: {time!r} is no number"
            raise ResultError(problem, path, number) from error
        section = DatSection(
            quantity, set_name, columns, time_ms, labels, over_time=over_time, mode=mode
        )
        header = _named(quantity, set_name)
        if over_time:
            census.setdefault(time_ms, []).append(header)
        if statistics is None and (doubt := _doubt_of_header(quantity, columns)):
            odd.setdefault(doubt)
        if wanted(quantity, set_name):
            rows = _Rows(section, path)
    if rows is not None:
        yield rows.section()
    if foreign:
        options.note(f"tables of another kind are left out, {foreign}")
    for doubt in list(odd)[:_MOST_NOTES]:
        options.note(doubt)
    _note_changes(census, options)


def _doubt_of_header(quantity: str, columns: Sequence[str]) -> str:
    """What is odd about the header of a section; "" for one that CalculiX is known to write."""
    if quantity not in _QUANTITIES:
        return f"{quantity!r} is no known quantity of CalculiX: another version, or a damaged line"
    usual = _QUANTITIES[quantity].split()
    if usual and list(columns) not in (usual, ["v(i)", "i=1..ndof"]):
        return f"{quantity} have the columns {' '.join(columns)}, expected {' '.join(usual)}"
    return ""


def _note_changes(census: Mapping[float, Sequence[str]], options: ReadOptions) -> None:
    """Note the times that have other sections than the time before.

    What is printed changes with the requests of another step, and by damage.
    """
    notes = []
    for (first_ms, before), (time_ms, now) in pairwise(census.items()):
        if sorted(before) != sorted(now):
            absent = Counter(before) - Counter(now)
            words = f"no {next(iter(absent))}" if absent else "more sections"
            notes.append(f"at {time_ms:g} ms there is {words}, unlike at {first_ms:g} ms")
    for note in notes[:_MOST_NOTES]:
        options.note(note)
    if len(notes) > _MOST_NOTES:
        options.note(f"other sections than before at {len(notes) - _MOST_NOTES} more times")


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


class _Rows:
    """The records of `section`, collected line by line or in tables."""

    def __init__(self, section: DatSection, path: Path) -> None:
        self._section, self._path = section, path
        self._count: int | None = None  # of values in a record
        self._labels: list[IntArray] = []
        self._values: list[FloatArray] = []
        self._lines: list[tuple[list[int], list[float]]] = []  # not in arrays yet

    def add(self, number: int, piece: str | Characters) -> None:
        """Take a line, or a table of lines, whose first has this number."""
        section = self._section
        if not isinstance(piece, str):
            regular = _regular(piece, section, self._count) if self._count else None
            if regular is not None:
                self._flush()
                self._labels.append(regular[0])
                self._values.append(regular[1])
                return
            piece = piece.tobytes().decode("latin-1")
        for at, line in enumerate(piece.splitlines()):
            record = _record(line, section, self._count)
            if record is None:
                problem = f"no record of {section.quantity}: {line[:80]!r}"
                raise ResultError(problem, self._path, number + at)
            self._count = len(record[1])
            self._lines.append(record)
            if len(self._lines) >= _LINES_AT_ONCE:
                self._flush()

    def _flush(self) -> None:
        if self._lines:
            labels, values = zip(*self._lines, strict=True)
            shape = len(self._lines), len(self._section.label_names)
            self._labels.append(np.array(labels, dtype=np.int64).reshape(shape))
            self._values.append(np.array(values))
            self._lines.clear()

    def section(self) -> DatSection:
        """The section with its records."""
        self._flush()
        if not self._values:
            return self._section.filled(
                np.empty((0, len(self._section.label_names)), dtype=np.int64), np.empty((0, 1))
            )
        return self._section.filled(np.concatenate(self._labels), np.concatenate(self._values))


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
    while rest:
        field = rest[-_VALUE_WIDTH:]
        if _VALUE.fullmatch(field):
            try:
                values.insert(0, fortran(field))
            except ValueError:  # beyond 1.8e308
                return None
        elif _ODD_VALUE.fullmatch(field):
            values.insert(0, float(field))
        else:
            break
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
# As many records as springs are active: the same ones in all quantities of one time.
_VARYING = ("contact stress", "relative contact displacement", "contact print energy")
_CONTACT_COUNT = "total number of contact elements"
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
    """Rows of all sections, or of those of one quantity."""
    contact = quantity in (*_VARYING, _CONTACT_COUNT)

    def wanted(name: str, _: str) -> bool:
        return quantity in (None, name) or (contact and name in (*_VARYING, _CONTACT_COUNT))

    for section in _whole(dat_sections(path, wanted, options), path, options):
        if quantity in (None, section.quantity):
            yield from _section_rows(section, path, options)


def _whole(
    sections: Iterable[DatSection], path: Path, options: ReadOptions
) -> Iterator[DatSection]:
    """The sections that are like the first of their kind; a cut or damaged one is refused.

    Which springs of a contact are active changes: their sections agree with each other at each
    time, and a change from time to time is noted.
    """
    firsts: dict[tuple[str, str], DatSection] = {}
    lasts: dict[tuple[str, str], DatSection] = {}
    springs: dict[str, list[tuple[float, int]]] = {}  # by quantity: time in ms, active springs
    of_set: dict[tuple[str, tuple[str, ...]], DatSection] = {}  # the last with these labels
    doubts: dict[str, None] = {}
    active: DatSection | None = None
    for section in sections:
        key = section.quantity, section.set_name
        varies = section.quantity in _VARYING
        first = section if varies else firsts.get(key, section)
        message = _damage(section, first, lasts.get(key))
        if (varies or section.quantity == _CONTACT_COUNT) and not message:
            message = _other_springs(section, active)
            active = section if varies else active
        lasts[key] = section
        if message:
            options.refuse(message, path, noted=f"dropped the section: {message}")
            continue
        firsts.setdefault(key, section)
        if varies:
            springs.setdefault(section.quantity, []).append((section.time_ms, len(section.labels)))
        elif section.over_time and section.label_names:
            same = of_set.get((section.set_name, section.label_names), section)
            of_set[section.set_name, section.label_names] = section
            if same.time_ms == section.time_ms and not np.array_equal(same.labels, section.labels):
                counts = f"{len(section.labels)} records, {same.quantity} {len(same.labels)}"
                doubts.setdefault(f"{section} has {counts}, or of others")
        yield section
    for doubt in list(doubts)[:_MOST_NOTES]:
        options.note(doubt)
    for quantity, held in springs.items():
        _note_springs(quantity, held, options)


def _other_springs(section: DatSection, active: DatSection | None) -> str:
    """How contact springs differ from those that were `active` at the same time; or ""."""
    if active is None or active.time_ms != section.time_ms:
        return ""
    if section.quantity == _CONTACT_COUNT:
        count = int(section.values[0, 0]) if section.values.size else 0
        if count == len(active.labels):
            return ""
        return f"{active} has {len(active.labels)} records, {section.quantity} is {count}"
    if active.quantity == section.quantity or active.label_names != section.label_names:
        return ""
    if np.array_equal(active.labels, section.labels):
        return ""
    count = len(section.labels)
    return f"{section} has {count} records, {active.quantity} {len(active.labels)}, or of others"


def _note_springs(quantity: str, counts: Sequence[tuple[float, int]], options: ReadOptions) -> None:
    """Note when the count of active springs changes, which a lost or duplicate row does, too."""
    changes = [
        f"{count} at {time_ms:g} ms"
        for (_, before), (time_ms, count) in pairwise(counts)
        if count != before
    ]
    if changes:
        shown = ", ".join([f"{counts[0][1]} at first", *changes[:_SHOWN_CHANGES]])
        more = len(changes) - _SHOWN_CHANGES
        shown += f" and {more} more changes" * (more > 0)
        options.note(f"records of {quantity}: {shown}; springs open and close, or rows are lost")


def _damage(section: DatSection, first: DatSection, before: DatSection | None) -> str:
    """What is wrong with a section after the `first` of its kind and the one `before`; or ""."""
    if words := section.not_finite():
        return words
    count, usual = len(section.labels), len(first.labels)
    if count != usual:
        return f"{section} is {'cut' if count < usual else 'damaged'}: {count} of {usual} records"
    if section.columns != first.columns:
        return f"{section} has {' '.join(section.columns)}, before it {' '.join(first.columns)}"
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
    return f"{section} is duplicate" if same else ""


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
