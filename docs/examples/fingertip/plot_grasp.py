"""
From a light touch to a grasp
=============================

A plate is pressed on the fingertip with 4 N, as in a grasp. The pulp stiffens, so the skin sinks in ever more slowly; SA afferents
report the force, RA and PC its changes.
"""

# sphinx_gallery_tags = ["fingertip", "force", "population"]

import warnings

import matplotlib.pyplot as plt
import numpy as np

import fembridge as fb

plt.style.use("fembridge.plots.screen")
COLOUR = {"SA": "C0", "RA": "C1", "PC": "C2"}

# %%
# A press in 200 ms and a hold. Deep touches are computed with large strain, and warn of their error: forces within 8 % of whole contact
# runs, stress mostly within 20 %.

warnings.simplefilter("ignore", fb.FembridgeWarning)
path = fb.Trajectory.press(press_n=4.0, ramp_ms=200, hold_ms=200)
touch = fb.touch("plate", path, population="grid:step_mm=1.5")
times_ms, depth_mm = path.times_ms, touch.depth_um / 1000
pressing = times_ms <= 200

fig, (left, right) = plt.subplots(1, 2, figsize=(8, 3.5))
left.plot(depth_mm[pressing], touch.force_n[pressing], color="0.3")
left.set(xlabel="depth (mm)", ylabel="force (N)", title="A plate on the fingertip")
edges_ms = np.arange(0, times_ms[-1] + 20, 20)
units = touch.rates.groupby("afferent").size()
for (name, colour), line in zip(COLOUR.items(), ("-", "--", ":"), strict=True):
    spikes = touch.spikes[touch.spikes["afferent"] == name]["spike_time_ms"]
    rate_ips = np.histogram(spikes, edges_ms)[0] / (0.020 * units[name])
    right.stairs(rate_ips, edges_ms, color=colour, ls=line, lw=1.8, label=name, baseline=None)
right.set(xlabel="time (ms)", ylabel="mean rate (impulses/s)", title="All units under the pad")
force = right.twinx()
force.plot(times_ms, touch.force_n, color="0.7", lw=1)
force.set_ylabel("force (N)", color="0.5")
right.legend(loc="upper right")

# %%
# The same step of force needs less and less depth:

for force_n in (0.5, 1.0, 2.0, 4.0):
    print(
        f"{force_n:g} N at {np.interp(force_n, touch.force_n[pressing], depth_mm[pressing]):.2f} mm"
    )
