"""Every option of every verb with values that a script or a slip of the finger gives.

The options come from the parsers, so that a new one is tried without an entry here; a new
verb needs a row in `LINES`.
"""

import argparse
import os
import random
import re
import shlex
import shutil
from importlib import import_module
from pathlib import Path

import pytest

from fembridge import cli
from fembridge.commands.options import Number

ROOT = Path(__file__).parents[2]

# What a parser, `float` or `int` may stumble over; in each run, and in a long one.
FEW = ("nan", "", "--", "1e308")
MANY = (
    *("inf", "-inf", "-1", "0", "1e-320", "-1e308", "1_000", "١٢", "99999999999999999999"),
    *("é", "a b", "=", ",", ":", "1:", ":1", "1,", "nan:1", "SA=", "SA=nan", "time=", "all"),
    *(os.fsdecode(b"\xff"), "a\nb", "-", "/dev/null", ".", "no/such/folder", "x" * 5000),
)

# By verb, or picture, a valid line that costs little, in the folder of `filled`.
LINES = {
    "stimuli": "sine_20_250",
    "build-deck": "--stimulus sine_20_250 -o runs",
    "check": "mine.inp",
    "fingertip": "--finger coarse_tip.toml -o tip.inp",
    "map": "--base-deck mine.inp --afferent SA=1 -o map",
    "run": "run_folder",
    "ingest": "run_folder",
    "export-script": "",
    "export-c": "",
    "calibrate": "press.csv --depth-um 200 -o calibration.toml",
    "encode": "traces.csv --no-raster -o encoded",
    "simulate": "--stimulus sine_20_250 --stored --no-plot -o out",
    "touch": "--press-um 200 --population one_each --no-plot -o out",
    "receptive-field": "--afferent SA --step-mm 2 --depth-um 200 -o field",
    "pad": "--plane --spacing-mm 1 -o pad.npz",
    "sweep": "study.toml -o sweep",
    "fit": "--observed rates.csv --afferent SA --evaluations 8 --population 4 -o fit",
    "study": "--observed rates.csv --drive published --seeds 1 --evaluations 100 -o study",
    "threshold": "--afferent SA --frequencies-hz 50 -o threshold",
    "validate": "-o report",
    "verify": "--quick --only patch -o verification",
    "deflect": "--finger quick -o deflection",
    "report": "run_folder -o report.html",
    "explore": "run_folder -o explore.html",
    "sample": "waveform -o sample",
    "plot mesh": "-o mesh.png",
    "plot response": "-o response.png",
    "plot trace": "traces.csv -o trace.png",
    "plot raster": "spikes.csv -o raster.png",
    "plot psth": "spikes.csv -o psth.png",
    "plot isi": "spikes.csv -o isi.png",
    "plot rates": "rates.csv -o rates.png",
    "plot stimulus": "sine_20_250 -o stimulus.png",
    "plot sensitivity": "rates.csv -o sensitivity.png",
    "plot all": "run_folder -o pictures",
    "cache": "",
    "doctor": "",
    "completion": "bash",
}
TRACES = "traces.csv --columns time_ms=time_ms,value=von_mises_pa"

# Minutes each, or of the machine alone: only their words are read.
COSTLY = {"validate", "verify", "study", "pad", "doctor"}

FILES = {
    "traces.csv": "time_ms,afferent,node,von_mises_pa\n"
    + "".join(f"{0.5 * row},SA,1,{1e4 + 900 * (row % 9)}\n" for row in range(40)),
    "press.csv": "time_ms,volts\n"
    + "".join(f"{row},{0.5 + min(max(row - 20, 0), 10) / 10}\n" for row in range(60)),
    "spikes.csv": "stimulus,afferent,trial,spike_time_ms\nsine_20_250,SA,0,7.5\n",
    "rates.csv": "stimulus,afferent,rate_ips\nsine_20_250,SA,25\nsine_50_250,SA,30\n",
    "coarse_tip.toml": 'base = "fingertip"\n[resolution]\npad_mm = 3\nfar_mm = 4\norder = 1\n',
    "study.toml": 'stimuli = ["sine_20_250"]\nstored = true\n',
}


def parsers(verb):
    """The parser of a verb by its name, or those of the pictures of plot by theirs."""

    def below(parser):
        actions = parser._actions
        return next((a.choices for a in actions if isinstance(a, argparse._SubParsersAction)), {})

    [parser] = below(cli._parser([verb])[0]).values()
    return {f"{verb} {name}": child for name, child in below(parser).items()} or {verb: parser}


def parser_of(name):
    return parsers(name.split()[0])[name]


def lines_with(name, values):
    """The line of a verb with each value for each option, and in the place of each word."""
    words = [*name.split(), *LINES[name].split()]
    for action in parser_of(name)._actions:
        flags = action.option_strings
        for value in values:
            if flags and not isinstance(action, argparse._HelpAction):
                yield [*words, f"{flags[-1]}={value}"]
                if flags[0] != flags[-1] and not flags[0].startswith("--"):
                    yield [*words, f"{flags[0]}{value}"]
    first = len(name.split())
    for place in range(first, len(words)):
        if not words[place].startswith("-") and not words[place - 1].startswith("-"):
            yield from ([*words[:place], value, *words[place + 1 :]] for value in values)


@pytest.fixture
def filled(tmp_path, monkeypatch):
    """A folder with what the lines name, and a solver that fails."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("FEMBRIDGE_CCX", "/bin/false")
    for name, text in FILES.items():
        Path(name).write_text(text, encoding="utf-8")
    shutil.copytree(ROOT / "fixtures" / "transient_sine", "run_folder")
    shutil.copy(ROOT / "fixtures" / "frd_samples" / "cpe4_bin_f64.frd", "job.frd")
    shutil.copy("run_folder/job.sta", "job.sta")
    return tmp_path


@pytest.fixture
def attempt(filled, capsys):
    """Run a command: 0, or one line and nothing written; the line."""

    def run(words, codes=(0, 1, 2)):
        before = set(filled.rglob("*"))
        code = cli.main(words)
        out, err = capsys.readouterr()
        assert code in codes, (words, err)
        if code:
            lines = [line for line in err.splitlines() if line.startswith("fembridge: ")]
            assert len(lines) == 1, (words, err)
        if code == 2:
            assert (out, err.count("\n")) == ("", 1), (words, err)
            assert set(filled.rglob("*")) == before, (words, err)
        assert not list(filled.rglob(".fembridge-draft*")), words
        return err

    return run


def test_every_verb_has_a_line():
    found = [name for verb in cli.VERBS for name in parsers(verb)]
    assert sorted(LINES) == sorted(found)


@pytest.mark.parametrize("name", LINES)
def test_numbers_are_read_in_one_way(name):
    """By a `Number`, with its range: not by `float` or `int`, which take nan and 1_000."""
    for action in parser_of(name)._actions:
        readers = {action.type, getattr(action, "item_type", None)}
        assert not readers & {float, int, complex}, (name, action.option_strings)
        defaults = action.default if isinstance(action.default, list) else [action.default]
        if action.nargs != 0 and any(isinstance(default, float | int) for default in defaults):
            assert any(isinstance(reader, Number) for reader in readers), action.option_strings


@pytest.mark.parametrize(
    "values", [FEW, pytest.param(MANY, marks=pytest.mark.slow)], ids=["few", "many"]
)
@pytest.mark.parametrize("name", LINES)
def test_no_value_of_an_option_is_more_than_a_line(name, values, attempt, monkeypatch):
    """The work itself is left out."""
    command = import_module(f"fembridge.commands.{name.split()[0].replace('-', '_')}")
    monkeypatch.setattr(command, "run", lambda args: {})
    attempt([*name.split(), *LINES[name].split()], codes=(0,))
    built = cli._parser([name.split()[0]])
    monkeypatch.setattr(cli, "_parser", lambda words: built)
    for words in lines_with(name, values):
        attempt(words, codes=(0, 2))


@pytest.mark.slow
@pytest.mark.usefixtures("unrendered", "in_this_process")
@pytest.mark.parametrize("name", sorted(LINES.keys() - COSTLY))
def test_no_value_of_an_option_breaks_the_work(name, attempt):
    lines = list(lines_with(name, (*FEW, *MANY)))
    for words in random.Random(26).sample(lines, min(len(lines), 60)):
        attempt(words)


def test_a_use_names_options_that_there_are():
    for verb in cli.VERBS:
        known = set().union(*(parser._option_string_actions for parser in parsers(verb).values()))
        command = import_module(f"fembridge.commands.{verb.replace('-', '_')}")
        for use in getattr(command, "USES", ()):
            assert set(use.options.split()) <= known, verb


@pytest.mark.parametrize(
    ("line", "needs"),
    [
        ("stimuli --seed 1", "--seed is for --export"),
        ("stimuli sine_20_250 --dt-ms 1", "--dt-ms is for a waveform in .npy"),
        ("stimuli --full-scale-um 1", "--full-scale-um is for a waveform in .wav"),
        ("stimuli --export csv sine_20_250 --seed 1", "--seed is for noise"),
        ("build-deck --stimulus sine_20_250 --base-deck a.inp --finger quick", "our finger"),
        ("build-deck --stimulus sine_20_250 --increments fixed", "--increments is for --base-deck"),
        ("build-deck --stimulus sine_20_250 --results text --ascii", "decks without --results"),
        ("build-deck --stimulus sine_20_250 --solver marc --whole-section", "--solver calculix"),
        ("build-deck --stimulus sine_20_250 --probe-fillet-mm 0.1", "--probe-shape flat"),
        ("simulate --stimulus sine_20_250 --stored --threads 2", "a solver, not for --stored"),
        ("simulate --stimulus sine_20_250 --stored --no-cache --yes", "--no-cache, --yes are for"),
        ("simulate --stimulus sine_20_250 --method map --jobs 2", "not for --method map"),
        ("simulate --stimulus sine_20_250 --dt-ms 1", "a waveform in .npy"),
        ("touch --press-um 300 --preindent-um 1e3", "--preindent-um is for --stimulus or --pins"),
        ("touch --press-um 300 --direction-deg 0", "--direction-deg is for --slide-mm-per-s"),
        ("touch --press-um 300 --slide-mm-per-s 9 --hold-ms 5", "without --slide-mm-per-s"),
        ("touch --stimulus sine_20_250 --ramp-ms 5", "--ramp-ms is for --press-um or --press-n"),
        ("touch --press-um 300 --friction 0.4", "--friction is for a shape that slides"),
        ("touch --press-um 300 --seed 3", "--seed is for --noise-mv more than 0"),
        ("touch --press-um 300 --pixel-mm 1", "--pixel-mm is for --shape FILE"),
        ("touch --press-um 300 --tile", "--tile is for --shape FILE"),
        ("touch --press-um 300 --shape a.csv --pixel-mm 1 --relief-mm 1", "FILE, a picture"),
        ("touch --pins pins.csv --shape punch", "--shape is for a shape, not for --pins"),
        ("receptive-field --afferent PC --endings-mm 1", "--afferent SA or RA"),
        ("receptive-field --afferent RA --sa-von-mises", "--afferent SA"),
        ("sweep study.toml --scheduler tcp://a:1", "--scheduler is for --executor dask"),
        ("sweep study.toml --executor dask --scheduler tcp://a:1 --jobs 2", "made here"),
        (
            "fit --observed rates.csv --spike-distance van_rossum",
            "--spike-distance is for --spikes",
        ),
        ("study --observed rates.csv --cells 3", "--cells is for --drive"),
        ("deflect --no-cache", "--no-cache is for --solver run"),
        ("deflect --stored --depth-mm 1", "--depth-mm is for --solver run"),
        ("plot mesh --probe-fillet-mm 0.1", "--probe-shape flat"),
        ("plot trace traces.csv --preindent-um 5", "--preindent-um is for a waveform"),
        ("plot raster spikes.csv --preindent-um 5", "--preindent-um is for a waveform"),
        ("ingest run_folder --node all --node-set NOPE", "chosen nodes, not for --node all"),
        ("ingest run_folder --node 5 --deck /missing", "--deck is for --node-set"),
        ("ingest run_folder --print-set NOPE", "--print-set is for --point"),
        ("ingest run_folder --increment last", "--increment is for --field"),
        ("ingest run_folder --derived principal", "--derived is for --vtu"),
        ("ingest run_folder --field STRESS --quantity stress", "--quantity is for a table at"),
        ("ingest run_folder --list -o a.csv", "--output is for what is written"),
        ("ingest job.frd --list --stress-unit kPa", "--stress-unit is for stress and lengths"),
        ("ingest job.sta --stress-unit kPa", "--stress-unit is for stress"),
        ("ingest job.frd --field DISP --stress-unit kPa", "for stress or forces"),
        (f"ingest {TRACES} --stress-unit kPa", "for columns whose names state no unit, not Pa"),
        (f"ingest {TRACES} --across-materials", "--across-materials is for stress or strain"),
        (f"ingest {TRACES} --afferents", "--afferents is for a file with a run.toml"),
        (f"ingest {TRACES} --quantity stress", "--quantity is stress"),
        ("ingest job.sta --quantity stress", "--quantity is for a table at"),
        ("ingest run_folder --field STRESS --modes", "--modes is for a table at nodes, or --vtu"),
        ("ingest run_folder --vtu v --across-materials", "--across-materials is for stress"),
        (
            "ingest job.frd --node 11 --quantity displacement --stress-unit kPa",
            "for stress or forces",
        ),
    ],
)
def test_an_option_that_the_chosen_way_does_not_use_is_refused(line, needs, attempt):
    assert needs in attempt(line.split(), codes=(2,))


def lines_of_docs():
    """Commands in README, docs and the verbs' examples, which all have to stay valid."""
    generated = {"_build", "commands"}
    docs = [
        page
        for page in (ROOT / "docs").rglob("*.md")
        if not {"decisions", *generated} & set(page.parts)
    ]
    pages = [ROOT / "README.md", *docs]
    for page in pages:
        for block in re.findall(r"^```[a-z]*\n(.*?)^```", page.read_text("utf-8"), re.M | re.S):
            for line in block.replace("\\\n", " ").splitlines():
                if line.startswith("fembridge "):
                    yield shlex.split(line, comments=True)[1:]
    for verb in cli.VERBS:
        module = import_module(f"fembridge.commands.{verb.replace('-', '_')}")
        yield shlex.split(module.EXAMPLE.partition(">")[0])[1:]


def test_commands_of_the_docs_are_valid(capsys, monkeypatch):
    lines = list(lines_of_docs())
    assert len(lines) > 40
    for words in lines:
        command = import_module(f"fembridge.commands.{words[0].replace('-', '_')}")
        monkeypatch.setattr(command, "run", lambda args: {})
        assert cli.main(words) == 0, (words, capsys.readouterr().err)
