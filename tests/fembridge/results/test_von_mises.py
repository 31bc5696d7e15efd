"""Von Mises stress against closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from fembridge.results.stress import von_mises_pa

STRESS = st.floats(-1e9, 1e9)
SQUARE_UNDERFLOWS = 1e-150  # Pa


def tensor(xx=0.0, yy=0.0, zz=0.0, xy=0.0, yz=0.0, zx=0.0):
    return np.array([xx, yy, zz, xy, yz, zx])


@settings(deadline=None)
@given(stress=STRESS, axis=st.sampled_from(["xx", "yy", "zz"]))
def test_uniaxial_stress_is_its_size(stress, axis):
    assert_allclose(
        von_mises_pa(tensor(**{axis: stress})), abs(stress), rtol=1e-12, atol=SQUARE_UNDERFLOWS
    )


@settings(deadline=None)
@given(pressure=STRESS)
def test_pressure_from_all_sides_is_none(pressure):
    assert von_mises_pa(tensor(pressure, pressure, pressure)) == 0.0


@settings(deadline=None)
@given(tau=STRESS, plane=st.sampled_from(["xy", "yz", "zx"]))
def test_pure_shear_is_root_three_times_it(tau, plane):
    found = von_mises_pa(tensor(**{plane: tau}))
    assert_allclose(found, np.sqrt(3.0) * abs(tau), rtol=1e-12, atol=SQUARE_UNDERFLOWS)


@settings(deadline=None)
@given(seed=st.integers(0, 1000))
def test_turning_the_axes_changes_nothing(seed):
    rng = np.random.default_rng(seed)
    full = rng.standard_normal((3, 3))
    full = full + full.T
    turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    pick = ([0, 1, 2, 0, 1, 2], [0, 1, 2, 1, 2, 0])
    before, after = von_mises_pa(full[pick]), von_mises_pa((turn @ full @ turn.T)[pick])
    assert_allclose(after, before, rtol=1e-10)


def test_leading_axes_are_kept():
    assert von_mises_pa(np.ones((4, 3, 6))).shape == (4, 3)


def test_five_components_are_no_tensor():
    with pytest.raises(ValueError, match=r"expected \(\.\.\., 6\)"):
        von_mises_pa(np.ones((2, 5)))
