"""
Rates under band-pass noise
===========================

Firing rate under noise of five bands (the paper's Fig. 5), beside TouchSim. The level is the root mean square of the motion.
"""

# sphinx_gallery_tags = ["paper", "vibration", "rates", "TouchSim"]

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.ticker import NullFormatter

import fembridge as fb
from fembridge.evidence import touchsim_rates

plt.style.use("fembridge.plots.screen")
COLOUR = {"SA": "C0", "RA": "C1", "PC": "C2"}

# %%
# The model was fitted to sinusoids alone: these stimuli are predictions.

rates = fb.simulate("noise", stored=True).rates
touchsim = {(rate.stimulus, rate.afferent): rate.rate_ips for rate in touchsim_rates()}
parts = rates["stimulus"].str.rsplit("_", n=1, expand=True)
rates["set"], rates["level_um"] = parts[0], parts[1].astype(float)
pairs = list(zip(rates["stimulus"], rates["afferent"], strict=True))
rates["touchsim_ips"] = [touchsim.get(pair) for pair in pairs]

sets = list(dict.fromkeys(rates["set"]))
fig, panels = plt.subplots(3, len(sets), figsize=(8.4, 5.4), sharex="col", sharey="row")
for row, (name, colour) in enumerate(COLOUR.items()):
    for column, group in enumerate(sets):
        chosen = rates[(rates["afferent"] == name) & (rates["set"] == group)]
        chosen = chosen.sort_values("level_um")
        panel = panels[row, column]
        panel.plot(
            chosen["level_um"], chosen["touchsim_ips"], ":s", color="0.55", ms=4, label="TouchSim"
        )
        panel.plot(
            chosen["level_um"], chosen["rate_ips"], "-o", color=colour, ms=5, label="fembridge"
        )
        panel.set_xscale("log")
        panel.xaxis.set_minor_formatter(NullFormatter())
        if row == 0:
            _, low, high = group.split("_")
            panel.set_title(f"{low} to {high} Hz")
        if row == 2:
            panel.set_xlabel("RMS (µm)")
    panels[row, 0].set_ylabel(f"{name} (impulses/s)")
panels[0, 0].legend(loc="upper left")

# %%
# Difference of the two models, root mean square over all stimuli, in impulses/s:

for name in COLOUR:
    chosen = rates[rates["afferent"] == name]
    difference = np.sqrt(((chosen["rate_ips"] - chosen["touchsim_ips"]) ** 2).mean())
    print(f"{name}: {difference:.1f}")
