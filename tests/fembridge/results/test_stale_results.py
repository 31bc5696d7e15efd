"""Results of a deck that has changed since are not taken for results of the new one."""

import shutil
from pathlib import Path

import pytest

from fembridge.errors import ResultError
from fembridge.results import read
from fembridge.store import sha256_of

RECORDED = Path(__file__).parents[3] / "fixtures" / "transient_sine"


@pytest.fixture
def folder(tmp_path):
    copy = tmp_path / "run"
    shutil.copytree(RECORDED, copy)
    (copy / "solver.toml").write_text(
        f'format = 1\ndeck_sha256 = "{sha256_of(copy / "job.inp")}"\n'
    )
    return copy


def test_results_of_the_deck_beside_them_are_read(folder):
    assert len(read(folder)) == 3


def test_a_deck_changed_after_the_run_is_named_with_what_to_do(folder):
    with (folder / "job.inp").open("a") as deck:
        deck.write("** another thought\n")

    with pytest.raises(ResultError, match=r"another deck than the job\.inp"):
        read(folder)


def test_results_without_a_record_are_taken_as_they_are(folder):
    (folder / "solver.toml").unlink()
    (folder / "job.inp").write_text("** mine\n")

    assert len(read(folder)) == 3
