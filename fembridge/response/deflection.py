"""How far the skin goes down around a thin probe: the paper's 50 um, pressed 1 mm deep.

The skin's elements under the probe have to be much smaller than it, or it slips
between their nodes and the run ends well with the skin untouched. So a mesh is cut
in three around the first touch, twice: 0.042 mm become 0.005 mm on ``quick``.

A profile is TOML, sealed by a checksum. Those in ``profiles`` are for machines without
a solver, and for the validation page: each is the ``deflection.toml`` that
``fembridge deflect --finger NAME --solver run`` writes.
"""

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from decks.analysis import Contact, Model
from decks.finger import Finger, Resolution
from decks.mesh import Mesh, refined
from decks.presets import PAPER, QUICK, mesh_of
from decks.probe import Probe
from fembridge.build import build_run_folder
from fembridge.errors import ResponseError, UsageError
from fembridge.response.indentation import loading_um, read_pressed
from fembridge.run_folder import RunFolder
from fembridge.solver.ccx import solve_once
from fembridge.solver.settings import DEFAULTS, SolverSettings
from fembridge.stimulus import Stimulus
from fembridge.store import read_sealed, remove_file, write_sealed
from fembridge.typing import FloatArray, Table

FORMAT = 1
PROFILE_FILE = "deflection.toml"
FOLDER = Path(__file__).parent / "profiles"

# Ishizuka et al., 3.1.
PROBE = Probe(diameter_mm=0.05)
DEPTH_MM = 1.0
PAPER_STEP_MM = 0.5
""""The deflection of the skin surface was obtained with an interval of 0.5 mm"."""
COMPARED_MM = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0)
"""Where meshes are compared."""
# Stiff springs: with them the probe overlaps the skin by 1 um at full depth.
CONTACT = Contact(stiffness_mpa_per_mm=5000.0)

# Between the two presets, and beyond them, for the study of convergence: the mesh
# of either takes gmsh.
MEDIUM = Finger(
    "medium",
    resolution=Resolution(
        contact_mm=1 / 24,
        contact_half_width_mm=1.0,
        ridge_mm=1 / 20,
        far_mm=0.35,
        stratum_corneum_rows=4,
        epidermis_rows=8,
        dermis_rows=14,
    ),
)
FINE = Finger(
    "fine",
    resolution=Resolution(
        contact_mm=1 / 48,
        contact_half_width_mm=1.0,
        ridge_mm=1 / 40,
        far_mm=0.2,
        stratum_corneum_rows=8,
        epidermis_rows=16,
        dermis_rows=32,
    ),
)
FINGERS = {finger.name: finger for finger in (QUICK, MEDIUM, PAPER, FINE)}

# The mesh is cut in three within these distances of the first touch, in turn.
FINE_MM = (0.2, 0.1)
# Increments grow with depth: what happens at first touch is smaller than the probe.
STEPS = 40
_DT_MS = 25.0  # 1 s in all, as in the paper; time has no meaning here
_LEAST_MM, _MOST_MM = 0.05, 2.0
_UM_PER_MM, _MM_PER_UM = 1000.0, 1.0e-3

# The skin under the probe follows it, less what the penalty springs give.
FOLLOWED = (0.95, 1.01)
# Both sides of a symmetric finger go down equally, to this share of the depth.
_UNLIKE_SHARE = 0.01
# No step down makes the force smaller by more than this share of the last one.
_FORCE_DIP_SHARE = 0.02
# Further out the pad turns into the finger's side; the first node there is kept.
REACH_MM = 6.0
_MM_DIGITS, _N_DIGITS = 6, 8

_NUMBERS = ("distance_mm", "deflection_mm", "loading_mm", "loading_n_per_mm")
# An order outside is none of a method that converges: the meshes differ otherwise.
_ORDERS = (0.25, 8.0)


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
        for name in _NUMBERS:
            array = np.array(getattr(self, name), dtype=np.float64)
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


def press_of(finger: Finger, mesh: Mesh | None = None) -> Model:
    """`finger` under the thin probe; without a `mesh` its own, refined under the probe."""
    if mesh is None:
        mesh = mesh_of(finger)
        for radius_mm in FINE_MM:
            mesh = refined(mesh, (0.0, 0.0), radius_mm)
    return Model(finger, mesh, PROBE, CONTACT, law="neo-hookean", support="prescribed")


def way_down(depth_mm: float = DEPTH_MM) -> Stimulus:
    """The probe's way: down to `depth_mm` in steps that grow."""
    if not _LEAST_MM <= depth_mm <= _MOST_MM:
        raise UsageError(
            f"deflection: depth is {depth_mm:g} mm, expected {_LEAST_MM:g} to {_MOST_MM:g} mm"
        )
    depth_um = depth_mm * _UM_PER_MM
    return Stimulus(
        id=f"deflection_{depth_um:g}",
        displacement_um=loading_um(depth_um, STEPS),
        dt_ms=_DT_MS,
        window_ms=(0.0, STEPS * _DT_MS),
        origin={"family": "deflection", "depth_um": depth_um},
    )


def build_press(folder: Path, press: Model, stimulus: Stimulus) -> RunFolder:
    """The run folder of `press`: displacements of the pad's whole surface are written."""
    mesh = press.mesh
    arrays = (mesh.node_mm, mesh.quad, mesh.layer)
    parts = [np.ascontiguousarray(a).astype(f"<{a.dtype.kind}8") for a in arrays]
    made_from = {
        "law": press.law,
        "elements": len(mesh.quad),
        "mesh_sha256": hashlib.sha256(b"".join(part.tobytes() for part in parts)).hexdigest(),
    }
    return build_run_folder(folder, press, stimulus, watched=mesh.pad(), made_from=made_from)


def solve_deflection(
    folder: Path, press: Model, depth_mm: float = DEPTH_MM, settings: SolverSettings = DEFAULTS
) -> Deflection:
    """Solve `press` in `folder` and write ``deflection.toml`` there.

    A run that was solved there before, with the same deck, is read again as long as
    its files are whole.

    Raises
    ------
    SolverError
        The run did not reach its depth.
    ResponseError
        It did, but the probe did not push the skin down: see `why_not`.
    """
    stimulus = way_down(depth_mm)
    run = build_press(folder, press, stimulus)
    remove_file(folder / PROFILE_FILE)  # it may be of another run
    outcome = solve_once(run, settings)
    if not outcome.accepted:
        raise outcome.to_error()
    found = _measured(run, press, stimulus)
    made = {"version": outcome.version or "", "iterations": outcome.iterations}
    deflection = replace(found, origin={**made, **found.origin})
    write_profile(folder / PROFILE_FILE, deflection)
    return deflection


def _measured(run: RunFolder, press: Model, stimulus: Stimulus) -> Deflection:
    """Read the run, and accept it, or say why not."""
    surface = press.mesh.pad()
    depth_mm = stimulus.displacement_um * _MM_PER_UM
    _, moved_mm, force_n_per_mm = read_pressed(run, stimulus, (surface + 1).tolist())
    x_mm, down_mm = press.mesh.node_mm[surface, 0], -moved_mm[-1, :, 1]
    apex_mm = float(down_mm[surface == run.apex_node - 1][0])
    distance_mm, deflection_mm, unlike_mm = both_sides(x_mm, down_mm)
    problem = why_not(float(depth_mm[-1]), apex_mm, force_n_per_mm)
    if problem is None and unlike_mm > _UNLIKE_SHARE * depth_mm[-1]:
        problem = (
            f"left and right differ by {unlike_mm:.3g} mm, expected at "
            f"most {_UNLIKE_SHARE * depth_mm[-1]:.3g} mm"
        )
    if problem is not None:
        raise ResponseError(f"{run.folder}: {problem}")
    pad = slice(int(np.searchsorted(distance_mm, REACH_MM)) + 1)
    return Deflection(
        name=press.finger.name,
        elements=len(press.mesh.quad),
        distance_mm=distance_mm[pad],
        deflection_mm=np.round(deflection_mm[pad], _MM_DIGITS) + 0.0,
        depth_mm=float(depth_mm[-1]),
        loading_mm=depth_mm,
        loading_n_per_mm=np.round(force_n_per_mm, _N_DIGITS) + 0.0,
        origin={
            "solver": run.solver,
            "deck_sha256": run.deck_sha256,
            "sides_differ_mm": round(unlike_mm, _MM_DIGITS),
            **run.inputs,
        },
    )


def why_not(depth_mm: float, apex_mm: float, force_n_per_mm: FloatArray) -> str | None:
    """Why a run is not one in which the probe pushed the skin; None if it is.

    `apex_mm` is how far the skin's point under it went down; `force_n_per_mm` ``(K,)``
    is that of the skin on the probe, from first touch to `depth_mm`.
    """
    last = float(force_n_per_mm[-1])
    least, most = (share * depth_mm for share in FOLLOWED)
    dip = float(-np.diff(force_n_per_mm).min())
    if not (last > 0 and np.isfinite(force_n_per_mm).all()):
        return f"the probe did not push: the force at {depth_mm:g} mm is {last:.3g} N/mm"
    if not least <= apex_mm <= most:
        return (
            f"the skin under the probe moved {apex_mm:.4g} mm, expected {least:.4g} to "
            f"{most:.4g} mm: the probe slipped between its nodes"
        )
    if dip > _FORCE_DIP_SHARE * last:
        return f"the force fell by {dip:.3g} N/mm on the way to {last:.3g} N/mm"
    return None


def both_sides(x_mm: FloatArray, down_mm: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Fold a profile at ``x = 0``: distance, mean of both sides, largest difference."""
    right = x_mm >= 0
    left_mm = np.interp(x_mm[right], -x_mm[::-1], down_mm[::-1])
    unlike_mm = float(np.abs(down_mm[right] - left_mm).max())
    return x_mm[right], 0.5 * (down_mm[right] + left_mm), unlike_mm


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
    del table["format"], table["sha256"]
    return Deflection(**table)


def stored_deflections() -> tuple[Deflection, ...]:
    """The profiles of all meshes that are stored, the coarsest first."""
    found = map(read_profile, FOLDER.glob("*.toml"))
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


def convergence(deflections: Sequence[Deflection]) -> list[dict[str, Any]]:
    """Compare the deflections at `COMPARED_MM` in mm, and the force in N/mm.

    They are of two meshes or more and one depth. Of each `quantity` there are `values` from
    the coarsest mesh to the finest; `change_percent`, the last step between two meshes in
    percent of the finest value; `limit` and `order`, Richardson's, NaN where there are not
    three meshes or the values do not come nearer to each other from one side. The element
    width goes with the number of elements to the power -1/2, since the meshes are made in
    one way.
    """
    meshes = sorted(deflections, key=lambda mesh: mesh.elements)
    quantities = {
        **{f"deflection_mm at {x:g} mm": [float(m.at(x)) for m in meshes] for x in COMPARED_MM},
        "force_n_per_mm": [mesh.force_n_per_mm for mesh in meshes],
    }
    width = np.array([mesh.elements**-0.5 for mesh in meshes])
    rows = []
    for quantity, values in quantities.items():
        change = 100 * (values[-1] - values[-2]) / values[-1]
        row = {"quantity": quantity, "values": values, "change_percent": change}
        three = len(values) >= 3
        found = richardson(width[-3:], np.array(values[-3:])) if three else (math.nan, math.nan)
        rows.append(row | dict(zip(("limit", "order"), found, strict=True)))
    return rows


def richardson(width: FloatArray, value: FloatArray) -> tuple[float, float]:
    """Limit and order of `value` ``(3,)`` at the element widths `width` ``(3,)``.

    A value that changes with the width h as ``limit + c h**p`` is known when three
    meshes are. Widths fall. The order solves ``(v1 - v2)/(v2 - v3) =
    (h1^p - h2^p)/(h2^p - h3^p)`` (Roache, J. Fluids Eng. 116:405, 1994, for a ratio of
    widths that is not the same). Both are NaN where the values do not close in from
    one side, or with an order outside 0.25 to 8.
    """
    from scipy.optimize import brentq

    coarse, fine = value[0] - value[1], value[1] - value[2]
    if not (coarse * fine > 0):
        return math.nan, math.nan

    def excess(order: float) -> float:
        first, second, third = width**order
        return float((first - second) / (second - third) - coarse / fine)

    if not excess(_ORDERS[0]) < 0 < excess(_ORDERS[1]):
        return math.nan, math.nan
    order = float(brentq(excess, *_ORDERS, xtol=1e-15))
    second, third = width[1] ** order, width[2] ** order
    return float(value[2] - fine * third / (second - third)), order
