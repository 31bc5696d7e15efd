"""A model beside what is known of real afferents: timing, thresholds, man, distance, ramp.

Each table is made of a table of published facts, `fembridge.evidence`, or of a user's in
its place, and of a model under the same stimuli by the response map. The parameters of
the whole fingertip are held to timing and thresholds too; the distance from a probe is
theirs alone.
"""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from decks.stimuli import DT_MS, Ramp, Sine, resolve
from decks.waveform import make_stimulus
from fembridge.errors import FembridgeWarning
from fembridge.evidence import (
    DISTANCE,
    MAN,
    PHASES,
    THRESHOLDS,
    TIMING,
    TIMING_COLUMNS,
    Facts,
    published,
    published_timing,
)
from fembridge.response.response_map import ResponseMap
from fembridge.stimulus import Stimulus
from fembridge.tables import AFFERENTS, SpikeTrain
from fembridge.tuning import against_evidence, thresholds, vibration
from fembridge.typing import FloatArray
from neural import ParameterSet
from neural.encoder import encode_cells
from neural.parameters import Parameters
from neural.timing import vector_strength

if TYPE_CHECKING:
    from pandas import DataFrame

# Within these bounds the timing of a model passes for that of a recorded unit.
STRENGTH_APART, IMPULSES_APART = 0.25, 0.30
# So many cells of a class are asked for the one that is most like a recorded unit.
_UNITS = 200

# From first touch 300 um deep at 3 mm/s, held for half a second, and back.
RAMP = Ramp(depth_um=300, up_ms=100, hold_ms=500, down_ms=100)

# Of the curves, in Hz, beside the frequencies that were recorded.
CURVE_HZ = (2.0, 5.0, 10.0, 20.0, 40.0, 80.0, 125.0, 200.0, 250.0, 315.0, 400.0, 500.0, 800.0)

# Of Johnson (1974), Fig. 7, and amplitudes that are tried.
_PIN_MM, _PIN_HZ, _PIN_DEEP_UM = 2.0, 40.0, 550.0
_PIN_UM = np.geomspace(15.0, 900.0, 24)

_NUMBERS = TIMING_COLUMNS[3:]
_PHASE_BINS, _PHASE_PANELS = 10, 2


class Answering(NamedTuple):
    """Parameters, and the response that they answer on."""

    response: ResponseMap
    model: ParameterSet

    def spikes(self, afferent: str, stimulus: Stimulus, units: int = 0) -> list[FloatArray]:
        """Spikes of each cell of a class, or of so many `units` that differ as those do."""
        parameters = self.model.parameters[afferent]
        if units and parameters.cells > 1:
            parameters = replace(parameters, cells=units)
        stress_pa = self.response.stress_pa(parameters, [stimulus])
        [cells] = encode_cells(stress_pa, stimulus.dt_ms, parameters)
        return cells

    def vibrated(
        self, row: Mapping[Any, Any], units: int = 0
    ) -> tuple[list[FloatArray], tuple[float, float]]:
        """Those under the vibration of a row, and the window of its whole cycles."""
        frequency_hz = row["frequency_hz"]
        stimulus = vibration(frequency_hz, row["amplitude_um"], self.model.preindent_um)
        cycles = np.floor(stimulus.window_ms[1] * frequency_hz / 1000.0 + 1e-9)
        window_ms = (0.0, cycles * 1000.0 / frequency_hz)
        return self.spikes(row["afferent"], stimulus, units), window_ms


@dataclass(frozen=True, slots=True, eq=False)
class Beside:
    """Timing and thresholds of parameters on a response, beside recorded ones.

    `timing` has a row a class and vibration: what was recorded, the model's impulses a
    cycle and vector strengths over all cells, the impulses of the cell of the class that is
    most like the recorded unit, that cell's place, and whether they are near enough.
    `tuning` are recorded thresholds with the model's, `curves` the model's.
    """

    timing: "DataFrame"
    tuning: "DataFrame"
    curves: "DataFrame"


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """The judged model, and the parameters of the whole `fingertip`, beside recorded afferents.

    `phases` are shares of the spikes by phase of the cycle, `man` are impulses a cycle in
    man, `distance` amplitudes of RA away from a probe, `ramp` spikes under
    `ramp_stimulus`. `sources` say of each set, by name, what it holds and where it is from,
    `trains` are a user's recorded spikes.
    """

    judged: Beside
    fingertip: Beside
    phases: "DataFrame"
    man: "DataFrame"
    distance: "DataFrame"
    ramp: tuple[SpikeTrain, ...]
    ramp_stimulus: Stimulus
    sources: Mapping[str, str]
    trains: tuple[SpikeTrain, ...] = ()


def gather(
    judged: Answering,
    fingertip: Answering,
    own: Mapping[str, Facts] | None = None,
    trains: Sequence[SpikeTrain] = (),
) -> Evidence:
    """Everything that is known, and the model under the same stimuli.

    `own` tables stand in the place of the published ones of their names, and recorded
    `trains` in that of the published timing.
    """
    own = own or {}
    known = {
        name: own.get(name) or published(name)
        for name in (THRESHOLDS, TIMING, PHASES, MAN, DISTANCE)
    }
    recorded = timing_of(trains) if trains else published_timing()
    phases = phases_of(trains) if trains else known[PHASES].table.assign(frequency_hz=20.0)
    ramp = make_stimulus(RAMP)
    sources = {name: facts.source for name, facts in known.items()}
    if trains:
        sources |= dict.fromkeys((TIMING, PHASES), "Recorded: the spikes that were given.")
    asked = known[THRESHOLDS].table
    return Evidence(
        judged=_beside_recorded(judged, recorded, asked),
        fingertip=_beside_recorded(fingertip, recorded, asked),
        phases=_phases(phases, judged),
        man=_man(known[MAN].table, judged),
        distance=_distance(known[DISTANCE].table, fingertip.model.parameters),
        ramp=tuple(
            SpikeTrain(ramp.id, name, times_ms, repeat)
            for name in AFFERENTS
            for repeat, times_ms in enumerate(judged.spikes(name, ramp), start=1)
        ),
        ramp_stimulus=ramp,
        sources=sources,
        trains=tuple(trains),
    )


def _beside_recorded(answering: Answering, recorded: "DataFrame", asked: "DataFrame") -> Beside:
    """Timing under `recorded` vibrations; thresholds, also at the frequencies `asked` for."""
    from pandas import concat

    response, model = answering
    found = []
    for name in AFFERENTS:
        hz = sorted({*CURVE_HZ, *asked.frequency_hz[asked.afferent == name]})
        found.append(thresholds(response, model.parameters[name], hz, model.preindent_um))
    curves = concat(found, ignore_index=True)
    return Beside(_timing(recorded, answering), against_evidence(curves, asked), curves)


def timing_of(trains: Sequence[SpikeTrain]) -> "DataFrame":
    """Timing of recorded spikes under sinusoids: a row a class and stimulus.

    Impulses a cycle are the mean over trains, vector strengths those of all spikes, in
    the window of the stimulus.
    """
    from pandas import DataFrame

    rows = [
        (
            name,
            sine.frequency_hz,
            sine.amplitude_um,
            *_numbers(mine, sine.frequency_hz, sine.window_ms),
        )
        for (name, sine), mine in _under_sines(trains).items()
    ]
    return DataFrame(rows, columns=list(TIMING_COLUMNS))


def _under_sines(trains: Sequence[SpikeTrain]) -> dict[tuple[str, Sine], list[FloatArray]]:
    """Spikes in ms of each train, by class and sinusoid; of other stimuli none."""
    found: dict[tuple[str, Sine], list[FloatArray]] = {}
    for train in trains:
        if isinstance(entry := resolve(train.stimulus)[0], Sine):
            found.setdefault((train.afferent, entry), []).append(train.times_ms)
    return found


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


def _beside(recorded: "DataFrame", answering: Answering) -> "DataFrame":
    """`recorded` vibrations with the model's numbers beside them, in as many whole cycles."""
    from pandas import DataFrame

    rows = []
    for row in recorded.to_dict("records"):
        cells, window_ms = answering.vibrated(row)
        rows.append(_numbers(cells, row["frequency_hz"], window_ms))
    return recorded.join(DataFrame(rows, recorded.index, [f"model_{name}" for name in _NUMBERS]))


def _timing(recorded: "DataFrame", answering: Answering) -> "DataFrame":
    """`_beside` with the cell that is most like the recorded unit of each class."""
    found = _beside(recorded, answering)
    impulses = _NUMBERS[0]
    for _, unit in recorded.groupby("afferent"):
        of_cells = []
        for row in unit.to_dict("records"):
            cells, window_ms = answering.vibrated(row, _UNITS)
            of_cells.append([_numbers([one], row["frequency_hz"], window_ms)[0] for one in cells])
        theirs = unit[impulses].to_numpy()[:, np.newaxis]
        apart = abs(np.array(of_cells) - theirs) / np.maximum(theirs, 0.1)
        most_alike = int(apart.sum(axis=0).argmin())
        found.loc[unit.index, "model_unit_impulses"] = [row[most_alike] for row in of_cells]
        found.loc[unit.index, "model_unit_place"] = (most_alike + 0.5) / apart.shape[1]
    first, second = (abs(found[f"model_{name}"] - found[name]) for name in _NUMBERS[1:])
    share = found["model_unit_impulses"] / found[impulses]
    return found.assign(  # NaN is not near
        strengths_near=np.maximum(first, second) <= STRENGTH_APART,
        impulses_near=abs(share - 1) <= IMPULSES_APART,
    )


def phases_of(trains: Sequence[SpikeTrain]) -> "DataFrame":
    """Recorded spikes by phase of the cycle, of the two strongest sinusoids of each class.

    Columns are those of the set ``timing_20hz_phase`` and ``frequency_hz``.
    """
    from pandas import DataFrame

    rows = []
    found = _under_sines(trains)
    for afferent in AFFERENTS:
        sines = [sine for name, sine in found if name == afferent]
        for sine in sorted(sines, key=lambda one: one.amplitude_um)[-_PHASE_PANELS:]:
            cycle_ms = 1000.0 / sine.frequency_hz
            edges_ms = np.linspace(0.0, cycle_ms, _PHASE_BINS + 1)
            together = np.concatenate(found[afferent, sine])
            counts, _ = np.histogram(together % cycle_ms, bins=edges_ms)
            key = (afferent, sine.frequency_hz, sine.amplitude_um)
            rows += [(*key, *pair) for pair in zip(edges_ms, counts, strict=False)]
    columns = ["afferent", "frequency_hz", "amplitude_um", "phase_ms", "spikes"]
    return DataFrame(rows, columns=columns)


def _phases(table: "DataFrame", answering: Answering) -> "DataFrame":
    """Shares of the spikes in bins of the cycle, recorded and of the model."""
    from pandas import DataFrame

    found = []
    keys = ["afferent", "frequency_hz", "amplitude_um"]
    groups: list[tuple[Any, Any]] = [*table.groupby(keys, sort=False)]
    for key, mine in groups:
        cells, _ = answering.vibrated(dict(zip(keys, key, strict=True)))
        together, cycle_ms = np.concatenate(cells), 1000.0 / key[1]
        starts_ms, recorded = (mine[name].to_numpy(float) for name in ("phase_ms", "spikes"))
        counts, _ = np.histogram(together % cycle_ms, bins=[*starts_ms, cycle_ms])
        shares = (one / max(one.sum(), 1) for one in (recorded, counts))
        found += [(*key, *row) for row in zip(starts_ms, *shares, strict=True)]
    return DataFrame(found, columns=[*keys, "phase_ms", "recorded", "model"])


def _man(table: "DataFrame", answering: Answering) -> "DataFrame":
    """Impulses a cycle in man and of the model, as far as its response reaches."""
    deepest_um = answering.response.deepest_um - answering.model.preindent_um
    table = table[table["amplitude_um"] <= deepest_um].reset_index(drop=True)
    return table.assign(model=_beside(table, answering)["model_impulses_per_cycle"])


def _distance(table: "DataFrame", parameters: Parameters) -> "DataFrame":
    """Amplitude for one impulse a cycle at a distance from a pin on the whole fingertip.

    `model_um` is of the median unit, `keenest_um` of the keenest cell of RA; NaN where the
    largest amplitude is not enough.
    """
    from scipy.stats import norm

    from fembridge.touching.pad import pad_named
    from fembridge.touching.population import Population
    from fembridge.touching.shape import Shape
    from fembridge.touching.touch import touch_skin
    from fembridge.touching.way import Way

    # A line of median units and one of keenest ones.
    units = Population.line(step_mm=0.25, half_length_mm=8.0, afferents=("RA", "RA"))
    keenest = norm.ppf(0.5 / parameters["RA"].cells)
    units = replace(units, deviate=np.repeat([0.0, keenest], len(units) // 2))
    window_ms = (2000.0 / _PIN_HZ, 10_000.0 / _PIN_HZ)
    times_ms = np.arange(round(window_ms[1] / DT_MS) + 1) * DT_MS
    wave = np.sin(2e-3 * np.pi * _PIN_HZ * times_ms)
    pad, pin = pad_named("reference"), Shape.punch(_PIN_MM)
    ways = [Way("sine", DT_MS, window_ms, _PIN_DEEP_UM + one_um * wave) for one_um in _PIN_UM]
    with warnings.catch_warnings():  # the largest amplitude ends 8 % beyond the trusted depth
        warnings.simplefilter("ignore", FembridgeWarning)
        touched = [touch_skin(pad, pin, way, units, parameters) for way in ways]
    reached = [one.rate_ips >= 0.99 * _PIN_HZ for one in touched]
    least_um = np.where(np.any(reached, axis=0), _PIN_UM[np.argmax(reached, axis=0)], np.nan)
    median, keen = (
        np.interp(table["distance_mm"], *each)
        for each in zip(np.split(units.z_mm, 2), np.split(least_um, 2), strict=True)
    )
    return table.assign(model_um=median, keenest_um=keen)
