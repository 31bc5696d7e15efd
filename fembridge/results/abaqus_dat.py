"""What Abaqus prints into its ``.dat``: tables at nodes and integration points.

                                INCREMENT     3 SUMMARY
 TIME INCREMENT COMPLETED  5.000E-04,  FRACTION OF STEP COMPLETED  6.000E-03
 STEP TIME COMPLETED       1.500E-03,  TOTAL TIME COMPLETED        1.500E-03

   THE FOLLOWING TABLE IS PRINTED FOR ALL ELEMENTS WITH TYPE C3D4 AVERAGED AT THE NODES

       NODE  FOOT-   S11         S22         S33         S12         S13         S23
             NOTE

           1       -133.7       5568.       1061.       52.65       42.54      -44.53

Tables are those of ``*EL PRINT`` and ``*NODE PRINT`` (Abaqus User's Guide, "Output to the data and
results files"); their form is that of public files (github.com/nightly/fedes, ``piston-tet.dat``;
listings in tutorials). A preamble may go on in the next line; a row may have a footnote (OR);
a table of zeros says so instead, and a row of zeros is left out. Shears come 12 13 23, as in a
``.dat`` of CalculiX; plane elements have 11 22 33 12. A table becomes a `DatSection` for each
quantity in it.

Numbers have four digits, times three or four: 0.2505 s is 0.251. Where number of increment times
its size agrees with the printed time, it is taken: so it is with the fixed increments of our decks.

Each increment has a summary with its times, and the tables that its step requests: every
increment, or every n-th and the last. A line of these that is missing is refused or noted.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from fembridge.errors import ResultError, UsageError
from fembridge.memory import check_memory
from fembridge.results.byte_file import text_lines
from fembridge.results.dat_section import TABLE, DatSection, Wanted
from fembridge.results.fields import numbers_near
from fembridge.results.history import History, of_samples
from fembridge.results.read_options import ReadOptions, in_pa
from fembridge.results.status import fortran
from fembridge.results.stress import von_mises_pa
from fembridge.trace import MS_PER_S, seconds_to_ms
from fembridge.typing import FloatArray

_ROWS_AT_ONCE, _ROW_BYTES, _VALUE_BYTES = 100_000, 300, 60  # of lists, and arrays of them
_LONGEST_PREAMBLE, _SHOWN = 1000, 80  # characters of it that are kept, and shown
STRESSES_AT_NODES, MISES_AT_NODES = "stresses at nodes", "von mises stress at nodes"

_ENDED = "THE ANALYSIS HAS BEEN COMPLETED"
_NUMBER = r"([-+.\dE]+)"
_INCREMENT = re.compile(r" *INCREMENT +(\d{1,9}) +SUMMARY *")
_SIZE = re.compile(rf" *TIME INCREMENT COMPLETED +{_NUMBER} *,.*")
_TIMES = re.compile(rf" *STEP TIME COMPLETED +{_NUMBER} *, +TOTAL TIME COMPLETED +{_NUMBER} *")
_STEP = re.compile(r" *S T E P +(\d{1,9}) .*")
_ABOUT_TIME = re.compile(r" *INCREMENT +\S+ +SUMMARY|.*TIME (?:INCREMENT )?COMPLETED")
_SET = re.compile(r"(?:NODE|ELEMENT) SET +(\S+)")
_ROW = re.compile(
    r" +(\d{1,18})((?: +\d{1,18})*?)(?: +[A-Z]{1,3})?"
    r"((?: +[-+]?\d+\.\d*(?:E[-+]\d\d|[-+]\d{3})?)+) *"
)
_TAILS = ("MAXIMUM", "MINIMUM", "TOTAL", "NODE", "ELEMENT", "AT ")  # of a table
_FLOAT = re.compile(r"[-+]?\d+\.\d*(?:E?[-+]\d+)?")
_FOUR_DIGITS = re.compile(r"[-+]?(?:0*\.0*$|0?(?=[\d.]{5}(?:[E+-]|$))\d{0,4}\.\d{0,4}(?:[E+-]|$))")
_LABELS = {("NODE",): ("node",), ("ELEMENT", "PT"): ("element", "point")}
# By the letters of a column: what it is, and in which unit of `printed`.
_FAMILIES = {"S": "stresses", "MISES": "von mises stress", "U": "displacements", "E": "strains",
             "LE": "strains", "RF": "forces", "COOR": "global coordinates"}  # fmt: skip


def nodal_stress(path: Path, nodes: Sequence[int] | None, options: ReadOptions) -> History:
    """Von Mises stress at `nodes`, in that order, averaged over elements by Abaqus.

    Of a node in several tables, whose means are over other elements each, the one of its
    own afferent's elements is taken where ``run.toml`` says which that is.
    """
    if nodes is None:
        raise UsageError(f"{path}: it gives stress at nodes that are named")
    own = {node: f"AROUND_{name}".upper() for node, name in options.classes.items()}
    wanted = (MISES_AT_NODES, STRESSES_AT_NODES)
    sections = list(abaqus_sections(path, lambda quantity, _: quantity in wanted, options))
    if not sections:
        words = "no stress averaged at nodes in it: *EL PRINT, POSITION=AVERAGED AT NODES"
        raise ResultError(words, path)
    samples: dict[int, dict[str, list[tuple[float, float]]]] = {node: {} for node in nodes}
    held = {one.quantity for one in sections}
    for one in sections:
        if one.quantity == STRESSES_AT_NODES and MISES_AT_NODES in held:
            continue
        stress = in_pa(one.values, options, path)
        stress = von_mises_pa(stress) if stress.shape[1] > 1 else stress[:, 0]
        for node, value in zip(one.labels[:, 0].tolist(), stress.tolist(), strict=True):
            if node in samples:
                samples[node].setdefault(one.set_name, []).append((one.time_ms, value))
    options.note("a .dat has four digits, too few for the drive of PC: the .odb has more")
    taken = []
    for node in nodes:
        sets = samples[node]
        name = own.get(node, "") if own.get(node, "") in sets else next(iter(sets), "")
        if not sets:
            known = np.unique(np.concatenate([one.labels[:, 0] for one in sections]))
            words = f"no stress at node {node}; near it {numbers_near(known, node)}"
            raise ResultError(words, path)
        if own.get(node) not in sets and len(sets) > 1:
            words = f"node {node} is in the tables of {' and '.join(sets)}, a mean over other"
            raise ResultError(f"{words} elements each, and no run.toml says which is its own", path)
        taken.append((node, np.array(sets[name])))
    return of_samples(taken, path)


@dataclass(slots=True)
class _Clock:
    """The time of the tables that follow; `now_s` is None where it is not printed.

    `problems` are contradictions among the lines about time that are not reported yet.
    `increments` are the numbers of the increments of each step, `sized` counts those with a line
    ``TIME INCREMENT``.
    """

    step: int = 1
    increment: int = 0
    size_s: float | None = None
    before_s: float = 0.0
    now_s: float | None = None
    last_s: float = 0.0
    start_s: float | None = None
    awaited: bool = False
    sized: int = 0
    problems: list[str] = field(default_factory=list)
    increments: dict[int, list[int]] = field(default_factory=dict)

    def reads(self, line: str) -> bool:
        """Whether `line` was about time."""
        if not ("COMPLETED" in line or "SUMMARY" in line or "S T E P" in line):
            return False
        if match := _INCREMENT.fullmatch(line):
            self._begin(int(match[1]))
        elif match := _SIZE.fullmatch(line):
            self.size_s = self._number(match[1])
            self.sized += 1
        elif match := _TIMES.fullmatch(line):
            self._times(match[1], match[2])
        elif match := _STEP.fullmatch(line):
            if int(match[1]) != self.step:
                self.step, self.before_s = int(match[1]), self.last_s
                self.increment, self.now_s, self.awaited = 0, None, False
        elif _ABOUT_TIME.match(line):
            self.problems.append(f"unreadable: {line.strip()[:80]!r}")
        else:
            return False
        return True

    def _begin(self, number: int) -> None:
        if self.awaited:
            self.problems.append(f"increment {self.increment} has no time")
        if self.increment and number != self.increment + 1:
            self.problems.append(f"increment {number} comes after {self.increment}")
        self.increment, self.size_s, self.now_s, self.awaited = number, None, None, True
        self.increments.setdefault(self.step, []).append(number)

    def _times(self, step_text: str, total_text: str) -> None:
        step_s, total_s = self._number(step_text), self._number(total_text)
        if not self.awaited:
            self.problems.append(f"a time of {step_text} s without a line INCREMENT")
            self.size_s = None
        self.awaited = False
        if step_s is None or total_s is None:
            return
        # Where a restart begins, the total time is ahead of the steps in the file.
        start_s = total_s - step_s - self.before_s
        self.start_s = start_s if self.start_s is None else self.start_s
        rounding_s = _last_digit_s(step_text) + 2.0 * _last_digit_s(total_text)
        if abs(start_s - self.start_s) > rounding_s + 2e-3 * abs(self.before_s):
            words = f"step time {step_text} s and total time {total_text} s contradict each other"
            self.problems.append(f"increment {self.increment}: {words}")
        if self.size_s is not None:
            exact_s = self.increment * self.size_s
            step_s = exact_s if abs(exact_s - step_s) <= 0.51 * _last_digit_s(step_text) else step_s
        self.now_s = self.last_s = self.before_s + step_s

    def _number(self, text: str) -> float | None:
        try:
            value = fortran(text)
            seconds_to_ms(value)
        except ValueError:
            self.problems.append(f"{text!r} is no time")
            return None
        return value


def _last_digit_s(printed: str) -> float:
    """One unit of the last digit of a printed time."""
    mantissa, _, power = printed.partition("E")
    return 10.0 ** (int(power or 0) - len(mantissa.partition(".")[2]))


@dataclass(slots=True)
class _Open:
    """A table that is being read; `time_ms` is None where no time is printed before it.

    `line` is its first, `step` and `increment` that of the clock, which is `awaited` when the
    increment has begun and its time is missing.
    """

    time_ms: float | None
    preamble: str
    line: int
    step: int
    increment: int
    awaited: bool
    labels: tuple[str, ...] = ()
    columns: tuple[str, ...] = ()
    rows: list[tuple[list[int], list[float]]] = field(default_factory=list)
    ended: bool = False
    total: list[float] = field(default_factory=list)
    odd: str = ""

    def sections(self) -> Iterator[DatSection]:
        """A section for each quantity, whose columns are together."""
        assert self.time_ms is not None  # see `abaqus_sections`
        found = _SET.search(self.preamble)
        at_nodes = " at nodes" if "AVERAGED AT THE NODES" in self.preamble else ""
        families: dict[str, list[int]] = {}
        for place, name in enumerate(self.columns):
            letters = name.rstrip("0123456789")
            families.setdefault(_FAMILIES.get(letters, letters.lower()), []).append(place)
        labels = np.array([row[0] for row in self.rows], dtype=np.int64)
        values = np.array([row[1] for row in self.rows], dtype=np.float64)
        labels = labels.reshape(len(self.rows), len(self.labels))
        values = values.reshape(len(self.rows), len(self.columns))
        for family, places in families.items():
            section = DatSection(
                quantity=family + at_nodes,
                set_name=found[1] if found else "ALL",
                columns=tuple(self.columns[place] for place in places),
                time_ms=self.time_ms,
                label_names=self.labels,
                labels=labels,
                values=_six(values[:, places]) if family == "stresses" else values[:, places],
            )
            if family == "stresses" and len(places) == 4:
                section = replace(section, columns=(*section.columns, "S13", "S23"))
            yield section
            if self.total:
                yield replace(
                    section,
                    quantity=f"total {family}",
                    label_names=(),
                    labels=np.empty((1, 0), dtype=np.int64),
                    values=np.array([[self.total[place] for place in places]]),
                )


def abaqus_sections(
    path: Path,
    wanted: Wanted,
    options: ReadOptions,
) -> Iterator[DatSection]:
    """As `fembridge.results.printed.dat_sections`, of a ``.dat`` of Abaqus."""
    sections: list[tuple[str, DatSection]] = []
    tables: dict[str, dict[tuple[int, int], _Open]] = {}  # by kind, then step and increment
    clock, whole = _Clock(), False
    odd = ""  # a number with more or fewer digits than Abaqus prints
    for item, number, closed in _tables(path, clock):
        for problem in clock.problems:
            options.refuse(f"line {number} or before: {problem}", path)
        clock.problems.clear()
        if item is None:
            whole = True
            continue
        table: _Open = item
        if message := _damage_of_table(table, closed):
            options.refuse(message, path, noted=f"{message}, which is left out")
            continue
        if table.time_ms is None:
            options.note(f"left out: the table from line {table.line} has no time")
            continue
        if not table.labels:
            options.note(f"left out: the table from line {table.line}, of another kind")
            continue
        for section in table.sections():
            if not wanted(section.quantity, section.set_name):
                continue
            kind = f"{section.quantity} {table.preamble}"
            others = tables.setdefault(kind, {})
            twin = others.setdefault((table.step, table.increment), table)
            if twin is not table and twin.columns == table.columns and twin.rows != table.rows:
                message = f"{section} is in two tables, from lines {twin.line} and {table.line}"
                options.refuse(message, path)
            sections.append((kind, section))
        odd = odd or table.odd
    for problem in clock.problems:
        options.refuse(problem, path)
    if odd:
        options.note(f"{odd} has not the four digits that Abaqus prints")
    if not whole:
        options.note(f"cut, or the job did not end: {_ENDED} is missing")
    count = sum(map(len, clock.increments.values()))
    if 0 < clock.sized < count:
        options.note(f"{count - clock.sized} of {count} increments have no line TIME INCREMENT")
    _note_absent(tables, clock.increments, options)
    yield from _with_zeros(sections, path, options)


def _damage_of_table(table: _Open, closed: bool) -> str:
    """What is wrong with a table as a whole; "" where nothing is."""
    if not closed:
        return f"cut in the table from line {table.line}"
    if not table.columns and not table.ended:
        return f"no names of columns in the table from line {table.line}"
    if table.awaited:
        return f"increment {table.increment} has no time before the table from line {table.line}"
    return ""


def _note_absent(
    tables: Mapping[str, Mapping[tuple[int, int], _Open]],
    increments: Mapping[int, Sequence[int]],
    options: ReadOptions,
) -> None:
    """Note the increments that lack a table of a kind that others have.

    A request prints every n-th increment of a step and the last.
    """
    for kind, held in tables.items():
        for step, numbers in increments.items():
            printed = [number for number in numbers if (step, number) in held]
            every = printed[0] if printed else 1
            expected = {number for number in numbers if number % every == 0}
            if numbers[0] > 1:  # of a restart
                expected = set(numbers) if every == numbers[0] else expected
            if not printed:
                options.note(f"step {step} has no table of {kind[:_SHOWN]}")
            elif absent := sorted(expected - set(printed)):
                shown = ", ".join(map(str, absent[:5])) + ", ..." * (len(absent) > 5)
                words = f"no table of {kind[:_SHOWN]} in increments {shown} of step {step}"
                options.note(f"{words}, {len(absent)} of {len(numbers)}")
            elif extra := sorted(set(printed) - expected - {numbers[-1]}):
                shown = ", ".join(map(str, extra[:5]))
                options.note(f"increment {shown} of step {step} has a table between the others")
            elif every > 1:
                options.note(f"every {every} increments of step {step} have {kind[:_SHOWN]}")


def _tables(path: Path, clock: _Clock) -> Iterator[tuple[_Open | None, int, bool]]:
    """Tables, the line of each, and whether more follows; None where the analysis has ended."""
    table: _Open | None = None
    for number, line, ended in text_lines(path):
        text = line.strip()
        if _ENDED in line or clock.reads(line) or TABLE in line:
            if table is not None:
                yield table, number, True
            table = None
            if _ENDED in line:
                yield None, number, True
            elif TABLE in line:
                time_ms = None if clock.now_s is None else clock.now_s * MS_PER_S
                at = number, clock.step, clock.increment, clock.awaited
                table = _Open(time_ms, text, *at)
        elif table is None or not text or text == "NOTE":
            continue
        elif table.columns and text.startswith("TOTAL") and ended:
            table.ended, table.total = True, _numbers(text.split()[1:], table, path, number)
        elif table.ended:
            row = _ROW.fullmatch(line) if table.columns else None
            if row and len(row[3].split()) == len(table.columns):
                raise ResultError(f"a row behind the end of its table: {line[:80]!r}", path, number)
        elif not table.columns:
            if text.startswith(("NODE", "ELEMENT")) and "FOOT" in text:
                names, _, columns = text.partition("FOOT-")
                table.labels = _LABELS.get(tuple(names.split()), ())
                table.ended = not table.labels  # of a kind that is not read
                table.columns = tuple(columns.split()) if table.labels else ()
            elif len(table.preamble) < _LONGEST_PREAMBLE:
                table.preamble += f" {text}"
        elif "ALL VALUES IN THIS TABLE ARE ZERO" in text:
            table.ended = True
        elif row := _ROW.fullmatch(line):
            values = _numbers(row[3].split(), table, path, number)
            labels = [int(row[1]), *map(int, row[2].split())]
            if len(labels) != len(table.labels):
                raise ResultError(f"no row of its table: {line[:80]!r}", path, number)
            table.rows.append((labels, values))
            if len(table.rows) % _ROWS_AT_ONCE == 0:
                needed_bytes = len(table.rows) * (_ROW_BYTES + _VALUE_BYTES * len(values))
                check_memory(needed_bytes, "the table", ResultError.at(path))
        elif text[0].isalpha() and (text.startswith(_TAILS) or not _FLOAT.search(text)):
            table.ended = True
        elif not ended:
            break
        elif text != "1":  # of a page
            raise ResultError(f"no row of its table: {line[:80]!r}", path, number)
    if table is not None:
        yield table, table.line, table.ended


def _numbers(words: Sequence[str], table: _Open, path: Path, number: int) -> list[float]:
    """The values of a row or a total, one a column."""
    try:
        values = [fortran(word) for word in words]
        if not table.odd and not all(map(_FOUR_DIGITS.match, words)):
            table.odd = next(f"line {number}: {w}" for w in words if not _FOUR_DIGITS.match(w))
        if len(values) != len(table.columns):
            raise ValueError(f"{len(values)} values, expected {len(table.columns)}")
    except ValueError as error:
        raise ResultError(f"no row of its table: {error}", path, number) from error
    return values


def _with_zeros(
    sections: Sequence[tuple[str, DatSection]], path: Path, options: ReadOptions
) -> Iterator[DatSection]:
    """The sections with the rows that others of their kind have: zeros are not printed."""
    every: dict[str, set[tuple[int, ...]]] = {}
    for kind, section in sections:
        every.setdefault(kind, set()).update(map(tuple, section.labels.tolist()))
    rows = {kind: sorted(labels) for kind, labels in every.items()}
    places = {kind: {row: k for k, row in enumerate(labels)} for kind, labels in rows.items()}
    filled, example = 0, ""
    for kind, section in sections:
        printed = [places[kind][tuple(row)] for row in section.labels.tolist()]
        if len(set(printed)) < len(printed):
            message = f"{section}: a row is duplicate"
            options.refuse(message, path, noted=f"dropped the section: {message}")
            continue
        if len(printed) == len(rows[kind]):
            yield section
            continue
        values = np.zeros((len(rows[kind]), section.values.shape[1]))
        values[printed] = section.values
        absent = next(row for k, row in enumerate(rows[kind]) if k not in set(printed))
        filled += len(rows[kind]) - len(printed)
        named = zip(section.label_names, absent, strict=True)
        example = example or ", ".join(
            [f"{section.time_ms:g} ms", *(f"{name} {label}" for name, label in named)]
        )
        labels = np.array(rows[kind], dtype=np.int64)
        yield replace(section, labels=labels, values=values)
    if filled:
        options.note(
            f"{filled} rows that tables lack are 0, the first at {example}: Abaqus prints no row "
            "of zeros"
        )


def _six(values: FloatArray) -> FloatArray:
    """Six components; a plane element has four, and its shears 13 and 23 are 0."""
    if values.shape[1] != 4:  # 11 22 33 12
        return values
    return np.hstack([values, np.zeros((len(values), 2))])
