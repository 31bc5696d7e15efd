"""Relaxing skin in decks of CalculiX: Maxwell branches over a layer's elements.

The closed form is the convolution of the strain with G(t) = G0 (1 - sum g (1 -
exp(-t/tau))); for strain that changes evenly from sample to sample it is a sum that
a plain loop gives.
"""

import math
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from decks.calculix import branches, calculix_deck, lasting
from decks.contact_analysis import ElementSet, Model
from decks.dialects import template
from decks.finger import Material, PronyTerm
from decks.keyword_deck import LINES, real
from decks.presets import QUICK, mesh_of
from fembridge.errors import DeckError
from fembridge.host.machine import find_ccx
from fembridge.results.printed import read_point_stress

SKIN = mesh_of(QUICK)
TERMS = (PronyTerm(0.4, 0.02), PronyTerm(0.25, 0.005))
DT_S, STEPS = 0.0005, 80
RELAXING = Material(0.05, 0.48, prony=TERMS)


def layer_of(values, name="dermis"):
    """One square element."""
    return ElementSet(name, np.array([1]), np.array([[1, 2, 3, 4]]), values, "linear")


def finger_with(**layers):
    """`quick` with Prony terms in some layers."""
    materials = dict(QUICK.materials)
    for name, terms in layers.items():
        materials[name] = replace(materials[name], prony=terms)
    return replace(QUICK, materials=materials)


def relaxed_stress(strain, modulus, terms, dt_s):
    """Stress of strain that is 0 before the first sample and even between samples."""
    stress = np.empty_like(strain)
    kept = [0.0] * len(terms)
    lasting_share = 1 - sum(term.g for term in terms)
    before = 0.0
    for row, now in enumerate(strain):
        for k, term in enumerate(terms):
            fade = math.exp(-dt_s / term.tau_s)
            rise = (1 - fade) * term.tau_s / dt_s
            kept[k] = kept[k] * fade + term.g * modulus * (now - before) * rise
        stress[row] = lasting_share * modulus * now + sum(kept)
        before = now
    return stress


def backward_euler(strain, section, creep, dt_s):
    """What ccx makes of a branch: creep of 3/2 of the rate times the deviator."""
    shear_mpa, stress, now = section.material.shear_mpa, 0.0, []
    for step in np.diff(strain, prepend=0.0):
        stress += 2 * shear_mpa * step
        stress /= 1 + 3 * shear_mpa * creep * dt_s
        now.append(stress)
    return np.array(now)


def waveform():
    """A jump, a hold, and a vibration."""
    time_s = DT_S * np.arange(1, STEPS + 1)
    return np.where(time_s < 0.02, 1e-3, 1e-3 + 5e-4 * np.sin(600 * time_s))


def test_branches_stepped_backward_give_the_exact_relaxation():
    strain = waveform()
    layer = layer_of(RELAXING)
    stress = 2 * lasting(layer).material.shear_mpa * strain
    for section, creep in branches([layer], 2, DT_S):
        stress = stress + backward_euler(strain, section, creep, DT_S)
    exact = relaxed_stress(strain, 2 * RELAXING.shear_mpa, TERMS, DT_S)
    assert_allclose(stress, exact, rtol=1e-12)


def test_volume_does_not_relax_and_mass_is_kept():
    layer = layer_of(RELAXING)
    parts = [lasting(layer), *(section for section, _ in branches([layer], 2, DT_S))]
    bulk_mpa = sum(part.material.bulk_mpa for part in parts)
    density = sum(part.material.density_kg_m3 for part in parts)
    assert_allclose(bulk_mpa, RELAXING.bulk_mpa, rtol=1e-12)
    assert_allclose(density, RELAXING.density_kg_m3, rtol=5e-3)


def test_a_term_faster_than_a_sample_is_refused(short):
    finger = finger_with(dermis=(PronyTerm(0.4, 0.0002),))
    with pytest.raises(DeckError, match="dermis") as refused:
        calculix_deck(Model(finger, SKIN, support="prescribed").analysis(short))
    assert (refused.value.argument, refused.value.found) == ("tau_s", 0.0002)


@pytest.mark.solver
@pytest.mark.parametrize("card", ["*VISCO, DIRECT, CETOL=1.0E6", "*DYNAMIC, DIRECT, ALPHA=-0.3"])
def test_ccx_relaxes_a_sheared_square_as_the_convolution_says(tmp_path, card):
    """Simple shear, small strain: the sum over branches against the exact stress."""
    has_mass = card.startswith("*DYNAMIC")
    shear = waveform()
    layer = layer_of(RELAXING)
    found = branches([layer], 2, DT_S)
    rows = [(0.0, 0.0), *zip(DT_S * np.arange(1, STEPS + 1), shear, strict=True)]
    table = "\n".join(f"{at_s:.7f}, {real(float(way))}" for at_s, way in rows)
    materials = template("materials.inp.j2").make_module(LINES)
    lines = [
        "*NODE, NSET=ALL\n1, 0, 0, 0\n2, 1, 0, 0\n3, 1, 1, 0\n4, 0, 1, 0",
        "*ELEMENT, TYPE=CPE4, ELSET=DERMIS\n1, 1, 2, 3, 4",
        materials.material(lasting(layer), 1.0, has_mass),
        materials.branch_materials(found, "CPE4", 1.0, has_mass),
        f"*AMPLITUDE, NAME=WAY\n{table}",
        f"*STEP, INC=1000\n{card}",
        f"{DT_S}, {STEPS * DT_S}",
        "*BOUNDARY\n1, 1, 2\n2, 1, 2\n3, 2, 2\n4, 2, 2",
        "*BOUNDARY, AMPLITUDE=WAY\n3, 1, 1, 1.0\n4, 1, 1, 1.0",
        *(f"*EL PRINT, ELSET={name}\nS" for name in ("DERMIS", "DERMIS_PRONY_1", "DERMIS_PRONY_2")),
        "*END STEP",
    ]
    (tmp_path / "job.inp").write_text("\n".join(lines) + "\n", "ascii")
    done = subprocess.run([find_ccx(), "-i", "job"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-500:]
    sets = ("DERMIS", *(section.name.upper() for section, _ in found))
    summed_pa = sum(read_point_stress(tmp_path / "job.dat", name)[2][:, :, 3] for name in sets)
    exact_pa = 1e6 * relaxed_stress(shear, RELAXING.shear_mpa, TERMS, DT_S)
    assert_allclose(summed_pa, np.broadcast_to(exact_pa[:, None], summed_pa.shape), atol=1e-5)


def test_a_node_counts_the_branches_of_its_layer(short):
    finger = finger_with(dermis=TERMS, subcutaneous_tissue=TERMS[:1])
    analysis = Model(finger, SKIN, support="prescribed").analysis(short)
    assert analysis.branches == {analysis.afferent["PC"]: 2}
    assert Model(QUICK, SKIN, support="prescribed").analysis(short).branches == {}
