"""
Thresholds against frequency
============================

The smallest vibration that evokes a spike, and the one that evokes a spike in every cycle: model and recordings of Freeman & Johnson
(1982). PC is most sensitive near 200 Hz, RA between 20 and 50 Hz.
"""

# sphinx_gallery_tags = ["recordings", "vibration", "thresholds"]

import matplotlib.pyplot as plt
import numpy as np

import fembridge as fb
from fembridge.evidence import published

plt.style.use("fembridge.plots.screen")
COLOUR = {"SA": "C0", "RA": "C1", "PC": "C2"}

# %%
# Thresholds are amplitudes from zero to peak, of the median cell of each class.

recorded = published("thresholds_freeman_johnson_1982").table
model = fb.threshold(list(COLOUR), [5, 10, 20, 40, 80, 160, 315, 630]).table

fig, panels = plt.subplots(1, 3, figsize=(8.4, 3.6), sharey=True)
for panel, (name, colour) in zip(panels, COLOUR.items(), strict=True):
    for criterion, line, marker, label in (
        ("absolute", "-", "o", "first spike"),
        ("one_impulse_a_cycle", "--", "s", "a spike a cycle"),
    ):
        ours = model[(model["afferent"] == name) & (model["criterion"] == criterion)]
        panel.plot(
            ours["frequency_hz"], ours["amplitude_um"], line, color=colour, label=f"model, {label}"
        )
        data = recorded[(recorded["afferent"] == name) & (recorded["criterion"] == criterion)]
        panel.plot(
            data["frequency_hz"], data["amplitude_um"], marker, color="0.25",
            mfc="0.25" if marker == "o" else "white", label=f"recorded, {label}",
        )  # fmt: skip
    panel.set(xscale="log", yscale="log", title=name, xlabel="frequency (Hz)", ylim=(0.1, 1000))
panels[0].set_ylabel("amplitude (µm)")
panels[1].legend(loc="lower left", fontsize=8)

# %%
# Factor between model and recording, either way, in the median over the recorded frequencies:

for name in COLOUR:
    data = recorded[(recorded["afferent"] == name) & (recorded["criterion"] == "absolute")]
    ours = model[(model["afferent"] == name) & (model["criterion"] == "absolute")].dropna()
    at_data = np.interp(
        np.log(data["frequency_hz"]), np.log(ours["frequency_hz"]), np.log(ours["amplitude_um"])
    )
    factor = np.exp(np.median(np.abs(at_data - np.log(data["amplitude_um"]))))
    best = data.loc[data["amplitude_um"].idxmin()]
    ours_best = ours.loc[ours["amplitude_um"].idxmin()]
    print(
        f"{name}: factor {factor:.2f}; most sensitive at {ours_best['frequency_hz']:g} Hz "
        f"(recorded {best['frequency_hz']:g} Hz)"
    )
