"""A stream beside the encoder of whole traces: the same spikes to the last bit."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fembridge.errors import ParameterError, TraceError, UsageError
from neural import MODELS, PUBLISHED, Stream, encode_afferents, encode_cells, parameter_set

SETS = [
    ("fitted", 0.1),
    ("fitted", 0.5),
    ("fitted", 1.0),
    ("fitted", 0.05),
    ("published", 0.5),
    ("published", 0.1),
    ("fitted_pad", 0.1),
]


def stress(samples, dt_ms, seed, channels=2):
    """A vibration on a hold, and noise, in Pa: all classes fire."""
    rng = np.random.default_rng(seed)
    times_ms = np.arange(samples) * dt_ms
    columns = [
        2e4 * (1 - np.cos(2e-3 * np.pi * rng.uniform(50, 200) * times_ms))
        + rng.uniform(0, 1e4)
        + rng.normal(0, 200, samples)
        for _ in range(channels)
    ]
    return np.stack(columns, axis=1)


def spikes_of_whole(stress_pa, dt_ms, parameters, start_ms=0.0):
    by_class = dict.fromkeys(parameters, stress_pa)
    return sorted(
        (time_ms, name, channel, cell)
        for name, conditions in encode_afferents(by_class, dt_ms, parameters, start_ms).items()
        for channel, cells in enumerate(conditions)
        for cell, times_ms in enumerate(cells)
        for time_ms in times_ms
    )


@pytest.mark.parametrize(("name", "dt_ms"), SETS)
@given(data=st.data())
def test_any_parts_have_the_spikes_of_the_whole(name, dt_ms, data):
    samples = data.draw(st.integers(2, max(120, round(60 / dt_ms))))
    cuts = data.draw(st.lists(st.integers(0, samples), max_size=12))
    stress_pa = stress(samples, dt_ms, data.draw(st.integers(0, 9)))
    stream, spikes = Stream(name, dt_ms, channels=2, start_ms=-7.5), []
    for part in np.split(stress_pa, sorted(cuts)):
        spikes += stream.push(part)
    spikes += stream.flush()
    assert stream.samples == samples
    assert sorted(spikes) == spikes_of_whole(
        stress_pa, dt_ms, parameter_set(name).parameters, start_ms=-7.5
    )


@pytest.mark.parametrize(("name", "dt_ms"), SETS)
def test_sample_by_sample_no_spike_comes_later_than_the_look_ahead(name, dt_ms):
    stress_pa = stress(500, dt_ms, seed=1, channels=1)[:, 0]
    stream = Stream(name, dt_ms)
    spikes, delays_ms = [], {"SA": [], "RA": [], "PC": []}
    for sample, value in enumerate(stress_pa):
        for spike in stream.step(value):
            spikes.append(spike)
            delays_ms[spike.afferent].append(sample * dt_ms - spike.time_ms)
    spikes += stream.flush()
    assert sorted(spikes) == spikes_of_whole(stress_pa, dt_ms, parameter_set(name).parameters)
    for name_of_class, delays in delays_ms.items():
        assert delays
        assert min(delays) > -1e-9
        assert max(delays) <= stream.look_ahead_ms[name_of_class] + 1e-9


@pytest.mark.parametrize("drive", MODELS)
def test_every_model_has_the_spikes_of_the_whole(drive, parameters_of):
    parameters = {name: parameters_of(row) for name, row in MODELS[drive].items()}
    stress_pa = stress(801, 0.5, seed=6, channels=2)
    expected = spikes_of_whole(stress_pa, 0.5, parameters)
    stream, spikes = Stream(parameters, 0.5, channels=2), []
    for part in np.split(stress_pa, [1, 2, 3, 90, 91, 400]):
        spikes += stream.push(part)
    assert len(expected) > 20
    assert sorted(spikes + stream.flush()) == expected


def test_classes_of_unlike_steps_and_delays_run_together():
    parameters = {"SA": PUBLISHED["SA"], "RA": parameter_set("fitted").parameters["RA"]}
    stress_pa = stress(2000, 0.1, seed=7, channels=1)
    stream = Stream(parameters)
    assert (stream.dt_ms, stream.look_ahead_ms) == (0.1, {"SA": 4.0, "RA": 0.0})
    spikes = [spike for row in stress_pa for spike in stream.step(row[0])] + stream.flush()
    assert {spike.afferent for spike in spikes} == {"SA", "RA"}
    assert sorted(spikes) == spikes_of_whole(stress_pa, 0.1, parameters)


def test_the_delay_of_fitted_at_its_own_step_is_zero():
    stream = Stream("fitted", 0.1)
    assert set(stream.look_ahead_ms.values()) == {0.0}
    for sample, value in enumerate(stress(800, 0.1, seed=2, channels=1)[:, 0]):
        for spike in stream.step(value):
            assert spike.time_ms == pytest.approx(sample * 0.1)


def test_a_class_alone_and_a_stress_of_each_class():
    values = parameter_set("fitted").parameters
    stress_pa = stress(900, 0.1, seed=3, channels=1)[:, 0]
    alone = Stream(afferents="RA")
    assert alone.push(stress_pa) == Stream(values["RA"], 0.1).push(stress_pa)
    alone.reset()
    [cells] = encode_cells(stress_pa, 0.1, values["RA"])
    expected = sorted((time_ms, cell) for cell, times in enumerate(cells) for time_ms in times)
    spikes = alone.push(stress_pa) + alone.flush()
    assert [(spike.time_ms, spike.cell) for spike in sorted(spikes)] == expected
    still = np.full_like(stress_pa, 100.0)
    mixed = Stream("fitted", 0.1)
    spikes = mixed.push({"SA": still, "RA": stress_pa, "PC": still}) + mixed.flush()
    assert {spike.afferent for spike in spikes} == {"RA"}
    assert [(spike.time_ms, spike.cell) for spike in sorted(spikes)] == expected


def test_memory_does_not_grow_with_the_signal():
    stream = Stream("fitted", 0.5, channels=3)
    for seed in range(3):
        stream.push(stress(1000, 0.5, seed, channels=3))
    members = [member for group in stream._groups for member in group.members.values()]
    assert len(members) == 3
    assert all(len(member.samples) < 20 for member in members)


def test_after_a_reset_a_stream_begins_anew():
    stress_pa = stress(700, 0.1, seed=4, channels=1)[:, 0]
    stream = Stream("fitted", 0.1)
    first = stream.push(stress_pa) + stream.flush()
    with pytest.raises(TraceError, match="reset"):
        stream.step(1.0)
    stream.reset()
    assert stream.push(stress_pa) + stream.flush() == first


@pytest.mark.parametrize(
    "samples", [np.nan, [1.0, 2.0], {"SA": 1.0}, {"SA": 1.0, "RA": 1.0, "PC": np.inf}]
)
def test_a_refused_sample_leaves_the_stream_as_it_was(samples):
    stress_pa = stress(600, 0.1, seed=5, channels=1)[:, 0]
    stream = Stream("fitted", 0.1)
    spikes = stream.push(stress_pa[:300])
    with pytest.raises(TraceError):
        stream.step(samples)
    spikes += stream.push(stress_pa[300:]) + stream.flush()
    assert sorted(spikes) == spikes_of_whole(stress_pa, 0.1, parameter_set("fitted").parameters)


def test_what_no_stream_can_be():
    with pytest.raises(ParameterError):
        Stream(PUBLISHED, 1.0)
    with pytest.raises(UsageError):
        Stream("fitted", 0.1, channels=0)
    with pytest.raises(UsageError):
        Stream("fited", 0.1)
    with pytest.raises(UsageError):
        Stream("fitted", 0.1, afferents="SA1")
