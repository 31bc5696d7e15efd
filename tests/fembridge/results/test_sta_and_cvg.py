"""Progress and convergence, read while the run may still be writing them."""

import os

import pytest

from fembridge.errors import ResultError
from fembridge.results.printed.cvg import CvgRow, read_cvg
from fembridge.results.printed.sta import StaRow, read_sta


def test_increments_of_a_run_are_listed_in_ms(samples):
    rows = read_sta(samples / "cpe4_ascii.sta")
    assert rows[-1] == StaRow(1, 4, 1, False, 5, 2.0, 2.0, 0.5)
    assert [row.increment for row in rows] == [1, 2, 3, 4]


def test_increment_numbers_begin_again_in_a_second_step(samples):
    rows = read_sta(samples / "cpe4_2step_mixed.sta")
    assert [(row.step, row.increment) for row in rows][-2:] == [(2, 1), (2, 2)]
    assert (rows[-1].total_time_ms, rows[-1].step_time_ms) == (3.0, 1.0)


def test_a_failed_attempt_keeps_the_time_at_its_start(samples):
    rows = read_sta(samples / "cpe4_diverged.sta")
    assert [row.failed for row in rows] == [False, True]
    assert (rows[1].total_time_ms, rows[1].increment_time_ms) == (0.5, 0.5)


def test_a_run_that_stopped_at_its_start_has_no_rows(samples):
    assert read_sta(samples / "cpe4_negjac.sta") == []


@pytest.mark.parametrize(
    ("name", "read_rows"), [("cpe4_ascii.sta", read_sta), ("cpe4_ascii.cvg", read_cvg)]
)
def test_cut_at_any_byte_the_rows_are_those_of_whole_lines(samples, tmp_path, name, read_rows):
    whole = (samples / name).read_bytes()
    rows, path = read_rows(samples / name), tmp_path / name
    path.write_bytes(whole)
    for size in range(len(whole), -1, -1):
        os.truncate(path, size)
        headers = 2 if name.endswith("sta") else 4
        complete = max(0, whole[:size].count(b"\n") - headers)
        assert read_rows(path) == rows[:complete]


def test_iterations_of_a_run_are_listed(samples):
    rows = read_cvg(samples / "cpe4_ascii.cvg")
    assert rows[0] == CvgRow(1, 1, 1, 1, 112, 412.6, 100.0, 0.0, 0.0)
    assert len([row for row in rows if row.increment == 1]) == 5


def test_a_diverging_residual_is_seen(samples):
    rows = read_cvg(samples / "cpe4_diverged.cvg")
    assert max(row.force_residual_percent for row in rows) > 5e3


def test_more_iterations_than_the_field_holds_are_none(tmp_path):
    path = tmp_path / "job.cvg"
    line = "     1     2     1  ****     1120         NaN ***********"
    path.write_text("\n" * 4 + line + "  0.0000E+00  0.1000E+01\n")
    (row,) = read_cvg(path)
    assert (row.iteration, row.contact_springs) == (None, 1120)
    assert row.force_residual_percent != row.force_residual_percent
    assert row.displacement_correction_percent != row.displacement_correction_percent
    assert row.temperature_correction_percent == 1.0


@pytest.mark.parametrize("read_rows", [read_sta, read_cvg])
def test_a_whole_line_that_is_no_row_is_refused_by_number(tmp_path, read_rows):
    path = tmp_path / "job.sta"
    path.write_text("\n" * 5 + "not a row\n")
    with pytest.raises(ResultError, match=r"job\.sta:6: no "):
        read_rows(path)


@pytest.mark.parametrize("read_rows", [read_sta, read_cvg])
def test_a_file_that_is_not_there_is_an_error(tmp_path, read_rows):
    with pytest.raises(ResultError, match="no such file"):
        read_rows(tmp_path / "job.sta")
