"""The verb ``fit``: what may be asked of it, and what it refuses."""

import csv
import tomllib
from pathlib import Path

import pytest

from fembridge.cli import main
from fembridge.commands import fit
from fembridge.errors import ResponseError, TableError, UsageError
from fembridge.response.response_map import FOLDER
from fembridge.tables import Rate, write_rates
from neural.models import MODELS
from neural.search import POPULATION, RULES

REAL = Path(__file__).parents[4] / "shared/data/observed_sine_rates.csv"
FILES = ["fitted.toml", "fitted_rates.csv", "pareto_RA.csv", "pareto_SA.csv"]
PICTURE = "tradeoffs.png"


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def table(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def record(tmp_path):
    return tomllib.loads((tmp_path / "out/fitted.toml").read_text(encoding="utf-8"))


def test_a_drive_of_one_class_leaves_the_others_out_and_tells(call, capsys, undrawn):
    summary = call("--drive", "rate")
    assert list(summary["afferents"]) == ["RA"]
    assert summary["notes"][0] == "SA left out: drive 'rate' is of RA"
    with pytest.raises(UsageError, match="no drive 'rate' for SA"):
        call("--drive", "rate", "--afferent", "SA")


def test_an_unknown_drive_is_refused_with_the_list(call):
    with pytest.raises(UsageError, match="drive 'risin', expected one of published, "):
        call("--drive", "risin")


def test_drive_list_tells_of_every_drive_and_needs_no_rates(capsys, parse):
    with pytest.raises(SystemExit) as stop:
        parse("--drive", "list")
    assert stop.value.code == 0
    told = capsys.readouterr().out
    for name, rows in MODELS.items():
        for afferent, model in rows.items():
            start = told.index(f"{name}, {afferent}")
            words = " ".join(told[start:].partition("\n\n")[0].split())
            assert model.equation in words
            assert model.reason in words
            for one in model.free():
                assert f"{one.field} {one.low:g} to {one.high:g}" in words


def test_the_help_tells_every_rule_and_that_rates_are_needed(capsys, parse):
    with pytest.raises(SystemExit):
        parse("--help")
    told = " ".join(capsys.readouterr().out.split())
    for name, sentence in RULES.items():
        assert f"{name}: {sentence}" in told
    with pytest.raises(SystemExit) as stop:
        parse()
    assert stop.value.code == 2


def test_a_class_that_was_not_observed_is_refused(call, tmp_path):
    with pytest.raises(UsageError, match="no observed rates of 'PC', only of SA, RA"):
        call("--afferent", "PC")
    assert not (tmp_path / "out").exists()


def test_the_command_line_has_the_verb_and_tells_an_error_in_a_line(observed, capsys):
    assert main(["fit", "--drive", "list"]) == 0
    assert capsys.readouterr().out.startswith("published, SA")
    assert main(["fit", "--observed", str(observed), "--evaluations", "5"]) == 2
    streams = capsys.readouterr()
    assert streams.out == ""
    assert streams.err == (
        f"fembridge: 5 evaluations, expected at least one population of {POPULATION}\n"
    )


def test_a_missing_rate_is_refused_unless_allowed(call, observed, tmp_path, undrawn):
    lines = observed.read_text().splitlines(keepends=True)
    observed.write_text("".join(lines[:-1]))
    with pytest.raises(TableError, match=r"noise_5_25_50 has a rate of SA"):
        call()
    call("--allow-missing")
    counts = record(tmp_path)["fit"]
    assert "unseen" in counts["SA"]["observed_rates"]
    assert "unseen" not in counts["RA"]["observed_rates"]


def test_an_own_response_is_taken_from_where_simulate_keeps_it(call, tmp_path, undrawn):
    kept = tmp_path / "simulated/response"
    kept.mkdir(parents=True)
    stored = (FOLDER / "paper.toml").read_bytes()
    (kept / "response.toml").write_bytes(stored)
    by_word = {}
    for word in (tmp_path / "simulated", kept, kept / "response.toml"):
        call("--response", word, "--afferent", "SA")
        by_word[word] = contents(tmp_path / "out")
        told = record(tmp_path)["fit"]["response"]
        assert (told["source"], told["finger"]) == ("solved response", "paper")
    first, *others = by_word.values()
    assert all(each == first for each in others)
    call("--finger", "paper", "--afferent", "SA")
    again = contents(tmp_path / "out")
    assert again["pareto_SA.csv"] == first["pareto_SA.csv"]


def test_a_folder_without_a_response_is_refused(call, tmp_path):
    with pytest.raises(ResponseError, match=r"no response\.toml here nor in response/"):
        call("--response", tmp_path)
    with pytest.raises(ResponseError, match=r"absent\.toml: not readable"):
        call("--response", tmp_path / "absent.toml")


def test_a_response_and_a_finger_together_are_misuse(capsys, parse):
    with pytest.raises(SystemExit) as stop:
        parse("--observed", "x", "--finger", "quick", "--response", "y")
    assert stop.value.code == 2


def test_the_observed_sinusoids_are_followed_better_than_by_table_2(tmp_path, undrawn, parse):
    if not REAL.is_file():
        pytest.skip(f"no {REAL.name}: observed rates are not distributed")
    words = ("--evaluations", "500", "--population", "100")
    summary = fit.run(parse("--observed", REAL, "-o", tmp_path / "out", *words))
    for name in ("SA", "RA", "PC"):
        told = summary["afferents"][name]
        [total] = [row for row in told["agreement"] if row["group"] == "all"]
        assert total["count"] == 37
        assert total["r_squared"] > 0.85
        assert total["rmse_ips"] < told["published"]["rmse_ips"]


def test_a_class_without_a_rate_to_fit_is_left_out_and_told(call, tmp_path, undrawn):
    table = tmp_path / "rates.csv"
    rates = [Rate("sine_20_250", "SA", 9.0), Rate("diharm_10_50_125", "RA", 30.0)]
    write_rates(table, rates)

    summary = call("--allow-missing")

    assert list(summary["afferents"]) == ["SA"]
    assert summary["notes"][0] == "RA left out: no observed rates of family sine"


def test_a_population_beyond_any_memory_is_misuse(call):
    with pytest.raises(UsageError, match="population is 1000000000"):
        call("--population", "1000000000", "--evaluations", "1000000000")
