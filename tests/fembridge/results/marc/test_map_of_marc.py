"""A map from the post file that a user of Marc brings."""

from pathlib import Path

import numpy as np
import post_writer as writer
import pytest
import stress_models as models
from numpy.testing import assert_allclose

import fembridge as fb
from fembridge.errors import ResultError
from fembridge.response.deck_map import load_unload_of
from fembridge.response.indentation import HysteresisError

pytestmark = pytest.mark.filterwarnings("ignore:.*softest material")  # a beam of steel
DECK = Path(__file__).parents[4] / "fixtures" / "marc_samples" / "nour_linear.dat"
PA_PER_UM = 40.0


def post_file(path, run, lag=0.0):
    """Stress that is proportional to the load; `lag` of it is left behind in unloading.

    Marc has cut the third increment, so there is an output between two samples.
    """
    stimulus = load_unload_of(run)
    samples_um, samples_s = stimulus.displacement_um, stimulus.times_ms / 1000
    stress_mpa = samples_um * (1 - lag * (np.diff(samples_um, prepend=0) < 0)) * PA_PER_UM * 1e-6

    def stress(x, y, layer, time_s):
        return [np.interp(time_s, samples_s, stress_mpa), 0, 0, 0, 0, 0]

    plane = models.Plane(80, *models.grid(3, 2), layers=[0] * 6)
    times_s = sorted([*samples_s.tolist(), samples_s[2:4].mean()])
    increments = plane.increments(stress, times_s)
    storage = writer.Storage()
    path.write_bytes(writer.post_bytes(storage, plane.model(sets=()), increments))


@pytest.fixture
def run(here):
    return fb.map_deck(DECK, "map", afferents={"SA": [3, 6], "RA": 7}, newton_per_um=10.0)


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_map_is_the_stress_of_the_file_against_the_load(run, here):
    post_file(here / "theirs.t16", run)
    mapped = fb.map_response("map", results="theirs.t16")
    assert [site.key for site in mapped.response.places] == ["SA 3", "SA 6", "RA"]
    table = mapped.table
    assert_allclose(table["von_mises_pa"], PA_PER_UM * np.abs(table["depth_um"]), rtol=1e-5)
    assert_allclose(table["force_n"], 10.0 * table["depth_um"])
    assert fb.DeckResponse.read("map").table.equals(table)


def test_a_table_exported_from_mentat_makes_the_same_map(run, here):
    stimulus = load_unload_of(run)
    rows = [
        f"{time_ms:g},,{node},{PA_PER_UM * abs(depth_um):.9g}"
        for node in (3, 6, 7)
        for time_ms, depth_um in zip(stimulus.times_ms, stimulus.displacement_um, strict=True)
    ]
    (here / "traces.csv").write_text(
        "time_ms,afferent,node,von_mises_pa\n" + "\n".join(rows) + "\n"
    )
    table = fb.map_response("map", results="traces.csv").table
    assert_allclose(table["von_mises_pa"], PA_PER_UM * np.abs(table["depth_um"]), rtol=1e-6)


def test_a_file_that_does_not_close_or_is_of_another_run_is_refused(run, here):
    post_file(here / "lag.t16", run, lag=0.02)
    with pytest.raises(HysteresisError) as refused:
        fb.map_response("map", results="lag.t16")
    assert_allclose(refused.value.closure_percent, 100 * 0.02 / 0.98, rtol=1e-3)
    shorter = fb.map_deck(DECK, "other", afferents={"SA": 3}, newton_per_um=10.0, retract_um=0.0)
    post_file(here / "short.t16", shorter)
    with pytest.raises(ResultError):
        fb.map_response("map", results="short.t16")
    with pytest.raises(ResultError):
        fb.map_response("map", results="none.t16")
