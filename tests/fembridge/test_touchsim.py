"""TouchSim's stored rates: whole, in the right windows, and as good as was measured."""

import pytest

from decks.stimuli import CATALOGUE
from fembridge.errors import UsageError
from fembridge.evidence import TOUCHSIM_MODELS, touchsim_rates
from fembridge.tables import AFFERENTS

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
        count = TOUCHSIM_MODELS[rate.afferent] * TRIALS
        spikes = rate.rate_ips * count * (end_ms - start_ms) / 1000.0
        rounding = 0.0005 * count * (end_ms - start_ms) / 1000.0  # three decimals kept
        assert abs(spikes - round(spikes)) <= rounding + 1e-9, rate


def test_a_depth_that_was_not_computed_is_said():
    with pytest.raises(UsageError, match=r"250.*0 or 500"):
        touchsim_rates(250)
