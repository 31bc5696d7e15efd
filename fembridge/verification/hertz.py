"""Study: Hertz line contact at three sizes of elements, against the closed form.

Pressure: forces on the probe's corners, gathered to the nearest nodes of the block.
Half the width is that of the half ellipse of the same second moment, ``P a^2 / 4``;
the peak is the end of the straight line that ``p^2`` is in ``x^2``.
"""

from dataclasses import dataclass

import numpy as np

from decks.analysis import Analysis
from decks.dialects import JOB
from fembridge.results.frd import read_stress_tensor
from fembridge.results.printed.dat import read_node_print
from fembridge.results.stress import von_mises_pa
from fembridge.typing import FloatArray
from fembridge.verification.bench import Bench
from fembridge.verification.extrapolation import Extrapolation, extrapolation
from fembridge.verification.finding import AT_LEAST, Chart, Check, Finding, Line, NumberTable, Panel
from fembridge.verification.hertz_block import (
    AXIS_MM,
    DEPTH_UM,
    EVEN_MM,
    RADIUS_MM,
    Hertz,
    element_mm,
    pressed,
)

NAME = "hertz"
TITLE = "Hertz line contact"

HALVINGS = (0, 1, 2)
BOUND_PERCENT = 1.0
LEAST_ORDER = 1.5
_FORCE = "force at the same depth"
_INNER_SHARE = 0.9
_PRINTS = ("*NODE PRINT, NSET=PROBE, TOTALS=ONLY", "*NODE PRINT, NSET=PROBE")


@dataclass(frozen=True, slots=True)
class Pressed:
    """What one mesh gives: `pressure_mpa` at `x_mm`, `von_mises_mpa` on the axis."""

    width_mm: float
    elements: int
    form: Hertz
    x_mm: FloatArray
    pressure_mpa: FloatArray
    von_mises_mpa: FloatArray

    @property
    def half_width_mm(self) -> float:
        """Of the half ellipse with the same second moment."""
        moment = (self.pressure_mpa * self.x_mm**2).sum() / self.pressure_mpa.sum()
        return float(2 * np.sqrt(moment))

    @property
    def peak_mpa(self) -> float:
        """End of the line of squared pressure over squared distance."""
        inner = np.abs(self.x_mm) < _INNER_SHARE * self.form.half_width_mm
        line = np.polyfit(self.x_mm[inner] ** 2, self.pressure_mpa[inner] ** 2, 1)
        return float(np.sqrt(line[1]))

    def errors_percent(self) -> tuple[float, float, float]:
        """Of half width, peak, and von Mises stress where it is furthest off."""
        axis_mpa = self.form.von_mises_mpa(np.array(AXIS_MM))
        off = self.von_mises_mpa / axis_mpa - 1
        return (
            100 * (self.half_width_mm / self.form.half_width_mm - 1),
            100 * (self.peak_mpa / self.form.peak_mpa - 1),
            100 * float(off[np.abs(off).argmax()]),
        )


def study(bench: Bench) -> Finding:
    """Press at three sizes of elements."""
    meshes = [_pressed(bench, count) for count in HALVINGS]
    finest = meshes[-1]
    width = np.array([mesh.width_mm for mesh in meshes])
    errors = np.array([mesh.errors_percent() for mesh in meshes])
    stress = np.array(
        [mesh.von_mises_mpa / mesh.form.von_mises_mpa(np.array(AXIS_MM)) for mesh in meshes]
    )
    force = np.array([mesh.form.force_n_per_mm for mesh in meshes])
    orders = {
        _FORCE: extrapolation(width, force / force[-1]),
        "half width": extrapolation(width, 1 + errors[:, 0] / 100),
        "peak pressure": extrapolation(width, 1 + errors[:, 1] / 100),
        **{
            f"von Mises stress, {depth:g} mm deep": extrapolation(width, stress[:, row])
            for row, depth in enumerate(AXIS_MM)
            if depth in (0.16, 0.32, 0.64)
        },
    }
    return Finding(
        name=NAME,
        title=TITLE,
        question=(
            f"A cylinder of radius {RADIUS_MM:g} mm goes {DEPTH_UM:g} µm into a "
            "block as large as a half plane, with the contact that decks have by "
            "default (node to surface, no friction here). Each mesh halves every "
            "element of the one before. The force is measured, so that the block's "
            "depth does not come in."
        ),
        words=_words(finest, errors, orders),
        checks=(
            *(
                Check(f"{what}, finest mesh: error", abs(float(off)), BOUND_PERCENT, "%")
                for what, off in zip(
                    ("half width", "peak pressure", "von Mises stress on the axis"),
                    errors[-1],
                    strict=True,
                )
            ),
            Check(
                f"observed order of the {_FORCE}", orders[_FORCE].order, LEAST_ORDER, side=AT_LEAST
            ),
        ),
        tables=(
            NumberTable(
                name="hertz",
                caption="Against the closed form; von Mises stress where it is "
                f"furthest off on the axis, {AXIS_MM[0]:g} to {AXIS_MM[-1]:g} mm deep",
                columns=(
                    *("element_mm", "elements", "force_n_per_mm", "half_width_mm"),
                    *("half_width_percent", "peak_mpa", "peak_percent"),
                    "von_mises_percent",
                ),
                rows=tuple(
                    (
                        mesh.width_mm,
                        mesh.elements,
                        mesh.form.force_n_per_mm,
                        mesh.half_width_mm,
                        float(off[0]),
                        mesh.peak_mpa,
                        float(off[1]),
                        float(off[2]),
                    )
                    for mesh, off in zip(meshes, errors, strict=True)
                ),
                formats=("g", "d", ".4f", ".4f", "+.2f", ".4f", "+.2f", "+.2f"),
            ),
            NumberTable(
                name="hertz_order",
                caption="Observed order of convergence of the ratio to the closed "
                "form (of the force: to that of the finest mesh), its limit for "
                "elements of no size, and 1.25 times the estimated error of the "
                "finest mesh (grid convergence index)",
                columns=("quantity", "order", "limit_of_ratio", "index_percent"),
                rows=tuple(
                    (what, each.order, each.limit, each.uncertainty_percent)
                    for what, each in orders.items()
                ),
                formats=("", ".2f", ".4f", ".2f"),
            ),
        ),
        charts=(_chart(meshes, errors, width),),
        cost=bench.spent,
    )


def _pressed(bench: Bench, halvings: int) -> Pressed:
    analysis, stimulus = pressed(halvings)
    bench.tell(f"{NAME}: {analysis.title}, {len(analysis.mesh.quad)} elements")
    folder = bench.solve_changed(f"{NAME}/{halvings}", analysis, stimulus, _PRINTS).folder
    _, _, forces_n = read_node_print(folder / f"{JOB}.dat", "forces", "PROBE")
    lower_n = np.abs(forces_n[-1, analysis.probe_mesh.lower_node, 1])
    width_mm = element_mm(halvings)
    x_mm, pressure_mpa = _gathered(analysis, lower_n, width_mm)
    nodes = list(analysis.afferent.values())
    _, tensor_pa = read_stress_tensor(folder / f"{JOB}.frd", nodes)
    return Pressed(
        width_mm=width_mm,
        elements=len(analysis.mesh.quad),
        form=Hertz(float(lower_n.sum())),
        x_mm=x_mm,
        pressure_mpa=pressure_mpa,
        von_mises_mpa=von_mises_pa(tensor_pa[-1]) * 1e-6,
    )


def _gathered(
    analysis: Analysis, force_n: FloatArray, width_mm: float
) -> tuple[FloatArray, FloatArray]:
    """Give each node of the block what the probe's corners nearest to it carry."""
    at_mm = analysis.probe_mesh.node_mm[analysis.probe_mesh.lower_node, 0]
    cell = np.rint(at_mm / width_mm).astype(np.int64)
    cells = np.arange(cell.min(), cell.max() + 1)
    total_n = np.bincount(cell - cell.min(), weights=force_n, minlength=len(cells))
    return cells * width_mm, total_n / width_mm


def _words(
    finest: Pressed, errors: FloatArray, orders: dict[str, Extrapolation]
) -> tuple[str, ...]:
    half, peak, stress = errors[-1].tolist()
    return (
        f"Elements of {finest.width_mm:g} mm, "
        f"{2 * finest.form.half_width_mm / finest.width_mm:.0f} across the contact: "
        f"half width {half:+.2f} %, peak pressure {peak:+.2f} %, von Mises stress "
        f"{stress:+.2f} % where it is furthest off. On the finger the contact "
        "is no more than an element wide; the study of meshes tells why that will do.",
        f"Observed order of the force: {orders[_FORCE].order:.2f}; 2 is what "
        "elements of first order promise. The orders of width, pressure and stress "
        "lie above that or cannot be told (a dash): they depend on where the "
        "contact's edge lies between two nodes, and on the finest mesh they no "
        "longer change.",
        "The limits of the ratios are not 1, because of what the closed form leaves "
        "out: springs between probe and block (five times as stiff, on the middle "
        "mesh, they take a third off the errors of width and pressure), and the far "
        "ends of the block (with a block half as large the stress inside was 0.7 % off "
        "instead of 0.2 %).",
    )


def _chart(meshes: list[Pressed], errors: FloatArray, width: FloatArray) -> Chart:
    form, finest = meshes[-1].form, meshes[-1]
    half_mm = form.half_width_mm
    across = np.linspace(-1.3, 1.3, 261)
    depth_mm = np.linspace(0.0, EVEN_MM, 161)
    axis_mm = np.array(AXIS_MM)
    shown = [
        Line(
            f"elements of {mesh.width_mm:g} mm",
            tuple((mesh.x_mm / mesh.form.half_width_mm)[near].tolist()),
            tuple((mesh.pressure_mpa / mesh.form.peak_mpa)[near].tolist()),
            "dots",
        )
        for mesh in (meshes[0], finest)
        for near in [np.abs(mesh.x_mm) < 1.3 * half_mm]
    ]
    exact = form.pressure_mpa(across * half_mm) / form.peak_mpa
    pressure = Panel(
        along="x / a",
        up="pressure / p0",
        lines=(Line("closed form", _plain(across), _plain(exact), "line"), *shown),
    )
    stress = Panel(
        along="depth / a",
        up="von Mises stress / p0",
        lines=(
            Line(
                "closed form",
                _plain(depth_mm / half_mm),
                _plain(form.von_mises_mpa(depth_mm) / form.peak_mpa),
                "line",
            ),
            *(
                Line(
                    f"elements of {mesh.width_mm:g} mm",
                    _plain(axis_mm / mesh.form.half_width_mm),
                    _plain(mesh.von_mises_mpa / mesh.form.peak_mpa),
                    "dots",
                )
                for mesh in (meshes[0], finest)
            ),
        ),
    )
    convergence = Panel(
        along="element (mm)",
        up="error (%)",
        lines=tuple(
            Line(what, _plain(width), _plain(errors[:, column]))
            for column, what in enumerate(("half width", "peak pressure", "von Mises stress"))
        ),
        log="x",
    )
    return Chart(
        name="hertz",
        caption="Pressure under the cylinder and von Mises stress below its middle "
        "on the coarsest and the finest mesh, and errors on all three.",
        panels=(pressure, stress, convergence),
    )


def _plain(values: FloatArray) -> tuple[float, ...]:
    return tuple(values.tolist())
