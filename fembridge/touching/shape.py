"""What touches the skin: rigid shapes as heights over a plane, and their words.

Seen from above the finger, x is to the right and z towards the tip. A shape's height is
0 where it is lowest, rises from there and is infinite where there is no shape; its middle
is at the origin until it is `rotated` or `moved`. Edges rise at 45 degrees, as they do on
embossed plates.

A word is a shape's name and its sizes, ``bar:width_mm=1,length_mm=8``.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fembridge.errors import UsageError
from fembridge.touching.named import named
from fembridge.typing import BoolArray, FloatArray

Height = Callable[[FloatArray, FloatArray], FloatArray]

# The least and the most that a length of a shape may be.
_LEAST_MM, _MOST_MM = 0.01, 200.0
# Where a shape ends, its edge is so high: more than the skin can follow.
_SLOPE_MM = 2.0
# Letters are drawn as grids this fine.
_PIXEL_MM = 0.05
_MOST_PIXELS = 20_000_000
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

        def height(x: FloatArray, z: FloatArray) -> FloatArray:
            off_x, off_z = (
                _off_lattice(each, spacing_mm, count) for each, count in ((x, columns), (z, rows))
            )
            return _raised(np.hypot(off_x, off_z) - 0.5 * diameter_mm, relief_mm)

        return cls(f"dots {spacing_mm:g} mm", height)

    @classmethod
    def braille(cls, text: str = "a") -> "Shape":
        """Small letters in Braille, read along x; domes of standard size."""
        unknown = sorted(set(text.lower()) - set(_BRAILLE_DOTS))
        if unknown or not text:
            raise UsageError(f"braille text {text!r}: expected letters a to z and blanks")
        middle = 0.5 * (len(text) - 1)
        places = [
            (
                (n - middle) * _BRAILLE_CELL_MM
                + (-0.5 if dot in "123" else 0.5) * _BRAILLE_PITCH_MM,
                (1 - "123456".index(dot) % 3) * _BRAILLE_PITCH_MM,
            )
            for n, letter in enumerate(text.lower())
            for dot in _BRAILLE_DOTS[letter]
        ]
        if not places:
            raise UsageError("braille text of blanks alone: nothing would touch")
        # A dome is the cap of a ball.
        radius_mm = 0.5 * (_BRAILLE_DIAMETER_MM**2 / (4 * _BRAILLE_RELIEF_MM) + _BRAILLE_RELIEF_MM)

        def height(x: FloatArray, z: FloatArray) -> FloatArray:
            away_mm = np.min([np.hypot(x - at_x, z - at_z) for at_x, at_z in places], axis=0)
            return np.minimum(_round(away_mm, 2 * radius_mm), _BRAILLE_RELIEF_MM)

        return cls(f"braille {text!r}", height)

    @classmethod
    def letters(cls, text: str = "A", size_mm: float = 6.0, relief_mm: float = 0.5) -> "Shape":
        """Raised letters `size_mm` high, read along x."""
        _check(size_mm=size_mm, relief_mm=relief_mm)
        from matplotlib.path import Path as Outline
        from matplotlib.textpath import TextPath

        if not text.strip():
            raise UsageError("no letters, expected a text")
        path = TextPath((0, 0), text, size=100)
        low, high = path.get_extents().get_points()
        scale = size_mm / (high - low)[1]
        columns, rows = (np.ceil((high - low) * scale / _PIXEL_MM) + 2 / _PIXEL_MM).astype(int)
        x = (np.arange(columns) - 0.5 * (columns - 1)) * _PIXEL_MM
        z = (0.5 * (rows - 1) - np.arange(rows)) * _PIXEL_MM
        grid = np.stack(np.meshgrid(x, z), -1).reshape(-1, 2) / scale + 0.5 * (low + high)
        outlines = [Outline(each).contains_points(grid) for each in path.to_polygons()]
        inside = np.logical_xor.reduce(outlines).reshape(rows, columns)  # an O has two
        return cls.of_grid(_beveled(inside, _PIXEL_MM, relief_mm), _PIXEL_MM, f"letters {text!r}")

    @classmethod
    def of_grid(cls, raised_mm: FloatArray, pixel_mm: float, name: str = "height map") -> "Shape":
        """Heights on a grid ``(row, column)``, the first row towards the tip.

        The largest of `raised_mm` touches first; NaN is a hole, and so is what is beside
        the grid. Between middles of pixels heights are bilinear.
        """
        raised = np.array(raised_mm, dtype=np.float64)
        if raised.ndim != 2 or min(raised.shape) < 2:
            raise UsageError(f"{name}: a grid {raised.shape}, expected 2 x 2 pixels or more")
        if raised.size > _MOST_PIXELS:
            raise UsageError(f"{name}: {raised.size} pixels, expected at most {_MOST_PIXELS}")
        if not np.isfinite(raised).any() or np.isposinf(raised).any():
            raise UsageError(f"{name}: heights must be finite, or NaN where there is none")
        _check(pixel_mm=pixel_mm * min(raised.shape))
        filled = np.where(np.isfinite(raised), np.nanmax(raised) - raised, _HOLE_MM)
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
        rows from the tip down, empty where there is a hole.

        Raises
        ------
        UsageError
            No such file, no picture, no numbers, or rows of unequal length.
        """
        path = Path(path)
        try:
            content = path.read_bytes()
        except OSError as error:
            raise UsageError(f"{path}: cannot be read: {error.strerror}") from error
        if path.suffix.lower() in (".csv", ".txt"):
            return cls.of_grid(_table(path, content), pixel_mm, path.name)
        _check(relief_mm=abs(relief_mm))
        import io

        from matplotlib.image import imread

        try:
            picture = np.asarray(
                imread(io.BytesIO(content), format=path.suffix[1:].lower() or None)
            )
        except Exception as error:  # Pillow raises many kinds
            raise UsageError(
                f"{path}: not a picture of heights: {error}; expected .png or .csv"
            ) from error
        grey = picture.astype(np.float64) / (255.0 if picture.dtype == np.uint8 else 1.0)
        solid = grey[..., 3] if grey.ndim == 3 and grey.shape[2] == 4 else np.ones(grey.shape[:2])
        light = grey if grey.ndim == 2 else grey[..., :3] @ (0.299, 0.587, 0.114)
        drawn = light[solid > 0.5]
        if drawn.size and np.ptp(drawn) == 0:
            light = np.full_like(light, float(relief_mm > 0))
        raised = (light if relief_mm > 0 else 1.0 - light) * solid
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
        No such shape, size or file; near ones are named.
    """

    def read(path: Path) -> Shape:
        if pixel_mm is None:
            raise UsageError(f"{word}: give the size of a pixel, --pixel-mm")
        return Shape.read(path, pixel_mm, 0.5 if relief_mm is None else relief_mm, log)

    return named(word, "shape", SHAPES, read, ".png or .csv")


# ---- Heights


def _check(**sizes_mm: float) -> None:
    for name, size_mm in sizes_mm.items():
        if not _LEAST_MM <= size_mm <= _MOST_MM:
            raise UsageError(f"{name} is {size_mm:g}, expected {_LEAST_MM:g} to {_MOST_MM:g}")


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


def _table(path: Path, content: bytes) -> FloatArray:
    """Numbers of a CSV without a header; an empty cell is NaN."""
    rows: list[list[float]] = []
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise UsageError(f"{path}: not a table of heights: {error}") from error
    separator = max(",;\t", key=text.count)
    for line, row in enumerate(text.splitlines(), start=1):
        if not row.strip():
            continue
        try:
            rows.append(
                [float(cell) if cell.strip() else math.nan for cell in row.split(separator)]
            )
        except ValueError as error:
            raise UsageError(f"{path}:{line}: {error}, expected heights in mm") from error
        if len(rows[-1]) != len(rows[0]):
            raise UsageError(f"{path}:{line}: {len(rows[-1])} heights, expected {len(rows[0])}")
    return np.array(rows or [[]])
