"""The loop over all membranes at once against one membrane at a time."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fembridge.errors import ParameterError, TraceError
from neural.encoder import encode_afferents, encode_cells, membrane_potential
from neural.firing import fire
from neural.lif import adaptation_constants, integrate, membrane_constants
from neural.parameters import PUBLISHED
from neural.sets import parameter_set

DT_MS = 0.5


@settings(max_examples=60)
@given(
    seed=st.integers(0, 2**32 - 1),
    rows=st.integers(1, 120),
    count=st.integers(1, 6),
    adaptive=st.booleans(),
)
def test_all_membranes_fire_when_each_of_them_does(seed, rows, count, adaptive):
    rng = np.random.default_rng(seed)
    current = rng.normal(2.0, 12.0, (rows, count))
    tau_ms, gap_mv = rng.uniform(1, 200, count), rng.uniform(1, 20, count)
    refractory_ms = rng.integers(0, 5, count) * DT_MS
    floored = rng.integers(0, 2, count).astype(bool)
    jump_mv = rng.uniform(0, 5, count) if adaptive else np.zeros(count)
    recovery_ms = rng.uniform(1, 90, count)
    decay, threshold, pause, jump, kept = [], [], [], [], []
    for k in range(count):
        one = membrane_constants(tau_ms[k], 1, DT_MS, gap_mv[k], refractory_ms[k])
        raised = adaptation_constants(jump_mv[k], recovery_ms[k], 1, DT_MS)
        for values, value in zip(
            (decay, threshold, pause, jump, kept),
            (one[0][0], one[1], one[2], raised[0][0], raised[1][0]),
            strict=True,
        ):
            values.append(value)

    fired = np.zeros((rows, count), dtype=bool)
    places = fire(
        current.copy(),
        np.array(decay),
        np.array(threshold),
        np.array(pause),
        floored,
        (np.array(jump), np.array(kept)) if adaptive else None,
    )
    fired[places] = True

    assert places[0].size == fired.sum()
    assert (np.diff(places[1]) >= 0).all()
    for k in range(count):
        expected = integrate(
            current[:, k],
            tau_ms[k],
            DT_MS,
            gap_mv[k],
            refractory_ms[k],
            floored=bool(floored[k]),
            jump_mv=jump_mv[k],
            recovery_ms=recovery_ms[k],
        )[1]
        np.testing.assert_array_equal(fired[:, k], expected)


def test_a_current_that_is_not_finite_is_refused():
    constants = (np.full(1, 0.9), np.full(1, 20.0), np.ones(1, int), np.zeros(1, bool))
    with pytest.raises(TraceError, match="not finite"):
        fire(np.array([[1.0], [np.inf]]), *constants)


@pytest.mark.parametrize("name", ["published", "fitted"])
def test_classes_together_fire_as_each_alone(name):
    parameters = parameter_set(name).parameters
    rng = np.random.default_rng(3)
    steps = rng.normal(0, 400, (501, 3, 4)).cumsum(axis=0)
    stress_pa = {c: np.abs(steps[:, k]) for k, c in enumerate(parameters)}

    together = encode_afferents(stress_pa, DT_MS, parameters)

    total = 0
    for afferent, stress in stress_pa.items():
        alone = encode_cells(stress, DT_MS, parameters[afferent])
        assert len(together[afferent]) == 4
        for mine, its in zip(together[afferent], alone, strict=True):
            assert len(mine) == parameters[afferent].cells
            for one, other in zip(mine, its, strict=True):
                np.testing.assert_array_equal(one, other)
                total += one.size
    assert total > 100


@pytest.mark.parametrize("name", PUBLISHED)
def test_a_spike_stands_where_the_potential_came_back_to_rest(name):
    times_ms = np.arange(501) * DT_MS
    stress_pa = 2e4 * np.maximum(np.sin(2e-3 * np.pi * 50 * times_ms), 0)
    [[spikes_ms]] = encode_cells(stress_pa, DT_MS, PUBLISHED[name])

    potential_mv = membrane_potential(stress_pa, DT_MS, PUBLISHED[name])

    assert spikes_ms.size > 3
    rows = np.round(spikes_ms / DT_MS).astype(int)
    assert (potential_mv[rows] == -65.0).all()


def test_stress_of_two_lengths_is_refused():
    stress_pa = {"SA": np.zeros(10), "RA": np.zeros(12)}
    with pytest.raises(TraceError, match="2 lengths, expected one time axis"):
        encode_afferents(stress_pa, DT_MS, PUBLISHED)


def test_a_step_that_the_parameters_are_not_for_is_refused():
    with pytest.raises(ParameterError, match="resample the trace"):
        encode_afferents({"SA": np.zeros(10)}, 1.0, PUBLISHED)
