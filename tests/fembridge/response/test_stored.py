"""Stored responses: given for exactly what they were made of, and for nothing else."""

import dataclasses

import pytest

from decks.finger_file import finger_from
from decks.presets import PRESETS, QUICK
from decks.probe import Probe
from fembridge.errors import ResponseError
from fembridge.response import response_map
from fembridge.response.response_map import stored_response


@pytest.mark.parametrize("name", PRESETS)
def test_each_preset_has_its_own_response(name):
    response = stored_response(PRESETS[name], Probe(), "CPE4")
    assert response.origin["finger"]["name"] == name


def test_the_presets_respond_differently():
    quick, paper = (stored_response(PRESETS[n], Probe(), "CPE4") for n in PRESETS)
    assert not (quick.tensor_pa == paper.tensor_pa)[1:, :, :4].any()


@pytest.mark.parametrize(
    ("finger", "probe", "element", "told"),
    [
        (QUICK, Probe(diameter_mm=2.0), "CPE4", "diameter_mm 1.0, asked for is 2.0"),
        (QUICK, Probe("flat"), "CPE4", "shape 'cylinder', asked for is 'flat'"),
        (QUICK, Probe(x_mm=0.5), "CPE4", "x_mm 0.0, asked for is 0.5"),
        (QUICK, Probe(), "CPE8R", "has 'CPE4', asked for is 'CPE8R'"),
        (
            finger_from({"materials": {"dermis": {"young_mpa": 0.5}}}, "quick"),
            Probe(),
            "CPE4",
            "materials.dermis.young_mpa 0.05, asked for is 0.5",
        ),
        (
            finger_from({"afferents": {"SA": {"depth_mm": 0.61}}}, "quick"),
            Probe(),
            "CPE4",
            "asked for is 0.61",
        ),
    ],
)
def test_anything_else_is_refused_and_the_difference_named(finger, probe, element, told):
    with pytest.raises(ResponseError, match="no response is stored for this") as caught:
        stored_response(finger, probe, element)
    assert told in str(caught.value)


def test_a_finger_of_another_name_is_told_which_are_stored():
    other = dataclasses.replace(QUICK, name="mine")
    with pytest.raises(ResponseError, match="finger 'mine', only for paper, quick"):
        stored_response(other, Probe(), "CPE4")


def test_a_stored_map_that_was_edited_is_refused(tmp_path, monkeypatch):
    text = (response_map.FOLDER / "quick.toml").read_text(encoding="utf-8")
    (tmp_path / "quick.toml").write_text(text.replace("400.0", "500.0"), "utf-8")
    monkeypatch.setattr(response_map, "FOLDER", tmp_path)
    with pytest.raises(ResponseError, match="edited or cut"):
        stored_response(QUICK, Probe(), "CPE4")
