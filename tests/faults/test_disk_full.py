"""No room: a limit of file size for us, and a file system that is really full."""

import gc
import json

import numpy as np
import pytest

from fembridge.cli import main
from fembridge.errors import OutputError
from fembridge.io.recording import FORMATS, Recording
from fembridge.io.spike_table import SpikeTrain

WORDS = ["simulate", "--stored", "--no-plot", "-o"]

FILL = """
import contextlib, io, json, pathlib, sys
from fembridge.cli import main
from fembridge.errors import OutputError
from fembridge.host.store import folder_lock
place, *words = sys.argv[1:]
folder = pathlib.Path(place) / "out"
def contents():
    return {p.name: p.read_bytes().hex() for p in folder.iterdir()}
def attempt(stimulus):
    said = io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
        code = main([*words, str(folder), "--stimulus", stimulus])
    return code, said.getvalue().splitlines()[-1]
codes = [attempt("sine_20_250")[0]]
before = contents()
filler = pathlib.Path(place) / "filler"
with contextlib.suppress(OSError), filler.open("wb", 0) as file:
    while True:
        file.write(bytes(4096))
code, line = attempt("sine_50_250")
same = contents() == before
try:
    with folder_lock(pathlib.Path(place), ".lock"):
        locked = "locked"
except OutputError as error:
    locked = str(error)
filler.unlink()
codes += [code, attempt("sine_50_250")[0]]
print(json.dumps({"codes": codes, "line": line, "same": same, "locked": locked}))
"""

RUN = """
import contextlib, io, json, pathlib, shutil, sys
from fembridge.cli import main
source, place = map(pathlib.Path, sys.argv[1:])
folder = place / "run"
shutil.copytree(source, folder)
said = io.StringIO()
with contextlib.redirect_stderr(said):
    code = main(["run", str(folder)])
names = sorted(path.name for path in folder.iterdir())
print(json.dumps({"code": code, "said": said.getvalue(), "names": names}))
"""


@pytest.fixture
def little_room(tmp_path):
    place = tmp_path / "little room"
    place.mkdir()

    def mount(kib):
        return place, f'mount -t tmpfs -o size={kib}k none "{place}"'

    return mount


def test_a_limit_of_file_size_leaves_the_earlier_results(
    tmp_path, files_below, capsys, refused, file_size_limit
):
    out = tmp_path / "out"
    assert main([*WORDS, str(out), "--stimulus", "sine_20_250"]) == 0
    before = files_below(out)
    capsys.readouterr()
    file_size_limit(4096)
    refused(*WORDS, out, "--stimulus", "sine_50_250", notes=2)
    assert files_below(out) == before


LIBRARIES = {"npz": "numpy", "mat": "scipy", "nwb": "pynwb", "neo": "neo", "sonata": "h5py"}


@pytest.mark.parametrize(
    "kind",
    [
        pytest.param(kind, marks=[pytest.mark.slow] * (kind not in ("npz", "nwb")))
        for kind in LIBRARIES
    ],
)
@pytest.mark.parametrize("most_bytes", [pytest.param(0, marks=pytest.mark.slow), 2000])
def test_a_recording_on_a_full_disk_is_one_line_whatever_its_library_prints(
    tmp_path, file_size_limit, capfd, as_in_table, kind, most_bytes
):
    pytest.importorskip(LIBRARIES[kind])
    path = tmp_path / f"spikes{FORMATS[kind].suffix}"
    times_ms = np.linspace(1.0, 400.0, 500)
    trains = [SpikeTrain("sine", name, times_ms) for name in ("SA", "RA", "PC")]
    recording = Recording.from_trains(trains, 0.5, 500.0)
    recording.write(path)
    before = path.read_bytes()
    capfd.readouterr()
    file_size_limit(most_bytes)
    with pytest.raises(OutputError) as problem:
        recording.write(path)
    gc.collect()
    assert capfd.readouterr() == ("", "")
    as_in_table(str(problem.value))
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.slow
def test_a_full_disk_leaves_the_earlier_results_and_room_is_all_it_takes(
    apart, little_room, as_in_table
):
    """A lock on it names its folder."""
    place, mount = little_room(800)
    shown = json.loads(apart(mount, FILL, place, *WORDS))
    assert shown["codes"] == [0, 1, 0]
    assert shown["same"]
    as_in_table(shown["line"].removeprefix("fembridge: "))
    as_in_table(shown["locked"])


@pytest.fixture
def left_on_a_full_disk(apart, little_room, as_in_table):
    """Names of what a refused run leaves where there is so much room."""

    def run(source, kib):
        place, mount = little_room(kib)
        shown = json.loads(apart(mount, RUN, source, place))
        assert shown["code"] == 1
        (line,) = shown["said"].splitlines()
        as_in_table(line.removeprefix("fembridge: "))
        return shown["names"]

    return run


@pytest.mark.solver
def test_calculix_on_a_disk_that_fills_is_not_believed(left_on_a_full_disk, make_run, patch):
    """It says `Job finished` and exits with 0."""
    source = make_run(deck=patch(end_s=0.05), increments=100)
    assert left_on_a_full_disk(source, 64) == ["failed", "job.inp", "run.toml"]


def test_a_disk_that_fills_when_the_log_grows_is_said(left_on_a_full_disk, fake_ccx, make_run):
    assert "job.frd" not in left_on_a_full_disk(make_run("loud"), 400)
