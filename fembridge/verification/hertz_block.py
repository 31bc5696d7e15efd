"""Hertz's line contact: the closed form, and a block and a probe as near to it.

A cylinder of radius R pressed with P per unit length into a half plane touches it
over 2a with the pressure ``p(x) = p0 sqrt(1 - x^2 / a^2)``:

    a = sqrt(4 P R / (pi E*)),  p0 = sqrt(P E* / (pi R)),  E* = E / (1 - nu^2)

and below its middle, with ``s = sqrt(1 + (z/a)^2)``, the stresses are

    across: -p0 ((s^2 + (z/a)^2) / s - 2 z/a),   along: -p0 / s

(K. L. Johnson, Contact Mechanics, 1985, section 4.2). What it leaves out is kept
small here: friction and large strain are off; the block reaches 240 a to each side;
a/R is 0.01, since points of the surface move towards the middle by a share that goes
with it; the springs of the contact give 4e-4; the probe is a polygon with four sides to
an element.
"""

from dataclasses import dataclass

import numpy as np

from decks.analysis import Analysis, Contact
from decks.finger import AfferentSite, Bone, Finger, Outline
from decks.material import Material
from decks.meshing.mesh import Mesh
from decks.motion import motion_of
from decks.presets import QUICK
from decks.probe import ProbeMesh
from fembridge.results.stress import von_mises_pa
from fembridge.stimulus import Stimulus
from fembridge.typing import FloatArray

RADIUS_MM = 40.0
MATERIAL = Material(500.0, 0.3)
E_STAR_MPA = MATERIAL.young_mpa / (1 - MATERIAL.poisson**2)
STIFFNESS_MPA_PER_MM = 2.0e6
DEPTH_UM = 11.25
INCREMENTS = 2
BLOCK_MM = 96.0
# The contact reaches about 0.4 mm to both sides; elements are even to here.
EVEN_MM = 0.64
# Coarsest element; finer meshes halve every element of it.
COARSE_MM = 0.08
_GROWTH = 1.5
# Places on the axis that are nodes of every mesh.
AXIS_MM = (0.08, 0.16, 0.24, 0.32, 0.40, 0.48, 0.56, 0.64)

_SIDES_PER_ELEMENT = 4
_PROBE_HALF_MM = 1.28
_PROBE_BODY_MM = 1.0
_DERMIS = 2


@dataclass(frozen=True, slots=True)
class Hertz:
    """The closed form for a force per mm of length."""

    force_n_per_mm: float

    @property
    def half_width_mm(self) -> float:
        """Half the width of the contact."""
        share = 4 * self.force_n_per_mm * RADIUS_MM / (np.pi * E_STAR_MPA)
        return float(np.sqrt(share))

    @property
    def peak_mpa(self) -> float:
        """Pressure in the middle."""
        return float(np.sqrt(self.force_n_per_mm * E_STAR_MPA / (np.pi * RADIUS_MM)))

    def pressure_mpa(self, x_mm: FloatArray) -> FloatArray:
        """Pressure at `x_mm`; 0 beside the contact."""
        inside = np.clip(1 - (x_mm / self.half_width_mm) ** 2, 0.0, None)
        pressure: FloatArray = self.peak_mpa * np.sqrt(inside)
        return pressure

    def axis_mpa(self, depth_mm: FloatArray) -> FloatArray:
        """Stress tensors ``(Z, 6)`` below the middle, xx yy zz xy yz zx."""
        depth = depth_mm / self.half_width_mm
        stretch = np.sqrt(1 + depth**2)
        across = -self.peak_mpa * ((stretch**2 + depth**2) / stretch - 2 * depth)
        along = -self.peak_mpa / stretch
        zero = np.zeros_like(across)
        out = MATERIAL.poisson * (across + along)
        return np.stack([across, along, out, zero, zero, zero], -1)

    def von_mises_mpa(self, depth_mm: FloatArray) -> FloatArray:
        """Von Mises stress ``(Z,)`` below the middle."""
        return von_mises_pa(self.axis_mpa(depth_mm))


def pressed(halvings: int) -> tuple[Analysis, Stimulus]:
    """Press the cylinder into the block whose elements were halved so often."""
    mesh = _block(halvings)
    stimulus = Stimulus("hertz", np.linspace(0.0, DEPTH_UM, INCREMENTS + 1), 1.0, (0.0, INCREMENTS))
    finger = Finger(
        "block",
        outline=Outline(50.0, 50.0),
        bone=Bone(depth_mm=50.0),
        materials={**QUICK.materials, "dermis": MATERIAL},
        afferents={f"Z{row}": AfferentSite("dermis", 0.0, at) for row, at in enumerate(AXIS_MM)},
    )
    edge, owner, face = mesh.outline()
    middle_mm = mesh.node_mm[edge].mean(axis=1)
    top = (middle_mm[:, 1] == 0) & (np.abs(middle_mm[:, 0]) < EVEN_MM)
    analysis = Analysis(
        title=f"Hertz, elements of {element_mm(halvings):g} mm",
        finger=finger,
        mesh=mesh,
        probe_mesh=_cylinder(element_mm(halvings) / _SIDES_PER_ELEMENT),
        motion=motion_of(stimulus),
        contact=Contact(stiffness_mpa_per_mm=STIFFNESS_MPA_PER_MM, friction=0.0),
        element="CPE4",
        afferent_row={name: mesh.node_at(site) for name, site in finger.afferents.items()},
        apex_row=int(np.flatnonzero((mesh.node_mm == 0.0).all(axis=1))[0]),
        fixed_row=np.flatnonzero(mesh.node_mm[:, 1] == -BLOCK_MM),
        contact_edge=np.stack([owner[top], face[top]], -1),
        large_strain=False,
    )
    return analysis, stimulus


def element_mm(halvings: int) -> float:
    """Width of the elements under the probe."""
    return float(COARSE_MM / 2**halvings)


def _block(halvings: int) -> Mesh:
    """Mesh a rectangle below y = 0, its elements square near the origin."""
    right = _ticks(halvings)
    x_mm = np.concatenate([-right[:0:-1], right])
    at = np.stack(np.meshgrid(x_mm, -right), -1).reshape(-1, 2)
    row, column = np.indices((len(right) - 1, len(x_mm) - 1)).reshape(2, -1)
    upper = row * len(x_mm) + column
    lower = upper + len(x_mm)
    quad = np.stack([lower, lower + 1, upper + 1, upper], -1)
    return Mesh(np.round(at, 9) + 0.0, quad, np.full(len(quad), _DERMIS))


def _ticks(halvings: int) -> FloatArray:
    """From 0 to the block's end: even ones, then growing ones, each halved."""
    even = np.linspace(0.0, EVEN_MM, round(EVEN_MM / COARSE_MM) + 1)
    way = np.cumsum(COARSE_MM * _GROWTH ** np.arange(1, 60))
    count = int(np.searchsorted(way, BLOCK_MM - EVEN_MM)) + 1
    far = EVEN_MM + way[:count] * (BLOCK_MM - EVEN_MM) / way[count - 1]
    ticks = np.concatenate([even, far])
    for _ in range(halvings):
        between = 0.5 * (ticks[1:] + ticks[:-1])
        ticks = np.sort(np.concatenate([ticks, between]))
    return ticks


def _cylinder(side_mm: float) -> ProbeMesh:
    """Give the lowest part of the cylinder, its corners `side_mm` apart in x."""
    count = round(_PROBE_HALF_MM / side_mm)
    x_mm = np.linspace(-_PROBE_HALF_MM, _PROBE_HALF_MM, 2 * count + 1)
    lower = np.stack([x_mm, RADIUS_MM - np.sqrt(RADIUS_MM**2 - x_mm**2)], -1)
    left = np.arange(2 * count)
    above = left + 2 * count + 1
    return ProbeMesh(
        np.round(np.concatenate([lower, lower + np.array([0.0, _PROBE_BODY_MM])]), 9),
        np.stack([left, left + 1, above + 1, above], -1),
    )
