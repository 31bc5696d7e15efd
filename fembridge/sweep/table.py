"""``results.csv``: a row for each point and afferent, those that failed too."""

import csv
import io
from collections.abc import Iterator, Mapping
from pathlib import Path

from fembridge.errors import FembridgeError
from fembridge.store import write_text
from fembridge.sweep.answers import Answer, read_answers
from fembridge.sweep.plan import Plan

RESULTS_FILE = "results.csv"
ANSWER_COLUMNS = (
    "stimulus",
    "afferent",
    "rate_ips",
    "spikes",
    "peak_stress_pa",
    "status",
    "cause",
    "run",
)

_Cell = str | float | int | None


def write_results(folder: Path, plan: Plan, causes: Mapping[str, str]) -> int:
    """Write the table of `plan` into `folder`; give the number of its rows.

    `causes` tells why, by the key of an item that failed.

    Raises
    ------
    OutputError
        The folder cannot be written.
    """
    out = io.StringIO(newline="")
    table = csv.writer(out, lineterminator="\n")
    table.writerow([*plan.columns, *ANSWER_COLUMNS])
    rows = 0
    for row in _rows(folder, plan, causes):
        table.writerow(row)
        rows += 1
    write_text(folder / RESULTS_FILE, out.getvalue())
    return rows


def _rows(folder: Path, plan: Plan, causes: Mapping[str, str]) -> Iterator[list[_Cell]]:
    read: dict[str, Mapping[tuple[str, str], Answer] | str] = {}
    for point in plan.points:
        key = point.item
        place = plan.items[key].place
        if key not in read:
            read[key] = causes.get(key) or _answers(folder / place)
        found = read[key]
        for afferent in point.afferents:
            begin = [*point.columns.values(), point.stimulus, afferent]
            if isinstance(found, str):
                yield [*begin, None, None, None, "failed", found, str(place)]
                continue
            one = found[point.stimulus, afferent]
            numbers = [one.rate_ips, one.spikes, one.peak_stress_pa]
            yield [*begin, *numbers, "done", None, str(place)]


def _answers(place: Path) -> Mapping[tuple[str, str], Answer] | str:
    """Read the answers; a file that went away since is a cause like any other."""
    try:
        return read_answers(place)
    except FembridgeError as error:
        return str(error)
