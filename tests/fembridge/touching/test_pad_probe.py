"""The map of a probe on a pad: against whole touches, and what fits and thresholds make of it."""

import shlex
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import fembridge as fb
from fembridge.cli import main
from fembridge.errors import FembridgeError, FembridgeWarning, ResponseError, UsageError
from fembridge.fitting.problem import fit_problem
from fembridge.fitting.thresholds import FORCE_COLUMNS
from fembridge.io.observed_rates import read_observed
from fembridge.response.response_map import read_map, write_map
from fembridge.touching.fingerprint import Fingerprint
from fembridge.touching.pad_file import STORED
from neural.models import model_named
from neural.parameter_sets import parameter_set
from neural.parameters import quantiles

STIMULI = ("sine_20_179.92", "sine_100_130.37", "sine_300_50", "noise_25_250_20")
CLASSES = ("SA", "RA", "PC")


@pytest.fixture(scope="module")
def ridged():
    """The default probe: a pin of 1 mm at three positions on the ridged reference pad."""
    return fb.PadProbe()


@pytest.fixture(scope="module")
def smooth():
    """The same pin on smooth skin."""
    return fb.PadProbe(ridges="none")


def touch_at(probe, stimulus, position_mm):
    """A touch of ten cells of each class, with one ending and sign 1, at one position."""
    skin, cells = probe.skin(), 10
    x_mm, z_mm = np.repeat(position_mm[:, np.newaxis], 3 * cells, axis=1)
    deviate = np.tile(quantiles(cells), 3)
    names = np.repeat(CLASSES, cells).tolist()
    units = fb.Population.at(names, x_mm, z_mm, deviate=deviate, finger=skin).with_endings(0.0)
    units = replace(units, endings_seed=np.full(len(units), 5))
    assert (units.sign == 1).all()
    return fb.touch(
        probe.shape,
        stimulus=stimulus,
        population=units,
        pad=skin,
        ridges=probe.ridges,
        at_mm=tuple(position_mm),
    )


@pytest.mark.parametrize(("ridges", "largest"), [("none", 0.003), (None, 0.015)])
def test_a_fit_sees_the_stress_and_predicts_the_rates_of_touches(ridges, largest):
    """Stress within a share of its swing: the depths at which contact is solved differ.

    A cell that fires in every cycle or in every other one is 5 % of the rate of ten.
    """
    probe = fb.PadProbe(ridges=ridges)
    fitted = parameter_set("fitted_pad")
    for stimulus in STIMULI:
        touches = [
            touch_at(probe, stimulus, position_mm)
            for position_mm in probe.positions_mm(probe.skin())
        ]
        simulation = fb.simulate(stimulus, response=probe, parameters=fitted)
        by_map = simulation.rates.groupby("afferent")["rate_ips"].mean()
        for row, name in enumerate(CLASSES):
            traces = [trace for trace in simulation.traces[0] if trace.afferent == name]
            for touch, trace in zip(touches, traces, strict=True):
                [stress_pa] = touch.stress_of([10 * row]).T
                difference_pa = np.abs(stress_pa - trace.stress_pa[::5]).max()
                assert difference_pa < largest * np.ptp(stress_pa)
        touched = pd.concat([touch.rates for touch in touches])
        touched = touched.groupby("afferent")["rate_ips"].mean()
        for name in CLASSES:
            assert by_map[name] == pytest.approx(touched[name], rel=0.05, abs=1.0)


def test_rates_of_a_fit_are_means_over_the_positions(ridged):
    fitted = parameter_set("fitted_pad")
    simulated = fb.simulate(STIMULI, response=ridged, parameters=fitted).rates
    assert sorted(simulated["unit"].unique()) == ["1", "2", "3"]
    means = simulated.groupby(["stimulus", "afferent"], sort=False)["rate_ips"].mean()
    observed = read_observed(means.reset_index())
    for name in CLASSES:
        parameters = fitted.parameters[name]
        model = model_named(parameters.drive, name)
        problem = fit_problem(
            observed, ridged.response, model, families=("sine", "noise"), preindent_um=75.0
        )
        values = [getattr(parameters, free.field) for free in problem.free]
        assert problem.stress_pa.shape[1:] == (4, 3)
        assert_allclose(problem.rates_ips(np.array(values))[0], problem.observed_ips, rtol=1e-9)


def test_forces_of_the_map_are_those_of_touches(ridged, smooth):
    for probe in (ridged, smooth):
        forces_n = [
            fb.touch(
                press_um=200,
                population="one_each",
                pad=probe.skin(),
                ridges=probe.ridges,
                at_mm=tuple(position_mm),
            ).force_n.max()
            for position_mm in probe.positions_mm(probe.skin())
        ]
        assert_allclose(probe.response.force_at_n(np.array(200.0)), np.mean(forces_n), rtol=0.01)
    assert probe.response.force_at_n(np.array([-50.0, 0.0])).tolist() == [0.0, 0.0]


@pytest.mark.parametrize(("pattern", "across"), [("across", (0, 1)), ("along", (1, 0))])
def test_positions_are_parts_of_a_ridge_apart_across_the_ridges(pattern, across):
    probe = fb.PadProbe(ridges=f"{pattern}:period_mm=0.6", positions=4, at_mm=(0.5, -1.0))
    steps = np.diff(probe.positions_mm(probe.skin()), axis=0)
    assert_allclose(np.abs(steps), np.tile(0.15 * np.array(across), (3, 1)), atol=1e-9)
    assert_allclose(probe.positions_mm(probe.skin()).mean(axis=0), [0.5, -1.0], atol=1e-12)


@pytest.mark.parametrize("pattern", ["loop", "whorl", "across", "along"])
def test_the_direction_across_ridges_is_that_of_their_steepest_slope(pattern):
    ridges = Fingerprint(pattern, seed=2)
    angles = np.linspace(0, np.pi, 721)
    for at_mm in ((0.0, 0.0), (2.0, 3.0), (-3.0, 1.0)):
        step_mm = 0.002
        around = np.array([np.cos(angles), np.sin(angles)]) * step_mm
        phase = ridges._turns(at_mm[0] + around[0], at_mm[1] + around[1])
        phase -= ridges._turns(np.array(at_mm[0]), np.array(at_mm[1]))
        steepest = around[:, np.abs(phase).argmax()] / step_mm
        assert abs(np.dot(steepest, ridges.across(*at_mm))) > 0.999


def test_skin_without_ridges_has_one_position(smooth):
    assert not smooth.response.is_mean
    assert smooth.positions_mm(smooth.skin()).tolist() == [[0.0, 0.0]]
    flat = fb.PadProbe(ridges="loop:height_mm=0")
    assert len(flat.positions_mm(flat.skin())) == 1


def test_a_map_of_a_probe_is_read_as_it_was_written(tmp_path, ridged):
    write_map(tmp_path / "map.toml", ridged.response)
    back = read_map(tmp_path / "map.toml")
    assert back.is_mean
    for name in ("depth_um", "tensor_pa", "force_n"):
        assert_array_equal(getattr(back, name), getattr(ridged.response, name))
    assert back.origin["mechanics"] == ridged.response.origin["mechanics"]
    text = (tmp_path / "map.toml").read_text(encoding="utf-8")
    assert str(tmp_path) not in text


@pytest.mark.slow
def test_thresholds_have_the_force_of_the_probe(tmp_path, ridged):
    result = fb.threshold(["RA", "SA"], [20, 200], pad=ridged, output=tmp_path / "out")
    table, depth_um = result.table, 75.0
    reached = table["amplitude_um"].notna()
    assert reached.sum() >= 6
    force_mn = 1000 * ridged.response.force_at_n(depth_um + table.loc[reached, "amplitude_um"])
    assert_allclose(table.loc[reached, "force_mn"], force_mn)
    at_rest_mn = 1000 * float(ridged.response.force_at_n(np.array(depth_um)))
    assert_allclose(table.loc[reached, "force_amplitude_mn"], force_mn - at_rest_mn)
    assert table.loc[~reached, list(FORCE_COLUMNS)].isna().all(axis=None)
    back = fb.Thresholds.read(tmp_path / "out").table
    assert list(back) == list(table)
    assert_allclose(back["force_mn"], table["force_mn"])
    on_section = fb.threshold(["RA"], [20]).table
    assert not set(FORCE_COLUMNS) & set(on_section)


def test_a_threshold_on_ridges_is_between_those_of_its_positions(ridged):
    at_each = [
        fb.threshold(["RA"], [50], response=ridged, unit=f"RA={unit}", parameters="fitted_pad")
        for unit in "123"
    ]
    [amplitude_um, *_] = fb.threshold(["RA"], [50], pad=ridged).table["amplitude_um"]
    each_um = [result.table["amplitude_um"][0] for result in at_each]
    assert min(each_um) <= amplitude_um <= max(each_um)
    assert min(each_um) < max(each_um)


def test_a_fit_of_a_probe_of_ones_own_states_its_mechanics(tmp_path, smooth, capsys):
    rates = fb.simulate("sine_20", response=smooth, parameters="fitted_pad").rates
    rates.to_csv(tmp_path / "rates.csv", index=False)
    words = ["fit", "--observed", str(tmp_path / "rates.csv"), "--pad", "reference", "--afferent"]
    words += ["PC", "--shape", "punch:diameter_mm=2", "--at-mm", "0.5", "-1", "--positions", "2"]
    words += ["--evaluations", "40", "--population", "20", "--name", "mine"]
    assert main([*words, "-o", str(tmp_path / "fit")]) == 0
    table = tomllib.loads((tmp_path / "fit" / "fitted.toml").read_text(encoding="utf-8"))
    response = table["fit"]["response"]
    assert table["name"] == "mine"
    assert table["preindent_um"] == 75.0
    assert response["pad"] == "reference"
    assert response["ridges"] == "0.44 mm apart, 0.1 mm high"
    assert response["probe"] == "punch 2 mm"
    assert (response["at_mm"], response["positions"]) == ([0.5, -1.0], 2)
    assert len(response["pad_sha256"]) == 64
    read = fb.Fit.read(tmp_path / "fit")
    assert read.name == "mine"
    assert dict(read.parameters.mechanics)["probe"] == "punch 2 mm"
    capsys.readouterr()


def test_a_study_compares_models_under_a_probe(smooth):
    rates = fb.simulate(
        ["sine_20", "sine_50"], response=smooth, parameters="fitted_pad"
    ).rates.query("afferent == 'RA'")
    result = fb.study(rates, drive="rising", seeds=[1], evaluations=200, pad=smooth)
    assert result.provenance["response"]["pad"] == "reference"
    by_response = fb.study(rates, drive="rising", seeds=[1], evaluations=200, response=smooth)
    assert result.trials.equals(by_response.trials)


@pytest.mark.parametrize(
    ("changes", "argument"),
    [
        ({"pad": "plane"}, "pad"),
        ({"pad": "no_such_pad"}, "pad"),
        ({"positions": 0}, "positions"),
        ({"deepest_um": 3000.0}, "deepest_um"),
        ({"at_mm": (1.0, 2.0, 3.0)}, "at_mm"),
        ({"pad": "fingertip", "ridges": "loop"}, "ridges"),
        ({"shape": "nothing"}, "shape"),
    ],
)
def test_what_is_no_probe_on_a_pad_is_refused(changes, argument):
    with pytest.raises(UsageError) as refused:
        fb.PadProbe(**changes).response  # noqa: B018 - computed when it is asked for
    assert refused.value.argument == argument


def test_a_probe_beside_the_skin_is_refused():
    with pytest.raises(FembridgeError):
        fb.PadProbe(at_mm=(30.0, 0.0)).response  # noqa: B018 - computed when it is asked for


@pytest.mark.parametrize("verb", ["threshold", "study", "validate", "fit"])
@pytest.mark.parametrize("words", [["--shape", "sphere"], ["--positions", "2"]])
def test_options_of_the_probe_are_for_a_pad(verb, words, capsys):
    observed = ["--observed", "rates.csv"] if verb in ("fit", "study") else []
    assert main([verb, *observed, *words, "--json"]) == 2
    assert words[0] in capsys.readouterr().out


def test_a_pad_and_another_source_of_stress_are_refused(smooth):
    for other in ({"finger": "quick"}, {"response": smooth}):
        with pytest.raises(UsageError) as refused:
            fb.threshold(["PC"], [100], pad=smooth, **other)
        assert refused.value.argument == next(iter(other))
    with pytest.raises(UsageError) as refused:
        fb.validate(pad=smooth, response=smooth)
    assert refused.value.argument == "response"


def test_a_mesh_is_probed_as_it_is():
    """A round fingertip: no ridges of ours, and other mechanics than the shipped set's."""
    probe = fb.PadProbe(pad="fingertip_macaque")
    response = probe.response
    assert (len(response.places), response.is_mean) == (3, False)
    assert response.force_n[-1] > response.force_n[1] > 0
    with pytest.warns(FembridgeWarning, match="fitted_pad was fitted"):
        table = fb.threshold(["PC"], [200], pad=probe).table
    assert (table["force_amplitude_mn"] > 0).all()


def test_a_stimulus_deeper_than_the_map_is_refused():
    with pytest.raises(ResponseError) as refused:
        fb.simulate("sine_20_250", response=fb.PadProbe(deepest_um=200, ridges="none"))
    assert refused.value.found > 200


@pytest.mark.slow
@pytest.mark.usefixtures("unrendered")
def test_the_worked_example_of_the_documentation_runs(tmp_path, monkeypatch, capsys, recwarn):
    """On a stored pad of a mesh, a short search, and without the page."""
    docs = Path(__file__).parents[3] / "docs"
    text = (docs / "how_to" / "own_pad.md").read_text(encoding="utf-8")
    _, _, section = text.partition("## Afferents of your own pad")
    block = section.split("```sh\n", 1)[1].split("```", 1)[0]
    commands = [shlex.split(line) for line in block.splitlines()]
    assert [words[1] for words in commands] == ["fit", "threshold", "touch", "validate"]
    monkeypatch.chdir(tmp_path)
    shutil.copyfile(STORED / "fingertip_macaque.npz", "mine.npz")
    fb.simulate("sine", stored=True).rates.to_csv("rates.csv", index=False)
    commands[0] += ["--evaluations", "60", "--population", "20"]
    few = ["--population", "one_each", "--no-plot"]
    commands[2] += few
    for words in commands[:-1]:
        assert main(words[1:]) == 0
    fitted = parameter_set(Path("fit/fitted.toml"))
    assert (fitted.name, fitted.mechanics["pad"]) == ("mine", "mine.npz")
    assert not [str(item.message) for item in recwarn if "was fitted" in str(item.message)]
    assert "was fitted on" not in capsys.readouterr().err
    words = ["touch", "--parameters", "fit/fitted.toml", "--press-n", "0.1", *few]
    assert main(words) == 0
    assert "parameter set mine was fitted on" in capsys.readouterr().err
