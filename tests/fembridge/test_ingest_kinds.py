"""``fembridge ingest``: nodes by set and place, fields, VTU, prints as tables."""

import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from fembridge.cli import main
from fembridge.run_folder import AfferentNode, RunFolder

SAMPLES = Path(__file__).parents[2] / "fixtures" / "frd_samples"
ASCII = str(SAMPLES / "cpe4_ascii.frd")
DAT = str(SAMPLES / "cpe4_ascii.dat")
FOREIGN_UNIT = "stress in the file taken as MPa (--stress-unit says otherwise)"


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    """An empty current folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def rows_of(path):
    with Path(path).open(newline="") as file:
        return list(csv.DictReader(file))


def nodes_of(path):
    return list(dict.fromkeys(row["node"] for row in rows_of(path)))


def test_nodes_of_a_set_and_near_a_place_are_named_on_stderr(capsys):
    words = [
        "--set",
        "probes",
        "--across-materials",
        "--near",
        "1.5,0.3",
        "-o",
        "t.csv",
    ]
    assert main(["ingest", ASCII, *words]) == 0
    assert nodes_of("t.csv") == ["11", "18", "25"]
    heard = capsys.readouterr()
    assert "set probes of cpe4_ascii.inp: 3 nodes, 11, 18, 25" in heard.err
    assert "near 1.5, 0.3: node 11 at 1.5, 0.25, 0.05 mm away" in heard.err
    assert FOREIGN_UNIT in heard.out


def test_a_negative_place_is_written_behind_an_equals_sign():
    assert main(["ingest", ASCII, "--near=-9,-0.5", "-o", "t.csv"]) == 0
    assert nodes_of("t.csv") == ["1"]


def test_a_set_needs_a_deck_and_can_name_one(here, capsys):
    shutil.copy(ASCII, here / "mine.frd")
    assert main(["ingest", "mine.frd", "--set", "PROBES"]) == 2
    assert "no deck mine.inp beside it; name one: --deck" in capsys.readouterr().err
    (here / "other.inp").write_text("*NSET, NSET=ONE\n25\n")
    words = ["--set", "one", "--deck", "other.inp", "-o", "t.csv"]
    assert main(["ingest", "mine.frd", *words]) == 0
    assert nodes_of("t.csv") == ["25"]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ([ASCII, "--list", "--node", "1"], "--list and --node do not go together"),
        ([ASCII, "--afferents", "--set", "A"], "--set and --afferents do not go tog"),
        ([ASCII, "--field", "DISP", "--vtu", "v"], "--vtu and --field do not go toge"),
        ([ASCII, "--point", "1:1"], "--point is for a .dat"),
        ([DAT, "--node", "1"], "--node is for a .frd"),
        ([DAT, "--quantity", "forces", "stresses"], "--quantity takes one name"),
        ([ASCII, "--field", "DISP", "-o", "f.txt"], "expected a name in .npz or .csv"),
        ([ASCII, "--near", "1"], "argument --near: invalid place value: '1'"),
        ([DAT, "--point", "7"], "argument --point: invalid point value: '7'"),
    ],
)
def test_words_that_mean_nothing_together_are_misuse(words, told, here, capsys):
    assert main(["ingest", *words]) == 2
    assert told in capsys.readouterr().err
    assert list(here.iterdir()) == []


def test_a_field_of_one_increment_says_its_time_and_unit(capsys):
    assert main(["ingest", ASCII, "--field", "STRESS", "--increment", "2"]) == 0
    with np.load("cpe4_ascii_stress_1_2.npz") as held:
        assert held["values"].shape == (47, 6)
        assert held["units"].tolist() == ["Pa"] * 6
    out = capsys.readouterr().out
    assert "STRESS of 47 nodes, step 1, increment 2, 1 ms; " + FOREIGN_UNIT in out


def test_the_unit_of_the_file_scales_a_field():
    field = ["ingest", ASCII, "--field", "STRESS", "-o"]
    assert main([*field, "mpa.csv"]) == 0
    assert main([*field, "kpa.csv", "--stress-unit", "kPa"]) == 0
    mpa, kpa = (float(rows_of(f)[0]["sxx_pa"]) for f in ("mpa.csv", "kpa.csv"))
    assert kpa == pytest.approx(mpa / 1e3, rel=1e-12)


def test_all_increments_go_to_paraview(here, capsys):
    assert main(["ingest", ASCII, "--vtu", "v", "--quantity", "STRESS"]) == 0
    assert len(list((here / "v").glob("*.vtu"))) == 4
    assert len(list((here / "v").glob("*.pvd"))) == 1
    out = capsys.readouterr().out
    assert "4 increments" in out
    assert FOREIGN_UNIT in out


def test_prints_become_a_table_and_say_their_unit(capsys):
    assert main(["ingest", DAT, "--quantity", "stresses"]) == 0
    rows = rows_of("cpe4_ascii_dat.csv")
    assert {row["unit"] for row in rows} == {"Pa"}
    assert FOREIGN_UNIT in capsys.readouterr().out


def test_traces_at_integration_points_can_be_encoded():
    assert main(["ingest", DAT, "--point", "1:1", "13:4", "-o", "t.csv"]) == 0
    assert nodes_of("t.csv") == ["101", "1304"]
    from fembridge.tables import read_traces

    assert [trace.node for trace in read_traces(Path("t.csv"))] == [101, 1304]


@pytest.mark.parametrize(("suffix", "rows"), [("sta", 4), ("cvg", 20)])
def test_progress_becomes_a_table(suffix, rows, capsys):
    path = SAMPLES / f"cpe4_ascii.{suffix}"
    assert main(["ingest", str(path), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["rows"] == rows == len(rows_of(summary["output"]))


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("cpe4_ascii.dat", "  stresses for set EPROBE: 4 times"),
        ("cpe4_ascii.sta", "  last: step 1, increment 4, attempt 1, failed 0"),
        ("cpe4_ascii.cvg", "  20 rows"),
        ("cpe4_lastiter_ResultsForLastIterations.frd", "  remark: iterations of incre"),
        ("cpe4_diverged.frd", "increment 2 of step 1 did not converge"),
    ],
)
def test_any_file_is_listed(name, words, here, capsys):
    assert main(["ingest", str(SAMPLES / name), "--list"]) == 0
    assert words in capsys.readouterr().out
    assert list(here.iterdir()) == []


def test_a_run_folder_is_in_mpa_always(here, capsys):
    folder = here / "run"
    folder.mkdir()
    shutil.copy(SAMPLES / "cpe4_bin_f64.frd", folder / "job.frd")
    places = (AfferentNode("SA", 25, "epidermis", 1.5, 0.75, 0.25),)
    RunFolder(folder, "calculix", 4, 0.5, 0.0, places, "0").write()
    assert main(["ingest", "run", "--stress-unit", "kPa"]) == 2
    assert "a run folder of fembridge is in MPa, always" in capsys.readouterr().err
    assert main(["ingest", "run"]) == 0
    assert "stress in the file taken as MPa\n" in capsys.readouterr().out
