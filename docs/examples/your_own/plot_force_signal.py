"""
A force signal of a robot
=========================

``neural.encode`` needs NumPy alone and takes any stress. A force sensor gives newtons; one gain turns them into the stress of an
afferent.
"""

# sphinx_gallery_tags = ["robot"]

import matplotlib.pyplot as plt
import numpy as np

from neural import PUBLISHED, encode

plt.style.use("fembridge.plots.screen")

dt_ms = 0.5
times_ms = np.arange(0, 800, dt_ms)
force_n = np.clip((times_ms - 100) / 100, 0, 1) - np.clip((times_ms - 600) / 50, 0, 1)
slip = (times_ms > 350) & (times_ms < 500)
force_n = force_n + 0.05 * slip * np.sin(2 * np.pi * 0.2 * times_ms)

gain_pa_per_n = 20e3
fig, (signal, raster) = plt.subplots(2, 1, sharex=True, height_ratios=(2, 1))
signal.plot(times_ms, force_n, color="0.3")
signal.set(ylabel="force (N)", title="A grasp that slips at 350 ms")
for row, (name, colour) in enumerate({"SA": "C0", "RA": "C1", "PC": "C2"}.items()):
    (spikes_ms,) = encode(gain_pa_per_n * force_n, dt_ms, PUBLISHED[name])
    raster.vlines(spikes_ms, 1.6 - row, 2.4 - row, color=colour)
    print(
        f"{name}: {spikes_ms.size} spikes, {np.sum((spikes_ms > 350) & (spikes_ms < 500))} of them while it slips"
    )
raster.set(yticks=(2, 1, 0), yticklabels=("SA", "RA", "PC"), xlabel="time (ms)")
