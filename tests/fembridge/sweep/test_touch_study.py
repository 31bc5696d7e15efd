"""Tables of touches: from Python, CSV, Parquet and study files, and what is refused."""

import math

import numpy as np
import pandas
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fembridge.errors import TableError, UsageError
from fembridge.sweeps.touch_study import read_touches


def study(**touches):
    return read_touches({"touches": {"press_um": 200, **touches}}).rows


def test_every_combination_in_the_order_of_the_factors_the_last_fastest():
    rows = study(product={"shape": ["edge", "plate"], "press_um": [100, 200, 300]})
    assert [(row["shape"], row["press_um"]) for row in rows] == [
        (shape, depth) for shape in ("edge", "plate") for depth in (100, 200, 300)
    ]


def test_draws_repeat_and_more_of_them_leave_the_earlier_as_they_are():
    draw = {"seed": 3, "x_mm": {"uniform": [-3, 3]}, "population_seed": "each"}
    few, again, many = (study(draw={"count": count, **draw}) for count in (5, 5, 50))
    assert few == again == many[:5]
    assert len({row["population_seed"] for row in many}) == 50
    other = study(draw={"count": 5, **draw, "seed": 4})
    assert not {row["x_mm"] for row in other} & {row["x_mm"] for row in few}


def test_shared_draws_are_the_same_for_every_combination():
    factors = {"product": {"shape": ["edge", "plate"]}}
    draw = {"count": 3, "x_mm": {"normal": [0, 1]}}
    own = [row["x_mm"] for row in study(**factors, draw=draw)]
    shared = [row["x_mm"] for row in study(**factors, draw={**draw, "shared": True})]
    assert shared[:3] == shared[3:]
    assert len(set(own)) == 6


@given(low=st.floats(0.01, 1), factor=st.floats(1, 10))
def test_log_uniform_draws_stay_within_their_ends_and_are_even_in_the_logarithm(low, factor):
    limits = [low, low * factor]
    rows = study(draw={"count": 200, "friction": {"log_uniform": limits}}, slide_mm_per_s=20)
    values = np.log([row["friction"] for row in rows])
    assert (values >= math.log(low) - 1e-9).all()
    assert (values <= math.log(low * factor) + 1e-9).all()
    middle, half = math.log(low) + math.log(factor) / 2, math.log(factor) / 2
    assert abs(values.mean() - middle) <= 0.3 * half + 1e-9  # five standard errors


def test_a_csv_a_parquet_file_and_a_frame_give_the_same_table(tmp_path):
    pytest.importorskip("pyarrow")
    frame = pandas.DataFrame(
        {
            "press_um": [200.0, None],
            "press_n": [None, 0.5],
            "trials": [2, 3],
            "label": ["a", "b"],
            "label_size": [1, 2],
        }
    )
    frame.to_csv(tmp_path / "touches.csv", index=False)
    frame.to_parquet(tmp_path / "touches.parquet")
    tables = [
        read_touches(source)
        for source in (frame, tmp_path / "touches.csv", str(tmp_path / "touches.parquet"))
    ]
    assert tables[0].rows == tables[1].rows == tables[2].rows
    assert tables[0].rows[1] == {"press_n": 0.5, "trials": 3, "label": "b", "label_size": 2}
    assert tables[0].labels == ("label", "label_size")


@pytest.mark.parametrize(
    ("row", "argument", "found"),
    [
        ({"press_mm": 2}, "press_mm", "press_mm"),
        ({"press_um": "deep"}, "press_um", "deep"),
        ({"press_um": -1}, "press_um", -1),
        ({"press_um": 200, "press_n": 1}, "press_n", None),
        ({"press_um": 200, "stimulus": "sine_20_250"}, "press_um", None),
        ({}, "press_um", None),
        ({"press_um": 200, "duration_ms": 100}, "duration_ms", 100.0),
        ({"press_um": 200, "slide_mm_per_s": 20, "hold_ms": 100}, "hold_ms", 100.0),
        ({"press_um": 200, "preindent_um": 10}, "preindent_um", 10.0),
        ({"press_um": 200, "trials": 1.5}, "trials", 1.5),
        ({"press_um": 200, "at_mm": 3}, "at_mm", 3),
        ({"press_um": 200, "label": [1]}, "label", [1]),
        ({"map": "map", "stimulus": "sine_20_250", "trials": 3}, "trials", 3),
        ({"map": "map", "press_um": 100}, "press_um", 100.0),
    ],
)
def test_a_row_that_describes_no_touch_is_refused_by_its_column(row, argument, found):
    with pytest.raises(UsageError) as refused:
        read_touches([{"press_um": 100}, row])
    assert refused.value.argument == argument
    assert refused.value.found == found
    assert "row 2" in str(refused.value)


def test_a_row_of_a_csv_is_refused_by_its_line(file):
    path = file("touches.csv", "press_um,trials\n# a remark\n200,1\n300,many\n")
    with pytest.raises(TableError) as refused:
        read_touches(path)
    assert (refused.value.path, refused.value.line) == (path, 4)
    assert (refused.value.argument, refused.value.found) == ("trials", "many")


@pytest.mark.parametrize(
    ("touches", "key"),
    [
        ({"product": {"shape": "edge"}}, "touches.product.shape"),
        ({"product": ["edge"]}, "touches.product"),
        ({"draw": {"count": 0}}, "touches.draw.count"),
        ({"draw": {"count": 10**9}}, "touches.draw.count"),
        ({"draw": {"seed": "one"}}, "touches.draw.seed"),
        ({"draw": {"x_mm": [1, 2]}}, "touches.draw.x_mm"),
        ({"draw": {"x_mm": {"uniform": [2, 1]}}}, "touches.draw.x_mm"),
        ({"draw": {"x_mm": {"log_uniform": [0, 1]}}}, "touches.draw.x_mm"),
        ({"draw": {"x_mm": "each"}}, "touches.draw.x_mm"),
        ({"rows": "touches.txt"}, "touches.rows"),
        ({"drw": {"count": 2}}, "touches.drw"),
        ({"draw": {"cont": 2}}, "touches.draw.cont"),
        ({"product": {"pres_um": [100]}}, "touches.product.pres_um"),
        ({"product": {"x_mm": [0] * 2000, "z_mm": [0] * 2000}}, "touches.product"),
    ],
)
def test_a_study_is_refused_by_its_key(file, touches, key):
    with pytest.raises(UsageError) as refused:
        study(**touches)
    assert refused.value.key == key


def test_a_study_file_may_list_rows_of_a_table_beside_it(file, tmp_path):
    file("letters.csv", "shape,label\nedge,e\nplate,p\n")
    path = file(
        "study.toml",
        'name = "mine"\n[touches]\nrows = "letters.csv"\ntrials = 2\n'
        "[touches.product]\npress_um = [100, 200]\n",
    )
    table = read_touches(path)
    assert (table.name, table.folder, len(table.rows)) == ("mine", tmp_path.resolve(), 4)
    assert table.rows[-1] == {"shape": "plate", "label": "p", "trials": 2, "press_um": 200.0}
