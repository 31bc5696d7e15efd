"""Scanned textures on a finger of a macaque, beside that of a human; how its skin was chosen.

``python -m benchmarks.macaque_textures --textures TEXTURES.csv`` scans gratings and dots at 80 mm/s
with 0.3 N over the stored pads ``macaque`` and ``reference``, with several fingerprints; four
minutes on one core. ``--observed RATES.csv`` makes pads of fingers with skin of several thicknesses
(CalculiX, half a minute each) and prints the errors of the rates under the pin of 1 mm, by which
the thickness was chosen. Both sets of parameters are ``fitted_pad``. TEXTURES.csv has the columns
``speed_mm_per_s,shape,afferent,rate_ips``; neither file may be distributed.
"""

import argparse
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas

import fembridge as fb
from decks.finger import Bone, Nail, Outline, Skin
from decks.presets import QUICK
from fembridge.errors import FembridgeWarning
from fembridge.reporting.fingertip_responses import Fingertip
from fembridge.touching.pad_file import resolve_pad
from fembridge.touching.ridged_pad import with_ridges
from fembridge.trace import AFFERENTS
from neural import parameter_set

SHARES = (0.55, 0.6, 0.65, 0.7)
PRINTS = ("none", "loop", "whorl", "across", *(f"loop:seed={seed}" for seed in range(1, 6)))
SPACING_MM, REACH_MM = 0.2, 4.0


def macaque(share):
    """A macaque's finger whose skin is `share` times as thick as human skin."""
    skin = {name: round(share * getattr(QUICK.skin, name), 4) for name in QUICK.skin.RANGES}
    sites = {
        name: replace(site, depth_mm=round(share * site.depth_mm, 3))
        for name, site in QUICK.afferents.items()
    }
    return replace(
        QUICK,
        name="macaque",
        outline=Outline(4.4, 3.6),
        skin=Skin(**skin),
        bone=Bone(half_width_mm=1.75, half_height_mm=1.15, depth_mm=4.5),
        nail=Nail(0.25),
        afferents=sites,
    )


def print_errors_under_the_pin(observed):
    """RMSE of the rates under sinusoids, by thickness of the skin and on `reference`."""
    pads = {f"skin {share:g}": fb.make_pad(macaque(share), spacing_mm=SPACING_MM,
                                          reach_mm=REACH_MM) for share in SHARES}  # fmt: skip
    for name, pad in {**pads, "reference": resolve_pad("reference")}.items():
        probe = fb.PadProbe(pad=pad, ridges="none")
        found = fb.validate(observed=observed, pad=probe).agreement
        own = found.query("reference == 'observed' and source == 'fitted_pad' and set == 'all'")
        errors = own[own["family"] == "sine"].set_index("afferent")["rmse_ips"]
        print(
            name,
            " ".join(f"{afferent} {errors[afferent]:.1f}" for afferent in AFFERENTS),
            flush=True,
        )


def print_textures(recorded):
    """Ratio, R² and explained share of the rates by pad and fingerprint, and of their mean."""
    recorded = recorded.pivot_table("rate_ips", "shape", "afferent")[list(AFFERENTS)]
    for name in ("macaque", "reference"):
        rates = {}
        for fingerprint in PRINTS:
            tip = Fingertip(
                with_ridges(resolve_pad(name), fingerprint), parameter_set("fitted_pad")
            )
            scans = {shape: tip.texture_rates_ips(shape, 80.0) for shape in recorded.index}
            rates[fingerprint] = pandas.DataFrame(scans).T[list(AFFERENTS)]
            print(name, fingerprint, agreement_text(rates[fingerprint], recorded), flush=True)
        loops = [table for fingerprint, table in rates.items() if fingerprint.startswith("loop")]
        print(
            name, f"mean of {len(loops)} loops", agreement_text(sum(loops) / len(loops), recorded)
        )


def agreement_text(model, recorded):
    parts = []
    for afferent in AFFERENTS:
        x, y = model[afferent].to_numpy(), recorded[afferent].to_numpy()
        share = 1 - np.square(x - y).sum() / np.square(y - y.mean()).sum()
        square = np.corrcoef(x, y)[0, 1] ** 2
        parts.append(f"{afferent} {x.sum() / y.sum():.2f}, {square:.2f}, {share:.2f}")
    return "; ".join(parts)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--observed", type=Path)
    parser.add_argument("--textures", type=Path)
    args = parser.parse_args()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FembridgeWarning)
        if args.observed:
            print_errors_under_the_pin(args.observed)
        if args.textures:
            print_textures(pandas.read_csv(args.textures))


if __name__ == "__main__":
    main()
