"""An own deck with another waveform, solved: the probe goes where that says."""

import os
import subprocess
from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose

from decks.motion import Motion
from decks.own_model import Request
from decks.own_model.inp import rebase_inp
from fembridge.machine import find_ccx
from fembridge.results.source import read_values

moved_at = partial(read_values, quantity="displacement")


pytestmark = pytest.mark.solver


def solve(folder, deck):
    """Run ccx; its result file."""
    folder.mkdir()
    (folder / "job.inp").write_bytes(deck)
    run = subprocess.run(
        [find_ccx(), "-i", "job"],
        cwd=folder,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert "*ERROR" not in run.stdout
    return folder / "job.frd"


# ---- A deck as somebody else writes it: metres, lower case, CRLF, tabs, two steps

WIDE, HIGH = 6, 4
CELL_M = 0.0005
DT_S = 5e-4
MOTION = Motion(np.arange(7) * DT_S, np.array([0.0, 0.02, 0.06, 0.05, -0.01, 0.0, 0.1]), DT_S, 0)
UNDER = 17


def mesh_lines():
    yield "*node,nset=nall"
    for row in range(HIGH + 1):
        for column in range(WIDE + 1):
            node = row * (WIDE + 1) + column + 1
            yield f"\t{node}, {column * CELL_M:g} ,{row * CELL_M:g}"
    yield "*element , type=CPE4 , elset=tissue"
    for row in range(HIGH):
        for column in range(WIDE):
            first = row * (WIDE + 1) + column + 1
            above = first + WIDE + 1
            nodes = f"{first}, {first + 1}, {above + 1}, {above}"
            yield f"{row * WIDE + column + 1}, {nodes}"
    yield "*nset, nset=bottom, generate"
    yield f"1, {WIDE + 1}"
    yield "*nset,nset=punch"
    yield f"{HIGH * (WIDE + 1) + 3}, {HIGH * (WIDE + 1) + 4},"
    yield from ("*material, name=soft", "*elastic", "5.e4, .45")
    yield from ("*solid section, elset=tissue, material=soft", "0.001")


FOREIGN_TABLE = ("** seconds, share of 0.2 mm", "0., 0.", "1., 0., 2., 1.")
HOLD = (
    "** first let it settle",
    "*step,nlgeom",
    "*static",
    " 1., 1.",
    "*boundary",
    "bottom,1,2",
    "punch,1,2,0.",
    "*node file, frequency=7",
    "u",
    "*end step",
)


def foreign():
    yield from ("*heading", "  *NOT a card, Größe in m")
    yield from mesh_lines()
    yield from ("*amplitude, name = Press,\ttime = total time", *FOREIGN_TABLE)
    yield from HOLD
    yield from ("*step,nlgeom,inc=5", "*static", "0.05, 1., 1.e-5, .1")
    yield from ("*boundary, op=mod, amplitude=press", "punch,2,2,-2.e-4")
    yield from ("*node file", "u, rf", "** strains too", "*el file", "s, e")
    yield from ("*node print, nset=punch, totals=only", "rf", "*end step")


@pytest.mark.parametrize("clock", ["total time", "step time"])
def test_the_probe_goes_where_the_waveform_says_on_either_clock(tmp_path, clock):
    deck = "\r\n".join([*foreign(), "*step", "*static", "*end step", ""])
    deck = deck.replace("total time", clock)
    punch = HIGH * (WIDE + 1) + 3
    request = Request(afferents={"PUNCH": punch, "UNDER": UNDER}, length_unit="m")
    rebased = rebase_inp(deck.encode("latin-1"), MOTION, request)
    assert_allclose(rebased.place_mm["UNDER"], (1.0, 1.0))
    assert rebased.deck.count(b"\n") == rebased.deck.count(b"\r\n")
    run = solve(tmp_path / "run", rebased.deck)
    times_ms, moved = moved_at(run, [punch])
    depth_mm = -1e3 * moved[:, 0, 1]
    # One output at the end of the first step; the step after the waveform's is left out.
    wanted = [0.0, *MOTION.depth_mm[1:]]
    assert_allclose(times_ms, 1000.0 + 1e3 * MOTION.time_s, rtol=1e-12)
    assert_allclose(depth_mm, wanted, rtol=0, atol=1e-9)
    _, stress = read_values(run, [UNDER])
    assert ((stress[1:, 0, 1] < 0) == (depth_mm[1:] > 1e-6)).all()  # pressed where it is deep
