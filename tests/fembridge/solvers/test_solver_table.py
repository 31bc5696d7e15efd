"""The table of solvers, and what another package adds to it."""

import importlib.metadata

import pytest

import fembridge.solvers
from fembridge.errors import MissingError
from fembridge.solvers import SOLVERS, load_solver
from fembridge.solvers.calculix import attempt_calculix


def test_calculix_is_in_the_table():
    assert load_solver("calculix") is attempt_calculix


@pytest.mark.parametrize("name", SOLVERS)
def test_every_row_can_be_loaded(name):
    assert callable(load_solver(name))


def test_another_package_can_add_a_solver(monkeypatch):
    row = importlib.metadata.EntryPoint("mine", "math:hypot", fembridge.solvers.ENTRY_POINTS)
    rows = importlib.metadata.EntryPoints([row])
    monkeypatch.setattr(fembridge.solvers, "entry_points", lambda group: rows.select(group=group))

    assert load_solver("mine")(3.0, 4.0) == 5.0
    with pytest.raises(MissingError, match=r"no solver 'nine' here.*calculix, mine"):
        load_solver("nine")


def test_marc_and_abaqus_are_run_by_their_owners():
    with pytest.raises(MissingError, match=r"run_marc -jid job_s2s, then"):
        load_solver("marc")
    with pytest.raises(MissingError, match=r"abaqus job=job, .* to fembridge encode"):
        load_solver("abaqus")
