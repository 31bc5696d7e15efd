"""TouchSim's stored rates: whole, in the right windows, and as good as was measured."""

import pytest

from decks.stimuli import CATALOGUE
from fembridge.errors import UsageError
from fembridge.evidence import TOUCHSIM_MODELS, touchsim_rates
from fembridge.tables import AFFERENTS

TRIALS = 5  # of each model: fewer do not make whole numbers of spikes


@pytest.mark.parametrize("whole_second", [False, True])
@pytest.mark.parametrize("depth_um", [0.0, 500.0])
def test_each_stimulus_has_a_whole_number_of_spikes_of_each_class(depth_um, whole_second):
    """A row of the other window would leave fractions of spikes."""
    windows_ms = {entry.id: entry.window_ms for entry in CATALOGUE}
    rates = touchsim_rates(depth_um, whole_second=whole_second)
    assert [(rate.stimulus, rate.afferent) for rate in rates] == [
        (entry.id, afferent) for entry in CATALOGUE for afferent in AFFERENTS
    ]
    for rate in rates:
        start_ms, end_ms = (0.0, 1000.0) if whole_second else windows_ms[rate.stimulus]
        count = TOUCHSIM_MODELS[rate.afferent] * TRIALS
        spikes = rate.rate_ips * count * (end_ms - start_ms) / 1000.0
        rounding = 0.0005 * count * (end_ms - start_ms) / 1000.0  # three decimals kept
        assert abs(spikes - round(spikes)) <= rounding + 1e-9, rate


def test_a_depth_that_was_not_computed_is_said():
    with pytest.raises(UsageError, match=r"250.*0 or 500"):
        touchsim_rates(250)
