"""
Deflection of the skin around a thin probe
==========================================

A probe 50 µm wide is pressed 1 mm into the finger: how far does the skin beside it sink (the paper's Fig. 2c)? The four meshes
agree, so the answer is not a matter of the mesh.
"""

# sphinx_gallery_tags = ["paper", "finite elements"]

import matplotlib.pyplot as plt
import numpy as np

import fembridge as fb

plt.style.use("fembridge.plots.screen")

# %%
# The profiles of four meshes are stored; ``fb.deflect("mine.toml")`` solves another finger.

result = fb.deflect()
distance_mm = np.arange(0, 6.01, 0.5)  # the paper reads the skin every 0.5 mm

fig, panel = plt.subplots()
for (name, profile), colour in zip(
    result.meshes.items(), ("0.75", "0.55", "0.35", "C1"), strict=True
):
    near = profile.distance_mm <= 6
    label = f"{name}, {profile.elements} elements"
    panel.plot(profile.distance_mm[near], profile.deflection_mm[near], color=colour, label=label)
finest = result.meshes["fine"]
panel.plot(distance_mm, finest.at(distance_mm), "o", color="C1", markersize=6)
panel.fill_between(finest.distance_mm, finest.deflection_mm, color="C1", alpha=0.12, lw=0)
panel.set(
    xlim=(0, 6), ylim=(1.08, 0), xlabel="distance from the probe (mm)", ylabel="deflection (mm)"
)
panel.set_title("Skin under a 50 µm probe, 1 mm deep")
panel.legend(loc="lower right")

# %%
# The paper reports a deflection of about 1 mm under the probe, which decreases with the distance.

print(f"under the probe: {finest.at(0):.3f} mm (paper: about 1 mm)")
print(f"1 mm beside it:  {finest.at(1):.3f} mm")
widest = max(
    abs(profile.at(distance_mm) - finest.at(distance_mm)).max()
    for profile in result.meshes.values()
)
print(f"largest difference between meshes: {1e3 * widest:.1f} µm")
