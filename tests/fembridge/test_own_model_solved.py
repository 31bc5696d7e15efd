"""Decks as their owners have them, from build-deck through ccx to spikes, without an edit."""

import csv
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import fembridge as fb
from fembridge.cli import main
from fembridge.results.readers import read_values
from fembridge.run_folder import read_run_folder

moved_at = partial(read_values, quantity="displacement")


pytestmark = pytest.mark.solver

RUN = "runs/wave"
TIMES_MS = np.arange(0.0, 60.5, 0.5)
WAVE_UM = 100 * np.sin(2 * np.pi * 50e-3 * TIMES_MS)


OWN = Path(__file__).with_name("own_models")
# As PrePoMax writes: solids in metres, a punch that is rigid by a reference point, hard
# contact, increments and ramp by default, no amplitude.
PREPOMAX = (OWN / "prepomax.inp").read_text()
PUNCH, POINT = 1000, 2001
SKIN_NODE = 25  # in the middle, one element under the skin
# In mm, pre-indented by 0.3 in a step of its own, then an amplitude.
AXISYMMETRIC = (OWN / "axisymmetric.inp").read_text()
PROBE, UNDER = 1000, 8  # 0.5 mm off the axis, a row up


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    return tmp_path


def build(here, deck, *options):
    rows = np.column_stack([TIMES_MS, WAVE_UM])
    np.savetxt("wave.csv", rows, "%.17g", ",", header="time_ms,displacement_um", comments="")
    (here / "mine.inp").write_text(deck)
    words = ["build-deck", "--base-deck", "mine.inp", "--stimulus", "wave.csv", "-o", "runs"]
    assert main([*words, *options]) == 0


def spikes_of(here, deck, *options):
    """Build, run, ingest and encode: the classes that fire."""
    build(here, deck, *options)
    assert main(["run", RUN, "--no-cache"]) == 0
    assert main(["ingest", RUN, "-o", "traces.csv"]) == 0
    assert main(["encode", "traces.csv", "--no-raster", "-o", "out"]) == 0
    lines = (here / "out/spikes.csv").read_text().splitlines()
    return {row["afferent"] for row in csv.DictReader(lines)}


def depth_um(probe, unit_um):
    """The probe's way into the skin, along -y, as ccx wrote it; the start is not in it."""
    _, moved = moved_at(Path(RUN, "job.frd"), [probe])
    return -unit_um * moved[-(len(WAVE_UM) - 1) :, 0, 1]


def test_a_deck_of_prepomax_goes_through_to_spikes(here, capsys):
    found = spikes_of(
        here,
        PREPOMAX,
        *("--move", f"{POINT},2", "--increments", "automatic"),
        *("--afferent", f"RA={SKIN_NODE}", "--frames", "1"),
    )
    said = capsys.readouterr().err
    assert "unit system M_KG_S_C" in said
    assert "NLGEOM" not in said
    # named before the run and after it, which is taken: hard contact has a default stiffness
    assert "mine.inp: CalculiX warns: reading *SURFACE BEHAVIOR: K must" in said
    assert f"{RUN}: CalculiX warned: reading *SURFACE BEHAVIOR: K must" in said
    assert found == {"RA"}
    assert_allclose(depth_um(PUNCH, 1e6), WAVE_UM[1:], atol=1e-6)
    (trace,) = fb.read(RUN)
    assert trace.stress_pa.max() > 1e3
    (place,) = read_run_folder(here / RUN).afferents
    assert_allclose((place.x_mm, place.y_mm, place.z_mm), (1.5, 1.5, 0.0), atol=1e-12)


AUTOMATIC = ("--afferent", f"SA={UNDER}", "--frames", "1", "--increments", "automatic")


@pytest.mark.slow
def test_an_axisymmetric_model_keeps_its_pre_indentation(here):
    assert spikes_of(here, AXISYMMETRIC, *AUTOMATIC) == {"SA"}
    assert_allclose(depth_um(PROBE, 1e3), 300.0 + WAVE_UM[1:], atol=1e-6)
    (trace,) = fb.read(RUN)
    assert_allclose(trace.stress_pa[0], trace.stress_pa[40], rtol=0.02)  # a cycle later


@pytest.mark.slow
def test_what_fixed_increments_do_not_solve_automatic_ones_do(here, capsys):
    build(here, AXISYMMETRIC, "--afferent", f"SA={UNDER}")
    assert main(["run", RUN, "--no-cache"]) == 1
    assert "did not converge" in (said := capsys.readouterr().err)
    assert "build-deck --increments automatic" in said
    spikes_of(here, AXISYMMETRIC, *AUTOMATIC)
    times_ms, _ = moved_at(here / RUN / "job.frd", [PROBE])
    assert_allclose(times_ms[-120:], 1000.5 + TIMES_MS[:-1], rtol=1e-9)


@pytest.mark.slow
def test_a_ramp_to_a_pre_indentation_begins_where_the_probe_stands(here):
    spikes_of(here, AXISYMMETRIC, *AUTOMATIC, "--preindent-um", "50")
    _, moved = moved_at(here / RUN / "job.frd", [PROBE])
    ramp_um = -1e3 * moved[-(len(WAVE_UM) + 20) : -(len(WAVE_UM) - 1), 0, 1]
    assert_allclose(ramp_um, 300 + 2.5 * np.arange(21), atol=1e-6)
    assert_allclose(depth_um(PROBE, 1e3), 350.0 + WAVE_UM[1:], atol=1e-6)


@pytest.mark.slow
def test_a_line_that_ccx_cannot_read_is_said_and_the_run_taken(here, capsys):
    deck = AXISYMMETRIC.replace("*STEP, NLGEOM\n", "*STEP, NLGEOM\npress it in\n", 1)
    spikes_of(here, deck, *AUTOMATIC)
    said = capsys.readouterr().err
    line = deck.splitlines().index("press it in") + 1
    assert f"mine.inp: line {line}: CalculiX warns: " in said
    assert "CalculiX warned: in calinput. Card image cannot be interpreted [PRESSITIN]" in said
