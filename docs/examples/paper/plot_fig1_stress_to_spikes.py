"""
From stress to spikes
=====================

A vibrating probe stresses the skin; the change of stress drives an RA afferent; its membrane integrates the drive and fires. This is
the model of the paper (its Fig. 1), with each step computed twice: by fembridge, and by one line of NumPy.
"""

# sphinx_gallery_tags = ["paper", "vibration", "model"]

import matplotlib.pyplot as plt
import numpy as np

import fembridge as fb
from neural import PUBLISHED, encode

plt.style.use("fembridge.plots.screen")

# %%
# **Stress.** The finite-element finger answers any motion of the probe: here 100 Hz with an amplitude of 130 µm. The stored solution
# of the finger is read, so no solver is needed. ``parameters="published"`` is Table 2 of the paper, which has a time step of 0.5 ms.

result = fb.simulate("sine_100_130", parameters="published", stored=True)
trace = result.traces[0][1]  # of the first stimulus, RA
stress_pa, dt_ms = trace.stress_pa, trace.dt_ms
times_ms = dt_ms * np.arange(stress_pa.size)

# %%
# **Drive, current, potential.** The drive is the change of the stress rate, equation (3). The current saturates, equation (5). The
# membrane leaks, and a spike resets it, equation (7).

ra = PUBLISHED["RA"]
rate = np.diff(stress_pa) / dt_ms
drive = np.zeros_like(stress_pa)  # the first two samples have no complete past
drive[2:] = np.abs(np.diff(rate))
current = ra.alpha_mv_per_ms * drive / (ra.a3_pa_per_ms + drive)

potential_mv = np.full(stress_pa.size, ra.rest_mv)
spikes_ms, resting_until_ms = [], 0.0
for row in range(1, stress_pa.size):
    leak = (ra.rest_mv - potential_mv[row - 1]) / ra.tau_ms
    inflow = current[row - 1] if times_ms[row - 1] >= resting_until_ms else 0.0
    potential_mv[row] = potential_mv[row - 1] + dt_ms * (leak + inflow)
    if potential_mv[row] > ra.threshold_mv:
        potential_mv[row] = ra.rest_mv
        spikes_ms.append(times_ms[row])
        resting_until_ms = times_ms[row] + ra.refractory_ms

# %%
fig, panels = plt.subplots(4, 1, sharex=True, figsize=(6.6, 5.4), height_ratios=(2, 2, 2, 0.7))
rows = (
    (stress_pa / 1e3, "stress\n(kPa)", "0.5"),
    (current, "current\n(mV/ms)", "C4"),
    (potential_mv, "membrane\n(mV)", "C1"),
)
for panel, (values, label, colour) in zip(panels, rows, strict=False):
    panel.plot(times_ms, values, color=colour)
    panel.set_ylabel(label)
panels[2].axhline(ra.threshold_mv, color="0.3", lw=0.8, ls=":")
panels[3].vlines(spikes_ms, 0, 1, color="C1")
panels[3].set(yticks=[], ylabel="spikes", xlabel="time (ms)", xlim=(0, 100))
panels[3].spines["left"].set_visible(False)
panels[0].set_title("An RA afferent under 100 Hz, 130 µm")
fig.align_ylabels()

# %%
# The loop above and ``neural.encode`` give the same spikes. ``encode`` needs NumPy alone and takes any stress, also a robot's.

(encoded_ms,) = encode(stress_pa, dt_ms, ra)
print(f"loop:          {len(spikes_ms)} spikes, the first at {spikes_ms[0]:g} ms")
print(f"neural.encode: {encoded_ms.size} spikes, the first at {encoded_ms[0]:g} ms")
print(f"equal: {np.allclose(spikes_ms, encoded_ms)}")
