"""
Spikes under a vibrating probe
==============================

A probe vibrates at 20 and 100 Hz on the reference finger. The stored response of the finger needs
no solver.
"""

# sphinx_gallery_tags = ["start", "vibration"]

import fembridge as fb

result = fb.simulate(["sine_20_250", "sine_100_200"], stored=True)
result.plot()

# %%
# The rates of the median afferent of each class, in impulses per second:

print(result.rates.pivot(index="stimulus", columns="afferent", values="rate_ips").round(1))
