"""Regression line, RMSE and bias against hand-worked points and plain sums."""

import csv
import dataclasses
import doctest
import math
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from fembridge.errors import ParameterError
from neural.agreement import agreement, bias_ips, regression
from neural.agreement import rmse_ips as rmse

RECORDINGS = Path(__file__).parents[3] / "shared" / "data"

rates = st.floats(0.0, 1000.0).map(lambda rate: round(rate, 3))
few = settings(max_examples=40)  # drawing them is what takes the time
pairs = st.lists(st.tuples(rates, rates), min_size=1, max_size=15)


def plain_line(observed, predicted):
    """Slope, intercept and R² as sums over the points."""
    count = len(observed)
    mean_x, mean_y = math.fsum(observed) / count, math.fsum(predicted) / count
    points = list(zip(observed, predicted, strict=True))
    sxx = math.fsum((x - mean_x) ** 2 for x in observed)
    syy = math.fsum((y - mean_y) ** 2 for y in predicted)
    sxy = math.fsum((x - mean_x) * (y - mean_y) for x, y in points)
    slope = sxy / sxx
    return slope, mean_y - slope * mean_x, sxy**2 / (sxx * syy)


def test_four_points_give_the_line_worked_out_by_hand():
    """From their means −3 −1 1 3 across, −2 0 −2 4 up: Sxx 20, Syy 24, Sxy 16.

    So the slope is 16/20 = 4/5 and R² is 16²/(20 · 24) = 8/15. With two degrees of
    freedom the t test has p = 1 − t/sqrt(t² + 2), which is 1 − |r|.
    """
    line = regression([2.0, 4.0, 6.0, 8.0], [4.0, 6.0, 4.0, 10.0])

    assert line.slope == pytest.approx(0.8, rel=1e-14)
    assert line.intercept_ips == pytest.approx(2.0, rel=1e-13)
    assert line.r_squared == pytest.approx(8 / 15, rel=1e-14)
    assert line.p_value == pytest.approx(1 - math.sqrt(8 / 15), rel=1e-13)
    assert line.count == 4


def test_three_points_have_the_p_value_of_the_cauchy_distribution():
    """p = 1 − (2/π) atan t, t² = R²/(1 − R²); here R² = 3/4, t = sqrt(3), p = 1/3."""
    line = regression([0.0, 1.0, 2.0], [0.0, 0.0, 3.0])

    assert line.r_squared == pytest.approx(0.75, rel=1e-14)
    assert line.p_value == pytest.approx(1 / 3, rel=1e-13)


@few
@given(pairs)
def test_the_line_is_that_of_plain_sums(points):
    observed, predicted = zip(*points, strict=True)
    assume(np.ptp(observed) > 0.1 and np.ptp(predicted) > 0.1)

    line = regression(observed, predicted)

    slope, intercept_ips, r_squared = plain_line(observed, predicted)
    size = 1.0 + abs(slope) * 1000.0
    assert line.slope == pytest.approx(slope, rel=1e-9, abs=1e-9)
    assert line.intercept_ips == pytest.approx(intercept_ips, abs=1e-9 * size)
    assert line.r_squared == pytest.approx(r_squared, rel=1e-9, abs=1e-12)
    assert line.count == len(points)


@few
@given(pairs, st.floats(0.1, 10.0), st.floats(0.0, 100.0))
def test_r_squared_sees_neither_scale_nor_offset_but_bias_and_rmse_do(points, scale, offset_ips):
    observed, predicted = np.transpose(points)
    assume(np.ptp(observed) > 0.1 and np.ptp(predicted) > 0.1)

    line = regression(observed, predicted)
    moved = regression(observed, scale * predicted + offset_ips)

    assert moved.r_squared == pytest.approx(line.r_squared, rel=1e-6, abs=1e-9)
    assert moved.slope == pytest.approx(scale * line.slope, rel=1e-6, abs=1e-6)
    assert bias_ips(observed, observed + offset_ips) == pytest.approx(
        offset_ips, rel=1e-9, abs=1e-9
    )
    assert rmse(observed, observed + offset_ips) == pytest.approx(offset_ips, rel=1e-9, abs=1e-9)


@few
@given(pairs)
def test_r_squared_and_p_do_not_ask_which_axis_is_which(points):
    observed, predicted = np.transpose(points)
    assume(np.ptp(observed) > 0.1 and np.ptp(predicted) > 0.1)

    one, other = regression(observed, predicted), regression(predicted, observed)

    assert one.r_squared == pytest.approx(other.r_squared, rel=1e-9, abs=1e-12)
    assert one.p_value == pytest.approx(other.p_value, rel=1e-6, abs=1e-9, nan_ok=True)


def test_the_p_value_is_the_share_of_shuffles_that_correlate_as_well():
    """A t test against 5000 shuffles of normal rates: within 4 standard errors."""
    rng = np.random.default_rng(11)
    observed = rng.normal(50.0, 10.0, 30)
    predicted = 0.3 * observed + rng.normal(0.0, 10.0, 30)
    line = regression(observed, predicted)
    shuffles = rng.permuted(np.tile(predicted, (5000, 1)), axis=1)

    products = (shuffles - predicted.mean()) @ (observed - observed.mean())
    chance = (products / (30.0 * observed.std() * predicted.std())) ** 2

    share = np.mean(chance >= line.r_squared)
    assert 0.02 < line.p_value < 0.5
    assert abs(share - line.p_value) < 4.0 * math.sqrt(line.p_value / 5000)


@few
@given(pairs)
def test_rmse_and_bias_are_those_of_a_plain_loop(points):
    errors_ips = [predicted - observed for observed, predicted in points]
    observed, predicted = zip(*points, strict=True)

    mean_square = math.fsum(error**2 for error in errors_ips) / len(errors_ips)
    mean = math.fsum(errors_ips) / len(errors_ips)

    assert rmse(observed, predicted) == pytest.approx(math.sqrt(mean_square), rel=1e-12)
    assert bias_ips(observed, predicted) == pytest.approx(mean, rel=1e-9, abs=1e-9)


def test_a_model_that_underrates_has_a_negative_bias():
    assert bias_ips([10.0, 20.0], [5.0, 20.0]) == -2.5
    assert rmse([10.0, 20.0], [5.0, 20.0]) == math.sqrt(12.5)


@pytest.mark.parametrize("rate_ips", [0.0, 0.1, 123.4])
def test_a_model_with_one_rate_for_all_has_a_flat_line_and_no_correlation(rate_ips):
    line = regression([0.0, 10.0, 35.0, 50.0], [rate_ips] * 4)

    assert (line.slope, line.intercept_ips) == (0.0, pytest.approx(rate_ips))
    assert math.isnan(line.r_squared)
    assert math.isnan(line.p_value)
    assert line.count == 4


def test_rates_that_differ_by_rounding_are_one_rate():
    """Means of the same counts in another order; a correlation of that is noise."""
    predicted = [0.1 + 0.2, 0.3, 0.3]
    assert predicted[0] != predicted[1]

    assert math.isnan(regression([1.0, 2.0, 3.0], predicted).r_squared)


@pytest.mark.parametrize("predicted_ips", [[1.0, 2.0, 3.0], [0.0, 0.0, 0.0]])
def test_observed_rates_that_are_all_equal_determine_no_line(predicted_ips):
    line = regression([7.0, 7.0, 7.0], predicted_ips)

    numbers = (line.slope, line.intercept_ips, line.r_squared, line.p_value)
    assert all(math.isnan(number) for number in numbers)
    assert line.count == 3


def test_a_line_through_two_points_fits_but_cannot_be_tested():
    line = regression([1.0, 3.0], [5.0, 1.0])

    assert (line.slope, line.intercept_ips, line.r_squared) == pytest.approx((-2, 7, 1))
    assert math.isnan(line.p_value)
    assert math.isnan(regression([1.0], [5.0]).slope)


def test_perfect_points_have_r_squared_one_and_a_vanishing_p():
    observed = np.linspace(0.0, 300.0, 37)

    line = regression(observed, 1.0 / 3.0 * observed + 0.7)

    assert line.r_squared == pytest.approx(1.0, abs=1e-14)
    assert line.r_squared <= 1.0
    assert line.p_value < 1e-100


def test_a_row_names_every_number_once():
    observed, predicted = [0.0, 10.0, 20.0], [1.0, 8.0, 30.0]

    row = agreement(observed, predicted).to_row()

    assert row == {
        **dataclasses.asdict(regression(observed, predicted)),
        "rmse_ips": rmse(observed, predicted),
        "bias_ips": bias_ips(observed, predicted),
    }
    assert list(row)[-2:] == ["rmse_ips", "bias_ips"]


@few
@given(pairs)
def test_any_rates_have_an_agreement(points):
    """No warning, no refusal: what is undetermined is NaN, RMSE and bias never are."""
    judged = agreement(*np.transpose(points))

    assert judged.rmse_ips >= abs(judged.bias_ips) * (1 - 1e-9)


@pytest.mark.parametrize(
    ("observed_ips", "predicted_ips", "words"),
    [
        ([], [], r"observed_ips of shape \(0,\)"),
        ([1.0, 2.0], [], r"predicted_ips of shape \(0,\)"),
        ([1.0, 2.0], [1.0], "2 observed_ips and 1 predicted_ips"),
        ([1.0, math.nan], [1.0, 2.0], "observed_ips is nan at row 1"),
        ([1.0, 2.0], [math.inf, 2.0], "predicted_ips is inf at row 0"),
        ([[1.0, 2.0]], [[1.0, 2.0]], r"observed_ips of shape \(1, 2\)"),
        (1.0, 2.0, r"observed_ips of shape \(\)"),
    ],
)
def test_rates_that_are_no_pairs_are_refused(observed_ips, predicted_ips, words):
    for measure in (agreement, regression, rmse, bias_ips):
        with pytest.raises(ParameterError, match=words):
            measure(observed_ips, predicted_ips)


def test_the_examples_of_the_docstrings_are_true():
    outcome = doctest.testmod(import_module("neural.agreement"))

    assert outcome.attempted > 0
    assert outcome.failed == 0


# R² and RMSE of TouchSim (Saal et al. 2017) against the digitised sines of Muniak et
# al. 2007, without indentation before, as they were worked out by another program.
@pytest.mark.parametrize(
    ("afferent", "r_squared", "rmse_ips"),
    [("SA", 0.94, 7.3), ("RA", 0.60, 32.4), ("PC", 0.98, 38.7)],
)
def test_touchsim_agrees_with_the_observed_sines_as_measured_before(afferent, r_squared, rmse_ips):
    """Windows of the paper's section 3.2: 245 ms at 20 Hz, 100 ms else."""
    observed_file = RECORDINGS / "observed_sine_rates.csv"
    touchsim_file = RECORDINGS / "touchsim_rates.csv"
    if not (observed_file.exists() and touchsim_file.exists()):
        pytest.skip("the observed rates are not ours to give away; they are not here")
    observed = {
        row["stimulus"]: float(row["rate_ips"])
        for row in read_rows(observed_file)
        if row["afferent"] == afferent
    }
    predicted = {
        row["stimulus"]: float(row["rate_mean_ips"])
        for row in read_rows(touchsim_file)
        if row["afferent"] == afferent
        and row["stimulus"] in observed
        and row["preindent_um"] == "0"
        and row["window_ms"] == ("245" if float(row["f1_hz"]) == 20.0 else "100")
    }

    judged = agreement(list(observed.values()), [predicted[name] for name in observed])

    assert judged.regression.count == 37
    assert round(judged.regression.r_squared, 2) == r_squared
    assert round(judged.rmse_ips, 1) == rmse_ips
    assert judged.regression.p_value < 1e-6


def read_rows(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))
