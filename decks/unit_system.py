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


def unit_system_in(heading: str) -> UnitSystem | None:
    """The unit system named in a heading; None if it names no known one."""
    match = _NAMED.search(heading)
    return None if match is None else UNIT_SYSTEMS.get(match[1].upper())
