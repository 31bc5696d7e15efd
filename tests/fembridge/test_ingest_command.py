"""``fembridge ingest``: from a result file to a table of traces."""

import csv
import json
import shutil
from pathlib import Path

import pytest

from fembridge.cli import main
from fembridge.run_folder import AfferentNode, RunFolder

SAMPLES = Path(__file__).parents[2] / "fixtures" / "frd_samples"


def rows_of(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture
def here(tmp_path, monkeypatch):
    """An empty current folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def run_folder(tmp_path):
    """A run folder with the results of the two-layer block, 4 x 0.5 ms."""
    folder = tmp_path / "sine_20_250"
    folder.mkdir()
    shutil.copy(SAMPLES / "cpe4_bin_f64.frd", folder / "job.frd")
    places = (
        AfferentNode("SA", 25, "epidermis", 1.5, 0.75, 0.25),
        AfferentNode("RA", 11, "dermis", 1.5, 0.25, 0.75),
    )
    RunFolder(folder, "calculix", 4, 0.5, 0.0, places, "0").write()
    return folder


def test_a_run_folder_gives_its_afferents_from_rest(here, run_folder, capsys):
    assert main(["ingest", str(run_folder / "job.frd")]) == 0
    rows = rows_of(here / "job_traces.csv")
    assert list(rows[0]) == ["time_ms", "afferent", "node", "von_mises_pa"]
    sa = [row for row in rows if row["afferent"] == "SA"]
    assert [float(row["time_ms"]) for row in sa] == [0, 0.5, 1, 1.5, 2]
    assert float(sa[0]["von_mises_pa"]) == 0.0
    assert float(sa[1]["von_mises_pa"]) == pytest.approx(9209.340, rel=1e-6)
    assert {row["node"] for row in sa} == {"25"}
    out = capsys.readouterr().out
    assert "2 traces, 0 to 2 ms every 0.5 ms; stress in the file taken as MPa" in out
    assert "SA node 25: peak 19600.4 Pa" in out


def test_the_folder_itself_and_the_word_afferents_do_the_same(here, run_folder):
    assert main(["ingest", str(run_folder), "-o", "a.csv"]) == 0
    assert main(["ingest", str(run_folder), "--afferents", "-o", "b.csv"]) == 0
    assert (here / "a.csv").read_bytes() == (here / "b.csv").read_bytes()


def test_nodes_of_a_foreign_file_have_no_afferent_and_say_their_unit(here, capsys):
    words = ["ingest", str(SAMPLES / "cpe4_ascii.frd"), "--node", "25", "11"]
    assert main([*words, "-o", "out/plain.csv"]) == 0
    rows = rows_of(here / "out" / "plain.csv")
    assert {(row["afferent"], row["node"]) for row in rows} == {("", "25"), ("", "11")}
    assert float(rows[0]["time_ms"]) == 0.5
    assert "taken as MPa (--stress-unit says otherwise)" in capsys.readouterr().out


def test_the_unit_of_the_file_can_be_told(here):
    words = ["ingest", str(SAMPLES / "cpe4_ascii.frd"), "--node", "11", "-o"]
    assert main([*words, "mpa.csv"]) == 0
    assert main([*words, "kpa.csv", "--stress-unit", "kPa"]) == 0
    mpa, kpa = (float(rows_of(here / f)[0]["von_mises_pa"]) for f in ("mpa.csv",) * 2)
    assert mpa == kpa
    kpa = float(rows_of(here / "kpa.csv")[0]["von_mises_pa"])
    assert kpa == pytest.approx(mpa / 1e3, rel=1e-9)


def test_without_nodes_the_file_is_listed_and_nothing_written(here, capsys):
    assert main(["ingest", str(SAMPLES / "cpe4_ascii.frd")]) == 2
    heard = capsys.readouterr()
    assert "STRESS: SXX, SYY, SZZ, SXY, SYZ, SZX; 4 increments" in heard.out
    assert "47 nodes, 1 to 47; ASCII" in heard.out
    assert "choose with --node N, --set NAME or --near X,Y" in heard.err
    assert list(here.iterdir()) == []


def test_afferents_of_a_foreign_file_are_misuse(here, capsys):
    assert main(["ingest", str(SAMPLES / "cpe4_ascii.frd"), "--afferents"]) == 2
    assert "no run.toml beside it; --afferents needs one" in capsys.readouterr().err


def test_a_listing_can_be_read_by_a_program(here, capsys):
    words = ["ingest", str(SAMPLES / "kill_bin_f32.frd"), "--list", "--json"]
    assert main(words) == 0
    held = json.loads(capsys.readouterr().out)
    assert held["mesh_nodes"] == 252
    assert "after 59 of 252 records" in held["problem"]


def test_a_listing_for_people_tells_what_is_wrong(here, capsys):
    assert main(["ingest", str(SAMPLES / "kill_bin_f32.frd"), "--list"]) == 0
    assert "problem: FORC of step 1, increment 2 is cut" in capsys.readouterr().out


def test_a_summary_is_all_that_json_prints(here, run_folder, capsys):
    assert main(["ingest", str(run_folder), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["output"] == "job_traces.csv"
    assert (summary["samples"], summary["dt_ms"]) == (5, 0.5)
    assert [trace["afferent"] for trace in summary["traces"]] == ["SA", "RA"]


def test_a_bad_file_leaves_an_earlier_table_alone(here, capsys):
    (here / "traces.csv").write_text("earlier\n")
    path = str(SAMPLES / "cpe4_diskfull.frd")
    assert main(["ingest", path, "--node", "11", "-o", "traces.csv"]) == 1
    assert (here / "traces.csv").read_text() == "earlier\n"
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "after 7 of 47 records" in error


def test_partial_takes_what_is_whole_and_says_on_stderr_what_is_not(here, capsys):
    words = ["ingest", str(SAMPLES / "cpe4_diskfull.frd"), "--node", "11"]
    assert main([*words, "--partial", "-o", "traces.csv"]) == 0
    assert len(rows_of(here / "traces.csv")) == 2
    heard = capsys.readouterr()
    assert "after 7 of 47 records" in heard.err
    assert "cut" not in heard.out


def test_a_node_on_a_boundary_needs_a_word_of_consent(here, capsys):
    words = ["ingest", str(SAMPLES / "cpe4_ascii.frd"), "--node", "18"]
    assert main(words) == 1
    assert "node 18 is between EPI and DER" in capsys.readouterr().err
    assert main([*words, "--across-materials"]) == 0


def test_help_ends_in_an_example(capsys):
    assert main(["ingest", "--help"]) == 0
    assert "example: fembridge ingest" in capsys.readouterr().out
