"""The patch test: elements of any shape under a linear displacement carry one stress.

All nodes of the rim follow ``u = G x``; those inside are free. The strain is then
the symmetric part of G everywhere and the stress is Hooke's, in plane strain and
without large-strain terms exactly. Two things about CalculiX 2.20 came out of it:

- Stress at nodes is 0.99996 of that at the integration points. The weights that
  extrapolate eight points to a node, 2.549, -0.683 (3), 0.183 (3) and -0.04904,
  add up to that and not to 1. One factor for all nodes and components.
- CPE4R fails on distorted elements: its control of hourglasses also answers to a
  linear displacement. On parallelograms it passes.
"""

import os
import subprocess

import numpy as np
import pytest
from numpy.testing import assert_allclose

from decks.keyword_deck import element_lines, node_lines, real
from decks.mesh import Mesh
from fembridge.machine import find_ccx
from fembridge.results.frd import read_stress_and_displacement
from fembridge.results.printed import read_point_stress

pytestmark = pytest.mark.solver

YOUNG_MPA, POISSON = 0.05, 0.48  # dermis, Table 1
GRADIENT = np.array([[2e-3, -1e-3], [4e-3, 1.5e-3]])
NODAL_SHARE = 2.549 - 3 * 0.683 + 3 * 0.183 - 0.04904
WIDTH_MM, HEIGHT_MM = 2.4, 1.2
# Five quads, none a parallelogram: one within a square, turned and shifted.
INNER_MM = [[0.4, 0.2], [1.8, 0.3], [1.6, 0.8], [0.8, 0.8]]
OUTER_MM = [[0, 0], [WIDTH_MM, 0], [WIDTH_MM, HEIGHT_MM], [0, HEIGHT_MM]]
QUAD = np.array([[0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7], [4, 5, 6, 7]])


def hooke_mpa(gradient):
    """Stress xx yy zz xy yz zx of a displacement gradient in plane strain."""
    shear_mpa = YOUNG_MPA / (2 * (1 + POISSON))
    lame_mpa = YOUNG_MPA * POISSON / ((1 + POISSON) * (1 - 2 * POISSON))
    xx, yy = gradient[0, 0], gradient[1, 1]
    volume = lame_mpa * (xx + yy)
    xy = shear_mpa * (gradient[0, 1] + gradient[1, 0])
    return [volume + 2 * shear_mpa * xx, volume + 2 * shear_mpa * yy, volume, xy, 0, 0]


def distorted():
    return Mesh(np.array(OUTER_MM + INNER_MM), QUAD, np.full(len(QUAD), 2))


def sheared():
    """Nine parallelograms."""
    x, y = (at.ravel() for at in np.meshgrid(np.arange(4), np.arange(4)))
    first = (np.arange(3)[:, None] * 4 + np.arange(3)).ravel()
    quad = np.stack([first, first + 1, first + 5, first + 4], -1)
    nodes = np.stack([0.8 * x + 0.2 * y, 0.4 * y], -1)
    return Mesh(nodes, quad, np.full(9, 2))


def rim_of(mesh, node_mm):
    """Which nodes, mid-sides among them, lie on the outline."""
    edge, _, _ = mesh.outline()
    corners, middles = mesh.node_mm[np.unique(edge)], mesh.node_mm[edge].mean(axis=1)
    rim_mm = np.concatenate([corners, middles])
    away_mm = np.linalg.norm(node_mm[:, None] - rim_mm, axis=2).min(axis=1)
    return away_mm < 1e-12


def deck_of(element, mesh):
    node_mm, quad = mesh.node_mm, mesh.quad
    if element == "CPE8R":
        node_mm, quad = mesh.with_midsides()
    moved_mm = node_mm @ GRADIENT.T
    boundary = [
        f"{row + 1}, {axis + 1}, {axis + 1}, {real(moved_mm[row, axis])}"
        for row in np.flatnonzero(rim_of(mesh, node_mm))
        for axis in (0, 1)
    ]
    lines = [
        "*NODE, NSET=ALL",
        *node_lines(range(1, len(node_mm) + 1), node_mm),
        f"*ELEMENT, TYPE={element}, ELSET=PATCH",
        *element_lines(range(1, len(quad) + 1), quad + 1),
        "*MATERIAL, NAME=DERMIS",
        "*ELASTIC",
        f"{real(YOUNG_MPA)}, {real(POISSON)}",
        "*SOLID SECTION, ELSET=PATCH, MATERIAL=DERMIS",
        "1.0",
        "*STEP",
        "*STATIC, DIRECT",
        "1.0, 1.0",
        "*BOUNDARY",
        *boundary,
        "*NODE OUTPUT, NSET=ALL, DOUBLE",
        "U",
        "*ELEMENT OUTPUT, NSET=ALL, DOUBLE",
        "S",
        "*EL PRINT, ELSET=PATCH",
        "S",
        "*END STEP",
    ]
    return node_mm, "\n".join(lines) + "\n"


@pytest.fixture
def solve(tmp_path):
    """Give nodes, displacement and stress at them, and stress at integration points.

    Both stresses come as shares of Hooke's largest component, less Hooke's.
    """

    def solved(element, mesh):
        node_mm, text = deck_of(element, mesh)
        (tmp_path / "job.inp").write_text(text)
        subprocess.run(
            [find_ccx(), "-i", "job"],
            cwd=tmp_path,
            env={**os.environ, "OMP_NUM_THREADS": "1"},
            check=True,
            capture_output=True,
        )
        nodes = list(range(1, len(node_mm) + 1))
        at_nodes = read_stress_and_displacement(tmp_path / "job.frd", nodes, nodes)
        _, _, at_points_pa = read_point_stress(tmp_path / "job.dat", "PATCH")
        off_mm = at_nodes.displacement_mm[0, :, :2] - node_mm @ GRADIENT.T
        return off_mm, at_nodes.tensor_pa[0] * 1e-6, at_points_pa[0] * 1e-6

    return solved


HOOKE_MPA = np.array(hooke_mpa(GRADIENT))
SCALE_MPA = np.abs(HOOKE_MPA).max()


@pytest.mark.parametrize(
    ("element", "mesh"),
    [
        ("CPE4", distorted()),
        ("CPE8R", distorted()),
        ("CPE4", sheared()),
        ("CPE4R", sheared()),
        ("CPE8R", sheared()),
    ],
    ids=["CPE4", "CPE8R", "CPE4 sheared", "CPE4R sheared", "CPE8R sheared"],
)
def test_a_patch_under_a_linear_displacement_carries_the_stress_of_hooke(solve, element, mesh):
    off_mm, at_nodes_mpa, at_points_mpa = solve(element, mesh)

    assert np.abs(off_mm).max() < 1e-12
    expected_mpa = np.broadcast_to(HOOKE_MPA, at_points_mpa.shape)
    assert_allclose(at_points_mpa, expected_mpa, rtol=1e-6, atol=1e-9 * SCALE_MPA)
    share = 1.0 if element == "CPE4R" else NODAL_SHARE
    expected_mpa = np.broadcast_to(share * HOOKE_MPA, at_nodes_mpa.shape)
    assert_allclose(at_nodes_mpa, expected_mpa, rtol=1e-9, atol=1e-12 * SCALE_MPA)


def test_reduced_integration_fails_on_distorted_quads(solve):
    off_mm, _, at_points_mpa = solve("CPE4R", distorted())
    off = np.abs(at_points_mpa - HOOKE_MPA).max() / SCALE_MPA
    assert np.abs(off_mm).max() > 1e-5
    assert 1e-3 < off < 5e-3


def test_stress_at_a_node_is_a_few_parts_in_a_hundred_thousand_low():
    assert_allclose(NODAL_SHARE, 1 - 4e-5, rtol=1e-12)
