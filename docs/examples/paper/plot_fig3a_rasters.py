"""
Spikes at 20 Hz
===============

SA, RA and PC afferents under a sinusoid of 20 Hz at 35, 130 and 250 µm (the paper's Fig. 3a). Each class has its own phase: SA fires
on the way in, RA on the way in and on the way out, PC at every sharp change.
"""

# sphinx_gallery_tags = ["paper", "vibration", "timing"]

import matplotlib.pyplot as plt
import numpy as np

import fembridge as fb
from fembridge.evidence import published
from neural.timing import vector_strength

plt.style.use("fembridge.plots.screen")
COLOUR = {"SA": "C0", "RA": "C1", "PC": "C2"}

# %%
# A class is a population of ten cells of different sensitivity; the most sensitive is on top. The first row is the motion of the probe.

amplitudes_um = (35, 130, 250)
result = fb.simulate([f"sine_20_{amplitude}" for amplitude in amplitudes_um], stored=True)
spikes = result.spikes

fig, panels = plt.subplots(
    4, 3, sharex=True, sharey="row", figsize=(7.2, 5), height_ratios=(0.8, 1, 1, 1)
)
for column, stimulus in enumerate(result.stimuli):
    times_ms = stimulus.dt_ms * np.arange(stimulus.displacement_um.size)
    panels[0, column].plot(times_ms, stimulus.displacement_um, color="0.3")
    panels[0, column].set_title(f"{amplitudes_um[column]} µm")
    for row, (name, colour) in enumerate(COLOUR.items(), start=1):
        ours = spikes[(spikes["stimulus"] == stimulus.id) & (spikes["afferent"] == name)]
        panels[row, column].vlines(
            ours["spike_time_ms"], 10.1 - ours["cell"], 10.9 - ours["cell"], color=colour
        )
        panels[row, column].set(ylim=(0, 11), yticks=[])
        panels[row, 0].set_ylabel(f"{name}\n(10 cells)")
    panels[3, column].set(xlabel="time (ms)", xlim=(0, 250))
panels[0, 0].set_ylabel("depth (µm)")

# %%
# Vector strength is 1 where all spikes have the same phase of the cycle. The recorded units are one of each class.

recorded = published("timing_20hz").table
for name in COLOUR:
    for amplitude_um in amplitudes_um:
        chosen = spikes[
            (spikes["stimulus"] == f"sine_20_{amplitude_um}") & (spikes["afferent"] == name)
        ]
        model = vector_strength(chosen["spike_time_ms"], 20)
        row = recorded[(recorded["afferent"] == name) & (recorded["amplitude_um"] == amplitude_um)]
        values = row["vector_strength_20hz"].to_list()
        print(f"{name} {amplitude_um:>3} µm: {model:.2f} (recorded {values[0] if values else '-'})")
