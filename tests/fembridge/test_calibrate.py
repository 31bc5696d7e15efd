"""The gain of a sensor from a press of known force or depth."""

import numpy as np
import pandas as pd
import pytest

import fembridge as fb
from fembridge.cli import main
from fembridge.errors import FembridgeWarning, ParameterError, TraceError, UsageError
from neural import Stream

TIMES_S = np.arange(600) * 5e-4


def press(slope=0.8, rest=0.4, noise=0.0):
    """Volts of a press between 100 and 250 ms."""
    held = np.interp(TIMES_S, [0.1, 0.15, 0.2, 0.25], [0, 1, 1, 0])
    return rest + slope * held + np.random.default_rng(2).normal(0, noise, TIMES_S.size)


def table(**columns):
    return pd.DataFrame({"time_s": TIMES_S, **columns})


@pytest.fixture(scope="module")
def under_300_um():
    response = fb.PadProbe(deepest_um=300).response
    stress_pa = response.tensor_pa[-1, :, 0].reshape(3, -1).mean(axis=1)
    return dict(zip(response.class_names(), stress_pa, strict=True)), float(response.force_n[-1])


def test_the_gain_is_the_stress_of_the_fingertip_over_the_signal(under_300_um):
    stress_pa, force_n = under_300_um
    calibration = fb.calibrate(table(volts=press()), depth_um=300)
    assert calibration.offset == pytest.approx({"volts": 0.4})
    for name, gain in calibration.gain_pa.items():
        assert gain == pytest.approx(stress_pa[name] / 0.8, rel=1e-6)
    assert calibration.provenance["force_n"] == pytest.approx(force_n)
    assert calibration.stress_pa(1.2)["RA"] == pytest.approx(stress_pa["RA"], rel=1e-6)


def test_force_and_depth_of_one_press_have_the_same_gain(under_300_um):
    _, force_n = under_300_um
    by_force = fb.calibrate(table(volts=press()), force_n=force_n)
    by_depth = fb.calibrate(table(volts=press()), depth_um=300)
    assert by_force.provenance["depth_um"] == pytest.approx(300, rel=0.01)
    assert by_force.gain_pa == pytest.approx(by_depth.gain_pa, rel=0.02)


def test_a_signal_that_falls_has_a_gain_below_zero():
    rising = fb.calibrate(table(volts=press()), depth_um=100).gain_pa
    falling = fb.calibrate(table(volts=press(-0.8, 3.0)), depth_um=100).gain_pa
    assert falling == pytest.approx({name: -gain for name, gain in rising.items()})


def test_the_column_with_the_largest_change_was_pressed():
    both = fb.calibrate(table(left=press(0.1, 0.2), right=press(0.7, 0.5)), depth_um=100)
    assert both.provenance["column"] == "right"
    assert both.offset == pytest.approx({"left": 0.2, "right": 0.5})
    assert both.stress_pa(0.2, "left")["SA"] == pytest.approx(0, abs=1e-6)
    with pytest.raises(UsageError):
        both.stress_pa(0.2, "middle")


def test_noise_that_fires_a_class_is_reported():
    with pytest.warns(FembridgeWarning, match="PC .* impulses/s"):
        fb.calibrate(table(volts=press(noise=0.005)), depth_um=300)


@pytest.mark.parametrize(
    ("options", "kind", "argument"),
    [
        ({}, UsageError, "force_n"),
        ({"force_n": 1.0, "depth_um": 100}, UsageError, "force_n"),
        ({"force_n": 5.0}, UsageError, "force_n"),
        ({"force_n": -1.0}, UsageError, "force_n"),
        ({"depth_um": 3000}, UsageError, "depth_um"),
    ],
)
def test_what_is_no_press_is_refused(options, kind, argument):
    with pytest.raises(kind) as caught:
        fb.calibrate(table(volts=press()), **options)
    assert caught.value.argument == argument


def test_a_signal_without_a_press_is_refused():
    with pytest.raises(TraceError, match="no press"):
        fb.calibrate(table(volts=np.full(TIMES_S.size, 0.4)), depth_um=100)


def test_the_command_writes_what_encode_reads(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    table(volts=press()).to_csv("press.csv", index=False)
    assert main(["calibrate", "press.csv", "--depth-um", "300"]) == 0
    shown = capsys.readouterr().out
    assert "--calibration" in shown
    assert "--gain-pa SA=" in shown
    words = ["encode", "press.csv", "--calibration", "calibration.toml", "--no-raster"]
    assert main(words) == 0
    encoding = fb.Encoding.read("encoded")
    assert encoding.parameters.name == "fitted_pad"
    calibration = fb.Calibration.read("calibration.toml")
    assert calibration.gain_pa == fb.calibrate("press.csv", depth_um=300).gain_pa
    stress_pa = calibration.stress_pa(press())
    for trace in encoding.traces:
        np.testing.assert_allclose(trace.stress_pa, stress_pa[trace.afferent], atol=1e-6)
    assert main([*words, "--gain-pa", "3"]) == 2
    stream = Stream("fitted_pad", 0.5)
    spikes = stream.push(stress_pa) + stream.flush()
    assert len(spikes) == len(encoding.spikes) > 20


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("[gain_pa]\nSA = 0\n", "gain_pa.SA"),
        ("[gain_pa]\nSA = 'x'\n", "gain_pa.SA"),
        ("[gain_pa]\nXX = 1.0\n", None),
        ("gain = 1\n", "gain"),
        ("gain_pa = 1\n", "gain_pa"),
        ("", None),
    ],
)
def test_a_file_that_is_no_calibration_is_refused(text, key, tmp_path):
    path = tmp_path / "calibration.toml"
    path.write_text(text)
    with pytest.raises(ParameterError) as caught:
        fb.Calibration.read(path)
    assert caught.value.path == path
    assert key is None or caught.value.key == key
