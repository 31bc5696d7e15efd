"""Scanned textures on a finger of a macaque, beside that of a human.

``python -m benchmarks.macaque_textures OBSERVED.csv TEXTURES.csv`` fits RA under a pin of 1 mm
on the pads ``reference`` and ``fingertip_macaque``, both without ridges, as
``benchmarks.shipped_sets`` does, and scans gratings and dots at 80 mm/s with 0.3 N. TEXTURES.csv
has the columns ``shape,afferent,rate_ips``; neither file may be distributed. Five minutes on one
core. ``--shipped`` scans with the set ``fitted_pad`` instead, all three classes on both pads;
two minutes.
"""

import argparse
import warnings
from pathlib import Path

import numpy as np
import pandas
from scipy.stats import norm

import fembridge as fb
from fembridge.errors import FembridgeWarning
from fembridge.fitting.fit import FitTargets, Search
from fembridge.touching.pad_file import resolve_pad
from fembridge.touching.population import Population
from fembridge.touching.shape import Shape
from fembridge.touching.touch import touch_skin
from fembridge.touching.trajectory import Trajectory
from fembridge.trace import AFFERENTS
from neural import parameter_set

PADS = ("reference", "fingertip_macaque")
SPEED_MM_PER_S, FORCE_N, DURATION_MS, FIRST_MS = 80.0, 0.3, 400.0, 100.0
TARGETS = FitTargets(thresholds="thresholds_freeman_johnson_1982", timing=True)


def texture(name):
    """Gratings with ridges as wide as gaps, 0.5 mm high; dots 0.5 mm wide, 0.4 mm high."""
    kind, period = name.split("_")
    half_mm = float(period) / 2
    if kind == "grating":
        return Shape.grating(half_mm, half_mm, 0.5)
    return Shape.dots(float(period), 0.5, 0.4)


def rates_ips(pad, shapes, afferents, parameters):
    """Mean rates ``(shape, class)`` of 25 units of each class after the first 100 ms."""
    x, z = (grid.ravel() for grid in np.meshgrid(np.arange(-1, 1.1), np.arange(-1.5, 1.6, 0.75)))
    deviate = norm.ppf((np.arange(x.size) % 5 + 0.5) / 5)
    slide = Trajectory.slide(
        SPEED_MM_PER_S, press_n=FORCE_N, direction_deg=90, duration_ms=DURATION_MS
    )
    names, (x, z, deviate) = np.repeat(afferents, x.size), np.tile([x, z, deviate], len(afferents))
    units = Population.at(names.tolist(), x, z, deviate=deviate, finger=pad)
    counts = []
    for shape in shapes:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FembridgeWarning)
            fired = touch_skin(pad, texture(shape), slide, units, parameters).fired
        late = np.bincount(fired.unit[fired.time_ms > FIRST_MS], minlength=len(units))
        counts.append(late.reshape(len(afferents), -1).mean(axis=1))
    return np.array(counts) * 1e3 / (DURATION_MS - FIRST_MS)


def report(model, observed):
    """Ratio, explained share of the variance and correlation of rates of one class."""
    missed = np.square(model - observed).sum() / np.square(observed - observed.mean()).sum()
    print(
        f"  {model.sum() / observed.sum():.2f} of the recorded rates, R2 {1 - missed:.2f}, "
        f"correlation {np.corrcoef(model, observed)[0, 1]:.2f}"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("observed", type=Path)
    parser.add_argument("textures", type=Path)
    parser.add_argument("--evaluations", type=int, default=16000)
    parser.add_argument("--shipped", action="store_true", help="the set fitted_pad, all classes")
    args = parser.parse_args()
    recorded = pandas.read_csv(args.textures).pivot_table("rate_ips", "shape", "afferent")
    for name in PADS:
        pad = resolve_pad(name)
        if args.shipped:
            model = rates_ips(pad, recorded.index, AFFERENTS, parameter_set("fitted_pad"))
            for afferent, column in zip(AFFERENTS, model.T, strict=True):
                print(f"{name}, fitted_pad, {afferent}")
                report(column, recorded[afferent].to_numpy())
            continue
        fit = fb.fit(
            args.observed,
            afferents="RA",
            pad=fb.PadProbe(pad=name, ridges="none"),
            targets=TARGETS,
            search=Search(evaluations=args.evaluations, rule="smallest_error"),
            preindent_um=75.0,
        )
        [model] = rates_ips(pad, recorded.index, ["RA"], fit.parameters).T
        rmse_ips = fit.fits["RA"].agreement().rmse_ips
        print(f"{name}: RMSE of sinusoids {rmse_ips:.1f} impulses/s")
        print(f"  {dict(zip(recorded.index, model.round().tolist(), strict=True))}")
        report(model, recorded["RA"].to_numpy())


if __name__ == "__main__":
    main()
