"""TouchSim's stored rates: whole, in the right windows, and as good as was measured."""

from pathlib import Path

import numpy as np
import pytest

import fembridge
from decks.stimuli import CATALOGUE
from fembridge.errors import UsageError
from fembridge.observed import read_observed
from fembridge.tables import AFFERENTS, read_rates, write_rates
from fembridge.touchsim import MODELS, touchsim_rates

SHARED = Path(fembridge.__file__).parents[2] / "shared" / "data"
OBSERVED_SINES = SHARED / "observed_sine_rates.csv"

ALL_KINDS = [
    pytest.param(depth_um, whole_second, id=f"{depth_um:g} um, {name}")
    for depth_um in (0.0, 500.0)
    for whole_second, name in ((False, "own window"), (True, "whole second"))
]
TRIALS = 5  # of each model: fewer do not make whole numbers of spikes


@pytest.mark.parametrize(("depth_um", "whole_second"), ALL_KINDS)
def test_every_stimulus_of_the_catalogue_has_one_rate_of_each_class(depth_um, whole_second):
    rates = touchsim_rates(depth_um, whole_second=whole_second)

    assert [(rate.stimulus, rate.afferent) for rate in rates] == [
        (entry.id, afferent) for entry in CATALOGUE for afferent in AFFERENTS
    ]


@pytest.mark.parametrize(("depth_um", "whole_second"), ALL_KINDS)
def test_a_rate_is_a_whole_number_of_spikes_in_its_window(depth_um, whole_second):
    """A row of the other window would leave fractions of spikes."""
    windows_ms = {entry.id: entry.window_ms for entry in CATALOGUE}

    for rate in touchsim_rates(depth_um, whole_second=whole_second):
        start_ms, end_ms = (0.0, 1000.0) if whole_second else windows_ms[rate.stimulus]
        count = MODELS[rate.afferent] * TRIALS
        spikes = rate.rate_ips * count * (end_ms - start_ms) / 1000.0
        rounding = 0.0005 * count * (end_ms - start_ms) / 1000.0  # three decimals kept
        assert abs(spikes - round(spikes)) <= rounding + 1e-9, rate


@pytest.mark.parametrize(("depth_um", "whole_second"), ALL_KINDS)
def test_no_spread_among_n_models_is_wider_than_one_of_them_alone_firing(depth_um, whole_second):
    """With one of n models firing, the deviation is the square root of n means."""
    for rate in touchsim_rates(depth_um, whole_second=whole_second):
        widest_ips = np.sqrt(MODELS[rate.afferent]) * rate.rate_ips
        assert rate.sd_ips <= widest_ips + 0.002, rate  # three decimals kept


def test_a_depth_that_was_not_computed_is_told():
    with pytest.raises(UsageError, match=r"250.*0 or 500"):
        touchsim_rates(250)


def test_the_rates_are_rates_that_a_table_takes(tmp_path):
    path = tmp_path / "rates.csv"
    rates = touchsim_rates()

    write_rates(path, rates)

    assert [rate.rate_ips for rate in read_rates(path)] == [rate.rate_ips for rate in rates]
    assert read_observed(path).families == ("sine", "diharm", "noise")


@pytest.mark.skipif(
    not OBSERVED_SINES.is_file(), reason="the observed rates are not on this machine"
)
@pytest.mark.parametrize(
    ("afferent", "r_squared", "rmse_ips"),
    [("SA", 0.94, 7.3), ("RA", 0.60, 32.4), ("PC", 0.98, 38.7)],
)
def test_against_the_observed_sinusoids_it_is_as_good_as_was_measured(
    afferent, r_squared, rmse_ips
):
    """The figures of the README beside the table, to the digits it gives.

    The whole second gives others: RA 0.59, PC 38.6 ips.
    """
    predicted = {
        rate.stimulus: rate.rate_ips for rate in touchsim_rates() if rate.afferent == afferent
    }
    stimuli, observed_ips = read_observed(OBSERVED_SINES).of(afferent)
    predicted_ips = np.array([predicted[stimulus] for stimulus in stimuli])

    correlation = np.corrcoef(observed_ips, predicted_ips)[0, 1]
    error_ips = np.sqrt(np.mean((predicted_ips - observed_ips) ** 2))

    assert round(correlation**2, 2) == r_squared
    assert round(error_ips, 1) == rmse_ips
