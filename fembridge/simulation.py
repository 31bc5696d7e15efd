"""What a simulation gives: stress, spikes and rates of each stimulus, and files."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fembridge.errors import TraceError
from fembridge.stimulus import Stimulus
from fembridge.store import filling, replacing, write_text
from fembridge.tables import Rate, SpikeTrain, write_rates, write_spikes
from fembridge.trace import STEP_TOLERANCE, StressTrace
from fembridge.typing import FloatArray, Table
from neural import Parameters, encode_afferents, mean_rate_ips

if TYPE_CHECKING:
    import pandas

RATES_FILE = "rates.csv"
SPIKES_FILE = "spikes.csv"
TRACES_FILE = "traces.npz"
RECORD_FILE = "simulation.toml"


@dataclass(frozen=True, slots=True, eq=False)
class Simulation:
    """One entry a stimulus: its stress `traces`, one an afferent; its spikes, rates.

    `trains` and `rates` run over stimuli, then afferents; a population has a train a
    cell, its `repeat` from 1, the most sensitive first, and its rate is their mean.
    `origin` tells how the stress was computed.
    """

    stimuli: tuple[Stimulus, ...]
    traces: tuple[tuple[StressTrace, ...], ...]
    trains: tuple[SpikeTrain, ...]
    rates: tuple[Rate, ...]
    origin: Mapping[str, object] = field(default_factory=dict)

    def write(self, folder: Path) -> None:
        """Write ``rates.csv``, ``spikes.csv``, ``traces.npz``, ``simulation.toml``.

        The NPZ holds ``stimulus`` ``(S,)``, ``afferent`` ``(A,)``, ``dt_ms``,
        ``displacement_um`` ``(S, T)`` and ``von_mises_pa`` ``(S, T, A)``. All four
        are replaced, or, after an error, none.

        Raises
        ------
        OutputError
            `folder` cannot be written.
        """
        import tomli_w

        with filling(folder, last=RECORD_FILE) as draft:
            self._write_traces(draft / TRACES_FILE)
            write_spikes(draft / SPIKES_FILE, self.trains)
            write_rates(draft / RATES_FILE, self.rates)
            write_text(draft / RECORD_FILE, tomli_w.dumps(self._record()))

    def rates_frame(self) -> "pandas.DataFrame":
        """Give the rates with columns ``stimulus``, ``afferent``, ``rate_ips``."""
        import pandas

        return pandas.DataFrame(
            [(r.stimulus, r.afferent, r.rate_ips) for r in self.rates],
            columns=["stimulus", "afferent", "rate_ips"],
        )

    def _write_traces(self, path: Path) -> None:
        displacement_um = [stimulus.displacement_um for stimulus in self.stimuli]
        stress_pa = [[trace.stress_pa for trace in row] for row in self.traces]
        with replacing(path) as draft, draft.open("wb") as file:
            np.savez(
                file,
                stimulus=np.array([stimulus.id for stimulus in self.stimuli]),
                afferent=np.array([trace.afferent for trace in self.traces[0]]),
                dt_ms=np.array(self.stimuli[0].dt_ms),
                displacement_um=np.array(displacement_um),
                von_mises_pa=np.moveaxis(np.array(stress_pa), 1, -1),
            )

    def _record(self) -> Table:
        stimuli = {
            stimulus.id: {
                "window_ms": list(stimulus.window_ms),
                "preindent_um": stimulus.preindent_um,
                **{k: v for k, v in stimulus.origin.items() if v is not None},
            }
            for stimulus in self.stimuli
        }
        return {**self.origin, "stimuli": stimuli}


def encode_all(
    stimuli: Sequence[Stimulus],
    traces: Sequence[Sequence[StressTrace]],
    parameters: Parameters,
    origin: Mapping[str, object],
) -> Simulation:
    """Turn the stress of all stimuli into spikes, one batch an afferent.

    Raises
    ------
    TraceError
        Not the same afferents for each stimulus, or not one time axis for all.
    ParameterError
        A time step that the parameters were not made for.
    """
    afferents = _shared_afferents(stimuli, traces, parameters)
    _check_times(stimuli, traces)
    stress_pa = {
        afferent: np.stack([row[column].stress_pa for row in traces], -1)
        for column, afferent in enumerate(afferents)
    }
    cells = encode_afferents(stress_pa, traces[0][0].dt_ms, parameters)
    trains, rates = [], []
    for row, stimulus in enumerate(stimuli):
        for afferent in afferents:
            spikes_ms = cells[afferent][row]
            trains.extend(trains_of(stimulus.id, afferent, spikes_ms))
            rate = mean_rate_ips(spikes_ms, stimulus.window_ms)
            rates.append(Rate(stimulus.id, afferent, rate))
    return Simulation(
        stimuli=tuple(stimuli),
        traces=tuple(tuple(row) for row in traces),
        trains=tuple(trains),
        rates=tuple(rates),
        origin=origin,
    )


def trains_of(stimulus: str, afferent: str, cells_ms: Sequence[FloatArray]) -> list[SpikeTrain]:
    """Give a train a cell; `repeat` counts them from 1, and is 0 for a single one."""
    first = 1 if len(cells_ms) > 1 else 0
    return [
        SpikeTrain(stimulus, afferent, times_ms, repeat)
        for repeat, times_ms in enumerate(cells_ms, start=first)
    ]


def _shared_afferents(
    stimuli: Sequence[Stimulus], traces: Sequence[Sequence[StressTrace]], parameters: Parameters
) -> list[str]:
    """Give the classes that every row of traces has, in that order."""
    if not stimuli or len(traces) != len(stimuli):
        raise TraceError(
            f"{len(traces)} rows of traces for {len(stimuli)} stimuli, expected one "
            "row for each of one or more"
        )
    first = [trace.afferent for trace in traces[0]]
    for stimulus, row in zip(stimuli, traces, strict=True):
        found = [trace.afferent for trace in row]
        if found != first or not first or not set(first) <= set(parameters):
            raise TraceError(
                f"{stimulus.id}: traces of {_listed(found)}, expected of "
                f"{_listed(first if found != first else list(parameters))}"
            )
    return [str(afferent) for afferent in first]


def _check_times(stimuli: Sequence[Stimulus], traces: Sequence[Sequence[StressTrace]]) -> None:
    """Hold every trace against the time axis of the first stimulus."""
    count, dt_ms = stimuli[0].displacement_um.size, stimuli[0].dt_ms
    near_ms = STEP_TOLERANCE * dt_ms
    for stimulus, row in zip(stimuli, traces, strict=True):
        axes = [(trace.stress_pa.size, trace.dt_ms, trace.start_ms) for trace in row]
        axes.append((stimulus.displacement_um.size, stimulus.dt_ms, 0.0))
        for size, step_ms, start_ms in axes:
            if size != count or abs(step_ms - dt_ms) > near_ms or abs(start_ms) > near_ms:
                raise TraceError(
                    f"{stimulus.id}: {size} samples every {step_ms:g} ms from "
                    f"{start_ms:g} ms, expected one time axis for all, {count} "
                    f"samples every {dt_ms:g} ms from 0 ms"
                )


def _listed(afferents: Sequence[str | None]) -> str:
    return ", ".join(afferent or "no class" for afferent in afferents) or "nothing"
