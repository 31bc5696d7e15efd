"""Relaxing skin: CalculiX writes the mean over branches, a reader gives their sum."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from numpy.testing import assert_allclose, assert_array_equal

from fembridge.errors import ResultError
from fembridge.results import read
from fembridge.results.frd import read_stress_tensor
from fembridge.results.read_options import ReadOptions
from fembridge.run_folder import read_run_folder

RECORDED = Path(__file__).parents[3] / "fixtures" / "transient_sine"


@pytest.fixture
def relaxing(tmp_path):
    """A recorded run, told that PC's node has three branches."""
    shutil.copytree(RECORDED, tmp_path / "run")
    run = read_run_folder(tmp_path / "run")
    replace(run, branches={run.node_of()["PC"]: 3}).write()
    return read_run_folder(tmp_path / "run")


def test_the_branches_of_a_run_come_back_as_they_were_written(relaxing):
    assert dict(relaxing.branches) == {relaxing.node_of()["PC"]: 3}


def test_stress_is_the_sum_where_there_are_branches_and_else_as_it_was(relaxing):
    plain = {trace.afferent: trace for trace in read(RECORDED)}
    summed = {trace.afferent: trace for trace in read(relaxing.folder)}

    assert_allclose(summed["PC"].stress_pa, 3 * plain["PC"].stress_pa, rtol=1e-14, atol=1e-100)
    for other in ("SA", "RA"):
        assert_array_equal(summed[other].stress_pa, plain[other].stress_pa)


def test_a_node_asked_for_by_its_number_is_summed_as_well(relaxing):
    node = relaxing.node_of()["PC"]
    [trace] = read(relaxing.folder, [node])
    [plain] = read(RECORDED, [node])
    assert_allclose(trace.stress_pa, 3 * plain.stress_pa, rtol=1e-14, atol=1e-100)


@pytest.mark.parametrize("words", ["0", "x = 2", "461 = 0", '461 = "two"', "0 = 2"])
def test_branches_that_are_no_counts_are_refused(relaxing, words):
    path = relaxing.folder / "run.toml"
    node = relaxing.node_of()["PC"]
    text = path.read_text("utf-8").replace(f"{node} = 3", words)
    path.write_text(text, "utf-8")
    with pytest.raises(ResultError):
        read_run_folder(relaxing.folder)


def test_a_node_between_as_many_materials_as_branches_is_let_through(samples):
    path = samples / "cpe4_ascii.frd"
    mean = read_stress_tensor(path, [18], ReadOptions(across_materials=True))[1]
    summed = read_stress_tensor(path, [18], ReadOptions(branches={18: 2}))[1]
    assert_allclose(summed, 2 * mean, rtol=1e-14, atol=1e-100)
