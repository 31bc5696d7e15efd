"""The page of outputs against what the verbs write, and the help; options that messages name."""

import argparse
import ast
import csv
import re
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import fembridge
from fembridge import cli
from fembridge.cli import outputs_of

ROOT = Path(fembridge.__file__).parents[1]
QUICK = ROOT / "fixtures" / "response_quick"
OBSERVED = """stimulus,afferent,rate_ips
sine_20_250,SA,25
sine_50_250,SA,30
sine_20_250,RA,60
sine_50_250,RA,70
"""
STUDY = 'stimuli = "sine_20_250"\nstored = true\n'


def columns_of(verb, file):
    _, columns = outputs_of(verb)[file]
    return [name for name, _, _ in columns]


def matches(header, names):
    """Whether each column is named, in this order; one in brackets is any number of columns."""
    pattern = ""
    for name in names:
        pieces = [re.escape(piece) for piece in re.split(r"<.*?>", name)]
        pattern += f"(?:{'[^,]*'.join(pieces)},){'+' if len(pieces) > 1 else ''}"
    return re.fullmatch(pattern, ",".join(header) + ",") is not None


@pytest.fixture
def here(tmp_path, monkeypatch, unrendered, in_this_process):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("FEMBRIDGE_CCX", "/bin/sh")  # found, never started
    Path("observed.csv").write_text(OBSERVED, encoding="utf-8")
    Path("study.toml").write_text(STUDY, encoding="utf-8")
    return tmp_path


SIMULATE = ["simulate", "--stored", "--no-plot", "--stimulus", "sine_20_250", "-o", "out"]
RUN = str(QUICK)
INTERFACE = str(ROOT / "fixtures/frd_samples/interface_cpe8r.frd")
SWEPT = ROOT / "docs/studies"
SENSITIVITY = ["plot", "sensitivity", "-o", "out/a.png", "--table", "out/t.csv"]
SENSITIVITY += ["--fingers", "out/f.csv"]
FRD = str(QUICK / "job.frd")
FIT = ["fit", "--observed", "observed.csv", "--evaluations", "20", "--population", "4", "-o", "out"]
TABLES = [
    (["stimuli", "--export", "csv", "sine_20_250", "-o", "out/"], {"*.csv": "ID.csv"}),
    (["build-deck", "--stimulus", "sine_20_250", "-o", "out"], {"*/*.csv": "ID/stimulus.csv"}),
    (["ingest", RUN, "-o", "out/a.csv"], {"a.csv": "NAME_traces.csv"}),
    (["ingest", FRD, "--field", "STRESS", "-o", "out/a.csv"], {"a.csv": "NAME_stress_1_39.csv"}),
    *(
        (["ingest", str(QUICK / f"job.{kind}"), "-o", "out/a.csv"], {"a.csv": f"NAME_{kind}.csv"})
        for kind in ("dat", "sta", "cvg")
    ),
    (
        ["ingest", INTERFACE, "--node", "23", "--one-sided", "EALL", "-o", "out/a.csv"],
        {"a.csv": "NAME_sides.csv"},
    ),
    (
        ["ingest", str(ROOT / "fixtures/marc_samples/nour_plastic.sts"), "-o", "out/a.csv"],
        {"a.csv": "NAME_sts.csv"},
    ),
    (
        [*SENSITIVITY, str(SWEPT / "sensitivity_one_at_a_time.csv")],
        {"t.csv": "--table FILE", "f.csv": "--fingers FILE.csv"},
    ),
    (
        [*SENSITIVITY, str(SWEPT / "sensitivity_hypercube.csv")],
        {"t.csv": "--table FILE of drawn fingers"},
    ),
    (SIMULATE, {name: name for name in ("rates.csv", "spikes.csv")}),
    (
        ["sweep", "study.toml", "-o", "out"],
        {
            "results.csv": "results.csv",
            "runs/*/answers.csv": "runs/KEY/answers.csv",
            "runs/*/spikes.csv": "runs/KEY/spikes.csv",
        },
    ),
    (["deflect", "-o", "out"], {"deflection.csv": "deflection.csv"}),
    (FIT, {name: name for name in ("pareto_SA.csv", "fitted_rates.csv")}),
]


@pytest.mark.parametrize(
    ("words", "named"), TABLES, ids=[f"{row[0][0]} {'+'.join(row[1].values())}" for row in TABLES]
)
def test_a_table_has_the_columns_of_the_page(here, words, named):
    assert cli.main(words) == 0
    for written, file in named.items():
        [path] = (here / "out").glob(written)
        with path.open(newline="", encoding="utf-8") as table:
            header = next(csv.reader(table))
        assert matches(header, columns_of(words[0], file)), header


def test_encoded_traces_have_the_columns_of_the_page(here):
    assert cli.main(["ingest", RUN, "-o", "traces.csv"]) == 0
    assert cli.main(["encode", "traces.csv", "--no-raster", "-o", "out"]) == 0
    for name in ("spikes.csv", "rates.csv"):
        header = (here / "out" / name).read_text("utf-8").splitlines()[0].split(",")
        assert header == columns_of("encode", name)
    with np.load(here / "out/stress.npz") as arrays:
        assert list(arrays) == columns_of("encode", "stress.npz")
    named = set(outputs_of("encode")) - {"raster.png", "spikes.npz"}
    assert {path.name for path in (here / "out").iterdir()} == named


def test_the_arrays_of_a_simulation_are_those_of_the_page(here):
    assert cli.main(SIMULATE) == 0
    with np.load(here / "out/traces.npz") as arrays:
        assert list(arrays) == columns_of("simulate", "traces.npz")
    named = set(outputs_of("simulate"))
    named -= {"raster.png", "response/", "spikes.npz"}
    assert {path.name for path in (here / "out").iterdir()} == named


@pytest.mark.slow
def test_the_tables_of_a_validation_are_those_of_the_page(here):
    words = ["validate", "--observed", "observed.csv", "-o", "out"]
    assert cli.main(words) == 0
    named = {file for file, (_, columns) in outputs_of("validate").items() if columns}
    assert {path.name for path in (here / "out").glob("*.csv")} == named
    for name in named:
        header = (here / "out" / name).read_text("utf-8").splitlines()[0].split(",")
        assert header == columns_of("validate", name)


@pytest.mark.slow
def test_the_table_of_a_study_has_the_columns_of_the_page(here):
    words = ["study", "--observed", "observed.csv", "--drive", "published", "--seeds", "1"]
    assert cli.main([*words, "--evaluations", "200", "-o", "out"]) == 0
    header = (here / "out/study.csv").read_text("utf-8").splitlines()[0].split(",")
    assert header == columns_of("study", "study.csv")


@pytest.mark.parametrize("verb", sorted(cli.VERBS))
def test_the_help_of_outputs_has_every_file_and_column(verb, capsys):
    assert cli.main([verb, "--help-outputs"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert shown
    for file, (description, columns) in outputs_of(verb).items():
        assert f"{file}: {description}" in shown
        for name, unit, meaning in columns:
            text = f"{name}{f' ({unit})' if unit else ''}: {meaning}".replace("`", "")
            assert " ".join(text.split()) in shown


@pytest.mark.parametrize("verb", sorted(cli.VERBS))
def test_a_help_page_is_short_and_begins_with_the_options(verb, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    assert cli.main([verb, "--help"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= 92
    assert lines.index("options:") < 12


def test_every_verb_that_writes_files_is_on_the_page_with_every_row_read():
    page = (ROOT / "fembridge/commands/outputs.md").read_text(encoding="utf-8")
    verbs = re.findall("^## (.*)", page, re.MULTILINE)
    assert sorted(verbs) == sorted(set(cli.VERBS) - {"cache", "check", "completion", "doctor"})
    outputs = [output for verb in verbs for output in outputs_of(verb).values()]
    assert len(outputs) == len(re.findall(r"^\*\*", page, re.MULTILINE))
    assert sum(len(columns) for _, columns in outputs) == len(
        re.findall(r"^\| `", page, re.MULTILINE)
    )


OTHERS = {"--help", "--help-outputs", "--version", "--json"}
"""Of every verb; added by the command line itself."""


def options_of(parser):
    found = set(parser._option_string_actions)
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            found.update(*map(options_of, action.choices.values()))
    return found


@pytest.fixture(scope="module")
def options():
    found = set(OTHERS)
    for verb in cli.VERBS:
        parser = argparse.ArgumentParser()
        import_module(f"fembridge.commands.{verb.replace('-', '_')}").add_arguments(parser)
        found |= options_of(parser)
    return found


@pytest.mark.parametrize("package", ["fembridge", "decks", "neural"])
def test_every_option_in_a_text_of_ours_exists(options, package):
    unknown = {}
    own_script = ROOT / "fembridge" / "results" / "export_script.py"  # with options of its own
    named = re.compile(r"(?<![\w-])--[a-z][a-z-]+[a-z]\b")
    for path in {*(ROOT / package).rglob("*.py")} - {own_script}:
        text = path.read_text(encoding="utf-8")
        if options.issuperset(named.findall(text)):  # also of comments and names: most files
            continue
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                for word in set(named.findall(node.value)) - options:
                    unknown[f"{path.relative_to(ROOT)}:{node.lineno}"] = word
    assert not unknown
