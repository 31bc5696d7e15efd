"""One warning, in one sentence, wherever a parameter set meets other mechanics than its fit's."""

import argparse
import warnings
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import pytest

import fembridge as fb
from fembridge.cli import VERBS, main
from fembridge.errors import FembridgeWarning
from fembridge.reporting import validation_data
from fembridge.response.response_map import write_map
from fembridge.solver.mechanics import check_mechanics, fit_mismatch
from fembridge.touching.pad_file import resolve_pad
from fembridge.touching.ridged_pad import with_ridges
from neural.parameter_sets import ParameterSet, parameter_set

SET = """\
base = "fitted_pad"
name = "mine"

[fit.response]
finger = "my finger"
finger_sha256 = "00"
pad = "mine.npz"
ridges = "0.5 mm apart, 0.1 mm high"
probe = "punch 0.7 mm"
"""
WORDS = "parameter set mine was fitted on a pad of finger 'my finger' with ridges 0.5 mm apart"
TOUCH = ["--press-um", "100", "--population", "one_each", "--no-plot"]


@pytest.fixture
def here(tmp_path, monkeypatch, in_this_process):
    """Work in a folder with a parameter set, the folders of its results, and a study."""
    monkeypatch.chdir(tmp_path)
    Path("mine.toml").write_text(SET, encoding="utf-8")
    Path("study.toml").write_text(
        'stimuli = ["sine_20_250"]\nstored = true\nparameters = "mine.toml"\n', encoding="utf-8"
    )
    mine = parameter_set(Path("mine.toml"))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FembridgeWarning)
        fb.simulate("sine_20_250", stored=True, parameters=mine).write("simulated")
        fb.touch(press_um=100, population="one_each", parameters=mine).write("touched")
    return tmp_path


class StopError(Exception):
    """The rest of the page is not needed."""


@pytest.fixture
def short_validation(monkeypatch):
    """End a validation where it would simulate."""

    def stop(*_):
        raise StopError

    monkeypatch.setattr(validation_data, "_simulated", stop)


PYTHON = {
    "simulate": lambda: fb.simulate("sine_20_250", stored=True, parameters="mine.toml"),
    "simulate by a map": lambda: fb.simulate(
        "sine_20_250", response=fb.PadProbe(), parameters="mine.toml"
    ),
    "encode": lambda: fb.encode("simulated", parameters="mine.toml"),
    "encode with the set of the run": lambda: fb.encode("simulated"),
    "touch": lambda: fb.touch(press_um=100, population="one_each", parameters="mine.toml"),
    "receptive_field": lambda: fb.receptive_field(
        "SA", depth_um=[200], step_mm=1.0, parameters="mine.toml"
    ),
    "threshold": lambda: fb.threshold(["PC"], [100], parameters="mine.toml"),
    "threshold on a pad": lambda: fb.threshold(
        ["PC"], [100], parameters="mine.toml", pad="reference"
    ),
    "sweep": lambda: fb.sweep("study.toml", "swept"),
    "validate": lambda: fb.validate(parameters="mine.toml"),
    "validate on a pad": lambda: fb.validate(parameters="mine.toml", pad="reference"),
    "report of a simulation": lambda: fb.report("simulated"),
    "report of a touch": lambda: fb.report("touched"),
    "build_deck": lambda: fb.build_deck("sine_20_250", "runs", parameters="mine.toml"),
}
COMMANDS = {
    "simulate": ["--stimulus", "sine_20_250", "--stored", "--no-plot", "-o", "out"],
    "encode": ["simulated", "-o", "out"],
    "touch": [*TOUCH, "-o", "out"],
    "receptive-field": ["--afferent", "SA", "--depth-um", "200", "--step-mm", "1", "-o", "out"],
    "threshold": ["--afferent", "PC", "--frequencies-hz", "100", "-o", "out"],
    "validate": ["-o", "out"],
    "build-deck": ["--stimulus", "sine_20_250", "-o", "out"],
}
"""Arguments of the verbs that take a parameter set."""
WITHOUT_MECHANICS = {"export-c"}
"""Verbs with a parameter set that see no stress: the header gets it from a sensor later."""


@pytest.mark.usefixtures("here", "short_validation")
@pytest.mark.parametrize("entry", PYTHON)
def test_each_function_warns_once(entry):
    with pytest.warns(FembridgeWarning) as caught:
        try:
            PYTHON[entry]()
        except StopError:
            assert entry.startswith("validate")
    texts = [str(item.message) for item in caught if "was fitted" in str(item.message)]
    assert len(texts) == 1
    assert texts[0].startswith(WORDS)


@pytest.mark.usefixtures("here", "short_validation", "unrendered")
@pytest.mark.parametrize("verb", COMMANDS)
def test_each_verb_with_a_parameter_set_warns(verb, capsys):
    try:
        main([verb, "--parameters", "mine.toml", *COMMANDS[verb]])
    except StopError:
        assert verb == "validate"
    assert capsys.readouterr().err.count(WORDS) == 1


@pytest.mark.usefixtures("here", "unrendered")
@pytest.mark.parametrize(
    "words",
    [
        ["sweep", "study.toml", "-o", "out"],
        pytest.param(["report", "touched"], marks=pytest.mark.slow),
    ],
)
def test_verbs_that_read_a_set_from_files_warn(words, capsys):
    main(words)
    assert WORDS in capsys.readouterr().err


def test_no_verb_with_a_parameter_set_is_left_out():
    with_set = set()
    for verb in VERBS:
        parser = argparse.ArgumentParser()
        command = import_module(f"fembridge.commands.{verb.replace('-', '_')}")
        command.add_arguments(parser)
        if "--parameters" in parser._option_string_actions:
            with_set.add(verb)
    assert with_set - WITHOUT_MECHANICS == COMMANDS.keys()


def test_a_set_of_the_same_mechanics_is_silent(here, recwarn):
    """A fit on the pad, then touches of any shape on the same skin."""
    rates = fb.simulate("sine_20", response=fb.PadProbe(), parameters="fitted_pad").rates
    observed = rates[rates["unit"] == "2"].drop(columns="unit")
    search = fb.Search(evaluations=40, population=20)
    fit = fb.fit(observed, afferents="SA", pad="reference", search=search, output="fit")
    assert dict(parameter_set(Path("fit/fitted.toml")).mechanics) == dict(fit.parameters.mechanics)
    fb.touch("sphere", press_um=100, population="one_each", parameters="fit/fitted.toml")
    fb.threshold(["SA"], [50], pad="reference", parameters=fit.parameters)
    write_map(here / "map.toml", fb.PadProbe().response)
    fb.simulate("sine_50_250", response="map.toml", parameters=fit.parameters)
    assert not [str(item.message) for item in recwarn if "was fitted" in str(item.message)]


def test_smooth_skin_and_ridges_of_other_sizes_are_other_mechanics():
    smooth = resolve_pad("reference")
    ridged = with_ridges(smooth, None)
    mine = replace(parameter_set("fitted_pad"), name="mine", mechanics=ridged.mechanics)
    assert fit_mismatch(mine, ridged.mechanics, {75.0}) == ""
    other_pattern = with_ridges(smooth, "whorl:seed=3").mechanics
    assert fit_mismatch(mine, other_pattern, {75.0}) == ""
    for ridges in ("none", "loop:period_mm=0.5", "loop:height_mm=0"):
        mechanics = with_ridges(smooth, ridges).mechanics
        assert "(here: a pad of finger 'quick' with" in fit_mismatch(mine, mechanics, {75.0})
    without_ridges = replace(mine, mechanics=dict(smooth.mechanics, ridges="none"))
    assert fit_mismatch(without_ridges, smooth.mechanics, {75.0}) == ""
    assert fit_mismatch(without_ridges, ridged.mechanics, {75.0})


def test_a_set_without_ridges_in_its_fit_is_for_both():
    """`fitted_pad` was fitted before sets named them."""
    shipped = parameter_set("fitted_pad")
    if "ridges" in shipped.mechanics:
        pytest.skip("the shipped set names its ridges")
    for ridges in ("none", "loop"):
        mechanics = with_ridges(resolve_pad("reference"), ridges).mechanics
        assert fit_mismatch(shipped, mechanics, {75.0}) == ""


def test_mechanics_of_a_set_travel_with_the_record_of_a_result():
    mine = replace(
        parameter_set("fitted_pad"),
        name="mine",
        preindent_um=40.0,
        mechanics={"name": "f", "sha256": "00", "pad": "p", "ridges": "none", "probe": "q"},
    )
    back = ParameterSet.from_record(mine.to_record(), "the record")
    assert back is not None
    assert (back.name, back.preindent_um) == ("mine", 40.0)
    assert dict(back.mechanics) == dict(mine.mechanics)
    assert back.parameters == mine.parameters
    shipped = parameter_set("fitted")
    assert ParameterSet.from_record(shipped.to_record(), "the record") is shipped
    assert ParameterSet.from_record({}, "the record") is None


def test_a_difference_is_returned_and_warned_of():
    with pytest.warns(FembridgeWarning) as caught:
        text = check_mechanics(parameter_set("fitted"), {"name": "other", "sha256": "1"}, {75.0})
    assert [str(item.message) for item in caught] == [text]
