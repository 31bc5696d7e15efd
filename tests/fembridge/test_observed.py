"""Observed rates: a table comes back as it was, or is refused with the line and what it has."""

from functools import partial

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from decks.stimuli import CATALOGUE
from fembridge.errors import TableError, UsageError
from fembridge.observed import read_observed
from fembridge.tables import AFFERENTS, Rate, read_rates, write_rates

HEADER = "stimulus,afferent,rate_ips\n"
IDS = [entry.id for entry in CATALOGUE]
OWN_IDS = ["sine_600_10", "sine_40_100", "diharm_10_50_20_20", "noise_30_200_7"]


@st.composite
def rate_arrays(draw):
    """Rates of some classes under some stimuli, in units that cannot be mistaken."""
    stimuli = draw(st.lists(st.sampled_from(IDS + OWN_IDS), min_size=1, unique=True))
    afferents = draw(st.sets(st.sampled_from(AFFERENTS), min_size=1))
    ips = st.just(0.0) | st.floats(0.51, 2000)
    column = st.lists(ips, min_size=len(stimuli), max_size=len(stimuli))
    columns = [draw(column) for _ in afferents]
    names = tuple(name for name in AFFERENTS if name in afferents)
    return tuple(stimuli), names, np.array(columns).T


@settings(settings.get_profile("costly"))
@given(written=rate_arrays(), mix=st.randoms(use_true_random=False))
def test_rates_come_back_bit_for_bit_however_the_classes_are_mixed(tmp_path_factory, written, mix):
    path = tmp_path_factory.mktemp("observed") / "rates.csv"
    stimuli, afferents, rate_ips = written
    rates = [
        Rate(stimulus, afferent, rate_ips[row, column])
        for row, stimulus in enumerate(stimuli)
        for column, afferent in enumerate(afferents)
    ]
    mix.shuffle(rates)
    write_rates(path, rates)

    frame = pd.DataFrame(rates).drop(columns="unit")
    of_file, of_frame = read_observed(path), read_observed(frame)

    for back in (of_file, of_frame):
        assert back.stimuli == tuple(dict.fromkeys(rate.stimulus for rate in rates))
        assert back.afferents == afferents
        order = [stimuli.index(each) for each in back.stimuli]
        np.testing.assert_array_equal(back.rate_ips, rate_ips[order])
        assert sorted(back.rates(), key=repr) == sorted(read_rates(path), key=repr)


@pytest.fixture
def table(file):
    """Write a text or bytes as a table and give its path."""
    return partial(file, "observed.csv")


def test_ids_come_back_as_the_catalogue_spells_them(table):
    path = table(HEADER + "SINE_20_250.00,SA,3\ndiharm_10_50_125_125,SA,4\nsine_600_10,SA,5\n")

    observed = read_observed(path)

    assert observed.stimuli == ("sine_20_250", "diharm_10_50_125", "sine_600_10")


def test_a_class_has_its_own_stimuli_and_one_that_was_not_observed_is_named(table):
    observed = read_observed(table(HEADER + "sine_50_250,PC,4\nsine_20_250,SA,3\n"), complete=False)

    stimuli, rate_ips = observed.of("PC")
    assert (stimuli, rate_ips.tolist()) == (("sine_50_250",), [4.0])
    with pytest.raises(UsageError, match="'RA'"):
        observed.of("RA")


LACKING = "sine_20_25,SA,3\nsine_20_25,RA,3\nsine_50_250,SA,4\nsine_100_10,RA,5\n"


@pytest.mark.parametrize(
    ("rows", "line", "found"),
    [
        ("", None, "no rates"),
        ("sine_20_25,SA,3\nsine_20_25,RA,3\nsine_20_25.0,SA,3\n", 4, "line 2: sine_20_25, SA"),
        (LACKING, 4, "sine_50_250 has no rate of RA"),
        (LACKING + "sine_50_250,RA,3\n", 5, "sine_100_10 has no rate of SA"),
        ("sine_20_25,PC,3\nsine_20_25,SA1,3\n", 3, "'SA1'"),
        ("sine_20_25,SA,3\nsine_20_250,SA,2000.5\n", 3, "2000.5"),
        (
            "sine_20_25,PC,0\nsine_20_250,PC,0.25\nsine_50_250,PC,0.1\n",
            3,
            "0.25, the highest of PC",
        ),
        (",SA,3\n", 2, "stimulus is empty"),
        ("sine_20_250um,SA,3\n", 2, "did you mean sine_20_250"),
        ("sine_2000_5,SA,3\n", 2, "sine_2000_5: frequency_hz"),
        ("sine_20,SA,3\n", 2, "'sine_20' names 12 stimuli"),
        ("sine_20_25,3\n", 2, "'3'"),
        *(
            (f"sine_20_25,SA,3\nsine_20_25,RA,{cell}\n", 3, found)
            for cell, found in (("", "''"), ("NaN", "'NaN'"), ("-3", "-3"), ('"12,5"', "'12,5'"))
        ),
    ],
)
def test_a_row_that_is_no_rate_is_named(table, rows, line, found):
    with pytest.raises(TableError) as caught:
        read_observed(table(HEADER + rows))

    assert caught.value.line == line
    assert found in caught.value.problem


def test_a_frame_names_its_row():
    frame = pd.DataFrame({"stimulus": ["sine_20_250"] * 2, "afferent": ["SA", "RA"]})
    with pytest.raises(TableError, match="DataFrame:2: rate_ips is nan"):
        read_observed(frame.assign(rate_ips=[3.0, np.nan]))
