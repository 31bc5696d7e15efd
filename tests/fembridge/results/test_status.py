"""``.sta`` and ``.cvg`` of CalculiX, ``.sts`` of Marc: recorded ones, cut ones, foreign lines."""

import csv
import os
from dataclasses import astuple, fields
from functools import partial
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from opened import naming, shows, write_table

from fembridge.errors import ResultError
from fembridge.results import describe
from fembridge.results.read_options import ReadOptions
from fembridge.results.status import CvgRow, StaRow, StsRow, read_cvg, read_sta, read_sts


def test_rows_of_a_recorded_run_are_listed_in_ms(samples):
    """Of one step, of two, where numbers begin again, and of an attempt that failed."""
    rows = read_sta(samples / "cpe4_ascii.sta")
    assert rows[-1] == StaRow(1, 4, 1, False, 5, 2.0, 2.0, 0.5)
    assert [row.increment for row in rows] == [1, 2, 3, 4]
    rows = read_sta(samples / "cpe4_2step_mixed.sta")
    assert [(row.step, row.increment) for row in rows][-2:] == [(2, 1), (2, 2)]
    assert (rows[-1].total_time_ms, rows[-1].step_time_ms) == (3.0, 1.0)
    good, failed = read_sta(samples / "cpe4_diverged.sta")
    assert (good.failed, failed.failed) == (False, True)
    assert (failed.total_time_ms, failed.increment_time_ms) == (0.5, 0.5)
    iterations = read_cvg(samples / "cpe4_ascii.cvg")
    assert iterations[0] == CvgRow(1, 1, 1, 1, 112, 412.6, 100.0, 0.0, 0.0)
    assert len([row for row in iterations if row.increment == 1]) == 5


@pytest.mark.parametrize(
    ("follows", "allowed"), [((1, 2, 2), True), ((1, 3, 1), False), ((2, 1, 1), False)]
)
def test_what_follows_a_failed_attempt_is_the_next_attempt(
    samples, tmp_path, follows, allowed, file
):
    failed = (samples / "cpe4_diverged.sta").read_text()
    last = failed.splitlines()[-1]
    path = file("job.sta", failed + "{:6}{:11}{:6} ".format(*follows) + last[24:] + "\n")
    if allowed:
        assert write_table(path, tmp_path / "t.csv")[1] == 3
    else:
        with pytest.raises(ResultError, match=naming("job.sta", "increment 2")):
            write_table(path, tmp_path / "t.csv")


@pytest.mark.parametrize(
    ("name", "read_rows"), [("cpe4_ascii.sta", read_sta), ("cpe4_ascii.cvg", read_cvg)]
)
def test_cut_at_any_byte_the_rows_are_those_of_whole_lines(samples, tmp_path, name, read_rows):
    whole = (samples / name).read_bytes()
    rows, path = read_rows(samples / name), tmp_path / name
    path.write_bytes(whole)
    for size in range(len(whole), -1, -1 if os.environ.get("CI") == "true" else -7):
        os.truncate(path, size)
        headers = 2 if name.endswith("sta") else 4
        complete = max(0, whole[:size].count(b"\n") - headers)
        assert read_rows(path) == rows[:complete]


@pytest.mark.parametrize("read_rows", [read_sta, read_cvg])
def test_a_whole_line_that_is_no_row_is_refused_by_number(file, read_rows):
    path = file("job.sta", "\n" * 5 + "not a row\n")
    with pytest.raises(ResultError, match=r"job\.sta:6: "):
        read_rows(path)


SAMPLES = Path(__file__).parents[3] / "fixtures" / "marc_samples"
HEAD = (
    "style=1\n"
    "information summary of job:  finger_job1\n"
    "version:  Marc 2021.4\n"
    "date:     Tue Jun 13 16:36:14 2023\n"
    "\n"
    "    case   inc  cycl  sepa cut   cycl   separ   cut  rmesh time step   total time"
    "        displ-mag              \n"
    "      #     #     #     #   #      #      #      #     #      of           of    "
    "     min         max    \n"
    "               |--of the inc--|------of the analysis------| the inc      the job\n"
    "\n"
)
ROW = (
    "      1      3    2    0    0      12       0     1     0"
    "  5.0000E-04  1.5000E-03  2.5000E-17  7.5000E-02\n"
)
END = """
 Job ends with exit number :    3004
            total wall time:        269.28
            total cpu  time:        265.70
"""


@pytest.mark.parametrize(
    ("name", "count", "cycles", "cut_backs", "greatest_mm"),
    [
        ("nour_linear", 2, 1, 0, 99.647),
        ("nour_plastic", 24, 100, 2, 108.78),
        ("pfl_example_model_0", 91, 2686, 12, 8.4233),
    ],
)
def test_a_real_job_is_read_to_its_end(name, count, cycles, cut_backs, greatest_mm):
    """The numbers are the last lines of the files, read by eye."""
    found = read_sts(SAMPLES / f"{name}.sts")
    last = found.rows[-1]
    assert (len(found.rows), found.exit_number, found.problem) == (count, 3004, None)
    assert (last.total_cycles, last.total_cut_backs) == (cycles, cut_backs)
    assert last.total_time_ms == 1000.0
    assert last.displacement_max_mm == greatest_mm
    assert [row.increment for row in found.rows] == list(range(count))


@pytest.fixture
def sts(file):
    """A function that writes a ``.sts`` and gives its path."""
    return partial(file, "job.sts")


def test_a_job_that_runs_or_was_killed_says_how_far_it_is(sts):
    found = read_sts(sts(HEAD + ROW))
    assert found.exit_number is None
    assert shows(found.problem, "increment 3", "1.5 ms")
    assert not shows(read_sts(sts(HEAD)).problem, "increment")


def test_counts_that_touch_are_distinguished_by_column_and_stars_are_no_count(sts):
    wide = ROW.replace(
        "      1      3    2    0    0      12       0",
        "      1      31234512345    0********12345678",
    )
    row = read_sts(sts(HEAD + wide)).rows[0]
    assert astuple(row)[:7] == (1, 3, 12345, 12345, 0, None, 12345678)


@pytest.mark.parametrize(
    ("text", "line", "shown"),
    [
        ("step\n" + HEAD, 1, ("'step'", "'style=1'")),
        (HEAD + "severe error\n" + ROW, 10, ()),
        (HEAD + ROW + ROW[:70] + "\n" + ROW[70:], 11, ()),
        (HEAD + ROW.replace("5.0000E-04", "NaN       "), 10, ("'NaN'",)),
        (HEAD + ROW.replace("   3 ", "  -3 "), 10, ("'-3'",)),
        (HEAD + ROW + END + ROW, 15, ()),
        (HEAD.replace("displ-mag", "temperature"), 6, ("case inc cycl",)),
        (HEAD.replace("case", "load case"), None, ()),
    ],
)
def test_a_foreign_or_wrapped_line_is_named(sts, text, line, shown):
    with pytest.raises(ResultError) as caught:
        read_sts(sts(text))
    assert shows(caught.value.problem, *shown)
    assert caught.value.line == line


def test_it_becomes_a_table_with_units_in_its_names(tmp_path, logged):
    path = SAMPLES / "nour_plastic.sts"
    logged = logged
    options = ReadOptions()
    assert write_table(path, tmp_path / "t.csv", options)[1] == 24
    with (tmp_path / "t.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == tuple(field.name for field in fields(StsRow))
    assert float(rows[-1]["displacement_max_mm"]) == 108.78
    assert logged == []
    assert describe(path)["problem"] is None


@given(cut=st.integers(0, len(HEAD + ROW * 3 + END)))
def test_cut_anywhere_it_gives_whole_rows_or_an_error(tmp_path_factory, cut):
    path = tmp_path_factory.getbasetemp() / "cut.sts"
    path.write_text((HEAD + ROW * 3 + END)[:cut])
    whole = StsRow(1, 3, 2, 0, 0, 12, 0, 1, 0, 0.5, 1.5, 2.5e-17, 0.075)
    try:
        found = read_sts(path)
    except ResultError:
        assert cut < len(HEAD)
    else:
        assert set(found.rows) <= {whole}
        assert len(found.rows) == min(3, max(0, cut - len(HEAD)) // len(ROW))
