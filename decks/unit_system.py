"""The unit system of a model, as named in its heading.

    *HEADING
    Hash: wQ2k, Date: 04/23/2022, Unit system: M_KG_S_C

PrePoMax writes this line, and CalculiX copies it into its results. The name gives
length, mass, time and temperature; force is mass times length over time squared, of
inches and pounds the pound-force; stress is force over length squared.
"""

import re
from dataclasses import dataclass

_NAMED = re.compile(r"unit\s+system\s*:\s*(\w+)", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class UnitSystem:
    """The units of length, stress, time and force of a model.

    `name` is the name in the heading; `length_unit` and `stress_unit` are values of options.
    """

    name: str
    length_unit: str
    stress_unit: str
    length_mm: float
    stress_pa: float
    force_n: float = 1.0
    time_ms: float = 1000.0

    def __str__(self) -> str:
        return f"{self.name}: length in {self.length_unit}, stress in {self.stress_unit}"


MM = UnitSystem("MM_TON_S_C", "mm", "MPa", 1.0, 1.0e6)
# Unit systems that PrePoMax writes, except UNIT_LESS and Undefined.
UNIT_SYSTEMS = {
    system.name: system
    for system in (
        MM,
        UnitSystem("M_TON_S_C", "m", "kPa", 1000.0, 1.0e3, force_n=1.0e3),
        UnitSystem("M_KG_S_C", "m", "Pa", 1000.0, 1.0),
        # 1 lbf is 4.4482216152605 N by definition, 1 in is 25.4 mm
        UnitSystem("IN_LB_S_F", "in", "psi", 25.4, 6894.757293168361, force_n=4.4482216152605),
    )
}
LENGTH_UNITS = {"mm": MM, "m": UNIT_SYSTEMS["M_KG_S_C"], "in": UNIT_SYSTEMS["IN_LB_S_F"]}
"""Unit systems by their unit of length."""


# Young's modulus of the soft tissues of a finger at small strain, from fat to epidermis. The
# softest material of a model of skin is one of them; a probe and a bone are stiffer.
TISSUE_MPA = (1.0e-3, 10.0)
_STRESS_UNITS_MPA = {"MPa": 1.0, "kPa": 1.0e-3, "Pa": 1.0e-6, "GPa": 1.0e3}


def modulus_doubt(name: str, modulus: float, stress_unit: str, unit_mpa: float) -> str:
    """A warning of the softest material of a model, unless it may be soft tissue; "" then.

    Parameters
    ----------
    name
        The material.
    modulus
        Its Young's modulus in `stress_unit`, of which one is `unit_mpa`.
    """
    low, high = TISSUE_MPA
    if low <= modulus * unit_mpa <= high:
        return ""
    fitting = [
        f"{modulus * size_mpa:g} MPa if the {modulus:g} is in {unit}"
        for unit, size_mpa in _STRESS_UNITS_MPA.items()
        if unit != stress_unit and low <= modulus * size_mpa <= high
    ]
    hint = f": it would be {' or '.join(fitting)}" if fitting else ""
    return (
        f"the softest material, {name}, has a modulus of {modulus * unit_mpa:g} MPa, soft tissue "
        f"{low:g} to {high:g} MPa{hint}"
    )


def unit_system_in(heading: str) -> UnitSystem | None:
    """The unit system named in a heading; None if it names no known one."""
    match = _NAMED.search(heading)
    return None if match is None else UNIT_SYSTEMS.get(match[1].upper())
