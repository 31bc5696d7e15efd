"""Stress at nodes of a post file, against closed forms and numbers worked by hand."""

import importlib.util
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from fembridge import read
from fembridge.results.marc import read as read_marc
from fembridge.results.marc import read_stress_tensor
from fembridge.results.read_options import ReadOptions


def _sibling(name):
    found = importlib.util.spec_from_file_location(
        f"fembridge_test_{name}", Path(__file__).parent / f"{name}.py"
    )
    module = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    return module


models = _sibling("stress_models")
TIMES_S = (0.0, 0.0005, 0.001, 0.0015)
FACTORS = (3.0, -2.0, 1.5, 0.7, -0.4, 0.2)


def linear_stress(x, y, layer, time_s):
    """Linear in place; in MPa, so that single precision is what is lost."""
    return [
        time_s * 1e3 * (f + 0.5 * (k + 1) * x - 0.3 * (k - 2) * y + 10 * layer)
        for k, f in enumerate(FACTORS)
    ]


@pytest.fixture(params=["t16", "t19", "big", "double"])
def storage(request, writer):
    """Each way in which a file may store its numbers."""
    return {
        "t16": writer.Storage(),
        "t19": writer.Storage(binary=False),
        "big": writer.Storage(big_endian=True),
        "double": writer.Storage(real_bytes=8),
    }[request.param]


@pytest.mark.parametrize("kind", [3, 11, 27, 54, 80])
def test_linear_stress_comes_out_at_every_node(kind, writer, write_post, storage):
    """A distorted mesh: what is linear in x and y is carried exactly."""
    nodes, quads = models.grid(3, 2, lambda x, y: (x + 0.2 * math.sin(3 * y), y + 0.15 * x * y))
    plane = models.Plane(kind, nodes, quads)
    increments = plane.increments(writer, linear_stress, TIMES_S)
    path = write_post(storage, plane.model(writer), increments)
    wanted = sorted(plane.bearing)

    times_ms, tensor_pa = read_stress_tensor(path, wanted)

    rounding = 3e-5 if path.suffix == ".t19" else 3e-6
    assert_allclose(times_ms, [0, 0.5, 1.0, 1.5], rtol=1e-6)
    for row, time_s in enumerate(TIMES_S):
        for column, node in enumerate(wanted):
            exact = 1e6 * np.array(linear_stress(*plane.nodes[node], 0, time_s))
            assert_allclose(tensor_pa[row, column], exact, rtol=0, atol=rounding * 1e7)


def test_traces_are_of_the_nodal_tensor_and_begin_at_increment_0(writer, write_post):
    nodes, quads = models.grid(2, 2)
    plane = models.Plane(80, nodes, quads)
    path = write_post(
        writer.Storage(), plane.model(writer), plane.increments(writer, linear_stress, TIMES_S)
    )
    first, second = read(path, [5, 1])
    assert (first.node, second.node) == (5, 1)
    assert first.start_ms == 0.0
    assert first.dt_ms == pytest.approx(0.5, rel=1e-6)
    for trace in (first, second):
        exact = [
            1e6 * models.von_mises(linear_stress(*plane.nodes[trace.node], 0, t)) for t in TIMES_S
        ]
        assert_allclose(trace.stress_pa, exact, rtol=1e-5)


def test_two_elements_worked_by_hand(writer, write_post):
    """Elements of 2 x 1 side by side; only sxx is not 0; points 1 to 4 as stored.

    At the corner itself the bilinear interpolant weighs its own point with
    a = 1 + √3/2, the two beside with -1/2, the far one with b = 1 - √3/2.
    Node 2 is corner 2 of element 1 and corner 1 of element 2.
    """
    nodes = {1: (0, 0), 2: (2, 0), 3: (4, 0), 4: (0, 1), 5: (2, 1), 6: (4, 1)}
    plane = models.Plane(11, nodes, [(1, 2, 5, 4), (2, 3, 6, 5)])
    stored = [[10.0, 20.0, 30.0, 44.0], [1.0, 2.0, 4.0, 8.0]]
    element = [[[abs(s), s, 0, 0, 0, 0, 0] for s in row] for row in stored]
    increments = [writer.Increment(number=k, time_s=k * 1e-3, element=element) for k in (0, 1)]
    path = write_post(writer.Storage(), plane.model(writer), increments)
    a, b = 1 + math.sqrt(3) / 2, 1 - math.sqrt(3) / 2

    def at(node, method):
        options = ReadOptions(extrapolate=method)
        return read_stress_tensor(path, [node], options)[1][0, 0, 0] / 1e6

    in_first = -0.5 * 10 + a * 20 + b * 30 - 0.5 * 44
    in_second = a * 1 - 0.5 * 2 - 0.5 * 4 + b * 8
    assert at(2, "linear") == pytest.approx((in_first + in_second) / 2, rel=1e-6)
    assert at(1, "linear") == pytest.approx(a * 10 - 0.5 * 50 + b * 44, rel=1e-6)
    assert at(2, "translate") == pytest.approx((20 + 1) / 2)
    assert at(5, "translate") == pytest.approx((44 + 4) / 2)
    assert at(2, "average") == pytest.approx((104 / 4 + 15 / 4) / 2)
    assert at(4, "average") == pytest.approx(104 / 4)


def test_both_ways_to_von_mises_agree_where_stress_is_uniform_and_else_do_not(writer, write_post):
    """Shear that turns its sign inside the element: the tensor's is 0 at mid-height,
    the points' is √3 |τ| of each."""
    nodes, quads = models.grid(1, 1)
    plane = models.Plane(11, nodes, quads)

    def file(stress):
        return write_post(
            writer.Storage(), plane.model(writer), plane.increments(writer, stress, (0.0, 1.0))
        )

    def trace(path, way, method="average"):
        options = ReadOptions(von_mises=way, extrapolate=method)
        return read_marc(path, [1], options)[0].stress_pa[0]

    same = file(lambda x, y, layer, t: [3.0, 1.0, -2.0, 0.5, 0, 0])
    uniform = 1e6 * models.von_mises([3.0, 1.0, -2.0, 0.5, 0, 0])
    assert trace(same, "tensor") == pytest.approx(uniform, rel=1e-6)
    assert trace(same, "scalar") == pytest.approx(uniform, rel=1e-6)
    turning = file(lambda x, y, layer, t: [0, 0, 0, y - 0.5, 0, 0])
    assert trace(turning, "tensor") == pytest.approx(0.0, abs=1.0)
    shear = math.sqrt(3) * 0.5 / math.sqrt(3)
    assert trace(turning, "scalar") == pytest.approx(1e6 * shear, rel=1e-6)
    assert trace(turning, "tensor", "linear") == pytest.approx(1e6 * math.sqrt(3) * 0.5, rel=1e-6)
    assert trace(turning, "scalar", "linear") == pytest.approx(1e6 * shear, rel=1e-6)


def test_the_points_own_von_mises_is_taken_as_stored_and_computed_without_it(writer, write_post):
    nodes, quads = models.grid(1, 1)
    plane = models.Plane(11, nodes, quads)
    stored = plane.increments(writer, linear_stress, (0.0, 1e-3))
    odd = [[[7.0, *values[1:]] for values in row] for row in stored[1].element]
    stored = (stored[0], replace(stored[1], element=odd))
    path = write_post(writer.Storage(), plane.model(writer), stored)
    said = []
    options = ReadOptions(von_mises="scalar", extrapolate="translate", tell=said.append)
    assert read_marc(path, [1], options)[0].stress_pa[1] == pytest.approx(7e6)
    assert "Equivalent Von Mises Stress (code 17)" in said[0]
    bare = [replace(one, element=[[v[1:] for v in row] for row in one.element]) for one in stored]
    path = write_post(writer.Storage(), plane.model(writer, codes=models.CODES[1:]), bare)
    first_point = models.place(plane.corners[0], *models.POINTS[4][0])
    wanted = 1e6 * models.von_mises(linear_stress(*first_point, 0, 1e-3))
    trace = read_marc(path, [1], options)[0]
    assert trace.stress_pa[1] == pytest.approx(wanted, rel=1e-6)
    assert "at the points" in said[-1]


def test_von_mises_below_zero_is_told(writer, write_post):
    """Points 2 and 3 have 1 MPa, the others none: at corner 1 that is -1/2 each."""
    plane = models.Plane(11, *models.grid(1, 1))
    element = [[[s, s, 0, 0, 0, 0, 0] for s in (0.0, 1.0, 1.0, 0.0)]]
    increments = [writer.Increment(number=k, time_s=k * 1e-3, element=element) for k in (0, 1)]
    path = write_post(writer.Storage(), plane.model(writer), increments)
    said = []
    options = ReadOptions(von_mises="scalar", tell=said.append)
    assert read_marc(path, [1], options)[0].stress_pa[0] == pytest.approx(-1e6)
    assert any("von Mises stress is below 0 at 0 ms" in words for words in said)


def test_one_point_elements_give_their_point_to_every_corner(writer, write_post):
    nodes, quads = models.grid(2, 1)
    plane = models.Plane(118, nodes, quads)
    path = write_post(
        writer.Storage(), plane.model(writer), plane.increments(writer, linear_stress, TIMES_S)
    )
    centre = 1e6 * np.array(linear_stress(0.5, 0.5, 0, 1e-3))
    other = 1e6 * np.array(linear_stress(1.5, 0.5, 0, 1e-3))
    for method in ("linear", "translate", "average"):
        options = ReadOptions(extrapolate=method)
        tensor_pa = read_stress_tensor(path, [1, 2, 3], options)[1][2]
        wanted = [centre, (centre + other) / 2, other]
        assert_allclose(tensor_pa, wanted, rtol=1e-5, atol=1)


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    columns=st.integers(1, 4),
    rows=st.integers(1, 3),
    kind=st.sampled_from([11, 27, 54, 80, 118]),
    method=st.sampled_from(["linear", "translate", "average"]),
    seed=st.integers(0, 2**32 - 1),
)
def test_a_node_has_the_mean_of_its_elements_as_a_plain_loop_finds_it(
    columns, rows, kind, method, seed, writer, write_post
):
    from fembridge.results.extrapolation import node_weights

    rng = np.random.default_rng(seed)
    plane = models.Plane(kind, *models.grid(columns, rows))
    values = rng.normal(size=(len(plane.quads), plane.count, 7))
    increments = [writer.Increment(number=k, time_s=k * 1e-3, element=values) for k in (0, 1)]
    storage = writer.Storage(real_bytes=8)
    path = write_post(storage, plane.model(writer), increments)
    node = int(rng.choice(sorted(plane.bearing)))
    total, count = np.zeros(6), 0
    for nodes, at_points in zip(plane.elements, values, strict=True):
        weights = node_weights(kind, len(nodes), plane.count, method)
        if node in nodes[: len(weights)]:
            total += weights[nodes.index(node)] @ at_points[:, 1:]
            count += 1
    found = read_stress_tensor(path, [node], ReadOptions(extrapolate=method))[1]
    assert_allclose(found[1, 0], 1e6 * total / count, rtol=1e-9, atol=1e-3)
