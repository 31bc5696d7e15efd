"""Whole touches and receptive fields: what must be equal by two ways, and larger where."""

import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pandas
import pytest
from matplotlib.figure import Figure
from numpy.testing import assert_allclose

import fembridge as fb
from decks.stimuli import resolve
from decks.synthesis import make_stimulus
from fembridge.errors import (
    FembridgeWarning,
    ResponseError,
    ResultError,
    UsageError,
)
from fembridge.response.response_map import FOLDER, read_map
from fembridge.results.von_mises import von_mises_pa as tensor_von_mises
from fembridge.touching.contact import press_to
from fembridge.touching.pad_file import resolve_pad
from fembridge.touching.population import Population
from fembridge.touching.receptive_field import _Probe, hot_spot_counts
from fembridge.touching.shape import Shape, resolve_shape
from fembridge.touching.stress import SA_NU, driving_stress_pa, sa_stress_pa
from fembridge.touching.touch import touch_skin
from fembridge.touching.trajectory import Trajectory
from neural import parameter_set

PAD = resolve_pad("reference")
FITTED = parameter_set("fitted")
ONE = Population.one_each()
BRIEF = Trajectory.press(press_um=200, hold_ms=5)


def way(word, preindent_um=75.0):
    [entry] = resolve([word])
    return Trajectory.from_waveform(make_stimulus(entry, preindent_um=preindent_um))


def touch_pins(wave, *x_mm):
    """Pins of 1 mm side by side, all with one waveform."""
    table = pandas.DataFrame({"x_mm": x_mm, "z_mm": 0.0, "diameter_mm": 1.0})
    depth_um = np.repeat(wave.level[:, None], len(x_mm), 1)
    pins = Trajectory.from_pins(table, depth_um, dt_ms=wave.dt_ms)
    return touch_skin(PAD, None, pins, ONE, FITTED)


def test_depths_solved_once_answer_as_every_sample_solved_alone():
    """A pin by levels of depth, and as an array of one pin by samples."""
    wave = way("sine_20_129.49")
    by_level = touch_skin(PAD, Shape.punch(1.0), wave, ONE, FITTED)
    by_sample = touch_pins(wave, 0.0)
    scale = by_level.stress_pa.max(axis=0)
    assert np.abs(by_level.stress_pa - by_sample.stress_pa).max(axis=0) == pytest.approx(
        0, abs=0.01 * scale.max()
    )
    assert_allclose(by_level.force_n, by_sample.force_n, atol=0.01 * by_level.force_n.max())


def test_pins_far_apart_do_not_know_of_each_other_and_near_ones_share():
    wave = way("sine_20_129.49")
    alone, near, far = (
        touch_pins(wave, *x_mm).force_n.max() for x_mm in ((0.0,), (-1.0, 1.0), (-3.5, 3.5))
    )
    assert near < 1.9 * alone
    assert far > near


def test_a_plate_that_slides_without_friction_is_a_plate_at_rest():
    units = Population.line(step_mm=1.0, half_length_mm=3.0)
    slid = touch_skin(
        PAD, Shape.plate(), Trajectory.slide(40.0, press_um=200, duration_ms=50), units, FITTED,
        friction=0.0,
    )  # fmt: skip
    held = touch_skin(PAD, Shape.plate(), Trajectory.press(press_um=200), units, FITTED)
    assert_allclose(slid.stress_pa[50], held.stress_pa[500], rtol=1e-3)
    assert np.ptp(slid.stress_pa, axis=0).max() <= 1e-4 * slid.stress_pa.max()


@pytest.mark.parametrize("way_mm", [0.0, 0.02])
def test_a_path_that_hardly_moves_still_presses_as_its_depth_says(tmp_path, way_mm):
    path = tmp_path / "path.csv"
    path.write_text(
        f"time_ms,x_mm,z_mm,depth_um\n0,0,0,100\n50,0,{way_mm / 2},300\n100,0,{way_mm},0\n"
    )
    slow = touch_skin(PAD, Shape.punch(1.0), Trajectory.from_table(path), ONE, FITTED, friction=0.0)
    held = touch_skin(PAD, Shape.punch(1.0), Trajectory.press(press_um=300), ONE, FITTED)
    depth_um = [100.0, 200.0, 300.0, 0.0]
    assert_allclose(slow.depth_um[[0, 50, 100, 200]], depth_um, atol=0.1)
    n_at = np.interp(depth_um, held.depth_um[:200], held.force_n[:200])
    assert_allclose(slow.force_n[[0, 50, 100, 200]], n_at, rtol=0.06, atol=1e-6)


def test_a_path_is_the_slide_that_it_describes(tmp_path):
    path = tmp_path / "path.csv"
    path.write_text("time_ms,x_mm,z_mm,depth_um\n0,0,2,150\n100,0,-2,150\n")
    slide = Trajectory.slide(40.0, press_um=150, duration_ms=100)
    ball = Shape.sphere(3.0)
    results = [
        touch_skin(PAD, shape, trajectory, ONE, FITTED)
        for shape, trajectory in (
            (ball.moved(0.0, 2.0), slide),
            (ball, Trajectory.from_table(path)),
        )
    ]
    assert_allclose(results[0].stress_pa, results[1].stress_pa, rtol=1e-3, atol=1.0)
    turned = tmp_path / "turned.csv"
    turned.write_text("time_ms,x_mm,z_mm,depth_um\n0,0,2,150\n50,0,0,150\n100,2,0,150\n")
    curved = touch_skin(PAD, Shape.sphere(3.0), Trajectory.from_table(turned), ONE, FITTED)
    assert_allclose(curved.stress_pa[:60], results[1].stress_pa[:60], rtol=0.05, atol=200.0)


def test_friction_shears_the_skin_to_the_other_side_when_the_way_is_turned():
    units = Population.line(step_mm=1.0, half_length_mm=4.0, along="z").with_endings(0.0)
    there, back = (
        touch_skin(
            PAD, Shape.plate(),
            Trajectory.slide(20.0, press_um=300, duration_ms=20, direction_deg=angle),
            units, FITTED,
        )
        for angle in (90.0, -90.0)
    )  # fmt: skip
    of_class = len(units) // 3
    for first in range(0, len(units), of_class):
        mine = slice(first, first + of_class)
        assert_allclose(there.stress_pa[10, mine], back.stress_pa[10, mine][::-1], rtol=1e-3)


def test_rates_count_the_spikes_of_the_window():
    result = fb.touch("sphere:diameter_mm=6", press_n=0.1, population="line:step_mm=1", trials=3)
    counts = result.spikes.groupby("unit").size().reindex(list(result.population.unit)).fillna(0)
    seconds = (result.trajectory.window_ms[1] - result.trajectory.window_ms[0]) / 1000
    assert_allclose(result.rates["rate_ips"], counts.to_numpy() / seconds / 3)
    assert set(result.spikes["trial"]) == {1, 2, 3}
    assert_allclose(result.force_n.max(), 0.1, rtol=1e-6)
    assert result.spikes["spike_time_ms"].gt(0).all()
    assert (
        result.contact.nodes.x_mm.size
        == result.contact.forces_n.shape[1]
        <= PAD.skin_nodes().x_mm.size
    )


SLIDE = Trajectory.slide(20, press_um=100, duration_ms=50)
WAVE = {"stimulus": "sine_20_250"}


@pytest.mark.parametrize(
    ("arguments", "argument"),
    [
        ({}, "trajectory"),
        ({"press_um": 100, "press_n": 1.0}, "press_n"),
        ({"press_um": 100, "stimulus": "sine_20_250"}, "press_um"),
        ({"press_um": 100, "trajectory": SLIDE}, "press_um"),
        ({"trajectory": "slide"}, "trajectory"),
        ({"stimulus": "sine_20"}, "stimulus"),
        ({"press_um": 100, "seed": -1}, "seed"),
        ({"press_um": 100, "seed": 1.5}, "seed"),
        ({"press_um": 100, "trials": 0}, "trials"),
        ({"press_um": 100, "trials": 2.5}, "trials"),
        ({"press_um": 100, "noise_mv": "much"}, "noise_mv"),
        ({"press_um": 100, "noise_mv": -1.0}, "noise_mv"),
        ({**WAVE, "preindent_um": 1e9}, "preindent_um"),
        ({**WAVE, "preindent_um": np.nan}, "preindent_um"),
        ({"press_um": 100, "preindent_um": 10}, "preindent_um"),
        ({"trajectory": SLIDE, "preindent_um": 10}, "preindent_um"),
        *(
            ({"trajectory": SLIDE, "friction": friction}, "friction")
            for friction in (np.nan, np.inf, 1e308, -0.1)
        ),
        ({"press_um": 100, "friction": 0.4}, "friction"),
        ({**WAVE, "friction": 0.4}, "friction"),
        ({"press_um": 100, "population": 3}, "population"),
        ({"press_um": 100, "pad": 3}, "pad"),
        ({"press_um": 100, "pad": "nobody"}, "pad"),
    ],
)
def test_an_argument_that_is_wrong_or_unused_is_named(arguments, argument):
    with pytest.raises(UsageError) as error:
        fb.touch("punch", **{"population": "one_each", **arguments})
    assert error.value.argument == argument


@pytest.mark.parametrize(
    ("unused", "argument"),
    [({"shape": "bar"}, "shape"), ({"at_mm": (1, 0)}, "at_mm"), ({"angle_deg": 5}, "angle_deg")],
)
def test_pins_have_no_shape_besides(unused, argument):
    table = pandas.DataFrame({"x_mm": [0.0], "z_mm": [0.0], "diameter_mm": [1.0]})
    pins = Trajectory.from_pins(table, np.full((100, 1), 50.0))
    with pytest.raises(UsageError) as error:
        fb.touch(trajectory=pins, population="one_each", **unused)
    assert error.value.argument == argument


@pytest.mark.parametrize(
    ("sizes", "argument"), [({}, "pixel_mm"), ({"pixel_mm": 1.0, "relief_mm": 0.5}, "relief_mm")]
)
def test_a_height_map_needs_its_pixel_and_a_table_of_heights_no_relief(tmp_path, sizes, argument):
    (tmp_path / "map.csv").write_text("0,1\n1,0\n")
    with pytest.raises(UsageError) as error:
        resolve_shape(str(tmp_path / "map.csv"), **sizes)
    assert error.value.argument == argument


def test_a_force_that_is_too_large_and_a_shape_beside_the_pad_are_refused():
    with pytest.raises(UsageError) as error:
        fb.touch(press_n=19.0, population="one_each")
    assert "4000 um" in error.value.expected
    with pytest.raises(UsageError, match="beside the pad"):
        fb.touch(press_um=100, at_mm=(30.0, 0.0), population="one_each")


# ---- One rule of pre-indentation, and parameters of other mechanics


def test_a_waveform_is_preindented_by_one_rule_in_every_form(tmp_path):
    """A Stimulus, an array, a table, a file and a trajectory of one waveform give one touch."""
    depth_um = 100 * np.sin(np.pi * np.arange(101) / 100) ** 2
    wave = fb.Waveform(depth_um, dt_ms=0.5, name="wave")
    table = pandas.DataFrame({"time_ms": 0.5 * np.arange(101), "displacement_um": depth_um})
    table.to_csv(tmp_path / "wave.csv", index=False)
    [stimulus] = wave.stimuli()
    forms = [{"stimulus": form} for form in (stimulus, wave, table, str(tmp_path / "wave.csv"))] + [
        {"trajectory": Trajectory.from_waveform(stimulus)}
    ]
    touches = [fb.touch(population="one_each", **form) for form in forms]
    for touched in touches:
        assert touched.trajectory.preindent_um == 75.0
        assert_allclose(touched.depth_um, 75.0 + depth_um, atol=1e-5)
    with pytest.warns(FembridgeWarning, match="here: 10 um"):
        explicit = fb.touch(stimulus=wave, preindent_um=10.0, population="one_each")
    assert_allclose(explicit.depth_um, 10.0 + depth_um, atol=1e-5)
    [deeper] = wave.stimuli(preindent_um=20.0)
    with pytest.warns(FembridgeWarning, match="here: 20 um"):
        kept = fb.touch(stimulus=deeper, preindent_um=20.0, population="one_each")
    assert_allclose(kept.depth_um, 20.0 + depth_um, atol=1e-5)


def test_pins_are_preindented_by_the_same_rule():
    table = pandas.DataFrame({"x_mm": [0.0, 1.5], "z_mm": 0.0, "diameter_mm": 1.0})
    depth_um = np.stack([np.linspace(0, 100, 201), np.full(201, 50.0)], -1)
    touched = fb.touch(trajectory=Trajectory.from_pins(table, depth_um), population="one_each")
    assert_allclose(touched.trajectory.pins.depth_um, depth_um + np.array([75.0, 0.0]), atol=1e-5)
    named = Trajectory.from_pins(table.assign(stimulus="sine_20_250"), preindent_um=75.0)
    later = Trajectory.from_pins(table.assign(stimulus="sine_20_250")).preindented(75.0)
    assert_allclose(named.pins.depth_um, later.pins.depth_um, atol=1e-5)


def test_parameters_of_other_mechanics_warn_in_a_touch_and_in_a_field():
    with pytest.warns(FembridgeWarning, match="fitted was fitted"):
        fb.touch("punch", BRIEF, parameters="fitted", population="one_each")
    with pytest.warns(FembridgeWarning, match="fitted was fitted"):
        fb.receptive_field("SA", depth_um=[200], step_mm=2.0, parameters="fitted")
    with pytest.warns(FembridgeWarning, match="pre-indentation of 75 um"):
        fb.touch(**WAVE, preindent_um=10.0, population="one_each")


# ---- The result as an object and as files


@pytest.mark.parametrize("kind", ["press", pytest.param("slide", marks=pytest.mark.slow), "pins"])
def test_a_touch_is_read_back_as_it_was_written(tmp_path, kind):
    table = pandas.DataFrame({"x_mm": [0.0, 1.5], "z_mm": 0.0, "diameter_mm": 1.0})
    table["stimulus"] = ["sine_20_250", "sine_40_100"]
    trajectory = {
        "press": BRIEF,
        "slide": Trajectory.slide(40, press_n=0.1, duration_ms=60),
        "pins": Trajectory.from_pins(table),
    }[kind]
    units = Population.line(step_mm=1.0).with_endings(0.5, sa_von_mises=True)
    touched = fb.touch(trajectory=trajectory, population=units, trials=2, noise_mv=0.5, seed=4)
    touched.write(tmp_path / "touch")
    again = fb.Touch.read(tmp_path / "touch")
    for name in ("rates", "spikes", "samples"):
        pandas.testing.assert_frame_equal(getattr(again, name), getattr(touched, name))
    assert again.provenance == touched.provenance
    assert_allclose(again.stress_of([0, 3]), touched.stress_of([0, 3]), rtol=1e-12)
    again.write(tmp_path / "again")
    for path in (tmp_path / "touch").glob("*.csv"):
        assert path.read_bytes() == (tmp_path / "again" / path.name).read_bytes()


def test_files_of_another_touch_are_refused(tmp_path):
    for folder, depth_um in (("a", 100), ("b", 200)):
        fb.touch(press_um=depth_um, population="one_each").write(tmp_path / folder)
    whole = (tmp_path / "a" / "contact.npz").read_bytes()
    (tmp_path / "a" / "contact.npz").write_bytes((tmp_path / "b" / "contact.npz").read_bytes())
    with pytest.raises(ResultError) as error:
        fb.Touch.read(tmp_path / "a")
    assert error.value.path == tmp_path / "a" / "contact.npz"
    (tmp_path / "a" / "contact.npz").write_bytes(whole[:200])
    with pytest.raises(ResultError):
        fb.Touch.read(tmp_path / "a")
    with pytest.raises(ResponseError):
        fb.Touch.read(tmp_path / "b", pad="plane")
    (tmp_path / "b" / "touch.toml").write_text("trials = 1\n")
    with pytest.raises(ResultError) as error:
        fb.Touch.read(tmp_path / "b")
    assert error.value.path == tmp_path / "b" / "touch.toml"


def test_the_record_of_a_touch_names_all_of_its_inputs():
    touched = fb.touch("bar:width_mm=2", press_um=100, at_mm=(0.0, 1.0), population="one_each")
    record = touched.provenance
    assert record["shape"] == {"name": "bar 2 x 10 mm", "x_mm": 0.0, "z_mm": 1.0, "angle_deg": 0.0}
    assert record["trajectory"]["hold_ms"] == 500.0 and record["trajectory"]["control"] == "depth"
    assert record["pad"]["source"] == "reference" and len(record["pad"]["sha256"]) == 64
    assert record["parameter_set"] == "fitted_pad" and record["population"]["units"] == 3
    other = fb.touch("bar:width_mm=2", press_um=101, population="one_each").provenance
    assert other["trajectory"]["sha256"] != record["trajectory"]["sha256"]
    assert other["population"] == record["population"]


def test_a_touch_and_a_field_are_shown_in_a_few_lines():
    touched = fb.touch(press_um=100, population="line:step_mm=2")
    assert len(repr(touched).splitlines()) <= 5 and "RA" in repr(touched)
    assert "<img" in touched._repr_html_()
    field = fb.receptive_field("SA", depth_um=[200], step_mm=2.0)
    assert len(repr(field).splitlines()) <= 5 and "<img" in field._repr_html_()


def test_a_field_is_read_back_as_it_was_written(tmp_path):
    """Also the least sensitive units, ten times whose threshold is too deep."""
    field = fb.receptive_field(
        "RA", units=31, depth_um=[100, 300], times_threshold=[10.0], step_mm=2.0
    )
    assert np.isnan(field.depth_um).any()
    field.write(tmp_path)
    again = fb.ReceptiveField.read(tmp_path)
    for name in ("summary", "areas", "units"):
        pandas.testing.assert_frame_equal(getattr(again, name), getattr(field, name))
    pandas.testing.assert_frame_equal(again.to_frame(), field.to_frame())
    assert np.array_equal(again.impulses, field.impulses)
    assert again.provenance == field.provenance
    with pytest.raises(UsageError) as error:
        fb.ReceptiveField.read(tmp_path, "SA")
    assert error.value.argument == "afferent"
    maps = tmp_path / "fields.csv"
    maps.write_text(maps.read_text() + "RA1,RA,100.0,0.3,0.0,1\n")
    with pytest.raises(ResultError) as error:
        fb.ReceptiveField.read(tmp_path)
    assert error.value.line == len(maps.read_text().splitlines())


def test_a_plane_pad_answers_a_cylinder_as_the_response_map_of_the_ridged_section():
    """CalculiX' contact and large strain on the mesh ``quick``, beside superposed unit forces."""
    depth_um = np.array([50.0, 100.0, 200.0])
    known = read_map(FOLDER / "quick.toml")
    units = Population.at(
        [str(place.afferent) for place in known.places],
        np.array([place.x_mm for place in known.places]), np.zeros(3),
    )  # fmt: skip
    units = replace(units, endings_mm=0.0, sa_von_mises=True)
    nodes, forces, _ = press_to(resolve_pad("plane"), Shape.cylinder(1.0), depth_um)
    stress = driving_stress_pa(resolve_pad("plane"), nodes, forces, units)
    ratio = stress / tensor_von_mises(known.tensors(depth_um))
    names = list(units.afferent)
    for name, least, most in (("SA", 0.98, 1.02), ("RA", 1.1, 1.2), ("PC", 1.0, 1.16)):
        mine = ratio[:, names.index(name)]
        assert least < mine.min() and mine.max() < most, (name, mine)


def test_what_touches_a_plane_pad_is_endless_and_forces_are_by_millimetre():
    """Beside a long cylinder on the prism, as far as ridges leave the deep afferent alone."""
    one = touch_skin(
        resolve_pad("plane"), Shape.cylinder(1.0), Trajectory.press(press_um=200), ONE, FITTED
    )
    units = Population.line(step_mm=3.0, half_length_mm=3.0, afferents=("PC",))
    rod = Shape("rod", lambda x, z: Shape.cylinder(1.0).height_mm(x, z) - z**2 / 40.0)
    with pytest.warns(FembridgeWarning, match="z = 12 mm"):
        whole = touch_skin(PAD, rod, Trajectory.press(press_um=200), units, FITTED)
    assert_allclose(whole.stress_pa.max(axis=0)[1], one.stress_pa.max(axis=0)[2], rtol=0.02)
    at = whole.contact.forces_n[whole.contact.hardest]
    middle = np.abs(whole.contact.nodes.z_mm) < 2.1
    per_mm = at[middle].sum() / (np.unique(whole.contact.nodes.z_mm[middle]).size * PAD.spacing_mm)
    assert_allclose(per_mm, one.force_n.max(), rtol=0.06)


def test_a_shape_that_never_touches_leaves_the_skin_at_rest():
    lifted = Trajectory(-np.ones(101), name="lifted")
    held = touch_skin(PAD, Shape.punch(1.0), lifted, ONE, FITTED)
    assert not held.stress_pa.any() and not held.force_n.any() and not held.fired.time_ms.size


@pytest.mark.parametrize("ridges", ["none", "loop"])
@pytest.mark.parametrize(
    "trajectory",
    [
        Trajectory.press(press_um=0, hold_ms=5),
        Trajectory.press(press_n=0, hold_ms=5),
        Trajectory.slide(40, press_n=0, duration_ms=20),
        Trajectory(depth_um=-np.ones(40), x_mm=0.02 * np.arange(40), z_mm=np.zeros(40)),
    ],
)
def test_a_touch_of_nothing_has_no_force_and_no_spikes(trajectory, ridges, tmp_path):
    touched = fb.touch("sphere", trajectory, population="one_each", ridges=ridges)
    assert not touched.force_n.any() and not touched.stress_pa.any()
    assert not touched.fired.time_ms.size
    touched.write(tmp_path)
    assert not fb.Touch.read(tmp_path).force_n.any()


def test_a_path_beside_the_pad_touches_nothing():
    path = Trajectory(depth_um=50 * np.ones(40), x_mm=0.02 * np.arange(40), z_mm=np.zeros(40))
    touched = fb.touch("punch", path, at_mm=(30.0, 0.0), population="one_each")
    assert not touched.force_n.any() and not touched.fired.time_ms.size


@pytest.mark.slow
def test_a_height_map_that_slides_away_says_when_it_ends():
    """Half of 8 mm at 80 mm/s from the middle of the pad, which is where it was pressed."""
    heights = np.zeros((80, 80))
    slide = Trajectory.slide(80, press_um=200, duration_ms=80)
    with pytest.warns(FembridgeWarning, match=r"ends after (49|5\d)"):
        fb.touch(Shape.from_heights(heights, 0.1), slide, population="one_each")
    endless = Shape.from_heights(heights, 0.1, tile=True)
    touched = fb.touch(endless, slide, population="one_each")
    assert touched.provenance["warnings"] == []
    plate = fb.touch("plate", slide, population="one_each")
    assert_allclose(touched.force_n, plate.force_n, rtol=1e-3)
    heavy = Trajectory.slide(80, press_n=0.2, duration_ms=200)
    with pytest.raises(UsageError, match="ends after 50") as error:
        fb.touch(Shape.from_heights(heights, 0.1), heavy, population="one_each")
    assert error.value.argument == "trajectory"


def test_contact_at_the_end_of_the_skin_warns_with_its_place():
    tilted = Shape("tilted plate", lambda x, z: np.clip(6.4 - x, 0.0, 13.0) + 0.0 * z)
    brief = Trajectory.press(press_um=200, hold_ms=20)
    with pytest.warns(FembridgeWarning, match="x = 6.33 mm"):
        wide = touch_skin(PAD, tilted, brief, ONE, FITTED)
    assert "6.33 mm" in wide.provenance["warnings"][0]
    with pytest.warns(FembridgeWarning, match="z = 12 mm"):
        touch_skin(PAD, Shape.sphere().moved(0.0, 14.0), brief, ONE, FITTED)
    near = touch_skin(PAD, Shape.punch(1.0), brief, ONE, FITTED)
    assert near.provenance["warnings"] == []


@pytest.mark.parametrize(
    ("shape", "width"),
    [
        ("grating:groove_mm=0.4,ridge_mm=0.4", 0.4),
        ("grating:groove_mm=0.4", 0.4),
        ("bar:width_mm=0.3", 0.3),
        ("punch:diameter_mm=0.4", 0.4),
        ("dots:diameter_mm=0.3", 0.3),
    ],
)
@pytest.mark.parametrize("angle_deg", [pytest.param(0.0, marks=pytest.mark.slow), 33.0])
def test_parts_narrower_than_the_nodes_resolve_warn(shape, width, angle_deg):
    """Flat parts and the grooves between them, however they are turned."""
    brief = {"trajectory": BRIEF, "population": "one_each", "ridges": "none"}
    with pytest.warns(FembridgeWarning, match="resolve 0.44 mm") as warned:
        fb.touch(shape, angle_deg=angle_deg, at_mm=(0.05, 0.13), **brief)
    [stated] = re.findall(r"about (\S+) mm wide", str(warned[0].message))
    assert float(stated) == pytest.approx(width, abs=0.06)
    assert warned[0].filename == __file__


@pytest.mark.parametrize(
    "shape",
    [
        *("punch:diameter_mm=0.5", "letters:text=R"),
        *(
            pytest.param(shape, marks=pytest.mark.slow)
            for shape in (
                *("punch", "sphere:diameter_mm=1", "cylinder:diameter_mm=1", "plate", "edge"),
                *("bar", "bar:width_mm=0.5", "grating", "dots", "braille:text=b"),
            )
        ),
    ],
)
def test_shapes_that_the_nodes_resolve_do_not_warn(shape):
    for place, press_um in (((0.0, 0.0), 50), ((0.06, 0.11), 700)):
        trajectory = Trajectory.press(press_um, hold_ms=5)
        brief = {"trajectory": trajectory, "population": "one_each"}
        touched = fb.touch(shape, at_mm=place, angle_deg=20.0, **brief)
        assert touched.provenance["warnings"] == []


def test_a_height_map_with_narrow_parts_warns(tmp_path):
    """Stripes 0.4 mm wide of pixels of 0.1 mm, and points of one pixel, high as they are wide."""
    stripes = np.tile(np.repeat([0.0, 0.5], 4), 5)[:, None] + np.zeros(40)
    points = np.zeros((40, 40))
    points[::6, ::6] = 0.5
    for heights in (stripes, points):
        np.savetxt(tmp_path / "map.csv", heights, delimiter=",")
        with pytest.warns(FembridgeWarning, match="resolve 0.44 mm"):
            fb.touch(
                Shape.read(tmp_path / "map.csv", 0.1), BRIEF, population="one_each", ridges="none"
            )


@pytest.mark.parametrize(
    ("shape", "press", "words"),
    [
        ("sphere", {"press_um": 1100}, "1100 um deep"),
        pytest.param("braille:text=b", {"press_n": 0.4}, "um deep", marks=pytest.mark.slow),
    ],
)
def test_more_than_a_millimetre_deep_warns_with_the_depth(shape, press, words):
    with pytest.warns(FembridgeWarning, match=words):
        fb.touch(shape, Trajectory.press(**press, hold_ms=5), population="one_each")


def test_a_field_warns_once_of_its_depth_and_its_probe():
    with pytest.warns(FembridgeWarning) as warned:
        fb.receptive_field("SA", probe_diameter_mm=0.3, depth_um=[200, 1500], step_mm=2.0)
    assert len(warned) == 2
    assert {str(each.message).split()[0] for each in warned} == {"1500", "punch"}


@pytest.mark.slow
def test_pictures_are_drawn_by_name_on_own_axes_and_others_refused():
    touched = fb.touch("punch", Trajectory.press(200, hold_ms=50), population="one_each")
    panels = {"pad": (3, 4), "raster": (4,), "psth": (3,), "isi": (3,), "force": (1,)}
    for kind, counts in panels.items():
        touched.plot(kind).draw_without_rendering()
        for count in counts:
            figure = Figure()
            axes = [figure.add_subplot(1, count, n + 1) for n in range(count)]
            assert touched.plot(kind, axes) is figure
            assert all(panel.has_data() for panel in axes)
        with pytest.raises(UsageError) as error:
            touched.plot(kind, Figure().subplots(1, 7))
        assert error.value.argument == "ax"
    field = fb.receptive_field("SA", units=3, depth_um=[200], step_mm=1.0)
    for kind, count in (("field", 5), ("area", 1)):
        field.plot(kind).draw_without_rendering()
        field.plot(kind, Figure().subplots(1, count)).draw_without_rendering()
    for result in (touched, field):
        with pytest.raises(UsageError) as error:
            result.plot("map")
        assert error.value.argument == "kind"


def test_a_unit_feels_by_the_ending_that_is_driven_most_times_its_sensitivity():
    """Against points at the places of the endings, one by one."""
    way, bar = Trajectory.press(press_um=300, hold_ms=20), Shape.bar(1.0, 6.0).moved(0.0, 1.3)
    units = Population.line(step_mm=1.0, half_length_mm=2.0)
    branched = touch_skin(PAD, bar, way, units, FITTED).stress_pa[140]
    unit, x_mm, z_mm, sensitivity = units.endings()
    classes = np.array(units.afferent)[unit].tolist()
    points = replace(Population.at(classes, x_mm, z_mm), endings_mm=0.0)
    felt = touch_skin(PAD, bar, way, points, FITTED).stress_pa[140] * sensitivity
    expected = [felt[unit == row].max() for row in range(len(units))]
    assert_allclose(branched, expected, rtol=1e-3)
    assert (branched[:5] > 1.05 * felt[sensitivity == 1][:5]).any()  # by another than the middle
    with pytest.raises(UsageError, match="endings_mm"):
        replace(ONE, endings_mm=9.0)


def test_the_pin_of_the_fit_drives_the_middle_ending_most():
    """So rates under it are those that parameters are fitted to, whatever the other endings are."""
    names = [str(number) for number in range(300)]
    for name in ("SA", "RA"):
        units = Population.at([name] * 300, np.zeros(300), np.zeros(300), unit=names)
        pressed = press_to(PAD, Shape.punch(1.0), np.array([20.0, 100.0, 325.0, 600.0]))[:2]
        stress, alone = (
            driving_stress_pa(PAD, *pressed, each) for each in (units, units.with_endings(0.0))
        )
        assert_allclose(stress, alone, rtol=1e-5)


@pytest.mark.slow
def test_sa_fires_at_edges_several_times_more_than_on_plateaus_and_not_in_gaps_or_beside():
    """Single endings; and under the pin of the fit a unit answers as to von Mises stress."""
    parameters = parameter_set("fitted_pad")
    units = Population.line(step_mm=0.5, half_length_mm=4.0, afferents=("SA",))
    by_mises = replace(units, sa_von_mises=True)
    pin = Shape.punch(1.0), way("sine_20_129.49")
    here = np.flatnonzero(units.z_mm == 0)
    one, other = (touch_skin(PAD, *pin, each, parameters) for each in (units, by_mises))
    assert_allclose(one.stress_pa[:, here], other.stress_pa[:, here], rtol=0.1, atol=200.0)
    assert_allclose(one.rate_ips[here], other.rate_ips[here], atol=5.0)

    def rates(shape, units):
        held = touch_skin(PAD, shape, Trajectory.press(press_um=1000), units, parameters)
        return held.rate_ips

    after = units[units.z_mm >= 0]
    points, grating = after.with_endings(0.0), Shape.grating(3.0, 4.0, 2.0)
    bar, gap = rates(Shape.bar(4.0, 14.0), points), rates(grating, points)
    # Beside a bar and in a gap a unit fires a few times while the shape comes.
    assert bar[3:6].max() > 1.6 * bar[:2].mean() > 16 and bar[7:].max() < 9
    assert gap[0] < 11 and gap[3:5].min() > 1.25 * gap[6:8].mean() > 16
    # Fibres reach from the middle of a gap to its edges: their mean there is a third of it.
    classes = ["SA"] * 12 * len(after)
    fibres = Population.at(classes, np.tile(after.x_mm, 12), np.tile(after.z_mm, 12))
    gap = rates(grating, fibres).reshape(12, -1).mean(axis=0)
    assert gap[0] < 0.5 * gap[3]


def test_what_sa_reads_is_pressure_and_a_share_of_tension_along_the_skin():
    rng = np.random.default_rng(3)
    influence, forces = rng.normal(size=(6, 5, 4)), rng.uniform(size=(3, 4))
    normal = rng.normal(size=(5, 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    found = sa_stress_pa(influence, forces, normal)
    for s in range(3):
        for u in range(5):
            xx, yy, zz, xy, yz, zx = influence[:, u] @ forces[s]
            tensor = np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]])
            n = normal[u]
            along = n @ tensor @ n
            read = SA_NU * (np.trace(tensor) - along) - along
            assert_allclose(found[s, u], max(read, 0.0), rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize(
    "name", ["PC", *(pytest.param(each, marks=pytest.mark.slow) for each in ("SA", "RA"))]
)
def test_a_field_grows_with_depth_around_the_afferent(name):
    field = fb.receptive_field(
        name, units=3, depth_um=[100, 200, 400], times_threshold=[], step_mm=0.5
    )
    areas = field.areas["area_mm2"].to_numpy().reshape(3, 3)
    assert (np.diff(areas, axis=1) >= 0).all() and areas[1, -1] > 0
    assert (np.diff(areas, axis=0) <= 0).all() or name != "PC"  # alike but for sensitivity
    assert (np.diff(field.threshold_um) > 0).all() and field.threshold_um[1] < 400
    for impulses in field.impulses[:2, -1]:
        hot = np.argwhere(impulses == impulses.max())
        assert np.hypot(field.x_mm[hot[:, 0]], field.z_mm[hot[:, 1]]).min() <= 0.5


def test_a_single_ending_has_a_field_that_is_its_own_mirror_image():
    field = fb.receptive_field(
        "SA", units=1, depth_um=[400], times_threshold=[], step_mm=0.5, endings_mm=0.0
    )
    assert_allclose(field.impulses, field.impulses[..., ::-1])
    assert_allclose(field.impulses, field.impulses[:, :, ::-1])
    assert field.hot_spots.tolist() == [1]


@pytest.mark.slow
def test_a_threshold_is_where_the_first_impulse_is():
    field = fb.receptive_field("SA", units=3, depth_um=[100], step_mm=0.5)
    for share, is_reached in ((0.98, False), (1.02, True)):
        depth_um = (share * field.threshold_um).tolist()
        again = fb.receptive_field("SA", units=3, depth_um=depth_um, step_mm=0.5)
        areas = again.areas["area_mm2"].to_numpy().reshape(3, -1)
        assert (np.diag(areas) > 0).tolist() == [is_reached] * 3
    # The force of the probe there, and units that differ in sensitivity alone.
    _, forces, _ = press_to(PAD, Shape.punch(0.5), field.threshold_um)
    assert_allclose(field.threshold_mn, 1e3 * forces.sum(axis=1), rtol=0.02)
    spread = parameter_set("fitted_pad").parameters["SA"].spread
    assert_allclose(
        np.log(field.threshold_um), np.log(field.threshold_um[1]) + spread * field.deviate, atol=0.1
    )


def test_a_multiple_of_threshold_is_a_depth_of_each_unit_or_too_deep():
    field = fb.receptive_field("RA", units=3, depth_um=[], times_threshold=[2.0, 22.0], step_mm=1.0)
    assert_allclose(field.depth_um[:, 0], 2 * field.threshold_um)
    assert np.isnan(field.depth_um[-1, 1]) and np.isnan(field.areas["area_mm2"].iloc[-1])
    assert_allclose(field.depth_um[:2, 1], 22 * field.threshold_um[:2])


@pytest.mark.slow
def test_fields_at_a_multiple_of_threshold_are_about_as_large_as_in_man():
    """Medians of Vallbo & Johansson 1980 at 4 to 5 times threshold: SA 11.0, RA 12.6 mm2."""
    shared = {"units": 15, "depth_um": [], "times_threshold": [4.5], "step_mm": 0.38}
    for name, low, high in (("SA", 0.6 * 11.0, 11.0), ("RA", 0.8 * 12.6, 1.2 * 12.6)):
        branched = fb.receptive_field(name, **shared).summary.set_index("quantity")["median"]
        assert low < branched["area_mm2 at 4.5 x threshold"] < high
        assert 3 <= branched["hot_spots"] <= 7
    point = fb.receptive_field("RA", **shared, endings_mm=0.0).summary.set_index("quantity")[
        "median"
    ]
    assert 1.4 * point["area_mm2 at 4.5 x threshold"] < branched["area_mm2 at 4.5 x threshold"]
    assert_allclose(branched["threshold_um"], point["threshold_um"], rtol=0.05)


@pytest.mark.slow
def test_few_traces_give_the_field_that_every_trace_gives(monkeypatch):
    for name, tolerance in (("SA", 0.0), ("PC", 0.02)):
        shared = {"units": 2, "depth_um": [200, 400], "times_threshold": [], "step_mm": 0.5}
        few = fb.receptive_field(name, **shared, probe_diameter_mm=1.0)
        with monkeypatch.context() as patched:
            patched.setattr("fembridge.touching.receptive_field._TRACES", 10**9)
            patched.setattr("fembridge.touching.receptive_field._LEAST_DRIVE", 1e-6)
            every = fb.receptive_field(name, **shared, probe_diameter_mm=1.0)
        areas = every.areas["area_mm2"].to_numpy()
        assert_allclose(few.areas["area_mm2"], areas, rtol=tolerance, atol=1e-9)
        inside = every.responds
        assert np.abs(few.impulses - every.impulses)[inside].mean() < 0.15


@pytest.mark.slow
def test_probes_around_that_hold_the_skin_make_a_step_of_the_probe_stronger():
    """The contact of all pins at once, by the heights of their ends."""
    background_um, step_um, pixel_mm = 400.0, 60.0, 0.05
    probe = _Probe(PAD, 0.5, np.array([0.0, step_um]), background_um, 1.0)
    units = Population.one_each(afferents=("SA",)).with_endings(0.0)
    drive_pa, force_n = probe.drive(units, np.array([0.0, 1.0]), np.array([0.0, 1.0]))
    axis = np.arange(-160, 161) * pixel_mm
    x_mm, z_mm = np.meshgrid(axis, axis)
    pins = np.hypot(x_mm - np.round(x_mm), z_mm - np.round(z_mm)) <= 0.25 + 1e-6
    stress, total_n = [], []
    for raised_mm in (0.0, 1e-3 * step_um):
        heights = np.where(pins, 0.0, -1.5)
        heights[pins & (np.hypot(x_mm, z_mm) < 0.5)] = raised_mm
        shape = Shape.from_heights(heights[::-1], pixel_mm)
        depth_um = np.array([background_um + 1e3 * raised_mm])
        nodes, forces, _ = press_to(PAD, shape, depth_um)
        stress.append(driving_stress_pa(PAD, nodes, forces, units)[0, 0])
        total_n.append(forces.sum())
    assert_allclose(drive_pa[1, 0, 0, 0], stress[1] - stress[0], rtol=0.02)
    # The probes around lose as much force as it gains, nearly.
    assert abs(total_n[1] - total_n[0]) < 0.1 * force_n[1, 0, 0]
    free = fb.receptive_field("SA", units=1, depth_um=[50])
    held = fb.receptive_field("SA", units=1, depth_um=[50], background_um=background_um)
    assert held.threshold_um[0] < 0.5 * free.threshold_um[0]
    assert free.areas["area_mm2"][0] == 0 < held.areas["area_mm2"][0]
    with pytest.raises(UsageError) as error:
        fb.receptive_field("SA", background_um=400, step_mm=0.5)
    assert (error.value.argument, error.value.found) == ("step_mm", 0.5)
    with pytest.raises(UsageError) as error:
        fb.receptive_field("SA", background_um=1800, depth_um=[300], times_threshold=[])
    assert (error.value.argument, error.value.found) == ("depth_um", 300.0)


def test_hot_spots_are_the_local_maxima_of_half_the_largest_or_more():
    rng = np.random.default_rng(8)
    maps = rng.integers(0, 9, (6, 9, 11)).astype(float)
    maps[0] = 1.0  # flat: one
    maps[1] = 0.0  # silent: none
    for drive, found in zip(maps, hot_spot_counts(maps).tolist(), strict=True):
        count = 0
        for x in range(9):
            for z in range(11):
                around = [
                    (drive[i, j], (i, j))
                    for i in range(max(x - 1, 0), min(x + 2, 9))
                    for j in range(max(z - 1, 0), min(z + 2, 11))
                    if (i, j) != (x, z)
                ]
                top = all(
                    drive[x, z] > value or (drive[x, z] == value and (x, z) < place)
                    for value, place in around
                )
                count += top and drive[x, z] >= 0.5 * drive.max() > 0
        assert found == count


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("afferent", ["XX", ["SA"]]),
        ("probe_diameter_mm", [np.nan, np.inf, 1e308, 0.0, -1.0]),
        ("criterion", [0.0, np.nan, 2.0]),
        ("depth_um", [[-1.0], [np.nan], [np.inf], ["deep"]]),
        ("times_threshold", [[0.0], [np.nan], [1e308]]),
        ("frequency_hz", [np.nan, np.inf, 0.0]),
        ("step_mm", [0.0, np.nan, np.inf]),
        ("units", [0, 1.5, 201]),
        ("background_um", [-1.0, np.nan, 1e308]),
    ],
)
def test_a_field_of_nothing_is_refused(name, values):
    for value in values:
        with pytest.raises(UsageError, match=name):
            fb.receptive_field(**{"afferent": "SA", name: value})


# ---- Parts of a touch


@pytest.mark.parametrize("scanned", [pytest.param(False, marks=pytest.mark.slow), True])
def test_stress_and_spikes_do_not_depend_on_how_many_samples_are_taken_at_a_time(
    monkeypatch, scanned
):
    """Noise too: its numbers come in the same order."""
    units = Population.line(step_mm=0.5, half_length_mm=3.0)
    way = Trajectory.slide(40.0, press_um=300, duration_ms=60) if scanned else way_of_sine()
    noisy = {"trials": 2, "noise_mv": 0.5, "seed": 3}

    def touched():
        return touch_skin(PAD, Shape.dots(2.0), way, units, FITTED, **noisy)

    whole = touched()
    stress_pa = whole.stress_pa
    monkeypatch.setattr("neural.encoder._UNIT_NUMBERS", 3_000)
    monkeypatch.setattr("fembridge.touching.contact._STEPS_AT_ONCE", 17)
    monkeypatch.setattr("fembridge.touching.contact_history._NUMBERS_PER_BLOCK", 500)
    monkeypatch.setattr("fembridge.touching.stress._BLOCK", 20_000)
    parts = touched()
    assert whole.fired.time_ms.size > 50
    for name in ("unit", "trial", "time_ms"):
        np.testing.assert_array_equal(getattr(parts.fired, name), getattr(whole.fired, name))
    assert_allclose(parts.stress_pa, stress_pa, rtol=1e-6, atol=1e-3)
    assert_allclose(parts.force_n, whole.force_n, rtol=1e-12)
    assert_allclose(parts.stress_of([4, 1]), stress_pa[:, [4, 1]], rtol=1e-6, atol=1e-3)


def way_of_sine():
    times_ms = np.arange(401) * 0.5
    depth_um = 300 + 200 * np.sin(2 * np.pi * 0.02 * times_ms)
    return Trajectory(depth_um, name="sine")


def test_stress_larger_than_the_memory_is_refused_and_some_units_are_not(monkeypatch):
    held = fb.touch("punch", Trajectory.press(200, hold_ms=20), population="line")
    monkeypatch.setenv("FEMBRIDGE_MEMORY", "100K")
    with pytest.raises(UsageError, match="stress of"):
        _ = held.stress_pa
    assert held.stress_of([2]).shape == (held.trajectory.level.size, 1)


def test_a_contact_of_too_many_steps_for_the_memory_is_refused(monkeypatch):
    slide = Trajectory.slide(40, press_um=300, duration_ms=200)
    fb.touch("plate", BRIEF, population="one_each")  # the pad is in memory
    monkeypatch.setenv("FEMBRIDGE_MEMORY", "10K")
    with pytest.raises(UsageError, match=r"contact of \d+ steps"):
        fb.touch("plate", slide, population="one_each")


@pytest.mark.slow
@pytest.mark.parametrize("duration_ms", [1_000, 10_000])
def test_a_touch_of_twenty_thousand_units_stays_below_two_gigabytes(duration_ms):
    program = f"""
import resource
import numpy as np
from fembridge.touching.pad_file import resolve_pad
from fembridge.touching.population import Population
from fembridge.touching.shape import Shape, resolve_shape
from fembridge.touching.touch import touch_skin
from fembridge.touching.trajectory import Trajectory
from neural import parameter_set
times_ms = np.arange({2 * duration_ms} + 1) * 0.5
trajectory = Trajectory(75 + 130 * np.sin(0.04 * np.pi * times_ms))
units = Population.fingertip(density=20_000 / 888)
parameters = parameter_set("fitted_pad")
touch_skin(resolve_pad("reference"), Shape.punch(1.0), trajectory, units, parameters)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6)
"""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert float(done.stdout) < 2.0
