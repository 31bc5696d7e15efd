"""Populations: densities, seeds, tables, and where units may lie."""

import hashlib
from collections import Counter
from dataclasses import replace

import numpy as np
import pandas
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from decks.presets import QUICK
from fembridge.errors import FembridgeError, FembridgeWarning, TableError, UsageError
from fembridge.touching.pad_file import resolve_pad
from fembridge.touching.population import (
    DENSITY_CM2,
    Population,
    check_inside,
    resolve_population,
)

PAD = resolve_pad("reference")


def test_a_fingertip_has_the_densities_of_man():
    units = Population.fingertip(seed=4)
    # 7 mm to both sides are 8.3 mm along an ellipse of 8 x 6.5 mm; 24 mm long.
    area_cm2 = 2 * 0.83 * 2.4
    for name, density in DENSITY_CM2.items():
        count = units.afferent.count(name)
        assert_allclose(count, density * area_cm2, rtol=0.08)
    assert np.abs(units.x_mm).max() <= 7.3
    assert len(set(units.unit)) == len(units)


def test_the_same_seed_is_the_same_finger():
    one, again, other = (Population.fingertip(seed=seed) for seed in (1, 1, 2))
    assert_array_equal(one.x_mm, again.x_mm)
    assert_array_equal(one.deviate, again.deviate)
    assert not np.array_equal(one.x_mm, other.x_mm)


def test_the_fingertip_is_that_of_earlier_versions_to_the_last_digit():
    """SHA-256 of places and deviates of five seeds, made before `density` was exact."""
    digest = hashlib.sha256()
    for seed in range(5):
        units = Population.fingertip(seed=seed)
        assert Counter(units.afferent) == {"SA": 260, "RA": 532, "PC": 96}
        for values in (units.x_mm, units.z_mm, units.deviate):
            digest.update(np.round(values, 9).tobytes())
    assert digest.hexdigest() == "4fba053a4724ce010146e443141f35abdaadd3d2b8cf5a936c5780a98542175f"


@pytest.mark.parametrize("density", [955 / 888, 0.01, 0.1, 0.3, 0.999, 1.001, 2.5, 10.0])
def test_density_asks_for_that_many_times_the_units_on_the_same_skin(density):
    units = Population.fingertip(density=density)
    assert len(units) == round(888 * density)
    for name, count in (("SA", 260), ("RA", 532), ("PC", 96)):
        selected = np.array(units.afferent) == name
        assert abs(selected.sum() - count * density) < 1
        if selected.sum() > 100:  # as many in each quarter, to the lattice
            quarters = np.histogram2d(
                units.x_mm[selected], units.z_mm[selected], 2, [[-7, 7], [-12, 12]]
            )[0]
            assert_allclose(quarters, selected.sum() / 4, rtol=0.15)
    assert len(set(units.unit)) == len(units)


def test_a_density_without_a_unit_and_too_many_units_are_refused():
    for make in (
        lambda: Population.fingertip(density=1e-9),
        lambda: Population.fingertip(density=float("nan")),
        lambda: Population.grid(step_mm=0.01),
        lambda: Population.one_each(x_mm=float("nan")),
        lambda: Population.at(["SA"], np.zeros(2), np.zeros(1)),
    ):
        with pytest.raises(UsageError):
            make()


def test_a_table_comes_back(tmp_path):
    units = Population.fingertip(seed=3, density=0.1)
    units.write(tmp_path / "population.csv")
    again = resolve_population(str(tmp_path / "population.csv"), QUICK)
    for name in ("x_mm", "z_mm", "depth_mm", "deviate"):
        assert_array_equal(getattr(again, name), getattr(units, name))
    assert again.unit == units.unit and again.afferent == units.afferent


def test_places_alone_make_a_population(tmp_path):
    path = tmp_path / "mine.csv"
    path.write_text("z_mm,afferent,x_mm\n1,PC,0\n2,SA,-1\n")
    units = Population.from_table(path)
    assert units.unit == ("1", "2")
    assert_allclose(units.depth_mm, [2.0, 0.5875])
    assert_allclose(units.z_mm, [1, 2])


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("afferent,x_mm,z_mm\nSA,0,0\nSA2,0,0\n", 3),
        ("afferent,x_mm,z_mm\nSA,here,0\n", 2),
        ("unit,afferent,x_mm,z_mm\na,SA,0,0\na,RA,0,0\n", 3),
        ("afferent,x_mm\nSA,0\n", 1),
        ("afferent,x_mm,z_mm,deviates\nSA,0,0,1\n", 1),
        ("# of a study\nafferent,x_mm,z_mm,layer\nSA,0,0,dermis\n", 2),
        ("afferent,x_mm,z_mm,deviate,deviate\nSA,0,0,1,2\n", 1),
        ("afferent,x_mm,z_mm\nSA,1_0,0\n", 2),
        ("afferent,x_mm,z_mm\nSA,\u0661,0\n", 2),
        ("afferent,x_mm,z_mm\nSA,0,nan\n", 2),
        ("afferent,x_mm,z_mm,depth_mm\nSA,0,0,-1\n", 2),
    ],
)
def test_a_table_that_is_no_population_names_the_line(tmp_path, text, line):
    path = tmp_path / "mine.csv"
    path.write_text(text)
    with pytest.raises(TableError) as error:
        Population.from_table(path)
    assert error.value.line == line


def test_a_column_of_another_name_is_refused_with_the_nearest(tmp_path):
    path = tmp_path / "mine.csv"
    path.write_text("afferent,x_mm,z_mm,deviates\nRA,0,0,0.5\n")
    with pytest.raises(TableError, match=r"deviates.* deviate"):
        Population.from_table(path)


def test_a_table_that_may_be_cut_in_its_last_cell_is_named(tmp_path):
    path = tmp_path / "mine.csv"
    path.write_text("afferent,x_mm,z_mm\nRA,0,1")
    with pytest.warns(FembridgeWarning, match=r"mine\.csv: no line end"):
        Population.from_table(path)


@pytest.mark.parametrize(
    ("row", "argument"),
    [
        ("far,RA,1e308,0,0.5,0", "x_mm"),
        ("far,RA,0,-1e308,0.5,0", "z_mm"),
        ("deep,RA,0,0,1e308,0", "depth_mm"),
        ("dull,RA,0,0,0.5,1e308", "deviate"),
    ],
)
def test_a_number_that_no_unit_has_is_refused_by_its_name(tmp_path, row, argument):
    path = tmp_path / "mine.csv"
    path.write_text(f"unit,afferent,x_mm,z_mm,depth_mm,deviate\na,SA,0,0,0.5,0\n{row}\n")
    with pytest.raises(UsageError, match=row.partition(",")[0]) as error:
        Population.from_table(path)
    assert error.value.argument == argument and abs(error.value.found) == 1e308


def placed(x_mm=0.0, z_mm=0.0, depth_mm=None, afferent="SA", pad=PAD):
    depths_mm = None if depth_mm is None else np.array([depth_mm, depth_mm])
    units = Population.at([afferent] * 2, np.array([x_mm, x_mm]), np.array([z_mm, z_mm]), depths_mm)
    check_inside(pad, replace(units, unit=("first", "second")))


@pytest.mark.parametrize(
    ("place", "match"),
    [
        ({"x_mm": 20.0}, r"first at x = 20 mm is beside the skin, .* 8 mm .*1 others"),
        ({"x_mm": -8.1}, "first at x = -8.1 mm"),
        ({"z_mm": 25.5}, "first at z = 25.5 mm is beyond the pad"),
        ({"z_mm": -900.0}, "first at z = -900 mm"),
        ({"depth_mm": 0.9}, "first is 0.9 mm deep in epidermis at x"),
        ({"depth_mm": 0.1}, "first is 0.1 mm deep in epidermis at x"),
        ({"depth_mm": 0.5, "afferent": "PC"}, "first is 0.5 mm deep in subcutaneous_tissue"),
    ],
)
def test_a_unit_outside_the_skin_that_the_pad_models_is_refused_by_its_name(place, match):
    with pytest.raises(UsageError, match=f"unit {match}"):
        placed(**place)


def test_a_unit_in_a_layer_without_stress_is_refused_by_its_name():
    units = replace(Population.one_each(), layer=("epidermis", "dermis", "subcutaneous_tissue"))
    with pytest.raises(UsageError, match="unit RA1: the pad holds no stress in dermis"):
        check_inside(PAD, units)


def test_a_unit_that_a_press_in_the_middle_does_not_reach_is_named():
    with pytest.warns(FembridgeWarning, match="unit first at z = -14 mm.*13.3 mm.*and 1 others"):
        placed(z_mm=-14.0)
    placed(z_mm=13.0)
    placed(z_mm=900.0, pad=resolve_pad("plane"))  # endless along the finger
    placed(x_mm=7.99)
    for pad in (PAD, resolve_pad("plane")):
        check_inside(pad, Population.fingertip(finger=pad.finger))
        check_inside(pad, Population.grid(half_width_mm=7.0, half_length_mm=12.0))


@pytest.mark.slow
def test_a_population_that_is_damaged_is_refused_or_has_another_cell(tmp_path):
    """No column vanishes and no row, whatever character is changed."""
    units, path = Population.fingertip(seed=3, density=0.01), tmp_path / "population.csv"
    units.write(path)
    whole, rng = path.read_bytes(), np.random.default_rng(26)
    for position in [*range(40), *rng.integers(0, len(whole), 250).tolist()]:
        damaged = bytearray(whole)
        damaged[position] ^= 1 << int(rng.integers(7))
        path.write_bytes(damaged)
        try:
            again = Population.from_table(path)
        except (FembridgeError, FembridgeWarning):
            continue
        assert len(again) == len(units)
        different = sum(
            not np.array_equal(getattr(again, name), getattr(units, name))
            for name in ("unit", "afferent", "x_mm", "z_mm", "depth_mm", "deviate", "endings_seed")
        )
        assert different <= 1 and (different == 0 or position > 40)


def test_words_name_a_population():
    assert len(resolve_population("grid:step_mm=2,half_width_mm=4,half_length_mm=2", QUICK)) == 45
    line = resolve_population("line:along=x,step_mm=0.5,half_length_mm=1", QUICK)
    assert_allclose(line.x_mm[:5], [-1, -0.5, 0, 0.5, 1])
    assert resolve_population("one_each:x_mm=2", QUICK).afferent == ("SA", "RA", "PC")
    for word, named in (
        ("fingertop", "fingertip"), ("grid:step=1", "step_mm"), ("grid:step_mm=0", "steps of 0"),
        ("fingertip:seed=1_0", "'1_0'"), ("fingertip:seed=1.5", "a whole number"),
        ("fingertip:seed=-1", "seed is -1"), ("fingertip:density=nan", "'nan'"),
        ("fingertip:density=1e308", "density is 1e[+]308"),
        ("one_each:x_mm=1e308", "x_mm of unit SA1 is 1e[+]308"),
        ("line:step_mm=1e-320", "at most 1000"), ("line:half_length_mm=inf", "'inf'"),
    ):  # fmt: skip
        with pytest.raises(UsageError, match=named):
            resolve_population(word, QUICK)


def test_units_are_selected_by_a_mask_numbers_or_a_slice_and_joined():
    units = Population.fingertip(seed=2)
    right = units[units.x_mm > 0]
    assert (right.x_mm > 0).all() and 0 < len(right) < len(units)
    joined = right + units[units.x_mm <= 0]
    assert sorted(joined.unit) == sorted(units.unit)
    order = [joined.unit.index(name) for name in units.unit]
    frame = joined[order].to_frame()
    pandas.testing.assert_frame_equal(frame, units.to_frame())
    assert units[3:5].unit == units[[3, 4]].unit == units.unit[3:5]
    assert units[-1].unit == units.unit[-1:]
    for rows in (np.zeros(len(units), dtype=bool), [len(units)], units.x_mm[:3] > 0):
        with pytest.raises(UsageError):
            units[rows]
    for other in (units, Population.one_each().with_endings(0.0)):
        with pytest.raises(UsageError):
            units + other


def test_units_of_one_class_are_placed_by_its_name():
    assert Population.at("SA", 0.5, -1).to_frame().iloc[0].tolist()[:4] == ["SA1", "SA", 0.5, -1.0]
    assert Population.at("RA", [0, 1], [2, 3]).unit == ("RA1", "RA2")


def test_a_population_is_the_same_from_a_table_and_from_its_file(tmp_path):
    units = Population.fingertip(seed=2)[::50]
    units.write(tmp_path / "units.csv")
    from_frame = resolve_population(units.to_frame(), QUICK)
    for other in (from_frame, resolve_population(str(tmp_path / "units.csv"), QUICK)):
        assert other.to_table() == units.to_table() and other.layer == units.layer
    assert repr(from_frame).startswith("Population(18 units: ")
    with pytest.raises(TableError):
        resolve_population(units.to_frame().drop(columns="afferent"), QUICK)


def endings_by_unit(units):
    """Endings of each unit by its name, from its position: ``(E, 3)``, x, z and sensitivity."""
    unit, x_mm, z_mm, sensitivity = units.endings()
    table = np.stack([x_mm - units.x_mm[unit], z_mm - units.z_mm[unit], sensitivity], axis=1)
    return {name: table[unit == row] for row, name in enumerate(units.unit)}


def test_the_most_sensitive_ending_of_a_fibre_is_in_the_middle_of_five_to_ten():
    units = Population.fingertip(seed=4)
    endings = endings_by_unit(units)
    counts = []
    for name, afferent in zip(units.unit, units.afferent, strict=True):
        (x_mm, z_mm, sensitivity), *others = endings[name]
        assert (x_mm, z_mm, sensitivity) == (0, 0, 1)
        away_mm = np.hypot(*np.reshape(others, (-1, 3)).T[:2])
        assert ((away_mm >= 0.75 - 1e-9) & (away_mm <= units.endings_mm + 1e-9)).all()
        assert all(0.45 <= share <= 0.75 for *_, share in others)
        if afferent == "PC":
            assert not others
        else:
            counts.append(1 + len(others))
    assert set(counts) == set(range(5, 11))


def test_endings_fill_the_ring_evenly_and_no_two_fibres_are_alike():
    units = Population.fingertip(seed=4)
    branched = [table for table in endings_by_unit(units).values() if len(table) > 1]
    others = np.concatenate([table[1:] for table in branched])
    mean_mm, away_mm = others[:, :2].mean(axis=0), np.hypot(others[:, 0], others[:, 1])
    assert np.abs(mean_mm).max() < 4 * away_mm.std() / np.sqrt(len(others)) + 0.02
    # In a ring from 0.5 to 1 of the radius half of the area lies within this distance.
    half_mm = units.endings_mm * np.sqrt(0.5 * (1 + 0.5**2))
    assert np.mean(away_mm < half_mm) == pytest.approx(0.5, abs=0.03)
    assert len({table[1].tobytes() for table in branched}) == len(branched)


def test_a_unit_keeps_its_endings_when_selected_joined_written_and_read(tmp_path):
    units = Population.fingertip(seed=2)
    endings = endings_by_unit(units)
    part = units[units.x_mm > 3][::-1]
    joined = units[5:9] + Population.at(["RA"], [0.0], [0.0], unit=["probe"])
    part.write(tmp_path / "units.csv")
    alike = (
        part,
        joined[:4],
        Population.from_table(tmp_path / "units.csv"),
        units.with_endings(1.5),
    )
    for other in (*alike, Population.fingertip(seed=2, density=1.0)):
        for name, table in endings_by_unit(other).items():
            assert_allclose(table, endings[name], rtol=0, atol=1e-12)
    again = endings_by_unit(Population.fingertip(seed=3))
    assert not np.array_equal(again["SA1"], endings["SA1"])


def test_a_unit_without_a_number_draws_its_endings_from_its_name(tmp_path):
    path = tmp_path / "mine.csv"
    path.write_text("unit,afferent,x_mm,z_mm\nthumb,SA,0,0\nSA1,RA,1,2\n")
    endings = endings_by_unit(Population.from_table(path))
    elsewhere = Population.at(["RA", "SA"], [2.0, -1.0], [0.0, 3.0], unit=["SA1", "thumb"])
    for name, table in endings_by_unit(elsewhere).items():
        assert_allclose(table, endings[name], rtol=0, atol=1e-12)
    assert_allclose(endings_by_unit(Population.one_each())["SA1"], endings["SA1"], atol=1e-12)
    assert not np.array_equal(endings["SA1"], endings["thumb"])


def test_half_of_all_pc_units_have_the_other_sign_which_they_keep(tmp_path):
    units = Population.fingertip(density=20)
    is_pc = np.array(units.afferent) == "PC"
    share = (units.sign[is_pc] < 0).mean()
    assert share == pytest.approx(0.5, abs=3 * 0.5 / np.sqrt(is_pc.sum()))
    assert (units.sign[~is_pc] == 1).all() and set(units.sign) == {-1.0, 1.0}
    part = units[is_pc][7:300]
    part.write(tmp_path / "units.csv")
    for other in (part, part[::-1][::-1], Population.from_table(tmp_path / "units.csv")):
        np.testing.assert_array_equal(other.sign, units.sign[is_pc][7:300])
    # Not that of an ending: no sensitivity, place or number of endings goes with it.
    assert abs(np.corrcoef(units.sign[is_pc], units.deviate[is_pc])[0, 1]) < 0.1


def test_numbers_of_endings_are_those_of_splitmix64():
    """A plain loop over Python's integers."""
    seed, mask = 7, 2**64 - 1

    def mixed(bits):
        bits = (bits ^ (bits >> 30)) * 0xBF58476D1CE4E5B9 & mask
        bits = (bits ^ (bits >> 27)) * 0x94D049BB133111EB & mask
        return bits ^ (bits >> 31)

    golden = 0x9E3779B97F4A7C15
    state, expected = mixed((seed + golden) & mask), []
    for _ in range(5):
        state = (state + golden) & mask
        expected.append((mixed(state) >> 11) / 2**53)
    units = Population.at(["SA"], [0.0], [0.0])
    units = replace(units, endings_seed=[seed])
    count, turn, area, *_ = expected
    _, x_mm, z_mm, _ = units.endings()
    assert x_mm.size == 5 + int(6 * count)
    away_mm = units.endings_mm * np.sqrt(0.5**2 + (1 - 0.5**2) * area)
    assert_allclose(np.hypot(x_mm, z_mm)[1], away_mm, rtol=1e-12)
    sector = (np.arctan2(z_mm[1], x_mm[1]) / (2 * np.pi) - turn) % 1
    assert 0 <= sector <= 1 / (x_mm.size - 1)


@pytest.mark.parametrize("seed", [-1, 0.5, 2.0**60, float("nan")])
def test_a_seed_of_endings_that_is_no_whole_number_is_refused(seed):
    with pytest.raises(UsageError) as error:
        replace(Population.at("SA", 0, 0), endings_seed=[seed])
    assert error.value.argument == "endings_seed"
    assert_allclose(error.value.found, seed)
