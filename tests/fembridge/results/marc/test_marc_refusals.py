"""What a post file may hold that is no stress history at the nodes asked for."""

import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from fembridge import read
from fembridge.errors import ResultError
from fembridge.results.field_file import read_field
from fembridge.results.marc import read_displacement, read_stress_tensor
from fembridge.results.marc_nodes.clock import unrounded_ms
from fembridge.results.read_options import ReadOptions


def _sibling(name):
    found = importlib.util.spec_from_file_location(
        f"fembridge_test_{name}", Path(__file__).parent / f"{name}.py"
    )
    module = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    return module


models = _sibling("stress_models")
TIMES_S = (0.0, 0.001, 0.002, 0.003)


def in_time(x, y, layer, time_s):
    return [1e3 * time_s, 0, 0, 0, 0, 0]


@pytest.fixture
def plane():
    """Four elements with pressure nodes 10 to 13."""
    return models.Plane(80, *models.grid(2, 2))


@pytest.fixture
def increments(plane, writer):
    """Four of them, stress grows by 1 MPa each."""
    return plane.increments(writer, in_time, TIMES_S)


@pytest.fixture
def write(plane, writer, write_post):
    """Write increments of `plane`."""

    def written(increments, storage=None, **changes):
        storage = storage or writer.Storage()
        return write_post(storage, plane.model(writer, **changes), increments)

    return written


@pytest.mark.parametrize(
    ("node", "told"),
    [
        (99, r"no node 99 in the mesh: it has 1 to 13, near it 11, 12, 13"),
        (10, r"node 10 is a corner of no element with values: a pressure node"),
        (0, r"no node 0 in the mesh"),
        (-1, r"no node -1 in the mesh"),
    ],
)
def test_a_node_without_stress_is_named(node, told, write, increments):
    with pytest.raises(ResultError, match=told):
        read(write(increments), [node])


@pytest.mark.parametrize("known", [(1, 2, 3, 5), ()])
def test_an_element_with_a_node_that_is_not_listed_is_named(known, writer, write_post):
    model = writer.Model(
        node_ids=known, coordinates=writer.Model().coordinates[: len(known)], codes=models.CODES
    )
    ones = np.ones((1, 4, len(models.CODES)))
    increments = [writer.Increment(k, time_s=0.1 * k, element=ones) for k in (1, 2)]
    path = write_post(writer.Storage(), model, increments)
    told = f"element 7 has node {4 if known else 1}, which has no coordinates"
    with pytest.raises(ResultError, match=told):
        read(path, [1])
    with pytest.raises(ResultError, match=told):
        read_field(path, "Stress", "last", ReadOptions())
    with pytest.raises(ResultError, match=told):
        read(path, near_mm=[(0.0, 0.0)])


def test_a_cut_file_is_refused_and_read_in_part_on_request(write, increments):
    path = write(increments)
    whole = path.read_bytes()
    path.write_bytes(whole[:-700])
    with pytest.raises(ResultError, match=r"; --partial .partial=True. takes what is"):
        read(path, [1])
    said = []
    (trace,) = read(path, [1], partial=True, tell=said.append)
    assert_allclose(trace.stress_pa, [0, 1e6, 2e6], rtol=1e-6, atol=1)
    assert any("increment" in words for words in said)


def test_increments_without_element_values_are_left_out_and_told(write, increments, writer):
    first = replace(increments[0], element=None)
    path = write((first, *increments[1:]))
    said = []
    (trace,) = read(path, [1], tell=said.append)
    assert trace.start_ms == pytest.approx(1.0)
    assert "left out: increments without element values, 0" in said
    bare = tuple(replace(one, element=None) for one in increments)
    with pytest.raises(ResultError, match="no element values in it: the deck's 'post'"):
        read(write(bare), [1])


def test_uneven_times_are_refused(write, increments, writer):
    late = replace(increments[3], time_s=0.0035)
    with pytest.raises(ResultError, match="node 1: uneven time step, "):
        read(write((*increments[:3], late)), [1])
    times_ms, _ = read_stress_tensor(write((*increments[:3], late)), [1])
    assert_allclose(times_ms, [0, 1, 2, 3.5], rtol=1e-6)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_stress_that_is_not_finite_is_refused_or_its_increment_dropped(
    value, write, increments, writer
):
    bad = np.array(increments[2].element)
    bad[0, 0, 1] = value
    changed = (*increments[:2], replace(increments[2], element=bad))
    path = write((*changed, increments[3]))
    with pytest.raises(ResultError, match="node 1 at 2 ms: stress is not finite"):
        read(path, [1])
    (trace,) = read(path, [9])
    assert trace.stress_pa.size == 4
    said = []
    options = ReadOptions(partial=True, tell=said.append)
    times_ms, _ = read_stress_tensor(path, [1], options)
    assert_allclose(times_ms, [0, 1, 3], rtol=1e-6)
    assert any("dropped increment 2: node 1" in words for words in said)


def test_points_that_no_element_has_may_hold_anything(writer, write_post):
    """A quadrilateral of 4 points in a file that stores 9: the others are ignored."""
    plane = models.Plane(11, *models.grid(2, 1))
    values = np.full((2, 9, 7), np.nan)
    values[:, :4] = plane.at_points(in_time, 0.001)
    increments = [writer.Increment(number=0, element=values)]
    path = write_post(writer.Storage(), plane.model(writer, points=9), increments)
    said = []
    tensor_pa = read_stress_tensor(path, [2], ReadOptions(tell=said.append))[1]
    assert_allclose(tensor_pa[0, 0, 0], 1e6, rtol=1e-6)
    assert any("the file stores 9 for each element: the first 4" in w for w in said)
    from fembridge.results.field_file import read_field

    assert_allclose(read_field(path, "Stress").values[:, 0], 1e6, rtol=1e-6)


def test_one_stored_point_is_the_element_s_mean_and_that_is_told(writer, write_post):
    plane = models.Plane(11, *models.grid(1, 1))
    element = [[[5.0] * 7]]
    increments = [writer.Increment(number=0, element=element)]
    path = write_post(writer.Storage(), plane.model(writer, points=1), increments)
    said = []
    tensor_pa = read_stress_tensor(path, [1], ReadOptions(tell=said.append))[1]
    assert_allclose(tensor_pa, 5e6)
    assert any("taken as the element's mean" in words for words in said)


def test_an_unknown_element_type_is_refused_and_averaged_on_request(writer, write_post):
    plane = models.Plane(11, *models.grid(1, 1))
    strange = tuple((n, 998, nodes, more) for n, _, nodes, more in
                    plane.model(writer).elements)  # fmt: skip
    increments = [writer.Increment(number=0, element=[[[s] * 7 for s in (1, 2, 3, 6)]])]
    path = write_post(writer.Storage(), plane.model(writer, elements=strange), increments)
    with pytest.raises(ResultError, match="element 1: element type 998: where its int"):
        read_stress_tensor(path, [1])
    options = ReadOptions(extrapolate="average")
    assert_allclose(read_stress_tensor(path, [1], options)[1], 3e6)


def test_a_type_whose_points_are_inferred_is_told(write, increments):
    said = []
    read(write(increments), [1], tell=said.append)
    assert any("element type 80: count and order of its" in words for words in said)


def test_the_same_mesh_written_anew_is_one_history(write, increments, plane, writer):
    model = plane.model(writer)
    again = replace(increments[2], new_model=model)
    path = write((*increments[:2], again, increments[3]))
    (trace,) = read(path, [5])
    assert_allclose(trace.stress_pa, [0, 1e6, 2e6, 3e6], rtol=1e-6, atol=1)


def test_another_mesh_at_the_nodes_asked_for_is_refused(write, increments, plane, writer):
    """Node 9, far from what moved, keeps its elements and its history."""
    moved = models.Plane(80, {**models.grid(2, 2)[0], 1: (-0.5, 0)}, plane.quads)
    again = replace(increments[2], new_model=moved.model(writer))
    path = write((*increments[:2], again, increments[3]))
    with pytest.raises(ResultError, match="increment 2 has a new mesh, in which what"):
        read(path, [1])
    assert read(path, [9])[0].stress_pa.size == 4


def test_a_new_mesh_with_other_post_codes_is_refused(write, increments, plane, writer):
    other = plane.model(writer, codes=models.CODES[1:])
    bare = [[v[1:] for v in row] for row in increments[2].element]
    again = replace(increments[2], new_model=other, element=bare)
    with pytest.raises(ResultError, match="increment 2 has other post codes than the"):
        read(write((*increments[:2], again)), [1])


def test_displacement_of_nodes_that_are_not_there_is_refused(write, increments):
    path = write(increments)
    with pytest.raises(ResultError, match="no node 99 in the mesh"):
        read_displacement(path, [1, 99])
    times_ms, moved_mm = read_displacement(path, [3, 1])
    assert_allclose(times_ms, [0, 1, 2, 3], rtol=1e-6)
    assert_allclose(moved_mm[2], [[0.002, -3, 0], [0.002, -1, 0]], rtol=1e-6)


def test_a_file_that_is_none_is_named(tmp_path):
    path = tmp_path / "job.t16"
    path.write_bytes(b"no post file at all, but long enough to look at")
    with pytest.raises(ResultError, match="no result file we read: begins with b'no p"):
        read(path, [1])


@pytest.mark.parametrize("kind", ["t16", "t19"])
@pytest.mark.parametrize("dt_s", [0.0005, 1 / 3000])
def test_even_times_are_even_again_without_their_rounding(kind, dt_s, write, plane, writer):
    """500 increments that end at a time of few digits after the step's."""
    times_s = [k * dt_s for k in range(1, 501)]
    increments = [
        writer.Increment(number=k + 1, time_s=t, element=np.ones((4, 4, 7)) * (1 + k % 7))
        for k, t in enumerate(times_s)
    ]
    storage = writer.Storage(binary=kind == "t16")
    (trace,) = read(write(increments, storage), [1])
    assert trace.dt_ms == pytest.approx(1e3 * dt_s, rel=1e-5)
    assert trace.stress_pa.size == 500


def test_times_that_are_not_even_stay_as_they_are():
    times_ms = np.array([0.0, 1.0, 2.0, 3.01])
    for kind, precision in (("t16", "single"), ("t19", "single"), ("t16", "double")):
        assert unrounded_ms(times_ms, kind, precision) is times_ms


def test_a_job_that_gave_up_is_told_from_its_status_file(write, increments, marc_samples, tmp_path):
    path, said = tmp_path / "job.t16", []
    path.write_bytes(write(increments).read_bytes())
    status = (marc_samples / "nour_plastic.sts").read_text()
    path.with_suffix(".sts").write_text(status)
    read(path, [1], tell=said.append)
    assert not any("job.sts" in words for words in said)
    path.with_suffix(".sts").write_text(status.replace("3004", "3002"))
    read(path, [1], tell=said.append)
    assert any("job.sts: the job ended" in words for words in said)
    path.with_suffix(".sts").write_text("something else\n")
    assert read(path, [1])[0].stress_pa.size == 4
