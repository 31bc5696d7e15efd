"""Whole fields of a post file: one increment, ParaView, places and sets; any damage."""

import contextlib
import os
import warnings

import meshio
import numpy as np
import post_writer as writer
import pytest
import stress_models as models
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from opened import choose_nodes, near_nodes, read_field, sides, written

from fembridge import read, write_vtu_series
from fembridge.errors import FembridgeError, ResultError, UsageError
from fembridge.results import describe
from fembridge.results.history import column_names
from fembridge.results.read_options import ReadOptions
from fembridge.results.readers import read_values

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
def path(plane, write_post):
    """A file of it."""
    increments = plane.increments(linear_stress, TIMES_S)
    return write_post(writer.Storage(), plane.model(sets=SETS), increments)


def test_a_nodal_field_has_all_nodes_but_those_of_pressure(path, plane):
    field = read_field(path, "disp", "2")
    assert field.name == "Displacement"
    assert set(field.nodes.tolist()) == plane.bearing
    assert column_names(field.components, field.units) == ["dx_mm", "dy_mm"]
    for node, (x, y) in zip(field.nodes.tolist(), field.values.tolist(), strict=True):
        assert (x, y) == (pytest.approx(0.002), -node)


def test_nodes_of_a_set_of_the_file_are_found_case_blind(path):
    said = []
    assert choose_nodes(path, sets=["PROBES"], options=ReadOptions(log=said.append)) == [3, 9]
    assert said == [f"set PROBES of {path.name}: 2 nodes, 3, 9"]
    with pytest.raises(ResultError, match="set empty has 0 nodes"):
        choose_nodes(path, sets=["empty"])
    with pytest.raises(UsageError, match="no node set 'soft'; it has probes, empty"):
        choose_nodes(path, sets=["soft"])


def test_a_set_of_a_deck_can_be_named(path, tmp_path):
    marc, abaqus = tmp_path / "mine.dat", tmp_path / "mine.inp"
    words = f"{'define':20}{'node':20}{'set':20}"
    marc.write_text(f"title\nextended\nend\n{words}tip\n{4:10}{2:10}\nend option\n")
    abaqus.write_text("*NSET, NSET=FOOT\n1, 2\n")
    assert choose_nodes(path, sets=["TIP"], deck=marc) == [4, 2]
    assert choose_nodes(path, sets=["foot"], deck=abaqus) == [1, 2]
    with pytest.raises(UsageError, match=r"mine.dat: no node set 'x'; it has tip"):
        choose_nodes(path, sets=["x"], deck=marc)


def test_paraview_gets_each_layer_s_own_values_at_a_boundary(path, plane, tmp_path):
    found = written(write_vtu_series(path, tmp_path / "out"))
    assert [time_ms for time_ms, _ in found] == pytest.approx([0.0, 1.0, 2.0])
    mesh = meshio.read(found[2][1])
    data = mesh.point_data
    assert {"Stress_pa", "von_mises_pa", "Displacement_mm", "node", "materials"} <= set(data)
    (cells,) = mesh.cells
    assert cells.type == {11: "quad", 80: "quad", 27: "quad8"}[plane.kind]
    layer = mesh.cell_data["material"][0]
    assert_array_equal(layer, plane.layers)
    assert_array_equal(mesh.cell_data["material stiff"][0], layer)
    for row, corners in enumerate(cells.data):
        nodes = plane.elements[row][: len(corners)]
        assert data["node"][corners].tolist() == list(nodes)
        for point, node in zip(corners, nodes, strict=True):
            x, y = plane.nodes[node]
            assert_allclose(mesh.points[point], [x, y, 0])
            exact = [1e6 * s for s in linear_stress(x, y, layer[row], 0.002)]
            assert_allclose(data["Stress_pa"][point], exact, rtol=0, atol=1e3)
            mises = models.von_mises(exact)
            assert data["von_mises_pa"][point] == pytest.approx(mises, rel=1e-4)
            assert data["Displacement_mm"][point].tolist() == [pytest.approx(0.002), -node]
            assert data["materials"][point] == 1 + (x == 2.0)


def test_unknown_elements_are_left_out_of_pictures_and_that_is_said(write_post, tmp_path):
    plane = models.Plane(11, *models.grid(2, 1))
    (first, second) = plane.model().elements
    elements = (first, (second[0], 998, second[2], second[3]))
    increments = plane.increments(linear_stress, (0.0,))
    model = plane.model(elements=elements)
    path, said = write_post(writer.Storage(), model, increments), []
    series = write_vtu_series(path, tmp_path, quantities=["Displacement"], log=said.append)
    assert len(meshio.read(written(series)[0][1]).cells[0].data) == 1
    assert "left out: elements of unknown type 998" in said
    assert read_field(path, "Displacement").nodes.size == 6


def test_nodes_between_bricks_lie_where_vtk_looks_for_them(write_post, tmp_path):
    """Marc's brick of 20: corners, middles of the bottom, of the top, then upright."""
    corners = [(x, y, z) for z in (0, 2) for x, y in ((0, 0), (2, 0), (2, 2), (0, 2))]
    pairs = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4)]
    pairs += [(k, k + 4) for k in range(4)]
    middles = [
        tuple((a + b) / 2 for a, b in zip(corners[p], corners[q], strict=True)) for p, q in pairs
    ]
    places = [*corners, *middles]
    model = writer.Model(
        node_ids=tuple(range(1, 21)),
        coordinates=tuple(places),
        elements=((1, 21, tuple(range(1, 21)), (1, 1, 1, 1, 0)),),
        points=27,
        codes=models.CODES,
        dimensions=3,
    )
    moved = writer.Quantity("Displacement", 1, 3, places)
    increments = [writer.Increment(number=0, nodal=(moved,))]
    path = write_post(writer.Storage(), model, increments)
    mesh = meshio.read(written(write_vtu_series(path, tmp_path))[0][1])
    (cells,) = mesh.cells
    assert cells.type == "hexahedron20"
    found = mesh.points[cells.data[0]]
    for k, (p, q) in enumerate(pairs):
        assert_allclose(found[8 + k], (found[p] + found[q]) / 2)


PARTIAL = ReadOptions(partial=True)
MUTATED = 1000 if os.environ.get("CI") == "true" else 40


WAYS = {
    "traces": lambda path: read(path, [1, 5], partial=True, across_materials=True),
    "scalar": lambda path: read(path, [5], von_mises="scalar"),
    "sides": lambda path: sides(path, 5, options=PARTIAL),
    "list": describe,
    "stress": lambda path: read_field(path, "Stress", options=PARTIAL),
    "moved": lambda path: read_field(path, "Displacement", options=PARTIAL),
    "near": lambda path: near_nodes(path, [(0.4, 0.4)]),
    "set": lambda path: choose_nodes(path, sets=["probes"]),
    "vtu": lambda path: write_vtu_series(path, path.parent / "vtu", partial=True),
}


@pytest.fixture(scope="module", params=["t16", "t19"])
def whole(request):
    """Give a small file: a function of no argument, for its bytes and its name."""
    plane = models.Plane(80, *models.grid(2, 2), layers=[0, 0, 1, 1])
    increments = plane.increments(
        lambda x, y, layer, t: [t * x, 0, 0, y, 0, 0], (0.0, 0.001, 0.002)
    )
    storage = writer.Storage(binary=request.param == "t16")
    model = plane.model(sets=(("probes", 1, (5,), ()),))
    content = writer.post_bytes(storage, model, increments)
    return lambda: (content, storage.name)  # which a failing test does not print


@settings(max_examples=MUTATED, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(way=st.sampled_from(sorted(WAYS)), seed=st.integers(0, 2**32 - 1), changes=st.integers(1, 4))
def test_changed_bytes_are_an_error_of_ours_or_numbers(way, seed, changes, whole, tmp_path):
    content, name = whole()
    rng = np.random.default_rng(seed)
    damaged = bytearray(content)
    for at in rng.integers(0, len(damaged), changes):
        damaged[at] = rng.choice([0, 1, 32, 45, 48, 57, 69, 127, 128, 255])
    if rng.integers(4) == 0:
        damaged = damaged[: rng.integers(1, len(damaged))]
    path = tmp_path / name
    path.unlink(missing_ok=True)  # else the disk is waited for
    path.write_bytes(damaged)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with contextlib.suppress(FembridgeError):
            WAYS[way](path)


@settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    kind=st.sampled_from([11, 27, 54, 80, 118]),
    layers=st.lists(st.integers(0, 2), min_size=6, max_size=6),
    method=st.sampled_from(["linear", "translate", "average"]),
    seed=st.integers(0, 2**32 - 1),
)
def test_a_field_and_the_traces_of_its_nodes_are_the_same_numbers(
    kind, layers, method, seed, write_post
):
    plane = models.Plane(kind, *models.grid(3, 2), layers=layers)
    values = np.random.default_rng(seed).normal(size=(6, plane.count, 7))
    increments = [writer.Increment(number=0, element=values)]
    path = write_post(writer.Storage(real_bytes=8), plane.model(), increments)
    options = ReadOptions(extrapolate=method)
    field = read_field(path, "Stress", options=options)
    if field.nodes.size:
        found = read_values(path, field.nodes.tolist(), options)[1]
        assert_allclose(field.values, found[0], rtol=1e-9, atol=1e-3)
    mean = ReadOptions(extrapolate=method, across_materials=True)
    every = read_field(path, "Stress", options=mean)
    assert every.nodes.size == len(plane.bearing)
    found = read_values(path, every.nodes.tolist(), mean)[1]
    assert_allclose(every.values, found[0], rtol=1e-9, atol=1e-3)
