"""A user's own deck becomes run folders, what he wrote stays; and goes through ccx to spikes."""

import csv
import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from own_block import BLOCK

import fembridge as fb
from decks.own_model import Request
from decks.stimuli import resolve
from decks.synthesis import make_stimulus
from fembridge.cli import main
from fembridge.errors import DeckError, FembridgeWarning
from fembridge.io.run_folder import read_run_folder, read_waveform
from fembridge.results.readers import read_values
from fembridge.results.result import open_result
from fembridge.solver.build import build_own_folder, read_base_deck

SAMPLES = Path(__file__).parents[2] / "fixtures"
INP = SAMPLES / "transient_sine" / "job.inp"
NODES = {"SA": 461, "RA": 367, "PC": 1459}


@pytest.fixture
def noise():
    return make_stimulus(resolve(["noise_25_250_5"])[0])


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    (tmp_path / "mine.inp").write_bytes(INP.read_bytes())
    return tmp_path


def words(*more):
    return ["build-deck", "--stimulus", "noise_25_250_5", *more]


def test_a_folder_holds_deck_waveform_and_what_was_changed(here, noise):
    base = read_base_deck(Path("mine.inp"))
    run, rebased = build_own_folder(here / "run", base, noise, Request(afferents=NODES))
    assert run == read_run_folder(here / "run")
    assert (run.solver, run.increments, run.start_ms) == ("calculix", 500, 0.0)
    assert {place.afferent: place.node for place in run.afferents} == NODES
    assert any("amplitude DEPTH" in remark for remark in rebased.remarks)
    assert run.inputs["base_deck"]["changes"] == list(rebased.remarks)
    times_ms, depth_um = read_waveform(here / "run")
    np.testing.assert_array_equal(times_ms, noise.times_ms)
    np.testing.assert_allclose(depth_um, noise.displacement_um, rtol=1e-15)
    new = (here / "run/job.inp").read_bytes().splitlines()
    old = INP.read_bytes().splitlines()
    first = next(k for k, (a, b) in enumerate(zip(old, new, strict=False)) if a != b)
    assert old[first - 1].startswith(b"*AMPLITUDE")


def test_the_verb_tells_what_it_changed_and_its_summary_lists_it(here, capsys):
    nodes = [word for name, k in NODES.items() for word in ("--afferent", f"{name}={k}")]
    assert main(words("--base-deck", "mine.inp", *nodes, "--json")) == 0
    out, err = capsys.readouterr()
    summary = json.loads(out)
    assert summary["solver"] == "calculix"
    assert [row["increments"] for row in summary["folders"]] == [500]
    assert "mine.inp: line" in err
    assert len(err.splitlines()) == len(summary["notes"])


@pytest.mark.parametrize(
    ("more", "code", "said"),
    [
        (["--finger", "paper"], 2, "--finger is for our finger"),
        (["--afferent", "SA=1", "--afferent", "SA=1"], 2, "names SA twice"),
        (["--solver", "marc"], 1, "mine.inp: a .inp is a deck for calculix or abaqus, not for"),
        (["--slide-mm-per-s", "4"], 1, {"argument": "--slide-mm-per-s"}),
        (["--amplitude", "NONE"], 1, {"path": "mine.inp"}),
        (["--afferent", "SA=999999"], 1, "999999"),
        (["--results", "both"], 1, {"argument": "--results", "found": "both", "path": "mine.inp"}),
        (["--afferent", "SA"], 2, {"argument": "--afferent", "found": "SA"}),
        (["--afferent", "SA=-1"], 2, {"argument": "--afferent", "found": "SA=-1"}),
        (["--afferent", "sa=3"], 2, {"argument": "--afferent", "found": "sa=3"}),
    ],
)
def test_what_makes_no_sense_is_one_line(here, refused, more, code, said):
    refused(words("--base-deck", "mine.inp", *more), said, code)


@pytest.mark.slow
def test_python_rebases_a_deck_as_the_verb_does(here, logged):
    nodes = [word for name, k in NODES.items() for word in ("--afferent", f"{name}={k}")]
    assert main(words("--base-deck", "mine.inp", *nodes, "-o", "verb")) == 0
    logged.clear()
    [run] = fb.rebase_deck("mine.inp", "noise_25_250_5", "python", afferents=NODES)
    files = sorted(path.name for path in run.folder.iterdir())
    assert files == sorted(path.name for path in (here / "verb/noise_25_250_5").iterdir())
    for name in files:
        expected = (here / "verb/noise_25_250_5" / name).read_bytes()
        assert (run.folder / name).read_bytes() == expected
    assert all(line.startswith("mine.inp: ") for line in logged)
    assert len(logged) == len(run.inputs["base_deck"]["changes"])


def requests_in(run):
    lines = run.deck.read_text().splitlines()
    cards = ("*NODE FILE", "*EL FILE", "*NODE OUTPUT", "*ELEMENT OUTPUT")
    return [
        (line, lines[row + 1]) for row, line in enumerate(lines) if line.upper().startswith(cards)
    ]


@pytest.mark.slow
def test_requests_of_results_stay_beside_ours_or_go(here):
    text = INP.read_text()
    last = text.upper().rindex("*END STEP")
    own = "*NODE FILE, NSET=AFFERENT_SA, FREQUENCY=7\nRF\n*EL FILE\nE\n"
    (here / "asks.inp").write_text(text[:last] + own + text[last:])
    rebase = partial(fb.rebase_deck, "asks.inp", "noise_25_250_5", afferents={"SA": NODES["SA"]})
    [run] = rebase(output="keeps")
    kept = requests_in(run)
    assert ("*NODE FILE, NSET=AFFERENT_SA", "RF") in kept and ("*EL FILE", "E") in kept
    card, data = kept[-1]
    assert (card.split(", ")[:2], data) == (
        ["*ELEMENT OUTPUT", "NSET=FEMBRIDGE_OUTPUT_AND_YOURS"],
        "S",
    )
    [run] = rebase(output="drops", own_output=False)
    assert [data for _, data in requests_in(run)] == ["U", "S"]
    assert run.inputs["base_deck"]["request"] == {"own_output": False}


@pytest.mark.slow
def test_a_large_field_that_a_request_makes_is_warned_of(here, monkeypatch):
    monkeypatch.setattr("fembridge.solver.deck._MANY_GIGABYTES", 0.1)
    text = INP.read_text()
    last = text.upper().rindex("*END STEP")
    (here / "asks.inp").write_text(text[:last] + "*NODE FILE\nU\n" + text[last:])
    rebase = partial(fb.rebase_deck, "asks.inp", "noise_25_250_5", afferents={"SA": NODES["SA"]})
    with pytest.warns(FembridgeWarning, match="--no-own-output"):
        rebase(output="keeps")
    rebase(output="drops", own_output=False)


@pytest.mark.solver
def test_sets_of_own_requests_are_in_the_results_with_the_afferents(here):
    """ccx has the U and S of one set: that of its last request."""
    request = "*NODE FILE, NSET=LOW\nU\n*EL FILE, NSET=SIDE\nS"
    text = BLOCK.format(model="*NSET, NSET=LOW\n1, 2", before="", loads=request)
    (here / "block.inp").write_text(text)
    fb.map_response("block.inp", "map", afferents={"SA": 3}, depth_um=20.0, steps=6)
    *_, field = fb.read_fields(Path("map/run"), "STRESS", across_materials=True)
    assert set(field.nodes.tolist()) == {1, 2, 3, 4}


@pytest.mark.parametrize(
    ("name", "said"),
    [("no.inp", "cannot be read"), ("mine.txt", "not a deck"), ("", "not a deck")],
)
def test_a_file_that_is_no_deck_is_named(here, name, said):
    with pytest.raises(DeckError, match=said) as refused:
        read_base_deck(here / name)
    assert refused.value.path == here / name


def test_included_files_come_along(here, noise):
    lines = (here / "mine.inp").read_text().splitlines(keepends=True)
    first = next(k for k, line in enumerate(lines) if line.startswith("*NODE,"))
    after = next(k for k in range(first + 1, len(lines)) if lines[k].startswith("*"))
    (here / "mesh.inc").write_text("".join(lines[first:after]))
    lines[first:after] = ["*INCLUDE, INPUT=mesh.inc\n"]
    (here / "mine.inp").write_text("".join(lines))
    base = read_base_deck(here / "mine.inp")
    run, _ = build_own_folder(here / "run", base, noise, Request(afferents=NODES))
    assert (here / "run/mesh.inc").read_bytes() == (here / "mesh.inc").read_bytes()
    assert {place.afferent: place.node for place in run.afferents} == NODES
    (here / "mesh.inc").unlink()
    with pytest.raises(DeckError, match=r"mesh\.inc"):
        build_own_folder(here / "again", base, noise, Request())
    assert not (here / "again").exists()


@pytest.mark.parametrize("name", ["../mesh.inc", "run.toml"])
def test_an_included_file_from_elsewhere_is_refused(here, noise, name):
    text = (here / "mine.inp").read_text()
    (here / "mine.inp").write_text(f"*INCLUDE, INPUT={name}\n{text}")
    base = read_base_deck(here / "mine.inp")
    with pytest.raises(DeckError, match=name) as caught:
        build_own_folder(here / "run", base, noise, Request())
    assert caught.value.path == here / "mine.inp"


@pytest.mark.slow
def test_results_of_a_run_are_in_the_units_that_its_deck_was_built_with(here):
    deck = INP.read_text().replace("*HEADING\n", "*HEADING\nUnit system: M_TON_S_C\n")
    (here / "mine.inp").write_text(deck)
    assert main(words("--base-deck", "mine.inp", "-o", "out")) == 0
    run = read_run_folder(here / "out/noise_25_250_5")
    assert (run.stress_unit, run.length_unit) == ("kPa", "m")
    run.results.write_bytes(b"    1C\n")
    with open_result(run) as result:
        options = result.source.options
        assert (options.stress_unit, options.length_unit) == ("kPa", "m")


moved_at = partial(read_values, quantity="displacement")
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


@pytest.mark.solver
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


@pytest.mark.solver
@pytest.mark.slow
def test_an_axisymmetric_model_keeps_its_pre_indentation(here):
    assert spikes_of(here, AXISYMMETRIC, *AUTOMATIC) == {"SA"}
    assert_allclose(depth_um(PROBE, 1e3), 300.0 + WAVE_UM[1:], atol=1e-6)
    (trace,) = fb.read(RUN)
    assert_allclose(trace.stress_pa[0], trace.stress_pa[40], rtol=0.02)  # a cycle later


@pytest.mark.solver
@pytest.mark.slow
def test_what_fixed_increments_do_not_solve_automatic_ones_do(here, capsys):
    build(here, AXISYMMETRIC, "--afferent", f"SA={UNDER}")
    assert main(["run", RUN, "--no-cache"]) == 1
    assert "did not converge" in (said := capsys.readouterr().err)
    assert "--increments automatic" in said
    spikes_of(here, AXISYMMETRIC, *AUTOMATIC)
    times_ms, _ = moved_at(here / RUN / "job.frd", [PROBE])
    assert_allclose(times_ms[-120:], 1000.5 + TIMES_MS[:-1], rtol=1e-9)


@pytest.mark.solver
@pytest.mark.slow
def test_a_ramp_to_a_pre_indentation_begins_where_the_probe_stands(here):
    spikes_of(here, AXISYMMETRIC, *AUTOMATIC, "--preindent-um", "50")
    _, moved = moved_at(here / RUN / "job.frd", [PROBE])
    ramp_um = -1e3 * moved[-(len(WAVE_UM) + 20) : -(len(WAVE_UM) - 1), 0, 1]
    assert_allclose(ramp_um, 300 + 2.5 * np.arange(21), atol=1e-6)
    assert_allclose(depth_um(PROBE, 1e3), 350.0 + WAVE_UM[1:], atol=1e-6)


@pytest.mark.solver
@pytest.mark.slow
def test_a_line_that_ccx_cannot_read_is_said_and_the_run_taken(here, capsys):
    deck = AXISYMMETRIC.replace("*STEP, NLGEOM\n", "*STEP, NLGEOM\npress it in\n", 1)
    spikes_of(here, deck, *AUTOMATIC)
    said = capsys.readouterr().err
    line = deck.splitlines().index("press it in") + 1
    assert f"mine.inp: line {line}: CalculiX warns: " in said
    assert "CalculiX warned: in calinput. Card image cannot be interpreted [PRESSITIN]" in said
