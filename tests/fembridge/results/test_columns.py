"""Tables and series of any program, whose columns the user names."""

import gzip
import itertools
import zipfile
from contextlib import suppress

import meshio
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from opened import naming, shows

from fembridge import read, read_history, write_vtu_series
from fembridge.cli import main
from fembridge.errors import FembridgeError, ResultError, TableError, UsageError
from fembridge.io.trace_table import read_traces
from fembridge.results.von_mises import von_mises_pa

TIMES_S = np.arange(0.0, 0.01, 0.0005)
STRESS_MPA = 0.01 * np.sin(2 * np.pi * 100 * TIMES_S) ** 2
TENSOR = np.array([3.0, 1.0, -2.0, 0.5, 0.25, -0.75])
SIX = {key: f"S{key.upper()}" for key in ("xx", "yy", "zz", "xy", "yz", "zx")}


def rows(separator, *columns):
    return "".join(separator.join(map(str, row)) + "\n" for row in zip(*columns, strict=True))


@pytest.mark.parametrize(
    ("head", "separator", "columns", "factor"),
    [
        ("Time [s];Stress (v-M) [MPa]\n", ";", ("Time [s]", "Stress (v-M) [MPa]"), 1e6),
        ("% Model:,f.mph\n%\n% t (s),solid.mises (Pa)\n", ",", ("t (s)", "solid.mises (Pa)"), 1.0),
        ("#TABLE VM\n\n INST VMIS\n", " ", ("INST", "VMIS"), 1e6),
        ("\ufefft\tS_kpa\r\n", "\t", ("t", "S_kpa"), 1e3),
    ],
)
def test_a_table_of_one_place_is_a_trace(file, head, separator, columns, factor):
    path = file("them.csv", head + rows(separator, TIMES_S, STRESS_MPA))
    (trace,) = read(path, columns=dict(zip(("time", "value"), columns, strict=True)))
    assert (trace.node, trace.start_ms) == (1, 0.0)
    assert trace.dt_ms == pytest.approx(0.5)
    assert_allclose(trace.stress_pa, STRESS_MPA * factor, rtol=1e-12)
    names = dict(zip(("time", "value"), columns, strict=True))
    (again,) = read_traces(path, columns=names, gain_pa=factor)
    assert_allclose(again.stress_pa, trace.stress_pa, rtol=1e-12)
    path.write_text(path.read_text().rstrip("\n") + "x\n")
    with pytest.raises(TableError) as caught:
        read_traces(path, columns=names, gain_pa=factor)
    assert caught.value.line == len(path.read_text().splitlines())


def test_nodes_afferents_and_a_tensor_in_any_order_of_rows(file):
    table = [
        (1000 * t, node, word, *(s * node * TENSOR))
        for node, word in ((9, "RA"), (7, "SA"))
        for t, s in zip(TIMES_S, STRESS_MPA, strict=True)
    ]
    path = file(
        "them.csv", "ms,N,who,SXX,SYY,SZZ,SXY,SYZ,SZX\n" + rows(",", *zip(*table, strict=True))
    )
    names = {"time_ms": "ms", "node": "N", "afferent": "who", **SIX}
    traces = read(path, columns=names)
    assert [(one.node, one.afferent) for one in traces] == [(7, "SA"), (9, "RA")]
    assert_allclose(traces[1].stress_pa, 9e6 * STRESS_MPA * von_mises_pa(TENSOR), rtol=1e-12)
    held = read_history(path, [9], quantity="stress", columns=names)
    assert list(held)[:3] == ["time_ms", "afferent", "node"]
    assert_allclose(held["szx_pa"], -0.75 * 9e6 * STRESS_MPA, rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "pa"), [("S [GPa]", 1e9), ("S (N/m^2)", 1.0), ("S [N/mm²]", 1e6), ("S_vm", 1e6),
                     ("S (von-Mises)", 1e6)],
)  # fmt: skip
@pytest.mark.filterwarnings("ignore:.*above 1 GPa:fembridge.FembridgeWarning")
def test_the_unit_in_a_name_is_taken(file, name, pa):
    path = file("them.csv", f"t_s,{name}\n0,1\n1,2\n")
    names = {"time": "t_s", "value": name}
    assert read(path, columns=names)[0].stress_pa.tolist() == [pa, 2 * pa]
    other = read(path, columns=names, stress_unit="kPa")[0].stress_pa[0]
    assert other == (1e3 if name in ("S_vm", "S (von-Mises)") else pa)  # the name goes before


def test_a_unit_that_is_none_of_stress_or_time_is_refused_with_the_way_out(file):
    path = file("them.csv", "t_s,t [min],S [furlong],force_n\n0,0,1,1\n1,1,2,2\n")
    for name in ("S [furlong]", "force_n"):
        names = {"time": "t_s", "value": name}
        with pytest.raises(UsageError, match=naming("Pa", "--stress-unit")):
            read(path, columns=names)
        assert read(path, columns=names, stress_unit="kPa")[0].stress_pa.tolist() == [1e3, 2e3]
    names = {"value": "S [furlong]"}
    with pytest.raises(UsageError, match=naming("'min'", "s, ms or us", "time_ms=t [min]")):
        read(path, columns={"time": "t [min]", **names}, stress_unit="Pa")
    for reader in (read_traces, lambda *a, **k: read(*a, stress_unit="Pa", **k)):
        how = {"gain_pa": 1.0} if reader is read_traces else {}
        (trace,) = reader(path, columns={"time_ms": "t [min]", **names}, **how)
        assert trace.dt_ms == 1.0
    with pytest.raises(UsageError, match=naming("'min'", "s, ms or us")):
        read_traces(path, columns={"time": "t [min]", **names}, gain_pa=1.0)


def test_node_and_afferent_are_found_by_their_names_as_encode_finds_them(file):
    path = file("them.csv", "t_s,node,afferent,S_pa\n0,9,RA,1\n1,9,RA,2\n0,7,SA,3\n1,7,SA,4\n")
    names = {"time": "t_s", "value": "S_pa"}
    whose = [
        {(one.node, one.afferent, *one.stress_pa) for one in reader(path, columns=names)}
        for reader in (read, read_traces)
    ]
    assert whose[0] == whose[1] == {(9, "RA", 1, 2), (7, "SA", 3, 4)}


def test_nodes_that_another_program_numbers_from_0_go_through_to_spikes(tmp_path):
    path, out = tmp_path / "them.csv", tmp_path / "out.csv"
    both = [(t, node, s) for node in (0, 1) for t, s in zip(TIMES_S, STRESS_MPA, strict=True)]
    path.write_text("t,node,S\n" + rows(",", *zip(*both, strict=True)))
    words = ["--columns", "time=t,value=S", "--node", "all", "-o", str(out)]
    assert main(["ingest", str(path), *words]) == 0
    assert [trace.node for trace in read_traces(out)] == [0, 1]


def test_a_packed_table_is_read_as_it_is_and_its_errors_name_it(file):
    path = file("them.csv.gz", gzip.compress(b"t_s,S_mpa\n0,1\n1,2\n"))
    (trace,) = read(path, columns={"time": "t_s", "value": "S_mpa"})
    assert_array_equal(trace.stress_pa, [1e6, 2e6])
    path.write_bytes(gzip.compress(b"t_s,S_mpa\n0,1\n1,x\n"))
    with pytest.raises(ResultError, match=naming("them.csv.gz:3", "S_mpa", "'x'")):
        read(path, columns={"time": "t_s", "value": "S_mpa"})


@pytest.mark.parametrize("form", ["value", "tensor", "components"])
def test_an_npz_has_arrays_over_time_and_nodes(tmp_path, form):
    path = tmp_path / "them.npz"
    stress = np.stack([STRESS_MPA, 2 * STRESS_MPA], 1)
    tensor = stress[:, :, None] * TENSOR
    arrays = {"t": TIMES_S, "n": [11, 12], "S": stress if form == "value" else tensor}
    arrays |= {name: tensor[:, :, k] for k, name in enumerate(SIX.values())}
    np.savez(path, **arrays)
    names = {"time": "t", "node": "n"} | (SIX if form == "components" else {"value": "S"})
    scale = 1.0 if form == "value" else von_mises_pa(TENSOR)
    traces = read(path, columns=names)
    assert [one.node for one in traces] == [11, 12]
    assert_allclose(traces[1].stress_pa, 2e6 * STRESS_MPA * scale, rtol=1e-12)


def test_our_own_series_comes_back_in(samples, tmp_path):
    path = samples / "cpe4_bin_f64.frd"
    series = write_vtu_series(path, tmp_path)
    for value in ("von_mises_pa", "STRESS_pa"):
        names = {"value": value, "node": "node"}  # the series says that it is in ms
        (found,), (wanted,) = read(series, [25], columns=names), read(path, [25])
        assert_allclose(found.stress_pa, wanted.stress_pa, rtol=1e-12)
        assert_array_equal(found.times_ms, wanted.times_ms)
    (near,), (there,) = (
        read(one, near_mm=[(0.6, 0.3)], **how)
        for one, how in ((series, {"columns": names}), (path, {}))
    )
    assert near.node == there.node


@pytest.mark.parametrize("array", ["mises", "six", "nine"])
def test_an_xdmf_series_is_read_with_its_own_order_of_tensors(here, array):
    path = here / "them.xdmf"  # meshio puts the HDF5 into the current folder
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    xx, yy, zz, xy, yz, zx = TENSOR
    nine = np.array([xx, xy, zx, xy, yy, yz, zx, yz, zz])
    six = np.array([xx, xy, zx, yy, yz, zz])  # XDMF's Tensor6
    with meshio.xdmf.TimeSeriesWriter(path) as out:
        out.write_points_cells(points, [("triangle", np.array([[0, 1, 2]]))])
        for t, s in zip(TIMES_S, STRESS_MPA, strict=True):
            grown = s * np.array([[1.0], [2.0], [3.0]])
            data = {"mises": grown[:, 0], "six": grown * six, "nine": grown * nine}
            out.write_data(float(t), point_data=data)
    (trace,) = read(path, near_mm=[(1, 0)], columns={"time": "t", "value": array})
    scale = 1.0 if array == "mises" else von_mises_pa(TENSOR)
    assert trace.node == 2
    assert_allclose(trace.stress_pa, 2e6 * STRESS_MPA * scale, rtol=1e-9)


@pytest.mark.parametrize(
    ("text", "names", "shown"),
    [
        ("t,S\n0,1\n1,2\n", None, ("columns", "t, S")),
        ("t,S\n0,1\n1,2\n", {"time": "t", "value": "X"}, ("'X'", "value", "t, S")),
        ("t,S\n0,1\n1,2\n", {"time": "t", "stress": "S"}, ("columns", "'stress'")),
        ("t,S\n0,1\n1,2\n", {"value": "S"}, ("columns", "time_ms")),
        ("t,S\n0,1\n1,2\n", {"time": "t", "xx": "S"}, ("columns", "value", "xx, yy")),
        ("t,S\n0,1\n1,x\n", {"time": "t", "value": "S"}, ("them.csv:3", "S", "'x'")),
        ("t,S\n0,1\n1,nan\n", {"time": "t", "value": "S"}, ("them.csv:3", "S", "'nan'")),
        ("t,S,n\n0,1,1\n1,2,1\n0,1,2\n", {"time": "t", "value": "S", "node": "n"},
         (2,)),
        ("t,S,n\n0,1,1\n1,2,1\n0,1,2\n3,1,2\n", {"time": "t", "value": "S", "node": "n"},
         ("them.csv:5", 2, 1)),
        ("t,S\n0,1\n1,2,3\n", {"time": "t", "value": "S"}, ("them.csv:3", 3, 2)),
        ("t,S\n0,1,2\n1,2,3\n", {"time": "t", "value": "S"}, ("them.csv:2", 3, 2)),
        ("t,S\n", {"time": "t", "value": "S"}, ("them.csv",)),
    ],
)  # fmt: skip
def test_what_a_table_lacks_is_named(file, text, names, shown):
    path = file("them.csv", text)
    with pytest.raises(FembridgeError, match=naming(*shown)):
        read(path, [1], columns=names)


def test_an_npz_that_unpacks_to_more_than_the_bound_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("fembridge.host.memory.SMALL_BYTES", 1 << 20)
    path = tmp_path / "bomb.npz"
    np.savez_compressed(path, t=TIMES_S, S=np.zeros((TIMES_S.size, 1 << 14)))
    with pytest.raises(ResultError, match=naming("bomb.npz", "S, t", 100)):
        read(path, [1], columns={"time": "t", "value": "S"})


def test_an_npz_that_is_damaged_or_holds_no_real_numbers_is_refused(tmp_path):
    path = tmp_path / "them.npz"
    np.savez_compressed(path, t=TIMES_S, S=STRESS_MPA)
    whole = path.read_bytes()
    for place in range(0, len(whole), 5):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 0xFF]) + whole[place + 1 :])
        with suppress(ResultError):
            read(path, [1], columns={"time": "t", "value": "S"})
    with zipfile.ZipFile(path, "w") as out:
        out.writestr("S.npy", bytes(100))
    with pytest.raises(ResultError, match=naming("them.npz", "S")):
        read(path, [1], columns={"time": "S", "value": "S"})
    np.savez(path, t=TIMES_S, S=STRESS_MPA * 1j)
    with pytest.raises(ResultError, match=naming("them.npz", "S", "complex128")):
        read(path, [1], columns={"time": "t", "value": "S"})
    np.savez(path, t=np.where(TIMES_S > 0, TIMES_S, np.nan), S=STRESS_MPA)
    with pytest.raises(ResultError, match=naming("them.npz", 1, "nan")):
        read(path, [1], columns={"time": "t", "value": "S"})
    np.savez(path, t=TIMES_S, S=STRESS_MPA, nodes=[1.5])
    with pytest.raises(ResultError, match=naming("them.npz", 1.5)):
        read(path, [1], columns={"time": "t", "value": "S", "node": "nodes"})


@pytest.mark.parametrize("suffix", [".pvd", ".vtu", ".xdmf"])
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_a_damaged_series_is_an_error_of_ours(samples, tmp_path, suffix, share):
    series = write_vtu_series(samples / "cpe4_ascii.frd", tmp_path)
    path = series if suffix == ".pvd" else next(tmp_path.glob("*.vtu")).with_name(f"job{suffix}")
    if suffix != ".pvd":
        path.write_bytes(next(tmp_path.glob("*.vtu")).read_bytes())
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(ResultError):
        read(path, [1], columns={"time": "t", "value": "von_mises_pa"})


def test_a_vtu_of_vectors_and_one_that_lies_are_refused(tmp_path):
    path = tmp_path / "them.vtu"
    points = np.zeros((30, 3))
    meshio.write(path, meshio.Mesh(points, [("vertex", np.arange(30)[:, None])], {"S": points}))
    names = {"time": "t", "value": "S"}
    with pytest.raises(ResultError, match=naming("them.vtu", 3)):
        read(path, [1], columns=names)
    path.write_text(path.read_text().replace('NumberOfComponents="3"', 'NumberOfComponents="7"'))
    with pytest.raises(ResultError, match=naming("them.vtu", "S", 720, 1680)):
        read(path, [1], columns=names)


def test_a_pvd_does_not_leave_its_folder(samples, tmp_path):
    series = write_vtu_series(samples / "cpe4_ascii.frd", tmp_path / "a")
    series.write_text(series.read_text().replace('file="', 'file="../a/../../'))
    with pytest.raises(ResultError, match=naming(series.name)):
        read(series, [1], columns={"time_ms": "t", "value": "von_mises_pa"})


def test_whole_fields_of_a_table_are_refused(tmp_path, capsys, file):
    path = file("them.csv", "t,S\n0,1\n1,2\n")
    for words in itertools.product(["--field", "--vtu"], [str(tmp_path / "x")]):
        assert main(["ingest", str(path), *words, "--columns", "time=t,value=S"]) == 2
        assert shows(capsys.readouterr().err, "them.csv")
    with pytest.raises(UsageError, match=naming("them.csv")):
        read(path, near_mm=[(0, 0)], columns={"time": "t", "value": "S"})


def test_the_command_lists_writes_and_what_it_wrote_is_encoded(here, file, capsys):
    text = "t,S,who,n\n" + "".join(
        f"{t},{s},SA,3\n" for t, s in zip(TIMES_S, STRESS_MPA, strict=True)
    )
    file("them.csv", text)
    assert main(["ingest", "them.csv"]) == 0
    assert shows(capsys.readouterr().out, "--columns", "time=NAME,value=NAME", "t, S, who, n")
    names = "time=t,value=S,afferent=who,node=n"
    assert main(["ingest", "them.csv", "--columns", names, "-o", "traces.csv"]) == 0
    said = capsys.readouterr()
    assert "1 trace, 0 to 9.5 ms every 0.5 ms" in said.out
    assert said.err.count("--columns time_ms=t") == 1
    assert main(["encode", "traces.csv", "--no-raster"]) == 0
