"""An own deck with another waveform, solved: the probe goes where that says."""

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from decks.motion import Motion
from decks.own_model import Request
from decks.own_model.inp import rebase_inp
from fembridge.machine import find_ccx
from fembridge.results.readers import read_values

# As somebody else writes it: metres, lower case, tabs, a step before the waveform's, one behind.
FOREIGN = Path(__file__).with_name("foreign.inp")
PUNCH, UNDER = 31, 17
DT_S = 5e-4
MOTION = Motion(np.arange(7) * DT_S, np.array([0.0, 0.02, 0.06, 0.05, -0.01, 0.0, 0.1]), DT_S, 0)


@pytest.mark.solver
@pytest.mark.parametrize("clock", ["total time", "step time"])
def test_the_probe_goes_where_the_waveform_says_on_either_clock(tmp_path, clock):
    deck = FOREIGN.read_text("ascii").replace("\n", "\r\n").replace("Groesse", "Größe")
    deck = deck.replace("total time", clock)
    request = Request(afferents={"PUNCH": PUNCH, "UNDER": UNDER}, length_unit="m")
    rebased = rebase_inp(deck.encode("latin-1"), MOTION, request)
    assert_allclose(rebased.place_mm["UNDER"], (1.0, 1.0))
    assert rebased.deck.count(b"\n") == rebased.deck.count(b"\r\n")
    (tmp_path / "job.inp").write_bytes(rebased.deck)
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    subprocess.run([find_ccx(), "-i", "job"], cwd=tmp_path, env=environment, check=True)
    times_ms, moved = read_values(tmp_path / "job.frd", [PUNCH], quantity="displacement")
    depth_mm = -1e3 * moved[:, 0, 1]
    # One output at the end of the first step; the step after the waveform's is left out.
    wanted = [0.0, *MOTION.depth_mm[1:]]
    assert_allclose(times_ms, 1000.0 + 1e3 * MOTION.time_s, rtol=1e-12)
    assert_allclose(depth_mm, wanted, rtol=0, atol=1e-9)
    _, stress = read_values(tmp_path / "job.frd", [UNDER])
    assert ((stress[1:, 0, 1] < 0) == (depth_mm[1:] > 1e-6)).all()  # pressed where it is deep
