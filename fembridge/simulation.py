"""What a simulation gives: stress, spikes and rates of each stimulus, and files."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fembridge.errors import TraceError
from fembridge.outputs import make_folder, replacing, write_text
from fembridge.stimulus import Stimulus
from fembridge.tables import Rate, SpikeTrain, write_rates, write_spikes
from fembridge.trace import StressTrace
from fembridge.typing import FloatArray, Table
from neural import Parameters, encode, rate_ips

RATES_FILE = "rates.csv"
SPIKES_FILE = "spikes.csv"
TRACES_FILE = "traces.npz"
RECORD_FILE = "simulation.toml"


@dataclass(frozen=True, slots=True, eq=False)
class Simulation:
    """One entry a stimulus: its stress `traces`, one an afferent; its spikes, rates.

    `trains` and `rates` run over stimuli, then afferents. `origin` tells how the
    stress was computed.
    """

    stimuli: tuple[Stimulus, ...]
    traces: tuple[tuple[StressTrace, ...], ...]
    trains: tuple[SpikeTrain, ...]
    rates: tuple[Rate, ...]
    origin: Mapping[str, object] = field(default_factory=dict)

    def write(self, folder: Path) -> None:
        """Write ``rates.csv``, ``spikes.csv``, ``traces.npz``, ``simulation.toml``.

        The NPZ holds ``stimulus`` ``(S,)``, ``afferent`` ``(A,)``, ``dt_ms``,
        ``displacement_um`` ``(S, T)`` and ``von_mises_pa`` ``(S, T, A)``.
        """
        import tomli_w

        make_folder(folder)
        with replacing(folder / TRACES_FILE) as draft, draft.open("wb") as file:
            np.savez(
                file,
                stimulus=np.array([stimulus.id for stimulus in self.stimuli]),
                afferent=np.array([trace.afferent for trace in self.traces[0]]),
                dt_ms=np.array(self.stimuli[0].dt_ms),
                displacement_um=np.stack(
                    [stimulus.displacement_um for stimulus in self.stimuli]
                ),
                von_mises_pa=np.stack(
                    [
                        np.stack([trace.stress_pa for trace in traces], -1)
                        for traces in self.traces
                    ]
                ),
            )
        write_spikes(folder / SPIKES_FILE, self.trains)
        write_rates(folder / RATES_FILE, self.rates)
        write_text(folder / RECORD_FILE, tomli_w.dumps(self._record()))

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
        Traces that do not share one time axis.
    ParameterError
        A time step that the parameters were not made for.
    """
    times: dict[str, list[FloatArray]] = {}
    afferents = [str(trace.afferent) for trace in traces[0]]
    lengths = {trace.stress_pa.size for row in traces for trace in row}
    steps = {round(trace.dt_ms, 9) for row in traces for trace in row}
    if len(lengths) != 1 or len(steps) != 1:
        raise TraceError(
            f"traces of {sorted(lengths)} samples every {sorted(steps)} ms, "
            "expected one time axis for all stimuli"
        )
    for column, afferent in enumerate(afferents):
        stress_pa = np.stack([row[column].stress_pa for row in traces], -1)
        dt_ms = traces[0][column].dt_ms
        times[afferent] = encode(stress_pa, dt_ms, parameters[afferent])
    trains, rates = [], []
    for row, stimulus in enumerate(stimuli):
        for afferent in afferents:
            spikes_ms = times[afferent][row]
            trains.append(SpikeTrain(stimulus.id, afferent, spikes_ms))
            rate = rate_ips(spikes_ms, stimulus.window_ms)
            rates.append(Rate(stimulus.id, afferent, rate))
    return Simulation(
        stimuli=tuple(stimuli),
        traces=tuple(tuple(row) for row in traces),
        trains=tuple(trains),
        rates=tuple(rates),
        origin=origin,
    )
