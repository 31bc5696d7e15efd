"""One field of one increment, chosen and written."""

import csv

import numpy as np
import pytest

from fembridge.errors import ResultError, UsageError
from fembridge.results.field_file import column_names, read_field, write_field
from fembridge.results.frd_format.field import read_fields
from fembridge.results.read_options import ReadOptions


@pytest.mark.parametrize(
    ("increment", "step", "number", "time_ms"),
    [("last", 2, 2, 3.0), ("1:2", 1, 2, 1.0), ("2:1", 2, 1, 2.5), ("4", 1, 4, 2.0)],
)
def test_an_increment_is_chosen_by_number_or_step_and_number(
    samples, increment, step, number, time_ms
):
    field = read_field(samples / "cpe4_2step_mixed.frd", "STRESS", increment)
    assert (field.step, field.increment) == (step, number)
    assert field.time_ms == pytest.approx(time_ms)


def test_an_increment_of_two_steps_is_misuse(samples):
    with pytest.raises(UsageError, match="increment 2 is in 2 steps: 1:2, 2:2"):
        read_field(samples / "cpe4_2step_mixed.frd", "STRESS", "2")


@pytest.mark.parametrize("word", ["first", "-1", "1:", "1:2:3", ""])
def test_a_word_that_chooses_nothing_is_misuse(samples, word):
    with pytest.raises(UsageError, match="expected last, N or STEP:N"):
        read_field(samples / "cpe4_ascii.frd", "STRESS", word)


def test_an_increment_that_is_absent_is_named_beside_those_there(samples):
    with pytest.raises(ResultError, match="no increment 9 of DISP, it has 1:1 to 1:4"):
        read_field(samples / "cpe4_ascii.frd", "DISP", "9")


def test_a_cut_file_gives_the_last_whole_field_when_partial(samples):
    path = samples / "kill_ascii.frd"
    with pytest.raises(ResultError, match="after 157 of 252 records"):
        read_field(path, "DISP")
    field = read_field(path, "DISP", "last", ReadOptions(partial=True))
    assert (field.increment, field.nodes.size) == (1, 252)


def test_the_one_field_is_that_of_the_pass_over_all(samples):
    path = samples / "cpe8r_nset_bin_f32.frd"
    for field in read_fields(path, "STRESS"):
        one = read_field(path, "STRESS", str(field.increment))
        assert np.array_equal(one.values, field.values)
        assert np.array_equal(one.nodes, field.nodes)


def test_a_csv_has_a_row_a_node_and_units_in_its_names(samples, tmp_path):
    field = read_field(samples / "cpe4_ascii.frd", "STRESS")
    write_field(tmp_path / "f.csv", field)
    with (tmp_path / "f.csv").open(newline="") as file:
        rows = list(csv.reader(file))
    assert rows[0] == ["node", "sxx_pa", "syy_pa", "szz_pa", "sxy_pa", "syz_pa", "szx_pa"]
    table = np.array(rows[1:], dtype=float)
    assert np.array_equal(table[:, 0], field.nodes)
    assert np.array_equal(table[:, 1:], field.values)


def test_an_npz_holds_all_of_the_field(samples, tmp_path):
    field = read_field(samples / "cpe4_ascii.frd", "DISP", "2")
    write_field(tmp_path / "f.npz", field)
    with np.load(tmp_path / "f.npz") as held:
        assert held["components"].tolist() == ["D1", "D2", "D3"]
        assert held["units"].tolist() == ["mm"] * 3
        assert (held["step"], held["increment"], held["time_ms"]) == (1, 2, 1.0)
        assert np.array_equal(held["values"], field.values)
        assert np.array_equal(held["nodes"], field.nodes)


def test_another_suffix_is_misuse(samples, tmp_path):
    field = read_field(samples / "cpe4_ascii.frd", "DISP")
    with pytest.raises(UsageError, match=r"expected a name in \.npz or \.csv"):
        write_field(tmp_path / "f.txt", field)
    assert list(tmp_path.iterdir()) == []


def test_names_of_columns_are_words(samples):
    contact = read_field(samples / "cpe4_ascii.frd", "CONTACT")
    assert column_names(contact)[:2] == ["copen_mm", "cslip1_mm"]
    error = read_field(samples / "cpe4_ascii.frd", "ERROR")
    assert column_names(error) == ["str_percent"]
