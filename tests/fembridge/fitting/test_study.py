"""The model study: cases, findings, their files, and the verb."""

import csv
import json
from dataclasses import replace

import pandas as pd
import pytest

import fembridge as fb
from fembridge.cli import main
from fembridge.errors import UsageError
from fembridge.fitting import model_study as study
from fembridge.fitting.model_study import (
    Case,
    default_cases,
    study_models,
    summary_text,
)
from fembridge.fitting.response_source import stored_source
from fembridge.io.observed_rates import read_observed
from fembridge.io.spike_table import Rate, write_rates
from neural.models import MODELS
from neural.parameter_sets import parameter_set

STIMULI = ("sine_20_100", "sine_20_250", "sine_50_100", "sine_50_250")
CASES = [Case("published", "RA", 1, 0.0), Case("rising", "RA", 2, 50.0)]
SHORT = {"evaluations": 200, "seeds": (1, 2)}


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    """Rates that go with amplitude and frequency, of RA and PC."""
    path = tmp_path_factory.mktemp("observed") / "rates.csv"
    rates = [
        Rate(name, afferent, gain * float(name.split("_")[2]) / 10)
        for name in STIMULI
        for afferent, gain in (("RA", 1.0), ("PC", 2.0))
    ]
    write_rates(path, rates)
    return path


@pytest.fixture(scope="module")
def made(table):
    response = stored_source("quick").response
    return study_models(read_observed(table), response, [*CASES, CASES[0]], **SHORT)


def test_each_case_has_a_trial_a_seed_and_the_best_comes_first(made):
    assert made.finished, "a case that is named twice is one"
    trials = made.trials
    assert trials["drive"].tolist() == ["published", "published", "rising", "rising"]
    assert trials["seed"].tolist() == [1, 2, 1, 2]
    medians = trials.groupby("drive")["held_out_rmse_ips"].median()
    ranked = made.ranked("RA")
    assert [part["drive"].iloc[0] for part in ranked] == medians.sort_values().index.tolist()
    assert set(made.unfitted) == {"RA"}


def test_the_summary_ends_with_the_paper_s_parameters_as_printed(made):
    lines = summary_text(made).splitlines()
    assert lines[0] == "### RA"
    assert "published, Table 2 as printed" in lines[-1]
    assert len([line for line in lines if line.startswith("| ")]) == 4


def test_the_whole_study_has_every_drive_unheld_and_held():
    cases = default_cases(("SA", "RA", "PC"))
    found = {(case.model, case.afferent, case.preindent_um) for case in cases}
    for name, rows in MODELS.items():
        for afferent in rows:
            assert {
                (name, afferent, 0.0),
                (name, afferent, parameter_set("fitted").preindent_um),
            } <= found
    assert len(cases) == len(set(cases))


@pytest.mark.slow
def test_two_processes_find_what_one_finds(table, made):
    response = stored_source("quick").response
    again = study_models(read_observed(table), response, CASES, jobs=2, **SHORT)
    assert summary_text(again) == summary_text(made)


@pytest.mark.parametrize(
    ("cases", "options", "argument"),
    [
        ([], {}, "cases"),
        ([Case("rising", "RA", 1, 0.0)], {"seeds": ()}, "seeds"),
        ([Case("rising", "RA", 1, 0.0)], {"jobs": 0}, "jobs"),
    ],
)
def test_what_is_no_study_is_refused(table, cases, options, argument):
    with pytest.raises(UsageError) as caught:
        study_models(read_observed(table), stored_source("quick").response, cases, **options)
    assert caught.value.argument == argument


@pytest.mark.parametrize(("argument", "value"), [("cells", 3), ("preindent_um", 75)])
def test_cells_and_depths_require_models(table, argument, value):
    with pytest.raises(UsageError) as caught:
        fb.study(table, **{argument: value})
    assert caught.value.argument == argument


def test_a_study_comes_back_from_its_files(table, tmp_path):
    options = {"drive": "corpuscle", "seeds": [1], "evaluations": 200}
    made = fb.study(pd.read_csv(table), **options, output=tmp_path / "first")
    read = fb.ModelStudy.read(tmp_path / "first")
    read.write(tmp_path / "second")
    assert read.unfitted == made.unfitted
    assert read.provenance == made.provenance
    pd.testing.assert_frame_equal(read.trials, made.trials, rtol=1e-14)
    for name in ("study.toml", "study.md"):
        assert (tmp_path / "first" / name).read_bytes() == (tmp_path / "second" / name).read_bytes()


def test_the_verb_writes_table_summary_and_picture(table, tmp_path, capsys):
    words = ["study", "--observed", str(table), "--drive", "corpuscle", "two_way"]
    short = ["--evaluations", "200", "--seeds", "1", "--json", "-o", str(tmp_path / "s")]
    assert main([*words, *short]) == 0

    shown = json.loads(capsys.readouterr().out)
    assert shown["cases"] == 2
    assert set(shown["best"]) == {"RA", "PC"}
    assert sorted(path.name for path in (tmp_path / "s").iterdir()) == [
        "study.csv",
        "study.md",
        "study.png",
        "study.toml",
    ]


@pytest.mark.slow
def test_an_interrupt_keeps_the_cases_that_are_finished(table, tmp_path, monkeypatch, capsys):
    """Also one in the middle of a search, which is not taken for a whole one."""
    asked, whole = [], study.search_front

    def stop_in_second_case(problem, **words):
        asked.append(problem.model.name)
        front = whole(problem, **words)
        return replace(front, finished=False) if asked[-1] == "two_way" else front

    monkeypatch.setattr(study, "search_front", stop_in_second_case)
    words = ["study", "--observed", str(table), "--drive", "corpuscle", "two_way", "corpuscle"]
    short = ["--evaluations", "200", "--seeds", "1", "--json", "-o", str(tmp_path / "s")]
    assert main([*words, *short]) == 130

    streams = capsys.readouterr()
    shown = json.loads(streams.out)
    assert (shown["finished"], shown["cases"]) == (False, len(set(asked)) - 1)
    assert asked[-1] == "two_way"
    with (tmp_path / "s" / "study.csv").open(newline="") as file:
        assert {row["drive"] for row in csv.DictReader(file)} == {"corpuscle"}
    assert "1 of " in streams.err.splitlines()[-1]


@pytest.mark.parametrize("name", ["study.png", ""])
def test_an_output_that_cannot_be_written_is_refused_before_the_first_case(
    table, tmp_path, monkeypatch, capsys, name
):
    output = tmp_path / "s"
    if name:
        (output / name).mkdir(parents=True)
    else:
        output.write_text("mine")
    monkeypatch.setattr(study, "search_front", lambda *_, **__: pytest.fail("computed"))
    assert main(["study", "--observed", str(table), "-o", str(output)]) == 1
    assert str(output / name) in capsys.readouterr().err
