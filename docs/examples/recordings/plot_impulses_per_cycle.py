"""
Spikes in a cycle, in humans
============================

Impulses per cycle of human SA, RA and PC afferents at 8, 32 and 128 Hz (medians of Johansson et al. 1982), and of the model. The probe
only moves upward from a pre-indentation.
"""

# sphinx_gallery_tags = ["recordings", "vibration", "human"]

import warnings

import matplotlib.pyplot as plt
import numpy as np

import fembridge as fb
from fembridge.evidence import published

plt.style.use("fembridge.plots.screen")
COLOUR = {"SA": "C0", "RA": "C1", "PC": "C2"}

# %%
# A waveform is an array. The probe stands at the pre-indentation and moves up and back, ``a (cos − 1)``.

recorded = published("impulses_a_cycle_johansson_1982").table
conditions = recorded[["frequency_hz", "amplitude_um"]].drop_duplicates()
conditions = conditions[conditions["amplitude_um"] <= 250]
dt_ms, cycles = 0.1, 6
model = {}
for frequency_hz, amplitude_um in conditions.itertuples(index=False):
    times_ms = np.arange(0, 1000 * cycles / frequency_hz, dt_ms)
    motion_um = 0.5 * amplitude_um * (np.cos(2e-3 * np.pi * frequency_hz * times_ms) - 1)
    waveform = fb.Waveform(motion_um, dt_ms=dt_ms, name=f"up_{frequency_hz}_{amplitude_um:g}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fb.FembridgeWarning)  # deeper than the set was fitted at
        result = fb.simulate(waveform, preindent_um=250, stored=True)
    spikes = result.spikes
    late = spikes[spikes["spike_time_ms"] > 1000 / frequency_hz]  # the first cycle settles
    per_cycle = late.groupby("afferent").size() / (10 * (cycles - 1))
    for name in COLOUR:
        model[name, frequency_hz, amplitude_um] = per_cycle.get(name, 0.0)

fig, panels = plt.subplots(1, 3, figsize=(8.4, 3.4), sharey=True)
for panel, frequency_hz in zip(panels, sorted(conditions["frequency_hz"].unique()), strict=True):
    for name, colour in COLOUR.items():
        data = recorded[(recorded["afferent"] == name) & (recorded["frequency_hz"] == frequency_hz)]
        data = data[data["amplitude_um"] <= 250].sort_values("amplitude_um")
        ours = [model[name, frequency_hz, amplitude] for amplitude in data["amplitude_um"]]
        panel.plot(data["amplitude_um"], ours, "-o", color=colour, label=f"{name}, model")
        panel.plot(
            data["amplitude_um"], data["impulses_per_cycle"], "--s", color=colour, mfc="white",
            label=f"{name}, recorded",
        )  # fmt: skip
    panel.set(xscale="log", title=f"{frequency_hz:g} Hz", xlabel="amplitude (µm)")
panels[0].set_ylabel("impulses per cycle")
panels[2].legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=9)

# %%
# The recorded numbers are medians of units under a probe of 6 mm; the model's probe has 1 mm.

for name in COLOUR:
    data = recorded[(recorded["afferent"] == name) & (recorded["amplitude_um"] <= 250)]
    ours = np.mean(
        [
            model[name, *row]
            for row in data[["frequency_hz", "amplitude_um"]].itertuples(index=False)
        ]
    )
    print(
        f"{name}: {ours:.2f} impulses per cycle in the mean, recorded {data['impulses_per_cycle'].mean():.2f}"
    )
