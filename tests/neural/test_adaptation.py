"""Membranes whose threshold each spike raises: what follows from jump and recovery."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fembridge.errors import ParameterError
from neural.candidates import candidate_counts
from neural.coefficients import Coefficients
from neural.lif import integrate, spike_counts

DT_MS, GAP_MV = 0.5, 10.0
seeds = st.integers(0, 2**32 - 1)


@settings(max_examples=20)
@given(seed=seeds, recovery_ms=st.floats(0.5, 1e4), floored=st.booleans())
def test_a_jump_of_nothing_is_no_adaptation(seed, recovery_ms, floored):
    drive = np.random.default_rng(seed).uniform(-10, 40, (120, 3))
    batch = {"dt_ms": DT_MS, "gap_mv": GAP_MV, "floored": floored}
    one = Coefficients(1.0, weights=(1.0,))

    plain_mv, plain = integrate(drive, 20.0, DT_MS, GAP_MV, floored=floored)
    potential_mv, fired = integrate(
        drive, 20.0, DT_MS, GAP_MV, floored=floored, jump_mv=0.0, recovery_ms=recovery_ms
    )

    np.testing.assert_array_equal(fired, plain)
    np.testing.assert_array_equal(potential_mv, plain_mv)
    for jump_mv in (0.0, [0.0, 5.0]):  # a still one beside one that adapts
        counts = candidate_counts(
            [drive], one, 20.0, **batch, jump_mv=jump_mv, recovery_ms=recovery_ms
        )
        np.testing.assert_array_equal(counts[0], plain.sum(axis=0))
    adaptive = {"jump_mv": 5.0, "recovery_ms": recovery_ms, "floored": floored}
    _, beside = integrate(drive, 20.0, DT_MS, GAP_MV, **adaptive)
    np.testing.assert_array_equal(counts[1], beside.sum(axis=0))
    if not floored:
        np.testing.assert_array_equal(spike_counts(drive, 20.0, DT_MS, GAP_MV), plain.sum(axis=0))


def test_a_threshold_that_never_comes_back_lengthens_every_interval_by_a_jump():
    """2 mV a row and a jump of 4: over 10, 14, 18, ... after 6, 8, 10, ... rows.

    The threshold of the n-th spike is 10 + 4n: 6 + 2n rows, one more than reach it.
    """
    _, fired = integrate(np.full(84, 4.0), 1e15, DT_MS, GAP_MV, jump_mv=4.0, recovery_ms=math.inf)

    assert np.flatnonzero(fired).tolist() == (np.cumsum([6, 8, 10, 12, 14, 16, 18]) - 1).tolist()


def test_a_jump_that_lasts_a_row_is_gone_at_the_next():
    """`recovery_ms` of one step keeps nothing of a jump: as without."""
    current = np.random.default_rng(5).uniform(0, 60, 200)

    _, adaptive = integrate(current, 20.0, DT_MS, GAP_MV, jump_mv=9.0, recovery_ms=DT_MS)
    _, plain = integrate(current, 20.0, DT_MS, GAP_MV)

    np.testing.assert_array_equal(adaptive, plain)


@pytest.mark.parametrize("recovery_ms", [20.0, 60.0])
def test_the_period_of_an_adaptive_cell_grows_to_a_steady_one(recovery_ms):
    """Steady at n rows: a jump θ* = jump + θ* q^n just passed by the n-th row.

    Without leak the n-th row has c n dt; q is 1 − dt/recovery. So n is the first
    with c n dt > gap + jump q^n / (1 − q^n).
    """
    current, jump_mv = 0.8, 6.0
    _, fired = integrate(
        np.full(6000, current), 1e15, DT_MS, GAP_MV, jump_mv=jump_mv, recovery_ms=recovery_ms
    )
    periods = np.diff(np.flatnonzero(fired))

    kept = (1.0 - DT_MS / recovery_ms) ** np.arange(1, 1000)
    passed = current * DT_MS * np.arange(1, 1000) > GAP_MV + jump_mv * kept / (1 - kept)
    steady = int(np.flatnonzero(passed)[0]) + 1
    assert periods[0] < periods[-1]
    assert (np.diff(periods[:4]) >= 0).all()
    assert np.abs(periods[-20:] - steady).max() <= 1  # rows are whole
    assert np.flatnonzero(fired)[0] == 25  # 26 rows of 0.4 mV, as from rest


@settings(max_examples=20)
@given(seed=seeds, jump_mv=st.floats(0.1, 20), recovery_ms=st.floats(1, 500))
def test_a_cell_that_adapts_fires_no_earlier_and_its_first_spike_is_the_same(
    seed, jump_mv, recovery_ms
):
    """Under a constant current every spike of the adaptive one comes later."""
    current = np.full(300, np.random.default_rng(seed).uniform(1, 40))

    _, plain = integrate(current, 30.0, DT_MS, GAP_MV)
    _, adaptive = integrate(current, 30.0, DT_MS, GAP_MV, jump_mv=jump_mv, recovery_ms=recovery_ms)

    rows, later = np.flatnonzero(plain), np.flatnonzero(adaptive)
    assert rows[0] == later[0]
    assert later.size <= rows.size
    assert (later >= rows[: later.size]).all()


def test_conditions_adapt_apart():
    currents = np.column_stack([np.full(200, 4.0), np.full(200, 30.0), np.zeros(200)])
    adaptive = {"jump_mv": 3.0, "recovery_ms": 30.0, "floored": True}

    _, together = integrate(currents, 25.0, DT_MS, GAP_MV, 0.5, **adaptive)

    for column, current in enumerate(currents.T):
        _, alone = integrate(current, 25.0, DT_MS, GAP_MV, 0.5, **adaptive)
        np.testing.assert_array_equal(together[:, column], alone)
    assert together.sum(axis=0)[2] == 0 < together.sum(axis=0)[0]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"jump_mv": -1.0}, "jump_mv must be >= 0, got -1"),
        ({"jump_mv": math.nan}, "jump_mv must be >= 0, got nan"),
        ({"jump_mv": math.inf}, "jump_mv must be >= 0, got inf"),
        ({"recovery_ms": 0.4}, r"recovery_ms must be at least dt_ms, 0\.5, got 0\.4"),
        ({"recovery_ms": math.nan}, "recovery_ms must be at least dt_ms, .* got nan"),
    ],
)
def test_an_adaptation_without_meaning_is_refused(change, words):
    with pytest.raises(ParameterError, match=words):
        integrate(np.zeros(9), 20.0, DT_MS, GAP_MV, **change)
    with pytest.raises(ParameterError, match=words):
        candidate_counts(
            [np.zeros((9, 2))],
            Coefficients(1.0, weights=(1.0,)),
            [20.0, 30.0],
            dt_ms=DT_MS,
            gap_mv=GAP_MV,
            **change,
        )
