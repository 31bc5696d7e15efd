"""Long CSV tables: one row a sample, a spike or a rate, in and out.

``traces``  ``time_ms,afferent,node,von_mises_pa``; afferent may be empty
``spikes``  ``stimulus,afferent,repeat,spike_time_ms``; a silent train has no row
``rates``   ``stimulus,afferent,rate_ips``

Columns may stand in any order, and others beside them. Numbers are written with as
many digits as bring them back exactly; lines end in LF.
"""

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fembridge.errors import TableError, TraceError
from fembridge.store import write_text
from fembridge.table_rows import read_rows
from fembridge.trace import STEP_TOLERANCE, StressTrace
from fembridge.typing import FloatArray

AFFERENTS = ("SA", "RA", "PC")

TRACE_COLUMNS = ("time_ms", "afferent", "node", "von_mises_pa")
SPIKE_COLUMNS = ("stimulus", "afferent", "repeat", "spike_time_ms")
RATE_COLUMNS = ("stimulus", "afferent", "rate_ips")


@dataclass(frozen=True, slots=True, eq=False)
class SpikeTrain:
    """Spikes of one afferent under one stimulus: `times_ms` ``(spikes,)``, rising."""

    stimulus: str
    afferent: str
    times_ms: FloatArray
    repeat: int = 0

    def __post_init__(self) -> None:
        times = np.array(self.times_ms, dtype=np.float64)
        where = f"{self.stimulus}, {self.afferent}, repeat {self.repeat}"
        if self.afferent not in AFFERENTS:
            raise TraceError(f"{where}: expected one of {', '.join(AFFERENTS)}")
        if times.ndim != 1 or not np.isfinite(times).all():
            raise TraceError(f"{where}: spike times must be (spikes,) and finite")
        if (np.diff(times) <= 0).any():
            raise TraceError(f"{where}: spike times do not rise")
        times.flags.writeable = False
        object.__setattr__(self, "times_ms", times)


@dataclass(frozen=True, slots=True)
class Rate:
    """Firing rate of one afferent under one stimulus."""

    stimulus: str
    afferent: str
    rate_ips: float


@dataclass(slots=True)
class _Samples:
    """Rows of one node, with the line that each stands on."""

    pairs: list[tuple[float, float]] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)


def read_traces(path: Path) -> list[StressTrace]:
    """Read a table of traces, in the order in which their nodes first appear.

    Raises
    ------
    TableError
        Not a table of traces: names the line, what is there, what is expected.
    """
    found: dict[tuple[str | None, int], _Samples] = {}
    for row in read_rows(path, TRACE_COLUMNS):
        afferent = row.choice("afferent", AFFERENTS) if row.cells["afferent"] else None
        samples = found.setdefault((afferent, row.whole("node", least=1)), _Samples())
        samples.pairs.append((row.number("time_ms"), row.number("von_mises_pa")))
        samples.lines.append(row.line)
    if not found:
        raise TableError("a header and no rows, expected samples", path)
    return [_trace(path, afferent, node, samples) for (afferent, node), samples in found.items()]


def write_traces(path: Path, traces: Iterable[StressTrace]) -> None:
    """Write a table of traces, one after the other."""
    _write(
        path,
        TRACE_COLUMNS,
        (
            (time_ms, trace.afferent or "", trace.node, stress_pa)
            for trace in traces
            for time_ms, stress_pa in zip(
                trace.times_ms.tolist(), trace.stress_pa.tolist(), strict=True
            )
        ),
    )


def read_spikes(path: Path) -> list[SpikeTrain]:
    """Read a table of spikes; each train's spikes come back in rising order.

    Raises
    ------
    TableError
        Not a table of spikes, or the same spike twice.
    """
    found: dict[tuple[str, str, int], dict[float, int]] = {}
    for row in read_rows(path, SPIKE_COLUMNS):
        name = (
            row.text("stimulus"),
            row.choice("afferent", AFFERENTS),
            row.whole("repeat", least=0),
        )
        lines = found.setdefault(name, {})
        first = lines.setdefault(row.number("spike_time_ms"), row.line)
        if first != row.line:
            raise row.error(f"the same spike as on line {first}")
    return [
        SpikeTrain(stimulus, afferent, np.array(sorted(lines)), repeat)
        for (stimulus, afferent, repeat), lines in found.items()
    ]


def write_spikes(path: Path, trains: Iterable[SpikeTrain]) -> None:
    """Write a table of spikes, one train after the other."""
    _write(
        path,
        SPIKE_COLUMNS,
        (
            (train.stimulus, train.afferent, train.repeat, time_ms)
            for train in trains
            for time_ms in train.times_ms.tolist()
        ),
    )


def read_rates(path: Path) -> list[Rate]:
    """Read a table of rates, observed or computed, in its order.

    Raises
    ------
    TableError
        Not a table of rates, a negative rate, or two for the same afferent.
    """
    found: dict[tuple[str, str], tuple[Rate, int]] = {}
    for row in read_rows(path, RATE_COLUMNS):
        afferent = row.choice("afferent", AFFERENTS)
        rate = Rate(row.text("stimulus"), afferent, row.number("rate_ips", least=0))
        _, first = found.setdefault((rate.stimulus, rate.afferent), (rate, row.line))
        if first != row.line:
            raise row.error(
                f"a second rate of {rate.stimulus}, {rate.afferent}; the first is on line {first}"
            )
    if not found:
        raise TableError("a header and no rows, expected rates", path)
    return [rate for rate, _ in found.values()]


def write_rates(path: Path, rates: Iterable[Rate]) -> None:
    """Write a table of rates in the order given."""
    rows = ((each.stimulus, each.afferent, each.rate_ips) for each in rates)
    _write(path, RATE_COLUMNS, rows)


def _trace(path: Path, afferent: str | None, node: int, samples: _Samples) -> StressTrace:
    """Make the trace of one node; its times must be one even, rising grid."""
    who = f"{afferent} node {node}" if afferent else f"node {node}"
    if len(samples.pairs) < 2:
        raise TableError(f"{who}: one sample, expected more", path, samples.lines[0])
    times_ms, stress_pa = np.array(samples.pairs).T
    steps_ms = np.diff(times_ms)
    usual_ms = float(np.median(steps_ms))
    even = np.abs(steps_ms - usual_ms) <= STEP_TOLERANCE * abs(usual_ms)
    off = np.flatnonzero(~even | (steps_ms <= 0))
    if off.size:
        row = int(off[0])
        raise TableError(
            f"{who}: time goes from {times_ms[row]:g} to {times_ms[row + 1]:g} ms, "
            f"expected an even step (most are {usual_ms:g} ms)",
            path,
            samples.lines[row + 1],
        )
    dt_ms = float((times_ms[-1] - times_ms[0]) / steps_ms.size)
    return StressTrace(stress_pa, dt_ms, node, afferent, start_ms=float(times_ms[0]))


def _write(path: Path, header: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    out = io.StringIO(newline="")
    table = csv.writer(out, lineterminator="\n")
    table.writerow(header)
    table.writerows(rows)
    write_text(path, out.getvalue())
