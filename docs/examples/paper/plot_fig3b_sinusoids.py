"""
Rates under sinusoids
=====================

Firing rate against amplitude at 20, 50, 100 and 300 Hz (the paper's Fig. 3b), beside TouchSim, another published model.
"""

# sphinx_gallery_tags = ["paper", "vibration", "rates", "TouchSim"]

import matplotlib.pyplot as plt
from matplotlib.ticker import NullFormatter

import fembridge as fb
from fembridge.evidence import touchsim_rates

plt.style.use("fembridge.plots.screen")
COLOUR = {"SA": "C0", "RA": "C1", "PC": "C2"}

# %%
# All 37 sinusoids of the catalogue, from the stored response of the finger. The recorded rates of Muniak et al. (2007) may not be
# distributed; with a table of your own, ``fb.validate(observed="rates.csv")`` draws them, too.

rates = fb.simulate("sine", stored=True).rates
touchsim = {(rate.stimulus, rate.afferent): rate.rate_ips for rate in touchsim_rates()}
numbers = rates["stimulus"].str.split("_", expand=True)
rates["frequency_hz"], rates["amplitude_um"] = numbers[1].astype(float), numbers[2].astype(float)
pairs = list(zip(rates["stimulus"], rates["afferent"], strict=True))
rates["touchsim_ips"] = [touchsim.get(pair) for pair in pairs]

frequencies_hz = sorted(rates["frequency_hz"].unique())
fig, panels = plt.subplots(3, len(frequencies_hz), figsize=(8, 5.4), sharex="col", sharey="row")
for row, (name, colour) in enumerate(COLOUR.items()):
    for column, frequency_hz in enumerate(frequencies_hz):
        chosen = rates[(rates["afferent"] == name) & (rates["frequency_hz"] == frequency_hz)]
        chosen = chosen.sort_values("amplitude_um")
        panel = panels[row, column]
        panel.plot(
            chosen["amplitude_um"],
            chosen["touchsim_ips"],
            ":s",
            color="0.55",
            ms=4,
            label="TouchSim",
        )
        panel.plot(
            chosen["amplitude_um"], chosen["rate_ips"], "-o", color=colour, ms=5, label="fembridge"
        )
        panel.set_xscale("log")
        panel.xaxis.set_minor_formatter(NullFormatter())
        if row == 0:
            panel.set_title(f"{frequency_hz:g} Hz")
        if row == 2:
            panel.set_xlabel("amplitude (µm)")
    panels[row, 0].set_ylabel(f"{name} (impulses/s)")
panels[0, 0].legend(loc="upper left")

# %%
# Difference of the two models, root mean square over all stimuli, in impulses/s; the page "Choose your model" has the agreement of both
# with the recorded rates.

for name in COLOUR:
    chosen = rates[rates["afferent"] == name]
    difference = ((chosen["rate_ips"] - chosen["touchsim_ips"]) ** 2).mean() ** 0.5
    print(f"{name}: {difference:.1f}")
