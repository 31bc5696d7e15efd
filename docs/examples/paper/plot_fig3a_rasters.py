"""
Spikes at 20 Hz
===============

SA, RA and PC afferents under a sinusoid of 20 Hz at 35, 130 and 250 µm (the paper's Fig. 3a). Each class has its own phase: RA fires
on the way in and on the way out, PC at every sharp change.
"""

# sphinx_gallery_tags = ["paper", "vibration", "timing"]

import matplotlib.pyplot as plt

import fembridge as fb

plt.style.use("fembridge.plots.screen")
COLOUR = {"SA": "C0", "RA": "C1", "PC": "C2"}

# %%
# A class is a population of ten cells of different sensitivity; the most sensitive is on top.

amplitudes_um = (35, 130, 250)
result = fb.simulate([f"sine_20_{amplitude}" for amplitude in amplitudes_um], stored=True)

fig, panels = plt.subplots(4, 3, sharex=True, figsize=(7.2, 5), height_ratios=(0.8, 1, 1, 1))
for column, stimulus in enumerate(result.stimuli):
    panels[0, column].plot(
        stimulus.dt_ms * range(stimulus.displacement_um.size)
        if False
        else [stimulus.dt_ms * k for k in range(stimulus.displacement_um.size)],
        stimulus.displacement_um,
        color="0.3",
    )
