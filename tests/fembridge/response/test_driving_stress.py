"""The stress that each model reads: von Mises, or that of equal energy."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from decks.material import TABLE_1
from decks.stimuli import resolve
from decks.waveform import make_stimulus
from fembridge.errors import ResponseError
from fembridge.response.response_map import FOLDER, read_map
from fembridge.results.stress import energy_stress_pa
from neural import PUBLISHED, drive_named

RESPONSE = read_map(FOLDER / "quick.toml")
STIMULUS = make_stimulus(resolve("sine_20_250")[0], preindent_um=50.0)
ENERGY = {name: drive_named("energy", name) for name in ("SA", "RA", "PC")}


def test_models_that_read_von_mises_stress_get_the_traces_of_the_response():
    expected = RESPONSE.traces(STIMULUS)
    rising = {name: drive_named("rising", name) for name in ("SA", "RA")}
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
