"""Populations: densities, seeds, tables."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from decks.presets import QUICK
from fembridge.errors import TableError, UsageError
from fembridge.touching.population import DENSITY_CM2, Population, population_named


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


def test_a_table_comes_back(tmp_path):
    units = Population.fingertip(seed=3, density=0.1)
    units.write(tmp_path / "population.csv")
    again = population_named(str(tmp_path / "population.csv"), QUICK)
    for name in ("x_mm", "z_mm", "depth_mm", "deviate"):
        assert_array_equal(getattr(again, name), getattr(units, name))
    assert again.unit == units.unit and again.afferent == units.afferent


def test_places_alone_make_a_population(tmp_path):
    path = tmp_path / "mine.csv"
    path.write_text("z_mm,afferent,x_mm\n1,PC,0\n2,SA,-1\n")
    units = Population.read(path)
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
    ],
)
def test_a_table_that_is_no_population_names_the_line(tmp_path, text, line):
    path = tmp_path / "mine.csv"
    path.write_text(text)
    with pytest.raises(TableError) as error:
        Population.read(path)
    assert error.value.line == line


def test_words_name_a_population():
    assert len(population_named("grid:step_mm=2,half_width_mm=4,half_length_mm=2", QUICK)) == 45
    line = population_named("line:along=x,step_mm=0.5,half_length_mm=1", QUICK)
    assert_allclose(line.x_mm[:5], [-1, -0.5, 0, 0.5, 1])
    assert population_named("one_each:x_mm=2", QUICK).afferent == ("SA", "RA", "PC")
    for word, named in (("fingertop", "fingertip"), ("grid:step=1", "step_mm")):
        with pytest.raises(UsageError, match=named):
            population_named(word, QUICK)
