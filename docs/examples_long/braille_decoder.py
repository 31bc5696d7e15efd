"""Decode 26 Braille letters from the spikes of a fingertip, by scikit-learn.

``python docs/examples_long/braille_decoder.py`` presses each letter at 40 places and keeps the
spikes in ``braille_letters/`` (the same command resumes). It trains a linear decoder on 32 of the
places, tests it on the other 8, and writes ``braille_accuracy.png`` and ``braille_confusion.png``.
It needs ``pip install 'fembridge[examples]'``. The page is docs/how_to/braille_decoder.md.

A place is the same for all letters, so no place of the test was seen in training. Units are drawn
from the fingertip, those of a class alone or of all three; the draws differ between folds.
"""

import argparse
import string
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.metrics import confusion_matrix
from sklearn.model_selection import GroupKFold
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

import fembridge as fb

CLASSES = ("SA", "RA", "PC")
SIZES = (10, 20, 50, 100, 200, 500)
FOLDS, SEEDS = 5, (0, 1, 2)
COLOURS = {"SA": "#2ca02c", "RA": "#1f77b4", "PC": "#ff7f0e", "all": "black"}
DPI, ALL = 100, "all"


def study(letters: str, places: int) -> dict:
    """Each letter at the same random places, pressed for 0.2 s."""
    return {
        "name": "Braille letters",
        "touches": {
            "press_um": 300,
            "ramp_ms": 50,
            "hold_ms": 100,
            "noise_mv": 0.3,
            "product": {"label": list(letters)},
            "draw": {
                "count": places,
                "seed": 1,
                "shared": True,  # the same places for every letter
                "x_mm": {"uniform": [-0.5, 0.5]},
                "z_mm": {"uniform": [-0.5, 0.5]},
                "angle_deg": {"uniform": [-5, 5]},
            },
        },
    }


def rows_of(content: dict) -> list[dict]:
    """Rows of the study, each with the shape of its letter and noise of its own."""
    from fembridge.sweeps.touch_study import read_touches

    rows = [dict(row) for row in read_touches(content).rows]
    for number, row in enumerate(rows):
        row |= {"shape": f"braille:text={row['label']}", "seed": number}
    return rows


def features(data: fb.Touches) -> dict[str, np.ndarray]:
    """Spike counts and first-spike times of each touch, ``(touch, unit)``."""
    touch = data.touches["touch"].to_numpy()
    unit = {name: number for number, name in enumerate(data.unit_rows(0))}
    spikes = data.spikes
    row = np.searchsorted(touch, spikes["touch"])
    column = spikes["unit"].map(unit).to_numpy()
    time_ms = spikes["spike_time_ms"].to_numpy()
    counts = np.zeros((touch.size, len(unit)))
    np.add.at(counts, (row, column), 1)
    first_ms = np.full(counts.shape, float(data.touches["end_ms"].max()))  # silent: at the end
    np.minimum.at(first_ms, (row, column), time_ms)
    return {"spike counts": counts, "first-spike times": first_ms}


def accuracy(values, label, places, rows, size, seed, shuffled=False):  # noqa: ANN001, ANN201
    """Share of letters decoded, in each fold of places, and the decoded letters."""
    rng = np.random.default_rng(seed)
    decoded = np.empty_like(label)
    shares = []
    for train, test in GroupKFold(FOLDS, shuffle=True, random_state=seed).split(
        values, groups=places
    ):
        units = rng.choice(rows, min(size, rows.size), replace=False)
        target = rng.permutation(label[train]) if shuffled else label[train]
        decoder = make_pipeline(
            StandardScaler(), LinearDiscriminantAnalysis(solver="lsqr", shrinkage=0.1)
        )
        decoder.fit(values[np.ix_(train, units)], target)
        decoded[test] = decoder.predict(values[np.ix_(test, units)])
        shares.append(float(np.mean(decoded[test] == label[test])))
    return shares, decoded


def main() -> None:
    """Compute, decode and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--letters", default=string.ascii_lowercase)
    parser.add_argument("--places", type=int, default=40)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("-o", "--output", type=Path, default=Path("braille_letters"))
    parser.add_argument("--pictures", type=Path, default=Path())
    args = parser.parse_args()

    data = fb.touch_many(
        rows_of(study(args.letters, args.places)), args.output, jobs=args.jobs, show_progress=True
    )
    label = data.touches["label"].to_numpy(dtype=str)
    places = data.touches["touch"].to_numpy() % args.places
    afferent = data.units_of(0)["afferent"].to_numpy()
    rows_of_class = {name: np.flatnonzero(afferent == name) for name in CLASSES}
    rows_of_class[ALL] = np.arange(afferent.size)

    curves: dict[tuple[str, str], list[tuple[int, float, float]]] = {}
    matrix = None
    for coding, values in features(data).items():
        for name, rows in rows_of_class.items():
            points = curves.setdefault((coding, name), [])
            for size in dict.fromkeys(min(size, rows.size) for size in SIZES):
                runs = [accuracy(values, label, places, rows, size, seed) for seed in SEEDS]
                means = [np.mean(shares) for shares, _ in runs]
                points.append((size, float(np.mean(means)), float(np.std(means))))
                if coding == "spike counts" and name == ALL and size == SIZES[3]:
                    matrix = confusion_matrix(label, runs[0][1], labels=list(args.letters))
            largest = ", ".join(f"{size}: {share:.2f}" for size, share, _ in points)
            print(f"{coding:18} {name:4} {largest}")
    values = features(data)["spike counts"]
    control = [
        np.mean(accuracy(values, label, places, rows_of_class[ALL], 200, seed, shuffled=True)[0])
        for seed in SEEDS
    ]
    chance = 1 / len(args.letters)
    print(f"chance {chance:.3f}; labels of the training shuffled: {np.mean(control):.3f}")
    args.pictures.mkdir(parents=True, exist_ok=True)
    draw_accuracy(curves, chance, float(np.mean(control)), args.pictures / "braille_accuracy.png")
    draw_confusion(matrix, args.letters, args.pictures / "braille_confusion.png")


def draw_accuracy(curves, chance, control, path) -> None:  # noqa: ANN001
    """Accuracy against the number of units, a panel for each code."""
    figure, panels = plt.subplots(1, 2, figsize=(8, 3.6), sharey=True, layout="constrained")
    for panel, coding in zip(panels, ("spike counts", "first-spike times"), strict=True):
        for (code, name), points in curves.items():
            if code == coding:
                size, share, spread = np.array(points).T
                panel.errorbar(
                    size, share, spread, marker="o", ms=4, color=COLOURS[name], label=name
                )
        panel.axhline(chance, color="0.5", ls="--", lw=1, label="chance")
        panel.axhline(control, color="0.5", ls=":", lw=1.2, label="shuffled labels")
        panel.set(xscale="log", xlabel="number of units", title=coding, ylim=(0, 1.02))
        panel.set_xticks(SIZES, map(str, SIZES))
        panel.minorticks_off()
        panel.spines[["top", "right"]].set_visible(False)
    panels[0].set_ylabel("share of letters decoded")
    panels[1].legend(frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    figure.savefig(path, dpi=DPI)


def draw_confusion(matrix, letters, path) -> None:  # noqa: ANN001
    """Share of the touches of a letter that are decoded as each letter."""
    figure, panel = plt.subplots(figsize=(5.4, 4.8), layout="constrained")
    image = panel.imshow(matrix / matrix.sum(axis=1, keepdims=True), cmap="Blues", vmin=0, vmax=1)
    panel.set_xticks(range(len(letters)), letters)
    panel.set_yticks(range(len(letters)), letters)
    panel.set(xlabel="decoded letter", ylabel="letter pressed", title="100 units, spike counts")
    figure.colorbar(image, label="share of touches", shrink=0.8)
    figure.savefig(path, dpi=DPI)


if __name__ == "__main__":
    main()
