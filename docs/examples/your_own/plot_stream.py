"""
A signal sample by sample
=========================

A robot's sensor delivers a sample every millisecond, and the spikes come out as they occur. ``neural.Stream`` keeps the state between
samples; its spikes are those of the whole signal.
"""

# sphinx_gallery_tags = ["robot", "stream"]

import matplotlib.pyplot as plt
import numpy as np

from neural import Stream, encode_cells, parameter_set

plt.style.use("fembridge.plots.screen")
COLOUR = {"SA": "C0", "RA": "C1", "PC": "C2"}

# %%
# A press of 20 kPa with a vibration of 80 Hz while it is held, as a sensor at 1 kHz sees it.

times_ms = np.arange(600)
held = np.clip(times_ms / 100, 0, 1) - np.clip((times_ms - 450) / 50, 0, 1)
shakes = (times_ms > 200) & (times_ms < 350)
stress_pa = 20e3 * held + 1500 * shakes * np.sin(2e-3 * np.pi * 80 * times_ms)

stream = Stream("fitted", dt_ms=1.0)
spikes = []
for sample in stress_pa:  # the loop of a robot
    spikes += stream.step(sample)
spikes += stream.flush()

fig, (signal, raster) = plt.subplots(2, 1, sharex=True, height_ratios=(1, 1.4))
signal.plot(times_ms, stress_pa / 1e3, color="0.3")
signal.set(ylabel="stress (kPa)", title="A press with a vibration")
for row, (name, colour) in enumerate(COLOUR.items()):
    for cell in range(10):
        at_ms = [s.time_ms for s in spikes if s.afferent == name and s.cell == cell]
        raster.vlines(at_ms, 25 - 10 * row - cell - 0.4, 25 - 10 * row - cell + 0.4, color=colour)
raster.set(yticks=(20, 10, 0), yticklabels=("SA", "RA", "PC"), xlabel="time (ms)")

# %%
# The delay of each class, and the same spikes from the whole signal at once:

print(f"look-ahead: {stream.look_ahead_ms}")
for name, values in parameter_set("fitted").parameters.items():
    [cells] = encode_cells(stress_pa, 1.0, values)
    streamed = sorted(s.time_ms for s in spikes if s.afferent == name)
    print(f"{name}: {len(streamed)} spikes, equal: {streamed == sorted(np.concatenate(cells))}")
