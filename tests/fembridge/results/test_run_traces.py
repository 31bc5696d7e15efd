"""Traces on the clock of the stimulus, from a run folder."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from fembridge.errors import ResultError
from fembridge.results import read
from fembridge.run_folder import AfferentNode, RunFolder


@pytest.fixture
def make_run(tmp_path, write_frd, block):
    """Make a run folder whose stress is 1, 2, 3, ... MPa, uniaxial."""

    def make(increments=6, start_ms=0.0, planned=None, dt_ms=0.5, nodes=(3, 1)):
        folder = tmp_path / "run"
        folder.mkdir()
        blocks = [
            block(
                "STRESS",
                k,
                k * dt_ms / 1e3,
                [(n, [float(k * n), 0, 0, 0, 0, 0]) for n in (1, 2, 3)],
                flag=3,
            )
            for k in range(1, increments + 1)
        ]
        write_frd(blocks).rename(folder / "job.frd")
        places = tuple(
            AfferentNode(name, node, "dermis", 0.0, 0.0, 1.0)
            for name, node in zip(("SA", "RA"), nodes, strict=True)
        )
        total = increments if planned is None else planned
        RunFolder(folder, "calculix", total, dt_ms, start_ms, places, "0").write()
        return folder

    return make


def test_without_a_ramp_a_rest_sample_of_zero_comes_first(make_run):
    sa, ra = read(make_run())
    assert (sa.afferent, sa.node, ra.afferent, ra.node) == ("SA", 3, "RA", 1)
    assert (ra.start_ms, ra.dt_ms) == (0.0, 0.5)
    assert ra.stress_pa[0] == 0.0
    assert_allclose(ra.stress_pa, np.arange(7) * 1e6, rtol=1e-12)
    assert_allclose(sa.stress_pa, np.arange(7) * 3e6, rtol=1e-12)


def test_with_a_ramp_its_last_increment_is_time_zero(make_run):
    _, ra = read(make_run(start_ms=1.0))
    assert ra.start_ms == 0.0
    assert_allclose(ra.stress_pa, [2e6, 3e6, 4e6, 5e6, 6e6], rtol=1e-12)


def test_a_printed_third_of_a_ms_is_an_even_step(make_run):
    _, ra = read(make_run(increments=300, dt_ms=1 / 3, start_ms=10 / 3))
    assert ra.stress_pa[0] == 10e6
    assert_allclose(ra.dt_ms, 1 / 3, rtol=1e-5)


def test_nodes_named_beside_a_run_are_plain_and_on_its_clock(make_run):
    (trace,) = read(make_run(start_ms=1.0), [2])
    assert (trace.afferent, trace.node, trace.start_ms) == (None, 2, 0.0)
    assert trace.stress_pa[0] == 4e6


def test_two_afferents_may_share_a_node(make_run):
    sa, ra = read(make_run(nodes=(2, 2)))
    assert (sa.afferent, ra.afferent, sa.node, ra.node) == ("SA", "RA", 2, 2)
    assert_allclose(sa.stress_pa, ra.stress_pa, rtol=0)


def test_a_stimulus_that_begins_between_increments_is_refused(make_run):
    with pytest.raises(ResultError, match=r"stimulus begins at 0\.75 ms"):
        read(make_run(start_ms=0.75))


def test_a_stimulus_that_begins_after_the_results_is_refused(make_run):
    words = "stimulus begins at 3 ms of solver time, the file holds 0.5 to 3 ms"
    with pytest.raises(ResultError, match=words):
        read(make_run(start_ms=3.0))


def test_results_that_stop_short_of_the_deck_are_refused_or_told(make_run):
    folder = make_run(increments=4, planned=6)
    with pytest.raises(ResultError, match="results end at 2 ms, the deck runs to 3 ms"):
        read(folder)
    heard = []
    _, ra = read(folder, partial=True, tell=heard.append)
    assert ra.stress_pa.size == 5
    assert heard == ["results end at 2 ms, the deck runs to 3 ms"]
