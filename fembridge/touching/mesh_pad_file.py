"""The file of the pad of a mesh: an NPZ with its checksum, checked when it is opened.

Stress is stored in half precision with 7 bits of each number, which deflate packs: 1.4 bytes a
number, rounded by 1 in 250 at most and without bias. Displacements are in single precision.
"""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fembridge.errors import ResponseError
from fembridge.host.store import near_hint, replacing, structure
from fembridge.io.npz import NpzFile
from fembridge.io.number import parse_number
from fembridge.touching.mesh_pad import MeshPad, MeshSite
from fembridge.typing import FloatArray

FORMAT = 1
KIND = "mesh"
# Arrays by their dimensions, see `MeshPad`: N nodes, F triangles, P points.
_DIMENSIONS = {
    "node": "N",
    "position_mm": "N3",
    "normal": "N3",
    "area_mm2": "N",
    "triangles": "F3",
    "is_end": "N",
    "down_mm": "3NN",
    "point_mm": "P3",
    "point_layer": "P",
    "point_depth_mm": "P",
    "stress_scale_pa": "31P1",
    "stress": "36PN",
}
_KINDS = {"node": "i", "triangles": "i", "point_layer": "i", "is_end": "b"}
_TEXTS = ("about", "sha256")
_COPIES = 3
_MOST_TEXT_BYTES = 1 << 20
# Bits of a half-precision number that are kept after its leading one.
_KEPT_BITS, _HALF_BITS = 7, 10
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

    arrays = {name: np.asarray(getattr(pad, name)) for name in _DIMENSIONS}
    arrays["stress"] = _rounded(pad.stress)
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


def _rounded(stress: NDArray[np.float16]) -> NDArray[np.float16]:
    """`stress` to `_KEPT_BITS`, to the nearest; the lowest bits are 0."""
    dropped = _HALF_BITS - _KEPT_BITS
    bits = stress.view(np.uint16) + np.uint16(1 << (dropped - 1))
    bits &= np.uint16(0xFFFF ^ ((1 << dropped) - 1))
    return bits.view(np.float16)


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
        _check_headers(archive, error)
        arrays = {name: archive.read(name, _COPIES) for name in archive.headers}
    text, stated = (str(arrays.pop(name)) for name in _TEXTS)
    if stated != checksum(text, arrays):
        raise error("its numbers do not match its checksum: edited or cut")
    try:
        table = json.loads(text, parse_float=parse_number, parse_constant=parse_number)
    except (ValueError, RecursionError) as problem:
        raise error(f"about: {problem}") from problem
    about = structure(table, _About, lambda problem: error(f"about: {problem}"))
    if about.format != FORMAT:
        raise error(f"format {about.format!r}, expected {FORMAT}")
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


def _check_headers(archive: NpzFile, error: Callable[[str], ResponseError]) -> None:
    """Refuse arrays that are unknown, missing or inconsistent, from headers alone."""
    required = (*_DIMENSIONS, *_TEXTS)
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
        if dtype.kind != _KINDS.get(name, "f") or dtype.itemsize > 8 or min(shape, default=0) < 1:
            raise error(f"{name} holds {dtype} {shape}")
        dimensions = _DIMENSIONS[name]
        for letter, size in zip(dimensions, shape, strict=False):
            sizes.setdefault(letter, size)
        expected = tuple(sizes.get(letter, 0) for letter in dimensions)
        if shape != expected:
            raise error(f"{name} is {shape}, expected {expected} as other arrays have it")


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
