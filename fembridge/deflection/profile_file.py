"""A profile as TOML: small, readable, and sealed by a checksum."""

import hashlib
import tomllib
from pathlib import Path

import numpy as np

from fembridge.deflection.profile import Deflection
from fembridge.errors import ResponseError
from fembridge.outputs import write_text
from fembridge.typing import Table

FORMAT = 1
PROFILE_FILE = "deflection.toml"

_NUMBERS = ("distance_mm", "deflection_mm", "loading_mm", "loading_n_per_mm")


def write_profile(path: Path, deflection: Deflection) -> None:
    """Write `deflection`; the same profile gives the same bytes."""
    import tomli_w

    table: Table = {
        "format": FORMAT,
        "name": deflection.name,
        "elements": deflection.elements,
        "depth_mm": deflection.depth_mm,
        **{name: getattr(deflection, name).tolist() for name in _NUMBERS},
        "origin": dict(deflection.origin),
    }
    sealed = tomli_w.dumps(table)
    write_text(path, f"{_seal(sealed.encode())}\n{sealed}")


def read_profile(path: Path) -> Deflection:
    """Read a profile that `write_profile` wrote.

    Raises
    ------
    ResponseError
        The file is absent, no profile, or was altered after it was written.
    """
    try:
        content = path.read_bytes()
        table = tomllib.loads(content.decode())
    except OSError as error:
        raise ResponseError(f"{path}: not readable: {error.strerror}") from error
    except (ValueError, RecursionError) as error:  # no TOML, no UTF-8, nested deep
        raise ResponseError(f"{path}: not readable as a profile: {error}") from error
    if table.get("format") != FORMAT:
        raise ResponseError(
            f"{path}: format {table.get('format')!r}, expected {FORMAT}"
        )
    stated, _, sealed = content.partition(b"\n")
    if stated != _seal(sealed).encode():
        raise ResponseError(
            f"{path}: its numbers do not match its checksum: it was edited or cut"
        )
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


def _seal(sealed: bytes) -> str:
    """First line of the file: the checksum of all bytes below it."""
    return f'sha256 = "{hashlib.sha256(sealed).hexdigest()}"'
