"""``fembridge simulate``: files, words and exit codes, with and without a solver."""

import json
import tomllib

import pytest

from fembridge.cli import main
from fembridge.errors import OutputError
from fembridge.host.machine import CCX_VARIABLE, SOLVER_INSTALL_LINE
from fembridge.io.spike_table import read_rates

FILES = ["finger.toml", "raster.png", "rates.csv", "simulation.toml", "spikes.csv", "traces.npz"]


@pytest.fixture
def here(tmp_path, monkeypatch):
    """Work in an empty folder of a machine that has no solver."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv(CCX_VARIABLE, raising=False)
    monkeypatch.setenv("PATH", "")
    return tmp_path


@pytest.fixture(scope="module")
def earlier(tmp_path_factory):
    """What a run left: names and bytes."""
    folder = tmp_path_factory.mktemp("earlier")
    assert main(["simulate", "--stimulus", "sine_50_250", "--stored", "-o", str(folder)]) == 0
    return contents(folder)


@pytest.fixture
def result(here, earlier):
    """The folder of an earlier run, as that left it."""
    folder = here / "out"
    folder.mkdir()
    for name, content in earlier.items():
        (folder / name).write_bytes(content)
    return folder


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_the_example_of_the_help_gives_six_files_a_table_and_one_note(here, capsys):
    assert main(["simulate", "--help"]) == 0
    example = capsys.readouterr().out.split("example: fembridge ")[1].split()
    assert main(example) == 0

    streams = capsys.readouterr()
    source, preindentation = streams.err.splitlines()
    assert "'quick'" in source
    assert source.endswith(SOLVER_INSTALL_LINE)
    assert "75 um" in preindentation
    assert "fitted" in preindentation
    first = contents(here / "out")
    assert sorted(first) == FILES
    rates = read_rates(here / "out/rates.csv")
    assert len(rates) == 15
    assert first["raster.png"][:4] == b"\x89PNG"
    *table, before_next, following = streams.out.splitlines()
    assert (before_next, following.strip()) == ("next:", "fembridge plot out")
    assert table[0].split() == ["stimulus", "SA", "RA", "PC", "impulses/s"]
    assert len(table) == 7
    for k, line in enumerate(table[1:6]):
        name, *cells = line.split()
        assert {rate.stimulus for rate in rates[3 * k : 3 * k + 3]} == {name}
        assert cells == [f"{rate.rate_ips:.1f}" for rate in rates[3 * k : 3 * k + 3]]
    listed, _, folder = table[-1].rpartition(": ")
    assert (sorted(listed.split(", ")), folder) == (FILES, "out")
    main(["simulate", "--stimulus", "noise_25_250", "--no-plot", "-o", "again"])
    first.pop("raster.png")
    assert contents(here / "again") == first


def test_json_is_all_that_stdout_holds_and_the_record_names_the_source(here, capsys):
    words = ["--stimulus", "noise_25_250_10", "--seed", "7", "--json", "--no-plot"]
    assert main(["simulate", *words]) == 0

    streams = capsys.readouterr()
    summary = json.loads(streams.out)
    assert summary["notes"] == streams.err.splitlines()
    assert (summary["output"], summary["method"], summary["parameters"]) == (
        *("out", "map", "fitted"),
    )
    assert summary["rates"] == [
        {"stimulus": r.stimulus, "afferent": r.afferent, "rate_ips": r.rate_ips}
        for r in read_rates(here / "out/rates.csv")
    ]
    record = tomllib.loads((here / "out/simulation.toml").read_text(encoding="utf-8"))
    assert record["source"] == "stored response"
    assert record["stimuli"]["noise_25_250_10"]["seed"] == 7


def test_without_a_plot_an_older_one_does_not_stay_beside_other_spikes(result, capsys):
    main(["simulate", "--stimulus", "sine_20_250", "-o", "out", "--no-plot"])
    assert sorted(contents(result)) == [name for name in FILES if name != "raster.png"]
    assert "raster" not in capsys.readouterr().out.splitlines()[-1]


def test_the_stored_response_of_the_paper_s_mesh_can_be_asked_for(here, capsys):
    words = ["--stimulus", "sine_20_250", "--finger", "paper", "--stored", "--no-plot"]
    assert main(["simulate", *words, "--preindent-um", "0"]) == 0
    first, second = capsys.readouterr().err.splitlines()
    assert "'paper'" in first
    assert second.startswith("warning: ")
    for value in ("'quick'", "paper", "75 um", "0 um"):
        assert value in second


@pytest.mark.parametrize(
    ("words", "found"),
    [
        (["--preindent-um", "900"], "1150 um"),
        (["--method", "transient"], "transient"),
        (["--probe-diameter-mm", "2"], "diameter_mm 1.0"),
    ],
)
def test_what_takes_a_solver_ends_in_the_line_that_installs_one(here, refused, words, found):
    line = refused(["simulate", "--stimulus", "sine_20_250", "-o", "out", *words], found, 1)
    assert line.endswith(f"{SOLVER_INSTALL_LINE}\n")


def test_an_earlier_result_survives_a_file_that_cannot_be_written(
    result, earlier, capsys, monkeypatch
):
    def disk_full(what, path, **options):
        raise OutputError("cannot write: No space left on device", path)

    monkeypatch.setattr("fembridge.io.recording.Recording.write", disk_full)
    words = ["--stimulus", "sine_20_250", "--export", "npz", "--no-plot", "-o", "out"]
    assert main(["simulate", *words]) == 1
    last = capsys.readouterr().err.splitlines()[-1]
    assert last == "fembridge: out/spikes.npz: cannot write: No space left on device"
    assert contents(result) == earlier


def test_a_finger_that_was_edited_since_the_run_is_not_written_over(result, capsys):
    mine = result / "finger.toml"
    mine.write_text(mine.read_text().replace("epidermis_mm", "# mine\nepidermis_mm"))
    edited = contents(result)
    assert main(["simulate", "--stimulus", "sine_20_250", "--stored", "-o", "out"]) == 1
    assert "edited since" in capsys.readouterr().err
    assert contents(result) == edited


@pytest.mark.parametrize("named", [True, False])
def test_a_finger_is_not_written_over_by_what_is_solved(tmp_path, capsys, named):
    mine = tmp_path / "finger.toml"
    mine.write_text('base = "quick"\n[skin]\nepidermis_mm = 0.5\n')
    words = ["simulate", "--stimulus", "sine_20_250", "--stored", "-o", str(tmp_path)]
    assert main([*words, *(["--finger", str(mine)] if named else [])]) == 1
    assert "another -o" in capsys.readouterr().err
    assert "epidermis_mm = 0.5" in mine.read_text()
    assert [path.name for path in tmp_path.iterdir()] == ["finger.toml"]
