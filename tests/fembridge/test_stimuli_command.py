"""``fembridge stimuli``: the list, and the files it writes."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from decks.stimuli import resolve
from decks.synthesis import make_stimulus
from fembridge.cli import main
from fembridge.io.waveform_file import FORMATS, write_marc_table, write_wav
from fembridge.stimulus import Stimulus


def summary(capsys, *words):
    assert main(["stimuli", *words, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_the_list_has_a_line_for_each_set_with_count_window_and_levels(capsys):
    assert main(["stimuli"]) == 0
    lines = capsys.readouterr().out.partition("next:")[0].splitlines()
    rows = [" ".join(line.split()) for line in lines if line.startswith("  ")]
    assert len(rows) == 13
    assert "sine_300 6 100-200 ms 4.59 7.41 11.94 19.24 31.02 50" in rows
    assert ("diharm_50_500 5 5-250 ms 2+0.25 5.62+0.74 15.81+2.17 44.46+6.37 125+18.75") in rows
    assert "noise_50_500 5 5-250 ms 0.13 0.5 1 5 10" in rows


def test_an_id_is_listed_with_its_numbers_and_its_window(capsys):
    assert main(["stimuli", "noise_25_250_10", "diharm_10_100_125", "sine_40_100"]) == 0
    noise, diharmonic, own, _, *following = capsys.readouterr().out.splitlines()
    assert "25 to 250 Hz, 10 um RMS, seed 1588730578, counted in 5-250 ms" in noise
    assert "10 Hz + 100 Hz, 125 um + 100 um" in diharmonic
    assert own.endswith("(not in the appendix)")
    assert following == ["next:", "  fembridge simulate --stimulus noise_25_250_10 -o out"]


def test_json_lists_all_82_with_numbers_and_the_note(capsys):
    listed = summary(capsys)
    assert listed["count"] == len(listed["stimuli"]) == 82
    numbers = {"frequency_hz": 20.0, "amplitude_um": 250.0, "window_ms": [5.0, 250.0]}
    sine = {"id": "sine_20_250", "family": "sine", "in_appendix": True}
    assert sine | numbers in listed["stimuli"]
    assert "sine_20_12.5" in listed["notes"][0]


def test_a_flat_waveform_is_a_silent_wav(tmp_path):
    flat = Stimulus("flat", np.zeros(3), 0.5, (0.5, 1.0))
    assert write_wav(flat, tmp_path / "flat.wav") == 1.0
    assert (tmp_path / "flat.wav").read_bytes().endswith(b"\0" * 6)


def test_a_marc_table_is_in_seconds_and_millimetres_in_columns_of_twenty(tmp_path):
    (entry,) = resolve("sine_50_250")
    stimulus = make_stimulus(entry)
    path = tmp_path / "table.dat"
    write_marc_table(stimulus, path)
    lines = path.read_text(encoding="ascii").splitlines()
    comment = [line for line in lines if line.startswith("$")]
    assert "positive into" in comment[0]
    keyword, header, variable, *rows = [line for line in lines if line not in comment]
    assert keyword == "table               sine_50_250"
    assert [int(header[k : k + 10]) for k in range(0, 50, 10)] == [1, 1, 0, 0, 2]
    assert [int(variable[k : k + 10]) for k in range(0, 160, 10)] == [
        *(1, 501, 2),
        *(0, 0, 2) * 3,
        *(0, 0, 0, 0),
    ]
    assert {len(row) for row in rows} == {40}
    values = np.array([[_real(row[:20]), _real(row[20:])] for row in rows])
    assert_allclose(values[:, 0], stimulus.times_ms / 1e3, rtol=1e-15, atol=0)
    assert_allclose(values[:, 1], stimulus.displacement_um / 1e3, rtol=1e-15, atol=0)
    # the line that Mentat 2020 wrote for a first point, and one with a sign
    assert rows[0] == " 0.000000000000000+0 0.000000000000000+0"
    assert rows[30] == " 1.500000000000000-2-2.500000000000000-1"


def _real(field):
    mantissa, exponent = field[:-2], field[-2:]
    return float(f"{mantissa}e{exponent}")


def test_a_set_goes_into_a_folder_one_file_a_stimulus(tmp_path, capsys):
    folder = tmp_path / "waves"
    files = summary(capsys, "--export", "npy", "noise_25_250,sine_20_250", "-o", str(folder))
    names = [f"{entry.id}.npy" for entry in resolve("noise_25_250,sine_20_250")]
    assert sorted(path.name for path in folder.iterdir()) == sorted(names)
    assert [file["file"] for file in files["files"]] == [str(folder / n) for n in names]
    assert main(["stimuli", "--export", "csv", "sine_20_250", "-o", f"{tmp_path}/new/"]) == 0
    assert (tmp_path / "new" / "sine_20_250.csv").is_file()  # the slash made it a folder


@pytest.mark.parametrize("format_name", list(FORMATS))
def test_without_o_a_file_named_after_the_id_is_written_here(
    tmp_path, monkeypatch, capsys, format_name
):
    monkeypatch.chdir(tmp_path)
    assert main(["stimuli", "--export", format_name, "sine_20_6.71"]) == 0
    suffix, _ = FORMATS[format_name]
    assert [path.name for path in tmp_path.iterdir()] == [f"sine_20_6.71{suffix}"]


def test_several_stimuli_do_not_go_into_one_file(refused, file):
    path = file("one.csv", "mine")
    words = ["stimuli", "--export", "csv", "sine_20", "-o", path]
    refused(words, "expected a folder for 12 stimuli", 1)
    assert path.read_text() == "mine"


def test_preindentation_and_seed_reach_the_file_and_the_summary(tmp_path, capsys):
    words = ["--export", "npy", "noise_5_25_1", "--preindent-um", "500", "--seed", "3"]
    shown = summary(capsys, *words, "-o", str(tmp_path))["files"][0]
    assert (shown["seed"], shown["preindent_um"]) == (3, 500.0)
    made = make_stimulus(*resolve("noise_5_25_1"), preindent_um=500.0, seed=3)
    assert_array_equal(np.load(shown["file"]), made.displacement_um)


@pytest.mark.parametrize(
    ("words", "shown"),
    [
        (["--export", "csv"], "no stimulus named"),
        (["--export", "csv", "sine_20_25o"], "did you mean"),
        (["sine_20", "-o", "x"], "--output is for --export"),
        (["--seed", "1"], "--seed is for --export"),
        (["--export", "csv", "sine_20_250", "--seed", "1"], "--seed is for noise"),
        (["--export", "csv", "sine_20_250", "--dt-ms", "3"], "--dt-ms is for a waveform in .npy"),
        (["--export", "wav", "sine_20_250", "--full-scale-um", "3"], "a waveform in .wav"),
        (
            ["--export", "csv", "sine_20_250", "--preindent-um", "nan"],
            "'nan', expected a number from 0",
        ),
    ],
)
def test_misuse_is_2_and_writes_nothing(refused, words, shown):
    refused(["stimuli", *words], shown)
