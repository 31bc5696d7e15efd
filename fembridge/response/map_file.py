"""A response map as TOML: small, readable, and sealed by a checksum."""

from pathlib import Path

import numpy as np

from fembridge.errors import ResponseError
from fembridge.response.response_map import IN_PLANE, ResponseMap
from fembridge.results.stress import TENSOR
from fembridge.run_folder import AfferentNode
from fembridge.store import read_sealed, write_sealed
from fembridge.typing import Table

FORMAT = 1
MAP_FILE = "response.toml"

_STORED = TENSOR[:IN_PLANE]


def write_map(path: Path, response: ResponseMap) -> None:
    """Write `response`; the same map gives the same bytes."""
    table: Table = {
        "format": FORMAT,
        "closure_percent": response.closure_percent,
        "depth_um": response.depth_um.tolist(),
        "force_n_per_mm": response.force_n_per_mm.tolist(),
        "origin": dict(response.origin),
        "afferents": {
            place.afferent: {
                **place.to_table(),
                **{
                    f"{name}_pa": response.tensor_pa[:, column, k].tolist()
                    for k, name in enumerate(_STORED)
                },
            }
            for column, place in enumerate(response.places)
        },
    }
    write_sealed(path, table)


def read_map(path: Path) -> ResponseMap:
    """Read a map that `write_map` wrote.

    Raises
    ------
    ResponseError
        The file is absent, not a map, or was altered after it was written.
    """
    table = read_sealed(path, "response map", FORMAT)
    try:
        afferents = table["afferents"]
        stored_pa = np.array(  # (afferent, component, K)
            [[place[f"{name}_pa"] for name in _STORED] for place in afferents.values()],
            dtype=np.float64,
        )
        tensor_pa = np.zeros((stored_pa.shape[-1], len(afferents), len(TENSOR)))
        tensor_pa[..., :IN_PLANE] = np.moveaxis(stored_pa, -1, 0)
        return ResponseMap(
            depth_um=np.array(table["depth_um"]),
            tensor_pa=tensor_pa,
            force_n_per_mm=np.array(table["force_n_per_mm"]),
            places=tuple(AfferentNode.from_table(name, place) for name, place in afferents.items()),
            closure_percent=float(table["closure_percent"]),
            origin=table["origin"],
        )
    except KeyError as error:
        raise ResponseError(f"{path}: not a response map: no {error}") from error
    except (TypeError, ValueError, AttributeError, ResponseError) as error:
        raise ResponseError(f"{path}: not a response map: {error}") from error
