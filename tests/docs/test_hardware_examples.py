"""The sketch and the ROS 2 node of docs/examples_hardware, run beside the encoder.

Neither a board nor ROS is here: a few lines stand for the libraries that both call.
"""

import importlib.util
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

import fembridge as fb
from neural import Stream, encode_afferents, parameter_set

FOLDER = Path(__file__).parents[2] / "docs" / "examples_hardware"
CLASSES = ("SA", "RA", "PC")
COMPILERS = [name for name in ("g++", "clang++") if shutil.which(name)]

ARDUINO = """
#include <cstdio>
enum { A0 = 14 };
static int readings[4096];
static unsigned long now_us = 0xFFFFF000UL; /* micros overflows after 4 ms */
static unsigned long sample_of_test;
inline unsigned long micros() { return now_us & 0xFFFFFFFFUL; }
inline int analogRead(int) { return readings[sample_of_test++]; }
struct Port {
    void begin(long) {}
    void print(double number, int digits) { std::printf("%.*f", digits, number); }
    void print(char sign) { std::printf("%c", sign); }
    void print(const char *text) { std::printf("%s", text); }
    void println(int number) { std::printf("%d\\n", number); }
};
static Port Serial;
"""
BOARD = """
#include "Arduino.h"
#include "touch_afferents.ino"
int main()
{
    unsigned long count = 0, turn;
    while (std::scanf("%d", &readings[count]) == 1) count++;
    setup();
    for (turn = 0; sample_of_test < count; turn++) {
        loop();
        now_us += 250;
    }
    return turn < 4 * (count - 1); /* one reading each 1000 us */
}
"""


@pytest.mark.skipif(not COMPILERS, reason="no C++ compiler (g++, clang++)")
@pytest.mark.parametrize("compiler", COMPILERS)
def test_the_sketch_prints_the_spikes_of_the_encoder(compiler, tmp_path):
    header = fb.export_c("fitted_pad", precision="float", sensor_ms=1.0)
    (tmp_path / "afferents.h").write_text(header)
    (tmp_path / "Arduino.h").write_text(ARDUINO)
    (tmp_path / "board.cpp").write_text(BOARD)
    shutil.copy(FOLDER / "touch_afferents" / "touch_afferents.ino", tmp_path)
    words = [compiler, "-std=c++11", "-O2", "-Wall", "-Wextra", "-pedantic", "-Werror"]
    words += ["-ffp-contract=off", "-o", str(tmp_path / "board"), str(tmp_path / "board.cpp")]
    subprocess.run(words, check=True)
    times_ms = np.arange(900)
    signal = 300 * np.interp(times_ms, [50, 150, 600, 700], [0, 1, 1, 0])
    signal += 20 * np.sin(2e-3 * np.pi * 150 * times_ms) * (times_ms > 250) * (times_ms < 450)
    readings = np.rint(102 + signal).astype(int)
    printed = subprocess.run(
        [str(tmp_path / "board")],
        input=" ".join(map(str, readings)),
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    ).stdout
    found = {
        (name, int(cell), round(10 * float(time_ms)))
        for time_ms, name, cell in (line.split(",") for line in printed.splitlines())
    }
    gains = {"SA": 86.0, "RA": 68.0, "PC": 1.9}
    stress_pa = {name: gain * (readings - 102.0) for name, gain in gains.items()}
    parameters = parameter_set("fitted_pad").parameters
    expected = {
        (name, cell, round(10 * time_ms))
        for name, [cells] in encode_afferents(stress_pa, 1.0, parameters).items()
        for cell, cell_ms in enumerate(cells)
        for time_ms in cell_ms
        if time_ms <= 897  # three samples of delay
    }
    assert {name for name, *_ in found} == set(CLASSES)
    assert len(expected) > 200
    assert len(found ^ expected) <= 0.02 * len(expected)  # single precision


class Record(SimpleNamespace):
    """A message: any fields."""


@pytest.fixture
def node_module(monkeypatch):
    """The node, with stand-ins of rclpy and of the messages."""

    class Node:
        def __init__(self, name):
            self.published, self.callbacks = [], {}

        def declare_parameter(self, name, default):
            return SimpleNamespace(value=self.parameters.get(name, default))

        def create_publisher(self, kind, topic, depth):
            publish = lambda message: self.published.append((topic, message))  # noqa: E731
            return SimpleNamespace(publish=publish)

        def create_subscription(self, kind, topic, callback, profile):
            self.callbacks[topic] = callback

        def destroy_node(self):
            pass

    modules = {
        "rclpy": {"init": lambda: None, "spin": None, "try_shutdown": lambda: None},
        "rclpy.node": {"Node": Node},
        "rclpy.qos": {"qos_profile_sensor_data": object()},
        "geometry_msgs": {},
        "geometry_msgs.msg": {"WrenchStamped": Record},
        "std_msgs": {},
        "std_msgs.msg": {
            "Float64MultiArray": lambda: Record(layout=Record(dim=[]), data=[]),
            "MultiArrayDimension": Record,
        },
    }
    for name, content in modules.items():
        module = ModuleType(name)
        module.__dict__.update(content)
        monkeypatch.setitem(sys.modules, name, module)
    specification = importlib.util.spec_from_file_location(
        "wrench_to_spikes", FOLDER / "wrench_to_spikes.py"
    )
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


def wrench(time_s, force_n):
    seconds = int(time_s)
    stamp = Record(sec=seconds, nanosec=round(1e9 * (time_s - seconds)))
    force = Record(x=0.0, y=0.0, z=force_n)
    return Record(header=Record(stamp=stamp), wrench=Record(force=force))


def test_the_node_publishes_the_spikes_of_the_force(node_module, tmp_path, monkeypatch):
    calibration = fb.Calibration({"SA": -4e4, "RA": -3e4, "PC": -900.0}, {"fz": -0.1}, "fitted_pad")
    calibration.write(tmp_path / "calibration.toml")
    rng = np.random.default_rng(3)
    times_s = 1000 + np.cumsum(rng.uniform(0.001, 0.003, 400))
    times_s[200:] += 5  # the sensor was off
    phase = 2 * np.pi * 60 * (times_s - times_s[0])
    force_n = -0.1 - np.interp(times_s - times_s[0], [0.05, 0.1], [0, 0.5]) * (
        1 + 0.2 * np.sin(phase)
    )
    node_module.WrenchToSpikes.parameters = {"calibration": str(tmp_path / "calibration.toml")}
    nodes = []

    def spin(node):
        nodes.append(node)
        for time, force in zip(times_s, force_n, strict=True):
            node.callbacks["wrench"](wrench(time, force))
        raise KeyboardInterrupt

    monkeypatch.setattr(node_module.rclpy, "spin", spin)
    node_module.main()
    [node] = nodes
    rows = []
    for topic, message in node.published:
        assert topic == "spikes"
        spikes, fields = message.layout.dim
        assert (spikes.size, fields.size) == (len(message.data) // 3, 3)
        rows += np.reshape(message.data, (-1, 3)).tolist()
    expected = []
    for part in (slice(0, 200), slice(200, 400)):
        start_s = times_s[part][0]
        grid_s = np.arange(start_s, times_s[part][-1], 0.001)
        stream = Stream("fitted_pad", 1.0)
        samples = np.interp(grid_s, times_s[part], force_n[part])
        expected += [
            (start_s + spike.time_ms / 1000, CLASSES.index(spike.afferent), spike.cell)
            for spike in stream.push(calibration.stress_pa(samples))
        ]
    assert {row[1] for row in rows} == {0, 1, 2}
    assert len(rows) == len(expected) > 100
    np.testing.assert_allclose(np.array(sorted(rows)), np.array(sorted(expected)), atol=1e-4)


@pytest.mark.parametrize(
    "page", [pytest.param("tutorials/robotics.md", marks=pytest.mark.slow), "how_to/hardware.md"]
)
def test_the_python_of_the_pages_runs(page, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    text = (FOLDER.parent / page).read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    names = {}
    for code in blocks:
        exec(compile(code, page, "exec"), names)
    assert blocks
    printed = capsys.readouterr().out
    assert "RA" in printed
    assert isinstance(names["stream"], Stream)
