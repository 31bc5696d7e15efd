"""Decks as they are: recorded ones taken or refused, and a foreign one solved."""

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from decks.calculix import calculix_deck
from decks.contact_analysis import Model
from decks.motion import Motion
from decks.own_model import Request
from decks.own_model.inp_deck import rebase_inp
from decks.presets import QUICK, mesh_of
from fembridge.errors import DeckError
from fembridge.host.machine import find_ccx
from fembridge.results.readers import read_values
from fembridge.stimulus import Stimulus

FIXTURES = Path(__file__).parents[3] / "fixtures"
# Those of `paper` are as those of `quick`, and large.
DECKS = sorted(path for path in FIXTURES.rglob("*.inp") if "paper" not in path.parent.name)
MOTION = Motion(np.arange(5) * 5e-4, np.array([0.0, 0.1, 0.2, 0.1, 0.0]), 5e-4, 0)
REFUSED = {
    "cpe4_2step_mixed": "several amplitudes move something: PRESS (line 141), P2",
    "cpe4_timepoints": "line 149: *CONTACT FILE, TIME POINTS",
}
# Words of what may change: data of the amplitude, increments, requests.
PLACES = ("*STEP", "*STATIC", "*DYNAMIC", "*NODE OUTPUT", "*NODE FILE", "*EL", "U", "S")


def name_of(path):
    return path.stem if path.stem != "job" else path.parent.name


@pytest.mark.parametrize("path", DECKS, ids=name_of)
def test_a_recorded_deck_takes_a_waveform_or_says_why_not(path):
    data = path.read_bytes()
    if path.stem in REFUSED:
        with pytest.raises(DeckError) as caught:
            rebase_inp(data, MOTION, Request())
        assert str(caught.value).startswith(REFUSED[path.stem])
        return
    rebased = rebase_inp(data, MOTION, Request()).deck
    assert rebase_inp(rebased, MOTION, Request()).deck == rebased
    old, new = data.decode().splitlines(), rebased.decode().splitlines()
    heads = [k for k, line in enumerate(old) if line.startswith("*AMPLITUDE")]
    if not heads:  # it gets one: where the first step was
        step = old.index("*STEP")
        assert new[: step + 1] == [*old[:step], "*AMPLITUDE, NAME=FEMBRIDGE_WAVEFORM"]
        assert "NR,1,1,0.02" in new
        return
    mesh = heads[0] + 1
    assert new[:mesh] == old[:mesh]
    kept = set(new)
    table = old[mesh : next(k for k in range(mesh, len(old)) if old[k][0] == "*")]
    for line in old[mesh + len(table) :]:
        words = line.split(",")
        if line not in kept and not line.startswith(PLACES):
            assert all(word.strip().replace(".", "").isdigit() for word in words)


def test_our_own_deck_with_another_waveform_is_the_deck_of_that_but_for_its_sets():
    model = Model(QUICK, mesh_of(QUICK))
    wanted = Stimulus("wanted", np.array([0.0, 15.0, -2.0, 40.0, 80.5]), 0.5, (0.0, 2.0))
    other = Stimulus("other", np.array([0.0, 5.0, 50.0]), 1.0, (0.0, 2.0))
    analysis = model.analysis(wanted)
    base = calculix_deck(model.analysis(other)).encode()
    rebased = rebase_inp(base, analysis.motion, Request(afferents=analysis.afferent))
    ours, own = calculix_deck(analysis).splitlines(), rebased.deck.decode().splitlines()
    rest = iter(own)
    kept = (line for line in ours if not line.startswith(("fembridge", "*", "U", "S")))
    assert [line for line in kept if line not in rest] == []  # in this order
    asked = [line for line in own if "FEMBRIDGE_OUTPUT" in line]
    assert asked == [
        "*NSET, NSET=FEMBRIDGE_OUTPUT",
        "*NODE OUTPUT, NSET=FEMBRIDGE_OUTPUT, FREQUENCY=1, DOUBLE",
        "*ELEMENT OUTPUT, NSET=FEMBRIDGE_OUTPUT, FREQUENCY=1, DOUBLE",
    ]
    place = analysis.mesh.node_mm[[node - 1 for node in analysis.afferent.values()]]
    assert_allclose([site.position_mm for site in rebased.sites.values()], place, rtol=0, atol=1e-9)


# As somebody else writes it: metres, lower case, tabs, a step before the waveform's, one behind.
FOREIGN = Path(__file__).with_name("foreign.inp")
PUNCH, UNDER = 31, 17
WAY_MM = np.array([0.0, 0.02, 0.06, 0.05, -0.01, 0.0, 0.1])
FOREIGN_MOTION = Motion(np.arange(7) * 5e-4, WAY_MM, 5e-4, 0)


@pytest.mark.solver
@pytest.mark.parametrize("clock", ["total time", "step time"])
def test_the_probe_goes_where_the_waveform_says_on_either_clock(tmp_path, clock):
    deck = FOREIGN.read_text("ascii").replace("\n", "\r\n").replace("Groesse", "Größe")
    deck = deck.replace("total time", clock)
    request = Request(afferents={"PUNCH": PUNCH, "UNDER": UNDER}, length_unit="m")
    rebased = rebase_inp(deck.encode("latin-1"), FOREIGN_MOTION, request)
    assert_allclose(rebased.sites["UNDER"].position_mm, (1.0, 1.0))
    assert rebased.deck.count(b"\n") == rebased.deck.count(b"\r\n")
    (tmp_path / "job.inp").write_bytes(rebased.deck)
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    subprocess.run([find_ccx(), "-i", "job"], cwd=tmp_path, env=environment, check=True)
    times_ms, moved = read_values(tmp_path / "job.frd", [PUNCH], quantity="displacement")
    depth_mm = -1e3 * moved[:, 0, 1]
    # One output at the end of the first step; the step after the waveform's is left out.
    wanted = [0.0, *FOREIGN_MOTION.depth_mm[1:]]
    assert_allclose(times_ms, 1000.0 + 1e3 * FOREIGN_MOTION.time_s, rtol=1e-12)
    assert_allclose(depth_mm, wanted, rtol=0, atol=1e-9)
    _, stress = read_values(tmp_path / "job.frd", [UNDER])
    assert ((stress[1:, 0, 1] < 0) == (depth_mm[1:] > 1e-6)).all()  # pressed where it is deep
