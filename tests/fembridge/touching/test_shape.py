"""Heights of shapes against what they are, and words and files that are none."""

import math
import struct
import tracemalloc
import zlib

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from fembridge.errors import FembridgeError, FembridgeWarning, UsageError
from fembridge.touching.png import MAX_PIXELS
from fembridge.touching.shape import Shape, resolve_shape


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
    shape = resolve_shape(str(tmp_path / "edge.png"), pixel_mm=0.1, relief_mm=0.3)
    assert_allclose(heights(shape, (0, 0.9), (1.2, 0.7), (0, 0)), [0, 0, 0.3], atol=1e-6)
    assert np.isposinf(heights(shape, (0, 1.2), (1.7, 0))).all()


def test_a_table_of_heights_may_have_holes(tmp_path):
    (tmp_path / "map.csv").write_text("0.1,0.2,0.3\n0.1,,0.3\n0.1,0.2,0.3\n")
    shape = resolve_shape(str(tmp_path / "map.csv"), pixel_mm=1.0)
    assert_allclose(heights(shape, (1, 1), (-1, 0), (0.5, 1)), [0, 0.2, 0.05])
    assert np.isposinf(heights(shape, (0, 0))).all()


@pytest.mark.parametrize(
    ("name", "content", "named"),
    [
        ("a.csv", "0.1,0.2\n0.1,high\n", "a.csv:2"),
        ("a.csv", "0.1\n", "a.csv"),
        ("a.csv", "", "a.csv"),
        ("a.csv", "0.1,0.2\n0.1,1_0\n", "a.csv:2: character '_'"),
        ("a.csv", "0.1,0.2\n0.1,\u0661\n", "a.csv:2: character"),
        ("a.csv", "0.1,0.2\n0.1,0.2\x0b\n", "a.csv:2: character"),
        ("a.csv", "0.1,0.2\n\n0.1,0.2\t\n", "a.csv:3: character"),
        ("a.csv", "0.1,0.2\n0.1,inf\n", "a.csv:2: 'inf'"),
        ("a.csv", "0.1,0.2\n0.1,-1e999\n", "a.csv:2: '-1e999'"),
        ("a.csv", "0.1,0.2\n0.1,1e308\n", "heights must be finite, at most"),
        ("a.csv", "0.1,0.2\n0.1,0.2,0.3\n", "a.csv:2: 3 heights"),
        ("a.png", "no picture", "not a PNG"),
        ("a.jpg", "no picture", "save it as PNG"),
    ],
)
def test_a_file_that_is_no_height_map_gets_a_line(tmp_path, name, content, named):
    (tmp_path / name).write_text(content, newline="")
    with pytest.raises(UsageError, match=named):
        resolve_shape(str(tmp_path / name), pixel_mm=0.1)


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("line_end", ["\n", "\r\n", "\r"])
def test_a_table_of_heights_of_any_program_is_read(tmp_path, separator, line_end):
    path = tmp_path / "map.csv"
    rows = [["0.1", " 2e-1", "nan"], ["", "", ""], [" .3", "", "-1"]]
    path.write_text("\ufeff" + line_end.join(map(separator.join, rows)) + line_end, newline="")
    shape = resolve_shape(str(path), pixel_mm=1.0)
    x, z = np.meshgrid([-1.0, 0.0, 1.0], [1.0, 0.0, -1.0])
    blank_line = separator == "\t"  # tabs alone
    expected = [[0.2, 0.1, math.inf], [math.inf] * 3, [0.0, math.inf, 1.3]]
    if blank_line:
        z, expected = np.array([[0.5] * 3, [-0.5] * 3]), [expected[0], expected[2]]
        x = x[:2]
    assert_allclose(shape.height_mm(x, z), expected)


def test_a_table_of_heights_that_may_be_cut_in_its_last_number_is_named(tmp_path):
    (tmp_path / "map.csv").write_text("0.1,0.2\n0.1,0.2")
    with pytest.warns(FembridgeWarning, match="map.csv: no line end"):
        resolve_shape(str(tmp_path / "map.csv"), pixel_mm=1.0)


def test_rows_and_columns_of_a_table_are_counted_before_memory_is_taken(tmp_path, monkeypatch):
    monkeypatch.setattr("fembridge.touching.shape.MAX_PIXELS", 1_000)
    for row, count in (("," * 600 + "1\n", 2), ("1,1\n", 600)):
        (tmp_path / "map.csv").write_text(row * count)
        with pytest.raises(UsageError, match=f"{count} x .* heights, expected at most 1000"):
            resolve_shape(str(tmp_path / "map.csv"), pixel_mm=0.1)


# ---- PNG


def chunk(name, body):
    return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))


def png(rows, columns, bits=8, colour=0, interlace=0, packed=None, chunks=()):
    """A picture of random pixels, or of the zlib stream `packed`, with further `chunks`."""
    header = struct.pack(">IIBBBBB", columns, rows, bits, colour, 0, 0, interlace)
    if packed is None:
        channels = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}[colour]
        pixels = np.random.default_rng(7).integers(0, 256, (rows, columns * channels * bits // 8))
        packed = zlib.compress(b"".join(b"\0" + row.astype(np.uint8).tobytes() for row in pixels))
    half = len(packed) // 2
    body = b"".join(chunk(*part) for part in chunks)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + body + chunk(b"IDAT", packed[:half])
        + chunk(b"IDAT", packed[half:]) + chunk(b"IEND", b"")
    )  # fmt: skip


PALETTE = ((b"PLTE", bytes(range(256)) * 3),)
PICTURES = {
    "grey": png(12, 9),
    "grey in 16 bits": png(12, 9, bits=16),
    "colours": png(12, 9, colour=2),
    "opacity": png(12, 9, colour=6),
    "palette": png(12, 9, colour=3, chunks=PALETTE),
}
AT = np.meshgrid(np.linspace(-0.6, 0.6, 40), np.linspace(-0.6, 0.6, 40))


@pytest.mark.parametrize("kind", PICTURES)
def test_a_byte_of_a_picture_that_is_changed_lost_or_added_is_refused(tmp_path, kind):
    """At places of a small picture; what another program adds may follow its end."""
    whole, path = PICTURES[kind], tmp_path / "map.png"
    path.write_bytes(whole + b"more")
    undamaged = Shape.read(path, 0.1).height_mm(*AT)
    assert np.isfinite(undamaged).any()
    rng = np.random.default_rng(26)
    for position in sorted({*range(0, 45, 4), *rng.integers(0, len(whole), 30).tolist()}):
        flipped = bytes([whole[position] ^ 1 << int(rng.integers(8))])
        for damaged in (
            whole[:position] + flipped + whole[position + 1 :],
            whole[:position],
            whole[:position] + whole[position + 1 :],
            whole[:position] + flipped + whole[position:],
        ):
            path.write_bytes(damaged)
            with pytest.raises(UsageError, match=r"map\.png"):
                Shape.read(path, 0.1)


@pytest.mark.parametrize(
    ("content", "match"),
    [
        (png(12, 9, packed=zlib.compress(bytes(10 * 12))[:-1] + b"\0"), "damaged pixel data"),
        (png(12, 9, packed=zlib.compress(bytes(10 * 11))), "less pixel data"),
        (png(12, 9, packed=zlib.compress(bytes(10 * 13))), "more pixel data"),
        (png(12, 9, packed=zlib.compress(bytes(10 * 12))[:-4]), "less pixel data"),
        (png(12, 9, packed=b"plain"), "damaged pixel data"),
        (png(12, 9, bits=3, packed=b"x"), "no such picture"),
        (png(0, 9, packed=b"x"), "no such picture"),
        (png(12, 9, chunks=((b"IHDR", b""),)), "twice"),
        (png(12, 9, chunks=((b"IDAT", b""), (b"tEXt", b""))), "twice"),
        (png(12, 9, chunks=((b"JUNK", b""),)), "'JUNK'"),
        (png(12, 9, colour=3), "decoded|one grey"),
        (png(12, 9)[:-12], "no IEND"),
        (png(12, 9)[:8] + png(12, 9)[33:], "where a PNG has IHDR"),
    ],
)
def test_a_picture_whose_parts_do_not_fit_is_refused_though_checksums_hold(
    tmp_path, content, match
):
    (tmp_path / "map.png").write_bytes(content)
    with pytest.raises(UsageError, match=match):
        Shape.read(tmp_path / "map.png", 0.1)


def test_a_picture_is_read_whatever_its_chunks_and_passes(tmp_path):
    """Interlaced, with texts and dates, and under another name: the same pixels."""
    pixels = np.random.default_rng(7).integers(0, 256, (12, 9)).astype(np.uint8)
    passes = ((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2),
              (0, 1, 1, 2))  # fmt: skip
    rows = [row for x, y, dx, dy in passes for row in pixels[y::dy, x::dx] if row.size]
    packed = zlib.compress(b"".join(b"\0" + row.tobytes() for row in rows))
    texts = ((b"tEXt", b"Comment\0dots"), (b"zTXt", b"Comment\0\0" + zlib.compress(bytes(9**7))))
    (tmp_path / "plain.png").write_bytes(png(12, 9))
    (tmp_path / "other.img").write_bytes(png(12, 9, interlace=1, packed=packed, chunks=texts))
    plain, other = (Shape.read(tmp_path / name, 0.1) for name in ("plain.png", "other.img"))
    assert_array_equal(plain.height_mm(*AT), other.height_mm(*AT))


def test_a_picture_that_is_too_large_is_refused_from_its_header(tmp_path):
    path, side = tmp_path / "map.png", 13_300
    packed = zlib.compress(bytes(side * (1 + -(-side // 8))))
    path.write_bytes(png(side, side, bits=1, packed=packed))
    assert path.stat().st_size < 50_000 < MAX_PIXELS < side**2
    tracemalloc.start()
    with pytest.raises(UsageError, match="13300 x 13300 pixels, expected at most 20000000"):
        Shape.read(path, 0.01)
    _, peak_bytes = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak_bytes < 1_000_000


@pytest.mark.parametrize(
    ("word", "named"),
    [
        ("sphre", "sphere"),
        ("bar:widht_mm=1", "width_mm"),
        ("bar:width_mm=wide", "wide"),
        ("punch:diameter_mm=0", "diameter_mm"),
        ("punch:diameter_mm=nan", "'nan', expected a number"),
        ("punch:diameter_mm=1e308", "1e[+]308, expected a number from 0.01 to 200"),
        ("punch:diameter_mm=1e999", "'1e999', expected a number"),
        ("bar:width_mm=1_0", "'1_0', expected a number"),
        ("bar:width_mm=\u0661", "expected a number"),
        ("bar:width_mm=1,width_mm=2", "twice"),
        ("dots:columns=1.5", "a whole number"),
        ("dots:columns=-1", "columns is -1"),
        ("dots:rows=" + "9" * 30, "rows is 9999999"),
        ("cylinder:length_mm=-1", "length_mm is -1"),
        ("braille:text=" + "a" * 1001, "1001 letters"),
        ("braille:text= ", "without a letter"),
        ("letters:text=" + "W" * 1000, "pixels of 0.05 mm, expected at most"),
        ("letters:text=\u200b", "the font has no"),
        ("letters:text=\u4e2d", "the font has no"),
        ("x" * 5000, "expected punch"),
        ("absent.png", "pixel"),
    ],
)
def test_a_word_that_is_no_shape_names_what_is_near(word, named):
    with pytest.raises(UsageError, match=named):
        resolve_shape(word)


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf, 1e308])
def test_a_number_that_is_no_size_or_place_is_refused_from_python_too(number):
    for make in (
        lambda: Shape.punch(number),
        lambda: Shape.bar(1.0, number),
        lambda: Shape.punch().rotated(number),
        lambda: Shape.punch().moved(number, 0.0),
        lambda: Shape.punch().moved(0.0, number),
        lambda: Shape.from_heights(np.eye(3), number),
        lambda: Shape.from_heights(number * np.ones((3, 3)), 0.1),
        lambda: resolve_shape("dots:spacing_mm=2").rotated(number),
    ):
        with pytest.raises(UsageError):
            make()
    if number != math.inf:  # without an end
        with pytest.raises(UsageError):
            Shape.cylinder(1.0, number)


@pytest.mark.parametrize(
    ("word", "sizes", "argument"),
    [
        ("punch", {"pixel_mm": 0.1}, "pixel_mm"),
        ("letters:text=a", {"relief_mm": 0.1}, "relief_mm"),
        ("map.csv", {"pixel_mm": 0.1, "relief_mm": 0.1}, "relief_mm"),
    ],
)
def test_a_size_that_a_shape_does_not_use_is_refused(word, sizes, argument):
    with pytest.raises(UsageError) as error:
        resolve_shape(word, **sizes)
    assert error.value.argument == argument


def test_a_long_text_in_braille_has_the_dots_of_each_letter():
    """Against a plain loop over all dots of all letters."""
    text = "a quick fox"
    x, z = np.meshgrid(np.linspace(-40, 40, 1201), np.linspace(-4, 4, 41))
    shape, heights_mm = Shape.braille(text), np.full(x.shape, 0.48)
    radius_mm = 0.5 * (1.5**2 / (4 * 0.48) + 0.48)
    for n, letter in enumerate(text):
        cell = Shape.braille(letter).moved((n - 5) * 6.2, 0.0) if letter != " " else None
        if cell:
            heights_mm = np.minimum(heights_mm, cell.height_mm(x, z))
    assert radius_mm > 0.75
    assert_allclose(shape.height_mm(x, z), heights_mm, atol=1e-12)


def test_a_dollar_is_a_letter_and_no_formula():
    assert Shape.letters("$a$").name == "letters '$a$'"
    assert Shape.letters("$\\foo$").name


def test_words_name_the_sizes_of_a_shape():
    assert_allclose(heights(resolve_shape("bar:width_mm=2,length_mm=3"), (1.4, 0.9)), [0])
    assert resolve_shape("letters:text=Ab,size_mm=4").name == "letters 'Ab'"
    assert heights(resolve_shape("letters:text=I,size_mm=4"), (0, 0), (0, 1.5)).max() == 0


def test_a_drawing_works_at_the_first_try_in_ink_on_paper_and_on_nothing(tmp_path, logged):
    """The same dot: white on black, black on white, and in ink on a transparent sheet."""
    from matplotlib.image import imsave

    dot = np.zeros((40, 40))
    dot[15:25, 15:25] = 1.0
    ink = np.zeros((40, 40, 4))
    ink[..., 3] = dot
    imsave(tmp_path / "chalk.png", dot, cmap="gray")
    imsave(tmp_path / "paper.png", 1 - dot, cmap="gray")
    imsave(tmp_path / "nothing.png", ink)
    chalk, paper, nothing = (
        Shape.read(tmp_path / f"{name}.png", 0.1, relief)
        for name, relief in (("chalk", 0.5), ("paper", -0.5), ("nothing", 0.5))
    )
    assert not logged
    x, z = np.meshgrid(np.linspace(-1.9, 1.9, 30), np.linspace(-1.9, 1.9, 30))
    assert_allclose(paper.height_mm(x, z), chalk.height_mm(x, z))
    assert_allclose(nothing.height_mm(x, z), chalk.height_mm(x, z))
    Shape.read(tmp_path / "paper.png", 0.1, 0.5)
    assert "--relief-mm -0.5" in logged[0]


def test_a_table_of_heights_that_is_damaged_is_refused_or_has_another_number_in_one_cell(tmp_path):
    """Unseen are another digit, sign, point or exponent, and a blank in their stead."""
    rng = np.random.default_rng(26)
    rows = rng.uniform(0, 1, (6, 5))
    whole = "".join(",".join(f"{cell:.3f}" for cell in row) + "\n" for row in rows).encode()
    path = tmp_path / "map.csv"
    for position in rng.integers(0, len(whole), 400).tolist():
        damaged = bytearray(whole)
        damaged[position] = int(rng.integers(256))
        path.write_bytes(damaged)
        try:
            Shape.read(path, 0.1)
        except (FembridgeError, FembridgeWarning):
            continue
        old, new = chr(whole[position]), chr(damaged[position])
        assert new == old or (old in ".0123456789" and new in "0123456789+-.eE \n\r"), (old, new)


def test_a_tiled_map_repeats_in_both_directions():
    heights = np.random.default_rng(1).uniform(0, 1, (7, 5))
    tiled = Shape.from_heights(heights, 0.2, tile=True)
    x, z = np.random.default_rng(2).uniform(-0.4, 0.4, (2, 50))
    assert_allclose(tiled.height_mm(x + 3 * 5 * 0.2, z - 2 * 7 * 0.2), tiled.height_mm(x, z))
    assert_allclose(tiled.height_mm(x, z), Shape.from_heights(heights, 0.2).height_mm(x, z))
    assert tiled.to_table()["tile"] is True


def test_a_file_with_its_sizes_is_a_specification(tmp_path):
    path = tmp_path / "map.csv"
    np.savetxt(path, np.random.default_rng(3).uniform(0, 1, (4, 6)), delimiter=",")
    shape = resolve_shape(f"{path}:pixel_mm=0.2,tile=true")
    expected = Shape.read(path, 0.2, tile=True)
    x, z = np.random.default_rng(4).uniform(-5, 5, (2, 50))
    assert_allclose(shape.height_mm(x, z), expected.height_mm(x, z))
    assert shape.half_size_mm is None
    assert resolve_shape(f"{path}:pixel_mm=0.2").half_size_mm == pytest.approx((0.6, 0.4))


@pytest.mark.parametrize(
    ("settings", "words", "argument", "found"),
    [
        ("tile=true", {}, "pixel_mm", None), ("pixel_mm=0.2,tile=yes", {}, "shape", "yes"),
        ("pixel_mm=0.2,tiles=true", {}, "shape", "tiles=true"),
        ("pixel_mm=0.2", {"pixel_mm": 0.3}, "pixel_mm", 0.3),
        ("pixel_mm=0.2", {"tile": True}, "tile", True),
    ],
)  # fmt: skip
def test_sizes_of_a_file_that_do_not_fit_are_refused(tmp_path, settings, words, argument, found):
    path = tmp_path / "map.csv"
    np.savetxt(path, np.eye(3), delimiter=",")
    with pytest.raises(UsageError) as error:
        resolve_shape(f"{path}:{settings}", **words)
    assert (error.value.argument, error.value.found) == (argument, found)
