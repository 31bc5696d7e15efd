"""A profile as TOML: small, readable, and sealed by a checksum."""

from pathlib import Path

import numpy as np

from fembridge.deflection.profile import Deflection
from fembridge.errors import ResponseError
from fembridge.store import read_sealed, write_sealed
from fembridge.typing import Table

FORMAT = 1
PROFILE_FILE = "deflection.toml"

_NUMBERS = ("distance_mm", "deflection_mm", "loading_mm", "loading_n_per_mm")


def write_profile(path: Path, deflection: Deflection) -> None:
    """Write `deflection`; the same profile gives the same bytes."""
    table: Table = {
        "format": FORMAT,
        "name": deflection.name,
        "elements": deflection.elements,
        "depth_mm": deflection.depth_mm,
        **{name: getattr(deflection, name).tolist() for name in _NUMBERS},
        "origin": dict(deflection.origin),
    }
    write_sealed(path, table)


def read_profile(path: Path) -> Deflection:
    """Read a profile that `write_profile` wrote.

    Raises
    ------
    ResponseError
        The file is absent, no profile, or was altered after it was written.
    """
    table = read_sealed(path, "profile", FORMAT)
    try:
        return Deflection(
            name=str(table["name"]),
            elements=int(table["elements"]),
            depth_mm=float(table["depth_mm"]),
            origin=table["origin"],
            **{name: np.array(table[name], dtype=np.float64) for name in _NUMBERS},
        )
    except KeyError as error:
        raise ResponseError(f"{path}: not a profile: no {error}") from error
    except (TypeError, ValueError, ResponseError) as error:
        raise ResponseError(f"{path}: not a profile: {error}") from error
