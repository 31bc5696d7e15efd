"""VTU and PVD: read back with meshio, and held against the file they came from."""

from pathlib import Path

import numpy as np
import pytest
from meshio._mesh import topological_dimension
from numpy.testing import assert_array_equal
from opened import as_modes, mesh_of, naming, pictured, shows

from fembridge import read_fields, write_vtu_series
from fembridge.errors import ResultError, UsageError
from fembridge.results.fields import tensor_values
from fembridge.results.von_mises import principal_stresses_pa, von_mises_pa

RECORDED = Path(__file__).parents[3] / "fixtures/transient_sine/job.frd"

# meshio 5.3.5 knows this one and has left it out of a table.
topological_dimension.setdefault("wedge15", 3)

# Pairs of nodes between which the later nodes of each VTK cell lie, in its order
# (vtkCellType.h and the pages of the classes).
EDGES = {
    "hexahedron20": "01 12 23 30 45 56 67 74 04 15 26 37",
    "wedge15": "01 12 20 34 45 53 03 14 25",
    "tetra10": "01 12 20 03 13 23",
    "triangle6": "01 12 20",
    "quad8": "01 12 23 30",
    "line3": "01",
}
# The same in the order of a .frd: hex20 and wedge15 have those between before the top.
FRD_EDGES = {
    4: (8, "01 12 23 30 04 15 26 37 45 56 67 74"),
    5: (6, "01 12 20 03 14 25 34 45 53"),
    6: (4, "01 12 20 03 13 23"),
    8: (3, "01 12 20"),
    10: (4, "01 12 23 30"),
    12: (2, "01"),
}


def pairs(text):
    return [(int(a), int(b)) for a, b in text.split()]


@pytest.mark.parametrize("name", ["cpe4_ascii", "cpe4_bin_f64", "cpe4_time_ge_1"])
def test_what_is_read_back_is_what_the_file_holds(samples, tmp_path, name):
    path = samples / f"{name}.frd"
    derived = ("von_mises", "principal")
    series = pictured(path, tmp_path / "out", derived=derived)
    grid, fields = mesh_of(path), list(read_fields(path))
    assert [time_ms for time_ms, _ in series] == [field.time_ms for field in fields]
    for (_, mesh), field in zip(series, fields, strict=True):
        assert_array_equal(mesh.points, grid.points_mm)
        assert_array_equal(mesh.point_data["node"], grid.nodes)
        assert_array_equal(mesh.point_data["STRESS_pa"], field.values)
        tensor_pa = tensor_values(field)
        assert_array_equal(mesh.point_data["von_mises_pa"], von_mises_pa(tensor_pa))
        assert_array_equal(mesh.point_data["principal_pa"], principal_stresses_pa(tensor_pa))
        (cells,) = mesh.cells
        assert cells.type == "quad"
        assert_array_equal(grid.nodes[cells.data], grid.nodes[grid.cells[0].rows])
        assert_array_equal(mesh.cell_data["material"][0], grid.cells[0].material)
        for number, layer in ((1, "EPI"), (2, "DER"), (3, "STEEL")):
            assert_array_equal(
                mesh.cell_data[f"material {layer}"][0], grid.cells[0].material == number
            )
    assert {"DISP_mm", "TOSTRAIN", "FORC_n", "CONTACT_copen_mm", "ERROR_percent"} <= set(
        mesh.point_data
    )
    assert "material SI" not in mesh.cell_data  # a contact, no material


def test_nodes_between_materials_are_marked_and_told(samples, tmp_path, logged):
    path, said = samples / "interface_cpe8r.frd", logged
    [(_, mesh)] = pictured(path, tmp_path)
    met = mesh.point_data["materials"]
    assert_array_equal(met == 2, mesh.points[:, 1] == 0.5)
    assert "9 nodes are between materials" in said[0]


def test_of_few_nodes_those_alone_are_written_and_said_once(samples, tmp_path, logged):
    path, said = samples / "cpe4_nset_unsorted_dup.frd", logged
    series = pictured(path, tmp_path)
    mesh, field = series[0][1], next(read_fields(path))
    assert mesh.point_data["node"].tolist() == [11, 18, 25]
    assert_array_equal(mesh.point_data["STRESS_pa"], field.values_at([11, 18, 25]))
    assert [(cells.type, cells.data.tolist()) for cells in mesh.cells] == [
        ("vertex", [[0], [1], [2]])
    ]
    assert sum(shows(line, "3 of 47") for line in said) == 1


def test_however_few_nodes_there_are_meshio_finds_each_array(tmp_path):
    """Some lengths of arrays had it take one for another: of four nodes it read no file."""
    series = pictured(RECORDED, tmp_path)
    nodes = series[0][1].point_data["node"]
    for (_, mesh), field in list(zip(series, read_fields(RECORDED), strict=True))[::6]:
        assert_array_equal(mesh.point_data["STRESS_pa"], field.values_at(nodes))


def test_a_node_without_a_value_is_nan_and_said_once(write_frd, block, tmp_path, logged):
    rows = [(node, [1.0 * node] * 6) for node in (1, 2, 3, 4)]
    moved = [(node, [0.5] * 3) for node in (1, 2)]
    blocks = [
        one
        for k in (1, 2, 3)
        for one in (block("STRESS", k, k * 1e-3, rows), block("DISP", k, k * 1e-3, moved))
    ]
    said = logged
    series = pictured(write_frd(blocks), tmp_path)
    assert len(series) == 3
    values = series[2][1].point_data["DISP_mm"]
    assert np.isnan(values).any(axis=1).tolist() == [False, False, True, True]
    assert len(said) == 1
    assert shows(said[0], "DISP", "2 of 4")


@pytest.mark.parametrize("kind", sorted(FRD_EDGES))
@pytest.mark.parametrize("mesh_flag", [1, 2])
def test_mid_side_nodes_lie_where_vtk_looks_for_them(write_frd, block, tmp_path, kind, mesh_flag):
    """A node's x is its number here, and so a name for it."""
    corners, edges = FRD_EDGES[kind]
    first = [2 * 3**k for k in range(corners)]  # so that no two sums are equal
    mids = [(first[a] + first[b]) // 2 for a, b in pairs(edges)]
    nodes = sorted({*first, *mids})
    assert len(nodes) == corners + len(mids)
    values = [(node, (node, 0, 0)) for node in nodes]
    path = write_frd(
        [block("DISP", 1, 1e-3, values)],
        nodes=nodes,
        elements=[(kind, 1, [*first, *mids])],
        mesh_flag=mesh_flag,
    )
    [(_, mesh)] = pictured(path, tmp_path / f"{kind}{mesh_flag}")
    (cells,) = mesh.cells
    found = mesh.points[cells.data[0], 0]
    middle = [(found[a] + found[b]) / 2 for a, b in pairs(EDGES[cells.type])]
    assert found[:corners].tolist() == first
    assert found[corners:].tolist() == middle


def test_only_what_was_asked_for_is_written(samples, tmp_path):
    path = samples / "cpe4_ascii.frd"
    mesh = pictured(path, tmp_path, quantities=["DISP"], derived=())[0][1]
    assert set(mesh.point_data) == {"node", "materials", "DISP_mm"}
    with pytest.raises(ResultError, match="HEAT"):
        write_vtu_series(path, tmp_path / "other", quantities=["HEAT"])
    with pytest.raises(UsageError, match=naming("derived", "'tresca'")):
        write_vtu_series(path, tmp_path / "other", derived=["tresca"])
    assert not (tmp_path / "other").exists()


def test_a_value_that_is_not_finite_leaves_its_block_out_and_the_others_are_written(
    write_frd, block, tmp_path, logged
):
    rows = [[(n, [x, 1, 1, 1, 1, 1]) for n in (1, 2, 3, 4)] for x in (1.0, np.nan)]
    moved = [(n, [1, 2, 3]) for n in (1, 2, 3, 4)]
    stress = [block("STRESS", k, k * 1e-3, rows[k == 2], 2) for k in (1, 2, 3)]
    both = [one for k, s in enumerate(stress, 1) for one in (block("DISP", k, k * 1e-3, moved), s)]
    for blocks, times_ms in ((stress, [1.0, 3.0]), (both, [1.0, 2.0, 3.0])):
        said = logged
        path = write_frd(blocks, mesh_flag=2)
        series = pictured(path, tmp_path / "out")
        assert [time_ms for time_ms, _ in series] == times_ms
        assert any(shows(line, "STRESS of step 1, increment 2", "node 1 at 2 ms") for line in said)
    held = series[1][1].point_data
    assert "DISP_mm" in held
    assert not {"STRESS_pa", "von_mises_pa"} & held.keys()
    with pytest.raises(ResultError, match=naming("written.frd")):
        write_vtu_series(write_frd([stress[1]], mesh_flag=2), tmp_path / "none")


def test_what_cannot_be_derived_is_said_and_the_rest_written(write_frd, block, tmp_path, logged):
    values = [[(n, [1.0] * 6) for n in nodes] for nodes in ((1, 2, 3, 4), (1, 2))]
    strain = ("EXX", "EYY", "EZZ", "EXY", "EYZ", "EZX")
    blocks = [
        block("STRESS", 1, 0.5, values[0]),
        block("TOSTRAIN", 1, 0.5, values[1], components=strain),
    ]
    said = logged
    series = pictured(
        write_frd(blocks),
        tmp_path / "out",
        derived=("strain_energy_density", "max_shear"),
    )
    assert "max_shear_pa" in series[0][1].point_data
    assert any(shows(line, "strain_energy_density", "STRESS", "TOSTRAIN") for line in said)


def test_names_that_xml_cannot_hold_are_made_plain(write_frd, block, tmp_path):
    path = write_frd(
        [block("A<&\x01B", 1, 1e-3, [(n, [2.0]) for n in (1, 2, 3, 4)], components=("X",))],
        nodes=(1, 2, 3, 4),
    )
    content = path.read_bytes().replace(b"1EPI", b"1E\xe9\x02")
    path.write_bytes(content)
    mesh = pictured(path, tmp_path)[0][1]
    assert "A___B" in mesh.point_data
    assert "material E__" in mesh.cell_data


def test_modes_and_times_are_never_in_one_series(samples, tmp_path, logged):
    """The first increment of a recorded file, made a mode; the others keep their times."""
    first = b" 5.00000E-04"
    path, said = tmp_path / "both.frd", logged
    path.write_bytes((samples / "cpe4_ascii.frd").read_bytes())
    as_modes(path, only=first)
    times = [at for at, _ in pictured(path, tmp_path / "times")]
    assert times == [field.time_ms for field in read_fields(samples / "cpe4_ascii.frd")][1:]
    assert any(shows(line, 1, "frequency in cycles per time", "--modes") for line in said)
    modes = pictured(path, tmp_path / "modes", modes=True)
    assert [at for at, _ in modes] == [float(first)]
    with pytest.raises(UsageError, match=naming("cpe4_ascii.frd", "modes")):
        write_vtu_series(samples / "cpe4_ascii.frd", tmp_path / "none", modes=True)


def test_a_wedge_stands_in_the_file_as_vtk_has_it(write_frd, block, tmp_path):
    """VTK's wedge has its parametric corners in the order of a .frd; meshio turns
    wedges over when it writes, which must not reach the file."""
    nodes = list(range(1, 7))
    path = write_frd(
        [block("DISP", 1, 1e-3, [(n, (0, 0, 0)) for n in nodes])],
        nodes=nodes,
        elements=[(2, 1, nodes)],
    )
    [(_, mesh)] = pictured(path, tmp_path)
    (cells,) = mesh.cells  # which turns it over once more
    assert cells.type == "wedge"
    assert cells.data[0][[0, 2, 1, 3, 5, 4]].tolist() == [0, 1, 2, 3, 4, 5]
