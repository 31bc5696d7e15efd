"""The file of a pad: an NPZ with its checksum, checked once when it is opened.

Shapes and types come from the headers of the arrays, before memory is taken. A file whose
checksum is right may still hold numbers that no pad has: a finger without a layer, a node
that moves towards the force on it. They are refused by the name of their array.
"""

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from decks.finger import LAYERS, Finger
from decks.section import section_of
from decks.unit_loads import PadMesh
from fembridge.errors import FingerError, ResponseError, UsageError
from fembridge.host.store import near_hint, replacing, structure
from fembridge.io.npz import NpzFile
from fembridge.io.number import parse_number
from fembridge.touching.mesh_pad import MeshPad
from fembridge.touching.mesh_pad_file import read_mesh_pad
from fembridge.touching.pad import Pad
from fembridge.touching.prism_pad import PrismPad, StressRow

FORMAT = 1

# Arrays of a stored pad by their dimensions, see `PrismPad`: N columns of nodes, P of them with
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
# Arrays as read, stress in single precision, and a margin.
_COPIES = 4
# Compliance of skin in mm/N: that of the stored pads is 0.3 to 30.
_COMPLIANCE_MM_PER_N = (1e-6, 1e6)
# Reciprocity and positive energy hold but for the solver's rounding, 2e-4 at most.
_ROUNDING = 0.02

STORED = Path(__file__).parent / "pads"


def write_pad(path: Path, pad: PrismPad) -> None:
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
            sha256=np.array(checksum(text, arrays)),
            **arrays,
        )


def read_pad(path: Path) -> Pad:
    """A pad that `write_pad` or `write_mesh_pad` stored.

    Raises
    ------
    ResponseError
        There is none, it was altered or cut, lacks an array or a key, or has numbers that
        no pad has: not finite, not rising, of another sign or shape.
    """
    error = error_at(path)
    with NpzFile(path, error) as archive:
        is_of_mesh = "triangles" in archive.headers
        if not is_of_mesh:
            _check_headers(archive, error)
            arrays = {name: archive.read(name, _COPIES) for name in archive.headers}
    if is_of_mesh:
        return read_mesh_pad(path)
    text, stated = (str(arrays.pop(name)) for name in _TEXTS)
    sound = stated == checksum(text, arrays)
    if not sound:
        raise error("its numbers do not match its checksum: edited or cut")
    try:
        table = json.loads(text, parse_float=parse_number, parse_constant=parse_number)
    except (ValueError, RecursionError) as problem:
        raise error(f"about: {problem}") from problem
    if isinstance(table, dict) and table.get("format", FORMAT) != FORMAT:
        raise error(f"format {table['format']!r}, expected {FORMAT}")
    about = structure(table, _About, lambda problem: error(f"about: {problem}"))
    finger = _finger(about.finger, error)
    _check_arrays(arrays, about, finger, error)
    stress_pa = arrays.pop("stress").astype(np.float32)
    stress_pa *= arrays["stress_scale_pa"].astype(np.float32)
    return PrismPad(
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
        source=str(path),
        sha256=stated,
    )


def resolve_pad(pad: str | Path | Pad) -> Pad:
    """The stored pad of a name, the pad of a file, or `pad` itself.

    Raises
    ------
    UsageError
        No such name and no such file.
    """
    if isinstance(pad, Pad):
        return pad
    if not isinstance(pad, str | Path):
        raise UsageError(argument="pad", found=pad, expected="a Pad, a name or a path")
    stored, path = STORED / f"{pad}.npz", Path(pad)
    try:
        if stored.is_file():
            return _stored(stored)
        if path.is_file():
            return read_pad(path)
    except OSError as error:  # a name that is too long
        raise UsageError(f"is {pad!r}: {error.strerror}", argument="pad", found=pad) from error
    names = sorted(path.stem for path in STORED.glob("*.npz"))
    expected = f"{', '.join(names)} or a file"
    problem = f"is {str(pad)!r}, expected {expected}{near_hint(str(pad), names)}"
    raise UsageError(problem, argument="pad", found=pad, expected=expected)


@cache
def _stored(path: Path) -> Pad:
    """A stored pad, read once."""
    pad = read_pad(path)
    if not isinstance(pad, PrismPad | MeshPad):
        raise ResponseError(f"{path}: neither the pad of a finger nor of a mesh")
    return replace(pad, source=path.stem)


def checksum(text: str, arrays: Mapping[str, Any]) -> str:
    """Checksum of the text and the arrays of a pad."""
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


def error_at(path: Path) -> Callable[[str], ResponseError]:
    """Maker of errors that name the file."""
    return lambda problem: ResponseError(f"{path}: {problem.removeprefix(f'{path}: ')}")


def _check_headers(archive: NpzFile, error: Callable[[str], ResponseError]) -> None:
    """Refuse arrays that are unknown, missing or inconsistent, from headers alone."""
    required = (*_DIMENSIONS, *_TEXTS)
    for name in archive.headers:
        if name not in required:
            raise error(f"array {name!r} is of no pad{near_hint(name, required)}")
    for name in required:
        if archive.headers.get(name) is None:
            raise error(f"no array {name}")
    headers = {name: header for name, header in archive.headers.items() if header is not None}
    sizes = {"3": 3, "6": 6, "1": 1}
    for name in _TEXTS:
        shape, dtype = headers[name]
        if shape or dtype.kind != "U" or dtype.itemsize > _MAX_TEXT_BYTES:
            raise error(f"{name} is {dtype} {shape}, expected a text")
    for name, dimensions in _DIMENSIONS.items():
        shape, dtype = headers[name]
        if dtype.kind != "f" or dtype.itemsize > 8 or min(shape, default=1) < 1:
            raise error(f"{name} holds {dtype} {shape}, expected real numbers")
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
