"""Contents of a base deck, with its problems and warnings, before anything is solved.

`inp_inspection` and `marc_inspection` fill an `Inspection` each from one kind of deck.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

from decks.own_model.inp_model import family_of
from decks.unit_system import LENGTH_UNITS, MM, UnitSystem, modulus_doubt
from fembridge.typing import Table

PA_PER_MPA = 1.0e6
M_PER_MM = 1.0e-3
# Of all that a finger or a probe is made of.
DENSITY_KG_M3 = (100.0, 30_000.0)
GRAVITY_M_S2 = (1.0, 100.0)
_SMALLEST_MM, _LARGEST_MM = 0.5, 1000.0


WAVEFORM = "waveform"
"""Role of a motion, and course of a load, that becomes the waveform."""


@dataclass(frozen=True, slots=True)
class Finding:
    """A statement on a deck; `line` is from 1, in `file` if that is not the deck itself.

    `topic` is units, materials, elements, afferents, contact, waveform, cards, solver or cost.
    """

    topic: str
    message: str
    line: int | None = None
    file: str = ""

    def __str__(self) -> str:
        location = "" if self.line is None else f"line {self.line}: "
        return f"{f'{self.file}, ' * bool(self.file)}{location}{self.message}"


@dataclass(slots=True, eq=False)
class Inspection:
    """Contents of a deck of `solver`: tables of rows, and findings.

    `size` are the sides of the box around its nodes, in its own unit. `stated` says where the
    units come from.
    """

    solver: str
    units: UnitSystem = MM
    stated: str = "assumed"
    size: tuple[float, ...] = ()
    nodes: int = 0
    dimensions: int = 3
    parts: list[Table] = field(default_factory=list)
    materials: list[Table] = field(default_factory=list)
    sets: list[Table] = field(default_factory=list)
    steps: list[Table] = field(default_factory=list)
    motions: list[Table] = field(default_factory=list)
    loads: list[Table] = field(default_factory=list)
    contacts: list[Table] = field(default_factory=list)
    afferents: list[Table] = field(default_factory=list)
    cards: list[Table] = field(default_factory=list)
    problems: list[Finding] = field(default_factory=list)
    warnings: list[Finding] = field(default_factory=list)

    @property
    def elements(self) -> int:
        """Number of elements."""
        return sum(part["elements"] for part in self.parts)

    @property
    def families(self) -> frozenset[str]:
        """Families of its elements."""
        return frozenset(part["family"] for part in self.parts)

    @property
    def size_mm(self) -> tuple[float, ...]:
        """Sides of the box around its nodes."""
        return tuple(side * self.units.length_mm for side in self.size)

    def warn(self, topic: str, message: str, line: int | None = None, file: str = "") -> None:
        """Add a warning."""
        self.warnings.append(Finding(topic, message, line, file))

    def check_units(self) -> None:
        """Warn of moduli, densities and sizes that no finger has."""
        self.warnings += unit_findings(self.materials, self.size_mm, self.units)


def unit_findings(
    materials: Sequence[Table], size_mm: Sequence[float], units: UnitSystem
) -> list[Finding]:
    """Warnings of a softest material, a density or a size that no finger has.

    Parameters
    ----------
    materials
        Rows with ``material``, ``young_mpa``, ``density_kg_m3``, ``elements`` and ``line``.
    size_mm
        Sides of the box around the nodes; () if not known.
    units
        Units of the deck.
    """
    findings: list[Finding] = []
    used = [row for row in materials if row["elements"] != 0]
    moduli = [row for row in used if row["young_mpa"]]
    if moduli:
        softest = min(moduli, key=lambda row: float(row["young_mpa"]))
        unit_mpa = units.stress_pa / PA_PER_MPA
        doubt = modulus_doubt(
            softest["material"], softest["young_mpa"] / unit_mpa, units.stress_unit, unit_mpa
        )
        if doubt:
            reading = (
                f"lengths are taken as {units.length_unit} and stress as {units.stress_unit} "
                "(--length-unit)"
            )
            findings.append(Finding("units", f"{doubt}; {reading}", softest["line"]))
    for row in used:
        density = row["density_kg_m3"]
        if density and not DENSITY_KG_M3[0] <= density <= DENSITY_KG_M3[1]:
            findings.append(
                Finding(
                    "units",
                    f"the density of {row['material']} is {density:g} kg/m3 in the deck's units; "
                    f"expected {DENSITY_KG_M3[0]:g} to {DENSITY_KG_M3[1]:g} (skin about 1100)"
                    f"{_density_hint(density, units)}",
                    row["line"],
                )
            )
    largest_mm = max(size_mm, default=0.0)
    if largest_mm and not _SMALLEST_MM <= largest_mm <= _LARGEST_MM:
        findings.append(
            Finding(
                "units",
                f"the model is {largest_mm:g} mm long with lengths in {units.length_unit}; a "
                "finger is some 20 mm (--length-unit)",
            )
        )
    return findings


def _density_hint(density: float, units: UnitSystem) -> str:
    """The unit of length with which a `density` in kg/m3 would be one; "" without any."""
    value = density / density_kg_m3(1.0, units)
    for unit, other in LENGTH_UNITS.items():
        if DENSITY_KG_M3[0] <= (other_kg_m3 := density_kg_m3(value, other)) <= DENSITY_KG_M3[1]:
            return f": it would be {other_kg_m3:g} with --length-unit {unit}"
    return ""


def density_kg_m3(density: float, units: UnitSystem) -> float:
    """A density of a deck in kg/m3; mass is force times time squared over length."""
    return density * units.force_n / (units.length_mm * M_PER_MM) ** 4


def gravity_finding(
    magnitude: float, units: UnitSystem, line: int | None, file: str = ""
) -> Finding | None:
    """A warning of gravity that is not that of the earth, of some orders of magnitude."""
    m_s2 = abs(magnitude) * units.length_mm * M_PER_MM
    if GRAVITY_M_S2[0] <= m_s2 <= GRAVITY_M_S2[1]:
        return None
    message = f"gravity is {m_s2:g} m/s2 in the deck's units, expected about 9.81"
    return Finding("units", message, line, file)


def part_row(name: str, kind: str, elements: int, material: str, instance: str = "") -> Table:
    """A row of the table of parts."""
    return {
        "part": name,
        "instance": instance,
        "element": kind,
        "family": family_of(kind),
        "elements": elements,
        "material": material,
    }
