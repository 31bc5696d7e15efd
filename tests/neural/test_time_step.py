"""Traces of another time step than that of the parameters."""

from dataclasses import replace

import numpy as np
import pytest

from fembridge.errors import ParameterError
from neural import PUBLISHED, parameter_set
from neural.encoder import encode_afferents, encode_cells, encode_units
from neural.time_step import read_at_step, step_ratio

FITTED = parameter_set("fitted").parameters
RA = FITTED["RA"]


def reader(stress_pa):
    return lambda first, end: stress_pa[first:end]


def wave(frequency_hz, dt_ms, duration_ms=100.0):
    times_ms = np.arange(round(duration_ms / dt_ms) + 1) * dt_ms
    return np.sin(2e-3 * np.pi * frequency_hz * times_ms)


@pytest.mark.parametrize(("frequency_hz", "tolerance"), [(100.0, 2e-5), (300.0, 5e-3)])
def test_a_sine_between_its_samples_is_a_sine(frequency_hz, tolerance):
    coarse, fine = (wave(frequency_hz, dt_ms) for dt_ms in (0.5, RA.dt_ms))
    read, samples = read_at_step(reader(coarse), len(coarse), RA, 0.5)
    inside = slice(15, -15)  # at the ends the stress outside counts as held
    assert samples == len(fine)
    np.testing.assert_allclose(read(0, samples)[inside], fine[inside], atol=tolerance)
    np.testing.assert_array_equal(read(0, samples)[::5], coarse)


def test_a_polynomial_of_degree_five_is_exact_and_a_constant_stays_so():
    rows = np.arange(40.0)
    read, samples = read_at_step(reader((rows / 40) ** 5), 40, RA, 0.5)
    np.testing.assert_allclose(
        read(15, samples - 15), (np.arange(15, samples - 15) / 200) ** 5, rtol=1e-12
    )
    read, samples = read_at_step(reader(np.full((40, 3), 0.1)), 40, RA, 0.5)
    assert (read(0, samples) == 0.1).all()


@pytest.mark.parametrize("shape", [(30,), (30, 4)])
def test_a_part_is_the_part_of_the_whole(shape):
    stress_pa = np.random.default_rng(3).uniform(0, 1e4, shape)
    read, samples = read_at_step(reader(stress_pa), 30, RA, 0.5)
    whole = read(0, samples)
    for first, end in ((0, 1), (3, 17), (0, samples), (samples - 1, samples), (64, 71)):
        np.testing.assert_array_equal(read(first, end), whole[first:end])


def test_of_a_finer_trace_every_nth_sample_is_read():
    published = PUBLISHED["RA"]
    fine = np.random.default_rng(4).uniform(0, 1e4, 101)
    read, samples = read_at_step(reader(fine), 101, published, 0.1)
    assert samples == 21
    np.testing.assert_array_equal(read(2, 9), fine[10:45:5])
    [coarse_ms], [fine_ms] = (
        encode_cells(fine[::every], dt_ms, published)[0] for every, dt_ms in ((5, 0.5), (1, 0.1))
    )
    np.testing.assert_array_equal(fine_ms, coarse_ms)


@pytest.mark.parametrize("dt_ms", [0.3, 0.25, 0.0, -0.5, np.nan, np.inf])
def test_a_step_that_does_not_fit_is_refused(dt_ms):
    with pytest.raises(ParameterError) as caught:
        step_ratio(PUBLISHED["SA"] if dt_ms != 0.25 else RA, dt_ms)
    assert caught.value.argument == "dt_ms"


def test_equations_with_a_time_step_take_no_coarser_trace():
    with pytest.raises(ParameterError):
        step_ratio(PUBLISHED["SA"], 1.0)
    assert step_ratio(RA, 1.0) == (10, 1)


def test_classes_of_different_steps_are_encoded_together():
    stress_pa = 2e4 * (1 + wave(40.0, 0.1, 200.0))
    mixed = {"SA": PUBLISHED["SA"], "RA": RA}
    together = encode_afferents(dict.fromkeys(mixed, stress_pa), 0.1, mixed)
    for name, values in mixed.items():
        [alone] = encode_cells(stress_pa, 0.1, values)
        for cell_ms, expected_ms in zip(together[name][0], alone, strict=True):
            np.testing.assert_array_equal(cell_ms, expected_ms)


def test_units_are_encoded_like_cells_from_a_coarser_trace():
    stress_pa = 2e4 * (1 + wave(40.0, 0.5, 200.0))
    for name, values in FITTED.items():
        [[cell_ms]] = encode_cells(stress_pa, 0.5, replace(values, cells=1))
        fired = encode_units(stress_pa[:, np.newaxis], [name], 0.5, FITTED)
        np.testing.assert_array_equal(fired.time_ms, cell_ms)


@pytest.mark.parametrize("afferent", ["SA", "RA", "PC"])
def test_rates_do_not_depend_on_the_step(afferent):
    """Mean rates of ten cells at the step of the set and at half of it, within 2 %."""
    values = FITTED[afferent]
    counts = []
    for dt_ms in (values.dt_ms, values.dt_ms / 2):
        stress_pa = np.stack(
            [
                np.maximum(4e4 * (0.5 + level * wave(frequency_hz, dt_ms, 250.0)), 0.0)
                for frequency_hz in (20.0, 50.0, 150.0, 400.0)
                for level in (0.1, 0.3, 0.5, 0.8)
            ],
            axis=-1,
        )
        cells = encode_cells(stress_pa, dt_ms, replace(values, dt_ms=dt_ms))
        counts.append([sum(map(len, trains)) for trains in cells])
    default, half = np.array(counts)
    assert half.sum() > 100
    assert abs(default.sum() - half.sum()) < 0.02 * half.sum()
