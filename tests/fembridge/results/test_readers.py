"""The table of readers: who takes which file, and what is said to a foreign one."""

import os
import subprocess
import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from fembridge.errors import ResultError, UsageError
from fembridge.results import READERS, Reader, describe, read, reader_of


def test_a_result_file_is_taken_by_suffix_and_first_bytes(samples):
    assert reader_of(samples / "cpe4_ascii.frd") is READERS[0]


def test_traces_come_in_the_order_asked_for_in_pa_and_ms(samples):
    """Values of the sample's expected.json, in MPa there."""
    first, second = read(samples / "cpe4_bin_f64.frd", [25, 11])
    assert (first.node, second.node) == (25, 11)
    assert (first.dt_ms, first.start_ms, first.afferent) == (0.5, 0.5, None)
    assert first.stress_pa[0] == pytest.approx(9209.340, rel=1e-6)
    assert second.stress_pa[-1] == pytest.approx(2484.529, rel=1e-6)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("job.frd", b"", "empty: 0 bytes"),
        ("job.frd", b"\x1f\x8b\x08\x00abc", "gzip: unpack it first"),
        ("job.frd", b"\x89HDF\r\n\x1a\n", "HDF5"),
        ("job.frd", b"*NODE, NSET=N\n1,0,0,0\n", "a solver deck, no results"),
        ("job.frd", b"\x00\x01", r"begins with b'\\x00\\x01'.*\.frd begins with b'  "),
        ("job.frd", b"   ", "no result file we read"),
        ("job.txt", b"    1C\n", r"begins like ccx-frd .* rename it to \.frd"),
        ("job", b"    1C\n", "named nothing: rename it"),
        ("job.dat", b"\n", "prints of CalculiX, no nodal results: fembridge ingest"),
    ],
)
def test_a_foreign_file_is_told_by_its_first_bytes(tmp_path, name, content, words):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(ResultError, match=words):
        read(path, [1])


def test_a_missing_file_is_told_with_a_near_name(tmp_path):
    (tmp_path / "job.frd").write_bytes(b"    1C\n")
    with pytest.raises(ResultError, match=r"no such file; near it: job\.frd"):
        read(tmp_path / "jab.frd", [1])
    with pytest.raises(ResultError, match="there is no folder"):
        read(tmp_path / "nowhere" / "job.frd", [1])


def test_a_folder_and_a_pipe_are_no_result_files(tmp_path):
    folder = tmp_path / "x.frd"
    (folder / "job.frd").mkdir(parents=True)
    with pytest.raises(ResultError, match="a folder, expected a result file"):
        read(folder, [1])
    os.mkfifo(tmp_path / "pipe.frd")
    with pytest.raises(ResultError, match="a pipe or a device"):
        read(tmp_path / "pipe.frd", [1])


def test_without_run_toml_the_nodes_have_to_be_named(samples):
    with pytest.raises(ResultError, match=r"no run\.toml beside it: name the nodes"):
        read(samples / "cpe4_ascii.frd")
    with pytest.raises(ResultError, match="no nodes to read"):
        read(samples / "cpe4_ascii.frd", [])


def test_an_unknown_unit_is_misuse(samples):
    with pytest.raises(UsageError, match="stress unit 'psi', expected MPa, kPa, Pa"):
        read(samples / "cpe4_ascii.frd", [11], stress_unit="psi")


def plug(monkeypatch, value):
    point = EntryPoint("theirs", value, "fembridge.readers")
    monkeypatch.setattr("importlib.metadata.entry_points", lambda group: (point,))


def test_another_package_adds_a_reader_under_the_entry_point(tmp_path, monkeypatch, samples):
    theirs = Reader("theirs", ".zzz", b"ZZZ", "fembridge.results.frd:read")
    monkeypatch.setattr("fembridge.results.THEIRS", theirs, raising=False)
    plug(monkeypatch, "fembridge.results:THEIRS")
    path = tmp_path / "run.zzz"
    path.write_bytes(b"ZZZ\n")
    assert reader_of(path) is theirs
    with pytest.raises(ResultError, match=r"no \.frd"):
        describe(path)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("no_such_module_here:row", "cannot be loaded: ModuleNotFoundError"),
        ("fembridge.results:read", "is a function, expected a fembridge.results.Rea"),
    ],
)
def test_a_broken_plugin_is_named_and_spares_our_own_formats(
    tmp_path, monkeypatch, samples, value, words
):
    plug(monkeypatch, value)
    assert reader_of(samples / "cpe4_ascii.frd") is READERS[0]
    path = tmp_path / "run.zzz"
    path.write_bytes(b"ZZZ\n")
    with pytest.raises(ResultError, match=words):
        reader_of(path)


def test_reading_loads_nothing_heavier_than_numpy(samples):
    code = (
        "import sys, fembridge.results as r\n"
        "assert 'fembridge.results.frd' not in sys.modules\n"
        "r.read(sys.argv[1], [11])\n"
        "heavy = {'pandas', 'scipy', 'meshio', 'matplotlib', 'rich'}\n"
        "sys.exit(str(heavy & set(sys.modules) or ''))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(samples / "cpe4_ascii.frd")],
        capture_output=True,
        text=True,
        cwd=Path(__file__).parents[3],
        check=False,
    )
    assert done.stderr.strip() == ""
