"""
A texture that slides over the fingertip
========================================

Embossed dots move across a fingertip at 80 mm/s, pressed with 0.2 N. SA afferents follow the dots, RA their edges, and PC the vibration
that the fingerprint ridges make of them.
"""

# sphinx_gallery_tags = ["fingertip", "texture", "population"]

import matplotlib.pyplot as plt

import fembridge as fb

plt.style.use("fembridge.plots.screen")

# %%
# Dots 4 mm apart, 0.4 mm high. A slide holds the force and moves the texture; the first 100 ms settle.

path = fb.Trajectory.slide(80.0, press_n=0.2, duration_ms=350, direction_deg=90)
touch = fb.touch("dots:spacing_mm=4,diameter_mm=0.5,relief_mm=0.4", path, seed=1)
figure = touch.plot("raster")

# %%
# Units that fire, their mean rate in impulses/s, and the largest:

rates = touch.rates
by_class = rates.groupby("afferent")["rate_ips"]
firing = by_class.agg(lambda rate: (rate > 0).sum()).rename("firing")
print(by_class.agg(units="size", mean="mean", largest="max").join(firing).round(1))
