"""VTU, PVD and XDMF of other programs: what meshio reads of whole files, and what damage does."""

import base64
import contextlib
import io
import os
import random
import struct
import warnings
import zipfile
import zlib

import h5py
import meshio
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from opened import naming

from fembridge import read
from fembridge.errors import FembridgeError, FembridgeWarning, ResultError
from fembridge.io.npz import NpzFile
from fembridge.results.series import numbers_in
from fembridge.results.von_mises import von_mises_pa
from fembridge.results.vtk_xml import VtuFile
from fembridge.results.xml_tree import MAX_DEPTH

TIMES_S = np.arange(4) * 0.0005
POINTS = np.random.default_rng(1).random((5, 3))
STRESS_MPA = np.random.default_rng(2).random((4, 5)) + 0.1
NODES = np.array([11, 12, 13, 14, 15])
CELLS = [("vertex", np.arange(5)[:, None])]
COLUMNS = {"time": "t", "value": "S", "node": "node"}
STYLES = {
    "zlib": {},
    "lzma": {"compression": "lzma", "header_type": "UInt64"},
    "plain": {"compression": None},
    "ascii": {"binary": False},
}


def write_vtu(path, stress=STRESS_MPA[0], style="plain", more=()):
    """A VTU as meshio writes it in one of `STYLES`, which warns of ASCII on the terminal."""
    data = {"S": stress.copy(), "node": NODES.copy(), **dict(more)}
    with contextlib.redirect_stdout(None), contextlib.redirect_stderr(None):
        meshio.vtu.write(path, meshio.Mesh(POINTS, CELLS, data), **STYLES[style])
    return path


def write_appended(path, encoding, stress=STRESS_MPA[0]):
    """A VTU whose arrays are appended, as VTK writes them."""
    arrays = {"Points": (POINTS, 3), "S": (stress, 1), "node": (NODES, 1)}
    data, tags = b"", {}
    for name, (array, count) in arrays.items():
        kind = "Float64" if array.dtype.kind == "f" else "Int64"
        tags[name] = (
            f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{count}" '
            f'format="appended" offset="{len(data)}"/>'
        )
        block = struct.pack("<Q", array.nbytes) + array.tobytes()
        data += block if encoding == "raw" else base64.b64encode(block)
    head = (
        '<?xml version="1.0"?><VTKFile type="UnstructuredGrid" version="1.0" '
        'byte_order="LittleEndian" header_type="UInt64"><UnstructuredGrid>'
        f'<Piece NumberOfPoints="5" NumberOfCells="0"><Points>{tags["Points"]}</Points><Cells/>'
        f"<PointData>{tags['S']}{tags['node']}</PointData></Piece></UnstructuredGrid>"
        f'<AppendedData encoding="{encoding}">\n _'
    )
    path.write_bytes(head.encode() + data + b"\n</AppendedData></VTKFile>\n")
    return path


def write_pvd(folder, style, entry='<DataSet timestep="{time!r}" part="0" file="{file}"/>\n'):
    """A PVD of four VTU files."""
    folder.mkdir(exist_ok=True)
    entries = ""
    for row, time in enumerate(TIMES_S.tolist()):
        file = folder / f"job{row}.vtu"
        if style in STYLES:
            write_vtu(file, STRESS_MPA[row], style)
        else:
            write_appended(file, style, STRESS_MPA[row])
        entries += entry.format(time=time, file=file.name)
    path = folder / "job.pvd"
    path.write_text(
        f'<?xml version="1.0"?>\n<VTKFile type="Collection">\n<Collection>\n{entries}'
        "</Collection>\n</VTKFile>\n"
    )
    return path


def write_xdmf(folder, storage, monkeypatch, arrays=None):
    """An XDMF series as meshio writes it: its other files go into the current folder."""
    folder.mkdir(exist_ok=True)
    monkeypatch.chdir(folder)
    with meshio.xdmf.TimeSeriesWriter("job.xdmf", data_format=storage) as out:
        out.write_points_cells(POINTS, CELLS)
        for row, time in enumerate(TIMES_S.tolist()):
            data = {"S": STRESS_MPA[row], "node": NODES} if arrays is None else arrays(row)
            out.write_data(time, point_data=data)
    return folder / "job.xdmf"


@pytest.fixture(params=[*STYLES, "raw", "base64", "HDF", "XML", "Binary"])
def series(request, tmp_path, monkeypatch):
    if request.param in ("HDF", "XML", "Binary"):
        return write_xdmf(tmp_path / "x", request.param, monkeypatch)
    return write_pvd(tmp_path / "p", request.param)


def test_every_encoding_gives_the_same_stress(series):
    traces = read(series, [15, 11], columns=COLUMNS)
    assert [trace.node for trace in traces] == [15, 11]
    for trace, column in zip(traces, (4, 0), strict=True):
        assert trace.dt_ms == pytest.approx(0.5)
        assert_allclose(trace.stress_pa, 1e6 * STRESS_MPA[:, column], rtol=1e-10)
    (nearest,) = read(series, near_mm=[POINTS[2].tolist()], columns=COLUMNS)
    assert nearest.node == 13


def test_blocks_of_a_vtu_are_joined_as_meshio_joins_them(tmp_path):
    points = np.random.default_rng(3).random((6001, 3))
    cells = [("vertex", np.arange(6001)[:, None])]
    for style in ("zlib", "lzma"):
        path = tmp_path / f"{style}.vtu"
        mesh = meshio.Mesh(points, cells, {"S": points[:, 0].copy(), "six": np.tile(points, 2)})
        meshio.vtu.write(path, mesh, **STYLES[style])
        expected = meshio.read(path)
        with VtuFile(path) as file:
            assert file.shapes == {"S": (6001,), "six": (6001, 6)}
            assert_array_equal(file.points(), expected.points)
            for name in file.shapes:
                assert_array_equal(file.read(name), expected.point_data[name])


def test_a_vtu_of_several_pieces_is_their_points_in_turn(tmp_path):
    path = write_vtu(tmp_path / "job.vtu")
    text = path.read_text()
    begin, end = text.index("<Piece"), text.index("</Piece>") + len("</Piece>")
    path.write_text(text[:end] + text[begin:end] + text[end:])
    with VtuFile(path) as file:
        assert_array_equal(file.read("S"), np.tile(STRESS_MPA[0], 2))
        assert file.count() == 10


def test_components_of_a_tensor_by_name_are_in_the_order_of_the_names(tmp_path, monkeypatch):
    tensor = np.array([3.0, 1.0, -2.0, 0.5, 0.25, -0.75])
    keys = ("xx", "yy", "zz", "xy", "yz", "zx")

    def arrays(row):
        return {
            f"S{key}": np.full(5, (row + 1) * part) for key, part in zip(keys, tensor, strict=True)
        }

    path = write_xdmf(tmp_path / "x", "HDF", monkeypatch, arrays)
    columns = {"time": "t", **{key: f"S{key}" for key in keys}}
    (trace,) = read(path, [3], columns=columns)
    assert_allclose(trace.stress_pa, 1e6 * np.arange(1, 5) * von_mises_pa(tensor), rtol=1e-12)
    np.savez(
        "one.npz",
        t=TIMES_S,
        **{f"S{key}": TIMES_S * part for key, part in zip(keys, tensor, strict=True)},
    )
    (trace,) = read(tmp_path / "x/one.npz", columns=columns)
    assert_allclose(trace.stress_pa, 1e6 * TIMES_S * von_mises_pa(tensor), rtol=1e-12)


# --- out of its folder


@pytest.mark.parametrize("name", ["../out.h5", "{folder}/out.h5", "link.h5"])
def test_an_xdmf_does_not_leave_its_folder(tmp_path, monkeypatch, name):
    path = write_xdmf(tmp_path / "x", "HDF", monkeypatch)
    (path.parent / "job.h5").rename(tmp_path / "out.h5")
    (path.parent / "link.h5").symlink_to(tmp_path / "out.h5")
    path.write_text(path.read_text().replace("job.h5", name.format(folder=tmp_path)))
    with pytest.raises(ResultError, match=r"job\.xdmf: (out|link)\.h5 "):
        read(path, [11], columns=COLUMNS)


def test_a_link_inside_the_folder_is_followed(tmp_path, monkeypatch):
    path = write_xdmf(tmp_path / "x", "HDF", monkeypatch)
    (path.parent / "job.h5").rename(path.parent / "kept.h5")
    (path.parent / "job.h5").symlink_to("kept.h5")
    (tmp_path / "outside.xdmf").symlink_to(path)
    assert read(tmp_path / "outside.xdmf", [11], columns=COLUMNS)[0].node == 11


def test_raw_data_outside_the_folder_is_refused_before_it_is_opened(tmp_path, monkeypatch):
    path = write_xdmf(tmp_path / "x", "Binary", monkeypatch)
    text = path.read_text()
    for name in ("/dev/zero", "../x.bin", "/etc/passwd", ""):
        path.write_text(text.replace("job2.bin", name))
        with pytest.raises(ResultError, match=r"job\.xdmf: "):
            read(path, [11], columns=COLUMNS)


@pytest.mark.parametrize("way", ["external link", "soft link", "external storage", "virtual"])
def test_hdf5_that_leads_to_another_file_is_refused(tmp_path, monkeypatch, way):
    path = write_xdmf(tmp_path / "x", "HDF", monkeypatch)
    name = "data2"
    np.save(tmp_path / "raw.npy", STRESS_MPA[0])
    with h5py.File(tmp_path / "out.h5", "w") as other:
        other["S"] = STRESS_MPA[0]
    with h5py.File(path.parent / "job.h5", "r+") as file:
        del file[name]
        if way == "external link":
            file[name] = h5py.ExternalLink("../out.h5", "/S")
        elif way == "soft link":
            file["away"] = h5py.ExternalLink("../out.h5", "/S")
            file[name] = h5py.SoftLink("/away")
        elif way == "external storage":
            storage = [(str(tmp_path / "raw.npy"), 128, 40)]
            file.create_dataset(name, (5,), "f8", external=storage)
        else:
            layout = h5py.VirtualLayout((5,), "f8")
            layout[:] = h5py.VirtualSource(tmp_path / "out.h5", "S", (5,))
            file.create_virtual_dataset(name, layout)
    with pytest.raises(ResultError, match=naming("job.xdmf", "data2")):
        read(path, [11], columns=COLUMNS)


def test_a_soft_link_inside_an_hdf5_is_followed_and_a_loop_is_refused(tmp_path, monkeypatch):
    path = write_xdmf(tmp_path / "x", "HDF", monkeypatch)
    with h5py.File(path.parent / "job.h5", "r+") as file:
        file.move("data2", "group/kept")
        file["data2"] = h5py.SoftLink("/group/kept")
    assert len(read(path, [11], columns=COLUMNS)) == 1
    with h5py.File(path.parent / "job.h5", "r+") as file:
        del file["data2"]
        file["data2"] = h5py.SoftLink("/data2")
    with pytest.raises(ResultError, match=naming("job.xdmf", "data2")):
        read(path, [11], columns=COLUMNS)


def test_an_xdmf_that_includes_another_file_is_refused(tmp_path, monkeypatch):
    path = write_xdmf(tmp_path / "x", "HDF", monkeypatch)
    path.write_text(
        path.read_text().replace("include xpointer", 'include href="../o.xml" xpointer')
    )
    with pytest.raises(ResultError, match=naming("job.xdmf", "'../o.xml'")):
        read(path, [11], columns=COLUMNS)


@pytest.mark.parametrize("name", ["job.pvd", "job.xdmf", "absent.vtu", "pipe.vtu", ""])
def test_a_pvd_lists_vtu_files_alone(tmp_path, name):
    path = write_pvd(tmp_path / "p", "plain")
    os.mkfifo(path.parent / "pipe.vtu")
    (path.parent / "job.xdmf").write_text("<Xdmf/>")
    path.write_text(path.read_text().replace("job2.vtu", name))
    with pytest.raises(ResultError):
        read(path, [11], columns=COLUMNS)


@pytest.mark.parametrize("binary", [True, False])
def test_a_pvd_may_list_legacy_vtk_files(tmp_path, binary):
    path = write_pvd(tmp_path / "p", "plain")
    path.write_text(path.read_text().replace(".vtu", ".vtk"))
    for row in range(4):
        data = {"S": STRESS_MPA[row].copy(), "node": NODES.copy()}
        mesh = meshio.Mesh(POINTS, CELLS, data)
        meshio.vtk.write(path.parent / f"job{row}.vtk", mesh, fmt_version="4.2", binary=binary)
    (trace,) = read(path, [12], columns=COLUMNS)
    assert_allclose(trace.stress_pa, 1e6 * STRESS_MPA[:, 1], rtol=1e-10)
    file = path.parent / "job2.vtk"
    whole = file.read_bytes()
    for old, new in (
        (b"POINTS 5", b"POINTS 5000000000"),
        (b"POINT_DATA 5", b"POINT_DATA 99999999"),
    ):
        file.write_bytes(whole.replace(old, new))
        with pytest.raises(ResultError, match=naming("job2.vtk", old.split()[0].decode())):
            read(path, [12], columns=COLUMNS)
    source = random.Random(3)
    for _ in range(30):
        file.write_bytes(mutated(whole, source))
        with contextlib.suppress(FembridgeError):
            read(path, [12], columns=COLUMNS)


# --- memory


def test_entities_and_deep_xml_are_refused(tmp_path, monkeypatch):
    path = write_xdmf(tmp_path / "x", "HDF", monkeypatch)
    text = path.read_text()
    doctype = '<!DOCTYPE Xdmf SYSTEM "Xdmf.dtd" []>'
    path.write_text(doctype + text)
    assert len(read(path, [11], columns=COLUMNS)) == 1
    path.write_text(doctype.replace("[]", '[<!ENTITY a "1"><!ENTITY b "&a;&a;">]') + text)
    with pytest.raises(ResultError, match=naming("job.xdmf:1", "'a'")):
        read(path, [11], columns=COLUMNS)
    path.write_text(doctype + text.replace("job.h5:/data2", "&outside;"))
    with pytest.raises(ResultError, match=naming("'outside'")):
        read(path, [11], columns=COLUMNS)
    path.write_text("<Xdmf>" + "<a>" * MAX_DEPTH)
    with pytest.raises(ResultError, match=naming("job.xdmf:1", MAX_DEPTH)):
        read(path, [11], columns=COLUMNS)
    monkeypatch.setattr("fembridge.results.xml_tree.MAX_ELEMENTS", 3)
    path.write_text(text)
    with pytest.raises(ResultError, match=naming(3)):
        read(path, [11], columns=COLUMNS)


def test_hdf5_that_is_a_shape_alone_takes_no_memory(tmp_path, monkeypatch):
    path = write_xdmf(tmp_path / "x", "HDF", monkeypatch)
    with h5py.File(path.parent / "job.h5", "r+") as file:
        for name in ("data0", "data2", "data3"):
            shape = (1 << 30, 3) if name == "data0" else (1 << 30,)
            del file[name]
            file.create_dataset(name, shape, "f8", chunks=(1 << 20, 3)[: len(shape)], compression=9)
    with pytest.raises(ResultError, match=naming("GB", 100)):
        read(path, [11], columns=COLUMNS)


def test_a_chunk_that_unpacks_to_more_than_its_size_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("fembridge.results.xdmf.SMALL_BYTES", 1 << 10)
    path = write_xdmf(tmp_path / "x", "HDF", monkeypatch)
    with h5py.File(path.parent / "job.h5", "r+") as file:
        del file["data2"]
        dataset = file.create_dataset("data2", (5,), "f8", chunks=(5,), compression=9)
        dataset.id.write_direct_chunk((0,), zlib.compress(bytes(1 << 20), 9))
    with pytest.raises(ResultError, match=naming("S", "bytes")):
        read(path, [11], columns=COLUMNS)
    with h5py.File(path.parent / "job.h5", "r+") as file:
        file["data2"][:] = STRESS_MPA[0]
    assert_allclose(read(path, [11], columns=COLUMNS)[0].stress_pa, 1e6 * STRESS_MPA[:, 0])


@pytest.mark.parametrize("style", ["zlib", "lzma"])
def test_a_vtu_unpacks_to_no_more_than_its_count_of_points(tmp_path, style, monkeypatch):
    path = tmp_path / "job.vtu"
    mesh = meshio.Mesh(
        np.zeros((4096, 3)), [("vertex", np.zeros((1, 1), int))], {"S": np.zeros(4096)}
    )
    meshio.vtu.write(path, mesh, **STYLES[style])
    text = path.read_text()
    path.write_text(text.replace('NumberOfPoints="4096"', 'NumberOfPoints="1073741824"'))
    with pytest.raises(ResultError, match=naming("job.vtu", 100)):
        read(path, [1], columns={"time": "t", "value": "S"})
    path.write_text(text)
    monkeypatch.setattr("fembridge.host.memory.SMALL_BYTES", 1 << 10)
    monkeypatch.setattr("fembridge.host.memory.MAX_RATIO", 2)
    with pytest.raises(ResultError, match=naming("job.vtu", 2)):
        read(path, [1], columns={"time": "t", "value": "S"})


def test_a_series_beyond_the_limit_of_memory_is_refused_by_name(tmp_path, monkeypatch):
    path = write_pvd(tmp_path / "p", "plain")
    monkeypatch.setenv("FEMBRIDGE_MEMORY", "300")
    with pytest.raises(ResultError, match=naming("job.pvd", "FEMBRIDGE_MEMORY=8G")):
        read(path, [11], columns=COLUMNS)


def test_one_file_in_many_outputs_is_read_once_and_doubted(tmp_path, monkeypatch):
    path = write_pvd(tmp_path / "p", "plain")
    entries = "".join(f'<DataSet timestep="{row}" file="./job0.vtu"/>' for row in range(300))
    path.write_text(f'<VTKFile type="Collection"><Collection>{entries}</Collection></VTKFile>')
    opened = []
    original = VtuFile.read

    def counted(file, name):
        opened.append(name)
        return original(file, name)

    monkeypatch.setattr(VtuFile, "read", counted)
    with pytest.warns(FembridgeWarning, match=naming("a.pvd", 0, 1)):
        (trace,) = read(path.rename(path.with_name("a.pvd")), [11], columns=COLUMNS)
    assert trace.stress_pa.size == 300
    assert opened.count("S") == 1


# --- numbers


@pytest.mark.parametrize("number", ["1_000", "١", "nan", "inf", "1e999", "x", ""])
@pytest.mark.parametrize("suffix", ["pvd", "xdmf"])
def test_a_time_that_is_no_finite_number_is_refused(tmp_path, monkeypatch, suffix, number):
    if suffix == "pvd":
        path = write_pvd(tmp_path / "p", "plain")
        text = path.read_text().replace('timestep="0.0015"', f'timestep="{number}"')
    else:
        path = write_xdmf(tmp_path / "x", "XML", monkeypatch)
        text = path.read_text().replace('Value="0.0015"', f'Value="{number}"')
    path.write_text(text)
    with pytest.raises(ResultError):
        read(path, [11], columns=COLUMNS)


@pytest.mark.parametrize("suffix", ["pvd", "xdmf", "csv", "npz"])
def test_a_time_that_is_too_large_in_ms_is_refused(tmp_path, monkeypatch, suffix):
    columns = COLUMNS
    if suffix == "pvd":
        path = write_pvd(tmp_path / "p", "plain")
        path.write_text(path.read_text().replace('timestep="0.0015"', 'timestep="1e308"'))
    elif suffix == "xdmf":
        path = write_xdmf(tmp_path / "x", "XML", monkeypatch)
        path.write_text(path.read_text().replace('Value="0.0015"', 'Value="1e308"'))
    else:
        path, columns = tmp_path / f"job.{suffix}", {"time": "t", "value": "S"}
        if suffix == "csv":
            path.write_text("t,S\n0,1\n1e308,2\n")
        else:
            np.savez(path, t=[0.0, 1e308], S=[1.0, 2.0])
    with pytest.raises(ResultError, match=naming(path.name, "1e+308")):
        read(path, [1 if columns is not COLUMNS else 11], columns=columns)


@pytest.mark.parametrize("text", ["1 2 3_0", "1 2 ٣", "1 2 3x", "1 2", "1 2 3 4", "1 2 0x3", ""])
def test_numbers_of_a_text_are_all_there_and_nothing_else(text):
    assert_array_equal(numbers_in(" 1\n2e0 3.\n", 3, np.dtype(np.float64), "S"), [1, 2, 3])
    with pytest.raises(ValueError, match="S"):
        numbers_in(text, 3, np.dtype(np.float64), "S")


def test_a_pvd_that_lost_an_entry_or_a_time_is_refused(tmp_path):
    path = write_pvd(tmp_path / "p", "plain")
    text = path.read_text()
    for change in (
        ("<DataSet", "<DataSeu"),
        ("<DataSet", ">DataSet"),
        ("timestep", "timestop"),
        ("Collection>", "Collectiom>"),
        ('type="Collection"', 'type="Collection" xmlns:a="&b;"'),
    ):
        path.write_text(text.replace(*change, 2 if "Collection>" in change else 1))
        with pytest.raises(ResultError):
            read(path, [11], columns=COLUMNS)


@pytest.mark.parametrize(
    ("change", "shown"),
    [
        (('Name="node"', 'Name="S"'), ("S",)),
        (('NumberOfPoints="5"', 'NumberOfPoints="4"'), (32,)),
        (('type="Float64" Name="S"', 'type="Float32" Name="S"'), (20,)),
        (("vtkZLib", "vtkLZ4"), ("vtkLZ4DataCompressor",)),
        (('type="UnstructuredGrid"', 'type="PolyData"'), ("PolyData",)),
        (("LittleEndian", "BigEndian"), ("node", 16777216)),
        (("Piece", "Piecf"), ("Piecf",)),
    ],
)
def test_a_vtu_whose_header_disagrees_with_its_data_is_refused(tmp_path, change, shown):
    path = write_vtu(tmp_path / "job.vtu", style="zlib")
    path.write_text(path.read_text().replace(*change))
    with pytest.raises(ResultError, match=naming("job.vtu", *shown)):
        read(path, [11], columns=COLUMNS)


def test_an_offset_that_leads_into_another_array_is_refused(tmp_path):
    path = write_appended(tmp_path / "job.vtu", "raw")
    content = path.read_bytes()
    stress_at, node_at = 8 + POINTS.nbytes, 16 + POINTS.nbytes + STRESS_MPA[0].nbytes
    path.write_bytes(content.replace(b'"%d"' % stress_at, b'"%d"' % node_at, 1))
    with pytest.raises(ResultError, match=naming("job.vtu", "node")):
        read(path, [11], columns=COLUMNS)


def test_a_dataset_of_two_names_or_of_another_type_is_doubted_or_refused(tmp_path, monkeypatch):
    path = write_xdmf(tmp_path / "x", "HDF", monkeypatch)
    text = path.read_text()
    path.write_text(text.replace("data4<", "data5<", 1))
    with pytest.raises(ResultError, match=naming("S", "int64", "Float")):
        read(path, [11], columns=COLUMNS)
    path.write_text(text.replace("data4<", "data2<", 1))
    with pytest.warns(FembridgeWarning, match=naming("job.xdmf")):
        read(path, [11], columns=COLUMNS)


def test_a_negative_von_mises_stress_is_doubted(tmp_path):
    np.savez(tmp_path / "a.npz", t=TIMES_S, S=-STRESS_MPA)
    with pytest.warns(FembridgeWarning, match=naming("a.npz", "Pa")):
        read(tmp_path / "a.npz", [1], columns={"time": "t", "value": "S"})


def test_node_numbers_are_whole_not_negative_and_each_is_once(tmp_path):
    columns = {"time": "t", "value": "S", "node": "n"}
    for numbers, shown in (
        ([1, 2, 3, 4, 1], (1, 2)),
        ([1, 2, 3, 4, -1], (-1,)),
        ([1, 2, 3, 4, 1e300], ("1e+300",)),
        ([1, 2, 3, 4, np.nan], ("nan",)),
        ([1, 2, 3, 4], ("(4,)", "(4, 5, 1)")),
    ):
        np.savez(tmp_path / "a.npz", t=TIMES_S, S=STRESS_MPA, n=numbers)
        with pytest.raises(ResultError, match=naming("a.npz", *shown)):
            read(tmp_path / "a.npz", [1], columns=columns)


@pytest.mark.parametrize(
    ("arrays", "shown"),
    [
        ({"S": STRESS_MPA.T}, ("S", "(5, 4)", 4)),
        ({"t": TIMES_S.reshape(2, 2)}, ("t", "(2, 2)", "(T,)")),
        ({"S": STRESS_MPA.astype(object)}, ("S", "object")),
        ({"S": STRESS_MPA.astype(str)}, ("S",)),
        ({"S": np.where(STRESS_MPA > 0.5, STRESS_MPA, np.inf)}, ()),
        ({"t": TIMES_S[:0], "S": STRESS_MPA[:0]}, ()),
        ({"who": ["SA"]}, (1, 5)),
        ({"who": ["SA", "RA", "PC", "SA", "XX"]}, ("'XX'", "SA, RA, PC")),
        ({"who": np.float64(3)}, ("who", "float64", "()")),
    ],
)
def test_arrays_of_an_npz_that_do_not_fit_are_refused_by_name(tmp_path, arrays, shown):
    parts = {"t": TIMES_S, "S": STRESS_MPA, "who": ["SA"] * 5, **arrays}
    np.savez(tmp_path / "a.npz", **parts)
    columns = {"time": "t", "value": "S", "afferent": "who"}
    with pytest.raises(ResultError, match=naming("a.npz", *shown)):
        read(tmp_path / "a.npz", [1], columns=columns)


def test_an_array_that_nobody_names_is_not_read_and_a_near_name_is_shown(tmp_path):
    path = tmp_path / "a.npz"
    np.savez(path, t=TIMES_S, stress=STRESS_MPA, more=np.array([{}], dtype=object))
    assert len(read(path, [1], columns={"time": "t", "value": "stress"})) == 1
    with pytest.raises(ResultError, match=naming("a.npz", "'stres'", "stress")):
        read(path, [1], columns={"time": "t", "value": "stres"})


def test_a_header_of_an_npz_that_lies_is_refused_before_memory_is_taken(tmp_path):
    header = io.BytesIO()
    fields = {"descr": "<f8", "fortran_order": False, "shape": (1 << 40,)}
    np.lib.format.write_array_header_1_0(header, fields)
    path = tmp_path / "a.npz"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("S.npy", header.getvalue())
    with pytest.raises(ResultError, match=naming("a.npz", "S")):
        NpzFile(path, ResultError.at(path))


# --- damage


def mutated(content, source):
    """`content` with one damage: a byte, a bit, a loss, an insertion, a cut or a digit."""
    damaged, kind, at = bytearray(content), source.randrange(7), source.randrange(len(content))
    if kind == 0:
        damaged[at] = source.randrange(256)
    elif kind == 1:
        damaged[at] ^= 1 << source.randrange(8)
    elif kind == 2:
        del damaged[at : at + source.choice([1, 2, 8, 40])]
    elif kind == 3:
        damaged[at:at] = source.randbytes(source.choice([1, 2, 8]))
    elif kind == 4:
        del damaged[at:]
    else:
        digits = [row for row, byte in enumerate(content) if 48 <= byte < 58] or [at]
        at = source.choice(digits)
        damaged[at : at + 1] = source.choice(
            [b"nan", b"1e308", b"1e999", b"99999999999", b"-1", b"1_0", b"x", "٣".encode()]
        )
    return bytes(damaged)


def test_no_mutation_of_a_series_is_a_traceback_or_another_shape(series):
    source = random.Random(7)
    others = sorted(path for path in series.parent.iterdir() if path != series)
    files = [series, *others[2:3], *others[-1:]]
    expected = read(series, [11, 15], columns=COLUMNS)
    for _ in range(200 if os.environ.get("CI") == "true" else 12):
        path = source.choice(files)
        whole = path.read_bytes()
        path.write_bytes(mutated(whole, source))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FembridgeWarning)
            try:
                traces = read(series, [11, 15], columns=COLUMNS)
            except FembridgeError:
                traces = expected
        path.write_bytes(whole)
        for trace, other in zip(traces, expected, strict=True):
            assert trace.node == other.node
            assert trace.stress_pa.shape == other.stress_pa.shape
