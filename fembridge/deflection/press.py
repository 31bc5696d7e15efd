"""What is solved: the paper's 50 µm probe, pressed into a mesh fine enough for it.

The skin's elements under the probe have to be much smaller than it, or it slips
between their nodes and the run ends well with the skin untouched. So a mesh is cut
in three around the first touch, twice: 0.042 mm become 0.005 mm on ``quick``.
"""

import hashlib
from dataclasses import dataclass

import numpy as np

from decks.analysis import Analysis, Contact, analyse
from decks.finger import Finger, Resolution
from decks.meshing.mesh import Mesh
from decks.meshing.refinement import refined
from decks.presets import PAPER, QUICK, mesh_of
from decks.probe import Probe
from fembridge.build import Model, inputs_of
from fembridge.errors import UsageError
from fembridge.stimulus import Stimulus
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


@dataclass(frozen=True, slots=True, eq=False)
class Press:
    """A finger, its refined mesh, and a probe that goes `depth_mm` into it."""

    finger: Finger
    mesh: Mesh
    probe: Probe = PROBE
    depth_mm: float = DEPTH_MM
    contact: Contact = CONTACT
    law: str = "neo-hookean"

    def __post_init__(self) -> None:
        if not _LEAST_MM <= self.depth_mm <= _MOST_MM:
            raise UsageError(
                f"deflection: depth is {self.depth_mm:g} mm, expected {_LEAST_MM:g} "
                f"to {_MOST_MM:g} mm"
            )
        if self.probe.x_mm != 0:
            raise UsageError(
                f"deflection: the probe stands at x = {self.probe.x_mm:g} mm, expected "
                "0, where the mesh is fine"
            )

    def stimulus(self) -> Stimulus:
        """Give the probe's way: down to `depth_mm` in steps that grow."""
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
        """Put it together; the pad's whole surface is watched."""
        return analyse(
            self.finger,
            self.mesh,
            self.stimulus(),
            probe=self.probe,
            contact=self.contact,
            law=self.law,
            watched=surface_of(self.mesh),
        )

    def inputs(self) -> Table:
        """Tell what the run is made from."""
        model = Model(self.finger, self.mesh, self.probe, self.contact)
        return {
            "law": self.law,
            "elements": len(self.mesh.quad),
            "mesh_sha256": digest(self.mesh),
            **inputs_of(model, self.stimulus()),
        }


def press_of(finger: Finger, depth_mm: float = DEPTH_MM) -> Press:
    """Find or make the mesh of `finger` and refine it under the probe.

    Raises
    ------
    MissingError, FingerError
        The finger needs a mesh of its own, and none can be made.
    UsageError
        A depth that is not within 0.05 to 2 mm.
    """
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
