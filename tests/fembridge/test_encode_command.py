"""``fembridge encode``: from a table of traces to tables of spikes and rates."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import fembridge as fb
from fembridge.cli import main
from fembridge.errors import FembridgeWarning, ResultError
from fembridge.io.spike_table import read_rates, read_spikes
from fembridge.io.trace_table import read_traces
from fembridge.simulation import spikes
from fembridge.trace import StressTrace, Traces
from neural import PUBLISHED, encode, encode_cells
from neural.parameter_sets import parameter_set

OURS = ["--parameters", "published"]
GAIN_PA = {"SA": 2e4, "RA": 4e4, "PC": 1e3}


def write_traces(path, traces):
    Traces(traces).to_frame().to_csv(path, index=False)


def traces(afferents=("SA", "RA", "PC"), start_ms=0.0, dt_ms=0.5):
    times_ms = start_ms + dt_ms * np.arange(501)
    wave = np.maximum(np.sin(2e-3 * np.pi * 50 * times_ms), 0.0)
    return [
        StressTrace(GAIN_PA.get(name, 1e4) * wave, dt_ms, 100 + k, name, start_ms)
        for k, name in enumerate(afferents)
    ]


@pytest.fixture
def here(tmp_path, monkeypatch):
    """Work in a folder that holds the table ``sine_50_250.csv``."""
    monkeypatch.chdir(tmp_path)
    write_traces(tmp_path / "sine_50_250.csv", traces())
    return tmp_path


def test_the_tables_hold_the_spikes_and_rates_of_encode(here, capsys):
    assert main(["encode", "sine_50_250.csv", *OURS, "--window-ms", "100:200"]) == 0

    shown = capsys.readouterr()
    trains = {one.afferent: one for one in read_spikes(here / "encoded/spikes.csv")}
    rates = {one.afferent: one for one in read_rates(here / "encoded/rates.csv")}
    assert list(trains) == list(rates) == ["SA", "RA", "PC"]
    for trace in traces():
        [times_ms] = encode(trace.stress_pa, 0.5, PUBLISHED[trace.afferent])
        np.testing.assert_array_equal(trains[trace.afferent].times_ms, times_ms)
        inside = (times_ms > 100) & (times_ms <= 200)
        assert rates[trace.afferent].rate_ips == 10.0 * inside.sum() > 0
        assert rates[trace.afferent].stimulus == "sine_50_250"
        assert f"{10.0 * inside.sum():.2f}  100 to 200" in shown.out
    assert (here / "encoded/raster.png").stat().st_size > 5000
    assert shown.err == ""


def test_the_derivative_is_passed_on(here):
    main(["encode", "sine_50_250.csv", *OURS, "--derivative", "forward", "--no-raster"])
    trains = {one.afferent: one for one in read_spikes(here / "encoded/spikes.csv")}
    [_, _, pc] = traces()
    [forward] = encode(pc.stress_pa, 0.5, PUBLISHED["PC"], derivative="forward")
    [backward] = encode(pc.stress_pa, 0.5, PUBLISHED["PC"])
    np.testing.assert_array_equal(trains["PC"].times_ms, forward)
    assert forward.tolist() != backward.tolist()


def test_traces_that_start_unloaded_are_named_where_the_fit_had_a_pre_indentation(here, capsys):
    assert main(["encode", "sine_50_250.csv", "--no-raster"]) == 0
    [line] = [one for one in capsys.readouterr().err.splitlines() if "fitted" in one]
    for value in ("'quick'", "75 um", "0 um"):
        assert value in line


@pytest.mark.parametrize(
    ("table", "words", "code", "message"),
    [
        (traces(), ["--window-ms", "5:300"], 2, "inside 0 to 250 ms, the SA trace"),
        (traces(), ["--window-ms", "200:100"], 2, {"argument": "--window-ms", "found": "200:100"}),
        (traces(), ["--parameters", "absent.toml"], 2, "absent.toml: "),
        (
            traces(),
            ["--parameters", "energy.toml"],
            2,
            {"argument": "--parameters", "found": "energy"},
        ),
        (traces(["SA"]), ["--afferent", "PC"], 2, {"argument": "--afferent", "expected": "SA"}),
        (traces(["SA"]), ["--columns", "z=node"], 2, {"argument": "--columns", "found": "z"}),
        (traces(["SA"]), ["--columns", "value=node"], 2, "column node has no unit"),
        (traces(["SA"]), ["--columns", "time=t"], 1, "no column t in"),
    ],
)
def test_what_cannot_be_encoded_ends_in_one_line_and_no_files(
    here, refused, table, words, code, message
):
    (here / "energy.toml").write_text('base = "published"\n[SA]\ndrive = "energy"\n', "utf-8")
    write_traces(here / "table.csv", table)
    refused(["encode", "table.csv", *words], message, code)


def spikes_by(path):
    """Times of every train, by class, unit and number of the cell."""
    return {(t.afferent, t.unit, t.cell): t.times_ms.tolist() for t in read_spikes(path)}


@pytest.mark.usefixtures("unrendered")
def test_any_number_of_units_keep_their_names(here, capsys):
    """Each as if it were alone; a unit without a name is called by its node."""
    many = [
        replace(trace, stress_pa=trace.stress_pa * gain, node=node)
        for node, gain in ((7, 1.0), (8, 2.0))
        for trace in traces()
    ]
    write_traces(here / "nodes.csv", many)
    frame = Traces([replace(one, unit=f"{one.afferent}, {one.node}") for one in many]).to_frame()
    frame.drop(columns="node").to_csv(here / "units.csv", index=False)

    assert main(["encode", "nodes.csv", "-o", "nodes", "--no-raster"]) == 0
    assert main(["encode", "units.csv", "-o", "units", "--no-raster"]) == 0
    assert main(["encode", "units.csv", "-o", "ra", "--no-raster", "--afferent", "RA"]) == 0

    by_node, by_unit = (spikes_by(here / name / "spikes.csv") for name in ("nodes", "units"))
    assert {unit for _, unit, _ in by_node} == {"7", "8"}
    named = {(name, f"{name}, {unit}", cell): t for (name, unit, cell), t in by_node.items()}
    assert by_unit == named
    assert spikes_by(here / "ra/spikes.csv") == {k: v for k, v in named.items() if k[0] == "RA"}
    for trace in many:
        cells = encode_cells(trace.stress_pa, 0.5, parameter_set("fitted").parameters["RA"])[0]
        if trace.afferent == "RA":
            for cell, times_ms in enumerate(cells, start=1):
                assert by_node.get(("RA", str(trace.node), cell), []) == times_ms.tolist()
    rates = read_rates(here / "units/rates.csv")
    assert [one.unit for one in rates] == list(dict.fromkeys(frame.unit))
    assert main(["plot", "raster", "units", "-o", "units.svg"]) == 0
    named = fb.encode(here / "units.csv")
    assert fb.encode(frame).spikes.equals(named.spikes.assign(stimulus="traces"))
    assert fb.encode(frame).rates.equals(named.rates.assign(stimulus="traces"))
    assert named.rates.columns.tolist() == ["stimulus", "afferent", "unit", "rate_ips"]
    assert named.rates.unit.tolist() == [rate.unit for rate in rates]


@pytest.mark.parametrize("dt_ms", [1.0, 0.25, 0.1])
def test_any_even_step_is_put_on_that_of_the_parameters(here, capsys, dt_ms):
    times_ms = np.arange(round(250 / dt_ms) + 1) * dt_ms
    wave = 2e4 * (1 - np.cos(2e-3 * np.pi * 20 * times_ms))
    write_traces(here / "other.csv", [StressTrace(wave, dt_ms, 1, "SA")])
    exact = 2e4 * (1 - np.cos(2e-3 * np.pi * 20 * np.arange(501) * 0.5))
    [alike_ms] = encode(exact, 0.5, PUBLISHED["SA"])
    assert main(["encode", "other.csv", "--parameters", "published", "--no-raster"]) == 0
    assert f"every {dt_ms:g} ms: resampled to every 0.5 ms" in capsys.readouterr().err
    found_ms = spikes_by(here / "encoded/spikes.csv")["SA", "", 0]
    np.testing.assert_allclose(found_ms, alike_ms, rtol=0, atol=0.5)


def test_uneven_times_need_a_step_and_get_it_by_pchip(here, capsys):
    times_ms = np.cumsum(np.tile([0.3, 0.6], 250))
    frame = pd.DataFrame(
        {"time_ms": times_ms, "afferent": "SA", "von_mises_pa": 2e4 + 100 * times_ms}
    )
    frame.to_csv(here / "uneven.csv", index=False)

    assert main(["encode", "uneven.csv"]) == 1
    assert "--resample-ms 0.5" in capsys.readouterr().err
    assert main(["encode", "uneven.csv", "--resample-ms", "0.5", "--no-raster"]) == 0
    even_ms = np.arange(times_ms[0], times_ms[-1], 0.5)
    [cells] = encode_cells(
        2e4 + 100 * even_ms, 0.5, parameter_set("fitted").parameters["SA"], float(even_ms[0])
    )
    found = spikes_by(here / "encoded/spikes.csv")
    for cell, times in enumerate(cells, start=1):
        np.testing.assert_allclose(found.get(("SA", "", cell), []), times)


def test_the_stress_of_a_simulation_gives_its_spikes_again(tmp_path, monkeypatch, capsys):
    """From its folder, from its NPZ elsewhere, and of one stimulus alone."""
    monkeypatch.chdir(tmp_path)
    made = fb.simulate(["sine_100_200", "ramp_300_20_50_20"], stored=True, parameters="fitted")
    made.write("out")
    (tmp_path / "away").mkdir()
    shutil.copy("out/traces.npz", "away/mine.npz")

    assert main(["encode", "out", "--no-raster"]) == 0
    assert capsys.readouterr().err == ""
    assert fb.encode("away/mine.npz").spikes.equals(made.spikes)
    assert fb.encode("out").rates.equals(made.rates)
    for name in ("spikes.csv", "rates.csv"):
        assert (tmp_path / "encoded" / name).read_bytes() == (tmp_path / "out" / name).read_bytes()
    words = ["--stimulus", "sine_100_200", "--json", "--no-raster"]
    assert main(["encode", "out/traces.npz", *words]) == 0
    rows = json.loads(capsys.readouterr().out)["rates"]
    assert [row["window_ms"] for row in rows] == [[100.0, 200.0]] * 3
    assert main(["encode", "out", "--stimulus", "sine_20_250"]) == 2
    error = capsys.readouterr().err
    for value in ("--stimulus", "'sine_20_250'", "sine_100_200"):
        assert value in error


def test_a_sensor_of_a_robot_is_a_table_too(here, capsys, logged):
    """Two taxels in N, 20 kPa a newton, seconds: a unit each, of two classes."""
    times_s = np.arange(251) * 1e-3
    force_n = 1 - np.cos(2 * np.pi * 30 * times_s)
    robot = pd.DataFrame({"t_s": times_s, "left": force_n, "right": 2 * force_n})
    robot.to_csv(here / "robot.csv", index=False)
    words = ["robot.csv", "--columns", "time=t_s,value=left,value=right", "--no-raster"]

    assert main(["encode", *words, "--gain-pa", "2e4", "--afferent", "SA", "RA"]) == 0
    assert main(["encode", *words, "--gain-pa", "0", "--afferent", "SA"]) == 2
    assert main(["encode", *words, "--afferent", "SA"]) == 2

    error = capsys.readouterr().err
    for hint in ("column left has no unit", "--gain-pa", "fembridge calibrate"):
        assert hint in error
    found = spikes_by(here / "encoded/spikes.csv")
    assert {(name, unit) for name, unit, _ in found} == {
        (name, unit) for name in ("SA", "RA") for unit in ("left", "right")
    }
    table = {"columns": {"time": "t_s", "value": ["left", "right"]}, "gain_pa": 2e4}
    again = fb.encode(robot, afferents=["SA", "RA"], stimulus="robot", **table).spikes
    assert any("0.1 ms" in line for line in logged)
    assert len(again) == sum(map(len, found.values()))
    times_ms = again.query("afferent == 'RA' and unit == 'right' and cell == 1").spike_time_ms
    assert times_ms.tolist() == found["RA", "right", 1]


def test_faint_stress_of_a_run_is_not_taken_for_another_unit(here, capsys):
    words = ["--stored", "--stimulus", "sine_20_0.1", "--preindent-um", "0", "--no-plot"]
    assert main(["simulate", *words, "-o", "faint"]) == 0
    assert main(["encode", "faint", "--no-raster"]) == 0
    shown = capsys.readouterr().err
    assert "no spikes" in shown or "Pa" in shown
    assert "--gain-pa" not in shown


@pytest.mark.parametrize(
    ("gain", "shown"),
    [
        (1e-6, "--gain-pa 1e6"),
        (1e-3, "--gain-pa 1e3"),
        (1e6, "--gain-pa 1e-6"),
        (0.0, "no spikes: all stress is 0"),
        (0.006, "no spikes: the strongest trace (RA)"),
        (1.0, ""),
    ],
)
def test_stress_that_no_touch_gives_is_doubted_in_one_line(here, capsys, gain, shown, logged):
    """Without PC, whose keenest cell answers even a 300th of the stress."""
    felt = [trace for trace in traces() if trace.afferent != "PC"]
    whole = [replace(trace, stress_pa=gain * trace.stress_pa) for trace in felt]
    write_traces(here / "table.csv", whole)
    assert main(["encode", "table.csv", "--no-raster", "--window-ms", "0:250"]) == 0
    doubts = [line for line in capsys.readouterr().err.splitlines() if "fitted on" not in line]
    assert len(doubts) == bool(shown)
    assert shown in "".join(doubts)
    if shown:
        assert doubts[0].startswith("warning: ")
        lines = logged
        with pytest.warns(FembridgeWarning, match="peaks|all stress is 0"):
            fb.encode(whole)
        assert not any(shown in line for line in lines)


def test_stress_that_no_equation_holds_is_refused(here, refused):
    """Sums of 1e200 Pa are infinite, and spikes of infinity are spikes of nothing."""
    write_traces(here / "table.csv", [replace(t, stress_pa=1e196 * t.stress_pa) for t in traces()])
    refused(["encode", "table.csv", "--no-raster"], "SA peaks at 2e+200 Pa, expected at most", 1)


def test_a_change_of_step_that_loses_power_is_said(here, capsys):
    """Of a coarse table what PCHIP smooths, of a fine one what folds."""
    for dt_ms, hz, shown in (
        (2.0, 100, "100 % of its power is above 50 Hz: rates may be off: sample it every 0.5 ms"),
        (2.0, 10, ""),
        (0.02, 10_000, "100 % of its power is above 5000 Hz: filter it first"),
        (0.02, 100, ""),
    ):
        times_ms = dt_ms * np.arange(round(200 / dt_ms))
        wave = 1e4 * (1 - np.cos(2e-3 * np.pi * hz * times_ms))
        write_traces(here / "other.csv", [StressTrace(wave, dt_ms, 1, "SA")])
        assert main(["encode", "other.csv", "--no-raster"]) == 0
        (line,) = [x for x in capsys.readouterr().err.splitlines() if "resampled to every" in x]
        assert line.endswith(shown or "every 0.1 ms")


def test_an_even_table_is_resampled_where_that_is_asked(here):
    with pytest.warns(FembridgeWarning, match=r"4 % of its power is above 100 Hz: .* 2 more"):
        (trace,) = read_traces(here / "sine_50_250.csv", resample_ms=5.0)[:1]
    (fine,) = read_traces(here / "sine_50_250.csv")[:1]
    assert trace.dt_ms == 5.0
    np.testing.assert_allclose(trace.stress_pa, fine.stress_pa[::10])


def test_a_stimulus_that_is_named_brings_its_window(here, capsys):
    for name, window_ms in (("sine_100_200", [100, 200]), ("ramp_100_20_20_20", [0, 210])):
        assert main(["encode", "sine_50_250.csv", "--no-raster", "--stimulus", name, "--json"]) == 0
        shown = capsys.readouterr()
        assert {tuple(row["window_ms"]) for row in json.loads(shown.out)["rates"]} == {
            tuple(window_ms)
        }
        assert "whole trace" not in shown.err
    words = ["--no-raster", "--stimulus", "ramp_100_200_200_200"]
    assert main(["encode", "sine_50_250.csv", *words]) == 0
    assert "rates over the whole trace" in capsys.readouterr().err


def test_a_few_samples_that_would_become_millions_are_refused(here, refused):
    """Times in us, taken as ms: five samples would be ten million."""
    table = pd.DataFrame({"time_ms": 1.1e6 * np.arange(5), "afferent": "SA", "von_mises_pa": 1e4})
    table.to_csv(here / "table.csv", index=False)
    for words in ([], ["--resample-ms", "0.5"]):
        refused(["encode", "table.csv", *words], "by resampling: are times in another unit?", 1)


def test_traces_in_batches_fire_as_all_at_once(monkeypatch):
    units = [replace(trace, unit=str(k)) for k in range(3) for trace in traces()]
    together = fb.encode(units).spikes
    monkeypatch.setattr(spikes, "_BATCH_SAMPLES", 1)
    assert fb.encode(units).spikes.equals(together)


ENCODINGS = {
    "simulation of two stimuli": lambda: fb.encode(
        fb.simulate(["sine_20_250", "noise_25_250_20"], stored=True)
    ),
    "units of other lengths and starts, with options": lambda: fb.encode(
        [
            replace(traces(["SA"])[0], unit="a"),
            replace(traces(["SA"], start_ms=0.5, dt_ms=0.25)[0], unit="b"),
            replace(traces(["RA"], dt_ms=1.0)[0], stress_pa=np.zeros(200)),
        ],
        parameters="published",
        stimulus="mine",
        window_ms=(10, 100),
        derivative="forward",
    ),
}


@pytest.mark.parametrize("name", ENCODINGS)
@pytest.mark.filterwarnings("ignore::fembridge.FembridgeWarning")
def test_an_encoding_is_read_back_as_it_was(here, name):
    encoding = ENCODINGS[name]()
    encoding.write("encoded")
    again = fb.Encoding.read("encoded")
    pd.testing.assert_frame_equal(again.spikes, encoding.spikes)
    pd.testing.assert_frame_equal(again.rates, encoding.rates)
    pd.testing.assert_frame_equal(again.traces.to_frame(), encoding.traces.to_frame())
    assert again.provenance == encoding.provenance
    assert again.windows_ms == encoding.windows_ms
    assert repr(again) == repr(encoding)
    again.write("again")
    for file in ("encoding.toml", "spikes.csv", "rates.csv"):
        assert (here / "again" / file).read_bytes() == (here / "encoded" / file).read_bytes()


def test_the_folder_of_the_command_is_the_one_that_the_function_writes(here):
    assert main(["encode", "sine_50_250.csv", *OURS, "--no-raster"]) == 0
    fb.encode("sine_50_250.csv", parameters="published").write("again")
    names = {path.name for path in (here / "encoded").iterdir()}
    assert names == {"encoding.toml", "rates.csv", "spikes.csv", "stress.npz"}
    for name in ("encoding.toml", "spikes.csv", "rates.csv"):
        assert (here / "again" / name).read_bytes() == (here / "encoded" / name).read_bytes()
    assert fb.Encoding.read("encoded").parameters is parameter_set("published")


@pytest.mark.parametrize("name", ["spikes.csv", "stress.npz"])
def test_a_file_of_another_encoding_is_refused(here, name):
    encoding = fb.encode("sine_50_250.csv", parameters="published")
    encoding.write("encoded")
    (here / "encoded" / name).write_bytes(b"changed")
    with pytest.raises(ResultError) as refused:
        fb.Encoding.read("encoded")
    assert refused.value.path.name == name
    (here / "encoded" / name).unlink()
    with pytest.raises(ResultError) as refused:
        fb.Encoding.read("encoded")
    assert refused.value.expected == name


def test_a_folder_without_an_encoding_is_refused(here):
    with pytest.raises(ResultError) as refused:
        fb.Encoding.read(here)
    assert refused.value.path == here / "encoding.toml"
