"""
Sensitivity beside the centre of a field
========================================

How much stronger must a 40 Hz vibration be when the probe is not over an RA afferent? Amplitude of one spike a cycle against the
distance, beside the recording of Johnson (1974).
"""

# sphinx_gallery_tags = ["recordings", "fingertip", "receptive field"]

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.ticker import NullFormatter

import fembridge as fb
from fembridge.evidence import published

plt.style.use("fembridge.plots.screen")

# %%
# A line of RA afferents under one probe stands for one afferent under many: the skin is the same along the finger.

recorded = published("distance_johnson_1974").table
units = fb.Population.line(0.5, 6.0, afferents=("RA",))
dt_ms, preindent_um, cycles = 0.5, 100.0, 5
times_ms = np.arange(0, 25 * cycles + dt_ms, dt_ms)
amplitudes_um = np.geomspace(20, 200, 12)
reached = []
for amplitude_um in amplitudes_um:
    depth_um = preindent_um + amplitude_um * np.sin(2e-3 * np.pi * 40 * times_ms)
    path = fb.Trajectory(depth_um, dt_ms=dt_ms, window_ms=(25, 125), name="40 Hz")
    touch = fb.touch("punch:diameter_mm=2", trajectory=path, population=units)
    reached.append(touch.rates["rate_ips"].to_numpy() >= 39)
threshold_um = np.where(np.any(reached, axis=0), amplitudes_um[np.argmax(reached, axis=0)], np.nan)
z_mm = units.to_frame()["z_mm"].to_numpy()

fig, panel = plt.subplots()
panel.plot(np.abs(z_mm), threshold_um, "o", color="C1", label="model, an RA unit each")
panel.plot(
    recorded["distance_mm"],
    recorded["amplitude_um"],
    "s--",
    color="0.25",
    mfc="white",
    label="recorded",
)
panel.set(
    yscale="log",
    xlabel="distance from the probe (mm)",
    ylabel="amplitude of a spike a cycle (µm)",
    xlim=(0, 5),
)
panel.set_title("RA at 40 Hz")
ticks = (20, 50, 100, 200, 500)
panel.set_yticks(ticks, list(map(str, ticks)))
panel.yaxis.set_minor_formatter(NullFormatter())
panel.legend()

# %%
# The model's units are less sensitive than the recorded one, and fall off faster: farther away more than 200 µm are needed.

print(
    f"most sensitive place: {np.nanmin(threshold_um):.0f} µm (recorded {recorded['amplitude_um'].min():g} µm)"
)
