"""A user's deck is loaded and unloaded once, and its map answers as the solver does."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from own_block import BLOCK, GRAVITY

import fembridge as fb
from decks.own_model import LoadScale
from fembridge.cli import main
from fembridge.errors import DeckError, MissingError, ResponseError, ResultError, UsageError
from fembridge.io.run_folder import AfferentNode, read_run_folder
from fembridge.response.deck_map import closure_of, load_unload
from fembridge.response.indentation import HysteresisError
from fembridge.response.response_map import ResponseMap, read_map, write_map

pytestmark = pytest.mark.filterwarnings("ignore:.*(softest material|density of)")
MARC = Path(__file__).parents[2] / "fixtures" / "marc_samples"
NODES = {"SA": [5, 6], "RA": 2}
FORCE = "*CLOAD\nTOP, 2, -0.001\n"
PRESSURE = "*DLOAD\n2, P3, 0.002\n"
PUSH = "*BOUNDARY\nTOP, 2, 2, -0.01\n"
CURVE = "*AMPLITUDE, NAME=A\n0., 0., 1., 1."
TOLERANCE_PERCENT = 0.5


def block(path, load=PUSH, model="", before="", loads="", requests=""):
    text = BLOCK.format(model=model, before=before, loads=loads).replace(PUSH, load)
    path.write_text(text.replace("*END STEP", f"{requests}*END STEP"))
    return path


@pytest.fixture
def deck(here):
    return block(here / "mine.inp")


def uniaxial(depth_um, *curves_pa):
    """Tensors whose von Mises stress is each of `curves_pa`."""
    tensor_pa = np.zeros((depth_um.size, len(curves_pa), 6))
    tensor_pa[..., 0] = np.stack(curves_pa, -1)
    return tensor_pa


# ---- The waveform and its check


def test_the_waveform_meets_depths_twice_and_middles_once():
    stimulus = load_unload(100.0, 50.0, steps=12)
    depth_um = stimulus.displacement_um
    assert (depth_um[0], depth_um[-1]) == (0.0, 0.0)
    assert (depth_um.max(), depth_um.min()) == (100.0, -50.0)
    values, counts = np.unique(depth_um, return_counts=True)
    assert set(counts[values != 0]) == {1, 2}
    assert load_unload(100.0, 0.0, steps=12).displacement_um.min() == 0.0


@pytest.mark.parametrize(
    ("argument", "value"), [("depth_um", 0.5), ("retract_um", 1e5), ("steps", 5)]
)
def test_a_run_outside_its_limits_is_refused(argument, value):
    with pytest.raises(UsageError) as refused:
        load_unload(**{argument: value})
    assert (refused.value.argument, refused.value.found) == (argument, value)


def test_a_function_of_depth_closes_and_a_lag_does_not():
    depth_um = load_unload(400.0).displacement_um
    smooth_pa = 50.0 * np.abs(depth_um) ** 1.3
    closure = closure_of(depth_um, uniaxial(depth_um, smooth_pa, 2 * smooth_pa))
    assert_array_equal(closure.percent, 0.0)
    assert (closure.interpolation_percent < 0.1).all()
    falling = np.diff(depth_um, prepend=0.0) < 0
    closure = closure_of(
        depth_um, uniaxial(depth_um, smooth_pa, np.where(falling, 0.97, 1) * smooth_pa)
    )
    assert_allclose(closure.percent, [0.0, 100 * 0.03 / 0.97], rtol=1e-6)


def test_a_kink_between_two_depths_shows_in_the_middles():
    depth_um = load_unload(400.0, 0.0, steps=8).displacement_um
    closure = closure_of(depth_um, uniaxial(depth_um, 10.0 * np.maximum(depth_um - 60.0, 0.0)))
    assert closure.percent[0] < 1e-9
    assert closure.interpolation_percent[0] > TOLERANCE_PERCENT


def test_a_difference_of_a_faint_stress_counts_against_five_percent_of_the_peak():
    depth_um = load_unload(100.0, 0.0).displacement_um
    curve_pa = depth_um**2
    row = np.flatnonzero(np.diff(depth_um) < 0)[-3] + 1
    curve_pa[row] += 0.01 * 0.05 * curve_pa.max()
    closure = closure_of(depth_um, uniaxial(depth_um, curve_pa))
    largest = max(closure.percent[0], closure.interpolation_percent[0])
    assert 0.0 < largest <= 1.0 + 1e-9


# ---- The map


def units_map(**changes):
    places = tuple(
        AfferentNode("SA", node, "", 0.1 * node, 0.5, z_mm=2.0, unit=unit)
        for node, unit in ((4, "4"), (9, "left"))
    )
    depth_um = np.array([-20.0, -10.0, 0.0, 40.0, 90.0])
    tensor_pa = np.arange(60.0).reshape(5, 2, 6)
    return ResponseMap(
        **{
            "depth_um": depth_um,
            "tensor_pa": tensor_pa,
            "force_n_per_mm": np.empty(0),
            "places": places,
            "closure_percent": 0.1,
            "origin": {"base_deck": {"file": "mine.inp", "sha256": "0"}},
            "lifts_off": False,
            "load": LoadScale("force", 0.002),
            **changes,
        }
    )


def test_a_map_of_units_in_a_solid_comes_back_from_its_file(tmp_path):
    response = units_map()
    write_map(tmp_path / "response.toml", response)
    again = read_map(tmp_path)
    assert again.places == response.places
    assert (again.lifts_off, again.load) == (False, LoadScale("force", 0.002))
    for name in ("depth_um", "tensor_pa", "force_n_per_mm"):
        assert_array_equal(getattr(again, name), getattr(response, name))


def test_of_several_units_one_is_chosen_by_name():
    response = units_map()
    assert [site.unit for site in response.with_units(["SA=left"]).places] == ["left"]
    chosen = response.with_units(["SA=4"])
    assert_array_equal(chosen.tensor_pa, response.tensor_pa[:, :1])
    for wrong in (["SA=5"], ["RA=4"], ["SA"], ["SA=4", "SA=left"]):
        with pytest.raises(UsageError) as refused:
            response.with_units(wrong)
        assert (refused.value.argument, refused.value.found) == ("unit", wrong[-1])


@pytest.mark.filterwarnings("ignore::fembridge.errors.FembridgeWarning")  # another finger
def test_thresholds_are_those_of_the_chosen_unit(tmp_path):
    """The unit with the larger stress is more sensitive, and is taken without a choice."""
    tensor_pa = np.zeros((3, 2, 6))
    tensor_pa[:, 0, 0], tensor_pa[:, 1, 0] = [0.0, 2e4, 8e4], [0.0, 4e4, 1.6e5]
    response = units_map(
        tensor_pa=tensor_pa, depth_um=np.array([0.0, 100.0, 400.0]), lifts_off=True, load=None
    )
    write_map(tmp_path / "response.toml", response)

    def amplitude_um(**unit):
        found = fb.threshold(["SA"], [20], response=tmp_path, preindent_um=100.0, **unit)
        return found.table["amplitude_um"].iloc[0], found.provenance["response"].get("units")

    weak, strong = amplitude_um(unit="SA=4"), amplitude_um(unit=["SA=left"])
    assert (weak[1], strong[1]) == (["SA=4"], ["SA=left"])
    assert weak[0] > 1.5 * strong[0]
    assert amplitude_um() == (strong[0], None)


@pytest.mark.filterwarnings("ignore:parameter set fitted")
def test_a_study_of_own_decks_is_a_dataframe_or_a_dict(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        write_map(tmp_path / name / "response.toml", units_map(load=None))
    frame = pd.DataFrame({"stimulus": ["sine_20_25"] * 2, "map": ["first", "second"]})
    by_frame = fb.sweep(frame, "by_frame").results
    decks = [{"map": "first"}, {"map": "second"}]
    by_dict = fb.sweep({"stimuli": ["sine_20_25"], "base_decks": decks}, "by_dict").results
    assert by_frame["finger"].tolist() == ["first", "first", "second", "second"]
    pd.testing.assert_frame_equal(by_frame, by_dict)
    for wrong in (frame.assign(finger="quick"), frame.assign(probe_x_mm=1.0)):
        with pytest.raises(UsageError) as refused:
            fb.sweep(wrong, "wrong")
        assert refused.value.argument == "study"


@pytest.mark.parametrize(
    ("argument", "value"),
    [("steps", 12), ("depth_um", 100.0), ("afferents", {"SA": 3}), ("afferents", pd.DataFrame())],
)
def test_options_of_a_deck_are_refused_for_the_folder_of_a_map(tmp_path, argument, value):
    with pytest.raises(UsageError) as refused:
        fb.map_response(tmp_path, **{argument: value})
    assert refused.value.argument == argument


def test_above_its_smallest_depth_a_map_answers_only_where_the_probe_has_left():
    wave_um = np.array([0.0, -30.0])
    with pytest.raises(ResponseError) as refused:
        units_map().tensors(wave_um)
    assert refused.value.found == -30.0
    free = units_map(lifts_off=True)
    assert_array_equal(free.tensors(wave_um)[1], free.tensor_pa[0])


def test_a_fit_reads_the_unit_with_the_largest_stress(logged):
    from neural.models import MODELS

    model = next(iter(MODELS.values()))["SA"]
    stimulus = fb.Stimulus("step", np.array([0.0, 40.0]), 0.5, (0.0, 0.5))
    stress_pa = units_map().stress_pa(model, [stimulus])
    strongest = units_map().traces(stimulus)[1]
    assert strongest.unit == "left"
    assert_allclose(stress_pa[:, 0, 0], strongest.stress_pa)


PRESSED = f"*STEP, NLGEOM\n*STATIC\n0.5, 1.\n{PUSH}*END STEP"


@pytest.mark.slow
@pytest.mark.solver
@pytest.mark.parametrize(
    ("load", "before", "options", "wave"),
    [
        (PUSH, "", {}, "sine_20_250"),
        (PUSH, PRESSED, {"move": "TOP,2"}, "sine_20_250"),
        (FORCE, "", {"newton_per_um": 1e-5}, "sine_20_250"),
        (PRESSURE, "", {"mpa_per_um": 1e-5}, "sine_50_250"),
    ],
    ids=["displacement", "pressed before", "force", "pressure"],
)
@pytest.mark.filterwarnings("ignore:parameter set fitted", "ignore:no spikes")
def test_a_trace_of_the_map_is_that_of_a_transient(here, load, before, options, wave):
    path = block(here / "mine.inp", load, before=before)
    mapped = fb.map_response(path, "map", afferents=NODES, depth_um=300.0, **options)
    assert mapped.response.closure_percent <= TOLERANCE_PERCENT
    [run] = fb.rebase_deck(path, wave, "runs", afferents=NODES, **options)
    [outcome] = fb.run(run)
    assert outcome.accepted
    simulation = fb.simulate(wave, response="map")
    solved = fb.read(run)
    assert [(t.afferent, t.unit, t.node) for t in solved] == [
        ("SA", "5", 5),
        ("SA", "6", 6),
        ("RA", "", 2),
    ]
    for transient, trace in zip(solved, simulation.traces[0], strict=True):
        assert (trace.afferent, trace.unit) == (transient.afferent, transient.unit)
        peak_pa = transient.stress_pa.max()
        difference = np.abs(trace.stress_pa[::5] - transient.stress_pa).max() / peak_pa
        assert 100 * difference < TOLERANCE_PERCENT
    rates = fb.encode(run, parameters="fitted").rates  # stress between samples is interpolated
    assert_allclose(rates.pop("rate_ips"), simulation.rates.rate_ips, rtol=0.02, atol=1.0)
    assert rates.equals(simulation.rates.drop(columns="rate_ips"))


@pytest.mark.slow
@pytest.mark.solver
@pytest.mark.filterwarnings("ignore:parameter set fitted")
def test_a_map_is_a_folder_that_other_verbs_read(deck, capsys):
    words = ["map", "--base-deck", "mine.inp", "--afferent", "SA=5,6", "--afferent", "RA=2"]
    assert main([*words, "--depth-um", "300", "-o", "map", "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["depth_um"] == [-300.0, 300.0]
    assert [(row["afferent"], row["unit"]) for row in summary["afferents"]] == [
        ("SA", "5"),
        ("SA", "6"),
        ("RA", ""),
    ]
    assert {path.name for path in Path("map").iterdir()} == {
        *("run", "response.toml", "response.csv", "response.png")
    }
    assert main(["simulate", "--stimulus", "sine_20_250", "--response", "map", "-o", "out"]) == 0
    simulation = fb.Simulation.read("out")
    assert list(simulation.rates.columns) == ["stimulus", "afferent", "unit", "rate_ips"]
    assert simulation.provenance["finger"]["name"] == "mine.inp"
    assert fb.encode("out").rates.equals(simulation.rates)
    again = fb.DeckResponse.read("map")
    assert again.table.equals(pd.read_csv("map/response.csv", dtype={"unit": str}).fillna(""))
    assert len(repr(again).splitlines()) <= 5
    study = {
        "stimuli": ["sine_20_250"],
        "base_decks": [
            {"map": "map"},
            {"deck": "mine.inp", "name": "solved", "afferents": NODES},
        ],
    }
    sweep = fb.sweep(study, "sweep")
    assert not sweep.failed
    by_map, solved = (part for _, part in sweep.results.groupby("finger", sort=False))
    assert list(by_map["unit"].fillna(0)) == [5, 6, 0]
    assert_allclose(solved["peak_stress_pa"], by_map["peak_stress_pa"], rtol=1e-3)
    assert_allclose(by_map["rate_ips"], simulation.rates["rate_ips"])


@pytest.mark.solver
def test_requests_of_the_users_own_stay(here):
    requests = "*NODE FILE, FREQUENCY=9\nRF\n*EL FILE\nE\n*NODE PRINT, NSET=TOP\nRF\n"
    path = block(here / "mine.inp", requests=requests)
    fb.map_response(path, "map", afferents=NODES, depth_um=100.0, retract_um=0.0)
    run = read_run_folder(Path("map/run"))
    forces = fb.read_history(run, nodes=[5, 6], quantity="reaction-force")
    strains = fb.read_history(run, nodes=[1], quantity="strain")
    samples = load_unload(100.0, 0.0).displacement_um.size
    assert len(forces) == 2 * (samples - 1)
    assert len(strains) == samples - 1
    assert (run.folder / "job.dat").read_text().count("forces") == samples - 1


@pytest.mark.solver
def test_skin_that_yields_has_no_map_and_the_message_names_the_card(here):
    path = block(here / "mine.inp")
    path.write_text(path.read_text().replace("0.05, 0.3\n", "0.05, 0.3\n*PLASTIC\n0.001, 0.\n", 1))
    with pytest.raises(HysteresisError) as refused:
        fb.map_response(path, "map", afferents=NODES)
    assert refused.value.closure_percent > TOLERANCE_PERCENT
    assert "*PLASTIC" in refused.value.problem
    assert "build-deck" in refused.value.problem
    assert not Path("map/response.toml").exists()
    assert Path("map/no_map.txt").read_text().strip() == str(refused.value)


# ---- What is refused before the solver runs


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"loads": GRAVITY}, "DLOAD"),
        (
            {
                "model": CURVE,
                "loads": "*BOUNDARY, AMPLITUDE=A\nSIDE, 1, 1, 0.02",
            },
            "amplitude A",
        ),
    ],
    ids=["ramped", "amplitude"],
)
def test_a_load_that_changes_beside_the_waveform_is_refused(here, changes, reason):
    path = block(here / "mine.inp", **changes)
    with pytest.raises(ResponseError) as refused:
        fb.map_deck(path, "map", afferents=NODES, move="TOP,2")
    assert reason in refused.value.found
    assert not Path("map").exists()


@pytest.mark.parametrize("procedure", ["*DYNAMIC", "*VISCO"])
def test_inertia_and_viscosity_are_refused(here, procedure):
    path = block(here / "mine.inp")
    path.write_text(path.read_text().replace("*STATIC", procedure))
    with pytest.raises(ResponseError) as refused:
        fb.map_deck(path, "map", afferents=NODES)
    assert procedure in refused.value.found


def test_a_map_needs_afferents(deck):
    with pytest.raises(UsageError) as refused:
        fb.map_deck(deck, "map")
    assert refused.value.argument == "afferents"


def test_a_force_for_a_displacement_is_refused(deck):
    force = pd.DataFrame({"time_ms": [0.0, 50.0, 100.0], "force_n": [0.0, 0.1, 0.0]})
    for call in (
        lambda: fb.simulate(force, stored=True),
        lambda: fb.simulate(force, response=units_map(load=None)),
        lambda: fb.simulate(force, response=units_map(load=LoadScale("pressure", 1.0))),
    ):
        with pytest.raises(UsageError) as refused:
            call()
        assert refused.value.argument == "stimulus"
    with pytest.raises(DeckError, match="CLOAD"):
        fb.rebase_deck(deck, force, "runs")


@pytest.mark.filterwarnings("ignore:parameter set fitted", "ignore:no spikes", "ignore:the strong")
def test_a_force_in_newton_is_read_at_its_size():
    times_ms = np.arange(0.0, 60.5, 0.5)
    force_n = 0.08 * np.sin(np.pi * times_ms / 60.0) ** 2
    response = units_map()
    expected = response.tensors(force_n / response.load.per_um)
    for column, scale in (("force_n", 1.0), ("force_mn", 1000.0)):
        frame = pd.DataFrame({"time_ms": times_ms, column: scale * force_n})
        [row] = fb.simulate(frame, response=response).traces
        from fembridge.results.von_mises import von_mises_pa

        assert_allclose(
            np.stack([trace.stress_pa[::5] for trace in row], -1),
            von_mises_pa(expected),
            rtol=1e-6,
        )
    one_um = fb.Stimulus("ramp", np.linspace(0.0, 20.0, 41), 0.5, (0.0, 20.0))
    [row] = fb.simulate(one_um, response=response, newton_per_um=0.004).traces
    assert_allclose(
        row[0].stress_pa[-1], von_mises_pa(response.tensors(np.array([40.0])))[0, 0], rtol=1e-9
    )


# ---- Loads of decks


def changes_of(path, stimulus="sine_20_250", **options):
    [run] = fb.rebase_deck(path, stimulus, "runs", **options)
    return run


def amplitude_of(run):
    lines = (run.folder / "job.inp").read_text().splitlines()
    first = next(k for k, line in enumerate(lines) if "FEMBRIDGE_WAVEFORM" in line)
    numbers = []
    for line in lines[first + 1 :]:
        if line.startswith("*"):
            break
        numbers += [float(text) for text in line.split(",")]
    return np.array(numbers[::2]), np.array(numbers[1::2])


def test_a_force_is_the_sum_over_the_nodes_of_its_lines(here):
    path = block(here / "mine.inp", "*CLOAD\nTOP, 2, -0.003\n4, 1, 0.008\n")
    run = changes_of(path, newton_per_um=1e-5)
    _, values = amplitude_of(run)
    # Two nodes of 3 mN down, one of 8 mN aside: 10 mN in all at amplitude 1.
    assert_allclose(values.max(), 250 * 1e-5 / 0.010, rtol=1e-3)
    text = (run.folder / "job.inp").read_text()
    assert "*CLOAD, AMPLITUDE=FEMBRIDGE_WAVEFORM\nTOP, 2, -0.003\n4, 1, 0.008\n" in text


def test_a_check_names_the_load_that_becomes_the_waveform(here):
    result = fb.check(block(here / "mine.inp", FORCE), newton_per_um=1e-5)
    assert result.passed
    [load] = result.loads.to_dict("records")
    assert (load["card"], load["target"], load["course"]) == ("*CLOAD", "TOP", "waveform")
    assert "*CLOAD, TOP,2" in result.motion_line()
    marc = fb.check(MARC / "nour_linear.dat", newton_per_um=10.0)
    assert marc.passed
    assert "tip_load" in marc.motion_line()


def test_a_named_force_leaves_the_others(here):
    path = block(
        here / "mine.inp",
        "*CLOAD, AMPLITUDE=HELD\nTOP, 2, -0.003\n4, 1, 0.008\n",
        model="*AMPLITUDE, NAME=HELD\n0., 0., 1., 1.",
    )
    run = changes_of(path, newton_per_um=1e-5, move="TOP,2")
    _, values = amplitude_of(run)
    assert_allclose(values.max(), 250 * 1e-5 / 0.006, rtol=1e-3)
    text = (run.folder / "job.inp").read_text()
    assert "*CLOAD, AMPLITUDE=HELD\n4, 1, 0.008\n" in text.replace("\n\n", "\n")


def test_a_force_begins_where_the_steps_before_leave_it(here):
    before = "*STEP\n*STATIC\n1., 1.\n*CLOAD\nTOP, 2, -0.0005\n*END STEP\n"
    run = changes_of(block(here / "mine.inp", FORCE, before=before), newton_per_um=1e-6)
    _, values = amplitude_of(run)
    assert_allclose(values[0], 0.5)
    assert_allclose(values.max(), 0.5 + 250e-6 / 0.002, rtol=1e-3)


@pytest.mark.parametrize(
    ("load", "options"),
    [
        ("*CLOAD\n5, 2, -1.\n6, 2, 1.\n", {"newton_per_um": 1.0}),
        ("*DLOAD\n1, P3, 0.1\n2, P3, 0.2\n", {"mpa_per_um": 1.0}),
        (FORCE, {"mpa_per_um": 1.0}),
        (FORCE, {"newton_per_um": 1.0, "move": "SIDE,2"}),
        (FORCE, {}),
    ],
    ids=["cancel", "unequal", "other quantity", "other set", "no scale"],
)
def test_a_load_that_no_waveform_can_scale_is_refused(here, load, options):
    with pytest.raises(DeckError):
        changes_of(block(here / "mine.inp", load), **options)
    assert not Path("runs").exists()


def test_a_deck_in_other_units_gets_the_load_in_them(here):
    path = block(here / "mine.inp", FORCE)
    path.write_text(path.read_text().replace("*HEADING", "*HEADING\nUnit system: IN_LB_S_F", 1))
    _, values = amplitude_of(changes_of(path, newton_per_um=1e-5))
    assert_allclose(values.max(), 250e-5 / 4.4482216152605 / 0.002, rtol=1e-3)


@pytest.mark.parametrize(
    ("name", "options", "factor"),
    [
        ("nour_linear", {"newton_per_um": 10.0}, 6000.0),
        ("nour_plastic", {"newton_per_um": 10.0}, 6000.0),
        ("pfl_example_model_0", {"mpa_per_um": 1e-4}, 0.025),
    ],
)
def test_loads_of_public_marc_decks_take_the_waveform(here, name, options, factor):
    [per_um] = options.values()
    path = MARC / f"{name}.dat"
    with pytest.raises(DeckError) as refused:
        fb.map_deck(path, "map", afferents={"SA": 3})
    assert next(iter(options)).replace("_", "-") in refused.value.problem
    run = fb.map_deck(path, "map", afferents={"SA": 3}, depth_um=50.0, **options)
    from decks.marc.contents import read_marc_deck

    table, *_ = [
        item
        for item in read_marc_deck((run.folder / "job.dat").read_bytes()).tables
        if item.points is not None and len(item.points) == run.increments + 1
    ]
    assert_allclose(table.points[:, 1].max(), 50.0 * per_um / factor, rtol=1e-6)
    with pytest.raises(MissingError):
        fb.map_response("map")
    assert not Path("map/response.toml").exists()


def test_an_abaqus_deck_keeps_its_requests_and_its_table_makes_the_map(here, capsys):
    requests = "*OUTPUT, FIELD, FREQUENCY=7\n*NODE OUTPUT\nRF,\n"
    block(here / "mine.inp", requests=requests)
    words = ["map", "--base-deck", "mine.inp", "--afferent", "SA=5,6", "-o", "map"]
    assert main([*words, "--depth-um", "50", "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["solver"] == "abaqus"
    text = Path("map/run/job.inp").read_text()
    assert requests in text
    assert "*EL PRINT, ELSET=FEMBRIDGE_OUTPUT, POSITION=AVERAGED AT NODES" in text
    stimulus = load_unload(50.0)
    rows = [
        f"{time_ms!r},,{node},{20.0 * abs(depth_um)!r}"
        for node in (5, 6)
        for time_ms, depth_um in zip(
            stimulus.times_ms.tolist(), stimulus.displacement_um.tolist(), strict=True
        )
    ]
    Path("theirs.csv").write_text("\n".join(["time_ms,afferent,node,von_mises_pa", *rows, ""]))
    assert main(["map", "map", "--results", "theirs.csv", "--no-plot"]) == 0
    table = fb.DeckResponse.read("map").table
    assert_allclose(table["von_mises_pa"], 20.0 * table["depth_um"].abs(), rtol=1e-9)


# ---- Afferents


def test_afferents_come_as_nodes_sets_and_tables(deck):
    table = pd.DataFrame({"afferent": ["SA", "SA"], "node": [5, 6], "unit": ["left", "right"]})
    table.to_csv("units.csv", index=False)
    expected = {
        "nodes": [("SA", "5", 5), ("SA", "6", 6)],
        "table": [("SA", "left", 5), ("SA", "right", 6)],
    }
    Path("mine.inp").write_text(
        deck.read_text().replace("*NSET, NSET=SIDE", "*NSET, NSET=MY_SA\n5, 6\n*NSET, NSET=SIDE")
    )
    for value, name in (
        ({"SA": [5, 6]}, "nodes"),
        ({"SA": np.array([5, 6])}, "nodes"),
        ({"SA": "TOP"}, "nodes"),
        ("my_sa", "nodes"),
        (table, "table"),
        ("units.csv", "table"),
    ):
        run = fb.map_deck("mine.inp", "map", afferents=value)
        assert [(s.afferent, s.unit, s.node) for s in run.afferents] == expected[name], value
        assert read_run_folder(run.folder).afferents == run.afferents
    text = (run.folder / "job.inp").read_text()
    assert "*NSET, NSET=AFFERENT_SA\n5, 6,\n" in text


@pytest.mark.parametrize(
    ("value", "error"),
    [
        ({"XX": 5}, UsageError),
        ({"SA": [5, 5]}, UsageError),
        ({"SA": 1.5}, UsageError),
        ({"SA": []}, UsageError),
        ({"SA": "NO_SET"}, DeckError),
        ("TOP", UsageError),
        (7, UsageError),
    ],
)
def test_afferents_that_are_none_are_refused(deck, value, error):
    with pytest.raises(error):
        fb.map_deck(deck, "map", afferents=value)
    assert not Path("map").exists()


def test_a_folder_of_another_run_is_no_map(deck):
    [run] = fb.rebase_deck(deck, "sine_20_250", "runs", afferents=NODES)
    with pytest.raises(ResultError) as refused:
        fb.map_response(run.folder)
    assert refused.value.found == "sine_20_250"
