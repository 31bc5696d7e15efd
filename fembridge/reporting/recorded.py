"""Models compared with recorded afferents: timing, thresholds, human units, distance, ramp.

Each comparison takes a table of published facts (`fembridge.evidence`), or a user's table
instead, and a model under the same stimuli on a response map. The parameters of the whole
fingertip are compared in timing, thresholds and, as the only ones, in the distance from a
probe.
"""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from decks.stimuli import DT_MS, Ramp, Sine, resolve
from decks.synthesis import at_step, make_stimulus
from fembridge.errors import FembridgeWarning
from fembridge.evidence import (
    DISTANCE,
    HUMAN,
    PHASES,
    THRESHOLDS,
    TIMING,
    TIMING_COLUMNS,
    Facts,
    published,
    published_timing,
)
from fembridge.fitting.thresholds import class_thresholds, compare_with_evidence, vibration
from fembridge.io.spike_table import SpikeTrain
from fembridge.response.response_map import ResponseMap
from fembridge.stimulus import Stimulus
from fembridge.trace import AFFERENTS
from fembridge.typing import FloatArray
from neural import ParameterSet
from neural.encoder import encode_cells
from neural.parameters import Parameters
from neural.timing import vector_strength

if TYPE_CHECKING:
    from pandas import DataFrame

    from fembridge.touching.pad import Pad

# Largest differences at which the timing of a model counts as that of a recorded unit: of
# vector strengths, and of impulses per cycle as a share.
STRENGTH_TOLERANCE, IMPULSES_TOLERANCE = 0.25, 0.30
# Size of the population that is searched for the cell closest to a recorded unit.
_CELLS = 200

# From first touch to 300 um at 3 mm/s, hold for 500 ms, and retract.
RAMP = Ramp(depth_um=300, up_ms=100, hold_ms=500, down_ms=100)

# Frequencies of the tuning curves in Hz, in addition to the recorded ones.
CURVE_HZ = (2.0, 5.0, 10.0, 20.0, 40.0, 80.0, 125.0, 200.0, 250.0, 315.0, 400.0, 500.0, 800.0)

# Pin of Johnson (1974), Fig. 7, and the amplitudes to try.
_PIN_MM, _PIN_HZ, _PIN_DEPTH_UM = 2.0, 40.0, 550.0
_PIN_UM = np.geomspace(15.0, 900.0, 24)

_NUMBERS = TIMING_COLUMNS[3:]
_PHASE_BINS, _PHASE_PANELS = 10, 2


class ModelOnResponse(NamedTuple):
    """A parameter set, and the stored or solved response that drives it."""

    response: ResponseMap
    model: ParameterSet

    def spikes_ms(self, afferent: str, stimulus: Stimulus, cells: int = 0) -> list[FloatArray]:
        """Spike times of each cell of a class; `cells` resizes its population, 0 keeps the size.

        A model with one cell is never resized. The most sensitive cells come first, each at all
        positions of the probe.
        """
        parameters = self.model.parameters[afferent]
        if cells and parameters.cells > 1:
            parameters = replace(parameters, cells=cells)
        fine = at_step(stimulus, parameters.dt_ms)
        stress_pa = self.response.stress_pa(parameters, [fine])[:, 0]
        by_position = encode_cells(stress_pa, fine.dt_ms, parameters)
        return [times_ms for cells_ms in zip(*by_position, strict=True) for times_ms in cells_ms]

    def vibration_spikes_ms(
        self, row: Mapping[Any, Any], cells: int = 0
    ) -> tuple[list[FloatArray], tuple[float, float]]:
        """Spike times under the vibration of a table's `row`, and the window of whole cycles."""
        frequency_hz = row["frequency_hz"]
        dt_ms = self.model.parameters[row["afferent"]].dt_ms
        stimulus = vibration(frequency_hz, row["amplitude_um"], self.model.preindent_um, dt_ms)
        cycles = np.floor(stimulus.window_ms[1] * frequency_hz / 1000.0 + 1e-9)
        window_ms = (0.0, cycles * 1000.0 / frequency_hz)
        return self.spikes_ms(row["afferent"], stimulus, cells), window_ms


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """Timing and thresholds of a model, with the recorded ones.

    `timing` has one row per class and vibration: recorded numbers, the model's impulses per
    cycle and vector strengths over all cells, the impulses of the cell closest to the
    recorded unit, the rank of that cell (0: most sensitive, 1: least sensitive), and whether
    the differences are within tolerance. `tuning` has recorded thresholds with the model's,
    `curves` the model's alone.
    """

    timing: "DataFrame"
    tuning: "DataFrame"
    curves: "DataFrame"


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """Recorded afferents compared with the judged model and the whole `fingertip`, if it is other.

    `phases` are shares of the spikes per phase bin, `human` impulses per cycle of human units,
    `distance` RA's amplitudes at distances from a probe, `ramp` spikes under `ramp_stimulus`.
    `sources` describes each evidence table, by its name: content and origin. `trains` are a
    user's recorded spikes.
    """

    judged: Comparison
    fingertip: Comparison | None
    phases: "DataFrame"
    human: "DataFrame"
    distance: "DataFrame"
    ramp: tuple[SpikeTrain, ...]
    ramp_stimulus: Stimulus
    sources: Mapping[str, str]
    trains: tuple[SpikeTrain, ...] = ()


def gather(
    judged: ModelOnResponse,
    fingertip: ModelOnResponse | None,
    overrides: Mapping[str, Facts] | None = None,
    trains: Sequence[SpikeTrain] = (),
    skin: "Pad | None" = None,
) -> Evidence:
    """Recorded afferents, and both models under the same stimuli; None: `judged` is on a pad.

    `skin` is the pad for the distance from a probe, by default the reference pad.

    `overrides` replace published tables of the same names; recorded `trains` replace the
    published timing and phases.
    """
    overrides = overrides or {}
    facts = {
        name: overrides.get(name) or published(name)
        for name in (THRESHOLDS, TIMING, PHASES, HUMAN, DISTANCE)
    }
    recorded = timing_of(trains) if trains else published_timing()
    phases = phases_of(trains) if trains else facts[PHASES].table.assign(frequency_hz=20.0)
    ramp = make_stimulus(RAMP)
    sources = {name: table.source for name, table in facts.items()}
    if trains:
        sources |= dict.fromkeys((TIMING, PHASES), "Recorded spikes supplied by the user.")
    recorded_thresholds = facts[THRESHOLDS].table
    return Evidence(
        judged=_comparison(judged, recorded, recorded_thresholds),
        fingertip=fingertip and _comparison(fingertip, recorded, recorded_thresholds),
        phases=_phases(phases, judged),
        human=_human(facts[HUMAN].table, judged),
        distance=_distance(facts[DISTANCE].table, (fingertip or judged).model.parameters, skin),
        ramp=tuple(
            SpikeTrain(ramp.id, name, times_ms, cell)
            for name in AFFERENTS
            for cell, times_ms in enumerate(judged.spikes_ms(name, ramp), start=1)
        ),
        ramp_stimulus=ramp,
        sources=sources,
        trains=tuple(trains),
    )


def _comparison(
    model_on_response: ModelOnResponse, recorded: "DataFrame", recorded_thresholds: "DataFrame"
) -> Comparison:
    """Timing under `recorded` vibrations; the model's curves include recorded frequencies."""
    from pandas import concat

    response, model = model_on_response
    tables = []
    for name in AFFERENTS:
        recorded_hz = recorded_thresholds.frequency_hz[recorded_thresholds.afferent == name]
        frequencies_hz = sorted({*CURVE_HZ, *recorded_hz})
        parameters = model.parameters[name]
        tables.append(class_thresholds(response, parameters, frequencies_hz, model.preindent_um))
    curves = concat(tables, ignore_index=True)
    timing = _timing(recorded, model_on_response)
    return Comparison(timing, compare_with_evidence(curves, recorded_thresholds), curves)


def timing_of(trains: Sequence[SpikeTrain]) -> "DataFrame":
    """Timing of recorded spikes under sinusoids: one row per class and stimulus.

    Impulses per cycle are the mean over trains, vector strengths are those of all spikes in
    the window of the stimulus.
    """
    from pandas import DataFrame

    rows = [
        (
            name,
            sine.frequency_hz,
            sine.amplitude_um,
            *_timing_numbers(trains_ms, sine.frequency_hz, sine.window_ms),
        )
        for (name, sine), trains_ms in _sine_trains_ms(trains).items()
    ]
    return DataFrame(rows, columns=list(TIMING_COLUMNS))


def _sine_trains_ms(trains: Sequence[SpikeTrain]) -> dict[tuple[str, Sine], list[FloatArray]]:
    """Spike times of each train, by class and sinusoid; other stimuli are left out."""
    groups: dict[tuple[str, Sine], list[FloatArray]] = {}
    for train in trains:
        if isinstance(entry := resolve(train.stimulus)[0], Sine):
            groups.setdefault((train.afferent, entry), []).append(train.times_ms)
    return groups


def _timing_numbers(
    trains_ms: Sequence[FloatArray], frequency_hz: float, window_ms: tuple[float, float]
) -> tuple[float, float, float]:
    """Impulses per cycle and train, and vector strengths of all spikes at f and at 2 f."""
    start_ms, end_ms = window_ms
    pooled_ms = np.concatenate([ms[(ms > start_ms) & (ms <= end_ms)] for ms in trains_ms])
    cycles = (end_ms - start_ms) * frequency_hz / 1000.0
    return (
        pooled_ms.size / len(trains_ms) / cycles,
        vector_strength(pooled_ms, frequency_hz),
        vector_strength(pooled_ms, 2.0 * frequency_hz),
    )


def _with_model(recorded: "DataFrame", model_on_response: ModelOnResponse) -> "DataFrame":
    """`recorded` vibrations joined with the model's numbers, in whole cycles."""
    from pandas import DataFrame

    rows = []
    for row in recorded.to_dict("records"):
        cells_ms, window_ms = model_on_response.vibration_spikes_ms(row)
        rows.append(_timing_numbers(cells_ms, row["frequency_hz"], window_ms))
    return recorded.join(DataFrame(rows, recorded.index, [f"model_{name}" for name in _NUMBERS]))


def _timing(recorded: "DataFrame", model_on_response: ModelOnResponse) -> "DataFrame":
    """`_with_model`, with the cell closest to the recorded unit of each class."""
    table = _with_model(recorded, model_on_response)
    impulses = _NUMBERS[0]
    for _, unit in recorded.groupby("afferent"):
        rows = []
        for row in unit.to_dict("records"):
            cells_ms, window_ms = model_on_response.vibration_spikes_ms(row, _CELLS)
            frequency_hz = row["frequency_hz"]
            rows.append([_timing_numbers([ms], frequency_hz, window_ms)[0] for ms in cells_ms])
        recorded_impulses = unit[impulses].to_numpy()[:, np.newaxis]
        difference = abs(np.array(rows) - recorded_impulses)
        difference = difference / np.maximum(recorded_impulses, 0.1)
        closest = int(difference.sum(axis=0).argmin())
        table.loc[unit.index, "model_unit_impulses"] = [row[closest] for row in rows]
        table.loc[unit.index, "model_unit_place"] = (closest + 0.5) / difference.shape[1]
    first, second = (abs(table[f"model_{name}"] - table[name]) for name in _NUMBERS[1:])
    share = table["model_unit_impulses"] / table[impulses]
    return table.assign(  # NaN is out of tolerance
        strengths_near=np.maximum(first, second) <= STRENGTH_TOLERANCE,
        impulses_near=abs(share - 1) <= IMPULSES_TOLERANCE,
    )


def phases_of(trains: Sequence[SpikeTrain]) -> "DataFrame":
    """Recorded spikes per phase bin of the cycle, for the two strongest sinusoids of each class.

    Columns are those of the evidence table ``timing_20hz_phase`` and ``frequency_hz``.
    """
    from pandas import DataFrame

    rows = []
    groups = _sine_trains_ms(trains)
    for afferent in AFFERENTS:
        sines = [sine for name, sine in groups if name == afferent]
        for sine in sorted(sines, key=lambda sine: sine.amplitude_um)[-_PHASE_PANELS:]:
            cycle_ms = 1000.0 / sine.frequency_hz
            edges_ms = np.linspace(0.0, cycle_ms, _PHASE_BINS + 1)
            pooled_ms = np.concatenate(groups[afferent, sine])
            counts, _ = np.histogram(pooled_ms % cycle_ms, bins=edges_ms)
            key = (afferent, sine.frequency_hz, sine.amplitude_um)
            rows += [(*key, *pair) for pair in zip(edges_ms, counts, strict=False)]
    columns = ["afferent", "frequency_hz", "amplitude_um", "phase_ms", "spikes"]
    return DataFrame(rows, columns=columns)


def _phases(table: "DataFrame", model_on_response: ModelOnResponse) -> "DataFrame":
    """Shares of the spikes per phase bin of the cycle, recorded and of the model."""
    from pandas import DataFrame

    rows = []
    keys = ["afferent", "frequency_hz", "amplitude_um"]
    groups: list[tuple[Any, Any]] = [*table.groupby(keys, sort=False)]
    for key, bins in groups:
        cells_ms, _ = model_on_response.vibration_spikes_ms(dict(zip(keys, key, strict=True)))
        pooled_ms, cycle_ms = np.concatenate(cells_ms), 1000.0 / key[1]
        starts_ms, recorded = (bins[name].to_numpy(float) for name in ("phase_ms", "spikes"))
        counts, _ = np.histogram(pooled_ms % cycle_ms, bins=[*starts_ms, cycle_ms])
        shares = (spikes / max(spikes.sum(), 1) for spikes in (recorded, counts))
        rows += [(*key, *row) for row in zip(starts_ms, *shares, strict=True)]
    return DataFrame(rows, columns=[*keys, "phase_ms", "recorded", "model"])


def _human(table: "DataFrame", model_on_response: ModelOnResponse) -> "DataFrame":
    """Impulses per cycle of human units and of the model, up to the depth of its response."""
    response, model = model_on_response
    table = table[table["amplitude_um"] <= response.deepest_um - model.preindent_um]
    table = table.reset_index(drop=True)
    return table.assign(model=_with_model(table, model_on_response)["model_impulses_per_cycle"])


def _distance(table: "DataFrame", parameters: Parameters, skin: "Pad | None" = None) -> "DataFrame":
    """Amplitude for one impulse per cycle at a distance from a pin on the whole fingertip.

    `model_um` is that of RA's median cell, `most_sensitive_um` that of its most sensitive cell; NaN
    where the largest amplitude does not suffice.
    """
    from scipy.stats import norm

    from fembridge.touching.pad_file import resolve_pad
    from fembridge.touching.population import Population
    from fembridge.touching.shape import Shape
    from fembridge.touching.touch import touch_skin
    from fembridge.touching.trajectory import Trajectory
    from neural.parameter_sets import ParameterSet

    pad, pin = skin or resolve_pad("reference"), Shape.punch(_PIN_MM)
    # A line of median cells and a line of most sensitive cells.
    half_length_mm = min(8.0, pad.half_length_mm)
    units = Population.line(0.25, half_length_mm, afferents=("RA", "RA"), finger=pad)
    most_sensitive = norm.ppf(0.5 / parameters["RA"].cells)
    units = replace(units, deviate=np.repeat([0.0, most_sensitive], len(units) // 2))
    window_ms = (2000.0 / _PIN_HZ, 10_000.0 / _PIN_HZ)
    times_ms = np.arange(round(window_ms[1] / DT_MS) + 1) * DT_MS
    wave = np.sin(2e-3 * np.pi * _PIN_HZ * times_ms)
    trajectories = [
        Trajectory(
            _PIN_DEPTH_UM + amplitude_um * wave, dt_ms=DT_MS, window_ms=window_ms, name="sine"
        )
        for amplitude_um in _PIN_UM
    ]
    with warnings.catch_warnings():  # the largest amplitude ends 8 % beyond the trusted depth
        warnings.simplefilter("ignore", FembridgeWarning)
        touches = [
            touch_skin(pad, pin, trajectory, units, ParameterSet("model", parameters))
            for trajectory in trajectories
        ]
    reached = [touch.rate_ips >= 0.99 * _PIN_HZ for touch in touches]
    threshold_um = np.where(np.any(reached, axis=0), _PIN_UM[np.argmax(reached, axis=0)], np.nan)
    median_um, most_sensitive_um = (
        np.interp(table["distance_mm"], z_mm, line_um, right=np.nan)
        for z_mm, line_um in zip(np.split(units.z_mm, 2), np.split(threshold_um, 2), strict=True)
    )
    return table.assign(model_um=median_um, most_sensitive_um=most_sensitive_um)
