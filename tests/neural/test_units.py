"""Units in one pass against cells one by one."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from fembridge.errors import ParameterError, TraceError
from neural import parameter_set
from neural.encoder import encode_cells, encode_units
from neural.parameters import quantiles

FITTED = parameter_set("fitted").parameters
PAD = parameter_set("fitted_pad").parameters
TIME = np.arange(501) * 0.5
WAVE = 20_000 * (1 + np.sin(2 * np.pi * 0.03 * TIME)) ** 1.3


@pytest.mark.parametrize("name", ["SA", "RA", "PC"])
@pytest.mark.parametrize("parameters", ["published", "fitted"])
def test_units_at_the_cells_quantiles_fire_as_the_cells_do(name, parameters):
    chosen = parameter_set(parameters).parameters
    one = chosen[name]
    deviate = quantiles(one.cells)
    stress = np.tile(WAVE[:, None], (1, one.cells))
    fired = encode_units(stress, [name] * one.cells, 0.5, chosen, deviate)
    [cells] = encode_cells(WAVE, 0.5, one)
    for unit, times_ms in enumerate(cells):
        assert_array_equal(fired.time_ms[fired.unit == unit], times_ms)


def test_classes_share_a_pass_and_keep_their_order():
    names = ["PC", "SA", "RA", "SA"]
    stress = np.stack([WAVE, WAVE, WAVE, 0.5 * WAVE], -1)
    together = encode_units(stress, names, 0.5, FITTED)
    for unit, name in enumerate(names):
        alone = encode_units(stress[:, unit : unit + 1], [name], 0.5, FITTED)
        assert_array_equal(together.time_ms[together.unit == unit], alone.time_ms)


def test_trials_are_alike_without_noise_and_repeat_with_their_seed():
    stress = np.stack([WAVE, 0.7 * WAVE], -1)
    still = encode_units(stress, ["RA", "SA"], 0.5, FITTED, trials=3)
    first = still.time_ms[still.trial == 1]
    for trial in (2, 3):
        assert_array_equal(still.time_ms[still.trial == trial], first)

    def noisy(seed):
        rng = np.random.default_rng(seed)
        return encode_units(stress, ["RA", "SA"], 0.5, FITTED, trials=5, noise_mv=1.0, rng=rng)

    assert_array_equal(noisy(1).time_ms, noisy(1).time_ms)
    assert (
        noisy(1).time_ms.size != noisy(2).time_ms.size
        or (noisy(1).time_ms != noisy(2).time_ms).any()
    )


def test_noise_has_the_size_that_it_says():
    """Without leak and without a threshold the potential spreads by noise_mv sqrt(t)."""
    rng = np.random.default_rng(0)
    fired = encode_units(np.zeros((201, 400)), ["RA"] * 400, 0.5, PAD, noise_mv=2.0, rng=rng)
    # A walk of 2 mV in 1 ms, clamped at rest, passes 10 mV after some 25 to 50 ms.
    rate = fired.time_ms.size / 400 / 100
    assert 1 / 60 < rate < 1 / 20


def test_what_does_not_fit_is_refused():
    with pytest.raises(TraceError):
        encode_units(WAVE[:, None], ["SA", "RA"], 0.5, FITTED)
    with pytest.raises(ParameterError, match="1 ms"):
        encode_units(WAVE[:, None], ["SA"], 1.0, FITTED)
    with pytest.raises(ParameterError, match="XX"):
        encode_units(WAVE[:, None], ["XX"], 0.5, FITTED)
    with pytest.raises(ParameterError):
        encode_units(WAVE[:, None], ["SA"], 0.5, FITTED, noise_mv=1.0)
