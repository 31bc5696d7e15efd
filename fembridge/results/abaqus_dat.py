"""The ``.dat`` of Abaqus: tables at nodes and integration points.

                                INCREMENT     3 SUMMARY
 TIME INCREMENT COMPLETED  5.000E-04,  FRACTION OF STEP COMPLETED  6.000E-03
 STEP TIME COMPLETED       1.500E-03,  TOTAL TIME COMPLETED        1.500E-03

   THE FOLLOWING TABLE IS PRINTED FOR ALL ELEMENTS WITH TYPE C3D4 AVERAGED AT THE NODES

       NODE  FOOT-   S11         S22         S33         S12         S13         S23
             NOTE

           1       -133.7       5568.       1061.       52.65       42.54      -44.53

Tables come from ``*EL PRINT`` and ``*NODE PRINT`` (Abaqus User's Guide, "Output to the data and
results files"); their form is that of public files (github.com/nightly/fedes, ``piston-tet.dat``;
listings in tutorials). A preamble may continue in the next line; a row may have a footnote (OR);
a row of zeros is not printed, nor is a table of zeros, except for a line that says so. Shears are
ordered 12 13 23, as in a ``.dat`` of CalculiX; plane elements have 11 22 33 12. Each quantity of a
table becomes a `DatSection`.

Numbers have four digits, times three or four: 0.2505 s is printed as 0.251. If increment number
times increment size agrees with the printed time, that product is used; this holds for the fixed
increments of fembridge's decks.

Each increment has a summary with its times, and the tables that its step requests: at every
increment, or at every n-th and the last. A missing line is refused or noted.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from fembridge.errors import ResultError, UsageError
from fembridge.host.memory import check_memory
from fembridge.results.byte_file import text_lines
from fembridge.results.dat_section import TABLE, DatSection, SectionFilter
from fembridge.results.fields import numbers_near
from fembridge.results.history import History, history_of_samples
from fembridge.results.read_options import ReadOptions, in_pa
from fembridge.results.status import parse_fortran
from fembridge.results.von_mises import von_mises_pa
from fembridge.trace import MS_PER_S, seconds_to_ms
from fembridge.typing import FloatArray, IntArray

_CHECKED_ROWS, _ROW_BYTES, _VALUE_BYTES = 100_000, 300, 60  # of lists, and arrays of them
_LONGEST_PREAMBLE, _SHOWN_CHARACTERS = 1000, 80  # of a preamble, kept and shown
STRESSES_AT_NODES, MISES_AT_NODES = "stresses at nodes", "von mises stress at nodes"

_COMPLETED = "THE ANALYSIS HAS BEEN COMPLETED"
_NUMBER = r"([-+.\dE]+)"
_INCREMENT = re.compile(r" *INCREMENT +(\d{1,9}) +SUMMARY *")
_SIZE = re.compile(rf" *TIME INCREMENT COMPLETED +{_NUMBER} *,.*")
_TIMES = re.compile(rf" *STEP TIME COMPLETED +{_NUMBER} *, +TOTAL TIME COMPLETED +{_NUMBER} *")
_STEP = re.compile(r" *S T E P +(\d{1,9}) .*")
_TIME_LINE = re.compile(r" *INCREMENT +\S+ +SUMMARY|.*TIME (?:INCREMENT )?COMPLETED")
_SET = re.compile(r"(?:NODE|ELEMENT) SET +(\S+)")
_ROW = re.compile(
    r" +(\d{1,18})((?: +\d{1,18})*?)(?: +[A-Z]{1,3})?"
    r"((?: +[-+]?\d+\.\d*(?:E[-+]\d\d|[-+]\d{3})?)+) *"
)
_TAILS = ("MAXIMUM", "MINIMUM", "TOTAL", "NODE", "ELEMENT", "AT ")  # of a table
_FLOAT = re.compile(r"[-+]?\d+\.\d*(?:E?[-+]\d+)?")
_FOUR_DIGITS = re.compile(r"[-+]?(?:0*\.0*$|0?(?=[\d.]{5}(?:[E+-]|$))\d{0,4}\.\d{0,4}(?:[E+-]|$))")
_LABELS = {("NODE",): ("node",), ("ELEMENT", "PT"): ("element", "point")}
# Quantity in `printed` by the letters of a column.
_FAMILIES = {"S": "stresses", "MISES": "von mises stress", "U": "displacements", "E": "strains",
             "LE": "strains", "RF": "forces", "COOR": "global coordinates"}  # fmt: skip


def nodal_stress(path: Path, nodes: Sequence[int] | None, options: ReadOptions) -> History:
    """Von Mises stress at `nodes`, in that order, averaged over elements by Abaqus.

    A node in several tables has a mean over other elements in each. The table of the elements
    around the node's afferent is used, if ``run.toml`` names the afferent.
    """
    if nodes is None:
        raise UsageError("is missing: choose nodes by number", path, argument="nodes")
    set_of_node = {node: f"AROUND_{set_name}".upper() for node, set_name in options.classes.items()}
    quantities = (MISES_AT_NODES, STRESSES_AT_NODES)
    sections = list(abaqus_sections(path, lambda quantity, _: quantity in quantities, options))
    if not sections:
        message = "no stress averaged at nodes (*EL PRINT, POSITION=AVERAGED AT NODES)"
        raise ResultError(message, path)
    samples: dict[int, dict[str, list[tuple[float, float]]]] = {node: {} for node in nodes}
    printed_quantities = {section.quantity for section in sections}
    for section in sections:
        if section.quantity == STRESSES_AT_NODES and MISES_AT_NODES in printed_quantities:
            continue
        stress = in_pa(section.values, options, path)
        stress = von_mises_pa(stress) if stress.shape[1] > 1 else stress[:, 0]
        for node, stress_pa in zip(section.labels[:, 0].tolist(), stress.tolist(), strict=True):
            if node in samples:
                samples[node].setdefault(section.set_name, []).append((section.time_ms, stress_pa))
    options.note("numbers in a .dat have four digits, too few for the drive of PC: use the .odb")
    samples_by_node = []
    for node in nodes:
        sets = samples[node]
        set_name = (
            set_of_node.get(node, "") if set_of_node.get(node, "") in sets else next(iter(sets), "")
        )
        if not sets:
            available = np.unique(np.concatenate([section.labels[:, 0] for section in sections]))
            message = f"no stress at node {node}; nearest {numbers_near(available, node)}"
            raise ResultError(message, path)
        if set_of_node.get(node) not in sets and len(sets) > 1:
            raise ResultError(
                f"node {node} is in the tables of {' and '.join(sets)}, means over other elements, "
                "and no run.toml names its afferent",
                path,
            )
        samples_by_node.append((node, np.array(sets[set_name])))
    return history_of_samples(samples_by_node, path)


@dataclass(frozen=True, slots=True, eq=False)
class PrintedTable:
    """A table of a ``.dat`` as printed, without rows of zeros.

    `kind` is its preamble, with the element type and the name of the set. `labels` ``(R, 1 or 2)``
    are node, or element and point; `values` ``(R, column)``; `line` is its first line.
    """

    kind: str
    set_name: str
    columns: tuple[str, ...]
    labels: IntArray
    values: FloatArray
    line: int


def printed_tables(path: Path) -> Iterator[PrintedTable]:
    """All tables of a ``.dat`` of Abaqus in its order, one at a time, whatever their times.

    Load cases have no times of their own, so these tables need none.

    Raises
    ------
    ResultError
        A cut table, or a file without the line that ends a complete analysis.
    """
    is_complete = False
    for table, number, closed in _read_tables(path, _Clock()):
        if table is None:
            is_complete = True
        elif not closed or (not table.columns and not table.closed):
            raise ResultError(f"cut in the table from line {table.line}", path, number)
        elif table.labels:
            yield PrintedTable(
                kind=table.preamble,
                set_name=table.set_name,
                columns=table.columns,
                labels=np.array([row[0] for row in table.rows], dtype=np.int64).reshape(
                    len(table.rows), len(table.labels)
                ),
                values=np.array([row[1] for row in table.rows]).reshape(
                    len(table.rows), len(table.columns)
                ),
                line=table.line,
            )
    if not is_complete:
        raise ResultError(f"cut, or the job did not end: {_COMPLETED} is missing", path)


@dataclass(slots=True)
class _Clock:
    """Time of the following tables; `time_s` is None if it is not printed.

    `problems` are contradictions between time lines that are not yet reported. `increments` are
    the increment numbers of each step; `size_count` is the number of ``TIME INCREMENT`` lines.
    """

    step: int = 1
    increment: int = 0
    size_s: float | None = None
    step_start_s: float = 0.0
    time_s: float | None = None
    last_time_s: float = 0.0
    start_s: float | None = None
    awaits_time: bool = False
    size_count: int = 0
    problems: list[str] = field(default_factory=list)
    increments: dict[int, list[int]] = field(default_factory=dict)

    def read_line(self, line: str) -> bool:
        """Read a line about time; return whether `line` is one."""
        if not ("COMPLETED" in line or "SUMMARY" in line or "S T E P" in line):
            return False
        if match := _INCREMENT.fullmatch(line):
            self._begin(int(match[1]))
        elif match := _SIZE.fullmatch(line):
            self.size_s = self._number(match[1])
            self.size_count += 1
        elif match := _TIMES.fullmatch(line):
            self._times(match[1], match[2])
        elif match := _STEP.fullmatch(line):
            if int(match[1]) != self.step:
                self.step, self.step_start_s = int(match[1]), self.last_time_s
                self.increment, self.time_s, self.awaits_time = 0, None, False
        elif _TIME_LINE.match(line):
            self.problems.append(f"unreadable: {line.strip()[:80]!r}")
        else:
            return False
        return True

    def _begin(self, number: int) -> None:
        if self.awaits_time:
            self.problems.append(f"increment {self.increment} has no time")
        if self.increment and number != self.increment + 1:
            self.problems.append(f"increment {number} follows {self.increment}")
        self.increment, self.size_s, self.time_s, self.awaits_time = number, None, None, True
        self.increments.setdefault(self.step, []).append(number)

    def _times(self, step_text: str, total_text: str) -> None:
        step_s, total_s = self._number(step_text), self._number(total_text)
        if not self.awaits_time:
            self.problems.append(f"a time of {step_text} s without a line INCREMENT")
            self.size_s = None
        self.awaits_time = False
        if step_s is None or total_s is None:
            return
        # After a restart the total time includes steps that are not in the file.
        start_s = total_s - step_s - self.step_start_s
        self.start_s = start_s if self.start_s is None else self.start_s
        rounding_s = _last_digit_s(step_text) + 2.0 * _last_digit_s(total_text)
        if abs(start_s - self.start_s) > rounding_s + 2e-3 * abs(self.step_start_s):
            message = f"step time {step_text} s and total time {total_text} s contradict each other"
            self.problems.append(f"increment {self.increment}: {message}")
        if self.size_s is not None:
            exact_s = self.increment * self.size_s
            step_s = exact_s if abs(exact_s - step_s) <= 0.51 * _last_digit_s(step_text) else step_s
        self.time_s = self.last_time_s = self.step_start_s + step_s

    def _number(self, text: str) -> float | None:
        try:
            value = parse_fortran(text)
            seconds_to_ms(value)
        except ValueError:
            self.problems.append(f"{text!r}, expected a time")
            return None
        return value


def _last_digit_s(printed: str) -> float:
    """One unit of the last digit of a printed time."""
    mantissa, _, power = printed.partition("E")
    return 10.0 ** (int(power or 0) - len(mantissa.partition(".")[2]))


@dataclass(slots=True)
class _Table:
    """A table that is being read; `time_ms` is None if no time is printed before it.

    `line` is its first line; `step` and `increment` are those of the clock. `awaits_time` marks
    an increment that has begun and whose time is not yet printed.
    """

    time_ms: float | None
    preamble: str
    line: int
    step: int
    increment: int
    awaits_time: bool
    labels: tuple[str, ...] = ()
    columns: tuple[str, ...] = ()
    rows: list[tuple[list[int], list[float]]] = field(default_factory=list)
    closed: bool = False
    total: list[float] = field(default_factory=list)
    digit_warning: str = ""

    @property
    def set_name(self) -> str:
        """Name of the set in the preamble, or ``ALL``."""
        match = _SET.search(self.preamble)
        return match[1] if match else "ALL"

    def sections(self) -> Iterator[DatSection]:
        """Section of each quantity."""
        assert self.time_ms is not None  # see `abaqus_sections`
        at_nodes = " at nodes" if "AVERAGED AT THE NODES" in self.preamble else ""
        families: dict[str, list[int]] = {}
        for column, name in enumerate(self.columns):
            letters = name.rstrip("0123456789")
            families.setdefault(_FAMILIES.get(letters, letters.lower()), []).append(column)
        labels = np.array([row[0] for row in self.rows], dtype=np.int64)
        values = np.array([row[1] for row in self.rows], dtype=np.float64)
        labels = labels.reshape(len(self.rows), len(self.labels))
        values = values.reshape(len(self.rows), len(self.columns))
        for family, columns in families.items():
            section = DatSection(
                quantity=family + at_nodes,
                set_name=self.set_name,
                columns=tuple(self.columns[column] for column in columns),
                time_ms=self.time_ms,
                label_names=self.labels,
                labels=labels,
                values=_complete_tensor(values[:, columns])
                if family == "stresses"
                else values[:, columns],
            )
            if family == "stresses" and len(columns) == 4:
                section = replace(section, columns=(*section.columns, "S13", "S23"))
            yield section
            if self.total:
                yield replace(
                    section,
                    quantity=f"total {family}",
                    label_names=(),
                    labels=np.empty((1, 0), dtype=np.int64),
                    values=np.array([[self.total[column] for column in columns]]),
                )


def abaqus_sections(
    path: Path,
    is_requested: SectionFilter,
    options: ReadOptions,
) -> Iterator[DatSection]:
    """Requested sections of a ``.dat`` of Abaqus, as `fembridge.results.printed.dat_sections`."""
    sections: list[tuple[str, DatSection]] = []
    tables: dict[str, dict[tuple[int, int], _Table]] = {}  # by kind, then step and increment
    clock, is_complete = _Clock(), False
    digit_warning = ""  # a number with more or fewer digits than Abaqus prints
    for item, number, closed in _read_tables(path, clock):
        for problem in clock.problems:
            options.refuse(f"line {number} or before: {problem}", path)
        clock.problems.clear()
        if item is None:
            is_complete = True
            continue
        table: _Table = item
        if message := _table_problem(table, closed):
            options.refuse(message, path, partial_note=f"left out: {message}", is_cut=not closed)
            continue
        if table.time_ms is None:
            options.note(f"left out: the table from line {table.line} has no time")
            continue
        if not table.labels:
            options.note(f"left out: the table from line {table.line} is of another kind")
            continue
        for section in table.sections():
            if not is_requested(section.quantity, section.set_name):
                continue
            kind = f"{section.quantity} {table.preamble}"
            tables_of_kind = tables.setdefault(kind, {})
            first_table = tables_of_kind.setdefault((table.step, table.increment), table)
            if (
                first_table is not table
                and first_table.columns == table.columns
                and first_table.rows != table.rows
            ):
                message = (
                    f"{section} is in two tables, from lines {first_table.line} and {table.line}"
                )
                options.refuse(message, path)
            sections.append((kind, section))
        digit_warning = digit_warning or table.digit_warning
    for problem in clock.problems:
        options.refuse(problem, path)
    if digit_warning:
        options.note(f"{digit_warning}, expected the four digits that Abaqus prints")
    if not is_complete:
        options.note(f"cut, or the job did not end: {_COMPLETED} is missing", is_cut=True)
    count = sum(map(len, clock.increments.values()))
    if 0 < clock.size_count < count:
        options.note(
            f"{count - clock.size_count} of {count} increments have no line TIME INCREMENT"
        )
    _note_missing_tables(tables, clock.increments, options)
    yield from _add_zero_rows(sections, path, options)


def _table_problem(table: _Table, closed: bool) -> str:
    """Problem of a table as a whole; "" if there is none."""
    if not closed:
        return f"cut in the table from line {table.line}"
    if not table.columns and not table.closed:
        return f"no column names in the table from line {table.line}"
    if table.awaits_time:
        return f"increment {table.increment} has no time before the table from line {table.line}"
    return ""


def _note_missing_tables(
    tables: Mapping[str, Mapping[tuple[int, int], _Table]],
    increments: Mapping[int, Sequence[int]],
    options: ReadOptions,
) -> None:
    """Note increments that lack a table which other increments have.

    Abaqus prints every n-th increment of a step and the last.
    """
    for kind, tables_of_kind in tables.items():
        for step, numbers in increments.items():
            printed = [number for number in numbers if (step, number) in tables_of_kind]
            interval = printed[0] if printed else 1
            expected = {number for number in numbers if number % interval == 0}
            if numbers[0] > 1:  # of a restart
                expected = set(numbers) if interval == numbers[0] else expected
            if not printed:
                options.note(f"step {step} has no table of {kind[:_SHOWN_CHARACTERS]}")
            elif absent := sorted(expected - set(printed)):
                shown = ", ".join(map(str, absent[:5])) + ", ..." * (len(absent) > 5)
                message = (
                    f"no table of {kind[:_SHOWN_CHARACTERS]} in increments {shown} of step {step}"
                )
                options.note(f"{message}, {len(absent)} of {len(numbers)}")
            elif extra := sorted(set(printed) - expected - {numbers[-1]}):
                shown = ", ".join(map(str, extra[:5]))
                options.note(f"additional table in increment {shown} of step {step}")
            elif interval > 1:
                options.note(
                    f"every {interval} increments of step {step} have {kind[:_SHOWN_CHARACTERS]}"
                )


def _read_tables(path: Path, clock: _Clock) -> Iterator[tuple[_Table | None, int, bool]]:
    """Each table, the line after it, and whether it is complete; None at the end of the job."""
    table: _Table | None = None
    for number, line, closed in text_lines(path):
        text = line.strip()
        if _COMPLETED in line or clock.read_line(line) or TABLE in line:
            if table is not None:
                yield table, number, True
            table = None
            if _COMPLETED in line:
                yield None, number, True
            elif TABLE in line:
                time_ms = None if clock.time_s is None else clock.time_s * MS_PER_S
                position = number, clock.step, clock.increment, clock.awaits_time
                table = _Table(time_ms, text, *position)
        elif table is None or not text or text == "NOTE":
            continue
        elif table.columns and text.startswith("TOTAL") and closed:
            table.closed, table.total = True, _parse_values(text.split()[1:], table, path, number)
        elif table.closed:
            row = _ROW.fullmatch(line) if table.columns else None
            if row and len(row[3].split()) == len(table.columns):
                raise ResultError(f"row after the end of its table: {line[:80]!r}", path, number)
        elif not table.columns:
            if text.startswith(("NODE", "ELEMENT")) and "FOOT" in text:
                names, _, columns = text.partition("FOOT-")
                table.labels = _LABELS.get(tuple(names.split()), ())
                table.closed = not table.labels  # of a kind that is not read
                table.columns = tuple(columns.split()) if table.labels else ()
            elif len(table.preamble) < _LONGEST_PREAMBLE:
                table.preamble += f" {text}"
        elif "ALL VALUES IN THIS TABLE ARE ZERO" in text:
            table.closed = True
        elif row := _ROW.fullmatch(line):
            values = _parse_values(row[3].split(), table, path, number, is_row=True)
            labels = [int(row[1]), *map(int, row[2].split())]
            if len(labels) != len(table.labels):
                raise ResultError(f"invalid row: {line[:80]!r}", path, number)
            table.rows.append((labels, values))
            if len(table.rows) % _CHECKED_ROWS == 0:
                needed_bytes = len(table.rows) * (_ROW_BYTES + _VALUE_BYTES * len(values))
                check_memory(needed_bytes, "the table", ResultError.at(path))
        elif text[0].isalpha() and (text.startswith(_TAILS) or not _FLOAT.search(text)):
            table.closed = True
        elif not closed:
            break
        elif text != "1":  # of a page
            raise ResultError(f"invalid row: {line[:80]!r}", path, number)
    if table is not None:
        yield table, table.line, table.closed


def _parse_values(
    texts: Sequence[str], table: _Table, path: Path, number: int, *, is_row: bool = False
) -> list[float]:
    """Values of a row or total, one for each column."""
    try:
        try:
            # Texts of a row were matched: a number with or without an exponent of two digits.
            values = list(map(float, texts if is_row else ()))
        except ValueError:  # an exponent without its letter
            values = []
        values = values or [parse_fortran(text) for text in texts]
        if not table.digit_warning and not all(map(_FOUR_DIGITS.match, texts)):
            table.digit_warning = next(
                f"line {number}: {text}" for text in texts if not _FOUR_DIGITS.match(text)
            )
        if len(values) != len(table.columns):
            raise ValueError(f"{len(values)} values, expected {len(table.columns)}")
    except ValueError as error:
        raise ResultError(f"invalid row: {error}", path, number) from error
    return values


def _add_zero_rows(
    sections: Sequence[tuple[str, DatSection]], path: Path, options: ReadOptions
) -> Iterator[DatSection]:
    """Sections with rows of zeros, which Abaqus does not print, added."""
    label_sets: dict[str, set[tuple[int, ...]]] = {}
    for kind, section in sections:
        label_sets.setdefault(kind, set()).update(map(tuple, section.labels.tolist()))
    rows = {kind: sorted(labels) for kind, labels in label_sets.items()}
    row_index = {kind: {row: k for k, row in enumerate(labels)} for kind, labels in rows.items()}
    filled, example = 0, ""
    for kind, section in sections:
        printed = [row_index[kind][tuple(row)] for row in section.labels.tolist()]
        if len(set(printed)) < len(printed):
            message = f"{section}: a row is duplicate"
            options.refuse(message, path, partial_note=f"dropped the section: {message}")
            continue
        if len(printed) == len(rows[kind]):
            yield section
            continue
        values = np.zeros((len(rows[kind]), section.values.shape[1]))
        values[printed] = section.values
        absent = next(row for k, row in enumerate(rows[kind]) if k not in set(printed))
        filled += len(rows[kind]) - len(printed)
        label_texts = zip(section.label_names, absent, strict=True)
        example = example or ", ".join(
            [f"{section.time_ms:g} ms", *(f"{name} {label}" for name, label in label_texts)]
        )
        labels = np.array(rows[kind], dtype=np.int64)
        yield replace(section, labels=labels, values=values)
    if filled:
        options.note(
            f"{filled} missing rows are taken as 0, the first at {example}: Abaqus does not print "
            "rows of zeros"
        )


def _complete_tensor(values: FloatArray) -> FloatArray:
    """Six components; of a plane element, which has four, the shears 13 and 23 are 0."""
    if values.shape[1] != 4:  # 11 22 33 12
        return values
    return np.hstack([values, np.zeros((len(values), 2))])
