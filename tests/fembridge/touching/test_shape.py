"""Heights of shapes against what they are, and words and files that are none."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from fembridge.errors import UsageError
from fembridge.touching.shape import Shape, shape_named


def heights(shape, *places):
    x, z = np.array(places, dtype=float).T
    return shape.height_mm(x, z)


def test_heights_are_those_of_the_body():
    assert_allclose(heights(Shape.punch(1.0), (0, 0), (0.49, 0), (0, 0.7)), [0, 0, 0.2])
    assert_allclose(heights(Shape.sphere(4.0), (0, 0), (1, 0)), [0, 2 - 3**0.5])
    assert np.isposinf(heights(Shape.sphere(4.0), (2.1, 0))).all()
    assert_allclose(heights(Shape.cylinder(2.0), (0.6, 50.0)), [0.2])
    bar = Shape.bar(width_mm=1.0, length_mm=6.0)
    assert_allclose(heights(bar, (2.9, 0.4), (0, 0.8), (3.3, 0.9)), [0, 0.3, 0.5])
    assert_allclose(heights(bar.rotated(90.0), (0.4, 2.9), (0.8, 0)), [0, 0.3], atol=1e-12)
    assert_allclose(heights(bar.moved(1.0, 2.0), (3.9, 2.4)), [0], atol=1e-12)
    assert_allclose(heights(Shape.edge(), (3, 1), (3, -0.2)), [0, 0.2])
    grating = Shape.grating(groove_mm=2.0, ridge_mm=1.0, relief_mm=0.8)
    assert_allclose(heights(grating, (0, 0), (5, 1.5), (0, 0.9), (0, 3)), [0.8, 0, 0.1, 0.8])
    dots = Shape.dots(spacing_mm=2.0, diameter_mm=0.6, relief_mm=0.4)
    assert_allclose(heights(dots, (0, 0), (2.2, -4), (1, 1)), [0, 0, 0.4])
    row = Shape.dots(spacing_mm=2.0, diameter_mm=0.6, relief_mm=0.4, columns=1, rows=2)
    assert_allclose(heights(row, (0, 1), (0, -1), (2, 1), (0, 3)), [0, 0, 0.4, 0.4])


def test_braille_has_the_dots_of_its_letter():
    cell = Shape.braille("n")  # 1 3 4 5
    places = [(-1.17, 2.34), (-1.17, 0), (-1.17, -2.34), (1.17, 2.34), (1.17, 0), (1.17, -2.34)]
    assert_allclose(heights(cell, *places), [0, 0.48, 0, 0, 0, 0.48], atol=1e-12)
    with pytest.raises(UsageError, match="é"):
        Shape.braille("é")


def test_a_letter_is_raised_along_its_strokes_alone():
    assert_allclose(heights(Shape.letters("O", size_mm=6.0), (0, 2.7), (0, 0)), [0, 0.5])
    assert_allclose(heights(Shape.letters("I", size_mm=6.0), (0, 0), (0, 2.7)), [0, 0])


def test_a_picture_is_raised_where_it_is_white(tmp_path):
    from matplotlib.image import imsave

    picture = np.zeros((20, 30))
    picture[:5] = 1.0  # the upper edge: towards the tip
    imsave(tmp_path / "edge.png", picture, cmap="gray", vmin=0, vmax=1)
    shape = shape_named(str(tmp_path / "edge.png"), pixel_mm=0.1, relief_mm=0.3)
    assert_allclose(heights(shape, (0, 0.9), (1.2, 0.7), (0, 0)), [0, 0, 0.3], atol=1e-6)
    assert np.isposinf(heights(shape, (0, 1.2), (1.7, 0))).all()


def test_a_table_of_heights_may_have_holes(tmp_path):
    (tmp_path / "map.csv").write_text("0.1,0.2,0.3\n0.1,,0.3\n0.1,0.2,0.3\n")
    shape = shape_named(str(tmp_path / "map.csv"), pixel_mm=1.0)
    assert_allclose(heights(shape, (1, 1), (-1, 0), (0.5, 1)), [0, 0.2, 0.05])
    assert np.isposinf(heights(shape, (0, 0))).all()


@pytest.mark.parametrize(
    ("name", "content", "named"),
    [
        ("a.csv", "0.1,0.2\n0.1,high\n", "a.csv:2"),
        ("a.csv", "0.1\n", "a.csv"),
        ("a.png", "no picture", "a.png"),
    ],
)
def test_a_file_that_is_no_height_map_gets_a_line(tmp_path, name, content, named):
    (tmp_path / name).write_text(content)
    with pytest.raises(UsageError, match=named):
        shape_named(str(tmp_path / name), pixel_mm=0.1)


@pytest.mark.parametrize(
    ("word", "named"),
    [
        ("sphre", "sphere"),
        ("bar:widht_mm=1", "width_mm"),
        ("bar:width_mm=wide", "wide"),
        ("punch:diameter_mm=0", "diameter_mm"),
        ("absent.png", "pixel"),
    ],
)
def test_a_word_that_is_no_shape_names_what_is_near(word, named):
    with pytest.raises(UsageError, match=named):
        shape_named(word)


def test_words_name_the_sizes_of_a_shape():
    assert_allclose(heights(shape_named("bar:width_mm=2,length_mm=3"), (1.4, 0.9)), [0])
    assert shape_named("letters:text=Ab,size_mm=4").name == "letters 'Ab'"
    assert heights(shape_named("letters:text=I,size_mm=4"), (0, 0), (0, 1.5)).max() == 0


def test_a_drawing_works_at_the_first_try_in_ink_on_paper_and_on_nothing(tmp_path):
    """The same dot: white on black, black on white, and in ink on a transparent sheet."""
    from matplotlib.image import imsave

    dot = np.zeros((40, 40))
    dot[15:25, 15:25] = 1.0
    ink = np.zeros((40, 40, 4))
    ink[..., 3] = dot
    imsave(tmp_path / "chalk.png", dot, cmap="gray")
    imsave(tmp_path / "paper.png", 1 - dot, cmap="gray")
    imsave(tmp_path / "nothing.png", ink)
    said = []
    chalk, paper, nothing = (
        Shape.read(tmp_path / f"{name}.png", 0.1, relief, said.append)
        for name, relief in (("chalk", 0.5), ("paper", -0.5), ("nothing", 0.5))
    )
    assert not said
    x, z = np.meshgrid(np.linspace(-1.9, 1.9, 30), np.linspace(-1.9, 1.9, 30))
    assert_allclose(paper.height_mm(x, z), chalk.height_mm(x, z))
    assert_allclose(nothing.height_mm(x, z), chalk.height_mm(x, z))
    Shape.read(tmp_path / "paper.png", 0.1, 0.5, said.append)
    assert "--relief-mm -0.5" in said[0]
