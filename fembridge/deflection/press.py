"""The paper's 50 um probe, pressed into a mesh fine enough for it, solved and judged.

The skin's elements under the probe have to be much smaller than it, or it slips
between their nodes and the run ends well with the skin untouched. So a mesh is cut
in three around the first touch, twice: 0.042 mm become 0.005 mm on ``quick``.
"""

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from decks.analysis import Analysis, Contact, Model
from decks.finger import Finger, Resolution
from decks.mesh import Mesh
from decks.presets import PAPER, QUICK, mesh_of
from decks.probe import Probe
from decks.refinement import refined
from fembridge.build import build_analysis_folder, inputs_of
from fembridge.deflection.profile import PROFILE_FILE, Deflection, write_profile
from fembridge.errors import ResponseError, UsageError
from fembridge.response.acceptance import check_times, force_on_probe
from fembridge.results.frd import read_displacement
from fembridge.run_folder import RunFolder
from fembridge.solver.ccx import finished_outcome, solve_once
from fembridge.solver.settings import DEFAULTS, SolverSettings
from fembridge.stimulus import Stimulus
from fembridge.store import remove_file
from fembridge.typing import FloatArray, IntArray, Table

# Ishizuka et al., 3.1.
PROBE = Probe(diameter_mm=0.05)
DEPTH_MM = 1.0
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
_GROWTH = 1.7
_DT_MS = 25.0  # 1 s in all, as in the paper; time has no meaning here
_DIGITS = 3
_LEAST_MM, _MOST_MM = 0.05, 2.0
_UM_PER_MM = 1000.0

# The skin under the probe follows it, less what the penalty springs give.
FOLLOWED = (0.95, 1.01)
# Both sides of a symmetric finger go down alike, to this share of the depth.
_UNLIKE_SHARE = 0.01
# No step down makes the force smaller by more than this share of the last one.
_FORCE_DIP_SHARE = 0.02
# Further out the pad turns into the finger's side; the first node there is kept.
REACH_MM = 6.0
_MM_PER_UM = 1.0e-3
_MM_DIGITS, _N_DIGITS = 6, 8


@dataclass(frozen=True, slots=True, eq=False)
class Press:
    """A finger, its refined mesh, and how deep the probe goes into it."""

    finger: Finger
    mesh: Mesh
    depth_mm: float = DEPTH_MM
    law: str = "neo-hookean"

    def __post_init__(self) -> None:
        if not _LEAST_MM <= self.depth_mm <= _MOST_MM:
            raise UsageError(
                f"deflection: depth is {self.depth_mm:g} mm, expected {_LEAST_MM:g} "
                f"to {_MOST_MM:g} mm"
            )

    def stimulus(self) -> Stimulus:
        """The probe's way: down to `depth_mm` in steps that grow."""
        share = np.arange(STEPS + 1) / STEPS
        depth_um: FloatArray = self.depth_mm * _UM_PER_MM * share**_GROWTH
        return Stimulus(
            id=f"deflection_{self.depth_mm * _UM_PER_MM:g}",
            displacement_um=np.round(depth_um, _DIGITS),
            dt_ms=_DT_MS,
            window_ms=(0.0, STEPS * _DT_MS),
            origin={"family": "deflection", "depth_um": self.depth_mm * _UM_PER_MM},
        )

    def analysis(self) -> Analysis:
        """The deck's content; the pad's whole surface is watched."""
        return replace(self.model(), support="prescribed").analysis(
            self.stimulus(), watched=surface_of(self.mesh)
        )

    def model(self) -> Model:
        """The finger under the probe."""
        return Model(self.finger, self.mesh, PROBE, CONTACT, law=self.law)

    def inputs(self) -> Table:
        """What the run is made from."""
        return {
            "law": self.law,
            "elements": len(self.mesh.quad),
            "mesh_sha256": digest(self.mesh),
            **inputs_of(self.model(), self.stimulus()),
        }


def press_of(finger: Finger, depth_mm: float = DEPTH_MM) -> Press:
    """The mesh of `finger`, refined under the probe."""
    mesh = mesh_of(finger)
    for radius_mm in FINE_MM:
        mesh = refined(mesh, (0.0, 0.0), radius_mm)
    return Press(finger, mesh, depth_mm=depth_mm)


def surface_of(mesh: Mesh) -> IntArray:
    """Rows of the nodes on the pad's surface, from left to right."""
    edge, _, _ = mesh.outline()
    node = np.unique(edge)
    pad = node[mesh.node_mm[node, 1] > 0.5 * mesh.node_mm[:, 1].min()]
    ordered: IntArray = pad[np.argsort(mesh.node_mm[pad, 0], kind="stable")]
    return ordered


def digest(mesh: Mesh) -> str:
    """SHA-256 of a mesh's nodes, elements and layers."""
    arrays = (mesh.node_mm, mesh.quad, mesh.layer)
    parts = [np.ascontiguousarray(a).astype(f"<{a.dtype.kind}8") for a in arrays]
    return hashlib.sha256(b"".join(part.tobytes() for part in parts)).hexdigest()


def solve_deflection(folder: Path, press: Press, settings: SolverSettings = DEFAULTS) -> Deflection:
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
    stimulus = press.stimulus()
    run = build_analysis_folder(folder, press.analysis(), stimulus, press.inputs())
    if finished_outcome(run) is None:
        remove_file(folder / PROFILE_FILE)  # of a run that is not there any more
    outcome, found = solve_once(run, settings, lambda run: measured_deflection(run, press))
    if found is None:
        raise outcome.to_error()
    made = {"version": outcome.version or "", "iterations": outcome.iterations}
    deflection = replace(found, origin={**made, **found.origin})
    write_profile(folder / PROFILE_FILE, deflection)
    return deflection


def measured_deflection(run: RunFolder, press: Press) -> Deflection:
    """Read the run that was built of `press`, and accept it, or say why not."""
    stimulus, mesh = press.stimulus(), press.mesh
    depth_mm = stimulus.displacement_um * _MM_PER_UM
    node = surface_of(mesh)
    found_ms, moved_mm = read_displacement(run.results, (node + 1).tolist())
    check_times(found_ms, stimulus.times_ms[1:], run.results)
    force_n_per_mm = force_on_probe(run, stimulus.times_ms)
    x_mm, down_mm = mesh.node_mm[node, 0], -moved_mm[-1, :, 1]
    apex_mm = float(down_mm[node == run.apex_node - 1][0])
    problem = why_not(float(depth_mm[-1]), apex_mm, force_n_per_mm)
    if problem is not None:
        raise ResponseError(f"{run.folder}: {problem}")
    distance_mm, deflection_mm, unlike_mm = both_sides(x_mm, down_mm)
    if unlike_mm > _UNLIKE_SHARE * depth_mm[-1]:
        raise ResponseError(
            f"{run.folder}: left and right differ by {unlike_mm:.3g} mm, expected at "
            f"most {_UNLIKE_SHARE * depth_mm[-1]:.3g} mm"
        )
    pad = slice(int(np.searchsorted(distance_mm, REACH_MM)) + 1)
    return Deflection(
        name=press.finger.name,
        elements=len(mesh.quad),
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
