"""A model beside what is known of real afferents: timing, thresholds, man, ramp and hold.

Each table is made of a table of published facts, `fembridge.evidence`, or of a user's in
its place, and of a model under the same stimuli by the response map.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from decks.stimuli import Ramp, Sine, resolve
from decks.waveform import make_stimulus
from fembridge.evidence import THRESHOLDS, TIMING_COLUMNS, evidence, published_timing
from fembridge.response.response_map import ResponseMap
from fembridge.stimulus import Stimulus
from fembridge.tables import AFFERENTS, SpikeTrain
from fembridge.tuning import against_evidence, thresholds, vibration
from fembridge.typing import FloatArray
from neural.encoder import encode_cells
from neural.parameters import Parameters
from neural.threshold import vector_strength

if TYPE_CHECKING:
    from pandas import DataFrame

# Within these bounds the timing of a model passes for that of a recorded unit.
STRENGTH_APART, IMPULSES_APART = 0.25, 0.30

# A tuning curve may be off by so many times at one frequency, and by so many in the median.
MOST_TIMES, MEDIAN_TIMES = 4.0, 1.5

# Ramp and hold from first touch: 300 um at 3 mm/s, held for half a second, and back.
RAMP = Ramp(depth_um=300, up_ms=100, hold_ms=500, down_ms=100)

# Of the curves, in Hz, beside the frequencies that were recorded.
CURVE_HZ = (2.0, 5.0, 10.0, 20.0, 40.0, 80.0, 125.0, 200.0, 250.0, 315.0, 400.0, 500.0, 800.0)

_NUMBERS = TIMING_COLUMNS[3:]
_BIN_MS, _CYCLE_MS = 5.0, 50.0

# Spikes of each cell of a class under a stimulus.
Spikes: TypeAlias = Callable[[str, Stimulus], list[FloatArray]]


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """Tables of one model beside recorded afferents.

    `timing` has a row a class and vibration: what was recorded, the model's impulses a
    cycle and vector strengths over all cells, the impulses of the keenest cell, and
    whether that is near enough. `phases` are shares of the spikes by phase of the cycle,
    `tuning` recorded thresholds with the model's, `curves` the model's, `man` impulses a
    cycle in man, `ramp` spikes under `ramp_stimulus`.
    """

    timing: "DataFrame"
    phases: "DataFrame"
    tuning: "DataFrame"
    curves: "DataFrame"
    man: "DataFrame"
    ramp: tuple[SpikeTrain, ...]
    ramp_stimulus: Stimulus

    def shortfalls(self) -> tuple[str, ...]:
        """A sentence for everything that is known and that the model does not do."""
        found = (_timing_shortfalls(self.timing), _tuning_shortfalls(self.tuning))
        return (*found[0], *found[1], *_ramp_shortfalls(self.ramp))


def gather(
    response: ResponseMap,
    parameters: Parameters,
    preindent_um: float,
    observed_thresholds: "DataFrame | None" = None,
    observed_trains: Sequence[SpikeTrain] = (),
) -> Evidence:
    """Everything that is known, and the model under the same stimuli.

    `observed_thresholds` and `observed_trains` stand in the place of the published ones.
    """
    from pandas import concat

    columns = {str(place.afferent): k for k, place in enumerate(response.places)}

    def spikes(afferent: str, stimulus: Stimulus) -> list[FloatArray]:
        trace = response.traces(stimulus, parameters)[columns[afferent]]
        [cells] = encode_cells(trace.stress_pa, stimulus.dt_ms, parameters[afferent])
        return cells

    asked = evidence(THRESHOLDS) if observed_thresholds is None else observed_thresholds
    curves = concat(
        [
            thresholds(
                response,
                parameters[name],
                sorted({*CURVE_HZ, *asked[asked["afferent"] == name]["frequency_hz"].tolist()}),
                preindent_um,
            )
            for name in AFFERENTS
        ],
        ignore_index=True,
    )
    recorded = timing_of(observed_trains) if observed_trains else published_timing()
    ramp = make_stimulus(RAMP)
    return Evidence(
        timing=_timing(recorded, preindent_um, spikes),
        phases=_phases(preindent_um, spikes),
        tuning=against_evidence(curves, asked),
        curves=curves,
        man=_man(response.deepest_um, preindent_um, spikes),
        ramp=tuple(
            SpikeTrain(ramp.id, name, times_ms, repeat)
            for name in AFFERENTS
            for repeat, times_ms in enumerate(spikes(name, ramp), start=1)
        ),
        ramp_stimulus=ramp,
    )


def timing_of(trains: Sequence[SpikeTrain]) -> "DataFrame":
    """Timing of recorded spikes under sinusoids: a row a class and stimulus.

    Impulses a cycle are the mean over trains, vector strengths those of all spikes, in
    the window of the stimulus.
    """
    from pandas import DataFrame

    rows = []
    for stimulus, afferent in dict.fromkeys((one.stimulus, one.afferent) for one in trains):
        entry = resolve(stimulus)[0]
        if isinstance(entry, Sine):
            same = (stimulus, afferent)
            mine = [one.times_ms for one in trains if (one.stimulus, one.afferent) == same]
            numbers = _numbers(mine, entry.frequency_hz, entry.window_ms)
            rows.append((afferent, entry.frequency_hz, entry.amplitude_um, *numbers))
    return DataFrame(rows, columns=list(TIMING_COLUMNS))


def _records(table: "DataFrame") -> list[dict[Any, Any]]:
    return table.to_dict("records")


def _whole_cycles(stimulus: Stimulus, frequency_hz: float) -> tuple[float, float]:
    """Window of as many whole cycles as a vibration has."""
    cycles = np.floor(stimulus.window_ms[1] * frequency_hz / 1000.0 + 1e-9)
    return 0.0, float(cycles) * 1000.0 / frequency_hz


def _numbers(
    trains_ms: Sequence[FloatArray], frequency_hz: float, window_ms: tuple[float, float]
) -> tuple[float, float, float]:
    """Impulses a cycle and train, and both vector strengths of all spikes."""
    start_ms, end_ms = window_ms
    together = np.concatenate([one[(one > start_ms) & (one <= end_ms)] for one in trains_ms])
    cycles = (end_ms - start_ms) * frequency_hz / 1000.0
    return (
        together.size / len(trains_ms) / cycles,
        vector_strength(together, frequency_hz),
        vector_strength(together, 2.0 * frequency_hz),
    )


def _timing(recorded: "DataFrame", preindent_um: float, spikes: Spikes) -> "DataFrame":
    from pandas import DataFrame

    rows = []
    for row in _records(recorded):
        frequency_hz = row["frequency_hz"]
        stimulus = vibration(frequency_hz, row["amplitude_um"], preindent_um)
        cells = spikes(row["afferent"], stimulus)
        window_ms = _whole_cycles(stimulus, frequency_hz)
        numbers = _numbers(cells, frequency_hz, window_ms)
        keenest = _numbers(cells[:1], frequency_hz, window_ms)[0]
        apart = [abs(mine - row[name]) for mine, name in zip(numbers, _NUMBERS, strict=True)]
        rows.append(
            {
                **row,
                **{f"model_{name}": mine for name, mine in zip(_NUMBERS, numbers, strict=True)},
                "model_keenest_impulses": keenest,
                "strengths_near": max(apart[1:]) <= STRENGTH_APART,  # NaN is not
                "impulses_near": abs(keenest / row[_NUMBERS[0]] - 1) <= IMPULSES_APART,
            }
        )
    return DataFrame(rows)


def _phases(preindent_um: float, spikes: Spikes) -> "DataFrame":
    """Recorded spikes by phase of the 20 Hz cycle, and the model's, as shares of all."""
    from pandas import DataFrame

    found = []
    table = evidence("timing_20hz_phase")
    for afferent, amplitude_um in table[["afferent", "amplitude_um"]].drop_duplicates().to_numpy():
        mine = table[(table["afferent"] == afferent) & (table["amplitude_um"] == amplitude_um)]
        stimulus = vibration(1000.0 / _CYCLE_MS, float(amplitude_um), preindent_um)
        together = np.concatenate(spikes(afferent, stimulus))
        edges_ms = np.arange(0.0, _CYCLE_MS + _BIN_MS, _BIN_MS)
        counts, _ = np.histogram(together % _CYCLE_MS, bins=edges_ms)
        recorded = mine["spikes"].to_numpy(np.float64)
        for k, phase_ms in enumerate(edges_ms[:-1].tolist()):
            shares = recorded[k] / recorded.sum(), counts[k] / max(together.size, 1)
            found.append((afferent, float(amplitude_um), phase_ms, *shares))
    return DataFrame(found, columns=["afferent", "amplitude_um", "phase_ms", "recorded", "model"])


def _man(deepest_um: float, preindent_um: float, spikes: Spikes) -> "DataFrame":
    """Impulses a cycle in man and of the model, as far as its response reaches."""
    table = evidence("impulses_a_cycle_johansson_1982")
    table = table[table["amplitude_um"] <= deepest_um - preindent_um].reset_index(drop=True)
    found = []
    for row in _records(table):
        stimulus = vibration(row["frequency_hz"], row["amplitude_um"], preindent_um)
        window_ms = _whole_cycles(stimulus, row["frequency_hz"])
        found.append(_numbers(spikes(row["afferent"], stimulus), row["frequency_hz"], window_ms)[0])
    return table.assign(model=found)


def _timing_shortfalls(timing: "DataFrame") -> Iterator[str]:
    for row in _records(timing[~timing["strengths_near"]]):
        mine, theirs = (
            " and ".join(f"{row[f'{prefix}{name}']:.2f}" for name in _NUMBERS[1:])
            for prefix in ("model_", "")
        )
        yield (
            f"{row['afferent']}, timing at {row['frequency_hz']:g} Hz, {row['amplitude_um']:g} µm: "
            f"vector strength {mine} at the frequency and at twice it, recorded {theirs}."
        )
    off = timing[~timing["impulses_near"]]
    for afferent in dict.fromkeys(off["afferent"]):
        words = ", ".join(
            f"{row['model_keenest_impulses']:.1f} instead of {row[_NUMBERS[0]]:.1f} at "
            f"{row['amplitude_um']:g} µm"
            for row in _records(off[off["afferent"] == afferent])
        )
        yield f"{afferent}, impulses a cycle of the keenest cell: {words}."


def _tuning_shortfalls(tuning: "DataFrame") -> Iterator[str]:
    known = tuning.dropna(subset="ratio")
    known = known.assign(times=np.exp(np.abs(np.log(known["ratio"]))))
    for afferent in dict.fromkeys(known["afferent"]):
        rows = _records(known[known["afferent"] == afferent].sort_values("times"))
        median, worst = float(np.median([row["times"] for row in rows])), rows[-1]
        if median > MEDIAN_TIMES or worst["times"] > MOST_TIMES:
            yield (
                f"{afferent}, thresholds: off by {median:.1f} times in the median, most at "
                f"{worst['frequency_hz']:g} Hz ({worst['criterion'].replace('_', ' ')}): "
                f"{worst['model_um']:.3g} µm instead of {worst['amplitude_um']:.3g}."
            )


def _ramp_shortfalls(trains: Sequence[SpikeTrain]) -> Iterator[str]:
    start_ms, top_ms, back_ms, end_ms = RAMP.corners_ms

    def count(afferent: str, low_ms: float, high_ms: float) -> int:
        mine = [train.times_ms for train in trains if train.afferent == afferent]
        return sum(int(((one > low_ms) & (one <= high_ms)).sum()) for one in mine)

    early = count("SA", top_ms, top_ms + 100.0)
    late = count("SA", back_ms - 100.0, back_ms)
    if not early > late > 0:
        yield (
            f"SA, ramp and hold: {early} spikes of all cells in the first 100 ms of the hold and "
            f"{late} in the last; recorded ones slow down and fire on."
        )
    margin_ms = 25.0
    for low_ms, high_ms, name in (
        (start_ms, top_ms + margin_ms, "indentation"),
        (back_ms, end_ms + margin_ms, "retraction"),
    ):
        silent = [one for one in ("RA", "PC") if not count(one, low_ms, high_ms)]
        if silent:
            yield f"{' and '.join(silent)}, ramp and hold: silent during {name}."
    for one in ("RA", "PC"):
        if count(one, top_ms + 2 * margin_ms, back_ms):
            yield f"{one}, ramp and hold: fires while the probe stands."
