"""Rigid shapes that touch the skin, as heights over a plane, and their specifications.

Seen from above the finger, x is to the right and z towards the tip. A shape's height is
0 where it is lowest, rises from there and is infinite where there is no shape; its middle
is at the origin until it is `rotated` or `moved`. Edges rise at 45 degrees, as they do on
embossed plates.

A specification is a shape's name and its sizes, ``bar:width_mm=1,length_mm=8``. Heights are
functions of this module with their sizes bound, so that a shape can be pickled.
"""

import codecs
import io
import logging
import math
import re
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from hashlib import sha256
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fembridge.errors import UsageError
from fembridge.host.memory import check_memory
from fembridge.host.store import read_bytes
from fembridge.io.text_table import warn_if_cut
from fembridge.ranges import Range, check_range
from fembridge.touching.png import MAX_PIXELS, SIGNATURE, read_png
from fembridge.touching.specification import from_specification
from fembridge.typing import BoolArray, FloatArray, Table

if TYPE_CHECKING:
    from matplotlib.path import Path as MatplotlibPath
_LOGGER = logging.getLogger(__name__)

Height = Callable[[FloatArray, FloatArray], FloatArray]

# The least and the most that a length of a shape may be.
_LEAST_MM, _MOST_MM = 0.01, 200.0
_SIZE_MM = Range(_LEAST_MM, _MOST_MM)
# The farthest that a shape may be from the middle of the pad.
MAX_AWAY_MM = 10_000.0
_COUNT = Range(0, 100_000, is_whole=True)
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
# A file of heights with its sizes, as a specification.
_FILE_WITH_SIZES = re.compile(r"(.+\.(?:png|csv|txt)):([^/\\]*)", re.IGNORECASE)
_NO_SIZE = math.nan
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


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Shape:
    """A rigid shape, as heights over a plane.

    Class methods make the usual ones: `punch`, `sphere`, `cylinder`, `plate`, `bar`, `edge`,
    `grating`, `dots`, `braille`, `letters`; `from_heights` and `read` take height maps.

    Parameters
    ----------
    name
        Name in messages and records.
    height
        Function of x and z in mm, ``(N,)``, that returns the height in mm over the lowest point;
        infinite beside the shape.
    x_mm, z_mm
        Position of the middle across and along the finger in mm. Default: 0.
    angle_deg
        Rotation in deg, counter-clockwise as seen from above. Default: 0.
    half_size_mm
        Half the columns and half the rows of a height map in mm. Default: None, no map, or one that
        repeats.
    origin
        Digest and pixel of a height map, for the record. Default: nothing.

    Raises
    ------
    UsageError
        A position or rotation out of range.

    Examples
    --------
    >>> import fembridge as fb
    >>> fb.Shape.bar(width_mm=1, length_mm=8).rotated(30).moved(0, 2)
    Shape('bar 1 x 8 mm', at (0, 2) mm, rotated by 30 degrees)
    """

    name: str
    height: Height
    x_mm: float = 0.0
    z_mm: float = 0.0
    angle_deg: float = 0.0
    half_size_mm: tuple[float, float] | None = None
    origin: Mapping[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_range("x_mm", self.x_mm, Range(-MAX_AWAY_MM, MAX_AWAY_MM))
        check_range("z_mm", self.z_mm, Range(-MAX_AWAY_MM, MAX_AWAY_MM))
        check_range("angle_deg", self.angle_deg)

    def __repr__(self) -> str:
        position = f"at ({self.x_mm:g}, {self.z_mm:g}) mm"
        rotation = f", rotated by {self.angle_deg:g} degrees" if self.angle_deg else ""
        return f"Shape({self.name!r}, {position}{rotation})"

    def to_table(self) -> Table:
        """Name, position and rotation, and the digest of a height map, for a record."""
        return {
            **self.origin,
            "name": self.name,
            "x_mm": float(self.x_mm),
            "z_mm": float(self.z_mm),
            "angle_deg": float(self.angle_deg),
        }

    def height_mm(self, x_mm: FloatArray, z_mm: FloatArray) -> FloatArray:
        """Height in mm over the lowest point at positions on the skin; infinite beside the shape.

        Parameters
        ----------
        x_mm, z_mm
            Positions across and along the finger in mm, ``(N,)`` or any shapes that broadcast.
        """
        return self.height(*self.own_position_mm(x_mm, z_mm))

    def moved(self, x_mm: float, z_mm: float) -> "Shape":
        """The shape, moved across and along the finger.

        Parameters
        ----------
        x_mm, z_mm
            Distances in mm.
        """
        return replace(self, x_mm=self.x_mm + x_mm, z_mm=self.z_mm + z_mm)

    def rotated(self, angle_deg: float) -> "Shape":
        """The shape, rotated about its middle.

        Parameters
        ----------
        angle_deg
            Angle in deg, counter-clockwise as seen from above.
        """
        return replace(self, angle_deg=self.angle_deg + angle_deg)

    def own_position_mm(self, x_mm: FloatArray, z_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions on the skin, ``(N,)``, as the shape sees them from its middle.

        Parameters
        ----------
        x_mm, z_mm
            Positions across and along the finger in mm, ``(N,)``.
        """
        turn = math.radians(self.angle_deg)
        across, along = x_mm - self.x_mm, z_mm - self.z_mm
        x = math.cos(turn) * across + math.sin(turn) * along
        z = -math.sin(turn) * across + math.cos(turn) * along
        return x, z

    # ---- Shapes

    @classmethod
    def punch(cls, diameter_mm: float = 1.0) -> "Shape":
        """A round pin with a flat end.

        Parameters
        ----------
        diameter_mm
            Diameter in mm. Default: 1.
        """
        _check(diameter_mm=diameter_mm)
        return cls(f"punch {diameter_mm:g} mm", partial(_punch_height, diameter_mm=diameter_mm))

    @classmethod
    def sphere(cls, diameter_mm: float = 5.0) -> "Shape":
        """A ball.

        Parameters
        ----------
        diameter_mm
            Diameter in mm. Default: 5.
        """
        _check(diameter_mm=diameter_mm)
        return cls(f"sphere {diameter_mm:g} mm", partial(_sphere_height, diameter_mm=diameter_mm))

    @classmethod
    def cylinder(cls, diameter_mm: float = 5.0, length_mm: float = math.inf) -> "Shape":
        """A rod along the finger; rotated by 90 degrees, across it.

        Parameters
        ----------
        diameter_mm
            Diameter in mm. Default: 5.
        length_mm
            Length in mm. Default: endless.
        """
        _check(diameter_mm=diameter_mm)
        if length_mm != math.inf:
            _check(length_mm=length_mm)
        height = partial(_cylinder_height, diameter_mm=diameter_mm, length_mm=length_mm)
        return cls(f"cylinder {diameter_mm:g} mm", height)

    @classmethod
    def plate(cls) -> "Shape":
        """A flat plate without end."""
        return cls("plate", _plate_height)

    @classmethod
    def bar(cls, width_mm: float = 1.0, length_mm: float = 10.0) -> "Shape":
        """A bar across the finger.

        Parameters
        ----------
        width_mm
            Width along the finger in mm. Default: 1.
        length_mm
            Length across the finger in mm. Default: 10.
        """
        _check(width_mm=width_mm, length_mm=length_mm)
        return cls(
            f"bar {width_mm:g} x {length_mm:g} mm",
            partial(_bar_height, width_mm=width_mm, length_mm=length_mm),
        )

    @classmethod
    def edge(cls) -> "Shape":
        """A plate towards the tip whose edge at ``z = 0`` runs across the finger."""
        return cls("edge", _edge_height)

    @classmethod
    def grating(
        cls, groove_mm: float = 1.0, ridge_mm: float = 1.0, relief_mm: float = 1.0
    ) -> "Shape":
        """Ridges across the finger with grooves between them; a groove is in the middle.

        Parameters
        ----------
        groove_mm, ridge_mm
            Widths in mm. Default: 1.
        relief_mm
            Depth of the grooves in mm. Default: 1.
        """
        _check(groove_mm=groove_mm, ridge_mm=ridge_mm, relief_mm=relief_mm)
        height = partial(
            _grating_height, groove_mm=groove_mm, ridge_mm=ridge_mm, relief_mm=relief_mm
        )
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
        """Flat dots on a square lattice, one in the middle.

        Parameters
        ----------
        spacing_mm
            Distance of two dots in mm. Default: 2.
        diameter_mm
            Diameter of a dot in mm. Default: 0.5.
        relief_mm
            Height of a dot in mm. Default: 0.4.
        columns, rows
            Numbers of dots across and along. Default: 0, without end.
        """
        _check(spacing_mm=spacing_mm, diameter_mm=diameter_mm, relief_mm=relief_mm)
        check_range("columns", columns, _COUNT)
        check_range("rows", rows, _COUNT)
        height = partial(
            _dots_height,
            spacing_mm=spacing_mm,
            diameter_mm=diameter_mm,
            relief_mm=relief_mm,
            columns=columns,
            rows=rows,
        )
        return cls(f"dots {spacing_mm:g} mm", height)

    @classmethod
    def braille(cls, text: str = "a") -> "Shape":
        """Small letters in Braille, read along x; domes of standard size.

        Parameters
        ----------
        text
            Letters a to z and blanks. Default: ``a``.
        """
        _check_text("braille", text)
        unknown = sorted(set(text.lower()) - set(_BRAILLE_DOTS))
        if unknown:
            raise UsageError(f"braille text {text!r}: expected letters a to z and blanks")
        return cls(f"braille {text!r}", partial(_braille_height, text=text.lower()))

    @classmethod
    def letters(cls, text: str = "A", size_mm: float = 6.0, relief_mm: float = 0.5) -> "Shape":
        """Raised letters, read along x.

        Parameters
        ----------
        text
            Printable letters. Default: ``A``.
        size_mm
            Height of the letters in the plane in mm. Default: 6.
        relief_mm
            Relief in mm. Default: 0.5.
        """
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
        return cls.from_heights(
            _beveled(inside, _PIXEL_MM, relief_mm), _PIXEL_MM, f"letters {text!r}"
        )

    @classmethod
    def from_heights(
        cls,
        raised_mm: FloatArray,
        pixel_mm: float,
        name: str = "height map",
        *,
        tile: bool = False,
    ) -> "Shape":
        """A height map: heights on a grid, bilinear between the middles of pixels.

        Parameters
        ----------
        raised_mm
            Heights in mm, ``(row, column)``, the first row towards the tip; the largest touches
            first. NaN is a hole.
        pixel_mm
            Size of a pixel in mm.
        name
            Name of the shape. Default: ``height map``.
        tile
            Whether the map repeats without end, in both directions. Default: False.

        Raises
        ------
        UsageError
            Not a grid of 2 x 2 pixels or more, infinite heights, or too large a grid.
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
        digest = sha256(np.ascontiguousarray(raised).tobytes()).hexdigest()
        origin: dict[str, object] = {
            "pixel_mm": float(pixel_mm),
            "pixels": list(raised.shape),
            "sha256": digest,
        }
        if tile:
            origin["tile"] = True
        height = partial(_map_height, heights_mm=filled, pixel_mm=pixel_mm, tile=tile)
        rows, columns = raised.shape
        half_mm = None if tile else (0.5 * columns * pixel_mm, 0.5 * rows * pixel_mm)
        return cls(name, height, half_size_mm=half_mm, origin=origin)

    @classmethod
    def read(
        cls,
        path: Path | str,
        pixel_mm: float,
        relief_mm: float = 0.5,
        *,
        tile: bool = False,
    ) -> "Shape":
        """A height map of a file: a picture, or heights in mm as CSV.

        Parameters
        ----------
        path
            A PNG picture, white raised over black: transparent pixels are low, and a picture of
            one opaque colour is raised there. Or a CSV with a height in mm per pixel, rows from
            the tip down, empty or ``nan`` for a hole. (Other pictures have no checksums: a
            damaged file would be another shape.)
        pixel_mm
            Size of a pixel in mm.
        relief_mm
            Height of white over black in mm; negative: of black over white. Default: 0.5.
        tile
            Whether the map repeats without end, in both directions. Default: False.

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
            return cls.from_heights(_table(path, content), pixel_mm, path.name, tile=tile)
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
            _LOGGER.info(
                f"{path.name}: its rim is raised, a plate with holes; --relief-mm {-relief_mm:g} "
                f"raises {'dark' if relief_mm > 0 else 'light'} parts instead"
            )
        return cls.from_heights(abs(relief_mm) * raised, pixel_mm, path.name, tile=tile)


SHAPES: Mapping[str, Callable[..., Shape]] = {
    name: getattr(Shape, name)
    for name in (
        "punch", "sphere", "cylinder", "plate", "bar", "edge", "grating", "dots",
        "braille", "letters",
    )
}  # fmt: skip


def resolve_shape(
    shape: str | Shape | FloatArray,
    pixel_mm: float | None = None,
    relief_mm: float | None = None,
    *,
    tile: bool = False,
) -> Shape:
    """The shape of a specification such as ``sphere:diameter_mm=4``, or of a file of heights.

    ``map.png:pixel_mm=0.05,tile=true`` is a file with its sizes.

    Parameters
    ----------
    shape
        A specification, the path of a height map, heights in mm ``(row, column)`` as for
        `Shape.from_heights`, or a `Shape`, which is returned unchanged.
    pixel_mm, relief_mm
        Sizes in mm of a height map, see `Shape.read`. Default: None, `shape` is none; the
        relief of a picture is 0.5.
    tile
        Whether a height map repeats without end. Default: False.

    Raises
    ------
    UsageError
        No such shape, size or file, with near names; a size that the shape does not use.
    """

    def size_of_pixel(heights: str, maker: str) -> float:
        if pixel_mm is None:
            expected = f"a size in mm; in Python fb.Shape.{maker}, pixel_mm=...)"
            problem = f"is missing, the size of a pixel of {heights}"
            raise UsageError(problem, argument="pixel_mm", expected=expected)
        return pixel_mm

    def read(path: Path) -> Shape:
        size_mm = size_of_pixel(str(path), "read(path")
        if relief_mm is not None and path.suffix.lower() in _TABLE_SUFFIXES:
            raise UsageError(
                f"is for a picture, and {path} has heights in mm", argument="relief_mm"
            )
        return Shape.read(path, size_mm, 0.5 if relief_mm is None else relief_mm, tile=tile)

    def heights(
        pixel_mm: float = _NO_SIZE, relief_mm: float = _NO_SIZE, *, tile: bool = False
    ) -> Shape:
        return resolve_shape(
            path, *(None if size is _NO_SIZE else size for size in (pixel_mm, relief_mm)), tile=tile
        )

    if isinstance(shape, str) and (found := _FILE_WITH_SIZES.fullmatch(shape)):
        path, settings = found.groups()
        unused = {"pixel_mm": pixel_mm, "relief_mm": relief_mm, "tile": tile or None}
        for argument, value in unused.items():
            if value is not None:
                raise UsageError("is part of the shape", argument=argument, found=value)
        return from_specification(f"heights:{settings}", "shape", {"heights": heights})
    if isinstance(shape, np.ndarray):
        if relief_mm is not None:
            raise UsageError(
                "is for a picture, and an array has heights in mm", argument="relief_mm"
            )
        size_mm = size_of_pixel("an array of heights", "from_heights(array")
        return Shape.from_heights(shape, size_mm, tile=tile)
    if not isinstance(shape, Shape | str):
        raise UsageError(argument="shape", found=shape, expected="a Shape, a text or a path")
    if isinstance(shape, Shape) or shape.partition(":")[0] in SHAPES:
        unused = {"pixel_mm": pixel_mm, "relief_mm": relief_mm, "tile": tile or None}
        for argument, value in unused.items():
            if value is not None:
                raise UsageError("is for a file of heights", argument=argument, found=value)
    if isinstance(shape, Shape):
        return shape
    return from_specification(shape, "shape", SHAPES, read, ".png or .csv")


# ---- Heights


def _check(**sizes_mm: float) -> None:
    for name, size_mm in sizes_mm.items():
        check_range(name, size_mm, _SIZE_MM)


def _check_text(name: str, text: str) -> None:
    if not text.strip():
        raise UsageError(f"{name} without a letter: nothing would touch")
    if len(text) > _MAX_LETTERS:
        raise UsageError(f"{name}: {len(text)} letters, expected at most {_MAX_LETTERS}")


def _punch_height(x: FloatArray, z: FloatArray, diameter_mm: float) -> FloatArray:
    return _raised(np.hypot(x, z) - 0.5 * diameter_mm, math.inf)


def _sphere_height(x: FloatArray, z: FloatArray, diameter_mm: float) -> FloatArray:
    return _round(np.hypot(x, z), diameter_mm)


def _cylinder_height(
    x: FloatArray, z: FloatArray, diameter_mm: float, length_mm: float
) -> FloatArray:
    return np.where(np.abs(z) <= 0.5 * length_mm, _round(x, diameter_mm), math.inf)


def _plate_height(x: FloatArray, z: FloatArray) -> FloatArray:
    return np.zeros(np.broadcast(x, z).shape)


def _bar_height(x: FloatArray, z: FloatArray, width_mm: float, length_mm: float) -> FloatArray:
    return _raised(_box(x, z, length_mm, width_mm), math.inf)


def _edge_height(x: FloatArray, z: FloatArray) -> FloatArray:
    return _raised(-z + 0.0 * x, math.inf)


def _grating_height(
    x: FloatArray, z: FloatArray, groove_mm: float, ridge_mm: float, relief_mm: float
) -> FloatArray:
    period_mm = groove_mm + ridge_mm
    off_mm = np.abs(_off_lattice(z, period_mm, 0))
    return _raised(0.5 * groove_mm - off_mm + 0.0 * x, relief_mm)


def _dots_height(
    x: FloatArray,
    z: FloatArray,
    spacing_mm: float,
    diameter_mm: float,
    relief_mm: float,
    columns: int,
    rows: int,
) -> FloatArray:
    off_x, off_z = _off_lattice(x, spacing_mm, columns), _off_lattice(z, spacing_mm, rows)
    away_mm = np.sqrt(off_x * off_x + off_z * off_z)  # a fifth of the time of hypot
    return _raised(away_mm - 0.5 * diameter_mm, relief_mm)


def _braille_height(x: FloatArray, z: FloatArray, text: str) -> FloatArray:
    has_dot = np.array([[dot in _BRAILLE_DOTS[letter] for dot in "123456"] for letter in text])
    middle = 0.5 * (len(text) - 1)
    # A dome is the cap of a ball.
    radius_mm = 0.5 * (_BRAILLE_DIAMETER_MM**2 / (4 * _BRAILLE_RELIEF_MM) + _BRAILLE_RELIEF_MM)
    # Of the nearest letter alone: from there its neighbours are beyond their domes.
    cell = np.clip(np.round(x / _BRAILLE_CELL_MM + middle), 0, len(text) - 1)
    cell_x_mm, letter = (cell - middle) * _BRAILLE_CELL_MM, cell.astype(np.int64)
    away_mm = np.full(np.broadcast(x, z).shape, math.inf)
    for dot in range(6):
        dot_x_mm = cell_x_mm + (-0.5 if dot < 3 else 0.5) * _BRAILLE_PITCH_MM
        dot_z_mm = (1 - dot % 3) * _BRAILLE_PITCH_MM
        dot_away_mm = np.hypot(x - dot_x_mm, z - dot_z_mm)
        away_mm = np.where(has_dot[letter, dot], np.minimum(away_mm, dot_away_mm), away_mm)
    return np.minimum(_round(away_mm, 2 * radius_mm), _BRAILLE_RELIEF_MM)


def _map_height(
    x: FloatArray, z: FloatArray, heights_mm: FloatArray, pixel_mm: float, *, tile: bool = False
) -> FloatArray:
    from scipy.ndimage import map_coordinates

    rows, columns = heights_mm.shape
    column = np.asarray(x) / pixel_mm + 0.5 * (columns - 1)
    row = 0.5 * (rows - 1) - np.asarray(z) / pixel_mm
    column, row = np.broadcast_arrays(column, row)
    if tile:
        around_mm = map_coordinates(heights_mm, [row, column], order=1, mode="grid-wrap")
        return np.where(around_mm < _HOLE_MM / 1e6, around_mm, math.inf)
    edge = 0.5 + 1e-9
    inside = (column >= -edge) & (column <= columns - 1 + edge)
    inside &= (row >= -edge) & (row <= rows - 1 + edge)
    interpolated_mm = map_coordinates(heights_mm, [row, column], order=1, mode="nearest")
    return np.where(inside & (interpolated_mm < _HOLE_MM / 1e6), interpolated_mm, math.inf)


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
        return np.asarray(x - spacing_mm * np.rint(x / spacing_mm))  # a tenth of that of %
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
