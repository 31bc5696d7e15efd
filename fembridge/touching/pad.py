"""The pad of a finger: what a unit force anywhere on its skin does to skin and afferents.

The finger is a prism along z, so a response depends on where across the finger force and
place are, ``x'`` and ``x``, and on ``z - z'``. It is a mirror image of itself about
``x = 0`` and about ``z = 0``: stored are forces with ``x' >= 0`` and places with
``z >= 0``, signs give the rest.

A plane pad is a slice of 1 mm in plane strain: what touches it has no end along z.

Stress is that in the middle of elements, from displacements and the material of that
element alone: nothing is averaged over two layers. `stress_rows` are rows of elements of
one layer, along the skin.
"""

import hashlib
import io
import json
import math
import warnings
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from decks.finger import LAYERS, Finger
from decks.green import PadMesh
from decks.section import Section, section_of
from fembridge.errors import FingerError, ResponseError, UsageError
from fembridge.memory import check_memory, check_unpacked, memory_limit_bytes, size_text
from fembridge.number import parse_number
from fembridge.store import near_hint, read_bytes, replacing, structure
from fembridge.typing import FloatArray, IntArray, SingleArray

FORMAT = 1
COMPONENTS = ("xx", "yy", "zz", "xy", "yz", "zx")
# What becomes of a stress or a force component under a mirror.
STRESS_FLIP = {"x": np.array([1, 1, 1, -1, 1, -1]), "z": np.array([1, 1, 1, 1, -1, -1])}
FORCE_FLIP = {"x": np.array([-1, 1, 1]), "z": np.array([1, 1, -1])}

# Nodes that may touch lie within half of this of the pad's middle, along the finger.
LATTICE_LENGTH_MM = 24.0

# Arrays of a stored pad by their dimensions, see `Pad`: N columns of nodes, P of them with
# x >= 0, K places of displacements along z, Z of stresses, R rows of M elements.
_DIMENSIONS = {
    "x_mm": "N",
    "y_mm": "N",
    "z_mm": "K",
    "stress_z_mm": "Z",
    "down_mm": "3PNK",
    "stress_scale_pa": "R31111",
    "stress": "R36PDZ",
    "row_arc_mm": "RM",
    "row_depth_mm": "RM",
}
_TEXTS = ("about", "sha256")
_MAX_TEXT_BYTES = 1 << 22
_HEADER_BYTES = 1 << 16
# Stored pads unpack to 1.1 and 2.7 times their size.
_MAX_RATIO, _SMALL_BYTES = 10, 1 << 28
# Arrays as read, stress in single precision, and a margin.
_COPIES = 4
# Compliance of skin in mm/N: that of the stored pads is 0.3 to 30.
_COMPLIANCE_MM_PER_N = (1e-6, 1e6)
# Reciprocity and positive energy hold but for the solver's rounding, 2e-4 at most.
_ROUNDING = 0.02

STORED = Path(__file__).parent / "pads"


@dataclass(frozen=True, slots=True, eq=False)
class StressRow:
    """Middles of a row of elements of `layer`, from the apex to the right.

    `arc_mm` and `depth_mm` ``(M,)``: along the smooth skin, and below it.
    """

    layer: str
    arc_mm: FloatArray
    depth_mm: FloatArray


@dataclass(frozen=True, eq=False)
class Pad:
    """Responses of the skin of `finger` to unit forces on it.

    `x_mm` ``(N,)`` and `y_mm` ``(N,)`` are the nodes that may touch, from left to right;
    on the finger they are `spacing_mm` apart along z. `z_mm` ``(K,)`` >= 0 are places of
    displacements, `stress_z_mm` ``(K - 1,)`` those of stresses.

    `down_mm` ``(3, N', N, K)`` is how far node n, z away, goes into the skin under 1 N
    on node n' along x, into the skin, along z; n' counts the nodes with x >= 0.
    `stress_pa` ``(R, 3, 6, N', 2 M, K - 1)`` is the stress in the middle of element m of
    `rows` ``R``, from left to right.
    """

    finger: Finger
    spacing_mm: float
    x_mm: FloatArray
    y_mm: FloatArray
    z_mm: FloatArray
    stress_z_mm: FloatArray
    down_mm: FloatArray
    stress_pa: FloatArray | SingleArray
    rows: tuple[StressRow, ...]
    origin: Mapping[str, Any] = field(default_factory=dict)

    BEYOND_ROWS: ClassVar[float] = 0.75
    """A unit may be this share of a row's thickness above or below the middles of rows."""

    @cached_property
    def section(self) -> Section:
        """The section of the finger, with its outline."""
        return section_of(self.finger)

    @property
    def plane(self) -> bool:
        """Whether it is the section alone: what touches is endless along z, forces are by mm."""
        return self.z_mm.size == 1

    @property
    def node_mm2(self) -> FloatArray:
        """Skin that a node of each column stands for, ``(N,)``."""
        return np.gradient(self.x_mm) * (1.0 if self.plane else self.spacing_mm)

    @property
    def reach_mm(self) -> float:
        """How far from the apex, across the finger, skin may be touched."""
        return float(self.x_mm[-1])

    @property
    def widest_mm(self) -> float:
        """How far from the apex, across the finger, stress is held."""
        arc_mm = min(float(row.arc_mm[-1]) for row in self.rows)
        section = self.section
        return float(np.interp(arc_mm, section.arc_mm, section.point_mm[:, 0]))

    @cached_property
    def compliance(self) -> FloatArray:
        """`down_mm` with all forces, ``(3, N, N, K)`` in mm/N."""
        mirrored = self.down_mm[:, :0:-1, ::-1, :] * FORCE_FLIP["x"][:, None, None, None]
        return np.concatenate([mirrored, self.down_mm], axis=1)

    @cached_property
    def lattice_compliance(self) -> FloatArray:
        """`compliance` ``(3, N', N, J)`` for nodes of the lattice, j times the spacing apart."""
        if self.plane:
            return self.compliance
        at_mm = np.arange(int(LATTICE_LENGTH_MM / self.spacing_mm) + 1.0) * self.spacing_mm
        check_memory(
            2 * 8 * 3 * self.x_mm.size**2 * at_mm.size, "the compliance of this pad", ResponseError
        )
        mirrored = np.concatenate([-self.z_mm[:0:-1], self.z_mm])
        place, weight = cubic_weights(mirrored, at_mm)
        weight[at_mm > self.z_mm[-1]] = 0.0
        spread = np.zeros((mirrored.size, at_mm.size))
        np.add.at(spread, (place, np.arange(at_mm.size)[:, None]), weight)
        far = self.z_mm.size - 1
        found = [
            table @ (spread[far:] + flip * np.pad(spread[far - 1 :: -1], ((1, 0), (0, 0))))
            for table, flip in zip(self.compliance, FORCE_FLIP["z"], strict=True)
        ]
        return np.stack(found)

    def depth_range_mm(self, layer: str, x_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Least and largest depth of which stress is held in `layer` under skin at `x_mm`.

        Raises
        ------
        UsageError
            The pad holds no stress in this layer.
        """
        rows = [row for row in self.rows if row.layer == layer]
        if len(rows) < 2:
            layers = ", ".join(dict.fromkeys(row.layer for row in self.rows))
            raise UsageError(f"the pad holds no stress in {layer}, but in {layers}")
        arc_mm = np.abs(self.arc_at(x_mm))
        upper, *_, lower = depths = [np.interp(arc_mm, row.arc_mm, row.depth_mm) for row in rows]
        least_mm = upper - self.BEYOND_ROWS * (depths[1] - upper)
        most_mm = lower + self.BEYOND_ROWS * (lower - depths[-2])
        return least_mm, most_mm

    def arc_at(self, x_mm: FloatArray) -> FloatArray:
        """Way along the smooth skin from the apex to `x_mm`, signed as it is."""
        section = self.section
        widest = int(section.point_mm[:, 0].argmax())
        x, arc = section.point_mm[: widest + 1, 0], section.arc_mm[: widest + 1]
        found: FloatArray = np.sign(x_mm) * np.interp(np.abs(x_mm), x, arc)
        return found

    def normal_at(self, x_mm: FloatArray) -> FloatArray:
        """Normal of the smooth skin in the section ``(place, 2)`` at `x_mm`."""
        right = self.section.point_mm[: int(self.section.point_mm[:, 0].argmax())]
        slope = np.sign(x_mm) * np.interp(
            np.abs(x_mm), right[:, 0], np.gradient(right[:, 1], right[:, 0])
        )
        return np.stack([-slope, np.ones_like(slope)], -1) / np.hypot(slope, 1.0)[:, None]


def cubic_weights(grid: FloatArray, at: FloatArray) -> tuple[IntArray, FloatArray]:
    """Four places of a rising `grid` around each of `at` ``(A,)``, and Lagrange's weights.

    Both ``(A, 4)``. Beyond the grid it is its end.
    """
    inside = np.clip(at, grid[0], grid[-1])
    first = np.clip(np.searchsorted(grid, inside) - 2, 0, grid.size - 4)
    place = first[:, None] + np.arange(4)
    knots = grid[place]
    weight = np.ones(place.shape)
    for one in range(4):
        for other in range(4):
            if one != other:
                weight[:, one] *= (inside - knots[:, other]) / (knots[:, one] - knots[:, other])
    return place, weight


def write_pad(path: Path, pad: Pad) -> None:
    """Store `pad` as NPZ with its checksum; stress in half precision (1 in 2000)."""
    from decks.presets import finger_table

    largest = np.maximum(np.abs(pad.stress_pa).max(axis=(2, 3, 4, 5), keepdims=True), 1e-9)
    arrays = {
        "x_mm": pad.x_mm,
        "y_mm": pad.y_mm,
        "z_mm": pad.z_mm,
        "stress_z_mm": pad.stress_z_mm,
        "down_mm": pad.down_mm.astype(np.float32),
        "stress_scale_pa": largest,
        "stress": (pad.stress_pa / largest).astype(np.float16),
        "row_arc_mm": np.stack([row.arc_mm for row in pad.rows]),
        "row_depth_mm": np.stack([row.depth_mm for row in pad.rows]),
    }
    about = {
        "format": FORMAT,
        "spacing_mm": pad.spacing_mm,
        "finger": finger_table(pad.finger),
        "layers": [row.layer for row in pad.rows],
        "origin": dict(pad.origin),
    }
    text = json.dumps(about, sort_keys=True)
    with replacing(path) as draft, draft.open("wb") as file:
        np.savez_compressed(
            file,
            about=np.array(text),
            sha256=np.array(_checksum(text, arrays)),
            **arrays,
        )


def read_pad(path: Path) -> Pad:
    """A pad that `write_pad` stored.

    Raises
    ------
    ResponseError
        There is none, it was altered or cut, lacks an array or a key, or has numbers that
        no pad has: not finite, not rising, of another sign or shape.
    """
    error = _error_at(path)
    content = read_bytes(path, memory_limit_bytes(), error)
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            _check_sizes(archive, len(content), error)
            arrays = {name: _array(archive, name) for name in archive.namelist()}
        arrays = {name.removesuffix(".npy"): array for name, array in arrays.items()}
        text, stated = (str(arrays.pop(name)) for name in _TEXTS)
        sound = stated == _checksum(text, arrays)
        table = json.loads(text, parse_float=parse_number, parse_constant=parse_number)
    except ResponseError:
        raise
    except Exception as problem:  # NumPy and zipfile raise a dozen kinds on a damaged archive
        raise error(f"not a pad that fembridge stored: {problem}") from problem
    if not sound:
        raise error("its numbers do not match its checksum: edited or cut")
    if isinstance(table, dict) and table.get("format", FORMAT) != FORMAT:
        raise error(f"format {table['format']!r}, expected {FORMAT}")
    about = structure(table, _About, lambda problem: error(f"about: {problem}"))
    finger = _finger(about.finger, error)
    _check_arrays(arrays, about, finger, error)
    stress_pa = arrays.pop("stress").astype(np.float32)
    stress_pa *= arrays["stress_scale_pa"].astype(np.float32)
    return Pad(
        finger=finger,
        spacing_mm=about.spacing_mm,
        x_mm=arrays["x_mm"],
        y_mm=arrays["y_mm"],
        z_mm=arrays["z_mm"],
        stress_z_mm=arrays["stress_z_mm"],
        down_mm=arrays["down_mm"].astype(np.float64),
        stress_pa=stress_pa,
        rows=tuple(
            StressRow(layer, arc_mm, depth_mm)
            for layer, arc_mm, depth_mm in zip(
                about.layers, arrays["row_arc_mm"], arrays["row_depth_mm"], strict=True
            )
        ),
        origin=about.origin,
    )


def pad_named(wanted: str | Pad) -> Pad:
    """A stored pad by its name, that of a file, or a pad as it is.

    Raises
    ------
    UsageError
        Neither is there.
    """
    if isinstance(wanted, Pad):
        return wanted
    stored, path = STORED / f"{wanted}.npz", Path(wanted)
    try:
        if stored.is_file():
            return _stored(stored)
        if path.is_file():
            return read_pad(path)
    except OSError as error:  # a name that is too long
        raise UsageError(f"pad {wanted!r}: {error.strerror}") from error
    names = [path.stem for path in STORED.glob("*.npz")]
    raise UsageError(
        f"pad {wanted!r}: neither a stored one ({', '.join(sorted(names))}) nor a file"
        + near_hint(str(wanted), names)
    )


@cache
def _stored(path: Path) -> Pad:
    """A stored pad, read once: one touch after the other is on the same."""
    return read_pad(path)


def _checksum(text: str, arrays: Mapping[str, Any]) -> str:
    digest = hashlib.sha256(text.encode())
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"{name} {array.dtype.str} {array.shape}".encode())
        digest.update(array.reshape(-1).view(np.uint8).data)
    return digest.hexdigest()


# ---- What a file may hold


@dataclass(frozen=True, slots=True)
class _About:
    """What a stored pad says in JSON."""

    format: int
    spacing_mm: float
    finger: dict[str, Any]
    layers: tuple[str, ...]
    origin: dict[str, Any]


def _error_at(path: Path) -> Callable[[str], ResponseError]:
    return lambda problem: ResponseError(f"{path}: {problem.removeprefix(f'{path}: ')}")


def _check_sizes(
    archive: zipfile.ZipFile, packed_bytes: int, error: Callable[[str], ResponseError]
) -> None:
    """Refuse arrays that are unknown, missing, inconsistent or too large, from headers alone."""
    required = (*_DIMENSIONS, *_TEXTS)
    names = [info.filename.removesuffix(".npy") for info in archive.infolist()]
    for name in names:
        if name not in required:
            raise error(f"array {name!r} is of no pad{near_hint(name, required)}")
        if names.count(name) > 1:
            raise error(f"array {name} twice")
    for name in required:
        if name not in names:
            raise error(f"no array {name}")
    total_bytes = sum(info.file_size for info in archive.infolist())
    if total_bytes > max(_SMALL_BYTES, _MAX_RATIO * packed_bytes):
        raise error(
            f"unpacks to {size_text(total_bytes)}, more than {_MAX_RATIO} times its "
            f"{size_text(packed_bytes)}"
        )
    check_unpacked(packed_bytes, total_bytes, "this pad", error, copies=_COPIES)
    sizes = {"3": 3, "6": 6, "1": 1}
    for name in _TEXTS:
        shape, dtype = _header(archive, f"{name}.npy", error)
        if shape or dtype.kind != "U" or dtype.itemsize > _MAX_TEXT_BYTES:
            raise error(f"{name} is {dtype} {shape}, expected a text")
    for name, dimensions in _DIMENSIONS.items():
        shape, dtype = _header(archive, f"{name}.npy", error)
        if dtype.kind != "f" or dtype.itemsize > 8:
            raise error(f"{name} holds {dtype}, expected real numbers")
        if len(shape) == len(dimensions):
            for letter, size in zip(dimensions, shape, strict=True):
                sizes.setdefault(letter, size)
        expected = tuple(sizes.get(letter, 0) for letter in dimensions)
        if shape != expected:
            raise error(f"{name} is {shape}, expected {expected} as other arrays have it")
        if name == "stress_z_mm":  # all sizes of nodes are known
            sizes["P"] = (sizes["N"] + 1) // 2
            if sizes["N"] % 2 == 0 or sizes["N"] < 3:
                raise error(f"x_mm has {sizes['N']} columns, expected an odd number of 3 or more")
            plane = sizes["K"] == 1
            if not plane and sizes["K"] < 3:
                raise error(f"z_mm has {sizes['K']} places, expected 1, or 3 and more")
            if sizes["Z"] != (1 if plane else sizes["K"] - 1):
                raise error(
                    f"stress_z_mm has {sizes['Z']} places, expected one between two of z_mm"
                )
    if sizes["D"] != 2 * sizes["M"] or sizes["M"] < 2:
        raise error(f"stress has {sizes['D']} elements a row, row_arc_mm has {sizes['M']}")


def _header(
    archive: zipfile.ZipFile, file: str, error: Callable[[str], ResponseError]
) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Shape and type of an array, which must be as large as the archive states."""
    info = archive.getinfo(file)
    name = file.removesuffix(".npy")
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise error(f"{name} is packed by another method than NumPy's")
    with archive.open(info) as member:
        start = io.BytesIO(member.read(_HEADER_BYTES))
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # a header of Python 2
        version = np.lib.format.read_magic(start)
        readers = {
            (1, 0): np.lib.format.read_array_header_1_0,
            (2, 0): np.lib.format.read_array_header_2_0,
        }
        if version not in readers:
            raise error(f"{name} is an array of format {version}, expected 1.0 or 2.0")
        shape, _, dtype = readers[version](start)
    if min(shape, default=1) < 1 or dtype.hasobject:
        raise error(f"{name} is {dtype} {shape}, expected numbers")
    if start.tell() + math.prod(shape) * dtype.itemsize != info.file_size:
        raise error(f"{name} has {info.file_size} bytes, not those of {dtype} {shape}")
    return shape, dtype


def _array(archive: zipfile.ZipFile, file: str) -> NDArray[Any]:
    with archive.open(file) as member:
        array: NDArray[Any] = np.lib.format.read_array(member, allow_pickle=False)
    return array


def _finger(table: Mapping[str, Any], error: Callable[[str], ResponseError]) -> Finger:
    """The finger of a stored pad, which must be there in full."""
    from decks.presets import finger_from, finger_table

    try:
        finger = finger_from(table, name="")
    except FingerError as problem:
        raise error(f"about: finger: {problem}") from problem
    if missing := _missing_key(table, finger_table(finger)):
        raise error(f"about: finger: no {missing}")
    return finger


def _missing_key(table: Mapping[str, Any], full: Mapping[str, Any]) -> str:
    """The first key of `full` that `table` lacks, with its place; "" where it has all."""
    for key, value in full.items():
        if key not in table:
            return key
        if isinstance(value, Mapping) and (below := _missing_key(table[key], value)):
            return f"{key}.{below}"
    return ""


def _check_arrays(
    arrays: Mapping[str, NDArray[Any]],
    about: _About,
    finger: Finger,
    error: Callable[[str], ResponseError],
) -> None:
    """Refuse numbers that no pad of `finger` has; shapes are known to agree."""
    least_mm, most_mm = PadMesh.RANGES["spacing_mm"]
    if not least_mm <= about.spacing_mm <= most_mm:
        raise error(f"spacing_mm is {about.spacing_mm:g}, expected {least_mm:g} to {most_mm:g}")
    for name, array in arrays.items():
        if not all(np.isfinite(part).all() for part in array):
            raise error(f"{name} is not finite everywhere")
    _check_places(arrays, about, finger, error)
    _check_compliance(arrays["down_mm"], error)
    stress, scale_pa = arrays["stress"], arrays["stress_scale_pa"]
    for row, direction in np.ndindex(stress.shape[:2]):
        largest, factor = np.abs(stress[row, direction]).max(), scale_pa[row, direction].item()
        axial = arrays["z_mm"].size == 1 and direction == 2  # in plane strain nothing answers
        if not (0 < factor < 1e12 and (abs(largest - 1) < 1e-3 or (axial and not largest))):
            raise error(
                f"stress of row {row + 1} under a force along {'xyz'[direction]} is "
                f"{largest:g} times its scale of {factor:g} Pa, expected 1"
            )


def _check_places(
    arrays: Mapping[str, NDArray[Any]],
    about: _About,
    finger: Finger,
    error: Callable[[str], ResponseError],
) -> None:
    """Refuse places of nodes and stresses that are not in order or not on `finger`."""
    x_mm, y_mm, z_mm, stress_z_mm = (
        arrays[name].astype(np.float64) for name in ("x_mm", "y_mm", "z_mm", "stress_z_mm")
    )
    arc_mm, depth_mm = (arrays[name].astype(np.float64) for name in ("row_arc_mm", "row_depth_mm"))
    step_mm = np.diff(x_mm)
    if not ((step_mm > 0) & (step_mm < 1.5 * about.spacing_mm)).all():
        raise error(f"x_mm does not rise by about spacing_mm, {about.spacing_mm:g}")
    if np.abs(x_mm + x_mm[::-1]).max() > 1e-6 or np.abs(y_mm - y_mm[::-1]).max() > 1e-6:
        raise error("x_mm and y_mm are not mirror images about x = 0")
    outline = finger.outline
    if x_mm[-1] > outline.half_width_mm + 1e-6:
        raise error(f"x_mm reaches {x_mm[-1]:g} mm, the finger {outline.half_width_mm:g}")
    if y_mm.max() > 1e-6 or y_mm.min() < -2 * outline.half_height_mm:
        raise error("y_mm is not on the skin of the finger, which is at 0 and below")
    if z_mm[0] != 0 or (np.diff(z_mm) <= 0).any():
        raise error("z_mm does not rise from 0")
    between = (
        stress_z_mm == 0 if z_mm.size == 1 else (stress_z_mm > z_mm[:-1]) & (stress_z_mm < z_mm[1:])
    )
    if not between.all():
        raise error("stress_z_mm does not lie between the places of z_mm")
    if len(about.layers) != len(arc_mm):
        raise error(f"about: {len(about.layers)} layers, expected one a row: {len(arc_mm)}")
    if not ((arc_mm[:, 0] > 0).all() and (np.diff(arc_mm, axis=1) > 0).all()):
        raise error("row_arc_mm does not rise from the apex")
    if arc_mm.max() > section_of(finger).end_arc_mm:
        raise error(f"row_arc_mm reaches {arc_mm.max():g} mm, beyond the back of the finger")
    if depth_mm.min() <= 0 or depth_mm.max() > 2 * outline.half_height_mm:
        raise error("row_depth_mm is not inside the finger")
    for layer in dict.fromkeys(about.layers):
        if layer not in LAYERS:
            raise error(f"about: layer {layer!r}{near_hint(layer, LAYERS)}")
        rows = [row for row, name in enumerate(about.layers) if name == layer]
        if len(rows) < 2 or (np.diff(depth_mm[rows], axis=0) <= 0).any():
            raise error(f"row_depth_mm does not rise in {layer}, of which there are {len(rows)}")
        top_mm, bottom_mm = _layer_mm(finger, layer)
        apex_mm = depth_mm[rows, 0]
        if apex_mm[0] < top_mm or apex_mm[-1] > bottom_mm:
            raise error(
                f"row_depth_mm is {apex_mm[0]:.3g} to {apex_mm[-1]:.3g} at the apex in {layer}, "
                f"expected {top_mm:.3g} to {bottom_mm:.3g}"
            )


def _layer_mm(finger: Finger, layer: str) -> tuple[float, float]:
    """Depths between which `layer` lies under the apex, ridges and papillae included."""
    skin, beyond_mm = finger.skin, finger.ridges.height_mm + finger.papillae.height_mm
    thick_mm = (skin.stratum_corneum_mm, skin.epidermis_mm, skin.dermis_mm)
    bottom_mm = np.cumsum(thick_mm).tolist()
    boundaries_mm = dict(
        zip(LAYERS, zip([0.0, *bottom_mm], [*bottom_mm, 1e3], strict=True), strict=False)
    )
    top, bottom = boundaries_mm.get(layer, (0.0, 0.0))
    return top - beyond_mm, bottom + beyond_mm


def _check_compliance(down_mm: NDArray[Any], error: Callable[[str], ResponseError]) -> None:
    """Refuse skin that does not yield to a force, or breaks reciprocity or positive energy."""
    middle = down_mm.shape[1] - 1
    column = np.arange(middle + 1)
    own_mm = down_mm[1, column, middle + column, 0].astype(np.float64)
    least, most = _COMPLIANCE_MM_PER_N
    if not ((own_mm > least) & (own_mm < most)).all():
        raise error(f"down_mm of a node under its own force is not {least:g} to {most:g} mm/N")
    bound_mm = np.sqrt(np.outer(own_mm, np.concatenate([own_mm[:0:-1], own_mm])))
    if (np.abs(down_mm[1]).max(axis=-1) > (1 + _ROUNDING) * bound_mm).any():
        raise error("down_mm of a node is larger under another node's force than under its own")
    right = down_mm[1, :, middle:]
    if np.abs(right - right.swapaxes(0, 1)).max() > _ROUNDING * own_mm.max():
        raise error("down_mm is not reciprocal: a force here moves there, a force there not here")
    if np.abs(down_mm[[0, 2]]).max() > 100 * own_mm.max():
        raise error("down_mm under a force along the skin is too large")
