"""The verb ``fit``: files, words, exit codes; what is kept after an interrupt."""

import csv
import json
import re
import tomllib
from pathlib import Path

import numpy as np
from numpy.testing import assert_allclose

from decks.stimuli import resolve
from decks.waveform import make_stimulus
from fembridge.fitting.fit import SearchBar
from fembridge.response.response_map import FOLDER, read_map
from fembridge.tables import read_rates
from neural import PUBLISHED, encode_cells, rate_ips, read_parameter_set
from neural.models import MODELS

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


def test_a_fit_writes_fronts_parameters_rates_and_a_picture(call, tmp_path, capsys):
    summary = call()
    assert sorted(contents(tmp_path / "out")) == [*FILES, PICTURE]
    assert (tmp_path / "out" / PICTURE).read_bytes().startswith(b"\x89PNG")
    assert summary["exit_code"] == 0
    assert summary["finished"]
    assert sorted(summary["files"]) == [*FILES, PICTURE]
    streams = capsys.readouterr()
    assert re.fullmatch(
        r"SA, drive rising: 40 evaluations in .* ips\n"
        r"RA, drive rising: 40 evaluations in .* ips\n",
        streams.err,
    )
    assert "noise, all, unseen" in streams.out
    assert "chosen: candidate 1, smallest RMSE over all 7 stimuli" in streams.out


def test_the_file_of_parameters_gives_the_rates_that_are_told(call, tmp_path, undrawn, stimuli):
    """Read back, and worked out by the encoder apart from the fit."""
    call()
    found = read_parameter_set(tmp_path / "out/fitted.toml")
    assert found.name == "fit"
    assert found.preindent_um == 75.0
    assert found.parameters["PC"] == PUBLISHED["PC"]
    told = read_rates(tmp_path / "out/fitted_rates.csv")
    assert [(one.stimulus, one.afferent) for one in told] == [
        (stimulus, name) for name in ("SA", "RA") for stimulus in stimuli
    ]
    response = read_map(FOLDER / "quick.toml")
    expected = []
    for one in told:
        stimulus = make_stimulus(resolve(one.stimulus)[0], preindent_um=75.0)
        [trace] = [t for t in response.traces(stimulus) if t.afferent == one.afferent]
        parameters = found.parameters[one.afferent]
        [cells] = encode_cells(trace.stress_pa[:, None], 0.5, parameters)
        expected.append(np.mean([rate_ips(x, stimulus.window_ms) for x in cells]))
    assert_allclose([one.rate_ips for one in told], expected, rtol=1e-12)
    assert max(expected) > 10.0


def test_the_chosen_row_of_a_front_has_the_parameters_that_were_written(call, tmp_path, undrawn):
    call("--rule", "frequency_response")
    found = record(tmp_path)
    for name in ("SA", "RA"):
        rows = table(tmp_path / f"out/pareto_{name}.csv")
        [chosen] = [row for row in rows if row["chosen"] == "yes"]
        told = found["fit"][name]
        assert int(chosen["candidate"]) == told["candidate"]
        assert len(rows) == told["front_size"]
        assert len(told["free"]) == told["free_parameters"]
        for field, free in told["free"].items():
            assert float(chosen[field]) == found[name][field]
            assert free["low"] <= found[name][field] <= free["high"]
        totals = [float(row["rmse_all_ips"]) for row in rows]
        assert totals == sorted(totals)
        groups = [float(chosen[f"rmse_{hz}_Hz_ips"]) for hz in (20, 50, 100)]
        weighed = np.average(np.square(groups), weights=[3, 2, 2])
        assert_allclose(float(chosen["rmse_all_ips"]), np.sqrt(weighed), rtol=1e-12)


def test_the_record_tells_where_all_came_from_and_no_rate_and_no_path(
    call, tmp_path, observed, undrawn
):
    import hashlib

    call("--seed", "5")
    told = record(tmp_path)["fit"]
    assert told["finished"] is True
    assert (told["seed"], told["evaluations"], told["population"]) == (5, 40, 20)
    assert told["rule"] == "smallest_error"
    digest = hashlib.sha256(observed.read_bytes()).hexdigest()
    assert told["observed"] == {"file": "rates.csv", "sha256": digest}
    stored = (FOLDER / "quick.toml").read_bytes()
    assert told["response"]["sha256"] == hashlib.sha256(stored).hexdigest()
    assert told["response"]["finger"] == "quick"
    assert set(told["versions"]) == {"fembridge", "numpy", "pymoo"}
    assert told["SA"]["equation"] == MODELS["rising"]["SA"].equation
    counts = told["SA"]["observed_rates"]
    assert counts["fitted"] == {"20 Hz": 3, "50 Hz": 2, "100 Hz": 2}
    assert counts["unseen"] == {"5-25 Hz": 1}
    seen = {(row["group"], row["seen"]) for row in told["RA"]["agreement"]}
    assert {("20 Hz", True), ("5-25 Hz", False)} < seen
    text = (tmp_path / "out/fitted.toml").read_text(encoding="utf-8")
    assert str(tmp_path) not in text


def test_the_same_seed_gives_the_same_bytes(call, tmp_path):
    call("--afferent", "RA")
    first = contents(tmp_path / "out")
    call("--afferent", "RA")
    assert contents(tmp_path / "out") == first
    assert PICTURE in first


def test_another_seed_gives_another_front(call, tmp_path, undrawn):
    call("--afferent", "RA")
    first = contents(tmp_path / "out")
    call("--afferent", "RA", "--seed", "2")
    assert contents(tmp_path / "out")["pareto_RA.csv"] != first["pareto_RA.csv"]


def test_an_interrupt_keeps_the_best_so_far_and_says_so(call, tmp_path, monkeypatch, capsys):
    heard = []

    def stop(self, afferent, progress):
        heard.append(progress.evaluations)
        if len(heard) == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr(SearchBar, "__call__", stop)
    summary = call("--evaluations", "400")
    assert summary["exit_code"] == 130
    assert not summary["finished"]
    assert sorted(contents(tmp_path / "out")) == [
        *(name for name in FILES if name != "pareto_RA.csv"),
        PICTURE,
    ]
    told = record(tmp_path)["fit"]
    assert told["finished"] is False
    assert told["SA"]["finished"] is False
    assert told["SA"]["evaluations"] == 40
    assert told["afferents"] == ["SA"]
    assert told["left_out"] == ["RA"]
    assert told["source"].endswith("interrupted")
    last = capsys.readouterr().err.splitlines()[-1]
    assert last == "interrupted: the best so far of SA is kept, finished = false"


def test_the_front_of_a_class_that_is_not_fitted_now_does_not_stay(call, tmp_path, undrawn):
    call()
    (tmp_path / "out/mine.txt").write_text("mine")
    call("--afferent", "SA")
    names = [name for name in FILES if name != "pareto_RA.csv"]
    assert sorted(contents(tmp_path / "out")) == sorted([*names, "mine.txt", PICTURE])


def test_json_is_all_that_stdout_holds(call, capsys, undrawn):
    from fembridge.cli import _strict

    summary = call("--json", "--afferent", "RA")
    assert capsys.readouterr().out == ""
    found = json.loads(json.dumps(_strict(summary), allow_nan=False))
    told = found["afferents"]["RA"]
    assert told["parameters"]["drive"] == "rising"
    assert told["evaluations"] == 40
    assert {row["group"] for row in told["agreement"]} >= {"20 Hz", "all"}


def test_all_families_can_be_fitted_and_then_none_is_unseen(call, tmp_path, undrawn):
    call("--family", "all", "--afferent", "SA")
    told = record(tmp_path)["fit"]
    assert told["families"] == ["sine", "diharm", "noise"]
    assert list(told["SA"]["observed_rates"]) == ["fitted"]
    assert told["SA"]["observed_rates"]["fitted"]["5-25 Hz"] == 1
    header = table(tmp_path / "out/pareto_SA.csv")[0]
    assert "rmse_5-25_Hz_ips" in header


def test_the_published_drive_is_fitted_without_pre_indentation(call, tmp_path, undrawn):
    call("--drive", "published", "--afferent", "SA")
    found = record(tmp_path)
    assert found["preindent_um"] == 0.0
    assert found["name"] == "fit_published"
    assert found["SA"]["drive"] == "published"
    call("--drive", "published", "--afferent", "SA", "--preindent-um", "30")
    assert record(tmp_path)["preindent_um"] == 30.0


def test_more_cells_bring_a_spread_to_search(call, tmp_path, undrawn):
    call("--drive", "rate", "--cells", "3", "--afferent", "RA")
    found = record(tmp_path)
    assert found["RA"]["cells"] == 3
    assert "spread" in found["fit"]["RA"]["free"]
