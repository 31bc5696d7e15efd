"""The table of solvers, and what another package adds to it."""

import importlib.metadata

import pytest

from fembridge.errors import MissingError
from fembridge.solver import batch
from fembridge.solver.batch import load_solver
from fembridge.solver.ccx import run_ccx


def test_calculix_is_in_the_table():
    assert load_solver("calculix") is run_ccx


def test_another_package_can_add_a_solver(monkeypatch):
    row = importlib.metadata.EntryPoint("mine", "math:hypot", batch.ENTRY_POINTS)
    rows = importlib.metadata.EntryPoints([row])
    monkeypatch.setattr(batch, "entry_points", lambda group: rows.select(group=group))

    assert load_solver("mine")(3.0, 4.0) == 5.0
    with pytest.raises(MissingError, match=r"no solver 'nine' here.*calculix, mine"):
        load_solver("nine")


def test_marc_and_abaqus_are_run_by_their_owners():
    with pytest.raises(MissingError, match=r"run_marc -jid job_s2s, then"):
        load_solver("marc")
    with pytest.raises(MissingError, match=r"abaqus job=job, .* to fembridge encode"):
        load_solver("abaqus")
