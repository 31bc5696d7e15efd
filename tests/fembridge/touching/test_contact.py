"""The active set against a plain loop, Hertz, and what every contact must satisfy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from fembridge.errors import UsageError
from fembridge.touching.compliance import DenseCompliance
from fembridge.touching.contact import MOST_NODES, ContactSolver, blas_threads
from fembridge.touching.pad_file import resolve_pad
from fembridge.touching.shape import Shape

PAD = resolve_pad("reference")


def plain_lcp(matrix, overlap, sweeps=20_000):
    """Projected Gauss-Seidel: one node after the other, until nothing moves."""
    force = np.zeros(len(overlap))
    for _ in range(sweeps):
        before = force.copy()
        for n in range(len(overlap)):
            rest = matrix[n] @ force - matrix[n, n] * force[n]
            force[n] = max(0.0, (overlap[n] - rest) / matrix[n, n])
        if np.abs(force - before).max() <= 1e-13 * force.max(initial=1e-300):
            break
    return force


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000), nodes=st.integers(2, 25))
def test_the_active_set_is_what_a_plain_loop_converges_to(seed, nodes):
    rng = np.random.default_rng(seed)
    place = rng.uniform(0, 3, (nodes, 2))
    away = np.linalg.norm(place[:, None] - place, axis=2)
    matrix = np.exp(-away) + 0.3 * np.eye(nodes)
    contact = ContactSolver(DenseCompliance(matrix))
    for _ in range(3):  # the second and third begin where the one before ended
        overlap = rng.normal(0.3, 1.0, nodes)
        force = contact.press(overlap)
        assert_allclose(force, plain_lcp(matrix, overlap), atol=1e-4)


def love_compliance(x, y, half, modulus):
    """Depth at (x, y) from the middle of a square of unit force; Love 1929."""

    def corner(a, b):
        return a * np.arcsinh(b / np.abs(a)) + b * np.arcsinh(a / np.abs(b))

    a, b = x + half, y + half
    c, d = x - half, y - half
    area = corner(a, b) - corner(a, d) - corner(c, b) + corner(c, d)
    return area / (np.pi * modulus * (2 * half) ** 2)


def test_a_sphere_on_a_half_space_is_hertz():
    modulus, radius, depth, pitch = 2.0, 4.0, 0.05, 0.04
    at = np.arange(-14, 15) * pitch
    x, y = (each.ravel() for each in np.meshgrid(at, at))
    matrix = love_compliance(x[:, None] - x, y[:, None] - y, 0.5 * pitch, modulus)
    gap = radius - np.sqrt(radius**2 - x**2 - y**2)
    force = ContactSolver(DenseCompliance(matrix)).press(depth - gap)
    assert_allclose(force.sum(), 4 / 3 * modulus * radius**0.5 * depth**1.5, rtol=0.01)
    touching_mm2 = (force > 0).sum() * pitch**2
    assert_allclose(touching_mm2, np.pi * radius * depth, rtol=0.06)
    largest = force.max() / pitch**2
    assert_allclose(largest, 2 * modulus / np.pi * (depth / radius) ** 0.5, rtol=0.02)


def under(shape, within_mm):
    """Nodes of the skin so near below a shape that just touches, and their gaps."""
    nodes = PAD.skin_nodes()
    gap = nodes.gaps_mm(shape)
    near = gap < gap.min() + within_mm
    return nodes.subset(near), gap[near] - gap.min()


@pytest.mark.parametrize(
    "shape",
    [
        Shape.punch(1.0),
        Shape.sphere(8.0).moved(1.0, 2.0),
        Shape.plate(),
        Shape.grating(1.0, 1.0).rotated(30.0),
        Shape.braille("b"),
    ],
    ids=lambda shape: shape.name,
)
def test_nothing_pulls_and_nothing_is_inside_the_shape(shape):
    nodes, gap = under(shape, 0.3)
    contact = ContactSolver.on_nodes(nodes)
    matrix = nodes.compliance().matrix
    for depth in (0.1, 0.3, 0.2):
        force = contact.press(depth - gap)
        outside = matrix @ force - (depth - gap)
        assert (force >= 0).all()
        assert outside.min() >= -2e-5 * depth
        assert np.abs(outside[force > 0]).max() <= 1e-9 * depth


def test_a_force_presses_to_the_depth_that_gives_it():
    nodes, gap = under(Shape.sphere(6.0), 0.5)
    by_depth = ContactSolver.on_nodes(nodes).press(0.4 - gap)
    by_force, depth = ContactSolver.on_nodes(nodes).press_with(gap, float(by_depth.sum()))
    assert_allclose(depth, 0.4, rtol=1e-9)
    assert_allclose(by_force, by_depth, atol=1e-12)


def test_drag_towards_one_side_moves_the_force_there_and_mirrors():
    nodes, gap = under(Shape.punch(2.0), 0.2)
    forward, back = (
        ContactSolver.on_nodes(nodes, (0.0, drag)).press(0.2 - gap) for drag in (0.4, -0.4)
    )
    assert_allclose(forward.sum(), back.sum(), rtol=1e-9)
    assert_allclose((forward * nodes.z_mm).sum(), -(back * nodes.z_mm).sum(), rtol=1e-6)
    assert abs((forward * nodes.z_mm).sum()) > 0


def test_too_many_nodes_are_refused():
    nodes = PAD.skin_nodes(half_length_mm=60.0)
    with pytest.raises(UsageError, match="6000"):
        ContactSolver.on_nodes(nodes)


def test_a_start_from_no_contact_takes_few_nodes_in_at_a_time():
    """Nodes that carry all of a force alone go so deep that all others would enter."""
    nodes, gap = under(Shape.grating(), 0.8)
    contact = ContactSolver.on_nodes(nodes)
    sizes = []
    exchange = contact._set.exchange

    def counted(enter, leave):
        sizes.append(int(enter.sum()))
        exchange(enter, leave)

    contact._set.exchange = counted
    force, _ = contact.press_with(gap, 0.5)
    assert max(sizes) < 0.5 * gap.size
    assert force.sum() == pytest.approx(0.5)


def test_contact_runs_in_one_thread_of_the_blas_and_gives_the_others_back():
    from threadpoolctl import threadpool_info

    def threads():
        return [each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas"]

    before = threads()
    with blas_threads(100):
        assert set(threads()) <= {1}
        with blas_threads(100):
            assert set(threads()) <= {1}
        assert set(threads()) <= {1}
    assert threads() == before
    with blas_threads(MOST_NODES):
        assert threads() == before
