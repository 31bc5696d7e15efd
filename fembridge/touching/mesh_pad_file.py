"""The file of the pad of a mesh: an NPZ with its checksum, checked when it is opened.

Stress and drag are rounded by 1 in 64 at most, displacement into the skin by 1 in 30 000, both
without bias; deflate packs a number of stress to 1.3 bytes and one of displacement to 1.9. A pad
that is its own mirror image about x = 0 is stored by half: forces on the nodes, and stress at the
points, that come first of each pair.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fembridge.errors import ResponseError
from fembridge.host.store import near_hint, replacing, structure
from fembridge.io.npz import NpzFile
from fembridge.io.number import parse_number
from fembridge.touching.mesh_pad import MeshPad, MeshSite
from fembridge.typing import FloatArray, IntArray

FORMAT = 2
_WHOLE_FORMAT = 1  # of files without mirror images and without an outline
KIND = "mesh"
# Arrays by their dimensions, see `MeshPad`: N nodes, F triangles, P points, L pieces of the
# outline; H and Q: nodes and points that come first of a pair of mirror images.
_DIMENSIONS = {
    "node": "N",
    "position_mm": "N3",
    "normal": "N3",
    "area_mm2": "N",
    "triangles": "F3",
    "is_end": "N",
    "down_mm": "3NH",
    "point_mm": "P3",
    "point_layer": "P",
    "point_depth_mm": "P",
    "stress_scale_pa": "31Q1",
    "stress": "36QN",
    "mirror_node": "N",
    "mirror_point": "P",
    "outline_mm": "L4",
}
_OF_FORMAT_2 = ("mirror_node", "mirror_point", "outline_mm")
_KINDS = dict.fromkeys(("node", "triangles", "point_layer", "mirror_node", "mirror_point"), "i")
_KINDS["is_end"] = "b"
_TEXTS = ("about", "sha256")
_COPIES = 3
_MOST_TEXT_BYTES = 1 << 20
# Bits that are kept after the leading one, of all there are: stress, displacement into the skin by
# forces along its tangents and into it. And with the type of the bits.
_STRESS_BITS, _DRAG_BITS, _INTO_BITS = 5, 5, 14
_ALL_BITS: Mapping[str, tuple[int, Any]] = {
    "float16": (10, np.uint16), "float32": (23, np.uint32)
}  # fmt: skip
# Signs in the mirror image: of forces across, into the skin, along; of xx, yy, zz, xy, yz, zx.
_FORCE_SIGNS = np.array([-1, 1, 1])
_STRESS_SIGNS = np.array([1, 1, 1, -1, 1, -1])
# Mirror images: distance in mm of two nodes, and share of the largest by which numbers differ.
_MIRROR_MM, _MIRROR_SHARE, _MIRROR_STRESS_SHARE = 1e-6, 1e-4, 0.02
# Reciprocity and positive energy, but for rounding.
_ROUNDING = 1e-3


@dataclass(frozen=True, slots=True)
class _About:
    """What a stored pad of a mesh says in JSON."""

    kind: str
    format: int
    name: str
    spacing_mm: float
    layers: tuple[str, ...]
    sites: dict[str, MeshSite]
    origin: dict[str, Any]


def write_mesh_pad(path: Path, pad: MeshPad) -> None:
    """Store `pad` with its checksum."""
    from fembridge.touching.pad_file import checksum

    node, point = _mirror_images(pad)
    half, points = _first_of_pairs(node), _first_of_pairs(point)
    bits = (_DRAG_BITS, _INTO_BITS, _DRAG_BITS)
    arrays = {
        name: np.asarray(getattr(pad, name))
        for name in _DIMENSIONS
        if not name.startswith("mirror")
    } | {
        "down_mm": np.stack(
            [
                _rounded(table[:, half].astype(np.float32), kept)
                for table, kept in zip(pad.down_mm, bits, strict=True)
            ]
        ),
        "stress": _rounded(pad.stress[:, :, points], _STRESS_BITS),
        "stress_scale_pa": pad.stress_scale_pa[:, :, points],
        "mirror_node": node,
        "mirror_point": point,
    }
    about = {
        "kind": KIND,
        "format": FORMAT,
        "name": pad.name,
        "spacing_mm": pad.spacing_mm,
        "layers": list(pad.layers),
        "sites": {name: asdict(site) for name, site in pad.sites.items()},
        "origin": dict(pad.origin),
    }
    text = json.dumps(about, sort_keys=True)
    with replacing(path) as draft, draft.open("wb") as file:
        np.savez_compressed(
            file,
            about=np.array(text),
            sha256=np.array(checksum(text, arrays)),
            **arrays,  # type: ignore[arg-type] # arrays alone
        )


def _rounded(values: NDArray[Any], kept_bits: int) -> NDArray[Any]:
    """Real numbers rounded to `kept_bits` after the leading one; lower bits are 0."""
    bits, kind = _ALL_BITS[values.dtype.name]
    dropped = bits - kept_bits
    patterns = np.ascontiguousarray(values).view(kind) + kind(1 << (dropped - 1))
    patterns &= ~kind((1 << dropped) - 1)
    rounded: NDArray[Any] = patterns.view(values.dtype)
    return rounded


def _first_of_pairs(mirror: IntArray) -> IntArray:
    """Rows that come first of a pair, or have no other."""
    return np.flatnonzero(np.arange(mirror.size) <= mirror)


def _mirror_images(pad: MeshPad) -> tuple[IntArray, IntArray]:
    """Rows of the mirror images of nodes and points about x = 0; the rows themselves if unlike."""
    node = _pairs(pad.position_mm)
    point = _pairs(np.column_stack([pad.point_mm, pad.point_layer]))  # layers may share a point
    if node is not None and point is not None:
        half, points = _first_of_pairs(node), _first_of_pairs(point)
        image = replace(
            pad,
            down_mm=_whole_down(pad.down_mm[:, :, half], node),
            stress=_whole_stress(pad.stress[:, :, points], node, point),
        )
        turned = pad.normal[node] * _FORCE_SIGNS
        alike = (
            (np.abs(turned - pad.normal).max(), _MIRROR_SHARE),
            (np.abs(image.down_mm - pad.down_mm).max(), _MIRROR_SHARE * pad.down_mm.max()),
            (np.abs(image.stress - pad.stress).max(), _MIRROR_STRESS_SHARE),
            (
                np.abs(pad.stress_scale_pa[:, :, point] / pad.stress_scale_pa - 1).max(),
                _MIRROR_STRESS_SHARE,
            ),
        )
        if all(difference <= most for difference, most in alike):
            return node, point
    return np.arange(pad.node.size), np.arange(len(pad.point_mm))


def _pairs(position_mm: FloatArray) -> IntArray | None:
    """Row of the mirror image of each position, whose first column is x; None if one has none."""
    from scipy.spatial import cKDTree

    mirrored_mm = position_mm.copy()
    mirrored_mm[:, 0] *= -1
    away_mm, row = cKDTree(position_mm).query(mirrored_mm)
    image: IntArray = np.asarray(row, dtype=np.int64)
    is_pair = away_mm.max() <= _MIRROR_MM and (image[image] == np.arange(image.size)).all()
    return image if is_pair else None


def _whole_down(half: NDArray[Any], node: IntArray) -> NDArray[Any]:
    """Displacements ``(3, N, N)`` of those under forces on the first nodes ``(3, N, H)``."""
    first = _first_of_pairs(node)
    all_down = np.empty((3, node.size, node.size), dtype=half.dtype)
    for table, image, sign in zip(all_down, half, _FORCE_SIGNS.tolist(), strict=True):
        table[:, node[first]] = sign * image[node]
        table[:, first] = image
    return all_down


def _whole_stress(half: NDArray[Any], node: IntArray, point: IntArray) -> NDArray[Any]:
    """Stress ``(3, 6, P, N)`` of that at the first points ``(3, 6, Q, N)``."""
    first = _first_of_pairs(point)
    all_stress = np.empty((3, 6, point.size, node.size), dtype=half.dtype)
    for force, component in np.ndindex(3, 6):
        sign = half.dtype.type(_FORCE_SIGNS[force] * _STRESS_SIGNS[component])
        table, image = all_stress[force, component], half[force, component]
        table[point[first]] = sign * image[:, node]
        table[first] = image
    return all_stress


def read_mesh_pad(path: Path) -> MeshPad:
    """A pad that `write_mesh_pad` stored.

    Raises
    ------
    ResponseError
        There is none, it was altered or cut, or has numbers that no pad has.
    """
    from fembridge.touching.pad_file import checksum, error_at

    error = error_at(path)
    with NpzFile(path, error) as archive:
        is_whole = not any(name in archive.headers for name in _OF_FORMAT_2)
        _check_headers(archive, error, is_whole=is_whole)
        arrays = {name: archive.read(name, _COPIES) for name in archive.headers}
    text, stated = (str(arrays.pop(name)) for name in _TEXTS)
    if stated != checksum(text, arrays):
        raise error("its numbers do not match its checksum: edited or cut")
    try:
        table = json.loads(text, parse_float=parse_number, parse_constant=parse_number)
    except (ValueError, RecursionError) as problem:
        raise error(f"about: {problem}") from problem
    about = structure(table, _About, lambda problem: error(f"about: {problem}"))
    expected = _WHOLE_FORMAT if is_whole else FORMAT
    if about.format != expected:
        raise error(f"format {about.format!r}, expected {expected}")
    if not is_whole:
        _check_pairs(arrays, error)
        node, point = arrays.pop("mirror_node"), arrays.pop("mirror_point")
        arrays["down_mm"] = _whole_down(arrays["down_mm"], node)
        arrays["stress"] = _whole_stress(arrays["stress"], node, point)
        scale_pa = np.empty((3, 1, point.size, 1))
        first = _first_of_pairs(point)
        scale_pa[:, :, point[first]] = scale_pa[:, :, first] = arrays["stress_scale_pa"]
        arrays["stress_scale_pa"] = scale_pa
    _check_arrays(arrays, about, error)
    return MeshPad(
        name=about.name,
        spacing_mm=about.spacing_mm,
        layers=about.layers,
        sites=about.sites,
        origin=about.origin,
        source=str(path),
        sha256=stated,
        **arrays,  # type: ignore[arg-type] # arrays alone
    )


def _check_headers(
    archive: NpzFile, error: Callable[[str], ResponseError], *, is_whole: bool
) -> None:
    """Refuse arrays that are unknown, missing or inconsistent, from headers alone."""
    dimensions_of = {
        name: dimensions.replace("H", "N").replace("Q", "P") if is_whole else dimensions
        for name, dimensions in _DIMENSIONS.items()
        if not (is_whole and name in _OF_FORMAT_2)
    }
    required = (*dimensions_of, *_TEXTS)
    for name in archive.headers:
        if name not in required:
            raise error(f"array {name!r} is of no pad{near_hint(name, required)}")
    sizes = {"3": 3, "6": 6, "1": 1}
    for name in required:
        header = archive.headers.get(name)
        if header is None:
            raise error(f"no array {name}")
        shape, dtype = header
        if name in _TEXTS:
            if shape or dtype.kind != "U" or dtype.itemsize > _MOST_TEXT_BYTES:
                raise error(f"{name} is {dtype} {shape}, expected a text")
            continue
        least = 0 if name == "outline_mm" else 1
        if (
            dtype.kind != _KINDS.get(name, "f")
            or dtype.itemsize > 8
            or min(shape, default=0) < least
        ):
            raise error(f"{name} holds {dtype} {shape}")
        dimensions = dimensions_of[name]
        for letter, size in zip(dimensions, shape, strict=False):
            sizes.setdefault(letter, size)
        expected = tuple(sizes.get(letter, 0) for letter in dimensions)
        if shape != expected:
            raise error(f"{name} is {shape}, expected {expected} as other arrays have it")


def _check_pairs(arrays: dict[str, NDArray[Any]], error: Callable[[str], ResponseError]) -> None:
    """Refuse mirror images that are no pairs, or as many as the arrays do not have."""
    for name, array, axis in (("mirror_node", "down_mm", 2), ("mirror_point", "stress", 2)):
        mirror = arrays[name]
        rows = np.arange(mirror.size)
        if not (mirror.min() >= 0 and mirror.max() < mirror.size):
            raise error(f"{name} has rows of no mirror image")
        if not (mirror[mirror] == rows).all():
            raise error(f"{name} has rows that are not in pairs")
        stored, expected = arrays[array].shape[axis], _first_of_pairs(mirror).size
        if stored != expected:
            raise error(f"{array} has {stored} columns, expected {expected} by {name}")


def _check_arrays(
    arrays: dict[str, NDArray[Any]], about: _About, error: Callable[[str], ResponseError]
) -> None:
    """Refuse numbers that no pad has; shapes are known to agree."""
    for name, array in arrays.items():
        if array.dtype.kind == "f" and not all(np.isfinite(part).all() for part in array):
            raise error(f"{name} is not finite everywhere")
    count, points = arrays["node"].size, arrays["point_layer"]
    if not (arrays["triangles"].min() >= 0 and arrays["triangles"].max() < count):
        raise error("triangles have corners that are no nodes")
    if not (points.min() >= 0 and points.max() < len(about.layers)):
        raise error("point_layer has numbers of no layer")
    for site in about.sites.values():
        if site.layer not in about.layers:
            raise error(f"about: layer {site.layer!r}{near_hint(site.layer, about.layers)}")
    if np.abs(np.linalg.norm(arrays["normal"], axis=1) - 1).max() > _ROUNDING:
        raise error("normal has vectors whose length is not 1")
    if not (about.spacing_mm > 0 and (arrays["area_mm2"] > 0).all()):
        raise error("spacing_mm or area_mm2 is not more than 0")
    if not ((arrays["stress_scale_pa"] > 0).all() and np.abs(arrays["stress"]).max() <= 1.01):
        raise error("stress is more than its scale")
    into: FloatArray = arrays["down_mm"][1]
    own_mm = np.diag(into)
    if not (own_mm > 0).all():
        raise error("down_mm of a node under its own force is not more than 0")
    if np.abs(into - into.T).max() > _ROUNDING * own_mm.max():
        raise error("down_mm is not reciprocal: a force here moves there, a force there not here")
