"""Study: Hertz line contact at three sizes of elements, against the closed form.

A cylinder of radius R pressed with P per unit length into a half plane touches it
over 2a with the pressure ``p(x) = p0 sqrt(1 - x^2 / a^2)``:

    a = sqrt(4 P R / (pi E*)),  p0 = sqrt(P E* / (pi R)),  E* = E / (1 - nu^2)

and below its middle, with ``s = sqrt(1 + (z/a)^2)``, the stresses are

    across: -p0 ((s^2 + (z/a)^2) / s - 2 z/a),   along: -p0 / s

(K. L. Johnson, Contact Mechanics, 1985, section 4.2). Effects outside the closed form are
small here: friction and large strain are off; the block reaches 240 a to each side; a/R is
0.01, because surface points move towards the middle in proportion to it; the contact springs
account for 4e-4; the probe is a polygon with four sides per element.

Pressure is computed from the forces on the probe's corners, summed at the nearest nodes of the
block. The half width is that of the half ellipse with the same second moment, ``P a^2 / 4``;
the peak is the intercept of the straight line that ``p^2`` is in ``x^2``.
"""

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from pandas import DataFrame

from decks.calculix import calculix_deck
from decks.contact_analysis import Contact, ContactAnalysis
from decks.dialects import JOB
from decks.finger import AfferentSite, Bone, Finger, Material, Outline
from decks.mesh import Mesh
from decks.motion import motion_of
from decks.presets import QUICK
from decks.probe import ProbeMesh
from fembridge.reporting.verification_runs import (
    AT_LEAST,
    BoundCheck,
    Finding,
    Runs,
    exact,
    extrapolated,
    finish,
    line,
    panels,
)
from fembridge.results.printed import read_node_print
from fembridge.results.readers import read_values
from fembridge.results.von_mises import von_mises_pa
from fembridge.stimulus import Stimulus
from fembridge.typing import FloatArray

RADIUS_MM = 40.0
MATERIAL = Material(500.0, 0.3)
E_STAR_MPA = MATERIAL.young_mpa / (1 - MATERIAL.poisson**2)
STIFFNESS_MPA_PER_MM = 2.0e6
DEPTH_UM = 11.25
INCREMENTS = 2
BLOCK_MM = 96.0
# The contact reaches about 0.4 mm to both sides; elements have equal widths up to here.
EVEN_MM = 0.64
# Coarsest element width; finer meshes halve every element.
COARSE_MM = 0.08
# Depths on the axis that are nodes of every mesh.
AXIS_MM = (0.08, 0.16, 0.24, 0.32, 0.40, 0.48, 0.56, 0.64)
HALVINGS = (0, 1, 2)
BOUND_PERCENT = 1.0
LEAST_ORDER = 1.5

_GROWTH = 1.5
_SIDES_PER_ELEMENT = 4
_PROBE_HALF_MM = 1.28
_PROBE_BODY_MM = 1.0
_DERMIS = 2
_INNER_SHARE = 0.9
_FORCE = "force at the same depth"
_PRINTS = ("*NODE PRINT, NSET=PROBE, TOTALS=ONLY", "*NODE PRINT, NSET=PROBE")


@dataclass(frozen=True, slots=True)
class Hertz:
    """Closed form for a force per mm of length."""

    force_n_per_mm: float

    @property
    def half_width_mm(self) -> float:
        """Half width of the contact."""
        share = 4 * self.force_n_per_mm * RADIUS_MM / (np.pi * E_STAR_MPA)
        return float(np.sqrt(share))

    @property
    def peak_mpa(self) -> float:
        """Pressure at the middle."""
        return float(np.sqrt(self.force_n_per_mm * E_STAR_MPA / (np.pi * RADIUS_MM)))

    def pressure_mpa(self, x_mm: FloatArray) -> FloatArray:
        """Pressure at `x_mm` from the middle; 0 outside the contact."""
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


@dataclass(frozen=True, slots=True)
class BlockResult:
    """Result on one mesh: `pressure_mpa` at `x_mm`, `von_mises_mpa` on the axis."""

    width_mm: float
    elements: int
    form: Hertz
    x_mm: FloatArray
    pressure_mpa: FloatArray
    von_mises_mpa: FloatArray

    @property
    def axis_share(self) -> FloatArray:
        """Von Mises stress on the axis relative to the closed form."""
        share: FloatArray = self.von_mises_mpa / self.form.von_mises_mpa(np.array(AXIS_MM))
        return share

    def to_row(self) -> dict[str, float]:
        """Results and their errors; of the stress on the axis the largest error."""
        x2_mm2, pressure_mpa, form = self.x_mm**2, self.pressure_mpa, self.form
        half_width_mm = float(2 * np.sqrt((pressure_mpa * x2_mm2).sum() / pressure_mpa.sum()))
        inner = np.abs(self.x_mm) < _INNER_SHARE * form.half_width_mm
        peak_mpa = float(np.sqrt(np.polyfit(x2_mm2[inner], pressure_mpa[inner] ** 2, 1)[1]))
        error = self.axis_share - 1
        return {
            "element_mm": self.width_mm,
            "elements": self.elements,
            "force_n_per_mm": form.force_n_per_mm,
            "half_width_mm": half_width_mm,
            "half_width_percent": 100 * (half_width_mm / form.half_width_mm - 1),
            "peak_mpa": peak_mpa,
            "peak_percent": 100 * (peak_mpa / form.peak_mpa - 1),
            "von_mises_percent": 100 * float(error[np.abs(error).argmax()]),
        }


def study(runs: Runs) -> Finding:
    """Errors and orders of convergence with three element sizes."""
    meshes = [_press_block(runs, count) for count in HALVINGS]
    share = np.array([mesh.axis_share for mesh in meshes])
    table = DataFrame([mesh.to_row() for mesh in meshes])
    width, force = table.element_mm.to_numpy(), table.force_n_per_mm.to_numpy()
    columns = ["half_width_percent", "peak_percent", "von_mises_percent"]
    errors = table[columns].to_numpy()
    series = {
        _FORCE: force / force[-1],
        "half width": 1 + errors[:, 0] / 100,
        "peak pressure": 1 + errors[:, 1] / 100,
        **{
            f"von Mises stress, {depth:g} mm deep": share[:, AXIS_MM.index(depth)]
            for depth in (0.16, 0.32, 0.64)
        },
    }
    orders = [(quantity, *extrapolated(width, value)) for quantity, value in series.items()]
    quantities = ("half width", "peak pressure", "von Mises stress on the axis")
    return Finding(
        checks=(
            *(
                BoundCheck(
                    f"{quantity}, finest mesh: error", abs(float(error_percent)), BOUND_PERCENT, "%"
                )
                for quantity, error_percent in zip(quantities, errors[-1], strict=True)
            ),
            BoundCheck(f"observed order of the {_FORCE}", orders[0][2], LEAST_ORDER, side=AT_LEAST),
        ),
        tables={
            "hertz": table,
            "hertz_order": DataFrame(
                orders, columns=["quantity", "limit_of_ratio", "order", "index_percent"]
            )[["quantity", "order", "limit_of_ratio", "index_percent"]],
        },
        figure=_figure(meshes, errors, width),
    )


def _press_block(runs: Runs, halvings: int) -> BlockResult:
    analysis, stimulus = cylinder_on_block(halvings)
    runs.log(f"hertz: solving {len(analysis.mesh.quad)} elements of {element_mm(halvings):g} mm")
    deck = calculix_deck(analysis).replace(*_PRINTS)
    increments = analysis.motion.increments
    folder = runs.solve_deck(f"hertz/{halvings}", deck, increments, stimulus.dt_ms)
    _, _, forces_n = read_node_print(folder / f"{JOB}.dat", "forces", "PROBE")
    lower_n = np.abs(forces_n[-1, analysis.probe_mesh.lower_node, 1])
    width_mm = element_mm(halvings)
    # Forces of the probe's corners, summed at the nearest node of the block.
    corner_mm = analysis.probe_mesh.node_mm[analysis.probe_mesh.lower_node, 0]
    node_index, corner_node = np.unique(np.rint(corner_mm / width_mm), return_inverse=True)
    nodes = list(analysis.afferent.values())
    _, tensor_pa = read_values(folder / f"{JOB}.frd", nodes)
    return BlockResult(
        width_mm=width_mm,
        elements=len(analysis.mesh.quad),
        form=Hertz(float(lower_n.sum())),
        x_mm=node_index * width_mm,
        pressure_mpa=np.bincount(corner_node, lower_n) / width_mm,
        von_mises_mpa=von_mises_pa(tensor_pa[-1]) * 1e-6,
    )


def _figure(meshes: list[BlockResult], errors: FloatArray, width: FloatArray) -> Figure:
    form = meshes[-1].form
    across = np.linspace(-1.3, 1.3, 261)
    depth_mm = np.linspace(0.0, EVEN_MM, 161)
    figure, (pressure, stress, convergence) = panels(3)
    half_mm, peak_mpa = form.half_width_mm, form.peak_mpa
    closed = {"label": "closed form", **exact()}
    pressure.plot(across, form.pressure_mpa(across * half_mm) / peak_mpa, **closed)
    stress.plot(depth_mm / half_mm, form.von_mises_mpa(depth_mm) / peak_mpa, **closed)
    across_mm = 1.3 * half_mm
    for row, mesh in enumerate((meshes[0], meshes[-1]), start=1):
        near = np.abs(mesh.x_mm) < across_mm
        style = {"label": f"elements of {mesh.width_mm:g} mm", **line(row, mark="dots")}
        half_mm, peak_mpa = mesh.form.half_width_mm, mesh.form.peak_mpa
        pressure.plot(mesh.x_mm[near] / half_mm, mesh.pressure_mpa[near] / peak_mpa, **style)
        stress.plot(np.array(AXIS_MM) / half_mm, mesh.von_mises_mpa / peak_mpa, **style)
    for row, quantity in enumerate(("half width", "peak pressure", "von Mises stress")):
        convergence.plot(width, errors[:, row], label=quantity, **line(row))
    finish(pressure, "x / a", "pressure / p0")
    finish(stress, "depth / a", "von Mises stress / p0")
    finish(convergence, "element (mm)", "error (%)", log="x")
    return figure


def cylinder_on_block(halvings: int) -> tuple[ContactAnalysis, Stimulus]:
    """Analysis of the cylinder on the block with elements halved `halvings` times."""
    mesh = _block(halvings)
    stimulus = Stimulus("hertz", np.linspace(0.0, DEPTH_UM, INCREMENTS + 1), 1.0, (0.0, INCREMENTS))
    finger = Finger(
        "block",
        outline=Outline(50.0, 50.0),
        bone=Bone(depth_mm=50.0),
        materials={**QUICK.materials, "dermis": MATERIAL},
        afferents={
            f"Z{row}": AfferentSite("dermis", 0.0, depth_mm) for row, depth_mm in enumerate(AXIS_MM)
        },
    )
    edge, owner, face = mesh.outline()
    middle_mm = mesh.node_mm[edge].mean(axis=1)
    top = (middle_mm[:, 1] == 0) & (np.abs(middle_mm[:, 0]) < EVEN_MM)
    analysis = ContactAnalysis(
        title=f"Hertz, elements of {element_mm(halvings):g} mm",
        finger=finger,
        mesh=mesh,
        probe_mesh=_cylinder(element_mm(halvings) / _SIDES_PER_ELEMENT),
        motion=motion_of(stimulus),
        contact=Contact(stiffness_mpa_per_mm=STIFFNESS_MPA_PER_MM, friction=0.0),
        element="CPE4",
        afferent={name: mesh.node_at(site) + 1 for name, site in finger.afferents.items()},
        apex=int(np.flatnonzero((mesh.node_mm == 0.0).all(axis=1))[0]) + 1,
        fixed_row=np.flatnonzero(mesh.node_mm[:, 1] == -BLOCK_MM),
        contact_edge=np.stack([owner[top], face[top]], -1),
        large_strain=False,
    )
    return analysis, stimulus


def element_mm(halvings: int) -> float:
    """Width of the elements under the probe."""
    return float(COARSE_MM / 2**halvings)


def _block(halvings: int) -> Mesh:
    """Mesh of a rectangle below y = 0, its elements square near the origin."""
    right = _ticks(halvings)
    x_mm = np.concatenate([-right[:0:-1], right])
    grid_mm = np.stack(np.meshgrid(x_mm, -right), -1).reshape(-1, 2)
    row, column = np.indices((len(right) - 1, len(x_mm) - 1)).reshape(2, -1)
    upper = row * len(x_mm) + column
    lower = upper + len(x_mm)
    quad = np.stack([lower, lower + 1, upper + 1, upper], -1)
    return Mesh(np.round(grid_mm, 9) + 0.0, quad, np.full(len(quad), _DERMIS))


def _ticks(halvings: int) -> FloatArray:
    """Node positions from 0 to the block's end: equal steps, then growing steps, all halved."""
    even = np.linspace(0.0, EVEN_MM, round(EVEN_MM / COARSE_MM) + 1)
    reach = np.cumsum(COARSE_MM * _GROWTH ** np.arange(1, 60))
    count = int(np.searchsorted(reach, BLOCK_MM - EVEN_MM)) + 1
    far = EVEN_MM + reach[:count] * (BLOCK_MM - EVEN_MM) / reach[count - 1]
    ticks, parts = np.concatenate([even, far]), 2**halvings
    halved: FloatArray = np.interp(
        np.arange(parts * (ticks.size - 1) + 1) / parts, np.arange(ticks.size), ticks
    )
    return halved


def _cylinder(side_mm: float) -> ProbeMesh:
    """Mesh of the lowest part of the cylinder with corners `side_mm` apart in x."""
    count = round(_PROBE_HALF_MM / side_mm)
    x_mm = np.linspace(-_PROBE_HALF_MM, _PROBE_HALF_MM, 2 * count + 1)
    lower = np.stack([x_mm, RADIUS_MM - np.sqrt(RADIUS_MM**2 - x_mm**2)], -1)
    left = np.arange(2 * count)
    above = left + 2 * count + 1
    return ProbeMesh(
        np.round(np.concatenate([lower, lower + np.array([0.0, _PROBE_BODY_MM])]), 9),
        np.stack([left, left + 1, above + 1, above], -1),
    )
