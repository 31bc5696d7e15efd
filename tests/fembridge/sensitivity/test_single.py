"""One parameter at a time: low, base, high."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fembridge.errors import UsageError
from fembridge.sensitivity import Output, SweptFingers, is_one_at_a_time, single_effects
from fembridge.sensitivity.single import effects_in_order
from fembridge.sweep.design import Range, one_at_a_time

RATE = Output("SA", "rate_ips", "all")
STRESS = Output("SA", "peak_stress_pa", "all")


def fingers(rows, *answers, outputs=(RATE, STRESS)):
    names = tuple(rows[0])
    value = np.array([[row[name] for name in names] for row in rows])
    return SweptFingers(names, value, outputs[: len(answers)], np.stack(answers, axis=1))


@given(slopes=st.lists(st.floats(-5, 5), min_size=1, max_size=5), half=st.floats(0.01, 0.5))
def test_the_change_of_a_linear_answer_is_slope_times_range(slopes, half):
    base = {f"p{k}": 1.0 for k in range(len(slopes))}
    rows = one_at_a_time(base, {name: Range(1 - half, 1 + half) for name in base})
    answers = np.array([np.dot(slopes, list(row.values())) for row in rows])

    swept = fingers(rows, answers)

    assert is_one_at_a_time(swept)
    effects = single_effects(swept)
    assert [each.parameter for each in effects] == list(base)
    for effect, slope in zip(effects, slopes, strict=True):
        span = effect.high - effect.low
        assert (effect.low, effect.high) == (rows[1]["p0"], rows[2]["p0"])
        assert effect.change == pytest.approx(slope * span, abs=1e-9)
        assert effect.at_base == answers[0]
        if answers[0]:
            expected = 100 * effect.change / answers[0]
            assert effect.percent == pytest.approx(expected)


def test_an_answer_that_comes_back_is_not_monotone_though_the_change_is_0():
    rows = one_at_a_time({"p": 1.0, "q": 1.0}, {"p": Range(0, 2), "q": Range(0, 2)})
    [p, q] = single_effects(fingers(rows, np.array([5.0, 3.0, 3.0, 4.0, 5.0])))

    assert (p.change, p.is_monotone) == (0.0, False)
    assert (q.change, q.is_monotone) == (1.0, True)


def test_more_than_two_levels_are_compared_from_end_to_end():
    rows = [{"p": 2.0, "q": 0.0}, *({"p": x, "q": 0.0} for x in (4.0, 1.0, 3.0))]
    rows.append({"p": 2.0, "q": 1.0})
    effects = single_effects(fingers(rows, np.array([20.0, 41.0, 9.0, 30.0, 20.0])))

    assert (effects[0].low, effects[0].base, effects[0].high) == (1.0, 2.0, 4.0)
    assert (effects[0].at_low, effects[0].at_base, effects[0].at_high) == (9, 20, 41)
    assert effects[0].is_monotone


def test_a_silent_base_has_no_percentage():
    rows = one_at_a_time({"p": 1.0}, {"p": Range(0, 2)})
    [effect] = single_effects(fingers(rows, np.array([0.0, 0.0, 4.0])))

    assert effect.change == 4.0
    assert math.isnan(effect.percent)


def test_the_strongest_comes_first_and_stress_parts_what_rates_do_not():
    rows = one_at_a_time({"p": 1.0, "q": 1.0, "r": 1.0}, {n: Range(0, 2) for n in "pqr"})
    rates = np.array([10.0, 10, 10, 10, 10, 10, 12])
    stress = np.array([100.0, 99, 101, 90, 110, 100, 100])

    assert effects_in_order(single_effects(fingers(rows, rates, stress))) == ["r", "q", "p"]


def test_two_changes_at_once_are_no_one_at_a_time():
    swept = fingers([{"p": 0.0, "q": 0.0}, {"p": 1.0, "q": 1.0}], np.array([0.0, 1.0]))

    assert not is_one_at_a_time(swept)
    with pytest.raises(UsageError, match="more than one parameter"):
        single_effects(swept)
