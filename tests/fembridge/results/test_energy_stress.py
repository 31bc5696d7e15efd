"""The stress of equal strain energy, against closed forms and the energy itself."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose

from fembridge.results.derived import strain_energy_density_pa
from fembridge.results.stress import energy_stress_pa, von_mises_pa

POISSON = st.floats(0.0, 0.499)
SQUARE_UNDERFLOWS = 1e-150  # Pa
TENSORS = arrays(np.float64, (4, 6), elements=st.floats(-1e5, 1e5))


@given(stress=st.floats(-1e6, 1e6), poisson=POISSON, along=st.integers(0, 2))
def test_uniaxial_stress_is_itself(stress, poisson, along):
    tensor = np.zeros(6)
    tensor[along] = stress
    found = energy_stress_pa(tensor, poisson)
    assert_allclose(found, abs(stress), rtol=1e-12, atol=SQUARE_UNDERFLOWS)


@given(shear=st.floats(-1e6, 1e6), poisson=POISSON, plane=st.integers(3, 5))
def test_pure_shear_is_as_much_as_shear_and_young_s_modulus_have_it(shear, poisson, plane):
    """W = τ²/2G with G = E/2(1 + ν)."""
    tensor = np.zeros(6)
    tensor[plane] = shear
    expected = abs(shear) * np.sqrt(2.0 * (1.0 + poisson))
    found = energy_stress_pa(tensor, poisson)
    assert_allclose(found, expected, rtol=1e-12, atol=SQUARE_UNDERFLOWS)


@given(pressure=st.floats(0.0, 1e6), poisson=POISSON)
def test_pressure_is_felt_as_much_as_the_material_gives(pressure, poisson):
    """W = p²/2K with K = E/3(1 − 2ν)."""
    tensor = np.array([-pressure] * 3 + [0.0] * 3)
    expected = pressure * np.sqrt(3.0 * (1.0 - 2.0 * poisson))
    found = energy_stress_pa(tensor, poisson)
    assert_allclose(found, expected, rtol=1e-9, atol=1e-12)


def test_pressure_on_what_cannot_be_compressed_is_nothing():
    tensor = np.array([-1e5 / 3, -1e5 / 3, -1e5 / 3, 0.0, 0.0, 0.0])
    assert_allclose(energy_stress_pa(tensor, 0.5), 0.0, atol=1e-2)


@given(tensor=TENSORS, poisson=POISSON, young_pa=st.floats(1e3, 1e9))
def test_it_is_the_energy_that_hooke_s_law_gives_each_tensor(tensor, poisson, young_pa):
    trace = tensor[:, :3].sum(axis=1, keepdims=True)
    strain = (1.0 + poisson) * tensor / young_pa
    strain[:, :3] -= poisson * trace / young_pa
    energy_pa = strain_energy_density_pa(tensor, strain)
    expected = np.sqrt(np.maximum(2.0 * young_pa * energy_pa, 0.0))
    found = energy_stress_pa(tensor, poisson)
    assert_allclose(found, expected, rtol=1e-6, atol=1e-6 * (1 + abs(tensor).max()))


@given(tensor=TENSORS)
def test_without_change_of_volume_it_is_von_mises_stress(tensor):
    """At ν = 1/2 all energy is of shape: 2EW = σ²."""
    scale = 1 + abs(tensor).max()
    assert_allclose(energy_stress_pa(tensor, 0.5), von_mises_pa(tensor), atol=1e-6 * scale)


@pytest.mark.parametrize("shape", [(5,), (6, 4), ()])
def test_what_is_no_tensor_is_refused(shape):
    with pytest.raises(ValueError, match=r"expected \(\.\.\., 6\)"):
        energy_stress_pa(np.zeros(shape), 0.3)


@pytest.mark.parametrize("poisson", [0.51, -1.1, float("nan")])
def test_a_ratio_that_no_material_has_is_refused(poisson):
    with pytest.raises(ValueError, match="poisson is"):
        energy_stress_pa(np.zeros(6), poisson)
