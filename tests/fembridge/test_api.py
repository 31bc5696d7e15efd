"""What the commands do, as functions: the examples of their docstrings, and the files."""

import doctest
import importlib.util
import inspect
import pickle
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas
import pytest

import fembridge as fb
from decks.presets import finger_from
from fembridge.cli import main
from fembridge.errors import (
    FembridgeWarning,
    MissingError,
    ResponseError,
    ResultError,
    UsageError,
)
from fembridge.io.run_folder import read_run_folder
from fembridge.response.response_map import FOLDER, read_map
from fembridge.results import result
from neural import parameter_set

RECORDED = Path(__file__).parents[2] / "fixtures/transient_sine"


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch, in_this_process):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("FEMBRIDGE_CCX", raising=False)
    monkeypatch.setenv("PATH", "")


HOMES = [importlib.import_module(home) for home in sorted({*fb._HOMES.values(), "decks.presets"})]
SLOW = {
    f"fembridge.{name}"
    for name in (
        *("fitting.fit", "fitting.model_study", "fitting.thresholds", "reporting.explorer"),
        *("sweeps.sweep", "touching.receptive_field", "touching.touch"),
    )
}
MODULES = [
    pytest.param(home, id=home.__name__, marks=[pytest.mark.slow] * (home.__name__ in SLOW))
    for home in (fb, result, *HOMES)
    if ">>>" in inspect.getsource(home)
    and home.__name__ != "fembridge.reporting.validation"  # tested beside it
]


@pytest.mark.parametrize("module", MODULES)
def test_the_examples_are_true(tmp_path, module):
    shutil.copytree(RECORDED, tmp_path / "runs/sine_20_250")
    found = doctest.testmod(module, optionflags=doctest.ELLIPSIS)
    assert found.attempted
    assert not found.failed


def test_simulate_gives_what_the_command_writes(tmp_path):
    words = ["--stimulus", "sine_20_250,noise_25_250_20", "--no-plot", "-o", "out"]
    assert main(["simulate", *words]) == 0
    result = fb.simulate(["sine_20_250", "noise_25_250_20"])
    for frame, name in ((result.rates, "rates"), (result.spikes, "spikes")):
        pandas.testing.assert_frame_equal(frame, pandas.read_csv(f"out/{name}.csv"))
    result.write("again")
    for name in ("rates.csv", "spikes.csv", "traces.npz", "simulation.toml"):
        written = (tmp_path / "again" / name).read_bytes()
        assert written == (tmp_path / "out" / name).read_bytes()


def test_public_names_are_all_that_a_listing_shows():
    assert set(fb.__all__) <= set(dir(fb))
    private = {name for name in dir(fb) if name.startswith("_") and not name.startswith("__")}
    assert not private & set(dir(fb))
    assert not {"Any", "Path", "find_spec", "import_module", "TYPE_CHECKING"} & set(dir(fb))


def test_a_folder_without_a_run_is_refused_before_any_run():
    with pytest.raises(ResultError) as refused:
        fb.run(["nofolder"])
    assert refused.value.path == Path("nofolder")


@pytest.mark.parametrize("traces", [[1, 2, 3], [], 5, None])
def test_encode_names_the_types_that_it_takes(traces):
    with pytest.raises(UsageError, match="StressTrace") as refused:
        fb.encode(traces)
    assert refused.value.argument == "traces"


@pytest.fixture
def unmeshed(monkeypatch):
    """Fail where a mesh is made, read or changed."""
    from decks import mesh

    def refuse(self):
        raise AssertionError("a mesh was made")

    monkeypatch.setattr(mesh.Mesh, "__post_init__", refuse)


OWN_SKIN = finger_from({"skin": {"epidermis_mm": 0.5}}, "own")


@pytest.mark.parametrize(
    "answer",
    [
        lambda: fb.simulate("sine_20_250", stored=True),
        lambda: fb.simulate("sine_20_250", finger="paper"),  # without ccx on the PATH
        lambda: fb.simulate("sine_20_250", probe=fb.Probe(diameter_mm=1.0), stored=True),
        lambda: fb.threshold(["PC"], [250]),
        lambda: fb.deflect("paper"),
        lambda: fb.sweep({"stimuli": ["sine_20_250"], "stored": True}),
        lambda: main(["simulate", "--stimulus", "sine_20_250", "--stored", "-o", "out"]),
    ],
)
@pytest.mark.filterwarnings("ignore:parameter set fitted was fitted on finger 'quick'")
def test_a_stored_answer_needs_no_mesh(answer, unmeshed):
    assert answer() is not None


@pytest.mark.parametrize("finger", [OWN_SKIN, replace(OWN_SKIN, name="quick")])
def test_an_own_finger_without_a_stored_answer_is_refused_before_it_is_meshed(finger, unmeshed):
    with pytest.raises(ResponseError):
        fb.simulate("sine_20_250", finger=finger, stored=True)
    with pytest.raises(MissingError):
        fb.simulate("sine_20_250", finger=finger)  # without ccx on the PATH
    with pytest.raises(ResponseError):
        fb.threshold(["PC"], [250], finger=finger)
    with pytest.raises(UsageError) as refused:
        fb.deflect(finger)
    assert (refused.value.argument, refused.value.found) == ("finger", finger.name)


def test_a_file_without_a_stored_answer_is_refused_before_it_is_meshed(tmp_path, unmeshed):
    Path("own.toml").write_text("[skin]\nepidermis_mm = 0.5\n", encoding="utf-8")
    words = ["simulate", "--stimulus", "sine_20_250", "--finger", "own.toml"]
    assert main([*words, "--stored"]) == ResponseError.exit_code
    assert [path.name for path in tmp_path.iterdir()] == ["own.toml"]


TAP_UM = 200 * np.sin(np.pi * np.arange(101) / 100) ** 2
STRESS = fb.StressTrace(np.linspace(0, 2e4, 501), 0.5, 1, "SA")


@pytest.mark.parametrize(
    ("call", "argument", "found"),
    [
        (lambda: fb.simulate("sine_20_250", probe="flat"), "probe", "flat"),
        (lambda: fb.simulate("sine_20_250", analysis="linear"), "analysis", "linear"),
        (lambda: fb.simulate("sine_20_250", solver=4), "solver", 4),
        (lambda: fb.simulate("sine_20_250", parameters=5), "parameters", 5),
        (lambda: fb.simulate("sine_20_250", preindent_um="75"), "preindent_um", "75"),
        (lambda: fb.simulate("sine_20_250", preindent_um=-5), "preindent_um", -5),
        (lambda: fb.build_deck("sine_20_250", contact="stiff"), "contact", "stiff"),
        (lambda: fb.build_deck("sine_20_250", frames=2.5), "frames", 2.5),
        (lambda: fb.run(5), "folders", 5),
        (lambda: fb.run("runs/sine_20_250", solver=5), "solver", 5),
        (lambda: fb.read("runs/sine_20_250", 461), "nodes", 461),
        (lambda: fb.encode(STRESS, window_ms=5), "window_ms", 5),
        (lambda: fb.Waveform(TAP_UM, dt_ms=0.5, window_ms=5).stimuli(), "window_ms", 5),
        (lambda: fb.Solver(jobs="2"), "jobs", "2"),
        (lambda: fb.Solver(jobs=1.5), "jobs", 1.5),
        (lambda: fb.sweep(5), "study", 5),
        (lambda: fb.verify(only="nothing"), "only", "nothing"),
    ],
)
def test_a_value_of_another_type_is_named(tmp_path, call, argument, found):
    shutil.copytree(RECORDED, tmp_path / "runs/sine_20_250")
    with pytest.raises(UsageError) as refused:
        call()
    assert (refused.value.argument, refused.value.found) == (argument, found)
    assert refused.value.expected


def test_a_long_value_is_cut_in_a_message_and_whole_in_the_field():
    with pytest.raises(UsageError) as refused:
        fb.encode(TAP_UM)
    assert len(str(refused.value)) < 400
    assert "\n" not in str(refused.value)
    assert refused.value.found is TAP_UM


def test_encode_takes_a_simulation_and_a_run_as_they_are(tmp_path):
    tap = fb.Waveform(TAP_UM, dt_ms=0.5, name="tap")
    simulation = fb.simulate([tap, "sine_20_250"], parameters="published", stored=True)
    encoding = fb.encode(simulation)
    pandas.testing.assert_frame_equal(encoding.spikes, simulation.spikes)
    pandas.testing.assert_frame_equal(encoding.rates, simulation.rates)
    assert encoding.parameters.name == "published"
    simulation.write("out")
    assert encoding.provenance == fb.encode("out").provenance

    shutil.copytree(RECORDED, tmp_path / "runs/sine_20_250")
    run = read_run_folder(tmp_path / "runs/sine_20_250")
    encoding = fb.encode(run, parameters="published")
    assert encoding.rates.equals(fb.encode(run.folder, parameters="published").rates)


def test_one_class_or_frequency_needs_no_list():
    assert (
        fb.encode(replace(STRESS, afferent=None), afferents="SA").rates["afferent"].item() == "SA"
    )
    one, listed = fb.threshold("PC", 250), fb.threshold(["PC"], [250])
    pandas.testing.assert_frame_equal(one.table, listed.table)


def test_samples_in_metres_are_doubted():
    with pytest.warns(FembridgeWarning, match=r"0\.0002 um"):
        fb.Waveform(1e-6 * TAP_UM, dt_ms=0.5).stimuli()


def test_a_folder_without_results_is_refused_with_the_files_that_were_expected(tmp_path):
    with pytest.raises(ResultError) as refused:
        fb.read(tmp_path)
    assert refused.value.path == tmp_path
    assert "job.frd" in refused.value.expected


def test_no_module_hides_a_public_function():
    """A submodule that was imported is an attribute of its package, whatever it hides."""
    for name in fb.__all__:
        assert importlib.util.find_spec(f"fembridge.{name}") is None


def test_values_are_shown_in_a_notebook_without_their_samples():
    two = fb.simulate(["sine_20_250", "sine_50_250"], stored=True)
    waveform = fb.Waveform(TAP_UM, dt_ms=0.5)
    [run] = fb.build_deck(waveform)
    [outcome] = fb.run(run)
    parameters = parameter_set("fitted")
    values = (
        two.to_recording(),
        read_map(FOLDER / "quick.toml"),
        fb.read_observed(two.rates),
        two,
        two.stimuli[0],
        two.traces[0][0],
        waveform,
        run,
        outcome,
        parameters,
    )
    shown = " ".join(map(repr, values))
    assert all(len(repr(value)) < 300 for value in values)
    assert "101 samples" in shown
    assert "calculix" in shown
    assert "sine_20_250" in shown
    assert "501 samples" in shown


RESULTS = {
    "simulation": lambda: fb.simulate("sine_20_250", stored=True),
    "encoding": lambda: fb.encode(
        fb.simulate("sine_20_250", stored=True),
        parameters=replace(parameter_set("fitted"), name="mine"),
    ),
    "touch": lambda: fb.touch("punch", press_um=200, population="one_each"),
    "receptive field": lambda: fb.receptive_field("RA", depth_um=[200], step_mm=1.0),
    "thresholds": lambda: fb.threshold(["RA"], [20, 250]),
    "fit": lambda: fb.fit(
        fb.simulate("sine_20", stored=True).rates,
        afferents=["SA"],
        search=fb.Search(evaluations=40, population=20),
    ),
    "deck response": lambda: fb.DeckResponse(read_map(FOLDER / "quick.toml")),
    "deflections": fb.deflect,
    "sweep": lambda: fb.sweep({"stimuli": ["sine_20_250"], "stored": True}),
}


@pytest.mark.parametrize("name", RESULTS)
def test_a_result_goes_to_another_process_and_back(name):
    result = RESULTS[name]()
    again = pickle.loads(pickle.dumps(result))
    assert repr(again) == repr(result)
    assert again.provenance == result.provenance


@pytest.mark.parametrize("name", ["published", "fitted"])
def test_a_shipped_parameter_set_is_the_same_after_pickling(name):
    shipped = parameter_set(name)
    assert pickle.loads(pickle.dumps(shipped)) is shipped


@pytest.mark.parametrize("finger", [None, "quick", fb.Finger("quick")])
def test_a_population_takes_a_finger_as_simulate_does(finger):
    units = fb.Population.one_each(finger=finger)
    pandas.testing.assert_frame_equal(units.to_frame(), fb.Population.one_each().to_frame())


def test_a_wrong_key_of_a_study_is_one_error_without_a_chain():
    with pytest.raises(UsageError) as refused:
        fb.sweep({"stimuli": ["sine_20_250"], "finger": "quick"})
    assert (refused.value.key, refused.value.__cause__) == ("finger", None)
    assert refused.value.__context__ is None


def test_the_deflections_are_drawn_into_axes_of_the_caller():
    from matplotlib.figure import Figure

    figure = Figure()
    axes = figure.subplots(1, 3)
    assert fb.deflect().plot(ax=axes) is figure
    assert axes[0].yaxis_inverted()
    assert fb.deflect("quick").plot(ax=axes[:2]) is figure
    with pytest.raises(UsageError) as refused:
        fb.deflect().plot(ax=axes[0])
    assert refused.value.argument == "ax"


SHAPES = [
    *(
        getattr(fb.Shape, name)()
        for name in ("punch", "sphere", "cylinder", "plate", "bar", "edge", "grating", "dots")
    ),
    fb.Shape.braille("A b"),
    fb.Shape.letters("O"),
    fb.Shape.from_heights(np.array([[0.1, np.nan], [0.0, 0.2]]), 0.5).rotated(30).moved(1, 2),
]


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.name)
def test_a_shape_goes_to_another_process_and_back(shape):
    again = pickle.loads(pickle.dumps(shape))
    x_mm, z_mm = np.meshgrid(np.linspace(-4, 4, 41), np.linspace(-3, 3, 31))
    np.testing.assert_array_equal(again.height_mm(x_mm, z_mm), shape.height_mm(x_mm, z_mm))
    assert (repr(again), again.to_table()) == (repr(shape), shape.to_table())


@pytest.mark.parametrize(
    "name",
    [
        *("Simulation", "Encoding", "Touch", "ReceptiveField", "Thresholds"),
        *("Fit", "Sweep", "Validation", "Deflections", "ModelStudy", "DeckResponse"),
    ],
)
def test_a_result_is_drawn_written_and_read_in_one_way(name):
    result = getattr(fb, name)
    assert [*inspect.signature(result.plot).parameters] == ["self", "kind", "ax"]
    for method in (result.write, result.read):
        assert "folder" in inspect.signature(method).parameters
    assert "provenance" in {*dir(result), *inspect.signature(result).parameters}
