"""A response map whose curves are known, and a solver that plays what it is given.

The solver stands for ccx on the ladder of contact models: each one's results are
the recorded ones of the quick finger, put where the solver would leave them.
"""

import shutil
from pathlib import Path

import numpy as np
import pytest

from decks.presets import PRESETS, model_of
from fembridge.response import indentation
from fembridge.response.indentation import HysteresisError
from fembridge.response.response_map import ResponseMap
from fembridge.run_folder import AfferentNode, read_run_folder
from fembridge.solver import ccx
from fembridge.solver.verdict import Cause, Failure, Outcome

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


RECORDED = Path(__file__).parents[3] / "fixtures" / "response_quick"


@pytest.fixture(scope="module")
def model():
    return model_of(PRESETS["quick"])


class Player:
    """Stands for `run_ccx`: one play a contact model, by its number; `smooth` are its twins."""

    def __init__(self):
        self.plays = {}
        self.numbers = []
        self.smooth = []

    def __call__(self, run, settings=None, halt=None):
        folder = run.folder
        if folder.name.startswith("frictionless_"):
            self.smooth.append(folder)
            return self.solve(folder)
        number = int(folder.name.removeprefix("contact_"))
        self.numbers.append(number)
        play = self.plays.get(number, "solve")
        if isinstance(play, Cause):
            return Outcome(folder, Failure(play, "increment 3"))
        return self.solve(folder)

    def solve(self, folder):
        run = read_run_folder(folder)
        for name in ("job.frd", "job.dat"):
            shutil.copy(RECORDED / name, folder)
        outcome = Outcome(folder, version="2.20", exit_code=0, wall_s=12.3, increments=39)
        ccx.write_record(folder, run.solver, outcome)
        return outcome


@pytest.fixture
def player(monkeypatch):
    player = Player()
    monkeypatch.setattr(ccx, "run_ccx", player)
    return player


@pytest.fixture
def path_dependent(monkeypatch):
    """Have what was solved in folders of these names refused; frictionless twins are.

    To have a twin accepted, take its name out.
    """
    names = {f"frictionless_{number}" for number in range(1, 10)}
    measured = indentation.measured_response

    def judge(run, stimulus):
        if run.folder.name in names:
            raise HysteresisError("unloading differs from loading by 17 %", 17.0)
        return measured(run, stimulus)

    monkeypatch.setattr(indentation, "measured_response", judge)
    return names
