"""Cells of the agreement tables against rates whose agreement is known."""

import math
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

from fembridge.errors import UsageError
from fembridge.tables import AFFERENTS, Rate
from fembridge.touchsim import touchsim_rates
from fembridge.validation.agreement_cell import EVERY_SET, agreement_cells, cell_of, references_of
from fembridge.validation.compared_rates import OBSERVED, TOUCHSIM, compare_rates
from fembridge.validation.family import FAMILIES, SINES
from fembridge.validation.study import STIMULI

TRUE = touchsim_rates()


def scaled(factor, offset_ips=0.0):
    return [
        Rate(rate.stimulus, rate.afferent, factor * rate.rate_ips + offset_ips) for rate in TRUE
    ]


@pytest.fixture(scope="module")
def compared():
    sources = {
        OBSERVED: [rate for rate in TRUE if rate.stimulus in SINES.stimuli],
        "equal": scaled(1.0),
        "double": scaled(2.0, 3.0),
        "silent": scaled(0.0),
        TOUCHSIM: scaled(1.1),
    }
    return compare_rates(STIMULI, sources)


@cache
def cells_of(compared, reference):
    return agreement_cells(compared, reference)


def of_sines(compared, source, afferent="RA", reference=OBSERVED):
    return cell_of(cells_of(compared, reference), reference, source, "sine", afferent)


def test_equal_rates_agree_fully_and_meet_both_goals(compared):
    cell = of_sines(compared, "equal")
    assert cell.count == 37
    assert_allclose(cell.agreement.regression.r_squared, 1.0)
    assert cell.agreement.rmse_ips == 0.0
    assert cell.meets_paper
    assert cell.beats(of_sines(compared, TOUCHSIM))


def test_doubled_rates_lie_on_a_line_and_are_worse_than_those_a_tenth_too_high(compared):
    cell = of_sines(compared, "double")
    line = cell.agreement.regression
    assert_allclose([line.slope, line.intercept_ips, line.r_squared], [2, 3, 1])
    rates = compared.of(OBSERVED, "RA", SINES.stimuli)
    assert_allclose(cell.agreement.bias_ips, (rates + 3).mean())
    assert cell.meets_paper
    assert cell.beats(of_sines(compared, TOUCHSIM)) is False


def test_a_silent_model_meets_nothing(compared):
    cell = of_sines(compared, "silent")
    assert math.isnan(cell.agreement.regression.r_squared)
    assert cell.meets_paper is False
    assert cell.beats(of_sines(compared, TOUCHSIM)) is False


def test_rates_with_a_line_beat_silence_if_they_are_nearer(compared):
    silent = of_sines(compared, "silent")
    assert of_sines(compared, "equal").beats(silent)


def test_agreement_with_touchsim_is_no_goal(compared):
    cell = of_sines(compared, "equal", reference=TOUCHSIM)
    assert cell.agreement is not None
    assert cell.meets_paper is None
    assert cell.beats(cell) is None


def test_without_a_common_stimulus_a_cell_is_empty_and_meets_nothing(compared):
    cells = cells_of(compared, OBSERVED)
    cell = cell_of(cells, OBSERVED, "equal", "noise", "SA")
    assert cell.agreement is None
    assert cell.count == 0
    assert cell.meets_paper is None


def test_there_is_a_cell_for_each_source_set_and_class(compared):
    cells = cells_of(compared, OBSERVED)
    sets = sum(len(family.sets) + 1 for family in FAMILIES)
    assert len(cells) == 4 * sets * len(AFFERENTS)
    assert references_of(compared) == (OBSERVED, TOUCHSIM)


def test_the_points_of_a_family_are_those_of_its_sets(compared):
    cells = cells_of(compared, TOUCHSIM)
    for family in FAMILIES:
        each = [
            cell_of(cells, TOUCHSIM, "double", family.name, "PC", one.name).count
            for one in family.sets
        ]
        whole = cell_of(cells, TOUCHSIM, "double", family.name, "PC", EVERY_SET)
        assert whole.count == np.sum(each) == len(family.stimuli)


def test_a_cell_that_is_not_there_is_named(compared):
    with pytest.raises(UsageError, match="no agreement of observed, nobody, sine"):
        cell_of(cells_of(compared, OBSERVED), OBSERVED, "nobody", "sine", "SA")
