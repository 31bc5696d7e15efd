"""The stored profiles: for machines without a solver, and for the validation page.

Each is the ``deflection.toml`` that ``fembridge deflect --finger NAME --solver run``
writes. From the coarsest mesh to the finest.
"""

from pathlib import Path

from fembridge.deflection.profile import Deflection
from fembridge.deflection.profile_file import read_profile
from fembridge.errors import ResponseError

FOLDER = Path(__file__).parent / "profiles"


def stored_deflections() -> tuple[Deflection, ...]:
    """Give the profiles of all meshes that are stored, the coarsest first.

    Raises
    ------
    ResponseError
        None is stored, or one was altered.
    """
    found = [read_profile(path) for path in sorted(FOLDER.glob("*.toml"))]
    if not found:
        raise ResponseError(f"{FOLDER}: no profile is stored there")
    return tuple(sorted(found, key=lambda deflection: deflection.elements))


def stored_deflection(name: str) -> Deflection:
    """Give the stored profile of the mesh called `name`.

    Raises
    ------
    ResponseError
        None is stored for it: it takes a solver.
    """
    stored = {deflection.name: deflection for deflection in stored_deflections()}
    if name not in stored:
        raise ResponseError(
            f"no deflection is stored for finger {name!r}, only for "
            f"{', '.join(stored)}; --solver run solves it"
        )
    return stored[name]
