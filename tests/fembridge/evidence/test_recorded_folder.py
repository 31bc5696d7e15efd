"""Tables of recorded responses are recognised by their columns and checked cell by cell."""

import pandas as pd
import pytest
from numpy.testing import assert_allclose

from fembridge.errors import FembridgeWarning, TableError, UsageError
from fembridge.evidence.recorded_folder import (
    joined_rates,
    ramp_windows,
    read_recorded_folder,
    read_recorded_table,
)

TABLES = {
    "ramps_sa": "unit,depth_mm,rate_0_100,rate_100_500\n2,1.5,80,40.5\n",
    "ramps_ra": "unit,depth_mm,speed_mm_per_s,impulses\n1,1.0,20,3\n",
    "textures": "speed_mm_per_s,shape,afferent,rate_ips\n80,dots_2.5,PC,90\n",
    "bars": "shape,width_mm,position_mm,rate_ips\nbar,1,0.5,40\n",
    "fields": "afferent,area_mm2\nRA,12.5\n",
}
RATES = "stimulus,afferent,rate_ips\nsine_20_250,SA,20\n"


@pytest.fixture
def folder(tmp_path):
    for name, text in {**TABLES, "rates": RATES}.items():
        (tmp_path / f"any_name_{name}.csv").write_text(text, encoding="utf-8")
    return tmp_path


def test_each_table_is_recognised_whatever_its_file_is_called(folder):
    rates, tables = read_recorded_folder(folder)
    assert set(tables) == set(TABLES)
    assert [part.stimuli for part in rates] == [("sine_20_250",)]
    assert tables["ramps_sa"]["rate_100_500"].tolist() == [40.5]
    assert ramp_windows(tables["ramps_sa"].columns)[1] == ("rate_100_500", 100.0, 500.0)


def test_files_with_the_same_columns_are_one_table(folder):
    more = "unit,depth_mm,speed_mm_per_s,impulses\n7,2.0,5,9\n"
    (folder / "more.csv").write_text(more, encoding="utf-8")
    _, tables = read_recorded_folder(folder)
    assert_allclose(tables["ramps_ra"]["impulses"], [3, 9])


def test_a_table_of_something_else_is_a_warning_and_a_folder_without_any_is_refused(tmp_path):
    (tmp_path / "notes.csv").write_text("day,weather\n1,rain\n", encoding="utf-8")
    with (
        pytest.warns(FembridgeWarning, match=r"notes\.csv"),
        pytest.raises(UsageError) as caught,
    ):
        read_recorded_folder(tmp_path)
    assert caught.value.argument == "recorded"
    with pytest.raises(UsageError) as caught:
        read_recorded_folder(tmp_path / "missing")
    assert caught.value.argument == "recorded"


@pytest.mark.parametrize(
    ("name", "old", "new", "line"),
    [
        ("ramps_sa", "1.5,", "2.5,", 2),  # deeper than the skin is computed
        ("ramps_ra", ",20,", ",0,", 2),
        ("textures", "dots_2.5", "sandpaper", 2),
        ("textures", "PC", "XX", 2),
        ("bars", "bar,1", "edge,1", 2),
        ("fields", "12.5", "-1", 2),
    ],
)
def test_an_invalid_cell_is_named_by_its_line(tmp_path, name, old, new, line):
    path = tmp_path / "table.csv"
    path.write_text(TABLES[name].replace(old, new), encoding="utf-8")
    with pytest.raises(TableError) as caught:
        read_recorded_table(path, name)
    assert (caught.value.path, caught.value.line) == (path, line)


def test_ramps_need_a_window_that_has_a_length():
    for columns in ({}, {"rate_100_100": [1.0]}):
        with pytest.raises(TableError):
            read_recorded_table(
                pd.DataFrame({"unit": ["1"], "depth_mm": [1.0], **columns}), "ramps_sa"
            )


def test_rates_of_two_files_are_joined_and_the_same_rate_twice_is_refused(folder):
    first = folder / "any_name_rates.csv"
    second = folder / "second.csv"
    second.write_text(RATES.replace("SA,20", "RA,40"), encoding="utf-8")
    parts, _ = read_recorded_folder(folder)
    whole = joined_rates(parts)
    assert {(rate.afferent, rate.rate_ips) for rate in whole.rates()} == {("SA", 20), ("RA", 40)}
    assert whole.sha256 not in {part.sha256 for part in parts}
    second.write_text(RATES, encoding="utf-8")
    parts, _ = read_recorded_folder(folder)
    with pytest.raises(TableError) as caught:
        joined_rates(parts)
    assert (caught.value.path, caught.value.found) == (second, "sine_20_250")
    assert joined_rates(parts[:1]) is parts[0]
    assert first.name == parts[0].path.name
    assert joined_rates([]) is None
