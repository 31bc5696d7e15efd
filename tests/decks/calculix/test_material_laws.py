"""Hyperelastic and anisotropic materials: one element in ccx against closed forms.

All nodes of a unit square follow a displacement gradient, so that strain is the same
everywhere and stress has a closed form. Where the sides are free, the closed form is solved
for the width at which the stress across is zero.
"""

import subprocess
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import brentq

from decks.calculix import calculix_deck
from decks.contact_analysis import ElementSet, Model
from decks.dialects import template
from decks.finger import Anisotropy, Material, OgdenTerm
from decks.keyword_deck import LINES, real
from decks.presets import QUICK, mesh_of
from fembridge.host.machine import find_ccx
from fembridge.results.printed import read_point_stress
from fembridge.results.readers import read_values
from fembridge.results.von_mises import von_mises_pa

CORNERS_MM = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
LARGE = np.array([[0.20, -0.10], [0.15, -0.25]])
REST = Material(0.05, 0.48)
LAWS = {
    "neo-hookean": replace(REST, law="neo-hookean"),
    "mooney-rivlin": replace(REST, law="mooney-rivlin", c01_share=0.35),
    "one Ogden term": replace(REST, law="ogden", ogden=(OgdenTerm(1.0, 9.5),)),
    "two Ogden terms": replace(
        REST, law="ogden", ogden=(OgdenTerm(0.7, 1.3), OgdenTerm(0.3, -4.0))
    ),
    "three Ogden terms": replace(
        REST, law="ogden", ogden=(OgdenTerm(0.5, 2.0), OgdenTerm(0.2, 12.0), OgdenTerm(0.3, -2.5))
    ),
}
STRATUM = Material(
    2.0, 0.3, anisotropy=Anisotropy(0.6, 0.25, 0.15, 1.2, 0.4, 0.3, shear_plane_mpa=0.5)
)


def stress_mpa(stretch, material):
    """Cauchy stress ``(3, 3)`` of a deformation gradient, from the derivative of the energy."""
    volume = np.linalg.det(stretch)
    squared = volume ** (-2 / 3) * stretch @ stretch.T
    shear_mpa = material.shear_mpa
    if material.law == "ogden":
        value, axis = np.linalg.eigh(squared)
        principal = sum(
            2 * term.share * shear_mpa / term.alpha * value ** (term.alpha / 2)
            for term in material.ogden
        )
        kirchhoff = axis @ np.diag(principal) @ axis.T
    else:
        c01_mpa = 0.5 * shear_mpa * material.c01_share
        c10_mpa = 0.5 * shear_mpa - c01_mpa
        kirchhoff = 2 * c10_mpa * squared
        kirchhoff = kirchhoff + 2 * c01_mpa * (np.trace(squared) * squared - squared @ squared)
    deviator = kirchhoff - np.trace(kirchhoff) / 3 * np.eye(3)
    return deviator / volume + material.bulk_mpa * (volume - 1) * np.eye(3)


def solve(folder, section, moved, large_strain=True, increments=5):
    """Stress ``(6,)`` in MPa and displacement ``(4, 2)`` at the end of a step of one element."""
    materials = template("materials.inp.j2").make_module(LINES)
    lines = [
        "*NODE, NSET=ALL\n1, 0, 0, 0\n2, 1, 0, 0\n3, 1, 1, 0\n4, 0, 1, 0",
        "*ELEMENT, TYPE=CPE4, ELSET=BODY\n1, 1, 2, 3, 4",
        materials.material(section, 1.0, False),
        f"*STEP{', NLGEOM' if large_strain else ''}\n*STATIC, DIRECT\n1.0, {increments}.0",
        "*BOUNDARY",
        *(f"{node}, {axis}, {axis}, {real(mm)}" for (node, axis), mm in moved.items()),
        "*EL PRINT, ELSET=BODY, GLOBAL=YES\nS\n*NODE OUTPUT, NSET=ALL, DOUBLE\nU\n*END STEP",
    ]
    (folder / "job.inp").write_text("\n".join(lines) + "\n", "ascii")
    done = subprocess.run([find_ccx(), "-i", "job"], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-500:]
    point_stress = read_point_stress(folder / "job.dat", "BODY")[2][-1]
    _, moved_mm = read_values(folder / "job.frd", [1, 2, 3, 4], quantity="displacement")
    return 1e-6 * point_stress.reshape(-1, 6), moved_mm[-1, :, :2]


def solved_stress_pa(folder, analysis):
    """Von Mises stress ``(T, afferent)`` of a whole finger in ccx."""
    folder.mkdir()
    (folder / "job.inp").write_text(calculix_deck(analysis), "ascii")
    done = subprocess.run([find_ccx(), "-i", "job"], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-500:]
    nodes = list(analysis.afferent.values())
    return von_mises_pa(read_values(folder / "job.frd", nodes, quantity="stress")[1])


def body(material, axes=None):
    return ElementSet(
        "body", np.array([1]), np.array([[1, 2, 3, 4]]), material, material.law or "linear", axes
    )


def follow(gradient):
    """All nodes follow a displacement gradient ``(2, 2)``."""
    moved_mm = CORNERS_MM @ np.asarray(gradient).T
    return {
        (node + 1, axis + 1): float(moved_mm[node, axis]) for node in range(4) for axis in range(2)
    }


def in_plane(gradient):
    stretch = np.eye(3)
    stretch[:2, :2] += gradient
    return stretch


def voigt(stress):
    return stress[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


@pytest.mark.solver
@pytest.mark.parametrize("name", LAWS)
def test_a_large_strain_has_the_stress_of_the_energy(name, tmp_path):
    material = LAWS[name]
    computed, _ = solve(tmp_path, body(material), follow(LARGE))
    expected = voigt(stress_mpa(in_plane(LARGE), material))
    assert_allclose(computed, np.broadcast_to(expected, computed.shape), atol=2e-6)
    assert np.abs(expected).max() > 0.005


@pytest.mark.solver
@pytest.mark.parametrize("name", LAWS)
def test_a_strip_pressed_by_a_third_with_free_sides_widens_as_the_energy_says(name, tmp_path):
    material, height = LAWS[name], 0.67

    def across(width):
        return stress_mpa(np.diag([width, height, 1.0]), material)[0, 0]

    width = brentq(across, 1.0, 2.0, xtol=1e-12)
    moved = {(1, 1): 0.0, (4, 1): 0.0, (1, 2): 0.0, (2, 2): 0.0}
    moved |= {(3, 2): height - 1, (4, 2): height - 1}
    computed, moved_mm = solve(tmp_path, body(material), moved, increments=10)
    expected = stress_mpa(np.diag([width, height, 1.0]), material)
    assert_allclose(moved_mm[[1, 2], 0], width - 1, rtol=1e-4)
    assert_allclose(computed[:, 1], expected[1, 1], rtol=1e-4)
    assert_allclose(computed[:, 2], expected[2, 2], rtol=1e-3)


@pytest.mark.solver
@pytest.mark.parametrize("name", LAWS)
def test_at_rest_each_law_has_the_stiffness_of_plane_strain(name, tmp_path):
    """``E / (1 - nu^2)`` with free sides, at a strain of 1e-4.

    ccx has Ogden's law from principal stretches, and 1 % of error at a strain of 1e-5.
    """
    material, strain = LAWS[name], 1e-4
    moved = {(1, 1): 0.0, (4, 1): 0.0, (1, 2): 0.0, (2, 2): 0.0, (3, 2): strain, (4, 2): strain}
    computed, _ = solve(tmp_path, body(material), moved, increments=1)
    assert_allclose(computed[:, 1], strain * 0.05 / (1 - 0.48**2), rtol=2e-4)


@pytest.mark.parametrize("name", LAWS)
def test_the_closed_forms_are_hookes_law_at_rest(name):
    material, gradient = LAWS[name], 1e-6 * LARGE
    lame_mpa = material.bulk_mpa - 2 * material.shear_mpa / 3
    strain = in_plane(0.5 * (gradient + gradient.T)) - np.eye(3)
    hooke = lame_mpa * np.trace(strain) * np.eye(3) + 2 * material.shear_mpa * strain
    assert_allclose(
        stress_mpa(in_plane(gradient), material), hooke, atol=1e-5 * np.abs(hooke).max()
    )


# ---- Anisotropy


def anisotropic_stress_mpa(gradient, material, angle):
    """Hooke's law of the nine constants, with axis 1 at `angle` from x; small strain."""
    e1, e2, e3, nu12, nu13, nu23, g12, g13, g23 = material.engineering_constants
    compliance = np.zeros((6, 6))
    compliance[:3, :3] = [
        [1 / e1, -nu12 / e1, -nu13 / e1],
        [-nu12 / e1, 1 / e2, -nu23 / e2],
        [-nu13 / e1, -nu23 / e2, 1 / e3],
    ]
    compliance[range(3, 6), range(3, 6)] = 1 / g12, 1 / g13, 1 / g23
    cos, sin = np.cos(angle), np.sin(angle)
    local = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    strain = local @ (in_plane(0.5 * (gradient + gradient.T)) - np.eye(3)) @ local.T
    doubled = voigt(strain) * [1, 1, 1, 2, 2, 2]
    xx, yy, zz, xy, zx, yz = np.linalg.solve(compliance, doubled)
    stress = np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]])
    return local.T @ stress @ local


@pytest.mark.solver
@pytest.mark.parametrize("angle", [0.0, 0.6, -1.2])
def test_an_anisotropic_layer_has_hookes_stress_about_its_own_axes(angle, tmp_path):
    gradient = 1e-3 * np.array([[2.0, -1.0], [4.0, 1.5]])
    section = body(STRATUM, np.array([[np.cos(angle), np.sin(angle)]]))
    computed, _ = solve(tmp_path, section, follow(gradient), large_strain=False, increments=1)
    expected = voigt(anisotropic_stress_mpa(gradient, STRATUM, angle))
    assert_allclose(computed, np.broadcast_to(expected, computed.shape), atol=2e-9)


@pytest.mark.slow
@pytest.mark.solver
def test_an_isotropic_stratum_corneum_written_as_anisotropic_gives_the_same_trace(short, tmp_path):
    """The whole finger, half of it solved, each element of the layer with axes of its own."""
    corneum = QUICK.materials["stratum_corneum"]
    shear_mpa = corneum.shear_mpa
    equal = replace(corneum, anisotropy=Anisotropy(corneum.young_mpa, corneum.poisson, shear_mpa))
    soft = replace(corneum, anisotropy=Anisotropy(0.2, corneum.poisson, 0.1))
    stress = []
    for name, material in (("plain", corneum), ("equal", equal), ("soft", soft)):
        finger = replace(QUICK, materials={**QUICK.materials, "stratum_corneum": material})
        analysis = Model(finger, mesh_of(finger)).analysis(short)
        stress.append(solved_stress_pa(tmp_path / name, analysis))
    plain, equal, soft = stress
    assert_allclose(equal, plain, rtol=1e-4, atol=1e-3)
    assert np.abs(soft[-1] / plain[-1] - 1).max() > 0.02


@pytest.mark.slow
@pytest.mark.solver
def test_a_finger_of_ogden_and_mooney_rivlin_layers_is_solved(short, tmp_path):
    """At 0.1 mm its stress is that of the neo-Hookean finger within a quarter, and not equal."""
    materials = dict(QUICK.materials)
    materials["dermis"] = replace(LAWS["two Ogden terms"])
    fat = materials["subcutaneous_tissue"]
    materials["subcutaneous_tissue"] = replace(fat, law="mooney-rivlin", c01_share=0.4)
    stress = []
    for name, finger in (("plain", QUICK), ("laws", replace(QUICK, materials=materials))):
        analysis = Model(finger, mesh_of(finger), law="neo-hookean").analysis(short)
        stress.append(solved_stress_pa(tmp_path / name, analysis))
    assert_allclose(stress[1][-1], stress[0][-1], rtol=0.25)
    assert np.abs(stress[1][-1] / stress[0][-1] - 1).max() > 1e-4
