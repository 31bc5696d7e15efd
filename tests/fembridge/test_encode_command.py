"""``fembridge encode``: from a table of traces to tables of spikes and rates."""

import json

import numpy as np
import pytest

from fembridge.cli import main
from fembridge.tables import read_rates, read_spikes, write_traces
from fembridge.trace import StressTrace
from neural import PUBLISHED, encode

OURS = ["--parameters", "published"]
GAIN_PA = {"SA": 2e4, "RA": 4e4, "PC": 1e3}


def traces(afferents=("SA", "RA", "PC"), start_ms=0.0, dt_ms=0.5):
    times_ms = start_ms + dt_ms * np.arange(501)
    wave = np.maximum(np.sin(2e-3 * np.pi * 50 * times_ms), 0.0)
    return [
        StressTrace(GAIN_PA.get(name, 1e4) * wave, dt_ms, 100 + k, name, start_ms)
        for k, name in enumerate(afferents)
    ]


@pytest.fixture
def here(tmp_path, monkeypatch):
    """Work in a folder that holds the table ``sine_50_250.csv``."""
    monkeypatch.chdir(tmp_path)
    write_traces(tmp_path / "sine_50_250.csv", traces())
    return tmp_path


def test_the_tables_hold_the_spikes_and_rates_of_encode(here, capsys):
    assert main(["encode", "sine_50_250.csv", *OURS, "--window-ms", "100", "200"]) == 0

    told = capsys.readouterr()
    trains = {one.afferent: one for one in read_spikes(here / "encoded/spikes.csv")}
    rates = {one.afferent: one for one in read_rates(here / "encoded/rates.csv")}
    assert list(trains) == list(rates) == ["SA", "RA", "PC"]
    for trace in traces():
        [times_ms] = encode(trace.stress_pa, 0.5, PUBLISHED[trace.afferent])
        np.testing.assert_array_equal(trains[trace.afferent].times_ms, times_ms)
        inside = (times_ms > 100) & (times_ms <= 200)
        assert rates[trace.afferent].rate_ips == 10.0 * inside.sum() > 0
        assert rates[trace.afferent].stimulus == "sine_50_250"
        assert f"{10.0 * inside.sum():.2f}  100 to 200" in told.out
    assert (here / "encoded/raster.png").stat().st_size > 5000
    assert told.err == ""


def test_without_a_window_rates_are_of_the_whole_trace_and_it_says_so(here, capsys):
    assert main(["encode", "sine_50_250.csv", *OURS, "--json", "--no-raster"]) == 0

    told = capsys.readouterr()
    summary = json.loads(told.out)
    assert "rates over the whole trace; narrow it with --window-ms" in told.err
    assert summary["files"] == ["encoded/spikes.csv", "encoded/rates.csv"]
    assert sorted(path.name for path in (here / "encoded").iterdir()) == ["rates.csv", "spikes.csv"]
    assert summary["parameters"] == "published"
    assert summary["afferents"]["RA"]["node"] == 101
    for told_of in summary["afferents"].values():
        assert told_of["window_ms"] == [0.0, 250.0]
        assert told_of["spikes"] == told_of["spikes_in_window"]
        assert told_of["rate_ips"] == told_of["spikes"] / 0.25


def test_own_parameters_change_their_class_alone(here):
    (here / "own.toml").write_text(
        "base = 'published'\n[SA]\nalpha_mv_per_ms = 3.58\n", encoding="utf-8"
    )
    words = ["encode", "sine_50_250.csv", "--no-raster"]

    main([*words, "-o", "published", *OURS])
    main([*words, "-o", "own", "--parameters", "own.toml"])

    published, own = (
        {one.afferent: one.rate_ips for one in read_rates(here / name / "rates.csv")}
        for name in ("published", "own")
    )
    assert own["SA"] > published["SA"]
    assert (own["RA"], own["PC"]) == (published["RA"], published["PC"])


def test_the_derivative_is_passed_on(here):
    main(["encode", "sine_50_250.csv", *OURS, "--derivative", "forward", "--no-raster"])

    trains = {one.afferent: one for one in read_spikes(here / "encoded/spikes.csv")}
    [_, _, pc] = traces()
    [forward] = encode(pc.stress_pa, 0.5, PUBLISHED["PC"], derivative="forward")
    [backward] = encode(pc.stress_pa, 0.5, PUBLISHED["PC"])
    np.testing.assert_array_equal(trains["PC"].times_ms, forward)
    assert forward.tolist() != backward.tolist()


def test_a_silent_afferent_has_a_rate_of_zero_and_a_panel(here, capsys):
    still = [StressTrace(np.zeros(501), 0.5, 7, "RA")]
    write_traces(here / "still.csv", still)

    assert main(["encode", "still.csv", "--window-ms", "5", "250"]) == 0

    assert read_spikes(here / "encoded/spikes.csv") == []
    assert [one.rate_ips for one in read_rates(here / "encoded/rates.csv")] == [0.0]
    assert (here / "encoded/raster.png").exists()


def test_a_trace_without_a_class_is_taken_for_those_that_are_named(here):
    write_traces(here / "node.csv", traces([None]))

    assert main(["encode", "node.csv", "--no-raster", "--afferent", "PC", "SA"]) == 0

    rates = read_rates(here / "encoded/rates.csv")
    assert [one.afferent for one in rates] == ["PC", "SA"]


def test_a_trace_of_solver_increments_may_be_counted_from_time_zero(here):
    """Its first sample stands at dt, and its spikes keep the table's clock."""
    [trace] = traces(["SA"], start_ms=0.5)
    write_traces(here / "increments.csv", [trace])

    words = ["encode", "increments.csv", *OURS, "--no-raster", "--window-ms", "0"]
    assert main([*words, "250"]) == 0
    assert main([*words, "250.6"]) == 2
    [times_ms] = encode(trace.stress_pa, 0.5, PUBLISHED["SA"])
    [train] = read_spikes(here / "encoded/spikes.csv")
    np.testing.assert_array_equal(train.times_ms, 0.5 + times_ms)


def test_help_shows_an_example_that_runs(here, capsys):
    with_help = main(["encode", "--help"])

    assert with_help == 0
    told = capsys.readouterr().out
    assert "example: fembridge encode traces.csv -o encoded --window-ms 5 250" in told
    (here / "sine_50_250.csv").rename("traces.csv")
    example = told.split("example: fembridge ")[1].split()
    assert main(example) == 0


def test_a_population_is_written_cell_by_cell(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    times_ms = np.arange(501) * 0.5
    stress_pa = 40e3 + 40e3 * np.sin(2e-3 * np.pi * 50 * times_ms)
    write_traces(tmp_path / "traces.csv", [StressTrace(stress_pa, 0.5, 1, "RA")])

    words = ["traces.csv", "--parameters", "fitted", "--window-ms", "5", "250"]
    assert main(["encode", *words, "--json"]) == 0

    told = json.loads(capsys.readouterr().out)
    trains = read_spikes(tmp_path / "encoded/spikes.csv")
    assert [train.repeat for train in trains] == [1, 2, 3, 4, 5]
    inside = sum(((t.times_ms > 5.0) & (t.times_ms <= 250.0)).sum() for t in trains)
    assert told["afferents"]["RA"]["cells"] == 5
    assert told["afferents"]["RA"]["rate_ips"] == pytest.approx(inside / 5 / 0.245)
    assert inside > 50


def test_traces_that_start_unloaded_are_named_where_the_fit_had_a_pre_indentation(here, capsys):
    assert main(["encode", "sine_50_250.csv", "--no-raster"]) == 0
    [line] = [one for one in capsys.readouterr().err.splitlines() if "fitted" in one]
    assert "finger 'quick' (here: not known)" in line
    assert "75 um deep before time 0 (here: 0 um)" in line


def test_files_are_replaced_all_or_none(here, capsys):
    assert main(["encode", "sine_50_250.csv", "--afferent", "SA"]) == 0
    (here / "encoded" / "raster.png").unlink()
    (here / "encoded" / "raster.png").mkdir()
    before = [(here / "encoded" / name).read_bytes() for name in ("spikes.csv", "rates.csv")]

    assert main(["encode", "sine_50_250.csv", "--stimulus", "other"]) == 1

    assert "raster.png: a folder stands" in capsys.readouterr().err
    after = [(here / "encoded" / name).read_bytes() for name in ("spikes.csv", "rates.csv")]
    assert after == before


@pytest.mark.parametrize(
    ("table", "words", "code", "message"),
    [
        (traces(), ["--window-ms", "5", "300"], 2, "inside 0 to 250 ms, the SA trace"),
        (traces(), ["--window-ms", "200", "100"], 2, "window 200 to 100 ms"),
        (traces(), ["--window-ms", "nan", "100"], 2, "window nan to 100 ms"),
        (traces(), ["--parameters", "absent.toml"], 2, "absent.toml: "),
        (traces(), ["--parameters", "energy.toml"], 2, "'energy' of SA reads strain energy"),
        (traces(["SA", "SA"]), [], 1, "nodes 100 and 101 are both SA"),
        (traces(["RA"], dt_ms=1.0), [], 1, "a sample every 1 ms"),
        (traces([None]), [], 1, "node 100 has no afferent"),
    ],
)
def test_what_cannot_be_encoded_ends_in_one_line_and_no_files(
    here, capsys, table, words, code, message
):
    (here / "energy.toml").write_text(
        'base = "published"\n[SA]\ndrive = "energy"\n', encoding="utf-8"
    )
    write_traces(here / "table.csv", table)

    assert main(["encode", "table.csv", *words]) == code

    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not (here / "encoded").exists()
