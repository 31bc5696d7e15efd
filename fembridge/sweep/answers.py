"""What an item gives: rate, spikes and peak stress by stimulus and afferent.

``answers.csv``  ``stimulus,afferent,rate_ips,spikes,peak_stress_pa``
``spikes.csv``   every spike, as in the other verbs
``item.toml``    what it was made of and how, with the checksums of the two

The record is written last and carries a checksum of its own: where all agree, the
item is finished and whole.
"""

import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from fembridge.errors import FembridgeError, TableError
from fembridge.simulation import SPIKES_FILE, Simulation
from fembridge.store import filling, read_sealed, sha256_of, write_sealed, write_text
from fembridge.sweep.task import FORMAT, Item
from fembridge.tables import write_spikes
from neural import spikes_inside

ANSWERS_FILE = "answers.csv"
RECORD_FILE = "item.toml"
COLUMNS = ("stimulus", "afferent", "rate_ips", "spikes", "peak_stress_pa")

_FILES = (ANSWERS_FILE, SPIKES_FILE)


@dataclass(frozen=True, slots=True)
class Answer:
    """One afferent under one stimulus.

    `spikes` are those inside the counting window, of all cells of its population;
    `peak_stress_pa` is the largest stress that its drive reads.
    """

    stimulus: str
    afferent: str
    rate_ips: float
    spikes: int
    peak_stress_pa: float


def answers_of(simulation: Simulation) -> list[Answer]:
    """Sum up each stimulus and afferent of `simulation`, in its order."""
    counts: dict[tuple[str, str], int] = {}
    windows = {each.id: each.window_ms for each in simulation.stimuli}
    for train in simulation.trains:
        key = train.stimulus, train.afferent
        inside = spikes_inside(train.times_ms, windows[train.stimulus])
        counts[key] = counts.get(key, 0) + inside
    peaks = {
        (stimulus.id, str(trace.afferent)): float(trace.stress_pa.max())
        for stimulus, row in zip(simulation.stimuli, simulation.traces, strict=True)
        for trace in row
    }
    return [
        Answer(
            rate.stimulus,
            rate.afferent,
            rate.rate_ips,
            counts[rate.stimulus, rate.afferent],
            peaks[rate.stimulus, rate.afferent],
        )
        for rate in simulation.mean_rates
    ]


def write_item(place: Path, item: Item, simulation: Simulation, how: Mapping[str, object]) -> None:
    """Write the three files of a finished item into `place`, the record last.

    Raises
    ------
    OutputError
        The folder cannot be written; what stands there is then no finished item.
    """
    out = io.StringIO(newline="")
    table = csv.writer(out, lineterminator="\n")
    table.writerow(COLUMNS)
    for each in answers_of(simulation):
        table.writerow(
            (each.stimulus, each.afferent, each.rate_ips, each.spikes, each.peak_stress_pa)
        )
    with filling(place, last=RECORD_FILE) as draft:
        write_text(draft / ANSWERS_FILE, out.getvalue())
        write_spikes(draft / SPIKES_FILE, simulation.trains)
        write_sealed(
            draft / RECORD_FILE,
            {
                "format": FORMAT,
                "key": item.key,
                "parameter_set": item.parameters_name,
                "how": dict(how),
                "files": {name: sha256_of(draft / name) for name in _FILES},
                "inputs": item.inputs(),
            },
        )


def is_finished(place: Path, item: Item) -> bool:
    """Whether `place` has all of `item`, as it was written."""
    try:
        record = read_sealed(place / RECORD_FILE, "record of an item", FORMAT)
        return record["key"] == item.key and all(
            sha256_of(place / name) == record["files"][name] for name in _FILES
        )
    except (FembridgeError, OSError, KeyError, TypeError):
        return False


def read_answers(place: Path) -> dict[tuple[str, str], Answer]:
    """Read the answers of a finished item, by stimulus and afferent.

    Raises
    ------
    TableError
        The table is not there or not whole.
    """
    path = place / ANSWERS_FILE
    try:
        with path.open(encoding="utf-8", newline="") as file:
            found = [
                Answer(
                    row["stimulus"],
                    row["afferent"],
                    float(row["rate_ips"]),
                    int(row["spikes"]),
                    float(row["peak_stress_pa"]),
                )
                for row in csv.DictReader(file)
            ]
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise TableError(f"not the answers of an item: {error!r}", path) from error
    return {(each.stimulus, each.afferent): each for each in found}
