"""Spikes that left the house, read again by the libraries that they are for."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import fembridge as fb
from fembridge.cli import main
from fembridge.errors import MissingError, UsageError
from fembridge.io.spike_table import SpikeTrain

# Warnings of the libraries about themselves are not ours to mend.
pytestmark = pytest.mark.filterwarnings("ignore")
UNITS = "fingertip:density=0.05"
PRESS = fb.Trajectory.press(press_n=0.2, hold_ms=80)


@pytest.fixture(scope="module")
def touch():
    return fb.touch("sphere", PRESS, population=UNITS, trials=3, noise_mv=0.5, seed=1)


@pytest.fixture(scope="module")
def recording(touch):
    return touch.to_recording()


@pytest.fixture(scope="module")
def folder(recording, tmp_path_factory):
    return tmp_path_factory.mktemp("recording")


def rows(touch):
    """Spikes of each unit and trial as the table has them."""
    table = touch.spikes.groupby(["trial", "unit"])["spike_time_ms"].apply(np.array)
    return dict(table.items())


def test_every_spike_of_the_table_is_in_the_recording(touch, recording):
    assert recording.unit == touch.population.unit and recording.trial == (1, 2, 3)
    expected = rows(touch)
    for k in range(3):
        for u, unit in enumerate(recording.unit):
            assert_array_equal(recording.spikes_ms(u, k), expected.get((k + 1, unit), []))
    assert recording.t_stop_ms == touch.trajectory.times_ms[-1]
    assert 0 < recording.time_ms.min() <= recording.time_ms.max() <= recording.t_stop_ms


def test_a_simulation_has_a_unit_a_cell_and_a_trial_a_stimulus():
    result = fb.simulate(["sine_20_250", "sine_50_250"], stored=True)
    recording = result.to_recording()
    assert recording.stimulus == ("sine_20_250", "sine_50_250")
    for train in result.trains:
        u = recording.unit.index(f"{train.afferent}{train.cell or ''}")
        k = recording.stimulus.index(train.stimulus)
        assert_array_equal(recording.spikes_ms(u, k), train.times_ms)
        assert recording.columns["cell"][u] == train.cell
    assert recording.depth_um.shape == (2, recording.t_stop_ms / recording.dt_ms + 1)


def test_npz_gives_each_unit_and_trial_by_its_start(recording, folder):
    with np.load(recording.write(folder / "a.npz")) as stored:
        row = 1 * stored["unit"].size + 4
        start, end = stored["start"][row : row + 2]
        assert_array_equal(stored["time_ms"][start:end], recording.spikes_ms(4, 1))
        assert_array_equal(stored["x_mm"], recording.columns["x_mm"])
        assert stored["t_stop_ms"] == recording.t_stop_ms


def test_matlab_has_the_fields_of_touchsim_in_seconds(touch, recording, folder):
    from scipy.io import loadmat

    stored = loadmat(recording.write(folder / "a.mat"), struct_as_record=False, squeeze_me=True)
    response = stored["response"]
    assert response.responses.shape == (3, len(recording.unit))
    for k, u in np.ndindex(response.responses.shape):
        one = response.responses[k, u]
        assert_allclose(np.atleast_1d(one.spikes), recording.spikes_ms(u, k) / 1000, rtol=1e-12)
        assert_allclose(response.rate[u, k], one.rate)
    assert_allclose(response.affpop.location[:, 0], touch.population.x_mm)
    assert set(response.affpop.__dict__["class"]) == {"SA1", "RA", "PC"}
    assert_allclose(response.stimulus.trace[:, 0], touch.depth_um / 1000)


def test_neo_has_a_segment_a_trial_and_a_train_a_unit(touch, recording, folder):
    neo = pytest.importorskip("neo")
    [block] = neo.io.get_io(str(recording.write(folder / "a.pkl"))).read()
    for k, segment in enumerate(block.segments):
        assert len(segment.spiketrains) == len(recording.unit)
        for u, train in enumerate(segment.spiketrains):
            assert_allclose(train.rescale("ms").magnitude, recording.spikes_ms(u, k))
            assert train.annotations["afferent"] == recording.afferent[u]
            assert train.annotations["x_mm"] == touch.population.x_mm[u]
            assert float(train.t_stop.rescale("ms")) == recording.t_stop_ms
        [depth] = segment.analogsignals
        assert_allclose(depth.rescale("um").magnitude[:, 0], touch.depth_um)


@pytest.mark.parametrize("trials", [1, pytest.param(3, marks=pytest.mark.slow)])
def test_nwb_round_trips_and_its_inspector_finds_nothing(trials, touch, recording, folder):
    pynwb, inspector = pytest.importorskip("pynwb"), pytest.importorskip("nwbinspector")
    if trials == 1:
        touch = fb.touch("sphere", PRESS, population=UNITS)
        recording = touch.to_recording()
    path = recording.write(folder / f"{trials}.nwb")
    assert list(inspector.inspect_nwbfile(nwbfile_path=str(path))) == []
    with pynwb.NWBHDF5IO(path, "r") as file:
        stored = file.read()
        assert stored.units.resolution == 0.0005
        units = stored.units.to_dataframe()
        assert tuple(units["unit"]) == recording.unit
        assert tuple(units["afferent"]) == recording.afferent
        assert_allclose(units["depth_mm"], touch.population.depth_mm)
        trial_s = recording.trial_ms / 1000
        for u in range(len(recording.unit)):
            expected = [trial_s[k] + recording.spikes_ms(u, k) / 1000 for k in range(trials)]
            assert_allclose(units["spike_times"].iloc[u], np.concatenate(expected))
        if trials > 1:
            table = stored.trials.to_dataframe()
            assert list(table["trial"]) == [1, 2, 3]
            assert_allclose(table["stop_time"] - table["start_time"], recording.t_stop_ms / 1000)
        depth = stored.stimulus["depth"]
        assert_allclose(depth.data[: touch.depth_um.size], touch.depth_um * 1e-6)


def test_who_was_recorded_can_be_said(recording):
    pytest.importorskip("pynwb")
    stored = recording.to_nwb(institution="A university", session_id="3")
    assert stored.institution == "A university" and stored.subject.subject_id == "simulated"


def test_sonata_is_read_by_libsonata(touch, recording, folder):
    h5py = pytest.importorskip("h5py")
    libsonata = pytest.importorskip("libsonata")
    path = recording.write(folder / "a.h5")
    with h5py.File(path) as file:
        assert file["spikes/afferents/timestamps"].attrs["units"] == "ms"
        assert_allclose(file["trials/start_ms"], recording.trial_ms)
    spikes = libsonata.SpikeReader(str(path))["afferents"]
    found = np.array(spikes.get(), dtype=[("node", "u8"), ("ms", "f8")])
    for u in range(len(recording.unit)):
        expected = [recording.trial_ms[k] + recording.spikes_ms(u, k) for k in range(3)]
        assert_allclose(found["ms"][found["node"] == u], np.concatenate(expected))
    nodes = libsonata.NodeStorage(str(path)).open_population("afferents")
    assert nodes.size == len(recording.unit)
    every = libsonata.Selection([(0, nodes.size)])
    assert_allclose(nodes.get_attribute("z_mm", every), touch.population.z_mm)
    assert list(nodes.get_attribute("afferent", every)) == list(recording.afferent)


def test_nest_fires_when_the_units_did(recording):
    nest = pytest.importorskip("nest")
    nest.ResetKernel()
    nest.verbosity = nest.VerbosityLevel.ERROR
    generators = recording.to_nest(trial=2)
    recorder = nest.Create("spike_recorder")
    nest.Connect(generators, recorder, syn_spec={"delay": 0.5})
    nest.Simulate(recording.t_stop_ms + 5)
    events = recorder.get("events")
    first = generators[0].global_id
    for u in range(len(recording.unit)):
        at = np.sort(events["times"][events["senders"] == first + u])
        assert_allclose(at, recording.spikes_ms(u, 2))


def test_brian2_fires_when_the_units_did(recording):
    try:
        import brian2
    except (ImportError, AttributeError) as error:  # those before 2.10 fail with NumPy 2.4
        pytest.skip(f"no Brian2 that runs here: {error}")
    group = recording.to_brian2(trial=1)
    monitor = brian2.SpikeMonitor(group)
    network = brian2.Network(group, monitor)
    brian2.defaultclock.dt = recording.dt_ms * brian2.ms
    network.run((recording.t_stop_ms + 1) * brian2.ms)
    for u, times in monitor.spike_trains().items():
        assert_allclose(times / brian2.ms, recording.spikes_ms(u, 1), atol=1e-6)


def test_a_tensor_has_a_one_where_a_unit_fires(recording):
    dense = recording.to_dense()
    assert dense.shape == (recording.t_stop_ms / 0.5 + 1, 3, len(recording.unit))
    assert dense.sum() == recording.time_ms.size and not dense[0].any()
    assert_array_equal(np.flatnonzero(dense[:, 2, 5]) * 0.5, recording.spikes_ms(5, 2))
    torch = pytest.importorskip("torch")
    assert torch.equal(recording.to_torch(), torch.from_numpy(dense))


def test_a_library_that_is_absent_is_named_with_what_installs_it(recording, monkeypatch, tmp_path):
    import sys

    for name, file in (("neo", "a.pkl"), ("pynwb", "a.nwb"), ("h5py", "a.h5")):
        monkeypatch.setitem(sys.modules, name, None)
        with pytest.raises(MissingError, match=r"pip install 'fembridge\["):
            recording.write(tmp_path / file)
        assert not (tmp_path / file).exists()
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(MissingError, match="pip install torch"):
        recording.to_torch()


def test_what_is_no_recording_is_refused(recording, tmp_path):
    with pytest.raises(UsageError, match=r"\.nwb"):
        recording.write(tmp_path / "a.nbw")
    early = [SpikeTrain("a", "SA", np.array([-1.0, 2.0]))]
    with pytest.raises(UsageError, match=r"-1 .*2 "):
        fb.Recording.from_trains(early, 0.5, 10.0)


def test_each_verb_that_makes_spikes_exports_them(tmp_path, capsys):
    simulated = ["simulate", "--stimulus", "sine_20_250", "--stored", "--no-plot"]
    assert main([*simulated, "--export", "npz", "--export", "mat", "-o", str(tmp_path)]) == 0
    assert "spikes.npz, spikes.mat" in capsys.readouterr().out
    with np.load(tmp_path / "traces.npz") as traces:
        table, step_ms = ["time_ms,afferent,node,von_mises_pa"], float(traces["dt_ms"])
        for a, name in enumerate(traces["afferent"]):
            stress = traces["von_mises_pa"][0, :, a]
            table += [f"{step_ms * n},{name},{a + 1},{one}" for n, one in enumerate(stress)]
    (tmp_path / "traces.csv").write_text("\n".join(table) + "\n")
    words = ["encode", str(tmp_path / "traces.csv"), "--parameters", "fitted", "--no-raster"]
    assert main([*words, "--export", "npz", "-o", str(tmp_path / "e"), "--json"]) == 0
    assert "spikes.npz" in json.loads(capsys.readouterr().out)["files"]
    with np.load(tmp_path / "spikes.npz") as one, np.load(tmp_path / "e/spikes.npz") as other:
        assert_allclose(one["time_ms"], other["time_ms"])
        assert_array_equal(one["start"], other["start"])
    assert main([*words, "-o", str(tmp_path / "e")]) == 0
    assert capsys.readouterr().err.endswith("of an earlier run: spikes.npz\n")
    words = ["touch", "--press-um", "100", "--population", "one_each", "--no-plot"]
    assert main([*words, "--export", "mat", "-o", str(tmp_path / "t"), "--json"]) == 0
    assert "spikes.mat" in json.loads(capsys.readouterr().out)["files"]


def test_trials_of_unequal_lengths_end_in_nan():
    made = fb.simulate(["sine_20_250", "ramp_300_20_50_20"], stored=True)
    recording = made.to_recording()
    ends = [one.displacement_um.size for one in made.stimuli]
    assert [np.isfinite(row).sum() for row in recording.depth_um] == ends
    assert recording.t_stop_ms == max(one.times_ms[-1] for one in made.stimuli)
    assert recording.time_ms.size == len(made.spikes)


def test_a_trial_ends_where_its_own_waveform_does(tmp_path):
    depth_um = np.array([[0.0, 1.0, 2.0, 1.0, 0.0], [0.0, 1.0, 0.0, np.nan, np.nan]])
    trains = [SpikeTrain("long", "SA", np.array([1.5])), SpikeTrain("short", "SA", np.array([0.5]))]
    recording = fb.Recording.from_trains(trains, 0.5, 2.0, depth_um=depth_um)
    assert_allclose(recording.end_ms, [2.0, 1.0])
    for library in ("neo", "pynwb"):
        pytest.importorskip(library)
    long, short = recording.to_neo().segments
    assert [float(one.spiketrains[0].t_stop) for one in (long, short)] == [2.0, 1.0]
    assert short.analogsignals[0].shape == (3, 1)
    trials = recording.to_nwb().trials.to_dataframe()
    assert_allclose(trials["stop_time"] - trials["start_time"], [0.002, 0.001])
    from scipy.io import loadmat

    stored = loadmat(recording.write(tmp_path / "a.mat"), squeeze_me=True, struct_as_record=False)
    assert_allclose(stored["response"].rate, [500.0, 1000.0])


def test_events_have_a_row_for_each_class_and_a_pixel_for_each_unit(recording, folder):
    events = np.load(recording.write(folder / "a.npy"))
    assert events.dtype.names == ("t", "x", "y", "p")
    assert events.size == recording.time_ms.size > 100
    assert (np.diff(events["t"]) >= 0).all() and events["p"].all()
    for k, trial_ms in enumerate(recording.trial_ms):
        for u, name in enumerate(recording.afferent):
            x, y = recording.afferent[:u].count(name), ("SA", "RA", "PC").index(name)
            expected = np.rint(1000 * (recording.spikes_ms(u, k) + trial_ms))
            found = events["t"][(events["x"] == x) & (events["y"] == y)]
            assert np.isin(expected, found).all()


def test_pixels_by_position_have_the_tip_above_and_classes_side_by_side(recording):
    events = recording.to_events(event_grid_mm=1.0)
    x_mm, z_mm = recording.columns["x_mm"], recording.columns["z_mm"]
    width = int(np.floor(np.ptp(x_mm))) + 1
    firing = {name: set() for name in ("SA", "RA", "PC")}
    for u, name in enumerate(recording.afferent):
        if any(recording.spikes_ms(u, k).size for k in range(3)):
            column = int(x_mm[u] - x_mm.min()) + width * ("SA", "RA", "PC").index(name)
            firing[name].add((column, int(z_mm.max() - z_mm[u])))
    assert set(zip(events["x"].tolist(), events["y"].tolist(), strict=True)) == set().union(
        *firing.values()
    )


def test_aedat4_is_read_by_another_library(recording, folder):
    """Python's `aedat`; dv-processing 2.0 read the same files, also by a range of time."""
    aedat = pytest.importorskip("aedat")
    decoder = aedat.Decoder(str(recording.write(folder / "a.aedat4")))
    units = max(recording.afferent.count(name) for name in ("SA", "RA", "PC"))
    assert decoder.id_to_stream() == {0: {"type": "events", "width": units, "height": 3}}
    packets = [packet["events"] for packet in decoder]
    assert len(packets) > 1
    assert_array_equal(
        [list(row) for row in np.concatenate(packets).tolist()],
        [list(row) for row in recording.to_events().tolist()],
    )


def test_aedat4_of_no_spikes_has_no_packets(folder):
    aedat = pytest.importorskip("aedat")
    silent = fb.Recording.from_trains([SpikeTrain("s", "SA", np.zeros(0))], 0.5, 100.0)
    path = silent.write(folder / "silent.aedat4")
    assert list(aedat.Decoder(str(path))) == []


@pytest.mark.parametrize(
    ("make", "argument"),
    [
        (lambda r, _: r.to_events(0.0), "event_grid_mm"),
        (lambda r, _: r.to_events(1e-6), "event_grid_mm"),
        (lambda r, folder: r.write(folder / "x.npz", event_grid_mm=1.0), "event_grid_mm"),
        (
            lambda _, __: fb.simulate("sine_20_250", stored=True).to_recording().to_events(1.0),
            "event_grid_mm",
        ),
    ],
)
def test_events_without_a_pixel_are_refused(recording, folder, make, argument):
    with pytest.raises(UsageError) as caught:
        make(recording, folder)
    assert caught.value.argument == argument


def test_events_of_touches_and_encodings_are_exported(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    words = ["--press-n", "0.1", "--population", UNITS, "--no-plot", "--event-grid-mm", "0.5"]
    assert main(["touch", "--shape", "sphere", *words, "--export", "events,aedat4"]) == 0
    touch = fb.Touch.read("out")
    assert_array_equal(np.load("out/spikes.npy"), touch.to_recording().to_events(0.5))
    assert (tmp_path / "out/spikes.aedat4").read_bytes().startswith(b"#!AER-DAT4.0")
    assert main(["sample", "pressure"]) == 0
    words = ["--no-raster", "--export", "aedat4", "--export", "events"]
    assert main(["encode", "sample/pressure.csv", *words]) == 0
    encoding = fb.Encoding.read("encoded")
    assert_array_equal(np.load("encoded/spikes.npy"), encoding.to_recording().to_events())
    assert (tmp_path / "encoded/spikes.aedat4").stat().st_size > 16 * len(encoding.spikes)
    assert main(["touch", "--event-grid-mm", "0.5", "--no-plot"]) == 2
