"""The response map: its curves, those that are stored, its file; and against whole transients."""

import dataclasses
import hashlib
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.interpolate import PchipInterpolator

from decks.finger import TABLE_1
from decks.presets import PRESETS, QUICK, finger_from, model_of
from decks.probe import Probe
from decks.stimuli import resolve
from decks.synthesis import make_stimulus
from fembridge.errors import ResponseError
from fembridge.io.run_folder import AfferentNode, read_run_folder, read_waveform
from fembridge.response.indentation import solve_response
from fembridge.response.response_map import (
    FOLDER,
    MAP_FILE,
    ResponseMap,
    read_map,
    stored_response,
    write_map,
)
from fembridge.results import read
from fembridge.results.von_mises import energy_stress_pa
from fembridge.solver.build import build_run_folder
from fembridge.solver.ccx import run_ccx
from fembridge.stimulus import Stimulus
from neural import PUBLISHED, encode
from neural.models import model_named

DEPTH_UM = np.array([0.0, 2.0, 7.0, 20.0, 55.0, 110.0, 190.0, 300.0])


PLACES = (
    AfferentNode("SA", 11, "epidermis", 0.0, -0.6, 0.6),
    AfferentNode("PC", 12, "subcutaneous", 0.25, -2.5, 2.5),
)


def tensor_at(depth_um):
    """Tensors ``(K, 2, 6)`` in Pa that rise, fall and bend with depth."""
    share = np.asarray(depth_um) / 300.0
    tensor_pa = np.zeros((*share.shape, 2, 6))
    tensor_pa[..., 0, 0] = 1e4 * share**1.5
    tensor_pa[..., 0, 1] = -3e4 * share
    tensor_pa[..., 0, 2] = -8e3 * np.sin(3 * share)
    tensor_pa[..., 0, 3] = 2e3 * share**2
    tensor_pa[..., 1, 1] = -1e3 * np.tanh(2 * share)
    return tensor_pa


@pytest.fixture(scope="session")
def made_map():
    """Give a map of these curves; what is named replaces a field of it."""

    def make(**changes):
        fields = {
            "depth_um": DEPTH_UM,
            "tensor_pa": tensor_at(DEPTH_UM),
            "force_n_per_mm": 1e-3 * DEPTH_UM**1.2,
            "places": PLACES,
            "closure_percent": 0.125,
            "origin": {"solver": "calculix", "finger": {"name": "µ-finger"}},
        }
        return ResponseMap(**(fields | changes))

    return make


def stimulus_of(depth_um):
    depth_um = np.asarray(depth_um, dtype=np.float64)
    return Stimulus("mine", depth_um, 0.5, (0.0, 0.5 * (depth_um.size - 1)))


@given(lifted_um=st.lists(st.floats(-500.0, 0.0), min_size=2, max_size=20))
def test_a_probe_that_is_lifted_off_leaves_no_stress(made_map, lifted_um):
    for trace in made_map().traces(stimulus_of(lifted_um)):
        assert_array_equal(trace.stress_pa, 0.0)


@given(depth_um=st.floats(0.0, 300.0))
def test_a_component_is_the_pchip_of_its_own_levels(made_map, depth_um):
    response = made_map()
    found = response.tensors(np.array([depth_um]))[0]
    for column in range(2):
        for k in range(4):
            levels_pa = response.tensor_pa[:, column, k]
            curve = PchipInterpolator(response.depth_um, levels_pa)
            assert_allclose(found[column, k], curve(depth_um), rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("depth_um", [300.001, 5e5])
def test_a_stimulus_that_goes_too_deep_is_refused_with_both_depths(made_map, depth_um):
    with pytest.raises(ResponseError) as caught:
        made_map().traces(stimulus_of([0.0, depth_um, 0.0]))
    for shown in ("mine", f"{depth_um:g} um", "300 um"):
        assert shown in str(caught.value)


BAD = [
    {"depth_um": np.arange(7.0)},
    {"tensor_pa": np.zeros((8, 3, 6))},
    {"depth_um": np.arange(8.0) + 1},
    {"depth_um": np.array([0.0, 1, 2, 2, 3, 4, 5, 6])},
    {"tensor_pa": np.full((8, 2, 6), np.inf)},
]


@pytest.mark.parametrize("changes", BAD)
def test_what_does_not_belong_together_is_no_map(made_map, changes):
    with pytest.raises(ResponseError):
        made_map(**changes)


RESPONSE = read_map(FOLDER / "quick.toml")
STIMULUS = make_stimulus(resolve("sine_20_250")[0], preindent_um=50.0)
ENERGY = {name: model_named("energy", name) for name in ("SA", "RA", "PC")}


def test_an_energy_takes_poisson_s_ratio_of_the_layer_of_its_afferent():
    tensor_pa = RESPONSE.tensors(STIMULUS.displacement_um)
    ratios = {"SA": 0.30, "RA": 0.30, "PC": 0.40}
    for column, trace in enumerate(RESPONSE.traces(STIMULUS, ENERGY)):
        ratio = ratios[trace.afferent]
        assert RESPONSE.poisson_at(RESPONSE.places[column]) == ratio
        assert TABLE_1[RESPONSE.places[column].layer].poisson == ratio
        expected = energy_stress_pa(tensor_pa[:, column], ratio)
        assert_array_equal(trace.stress_pa, expected)
        assert expected.max() > 100.0


@pytest.mark.parametrize(
    "origin", [{}, {"finger": "quick"}, {"finger": {"materials": {"epidermis": {}}}}]
)
def test_an_energy_without_its_material_is_refused_and_a_plain_stress_is_not(origin):
    bare = replace(RESPONSE, origin=origin)
    with pytest.raises(ResponseError, match=r"epidermis.*SA"):
        bare.traces(STIMULUS, ENERGY)
    assert len(bare.traces(STIMULUS, PUBLISHED)) == 3


@pytest.mark.parametrize(
    ("finger", "probe", "element", "shown"),
    [
        (QUICK, Probe(diameter_mm=2.0), "CPE4", ("probe", "diameter_mm", "1.0", "2.0")),
        (QUICK, Probe("flat"), "CPE4", ("probe", "shape", "'cylinder'", "'flat'")),
        (QUICK, Probe(), "CPE8R", ("element", "'CPE4'", "'CPE8R'")),
        (
            finger_from({"afferents": {"SA": {"depth_mm": 0.61}}}, "quick"),
            Probe(),
            "CPE4",
            ("finger", "afferents.SA.depth_mm", "0.61"),
        ),
    ],
)
def test_anything_else_is_refused_and_the_difference_named(finger, probe, element, shown):
    with pytest.raises(ResponseError) as caught:
        stored_response(finger, probe, element)
    for name_or_value in shown:
        assert name_or_value in str(caught.value)


def test_a_finger_of_another_name_gets_the_names_of_those_that_are():
    other = dataclasses.replace(QUICK, name="mine")
    with pytest.raises(ResponseError, match=r"'mine'.*paper, quick"):
        stored_response(other, Probe(), "CPE4")


@pytest.fixture
def path(tmp_path, made_map):
    path = tmp_path / MAP_FILE
    write_map(path, made_map())
    return path


def test_every_edited_digit_is_found(path):
    """Each number of the file in turn, its first digit moved by one."""
    content = path.read_bytes()
    start = content.index(b"\n") + 1
    digits = [
        k
        for k in range(start, len(content))
        if content[k : k + 1].isdigit() and not content[k - 1 : k].isdigit()
    ]
    assert len(digits) > 60
    for k in digits:
        moved = b"%d" % ((content[k] - ord("0") + 1) % 10)
        path.write_bytes(content[:k] + moved + content[k + 1 :])
        with pytest.raises(ResponseError):
            read_map(path)
    path.write_bytes(content)
    read_map(path)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 0.999])
def test_a_file_cut_anywhere_is_refused(path, share):
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(ResponseError, match=f"^{path}: "):
        read_map(path)


def resealed(path, table):
    """Write `table` with a checksum that fits, as a program of ill will could."""
    body = tomli_w.dumps({key: value for key, value in table.items() if key != "sha256"})
    digest = hashlib.sha256(body.encode()).hexdigest()
    path.write_text(f'sha256 = "{digest}"\n{body}', encoding="utf-8")


@pytest.mark.parametrize(
    ("keys", "value"),
    [
        (["depth_um"], [0.0, 1.0]),
        (["depth_um"], [0.0, 1.0, "deep"]),
        (["depth_um", 1], 10**400),
        (["depth_um", 1], True),
        (["depth_um", 1], "2"),
        (["force_n_per_mm", 1], float("nan")),
        (["force_n_per_mm", 1], "1_0"),
        (["afferents"], 5),
        (["afferents"], {}),
        (["afferents", "SA"], 5),
        (["afferents", "SA", "xx_pa"], [1.0]),
        (["afferents", "SA", "xx_pa", 2], float("inf")),
        (["afferents", "SA", "xx_pa", 2], 10**400),
        (["afferents", "SA", "xx_pa", 2], "1_0"),
        (["afferents", "SA", "xx_pas"], [1.0]),
        (["afferents", "SA", "node"], 0),
        (["afferents", "SA", "node"], 1.5),
        (["afferents", "SA", "node"], None),
        (["afferents", "SA", "x_mm"], float("nan")),
        (["afferents", "SA", "x_mm"], None),
        (["closure_percent"], "0"),
        (["closure_percents"], 0.0),
        (["origin"], 1),
        (["origin"], None),
    ],
)
def test_a_sealed_file_that_holds_no_map_is_refused(path, keys, value):
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    *parents, last = keys
    inner = table
    for key in parents:
        inner = inner[key]
    if value is None:
        del inner[last]
    else:
        inner[last] = value
    resealed(path, table)
    with pytest.raises(ResponseError, match=f"^{path}: "):
        read_map(path)


FIXTURES = Path(__file__).parents[3] / "fixtures"

# DESIGN of the test: a map's trace lies within this share of its own peak.
TRACE_SHARE = 0.002


def assert_same_neurons(by_map, by_transient):
    """Stress within 0.2 % of its peak, and the very same spikes."""
    assert [t.afferent for t in by_map] == [t.afferent for t in by_transient]
    for mapped, solved in zip(by_map, by_transient, strict=True):
        assert mapped.node == solved.node
        peak_pa = solved.stress_pa.max()
        off_pa = np.abs(mapped.stress_pa - solved.stress_pa).max()
        assert off_pa <= TRACE_SHARE * peak_pa, (mapped.afferent, off_pa / peak_pa)
        spikes = [
            encode(trace.stress_pa, trace.dt_ms, PUBLISHED[trace.afferent])[0]
            for trace in (mapped, solved)
        ]
        np.testing.assert_array_equal(*spikes)


@pytest.mark.parametrize("name", ["transient_sine", "transient_sine_ascii"])
def test_the_stored_map_answers_a_recorded_transient_as_the_solver_did(name):
    folder = FIXTURES / name
    times_ms, displacement_um = read_waveform(folder)
    stimulus = Stimulus(name, displacement_um, 0.5, (0.0, float(times_ms[-1])))
    recorded = read(folder)
    assert_same_neurons(read_map(FOLDER / "quick.toml").traces(stimulus), recorded)
    for trace in recorded:  # else equal spikes would say nothing
        assert encode(trace.stress_pa, trace.dt_ms, PUBLISHED[trace.afferent])[0].size


@pytest.mark.slow
@pytest.mark.solver
def test_map_and_transient_agree_on_noise_solved_here(tmp_path):
    """The first 20 ms of a noise; of a sine ``test_chain`` shows it."""
    whole = make_stimulus(*resolve("noise_25_250_20"), preindent_um=60.0)
    stimulus = dataclasses.replace(
        whole, displacement_um=whole.displacement_um[:41], window_ms=(0.0, 20.0)
    )
    model = model_of(PRESETS["quick"])
    _, solved = solve_response(tmp_path / "response", model)
    folder = tmp_path / "transient"
    build_run_folder(folder, model, stimulus)
    run_ccx(read_run_folder(folder))

    assert_same_neurons(solved.traces(stimulus), read(folder))
    stored = stored_response(model.finger, model.probe, model.element)
    np.testing.assert_allclose(solved.tensor_pa, stored.tensor_pa, rtol=1e-6, atol=1e-3)
    assert read_run_folder(folder).start_ms > 0
