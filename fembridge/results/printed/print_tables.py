"""What solvers print beside their results, as long tables.

A ``.dat`` of CalculiX gives one row a number, with its unit beside it:
``time_ms,mode,quantity,set,node,element,point,face,component,value,unit``. Stress is
in Pa, and so are energy densities (1 Pa is 1 J/m³). Other units follow from a deck
in mm, N and s; of a deck in other units (``--stress-unit``) they are called "deck",
and the number is the deck's. A ``.sta`` gives one row an attempt at an increment, a
``.cvg`` one row an iteration, with the unit in the name of the column; so does the
``.sts`` of Marc for each increment that ended.
"""

import csv
from collections.abc import Callable, Iterator, Sequence
from dataclasses import astuple, dataclass, fields
from importlib import import_module
from pathlib import Path

import numpy as np

from fembridge.errors import ResultError
from fembridge.results.mentat import StsRow, read_sts
from fembridge.results.printed.cvg import CvgRow, read_cvg
from fembridge.results.printed.dat_section import DatSection, dat_sections
from fembridge.results.printed.sta import StaRow, read_sta
from fembridge.results.printed.text_lines import text_lines
from fembridge.results.read_options import ReadOptions, in_pa
from fembridge.store import replacing
from fembridge.typing import Table

DAT_COLUMNS = (
    "time_ms", "mode", "quantity", "set", "node", "element", "point", "face",
    "component", "value", "unit",
)  # fmt: skip
_LABELS = ("node", "element", "point", "face")
_VARYING = ("contact", "relative contact")  # as many records as springs are active
PA, DECK = "Pa", "deck"
_UNITS = {
    "displacements": "mm", "velocities": "mm/s", "global coordinates": "mm",
    "center of gravity": "mm", "relative contact displacement": "mm",
    "forces": "N", "total force": "N",
    "stresses": PA, "viscous stresses": PA, "contact stress": PA,
    "internal energy density": PA,
    "strains": "1", "mechanical strains": "1", "equivalent plastic strain": "1",
    "internal state variables": "", "total number of contact elements": "1",
    "internal energy": "mJ", "total internal energy": "mJ",
    "kinetic energy": "mJ", "total kinetic energy": "mJ",
    "contact print energy": "mJ", "total contact spring energy": "mJ",
    "volume": "mm3", "total volume": "mm3", "total mass": "t",
}  # fmt: skip
_OF_ANY_DECK = (PA, "1", "")

Row = Sequence[object]


@dataclass(frozen=True, slots=True)
class PrintTable:
    """A kind of print: its `suffix`, its columns, what reads its rows.

    `problem` tells why what it holds is not the whole of a run; None if it is.
    `about` is ``module:function`` of what tells more than counts, if anything does.
    """

    name: str
    suffix: str
    columns: tuple[str, ...]
    rows: Callable[[Path, ReadOptions, str | None], Iterator[Row]]
    problem: Callable[[Path], str | None]
    about: str | None = None

    def describe(self, path: Path) -> Table:
        """Tell what `path` holds."""
        if self.about is not None:
            module, _, function = self.about.partition(":")
            found: Table = getattr(import_module(module), function)(path)
            return found
        rows = list(self.rows(path, ReadOptions(partial=True), None))
        return {
            "format": self.name,
            "bytes": path.stat().st_size,
            "rows": len(rows),
            "last": dict(zip(self.columns, rows[-1], strict=True)) if rows else None,
            "problem": self.problem(path),
        }


def print_table_of(path: Path) -> PrintTable | None:
    """Give the kind of print that `path` is by its suffix; None if it is none."""
    found = [table for table in PRINT_TABLES if path.suffix.lower() == table.suffix]
    return found[0] if found else None


def write_print_table(
    table: PrintTable, path: Path, output: Path, options: ReadOptions, quantity: str | None = None
) -> int:
    """Write what `path` holds as CSV to `output`; give the count of rows.

    `quantity` takes one of a ``.dat`` alone.

    Raises
    ------
    ResultError
        The file is absent, cut or foreign; it holds no such quantity; a value is
        no finite number. `options.partial` takes what is whole instead.
    """
    count = 0
    with replacing(output) as draft, draft.open("w", newline="") as out:
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(table.columns)
        for row in table.rows(path, options, quantity):
            writer.writerow(row)
            count += 1
        if not count:
            words = "no rows" if quantity is None else f"no {quantity} in it"
            raise ResultError(f"{words}: there is nothing to write", path)
    return count


def unit_of(quantity: str, options: ReadOptions) -> str:
    """Give the unit in which the values of `quantity` leave here."""
    unit = _UNITS.get(quantity, DECK)
    return unit if unit in _OF_ANY_DECK or options.stress_unit == "MPa" else DECK


def _dat_rows(path: Path, options: ReadOptions, quantity: str | None) -> Iterator[Row]:
    counts: dict[tuple[str, str], int] = {}
    before: DatSection | None = None
    sections = dat_sections(path, lambda name, _: quantity is None or name == quantity, options)
    for section in sections:
        if before is not None:
            yield from _section_rows(before, path, options)
            counts[before.quantity, before.set_name] = len(before.values)
        before = section
    if before is None:
        return
    usual = counts.get((before.quantity, before.set_name), len(before.values))
    varying = before.quantity.startswith(_VARYING)
    if len(before.values) < usual and not varying:
        words = f"{before} is cut: {len(before.values)} of {usual} records"
        if not options.partial:
            raise ResultError(words, path)
        options.note(f"dropped: {words}")
        return
    yield from _section_rows(before, path, options)


def _section_rows(section: DatSection, path: Path, options: ReadOptions) -> Iterator[Row]:
    unit = unit_of(section.quantity, options)
    bad = np.argwhere(~np.isfinite(section.values))
    if bad.size:
        row, column = bad[0]
        labels = zip(section.label_names, section.labels[row].tolist(), strict=True)
        where = ", ".join(f"{name} {label}" for name, label in labels)
        words = f"{section}, {where}: {section.columns[column]} is {section.values[row, column]}"
        if not options.partial:
            raise ResultError(words, path)
        options.note(f"dropped the section: {words}")
        return
    stored = section.values
    if unit == PA:
        stored = in_pa(stored, options, path)
    time_ms = section.time_ms if section.over_time else ""
    mode = "" if section.mode is None else section.mode
    places = [
        section.label_names.index(name) if name in section.label_names else None for name in _LABELS
    ]
    for labels_row, values in zip(section.labels.tolist(), stored.tolist(), strict=True):
        label = ["" if at is None else labels_row[at] for at in places]
        for name, value in zip(section.columns, values, strict=True):
            yield (
                time_ms, mode, section.quantity, section.set_name, *label,
                name, value, unit,
            )  # fmt: skip


def _sta_rows(path: Path, options: ReadOptions, _: str | None) -> Iterator[Row]:
    _tell_unfinished(path, options)
    for row in read_sta(path):
        step, increment, attempt, failed, *rest = astuple(row)
        yield step, increment, attempt, int(failed), *rest


def _cvg_rows(path: Path, options: ReadOptions, _: str | None) -> Iterator[Row]:
    _tell_unfinished(path, options)
    for row in read_cvg(path):
        yield tuple("" if cell is None else cell for cell in astuple(row))


def _sts_rows(path: Path, options: ReadOptions, _: str | None) -> Iterator[Row]:
    found = read_sts(path)
    if found.problem is not None:
        options.note(found.problem)
    for row in found.rows:
        yield tuple("" if cell is None else cell for cell in astuple(row))


def _tell_unfinished(path: Path, options: ReadOptions) -> None:
    words = _unfinished(path)
    if words is not None:
        options.note(words)


def _unfinished(path: Path) -> str | None:
    for number, line, ended in text_lines(path):
        if not ended:
            return f"line {number} has no end yet and is left out: {line[:40]!r}"
    return None


def _sts_problem(path: Path) -> str | None:
    return read_sts(path).problem


def _columns(row: type) -> tuple[str, ...]:
    return tuple(field.name for field in fields(row))


_ABOUT_DAT = "fembridge.results.printed.dat:describe"

PRINT_TABLES = (
    PrintTable("ccx-dat", ".dat", DAT_COLUMNS, _dat_rows, _unfinished, _ABOUT_DAT),
    PrintTable("ccx-sta", ".sta", _columns(StaRow), _sta_rows, _unfinished),
    PrintTable("ccx-cvg", ".cvg", _columns(CvgRow), _cvg_rows, _unfinished),
    PrintTable("marc-sts", ".sts", _columns(StsRow), _sts_rows, _sts_problem),
)
