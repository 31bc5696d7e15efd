"""A response map as TOML: small, readable, and sealed by a checksum."""

import hashlib
import tomllib
from pathlib import Path

import numpy as np

from fembridge.errors import ResponseError
from fembridge.outputs import write_text
from fembridge.response.response_map import ResponseMap
from fembridge.results.stress import TENSOR
from fembridge.run_folder import AfferentNode
from fembridge.typing import Table

FORMAT = 1
MAP_FILE = "response.toml"

# Plane strain: the out-of-plane shears are rounding noise of the solver.
_STORED = TENSOR[:4]


def write_map(path: Path, response: ResponseMap) -> None:
    """Write `response`; the same map gives the same bytes."""
    import tomli_w

    table: Table = {
        "format": FORMAT,
        "closure_percent": response.closure_percent,
        "depth_um": response.depth_um.tolist(),
        "force_n_per_mm": response.force_n_per_mm.tolist(),
        "origin": dict(response.origin),
        "afferents": {
            place.afferent: {
                "node": place.node,
                "layer": place.layer,
                "x_mm": place.x_mm,
                "y_mm": place.y_mm,
                "depth_mm": place.depth_mm,
                **{
                    f"{name}_pa": response.tensor_pa[:, column, k].tolist()
                    for k, name in enumerate(_STORED)
                },
            }
            for column, place in enumerate(response.places)
        },
    }
    text = tomli_w.dumps({"sha256": _digest(table), **table})
    write_text(path, text)


def read_map(path: Path) -> ResponseMap:
    """Read a map that `write_map` wrote.

    Raises
    ------
    ResponseError
        The file is absent, not a map, or was altered after it was written.
    """
    try:
        with path.open("rb") as file:
            table = tomllib.load(file)
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ResponseError(f"{path}: not readable as a response map: {error}") from (
            error
        )
    stated = table.pop("sha256", None)
    if table.get("format") != FORMAT:
        raise ResponseError(
            f"{path}: format {table.get('format')!r}, expected {FORMAT}"
        )
    if stated != _digest(table):
        raise ResponseError(
            f"{path}: its numbers do not match its checksum: it was edited or cut"
        )
    try:
        afferents = table["afferents"]
        tensor_pa = np.zeros((len(table["depth_um"]), len(afferents), len(TENSOR)))
        for column, place in enumerate(afferents.values()):
            for k, name in enumerate(_STORED):
                tensor_pa[:, column, k] = place[f"{name}_pa"]
        return ResponseMap(
            depth_um=np.array(table["depth_um"]),
            tensor_pa=tensor_pa,
            force_n_per_mm=np.array(table["force_n_per_mm"]),
            places=tuple(
                AfferentNode(
                    name,
                    place["node"],
                    place["layer"],
                    place["x_mm"],
                    place["y_mm"],
                    place["depth_mm"],
                )
                for name, place in afferents.items()
            ),
            closure_percent=table["closure_percent"],
            origin=table["origin"],
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ResponseError(f"{path}: not a response map: {error!r}") from error


def _digest(table: Table) -> str:
    import tomli_w

    return hashlib.sha256(tomli_w.dumps(table).encode()).hexdigest()
