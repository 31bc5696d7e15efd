"""Deflection of the skin around a thin probe: the paper's 50 um, pressed 1 mm deep.

The elements under the probe must be much smaller than the probe. Otherwise the probe
slips between their nodes, and the run converges with the skin untouched. So the elements
around the first touch are divided by three, twice: 0.042 mm become 0.005 mm on ``quick``.

A profile is a TOML file with a checksum. Those in ``profiles`` serve machines without
a solver, and the validation page: each is the ``deflection.toml`` that
``fembridge deflect --finger NAME --solver run`` writes.
"""

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from decks.contact_analysis import Contact, Model
from decks.finger import Finger, Resolution
from decks.mesh import Mesh, refined
from decks.presets import PAPER, QUICK, mesh_of
from decks.probe import Probe
from fembridge.errors import ResponseError, UsageError
from fembridge.host.store import read_sealed, remove_file, write_sealed
from fembridge.io.run_folder import RunFolder
from fembridge.response.indentation import loading_um, read_pressed
from fembridge.solver.build import build_run_folder
from fembridge.solver.ccx import solve_once
from fembridge.solver.settings import DEFAULTS, Solver
from fembridge.stimulus import Stimulus
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
"""Distances in mm at which meshes are compared."""
# Stiff springs: with them the probe overlaps the skin by 1 um at full depth.
CONTACT = Contact(stiffness_mpa_per_mm=5000.0)

# A mesh between the two presets and one finer than both, for the convergence study; both
# need gmsh.
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

# Elements within these distances of the first touch are divided by three, in this order.
FINE_MM = (0.2, 0.1)
# Increments grow with depth: the contact at first touch is narrower than the probe.
STEPS = 40
_DT_MS = 25.0  # 1 s in total, as in the paper; the result does not depend on time
_MIN_DEPTH_MM, _MAX_DEPTH_MM = 0.05, 2.0
_UM_PER_MM, _MM_PER_UM = 1000.0, 1.0e-3

# Displacement of the skin under the probe over the probe's depth: below 1 by the
# compression of the penalty springs.
APEX_SHARES = (0.95, 1.01)
# Largest difference between both sides of a symmetric finger, over the depth.
_MAX_ASYMMETRY_SHARE = 0.01
# Largest fall of the force between two increments, over the final force.
_MAX_FORCE_DIP_SHARE = 0.02
# Farther out the pad becomes the side of the finger; the first node beyond is kept.
REACH_MM = 6.0
_MM_DIGITS, _N_DIGITS = 6, 8

_ARRAYS = ("distance_mm", "deflection_mm", "loading_mm", "loading_n_per_mm")
# An order outside this range means that the meshes differ in more than element size.
_ORDERS = (0.25, 8.0)


@dataclass(frozen=True, slots=True, eq=False)
class Deflection:
    """Deflection of the skin, `deflection_mm` ``(N,)`` at `distance_mm` ``(N,)``.

    The distance is from the probe's axis to a point of the undeformed skin, across the
    finger, ascending from 0; the deflection of that point is positive into the finger. The
    probe is `depth_mm` below first touch. `loading_n_per_mm` ``(K,)`` is the force of
    the skin on the probe at the depths `loading_mm` ``(K,)``, from 0 to `depth_mm`.
    `elements` is the number of elements of the mesh `name`; `origin` holds the inputs.
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
        for name in _ARRAYS:
            array = np.array(getattr(self, name), dtype=np.float64)
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @property
    def force_n_per_mm(self) -> float:
        """Force of the skin on the probe at full depth, in N per mm of probe length."""
        return float(self.loading_n_per_mm[-1])

    def at(self, distance_mm: FloatArray | float) -> FloatArray:
        """Deflection in mm at distances in mm, linear between the skin's nodes."""
        requested_mm = np.asarray(distance_mm, dtype=np.float64)
        end_mm = float(self.distance_mm[-1])
        if not ((requested_mm >= 0) & (requested_mm <= end_mm)).all():
            raise ResponseError(
                f"{self.name}: distance from the probe {requested_mm.min():g} to "
                f"{requested_mm.max():g} mm, the profile has 0 to {end_mm:g} mm"
            )
        return np.asarray(np.interp(requested_mm, self.distance_mm, self.deflection_mm))


def press_of(finger: Finger, mesh: Mesh | None = None) -> Model:
    """Model of `finger` under the thin probe; default mesh: its own, refined under the probe."""
    if mesh is None:
        mesh = mesh_of(finger)
        for radius_mm in FINE_MM:
            mesh = refined(mesh, (0.0, 0.0), radius_mm)
    return Model(finger, mesh, PROBE, CONTACT, law="neo-hookean", support="prescribed")


def press_stimulus(depth_mm: float = DEPTH_MM) -> Stimulus:
    """Probe displacement down to `depth_mm` in growing steps."""
    if not _MIN_DEPTH_MM <= depth_mm <= _MAX_DEPTH_MM:
        expected = f"{_MIN_DEPTH_MM:g} to {_MAX_DEPTH_MM:g}"
        raise UsageError(argument="depth_mm", found=depth_mm, expected=expected)
    depth_um = depth_mm * _UM_PER_MM
    return Stimulus(
        id=f"deflection_{depth_um:g}",
        displacement_um=loading_um(depth_um, STEPS),
        dt_ms=_DT_MS,
        window_ms=(0.0, STEPS * _DT_MS),
        origin={"family": "deflection", "depth_um": depth_um},
    )


def build_press_folder(folder: Path, press: Model, stimulus: Stimulus) -> RunFolder:
    """Run folder of `press`, with displacements of all surface nodes of the pad."""
    mesh = press.mesh
    arrays = (mesh.node_mm, mesh.quad, mesh.layer)
    contiguous = [np.ascontiguousarray(a).astype(f"<{a.dtype.kind}8") for a in arrays]
    inputs = {
        "law": press.law,
        "elements": len(mesh.quad),
        "mesh_sha256": hashlib.sha256(
            b"".join(array.tobytes() for array in contiguous)
        ).hexdigest(),
    }
    return build_run_folder(folder, press, stimulus, watched=mesh.pad(), made_from=inputs)


def solve_deflection(
    folder: Path, press: Model, depth_mm: float = DEPTH_MM, settings: Solver = DEFAULTS
) -> Deflection:
    """Deflection of `press`, solved in `folder` and written there as ``deflection.toml``.

    The complete results of an earlier run of the same deck in `folder` are reused.

    Raises
    ------
    SolverError
        The run did not reach `depth_mm`.
    ResponseError
        The probe did not push the skin down: see `press_problem`.
    """
    stimulus = press_stimulus(depth_mm)
    run = build_press_folder(folder, press, stimulus)
    remove_file(folder / PROFILE_FILE)  # possibly of another run
    outcome = solve_once(run, settings)
    if not outcome.accepted:
        raise outcome.to_error()
    measured = _read_deflection(run, press, stimulus)
    solver_record = {"version": outcome.version or "", "iterations": outcome.iterations}
    deflection = replace(measured, origin={**solver_record, **measured.origin})
    write_profile(folder / PROFILE_FILE, deflection)
    return deflection


def _read_deflection(run: RunFolder, press: Model, stimulus: Stimulus) -> Deflection:
    """Deflection of the run; a ResponseError where the run is not accepted."""
    surface = press.mesh.pad()
    depth_mm = stimulus.displacement_um * _MM_PER_UM
    _, displacement_mm, force_n_per_mm = read_pressed(run, stimulus, (surface + 1).tolist())
    x_mm, down_mm = press.mesh.node_mm[surface, 0], -displacement_mm[-1, :, 1]
    apex_mm = float(down_mm[surface == run.apex_node - 1][0])
    distance_mm, deflection_mm, asymmetry_mm = fold_sides(x_mm, down_mm)
    problem = press_problem(float(depth_mm[-1]), apex_mm, force_n_per_mm)
    if problem is None and asymmetry_mm > _MAX_ASYMMETRY_SHARE * depth_mm[-1]:
        problem = (
            f"left and right differ by {asymmetry_mm:.3g} mm, expected at "
            f"most {_MAX_ASYMMETRY_SHARE * depth_mm[-1]:.3g} mm"
        )
    if problem is not None:
        raise ResponseError(problem, run.folder)
    kept_rows = slice(int(np.searchsorted(distance_mm, REACH_MM)) + 1)
    return Deflection(
        name=press.finger.name,
        elements=len(press.mesh.quad),
        distance_mm=distance_mm[kept_rows],
        deflection_mm=np.round(deflection_mm[kept_rows], _MM_DIGITS) + 0.0,
        depth_mm=float(depth_mm[-1]),
        loading_mm=depth_mm,
        loading_n_per_mm=np.round(force_n_per_mm, _N_DIGITS) + 0.0,
        origin={
            "solver": run.solver,
            "deck_sha256": run.deck_sha256,
            "sides_differ_mm": round(asymmetry_mm, _MM_DIGITS),
            **run.inputs,
        },
    )


def press_problem(depth_mm: float, apex_mm: float, force_n_per_mm: FloatArray) -> str | None:
    """Reason why the probe did not push the skin; None where it did.

    `apex_mm` is the downward displacement of the skin under the probe; `force_n_per_mm`
    ``(K,)`` the force of the skin on the probe, from first touch to `depth_mm`.
    """
    final_n_per_mm = float(force_n_per_mm[-1])
    lowest_mm, highest_mm = (share * depth_mm for share in APEX_SHARES)
    dip_n_per_mm = float(-np.diff(force_n_per_mm).min())
    if not (final_n_per_mm > 0 and np.isfinite(force_n_per_mm).all()):
        return f"the probe did not push: the force at {depth_mm:g} mm is {final_n_per_mm:.3g} N/mm"
    if not lowest_mm <= apex_mm <= highest_mm:
        return (
            f"the skin under the probe moved {apex_mm:.4g} mm, expected {lowest_mm:.4g} to "
            f"{highest_mm:.4g} mm: the probe slipped between its nodes"
        )
    if dip_n_per_mm > _MAX_FORCE_DIP_SHARE * final_n_per_mm:
        return (
            f"the force fell by {dip_n_per_mm:.3g} N/mm before it reached {final_n_per_mm:.3g} N/mm"
        )
    return None


def fold_sides(x_mm: FloatArray, down_mm: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Distance, mean of both sides and their largest difference, of a profile around x = 0."""
    right = x_mm >= 0
    left_mm = np.interp(x_mm[right], -x_mm[::-1], down_mm[::-1])
    asymmetry_mm = float(np.abs(down_mm[right] - left_mm).max())
    return x_mm[right], 0.5 * (down_mm[right] + left_mm), asymmetry_mm


def write_profile(path: Path, deflection: Deflection) -> None:
    """Write `deflection` to `path`; the same profile gives the same bytes."""
    table: Table = {
        "format": FORMAT,
        "name": deflection.name,
        "elements": deflection.elements,
        "depth_mm": deflection.depth_mm,
        **{name: getattr(deflection, name).tolist() for name in _ARRAYS},
        "origin": dict(deflection.origin),
    }
    write_sealed(path, table)


def read_profile(path: Path) -> Deflection:
    """Deflection from a file that `write_profile` wrote."""
    table = read_sealed(path, "profile", FORMAT)
    del table["format"], table["sha256"]
    return Deflection(**table)


def stored_deflections() -> tuple[Deflection, ...]:
    """Stored profiles of all meshes, the coarsest first."""
    deflections = map(read_profile, FOLDER.glob("*.toml"))
    return tuple(sorted(deflections, key=lambda deflection: deflection.elements))


def stored_deflection(finger: str | Finger) -> Deflection:
    """Stored profile of `finger`: the name of its mesh, or a finger that equals one of `FINGERS`.

    Raises
    ------
    UsageError
        No profile is stored for `finger`.
    """
    name = finger if isinstance(finger, str) else finger.name
    stored = {deflection.name: deflection for deflection in stored_deflections()}
    if name not in stored or (isinstance(finger, Finger) and finger != FINGERS.get(name)):
        raise UsageError(
            f"{name!r} has no stored profile, only {', '.join(stored)} have; stored = False (of "
            "the command: --solver run) solves it",
            argument="finger",
            found=name,
            expected=" or ".join(stored),
        )
    return stored[name]


def convergence(deflections: Sequence[Deflection]) -> list[dict[str, Any]]:
    """Convergence of the deflection in mm at `COMPARED_MM` and of the force in N/mm.

    `deflections` are of two or more meshes at one depth. Each row has a `quantity`; its
    `values` from the coarsest to the finest mesh; `change_percent`, the change from the
    second finest to the finest mesh in percent of the finest value; Richardson's `limit`
    and `order`, NaN with fewer than three meshes or without monotonic convergence. The
    element width is proportional to the number of elements to the power -1/2, since all
    meshes are made in the same way.
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
        has_three_meshes = len(values) >= 3
        richardson_fit = (
            richardson(width[-3:], np.array(values[-3:]))
            if has_three_meshes
            else (math.nan, math.nan)
        )
        rows.append(row | dict(zip(("limit", "order"), richardson_fit, strict=True)))
    return rows


def richardson(width: FloatArray, value: FloatArray) -> tuple[float, float]:
    """Limit and order of `value` ``(3,)`` at the element widths `width` ``(3,)``.

    Three meshes determine a value that depends on the width h as ``limit + c h**p``. The
    widths descend. The order solves ``(v1 - v2)/(v2 - v3) = (h1^p - h2^p)/(h2^p - h3^p)``
    (Roache, J. Fluids Eng. 116:405, 1994, for unequal ratios of widths). Both are NaN
    where the values do not converge monotonically, or with an order outside 0.25 to 8.
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
