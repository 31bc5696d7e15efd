"""
Which letter was it?
====================

A decoder reads Braille letters from spike counts: each letter is pressed at places that the decoder has not seen.
"""

# sphinx_gallery_tags = ["fingertip", "data set", "decoder"]

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.metrics import ConfusionMatrixDisplay
from sklearn.model_selection import cross_val_predict

import fembridge as fb

plt.style.use("fembridge.plots.screen")

# %%
# Six letters, ten random places each, 250 µm deep.

letters, places = list("abcdef"), 10
rng = np.random.default_rng(1)
table = pd.DataFrame(
    [
        {
            "shape": f"braille:text={letter}",
            "press_um": 250,
            "x_mm": x_mm,
            "z_mm": z_mm,
            "hold_ms": 60,
        }
        for x_mm, z_mm in rng.uniform(-0.4, 0.4, (places, 2)).round(3)
        for letter in letters
    ]
)
table["population"] = "grid:step_mm=1.5"
data = fb.touch_many(table, jobs=1)
counts = data.rates.pivot_table(
    index="touch", columns=["afferent", "unit"], values="rate_ips"
).fillna(0)

# %%
# All letters of a place are in the training or in the test.

named = [shape[-1] for shape in table["shape"]]
place = np.repeat(np.arange(places), len(letters))
folds = [(place % 5 != fold, place % 5 == fold) for fold in range(5)]
decoder = LinearDiscriminantAnalysis(solver="lsqr", shrinkage=0.1)
predicted = cross_val_predict(
    decoder, counts, named, cv=[(np.flatnonzero(a), np.flatnonzero(b)) for a, b in folds]
)
fig, panel = plt.subplots(figsize=(4.6, 4.2))
ConfusionMatrixDisplay.from_predictions(named, predicted, ax=panel, cmap="Greys", colorbar=False)
panel.set_title("Letters read from spikes")
print(
    f"{np.mean(np.array(named) == predicted):.0%} of the letters are read; chance is {1 / len(letters):.0%}"
)
