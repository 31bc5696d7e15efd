"""
Receptive fields as large as recorded
=====================================

Where on the skin a probe at 4.5 times the threshold makes an afferent fire: fields of SA and RA units, and their areas beside the
medians of Vallbo & Johansson (1980).
"""

# sphinx_gallery_tags = ["recordings", "fingertip", "receptive field", "human"]

import matplotlib.pyplot as plt
import numpy as np

import fembridge as fb

plt.style.use("fembridge.plots.screen")
RECORDED_MM2 = {"SA": 11.0, "RA": 12.6}

# %%
# Each unit has five to ten endings at random places, so no two fields are alike. A field ends where a probe at 4.5 times the unit's
# threshold, the depth of the recordings, no longer evokes a spike.

fields = {
    name: fb.receptive_field(name, units=9, step_mm=0.4, depth_um=[], times_threshold=[4.5])
    for name in RECORDED_MM2
}

fig, panel = plt.subplots(figsize=(5.4, 3.6))
for place, (name, field) in enumerate(fields.items()):
    areas_mm2 = field.areas["area_mm2"]
    beside = place + np.linspace(-0.12, 0.12, len(areas_mm2))
    panel.plot(beside, areas_mm2, "o", color=f"C{place}", label=f"{name} units of the model")
    panel.hlines(
        RECORDED_MM2[name], place - 0.3, place + 0.3, color="0.15", lw=2.5,
        label="recorded median" if place == 0 else None,
    )  # fmt: skip
    panel.hlines(areas_mm2.median(), place - 0.2, place + 0.2, color=f"C{place}", ls="--")
panel.set(
    xticks=(0, 1), xticklabels=RECORDED_MM2, ylabel="area (mm²)", ylim=(0, 24), xlim=(-0.6, 1.6)
)
panel.legend(loc="upper left")

# %%
# Medians of the model and the recorded ones:

for name, field in fields.items():
    print(f"{name}: {field.areas['area_mm2'].median():.1f} mm², recorded {RECORDED_MM2[name]} mm²")
