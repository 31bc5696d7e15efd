"""Tables of robots: columns are recognised, uneven times and slow sensors are reported."""

import warnings

import numpy as np
import pandas as pd
import pytest

import fembridge as fb
from fembridge.cli import main
from fembridge.errors import FembridgeWarning, UsageError
from fembridge.io.sensor_table import deaf_above, sensor_table

TIMES_S = np.arange(400) * 1e-3


def signal(times_s=TIMES_S):
    return 1 - np.cos(2 * np.pi * 30 * times_s)


@pytest.mark.parametrize(
    ("header", "time", "values"),
    [
        ("time_s,pressure_kpa", {"time": "time_s"}, ["pressure_kpa"]),
        ("seq,t,left,right", {"time": "t"}, ["left", "right"]),
        ("time [ms],fx,fy", {"time": "time [ms]"}, ["fx", "fy"]),
        ("timestamp,taxel 1,comment", {"time": "timestamp"}, ["taxel 1"]),
        ("Time_us;Force_N", {"time": "Time_us"}, ["Force_N"]),
        ("time_s,pressure_kpa,temperature", {"time": "time_s"}, ["pressure_kpa"]),
        ("time_ms,afferent,von_mises_pa", None, None),
        ("torque,tension", None, None),
    ],
)
def test_columns_are_recognised(header, time, values, tmp_path):
    separator = ";" if ";" in header else ","
    names = header.split(separator)
    rows = [
        separator.join("n" if name == "comment" else f"{row * 0.001:g}" for name in names)
        for row in range(1, 9)
    ]
    path = tmp_path / "robot.csv"
    path.write_text("\n".join([header, *rows, ""]))
    table = sensor_table(path)
    frame = pd.read_csv(path, sep=separator)
    if time is None:
        assert table is None
        assert sensor_table(frame) is None
        return
    for found in (table, sensor_table(frame)):
        assert found.value_names == values
        assert {key: name for key, name in found.columns.items() if key != "value"} == time


def test_the_time_step_tells_seconds_from_milliseconds(tmp_path):
    for step, key in ((0.001, "time"), (2, "time_ms")):
        frame = pd.DataFrame({"time": step * np.arange(9), "force": 1.0})
        table = sensor_table(frame)
        assert key in table.columns
        assert table.step_ms == pytest.approx(1.0 if key == "time" else 2.0)
    assert sensor_table(pd.DataFrame({"millis": [0, 1, 2], "f": 1})).step_ms == 1.0


def test_a_gain_makes_every_number_a_value():
    frame = pd.DataFrame({"time_s": TIMES_S, "p_kpa": 1.0, "temperature": 20.0})
    assert sensor_table(frame, has_gain=True).value_names == ["p_kpa", "temperature"]


def test_a_table_of_a_robot_needs_a_gain_and_nothing_else(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    frame = pd.DataFrame({"t": TIMES_S, "left": signal(), "right": 2 * signal()})
    frame.to_csv("robot.csv", index=False)
    assert main(["encode", "robot.csv", "--no-raster"]) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    for hint in ("left", "fembridge calibrate", "--gain-pa"):
        assert hint in error
    assert main(["encode", "robot.csv", "--gain-pa", "1e4", "--no-raster"]) == 0
    shown = capsys.readouterr().err
    for hint in ("time in t", "left, right", "SA, RA, PC", "above 500 Hz"):
        assert hint in shown
    found = fb.Encoding.read("encoded").spikes
    assert set(found["unit"]) == {"left", "right"}
    assert set(found["afferent"]) == {"SA", "RA", "PC"}


def test_the_sample_of_a_robot_is_encoded_as_it_is(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["sample", "pressure"]) == 0
    assert main(["encode", "sample/pressure.csv", "--no-raster"]) == 0
    assert "warning" not in capsys.readouterr().err
    assert set(fb.Encoding.read("encoded").spikes["afferent"]) == {"SA", "RA", "PC"}


def test_uneven_times_of_a_sensor_are_put_on_an_even_grid(logged):
    rng = np.random.default_rng(1)
    times_s = TIMES_S + rng.uniform(-2e-4, 2e-4, TIMES_S.size)
    uneven = pd.DataFrame({"time_s": times_s, "p_kpa": 10 * signal(times_s)})
    encoding = fb.encode(uneven, afferents="SA")
    assert {trace.dt_ms for trace in encoding.traces} == {0.5}
    assert sum("resampled" in line for line in logged) == 1
    assert any("uneven times are resampled every 0.5 ms" in line for line in logged)
    times_ms = encoding.traces[0].times_ms
    exact = 1e4 * signal(times_ms / 1000)
    np.testing.assert_allclose(encoding.traces[0].stress_pa, exact, atol=100)


def test_pc_misses_what_a_slow_sensor_does_not_have():
    assert deaf_above(0.5) is None
    assert "above 50 Hz" in deaf_above(10.0)
    frame = pd.DataFrame({"time_s": TIMES_S, "p_kpa": 10 * signal()})
    with pytest.warns(FembridgeWarning, match="PC.*above 500 Hz"):
        fb.encode(frame)
    with warnings.catch_warnings():
        warnings.simplefilter("error", FembridgeWarning)
        fb.encode(frame, afferents="RA")


def test_a_gain_of_each_class_multiplies_its_stress():
    frame = pd.DataFrame({"time_s": TIMES_S / 2, "volts": signal()})
    encoding = fb.encode(frame, gain_pa={"SA": 1e4, "PC": -300.0})
    peaks = {
        trace.afferent: trace.stress_pa[np.abs(trace.stress_pa).argmax()]
        for trace in encoding.traces
    }
    assert peaks == pytest.approx({"SA": 2e4, "PC": -600.0}, rel=1e-3)
    with pytest.raises(UsageError) as caught:
        fb.encode(frame, gain_pa={"SA": 1e4}, afferents=["SA", "RA"])
    assert caught.value.argument == "gain_pa"


def test_the_option_gain_takes_numbers_by_class(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    pd.DataFrame({"time_s": TIMES_S / 2, "volts": signal()}).to_csv("robot.csv", index=False)
    words = ["encode", "robot.csv", "--no-raster"]
    assert main([*words, "--gain-pa", "SA=1e4,RA=2e4"]) == 0
    found = fb.Encoding.read("encoded")
    assert {t.afferent: round(t.stress_pa.max()) for t in found.traces} == {
        "SA": 20000,
        "RA": 40000,
    }
    capsys.readouterr()
    for text in ("SA=1,SA=2", "XX=1", "SA=", "SA=nan"):
        assert main([*words, "--gain-pa", text]) == 2
