"""Paths, pins and ways: tables that are damaged, and numbers that no way has."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

import fembridge as fb
from fembridge.errors import FembridgeError, FembridgeWarning, TableError, UsageError
from fembridge.touching.way import Pins, Way, read_pins

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
        (Way.read, PATH.replace("depth_um", "depth"), 1, "depth.*depth_um"),
        (Way.read, PATH.replace("x_mm", "x_um"), 1, "x_mm"),
        (Way.read, PATH.replace("um\n", "um,force\n").replace("0\n", "0,1\n"), 1, "force_n"),
        (Way.read, PATH.replace("50,", "5_0,"), 3, "5_0"),
        (Way.read, PATH.replace("50,", "\u0665\u0660,"), 3, "time_ms"),
        (Way.read, PATH.replace("300", "1e999"), 3, "1e999"),
        (Way.read, PATH.replace("50,", "0,"), 3, "rise"),
        (read_pins, PINS.replace("diameter_mm", "diameter"), 1, "diameter_mm"),
        (read_pins, PINS.replace("s\n", "s,delay_ms\n").replace("0\n", "0,1\n"), 1, "delay_ms"),
        (read_pins, PINS.replace("1.5", "1_5"), 3, "1_5"),
        (read_pins, PINS.replace("1.5", "1e308"), 3, "x_mm is 1e[+]308"),
        (read_pins, PINS.replace("0.5", "1e308"), 3, "diameter_mm is 1e[+]308"),
        (read_pins, PINS.replace("0.5", "0"), 3, "diameter_mm"),
        (read_pins, PINS.replace("sine_40_100", ""), 3, "stimulus"),
        (read_pins, PINS.replace("sine_40_100", "sine_20"), 3, "12"),
    ],
)  # fmt: skip
def test_a_path_or_pins_with_another_column_or_no_number_name_the_line(
    table, read, text, line, match
):
    with pytest.raises(TableError, match=match) as error:
        read(table(text))
    assert error.value.line == line


@pytest.mark.parametrize(
    ("read", "text", "match"),
    [
        (Way.read, PATH.replace("100,2", "1e308,2"), "time_ms from 0 to 1e[+]308"),
        (Way.read, PATH.replace("100,2", "1e6,2"), "time_ms from 0 to 1e[+]06"),
        (Way.read, "time_ms,x_mm,z_mm,force_n\n0,0,0,1\n0.1,0,0,1\n", "time_ms from 0 to 0.1"),
        (Way.read, PATH.replace("0.25", "1e308"), "x_mm is 0 to 1e[+]308"),
        (Way.read, PATH.replace("-10", "-1e308"), "at least"),
        (Way.read, PATH.replace("300", "1e308"), "at most 2000"),
        (Way.read, PATH.replace("depth_um", "force_n"), "at most 20"),
        (read_pins, PINS.split("\n")[0] + "\n", "0 pins"),
        (read_pins, PINS + "0,0,1,sine_20_250\n" * 2000, "2002 pins"),
    ],
)
def test_a_path_or_pins_beyond_their_ranges_are_refused(table, read, text, match):
    with pytest.raises(UsageError, match=match):
        read(table(text))


@pytest.mark.parametrize(("read", "text"), [(Way.read, PATH), (read_pins, PINS)])
def test_a_path_or_pins_that_may_be_cut_in_the_last_cell_are_named(table, read, text):
    with pytest.warns(FembridgeWarning, match=r"table\.csv: no line end"):
        read(table(text[:-1]))
    read(table(text.replace("\n", "\r\n")))


@pytest.mark.parametrize(("read", "text"), [(Way.read, PATH), (read_pins, PINS)])
def test_a_path_or_pins_that_are_damaged_keep_their_rows_and_columns(table, read, text):
    whole, rng = text.encode(), np.random.default_rng(26)
    undamaged = read(table(whole))
    header = whole.index(b"\n")
    for position in range(len(whole)):
        damaged = bytearray(whole)
        damaged[position] ^= 1 << int(rng.integers(7))
        try:
            way = read(table(bytes(damaged)))
        except (FembridgeError, FembridgeWarning):
            continue
        if way.pins is not None:
            assert len(way.pins.places) == 2
        if position < header:  # refused, or a blank
            assert_allclose(way.pressed, undamaged.pressed)


@pytest.mark.parametrize("number", ODD)
def test_a_way_with_a_number_that_means_nothing_is_refused_from_python(number):
    ones = np.ones(5)
    odd = np.array([0, 1, number, 1, 0])
    for make in (
        lambda: Way.hold(press_um=number),
        lambda: Way.hold(press_n=number),
        lambda: Way.hold(press_um=100, ramp_ms=number),
        lambda: Way.hold(press_um=100, hold_ms=number),
        lambda: Way.slide(number, press_um=100),
        lambda: Way.slide(40, press_um=100, duration_ms=number),
        lambda: Way.slide(40, press_um=100, direction_deg=number),
        lambda: Way.slide(40, press_um=100, start_mm=(number, 0.0)),
        lambda: Way("way", 0.5, (0.0, 2.0), odd),
        lambda: Way("way", 0.5, (0.0, 2.0), ones, x_mm=odd, z_mm=ones),
        lambda: Way("way", 0.5, (0.0, 2.0), ones, x_mm=ones, z_mm=odd),
        lambda: Pins(((0.0, 0.0, 1.0),), odd[:, None]),
        lambda: Pins(((number, 0.0, 1.0),), ones[:, None]),
        lambda: Pins(((0.0, 0.0, number),), ones[:, None]),
        lambda: fb.touch("punch", press_um=100, population="one_each", angle_deg=number),
        lambda: fb.touch("punch", press_um=100, population="one_each", at_mm=(0.0, number)),
        lambda: fb.touch(
            "plate", press_um=100, population="one_each", slide_mm_per_s=40, direction_deg=number
        ),
    ):
        with pytest.raises(UsageError):
            make()


def test_a_way_of_other_shapes_is_refused():
    ones = np.ones(5)
    for make in (
        lambda: Way("way", 0.5, (0.0, 2.0), np.ones(0)),
        lambda: Way("way", 0.5, (0.0, 2.0), ones[:, None]),
        lambda: Way("way", 0.5, (0.0, 2.0), ones, x_mm=ones[1:], z_mm=ones),
        lambda: Way("way", 0.5, (2.0, 2.0), ones),
        lambda: Way("way", 0.5, (math.nan, 2.0), ones),
        lambda: Way("way", 0.5, (0.0, math.inf), ones),
        lambda: Way("way", math.nan, (0.0, 2.0), ones),
        lambda: Way("way", math.inf, (0.0, 2.0), ones),
        lambda: Way("way", -0.5, (0.0, 2.0), ones),
        lambda: Pins((), np.ones((5, 0))),
        lambda: Pins(((0.0, 0.0, 1.0),), np.ones((5, 2))),
    ):
        with pytest.raises(UsageError):
            make()


def test_a_pin_of_the_same_stimulus_has_the_same_waveform(table):
    rows = "".join(f"{0.2 * n:g},0,0.1,sine_20_250\n" for n in range(-20, 20))
    way = read_pins(table(PINS.split("\n")[0] + "\n" + rows))
    assert_allclose(way.pins.depth_um, np.repeat(way.pressed[:, None], 40, axis=1))
