"""Rates side by side: each where it belongs, NaN where a source has none."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from fembridge.errors import UsageError
from fembridge.tables import AFFERENTS, Rate
from fembridge.validation.compared_rates import OBSERVED, TOUCHSIM, ComparedRates, compare_rates

STIMULI = ("sine_20_250", "sine_50_250", "noise_5_25_50")
PLACES = [(stimulus, afferent) for stimulus in STIMULI for afferent in AFFERENTS]


@given(
    rates=st.dictionaries(
        st.tuples(st.sampled_from(["first", "second"]), st.sampled_from(PLACES)), st.floats(0, 500)
    )
)
def test_each_rate_stands_in_its_place_and_nothing_in_any_other(rates):
    sources = {
        source: [
            Rate(*place, rate_ips) for (its, place), rate_ips in rates.items() if its == source
        ]
        for source in ("first", "second")
    }
    compared = compare_rates(STIMULI, sources)
    for source in sources:
        for stimulus, afferent in PLACES:
            [found] = compared.of(source, afferent, [stimulus])
            expected = rates.get((source, (stimulus, afferent)), np.nan)
            assert_array_equal(found, expected)
    known = [source for source in sources if sources[source]]
    assert list(compared.known(STIMULI)) == known


def test_a_rate_of_another_stimulus_is_left_out():
    compared = compare_rates(STIMULI, {"own": [Rate("sine_40_100", "SA", 9.0)]})
    assert np.isnan(compared.rate_ips).all()


def test_the_reference_is_what_was_observed_of_these_stimuli_or_else_touchsim():
    rates = {
        OBSERVED: [Rate("sine_20_250", "SA", 4.0)],
        TOUCHSIM: [Rate(stimulus, "SA", 5.0) for stimulus in STIMULI],
    }
    compared = compare_rates(STIMULI, rates)
    assert compared.reference(STIMULI) == OBSERVED
    assert compared.reference(STIMULI[1:]) == TOUCHSIM


@pytest.mark.parametrize(
    ("sources", "rate_ips", "words"),
    [
        (("a",), np.zeros((1, 3, 2)), "shape"),
        (("a", "a"), np.zeros((2, 3, 3)), "stands there twice"),
        (("a",), np.full((1, 3, 3), -1.0), "negative"),
        (("a",), np.full((1, 3, 3), np.inf), "infinite"),
    ],
)
def test_what_are_no_rates_side_by_side_is_refused(sources, rate_ips, words):
    with pytest.raises(UsageError, match=words):
        ComparedRates(sources, STIMULI, rate_ips)
