"""The page on deflection tells what is stored."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

from fembridge.deflection.profile import richardson, stored_deflections

PAGE = (Path(__file__).parents[3] / "docs" / "deflection.md").read_text("utf-8")
MESHES = stored_deflections()


def row(label):
    """Cells of the table's row that begins with `label`."""
    (line,) = re.findall(rf"^\| {re.escape(label)} \|(.*)\|$", PAGE, re.MULTILINE)
    return [cell.strip() for cell in line.split("|")]


@pytest.mark.parametrize("distance_mm", [0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 6.0])
def test_the_table_holds_the_stored_deflections(distance_mm):
    label = f"{distance_mm:g} mm"
    cells = row(label if distance_mm else "deflection at 0 mm, in mm")
    assert cells[:-1] == [f"{float(mesh.at(distance_mm)):.4f}" for mesh in MESHES]


def test_the_table_holds_elements_and_forces():
    assert [int(cell.replace(" ", "")) for cell in row("elements")[:-1]] == [
        mesh.elements for mesh in MESHES
    ]
    forces = [f"{mesh.force_n_per_mm:.5f}" for mesh in MESHES]
    assert row("force, in N/mm")[:-1] == forces


def test_the_page_does_not_claim_more_agreement_than_there_is():
    every_mm = np.arange(0.0, 6.0 + 1e-9, 0.01)
    for mesh in MESHES[:-1]:
        (told,) = re.findall(rf"`{mesh.name}`(?: is everywhere)? within ([\d.]+) µm", PAGE)
        off_um = 1000 * np.abs(mesh.at(every_mm) - MESHES[-1].at(every_mm)).max()
        assert off_um <= float(told) <= 1.1 * off_um


def test_the_uncertainty_covers_both_limits():
    """Of the force, and of the deflection 3 mm away, from the first and last three."""
    width = np.array([mesh.elements**-0.5 for mesh in MESHES])
    for values in (
        np.array([mesh.force_n_per_mm for mesh in MESHES]),
        np.array([float(mesh.at(3.0)) for mesh in MESHES]),
    ):
        first, _ = richardson(width[:3], values[:3])
        last, _ = richardson(width[1:], values[1:])
        assert not math.isnan(first + last)
        assert abs(first / last - 1) <= 0.005
