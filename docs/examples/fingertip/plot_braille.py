"""
A Braille letter on a whole fingertip
=====================================

The letter "b" is pressed into a fingertip with 0.25 N. Every SA, RA and PC afferent of the fingertip has its place, and each answers
with its own spikes.
"""

# sphinx_gallery_tags = ["fingertip", "shape", "population"]

import fembridge as fb

touch = fb.touch("braille:text=b", press_n=0.25, seed=1)
figure = touch.plot("pad")

# %%
# How many units of each class fire, and how often:

rates = touch.rates
print(rates.groupby("afferent")["rate_ips"].agg(units="size", mean="mean", largest="max").round(1))
