"""Few nodes in contact on the fine grid, solved directly: beside dense systems and plain loops."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from fembridge.touching import grid_contact
from fembridge.touching.contact import ContactSolver, blas_threads
from fembridge.touching.contact_history import solve_contact
from fembridge.touching.grid_contact import _Factors
from fembridge.touching.pad_file import resolve_pad
from fembridge.touching.ridged_pad import with_ridges
from fembridge.touching.shape import Shape
from fembridge.touching.trajectory import Trajectory

RIDGED = with_ridges(resolve_pad("reference"), "loop")


@pytest.mark.parametrize("most_factors", [1, 24])
@pytest.mark.parametrize("force_n", [None, 0.7])
def test_bordered_factors_solve_the_system_of_the_nodes_in_contact(
    force_n, most_factors, monkeypatch
):
    monkeypatch.setattr(grid_contact, "_MOST_FACTORS", most_factors)
    rng = np.random.default_rng(3)
    root = rng.normal(size=(140, 140))
    entries = (root @ root.T + 60 * np.eye(140)).astype(np.float32)
    factors = _Factors()
    first = rows = np.sort(rng.permutation(120)[:80])
    # Few border a factor, thirty make another; nodes come near; a set comes again.
    for near, exchanged in [(120, n) for n in (0, 1, 3, 4, 30, 2)] + [(140, 5), (140, None)]:
        if exchanged is None:
            rows = first
        else:
            leaving = rng.permutation(rows)[:exchanged]
            entering = rng.permutation(np.setdiff1d(np.arange(near), rows))[:exchanged]
            rows = np.union1d(np.setdiff1d(rows, leaving), entering)
        gap = rng.normal(size=near).astype(np.float32)
        found, moved, depth = factors.solve(entries[:near, :near], rows, gap, force_n)
        matrix = entries[np.ix_(rows, rows)].astype(np.float64)
        expected = np.zeros(near)
        expected[rows] = np.linalg.solve(matrix, depth - gap[rows])
        assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())
        assert_allclose(moved[rows], depth - gap[rows], atol=1e-4 * np.abs(moved).max())
        assert_allclose(moved, entries[:near, :near] @ expected, atol=1e-4 * np.abs(moved).max())
        if force_n is None:
            assert depth == 0.0
        else:
            assert_allclose(found.sum(), force_n, rtol=1e-4)


def test_displacement_by_friction_is_that_of_the_operator():
    nodes = RIDGED.skin_nodes()
    nodes = nodes.subset((np.abs(nodes.x_mm) < 1.1) & (np.abs(nodes.z_mm) < 1.1))
    compliance = nodes.compliance((0.1, -0.4))
    rows = np.arange(nodes.size)
    forces = np.random.default_rng(4).uniform(0, 1e-3, nodes.size).astype(np.float32)
    window = np.zeros(compliance.shape, dtype=np.float32)
    window.flat[compliance.at] = forces
    expected = compliance.drag_moved_mm(window).ravel()[compliance.at]
    found = compliance.drag_entries_mm(rows, rows) @ forces
    assert_allclose(found, expected, atol=3e-3 * np.abs(expected).max())


SLIDES = [
    (Shape.dots(1.5, 0.5, 0.4), Trajectory.slide(80, press_um=250, duration_ms=25)),
    (Shape.grating(0.5, 0.5), Trajectory.slide(80, press_n=0.2, duration_ms=25)),
    (Shape.sphere(4.0).moved(0, 1), Trajectory.slide(80, press_n=0.1, duration_ms=25)),
]


@pytest.mark.parametrize(("shape", "slide"), SLIDES)
def test_a_slide_is_that_of_conjugate_gradients(shape, slide, monkeypatch):
    """Each is within 1 % of the forces, in sum of absolute differences."""
    direct = solve_contact(RIDGED, shape, slide, 0.4)
    monkeypatch.setattr(grid_contact._NearNodes, "start", lambda *_: None)
    monkeypatch.setattr(grid_contact._NearNodes, "solve", lambda *_: None)
    gradients = solve_contact(RIDGED, shape, slide, 0.4)
    found, expected = (on_grid(contact) for contact in (direct, gradients))
    differs = np.abs(found - expected).sum(axis=(1, 2)) / expected.sum(axis=(1, 2))
    assert differs.max() < 0.02
    assert_allclose(direct.depth_um, gradients.depth_um, atol=1.0)


def on_grid(contact):
    """Forces ``(S, column, row)`` on the whole grid."""
    nodes = contact.nodes
    forces = np.zeros((len(contact.forces_n), nodes.pad.x_mm.size, 2 * nodes.pad.end_row + 1))
    forces[:, nodes.column, nodes.row + nodes.pad.end_row] = contact.forces_n
    return forces


@pytest.mark.parametrize("most_near", [1_200, 30])
@pytest.mark.parametrize(("shape", "slide"), SLIDES[:2])
def test_no_node_is_inside_the_shape_at_any_step(shape, slide, most_near, monkeypatch):
    """Also of those that are not looked at in each step, by the whole operator."""
    monkeypatch.setattr(grid_contact, "_MOST_NEAR", most_near)
    nodes = RIDGED.skin_nodes()
    nodes = nodes.subset(-nodes.height_mm < 0.9)
    contact, whole = (ContactSolver.on_nodes(nodes) for _ in range(2))
    for step in range(0, 51, 2):
        moved = shape.moved(0.0, float(slide.z_mm[step]))
        level = 0.2 if slide.by_force else 250.0
        gap = nodes.gaps_mm(moved)
        force_n, depth_mm = contact.press_by(gap, level, by_force=slide.by_force)
        away_mm = whole.moved_mm(force_n) + gap - depth_mm
        own_mm = nodes.compliance().own_mm * force_n.sum() / (force_n > 0).sum()
        assert force_n.min() >= 0
        assert away_mm.min() > -0.06 * own_mm  # the table is within 0.2 % of the operator
        assert np.abs(away_mm[force_n > 0.01 * force_n.max()]).max() < 0.06 * own_mm


def test_a_force_that_presses_deeper_between_the_tried_steps_reaches_further_nodes():
    """A ball slides off the middle of the finger by steps that are not tried first."""
    way_mm = np.interp(np.arange(61), [0, 15, 45, 60], [0.0, 4.0, -4.0, 0.0])
    still = np.zeros(61)
    slide = Trajectory(force_n=np.full(61, 0.1), x_mm=way_mm, z_mm=still)
    found = solve_contact(RIDGED, Shape.sphere(4.0), slide, 0.0)
    assert_allclose(found.total_n, 0.1, rtol=1e-4)
    alone = Trajectory(force_n=np.full(2, 0.1), x_mm=np.full(2, 4.0), z_mm=np.zeros(2))
    expected = solve_contact(RIDGED, Shape.sphere(4.0), alone, 0.0)
    assert_allclose(found.depth_um[found.position == 15.0], expected.depth_um[:1], rtol=2e-3)


def test_contact_comes_and_goes_and_leaves_nothing_behind():
    """A press, no contact, and the same press: what is kept between steps does not show."""
    nodes = RIDGED.skin_nodes()
    nodes = nodes.subset(-nodes.height_mm < 0.5)
    gap = nodes.gaps_mm(Shape.sphere(5.0))
    contact = ContactSolver.on_nodes(nodes)
    first = contact.press_by(gap, 300.0, by_force=False)[0]
    assert not contact.press_by(gap, -10.0, by_force=False)[0].any()
    again = contact.press_by(gap, 300.0, by_force=False)[0]
    assert_allclose(again, first, atol=1e-6 * first.max())


def test_contact_on_the_grid_takes_one_thread_however_many_nodes_may_touch():
    from threadpoolctl import threadpool_info

    contact = ContactSolver.on_nodes(RIDGED.skin_nodes())
    with blas_threads(contact.nodes_at_once):
        threads = {info["num_threads"] for info in threadpool_info() if info["user_api"] == "blas"}
    assert threads == {1}
