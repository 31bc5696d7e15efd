"""A post file at nodes and whole, against closed forms and a plain loop; any damage."""

import contextlib
import math
import os
import warnings
from dataclasses import replace

import numpy as np
import post_writer as writer
import pytest
import stress_models as models
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from opened import choose_nodes, naming, near_nodes, pictured, read_field, shows, sides

from fembridge import read, read_history, write_vtu_series
from fembridge.errors import FembridgeError, FembridgeWarning, ResultError, UsageError
from fembridge.io.run_folder import AfferentNode, RunFolder
from fembridge.results import describe
from fembridge.results.extrapolation import UNKNOWN_LAYERS
from fembridge.results.history import column_names
from fembridge.results.read_options import ReadOptions
from fembridge.results.readers import open_source, read_values


def mises_at(path, node, options):
    """Von Mises stress at a node."""
    with open_source(path, options) as source:
        return source.history([node], "von-mises").derived("von-mises").values[:, 0, 0]


TIMES_S = (0.0, 0.0005, 0.001, 0.0015)
FACTORS = (3.0, -2.0, 1.5, 0.7, -0.4, 0.2)


def linear_stress(x, y, layer, time_s):
    """Linear in place; in MPa, so that single precision is what is lost."""
    return [
        time_s * 1e3 * (f + 0.5 * (k + 1) * x - 0.3 * (k - 2) * y + 10 * layer)
        for k, f in enumerate(FACTORS)
    ]


@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize("kind", [3, 11, 27, 54, 80])
def test_linear_stress_comes_out_at_every_node(kind, write_post, binary):
    """A sheared mesh: what is linear in x and y is carried exactly."""
    nodes, quads = models.grid(3, 2, lambda x, y: (x + 0.4 * y, y + 0.15 * x))
    plane = models.Plane(kind, nodes, quads)
    increments = plane.increments(linear_stress, TIMES_S)
    path = write_post(writer.Storage(binary), plane.model(), increments)
    wanted = sorted(plane.bearing)

    times_ms, tensor_pa = read_values(path, wanted)

    rounding = 3e-5 if path.suffix == ".t19" else 3e-6
    assert_allclose(times_ms, [0, 0.5, 1.0, 1.5], rtol=1e-6)
    for row, time_s in enumerate(TIMES_S):
        for column, node in enumerate(wanted):
            exact = 1e6 * np.array(linear_stress(*plane.nodes[node], 0, time_s))
            assert_allclose(tensor_pa[row, column], exact, rtol=0, atol=rounding * 1e7)


@pytest.fixture
def square(write_post):
    """A file of one element with this stress at its points."""
    plane = models.Plane(11, *models.grid(1, 1))

    def written(stress, change=lambda increments: increments, **changes):
        increments = change(plane.increments(stress, (0.0, 1e-3)))
        return write_post(writer.Storage(), plane.model(**changes), increments)

    return written


def test_both_ways_to_von_mises_agree_where_stress_is_uniform_and_else_do_not(square):
    """Shear that turns its sign inside the element: the tensor's is 0 at mid-height,
    the points' is √3 |τ| of each."""

    def found(path, way, method="average"):
        return mises_at(path, 1, ReadOptions(von_mises=way, extrapolate=method))[0]

    same = square(lambda x, y, layer, t: [3.0, 1.0, -2.0, 0.5, 0, 0])
    for way in ("tensor", "scalar"):
        uniform = 1e6 * models.von_mises([3.0, 1.0, -2.0, 0.5, 0, 0])
        assert found(same, way) == pytest.approx(uniform, rel=1e-6)
    turning = square(lambda x, y, layer, t: [0, 0, 0, y - 0.5, 0, 0])
    assert found(turning, "tensor") == pytest.approx(0.0, abs=1.0)
    assert found(turning, "tensor", "linear") == pytest.approx(1e6 * math.sqrt(3) / 2, rel=1e-6)
    for method in ("average", "linear"):
        assert found(turning, "scalar", method) == pytest.approx(0.5e6, rel=1e-6)


def test_the_points_own_von_mises_is_taken_as_stored_and_computed_without_it(square, logged):
    def points(change):
        return lambda increments: [
            replace(one, element=[[change(values) for values in row] for row in one.element])
            for one in increments
        ]

    said = logged
    options = ReadOptions(von_mises="scalar", extrapolate="translate")
    path = square(linear_stress, points(lambda values: [7.0, *values[1:]]))
    assert mises_at(path, 1, options)[1] == pytest.approx(7e6)
    assert "Equivalent Von Mises Stress (code 17)" in said[0]
    path = square(linear_stress, points(lambda values: values[1:]), codes=models.CODES[1:])
    first_point = models.place([(0, 0), (1, 0), (1, 1), (0, 1)], *models.POINTS[4][0])
    wanted = 1e6 * models.von_mises(linear_stress(*first_point, 0, 1e-3))
    assert mises_at(path, 1, options)[1] == pytest.approx(wanted, rel=1e-6)
    assert "at the points" in said[-1]


@pytest.fixture
def stored(write_post):
    """A file of two increments that have these values at the points of a plane."""

    def written(plane, values, **changes):
        made = [writer.Increment(number=k, time_s=k * 1e-3, element=values) for k in (0, 1)]
        return write_post(writer.Storage(real_bytes=8), plane.model(**changes), made)

    return written


@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    columns=st.integers(1, 4),
    rows=st.integers(1, 3),
    kind=st.sampled_from([11, 27, 54, 80, 118]),
    method=st.sampled_from(["linear", "translate", "average"]),
    seed=st.integers(0, 2**32 - 1),
)
def test_a_node_has_the_mean_of_its_elements_as_a_plain_loop_finds_it(
    columns, rows, kind, method, seed, stored
):
    from fembridge.results.extrapolation import node_weights

    rng = np.random.default_rng(seed)
    plane = models.Plane(kind, *models.grid(columns, rows))
    values = rng.normal(size=(len(plane.quads), plane.count, 7))
    path = stored(plane, values)
    node = int(rng.choice(sorted(plane.bearing)))
    total, count = np.zeros(6), 0
    for nodes, at_points in zip(plane.elements, values, strict=True):
        weights = node_weights(kind, len(nodes), plane.count, method)
        if node in nodes[: len(weights)]:
            total += weights[nodes.index(node)] @ at_points[:, 1:]
            count += 1
    found = read_values(path, [node], ReadOptions(extrapolate=method))[1]
    assert_allclose(found[1, 0], 1e6 * total / count, rtol=1e-9, atol=1e-3)


@pytest.mark.parametrize(
    ("firsts", "taken", "named"),
    [
        ((311,), 0, "Stress (codes 311 to 316)"),
        ((341,), 0, "Cauchy Stress (codes 341 to 346)"),
        ((311, 341), 1, "Cauchy Stress (codes 341 to 346)"),
        ((11,), 0, ""),
    ],
)
@pytest.mark.parametrize("way", [1, -1])
def test_the_first_stress_tensor_there_is_is_taken_and_named(
    firsts, taken, named, way, stored, logged
):
    """Of components in any order."""
    plane = models.Plane(11, *models.grid(1, 1))
    codes = [(first + k, 0, "") for first in firsts for k in range(6)][::way]
    values = [[[code % 5 + 10.0 * (code > 340) for code, _, _ in codes]] * 4]
    path = stored(plane, values, codes=tuple(codes))
    said = logged
    found = read_values(path, [1], ReadOptions())[1]
    first = firsts[taken]
    wanted = [1e6 * (code % 5 + 10.0 * (code > 340)) for code in range(first, first + 6)]
    assert_allclose(found[0, 0], wanted)
    assert said[-1].startswith(f"stress: {named}")


@pytest.mark.parametrize(
    ("codes", "shown"),
    [
        (((17, 0, ""),), ("Equivalent Von Mises Stress", 17, "--von-mises scalar")),
        (
            tuple((681 + k, 0, "") for k in range(6)),
            ("Logarithmic Strain", "681 to 686"),
        ),
        (((7, 0, ""), (301, 0, "")), (311, 341)),
        (
            tuple((311 + k, layer, "") for layer in (1, 3) for k in range(6)),
            (311, "1, 3"),
        ),
    ],
)
def test_a_file_without_one_stress_tensor_says_what_it_has(codes, shown, stored):
    plane = models.Plane(11, *models.grid(1, 1))
    path = stored(plane, [[[1.0] * len(codes)] * 4], codes=codes)
    with pytest.raises(ResultError, match=naming(path.name, *shown)):
        read_values(path, [1])


# Two columns of elements to the left are layer 0, one to the right is layer 1.
SOFT_MPA, STIFF_MPA = 1.0, 40.0
BETWEEN, INSIDE, IN_STIFF = 7, 6, 8


def uniform(x, y, layer, time_s):
    return [(STIFF_MPA if layer else SOFT_MPA) * time_s, 0, 0, 0, 0, 0]


@pytest.fixture
def two_layers():
    """Six elements, a layer boundary at x = 2."""
    return models.Plane(11, *models.grid(3, 2), layers=[0, 0, 1, 0, 0, 1])


def file_of(plane, write_post, **changes):
    increments = plane.increments(uniform, (0.0, 1.0))
    model = plane.model(**changes)
    return write_post(writer.Storage(), model, increments)


def last_mpa(path, node, **options):
    tensor_pa = read_values(path, [node], ReadOptions(**options))[1]
    return tensor_pa[-1, 0, 0] / 1e6


LAYERS = (("epidermis", 0, (1, 2, 4, 5), ()), ("dermis", 0, (3, 6), ()), ("n", 1, (7,), ()))


@pytest.mark.parametrize(
    ("changes", "names"),
    [
        ({}, ("1 1 1 3 1", "2 1 1 3 1")),
        ({"sets": LAYERS}, ("epidermis", "dermis", "--one-sided")),
        ({"sets": LAYERS, "revision": 12}, ("epidermis", "dermis")),  # which has no ids
    ],
)
def test_a_node_between_layers_is_refused_with_both_names(two_layers, write_post, changes, names):
    path = file_of(two_layers, write_post, **changes)
    with pytest.raises(ResultError, match=naming("node 7", *names)):
        last_mpa(path, BETWEEN)
    assert last_mpa(path, IN_STIFF) == pytest.approx(STIFF_MPA)


def test_each_side_of_a_boundary_for_itself(two_layers, write_post):
    path = file_of(two_layers, write_post, sets=LAYERS)
    soft, stiff = sides(path, BETWEEN)
    assert (soft.name, stiff.name) == ("epidermis", "dermis")
    assert (soft.elements, stiff.elements) == ((2, 5), (3, 6))
    assert_allclose(soft.von_mises_pa, [0, SOFT_MPA * 1e6], rtol=1e-6)
    assert_allclose(stiff.von_mises_pa, [0, STIFF_MPA * 1e6], rtol=1e-6)
    (alone,) = sides(path, INSIDE)
    assert alone.elements == (1, 2, 4, 5)


def test_a_file_that_tells_no_layers_is_read_and_that_is_said(two_layers, write_post, logged):
    path = file_of(two_layers, write_post, revision=12)
    said = logged
    mean = (2 * SOFT_MPA + 2 * STIFF_MPA) / 4
    assert last_mpa(path, BETWEEN) == pytest.approx(mean)
    assert UNKNOWN_LAYERS in said


def deck_text(plane):
    """A deck of version 15, free layout, with a ``connectivity`` for each layer."""
    lines = ["title", "version,15", "table,0", "end"]
    for layer in (0, 1):
        lines += ["connectivity", f"0,0,1,0,1,{layer + 1},0,1,0,"]
        lines += [
            ",".join(map(str, (row, plane.kind, *nodes, "")))
            for row, (nodes, mine) in enumerate(zip(plane.elements, plane.layers, strict=True), 1)
            if mine == layer
        ]
    lines += ["coordinates", f"3,{len(plane.nodes)},0,1,"]
    lines += [f"{node},{x},{y},0.," for node, (x, y) in plane.nodes.items()]
    return "\n".join([*lines, "end option", ""])


def test_the_deck_beside_tells_the_materials_of_a_file_without_ids(
    two_layers, write_post, tmp_path, file
):
    path = file("job.t16", file_of(two_layers, write_post, revision=12).read_bytes())
    (tmp_path / "job.dat").write_text(deck_text(two_layers))
    with pytest.raises(ResultError, match=naming("job.t16", "node 7", "material 1", "material 2")):
        last_mpa(path, BETWEEN)
    assert last_mpa(path, INSIDE) == pytest.approx(SOFT_MPA)


def test_a_collapsed_quadrilateral_counts_once_with_both_its_corners(stored):
    """Element 2 has node 2 at its corners 1 and 2: the mean of both is its share."""
    nodes = {1: (0, 0), 2: (1, 0), 3: (1, 1), 4: (0, 1), 5: (2, 1)}
    plane = models.Plane(11, nodes, [(1, 2, 3, 4), (2, 2, 5, 3)])
    values = np.random.default_rng(3).normal(size=(2, 4, 7))
    path = stored(plane, values)
    options = ReadOptions(extrapolate="translate")
    found = read_values(path, [2], options)[1][0, 0] / 1e6
    second = (values[1, 0, 1:] + values[1, 1, 1:]) / 2
    assert_allclose(found, (values[0, 1, 1:] + second) / 2, rtol=1e-12)
    field = read_field(path, "Stress", options=options)
    assert_allclose(field.values_at([2])[0] / 1e6, found, rtol=1e-12)


def in_time(x, y, layer, time_s):
    return [1e3 * time_s, 0, 0, 0, 0, 0]


# Four elements with pressure nodes 10 to 13; stress grows by 1 MPa an increment.
PLANE = models.Plane(80, *models.grid(2, 2))
INCREMENTS = PLANE.increments(in_time, (0.0, 0.001, 0.002, 0.003))


@pytest.fixture
def growing(write_post):
    """A file of these increments."""
    return lambda made=INCREMENTS: write_post(writer.Storage(), PLANE.model(), made)


@pytest.mark.parametrize(
    ("node", "shown"),
    [
        (99, ("node 99", "1 to 13", "11, 12, 13")),
        (10, ("node 10",)),
        (0, ("node 0",)),
        (-1, ("node -1",)),
    ],
)
def test_a_node_without_stress_is_named(node, shown, growing):
    with pytest.raises(ResultError, match=naming(*shown)):
        read(growing(), [node])


@pytest.mark.parametrize("known", [(1, 2, 3, 5), ()])
def test_an_element_with_a_node_that_is_not_listed_is_named(known, write_post):
    model = writer.Model(
        node_ids=known, coordinates=writer.Model().coordinates[: len(known)], codes=models.CODES
    )
    ones = np.ones((1, 4, len(models.CODES)))
    increments = [writer.Increment(k, time_s=0.1 * k, element=ones) for k in (1, 2)]
    path = write_post(writer.Storage(), model, increments)
    shown = naming(path.name, "element 7", f"node {4 if known else 1}")
    with pytest.raises(ResultError, match=shown):
        read(path, [1])
    with pytest.raises(ResultError, match=shown):
        read_field(path, "Stress", "last", ReadOptions())
    with pytest.raises(ResultError, match=shown):
        read(path, near_mm=[(0.0, 0.0)])


def test_a_cut_file_is_refused_and_read_in_part_on_request(growing, logged):
    path = growing()
    path.write_bytes(path.read_bytes()[:-700])
    with pytest.raises(ResultError, match=naming(path.name, "byte", "--partial")):
        read(path, [1])
    said = logged
    (trace,) = read(path, [1], partial=True)
    assert_allclose(trace.stress_pa, [0, 1e6, 2e6], rtol=1e-6, atol=1)
    assert any("increment" in words for words in said)


def test_increments_without_element_values_are_left_out_and_told(growing, logged):
    bare = tuple(replace(one, element=None) for one in INCREMENTS)
    path = growing((bare[0], *INCREMENTS[1:]))
    said = logged
    (trace,) = read(path, [1])
    assert trace.start_ms == pytest.approx(1.0)
    assert any(shows(line, "Stress", 0) for line in said)
    with pytest.raises(ResultError, match=naming("'post'", 311)):
        read(growing(bare), [1])


def test_a_post_file_gives_any_quantity_at_nodes_and_without_stress_displacement(marc_samples):
    path = marc_samples / "nour_plastic.t16"
    found = read_history(path, [5, 18])
    assert list(found)[-2:] == ["dx_mm", "dy_mm"]
    last = read_field(path, "Displacement").values_at([18])[0]
    assert_allclose(found.iloc[-1, -2:].astype(float), last)
    metres = read_history(path, [18], quantity="displacement", length_unit="m")
    assert_allclose(metres.iloc[-1, -2:].astype(float), 1000 * last)
    every = read_history(path, "all", quantity="reaction-force")
    assert every["node"].nunique() == 85
    with pytest.raises(ResultError, match=naming("nour_plastic.t16", 311, 341)):
        read_history(path, [5], quantity="von-mises")


def test_points_that_no_element_has_may_hold_anything(stored, logged):
    """A quadrilateral of 4 points in a file that stores 9: the others are ignored."""
    plane = models.Plane(11, *models.grid(2, 1))
    values = np.full((2, 9, 7), np.nan)
    values[:, :4] = plane.at_points(in_time, 0.001)
    path = stored(plane, values, points=9)
    said = logged
    tensor_pa = read_values(path, [2], ReadOptions())[1]
    assert_allclose(tensor_pa[0, 0, 0], 1e6, rtol=1e-6)
    assert any(shows(line, 9, 4) for line in said)
    assert_allclose(read_field(path, "Stress").values[:, 0], 1e6, rtol=1e-6)


def test_an_unknown_element_type_is_refused_and_averaged_on_request(stored):
    plane = models.Plane(11, *models.grid(1, 1))
    strange = tuple((n, 998, nodes, more) for n, _, nodes, more in
                    plane.model().elements)  # fmt: skip
    path = stored(plane, [[[s] * 7 for s in (1, 2, 3, 6)]], elements=strange)
    with pytest.raises(ResultError, match=naming(path.name, "element 1", "type 998")):
        read_values(path, [1])
    options = ReadOptions(extrapolate="average")
    assert_allclose(read_values(path, [1], options)[1], 3e6)


def test_a_job_that_gave_up_is_distinguished_from_its_status_file(
    growing, marc_samples, tmp_path, logged
):
    path, said = tmp_path / "job.t16", logged
    path.write_bytes(growing().read_bytes())
    status = (marc_samples / "nour_plastic.sts").read_text()
    path.with_suffix(".sts").write_text(status)
    read(path, [1])
    assert not any("job.sts" in words for words in said)
    path.with_suffix(".sts").write_text(status.replace("3004", "3002"))
    read(path, [1])
    assert any("job.sts" in words for words in said)
    path.with_suffix(".sts").write_text("something else\n")
    assert read(path, [1])[0].stress_pa.size == 4


def stress_mpa(x, y, layer, time_s):
    """Linear in place and jumping from layer to layer."""
    return [time_s * 1e3 * (0.01 * (k + 1) + 0.02 * x - 0.01 * y + 0.5 * layer) for k in range(6)]


def own_run(folder, times_s, increments, start_ms, **more):
    """A run folder of someone's own model, with an afferent at node 5."""
    plane = models.Plane(11, *models.grid(2, 2))
    made = plane.increments(stress_mpa, times_s)
    (folder / "job.t16").write_bytes(writer.post_bytes(writer.Storage(), plane.model(), made))
    place = AfferentNode("SA", 5, "dermis", 1.0, 1.0, 1.0)
    RunFolder(folder, "marc", increments, 0.5, start_ms, (place,), "0", **more).write()
    return folder


def test_steps_before_the_stimulus_need_not_have_its_time_step(tmp_path):
    """Two steps of its owner's to 0.3 s, then the stimulus."""
    times_s = (0.0, 0.1, 0.3, 0.3005, 0.301, 0.3015)
    (trace,) = read(own_run(tmp_path, times_s, 3, 300.0, before_ms=300.0))
    exact = [1e6 * models.von_mises(stress_mpa(1, 1, 0, t)) for t in times_s[2:]]
    assert_allclose(trace.stress_pa, exact, rtol=1e-5)
    assert (trace.start_ms, round(trace.dt_ms, 4)) == (0.0, 0.5)


def test_someone_s_own_model_may_be_in_another_unit(tmp_path):
    own_run(tmp_path, (0.0, 0.0005, 0.001), 2, 0.0, stress_unit="kPa")
    exact = 1e3 * models.von_mises(stress_mpa(1.0, 1.0, 0, 0.001))
    assert read(tmp_path)[0].stress_pa[-1] == pytest.approx(exact, rel=1e-5)
    with pytest.raises(UsageError, match=naming("stress_unit", "MPa", "kPa")):
        read(tmp_path, stress_unit="MPa")
    with pytest.raises(UsageError, match=naming("length_unit", "m", "mm")):
        read(tmp_path, length_unit="m")


# ---- Whole fields: one increment, ParaView, places and sets; any damage

SETS = (
    ("probes", 1, (3, 9), ()),
    ("empty", 1, (), ()),
    ("soft", 0, (1, 2, 4, 5), ()),
    ("stiff", 0, (3, 6), ()),
)


def layered_stress(x, y, layer, time_s):
    return [1e3 * time_s * (k + x - 2 * y + 50 * layer) for k in range(6)]


@pytest.fixture(params=[11, 27, 80])
def layered(request):
    """Six elements, a layer boundary at x = 2."""
    return models.Plane(request.param, *models.grid(3, 2), layers=[0, 0, 1, 0, 0, 1])


@pytest.fixture
def post(layered, write_post):
    """A file of it."""
    increments = layered.increments(layered_stress, (0.0, 0.001, 0.002))
    return write_post(writer.Storage(), layered.model(sets=SETS), increments)


def test_a_nodal_field_has_all_nodes_but_those_of_pressure(post, layered):
    field = read_field(post, "disp", "2")
    assert field.name == "Displacement"
    assert set(field.nodes.tolist()) == layered.bearing
    assert column_names(field.components, field.units) == ["dx_mm", "dy_mm"]
    for node, (x, y) in zip(field.nodes.tolist(), field.values.tolist(), strict=True):
        assert (x, y) == (pytest.approx(0.002), -node)


def test_nodes_of_a_set_of_the_file_are_found_case_blind(post, logged):
    said = logged
    assert choose_nodes(post, sets=["PROBES"], options=ReadOptions()) == [3, 9]
    assert len(said) == 1
    assert shows(said[0], "PROBES", post.name, 2, "3, 9")
    with pytest.raises(ResultError, match=naming(post.name, "empty", 0)):
        choose_nodes(post, sets=["empty"])
    with pytest.raises(UsageError, match=naming(post.name, "'soft'", "probes, empty")):
        choose_nodes(post, sets=["soft"])


def test_a_set_of_a_deck_can_be_named(post, tmp_path):
    marc, abaqus = tmp_path / "mine.dat", tmp_path / "mine.inp"
    words = f"{'define':20}{'node':20}{'set':20}"
    marc.write_text(f"title\nextended\nend\n{words}tip\n{4:10}{2:10}\nend option\n")
    abaqus.write_text("*NSET, NSET=FOOT\n1, 2\n")
    assert choose_nodes(post, sets=["TIP"], deck=marc) == [4, 2]
    assert choose_nodes(post, sets=["foot"], deck=abaqus) == [1, 2]
    with pytest.raises(UsageError, match=naming("mine.dat", "'x'", "tip")):
        choose_nodes(post, sets=["x"], deck=marc)


def test_paraview_gets_each_layer_s_own_values_at_a_boundary(post, layered, tmp_path):
    found = pictured(post, tmp_path / "out")
    assert [time_ms for time_ms, _ in found] == pytest.approx([0.0, 1.0, 2.0])
    mesh = found[2][1]
    data = mesh.point_data
    assert {"Stress_pa", "von_mises_pa", "Displacement_mm", "node", "materials"} <= set(data)
    (cells,) = mesh.cells
    assert cells.type == {11: "quad", 80: "quad", 27: "quad8"}[layered.kind]
    layer = mesh.cell_data["material"][0]
    assert_array_equal(layer, layered.layers)
    assert_array_equal(mesh.cell_data["material stiff"][0], layer)
    for row, corners in enumerate(cells.data):
        nodes = layered.elements[row][: len(corners)]
        assert data["node"][corners].tolist() == list(nodes)
        for point, node in zip(corners, nodes, strict=True):
            x, y = layered.nodes[node]
            assert_allclose(mesh.points[point], [x, y, 0])
            exact = [1e6 * s for s in layered_stress(x, y, layer[row], 0.002)]
            assert_allclose(data["Stress_pa"][point], exact, rtol=0, atol=1e3)
            mises = models.von_mises(exact)
            assert data["von_mises_pa"][point] == pytest.approx(mises, rel=1e-4)
            assert data["Displacement_mm"][point].tolist() == [pytest.approx(0.002), -node]
            assert data["materials"][point] == 1 + (x == 2.0)


def test_unknown_elements_are_left_out_of_pictures_and_that_is_said(write_post, tmp_path, logged):
    plane = models.Plane(11, *models.grid(2, 1))
    (first, second) = plane.model().elements
    elements = (first, (second[0], 998, second[2], second[3]))
    increments = plane.increments(layered_stress, (0.0,))
    model = plane.model(elements=elements)
    path, said = write_post(writer.Storage(), model, increments), logged
    series = pictured(path, tmp_path, quantities=["Displacement"])
    assert len(series[0][1].cells[0].data) == 1
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
    mesh = pictured(path, tmp_path)[0][1]
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
        warnings.simplefilter("ignore", FembridgeWarning)  # a doubt about numbers is an answer
        with contextlib.suppress(FembridgeError):
            WAYS[way](path)


@settings(max_examples=10, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    kind=st.sampled_from([11, 27, 54, 80, 118]),
    layers=st.lists(st.integers(0, 2), min_size=6, max_size=6),
    method=st.sampled_from(["linear", "translate", "average"]),
    seed=st.integers(0, 2**32 - 1),
)
def test_a_field_and_the_traces_of_its_nodes_are_the_same_numbers(
    kind, layers, method, seed, stored
):
    plane = models.Plane(kind, *models.grid(3, 2), layers=layers)
    values = np.random.default_rng(seed).normal(size=(6, plane.count, 7))
    path = stored(plane, values)
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
