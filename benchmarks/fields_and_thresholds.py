"""Receptive fields and thresholds of populations, and what stands between them and recordings.

``python -m benchmarks.fields_and_thresholds [OBSERVED.csv]``: areas, hot spots and thresholds on
free skin and under an array of probes (Vega-Bermudez & Johnson 1999); force and stress by um of
probes of several diameters; thresholds by the duration of the ramp; and, with a table of observed
rates of sinusoids (``stimulus,afferent,rate_ips``), the error of the mean rate of populations
whose sensitivities are shifted or spread otherwise.
"""

import sys

import numpy as np
import pandas

import fembridge as fb
from fembridge.io.waveform import resolve_stimuli
from fembridge.touching.contact import press_to
from fembridge.touching.pad_file import resolve_pad
from fembridge.touching.population import Population
from fembridge.touching.shape import Shape
from fembridge.touching.stress import driving_stress_pa, interpolate_states
from neural import parameter_set
from neural.encoder import encode_units
from neural.parameters import quantiles

PAD = resolve_pad("reference")
PARAMETERS = parameter_set("fitted_pad").parameters
CLASSES = ("SA", "RA", "PC")
DT_MS = 0.1


def fields():
    for name in CLASSES:
        print(fb.receptive_field(name).summary.to_string(index=False))
    for name in CLASSES[:2]:
        field = fb.receptive_field(
            name, background_um=1500, depth_um=[50, 100, 200, 500], times_threshold=[]
        )
        print(f"{name} under an array of probes, 1.5 mm deep:")
        print(field.summary.to_string(index=False))
        means = field.areas.groupby("depth_um")["area_mm2"].mean()
        print("  mean areas:", ", ".join(f"{um:g} um {mm2:.1f}" for um, mm2 in means.items()))


def stiffness():
    units = Population.one_each().with_endings(0.0)
    for diameter_mm in (0.5, 1.0, 2.0):
        nodes, forces, _ = press_to(PAD, Shape.punch(diameter_mm), np.array([50.0]))
        stress, force_mn = driving_stress_pa(PAD, nodes, forces, units)[0], 1e3 * forces.sum()
        print(
            f"probe {diameter_mm:g} mm, 50 um deep: {force_mn / 50:.3f} mN/um; SA, RA, PC "
            f"{(stress / 50).round(1)} Pa/um, {(stress / force_mn).round(0)} Pa/mN"
        )


def ramps():
    level_um = 2000 * (np.arange(41) / 40) ** 2
    nodes, forces, _ = press_to(PAD, Shape.punch(0.5), level_um)
    force_mn = 1e3 * forces.sum(axis=1)
    depths = np.geomspace(5, 200, 150)
    for name in CLASSES:
        units = Population.one_each(afferents=(name,)).with_endings(0.0)
        stress = driving_stress_pa(PAD, nodes, forces, units)[:, 0]
        found = []
        for ramp_ms in (40.0, 20.0, 10.0, 5.0, 2.0, 1.0):
            ramp = 0.5 * (1 - np.cos(np.pi * np.arange(round(ramp_ms / DT_MS)) * DT_MS / ramp_ms))
            wave = np.concatenate([np.zeros(100), ramp, np.ones(1001), ramp[::-1], np.zeros(100)])
            trace = interpolate_states(level_um, stress, (wave[:, None] * depths).ravel())
            trace = trace.reshape(wave.size, -1)
            fired = encode_units(trace, [name] * depths.size, DT_MS, PARAMETERS)
            least = depths[fired.unit.min()]
            found.append(
                f"{ramp_ms:g} ms {least:.0f} um {np.interp(least, level_um, force_mn):.1f} mN"
            )
        print(f"{name}, threshold by ramp: {', '.join(found)}")


def distributions(observed_csv, cells=40):
    """RMSE of mean rates under the sinusoids of the fit, by shift and scale of the deviates."""
    observed = pandas.read_csv(observed_csv)
    level_um = 600 * (np.arange(31) / 30) ** 1.5
    nodes, forces, _ = press_to(PAD, Shape.punch(1.0), level_um)
    stimuli = resolve_stimuli(list(dict.fromkeys(observed["stimulus"])))
    grid = np.linspace(-7.0, 4.0, 221)
    for name in CLASSES:
        units = Population.one_each(afferents=(name,)).with_endings(0.0)
        stress = driving_stress_pa(PAD, nodes, forces, units)
        rates = {}
        for stimulus in stimuli:
            depth_um = np.maximum(75 + stimulus.displacement_um - stimulus.preindent_um, 0)
            trace = np.repeat(interpolate_states(level_um, stress, depth_um), grid.size, 1)
            fired = encode_units(trace, [name] * grid.size, stimulus.dt_ms, PARAMETERS, grid)
            first_ms, last_ms = stimulus.window_ms
            counted = fired.unit[(fired.time_ms > first_ms) & (fired.time_ms <= last_ms)]
            seconds = (last_ms - first_ms) / 1e3
            rates[stimulus.id] = np.bincount(counted, minlength=grid.size) / seconds
        rows = observed[observed["afferent"] == name]
        for shift in (0.0, -0.25, -0.5, -1.0):
            errors = []
            for scale in (0.8, 1.0, 1.2, 1.5):
                deviates = shift + scale * quantiles(cells)
                mean = [np.interp(deviates, grid, rates[s]).mean() for s in rows["stimulus"]]
                errors.append(np.sqrt(np.square(mean - rows["rate_ips"]).mean()))
            texts = ", ".join(f"{error:.1f}" for error in errors)
            print(f"{name}, deviates {shift:+g}, times 0.8, 1, 1.2, 1.5: RMSE {texts} impulses/s")


if __name__ == "__main__":
    fields()
    stiffness()
    ramps()
    if sys.argv[1:]:
        distributions(sys.argv[1])
