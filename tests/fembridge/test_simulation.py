"""What a simulation gives: spikes of the stress it was given, and its files."""

import dataclasses
import tomllib

import numpy as np
import pandas
import pytest
from numpy.testing import assert_array_equal

from decks.stimuli import resolve
from decks.waveform import make_stimulus
from fembridge.errors import OutputError, ParameterError, TraceError
from fembridge.simulation import encode_all
from fembridge.tables import read_rates, read_spikes
from fembridge.trace import StressTrace
from neural import PUBLISHED, encode

GAIN_PA_PER_UM = {"SA": 120.0, "RA": 75.0, "PC": 4.0}
FILES = ["rates.csv", "simulation.toml", "spikes.csv", "traces.npz"]
STIMULI = tuple(make_stimulus(entry) for entry in resolve(["sine_20_250,noise_25_250_20"]))


def trace_of(stimulus, afferent, **more):
    stress_pa = GAIN_PA_PER_UM.get(afferent, 1.0) * np.maximum(stimulus.displacement_um, 0.0)
    return StressTrace(stress_pa, 0.5, 7, afferent, **more)


def traces_of(stimuli=STIMULI, afferents=("SA", "RA", "PC")):
    return [[trace_of(stimulus, name) for name in afferents] for stimulus in stimuli]


@pytest.fixture(scope="module")
def simulation():
    return encode_all(STIMULI, traces_of(), PUBLISHED, {"method": "map"})


def test_spikes_are_those_of_each_trace_alone(simulation):
    """All stimuli are encoded in one batch; here one by one."""
    expected = [
        (stimulus.id, trace.afferent, encode(trace.stress_pa, 0.5, PUBLISHED[name])[0])
        for stimulus, row in zip(STIMULI, traces_of(), strict=True)
        for trace, name in zip(row, PUBLISHED, strict=True)
    ]

    assert len(simulation.trains) == 6
    for train, (stimulus_id, afferent, times_ms) in zip(simulation.trains, expected, strict=True):
        assert (train.stimulus, train.afferent) == (stimulus_id, afferent)
        assert_array_equal(train.times_ms, times_ms)
    assert sum(train.times_ms.size for train in simulation.trains) > 50


def test_rates_count_the_spikes_of_the_stimulus_s_own_window(simulation):
    for train, rate in zip(simulation.trains, simulation.mean_rates, strict=True):
        inside = (train.times_ms > 5.0) & (train.times_ms <= 250.0)
        assert (rate.stimulus, rate.afferent) == (train.stimulus, train.afferent)
        assert rate.rate_ips == pytest.approx(inside.sum() / 0.245, rel=1e-12)


def test_windows_may_differ_from_stimulus_to_stimulus():
    stimuli = [make_stimulus(e) for e in resolve(["sine_20_250,sine_100_85.98"])]
    assert [s.window_ms for s in stimuli] == [(5.0, 250.0), (100.0, 200.0)]

    found = encode_all(stimuli, traces_of(stimuli), PUBLISHED, {})

    last, train = found.mean_rates[-1], found.trains[-1]
    inside = (train.times_ms > 100.0) & (train.times_ms <= 200.0)
    assert last.rate_ips == pytest.approx(inside.sum() / 0.1, rel=1e-12)
    assert inside.any()


@pytest.mark.parametrize("mine", [False, True])
def test_the_finger_of_an_earlier_simulation_goes_and_one_of_ones_own_stays(
    tmp_path, simulation, mine
):
    if mine:
        (tmp_path / "finger.toml").write_text("base = 'quick'\n", encoding="utf-8")
    else:
        finger = {"response": {"finger": {"name": "quick"}}}
        dataclasses.replace(simulation, origin=finger).write(tmp_path)
        assert (tmp_path / "finger.toml").exists()

    simulation.write(tmp_path)  # no response, no finger

    assert (tmp_path / "finger.toml").exists() == mine


def test_the_files_hold_the_simulation(tmp_path, simulation):
    simulation.write(tmp_path / "out")

    folder = tmp_path / "out"
    assert sorted(path.name for path in folder.iterdir()) == FILES
    assert read_rates(folder / "rates.csv") == list(simulation.mean_rates)
    spiking = [train for train in simulation.trains if train.times_ms.size]
    for read, train in zip(read_spikes(folder / "spikes.csv"), spiking, strict=True):
        assert (read.stimulus, read.afferent) == (train.stimulus, train.afferent)
        assert_array_equal(read.times_ms, train.times_ms)
    with np.load(folder / "traces.npz", allow_pickle=False) as bulk:
        assert bulk["stimulus"].tolist() == [stimulus.id for stimulus in STIMULI]
        assert bulk["afferent"].tolist() == ["SA", "RA", "PC"]
        assert bulk["dt_ms"] == 0.5
        assert bulk["displacement_um"].shape == (2, 501)
        assert bulk["von_mises_pa"].shape == (2, 501, 3)
        for s, row in enumerate(simulation.traces):
            assert_array_equal(bulk["displacement_um"][s], STIMULI[s].displacement_um)
            for a, trace in enumerate(row):
                assert_array_equal(bulk["von_mises_pa"][s, :, a], trace.stress_pa)


def test_the_record_tells_origin_windows_and_the_noise_s_seed(tmp_path, simulation):
    simulation.write(tmp_path)

    record = tomllib.loads((tmp_path / "simulation.toml").read_text(encoding="utf-8"))
    assert record["method"] == "map"
    noise = record["stimuli"]["noise_25_250_20"]
    assert noise["seed"] == STIMULI[1].origin["seed"]
    assert noise["window_ms"] == [5.0, 250.0]


@pytest.mark.parametrize("blocked", FILES)
def test_a_result_that_cannot_be_written_leaves_the_earlier_one(tmp_path, simulation, blocked):
    """Whichever of the four it is: no file of the new one beside three old ones."""
    simulation.write(tmp_path)
    (tmp_path / blocked).unlink()
    (tmp_path / blocked).mkdir()
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir() if p.is_file()}
    other = dataclasses.replace(simulation, trains=(), mean_rates=(), origin={"method": "x"})

    with pytest.raises(OutputError, match=f"{blocked}: a folder stands where a file"):
        other.write(tmp_path)

    after = {p.name: p.read_bytes() for p in tmp_path.iterdir() if p.is_file()}
    assert after == before
    assert len(before) == 3


def other_clock(**changes):
    rows = traces_of()
    rows[1][2] = dataclasses.replace(rows[1][2], **changes)
    return rows


@pytest.mark.parametrize(
    ("traces", "kind", "found"),
    [
        (traces_of(afferents=("SA", "XY")), TraceError, "of XY, expected 501 of SA, RA, PC"),
        (other_clock(stress_pa=np.zeros(500)), TraceError, "500 samples of PC, expected 501"),
        (other_clock(dt_ms=1.0), ParameterError, "PC: the trace has a sample every 1 ms"),
    ],
)
def test_traces_that_do_not_fit_stimuli_or_parameters_are_refused(traces, kind, found):
    with pytest.raises(kind, match=found):
        encode_all(STIMULI, traces, PUBLISHED, {})


def test_a_clock_with_the_rounding_of_a_solver_is_the_same_clock(simulation):
    """Times of six digits: the mean step of 500 is off in the ninth."""
    rounded = other_clock(dt_ms=0.5 * (1 + 1e-9))
    found = encode_all(STIMULI, rounded, PUBLISHED, {})
    assert_array_equal(found.trains[-1].times_ms, simulation.trains[-1].times_ms)


def test_rates_and_spikes_as_tables_are_those_of_the_files(tmp_path, simulation):
    simulation.write(tmp_path)
    for frame, name in ((simulation.rates, "rates.csv"), (simulation.spikes, "spikes.csv")):
        pandas.testing.assert_frame_equal(frame, pandas.read_csv(tmp_path / name))
