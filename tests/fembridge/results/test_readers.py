"""The table of readers, traces of a run folder on the stimulus's clock, and nodes by place."""

import gzip
import os
import shutil
import struct
from dataclasses import replace
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from opened import naming, near_nodes, shows

from fembridge.cli import main
from fembridge.errors import ResultError, UsageError
from fembridge.host.store import sha256_of
from fembridge.io.run_folder import AfferentNode, RunFolder, read_run_folder
from fembridge.results import READERS, Reader, describe, open_result, read, read_history
from fembridge.results.byte_file import ByteFile, in_words
from fembridge.results.read_options import ReadOptions
from fembridge.results.readers import find_reader, read_values


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "the end of the file"),
        (b"\0\0\0", "3 zero bytes"),
        (b" \r\n", "a blank line"),
        (b" -1    12\r\n", "' -1    12'"),
        (b" -1  \xff 12", "' -1  \N{MIDDLE DOT} 12', 1 of it no text"),
        (b"\xff\xfe\x01a", "4 bytes that are no text"),
    ],
)
def test_bytes_are_described_in_words(content, words):
    assert in_words(content) == words


@pytest.mark.parametrize(
    ("name", "content", "shown"),
    [
        ("job.frd", b"", (0,)),
        ("job.frd", b"\x1f\x8b\x08\x00abc", ("gzip", ".frd.gz")),
        ("job.frd", b"\x89HDF\r\n\x1a\n", ("HDF5", ".t16", ".t19")),
        ("job.frd", b"*NODE, NSET=N\n1,0,0,0\n", ("'*NODE, NSET='",)),
        ("job.frd", b"\x00\x01", ("no text", ".frd")),
        ("job.frd", b"   ", ("a blank line", ".frd")),
        ("job.txt", b"    1C\n", ("ccx-frd", ".txt", ".frd")),
        ("job", b"    1C\n", ("ccx-frd", ".frd")),
        ("job.dat", b"\n", ("fembridge ingest", "--point")),
    ],
)
def test_a_foreign_file_is_recognised_by_its_first_bytes(tmp_path, name, content, shown):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(ResultError, match=naming(name, *shown)):
        read(path, [1])


def test_what_is_no_result_file_and_a_choice_of_no_nodes_are_refused(samples, tmp_path):
    (tmp_path / "folder.frd" / "job.frd").mkdir(parents=True)
    os.mkfifo(tmp_path / "pipe.frd")
    for name in ("pip.frd", "nowhere/job.frd", "folder.frd", "pipe.frd"):
        with pytest.raises(ResultError, match=name):
            read(tmp_path / name, [1])
    for nodes in (None, []):
        with pytest.raises(ResultError):
            read(samples / "cpe4_ascii.frd", nodes)
    with pytest.raises(UsageError):
        read(samples / "cpe4_ascii.frd", [11], stress_unit="bar")


def test_a_result_that_was_closed_says_so(samples):
    with open_result(samples / "cpe4_ascii.frd") as result:
        assert result.source.describe()
    with pytest.raises(ResultError, match=naming("cpe4_ascii.frd")):
        result.history([11])


def test_a_file_is_opened_once_for_all_that_a_command_asks(samples, monkeypatch, capsys):
    """It is listed, a node is sought and its trace is tried."""
    path, opened, original = samples / "cpe4_ascii.frd", [], os.open
    monkeypatch.setattr(os, "open", lambda name, how: opened.append(name) or original(name, how))
    assert main(["ingest", str(path)]) == 0
    assert "where it is largest" in capsys.readouterr().out
    assert opened.count(path) == 1


def plug(monkeypatch, value):
    point = EntryPoint("theirs", value, "fembridge.readers")
    monkeypatch.setattr("importlib.metadata.entry_points", lambda group: (point,))


def test_another_package_adds_a_reader_under_the_entry_point(file, monkeypatch, samples):
    theirs = Reader("theirs", ".zzz", b"ZZZ", "fembridge.results.frd:FrdSource")
    monkeypatch.setattr("fembridge.results.THEIRS", theirs, raising=False)
    plug(monkeypatch, "fembridge.results:THEIRS")
    path = file("run.zzz", b"ZZZ\n")
    with ByteFile(path) as file:
        assert find_reader(file) is theirs
    with pytest.raises(ResultError):
        read(path, [1])


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        ("no_such_module_here:row", ("ModuleNotFoundError",)),
        ("fembridge.results:read", ("function", "fembridge.results.Reader")),
    ],
)
def test_a_broken_plugin_is_named_and_spares_our_own_formats(
    file, monkeypatch, samples, value, shown
):
    plug(monkeypatch, value)
    with ByteFile(samples / "cpe4_ascii.frd") as ours:
        assert find_reader(ours) is READERS[0]
    path = file("run.zzz", b"ZZZ\n")
    with pytest.raises(ResultError, match=naming("run.zzz", value, *shown)):
        describe(path)


@pytest.fixture
def make_run(tmp_path, write_frd, block):
    """Make a run folder whose stress is 1, 2, 3, ... MPa, uniaxial."""

    def make(increments=6, start_ms=0.0, planned=None, dt_ms=0.5, nodes=(3, 1)):
        folder = tmp_path / "run"
        folder.mkdir()
        blocks = [
            block(
                "STRESS",
                k,
                k * dt_ms / 1e3,
                [(n, [float(k * n), 0, 0, 0, 0, 0]) for n in (1, 2, 3)],
                flag=3,
            )
            for k in range(1, increments + 1)
        ]
        write_frd(blocks).rename(folder / "job.frd")
        places = tuple(
            AfferentNode(name, node, "dermis", 0.0, 0.0, 1.0)
            for name, node in zip(("SA", "RA"), nodes, strict=True)
        )
        total = increments if planned is None else planned
        RunFolder(folder, "calculix", total, dt_ms, start_ms, places, "0").write()
        return folder

    return make


def test_without_a_ramp_a_rest_sample_of_zero_comes_first(make_run):
    sa, ra = read(make_run())
    assert (sa.afferent, sa.node, ra.afferent, ra.node) == ("SA", 3, "RA", 1)
    assert (ra.start_ms, ra.dt_ms) == (0.0, 0.5)
    assert ra.stress_pa[0] == 0.0
    assert_allclose(ra.stress_pa, np.arange(7) * 1e6, rtol=1e-12)
    assert_allclose(sa.stress_pa, np.arange(7) * 3e6, rtol=1e-12)


def test_with_a_ramp_its_last_increment_is_time_zero_also_of_nodes_that_are_named(make_run):
    folder = make_run(start_ms=1.0)
    _, ra = read(folder)
    assert ra.start_ms == 0.0
    assert_allclose(ra.stress_pa, [2e6, 3e6, 4e6, 5e6, 6e6], rtol=1e-12)
    (trace,) = read(folder, [2])
    assert (trace.afferent, trace.node, trace.start_ms) == (None, 2, 0.0)
    assert trace.stress_pa[0] == 4e6


def test_two_afferents_may_share_a_node(make_run):
    sa, ra = read(make_run(nodes=(2, 2)))
    assert (sa.afferent, ra.afferent, sa.node, ra.node) == ("SA", "RA", 2, 2)
    assert_allclose(sa.stress_pa, ra.stress_pa, rtol=0)


@pytest.mark.parametrize(
    ("start_ms", "shown"),
    [(0.75, "0.75 ms"), (3.0, "3 ms")],
)
def test_a_stimulus_that_begins_between_increments_or_after_them_is_refused(
    make_run, start_ms, shown
):
    with pytest.raises(ResultError, match=naming("job.frd", shown, "0.5 to 3 ms")):
        read(make_run(start_ms=start_ms))


def test_results_that_stop_short_of_the_deck_are_refused_or_told(make_run, logged):
    folder = make_run(increments=4, planned=6)
    with pytest.raises(ResultError, match=naming("job.frd", "2 ms", "3 ms")):
        read(folder)
    logged = logged
    _, ra = read(folder, partial=True)
    assert ra.stress_pa.size == 5
    assert len(logged) == 1
    assert shows(logged[0], "2 ms", "3 ms")


RECORDED = Path(__file__).parents[3] / "fixtures" / "transient_sine"


@pytest.fixture
def folder(tmp_path):
    copy = tmp_path / "run"
    shutil.copytree(RECORDED, copy)
    (copy / "solver.toml").write_text(
        f'format = 1\ndeck_sha256 = "{sha256_of(copy / "job.inp")}"\n'
    )
    return copy


@pytest.mark.parametrize("resample_ms", [0.7, 0.25, 60.0])
@pytest.mark.filterwarnings("ignore:.*filter it first:fembridge.FembridgeWarning")
def test_a_whole_run_is_whole_whatever_the_step_that_it_is_resampled_with(folder, resample_ms):
    plain, (sa, *_) = read(folder), read(folder, resample_ms=resample_ms)
    assert (sa.start_ms, sa.stress_pa[0]) == (0.0, plain[0].stress_pa[0])
    assert 60.0 - resample_ms < sa.times_ms[-1] <= 60.0 + 1e-9


def test_a_deck_changed_after_the_run_is_named_with_what_to_do(folder):
    with (folder / "job.inp").open("a") as deck:
        deck.write("** another thought\n")
    with pytest.raises(ResultError):
        read(folder)


def nodes_of(run):
    return {place.afferent: place.node for place in run.afferents}


@pytest.fixture
def saying(tmp_path):
    """A function that gives a recorded run which says that of its nodes."""

    def write(of):
        run = read_run_folder(shutil.copytree(RECORDED, tmp_path / "run"))
        replace(run, **of(nodes_of(run))).write()
        return read_run_folder(tmp_path / "run")

    return write


@pytest.mark.parametrize("by_number", [False, True])
def test_stress_is_the_sum_where_there_are_branches_and_else_as_it_was(saying, by_number):
    relaxing = saying(lambda nodes: {"branches": {nodes["PC"]: 3}})
    nodes = nodes_of(relaxing)
    chosen = list(nodes.values()) if by_number else None
    plain = {trace.node: trace.stress_pa for trace in read(RECORDED, chosen)}
    summed = {trace.node: trace.stress_pa for trace in read(relaxing.folder, chosen)}

    node = nodes.pop("PC")
    assert_allclose(summed[node], 3 * plain[node], rtol=1e-14, atol=1e-100)
    for other in nodes.values():
        assert_array_equal(summed[other], plain[other])
    every = read_history(relaxing.folder, "all")
    of_node = every[every["node"] == node]["von_mises_pa"].to_numpy()
    assert_allclose(of_node, summed[node][1:], rtol=1e-9)


def test_a_node_between_as_many_materials_as_branches_is_let_through(samples):
    path = samples / "cpe4_ascii.frd"
    mean = read_values(path, [18], ReadOptions(across_materials=True))[1]
    summed = read_values(path, [18], ReadOptions(branches={18: 2}))[1]
    assert_allclose(summed, 2 * mean, rtol=1e-14, atol=1e-100)


SXY = 3


def von_mises(tensor):
    """Of one tensor, xx yy zz xy yz zx, by its deviator."""
    xx, yy, zz, xy, yz, zx = tensor
    whole = np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]])
    deviator = whole - np.trace(whole) / 3 * np.eye(3)
    return np.sqrt(1.5 * (deviator**2).sum())


@pytest.mark.parametrize("by_number", [False, True])
def test_traces_of_a_half_are_made_without_the_shear_on_its_axis(saying, by_number):
    """As if RA's node, where there is shear, were there."""
    halved = saying(lambda nodes: {"on_axis": (nodes["RA"],)})
    node = nodes_of(halved)["RA"]
    chosen = [node] if by_number else None
    found = {trace.node: trace for trace in read(halved.folder, chosen)}
    plain = {trace.node: trace for trace in read(RECORDED, chosen)}
    tensor_pa = read_values(halved.results, [node])[1][:, 0]
    tensor_pa[:, SXY] = 0.0
    expected_pa = [0.0, *map(von_mises, tensor_pa)]
    assert_allclose(found[node].stress_pa, expected_pa, rtol=1e-9, atol=1e-9)
    assert np.abs(found[node].stress_pa - plain[node].stress_pa).max() > 1
    for other in set(found) - {node}:
        assert_array_equal(found[other].stress_pa, plain[other].stress_pa)
    every = read_history(halved.folder, "all", across_materials=True)
    of_node = every[every["node"] == node]["von_mises_pa"].to_numpy()
    assert_allclose(of_node, expected_pa[1:], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", ["cpe4_ascii.frd", "cpe4_bin_f64.frd"])
def test_a_packed_file_is_read_as_what_is_in_it(samples, file, name):
    path = file(f"{name}.gz", gzip.compress((samples / name).read_bytes()))
    (packed,), (plain,) = read(path, [25]), read(samples / name, [25])
    assert packed.stress_pa.tolist() == plain.stress_pa.tolist()
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(ResultError, match=naming(f"{name}.gz")):
        read(path, [25])


def test_a_bomb_is_unpacked_up_to_a_bound(file, monkeypatch):
    monkeypatch.setattr("fembridge.results.byte_file.SMALL_BYTES", 1 << 16)
    path = file("job.frd.gz", gzip.compress(bytes(1 << 24)))
    with pytest.raises(ResultError, match=naming("job.frd.gz", 100)):
        read(path, [25])


# ---- Nodes by their place


def test_a_nearer_node_without_results_is_named(samples):
    path = samples / "cpe8r_nset_bin_f32.frd"
    [(node, words)] = near_nodes(path, [(0.0, 0.0, 0.0)])
    assert node == 27
    assert shows(words, "node 27", "node 1")


def test_a_place_is_as_deep_as_the_mesh(block, write_frd, samples):
    for place in ((1.0,), (1.0, 2.0, 3.0, 4.0), (1.0, float("nan"))):
        with pytest.raises(UsageError):
            near_nodes(samples / "cpe4_ascii.frd", [place])
    path = write_frd([block("STRESS", 1, 1e-3, [(1, [1.0] * 6)])], mesh_flag=3)
    content = path.read_bytes()
    old, new = struct.pack("<i3d", 2, 2, 0, 0), struct.pack("<i3d", 2, 2, 0, 1.5)
    path.write_bytes(content.replace(old, new))
    with pytest.raises(UsageError, match=naming("near_mm", "0 to 1.5", "x,y,z")):
        near_nodes(path, [(1, 0)])
    assert near_nodes(path, [(1, 0, 0)])[0][0] == 1


@settings(max_examples=30)
@given(seed=st.integers(0, 99), mesh_flag=st.sampled_from([1, 3]), count=st.integers(1, 40))
def test_any_place_gives_what_a_plain_search_gives(block, write_frd, seed, mesh_flag, count):
    """The writer puts node n at x = n."""
    rng = np.random.default_rng(seed)
    mesh = sorted(rng.choice(np.arange(1, 200), count + 5, replace=False).tolist())
    held = sorted(rng.choice(mesh, count, replace=False).tolist())
    path = write_frd(
        [block("STRESS", 1, 1e-3, [(n, [1.0] * 6) for n in held])],
        nodes=mesh,
        elements=[(9, 1, mesh[:4])],
        mesh_flag=mesh_flag,
    )
    x_mm = float(rng.uniform(-5, 205))
    [(node, words)] = near_nodes(path, [(x_mm, 0.0)])
    assert node == min(held, key=lambda n: (abs(n - x_mm), n))
    assert f"{abs(node - x_mm):.3g} mm away" in words
