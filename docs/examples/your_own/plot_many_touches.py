"""
Many touches in one table
=========================

A table with a row per touch becomes one data set of spikes: here three Braille letters at five places.
"""

# sphinx_gallery_tags = ["fingertip", "data set", "sweep"]

import matplotlib.pyplot as plt
import pandas as pd

import fembridge as fb

plt.style.use("fembridge.plots.screen")

# %%
# Columns are the arguments of ``fb.touch``; rows that share contact share its computation.

table = pd.DataFrame(
    [
        {"shape": f"braille:text={letter}", "press_um": 250, "x_mm": 0.2 * place, "hold_ms": 100}
        for letter in "abc"
        for place in range(-2, 3)
    ]
)
table["population"] = "grid:step_mm=1.5"
data = fb.touch_many(table, jobs=1)

# %%
# ``data.rates`` has a row per touch and unit. The three letters have one, two and two dots:

rates = data.rates.merge(data.touches[["touch", "shape"]], on="touch")
total = rates.groupby(["shape", "touch", "afferent"])["rate_ips"].mean().reset_index()
fig, panel = plt.subplots()
for column, name in enumerate(("SA", "RA", "PC")):
    chosen = total[total["afferent"] == name]
    for row, (_, group) in enumerate(chosen.groupby("shape")):
        panel.plot(
            [row + 0.2 * (column - 1)] * len(group), group["rate_ips"], "os^"[column],
            color=f"C{column}", label=name if row == 0 else None,
        )  # fmt: skip
panel.set(
    xticks=range(3), xticklabels=("a", "b", "c"), ylabel="mean rate of all units (impulses/s)",
    title="Five places of each letter",
)  # fmt: skip
panel.legend()
print(f"{len(data.touches)} touches, {len(data.spikes)} spikes")
