"""build-deck, run, ingest and encode, without options, against simulate."""

import shutil
import tomllib
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pandas
import pytest
import tomli_w

import fembridge as fb
from fembridge.cli import main
from fembridge.errors import FembridgeError, FembridgeWarning, ParameterError
from fembridge.io.run_folder import read_run_folder
from fembridge.io.spike_table import read_rates, read_spikes
from fembridge.io.trace_table import read_traces
from fembridge.response.response_map import MAP_FILE, read_map
from neural import parameter_set
from neural.parameter_sets import FITTED_FILE

pytestmark = pytest.mark.usefixtures("here")
RECORDED = Path(__file__).parents[2] / "fixtures/transient_sine"


@pytest.mark.slow
@pytest.mark.solver
def test_four_verbs_without_options_are_one(here, logged):
    """From Python and by commands; the transient of the chain against the map of simulate.

    The map is solved, read again from its folder, and gives what the stored one gives.
    """
    preindent_um = parameter_set("fitted").preindent_um
    wave_um = preindent_um + 60.0 * np.sin(2e-3 * np.pi * 100.0 * 0.5 * np.arange(31))
    stimulus = fb.Stimulus("mine", wave_um, 0.5, (5.0, 15.0), preindent_um)
    lines = logged
    at_once = fb.simulate(stimulus, solver=fb.Solver(runs_folder="out"))
    assert at_once.origin["method"] == "map"
    again = fb.simulate(stimulus, solver=fb.Solver(runs_folder="out"))
    stored = fb.simulate(stimulus, stored=True)
    assert any("response of finger 'quick' solved in " in one for one in lines)
    assert any("'quick' reused: 39 increments" in one for one in lines)
    for other in (again, stored):
        pandas.testing.assert_frame_equal(other.spikes, at_once.spikes)
        pandas.testing.assert_frame_equal(other.rates, at_once.rates)
    assert read_map(here / "out/response" / MAP_FILE).closure_percent < 0.5

    [run] = fb.build_deck(stimulus)
    [outcome] = fb.run(run)
    assert outcome.accepted
    spikes = fb.encode(fb.read(run)).spikes
    assert main(["ingest", str(run.folder), "-o", "traces.csv"]) == 0
    assert main(["encode", "traces.csv", "--no-raster", "-o", "encoded"]) == 0

    assert len(spikes) > 10
    # Of the transient, stress between samples is interpolated: a spike may move by one step.
    step_ms = parameter_set("fitted").parameters["SA"].dt_ms
    pandas.testing.assert_frame_equal(spikes, at_once.spikes, rtol=0, atol=1.5 * step_ms)
    at_once.write("out")
    assert tomllib.loads((here / "out/simulation.toml").read_text("utf-8"))["source"] == "CalculiX"
    assert (here / "encoded/rates.csv").read_bytes() == (here / "out/rates.csv").read_bytes()
    written = pandas.read_csv(here / "encoded/spikes.csv")
    expected = pandas.read_csv(here / "out/spikes.csv")
    pandas.testing.assert_frame_equal(written, expected, rtol=0, atol=1.5 * step_ms)


@pytest.mark.parametrize(
    ("words", "depth_um", "name"),
    [
        ([], 75.0, "fitted"),
        (["--parameters", "published"], 0.0, "published"),
        (["--preindent-um", "10"], 10.0, "fitted"),
        (["--parameters", "mine.toml"], 75.0, "mine"),
    ],
)
def test_run_toml_names_set_and_depth(here, words, depth_um, name):
    (here / "mine.toml").write_text("base = 'fitted'\n[SA]\ntau_ms = 50.0\n", encoding="utf-8")
    assert main(["build-deck", "--stimulus", "sine_20_250", *words]) == 0
    origin = read_run_folder(here / "runs/sine_20_250").origin()
    assert (origin.preindent_um, origin.parameters["name"]) == (depth_um, name)
    assert (origin.stimulus, origin.finger["name"]) == ("sine_20_250", "quick")
    assert (len(origin.parameters) > 1) == (name == "mine")  # of ones own all of it


def test_a_deck_of_ones_own_stays_where_it_is(here):
    assert main(["build-deck", "--stimulus", "sine_20_250", "--parameters", "published"]) == 0
    base = here / "runs/sine_20_250/job.inp"
    words = ["--base-deck", str(base), "--afferent", "SA=461", "-o", "own"]
    assert main(["build-deck", "--stimulus", "sine_20_250", *words]) == 0
    origin = read_run_folder(here / "own/sine_20_250").origin()
    assert (origin.preindent_um, origin.parameters) == (0.0, {"name": "fitted"})
    assert origin.finger["name"] == "job.inp"


@pytest.fixture
def recorded(here):
    """A recorded run, whose ``run.toml`` names Table 2 as the set."""
    folder = here / "run"
    shutil.copytree(RECORDED, folder)
    with (folder / "run.toml").open("a", encoding="utf-8") as file:
        file.write('\n[inputs.parameters]\nname = "published"\n')
    return folder


def encoded(*words):
    assert main(["encode", "traces.csv", "--no-raster", *words]) == 0
    return read_spikes(Path("encoded/spikes.csv")), read_rates(Path("encoded/rates.csv"))


@pytest.mark.usefixtures("recorded")
def test_what_the_run_names_travels_with_the_table(here, capsys):
    assert main(["ingest", "run", "-o", "traces.csv"]) == 0
    traces = read_traces(here / "traces.csv")
    assert traces.origin == fb.read("run").origin
    capsys.readouterr()

    trains, rates = encoded()

    assert capsys.readouterr().err == ""  # no other finger, no other depth, a window
    assert {train.stimulus for train in trains} == {traces.origin.stimulus}
    first, last = traces.origin.window_ms
    for rate in rates:
        [mine] = [train.times_ms for train in trains if train.afferent == rate.afferent] or [[]]
        inside = sum(first < time <= last for time in mine)
        assert rate.rate_ips == pytest.approx(1000.0 * inside / (last - first))
    other, _ = encoded("--parameters", "fitted", "--stimulus", "else")
    assert {train.stimulus for train in other} == {"else"}
    assert max(train.cell for train in other) == 10


@pytest.mark.usefixtures("recorded")
def test_a_table_that_was_changed_is_of_no_run(here, capsys):
    assert main(["ingest", "run", "-o", "traces.csv"]) == 0
    with (here / "traces.csv").open("a", encoding="utf-8") as file:
        file.write("\n")
    capsys.readouterr()
    encoded()
    shown = capsys.readouterr().err
    assert "traces.csv.toml: of another table than traces.csv, not used" in shown
    assert "'quick'" in shown


@pytest.mark.usefixtures("recorded")
def test_a_table_of_no_run_takes_an_old_record_away(here):
    assert main(["ingest", "run", "-o", "traces.csv"]) == 0
    shutil.copy("run/job.frd", "alone.frd")
    node = fb.read("run")[0].node
    assert main(["ingest", "alone.frd", "--node", str(node), "-o", "traces.csv"]) == 0
    assert not (here / "traces.csv.toml").exists()


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ('name = "published"', 'name = "other"', "name"),
        ('name = "published"', "tau_ms = 3", "tau_ms"),
        ("window_ms = [", "window_ms = [1.0, ", "inputs.window_ms"),
        ("preindent_um = ", "preindent_um = '1' #", "inputs.preindent_um"),
    ],
)
def test_a_run_with_an_invalid_origin_is_refused_by_key(recorded, old, new, key):
    text = (recorded / "run.toml").read_text(encoding="utf-8")
    assert old in text
    (recorded / "run.toml").write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(FembridgeError) as caught:
        fb.encode(fb.read("run"))
    assert caught.value.key == key


@pytest.mark.parametrize(
    ("finger", "name"), [("quick.toml", "fitted"), ("quick", "mine"), ("quick", "fitted")]
)
def test_a_finger_of_the_same_name_is_distinguished_where_a_set_is_used(here, finger, name):
    """The run's is another one than the preset, or the preset than that of the fit, or none."""
    (here / "quick.toml").write_text("name = 'quick'\n[materials.dermis]\nyoung_mpa = 0.06\n")
    fit = "[fit.response]\nfinger = 'quick'\nfinger_sha256 = 'ab'\n"
    (here / "mine.toml").write_text(f"base = 'fitted'\n{fit}", encoding="utf-8")
    same = (finger, name) == ("quick", "fitted")
    deck = {"stimulus": "sine_20_250", "finger": finger}
    traces, parameters = fb.read(RECORDED), "mine.toml" if name == "mine" else name
    with nullcontext() if same else pytest.warns(FembridgeWarning, match="'quick'"):
        [run] = fb.build_deck(**deck, parameters=parameters)
    traces.origin = run.origin()
    with nullcontext() if same else pytest.warns(FembridgeWarning, match="'quick'"):
        fb.encode(traces, parameters=parameters)


def test_a_run_keeps_the_equations_that_its_set_was_fitted_with(here):
    """So that a version with another one refuses the numbers, as of the set's own file."""
    shipped = tomllib.loads(FITTED_FILE.read_text("utf-8"))
    (here / "mine.toml").write_text(tomli_w.dumps({**shipped, "name": "mine"}), encoding="utf-8")
    [run] = fb.build_deck("sine_20_250", parameters="mine.toml")
    fb.simulate("sine_20_250", stored=True, parameters="mine.toml").write("out")
    for path in (run.folder / "run.toml", here / "out/simulation.toml"):
        text = path.read_text("utf-8")
        equation = shipped["fit"]["SA"]["equation"]
        assert equation in text
        path.write_text(text.replace(equation, "I' = 0"), encoding="utf-8")
    traces = fb.read(RECORDED)
    traces.origin = read_run_folder(run.folder).origin()
    for source in (traces, "out"):
        with pytest.raises(ParameterError) as caught:
            fb.encode(source)
        assert caught.value.key == "fit.SA.equation"
