"""Compute the tables of ``fembridge/evidence/touchsim`` with TouchSim.

``python -m benchmarks.touchsim_rates -o FOLDER [TABLE ...]`` with TouchSim
(<https://github.com/hsaal/touchsim>, 0.1.1) on PYTHONPATH writes one CSV file per table into
FOLDER; ten minutes on one core. A recent NumPy requires ``np.bool_`` instead of ``np.bool``
in ``transduction.py``; with ``target="cpu"`` instead of ``"parallel"`` there, the noise can be
seeded.

Each class is all TouchSim models of that class at the same place; a number is the mean over
models (of thresholds and amplitudes the median). Rates and impulses have TouchSim's noise on the
membrane, five trials; searches for an amplitude are without noise.
"""

import argparse
import math
from pathlib import Path

import numpy as np
import pandas
from numba import njit
from touchsim import transduction
from touchsim.classes import Afferent, AfferentPopulation, Stimulus

from decks.stimuli import CATALOGUE, resolve
from decks.synthesis import make_stimulus
from fembridge.evidence import DISTANCE, HUMAN, THRESHOLDS, TIMING, published
from neural.timing import vector_strength

RATE_HZ = 5000.0
"""Sampling rate of TouchSim's neurons."""
CLASSES = {"SA": "SA1", "RA": "RA", "PC": "PC"}
MODELS = {"SA": 4, "RA": 9, "PC": 4}
TRIALS, SEED = 5, 1
PIN_RADIUS_MM = 0.5
PIN_STEP_MM = 0.25
"""Distance of the pins that make a shape."""
# Sinusoids between those of the catalogue, at its range of levels.
TEXTURES = [f"grating_{p}" for p in (1, 3, 5, 8, 12)] + [f"dots_{p}" for p in (2, 3, 4, 5, 6)]
FURTHER_HZ = (30, 150, 250)
FURTHER_UM = {30: (25 / 3, 250.0), 150: (5.0, 150.0), 250: (7 / 3, 70.0)}


def pressed(places_mm, radius_mm, forces, rates):
    """Stimulus of pins with given forces ``(T, pin)`` instead of depths."""
    stimulus = Stimulus.__new__(Stimulus)  # TouchSim refuses subclasses
    stimulus.location, stimulus.pin_radius, stimulus.fs = places_mm, radius_mm, RATE_HZ
    stimulus._profile, stimulus._profiledyn = forces, rates
    stimulus.trace = np.zeros((len(places_mm), len(forces)))
    return stimulus


@njit
def seed_noise(seed):
    np.random.seed(seed)  # noqa: NPY002 - numba's generator, which TouchSim uses


def units(name, places_mm=((0.0, 0.0),), noisy=True):
    """All models of a class at each place, place by place."""
    return AfferentPopulation(
        *(
            Afferent(CLASSES[name], idx=model, location=np.array(place), noisy=noisy)
            for place in places_mm
            for model in range(MODELS[name])
        )
    )


def pin(depth_um, radius_mm=PIN_RADIUS_MM, places_mm=((0.0, 0.0),)):
    """Pins pressed to a depth ``(T,)`` together, sampled at RATE_HZ."""
    depth_mm = np.tile(np.asarray(depth_um) / 1e3, (len(places_mm), 1))
    location = np.asarray(places_mm, float)
    return Stimulus(trace=depth_mm, location=location, fs=RATE_HZ, pin_radius=radius_mm)


def spikes_ms(population, stimulus, trials=TRIALS):
    """Spike times in ms of each unit and trial, ``[trial][unit]``."""
    seed_noise(SEED)
    return [[1e3 * times for times in population.response(stimulus).spikes] for _ in range(trials)]


def counts(trains, window_ms):
    """Mean count of each unit over trials, ``(unit,)``."""
    start, end = window_ms
    each = [[np.sum((t > start) & (t <= end)) for t in trial] for trial in trains]
    return np.mean(each, axis=0)


def vibrations():
    """The catalogue's waveforms without pre-indentation, in the window of the observed spikes."""
    entries = list(CATALOGUE)
    for hz in FURTHER_HZ:
        levels = np.geomspace(*FURTHER_UM[hz], 10)
        entries += [resolve(f"sine_{hz}_{float(f'{level:.4g}'):g}")[0] for level in levels]
    rows = []
    for entry in entries:
        wave = pin(make_stimulus(entry, 0.0, dt_ms=0.1).displacement_um[::2])
        start, end = entry.window_ms
        for name in CLASSES:
            rates = 1e3 * counts(spikes_ms(units(name), wave), entry.window_ms) / (end - start)
            rows.append((entry.id, name, rates.mean(), rates.std(ddof=1)))
    return pandas.DataFrame(rows, columns=["stimulus", "afferent", "rate_ips", "rate_sd_ips"])


def sine_um(hz, amplitude_um, duration_ms):
    times_s = np.arange(round(duration_ms / 1e3 * RATE_HZ)) / RATE_HZ
    return amplitude_um * np.sin(2 * np.pi * hz * times_s)


def least_um(needed, reaches):
    """Smallest amplitude of each model at which it fires `needed` times; infinite if none does.

    A first pass of 28 amplitudes from 0.01 um to 1 mm, then halvings.
    """
    first = np.geomspace(0.01, 1000.0, 28)
    table = np.array([reaches(amplitude) >= needed for amplitude in first])
    result = []
    for model in range(table.shape[1]):
        if not table[:, model].any():
            result.append(math.inf)
            continue
        row = int(table[:, model].argmax())
        low, high = first[max(row - 1, 0)], first[row]
        for _ in range(6):
            middle = math.sqrt(low * high)
            low, high = (low, middle) if reaches(middle)[model] >= needed else (middle, high)
        result.append(high)
    return np.array(result)


def thresholds():
    """As `fembridge threshold`: phase 0, 100 ms or five cycles, whichever is longer."""
    rows = []
    table = published(THRESHOLDS).table
    for row in table[["afferent", "criterion", "frequency_hz"]].itertuples(index=False):
        duration_ms = max(100.0, 5e3 / row.frequency_hz)
        cycles = math.floor(duration_ms * row.frequency_hz / 1e3 + 1e-9)
        needed = 1 if row.criterion == "absolute" else cycles - 1
        population = units(row.afferent, noisy=False)

        def reaches(amplitude_um, population=population, hz=row.frequency_hz, ms=duration_ms):
            wave = pin(sine_um(hz, amplitude_um, ms))
            return counts(spikes_ms(population, wave, 1), (0.0, ms + 20.0))

        model_um = least_um(needed, reaches)
        rows.append((*row, np.median(model_um), model_um.min(), model_um.max()))
    columns = ["amplitude_um", "most_sensitive_um", "least_sensitive_um"]
    return pandas.DataFrame(rows, columns=["afferent", "criterion", "frequency_hz", *columns])


def timing():
    """Impulses per cycle and vector strengths at 20 Hz, whole cycles, spikes of all models."""
    rows = []
    for row in published(TIMING).table.itertuples(index=False):
        wave = pin(sine_um(20.0, row.amplitude_um, 250.0))
        trains = spikes_ms(units(row.afferent), wave)
        pooled = np.concatenate([times for trial in trains for times in trial])
        pooled = pooled[pooled <= 250.0]
        per_cycle = pooled.size / (5 * TRIALS * MODELS[row.afferent])
        strengths = (vector_strength(pooled, hz) for hz in (20.0, 40.0))
        rows.append((row.afferent, row.amplitude_um, per_cycle, *strengths))
    columns = ["impulses_per_cycle", "vector_strength_20hz", "vector_strength_40hz"]
    return pandas.DataFrame(rows, columns=["afferent", "amplitude_um", *columns])


def disc(radius_mm, step_mm=PIN_STEP_MM):
    """Places of pins in a disc, ``(N, 2)``."""
    axis = np.arange(-math.floor(radius_mm / step_mm), radius_mm / step_mm) * step_mm
    x, y = (grid.ravel() for grid in np.meshgrid(axis, axis))
    inside = np.hypot(x, y) <= radius_mm + 1e-9
    return np.column_stack([x, y])[inside]


def impulses():
    """Johansson et al. 1982: a probe of 6 mm moves only upward from a depth of 0.6 mm."""
    rows, places = [], disc(3.0, 0.5)
    press_ms = 1000.0
    for row in published(HUMAN).table.itertuples(index=False):
        duration_ms = max(500.0, 10e3 / row.frequency_hz)
        times_s = np.arange(round(duration_ms / 1e3 * RATE_HZ)) / RATE_HZ
        lifted = row.amplitude_um * 0.5 * (1 - np.cos(2 * np.pi * row.frequency_hz * times_s))
        ramp = np.minimum(np.arange(round(press_ms / 1e3 * RATE_HZ)) / (0.1 * RATE_HZ), 1.0)
        depth = np.concatenate([600.0 * ramp, 600.0 - lifted])
        wave = pin(depth, 0.25, places)
        cycles = duration_ms * row.frequency_hz / 1e3
        count = counts(spikes_ms(units(row.afferent), wave), (press_ms, press_ms + duration_ms))
        rows.append((row.afferent, row.frequency_hz, row.amplitude_um, count.mean() / cycles))
    columns = ["afferent", "frequency_hz", "amplitude_um", "impulses_per_cycle"]
    return pandas.DataFrame(rows, columns=columns)


def distance():
    """Johnson 1974, Fig. 7: pin of 2 mm, 0.55 mm deep, 40 Hz; whole cycles from 550 ms."""
    rows = []
    ramp = 550.0 * np.minimum(np.arange(2500) / 250.0, 1.0)
    for row in published(DISTANCE).table.itertuples(index=False):
        population = units("RA", ((row.distance_mm, 0.0),), noisy=False)

        def reaches(amplitude_um, population=population):
            wave = pin(np.concatenate([ramp, 550.0 + sine_um(40.0, amplitude_um, 300.0)]), 1.0)
            return counts(spikes_ms(population, wave, 1), (550.0, 800.0))

        model_um = least_um(10 - 0.1, reaches)
        rows.append((row.distance_mm, np.median(model_um), model_um.min()))
    return pandas.DataFrame(rows, columns=["distance_mm", "amplitude_um", "most_sensitive_um"])


def ramp_um(depth_mm, speed_mm_per_s, hold_ms):
    up = np.arange(0.0, depth_mm / speed_mm_per_s, 1 / RATE_HZ) * speed_mm_per_s * 1e3
    rest = np.zeros(round(0.05 * RATE_HZ))
    return np.concatenate([rest, up, np.full(round(hold_ms / 1e3 * RATE_HZ), depth_mm * 1e3)])


def ramps_sa():
    """Ramp at 40 mm/s and hold, pin of 2 mm: rates in four windows from first touch."""
    rows = []
    for depth_mm in np.round(np.arange(0.2, 2.01, 0.2), 1):
        trains = spikes_ms(units("SA"), pin(ramp_um(depth_mm, 40.0, 1100.0), 1.0))
        windows = ((0, 100), (100, 200), (200, 500), (500, 1000))
        rates = [
            1e3 * counts(trains, (50.0 + start, 50.0 + end)).mean() / (end - start)
            for start, end in windows
        ]
        rows.append((depth_mm, *rates))
    columns = ["depth_mm", "rate_0_100", "rate_100_200", "rate_200_500", "rate_500_1000"]
    return pandas.DataFrame(rows, columns=columns)


def ramps_ra():
    """Impulses of RA on a ramp, pin of 2 mm, up to 10 ms after its end."""
    rows = []
    for depth_mm in (0.5, 1.0, 1.5, 2.0):
        for speed in np.geomspace(1.0, 100.0, 13):
            trains = spikes_ms(units("RA"), pin(ramp_um(depth_mm, speed, 100.0), 1.0))
            end_ms = 60.0 + 1e3 * depth_mm / speed
            rows.append((depth_mm, float(f"{speed:.4g}"), counts(trains, (50.0, end_ms)).mean()))
    return pandas.DataFrame(rows, columns=["depth_mm", "speed_mm_per_s", "impulses"])


def fields():
    """A probe of 0.5 mm, ramp of 20 ms and hold of 100 ms, 4.5 times the threshold of each model.

    The half-space is the same everywhere, so the field is a disc; its radius by halvings.
    """
    ramp = np.minimum(np.arange(600) / 100.0, 1.0)
    rows = []
    for name, models in MODELS.items():

        def fired(depth_um, away_mm=0.0, name=name):
            population = units(name, ((away_mm, 0.0),), noisy=False)
            return counts(spikes_ms(population, pin(depth_um * ramp, 0.25), 1), (0.0, 140.0))

        threshold_um = least_um(1, fired)
        for model in range(models):
            if not np.isfinite(threshold_um[model]):
                continue
            low, high = 0.0, 60.0
            for _ in range(14):
                middle = 0.5 * (low + high)
                inside = fired(4.5 * threshold_um[model], middle)[model] >= 1
                low, high = (middle, high) if inside else (low, middle)
            rows.append((name, model, threshold_um[model], math.pi * low**2))
    return pandas.DataFrame(rows, columns=["afferent", "model", "threshold_um", "area_mm2"])


def bar_pins(from_mm, to_mm):
    """Places of the pins that fill a bar across 8 mm."""
    count = round((to_mm - from_mm) / PIN_STEP_MM)
    across = from_mm + (np.arange(count) + 0.5) * PIN_STEP_MM
    along = (np.arange(32) - 15.5) * PIN_STEP_MM
    x, y = np.meshgrid(across, along)
    return np.column_stack([x.ravel(), y.ravel()])


def bars():
    """SA at 0 to 4 mm from the middle of bars, and of gaps between bars of 4 mm, 1 mm deep.

    Pins 0.25 mm apart over 8 mm of the length; ramp of 50 ms and hold of 500 ms.
    """
    positions = np.arange(0.0, 4.01, 0.5)
    ramp = 1000.0 * np.concatenate([np.arange(250) / 250.0, np.ones(2500)])
    population = units("SA", [(position, 0.0) for position in positions])
    rows = []
    for width in (0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 5.0):
        for kind in ("bar", "gap"):
            half = 0.5 * width
            if kind == "bar":
                places = bar_pins(-half, half)
            else:
                beside = bar_pins(half, half + 4.0)
                places = np.concatenate([beside, -beside])
            trains = spikes_ms(population, pin(ramp, 0.5 * PIN_STEP_MM, places))
            rates = 1e3 * counts(trains, (50.0, 550.0)) / 500.0
            for position, rate in zip(positions, rates.reshape(-1, 4).mean(axis=1), strict=True):
                rows.append((kind, width, position, rate))
    return pandas.DataFrame(rows, columns=["shape", "width_mm", "position_mm", "rate_ips"])


def height_mm(kind, period, x, y):
    """Height of a texture above its highest points, at most 0."""
    if kind == "grating":
        return np.where(np.abs((x + 0.5 * period) % period - 0.5 * period) < period / 4, -0.5, 0.0)
    half = 0.5 * period
    away = np.hypot((x + half) % period - half, (y + half) % period - half)
    return np.where(away <= 0.25, 0.0, -0.4)


def pressures(heights_mm, places, offset_mm):
    """Forces in N ``(phase, pin)`` of a texture whose top is `offset_mm` deep."""
    depth = np.maximum(offset_mm + heights_mm, 0.0)
    forces, _ = transduction.skin_touch_profile(depth, places, RATE_HZ, 0.5 * PIN_STEP_MM)
    return forces


def textures(press_n=0.3, names=TEXTURES):
    """Gratings and dots of Weber et al. 2013, scanned at 40, 80 and 120 mm/s.

    Pins 0.25 mm apart in a disc of 4 mm radius, each as high as the texture on the average over its
    width along the scan (without this mean, edges jump from pin to pin); the depth is constant,
    such that the mean force is 0.3 N (Young's modulus 50 kPa of TouchSim). Models at 15 places of
    2 x 3 mm; 600 ms after 400 ms.
    """
    places = disc(4.0)
    x, y = np.meshgrid(np.arange(-1.5, 1.6, 0.75), np.arange(-1, 1.1))
    spots = np.column_stack([x.ravel(), y.ravel()])
    distance_mm = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))
    radius_mm = 0.5 * PIN_STEP_MM
    with np.errstate(divide="ignore", invalid="ignore"):
        skin = (1 - 0.4**2) / np.pi / radius_mm * np.arcsin(radius_mm / distance_mm) / 0.05
    skin[distance_mm <= radius_mm] = (1 - 0.4**2) / 2 / radius_mm / 0.05
    rows = []
    for name in names:
        kind, period = name.split("_")[0], float(name.split("_")[1])
        phases = np.arange(0.0, period, 0.025)
        moved = places[:, :1] - phases  # (pin, phase): the texture moves towards +x
        across = (np.arange(5) - 2) / 5 * PIN_STEP_MM
        heights = np.mean(
            [height_mm(kind, period, moved + step, places[:, 1:]) for step in across], axis=0
        )
        low, high, some = 0.0, 3.0, slice(None, None, max(1, phases.size // 12))
        for _ in range(9):
            middle = 0.5 * (low + high)
            mean_n = pressures(heights[:, some], places, middle).sum(axis=1).mean()
            low, high = (middle, high) if mean_n < press_n else (low, middle)
        forces = pressures(heights, places, high)
        print(f"{name}: {1e3 * high:.0f} um deep, {forces.sum(axis=1).mean():.3f} N", flush=True)
        for speed in (40.0, 80.0, 120.0):
            place = speed * np.arange(round(1.0 * RATE_HZ)) / RATE_HZ / 0.025
            first = place.astype(int)
            share = (place - first)[:, None]
            at = (1 - share) * forces[first % len(forces)] + share * forces[
                (first + 1) % len(forces)
            ]
            at *= np.minimum(np.arange(len(at)) / (0.05 * RATE_HZ), 1.0)[:, None]
            profile = at @ skin
            rates = np.gradient(profile, 1 / RATE_HZ, axis=0)
            stimulus = pressed(places, radius_mm, at, np.linalg.solve(skin, rates.T))
            for afferent in CLASSES:
                trains = spikes_ms(units(afferent, spots), stimulus, 2)
                rate = 1e3 * counts(trains, (400.0, 1000.0)).mean() / 600.0
                rows.append((speed, name, afferent, rate))
    return pandas.DataFrame(rows, columns=["speed_mm_per_s", "shape", "afferent", "rate_ips"])


TABLES = {
    function.__name__: function
    for function in (
        vibrations, thresholds, timing, impulses, distance, ramps_sa, ramps_ra, fields, bars,
        textures,
    )
}  # fmt: skip


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("tables", nargs="*", metavar="TABLE", default=list(TABLES))
    parser.add_argument("-o", dest="folder", type=Path, required=True)
    args = parser.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    for name in args.tables:
        table = TABLES[name]().round(3)
        table.to_csv(args.folder / f"{name}.csv", index=False, lineterminator="\n")
        print(f"{name}: {len(table)} rows", flush=True)


if __name__ == "__main__":
    main()
