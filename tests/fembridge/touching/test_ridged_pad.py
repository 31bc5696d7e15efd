"""The fine grid with ridges: closed forms, plain loops, and pads with finer elements."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import fembridge as fb
from decks.unit_loads import smooth
from fembridge.errors import UsageError
from fembridge.touching.compliance import GridCompliance, interpolation_weights
from fembridge.touching.contact import ContactSolver, press_to
from fembridge.touching.fingerprint import PATTERNS, Fingerprint, resolve_fingerprint
from fembridge.touching.grid_contact import GridContactSolver
from fembridge.touching.layered_skin import ElasticLayer, surface_compliance, surface_kernel
from fembridge.touching.pad_file import resolve_pad
from fembridge.touching.population import Population
from fembridge.touching.prism_pad import LatticeNodes
from fembridge.touching.ridged_pad import RidgedPad, with_ridges
from fembridge.touching.shape import Shape
from fembridge.touching.stress import von_mises_pa
from fembridge.touching.touch import touch_skin
from fembridge.touching.touch_result import Touch
from fembridge.touching.trajectory import Trajectory
from neural import parameter_set

PAD = resolve_pad("reference")
FLAT = with_ridges(PAD, "loop:height_mm=0")
RIDGED = with_ridges(PAD, "whorl")
SKIN = (
    ElasticLayer(0.65, 2.0, 0.3),
    ElasticLayer(1.1, 0.05, 0.48),
    ElasticLayer(4.55, 0.024, 0.4),
)


# ---- Layered skin


def test_a_thick_layer_is_a_half_space():
    """2 (1 - nu^2) / (E k): what a half-space yields to a pressure of wavenumber k."""
    wavenumber = np.geomspace(0.3, 30, 20)
    expected = 2 * (1 - 0.3**2) / (2.0 * wavenumber)
    assert_allclose(surface_compliance([ElasticLayer(50.0, 2.0, 0.3)], wavenumber), expected, 1e-9)


def test_an_even_pressure_squeezes_each_layer_by_its_confined_modulus():
    confined = [
        layer.young_mpa * (1 - layer.poisson) / ((1 + layer.poisson) * (1 - 2 * layer.poisson))
        for layer in SKIN
    ]
    expected = sum(
        layer.thickness_mm / modulus for layer, modulus in zip(SKIN, confined, strict=True)
    )
    assert_allclose(surface_compliance(SKIN, np.zeros(1)), expected, rtol=5e-3)


def test_a_layer_cut_in_two_is_the_layer():
    wavenumber = np.geomspace(0.05, 30, 30)
    whole = surface_compliance(SKIN, wavenumber)
    upper = replace(SKIN[1], thickness_mm=0.4)
    lower = replace(SKIN[1], thickness_mm=0.7)
    cut = surface_compliance([SKIN[0], upper, lower, SKIN[2]], wavenumber)
    assert_allclose(cut, whole, rtol=1e-9)


def test_the_kernel_falls_as_a_point_force_on_a_half_space():
    """(1 - nu^2) / (pi E r), a few nodes from the force and far above the base."""
    kernel = surface_kernel([ElasticLayer(30.0, 2.0, 0.3)], 0.125, (20, 20))
    apart = np.arange(3, 8)
    point = (1 - 0.3**2) / (np.pi * 2.0 * 0.125 * apart)
    assert_allclose(kernel[0, apart], point, rtol=0.05)
    assert_allclose(kernel, kernel.T, rtol=1e-9)


# ---- The grid


def grid_nodes(pad, half_mm):
    nodes = pad.skin_nodes()
    return nodes.subset((np.abs(nodes.x_mm) <= half_mm) & (np.abs(nodes.z_mm) <= half_mm))


def test_the_operator_is_the_sum_of_its_parts_by_plain_loops():
    """K between two nodes, and the rest of the pad's nodes with cubic weights on both."""
    nodes = grid_nodes(RIDGED, 0.4)
    compliance, grid = nodes.compliance(), RIDGED.grid
    rng = np.random.default_rng(1)
    for force, node in rng.integers(0, nodes.size, (6, 2)):
        expected = grid.kernel_mm[
            abs(nodes.column[force] - nodes.column[node]), abs(nodes.row[force] - nodes.row[node])
        ]
        rows = 2 * PAD.end_row + 1
        along = interpolation_weights(
            (nodes.row[[force, node]] + RIDGED.end_row) / grid.parts, rows
        )
        for m, across_m in enumerate(grid.across[nodes.column[force]]):
            for n, across_n in enumerate(grid.across[nodes.column[node]]):
                if across_m and across_n:
                    for i in np.flatnonzero(along[0]):
                        for j in np.flatnonzero(along[1]):
                            rest = grid.rest_mm[m, n, abs(i - j)]
                            expected += across_m * across_n * along[0, i] * along[1, j] * rest
        unit = np.zeros(nodes.size)
        unit[force] = 1.0
        moved = compliance.moved_mm(np.array([force]), unit)
        assert_allclose(moved[node], expected, rtol=2e-5)
        [[entry]] = compliance.block(np.array([node]), np.array([force]))
        assert_allclose(entry, expected, rtol=2e-3)


def test_the_operator_is_symmetric_and_positive():
    nodes = grid_nodes(RIDGED, 0.8)
    compliance = nodes.compliance()
    rng = np.random.default_rng(2)
    for _ in range(5):
        one, other = rng.normal(size=(2, nodes.size))
        moved = compliance.moved_mm(np.arange(nodes.size), one)
        back = compliance.moved_mm(np.arange(nodes.size), other)
        assert_allclose(moved @ other, back @ one, rtol=1e-3, atol=1e-3)
        assert moved @ one > 0


def half_space_grid(radius_nodes, spacing_mm):
    """A grid on a homogeneous half-space: a thick layer without a rest."""
    side = 2 * radius_nodes + 1
    column, row = (index.ravel() for index in np.indices((side, side)))
    kernel = surface_kernel([ElasticLayer(60.0, 2.0, 0.3)], spacing_mm, (side, side))
    apart = np.abs(np.arange(side)[:, None] - np.arange(side))
    return (
        GridCompliance(
            kernel,
            np.zeros((side, side, side)),
            kernel[apart].astype(np.float32),
            np.eye(side),
            1,
            column,
            row - radius_nodes,
        ),
        (column - radius_nodes) * spacing_mm,
        (row - radius_nodes) * spacing_mm,
    )


@pytest.mark.slow
def test_a_sphere_on_a_half_space_is_hertz():
    modulus, radius_mm, depth_mm = 2.0 / (1 - 0.3**2), 4.0, 0.05
    compliance, x_mm, z_mm = half_space_grid(12, 0.05)
    overlap_mm = depth_mm - (x_mm**2 + z_mm**2) / (2 * radius_mm)
    force_n = GridContactSolver(compliance).press(overlap_mm)
    assert_allclose(force_n.sum(), 4 / 3 * modulus * radius_mm**0.5 * depth_mm**1.5, rtol=0.015)
    top_mpa = 2 / np.pi * modulus * np.sqrt(depth_mm / radius_mm)
    assert_allclose(force_n.max() / 0.05**2, top_mpa, rtol=0.02)
    by_force, deep_mm = GridContactSolver(compliance).press_with(-overlap_mm, force_n.sum())
    assert_allclose(deep_mm, 0.0, atol=2e-4)
    assert_allclose(by_force, force_n, atol=0.02 * force_n.max())


def plain_lcp(matrix, overlap, sweeps=4000):
    """Projected Gauss-Seidel: one node after the other, until nothing moves."""
    force = np.zeros(len(overlap))
    for _ in range(sweeps):
        before = force.copy()
        for n in range(len(overlap)):
            rest = matrix[n] @ force - matrix[n, n] * force[n]
            force[n] = max(0.0, (overlap[n] - rest) / matrix[n, n])
        if np.abs(force - before).max() <= 1e-9 * force.max(initial=1e-300):
            break
    return force


@pytest.mark.parametrize("few", [600, 0])
def test_conjugate_gradients_find_what_a_plain_loop_converges_to(few, monkeypatch):
    """With the factor of the nodes in contact, and with blocks."""
    monkeypatch.setattr("fembridge.touching.grid_contact._FEW_NODES", few)
    nodes = grid_nodes(RIDGED, 0.6)
    contact = ContactSolver.on_nodes(nodes)
    assert isinstance(contact, GridContactSolver)
    matrix = np.stack([contact.moved_mm(unit) for unit in np.eye(nodes.size)], axis=1)
    for place in (0.0, 0.05):
        gap_mm = nodes.gaps_mm(Shape.sphere(3.0).moved(place, 0.1))
        overlap_mm = 0.08 + gap_mm.min() - gap_mm
        expected = plain_lcp(matrix, overlap_mm)
        found = contact.press(overlap_mm)
        assert_allclose(found, expected, atol=0.03 * expected.max())
        assert_allclose(found.sum(), expected.sum(), rtol=5e-3)


@pytest.mark.parametrize("shape", [Shape.plate(), Shape.grating(0.5, 0.5, 0.5), Shape.dots(3.0)])
def test_nothing_pulls_and_nothing_is_inside_the_shape(shape):
    nodes = RIDGED.skin_nodes()
    gap_mm = nodes.gaps_mm(shape)
    nodes, gap_mm = nodes.subset(gap_mm < gap_mm.min() + 0.9), gap_mm[gap_mm < gap_mm.min() + 0.9]
    contact = ContactSolver.on_nodes(nodes)
    force_n, depth_mm = contact.press_with(gap_mm, 0.3)
    assert_allclose(force_n.sum(), 0.3, rtol=1e-6)
    assert force_n.min() >= 0
    away_mm = contact.moved_mm(force_n) + gap_mm - depth_mm
    assert np.abs(away_mm[force_n > 0]).max() < 2e-3
    assert away_mm.min() > -2e-3


# ---- Compared with the pad's own nodes, and with finer elements


@pytest.mark.parametrize(
    ("shape", "press_um", "force", "stress"),
    [(Shape.plate(), 500.0, 0.01, 0.02), (Shape.sphere(8.0), 300.0, 0.02, 0.05)],
)
def test_a_wide_contact_on_smooth_skin_is_that_of_the_pads_own_nodes(
    shape, press_um, force, stress
):
    level = np.array([press_um])
    fine, fine_n, _ = press_to(FLAT, shape, level)
    coarse, coarse_n, _ = press_to(PAD, shape, level)
    assert_allclose(fine_n.sum(), coarse_n.sum(), rtol=force)
    on_pad, on_pad_n = fine.spread_on_pad(fine_n)
    assert_allclose(on_pad_n.sum(), fine_n.sum(), rtol=1e-5)
    for site in PAD.afferents.values():
        place = np.array([site.layer]), np.zeros(1), np.zeros(1), np.array([site.depth_mm])
        here, there = (
            von_mises_pa(PAD.influence_pa(nodes, *place), forces)
            for nodes, forces in ((on_pad, on_pad_n), (coarse, coarse_n))
        )
        assert_allclose(here, there, rtol=stress)


@pytest.mark.slow
@pytest.mark.solver
@pytest.mark.filterwarnings("ignore:contact reaches the end")
def test_ridges_as_heights_press_as_ridges_of_elements():
    """A grating on ridges along the finger, modelled by elements of 0.125 mm, and as heights."""
    modelled = fb.make_pad(spacing_mm=0.125, reach_mm=2.0, ridges=True)
    without = fb.make_pad(spacing_mm=0.125, reach_mm=2.0)
    assert smooth(modelled.finger) == without.finger
    heights = with_ridges(without, Fingerprint("along", period_mm=0.5))
    units = Population.one_each(finger=without)
    slide = Trajectory.slide(80.0, press_um=400, direction_deg=0, duration_ms=200)
    grating = Shape.grating(1.5, 1.5, 0.5).rotated(90.0)
    elements, grid = (
        touch_skin(skin, grating, slide, units, parameter_set("fitted_pad"))
        for skin in (modelled, heights)
    )
    assert_allclose(grid.force_n.mean(), elements.force_n.mean(), rtol=0.05)
    smooth_skin = touch_skin(without, grating, slide, units, parameter_set("fitted_pad"))
    swing = [swing_pa(touched, 50, 400) for touched in (grid, elements, smooth_skin)]
    assert_allclose(swing[0], swing[1], rtol=0.6)
    assert min(swing[0][2], swing[1][2]) > 2 * swing[2][2]  # PC


def swing_pa(touched, low_hz, high_hz, first_ms=30):
    """Root of the mean square of each unit's stress in a band of frequencies."""
    dt_ms = touched.trajectory.dt_ms
    stress = touched.stress_pa[round(first_ms / dt_ms) :]
    window = np.hanning(len(stress))[:, None]
    power = np.abs(np.fft.rfft((stress - stress.mean(axis=0)) * window, axis=0)) ** 2
    hz = np.fft.rfftfreq(len(stress), dt_ms / 1e3)
    band = power[(hz >= low_hz) & (hz < high_hz)].sum(axis=0)
    return np.sqrt(2 * band / np.square(window).sum() / len(stress))


def test_forces_on_nodes_of_the_pad_spread_on_themselves():
    middle = LatticeNodes(RIDGED, np.array([36, 38, 37]), np.array([0, 2, 1]))
    on_pad, forces = middle.spread_on_pad(np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0, 0, 1]]))
    assert on_pad.pad is PAD
    for row, (column, place) in enumerate(((18, 0), (19, 1))):
        loaded = np.abs(forces[row]) > 1e-6
        assert (on_pad.column[loaded], on_pad.row[loaded]) == (column, place)
    # Between four nodes the moments are those of the force, too.
    assert_allclose(forces[2] @ on_pad.column, 18.5, rtol=1e-5)
    assert_allclose(forces[2] @ on_pad.row, 0.5, rtol=1e-4)


# ---- Ridges


@pytest.mark.parametrize("pattern", PATTERNS)
def test_ridges_are_a_period_apart_and_as_high_as_stated(pattern):
    print_ = Fingerprint(pattern, period_mm=0.5, height_mm=0.08)
    along = np.linspace(-8, 8, 20_001)
    line = (0.0 * along + 3.0, along) if pattern != "along" else (along, 0.0 * along)
    below_mm = print_.below_mm(*line)
    assert below_mm.min() >= 0
    assert_allclose(below_mm.max(), 0.08, rtol=1e-3)
    if pattern in ("across", "along"):
        tops = np.flatnonzero(np.diff(np.sign(np.diff(below_mm))) > 0)
        assert_allclose(np.diff(along[tops]), 0.5, atol=2e-3)


def test_a_share_of_the_period_is_even():
    below_mm = Fingerprint("across", top_share=0.6).below_mm(
        np.zeros(10_000), np.linspace(0, 44, 10_000)
    )
    assert_allclose((below_mm < 1e-12).mean(), 0.6, atol=0.01)


def test_a_seed_moves_the_ridges_and_nothing_else():
    place = np.zeros(50), np.linspace(0, 2, 50)
    one, same, other = (Fingerprint(seed=seed).below_mm(*place) for seed in (1, 1, 2))
    assert np.array_equal(one, same) and not np.allclose(one, other)


@pytest.mark.parametrize(
    ("ridges", "argument"),
    [
        ("spiral", "ridges"), (3, "ridges"), ("loop:period_mm=9", "period_mm"),
        ("whorl:node_mm=0.2,period_mm=0.3", "node_mm"), ("whorl:sead=1", "ridges"),
    ],
)  # fmt: skip
def test_a_fingerprint_of_nothing_is_refused(ridges, argument):
    with pytest.raises(UsageError) as error:
        resolve_fingerprint(ridges)
    assert error.value.argument == argument


def test_ridges_are_for_the_pad_of_a_smooth_finger_and_its_default():
    assert isinstance(with_ridges(PAD, None), RidgedPad)
    assert with_ridges(PAD, None) is with_ridges(PAD, None)  # kept for the next touch
    assert with_ridges(RIDGED, None) is RIDGED
    assert with_ridges(RIDGED, "none") is PAD
    plane = resolve_pad("plane")
    assert with_ridges(plane, None) is plane
    with pytest.raises(UsageError) as error:
        fb.touch(press_um=100, pad="plane", ridges="loop", population="one_each")
    assert error.value.argument == "ridges"


def test_a_touch_on_ridges_is_read_back_as_it_was_written(tmp_path):
    slide = Trajectory.slide(80.0, press_um=200, duration_ms=20)
    written = fb.touch("dots", slide, population="one_each", ridges="whorl:seed=2")
    assert written.provenance["ridges"]["seed"] == 2
    written.write(tmp_path / "out")
    read = Touch.read(tmp_path / "out")
    assert_allclose(read.stress_pa, written.stress_pa, rtol=1e-5, atol=1e-3)
    assert isinstance(read.contact.nodes.pad, RidgedPad)


@pytest.mark.slow
def test_ridges_shake_pc_as_a_grating_slides_over_them():
    """Ridges 0.44 mm apart meet an edge 180 times a second at 80 mm/s (Scheibert et al. 2009)."""
    slide = Trajectory.slide(80.0, press_n=0.3, direction_deg=90, duration_ms=150)
    units = Population.at(["PC"], [0.0], [0.0])
    grating = Shape.grating(1.5, 1.5, 0.5)
    band = [
        swing_pa(touch_skin(skin, grating, slide, units, parameter_set("fitted_pad")), 150, 210)
        for skin in (PAD, with_ridges(PAD, "across"))
    ]
    assert band[1] > 5 * band[0]


def test_stress_far_along_the_finger_fades_without_a_step():
    """The prism ends 13.3 mm from a force; a unit there saw forces come and go."""
    z_mm = np.linspace(8.0, 24.0, 321)
    force = PAD.nodes_from({"column": np.array([18]), "row": np.array([0])})
    place = np.full(z_mm.size, "subcutaneous_tissue"), 0 * z_mm, z_mm, 0 * z_mm + 2.0
    axial_pa = PAD.influence_pa(force, *place)[1, :, 0]
    assert np.abs(axial_pa[-1]) < 0.2 * np.abs(axial_pa).max()
    assert np.abs(np.diff(axial_pa)).max() < 0.05 * np.abs(axial_pa).max()


def test_friction_moves_the_contact_as_on_the_pads_own_nodes():
    """From the first state on: the grid takes friction from the forces of the state before."""
    slide = Trajectory.slide(80.0, press_um=300, duration_ms=12)
    units = Population.at(["PC"], [0.0], [0.0])
    middles = []
    for skin in (FLAT, PAD):
        touched = touch_skin(skin, Shape.plate(), slide, units, parameter_set("fitted_pad"))
        contact = touched.contact
        middles.append((contact.forces_n @ contact.nodes.z_mm) / contact.total_n)
    assert middles[1][0] > 0.1
    assert_allclose(middles[0], middles[1][0], atol=0.005)
