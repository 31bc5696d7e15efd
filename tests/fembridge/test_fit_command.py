"""The verb ``fit``: files, words, exit codes; what is kept after an interrupt."""

import argparse
import csv
import re
import tomllib

import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.testing import assert_allclose

from decks.synthesis import make_stimulus
from fembridge.cli import main
from fembridge.commands import fit
from fembridge.errors import OutputError, ResponseError, TableError, UsageError
from fembridge.fitting import fit as fitting
from fembridge.fitting.fit import SearchBar
from fembridge.host.store import sha256_of
from fembridge.io.spike_table import Rate, read_rates, write_rates
from fembridge.response.response_map import FOLDER, read_map
from neural import PUBLISHED, encode_cells, parameter_set, rate_ips
from neural.models import MODELS

FILES = [
    *("fitted.toml", "fitted_rates.csv", "observed_and_fitted.csv"),
    *("pareto_RA.csv", "pareto_SA.csv"),
]
PICTURE = "tradeoffs.png"


# Of nobody: SA and RA.
RATES = {
    "sine_20_67.07": (3.0, 30.0),
    "sine_20_129.49": (6.0, 55.0),
    "sine_20_250": (12.0, 100.0),
    "sine_50_113.6": (7.0, 45.0),
    "sine_50_250": (14.0, 95.0),
    "sine_100_85.98": (5.0, 40.0),
    "sine_100_200": (11.0, 90.0),
    "noise_5_25_50": (2.0, 10.0),
}
SHORT = ("--evaluations", "40", "--population", "20")


def write_observed(path):
    """A table of rates of SA and RA that someone may have observed."""
    rates = [
        Rate(stimulus, name, rate)
        for stimulus, both in RATES.items()
        for name, rate in zip(("SA", "RA"), both, strict=True)
    ]
    write_rates(path, rates)
    return path


@pytest.fixture
def observed(tmp_path):
    return write_observed(tmp_path / "rates.csv")


def parse(*words):
    """Parse words as the command line does."""
    parser = argparse.ArgumentParser(prog="fembridge fit")
    fit.add_arguments(parser)
    parser.add_argument("--json", action="store_true")
    return parser.parse_args([str(word) for word in words])


@pytest.fixture
def call(tmp_path, observed):
    """Run the verb on these rates into a folder ``out``."""
    given = ("--observed", observed, "-o", tmp_path / "out", *SHORT)
    return lambda *words: fit.run(parse(*given, *words))


@pytest.fixture
def undrawn(monkeypatch):
    """Put an empty figure in the place of the picture: drawing takes seconds."""
    monkeypatch.setattr(
        "fembridge.plots.fit_result.tradeoffs_figure", lambda *_: Figure(figsize=(1, 1))
    )


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The folder of a fit of both classes, `undrawn`, and its table of rates."""
    folder = tmp_path_factory.mktemp("made")
    table = write_observed(folder / "rates.csv")
    words = ["--seed", "5", "--rule", "frequency_response", "-o", str(folder / "out")]
    with pytest.MonkeyPatch.context() as undrawn:
        undrawn.setattr(
            "fembridge.plots.fit_result.tradeoffs_figure", lambda *_: Figure(figsize=(1, 1))
        )
        assert main(["fit", "--observed", str(table), *SHORT, *words]) == 0
    return folder


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def table(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def record(tmp_path):
    return tomllib.loads((tmp_path / "out/fitted.toml").read_text(encoding="utf-8"))


def test_a_fit_writes_fronts_parameters_rates_and_a_picture(
    call, tmp_path, undrawn, logged, capsys
):
    summary = call()
    assert sorted(contents(tmp_path / "out")) == [*FILES, PICTURE]
    assert (tmp_path / "out" / PICTURE).read_bytes().startswith(b"\x89PNG")
    assert summary["exit_code"] == 0
    assert summary["finished"]
    assert sorted(summary["files"]) == [*FILES, PICTURE]
    assert [re.search(r"(SA|RA).*(fading|two_way).* 40 ", line).groups() for line in logged] == [
        ("SA", "fading"),
        ("RA", "two_way"),
    ]
    assert "noise, all, unseen" in (out := capsys.readouterr().out)
    assert "chosen: candidate 1, smallest RMSE over all 7 stimuli" in out


def test_the_file_of_parameters_gives_the_rates_that_are_said(made):
    """Read back, and worked out by the encoder apart from the fit."""
    found = parameter_set(made / "out/fitted.toml")
    assert found.name == "fit"
    assert found.preindent_um == 75.0
    assert found.parameters["PC"] == PUBLISHED["PC"]
    shown = read_rates(made / "out/fitted_rates.csv")
    assert [(one.stimulus, one.afferent) for one in shown] == [
        (stimulus, name) for name in ("SA", "RA") for stimulus in RATES
    ]
    response = read_map(FOLDER / "quick.toml")
    expected = []
    for one in shown:
        parameters = found.parameters[one.afferent]
        stimulus = make_stimulus(one.stimulus, preindent_um=75.0, dt_ms=parameters.dt_ms)
        [trace] = [t for t in response.traces(stimulus) if t.afferent == one.afferent]
        [cells] = encode_cells(trace.stress_pa[:, None], parameters.dt_ms, parameters)
        expected.append(np.mean([rate_ips(x, stimulus.window_ms) for x in cells]))
    assert_allclose([one.rate_ips for one in shown], expected, rtol=1e-12)
    assert max(expected) > 10.0


def test_the_chosen_row_of_a_front_has_the_parameters_that_were_written(made):
    found = record(made)
    for name in ("SA", "RA"):
        rows = table(made / f"out/pareto_{name}.csv")
        [chosen] = [row for row in rows if row["chosen"] == "yes"]
        shown = found["fit"][name]
        assert int(chosen["candidate"]) == shown["candidate"]
        assert len(rows) == shown["front_size"]
        assert len(shown["free"]) == shown["free_parameters"]
        for field, free in shown["free"].items():
            assert float(chosen[field]) == found[name][field]
            assert free["low"] <= found[name][field] <= free["high"]
        totals = [float(row["rmse_all_ips"]) for row in rows]
        assert totals == sorted(totals)
        groups = [float(chosen[f"rmse_{hz}_Hz_ips"]) for hz in (20, 50, 100)]
        weighed = np.average(np.square(groups), weights=[3, 2, 2])
        assert_allclose(float(chosen["rmse_all_ips"]), np.sqrt(weighed), rtol=1e-12)


def test_the_record_tells_where_all_came_from_and_no_rate_and_no_path(made):
    shown = record(made)["fit"]
    assert shown["finished"] is True
    assert (shown["seed"], shown["evaluations"], shown["population"]) == (5, 40, 20)
    assert shown["rule"] == "frequency_response"
    sha256 = sha256_of(made / "rates.csv")
    assert shown["observed"] == {"file": "rates.csv", "sha256": sha256}
    assert shown["response"]["sha256"] == sha256_of(FOLDER / "quick.toml")
    assert shown["response"]["finger"] == "quick"
    assert {*shown["versions"]} - {"numba"} == {"fembridge", "numpy", "pymoo"}
    counts = shown["SA"]["observed_rates"]
    assert counts["fitted"] == {"20 Hz": 3, "50 Hz": 2, "100 Hz": 2}
    assert counts["unseen"] == {"5-25 Hz": 1}
    seen = {(row["group"], row["seen"]) for row in shown["RA"]["agreement"]}
    assert {("20 Hz", True), ("5-25 Hz", False)} < seen
    text = (made / "out/fitted.toml").read_text(encoding="utf-8")
    assert str(made) not in text


def test_the_same_seed_gives_the_same_bytes(call, tmp_path, undrawn):
    call("--afferent", "RA")
    first = contents(tmp_path / "out")
    call("--afferent", "RA")
    assert contents(tmp_path / "out") == first


@pytest.mark.usefixtures("undrawn")
def test_an_interrupt_keeps_the_best_so_far_and_says_so(call, tmp_path, monkeypatch, logged):
    updates = []

    def stop(self, afferent, progress):
        updates.append(progress.evaluations)
        if len(updates) == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr(SearchBar, "__call__", stop)
    summary = call("--evaluations", "400")
    assert summary["exit_code"] == 130
    assert not summary["finished"]
    assert sorted(contents(tmp_path / "out")) == [
        *(name for name in FILES if name != "pareto_RA.csv"),
        PICTURE,
    ]
    shown = record(tmp_path)["fit"]
    assert shown["finished"] is False
    assert shown["SA"]["finished"] is False
    assert shown["SA"]["evaluations"] == 40
    assert shown["afferents"] == ["SA"]
    assert shown["left_out"] == ["RA"]
    assert shown["source"].endswith("interrupted")
    assert len(logged) == 2


@pytest.mark.parametrize("name", [FILES[0], PICTURE, ""])
def test_an_output_that_cannot_be_written_is_refused_before_the_search(
    call, tmp_path, monkeypatch, name
):
    if name:
        (tmp_path / "out" / name).mkdir(parents=True)
    else:
        (tmp_path / "out").write_text("mine")
    monkeypatch.setattr(fitting, "search_front", lambda *_, **__: pytest.fail("searched"))
    with pytest.raises(OutputError) as caught:
        call()
    assert caught.value.path == tmp_path / "out" / name


def test_the_front_of_a_class_that_is_not_fitted_now_does_not_stay(call, tmp_path, undrawn):
    call()
    (tmp_path / "out/mine.txt").write_text("mine")
    call("--afferent", "SA")
    names = [name for name in FILES if name != "pareto_RA.csv"]
    assert sorted(contents(tmp_path / "out")) == sorted([*names, "mine.txt", PICTURE])


def test_the_published_drive_is_fitted_to_all_families_without_pre_indentation(
    call, tmp_path, undrawn
):
    call("--drive", "published", "--afferent", "SA", "--family", "all")
    found = record(tmp_path)
    assert (found["preindent_um"], found["name"]) == (0.0, "fit_published")
    assert found["SA"]["drive"] == "published"
    shown = found["fit"]
    assert shown["families"] == ["sine", "diharm", "noise"]
    assert list(shown["SA"]["observed_rates"]) == ["fitted"]
    assert shown["SA"]["observed_rates"]["fitted"]["5-25 Hz"] == 1
    assert "rmse_5-25_Hz_ips" in table(tmp_path / "out/pareto_SA.csv")[0]


def test_a_model_of_one_class_leaves_the_others_out(call, tmp_path, undrawn, logged):
    summary = call("--drive", "two_way", "--cells", "3")
    assert list(summary["afferents"]) == ["RA"]
    assert summary["afferents"]["RA"]["parameters"]["drive"] == "two_way"
    assert all(name in logged[0] for name in ("SA", "RA", "two_way"))
    found = record(tmp_path)
    assert found["RA"]["cells"] == 3
    assert "spread" in found["fit"]["RA"]["free"]


@pytest.mark.parametrize(
    ("words", "error", "found"),
    [
        (["--drive", "two_way", "--afferent", "SA"], UsageError, "'two_way'.* SA"),
        (["--drive", "risin"], UsageError, "'risin'"),
        (["--afferent", "PC"], UsageError, "'PC'"),
        (["--response", "."], ResponseError, r"response\.toml"),
        (["--response", "absent.toml"], ResponseError, r"absent\.toml"),
    ],
)
def test_what_no_fit_can_be_made_of_is_refused(call, tmp_path, monkeypatch, words, error, found):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(error, match=found):
        call(*words)
    assert not (tmp_path / "out").exists()


def test_drive_list_describes_every_model_and_needs_no_rates(capsys):
    with pytest.raises(SystemExit) as stop:
        parse("--drive", "list")
    assert stop.value.code == 0
    shown = capsys.readouterr().out
    for name, rows in MODELS.items():
        for afferent, model in rows.items():
            start = shown.index(f"{name}, {afferent}")
            assert model.equation in " ".join(shown[start:].split())


def test_a_missing_rate_is_refused_unless_allowed(call, observed, tmp_path, undrawn, logged):
    """Then a class that has none to fit is left out, and that is told."""
    rates = [Rate(one, "SA", both[0]) for one, both in RATES.items()]
    write_rates(observed, [*rates, Rate("noise_5_25_50", "RA", 10.0)])
    with pytest.raises(TableError, match=r"sine_20_67\.07 has no rate of RA"):
        call()
    summary = call("--allow-missing")
    assert list(summary["afferents"]) == ["SA"]
    assert logged[0] == "RA left out: no observed rates of family sine"


def test_an_own_response_is_taken_from_where_simulate_keeps_it(call, tmp_path, undrawn):
    kept = tmp_path / "simulated/response"
    kept.mkdir(parents=True)
    stored = (FOLDER / "paper.toml").read_bytes()
    (kept / "response.toml").write_bytes(stored)
    found = []
    for word in (tmp_path / "simulated", kept / "response.toml"):
        call("--response", word, "--afferent", "SA")
        found.append(contents(tmp_path / "out"))
        shown = record(tmp_path)["fit"]["response"]
        assert (shown["source"], shown["finger"]) == ("solved response", "paper")
    assert found[0] == found[1]
    call("--finger", "paper", "--afferent", "SA")
    assert contents(tmp_path / "out")["pareto_SA.csv"] == found[0]["pareto_SA.csv"]


def test_each_frequency_is_predicted_by_a_fit_without_it(call, undrawn, tmp_path, capsys):
    """As a fit to a table without that frequency predicts it."""
    call("--afferent", "SA", "--drive", "published", "--held-out")
    found = record(tmp_path)["fit"]["SA"]["held_out"]
    sines = {name: rates[0] for name, rates in RATES.items() if name.startswith("sine")}
    assert found["rates_ips"].keys() == sines.keys()
    errors = [found["rates_ips"][name] - rate for name, rate in sines.items()]
    assert_allclose(found["rmse_ips"], np.sqrt(np.mean(np.square(errors))), rtol=1e-3)
    assert len(re.findall(r"held-out groups +7 ", capsys.readouterr().out)) == 1

    part, out = tmp_path / "part.csv", tmp_path / "part"
    write_rates(part, [Rate(one, "SA", r) for one, r in sines.items() if "sine_20_" not in one])
    words = ["--observed", str(part), "-o", str(out), "--drive", "published"]
    assert main(["fit", *words, *SHORT]) == 0
    asked = [name for name in sines if "sine_20_" in name]
    words = ["--parameters", str(out / "fitted.toml"), "--stored", "--no-plot"]
    words += ["-o", str(tmp_path / "sim")]
    assert main(["simulate", "--stimulus", ",".join(asked), *words]) == 0
    rates = read_rates(tmp_path / "sim/rates.csv")
    predicted = [rate.rate_ips for rate in rates if rate.afferent == "SA"]
    assert_allclose([found["rates_ips"][name] for name in asked], predicted, atol=1e-3)


def test_one_frequency_cannot_be_left_out(call, tmp_path):
    write_rates(tmp_path / "one.csv", [Rate("sine_20_250", "SA", 12.0)])
    with pytest.raises(UsageError, match=r"SA.* 20 Hz") as caught:
        call("--observed", tmp_path / "one.csv", "--held-out")
    assert caught.value.argument == "held_out"
