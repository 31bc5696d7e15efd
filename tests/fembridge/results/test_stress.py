"""Stress tensors against closed forms; what follows from them, and both sides of a boundary."""

import shutil

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.testing import assert_allclose
from opened import naming, sides

from fembridge.errors import ResultError
from fembridge.results import read_fields
from fembridge.results.extrapolation import brick_weights
from fembridge.results.fields import derive_values
from fembridge.results.von_mises import (
    energy_stress_pa,
    max_shear_pa,
    mean_stress_pa,
    principal_stresses_pa,
    strain_energy_density_pa,
    von_mises_pa,
)

POISSON = st.floats(0.0, 0.5)
FOUR_TENSORS = hnp.arrays(np.float64, (4, 6), elements=st.floats(-1e5, 1e5))


@given(tensor=FOUR_TENSORS, poisson=POISSON, young_pa=st.floats(1e3, 1e9))
def test_energy_stress_is_the_energy_that_hooke_s_law_gives_each_tensor(tensor, poisson, young_pa):
    trace = tensor[:, :3].sum(axis=1, keepdims=True)
    strain = (1.0 + poisson) * tensor / young_pa
    strain[:, :3] -= poisson * trace / young_pa
    energy_pa = strain_energy_density_pa(tensor, strain)
    expected = np.sqrt(np.maximum(2.0 * young_pa * energy_pa, 0.0))
    found = energy_stress_pa(tensor, poisson)
    assert_allclose(found, expected, rtol=1e-6, atol=1e-6 * (1 + abs(tensor).max()))


@pytest.mark.parametrize("poisson", [0.51, -1.1, float("nan")])
def test_a_ratio_that_no_material_has_is_refused(poisson):
    with pytest.raises(ValueError):
        energy_stress_pa(np.zeros(6), poisson)


def matrices_of(tensor):
    xx, yy, zz, xy, yz, zx = np.moveaxis(tensor, -1, 0)
    rows = [[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


@given(
    values=hnp.arrays(np.float64, 3, elements=st.floats(-1e6, 1e6)),
    angles=hnp.arrays(np.float64, 3, elements=st.floats(-3.2, 3.2)),
)
def test_principal_stresses_do_not_change_when_the_axes_are_turned(values, angles):
    turn = np.eye(3)
    for (a, b), angle in zip(((0, 1), (1, 2), (0, 2)), angles, strict=True):
        one = np.eye(3)
        one[[a, b], [a, b]] = np.cos(angle)
        one[a, b], one[b, a] = -np.sin(angle), np.sin(angle)
        turn = turn @ one
    m = turn @ np.diag(values) @ turn.T
    tensor = np.array([m[0, 0], m[1, 1], m[2, 2], m[0, 1], m[1, 2], m[2, 0]])
    scale = np.abs(values).max() + 1e-140  # squares underflow
    found = principal_stresses_pa(tensor)
    assert_allclose(found, np.sort(values)[::-1], atol=1e-13 * scale)
    s1, s2, s3 = found
    mises = np.sqrt(((s1 - s2) ** 2 + (s2 - s3) ** 2 + (s3 - s1) ** 2) / 2)
    assert_allclose(von_mises_pa(tensor), mises, atol=1e-12 * scale)


def test_closed_forms_of_simple_states():
    pull, shear, pressure = np.eye(6)[0], np.eye(6)[4], -np.array([1, 1, 1, 0, 0, 0.0])
    assert_allclose(principal_stresses_pa(pull), [1, 0, 0], atol=1e-15)
    assert_allclose(principal_stresses_pa(shear), [1, 0, -1], atol=1e-15)
    assert_allclose(max_shear_pa(np.stack([pull, shear, pressure])), [0.5, 1, 0])
    assert_allclose(mean_stress_pa(np.stack([pull, shear, pressure])), [1 / 3, 0, -1])


@given(
    strain=hnp.arrays(np.float64, 6, elements=st.floats(-1e-3, 1e-3)),
    young_pa=st.floats(1e3, 1e9),
    poisson=st.floats(0.0, 0.45),
)
def test_strain_energy_is_that_of_a_linear_material(strain, young_pa, poisson):
    """W = λ/2 (tr ε)² + μ ε:ε, with each tensor shear in it twice."""
    mu = young_pa / (2 * (1 + poisson))
    lame = young_pa * poisson / ((1 + poisson) * (1 - 2 * poisson))
    trace = strain[:3].sum()
    stress = 2 * mu * strain + lame * trace * np.array([1, 1, 1, 0, 0, 0])
    square = (matrices_of(strain) ** 2).sum()
    assert_allclose(
        strain_energy_density_pa(stress, strain),
        lame / 2 * trace**2 + mu * square,
        rtol=1e-9,
        atol=1e-12 * young_pa * 1e-6,
    )


def test_strain_energy_is_the_ener_of_a_recorded_shear(write_frd, block):
    """CalculiX 2.20, C3D20, E 1000, nu 0.3, u = 0.001 x + 0.002 y: node 1 of the
    ``.frd``, whose EXY is 0.001, half of the angle."""
    stress = [1.3461, 0.5769, 0.5769, 0.7692, 0.0, 0.0]
    strain = [9.9996e-4, 0.0, 0.0, 9.9996e-4, 0.0, 0.0]
    names = ("EXX", "EYY", "EZZ", "EXY", "EYZ", "EZX")
    blocks = [
        block("STRESS", 1, 1.0, [(1, stress)]),
        block("TOSTRAIN", 1, 1.0, [(1, strain)], components=names),
        block("ENER", 1, 1.0, [(1, [1.44225e-3])], components=("ENER",)),
    ]
    quantities = ("STRESS", "TOSTRAIN", "ENER")
    path = write_frd(blocks)
    fields = {name: next(read_fields(path, name)) for name in quantities}
    assert fields["ENER"].units == ("Pa",)
    energy_pa = derive_values("strain_energy_density", fields)
    assert_allclose(energy_pa, fields["ENER"].component("ENER"), rtol=1e-4)


def test_each_side_of_a_layer_boundary_has_its_own_stress(samples):
    """Uniform stretch: 0.000549 MPa below and 0.02198 above, by closed form; the
    ``.frd`` has the mean of both at these nodes."""
    path = samples / "interface_cpe8r.frd"
    field = next(read_fields(path))
    for node in range(29, 38):  # at y = 0.5
        below, above = sides(path, node, "EALL")
        assert (below.name, above.name) == ("A", "B")
        assert below.times_ms.tolist() == above.times_ms.tolist() == [1000.0]
        for side, young_pa in ((below, 0.05e6), (above, 2.0e6)):
            sxx = 0.01 * young_pa / (1 - 0.3**2)
            assert_allclose(side.tensor_pa, [[sxx, 0, 0.3 * sxx, 0, 0, 0]], atol=1e-6 * sxx)
        mean = (below.tensor_pa + above.tensor_pa)[0, 0] / 2
        assert_allclose(field.values_at([node])[0, 0], mean, rtol=1e-4)


def test_one_sided_stress_tells_what_is_missing(samples, tmp_path):
    for suffix in ("frd", "dat"):
        name = f"interface_cpe8r.{suffix}"
        shutil.copy(samples / name, tmp_path / name)
    path = tmp_path / "interface_cpe8r.frd"
    with pytest.raises(ResultError, match=naming("interface_cpe8r.frd", 999)):
        sides(path, 999, "EALL")
    dat = path.with_suffix(".dat")
    lines = dat.read_text().splitlines(keepends=True)
    dat.write_text("".join(x for x in lines if not x.startswith(f"{10:10d} ")))
    with pytest.raises(ResultError, match=naming("interface_cpe8r.dat", "EALL", 10, 33)):
        sides(path, 33, "EALL")
    dat.write_text("".join(x for x in lines if not x.startswith(f"{10:10d}   8")))
    with pytest.raises(ResultError, match=naming("interface_cpe8r.dat", 10)):
        sides(path, 33, "EALL")


PLACES = {
    "quad4": [(-1, -1), (1, -1), (1, 1), (-1, 1)],
    "hex8": [(-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1),
            (-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)],
}  # fmt: skip


@pytest.mark.parametrize("kind", ["quad4", "quad8", "hex8", "hex20"])
@pytest.mark.parametrize(("points", "order"), [(1, 0), (8, 1), (27, 2)])
def test_a_stress_that_varies_with_the_order_of_the_points_is_carried_exactly(kind, points, order):
    corners = PLACES["quad4" if kind.startswith("qu") else "hex8"]
    places = list(corners)
    if kind == "quad8":
        places += [(0, -1), (1, 0), (0, 1), (-1, 0)]
    if kind == "hex20":  # bottom, between, top: the order of a .frd
        mids = [(0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 5), (2, 6), (3, 7),
                (4, 5), (5, 6), (6, 7), (7, 4)]  # fmt: skip
        places += [tuple(np.add(corners[a], corners[b]) / 2) for a, b in mids]
    gauss = {1: [0.0], 8: [-(3**-0.5), 3**-0.5], 27: [-(0.6**0.5), 0.0, 0.6**0.5]}
    lie = [(x, y, z) for z in gauss[points] for y in gauss[points] for x in gauss[points]]

    def stress(x, y, z=0.0):
        return (2 + 3 * x**order) * (1 - 4 * y**order) * (5 + z**order * len(corners))

    plane = kind.startswith("qu")
    printed = [stress(x, y, 0.0 if plane else z) for x, y, z in lie]
    for corner, place in enumerate(places):
        weights = brick_weights(kind, points, corner)
        assert_allclose(weights @ printed, stress(*place), rtol=1e-12, atol=1e-12)


def test_an_unknown_kind_of_element_is_not_extrapolated():
    with pytest.raises(ValueError, match=naming("tri6", 9)):
        brick_weights("tri6", 9, 0)
