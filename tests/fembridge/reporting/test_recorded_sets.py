"""Agreement of models with recorded sets: against plain formulas, and of made-up fingertips."""

import math

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from decks.stimuli import CATALOGUE, resolve
from fembridge.evidence import TOUCHSIM_SETS, UsageError, touchsim_rates, touchsim_table
from fembridge.io.spike_table import Rate
from fembridge.reporting.fingertip_responses import Fingertip, texture_shape
from fembridge.reporting.rate_tables import FINGERTIP, TOUCHSIM
from fembridge.reporting.recorded_sets import (
    JUDGED,
    POINT_COLUMNS,
    RECORDED_SETS,
    _bar_points,
    _ramp_points,
    _rate_points,
    _texture_points,
    further_stimuli,
    recorded_rows,
    set_of,
)
from fembridge.touching.pad_file import resolve_pad
from neural import parameter_set

VALUES = st.lists(st.floats(0.5, 300), min_size=4, max_size=12)


def points_of(name, afferent, recorded, model):
    rows = [
        (name, afferent, f"condition {row}", *pair, math.nan, math.nan)
        for row, pair in enumerate(zip(recorded, model, strict=True))
    ]
    return pd.DataFrame(rows, columns=list(POINT_COLUMNS))


def row_of(points, source="own"):
    rows = recorded_rows(points, "own")
    [row] = rows[rows["source"] == source].to_dict("records")
    return row


@given(recorded=VALUES, errors=st.lists(st.floats(-0.4, 40), min_size=12, max_size=12))
def test_agreement_is_that_of_the_plain_formulas(recorded, errors):
    model = [value + error for value, error in zip(recorded, errors, strict=False)]
    row = row_of(points_of("sine", "SA", recorded, model))
    squares = sum((a - b) ** 2 for a, b in zip(model, recorded, strict=True))
    mean = sum(recorded) / len(recorded)
    deviations = sum((value - mean) ** 2 for value in recorded)
    assert row["count"] == row["recorded"] == len(recorded)
    assert_allclose(row["rmse"], math.sqrt(squares / len(recorded)), rtol=1e-9)
    assert_allclose(row["ratio"], sum(model) / sum(recorded), rtol=1e-9)
    if deviations > 1e-6:
        assert_allclose(row["explained"], 1 - squares / deviations, rtol=1e-6, atol=1e-9)


@given(recorded=VALUES, factor=st.floats(0.1, 10))
def test_amplitudes_too_high_by_a_factor_have_this_ratio_and_error(recorded, factor):
    row = row_of(points_of("thresholds", "RA", recorded, [factor * um for um in recorded]))
    assert_allclose(row["ratio"], factor, rtol=1e-9)
    assert_allclose(row["rmse"], max(factor, 1 / factor), rtol=1e-9)


def test_a_value_that_a_model_does_not_reach_is_not_counted():
    row = row_of(points_of("distance", "RA", [50, 100, 200, 400], [100, 200, math.nan, math.inf]))
    assert (row["recorded"], row["count"]) == (4, 2)
    assert_allclose(row["ratio"], 2.0)


def test_a_falling_model_has_a_negative_correlation_and_a_single_value_no_error():
    row = row_of(points_of("textures", "PC", [1, 2, 3], [3, 2, 1]))
    assert_allclose((row["correlation"], row["r_squared"]), (-1, 1))
    row = row_of(points_of("fields", "PC", [100], [50]))
    assert math.isnan(row["rmse"])
    assert_allclose(row["ratio"], 0.5)


def test_every_set_has_a_row_and_one_without_data_names_its_columns():
    rows = recorded_rows(points_of("sine", "SA", [1, 2], [1, 2]), "own")
    assert set(rows["set"]) == {recorded_set.name for recorded_set in RECORDED_SETS}
    missing = rows[(rows["set"] == "ramps_ra")].to_dict("records")
    assert len(missing) == 1
    assert missing[0]["recorded"] == missing[0]["count"] == 0
    assert "unit,depth_mm,speed_mm_per_s,impulses" in missing[0]["missing"]


def test_each_stimulus_belongs_to_a_set_and_only_sinusoids_of_the_fit_are_training():
    names = {recorded_set.name: recorded_set.role for recorded_set in RECORDED_SETS}
    roles = {entry.id: names[set_of(entry)] for entry in CATALOGUE}
    training = {name for name, role in roles.items() if role == "training"}
    assert training == {entry.id for entry in CATALOGUE if entry.family == "sine"}
    assert roles["diharm_10_50_2"] == roles["noise_25_250_1"] == "validation"
    assert roles["diharm_10_100_2"] == roles["noise_50_500_1"] == "neither"
    assert set_of(resolve("sine_150_20")[0]) == "sine_validation"
    assert set_of(resolve("sine_60_20")[0]) == "sine_other"


def test_rates_of_touchsim_are_found_in_and_outside_the_catalogue():
    stored = touchsim_table("sinusoids").iloc[0]
    rates = [Rate("sine_20_250", "SA", 1.0), Rate(stored["stimulus"], stored["afferent"], 2.0)]
    rows = pd.DataFrame(_rate_points(rates, {}), columns=list(POINT_COLUMNS))
    [expected] = [
        rate.rate_ips
        for rate in touchsim_rates()
        if (rate.stimulus, rate.afferent) == ("sine_20_250", "SA")
    ]
    assert_allclose(rows[TOUCHSIM], [expected, stored["rate_ips"]])
    assert rows[JUDGED].isna().all()
    assert [entry.id for entry in further_stimuli(rates)] == [stored["stimulus"]]


def test_touchsim_s_tables_are_complete_and_an_unknown_one_is_refused():
    for name in TOUCHSIM_SETS:
        assert not touchsim_table(name).isna().any(axis=None), name
    with pytest.raises(UsageError) as caught:
        touchsim_table("smell")
    assert caught.value.argument == "name"


@pytest.fixture(scope="module")
def fingertip():
    return Fingertip(resolve_pad("reference"), parameter_set("fitted_pad"))


def test_sa_fires_more_on_deeper_ramps_and_slows_down(fingertip):
    windows = [(0, 100), (100, 200), (200, 500), (500, 1000)]
    shallow, deep = (fingertip.ramp_rates_ips(depth_mm, windows) for depth_mm in (0.5, 1.0))
    assert (deep > shallow).all()
    assert (np.diff(deep) < 0).all()


@pytest.mark.slow
def test_points_of_ramps_textures_and_bars_join_model_and_touchsim(fingertip):
    sa = pd.DataFrame({"unit": ["1"], "depth_mm": [1.0], "rate_0_100": [90.0], "rate_0_7": [9.0]})
    ra = pd.DataFrame(
        {"unit": "2", "depth_mm": 1.0, "speed_mm_per_s": [10.0, 900.0], "impulses": [4.0, 4.0]}
    )
    columns = list(POINT_COLUMNS)
    ramps = pd.DataFrame(_ramp_points(fingertip, sa, ra), columns=columns)
    stored = touchsim_table("ramps_sa").set_index("depth_mm")["rate_0_100"]
    assert_allclose(ramps[TOUCHSIM].iloc[0], stored[1.0])
    assert ramps[TOUCHSIM].isna().tolist() == [False, True, False, True]  # beyond its tables
    stored = touchsim_table("ramps_ra").set_index(["depth_mm", "speed_mm_per_s"])["impulses"]
    assert_allclose(ramps[TOUCHSIM].iloc[2], stored[1.0, 10.0])
    assert_allclose(ramps[FINGERTIP].iloc[2], fingertip.ramp_impulses(1.0, 10.0))

    bars = pd.DataFrame(
        {"shape": "bar", "width_mm": 2.0, "position_mm": [0.0, 4.0], "rate_ips": [20.0, 1.0]}
    )
    points = pd.DataFrame(_bar_points(fingertip, bars), columns=columns)
    assert points[FINGERTIP].iloc[0] > points[FINGERTIP].iloc[1]

    texture = pd.DataFrame(
        {"speed_mm_per_s": 80.0, "shape": "dots_4", "afferent": ["SA", "RA"], "rate_ips": 50.0}
    )
    points = pd.DataFrame(_texture_points(fingertip, texture), columns=columns)
    assert (points[FINGERTIP] > 0).all()
    stored = touchsim_table("textures").set_index(["speed_mm_per_s", "shape", "afferent"])
    assert_allclose(points[TOUCHSIM].iloc[0], stored.loc[(80.0, "dots_4", "SA"), "rate_ips"])


def test_a_texture_has_its_period():
    x = np.zeros(1)
    for shape in ("grating_3", "dots_3"):
        height = texture_shape(shape).height_mm
        for z in (0.1, 0.9, 1.6):
            assert_allclose(height(x, np.array([z])), height(x, np.array([z + 3.0])))
