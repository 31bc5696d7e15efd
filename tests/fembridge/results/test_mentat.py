"""Plots that Mentat saved as text: real ones and damaged ones.

The first layout of a plot is that of a table copied from Mentat 2014 (a trailing blank in
each label, six digits, tabs); the second and third are as programs say that read them.
"""

import csv
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from opened import naming, shows, write_table

from fembridge.errors import ResultError
from fembridge.results import describe
from fembridge.results.mentat import read_plot_tables
from fembridge.results.read_options import ReadOptions
from fembridge.results.readers import open_source

COPIED = (
    "Time \tEquivalent Von Mises Stress Node 12 \tEquivalent Von Mises Stress Node 7 \n"
    "0\t0\t0\n"
    "0.0005\t0.0125\t0.5\n"
    "0.001\t0.025\t0.25\n"
)
NINE_LINES = (
    "History Plot\n\njob: finger_job1\nlocation\n12\nvariables\n2\nTime\n"
    "Equivalent Von Mises Stress\n"
    " 0.000000000000e+000 0.000000000000e+000\n"
    " 5.000000000000e-004 1.250000000000e-002\n"
    " 1.000000000000e-003 2.500000000000e-002\n"
)
PATH_PLOT = (
    "Pathplot\n"
    "Arc Length\tEquivalent Von Mises Stress\tDisplacement Y\n"
    "1\t0\t0.5\t0.1\n"
    "2\t0.25\t0.75\t0.2\n"
    "3\t0.5\t1\t0.3\n"
)


def read(path, nodes=(), options=ReadOptions()):  # noqa: B008 - frozen
    """Traces at `nodes`, or of all curves."""
    with open_source(path, options) as source:
        return source.history(nodes or None).traces()


def read_plot(path):
    """The one table of a text."""
    (table,), _ = read_plot_tables(path)
    return table


@pytest.fixture
def text(file):
    """A function that writes a text and gives its path."""
    return partial(file, "plot.txt")


def test_a_copied_table_has_a_trace_for_each_node_that_its_labels_name(text):
    first, second = read(text(COPIED), ())
    assert (first.node, second.node) == (12, 7)
    assert (first.start_ms, first.dt_ms) == (0.0, 0.5)
    assert_allclose(first.stress_pa, [0.0, 0.0125e6, 0.025e6], rtol=1e-15)
    assert_allclose(second.stress_pa, [0.0, 0.5e6, 0.25e6], rtol=1e-15)


def test_two_columns_under_nine_lines_need_a_node_and_tell_what_they_are_taken_for(text, logged):
    path = text(NINE_LINES)
    logged = logged
    trace = read(path, [12], ReadOptions())[0]
    assert trace.node == 12
    assert_allclose(trace.stress_pa, [0.0, 12500.0, 25000.0], rtol=1e-15)
    assert shows(logged[0], "'History Plot")
    with pytest.raises(ResultError, match=naming("plot.txt", 0, 1)):
        read(path, ())


def test_a_path_plot_is_a_table_and_no_trace(text, tmp_path):
    path = text(PATH_PLOT)
    table = read_plot(path)
    assert table.labels[0] == "index"
    assert table.labels[table.x] == "Arc Length"
    assert not table.is_over_time
    assert table.header == ("Pathplot", PATH_PLOT.splitlines()[1])
    with pytest.raises(ResultError, match=naming("plot.txt:3", "'Arc Length'", "Time")):
        read(path, [1])
    assert write_table(path, tmp_path / "t.csv")[1] == 3
    with (tmp_path / "t.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert rows[1]["Arc Length"] == "0.25"
    assert rows[2]["Displacement Y"] == "0.3"


def test_what_is_no_von_mises_stress_is_left_out_and_told(text, logged):
    path = text(COPIED.replace("Mises Stress Node 12", "X Displacement Node 12"))
    logged = logged
    traces = read(path, (), ReadOptions())
    assert [trace.node for trace in traces] == [7]
    assert len(logged) == 1
    assert shows(logged[0], "'Equivalent Von X Displacement Node 12'")
    none = COPIED.replace("Mises", "Nothing")
    with pytest.raises(
        ResultError, match=naming("plot.txt:2", "'Equivalent Von Nothing Stress Node 12'")
    ):
        read(text(none), ())


def test_curves_one_under_the_other_are_all_read(text, tmp_path):
    one, two = (
        f"Time \tEquivalent Von Mises Stress Node {node} \n0\t0\n0.0005\t{peak}\n0.001\t0\n"
        for node, peak in ((5, 0.5), (6, 0.25))
    )
    path = text(one + "\n" + two)
    assert describe(path)["over_time"]
    assert [(t.node, t.stress_pa[1]) for t in read(path, ())] == [(5, 5e5), (6, 2.5e5)]
    assert [table.line for table in read_plot_tables(path)[0]] == [2, 7]
    assert write_table(path, tmp_path / "t.csv")[1] == 6
    lines = (tmp_path / "t.csv").read_text().splitlines()
    assert lines[0] == "table,Time,Equivalent Von Mises Stress"
    assert lines[5] == "2,0.0005,0.25"
    with pytest.raises(ResultError, match=naming("plot.txt", 2, 5)):
        read(text(one + "\n" + one), ())


def test_tables_of_other_columns_do_not_become_one_csv(text, tmp_path):
    other = "Arc Length\tDisplacement X\n0\t0\n1\t2\n2\t5\n"
    time = "Time\tDisplacement X\n0\t0\n1\t2\n2\t4\n"
    with pytest.raises(ResultError, match=naming("plot.txt:7", "Arc Length", "Time")):
        write_table(text(time + "\n" + other), tmp_path / "t.csv")
    assert not (tmp_path / "t.csv").exists()


@pytest.mark.parametrize(
    "content",
    [
        COPIED.replace("\n", "\r\n"),
        COPIED.rstrip("\n"),
        COPIED.replace("\t", "    "),
        COPIED.replace("0.0125", "1.25e-002"),
        "\ufeff" + COPIED,
    ],
    ids=["crlf", "cut", "blanks", "exponent", "mark"],
)
def test_how_the_numbers_are_written_and_parted_does_not_matter(text, content):
    table = read_plot(text(content))
    assert_array_equal(table.values, [[0, 0, 0], [0.0005, 0.0125, 0.5], [0.001, 0.025, 0.25]])


@given(
    rows=st.lists(st.lists(st.floats(-1e30, 1e30), min_size=3, max_size=3), min_size=2, max_size=9),
    separator=st.sampled_from(["\t", " ", "   "]),
    head=st.sampled_from(["", "title\n", "title\nmore\n\n", "7\n", "a b c\n"]),
)
def test_any_table_comes_back_number_by_number(tmp_path_factory, rows, separator, head):
    path = tmp_path_factory.getbasetemp() / "any.txt"
    path.write_text(head + "\n".join(separator.join(map(repr, row)) for row in rows))
    assert_array_equal(read_plot(path).values, np.array(rows))


HISTORY = "Time Node 2\tEquivalent Von Mises Stress Node 2\n" + "".join(
    f"{k * 0.0005:g}\t{100 + k}.25\n" for k in range(12)
)


@pytest.mark.parametrize("row", [1, 6, 12])
@pytest.mark.parametrize(
    "damage",
    ["0.0x1\t101.25", "0.001", "0.001\t1x1.25", "0.001\t1\t2", "1\t-", "1\tnan", "1\t1e999"],
)
def test_a_damaged_row_is_refused_and_does_not_part_a_table(file, row, damage):
    lines = HISTORY.splitlines()
    lines[row] = damage
    path = file("plot.txt", "\n".join(lines) + "\n")
    with pytest.raises(ResultError) as refused:
        read(path, [2])
    assert refused.value.line == row + 1


def test_a_text_that_is_cut_in_its_last_number_says_so(file, logged):
    path = file("plot.txt", HISTORY[:-2])
    said = logged
    (trace,) = read(path, [2], ReadOptions())
    assert trace.stress_pa[-1] == 111.2e6
    assert shows("; ".join(said), repr("0.0055\t111.2"))
    assert shows(describe(path)["problem"], repr("0.0055\t111.2"))
    path.write_text(HISTORY)
    said.clear()
    read(path, [2], ReadOptions())
    assert said == []


def test_rows_of_more_numbers_right_behind_a_table_are_refused(text):
    path = text(" 0 0\n 1 2\n 2 5\n 3 1 4 7\n 4 2 5 8\n")
    with pytest.raises(ResultError, match=naming("plot.txt:4", 2)):
        read(path, [12])
