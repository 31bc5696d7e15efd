"""Half of a section: on its axis a reader takes no shear, whatever the solver wrote."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from fembridge.errors import ResultError
from fembridge.results import read
from fembridge.results.frd import read_stress_and_displacement, read_stress_tensor
from fembridge.results.read_options import ReadOptions
from fembridge.run_folder import read_run_folder

RECORDED = Path(__file__).parents[3] / "fixtures" / "transient_sine"
SXY = 3


def von_mises(tensor):
    """Of one tensor, xx yy zz xy yz zx, by its deviator."""
    xx, yy, zz, xy, yz, zx = tensor
    whole = np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]])
    deviator = whole - np.trace(whole) / 3 * np.eye(3)
    return np.sqrt(1.5 * (deviator**2).sum())


@pytest.fixture
def halved(tmp_path):
    """A recorded run, told that RA's node, where there is shear, is on the axis."""
    shutil.copytree(RECORDED, tmp_path / "run")
    run = read_run_folder(tmp_path / "run")
    replace(run, on_axis=(run.node_of()["RA"],)).write()
    return read_run_folder(tmp_path / "run")


def test_nodes_on_the_axis_come_back_as_they_were_written(halved):
    assert halved.on_axis == (halved.node_of()["RA"],)


def test_a_run_of_the_whole_says_nothing_of_an_axis():
    assert read_run_folder(RECORDED).on_axis == ()
    assert "on_axis" not in (RECORDED / "run.toml").read_text("utf-8")


def test_shear_on_the_axis_is_none_and_else_as_it_was(halved):
    nodes = list(halved.node_of().values())
    column = nodes.index(halved.on_axis[0])
    plain_pa = read_stress_tensor(halved.results, nodes)[1]
    options = ReadOptions(on_axis=halved.on_axis)
    tensor_pa = read_stress_tensor(halved.results, nodes, options)[1]
    assert np.abs(plain_pa[:, column, SXY]).max() > 100  # or this would show nothing
    expected_pa = plain_pa.copy()
    expected_pa[:, column, SXY] = 0.0
    assert_array_equal(tensor_pa, expected_pa)
    both = read_stress_and_displacement(halved.results, nodes, nodes, options)
    assert_array_equal(both.tensor_pa, expected_pa)


@pytest.mark.parametrize("by_number", [False, True])
def test_traces_of_a_half_are_made_without_that_shear(halved, by_number):
    node = halved.node_of()["RA"]
    chosen = [node] if by_number else None
    found = {trace.node: trace for trace in read(halved.folder, chosen)}
    plain = {trace.node: trace for trace in read(RECORDED, chosen)}
    tensor_pa = read_stress_tensor(halved.results, [node])[1][:, 0]
    tensor_pa[:, SXY] = 0.0
    expected_pa = [0.0, *map(von_mises, tensor_pa)]
    assert_allclose(found[node].stress_pa, expected_pa, rtol=1e-9, atol=1e-9)
    assert np.abs(found[node].stress_pa - plain[node].stress_pa).max() > 1
    for other in set(found) - {node}:
        assert_array_equal(found[other].stress_pa, plain[other].stress_pa)


@pytest.mark.parametrize("words", ["[0]", "[-3]", "[true]", '["two"]', "[1.5]", "7"])
def test_nodes_on_the_axis_that_are_none_are_refused(halved, words):
    path = halved.folder / "run.toml"
    text = path.read_text("utf-8")
    start = text.index("on_axis = ")
    end = text.index("]", start) + 1
    path.write_text(f"{text[:start]}on_axis = {words}{text[end:]}", "utf-8")
    with pytest.raises(ResultError):
        read_run_folder(halved.folder)
