"""Trajectories: tables that are damaged, and numbers out of range."""

import io
import math

import numpy as np
import pandas
import pytest
from numpy.testing import assert_allclose

import fembridge as fb
from fembridge.errors import FembridgeError, FembridgeWarning, TableError, UsageError
from fembridge.touching.trajectory import PinArray, Trajectory

PATH = "time_ms,x_mm,z_mm,depth_um\n0,0,2,150\n50,0.25,0,300\n100,2,0,-10\n"
PINS = "x_mm,z_mm,diameter_mm,stimulus\n0,0,1,sine_20_250\n1.5,-2,0.5,sine_40_100\n"
ODD = (math.nan, math.inf, -math.inf, 1e308, -1e308)


@pytest.fixture
def table(tmp_path):
    """Write a text as a table; its path."""

    def write(text):
        path = tmp_path / "table.csv"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


@pytest.mark.parametrize(
    ("read", "text", "line", "match"),
    [
        (Trajectory.from_table, PATH.replace("depth_um", "depth"), 1, "depth.*depth_um"),
        (Trajectory.from_table, PATH.replace("x_mm", "x_um"), 1, "x_mm"),
        (
            Trajectory.from_table,
            PATH.replace("um\n", "um,force\n").replace("0\n", "0,1\n"),
            1,
            "force_n",
        ),
        (Trajectory.from_table, PATH.replace("50,", "5_0,"), 3, "5_0"),
        (Trajectory.from_table, PATH.replace("50,", "\u0665\u0660,"), 3, "time_ms"),
        (Trajectory.from_table, PATH.replace("300", "1e999"), 3, "1e999"),
        (Trajectory.from_table, PATH.replace("50,", "0,"), 3, "rise"),
        (Trajectory.from_pins, PINS.replace("diameter_mm", "diameter"), 1, "diameter_mm"),
        (
            Trajectory.from_pins,
            PINS.replace("s\n", "s,delay_ms\n").replace("0\n", "0,1\n"),
            1,
            "delay_ms",
        ),
        (Trajectory.from_pins, PINS.replace("1.5", "1_5"), 3, "1_5"),
        (Trajectory.from_pins, PINS.replace("1.5", "1e308"), 3, "x_mm is 1e[+]308"),
        (Trajectory.from_pins, PINS.replace("0.5", "1e308"), 3, "diameter_mm is 1e[+]308"),
        (Trajectory.from_pins, PINS.replace("0.5", "0"), 3, "diameter_mm"),
        (Trajectory.from_pins, PINS.replace("sine_40_100", ""), 3, "stimulus"),
        (Trajectory.from_pins, PINS.replace("sine_40_100", "sine_20"), 3, "12"),
    ],
)
def test_a_path_or_pins_with_another_column_or_no_number_name_the_line(
    table, read, text, line, match
):
    with pytest.raises(TableError, match=match) as error:
        read(table(text))
    assert error.value.line == line


@pytest.mark.parametrize(
    ("read", "text", "match"),
    [
        (Trajectory.from_table, PATH.replace("100,2", "1e308,2"), "time_ms from 0 to 1e[+]308"),
        (Trajectory.from_table, PATH.replace("100,2", "1e6,2"), "time_ms from 0 to 1e[+]06"),
        (
            Trajectory.from_table,
            "time_ms,x_mm,z_mm,force_n\n0,0,0,1\n0.1,0,0,1\n",
            "time_ms from 0 to 0.1",
        ),
        (Trajectory.from_table, PATH.replace("0.25", "1e308"), "x_mm is 0 to 1e[+]308"),
        (Trajectory.from_table, PATH.replace("-10", "-1e308"), "depth_um is -1e[+]308"),
        (Trajectory.from_table, PATH.replace("300", "1e308"), "expected -1e[+]06 to 4000"),
        (Trajectory.from_table, PATH.replace("depth_um", "force_n"), "expected -1e[+]06 to 20$"),
        (Trajectory.from_pins, PINS.split("\n")[0] + "\n", "0 pins"),
        (Trajectory.from_pins, PINS + "0,0,1,sine_20_250\n" * 2000, "2002 pins"),
    ],
)
def test_a_path_or_pins_beyond_their_ranges_are_refused(table, read, text, match):
    with pytest.raises(UsageError, match=rf"table\.csv: .*{match}"):
        read(table(text))


@pytest.mark.parametrize(
    ("read", "text"), [(Trajectory.from_table, PATH), (Trajectory.from_pins, PINS)]
)
def test_a_path_or_pins_that_may_be_cut_in_the_last_cell_are_named(table, read, text):
    with pytest.warns(FembridgeWarning, match=r"table\.csv: no line end"):
        read(table(text[:-1]))
    read(table(text.replace("\n", "\r\n")))


@pytest.mark.parametrize(
    ("read", "text"), [(Trajectory.from_table, PATH), (Trajectory.from_pins, PINS)]
)
def test_a_path_or_pins_that_are_damaged_keep_their_rows_and_columns(table, read, text):
    whole, rng = text.encode(), np.random.default_rng(26)
    undamaged = read(table(whole))
    header = whole.index(b"\n")
    for position in range(len(whole)):
        damaged = bytearray(whole)
        damaged[position] ^= 1 << int(rng.integers(7))
        try:
            trajectory = read(table(bytes(damaged)))
        except (FembridgeError, FembridgeWarning):
            continue
        if trajectory.pins is not None:
            assert len(trajectory.pins.positions) == 2
        if position < header:  # refused, or a blank
            assert_allclose(trajectory.level, undamaged.level)


@pytest.mark.parametrize("number", ODD)
def test_a_number_out_of_range_is_refused_from_python(number):
    ones = np.ones(5)
    odd = np.array([0, 1, number, 1, 0])
    for make in (
        lambda: Trajectory.press(press_um=number),
        lambda: Trajectory.press(press_n=number),
        lambda: Trajectory.press(press_um=100, ramp_ms=number),
        lambda: Trajectory.press(press_um=100, hold_ms=number),
        lambda: Trajectory.slide(number, press_um=100),
        lambda: Trajectory.slide(40, press_um=100, duration_ms=number),
        lambda: Trajectory.slide(40, press_um=100, direction_deg=number),
        lambda: Trajectory(odd),
        lambda: Trajectory(force_n=odd),
        lambda: Trajectory(ones, x_mm=odd, z_mm=ones),
        lambda: Trajectory(ones, x_mm=ones, z_mm=odd),
        lambda: PinArray(((0.0, 0.0, 1.0),), odd[:, None]),
        lambda: PinArray(((number, 0.0, 1.0),), ones[:, None]),
        lambda: PinArray(((0.0, 0.0, number),), ones[:, None]),
        lambda: fb.touch("punch", press_um=100, population="one_each", angle_deg=number),
        lambda: fb.touch("punch", press_um=100, population="one_each", at_mm=(0.0, number)),
    ):
        with pytest.raises(UsageError):
            make()


def test_arrays_of_other_shapes_are_refused():
    ones = np.ones(5)
    for make, argument in (
        (lambda: Trajectory(), "depth_um"),
        (lambda: Trajectory(ones, force_n=ones), "depth_um"),
        (lambda: Trajectory(ones[:, None]), "depth_um"),
        (lambda: Trajectory("deep"), "depth_um"),
        (lambda: Trajectory(ones, x_mm=ones), "z_mm"),
        (lambda: Trajectory(ones, x_mm=ones[1:], z_mm=ones), "x_mm"),
        (lambda: Trajectory(ones, window_ms=(2.0, 2.0)), "window_ms"),
        (lambda: Trajectory(ones, window_ms=(math.nan, 2.0)), "window_ms"),
        (lambda: Trajectory(ones, dt_ms=math.nan), "dt_ms"),
        (lambda: Trajectory(ones, dt_ms=math.inf), "dt_ms"),
        (lambda: Trajectory(ones, dt_ms=-0.5), "dt_ms"),
        (lambda: PinArray((), np.ones((5, 0))), "positions"),
        (lambda: PinArray(((0.0, 0.0, 1.0),), np.ones((5, 2))), "depth_um"),
    ):
        with pytest.raises(UsageError) as error:
            make()
        assert error.value.argument == argument
    with pytest.raises(UsageError):
        Trajectory(np.ones(0))


def test_a_trajectory_of_arrays_has_the_times_of_its_samples():
    trajectory = Trajectory(depth_um=[0, 1, 2], dt_ms=0.25)
    assert_allclose(trajectory.times_ms, [0, 0.25, 0.5])
    assert trajectory.window_ms == (0.0, 0.5) and not trajectory.slides


def test_a_pin_of_the_same_stimulus_has_the_same_waveform(table):
    rows = "".join(f"{0.2 * n:g},0,0.1,sine_20_250\n" for n in range(-20, 20))
    trajectory = Trajectory.from_pins(table(PINS.split("\n")[0] + "\n" + rows))
    expected = np.repeat(trajectory.level[:, None], 40, axis=1)
    assert_allclose(trajectory.pins.depth_um, expected)


def test_pins_and_paths_are_the_same_from_a_table_and_from_a_file(table):
    for read, text in ((Trajectory.from_table, PATH), (Trajectory.from_pins, PINS)):
        path = table(text)
        from_file, from_frame = read(path), read(pandas.read_csv(path))
        assert_allclose(from_frame.level, from_file.level)
        assert from_frame.window_ms == from_file.window_ms


def test_pins_take_waveforms_of_any_kind_from_a_table():
    frame = pandas.read_csv(io.StringIO(PINS))
    named = Trajectory.from_pins(frame)
    waves = [fb.Waveform("sine_20_250"), fb.Waveform("sine_40_100").stimuli()[0]]
    assert_allclose(
        Trajectory.from_pins(frame.assign(stimulus=waves)).pins.depth_um, named.pins.depth_um
    )
    samples = Trajectory.from_pins(frame.drop(columns="stimulus"), named.pins.depth_um)
    assert_allclose(samples.level, named.level)
