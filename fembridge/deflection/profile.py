"""The profile of the skin's surface under a probe: its file, those stored, several meshes.

A profile is TOML, sealed by a checksum. Those in ``profiles`` are for machines without
a solver, and for the validation page: each is the ``deflection.toml`` that
``fembridge deflect --finger NAME --solver run`` writes.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fembridge.errors import ResponseError, UsageError
from fembridge.store import read_sealed, write_sealed
from fembridge.typing import FloatArray, Table

FORMAT = 1
PROFILE_FILE = "deflection.toml"
FOLDER = Path(__file__).parent / "profiles"
PAPER_STEP_MM = 0.5
"""Ishizuka et al., 3.1: "the deflection of the skin surface was obtained with an
interval of 0.5 mm"."""
COMPARED_MM = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0)
"""Where meshes are compared."""

_NUMBERS = ("distance_mm", "deflection_mm", "loading_mm", "loading_n_per_mm")
# An order outside is none of a method that converges: the meshes differ otherwise.
_ORDERS = (0.25, 8.0)
_HALVINGS = 80


@dataclass(frozen=True, slots=True, eq=False)
class Deflection:
    """How far the skin went down, `deflection_mm` ``(N,)`` at `distance_mm` ``(N,)``.

    Both are of points of the skin: the distance is the one from the probe's middle,
    across the finger, before anything moved; down is into the finger. Distances
    ascend from 0. The probe is `depth_mm` below its first touch. On its way it
    met `loading_n_per_mm` ``(K,)`` at `loading_mm` ``(K,)``, from 0 to `depth_mm`.
    `elements` are those of the mesh called `name`; `origin` is what it was made from.
    """

    name: str
    elements: int
    distance_mm: FloatArray
    deflection_mm: FloatArray
    depth_mm: float
    loading_mm: FloatArray
    loading_n_per_mm: FloatArray
    origin: Mapping[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for axis, values in (("distance_mm", "deflection_mm"), ("loading_mm", "loading_n_per_mm")):
            x, y = (np.array(getattr(self, name), dtype=np.float64) for name in (axis, values))
            if x.shape != y.shape or not np.isfinite([x, y]).all() or not (np.diff(x) > 0).all():
                raise ResponseError(
                    f"{self.name}: {axis} and {values}: expected as many finite numbers of both, "
                    f"{axis} ascending"
                )
            for name, array in ((axis, x), (values, y)):
                array.flags.writeable = False
                object.__setattr__(self, name, array)

    @property
    def force_n_per_mm(self) -> float:
        """Force of the skin on the probe at its full depth, per mm of its length."""
        return float(self.loading_n_per_mm[-1])

    def at(self, distance_mm: FloatArray | float) -> FloatArray:
        """Deflection in mm at distances in mm, straight between the skin's nodes."""
        wanted_mm = np.asarray(distance_mm, dtype=np.float64)
        last_mm = float(self.distance_mm[-1])
        if not ((wanted_mm >= 0) & (wanted_mm <= last_mm)).all():
            raise ResponseError(
                f"{self.name}: asked for {wanted_mm.min():g} to {wanted_mm.max():g} mm "
                f"from the probe, the profile has 0 to {last_mm:g} mm"
            )
        found: FloatArray = np.asarray(np.interp(wanted_mm, self.distance_mm, self.deflection_mm))
        return found


@dataclass(frozen=True, slots=True)
class ConvergenceRow:
    """One quantity on each mesh: `values` from the coarsest mesh to the finest.

    `change_percent` is the last step between two meshes, in percent of the finest
    value. `limit` and `order` are Richardson's, NaN where there are not three
    meshes or the values do not come nearer to each other from one side.
    """

    quantity: str
    values: tuple[float, ...]
    change_percent: float
    limit: float
    order: float


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
    """Read a profile that `write_profile` wrote."""
    table = read_sealed(path, "profile", FORMAT)
    try:
        return Deflection(
            name=str(table["name"]),
            elements=int(table["elements"]),
            depth_mm=float(table["depth_mm"]),
            origin=table["origin"],
            **{name: np.array(table[name], dtype=np.float64) for name in _NUMBERS},
        )
    except (KeyError, TypeError, ValueError, ResponseError) as error:
        raise ResponseError(f"{path}: not a profile: {error}") from error


def stored_deflections() -> tuple[Deflection, ...]:
    """The profiles of all meshes that are stored, the coarsest first."""
    found = [read_profile(path) for path in sorted(FOLDER.glob("*.toml"))]
    if not found:
        raise ResponseError(f"{FOLDER}: no profile is stored there")
    return tuple(sorted(found, key=lambda deflection: deflection.elements))


def stored_deflection(name: str) -> Deflection:
    """The stored profile of the mesh called `name`."""
    stored = {deflection.name: deflection for deflection in stored_deflections()}
    if name not in stored:
        raise UsageError(
            f"no deflection is stored for finger {name!r}, only for "
            f"{', '.join(stored)}; --solver run solves it"
        )
    return stored[name]


def convergence(deflections: Sequence[Deflection]) -> tuple[ConvergenceRow, ...]:
    """Compare the deflections at `COMPARED_MM` in mm, and the force in N/mm.

    The element width goes with the number of elements to the power -1/2, since the
    meshes are made alike.
    """
    meshes = sorted(deflections, key=lambda mesh: mesh.elements)
    depths_mm = {mesh.depth_mm for mesh in meshes}
    if len(meshes) < 2 or len(depths_mm) != 1:
        raise ResponseError(
            f"{len(meshes)} profiles of depths {depths_mm} mm, expected two or more of one depth"
        )
    quantities = {
        **{f"deflection_mm at {x:g} mm": [float(m.at(x)) for m in meshes] for x in COMPARED_MM},
        "force_n_per_mm": [mesh.force_n_per_mm for mesh in meshes],
    }
    width = np.array([mesh.elements**-0.5 for mesh in meshes])
    rows = []
    for quantity, values in quantities.items():
        three = len(values) >= 3
        ends = richardson(width[-3:], np.array(values[-3:])) if three else (math.nan, math.nan)
        change = 100 * (values[-1] - values[-2]) / values[-1]
        rows.append(ConvergenceRow(quantity, tuple(values), change, *ends))
    return tuple(rows)


def richardson(width: FloatArray, value: FloatArray) -> tuple[float, float]:
    """Limit and order of `value` ``(3,)`` at the element widths `width` ``(3,)``.

    A value that changes with the width h as ``limit + c h**p`` is known when three
    meshes are. Widths fall. The order solves ``(v1 - v2)/(v2 - v3) =
    (h1^p - h2^p)/(h2^p - h3^p)`` (Roache, J. Fluids Eng. 116:405, 1994, for a ratio of
    widths that is not the same). Both are NaN where the values do not close in from
    one side, or with an order outside 0.25 to 8.
    """
    coarse, fine = value[0] - value[1], value[1] - value[2]
    if not (coarse * fine > 0):
        return math.nan, math.nan

    def excess(order: float) -> float:
        first, second, third = width**order
        return float((first - second) / (second - third) - coarse / fine)

    low, high = _ORDERS
    if not excess(low) < 0 < excess(high):
        return math.nan, math.nan
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) < 0 else (low, middle)
    order = 0.5 * (low + high)
    second, third = width[1] ** order, width[2] ** order
    return float(value[2] - fine * third / (second - third)), order
