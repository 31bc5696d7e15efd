"""Prints as long tables: a row a number, an attempt or an iteration."""

import csv

import pytest

from fembridge.errors import ResultError
from fembridge.results.printed.print_tables import print_table_of, write_print_table
from fembridge.results.read_options import ReadOptions

MOVED = " displacements (vx,vy,vz) for set N and time  0.5000000E-03\n\n"
MOVED_LATER = MOVED.replace("0.5000000E-03", "0.1000000E-02")
CONTACT = (
    " contact stress (slave element+face,press,tang1,tang2) for all contact elements "
    "and time 0.5000000E-03\n\n"
)
CONTACT_LATER = CONTACT.replace("0.5000000E-03", "0.1000000E-02")
GOOD = "        11  1.250000E+00 -2.500000E-03  3.000000E+00\n"
SPRING = "        21          5  1.250000E+00 -2.500000E-03  3.000000E+00\n"


@pytest.fixture
def dat(tmp_path):
    """A function that writes a ``.dat`` and gives its path."""

    def write(text):
        path = tmp_path / "job.dat"
        path.write_text(text)
        return path

    return write


def rows_of(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def write(path, output, quantity=None, **options):
    table = print_table_of(path)
    return write_print_table(table, path, output, ReadOptions(**options), quantity)


def test_a_dat_becomes_a_row_a_number_with_its_unit(samples, tmp_path):
    output = tmp_path / "t.csv"
    count = write(samples / "cpe4_ascii.dat", output)
    rows = rows_of(output)
    assert count == len(rows)
    assert set(rows[0]) == {
        "time_ms", "mode", "quantity", "set", "node", "element", "point", "face",
        "component", "value", "unit",
    }  # fmt: skip
    units = {row["quantity"]: row["unit"] for row in rows}
    assert units["displacements"] == "mm"
    assert (units["total force"], units["stresses"]) == ("N", "Pa")
    stress = next(row for row in rows if row["quantity"] == "stresses")
    assert (stress["element"], stress["point"], stress["node"]) == ("1", "1", "")
    assert float(stress["value"]) == pytest.approx(1515.402)
    total = next(row for row in rows if row["quantity"] == "total force")
    assert (total["node"], total["set"], total["time_ms"]) == ("", "NTOP", "0.5")


def test_one_quantity_can_be_taken_and_an_absent_one_is_named(samples, tmp_path):
    output = tmp_path / "t.csv"
    assert write(samples / "cpe4_ascii.dat", output, "total force") == 12
    assert {row["quantity"] for row in rows_of(output)} == {"total force"}
    with pytest.raises(ResultError, match="no temperatures in it"):
        write(samples / "cpe4_ascii.dat", output, "temperatures")
    assert len(rows_of(output)) == 12  # what stood there stays


def test_a_deck_of_another_unit_has_its_stress_in_pa_and_the_rest_as_it_is(samples, tmp_path):
    output = tmp_path / "t.csv"
    write(samples / "cpe4_ascii.dat", output, stress_unit="kPa")
    rows = rows_of(output)
    stress = next(row for row in rows if row["quantity"] == "stresses")
    assert float(stress["value"]) == pytest.approx(1.515402)
    assert {r["unit"] for r in rows if r["quantity"] == "displacements"} == {"deck"}


@pytest.mark.parametrize("odd", ["NaN", "Infinity", "-Infinity"])
def test_a_value_that_is_no_number_is_named_or_its_section_left_out(dat, odd):
    bad = f"        12{odd:>14}  1.000000E+00  1.000000E+00\n"
    path = dat(f"\n{MOVED}{GOOD}{GOOD}\n{MOVED_LATER}{GOOD}{bad}")
    output = path.with_name("t.csv")
    words = r"displacements for set N at 1 ms, node 12: vx is -?(nan|inf)"
    with pytest.raises(ResultError, match=words):
        write(path, output)
    heard = []
    assert write(path, output, partial=True, tell=heard.append) == 6
    assert heard[0].startswith("dropped the section: displacements for set N at 1 ms")


def test_a_last_section_that_is_short_is_refused_or_left_out(dat):
    path = dat(f"\n{MOVED}{GOOD}{GOOD}\n{MOVED_LATER}{GOOD}")
    output = path.with_name("t.csv")
    with pytest.raises(ResultError, match="at 1 ms is cut: 1 of 2 records"):
        write(path, output)
    assert write(path, output, partial=True) == 6


def test_a_contact_print_may_have_fewer_records_at_the_end(dat):
    path = dat(f"\n{CONTACT}{SPRING}{SPRING}\n{CONTACT_LATER}{SPRING}")
    assert write(path, path.with_name("t.csv")) == 9


@pytest.mark.parametrize(("suffix", "rows"), [("sta", 4), ("cvg", 20)])
def test_progress_becomes_a_table_with_units_in_its_names(samples, tmp_path, suffix, rows):
    output = tmp_path / "t.csv"
    assert write(samples / f"cpe4_ascii.{suffix}", output) == rows
    first = rows_of(output)[0]
    name = "total_time_ms" if suffix == "sta" else "force_residual_percent"
    assert float(first[name]) == (0.5 if suffix == "sta" else 412.6)


def test_a_line_that_is_still_being_written_is_told(samples, tmp_path):
    path = tmp_path / "job.sta"
    path.write_bytes((samples / "cpe4_ascii.sta").read_bytes()[:-20])
    heard = []
    assert write(path, tmp_path / "t.csv", tell=heard.append) == 3
    assert heard[0].startswith("line 6 has no end yet and is left out")
    assert "line 6" in print_table_of(path).describe(path)["problem"]


def test_a_suffix_that_is_no_print_has_no_table(tmp_path):
    assert print_table_of(tmp_path / "job.frd") is None
    assert print_table_of(tmp_path / "JOB.DAT").name == "ccx-dat"
