"""Units in the names of columns: ``time_s``, ``pressure [kPa]``."""

import math
import re
from collections.abc import Callable

from decks.unit_system import UNIT_SYSTEMS
from fembridge.errors import UsageError
from fembridge.trace import MS_PER_S

MS_PER_UNIT = {"us": 1e-3, "ms": 1.0, "s": MS_PER_S}
_PA_PER_UNIT = {system.stress_unit.lower(): system.stress_pa for system in UNIT_SYSTEMS.values()}
_PA_PER_UNIT |= {"gpa": 1e9, "n/m2": 1.0, "n/mm2": 1e6}
_STRESS_UNITS = "Pa, kPa, MPa, GPa, psi, N/m^2 or N/mm^2"
_UNIT = re.compile(r"(?:_([A-Za-z]+)|[\[(] *([^][()]*[A-Za-z][^][()]*?) *[])])$")
_OTHER_UNITS = ("n", "mn", "kn", "lbf", "mm", "um", "v", "mv", "ns", "min", "h")
_NO_UNIT = re.compile("[xyz]{2}|.*mises.*|v-m")  # in brackets


def to_pa(value: str, gain_pa: float | None) -> float:
    """Stress in Pa of 1 in the column `value`."""
    if gain_pa is not None:
        if not (math.isfinite(gain_pa) and gain_pa):
            raise UsageError(argument="gain_pa", found=gain_pa, expected="a number other than 0")
        return gain_pa
    factor = pa_per(value)
    if factor is None:
        raise UsageError(
            f"column {value} has no unit in its name (_pa, _kpa or _mpa): --gain-pa (gain_pa) is "
            "the stress in Pa of a value of 1; `fembridge calibrate` finds it from a press",
            found=value,
        )
    return factor


def pa_per(name: str) -> float | None:
    """Stress in Pa of 1 in a column, from its name; None if the name has no unit."""
    return _PA_PER_UNIT.get(_unit_in(name)[0])


def check_stress_unit(name: str) -> None:
    """Refuse a column whose name has a unit that is not a known unit of stress."""
    unit, sure = _unit_in(name)
    if sure and unit not in _PA_PER_UNIT:
        raise UsageError(
            f"column {name} is in {unit!r}, expected {_STRESS_UNITS}: --stress-unit (stress_unit) "
            "is the unit of its numbers",
            found=unit,
            expected=_STRESS_UNITS,
        )


def ms_per(name: str, in_ms: bool, note: Callable[[str], None]) -> float:
    """Time in ms of 1 in a column: from its name, else 1 ms with `in_ms`, else 1 s."""
    unit, sure = _unit_in(name)
    if unit in MS_PER_UNIT or in_ms:
        return MS_PER_UNIT.get(unit, 1.0)
    if sure:
        raise UsageError(
            f"column {name} is in {unit!r}, expected s, ms or us: rename it when its numbers "
            f"are in s, or --columns time_ms={name} takes them as ms",
            found=unit,
            expected="s, ms or us",
        )
    note(f"time taken as s; --columns time_ms={name} takes it as ms")
    return MS_PER_S


def _unit_in(name: str) -> tuple[str, bool]:
    """Possible unit at the end of a name in lower case, or ""; whether it is certain."""
    if not (match := _UNIT.search(name)):
        return "", False
    unit = re.sub(r"\^|\*\*|\s", "", (match[1] or match[2]).lower()).replace("²", "2")
    if match[1]:
        return unit, unit in _OTHER_UNITS
    return unit, not _NO_UNIT.fullmatch(unit)
