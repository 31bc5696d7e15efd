"""What a command leaves in temporary and working folders: nothing, or what the next removes."""

import gzip
import os
import signal

import pytest

from fembridge.cli import main
from fembridge.errors import OutputError
from fembridge.host.store import DRAFT_PREFIX, folder_lock, temporary_folder
from fembridge.results.byte_file import ByteFile

SOLVER = """
import os, sys, time
from pathlib import Path
if sys.argv[1] == "-v":
    print("This is Version 2.20")
    sys.exit(201)
print("CalculiX Version 2.20, Copyright", flush=True)
job = sys.argv[2]
Path("spooles.out").write_text("pivots")
Path(f"{job}.sta").write_text("SUMMARY\\n")
Path(os.environ["AT_WORK"]).touch()
if Path(os.environ["AT_WORK"]).with_name("ends").exists():
    print(" *ERROR in nowhere: the end", flush=True)
    sys.exit(201)
time.sleep(600)
"""
PAD = ["pad", "--plane", "--spacing-mm", "0.5", "--reach-mm", "2", "-o"]


@pytest.fixture
def temporary(tmp_path, monkeypatch):
    """The temporary directory, of this process and of those that it starts."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setenv("TMPDIR", str(folder))
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    return folder


@pytest.fixture
def slow_ccx(tmp_path, monkeypatch, python_program):
    """A solver that works until it is stopped; once there is a file `ends`, it fails at once."""
    monkeypatch.setenv("FEMBRIDGE_CCX", str(python_program(tmp_path / "bin" / "ccx", SOLVER)))
    monkeypatch.setenv("AT_WORK", str(tmp_path / "at work"))
    return tmp_path / "at work"


def names_below(folder):
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*"))


@pytest.mark.parametrize(
    "number",
    [
        signal.SIGKILL,
        *(pytest.param(each, marks=pytest.mark.slow) for each in (signal.SIGINT, signal.SIGTERM)),
    ],
)
def test_pad_that_is_ended_leaves_what_the_next_removes(
    begin, tmp_path, temporary, slow_ccx, wait_until, capsys, as_in_table, number
):
    out = tmp_path / "out"
    process = begin("-m", "fembridge.cli", *PAD, out / "pad.npz")
    wait_until(slow_ccx.exists)
    os.kill(process.pid, number)
    process.communicate()
    assert not names_below(temporary)
    if number != signal.SIGKILL:
        assert process.returncode == 128 + number
        assert not names_below(out)
        return
    (draft,) = out.iterdir()
    assert draft.name.startswith(DRAFT_PREFIX)
    slow_ccx.with_name("ends").touch()
    assert main([*PAD, str(out / "pad.npz")]) == 1
    as_in_table(capsys.readouterr().err.strip().removeprefix("fembridge: "))
    assert not names_below(out)
    assert not names_below(temporary)


def test_a_run_that_is_killed_leaves_what_the_next_run_removes(
    begin, temporary, slow_ccx, make_run, wait_until, capsys, as_in_table
):
    """CalculiX writes ``spooles.out`` where it was started: in the run folder."""
    folder = make_run()
    process = begin("-m", "fembridge.cli", "run", folder)
    wait_until(slow_ccx.exists)
    process.kill()
    process.communicate()
    assert (folder / "spooles.out").is_file()
    slow_ccx.with_name("ends").touch()
    assert main(["run", str(folder)]) == 1
    as_in_table(capsys.readouterr().err.strip().removeprefix("fembridge: "))
    assert {path.name for path in folder.iterdir()} == {"failed", "job.inp", "run.toml"}
    assert not names_below(temporary)


def test_a_lock_that_cannot_be_written_leaves_no_file(tmp_path, as_in_table, file_size_limit):
    file_size_limit(0)
    with pytest.raises(OutputError) as problem, folder_lock(tmp_path, ".lock"):
        pytest.fail("locked without a number")
    as_in_table(str(problem.value))
    assert not names_below(tmp_path)


def test_a_packed_result_has_no_name_where_it_is_unpacked(temporary, tmp_path):
    path = tmp_path / "job.frd.gz"
    path.write_bytes(gzip.compress(b"    1C\n 9999\n"))
    with ByteFile(path) as file:
        assert not names_below(temporary)
        assert file.data_path.read_bytes() == b"    1C\n 9999\n"
        assert file.line(0) == (b"    1C", 7)


def test_a_full_temporary_folder_is_named_with_the_variable_of_another(
    temporary, tmp_path, refused, file_size_limit
):
    path = tmp_path / "job.frd.gz"
    path.write_bytes(gzip.compress(os.urandom(20_000)))
    file_size_limit(4096)
    refused("ingest", path, "-o", tmp_path / "traces.csv")
    assert not names_below(temporary)


def test_an_export_of_several_stimuli_on_a_full_disk_is_all_or_nothing(
    tmp_path, refused, file_size_limit
):
    folder = tmp_path / "waves"
    file_size_limit(8000)
    ids = "ramp_50_10_5_10,sine_20_250"  # the first has room
    refused("stimuli", "--export", "csv", ids, "-o", folder)
    assert not folder.exists()


def test_a_temporary_folder_that_a_kill_left_is_removed_by_the_next(temporary):
    abandoned = temporary / f"{DRAFT_PREFIX}killed"
    abandoned.mkdir()
    (abandoned / "job.frd").touch()
    with temporary_folder() as first, temporary_folder() as second:
        assert {path.name for path in temporary.iterdir()} == {first.name, second.name}
    assert not names_below(temporary)


def test_a_disk_without_room_for_the_solver_s_copy_keeps_no_half_of_it(
    fake_ccx, make_run, refused, file_size_limit
):
    folder = make_run(deck="** play normal\n" + "** a line\n" * 1000)
    file_size_limit(4096)
    refused("run", folder)
    assert {path.name for path in folder.iterdir()} == {"job.inp", "run.toml"}
