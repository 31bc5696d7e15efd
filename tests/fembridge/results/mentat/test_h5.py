"""The ``.h5`` of Marc: files made by h5py after the description, as no real one is."""

import csv
import sys

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from fembridge.errors import MissingError, ResultError
from fembridge.results.mentat.h5 import (
    H5Increment,
    describe,
    quantities,
    read,
    read_element_scalar,
    read_increments,
    read_nodal,
)
from fembridge.results.printed.print_tables import print_table_of, write_print_table
from fembridge.results.read_options import ReadOptions

SUMMARY = (
    "INC", "SUBINC", "ITERTN", "CASE", "CYCL_INC", "SEPA_INC", "CUT_INC", "CYCL_TOT",
    "SEPA_TOT", "CUT_TOT", "RMESH", "DEACT", "CONT_GEOM", "ANALFLAG",
)  # fmt: skip
NODES, INCREMENTS, ELEMENTS, POINTS = 5, 3, 4, 2
DISPLACEMENT = "Marc/Results/Node/Displacement"
MISES, QUAD = "Equivalent Von Mises Stress", "Quad4"
SCALAR = f"Marc/Results/Element/Scalar/{MISES}/{QUAD}"


@pytest.fixture
def h5py():
    return pytest.importorskip("h5py", reason="no h5py, which is optional")


@pytest.fixture
def values():
    """Numbers of which no two are alike, by the axes that matter."""
    generator = np.random.default_rng(5)
    return {
        "nodal": generator.normal(size=(NODES, 3, INCREMENTS)),
        "scalar": generator.normal(size=(ELEMENTS, INCREMENTS, POINTS)),
    }


@pytest.fixture
def job(h5py, tmp_path, values):
    """A function that writes a file as described, changed, and gives its path."""

    def write(change=None, rows=None):
        path = tmp_path / "job.h5"
        with h5py.File(path, "w") as file:
            marc = file.create_group("Marc")
            marc.attrs["precision"] = np.array([1])
            marc.attrs["title"] = np.array([b"finger"])
            file["Marc/Summary"] = summary() if rows is None else rows
            nodal = values["nodal"].reshape(NODES, 3, INCREMENTS, 1, 1, 1, 1)
            file[DISPLACEMENT] = nodal
            file["Marc/Results/Node/Node Post Summary"] = np.ones((1, 5, 3, 1, 1, 1, 1))
            scalar = values["scalar"].reshape(ELEMENTS, 1, INCREMENTS, POINTS, 1, 1, 1, 1)
            file[SCALAR] = scalar
            file["Marc/Input/Something"] = np.arange(3)
            if change is not None:
                change(file)
        return path

    return write


def summary(times_s=(0.0, 0.0005, 0.001)):
    """The list of increments, and the row that marks its end."""
    kinds = [(name, "i8") for name in SUMMARY]
    kinds += [("TIME_INC", "f8"), ("TIME_TOT", "f8"), ("TITLE", "S70")]
    rows = np.zeros(len(times_s) + 1, dtype=kinds)
    for row, time_s in zip(rows, times_s, strict=False):
        increment = round(time_s / 0.0005)
        row["INC"], row["CASE"], row["CYCL_INC"] = increment, 1, 10 + increment
        row["CYCL_TOT"], row["CUT_TOT"], row["RMESH"] = 20 + increment, 30, 40
        row["SEPA_INC"], row["CUT_INC"], row["SEPA_TOT"] = 50, 60, 70
        row["TIME_INC"], row["TIME_TOT"] = 0.0005, time_s
    rows[-1]["INC"] = -1
    return rows


def replaced(place, array):
    def change(file):
        del file[place]
        file[place] = array

    return change


def test_the_increments_stand_in_the_list_up_to_the_row_that_ends_it(job):
    found = read_increments(job())
    assert len(found) == INCREMENTS
    assert found[1] == H5Increment(1, 1, 0, 11, 50, 60, 21, 70, 30, 40, 0.5, 0.5)
    assert [row.total_time_ms for row in found] == [0.0, 0.5, 1.0]


def test_a_list_without_its_end_is_of_a_job_that_runs(job):
    assert len(read_increments(job(rows=summary()[:-1]))) == INCREMENTS


@pytest.mark.parametrize("increment", range(INCREMENTS))
def test_arrays_are_read_by_row_one_increment_at_a_time(job, values, increment):
    path = job()
    nodal = read_nodal(path, "Displacement", increment)
    assert_array_equal(nodal, values["nodal"][:, :, increment])
    scalar = read_element_scalar(path, MISES, QUAD, increment)
    assert_array_equal(scalar, values["scalar"][:, increment])


def test_a_layer_is_taken_by_number(job, values):
    layered = np.zeros((ELEMENTS, 1, INCREMENTS, POINTS, 1, 2, 1, 1))
    layered[:, 0, :, :, 0, 1, 0, 0] = values["scalar"]
    path = job(replaced(SCALAR, layered))
    upper = read_element_scalar(path, MISES, QUAD, 2, layer=1)
    assert_array_equal(upper, values["scalar"][:, 2])
    with pytest.raises(ResultError, match="no layer 2 of /Marc/Results/Element"):
        read_element_scalar(path, MISES, QUAD, 2, layer=2)


def test_an_imaginary_part_of_zeros_is_none_and_any_other_is_refused(job, values):
    halves = np.zeros((NODES, 3, INCREMENTS, 1, 1, 2, 1))
    halves[..., 0, 0, 0, 0] = values["nodal"]
    path = job(replaced(DISPLACEMENT, halves))
    assert_array_equal(read_nodal(path, "Displacement", 0), values["nodal"][:, :, 0])
    halves[0, 0, 0, 0, 0, 1, 0] = 1e-9
    with pytest.raises(ResultError, match="has complex values"):
        read_nodal(job(replaced(DISPLACEMENT, halves)), "Displacement", 0)


@pytest.mark.parametrize(
    ("shape", "said"),
    [
        ((NODES, 3, INCREMENTS, 1, 1, 1), "has 6 dimensions, described are 7"),
        ((NODES, 3, INCREMENTS, 2, 1, 1, 1), "has 2 in its dimension 'set'"),
        ((NODES, 3, INCREMENTS, 1, 2, 1, 1), "2 in its dimension 'sub-increment'"),
        ((NODES, 3, INCREMENTS, 1, 1, 1, 4), "has 4 in its dimension 'iteration'"),
        ((NODES, 3, 2, 1, 1, 1, 1), "has 2 increments and the list of them 3"),
    ],
)
def test_what_the_description_does_not_say_is_refused(job, shape, said):
    path = job(replaced(DISPLACEMENT, np.zeros(shape)))
    with pytest.raises(ResultError, match=said):
        read_nodal(path, "Displacement", 0)


def test_a_value_that_is_not_finite_is_refused(job):
    array = np.full((NODES, 3, INCREMENTS, 1, 1, 1, 1), np.nan)
    with pytest.raises(ResultError, match="is not finite everywhere"):
        read_nodal(job(replaced(DISPLACEMENT, array)), "Displacement", 0)


def test_what_is_not_there_is_named_with_what_is(job):
    path = job()
    with pytest.raises(ResultError, match="no array /Marc/Results/Node/Velocity, there"):
        read_nodal(path, "Velocity", 0)
    with pytest.raises(ResultError, match=f"there is {SCALAR}, {DISPLACEMENT}"):
        read_element_scalar(path, MISES, "Tria3", 0)
    with pytest.raises(ResultError, match="no increment 3, there are 3 from 0"):
        read_nodal(path, "Displacement", 3)
    with pytest.raises(ResultError, match="no increment -1"):
        read_nodal(path, "Displacement", -1)


def test_quantities_are_listed_with_their_counts(job):
    scalar, nodal = quantities(job())
    assert (nodal.name, nodal.rows, nodal.components) == ("Displacement", NODES, 3)
    assert (scalar.name, scalar.element_type) == (MISES, QUAD)
    assert (scalar.rows, scalar.points, scalar.layers) == (ELEMENTS, POINTS, 1)


def test_there_are_no_traces_and_it_says_why(job):
    with pytest.raises(ResultError, match=r"which node is which row .* take the \.t16"):
        read(job(), [1], ReadOptions())


def test_the_description_says_that_no_real_file_was_seen(job):
    held = describe(job())
    assert (held["title"], held["precision"]) == ("finger", "double")
    assert (held["increments"], held["end_ms"]) == (3, 1.0)
    assert held["arrays"] == [SCALAR, DISPLACEMENT]
    assert "Marc/Input/Something" in held["not_described"]
    assert "no real file" in held["problem"]


def test_its_increments_become_a_table(job, tmp_path):
    path = job()
    table = print_table_of(path)
    heard = []
    options = ReadOptions(tell=heard.append)
    assert write_print_table(table, path, tmp_path / "t.csv", options) == INCREMENTS
    with (tmp_path / "t.csv").open(newline="") as file:
        assert [row["total_time_ms"] for row in csv.DictReader(file)][1:] == [
            "0.5", "1.0",
        ]  # fmt: skip
    assert "no real file" in heard[0]
    assert table.describe(path) == describe(path)


def test_another_hdf5_file_is_named(h5py, tmp_path):
    path = tmp_path / "other.h5"
    with h5py.File(path, "w") as file:
        file["data"] = np.arange(3)
    with pytest.raises(ResultError, match="no list /Marc/Summary with CASE, INC"):
        describe(path)
    wrong = np.zeros(2, dtype=[("INC", "i8")])
    with h5py.File(path, "w") as file:
        file["Marc/Summary"] = wrong
    with pytest.raises(ResultError, match="no list /Marc/Summary with CASE, SUBINC"):
        read_increments(path)


def test_a_cut_file_and_one_that_is_no_hdf5_are_named(job, tmp_path):
    path = job()
    path.write_bytes(path.read_bytes()[:2000])
    with pytest.raises(ResultError, match="damaged, or still being written"):
        describe(path)
    path.write_bytes(b"no HDF5 at all")
    with pytest.raises(ResultError, match="no HDF5: begins with b'no HDF5 '"):
        describe(path)
    with pytest.raises(ResultError, match="no such file"):
        describe(tmp_path / "gone.h5")


def test_without_h5py_it_says_how_to_get_it(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "h5py", None)
    path = tmp_path / "job.h5"
    path.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(100))
    with pytest.raises(MissingError, match=r'pip install "fembridge\[h5\]"'):
        read_increments(path)
