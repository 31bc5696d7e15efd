"""Regression line, RMSE and bias against hand-worked points and plain sums."""

import math

import pytest

from fembridge.errors import ParameterError
from neural.agreement import agreement


def regression(observed, predicted):
    return agreement(observed, predicted).regression


def test_four_points_give_the_line_worked_out_by_hand():
    """From their means −3 −1 1 3 across, −2 0 −2 4 up: Sxx 20, Syy 24, Sxy 16.

    So the slope is 16/20 = 4/5 and R² is 16²/(20 · 24) = 8/15. With two degrees of
    freedom the t test has p = 1 − t/sqrt(t² + 2), which is 1 − |r|.
    """
    judged = agreement([2.0, 4.0, 6.0, 8.0], [4.0, 6.0, 4.0, 10.0])
    line = judged.regression

    assert judged.bias_ips == pytest.approx(1.0)
    assert judged.rmse_ips == pytest.approx(math.sqrt((4 + 4 + 4 + 4) / 4))
    assert list(judged.to_row())[-2:] == ["rmse_ips", "bias_ips"]
    assert line.slope == pytest.approx(0.8, rel=1e-14)
    assert line.intercept_ips == pytest.approx(2.0, rel=1e-13)
    assert line.r_squared == pytest.approx(8 / 15, rel=1e-14)
    assert line.p_value == pytest.approx(1 - math.sqrt(8 / 15), rel=1e-13)
    assert line.count == 4


@pytest.mark.parametrize("rates_ips", [[0.0] * 4, [123.4] * 4, [0.1 + 0.2, 0.3, 0.3, 0.3]])
def test_a_model_with_one_rate_for_all_has_a_flat_line_and_no_correlation(rates_ips):
    """Also where means of the same counts in another order differ by rounding."""
    line = regression([0.0, 10.0, 35.0, 50.0], rates_ips)
    assert (line.slope, line.intercept_ips) == (0.0, pytest.approx(rates_ips[-1]))
    assert math.isnan(line.r_squared)
    assert math.isnan(line.p_value)
    assert line.count == 4


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


@pytest.mark.parametrize(
    ("observed_ips", "predicted_ips"),
    [
        ([], []),
        ([1.0, 2.0], [1.0]),
        ([1.0, math.nan], [1.0, 2.0]),
        ([1.0, 2.0], [math.inf, 2.0]),
        ([[1.0, 2.0]], [[1.0, 2.0]]),
    ],
)
def test_rates_that_are_no_pairs_are_refused(observed_ips, predicted_ips):
    with pytest.raises(ParameterError):
        agreement(observed_ips, predicted_ips)
