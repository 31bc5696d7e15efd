"""Deep touches: closed forms of the sheet and the pulp, and whole contact runs."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import fembridge as fb
from fembridge.errors import FembridgeWarning, UsageError
from fembridge.touching.contact import DEEPEST_UM, press_to
from fembridge.touching.contact_history import solve_contact
from fembridge.touching.large_strain import (
    FULL_UM,
    SMALL_UM,
    has_large_strain,
    press_deep,
    share_of_large_strain,
    sheet_of,
)
from fembridge.touching.pad_file import resolve_pad
from fembridge.touching.prism_pad import LatticeNodes
from fembridge.touching.ridged_pad import with_ridges
from fembridge.touching.shape import Shape

PAD = resolve_pad("reference")
SHEET = sheet_of(PAD)
RIDGED = with_ridges(PAD, None)
ONE = fb.Population.one_each()
PLATE, BALL = Shape.plate(), Shape.sphere(5.0)

# CalculiX 2.20, finite strain, neo-Hookean skin and Ogden pulp, elements of 0.5 mm:
# ``python -m benchmarks.deep_touch``. Depth in um: force in N.
PLATE_N = {1000: 0.4425, 1500: 0.9326, 2000: 1.697, 2500: 2.873}
BALL_N = {1000: 0.1999, 2000: 0.5316, 3000: 1.171, 3500: 1.684}
# Von Mises stress 2 mm deep under the middle, in kPa.
PLATE_PC_KPA = {1000: 5.5, 1500: 8.9, 2000: 14.8, 2500: 26.0}
BALL_PC_KPA = {1000: 5.9, 2000: 16.5, 3000: 43.1, 3500: 71.6}
# SA under the middle of the plate, where 0.5 mm resolves it.
PLATE_SA_KPA = {1000: 53.3, 1500: 59.9, 2000: 72.8, 2500: 92.9}


def random_loads(seed=0):
    loads = np.zeros(SHEET.shape)
    middle = tuple(slice(size // 2 - 6, size // 2 + 7) for size in SHEET.shape[1:])
    loads[(slice(None), *middle)] = np.random.default_rng(seed).normal(size=(3, 13, 13)) * 1e-3
    return loads


@pytest.fixture(scope="module", params=[pytest.param("plate", marks=pytest.mark.slow), "ball"])
def deep(request):
    """Depths, force, von Mises stress of SA and PC in kPa, and those of CalculiX."""
    shape, expected_n, pc_kpa, sa_kpa = {
        "plate": (PLATE, PLATE_N, PLATE_PC_KPA, PLATE_SA_KPA),
        "ball": (BALL, BALL_N, BALL_PC_KPA, None),
    }[request.param]
    _, forces, _, large = press_deep(RIDGED, shape, np.array(list(expected_n), dtype=float))
    near = np.array([0.125])  # where the elements of CalculiX have their middle
    stress_kpa = {
        name: von_mises(large.fields.stress_pa(np.array([layer]), near, near, np.array([depth])))
        for name, layer, depth in (
            ("SA", "epidermis", 0.5875),
            ("PC", "subcutaneous_tissue", 2.0),
        )
    }
    return forces.sum(axis=1), stress_kpa, expected_n, pc_kpa, sa_kpa


def von_mises(tensor):
    xx, yy, zz, xy, yz, zx = tensor[:, 0] / 1e3
    square = 0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2)
    return np.sqrt(square + 3 * (xy**2 + yz**2 + zx**2))


def test_the_force_is_that_of_whole_contact_runs(deep):
    forces_n, _, expected_n, *_ = deep
    assert_allclose(forces_n, list(expected_n.values()), rtol=0.06)


def test_stress_in_the_pulp_is_that_of_whole_contact_runs(deep):
    _, stress_kpa, _, expected_kpa, _ = deep
    assert_allclose(stress_kpa["PC"], list(expected_kpa.values()), rtol=0.15)


def test_stress_of_sa_under_a_plate_is_that_of_whole_contact_runs(deep):
    _, stress_kpa, _, _, expected_kpa = deep
    if expected_kpa is None:
        pytest.skip("elements of 0.5 mm do not resolve a ball of 5 mm at SA")
    assert_allclose(stress_kpa["SA"], list(expected_kpa.values()), rtol=0.1)


def test_small_touches_are_those_of_small_strain():
    level = np.array([100.0, SMALL_UM])
    _, forces, _, large = press_deep(PAD, BALL, level)
    plain_nodes, plain, _ = press_to(PAD, BALL, level)
    assert_allclose(forces.sum(axis=1), plain.sum(axis=1), rtol=1e-9)
    place = np.array(["epidermis"]), np.zeros(1), np.zeros(1), np.array([0.55])
    superposed = np.einsum("cpn,sn->cps", PAD.influence_pa(plain_nodes, *place), plain)
    assert_allclose(large.fields.stress_pa(*place), superposed, atol=0.01 * superposed.max())


def test_large_strain_sets_in_smoothly():
    depth_um = np.linspace(SMALL_UM, FULL_UM, 11)
    share = np.array([share_of_large_strain(depth) for depth in depth_um])
    assert share[0] == 0
    assert share[-1] == 1
    assert (np.diff(share) > 0).all()


def test_displacement_by_waves_is_the_sum_over_all_loads():
    loads = random_loads()
    column, row = np.array([20, 28, 35]), np.array([-3, 0, 7])
    expected = np.zeros(3)
    for direction, flip in ((0, 1), (1, 1), (2, -1)):
        for force, at in zip(*np.nonzero(loads[direction]), strict=True):
            apart = row - (at - PAD.end_row)
            sign = np.where(apart < 0, flip, 1)
            table = PAD.lattice_compliance[direction, force, column, np.abs(apart)]
            expected += sign * table * loads[direction, force, at]
    down_mm = SHEET.down_mm(loads)[column, row + PAD.end_row]
    assert_allclose(down_mm, expected, atol=1e-5 * np.abs(expected).max())


def test_stress_by_waves_is_the_superposed_stress():
    loads = random_loads()
    force, at = np.nonzero(loads[1])
    nodes = LatticeNodes(PAD, force, at - PAD.end_row)
    number = next(n for n, row in enumerate(PAD.rows) if row.layer == "epidermis")
    middle = PAD.rows[number]
    x_mm = np.interp(middle.arc_mm[4:6], PAD.section.arc_mm, PAD.section.point_mm[:, 0])
    only_down = np.zeros_like(loads)
    only_down[1] = loads[1]
    stress = SHEET.row_mpa(number, SHEET.real_waves(only_down[None].astype(np.float32)))
    place = np.full(2, "epidermis"), x_mm, np.zeros(2), middle.depth_mm[4:6]
    expected = PAD.influence_pa(nodes, *place) @ loads[1][force, at] / 1e6
    half = middle.arc_mm.size
    found = stress[half + 4 : half + 6, PAD.end_row, :, 0].T
    assert_allclose(found, expected, atol=1e-3 * np.abs(expected).max())


@pytest.mark.slow
def test_waves_kept_as_real_numbers_give_the_stress_of_complex_ones():
    """Loads in all three directions, in a row of the skin and in one of the pulp."""
    loads = np.random.default_rng(8).normal(size=(2, *SHEET.shape)).astype(np.float32)
    for row in (0, len(PAD.rows) - 1):
        by_wave = SHEET._stress_waves(row) @ SHEET._waves(loads)
        expected = SHEET._rows(by_wave).reshape(SHEET.shape[2], 6, -1, 2).transpose(2, 0, 1, 3)
        for _ in range(2):  # computed, then kept
            stress = SHEET.row_mpa(row, SHEET.real_waves(loads))
            for part in range(6):
                largest = np.abs(expected[..., part, :]).max()
                assert_allclose(
                    stress[..., part, :], expected[..., part, :], rtol=0, atol=3e-6 * largest
                )


def test_further_loads_of_the_sheet_are_in_balance():
    """Forces within a sheet have no sum along the finger and, on even skin, none along it."""
    loads = random_loads(3)
    loads[1] = np.abs(loads[1])
    further = SHEET.further_loads(loads, np.zeros(SHEET.shape[1:]))
    pressed_n = SHEET.pressure_mpa(SHEET.down_mm(SHEET._even(loads))) * SHEET._node_mm2
    further[1] += pressed_n
    sums = further.sum(axis=(1, 2))
    assert_allclose(sums, 0, atol=1e-9 * np.abs(further).sum())


def test_a_ball_pushes_the_skin_below_it_outward():
    """In a hollow of radius R a force F into the skin comes with F x / R and F z / R."""
    radius_mm = 2.5
    x_mm = PAD.x_mm[:, None]
    z_mm = np.arange(-PAD.end_row, PAD.end_row + 1) * PAD.spacing_mm
    hollow_mm = (x_mm**2 + z_mm**2) / (2 * radius_mm)
    contact_n = np.random.default_rng(5).uniform(size=SHEET.shape[1:])
    beside_n = SHEET.beside_n(contact_n, PAD.y_mm[:, None] - hollow_mm)
    expected = np.stack([contact_n * x_mm, contact_n * z_mm]) / radius_mm
    inner = (slice(None), slice(1, -1), slice(1, -1))
    assert_allclose(beside_n[inner], expected[inner], rtol=1e-9, atol=1e-12)


def test_flattened_skin_is_pressed_straight():
    contact_n = np.ones(SHEET.shape[1:])
    flat_mm = PAD.y_mm[:, None] + np.zeros(SHEET.shape[1:])
    assert_allclose(SHEET.beside_n(contact_n, flat_mm), 0, atol=1e-12)
    loads = np.zeros(SHEET.shape)
    loads[1] = random_loads(2)[1] ** 2
    turned = SHEET.further_loads(loads, loads[1]) - SHEET.further_loads(loads, 0 * loads[1])
    down_mm = SHEET.down_mm(SHEET._even(loads))
    slopes = SHEET.beside_n(np.ones_like(down_mm), down_mm)
    expected = SHEET._even(loads[1] * slopes)
    assert_allclose(turned[[0, 2]], expected, atol=1e-9 * np.abs(expected).max())
    assert_allclose(turned[1], 0, atol=1e-12 * np.abs(loads).max())


def test_a_turned_sheet_has_the_stress_of_green_s_strain():
    """Rigid loads aside: rotation omega alone strains by omega^2 / 2."""
    turn = 0.2

    down_mm = turn * np.arange(SHEET.shape[2]) * PAD.spacing_mm * np.ones((SHEET.shape[1], 1))
    initial, _, strain, turns = SHEET._sheet_strain(np.zeros(SHEET.shape), down_mm)
    middle = SHEET.shape[1] // 2
    young, poisson = 2.0, 0.3
    assert_allclose(turns[1][middle], -turn, rtol=1e-3)
    assert_allclose(strain, 0, atol=1e-9)
    assert_allclose(initial[1][middle], young / (1 - poisson**2) * turn**2 / 2, rtol=2e-3)


def test_pulp_that_is_evenly_compressed_pushes_back_by_its_law():
    compressed = np.full(SHEET.shape[1:], 0.3) * SHEET.bone_mm
    tissue = PAD.finger.materials["subcutaneous_tissue"]
    young, poisson = tissue.young_mpa, tissue.poisson
    modulus = young * (1 - poisson) / ((1 + poisson) * (1 - 2 * poisson))
    assert_allclose(SHEET.pressure_mpa(compressed), 10.0 * modulus * 0.3**3.5, rtol=1e-9)
    assert_allclose(SHEET.tissue_stress_mpa(compressed), 13.0 * modulus * 0.3**4, rtol=1e-9)


@pytest.mark.slow
def test_a_ball_with_two_newtons_is_answered_and_read_again(tmp_path):
    with pytest.warns(FembridgeWarning, match="large strain"):
        result = fb.touch("sphere", press_n=2.0, population=ONE)
    assert result.force_n.max() == pytest.approx(2.0, rel=1e-3)
    assert 3500 < result.depth_um.max() < 3900
    result.write(tmp_path / "out")
    again = fb.Touch.read(tmp_path / "out")
    assert_allclose(again.stress_pa, result.stress_pa, rtol=1e-4, atol=1.0)
    assert again.rates.equals(result.rates)


def test_a_small_force_stays_with_small_strain():
    result = fb.touch("sphere", press_n=0.05, population=ONE)
    assert result.contact.large_strain is None


@pytest.mark.parametrize(
    ("shape", "press"),
    [
        pytest.param("sphere", {"press_n": 4.0}, marks=pytest.mark.slow),
        ("plate", {"press_n": 6.0}),
    ],
)
def test_a_touch_beyond_the_range_names_force_and_depth(shape, press):
    with pytest.raises(UsageError) as error:
        fb.touch(shape, population=ONE, **press)
    assert "5 N" in error.value.expected
    assert f"{DEEPEST_UM:g} um" in error.value.expected


def test_slides_and_pads_of_meshes_end_at_two_millimetres():
    slide = fb.Trajectory.slide(40.0, press_um=2_500, duration_ms=20)
    press = fb.Trajectory.press(press_um=2_500)
    for way, pad in ((slide, PAD), (press, resolve_pad("fingertip"))):
        with pytest.raises(UsageError) as error:
            solve_contact(pad, BALL, way, 0.4)
        assert error.value.argument == "depth_um"
        assert error.value.found == 2_500


def test_only_smooth_prisms_have_large_strain():
    assert has_large_strain(PAD)
    assert has_large_strain(RIDGED)
    assert not has_large_strain(resolve_pad("plane"))
    assert not has_large_strain(resolve_pad("fingertip"))


@pytest.mark.parametrize("press", [{"press_um": 0.0}, {"press_n": 0.0}])
def test_a_touch_that_never_touches_has_no_spikes(press):
    result = fb.touch("sphere", population=ONE, **press)
    assert not result.force_n.any()
    assert result.spikes.empty


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::fembridge.errors.FembridgeWarning")
def test_a_steady_press_evokes_no_spikes_of_pc_on_its_way():
    """Steps between states that are not settled would: with 1.5 % left, 11 spikes here."""
    units = fb.Population.fingertip(finger=PAD)
    units = units[[name == "PC" for name in units.afferent]]
    units = replace(units, endings_seed=np.full(len(units), 5))  # those of sign -1 fire at the end
    assert (units.sign == 1).all()
    press = fb.Trajectory.press(press_n=1.0, ramp_ms=125, hold_ms=20)
    spikes = fb.touch("plate", press, population=units, ridges="none").spikes
    on_the_way = (spikes["spike_time_ms"] > 30) & (spikes["spike_time_ms"] < 130)
    assert on_the_way.sum() <= 5
