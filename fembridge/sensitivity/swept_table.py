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
from fembridge.table_rows import Row, decoded, header_of, read_content, rows_of

RESULT_COLUMNS = ("stimulus", "afferent", RATE, STRESS, "status", "cause")

_OUTPUT = re.compile(rf"([A-Z][A-Z0-9_]*):({'|'.join(QUANTITIES)}):(\S+)")

Point = tuple[str, ...]
"""The cells of a row that tell its finger from others."""


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
    text = decoded(read_content(path), path)
    header = header_of(text, path, RESULT_COLUMNS)
    if "stimulus" in header:
        return _from_results(path, text, header)
    if any(_OUTPUT.fullmatch(name) for name in header):
        return _from_summary(path, text, header)
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


def _from_results(path: Path, text: str, header: Sequence[str]) -> SweptFingers:
    """Gather the rows of each finger, its parameters before the column stimulus."""
    telling = header[: header.index("stimulus")]
    answers: dict[Point, dict[tuple[str, str], Row]] = {}
    causes: dict[Point, str] = {}
    for row in rows_of(text, path, (*telling, *RESULT_COLUMNS)):
        point = tuple(row.cells[name] for name in telling)
        mine = answers.setdefault(point, {})
        if row.choice("status", ("done", "failed")) == "failed":
            causes.setdefault(point, row.cells["cause"])
            continue
        if mine.setdefault((row.text("stimulus"), row.text("afferent")), row) != row:
            raise row.error("this stimulus and afferent stand there twice")
    whole = [point for point in answers if point not in causes]
    names, value = _parameters(path, telling, whole)
    outputs, answer = _means(path, [answers[point] for point in whole])
    return SweptFingers(names, value, outputs, answer, tuple(causes.values()))


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
    path: Path, fingers: Sequence[Mapping[tuple[str, str], Row]]
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
        quantity: np.array(
            [[rows[key].number(quantity, least=0) for key in asked] for rows in fingers]
        )
        for quantity in QUANTITIES
    }
    columns = [
        numbers[output.quantity][:, places].mean(axis=1) for output, places in members.items()
    ]
    return tuple(members), np.stack(columns, axis=1)


def _from_summary(path: Path, text: str, header: Sequence[str]) -> SweptFingers:
    found = {name: _OUTPUT.fullmatch(name) for name in header}
    outputs = {
        name: Output(match[1], match[2], match[3])
        for name, match in found.items()
        if match is not None
    }
    names = [name for name, match in found.items() if match is None]
    rows = list(rows_of(text, path, header))
    return SweptFingers(
        tuple(names), _numbers(rows, names), tuple(outputs.values()), _numbers(rows, outputs)
    )


def _numbers(rows: Sequence[Row], names: Iterable[str]) -> np.ndarray:
    """Give the numbers of columns ``(row, column)``."""
    columns = [[row.number(name) for row in rows] for name in names]
    return np.array(columns).reshape(len(columns), len(rows)).T
