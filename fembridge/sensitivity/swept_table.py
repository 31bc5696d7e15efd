"""The table of a sweep as fingers: ``results.csv``, or its summary, a row a finger.

The summary has the parameters, and a column ``SA:rate_ips:sine_20`` for each output:
the mean over the stimuli of a set. ``all`` is the mean over all stimuli.
"""

import csv
import io
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from decks.stimuli import resolve
from fembridge.errors import StimulusError, TableError
from fembridge.sensitivity.swept import ALL, QUANTITIES, RATE, STRESS, Output, SweptFingers
from fembridge.tables import TextTable, read_table

RESULT_COLUMNS = ("stimulus", "afferent", RATE, STRESS, "status", "cause")

_OUTPUT = re.compile(rf"([A-Z][A-Z0-9_]*):({'|'.join(QUANTITIES)}):(\S+)")

Point = tuple[str, ...]
"""The cells of a row that tell its finger from others."""

Asked = tuple[str, str]
"""Stimulus and afferent."""


def read_swept(path: Path) -> SweptFingers:
    """Read ``results.csv`` of a sweep, or what `swept_text` made of one.

    A finger of which anything failed is left out; its cause is told.

    Raises
    ------
    TableError
        Neither of them, or a cell that is no number where one is expected.
    UsageError
        Nothing to compare.
    """
    table = read_table(path)
    if "stimulus" in table.header:
        return _from_results(path)
    if any(_OUTPUT.fullmatch(name) for name in table.header):
        return _from_summary(table)
    raise TableError(
        "neither results.csv of a sweep, with a column stimulus, nor a summary of "
        "one, with columns as SA:rate_ips:all",
        path,
        1,
    )


def swept_text(swept: SweptFingers) -> str:
    """Give the summary: a row a finger, six digits that count."""
    out = io.StringIO(newline="")
    table = csv.writer(out, lineterminator="\n")
    outputs = [f"{o.afferent}:{o.quantity}:{o.group}" for o in swept.outputs]
    table.writerow([*swept.names, *outputs])
    for values, answers in zip(swept.value, swept.answer, strict=True):
        table.writerow([f"{number:.6g}" for number in (*values, *answers)])
    return out.getvalue()


def group_of(stimulus: str) -> str:
    """Give the set of a stimulus: ``sine_20`` by its frequency, or its family."""
    try:
        [entry] = resolve([stimulus])
    except (StimulusError, ValueError):
        return stimulus
    if entry.family != "sine":
        return entry.family
    return stimulus.rpartition("_")[0]


def _from_results(path: Path) -> SweptFingers:
    """Gather the rows of each finger, its parameters before the column stimulus."""
    table = read_table(path, RESULT_COLUMNS)
    telling = table.header[: table.header.index("stimulus")]
    points: list[Point] = list(zip(*map(table.column, telling), strict=True))
    if not telling:
        points = [()] * table.size
    failed = table.choices("status", ("done", "failed")) == "failed"
    causes: dict[Point, str] = {}
    for row in np.flatnonzero(failed).tolist():
        causes.setdefault(points[row], table.column("cause")[row])
    done = table.where(~failed)
    numbers = zip(*(done.numbers(quantity, least=0) for quantity in QUANTITIES), strict=True)
    answers: dict[Point, dict[Asked, tuple[float, ...]]] = {point: {} for point in points}
    names = zip(done.words("stimulus"), done.words("afferent"), numbers, strict=True)
    for row, (index, (stimulus, afferent, values)) in enumerate(
        zip(np.flatnonzero(~failed).tolist(), names, strict=True)
    ):
        mine = answers[points[index]]
        if (stimulus, afferent) in mine:
            raise done.error(row, f"duplicate: {stimulus}, {afferent} of the same finger")
        mine[stimulus, afferent] = values
    whole = [point for point in answers if point not in causes]
    swept, value = _parameters(path, telling, whole)
    outputs, answer = _means(path, [answers[point] for point in whole])
    return SweptFingers(swept, value, outputs, answer, tuple(causes.values()))


def _parameters(
    path: Path, telling: Sequence[str], points: Sequence[Point]
) -> tuple[tuple[str, ...], np.ndarray]:
    """Give names and values ``(finger, parameter)`` of what is not the same in all."""
    names, columns = [], []
    for name, cells in zip(telling, zip(*points, strict=True), strict=False):
        if len(set(cells)) == 1:
            continue
        try:
            column = [float(cell) for cell in cells]
            if not np.isfinite(column).all():
                raise ValueError
        except ValueError:
            shown = ", ".join(repr(cell) for cell in list(dict.fromkeys(cells))[:3])
            raise TableError(
                f"{name} is {shown}: expected one for all, or different numbers", path
            ) from None
        names.append(name)
        columns.append(column)
    return tuple(names), np.array(columns).reshape(len(names), len(points)).T


def _means(
    path: Path, fingers: Sequence[Mapping[Asked, tuple[float, ...]]]
) -> tuple[tuple[Output, ...], np.ndarray]:
    """Give outputs and their means ``(finger, output)`` over groups of stimuli."""
    if not fingers:
        return (), np.zeros((0, 0))
    asked = list(fingers[0])
    for rows in fingers:
        if set(rows) != set(asked):
            odd = next(iter(set(rows) ^ set(asked)))
            raise TableError(f"{' '.join(odd)} is not there for all fingers", path)
    groups = {stimulus: group_of(stimulus) for stimulus, _ in asked}
    members: dict[Output, list[int]] = {}
    for quantity in QUANTITIES:
        for afferent in dict.fromkeys(name for _, name in asked):
            for group in (ALL, *dict.fromkeys(groups.values())):
                members[Output(afferent, quantity, group)] = [
                    place
                    for place, (stimulus, name) in enumerate(asked)
                    if name == afferent and group in (ALL, groups[stimulus])
                ]
    numbers = {
        quantity: np.array([[rows[key][column] for key in asked] for rows in fingers])
        for column, quantity in enumerate(QUANTITIES)
    }
    columns = [
        numbers[output.quantity][:, places].mean(axis=1) for output, places in members.items()
    ]
    return tuple(members), np.stack(columns, axis=1)


def _from_summary(table: TextTable) -> SweptFingers:
    found = {name: _OUTPUT.fullmatch(name) for name in table.header}
    outputs = {
        name: Output(match[1], match[2], match[3])
        for name, match in found.items()
        if match is not None
    }
    names = [name for name, match in found.items() if match is None]
    return SweptFingers(
        tuple(names), _numbers(table, names), tuple(outputs.values()), _numbers(table, outputs)
    )


def _numbers(table: TextTable, names: Iterable[str]) -> np.ndarray:
    """Give the numbers of columns ``(row, column)``."""
    columns = [table.numbers(name) for name in names]
    return np.array(columns).reshape(len(columns), table.size).T
