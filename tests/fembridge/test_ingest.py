"""``fembridge ingest``: traces, nodes by set and place, fields, VTU, prints as tables."""

import csv
import json
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import fembridge as fb
from fembridge.cli import main
from fembridge.errors import ResultError
from fembridge.io.run_folder import read_run_folder
from fembridge.io.trace_table import read_traces

pytestmark = pytest.mark.usefixtures("here")
SAMPLES = Path(__file__).parents[2] / "fixtures" / "frd_samples"
ASCII = str(SAMPLES / "cpe4_ascii.frd")
DAT = str(SAMPLES / "cpe4_ascii.dat")
# On the boundary between the two layers of `interface_cpe8r`.
NODES = ("29", "33", "37")
FOREIGN_UNIT = "stress in the file taken as MPa (--stress-unit says otherwise)"


def rows_of(path):
    with Path(path).open(newline="") as file:
        return list(csv.DictReader(file))


def nodes_of(path):
    return list(dict.fromkeys(row["node"] for row in rows_of(path)))


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
    assert main(["ingest", str(run_folder), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["output"], summary["samples"]) == ("job_traces.csv", 5)
    assert [trace["afferent"] for trace in summary["traces"]] == ["SA", "RA"]


def test_without_nodes_the_file_is_listed_with_a_command_that_works(here, capsys):
    assert main(["ingest", ASCII]) == 0
    logged = capsys.readouterr()
    assert "STRESS: SXX, SYY, SZZ, SXY, SYZ, SZX; 4 increments" in logged.out
    assert "47 nodes, 1 to 47; ASCII" in logged.out
    assert "sets: NALL 47, NBOT 7, NTOP 4, PROBES 3" in logged.out
    assert list(here.iterdir()) == []
    command = logged.out.splitlines()[-1].split()
    assert command[0] == "fembridge"
    assert main(command[1:]) == 0
    assert len(rows_of(here / "cpe4_ascii_traces.csv")) == 4
    assert main(["ingest", ASCII, "-o", "traces.csv"]) == 2  # asked for, and nothing chosen
    assert (
        "choose with --node N or all, --node-set NAME or --near-mm X,Y" in capsys.readouterr().err
    )


def test_a_run_without_afferents_is_listed_and_asks_for_nodes(here, run_folder, capsys):
    """As build-deck leaves it of a model of one's own without --afferent."""
    replace(read_run_folder(run_folder), afferents=()).write()
    assert main(["ingest", str(run_folder)]) == 0
    assert "--node 39" in capsys.readouterr().out
    for option in (["--afferents"], ["-o", "a.csv"], ["--quantity", "stress"]):
        assert main(["ingest", str(run_folder), *option]) == 2
        assert "its run.toml has no afferents" in capsys.readouterr().err
    assert main(["ingest", str(run_folder), "--node", "25", "-o", "a.csv"]) == 0
    assert main(["encode", str(run_folder), "-o", "out"]) == 1
    assert "run.toml names no afferent: choose nodes, fembridge" in capsys.readouterr().err
    with pytest.raises(ResultError, match="names no afferent"):
        fb.read(run_folder)


def test_nodes_of_a_set_and_near_a_place_are_named_on_stderr(capsys):
    words = ["--node-set", "probes", "--across-materials", "--near-mm", "1.5,0.3", "-o", "t.csv"]
    assert main(["ingest", ASCII, *words]) == 0
    assert nodes_of("t.csv") == ["11", "18", "25"]
    logged = capsys.readouterr()
    assert "set probes of cpe4_ascii.inp: 3 nodes, 11, 18, 25" in logged.err
    assert "near 1.5, 0.3: node 11 at 1.5, 0.25, 0.05 mm away" in logged.err
    assert FOREIGN_UNIT in logged.out


def test_a_set_needs_a_deck_and_can_name_one(here, capsys):
    shutil.copy(ASCII, here / "mine.frd")
    assert main(["ingest", "mine.frd", "--node-set", "PROBES"]) == 2
    assert "no deck mine.inp" in capsys.readouterr().err
    (here / "other.inp").write_text("*NSET, NSET=ONE\n25\n")
    words = ["--node-set", "one", "--deck", "other.inp", "-o", "t.csv"]
    assert main(["ingest", "mine.frd", *words]) == 0
    assert nodes_of("t.csv") == ["25"]


@pytest.mark.parametrize(
    ("words", "shown"),
    [
        ([ASCII, "--list", "--node", "1"], {"argument": "--list", "path": ASCII}),
        ([ASCII, "--node", "11", "--increment", "2"], {"argument": "--increment"}),
        ([ASCII, "--point", "1:1"], {"argument": "--point", "path": ASCII}),
        ([DAT, "--vtu", "v"], {"argument": "--vtu", "path": DAT}),
        ([DAT, "--extrapolate", "linear"], {"argument": "--extrapolate"}),
        (
            [DAT, "--quantity", "forces", "stresses"],
            {"argument": "--quantity", "expected": "one name"},
        ),
        ([ASCII, "--field", "DISP", "-o", "f.txt"], "expected a name in .npz or .csv"),
        ([ASCII, "--node-set", "PROBES", "--one-sided", "EALL"], {"argument": "--one-sided"}),
        ([ASCII, "--node", "11", "--derived", "principal"], {"argument": "--derived"}),
        ([DAT, "--resample-ms", "1"], {"argument": "--resample-ms"}),
        ([ASCII, "--node", "all", "--one-sided", "EALL"], {"argument": "--one-sided"}),
        (["--node", "1", "2", "3x", ASCII], {"argument": "--node", "found": "3x"}),
        (
            [ASCII, "--node", "25", "-o", "t.parquet"],
            {"argument": "--output", "found": "t.parquet"},
        ),
    ],
)
def test_words_that_mean_nothing_together_are_misuse(refused, words, shown):
    refused(["ingest", *words], shown)


def test_a_field_of_one_increment_says_its_time_and_unit(capsys):
    assert main(["ingest", ASCII, "--field", "STRESS", "--increment", "2"]) == 0
    with np.load("cpe4_ascii_stress_1_2.npz") as held:
        assert held["values"].shape == (47, 6)
        assert held["units"].tolist() == ["Pa"] * 6
    out = capsys.readouterr().out
    assert "STRESS of 47 nodes, step 1, increment 2, 1 ms; " + FOREIGN_UNIT in out


def test_traces_at_integration_points_can_be_encoded():
    assert main(["ingest", DAT, "--point", "1:1", "13:4", "-o", "t.csv"]) == 0
    assert nodes_of("t.csv") == ["101", "1304"]
    assert [trace.node for trace in read_traces(Path("t.csv"))] == [101, 1304]
    assert main(["ingest", DAT, "--point", "13:4", "--resample-ms", "0.25", "-o", "t.csv"]) == 0
    assert [float(row["time_ms"]) for row in rows_of("t.csv")] == [0.25 * k for k in range(2, 9)]


def test_a_run_folder_is_in_mpa_always(run_folder, capsys):
    assert main(["ingest", str(run_folder), "--stress-unit", "kPa"]) == 2
    assert "--stress-unit is kPa, expected MPa" in capsys.readouterr().err
    assert main(["ingest", str(run_folder), "--afferents"]) == 0
    assert "stress in the file taken as MPa\n" in capsys.readouterr().out


def test_one_sided_stress_has_a_row_a_material_and_none_of_the_mean(capsys):
    """Two layers stretched by 1 %, free above: E/(1 - nu^2) of each, nu 0.3."""
    interface = str(SAMPLES / "interface_cpe8r.frd")
    assert main(["ingest", interface, "--node", *NODES, "--one-sided", "EALL"]) == 0
    rows = rows_of("interface_cpe8r_sides.csv")
    for side, young_mpa in zip(rows, 3 * (0.05, 2.0), strict=True):
        pull_pa = 1e6 * young_mpa / (1 - 0.3**2) * 0.01
        assert float(side["xx_pa"]) == pytest.approx(pull_pa, rel=1e-5)
        assert float(side["von_mises_pa"]) == pytest.approx(pull_pa * 0.79**0.5, rel=1e-5)
    assert [row["node"] for row in rows] == [node for node in NODES for _ in "ab"]
    assert "sides" in capsys.readouterr().out


@pytest.mark.solver
def test_default_increments_of_calculix_go_to_spikes_by_the_commands_that_are_shown(
    here, capsys, patch
):
    deck = patch(end_s=1.0).replace("*HEADING\n", "*HEADING\nUnit system: MM_TON_S_C\n")
    uneven = deck.replace(", DIRECT\n0.0005, 1.0", "\n0.1, 1.0, 1e-5, 0.17")
    (here / "job.inp").write_text(uneven)
    subprocess.run(["ccx", "-i", "job"], check=True, capture_output=True, cwd=here)
    assert main(["ingest", "job.frd"]) == 0
    logged = capsys.readouterr()
    assert "MM_TON_S_C: length in mm, stress in MPa" in logged.err
    plain, resampled = (line.split() for line in logged.out.splitlines()[-2:])
    assert main(plain[1:]) == 0
    rows = rows_of(here / "job_traces.csv")
    assert len({row["time_ms"] for row in rows}) == len(rows) == 7
    said = capsys.readouterr().out
    assert "7 increments, 100 to 1000 ms, uneven" in said
    assert "--resample-ms 0.5 makes the even step that encode needs" in said
    assert main(["encode", "job_traces.csv", "--afferent", "SA", "--no-raster"]) == 1
    assert "--resample-ms" in capsys.readouterr().err
    assert main(resampled[1:]) == 0
    assert main(["encode", "job_traces.csv", "--afferent", "SA", "--no-raster"]) == 0


def test_another_quantity_has_its_units_in_the_names_of_its_columns(here, capsys):
    words = ["ingest", ASCII, "--node", "25", "--quantity"]
    for quantity, last, unit in (
        ("stress", "szx_pa", "stress in the file taken as MPa"),
        ("principal", "principal_3_pa", "stress in the file taken as MPa"),
        ("displacement", "d3_mm", "lengths in the file taken as mm"),
        ("reaction-force", "f3_n", "reaction-force of 1 node"),
        ("strain", "ezx", "strain of 1 node"),
        ("contact", "cshear2_pa", "lengths in the file taken as mm"),
    ):
        assert main([*words, quantity]) == 0
        table = here / f"cpe4_ascii_{quantity}.csv"
        assert list(rows_of(table)[0])[-1] == last
        assert unit in capsys.readouterr().out
    assert main([*words, "nonsense"]) == 1
    assert "DISP, STRESS" in capsys.readouterr().err
    assert main([*words, "stress", "strain"]) == 2


def test_curves_without_nodes_ask_for_a_number(here, capsys):
    (here / "plot.txt").write_text(
        "Time\tEquivalent Von Mises Stress\n0\t0\n0.0005\t0.0125\n0.0015\t0.5\n"
    )
    assert main(["ingest", "plot.txt"]) == 0
    assert "--node N" in capsys.readouterr().out
    assert main(["ingest", "plot.txt", "--node", "7"]) == 0
    assert [row["time_ms"] for row in rows_of(here / "plot_traces.csv")] == ["0.0", "0.5", "1.5"]


def test_all_nodes_are_a_table_and_a_dozen_lines(here, capsys):
    assert main(["ingest", ASCII, "--node", "all", "--across-materials"]) == 0
    assert len(nodes_of("cpe4_ascii_traces.csv")) == 47
    assert "47 traces, 0.5 to 2 ms every 0.5 ms" in (out := capsys.readouterr().out)
    assert "and 35 more" in out
    assert main(["ingest", ASCII, "--node", "all", "3"]) == 2


def test_a_damaged_file_shows_the_command_that_takes_what_is_whole(here, capsys):
    assert main(["ingest", str(SAMPLES / "cpe4_diskfull.frd")]) == 0
    logged = capsys.readouterr().out
    assert "after 7 of 47 records" in logged
    command = logged.splitlines()[-1].split()
    assert "--partial" in command
    assert main([*command[1:], "-o", "traces.csv"]) == 0
    assert len(nodes_of("traces.csv")) == 1 and len(rows_of("traces.csv")) == 2
    logged = capsys.readouterr()
    assert "after 7 of 47 records" in logged.err
    assert "cut" not in logged.out


def test_a_run_folder_is_resampled_from_its_rest_and_moves_in_its_own_time(here, run_folder):
    assert main(["ingest", str(run_folder), "--resample-ms", "0.25"]) == 0
    rows = [row for row in rows_of(here / "job_traces.csv") if row["afferent"] == "SA"]
    assert [float(row["time_ms"]) for row in rows] == [0.25 * k for k in range(9)]
    assert float(rows[0]["von_mises_pa"]) == 0.0
    assert float(rows[2]["von_mises_pa"]) == pytest.approx(9209.340, rel=1e-6)
    assert main(["ingest", str(run_folder), "--quantity", "displacement"]) == 0
    moved = rows_of(here / "job_displacement.csv")
    assert [row["afferent"] for row in moved] == ["SA"] * 4 + ["RA"] * 4
    assert float(moved[0]["time_ms"]) == 0.5
