"""Whole fields of a post file: one increment, ParaView, places and sets."""

import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from fembridge.errors import ResultError, UsageError
from fembridge.results.field_file import column_names, read_field
from fembridge.results.marc import read_stress_tensor
from fembridge.results.near_node import near_nodes
from fembridge.results.node_choice import NodeChoice
from fembridge.results.read_options import ReadOptions


def _sibling(name):
    found = importlib.util.spec_from_file_location(
        f"fembridge_test_{name}", Path(__file__).parent / f"{name}.py"
    )
    module = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    return module


models = _sibling("stress_models")
TIMES_S = (0.0, 0.001, 0.002)
SETS = (
    ("probes", 1, (3, 9), ()),
    ("empty", 1, (), ()),
    ("soft", 0, (1, 2, 4, 5), ()),
    ("stiff", 0, (3, 6), ()),
)


def linear_stress(x, y, layer, time_s):
    return [1e3 * time_s * (k + x - 2 * y + 50 * layer) for k in range(6)]


@pytest.fixture(params=[11, 27, 80])
def plane(request):
    """Six elements, a layer boundary at x = 2."""
    return models.Plane(request.param, *models.grid(3, 2), layers=[0, 0, 1, 0, 0, 1])


@pytest.fixture
def path(plane, writer, write_post):
    """A file of it."""
    increments = plane.increments(writer, linear_stress, TIMES_S)
    return write_post(writer.Storage(), plane.model(writer, sets=SETS), increments)


def test_a_stress_field_has_the_nodes_inside_layers_and_says_what_it_left(path, plane):
    said = []
    field = read_field(path, "Stress", "1", ReadOptions(tell=said.append))
    between = {n for n in plane.bearing if plane.nodes[n][0] == 2.0}
    assert set(field.nodes.tolist()) == plane.bearing - between
    assert f"left out: {len(between)} nodes lie between layers" in "; ".join(said)
    assert (field.increment, field.components) == (1, ("SXX", "SYY", "SZZ", "SXY", "SYZ", "SZX"))
    assert field.time_ms == pytest.approx(1.0)
    for node, values in zip(field.nodes.tolist(), field.values, strict=True):
        x, y = plane.nodes[node]
        exact = 1e6 * np.array(linear_stress(x, y, int(x > 2), 0.001))
        assert_allclose(values, exact, rtol=0, atol=1e3)


def test_a_field_across_materials_is_the_mean_that_traces_take(path, plane):
    options = ReadOptions(across_materials=True)
    field = read_field(path, "stress", options=options)
    nodes = sorted(plane.bearing)
    assert sorted(field.nodes.tolist()) == nodes
    _, tensor_pa = read_stress_tensor(path, nodes, options)
    assert_allclose(field.at(nodes), tensor_pa[-1], rtol=1e-12, atol=1e-6)


@settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    kind=st.sampled_from([11, 27, 54, 80, 118]),
    layers=st.lists(st.integers(0, 2), min_size=6, max_size=6),
    method=st.sampled_from(["linear", "translate", "average"]),
    seed=st.integers(0, 2**32 - 1),
)
def test_a_field_and_the_traces_of_its_nodes_are_the_same_numbers(
    kind, layers, method, seed, writer, write_post
):
    plane = models.Plane(kind, *models.grid(3, 2), layers=layers)
    values = np.random.default_rng(seed).normal(size=(6, plane.count, 7))
    increments = [writer.Increment(number=0, element=values)]
    path = write_post(writer.Storage(real_bytes=8), plane.model(writer), increments)
    options = ReadOptions(extrapolate=method)
    field = read_field(path, "Stress", options=options)
    if field.nodes.size:
        found = read_stress_tensor(path, field.nodes.tolist(), options)[1]
        assert_allclose(field.values, found[0], rtol=1e-9, atol=1e-3)
    mean = ReadOptions(extrapolate=method, across_materials=True)
    every = read_field(path, "Stress", options=mean)
    assert every.nodes.size == len(plane.bearing)
    found = read_stress_tensor(path, every.nodes.tolist(), mean)[1]
    assert_allclose(every.values, found[0], rtol=1e-9, atol=1e-3)


def test_a_nodal_field_has_all_nodes_but_those_of_pressure(path, plane):
    field = read_field(path, "disp", "2")
    assert field.name == "Displacement"
    assert set(field.nodes.tolist()) == plane.bearing
    assert column_names(field) == ["dx_mm", "dy_mm"]
    for node, (x, y) in zip(field.nodes.tolist(), field.values.tolist(), strict=True):
        assert (x, y) == (pytest.approx(0.002), -node)


def test_names_are_as_short_as_they_are_clear(path):
    assert read_field(path, "equiv").name == "Equivalent Von Mises Stress"
    assert read_field(path, "STRESS").name == "Stress"
    with pytest.raises(ResultError, match="no heat in it, it holds Displacement, Equ"):
        read_field(path, "heat")
    with pytest.raises(UsageError, match="'' may be Displacement or Equivalent"):
        read_field(path, "")


def test_an_increment_that_is_not_there_is_refused_with_those_there(path):
    with pytest.raises(ResultError, match="no increment 7 of Stress, it has 0:0 to 0:2"):
        read_field(path, "Stress", "7")


def test_increments_of_one_number_are_told_apart_by_their_sub_increment(plane, writer, write_post):
    increments = [
        replace(one, number=4, sub=k)
        for k, one in enumerate(plane.increments(writer, linear_stress, TIMES_S))
    ]
    path = write_post(writer.Storage(), plane.model(writer), increments)
    with pytest.raises(UsageError, match="increment 4 is in 3 steps: 0:4, 1:4, 2:4"):
        read_field(path, "Displacement", "4")
    assert read_field(path, "Displacement", "1:4").time_ms == pytest.approx(1.0)


def test_the_nearest_node_is_one_with_elements(path, plane):
    (near,) = near_nodes(path, [(1.1, 0.9)])
    assert plane.nodes[near.node] == (1.0, 1.0)
    assert near.distance_mm == pytest.approx(np.hypot(0.1, 0.1))
    (origin,) = near_nodes(path, [(-1.0, -1.0)])  # where pressure nodes stand
    assert origin.node == 1


def test_nodes_of_a_set_of_the_file_are_found_case_blind(path):
    said = []
    assert NodeChoice(sets=["PROBES"]).resolve(path, said.append) == [3, 9]
    assert said == [f"set PROBES of {path.name}: 2 nodes, 3, 9"]
    with pytest.raises(ResultError, match="set empty holds no nodes"):
        NodeChoice(sets=["empty"]).resolve(path)
    with pytest.raises(UsageError, match="no node set 'soft'; it has probes, empty"):
        NodeChoice(sets=["soft"]).resolve(path)


def test_a_set_of_a_deck_can_be_named(path, tmp_path):
    marc, abaqus = tmp_path / "mine.dat", tmp_path / "mine.inp"
    words = f"{'define':20}{'node':20}{'set':20}"
    marc.write_text(f"title\nextended\nend\n{words}tip\n{4:10}{2:10}\nend option\n")
    abaqus.write_text("*NSET, NSET=FOOT\n1, 2\n")
    assert NodeChoice(sets=["TIP"], deck=marc).resolve(path) == [4, 2]
    assert NodeChoice(sets=["foot"], deck=abaqus).resolve(path) == [1, 2]
    with pytest.raises(UsageError, match=r"mine.dat: no node set 'x'; it has tip"):
        NodeChoice(sets=["x"], deck=marc).resolve(path)
