"""What a caller may ask of any reader, beside the nodes."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fembridge.errors import ResultError, UsageError
from fembridge.trace import PA_PER_MPA
from fembridge.typing import FloatArray

PA_PER_UNIT = {"MPa": PA_PER_MPA, "kPa": 1.0e3, "Pa": 1.0}


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """How strictly to read, in which unit, and whom to tell what was left out.

    `partial` takes what is whole of a run that did not end well, and tells
    `tell` what it dropped; without it such a file is refused. `across_materials`
    lets through the stress of a node on a layer boundary. `stress_unit` is the
    unit of the file: CalculiX and Marc have none, the deck decides; N and mm
    give MPa.
    """

    partial: bool = False
    across_materials: bool = False
    stress_unit: str = "MPa"
    tell: Callable[[str], None] | None = None

    def __post_init__(self) -> None:
        if self.stress_unit not in PA_PER_UNIT:
            raise UsageError(
                f"stress unit {self.stress_unit!r}, expected {', '.join(PA_PER_UNIT)}"
            )

    @property
    def pa_per_unit(self) -> float:
        """Pascals in one unit of the file's stress."""
        return PA_PER_UNIT[self.stress_unit]

    def note(self, words: str) -> None:
        """Pass `words` on to whoever wants to know."""
        if self.tell is not None:
            self.tell(words)


def in_pa(stress: FloatArray, options: ReadOptions, path: Path) -> FloatArray:
    """Give stress of a file in Pa.

    Raises
    ------
    ResultError
        A number is too large to be one.
    """
    with np.errstate(over="ignore"):
        stress_pa: FloatArray = stress * options.pa_per_unit
    if not np.isfinite(stress_pa).all():
        worst = float(stress.flat[np.abs(stress).argmax()])
        raise ResultError(f"a stress of {worst:g} {options.stress_unit}", path)
    return stress_pa
