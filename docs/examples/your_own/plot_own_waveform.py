"""
Your own waveform
=================

An array of displacements is a stimulus. Here the probe goes 300 µm into the skin, in half a second, and trembles while it is there.
"""

# sphinx_gallery_tags = ["vibration", "waveform"]

import numpy as np

import fembridge as fb

times_ms = np.arange(0, 500, 0.5)
press_um = 150 * (1 - np.cos(2 * np.pi * times_ms / 500))
tremor_um = 5 * np.sin(2 * np.pi * 0.15 * times_ms) * (press_um / 300)
tap = fb.Waveform(press_um + tremor_um, dt_ms=0.5, name="press")

result = fb.simulate(tap, stored=True)
figure = result.plot()

# %%
# The rates of the median afferent of each class, in impulses per second:

print(result.rates[["afferent", "rate_ips"]].round(1).to_string(index=False))
