"""The result of a simulation: stress, spikes and rates of each stimulus, as tables and files."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fembridge.errors import (
    ResultError,
    TraceError,
    UsageError,
)
from fembridge.host.store import (
    filling,
    remove_file,
    replacing,
    sha256_of,
    write_toml,
)
from fembridge.io.spike_table import (
    Rate,
    SpikeTrain,
    rates_frame,
    read_rates,
    read_spikes,
    spikes_frame,
    write_rates,
    write_spikes,
)
from fembridge.plots.shown import Shown
from fembridge.simulation.folder import (
    FINGER_FILE,
    RASTER_FILE,
    RATES_FILE,
    RECORD_FILE,
    SPIKES_FILE,
    TRACES_FILE,
    check_finger,
    has_finger,
    read_origin,
    stimuli_in,
    with_origin,
)
from fembridge.simulation.spikes import encode_traces, spike_trains
from fembridge.solver.build import stimulus_inputs
from fembridge.stimulus import Stimulus
from fembridge.trace import StressTrace, Traces, model_id, stacked
from neural import Parameters, mean_rate_ips

if TYPE_CHECKING:
    import matplotlib.figure
    import pandas

    from fembridge.io.recording import Recording
    from fembridge.plots.style import Panels

PICTURES = ("raster", "psth", "isi", "rates")


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Simulation(Shown):
    """Stress, spikes and rates of each stimulus, the result of `fembridge.simulate`.

    Parameters
    ----------
    stimuli
        The stimuli.
    traces
        Stress histories: a row per stimulus, a column per class, or per unit of a class.
    trains
        Spike trains, stimulus after stimulus, then class after class. A population has one
        train per cell, numbered from 1, the most sensitive first.
    mean_rates
        Firing rates in the same order; of a population the mean over its cells.
    origin
        How the stress was computed. Default: empty.

    Examples
    --------
    >>> import fembridge as fb
    >>> result = fb.simulate("sine_20_250", stored=True)
    >>> result.rates["rate_ips"].round(1).tolist()
    [26.5, 51.8, 42.9]
    >>> result.write("out")
    >>> fb.Simulation.read("out").spikes.equals(result.spikes)
    True
    """

    stimuli: tuple[Stimulus, ...]
    traces: tuple[tuple[StressTrace, ...], ...]
    trains: tuple[SpikeTrain, ...]
    mean_rates: tuple[Rate, ...]
    origin: Mapping[str, object] = field(default_factory=dict)

    def _lines(self) -> list[str]:
        ids = [stimulus.id for stimulus in self.stimuli]
        classes = list(dict.fromkeys(rate.afferent for rate in self.mean_rates))
        more = f" and {len(ids) - 3} more" if len(ids) > 3 else ""
        rates = ", ".join(
            f"{name} {np.mean([r.rate_ips for r in self.mean_rates if r.afferent == name]):.1f}"
            for name in classes
        )
        return [
            f"Simulation of {', '.join(ids[:3])}{more}",
            f"  by {self.origin.get('method', 'traces')}, "
            f"parameters {self.origin.get('parameter_set', 'not named')}",
            f"  mean rates in impulses/s: {rates}",
            "  .rates, .spikes, .traces, .plot(), .write(folder)",
        ]

    @property
    def provenance(self) -> dict[str, object]:
        """Version, method, parameters, response, finger with checksum, and each stimulus."""
        response: Any = self.origin.get("response", {})
        identity = model_id(response)
        return {
            **self.origin,
            **({"finger": identity} if identity else {}),
            "stimuli": {stimulus.id: stimulus_inputs(stimulus) for stimulus in self.stimuli},
        }

    @property
    def rates(self) -> "pandas.DataFrame":
        """Firing rates in impulses/s: ``stimulus, afferent[, unit], rate_ips``."""
        return rates_frame(self.mean_rates)

    @property
    def spikes(self) -> "pandas.DataFrame":
        """Spikes, one row each: ``stimulus, afferent[, unit], cell, spike_time_ms``."""
        return spikes_frame(self.trains)

    def plot(
        self, kind: str | None = None, ax: "Panels | None" = None
    ) -> "matplotlib.figure.Figure":
        """Picture of the spikes or rates, as `fembridge plot` draws it.

        Parameters
        ----------
        kind
            ``raster``, ``psth`` or ``isi`` of the spikes, with a panel per class; or ``rates``
            against amplitude, the mean of all units, with a column per frequency. Default:
            ``raster``.
        ax
            Axes to draw into, one per panel. Default: a new figure.

        Raises
        ------
        UsageError
            An unknown kind, or another number of axes than panels.
        """
        picture = kind or "raster"
        from fembridge.plots.spike_figures import isi_figure, psth_figure, raster_figure

        if picture not in PICTURES:
            raise UsageError(argument="kind", found=kind, expected=", ".join(PICTURES))
        if picture == "rates":
            from fembridge.plots.rate_comparison import rates_figure

            by_class: dict[tuple[str, str], list[float]] = {}
            for rate in self.mean_rates:
                by_class.setdefault((rate.stimulus, rate.afferent), []).append(rate.rate_ips)
            means = [Rate(*key, float(np.mean(units))) for key, units in by_class.items()]
            return rates_figure(means, axes=ax)
        rows: dict[str, Any] = {
            "stimuli": [stimulus.id for stimulus in self.stimuli],
            "afferents": list(dict.fromkeys(str(trace.afferent) for trace in self.traces[0])),
            "axes": ax,
        }
        if picture == "isi":
            return isi_figure(self.trains, **rows)
        windows_ms = {stimulus.window_ms for stimulus in self.stimuli}
        rows["window_ms"] = windows_ms.pop() if len(windows_ms) == 1 else None
        rows["waveform"] = self.stimuli[0] if len(self.stimuli) == 1 else None
        draw = raster_figure if picture == "raster" else psth_figure
        return draw(self.trains, **rows)

    def to_traces(self) -> Traces:
        """Stress traces of all stimuli, with their windows, parameters and finger.

        `fembridge.encode` encodes them; `to_frame` of the result makes a table of them.
        """
        traces = [
            replace(trace, stimulus=stimulus.id)
            for stimulus, row in zip(self.stimuli, self.traces, strict=True)
            for trace in row
        ]
        finger: Any = self.provenance.get("finger", {})
        return with_origin(traces, self.stimuli, self.origin, finger)

    def to_recording(self) -> "Recording":
        """Recording for other programs: one trial for each stimulus, one unit for each cell."""
        from fembridge.io.recording import Recording

        nodes = {(str(trace.afferent), trace.unit): trace.node for trace in self.traces[0]}
        depth_um = stacked([stimulus.displacement_um for stimulus in self.stimuli])
        dt_ms = self.stimuli[0].dt_ms
        t_stop_ms = (depth_um.shape[1] - 1) * dt_ms
        return Recording.from_trains(self.trains, dt_ms, t_stop_ms, nodes, depth_um)

    def write(
        self,
        folder: str | os.PathLike[str],
        *,
        plot: bool = False,
        more: Mapping[str, Callable[[Path], object]] | None = None,
    ) -> None:
        """Write ``rates.csv``, ``spikes.csv``, ``traces.npz`` and ``simulation.toml``.

        The finger of a response is written to ``finger.toml``, which the record names. The NPZ
        has ``stimulus`` ``(S,)``, ``afferent``, ``node`` and, where a class has several units,
        ``unit`` ``(A,)``, ``dt_ms``,
        ``displacement_um`` ``(S, T)`` and ``von_mises_pa`` ``(S, T, A)``, NaN after the end of
        a shorter stimulus. All files are replaced, or none; `read` reads them.

        Parameters
        ----------
        folder
            Folder of the files, which is made.
        plot
            Whether to draw ``raster.png``. Default: False.
        more
            Functions that write further files, by name. Default: None.

        Raises
        ------
        OutputError
            The folder cannot be written, or has a ``finger.toml`` of the user.
        """
        stimuli = {stimulus.id: stimulus_inputs(stimulus) for stimulus in self.stimuli}
        for table in stimuli.values():
            del table["id"]
        stress_pa = [
            stacked([row[k].stress_pa for row in self.traces]) for k in range(len(self.traces[0]))
        ]
        units = [trace.unit for trace in self.traces[0]]
        named_units: dict[str, Any] = {"unit": np.array(units)} if any(units) else {}
        record: dict[str, Any] = {**self.origin, "stimuli": stimuli}
        response = record.get("response", {})
        finger = response.get("finger")
        has_file = isinstance(finger, Mapping)  # else only its name is known
        folder = Path(folder)
        is_left_over = not has_file and has_finger(folder)
        if has_file:
            check_finger(folder, finger)
        with filling(folder, last=RECORD_FILE) as draft:
            with replacing(draft / TRACES_FILE) as path, path.open("wb") as file:
                np.savez(
                    file,
                    stimulus=np.array([stimulus.id for stimulus in self.stimuli]),
                    afferent=np.array([trace.afferent for trace in self.traces[0]]),
                    node=np.array([trace.node for trace in self.traces[0]]),
                    **named_units,
                    dt_ms=np.array(self.stimuli[0].dt_ms),
                    displacement_um=stacked(
                        [stimulus.displacement_um for stimulus in self.stimuli]
                    ),
                    von_mises_pa=np.stack(stress_pa, -1),
                )
            write_spikes(draft / SPIKES_FILE, self.trains)
            write_rates(draft / RATES_FILE, self.mean_rates)
            if has_file:
                write_toml(draft / FINGER_FILE, finger)
                record["response"] = {
                    **response,
                    "finger": finger.get("name", ""),
                    "finger_file": FINGER_FILE,
                    "finger_file_sha256": sha256_of(draft / FINGER_FILE),
                }
            write_toml(draft / RECORD_FILE, record)
            if plot:
                from fembridge.plots.style import save_figure

                save_figure(self.plot(), draft / RASTER_FILE)
            for name, write in (more or {}).items():
                write(draft / name)
        if is_left_over:
            remove_file(folder / FINGER_FILE)

    @classmethod
    def read(cls, folder: str | os.PathLike[str]) -> "Simulation":
        """The simulation that `write` or ``fembridge simulate`` wrote.

        Parameters
        ----------
        folder
            Folder with ``simulation.toml``, ``traces.npz``, ``spikes.csv`` and ``rates.csv``.

        Raises
        ------
        ResultError, TableError
            A file is absent, cut short or of another kind.

        Examples
        --------
        >>> import fembridge as fb
        >>> result = fb.simulate("sine_20_250", stored=True)
        >>> result.write("out")
        >>> fb.Simulation.read("out").rates.equals(result.rates)
        True
        """
        folder = Path(folder)
        contents = stimuli_in(folder)
        if contents.path != folder / RECORD_FILE:
            raise ResultError(f"no {RECORD_FILE} and {TRACES_FILE}: not a simulation", folder)
        columns = len(contents.traces) // len(contents.stimuli)
        rows = [
            tuple(contents.traces[begin : begin + columns])
            for begin in range(0, len(contents.traces), columns)
        ]
        trains = {
            (train.stimulus, (train.afferent, train.unit), train.cell): train
            for train in contents.with_silent(read_spikes(folder / SPIKES_FILE))
        }
        stimuli = [stimulus.id for stimulus in contents.stimuli]
        units = [(str(trace.afferent), trace.unit) for trace in rows[0]]

        def position(key: tuple[str, tuple[str, str], int]) -> tuple[int, int, int]:
            return stimuli.index(key[0]), units.index(key[1]), key[2]

        try:
            ordered = tuple(trains[key] for key in sorted(trains, key=position))
        except ValueError as error:
            raise ResultError(f"another simulation than {TRACES_FILE}", folder / SPIKES_FILE) from (
                error
            )
        rates = tuple(read_rates(folder / RATES_FILE))
        return cls(contents.stimuli, tuple(rows), ordered, rates, read_origin(folder))


def encode_all(
    stimuli: Sequence[Stimulus],
    traces: Sequence[Sequence[StressTrace]],
    parameters: Parameters,
    origin: Mapping[str, object],
) -> Simulation:
    """Spikes and rates of the stress of all stimuli.

    Raises
    ------
    TraceError, ParameterError
        A class without parameters, another number of samples than the stimulus has, another
        time step than that of the parameters.
    """
    pairs = [
        (stimulus, trace) for stimulus, row in zip(stimuli, traces, strict=True) for trace in row
    ]
    for stimulus, trace in pairs:
        size, expected = trace.stress_pa.size, stimulus.displacement_um.size
        if trace.afferent not in parameters or size != expected:
            raise TraceError(
                f"of {stimulus.id} has {size} samples of {trace.afferent}, expected {expected} of "
                f"{', '.join(parameters)}",
                argument="traces",
                found=(size, trace.afferent),
                expected=f"{expected} samples of {', '.join(parameters)}",
            )
    trains, rates = [], []
    cells = encode_traces([trace for _, trace in pairs], parameters)
    for (stimulus, trace), spikes_ms in zip(pairs, cells, strict=True):
        afferent = str(trace.afferent)
        trains.extend(spike_trains(stimulus.id, afferent, spikes_ms, trace.unit))
        rate = mean_rate_ips(spikes_ms, stimulus.window_ms)
        rates.append(Rate(stimulus.id, afferent, rate, trace.unit))
    rows = tuple(tuple(row) for row in traces)
    return Simulation(tuple(stimuli), rows, tuple(trains), tuple(rates), origin)
