"""The ``.sts`` of Marc: real ones, running ones, ended ones, damaged ones."""

import csv
from dataclasses import astuple, fields
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fembridge.errors import ResultError
from fembridge.results.mentat.sts import StsRow, read_sts, sts_rows
from fembridge.results.printed.print_tables import print_table_of, write_print_table
from fembridge.results.read_options import ReadOptions

SAMPLES = Path(__file__).parents[4] / "fixtures" / "marc_samples"
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


@pytest.fixture
def sts(tmp_path):
    """A function that writes a ``.sts`` and gives its path."""

    def write(text):
        path = tmp_path / "job.sts"
        path.write_bytes(text.encode("latin-1"))
        return path

    return write


@pytest.mark.parametrize(
    ("name", "version", "count", "cycles", "cut_backs", "greatest_mm"),
    [
        ("nour_linear", "Marc 2020", 2, 1, 0, 99.647),
        ("nour_plastic", "Marc 2020", 24, 100, 2, 108.78),
        ("pfl_example_model_0", "Marc 2021.4", 91, 2686, 12, 8.4233),
    ],
)
def test_a_real_job_is_read_to_its_end(name, version, count, cycles, cut_backs, greatest_mm):
    """The numbers are the last lines of the files, read by eye."""
    found = read_sts(SAMPLES / f"{name}.sts")
    last = found.rows[-1]
    assert (found.version, len(found.rows), found.exit_number) == (version, count, 3004)
    assert (found.problem, found.unfinished) == (None, None)
    assert (last.total_cycles, last.total_cut_backs) == (cycles, cut_backs)
    assert last.total_time_ms == 1000.0
    assert last.displacement_max_mm == greatest_mm
    assert [row.increment for row in found.rows] == list(range(count))


@pytest.mark.parametrize("name", ["nour_plastic", "pfl_example_model_0"])
def test_in_a_real_job_steps_add_up_to_times_and_cycles_to_their_total(name):
    """Printed to five digits; cycles of a cut-back attempt count in the total."""
    time_ms, cycles = 0.0, 0
    for row in sts_rows(SAMPLES / f"{name}.sts"):
        time_ms += row.increment_time_ms
        cycles += row.cycles
        assert row.total_time_ms == pytest.approx(time_ms, rel=5e-4)
        assert row.total_cycles >= cycles


def test_every_cell_of_a_row_goes_to_its_name(sts):
    assert sts_rows(sts(HEAD + ROW + END)) == [
        StsRow(1, 3, 2, 0, 0, 12, 0, 1, 0, 0.5, 1.5, 2.5e-17, 0.075)
    ]


def test_line_ends_of_windows_change_nothing(sts):
    text = HEAD + ROW + END
    unix = read_sts(sts(text))
    assert read_sts(sts(text.replace("\n", "\r\n"))) == unix


def test_a_job_that_runs_or_was_killed_says_how_far_it_is(sts):
    found = read_sts(sts(HEAD + ROW))
    assert found.exit_number is None
    assert found.problem == ("the job has not ended, or was killed, increment 3 at 1.5 ms")
    assert read_sts(sts(HEAD)).problem == "the job has not ended, or was killed"


def test_a_last_line_that_is_still_being_written_is_left_out(sts):
    found = read_sts(sts(HEAD + ROW + ROW[:60]))
    assert len(found.rows) == 1
    assert found.unfinished == (11, ROW[:60])


def test_an_end_without_a_line_end_counts_as_the_end(sts):
    assert read_sts(sts(HEAD + ROW + "\n Job ends with exit number :    3004")).rows
    assert read_sts(sts(HEAD + ROW + END.rstrip("\n"))).problem is None


@pytest.mark.parametrize("number", [13, 2004, 3002, 3015])
def test_another_exit_number_is_a_problem_that_names_it(sts, number):
    text = HEAD + ROW + END
    found = read_sts(sts(text.replace("3004", str(number))))
    assert found.exit_number == number
    assert found.problem == (
        f"the job ended after increment 3 at 1.5 ms with exit number {number}, 3004 is success"
    )


def test_a_job_that_ended_at_once_has_no_rows(sts):
    words = read_sts(sts(HEAD + END.replace("3004", "13"))).problem
    assert words == ("the job ended before any increment with exit number 13, 3004 is success")


def test_counts_that_touch_are_told_apart_by_column_and_stars_are_no_count(sts):
    wide = ROW.replace(
        "      1      3    2    0    0      12       0",
        "      1      31234512345    0********12345678",
    )
    row = sts_rows(sts(HEAD + wide))[0]
    assert astuple(row)[:7] == (1, 3, 12345, 12345, 0, None, 12345678)


def test_a_real_without_its_e_is_read_as_fortran_means_it(sts):
    row = sts_rows(sts(HEAD + ROW.replace("2.5000E-17", "2.5000-117")))[0]
    assert row.displacement_min_mm == 2.5e-117


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("step\n" + HEAD, 1, "begins with 'step', a .sts of Marc with 'style=1'"),
        (HEAD + "severe error\n" + ROW, 10, "no increment: "),
        (HEAD + ROW + ROW[:70] + "\n" + ROW[70:], 11, "no increment: "),
        (HEAD + ROW.replace("5.0000E-04", "NaN       "), 10, "'NaN' is no number"),
        (HEAD + ROW.replace("   3 ", "  -3 "), 10, "'-3' is no count"),
        (HEAD + ROW + END + ROW, 15, "after the end: "),
        (HEAD.replace("displ-mag", "temperature"), 6, "columns 'case inc cycl"),
        (HEAD.replace("case", "load case"), None, "no line of column names"),
    ],
)
def test_a_foreign_or_wrapped_line_is_named(sts, text, line, said):
    with pytest.raises(ResultError) as caught:
        read_sts(sts(text))
    assert said in caught.value.problem
    assert caught.value.line == line


def test_an_absent_file_is_named(tmp_path):
    with pytest.raises(ResultError, match="no such file"):
        read_sts(tmp_path / "job.sts")


def test_it_becomes_a_table_with_units_in_its_names(tmp_path):
    path = SAMPLES / "nour_plastic.sts"
    table = print_table_of(path)
    heard = []
    options = ReadOptions(tell=heard.append)
    assert write_print_table(table, path, tmp_path / "t.csv", options) == 24
    with (tmp_path / "t.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == tuple(field.name for field in fields(StsRow))
    assert float(rows[-1]["displacement_max_mm"]) == 108.78
    assert heard == []
    assert table.describe(path)["problem"] is None


def test_a_table_of_a_job_that_failed_is_written_and_told(sts, tmp_path):
    path = sts(HEAD + ROW + END.replace("3004", "3002"))
    table = print_table_of(path)
    heard = []
    write_print_table(table, path, tmp_path / "t.csv", ReadOptions(tell=heard.append))
    assert "exit number 3002" in heard[0]
    assert "exit number 3002" in table.describe(path)["problem"]


@given(cut=st.integers(0, len(HEAD + ROW * 3 + END)))
def test_cut_anywhere_it_gives_whole_rows_or_an_error(tmp_path_factory, cut):
    path = tmp_path_factory.getbasetemp() / "cut.sts"
    path.write_text((HEAD + ROW * 3 + END)[:cut])
    whole = sts_row_of_text()
    try:
        found = read_sts(path)
    except ResultError:
        assert cut < len(HEAD)
    else:
        assert set(found.rows) <= {whole}
        assert len(found.rows) == min(3, max(0, cut - len(HEAD)) // len(ROW))


def sts_row_of_text():
    return StsRow(1, 3, 2, 0, 0, 12, 0, 1, 0, 0.5, 1.5, 2.5e-17, 0.075)


@given(data=st.data())
def test_a_changed_byte_gives_rows_or_an_error_and_nothing_else(tmp_path_factory, data):
    content = bytearray((HEAD + ROW * 2 + END).encode())
    content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path = tmp_path_factory.getbasetemp() / "changed.sts"
    path.write_bytes(bytes(content))
    try:
        found = read_sts(path)
    except ResultError:
        return
    assert len(found.rows) <= 2
