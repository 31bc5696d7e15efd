"""What touches the skin: rigid shapes as heights over a plane, and their words.

Seen from above the finger, x is to the right and z towards the tip. A shape's height is
0 where it is lowest, rises from there and is infinite where there is no shape; its middle
is at the origin until it is `rotated` or `moved`. Edges rise at 45 degrees, as they do on
embossed plates.

A word is a shape's name and its sizes, ``bar:width_mm=1,length_mm=8``.
"""

import codecs
import io
import math
import re
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fembridge.errors import UsageError
from fembridge.memory import check_memory
from fembridge.store import read_bytes
from fembridge.tables import warn_if_cut
from fembridge.touching.named import named
from fembridge.touching.png import MAX_PIXELS, SIGNATURE, read_png
from fembridge.typing import BoolArray, FloatArray

if TYPE_CHECKING:
    from matplotlib.path import Path as MatplotlibPath

Height = Callable[[FloatArray, FloatArray], FloatArray]

# The least and the most that a length of a shape may be.
_LEAST_MM, _MOST_MM = 0.01, 200.0
# The farthest that a shape may be from the middle of the pad, and turned.
MAX_AWAY_MM, MAX_TURN_DEG = 10_000.0, 3_600.0
_MAX_COUNT = 100_000
_MAX_LETTERS = 1_000
# Where a shape ends, its edge is so high: more than the skin can follow.
_SLOPE_MM = 2.0
# Letters are drawn as grids this fine.
_PIXEL_MM = 0.05
# Bytes of a file of heights: 25 characters a number, and a margin.
_MAX_FILE_BYTES = 32 * MAX_PIXELS
# Bytes of a pixel: of a table's text and its numbers, of a grid of letters.
_TABLE_PIXEL_BYTES, _LETTER_PIXEL_BYTES = 72, 64
# Heights beyond this are no heights of a plate, but would be holes.
_MAX_HEIGHT_MM = 1e5
_ROWS_PER_BLOCK, _CELLS_PER_BLOCK = 256, 1 << 16
_TABLE_SUFFIXES = (".csv", ".txt")
_BLANKS = b" \t\r\n"
# Python's float accepts underscores, control characters and other scripts, no table has them.
# The second is of tables whose cells are separated by tabs.
_NO_TABLE = re.compile(rb"[^\r\n -~]|_|\r(?!\n)"), re.compile(rb"[^\t\r\n -~]|_|\r(?!\n)")
# A hole of a height map, and any share of one that is more than rounding, is no shape.
_HOLE_MM = 1e12
# Dots 1, 2, 3 are the left column of a Braille cell from above, 4, 5, 6 the right one.
_BRAILLE_DOTS = {
    "a": "1", "b": "12", "c": "14", "d": "145", "e": "15", "f": "124", "g": "1245",
    "h": "125", "i": "24", "j": "245", "k": "13", "l": "123", "m": "134", "n": "1345",
    "o": "135", "p": "1234", "q": "12345", "r": "1235", "s": "234", "t": "2345",
    "u": "136", "v": "1236", "w": "2456", "x": "1346", "y": "13456", "z": "1356", " ": "",
}  # fmt: skip
# Pitch of dots and cells and size of a dot: Library of Congress, Specification 800.
_BRAILLE_PITCH_MM, _BRAILLE_CELL_MM = 2.34, 6.2
_BRAILLE_DIAMETER_MM, _BRAILLE_RELIEF_MM = 1.5, 0.48


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """A rigid shape: `height` in mm of places x, z in mm, and how to call it."""

    name: str
    height: Height
    x_mm: float = 0.0
    z_mm: float = 0.0
    angle_deg: float = 0.0

    def __post_init__(self) -> None:
        check_range("x_mm", self.x_mm, -MAX_AWAY_MM, MAX_AWAY_MM)
        check_range("z_mm", self.z_mm, -MAX_AWAY_MM, MAX_AWAY_MM)
        check_range("angle_deg", self.angle_deg, -MAX_TURN_DEG, MAX_TURN_DEG)

    def height_mm(self, x_mm: FloatArray, z_mm: FloatArray) -> FloatArray:
        """Height over its lowest point at places on the skin; infinite beside it."""
        turn = math.radians(self.angle_deg)
        across, along = x_mm - self.x_mm, z_mm - self.z_mm
        x = math.cos(turn) * across + math.sin(turn) * along
        z = -math.sin(turn) * across + math.cos(turn) * along
        return self.height(x, z)

    def moved(self, x_mm: float, z_mm: float) -> "Shape":
        """The shape, that way further."""
        return replace(self, x_mm=self.x_mm + x_mm, z_mm=self.z_mm + z_mm)

    def rotated(self, angle_deg: float) -> "Shape":
        """The shape, rotated about its middle, counter-clockwise."""
        return replace(self, angle_deg=self.angle_deg + angle_deg)

    # ---- Shapes

    @classmethod
    def punch(cls, diameter_mm: float = 1.0) -> "Shape":
        """A round pin with a flat end."""
        _check(diameter_mm=diameter_mm)
        return cls(
            f"punch {diameter_mm:g} mm",
            lambda x, z: _raised(np.hypot(x, z) - 0.5 * diameter_mm, math.inf),
        )

    @classmethod
    def sphere(cls, diameter_mm: float = 5.0) -> "Shape":
        """A ball."""
        _check(diameter_mm=diameter_mm)
        return cls(f"sphere {diameter_mm:g} mm", lambda x, z: _round(np.hypot(x, z), diameter_mm))

    @classmethod
    def cylinder(cls, diameter_mm: float = 5.0, length_mm: float = math.inf) -> "Shape":
        """A rod that lies along the finger; rotated by 90 degrees, across it."""
        _check(diameter_mm=diameter_mm)
        if length_mm != math.inf:
            _check(length_mm=length_mm)
        half_mm = 0.5 * length_mm

        def height(x: FloatArray, z: FloatArray) -> FloatArray:
            return np.where(np.abs(z) <= half_mm, _round(x, diameter_mm), math.inf)

        return cls(f"cylinder {diameter_mm:g} mm", height)

    @classmethod
    def plate(cls) -> "Shape":
        """A flat plate without end."""
        return cls("plate", lambda x, z: np.zeros(np.broadcast(x, z).shape))

    @classmethod
    def bar(cls, width_mm: float = 1.0, length_mm: float = 10.0) -> "Shape":
        """A bar across the finger: `width_mm` along it, `length_mm` across."""
        _check(width_mm=width_mm, length_mm=length_mm)
        return cls(
            f"bar {width_mm:g} x {length_mm:g} mm",
            lambda x, z: _raised(_box(x, z, length_mm, width_mm), math.inf),
        )

    @classmethod
    def edge(cls) -> "Shape":
        """A plate that ends at ``z = 0``, across the finger; it lies towards the tip."""
        return cls("edge", lambda x, z: _raised(-z + 0.0 * x, math.inf))

    @classmethod
    def grating(
        cls, groove_mm: float = 1.0, ridge_mm: float = 1.0, relief_mm: float = 1.0
    ) -> "Shape":
        """Ridges across the finger, grooves between them; a groove is in the middle."""
        _check(groove_mm=groove_mm, ridge_mm=ridge_mm, relief_mm=relief_mm)
        period_mm = groove_mm + ridge_mm

        def height(x: FloatArray, z: FloatArray) -> FloatArray:
            off_mm = np.abs((z + 0.5 * period_mm) % period_mm - 0.5 * period_mm)
            return _raised(0.5 * groove_mm - off_mm + 0.0 * x, relief_mm)

        return cls(f"grating {groove_mm:g}/{ridge_mm:g} mm", height)

    @classmethod
    def dots(
        cls,
        spacing_mm: float = 2.0,
        diameter_mm: float = 0.5,
        relief_mm: float = 0.4,
        columns: int = 0,
        rows: int = 0,
    ) -> "Shape":
        """Flat dots on a square lattice, one in the middle; 0 columns or rows: no end."""
        _check(spacing_mm=spacing_mm, diameter_mm=diameter_mm, relief_mm=relief_mm)
        check_range("columns", columns, 0, _MAX_COUNT)
        check_range("rows", rows, 0, _MAX_COUNT)

        def height(x: FloatArray, z: FloatArray) -> FloatArray:
            off_x, off_z = _off_lattice(x, spacing_mm, columns), _off_lattice(z, spacing_mm, rows)
            return _raised(np.hypot(off_x, off_z) - 0.5 * diameter_mm, relief_mm)

        return cls(f"dots {spacing_mm:g} mm", height)

    @classmethod
    def braille(cls, text: str = "a") -> "Shape":
        """Small letters in Braille, read along x; domes of standard size."""
        _check_text("braille", text)
        unknown = sorted(set(text.lower()) - set(_BRAILLE_DOTS))
        if unknown:
            raise UsageError(f"braille text {text!r}: expected letters a to z and blanks")
        raised = np.array([[dot in _BRAILLE_DOTS[letter] for dot in "123456"]
                           for letter in text.lower()])  # fmt: skip
        middle = 0.5 * (len(text) - 1)
        # A dome is the cap of a ball.
        radius_mm = 0.5 * (_BRAILLE_DIAMETER_MM**2 / (4 * _BRAILLE_RELIEF_MM) + _BRAILLE_RELIEF_MM)

        def height(x: FloatArray, z: FloatArray) -> FloatArray:
            # Of the nearest letter alone: from there its neighbours are beyond their domes.
            cell = np.clip(np.round(x / _BRAILLE_CELL_MM + middle), 0, len(text) - 1)
            cell_x_mm, letter = (cell - middle) * _BRAILLE_CELL_MM, cell.astype(np.int64)
            away_mm = np.full(np.broadcast(x, z).shape, math.inf)
            for dot in range(6):
                dot_x_mm = cell_x_mm + (-0.5 if dot < 3 else 0.5) * _BRAILLE_PITCH_MM
                dot_z_mm = (1 - dot % 3) * _BRAILLE_PITCH_MM
                dot_away_mm = np.hypot(x - dot_x_mm, z - dot_z_mm)
                away_mm = np.where(raised[letter, dot], np.minimum(away_mm, dot_away_mm), away_mm)
            return np.minimum(_round(away_mm, 2 * radius_mm), _BRAILLE_RELIEF_MM)

        return cls(f"braille {text!r}", height)

    @classmethod
    def letters(cls, text: str = "A", size_mm: float = 6.0, relief_mm: float = 0.5) -> "Shape":
        """Raised letters `size_mm` high, read along x."""
        _check(size_mm=size_mm, relief_mm=relief_mm)
        _check_text("letters", text)
        from matplotlib.path import Path as Outline

        path = _outline_of(text)
        low, high = path.get_extents().get_points()
        scale = size_mm / (high - low)[1]
        columns, rows = (np.ceil((high - low) * scale / _PIXEL_MM) + 2 / _PIXEL_MM).astype(int)
        if columns * rows > MAX_PIXELS:
            raise UsageError(
                f"letters {text!r}: {columns} x {rows} pixels of {_PIXEL_MM:g} mm, expected at "
                f"most {MAX_PIXELS} in all: fewer or smaller letters"
            )
        check_memory(_LETTER_PIXEL_BYTES * columns * rows, f"letters {text!r}", UsageError)
        x = (np.arange(columns) - 0.5 * (columns - 1)) * _PIXEL_MM
        z = (0.5 * (rows - 1) - np.arange(rows)) * _PIXEL_MM
        middle = 0.5 * (low + high)
        inside = np.zeros((rows, columns), dtype=bool)  # an O has two outlines
        for vertices in path.to_polygons():
            outline = Outline(vertices)
            (left, below), (right, above) = (outline.get_extents().get_points() - middle) * scale
            column = slice(*np.searchsorted(x, (left - _PIXEL_MM, right + _PIXEL_MM)))
            row = slice(*np.searchsorted(-z, (-above - _PIXEL_MM, -below + _PIXEL_MM)))
            grid = np.stack(np.meshgrid(x[column], z[row]), -1)
            part = outline.contains_points(grid.reshape(-1, 2) / scale + middle)
            inside[row, column] ^= part.reshape(grid.shape[:2])
        return cls.of_grid(_beveled(inside, _PIXEL_MM, relief_mm), _PIXEL_MM, f"letters {text!r}")

    @classmethod
    def of_grid(cls, raised_mm: FloatArray, pixel_mm: float, name: str = "height map") -> "Shape":
        """Heights on a grid ``(row, column)``, the first row towards the tip.

        The largest of `raised_mm` touches first; NaN is a hole, and so is what is beside
        the grid. Between middles of pixels heights are bilinear.
        """
        raised = np.asarray(raised_mm, dtype=np.float64)
        if raised.ndim != 2 or min(raised.shape) < 2:
            raise UsageError(f"{name}: a grid {raised.shape}, expected 2 x 2 pixels or more")
        if raised.size > MAX_PIXELS:
            raise UsageError(f"{name}: {raised.size} pixels, expected at most {MAX_PIXELS}")
        hole = np.isnan(raised)
        if hole.all() or not (hole | (np.abs(raised) <= _MAX_HEIGHT_MM)).all():
            raise UsageError(
                f"{name}: heights must be finite, at most {_MAX_HEIGHT_MM:g} mm, or NaN where "
                "there is none"
            )
        if not 0 < pixel_mm < math.inf:
            raise UsageError(f"{name}: pixel_mm is {pixel_mm:g}, expected more than 0")
        least_mm = pixel_mm * min(raised.shape)
        if not _LEAST_MM <= least_mm <= _MOST_MM:
            raise UsageError(
                f"{name}: {min(raised.shape)} pixels of {pixel_mm:g} mm are {least_mm:g} mm, "
                f"expected {_LEAST_MM:g} to {_MOST_MM:g}"
            )
        filled = np.nanmax(raised) - raised
        filled[hole] = _HOLE_MM
        rows, columns = filled.shape

        def height(x: FloatArray, z: FloatArray) -> FloatArray:
            from scipy.ndimage import map_coordinates

            column = np.asarray(x) / pixel_mm + 0.5 * (columns - 1)
            row = 0.5 * (rows - 1) - np.asarray(z) / pixel_mm
            column, row = np.broadcast_arrays(column, row)
            edge = 0.5 + 1e-9
            inside = (column >= -edge) & (column <= columns - 1 + edge)
            inside &= (row >= -edge) & (row <= rows - 1 + edge)
            found = map_coordinates(filled, [row, column], order=1, mode="nearest")
            return np.where(inside & (found < _HOLE_MM / 1e6), found, math.inf)

        return cls(name, height)

    @classmethod
    def read(
        cls,
        path: Path | str,
        pixel_mm: float,
        relief_mm: float = 0.5,
        log: Callable[[str], None] = lambda line: None,
    ) -> "Shape":
        """A height map: a picture, white raised by `relief_mm` over black, or a CSV in mm.

        With a negative `relief_mm` black is raised over white. What is transparent is low;
        where all that is drawn has one colour, it is raised. A CSV holds a height a pixel,
        rows from the tip down, empty or ``nan`` where there is a hole. A picture must be a
        PNG: other kinds have no checksums, so that damage would be another shape.

        Raises
        ------
        UsageError
            No such file, no picture, a checksum that fails, no numbers, rows of unequal
            length, or more than 20 million pixels.

        Warns
        -----
        FembridgeWarning
            No line end behind the last number of a CSV, which may be cut.
        """
        path = Path(path)
        content = read_bytes(path, _MAX_FILE_BYTES, UsageError)
        is_table = path.suffix.lower() in _TABLE_SUFFIXES and not content.startswith(SIGNATURE)
        if is_table:
            return cls.of_grid(_table(path, content), pixel_mm, path.name)
        if not _LEAST_MM <= abs(relief_mm) <= _MOST_MM:
            raise UsageError(
                f"relief_mm is {relief_mm:g}, expected {_LEAST_MM:g} to {_MOST_MM:g}, or minus that"
            )
        light, solid = _light_and_opacity(read_png(path, content))
        drawn = light[solid > 0.5]
        if drawn.size and np.ptp(drawn) == 0:
            light.fill(float(relief_mm > 0))
        del drawn
        raised = (light if relief_mm > 0 else 1.0 - light) * solid
        del light, solid
        if np.ptp(raised) == 0:
            raise UsageError(f"{path}: one grey all over, expected white where it is raised")
        rim = np.concatenate([raised[[0, -1]].ravel(), raised[:, [0, -1]].ravel()])
        if np.median(rim) > 0.5 * raised.max():
            log(
                f"{path.name}: its rim is raised, a plate with holes; --relief-mm {-relief_mm:g} "
                f"raises {'dark' if relief_mm > 0 else 'light'} parts instead"
            )
        return cls.of_grid(abs(relief_mm) * raised, pixel_mm, path.name)


SHAPES: Mapping[str, Callable[..., Shape]] = {
    name: getattr(Shape, name)
    for name in (
        "punch", "sphere", "cylinder", "plate", "bar", "edge", "grating", "dots",
        "braille", "letters",
    )
}  # fmt: skip


def shape_named(
    word: str,
    pixel_mm: float | None = None,
    relief_mm: float | None = None,
    log: Callable[[str], None] = lambda line: None,
) -> Shape:
    """The shape of a word such as ``sphere:diameter_mm=4``, or of a file of heights.

    Raises
    ------
    UsageError
        No such shape, size or file; near ones are named. A `pixel_mm` or `relief_mm` that
        the shape does not use.
    """

    def read(path: Path) -> Shape:
        if pixel_mm is None:
            raise UsageError(f"{word}: give the size of a pixel, --pixel-mm")
        if relief_mm is not None and path.suffix.lower() in _TABLE_SUFFIXES:
            raise UsageError(f"{word} has heights in mm: --relief-mm (relief_mm=) is for a picture")
        return Shape.read(path, pixel_mm, 0.5 if relief_mm is None else relief_mm, log)

    if word.partition(":")[0] in SHAPES:
        for name, size_mm in (("pixel", pixel_mm), ("relief", relief_mm)):
            if size_mm is not None:
                raise UsageError(
                    f"--{name}-mm ({name}_mm=) is for a file of heights, and {word!r} is none"
                )
    return named(word, "shape", SHAPES, read, ".png or .csv")


# ---- Heights


def check_range(name: str, value: float, least: float, most: float) -> None:
    """Refuse a number that is not finite or not from `least` to `most`."""
    if not least <= value <= most:
        raise UsageError(f"{name} is {value:g}, expected {least:g} to {most:g}")


def _check(**sizes_mm: float) -> None:
    for name, size_mm in sizes_mm.items():
        check_range(name, size_mm, _LEAST_MM, _MOST_MM)


def _check_text(name: str, text: str) -> None:
    if not text.strip():
        raise UsageError(f"{name} without a letter: nothing would touch")
    if len(text) > _MAX_LETTERS:
        raise UsageError(f"{name}: {len(text)} letters, expected at most {_MAX_LETTERS}")


def _raised(outside_mm: FloatArray, relief_mm: float) -> FloatArray:
    """0 within an outline, rising at 45 degrees outside, to `relief_mm`.

    Without a relief there is nothing beyond the slope.
    """
    height: FloatArray = np.clip(outside_mm, 0.0, relief_mm)
    if relief_mm == math.inf:
        return np.where(outside_mm <= _SLOPE_MM, height, math.inf)
    return height


def _round(away_mm: FloatArray, diameter_mm: float) -> FloatArray:
    radius_mm = 0.5 * diameter_mm
    below = radius_mm**2 - np.square(away_mm)
    return np.where(below >= 0, radius_mm - np.sqrt(np.maximum(below, 0)), math.inf)


def _box(x: FloatArray, z: FloatArray, width_mm: float, length_mm: float) -> FloatArray:
    """Distance from a rectangle's outline, negative inside."""
    off_x, off_z = np.abs(x) - 0.5 * width_mm, np.abs(z) - 0.5 * length_mm
    outside = np.hypot(np.maximum(off_x, 0), np.maximum(off_z, 0))
    return np.asarray(outside + np.minimum(np.maximum(off_x, off_z), 0))


def _off_lattice(x: FloatArray, spacing_mm: float, count: int) -> FloatArray:
    """Distance from the nearest of `count` points `spacing_mm` apart, about 0."""
    if not count:
        return np.asarray((x + 0.5 * spacing_mm) % spacing_mm - 0.5 * spacing_mm)
    first = -0.5 * (count - 1)
    nearest = np.clip(np.round(x / spacing_mm - first), 0, count - 1) + first
    return np.asarray(x - nearest * spacing_mm)


def _beveled(inside: BoolArray, pixel_mm: float, relief_mm: float) -> FloatArray:
    """Heights of a raised area with edges of 45 degrees."""
    from scipy.ndimage import distance_transform_edt

    away_mm = distance_transform_edt(~inside) * pixel_mm
    return np.asarray(relief_mm - _raised(away_mm, relief_mm))


def _outline_of(text: str) -> "MatplotlibPath":
    """Outlines of the letters of `text`, in any size."""
    from matplotlib.font_manager import FontProperties, findfont, get_font
    from matplotlib.textpath import TextPath

    families = FontProperties().get_family()
    fonts = [get_font(findfont(FontProperties(family=[family]))) for family in families]
    for letter in text:  # else a box is drawn in its stead
        if not letter.isprintable() or not any(font.get_char_index(ord(letter)) for font in fonts):
            raise UsageError(f"letters {text!r}: the font has no {letter!r}")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:  # a dollar alone, not a formula
            path = TextPath((0, 0), text.replace("$", r"\$"), size=100)
        except UserWarning as problem:
            raise UsageError(f"letters {text!r}: {problem}") from problem
    if not (len(path.vertices) and np.ptp(path.vertices, axis=0).min() > 0):
        raise UsageError(f"letters {text!r}: no outline, nothing would touch")
    return path


def _light_and_opacity(picture: NDArray[np.float32]) -> tuple[FloatArray, FloatArray]:
    """Light and opacity ``(row, column)`` from 0 to 1 of a picture's pixels."""
    light, solid = np.empty(picture.shape[:2]), np.ones(picture.shape[:2])
    for first in range(0, len(picture), _ROWS_PER_BLOCK):  # of colours in double precision
        rows = slice(first, first + _ROWS_PER_BLOCK)
        block = picture[rows].astype(np.float64)
        light[rows] = block if block.ndim == 2 else block[..., :3] @ (0.299, 0.587, 0.114)
        if block.ndim == 3 and block.shape[2] == 4:
            solid[rows] = block[..., 3]
    return light, solid


def _table(path: Path, content: bytes) -> FloatArray:
    """Numbers of a CSV without a header; an empty cell or ``nan`` is NaN."""
    content = content.removeprefix(codecs.BOM_UTF8)
    if b"\n" not in content:
        content = content.replace(b"\r", b"\n")
    separator = max(",;\t", key=lambda sign: content.count(sign.encode()))
    sign, columns, lines = separator.encode(), 0, 0
    for line, row in enumerate(io.BytesIO(content), start=1):
        if row.strip(_BLANKS):
            columns = columns or row.count(sign) + 1
            lines += 1
            if (row_columns := row.count(sign) + 1) != columns:
                raise UsageError(f"{path}:{line}: {row_columns} heights, expected {columns}")
    if min(lines, columns) < 2:
        raise UsageError(f"{path}: a grid ({lines}, {columns}), expected 2 x 2 pixels or more")
    if lines * columns > MAX_PIXELS:
        raise UsageError(f"{path}: {lines} x {columns} heights, expected at most {MAX_PIXELS}")
    check_memory(_TABLE_PIXEL_BYTES * lines * columns, f"{path}: a table of this size", UsageError)
    heights = np.empty((lines, columns))
    rows = (pair for pair in enumerate(io.BytesIO(content), start=1) if pair[1].strip(_BLANKS))
    done = 0
    while block := list(islice(rows, max(1, _CELLS_PER_BLOCK // columns))):
        try:
            numbers = _numbers(b"".join(row for _, row in block), separator)
        except ValueError:  # name the line
            for line, row in block:
                try:
                    _numbers(row, separator)
                except ValueError as error:
                    raise UsageError(f"{path}:{line}: {error}, expected heights in mm") from error
            raise
        heights[done : done + len(block)] = numbers.reshape(len(block), columns)
        done += len(block)
    warn_if_cut(path, content[-1:])
    return heights


def _numbers(rows: bytes, separator: str) -> FloatArray:
    """Numbers of the cells of some rows; a ValueError says which cell has none."""
    if odd := _NO_TABLE[separator == "\t"].search(rows):
        raise ValueError(f"character {odd[0].decode('latin-1')!a}")
    text = rows.decode("ascii").replace("\r", "").removesuffix("\n")
    cells = text.replace("\n", separator).split(separator)
    numbers = np.array([float(cell) if cell.strip() else math.nan for cell in cells])
    if np.isinf(numbers).any():
        raise ValueError(f"{cells[int(np.isinf(numbers).argmax())].strip()!r} is infinite")
    return numbers
