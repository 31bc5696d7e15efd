"""``fembridge simulate``: files, words and exit codes, with and without a solver."""

import json
import tomllib
from dataclasses import replace

import numpy as np
import pytest

from decks.stimuli import resolve
from decks.waveform import make_stimulus
from fembridge.cli import main
from fembridge.machine import CCX_VARIABLE, SOLVER_INSTALL_LINE
from fembridge.response.response_map import FOLDER, read_map
from fembridge.tables import read_rates, read_spikes
from neural import PUBLISHED, encode, parameter_set
from neural.parameters import quantiles

FILES = ["raster.png", "rates.csv", "simulation.toml", "spikes.csv", "traces.npz"]
NOTE = (
    "no ccx on the PATH: stored response of finger 'quick'; "
    f"to solve it here: {SOLVER_INSTALL_LINE}\n"
)

HELD = "parameters fitted: the probe is 75 um deep before time 0, as in their fit\n"
PUBLISHED_WORDS = ["--parameters", "published"]


@pytest.fixture
def here(tmp_path, monkeypatch):
    """Work in an empty folder of a machine that has no solver."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv(CCX_VARIABLE, raising=False)
    monkeypatch.setenv("PATH", "")
    return tmp_path


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_a_set_of_stimuli_gives_five_files_and_one_note(here, capsys):
    assert main(["simulate", "--stimulus", "noise_25_250", "-o", "out"]) == 0

    streams = capsys.readouterr()
    assert streams.err == NOTE + HELD
    assert sorted(contents(here / "out")) == FILES
    rates = read_rates(here / "out/rates.csv")
    assert len(rates) == 15
    assert {rate.afferent for rate in rates} == {"SA", "RA", "PC"}
    assert (here / "out/raster.png").read_bytes()[:4] == b"\x89PNG"
    table = streams.out.splitlines()
    assert table[0].split() == ["stimulus", "SA", "RA", "PC", "impulses/s"]
    assert len(table) == 7
    for k, line in enumerate(table[1:6]):
        name, *cells = line.split()
        assert {rate.stimulus for rate in rates[3 * k : 3 * k + 3]} == {name}
        expected = [f"{rate.rate_ips:.1f}" for rate in rates[3 * k : 3 * k + 3]]
        assert cells == expected
    assert table[-1] == "rates.csv, spikes.csv, traces.npz, raster.png: out"


def test_the_rates_are_those_of_the_stored_map_worked_out_apart(here):
    """Catalogue, map and encoder put together by hand."""
    main(["simulate", "--stimulus", "noise_25_250", "-o", "out", *PUBLISHED_WORDS])

    response = read_map(FOLDER / "quick.toml")
    expected = {}
    for entry in resolve(["noise_25_250"]):
        for trace in response.traces(make_stimulus(entry)):
            [times_ms] = encode(trace.stress_pa, 0.5, PUBLISHED[trace.afferent])
            count = ((times_ms > 5.0) & (times_ms <= 250.0)).sum()
            expected[entry.id, trace.afferent] = count / 0.245
    rates = read_rates(here / "out/rates.csv")
    found = {(rate.stimulus, rate.afferent): rate.rate_ips for rate in rates}
    assert found == pytest.approx(expected, rel=1e-12)
    assert sum(found.values()) > 500
    spikes = read_spikes(here / "out/spikes.csv")
    assert all((train.times_ms > 0).all() for train in spikes)


def test_the_fitted_population_stands_on_a_held_probe(here):
    """As above, cell by cell: each is the median one under stress of another size."""
    main(["simulate", "--stimulus", "noise_25_250_20", "-o", "out"])

    response = read_map(FOLDER / "quick.toml")
    [entry] = resolve(["noise_25_250_20"])
    chosen = parameter_set("fitted")
    rates = {r.afferent: r.rate_ips for r in read_rates(here / "out/rates.csv")}
    trains = read_spikes(here / "out/spikes.csv")
    for trace in response.traces(make_stimulus(entry, chosen.preindent_um)):
        population = chosen.parameters[trace.afferent]
        one = replace(population, cells=1)
        counts = []
        for quantile in quantiles(population.cells):
            stress_pa = trace.stress_pa / np.exp(population.spread * quantile)
            [times_ms] = encode(stress_pa, 0.5, one)
            counts.append(((times_ms > 5.0) & (times_ms <= 250.0)).sum())
        assert rates[trace.afferent] == pytest.approx(np.mean(counts) / 0.245)
        assert counts == sorted(counts, reverse=True)
    assert {train.repeat for train in trains if train.afferent == "PC"} == set(range(1, 6))


def test_the_traces_are_those_of_the_stored_map(here):
    words = ["--stimulus", "sine_50_250", "-o", "out", "--no-plot"]
    main(["simulate", *words, "--preindent-um", "0"])

    [entry] = resolve(["sine_50_250"])
    expected = read_map(FOLDER / "quick.toml").traces(make_stimulus(entry))
    with np.load(here / "out/traces.npz", allow_pickle=False) as bulk:
        for column, trace in enumerate(expected):
            np.testing.assert_array_equal(bulk["von_mises_pa"][0, :, column], trace.stress_pa)


def test_json_is_all_that_stdout_holds(here, capsys):
    words = ["--stimulus", "sine_20_250", "-o", "out", "--json", "--no-plot"]
    assert main(["simulate", *words]) == 0

    streams = capsys.readouterr()
    summary = json.loads(streams.out)
    assert streams.err == NOTE + HELD
    assert summary["output"] == "out"
    assert summary["method"] == "map"
    assert summary["notes"] == [NOTE.strip(), HELD.strip()]
    assert summary["parameters"] == "fitted"
    assert summary["rates"] == [
        {"stimulus": r.stimulus, "afferent": r.afferent, "rate_ips": r.rate_ips}
        for r in read_rates(here / "out/rates.csv")
    ]


def test_the_record_can_be_read_and_names_its_source(here):
    words = ["--stimulus", "noise_25_250_10", "--seed", "7", "--no-plot"]
    main(["simulate", *words, *PUBLISHED_WORDS])

    record = tomllib.loads((here / "out/simulation.toml").read_text(encoding="utf-8"))
    assert record["source"] == "stored response"
    assert record["stimuli"]["noise_25_250_10"]["seed"] == 7
    assert record["parameters"]["PC"]["tau_ms"] == PUBLISHED["PC"].tau_ms


def test_the_whole_catalogue_is_answered_at_once(here, capsys):
    assert main(["simulate", "--stimulus", "all", "-o", "out", "--no-plot"]) == 0

    rates = read_rates(here / "out/rates.csv")
    assert len(rates) == 82 * 3
    assert len({rate.stimulus for rate in rates}) == 82
    out = capsys.readouterr().out.splitlines()
    assert out[-2] == "... 52 more in rates.csv"


def test_the_same_command_gives_the_same_bytes(here):
    for folder in ("first", "second"):
        main(["simulate", "--stimulus", "noise_25_250_10", "-o", folder])
    assert contents(here / "first") == contents(here / "second")


def test_without_a_plot_an_older_one_does_not_stay_beside_other_spikes(here, capsys):
    main(["simulate", "--stimulus", "sine_20_250", "-o", "out"])
    main(["simulate", "--stimulus", "sine_50_250", "-o", "out", "--no-plot"])

    assert sorted(contents(here / "out")) == FILES[1:]
    assert "raster" not in capsys.readouterr().out.splitlines()[-1]


def test_the_stored_response_of_the_paper_s_mesh_can_be_asked_for(here, capsys):
    words = ["--stimulus", "sine_20_250", "--finger", "paper", "--stored", "--no-plot"]
    assert main(["simulate", *words]) == 0
    told = "stored response of finger 'paper'\n"
    assert capsys.readouterr().err == told + HELD


def test_a_probe_that_stands_deeper_fires_sa_between_cycles(here):
    words = ["simulate", "--stimulus", "sine_20_12.5", "--no-plot"]
    main([*words, "-o", "touch"])
    main([*words, "-o", "held", "--preindent-um", "300"])

    touch, held = (read_rates(here / name / "rates.csv") for name in ("touch", "held"))
    assert held[0].rate_ips > touch[0].rate_ips


def test_help_shows_an_example_that_runs(here, capsys):
    assert main(["simulate", "--help"]) == 0
    told = capsys.readouterr().out
    example = told.split("example: fembridge ")[1].split()
    assert main(example) == 0
    assert (here / "out/rates.csv").exists()


@pytest.mark.solver
def test_with_a_solver_the_response_is_solved_and_then_read_again(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["simulate", "--stimulus", "noise_25_250", "-o"]
    assert main([*words, "out"]) == 0
    first = capsys.readouterr().err
    assert main([*words, "out", "--no-plot"]) == 0
    second = capsys.readouterr().err
    assert main([*words, "stored", "--stored", "--no-plot"]) == 0

    assert "response of finger 'quick' solved in " in first
    assert "response of finger 'quick' read again: 39 increments" in second
    solved, stored = (tmp_path / name / "rates.csv" for name in ("out", "stored"))
    assert solved.read_bytes() == stored.read_bytes()
    record = tomllib.loads((tmp_path / "out/simulation.toml").read_text("utf-8"))
    assert record["source"] == "CalculiX"
    assert read_map(tmp_path / "out/response/response.toml").closure_percent < 0.5
