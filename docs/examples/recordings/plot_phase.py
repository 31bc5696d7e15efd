"""
When in the cycle afferents fire
================================

Spikes of one SA, RA and PC unit of a monkey by phase of a 20 Hz cycle (Muniak et al. 2007), and those of the model.
"""

# sphinx_gallery_tags = ["recordings", "vibration", "timing"]

import matplotlib.pyplot as plt
import numpy as np

import fembridge as fb
from fembridge.evidence import published

plt.style.use("fembridge.plots.screen")
COLOUR = {"SA": "C0", "RA": "C1", "PC": "C2"}
LATENCY_MS = 5  # conduction from the skin to the electrode

# %%
# The recording is a histogram of 5 ms. A nerve conducts for some milliseconds, which the model leaves out; they are added here.

recorded = published("timing_20hz_phase").table
amplitude_um = recorded["amplitude_um"].max()
result = fb.simulate(f"sine_20_{amplitude_um:g}", stored=True)
edges_ms = np.arange(0, 51, 5)

fig, panels = plt.subplots(1, 3, figsize=(8.4, 3.2), sharey=True)
for panel, (name, colour) in zip(panels, COLOUR.items(), strict=True):
    spikes = result.spikes[result.spikes["afferent"] == name]["spike_time_ms"]
    counts, _ = np.histogram((spikes + LATENCY_MS) % 50, edges_ms)
    data = recorded[(recorded["afferent"] == name) & (recorded["amplitude_um"] == amplitude_um)]
    share = data["spikes"] / data["spikes"].sum()
    panel.bar(
        edges_ms[:-1] + 2.5, counts / counts.sum(), 4.4, color=colour, alpha=0.6, label="model"
    )
    panel.step(edges_ms, [*share, share.iloc[-1]], where="post", color="0.15", label="recorded")
    panel.set(title=f"{name}, {amplitude_um:g} µm", xlabel="phase (ms)", xlim=(0, 50))
panels[0].set_ylabel("share of spikes")
panels[0].legend()

# %%
# Overlap of the two histograms; 1 is equal:

for name in COLOUR:
    spikes = result.spikes[result.spikes["afferent"] == name]["spike_time_ms"]
    counts, _ = np.histogram((spikes + LATENCY_MS) % 50, edges_ms)
    data = recorded[(recorded["afferent"] == name) & (recorded["amplitude_um"] == amplitude_um)]
    overlap = np.minimum(counts / counts.sum(), data["spikes"] / data["spikes"].sum()).sum()
    print(f"{name}: {overlap:.2f}")
