"""Meshes of one finger made alike, from coarse to fine."""

from dataclasses import replace

import numpy as np

from decks.finger import Finger, Resolution
from decks.presets import PAPER

# Von Mises stress of SA, RA, PC at 200 um on an endless mesh: the study `mesh`, whole
# run, with CalculiX 2.20.
LIMIT_KPA = np.array([31.43, 19.24, 1.018])


def member(factor: float) -> Finger:
    """Give the finger of the family with this factor."""
    return (
        PAPER
        if factor == 1.0
        else replace(PAPER, name=f"paper_x{factor:g}", resolution=resolution(factor))
    )


def resolution(factor: float) -> Resolution:
    """Give the `paper` finger's resolution, `factor` times as wide everywhere."""
    paper = PAPER.resolution
    return Resolution(
        contact_mm=paper.contact_mm * factor,
        contact_half_width_mm=paper.contact_half_width_mm,
        ridge_mm=paper.ridge_mm * factor,
        far_mm=paper.far_mm * factor,
        stratum_corneum_rows=round(paper.stratum_corneum_rows / factor),
        epidermis_rows=round(paper.epidermis_rows / factor),
        dermis_rows=round(paper.dermis_rows / factor),
    )
