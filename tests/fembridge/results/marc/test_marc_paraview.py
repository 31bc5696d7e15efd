"""A post file as VTU files, read back with meshio."""

import importlib.util
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import meshio
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from fembridge import write_vtu_series
from fembridge.errors import ResultError, UsageError
from fembridge.results.field_file import read_field


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


def entries(path):
    found = ElementTree.parse(path).getroot().iter("DataSet")
    return [(float(x.get("timestep")), path.parent / x.get("file")) for x in found]


def test_paraview_gets_each_layer_s_own_values_at_a_boundary(path, plane, tmp_path):
    found = entries(write_vtu_series(path, tmp_path / "out"))
    assert [time_ms for time_ms, _ in found] == pytest.approx([0.0, 1.0, 2.0])
    mesh = meshio.read(found[2][1])
    data = mesh.point_data
    assert {"Stress", "von_mises", "Displacement", "node", "materials"} <= set(data)
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
            assert_allclose(data["Stress"][point], exact, rtol=0, atol=1e3)
            mises = models.von_mises(exact)
            assert data["von_mises"][point] == pytest.approx(mises, rel=1e-4)
            assert data["Displacement"][point].tolist() == [pytest.approx(0.002), -node]
            assert data["materials"][point] == 1 + (x == 2.0)


def test_paraview_gets_what_was_asked_for_alone(path, tmp_path):
    series = write_vtu_series(path, tmp_path / "a", quantities=["disp"])
    mesh = meshio.read(entries(series)[0][1])
    assert set(mesh.point_data) == {"node", "materials", "Displacement"}
    derived = ("principal", "max_shear")
    series = write_vtu_series(path, tmp_path / "b", derived=derived)
    assert {*derived} <= set(meshio.read(entries(series)[0][1]).point_data)
    with pytest.raises(UsageError, match="strain_energy_density takes STRESS and TOST"):
        write_vtu_series(path, tmp_path / "c", derived=["strain_energy_density"])
    with pytest.raises(ResultError, match="no heat in it"):
        write_vtu_series(path, tmp_path / "c", quantities=["heat"])
    assert not (tmp_path / "c").exists()


def test_paraview_gets_the_mesh_of_each_increment(writer, write_post, tmp_path):
    first = models.Plane(11, *models.grid(2, 1))
    second = models.Plane(11, *models.grid(3, 1))
    one, *_ = first.increments(writer, linear_stress, (0.0,))
    two, *_ = second.increments(writer, linear_stress, (0.001,))
    changed = replace(two, number=1, new_model=second.model(writer))
    path = write_post(writer.Storage(), first.model(writer), [one, changed])
    meshes = [meshio.read(f) for _, f in entries(write_vtu_series(path, tmp_path))]
    assert [len(mesh.cells[0].data) for mesh in meshes] == [2, 3]


def test_unknown_elements_are_left_out_of_pictures_and_that_is_told(writer, write_post, tmp_path):
    plane = models.Plane(11, *models.grid(2, 1))
    (first, second) = plane.model(writer).elements
    elements = (first, (second[0], 998, second[2], second[3]))
    increments = plane.increments(writer, linear_stress, (0.0,))
    model = plane.model(writer, elements=elements)
    path, said = write_post(writer.Storage(), model, increments), []
    series = write_vtu_series(path, tmp_path, quantities=["Displacement"], tell=said.append)
    assert len(meshio.read(entries(series)[0][1]).cells[0].data) == 1
    assert "left out: elements of unknown type 998" in said
    assert read_field(path, "Displacement").nodes.size == 6


def test_nodes_between_bricks_lie_where_vtk_looks_for_them(writer, write_post, tmp_path):
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
    mesh = meshio.read(entries(write_vtu_series(path, tmp_path))[0][1])
    (cells,) = mesh.cells
    assert cells.type == "hexahedron20"
    found = mesh.points[cells.data[0]]
    for k, (p, q) in enumerate(pairs):
        assert_allclose(found[8 + k], (found[p] + found[q]) / 2)


def test_memory_does_not_grow_with_the_number_of_increments(writer, write_post, tmp_path):
    import tracemalloc

    plane = models.Plane(11, *models.grid(30, 30))
    (one,) = plane.increments(writer, linear_stress, (0.0,))
    peaks = []
    for count in (2, 8):
        increments = [replace(one, number=k, time_s=k * 1e-3) for k in range(count)]
        path = write_post(writer.Storage(), plane.model(writer), increments)
        write_vtu_series(path, tmp_path / "warm")
        tracemalloc.start()
        try:
            write_vtu_series(path, tmp_path / f"{count}")
            peaks.append(tracemalloc.get_traced_memory()[1])
        finally:
            tracemalloc.stop()
    assert peaks[1] < 1.2 * peaks[0]
