"""The stored pad of a macaque's finger: the file of the documentation, and where it is used."""

import re
import warnings
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import fembridge as fb
from decks.presets import read_finger
from fembridge.errors import FembridgeWarning
from fembridge.reporting import validation_data
from fembridge.reporting.recorded_sets import JUDGED
from fembridge.touching.pad_file import resolve_pad
from fembridge.touching.ridged_pad import RidgedPad, with_ridges
from neural import parameter_set


def test_the_stored_pad_is_of_the_finger_in_the_documentation(tmp_path):
    page = Path(__file__).parents[3] / "docs" / "how_to" / "finger.md"
    _, _, section = page.read_text(encoding="utf-8").partition("## The finger of a macaque")
    [text] = re.findall(r"```toml\n(.*?)```", section.partition("\n## ")[0], re.DOTALL)
    path = tmp_path / "macaque.toml"
    path.write_text(text, encoding="utf-8")
    pad = resolve_pad("macaque")
    described = read_finger(str(path))
    assert pad.finger == replace(described, ridges=pad.finger.ridges, papillae=pad.finger.papillae)
    assert pad.spacing_mm == 0.2


def test_a_narrow_finger_is_round_and_short_in_proportion():
    human, macaque = resolve_pad("reference"), resolve_pad("macaque")
    assert human.tip_radius_mm == pytest.approx(20.0)
    assert macaque.tip_radius_mm == pytest.approx(11.0)
    z_mm = np.array([0.0, 3.0])
    for pad, radius_mm in ((human, 20.0), (macaque, 11.0), (with_ridges(macaque, "across"), 11.0)):
        below_mm = -np.diff(pad.skin_height_mm(np.zeros(2), z_mm))[0]
        assert below_mm == pytest.approx(9 / 2 / radius_mm, abs=0.11)
    units = fb.Population.fingertip(finger=macaque)
    assert np.abs(units.x_mm).max() < 4.4
    assert 6.0 < np.abs(units.z_mm).max() <= 6.6
    assert len(fb.Population.fingertip()) == 888


def test_the_same_force_presses_a_narrow_finger_harder():
    peaks_pa = []
    for pad in ("reference", "macaque"):
        units = fb.Population.one_each(finger=resolve_pad(pad)).with_endings(0.0)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FembridgeWarning)  # fitted on another finger
            touch = fb.touch("plate", press_n=0.05, pad=pad, ridges="none", population=units)
        peaks_pa.append(touch.stress_pa.max(axis=0))
    assert (peaks_pa[1] > 1.1 * peaks_pa[0]).all()


def test_recorded_textures_are_scanned_over_the_macaque_s_finger(monkeypatch):
    given = []
    monkeypatch.setattr(validation_data, "recorded_points", lambda *args, **_: given.append(args))
    own = SimpleNamespace(
        model=parameter_set("fitted_pad"), response=SimpleNamespace(deepest_um=600.0)
    )
    simulations = {own.model.name: SimpleNamespace(mean_rates=[])}
    for skin in (None, resolve_pad("reference")):
        validation_data._points(None, simulations, own, None, None, {}, skin)
    (*_, smooth, textured), (*_, on_own, textured_own) = given
    assert isinstance(textured.pad, RidgedPad)
    assert textured.pad.smooth_pad.source == "macaque"
    assert smooth.pad.source == on_own.pad.source == textured_own.pad.source == "reference"
    assert JUDGED in given[0][1]
