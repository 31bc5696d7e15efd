"""The ``.dat`` of CalculiX, and long tables of all files that solvers print.

A ``.dat`` has the output of ``*NODE PRINT`` and ``*EL PRINT`` in sections: one quantity of one
set at one time.

 stresses (elem, integ.pnt.,sxx,syy,szz,sxy,sxz,syz) for set EP and time  0.5000000E-03

         1   1  1.082338E-03  1.031436E-03  9.281549E-04 -1.290587E-03 ...

A section has no count of its records. A cut section has a last line without a line end, or
fewer records than the previous section of its kind. The number of contact records varies, but
is the same in all contact sections of one time. A header and its records are each followed by
one blank line; records after another blank line have lost their header. Headers vary between
versions (``forset X``, ``pe)for set X``, ``eneset X``, no columns). Values are the last fields
of a line, 14 characters each, without separators. Tensors are printed as xx yy zz xy xz yz and
returned in the order of the ``.frd``, xx yy zz xy yz zx.
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
from fembridge.results.dat_section import TABLE, DatSection, SectionFilter, set_label
from fembridge.results.history import History
from fembridge.results.read_options import ReadOptions, Remark, in_pa
from fembridge.results.source import Source
from fembridge.results.status import parse_fortran, status_rows
from fembridge.trace import seconds_to_ms
from fembridge.typing import FloatArray, IntArray, Table

STRESSES = "stresses"
POINTS_AN_ELEMENT = 100  # more than any element has; node number = 100 * element + point
_FRD_ORDER = [0, 1, 2, 3, 5, 4]  # xx yy zz xy yz zx of xx yy zz xy xz yz
_DEFAULTS = ReadOptions()
_START_BYTES = 1 << 14
_LINES_AT_ONCE = 4096  # records parsed line by line
_MAX_FOREIGN_LINES = 200_000  # lines of no section
_MAX_NOTES, _SHOWN_CHANGES = 3, 5

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
# Columns by quantity in printout.f of CalculiX; "" if they vary between versions.
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
_LONGEST_SYSTEM = 90  # an orientation has up to 80 characters
_VALUE = re.compile(r" +[+-]?\d?\.\d{6}(E[+-]\d{2}|[+-]\d{3})")
_NOT_FINITE_VALUE = re.compile(r" +[+-]?(nan|inf|infinity)", re.IGNORECASE)
_LABEL = re.compile(r"\d{1,18}")
# After the values: "L" in the axes of *TRANSFORM, or the name of an orientation; no number.
_LOCAL_SYSTEM = re.compile(
    r"(?<=\d) +(?!(?:nan|inf|infinity)\b)(?P<name>[a-z_][^\s,]*) *", re.IGNORECASE
)
_EIGENVALUES = re.compile(r" *E I G E N V A L U E +O U T P U T *")
_TIME = re.compile(r"-?\d*\.\d+(E[+-]\d{2,3}|[+-]\d{3})?")


def is_abaqus(path: Path) -> bool:
    """Whether a ``.dat`` is from Abaqus."""
    with ByteFile(path) as file:
        start = file.peek(0, _START_BYTES)
    return b"ABAQUS" in start.upper() or TABLE.encode() in start


def dat_sections(
    path: Path,
    is_requested: SectionFilter,
    options: ReadOptions,
) -> Iterator[DatSection]:
    """Requested sections in file order.

    Tables of another kind (eigenvalues, participation factors, knots) are left out with a
    remark.
    """
    if is_abaqus(path):
        from fembridge.results.abaqus_dat import abaqus_sections

        yield from abaqus_sections(path, is_requested, options)
        return
    rows: _Rows | None = None  # of the requested section that is read now
    statistics: re.Match[str] | None = None
    mode, is_timed, foreign_example = None, True, ""
    census: dict[float, list[str]] = {}  # sections of each time
    header, blank_lines, header_lost = (
        "",
        0,
        False,
    )  # of the section that is read now, requested or not
    doubts: dict[str, None] = {}
    foreign_lines = 0
    has_modes = False
    for number, line, closed in text_runs(path):
        if isinstance(line, str) and not closed:
            options.refuse(f"cut inside a line: {line[:40]!r}", path, number, is_cut=True)
            break
        if not (line if isinstance(line, str) else line[0].tobytes()).strip():
            blank_lines += 1 if isinstance(line, str) else len(line)
            continue
        if not isinstance(line, str) or _is_record(line):
            if header and blank_lines > 1 and not header_lost:
                header_lost = True
                message = f"records after {header} and a blank line: a header is missing"
                options.refuse(message, path, number, partial_note=f"left out: {message}")
            if rows is not None and not header_lost:
                blank_lines = 1
                rows.add(number, line)
            elif header:
                blank_lines = 1
            else:
                foreign_lines += isinstance(line, str)
            continue
        text = line.rstrip()
        if rows is not None:
            yield rows.section()
        rows, header, blank_lines, header_lost = None, "", 0, False
        has_modes = has_modes or bool("O U T P U T" in line and _EIGENVALUES.fullmatch(line))
        eigen = _MODE.match(line) if "N U M B E R" in line else None
        if eigen or ("F R E Q U E N C Y" in line and _FREQUENCY.fullmatch(line)):
            mode, is_timed = int(eigen[1]) if eigen else None, False
        head = _STATISTICS.fullmatch(text[:_LONGEST_HEADER]) if "statistics" in text else None
        if head is not None:
            statistics = head
            continue
        if not line.startswith("   "):
            statistics = None
        fields = (
            _parse_header(text)
            if statistics is None
            else _parse_statistics(text.strip(), statistics)
        )
        if fields is None:
            foreign_example = foreign_example or f"from line {number}: {text.strip()[:60]}"
            foreign_lines += 1
            if foreign_lines > _MAX_FOREIGN_LINES:
                raise ResultError(f"{foreign_lines} lines belong to no section", path, number)
            continue
        quantity, set_name, columns, labels, time = fields
        try:
            time_ms = seconds_to_ms(parse_fortran(time))
            if not _TIME.fullmatch(time):
                raise ValueError
        except ValueError as error:
            problem = f"time of a section is {time!r}, expected a number"
            raise ResultError(problem, path, number) from error
        section = DatSection(
            quantity,
            set_name,
            columns,
            time_ms,
            labels,
            is_over_time=is_timed,
            mode=mode,
            has_modes=has_modes,
        )
        header = _section_name(quantity, set_name)
        if is_timed and not has_modes:  # tables of a steady state repeat their times
            census.setdefault(time_ms, []).append(header)
        if statistics is None and (doubt := _header_warning(quantity, columns)):
            doubts.setdefault(doubt)
        if is_requested(quantity, set_name):
            rows = _Rows(section, path, doubts)
    if rows is not None:
        yield rows.section()
    if foreign_example:
        options.note(f"left out: tables of another kind, {foreign_example}")
    for doubt in list(doubts)[:_MAX_NOTES]:
        options.note(doubt)
    _note_changes(census, options)


def _header_warning(quantity: str, columns: Sequence[str]) -> str:
    """Warning about the header of a section; "" for a header that CalculiX writes."""
    if quantity not in _QUANTITIES:
        return f"unknown quantity {quantity!r}: another version of CalculiX, or a damaged line"
    expected = _QUANTITIES[quantity].split()
    if expected and list(columns) not in (expected, ["v(i)", "i=1..ndof"]):
        return f"columns of {quantity} are {' '.join(columns)}, expected {' '.join(expected)}"
    return ""


def _note_changes(census: Mapping[float, Sequence[str]], options: ReadOptions) -> None:
    """Note times with other sections than the previous time.

    The cause is either a step with other output requests or damage.
    """
    notes = []
    for (first_ms, previous), (time_ms, current) in pairwise(census.items()):
        if sorted(previous) != sorted(current):
            absent = Counter(previous) - Counter(current)
            change = f"no {next(iter(absent))}" if absent else "more sections"
            notes.append(f"{change} at {time_ms:g} ms, unlike at {first_ms:g} ms")
    for note in notes[:_MAX_NOTES]:
        options.note(note)
    if len(notes) > _MAX_NOTES:
        options.note(f"the sections change at {len(notes) - _MAX_NOTES} more times")


def _is_record(line: str) -> bool:
    """Whether a line begins with a number or ends with NaN."""
    first = line.lstrip()[:1]
    return bool(first) and (
        not first.isalpha() or bool(_NOT_FINITE_VALUE.match(line[-_VALUE_WIDTH:]))
    )


HeaderFields = tuple[str, str, tuple[str, ...], tuple[str, ...], str]
"""Quantity, set, columns, names of the labels and time of a section."""


def _parse_header(line: str) -> HeaderFields | None:
    """Fields of a header; None if the line is not a header."""
    header = _HEADER.fullmatch(line) if len(line) <= _LONGEST_HEADER else None
    if header is None:
        return None
    quantity = header["what"].partition("(")[0]
    lists = re.findall(r"\(([^()]*)", header["what"])
    names = [name.strip() for part in lists for name in part.split(",")]
    labels = [label for name in names for label in _LABELS.get(name, "").split()]
    if any(" " in name and name not in _LABELS for name in names):
        names = []  # the brackets contain a remark, not columns
    if not labels and not quantity.startswith(("total", "center of gravity")):
        labels = ["node"]
    columns = tuple(name for name in names if name not in _LABELS)
    set_name = header["set"] or header["near"] or header["contact"] or ""
    return quantity.strip(), set_name, columns, tuple(labels), header["time"]


def _parse_statistics(text: str, head: re.Match[str]) -> HeaderFields | None:
    """Fields of a line under the header of surface statistics."""
    for start, names in _PARTS_OF_STATISTICS.items():
        if text.startswith(start):
            quantity = f"surface {start.removeprefix('total surface ')}"
            return quantity, head["set"], names, (), head["time"]
    return None


class _Rows:
    """The records of `section`, collected line by line or in tables.

    A remark on records in local axes is put into `doubts`.
    """

    def __init__(self, section: DatSection, path: Path, doubts: dict[str, None]) -> None:
        self._section, self._path, self._doubts = section, path, doubts
        self._count: int | None = None  # of values in a record
        self._labels: list[IntArray] = []
        self._values: list[FloatArray] = []
        self._lines: list[tuple[list[int], list[float]]] = []  # not in arrays yet

    def add(self, number: int, piece: str | Characters) -> None:
        """Add a line, or a table of lines of which the first has this number."""
        section = self._section
        if not isinstance(piece, str):
            regular = _parse_table(piece, section, self._count) if self._count else None
            if regular is not None:
                self._flush()
                self._labels.append(regular[0])
                self._values.append(regular[1])
                return
            piece = piece.tobytes().decode("latin-1")
        for offset, line in enumerate(piece.splitlines()):
            local = _LOCAL_SYSTEM.search(line, max(0, len(line) - _LONGEST_SYSTEM))
            if local is not None and local.end() == len(line):
                line = line[: local.start()]
                self._doubts.setdefault(_local_warning(section, local["name"]))
            record = _parse_record(line, section, self._count)
            if record is None:
                problem = f"{line[:80]!r}, expected a record of {section.quantity}"
                raise ResultError(problem, self._path, number + offset)
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
            return self._section.with_records(
                np.empty((0, len(self._section.label_names)), dtype=np.int64), np.empty((0, 1))
            )
        return self._section.with_records(
            np.concatenate(self._labels), np.concatenate(self._values)
        )


def _local_warning(section: DatSection, system: str) -> str:
    """Remark on records that are printed in local axes."""
    axes = "*TRANSFORM" if system == "L" else "orientations, or of shells and beams"
    return f"{section.quantity} for {set_label(section.set_name)}: in the local axes of {axes}"


def _parse_table(
    records: Characters, section: DatSection, count: int
) -> tuple[IntArray, FloatArray] | None:
    """Labels and values of records with `count` regular numbers each; else None."""
    head, names = records.shape[1] - 1 - count * _VALUE_WIDTH, len(section.label_names)
    if head < 0 or section.quantity.startswith("total number"):
        return None
    fields, prefix = records[:, head:-1].reshape(-1, _VALUE_WIDTH), records[:, :head]
    values, parsed = fixed_floats(fields[:, 1:])
    parsed &= fields[:, 0] == ord(" ")
    # Labels end where those of the first record do.
    ends = [match.end() for match in _LABEL.finditer(prefix[0].tobytes().decode("latin-1"))]
    if not parsed.all() or len(ends) != names or (prefix[:, max([0, *ends]) :] != ord(" ")).any():
        return None
    labels = np.empty((len(records), names), dtype=np.int64)
    for column, (begin, end) in enumerate(pairwise([0, *ends])):
        labels[:, column], is_count = fixed_integers(prefix[:, begin:end])
        if end - begin > _LONGEST_LABEL or not is_count.all():
            return None
    return labels, values.reshape(-1, count)


def _parse_record(
    line: str, section: DatSection, expected: int | None
) -> tuple[list[int], list[float]] | None:
    """Labels and values of a record with `expected` values; None if the line is not a record."""
    values: list[float] = []
    rest = line
    while rest:
        field = rest[-_VALUE_WIDTH:]
        if _VALUE.fullmatch(field):
            try:
                values.insert(0, parse_fortran(field))
            except ValueError:  # beyond 1.8e308
                return None
        elif _NOT_FINITE_VALUE.fullmatch(field):
            values.insert(0, float(field))
        else:
            break
        rest = rest[:-_VALUE_WIDTH]
    label_texts = rest.split()
    labels = [int(text) for text in label_texts if _LABEL.fullmatch(text)]
    if section.quantity.startswith("total number") and not values and len(labels) == 1:
        values, labels, label_texts = [float(labels[0])], [], []
    fits = len(labels) == len(label_texts) == len(section.label_names)
    if len(section.columns) > 1 and section.quantity != "surface area":
        fits &= len(values) == len(section.columns)
    return (labels, values) if fits and values and expected in (None, len(values)) else None


def _section_name(quantity: str, set_name: str) -> str:
    return f"{quantity} for {set_label(set_name)}"


def read_node_print(
    path: Path, quantity: str, set_name: str, options: ReadOptions = _DEFAULTS
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Nodal values of a set: ``(T,)`` in ms, ``(node,)``, ``(T, node, column)``.

    A ``total force`` has no node and one row.
    """
    times_ms, labels, values = _history(path, quantity, set_name, options)
    if labels.shape[1] > 1:
        raise ResultError(f"{quantity} has element labels, expected nodes", path)
    return times_ms, labels.ravel(), values


def read_point_stress(
    path: Path, set_name: str | None = None, options: ReadOptions = _DEFAULTS
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Stress at integration points, without averaging.

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
    """Printed stress at integration points ``(element, point)``, in that order.

    The node number of a point is element times 100 plus point.
    """
    times_ms, stored_points, tensor_pa = read_point_stress(path, set_name, options)
    columns = []
    for element, point in points:
        rows = np.flatnonzero((stored_points == (element, point)).all(axis=1))
        if not rows.size:
            of_element = stored_points[stored_points[:, 0] == element, 1]
            numbers = stored_points[:, 0]
            available = f"elements {numbers.min()} to {numbers.max()}"
            if of_element.size:
                available = f"points {of_element.min()} to {of_element.max()}"
            problem = f"no element {element}, point {point}; the file has {available}"
            raise ResultError(problem, path)
        columns.append(int(rows[0]))
    nodes = (element * POINTS_AN_ELEMENT + point for element, point in points)
    return History.from_stress(nodes, times_ms, tensor_pa[:, columns], path)


def _history(
    path: Path, quantity: str, set_name: str | None, options: ReadOptions
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Times ``(T,)`` in ms, labels, and values ``(T, record, column)`` of one set."""
    available: dict[str, None] = {}
    requested_set = None if set_name is None else set_name.casefold()

    def is_requested(section_quantity: str, section_set: str) -> bool:
        available[_section_name(section_quantity, section_set)] = None
        return section_quantity == quantity and requested_set in (None, section_set.casefold())

    sections = list(dat_sections(path, is_requested, options))
    if not sections:
        requested = quantity if set_name is None else f"{quantity} for set {set_name}"
        raise ResultError(
            f"no {requested}; the file has {'; '.join(available) or 'no sections'}", path
        )
    first = sections[0]
    sets = list(dict.fromkeys(section.set_name for section in sections))
    if len(sets) > 1:
        names = ", ".join(sets)
        raise ResultError(
            f"{quantity} of {len(sets)} sets, {names}; choose one with --print-set", path
        )
    if not first.is_over_time:
        raise ResultError(f"{quantity} of modes or frequencies, expected times", path)
    if not len(first.values):
        raise ResultError(f"{first}: no records", path)
    sections = list(_check_sections(sections, path, options))
    if not sections:
        raise ResultError(f"{quantity}: no complete section", path)
    times_ms = np.array([section.time_ms for section in sections])
    if (np.diff(times_ms) < 0).any():
        raise ResultError(f"{quantity} of several frequencies, each with times of its own", path)
    return times_ms, first.labels, np.stack([section.values for section in sections])


DAT_COLUMNS = (
    "time_ms", "mode", "quantity", "set", "node", "element", "point", "face",
    "component", "value", "unit",
)  # fmt: skip
# A record for each active spring: the same springs in all quantities of one time.
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
    """Content of `path` as a long table: its columns, then row by row.

    A ``.dat`` has a row for each number, with its unit. Stress and energy density are in Pa
    (1 Pa is 1 J/m³). Other units are those of a deck in mm, N and s; for a deck in other units
    (``--stress-unit``) the unit is "deck" and the number is unchanged. `quantity` selects one
    quantity of a ``.dat``. Status files: see `status_rows`.
    """
    if suffix_of(path) == ".dat":
        yield DAT_COLUMNS
        yield from _dat_rows(path, options, quantity)
        return
    yield from status_rows(path, options)


class PrintSource(Source):
    """A file that a solver prints: a ``.dat`` of CalculiX or Abaqus, or a status file."""

    def describe(self) -> Table:
        """Number of rows and the last row, or the sections of a ``.dat``."""
        path = self.path
        described = super().describe()
        remarks: list[Remark] = []
        if suffix_of(path) != ".dat":
            columns, *rows = status_rows(path, ReadOptions(on_remark=remarks.append))
            last = dict(zip(map(str, columns), rows[-1], strict=True)) if rows else None
            return described | {
                "rows": len(rows),
                "last": last,
                "problem": str(remarks[0]) if remarks else None,
            }
        section_counts = Counter[str]()
        options = ReadOptions(partial=True, on_remark=remarks.append)
        list(
            dat_sections(
                path, lambda *section: section_counts.update([_section_name(*section)]), options
            )
        )
        if self._of_abaqus:
            described["format"] = "abaqus-dat"
        cut = [str(remark) for remark in remarks if remark.is_cut]
        others = [str(remark) for remark in remarks if not remark.is_cut]
        return described | {
            "sections": dict(section_counts),
            "remarks": others,
            "problem": (*cut, None)[0],
        }

    def table(self, quantity: str | None = None) -> Iterator[Row]:
        """Long table, see `print_rows`."""
        return print_rows(self.path, self.options, quantity)

    @property
    def _of_abaqus(self) -> bool:
        return suffix_of(self.path) == ".dat" and is_abaqus(self.path)

    def named_nodes(self) -> Sequence[int]:
        """Empty for a ``.dat`` of Abaqus; other prints have no values at nodes."""
        return () if self._of_abaqus else self._refuse_fields()

    def stress(self, nodes: Sequence[int] | None) -> History:
        """Von Mises stress at `nodes` in a ``.dat`` of Abaqus."""
        if not self._of_abaqus:
            self._refuse_fields()
        from fembridge.results.abaqus_dat import nodal_stress

        return nodal_stress(self.path, nodes, self.options)

    def _refuse_fields(self) -> NoReturn:
        raise ResultError(
            "printed results have no values at nodes: fembridge ingest makes a table of them, "
            "--point makes traces at the integration points of a .dat",
            self.path,
        )


def _dat_rows(path: Path, options: ReadOptions, quantity: str | None) -> Iterator[Row]:
    """Rows of all sections, or of one quantity."""
    contact = quantity in (*_VARYING, _CONTACT_COUNT)

    def is_requested(name: str, _: str) -> bool:
        return quantity in (None, name) or (contact and name in (*_VARYING, _CONTACT_COUNT))

    for section in _check_sections(dat_sections(path, is_requested, options), path, options):
        if quantity in (None, section.quantity):
            yield from _section_rows(section, path, options)


def _check_sections(
    sections: Iterable[DatSection], path: Path, options: ReadOptions
) -> Iterator[DatSection]:
    """Sections with the records of the first of their kind; a cut or damaged one is refused.

    Active contact springs change over time: contact sections of one time are compared with each
    other, and changes over time are noted.
    """
    firsts: dict[tuple[str, str], DatSection] = {}
    lasts: dict[tuple[str, str], DatSection] = {}
    springs: dict[str, list[tuple[float, int]]] = {}  # by quantity: time in ms, active springs
    same_labels: dict[tuple[str, tuple[str, ...]], DatSection] = {}  # the last with these labels
    doubts: dict[str, None] = {}
    active: DatSection | None = None
    for section in sections:
        section_key = section.quantity, section.set_name
        varies = section.quantity in _VARYING
        first = section if varies else firsts.get(section_key, section)
        message = _section_problem(section, first, lasts.get(section_key))
        if (varies or section.quantity == _CONTACT_COUNT) and not message:
            message = _spring_mismatch(section, active)
            active = section if varies else active
        lasts[section_key] = section
        if message:
            options.refuse(message, path, partial_note=f"left out: {message}")
            continue
        firsts.setdefault(section_key, section)
        if varies:
            springs.setdefault(section.quantity, []).append((section.time_ms, len(section.labels)))
        elif section.is_over_time and section.label_names:
            first_of_set = same_labels.get((section.set_name, section.label_names), section)
            same_labels[section.set_name, section.label_names] = section
            if first_of_set.time_ms == section.time_ms and not np.array_equal(
                first_of_set.labels, section.labels
            ):
                doubts.setdefault(_label_problem(section, first_of_set))
        yield section
    for doubt in list(doubts)[:_MAX_NOTES]:
        options.note(doubt)
    for quantity, spring_counts in springs.items():
        _note_springs(quantity, spring_counts, options)


def _spring_mismatch(section: DatSection, active: DatSection | None) -> str:
    """Message about contact springs that differ from those `active` at the same time; or ""."""
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
    return _label_problem(section, active)


def _label_problem(section: DatSection, other: DatSection) -> str:
    """Message that two sections of one time and set have different labels."""
    return (
        f"{section} has {len(section.labels)} records, {other.quantity} {len(other.labels)}: "
        "their labels differ"
    )


def _note_springs(quantity: str, counts: Sequence[tuple[float, int]], options: ReadOptions) -> None:
    """Note changes of the number of active springs; a lost or duplicate row has the same effect."""
    changes = [
        f"{count} at {time_ms:g} ms"
        for (_, previous), (time_ms, count) in pairwise(counts)
        if count != previous
    ]
    if changes:
        shown = ", ".join([f"{counts[0][1]} at first", *changes[:_SHOWN_CHANGES]])
        hidden = len(changes) - _SHOWN_CHANGES
        shown += f" and {hidden} more changes" * (hidden > 0)
        options.note(f"records of {quantity}: {shown}; springs open and close, or rows are missing")


def _section_problem(section: DatSection, first: DatSection, previous: DatSection | None) -> str:
    """Problem of a section, compared with the `first` and `previous` of its kind; or ""."""
    if message := section.not_finite_problem():
        return message
    count, expected = len(section.labels), len(first.labels)
    if count != expected:
        state = "cut" if count < expected else "damaged"
        return f"{section} is {state}: {count} of {expected} records"
    if section.columns != first.columns:
        return f"{section} has {' '.join(section.columns)}, before it {' '.join(first.columns)}"
    if not np.array_equal(section.labels, first.labels):
        return f"{section} has other {section.label_names[0]}s than {first.when}"
    if section.label_names == ("element", "point") and count:
        # The points of an element are numbered from 1.
        element, point = section.labels.T
        begins = np.diff(element, prepend=-1) != 0
        if not (np.diff(point, prepend=0)[~begins] == 1).all() or (point[begins] != 1).any():
            return f"{section} is damaged: points of an element are missing or duplicate"
    if previous is None or not (section.is_over_time and previous.is_over_time):
        return ""
    if section.has_modes and section.time_ms == first.time_ms:
        return ""  # a steady state has a table for each frequency
    if section.time_ms < previous.time_ms:
        return f"{section} comes after {previous.time_ms:g} ms"
    is_same = section.time_ms == previous.time_ms and np.array_equal(
        section.values, previous.values
    )
    return f"{section} is duplicate" if is_same else ""


def _section_rows(section: DatSection, path: Path, options: ReadOptions) -> Iterator[Row]:
    unit = _UNITS.get(section.quantity, _DECK)
    if unit not in _OF_ANY_DECK and options.stress_unit != "MPa":
        unit = _DECK
    stored = in_pa(section.values, options, path) if unit == _PA else section.values
    time_ms = section.time_ms if section.is_over_time else ""
    mode = "" if section.mode is None else section.mode
    quantity, set_name, columns = section.quantity, section.set_name, section.columns
    for labels, values in zip(section.labels.tolist(), stored.tolist(), strict=True):
        label_of = dict(zip(section.label_names, labels, strict=True))
        prefix = (
            time_ms,
            mode,
            quantity,
            set_name,
            *(label_of.get(name, "") for name in DAT_COLUMNS[4:8]),
        )
        for name, value in zip(columns, values, strict=True):
            yield (*prefix, name, value, unit)
