"""The response map: its curves, what drives read of it, and those that are stored."""

import dataclasses
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.interpolate import PchipInterpolator

from decks.finger_file import finger_from
from decks.material import TABLE_1
from decks.presets import PRESETS, QUICK
from decks.probe import Probe
from decks.stimuli import resolve
from decks.waveform import make_stimulus
from fembridge.errors import ResponseError
from fembridge.response import response_map
from fembridge.response.response_map import FOLDER, read_map, stored_response
from fembridge.results.stress import energy_stress_pa, von_mises_pa
from fembridge.stimulus import Stimulus
from neural import PUBLISHED
from neural.models import model_named

depths_below_300 = st.lists(st.floats(0.0, 300.0), min_size=2, max_size=40)


def stimulus_of(depth_um):
    depth_um = np.asarray(depth_um, dtype=np.float64)
    return Stimulus("mine", depth_um, 0.5, (0.0, 0.5 * (depth_um.size - 1)))


def test_at_its_own_levels_a_map_is_exact(made_map):
    """The deepest closes the last polynomial: there, to the last bits."""
    response = made_map()

    found_pa = response.tensors(response.depth_um)

    assert_array_equal(found_pa[:-1], response.tensor_pa[:-1])
    assert_allclose(found_pa[-1], response.tensor_pa[-1], rtol=1e-14)
    for column, trace in enumerate(response.traces(stimulus_of(response.depth_um))):
        stress_pa = von_mises_pa(response.tensor_pa[:, column])
        assert_array_equal(trace.stress_pa[:-1], stress_pa[:-1])


def test_a_trace_knows_its_node_its_class_and_its_clock(made_map):
    sa, pc = made_map().traces(stimulus_of([0.0, 10.0, 5.0]))

    assert [(t.afferent, t.node) for t in (sa, pc)] == [("SA", 11), ("PC", 12)]
    assert (sa.dt_ms, sa.start_ms, sa.stress_pa.size) == (0.5, 0.0, 3)


@given(lifted_um=st.lists(st.floats(-500.0, 0.0), min_size=2, max_size=20))
def test_a_probe_that_is_lifted_off_leaves_no_stress(made_map, lifted_um):
    for trace in made_map().traces(stimulus_of(lifted_um)):
        assert_array_equal(trace.stress_pa, 0.0)


@given(depth_um=depths_below_300)
def test_between_two_levels_no_component_overshoots(made_map, depth_um):
    response = made_map()
    found = response.tensors(np.array(depth_um))

    above = np.searchsorted(response.depth_um, depth_um, side="left").clip(1)
    ends = response.tensor_pa[above - 1], response.tensor_pa[above]
    slack = 1e-9 * np.abs(response.tensor_pa).max()
    assert (found >= np.minimum(*ends) - slack).all()
    assert (found <= np.maximum(*ends) + slack).all()


@given(depth_um=depths_below_300)
def test_stress_is_that_of_the_interpolated_tensor(made_map, depth_um):
    response = made_map()
    tensor_pa = response.tensors(np.array(depth_um))
    for column, trace in enumerate(response.traces(stimulus_of(depth_um))):
        assert_array_equal(trace.stress_pa, von_mises_pa(tensor_pa[:, column]))


@given(depth_um=st.floats(0.0, 300.0))
def test_a_component_is_the_pchip_of_its_own_levels(made_map, depth_um):
    response = made_map()
    found = response.tensors(np.array([depth_um]))[0]
    for column in range(2):
        for k in range(4):
            levels_pa = response.tensor_pa[:, column, k]
            curve = PchipInterpolator(response.depth_um, levels_pa)
            assert_allclose(found[column, k], curve(depth_um), rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("depth_um", [0.5, 33.0, 222.2])
def test_a_straight_line_stays_one(made_map, depth_um):
    """The second component of SA is -100 Pa a micrometre: any depth, closed form."""
    tensor_pa = made_map().tensors(np.array([depth_um]))
    assert_allclose(tensor_pa[0, 0, 1], -100.0 * depth_um, rtol=1e-12)


def test_the_scheme_of_fritsch_and_carlson_worked_out_by_hand(made_map):
    """Slopes 1 and 3 over equal steps: the middle derivative is their harmonic mean.

    Ends by the three-point formula: (3*1 - 3)/2 = 0 at 0.
    """
    tensor_pa = np.zeros((3, 2, 6))
    tensor_pa[:, 0, 1] = [0.0, 10.0, 40.0]
    response = made_map(
        depth_um=[0.0, 10.0, 20.0], tensor_pa=tensor_pa, force_n_per_mm=[0.0, 1.0, 2.0]
    )
    at_5 = response.tensors(np.array([5.0]))[0, 0, 1]
    d0, d1 = 0.0, 2 * 1 * 3 / (1 + 3)
    assert_allclose(at_5, 0.5 * (0 + 10) + 10 / 8 * (d0 - d1), rtol=1e-12)


@pytest.mark.parametrize("depth_um", [300.001, 301.0, 5e5])
def test_a_stimulus_that_goes_too_deep_is_refused_with_both_depths(made_map, depth_um):
    with pytest.raises(ResponseError) as caught:
        made_map().traces(stimulus_of([0.0, depth_um, 0.0]))
    assert str(caught.value) == (f"mine goes {depth_um:g} um deep, the response map reaches 300 um")


def test_a_stimulus_a_nanometre_too_deep_does_not_seem_to_fit(made_map):
    with pytest.raises(ResponseError, match=r"goes 300\.000001 um deep"):
        made_map().traces(stimulus_of([0.0, 300.000001]))


@pytest.mark.parametrize("depth_um", [np.nan, np.inf, -np.inf])
def test_a_depth_that_is_none_is_refused(made_map, depth_um):
    with pytest.raises(ResponseError, match="probe: a probe depth is not finite"):
        made_map().tensors(np.array([0.0, depth_um]))


BAD = [
    {"depth_um": np.arange(7.0)},
    {"force_n_per_mm": np.zeros(3)},
    {"tensor_pa": np.zeros((8, 2, 4))},
    {"tensor_pa": np.zeros((8, 3, 6))},
    {"places": (), "tensor_pa": np.zeros((8, 0, 6))},
    {"depth_um": np.arange(8.0) + 1},
    {"depth_um": np.array([0.0, 1, 2, 2, 3, 4, 5, 6])},
    {"depth_um": np.arange(8.0)[:, None]},
    {"depth_um": np.full(8, np.nan)},
    {"tensor_pa": np.full((8, 2, 6), np.inf)},
    {"tensor_pa": np.ones((8, 2, 6))},
    {"closure_percent": -1.0},
]


@pytest.mark.parametrize("changes", BAD)
def test_what_does_not_belong_together_is_no_map(made_map, changes):
    with pytest.raises(ResponseError):
        made_map(**changes)


def test_out_of_plane_shear_is_no_plane_strain(made_map):
    tensor_pa = made_map().tensor_pa.copy()
    tensor_pa[3, 1, 5] = 1e-9
    with pytest.raises(ResponseError):
        made_map(tensor_pa=tensor_pa)


def test_two_depths_are_no_curve(made_map):
    with pytest.raises(ResponseError, match="expected three or more depths"):
        made_map(depth_um=[0.0, 1.0], tensor_pa=np.zeros((2, 2, 6)), force_n_per_mm=[0, 1])


def test_a_map_lets_nobody_write(made_map):
    response = made_map()
    with pytest.raises(ValueError, match="read-only"):
        response.tensor_pa[1, 0, 0] = 5.0
    with pytest.raises(AttributeError):
        response.closure_percent = 0.0
    assert response.deepest_um == 300.0


RESPONSE = read_map(FOLDER / "quick.toml")
STIMULUS = make_stimulus(resolve("sine_20_250")[0], preindent_um=50.0)
ENERGY = {name: model_named("energy", name) for name in ("SA", "RA", "PC")}


def test_models_that_read_von_mises_stress_get_the_traces_of_the_response():
    expected = RESPONSE.traces(STIMULUS)
    rising = {name: model_named("rising", name) for name in ("SA", "RA")}
    for models in ({}, rising, PUBLISHED):
        found = RESPONSE.traces(STIMULUS, models)
        assert [t.afferent for t in found] == [t.afferent for t in expected]
        for one, other in zip(found, expected, strict=True):
            assert_array_equal(one.stress_pa, other.stress_pa)
            assert (one.node, one.dt_ms, one.start_ms) == (other.node, other.dt_ms, other.start_ms)


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


def test_parameters_of_an_energy_drive_read_what_their_drive_reads():
    parameters = {name: replace(one, drive="energy") for name, one in PUBLISHED.items()}
    by_parameters = RESPONSE.traces(STIMULUS, parameters)
    by_drive = RESPONSE.traces(STIMULUS, ENERGY)
    for one, other in zip(by_parameters, by_drive, strict=True):
        assert_array_equal(one.stress_pa, other.stress_pa)


def test_each_class_reads_its_own():
    mixed = {"SA": ENERGY["SA"], "RA": PUBLISHED["RA"]}
    energy = RESPONSE.traces(STIMULUS, ENERGY)
    plain = RESPONSE.traces(STIMULUS)
    found = RESPONSE.traces(STIMULUS, mixed)
    for one, other in zip(found, (energy[0], plain[1], plain[2]), strict=True):
        assert_array_equal(one.stress_pa, other.stress_pa)
    assert not np.array_equal(energy[0].stress_pa, plain[0].stress_pa)


@pytest.mark.parametrize(
    "origin", [{}, {"finger": "quick"}, {"finger": {"materials": {"epidermis": {}}}}]
)
def test_an_energy_without_its_material_is_refused_and_a_plain_stress_is_not(origin):
    bare = replace(RESPONSE, origin=origin)
    with pytest.raises(ResponseError, match="Poisson's ratio of epidermis, in which SA"):
        bare.traces(STIMULUS, ENERGY)
    assert len(bare.traces(STIMULUS, PUBLISHED)) == 3


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
