"""Compiled loops beside their equals in NumPy."""

import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose

from neural import encoder, filters, lif, parameter_set, time_step
from neural.compiled import compiled, jit
from neural.encoder import encode_units
from neural.lif import Membrane, State, fire

MODULES = (encoder, filters, lif, time_step)


def use(way, patch):
    """Loops as numba compiles them, as Python runs them, or none: NumPy."""
    if way == "compiled":
        pytest.importorskip("numba")
    loop = {"compiled": jit, "plain loops": lambda loop: loop, "NumPy": lambda _: None}[way]
    for module in MODULES:
        patch.setattr(module, "compiled", loop)


@pytest.mark.parametrize("way", ["compiled", "plain loops"])
@pytest.mark.parametrize("count", [3, 40])
def test_membranes_fire_as_in_numpy_also_in_parts(way, count, monkeypatch):
    rng = np.random.default_rng(count)
    current = rng.normal(0.6, 2.0, (400, count))
    membrane = Membrane(
        decay=rng.uniform(0.8, 1.0, count),
        threshold=rng.uniform(3, 12, count),
        refractory=rng.integers(0, 4, count),
        clamped=rng.random(count) < 0.5,
        jump=rng.uniform(0, 5, count),
        decay_of_jump=rng.uniform(0.9, 1.0, count),
        until_turn=rng.random(count) < 0.5,
        fatigue=rng.uniform(0, 4, count) * (rng.random(count) < 0.5),
        decay_of_fatigue=rng.uniform(0.9, 1.0, count),
    )
    use("NumPy", monkeypatch)
    expected = fire(current, membrane)
    assert expected[0].size > 20
    use(way, monkeypatch)
    state, parts = State.at_rest(count), []
    for first, last in ((0, 150), (150, 151), (151, 400)):
        rows, membranes = fire(current[first:last], membrane, state)
        parts.append(np.stack([membranes, rows + first]))
    found = np.concatenate(parts, axis=1)
    found = found[:, np.lexsort((found[1], found[0]))]
    assert np.array_equal(found, np.stack(expected[::-1]))


@pytest.mark.parametrize("way", ["compiled", "plain loops"])
@pytest.mark.parametrize("name", ["faded", "slow_rate", "corpuscle"])
@pytest.mark.parametrize("shape", [(200,), (200, 3)])
def test_filters_are_those_of_numpy(way, name, shape, monkeypatch):
    stress_pa = np.abs(np.random.default_rng(2).normal(5e3, 2e3, shape)).cumsum(axis=0)
    filter_ = getattr(filters, name)
    use("NumPy", monkeypatch)
    expected = filter_(stress_pa, 0.1)
    use(way, monkeypatch)
    assert_allclose(
        filter_(stress_pa, 0.1), expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max()
    )


def test_a_corpuscle_in_parts_is_that_of_numpy_to_the_last_bit(monkeypatch):
    stress_pa = np.abs(np.random.default_rng(2).normal(5e3, 2e3, (300, 9))).cumsum(axis=0)
    stress_pa[100:200] = stress_pa[100]
    use("NumPy", monkeypatch)
    expected = filters.corpuscle(stress_pa, 0.1)
    use("compiled", monkeypatch)
    past, found = filters.Past(), []
    for first, last in ((0, 120), (120, 121), (121, 300)):
        begin, end = max(0, first - 8), min(300, last + 8)
        past.before, past.count = first - begin, last - first
        part = filters.corpuscle(stress_pa[begin:end], 0.1, past=past)
        assert not part[: past.before].any() and not part[past.before + past.count :].any()
        found.append(part[past.before : past.before + past.count])
    assert np.array_equal(np.concatenate(found), expected)


@pytest.mark.parametrize("way", ["compiled", "plain loops"])
@pytest.mark.parametrize("shape", [(60,), (60, 3)])
def test_a_finer_trace_is_that_of_numpy(way, shape, monkeypatch):
    trace = np.random.default_rng(3).normal(size=shape)
    values = parameter_set("fitted_pad").parameters["PC"]

    def finer():
        read, samples = time_step.read_at_step(lambda a, b: trace[a:b], 60, values, 0.5)
        return [read(first, last) for first, last in ((0, samples), (37, 111), (280, samples))]

    use("NumPy", monkeypatch)
    expected = finer()
    use(way, monkeypatch)
    for found, part in zip(finer(), expected, strict=True):
        assert_allclose(found, part, rtol=1e-12, atol=1e-12)


def textured(units):
    times_ms = np.arange(600) * 0.5
    rng = np.random.default_rng(5)
    sizes_pa = np.geomspace(20, 60_000, units)
    phase = rng.uniform(0, 6, units)
    swing = np.sin(2 * np.pi * times_ms[:, None] / rng.uniform(4, 60, units) + phase)
    return sizes_pa * (1.05 + swing) * np.minimum(times_ms / 50, 1)[:, None]


@pytest.mark.parametrize("way", ["compiled", "NumPy"])
@pytest.mark.parametrize("name", ["fitted_pad", "published"])
def test_units_known_to_be_silent_would_not_have_fired(way, name, monkeypatch):
    """And blocks of units fire as all of them together."""
    parameters = parameter_set(name).parameters
    afferent = ["SA", "RA", "PC"] * 70
    deviate = np.random.default_rng(6).normal(size=210)
    if way == "compiled":
        pytest.importorskip("numba")
        monkeypatch.setattr(encoder, "compile_for", lambda _: True)
    else:
        monkeypatch.setattr(encoder, "compile_for", lambda _: False)
    use(way, monkeypatch)
    found = encode_units(textured(210), afferent, 0.5, parameters, deviate)
    use("NumPy", monkeypatch)
    monkeypatch.setattr(encoder, "compile_for", lambda _: False)
    left_out = []
    may_fire = encoder._may_fire
    monkeypatch.setattr(
        encoder,
        "_may_fire",
        lambda *arguments: np.ones_like(left_out.append(may_fire(*arguments)) or left_out[-1]),
    )
    expected = encode_units(textured(210), afferent, 0.5, parameters, deviate)
    assert np.array_equal(found.unit, expected.unit)
    assert_allclose(found.time_ms, expected.time_ms, rtol=1e-12)
    silent = sum(int((~units).sum()) for units in left_out)
    assert (silent > 20) == (name == "fitted_pad")


def test_a_loop_is_compiled_once_numba_is_loaded(monkeypatch):
    monkeypatch.delitem(sys.modules, "numba", raising=False)
    assert compiled(lif._fire_rows) is None
