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
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from fembridge.errors import ResultError, UsageError
from fembridge.results.byte_file import text_lines
from fembridge.results.dat_section import TABLE, DatSection, Wanted
from fembridge.results.fields import numbers_near
from fembridge.results.history import History, of_samples
from fembridge.results.read_options import ReadOptions, in_pa
from fembridge.results.status import fortran
from fembridge.results.stress import von_mises_pa
from fembridge.trace import MS_PER_S
from fembridge.typing import FloatArray

STRESSES_AT_NODES, MISES_AT_NODES = "stresses at nodes", "von mises stress at nodes"

_ENDED = "THE ANALYSIS HAS BEEN COMPLETED"
_NUMBER = r"([-+]?\d*\.?\d*(?:E[-+]?\d+)?)"
_INCREMENT = re.compile(r" *INCREMENT +(\d+) +SUMMARY *")
_SIZE = re.compile(rf" *TIME INCREMENT COMPLETED +{_NUMBER} *,.*")
_TIMES = re.compile(rf" *STEP TIME COMPLETED +{_NUMBER} *, +TOTAL TIME COMPLETED +{_NUMBER} *")
_STEP = re.compile(r" *S T E P +(\d+) .*")
_SET = re.compile(r"(?:NODE|ELEMENT) SET +(\S+)")
_ROW = re.compile(r" +(\d+)((?: +\d+)*?)(?: +[A-Z]{1,3})?((?: +[-+]?\d+\.\d*(?:E?[-+]\d+)?)+) *")
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
    """The time of the tables that follow."""

    step: int = 1
    increment: int = 0
    size: str = ""
    before_s: float = 0.0
    now_s: float = 0.0

    def reads(self, line: str) -> bool:
        """Whether `line` was about time."""
        if found := _INCREMENT.fullmatch(line):
            self.increment = int(found[1])
        elif found := _SIZE.fullmatch(line):
            self.size = found[1]
        elif found := _TIMES.fullmatch(line):
            self.now_s = self.before_s + self._in_step_s(found[1])
        elif found := _STEP.fullmatch(line):
            if int(found[1]) != self.step:
                self.step, self.before_s = int(found[1]), self.now_s
        else:
            return False
        return True

    def _in_step_s(self, printed: str) -> float:
        exact_s = self.increment * float(self.size or "nan")
        decimals = len(printed.partition(".")[2].partition("E")[0])
        rounding_s = 0.51 * 10.0 ** (int(printed.partition("E")[2] or 0) - decimals)
        return exact_s if abs(exact_s - float(printed)) <= rounding_s else float(printed)


@dataclass(slots=True)
class _Open:
    """A table that is being read."""

    time_ms: float
    preamble: str
    labels: tuple[str, ...] = ()
    columns: tuple[str, ...] = ()
    rows: list[tuple[list[int], list[float]]] = field(default_factory=list)
    ended: bool = False
    total: list[float] = field(default_factory=list)

    def sections(self) -> Iterator[DatSection]:
        """A section for each quantity, whose columns are together."""
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
    found: list[tuple[str, DatSection]] = []
    whole = False
    for table, number, closed in _tables(path):
        if table is None:
            whole = True
            continue
        if not closed:
            words = f"cut in the table from line {number}"
            options.refuse(words, path, noted=f"{words}, which is left out")
            continue
        for section in table.sections():
            if wanted(section.quantity, section.set_name):
                found.append((f"{section.quantity} {table.preamble}", section))
    if not whole:
        options.note(f"cut, or the job did not end: {_ENDED} is missing")
    yield from _with_zeros(found, options)


def _tables(path: Path) -> Iterator[tuple[_Open | None, int, bool]]:
    """Tables, the line of each, and whether more follows; None where the analysis has ended."""
    clock, table, at = _Clock(), None, 0
    for number, line, ended in text_lines(path):
        text = line.strip()
        if _ENDED in line or clock.reads(line) or TABLE in line:
            if table is not None:
                yield table, at, True
            table = None
            if _ENDED in line:
                yield None, number, True
            elif TABLE in line:
                table, at = _Open(clock.now_s * MS_PER_S, text), number
        elif table is None or not text or text == "NOTE":
            continue
        elif table.columns and text.startswith("TOTAL") and ended:
            table.ended, table.total = True, [fortran(word) for word in text.split()[1:]]
        elif table.ended:
            continue
        elif not table.columns:
            if text.startswith(("NODE", "ELEMENT")) and "FOOT" in text:
                names, _, columns = text.partition("FOOT-")
                table.labels = _LABELS.get(tuple(names.split()), ())
                table.ended = not table.labels  # of a kind that is not read
                table.columns = tuple(columns.split()) if table.labels else ()
            else:
                table.preamble += f" {text}"
        elif "ALL VALUES IN THIS TABLE ARE ZERO" in text:
            table.ended = True
        elif row := _ROW.fullmatch(line):
            values = [fortran(word) for word in row[3].split()]
            labels = [int(row[1]), *map(int, row[2].split())]
            if (len(labels), len(values)) != (len(table.labels), len(table.columns)):
                raise ResultError(f"no row of its table: {line[:80]!r}", path, number)
            table.rows.append((labels, values))
        elif text[0].isalpha():
            table.ended = True
        elif not ended:
            break
        elif text != "1":  # of a page
            raise ResultError(f"no row of its table: {line[:80]!r}", path, number)
    if table is not None:
        yield table, at, table.ended


def _with_zeros(
    found: Sequence[tuple[str, DatSection]], options: ReadOptions
) -> Iterator[DatSection]:
    """The sections with the rows that others of their kind have: zeros are not printed."""
    known: dict[str, set[tuple[int, ...]]] = {}
    for kind, one in found:
        known.setdefault(kind, set()).update(map(tuple, one.labels.tolist()))
    filled = False
    for kind, section in found:
        one, every = section, sorted(known[kind])
        if len(every) != len(one.labels):
            rows_at = {row: k for k, row in enumerate(every)}
            values = np.zeros((len(every), one.values.shape[1]))
            values[[rows_at[tuple(row)] for row in one.labels.tolist()]] = one.values
            filled = True
            one = replace(one, labels=np.array(every, dtype=np.int64), values=values)
        yield one
    if filled:
        options.note("rows that tables lack are 0: Abaqus prints no row of zeros")


def _six(values: FloatArray) -> FloatArray:
    """Six components; a plane element has four, and its shears 13 and 23 are 0."""
    if values.shape[1] != 4:  # 11 22 33 12
        return values
    return np.hstack([values, np.zeros((len(values), 2))])
