"""What a caller may ask of any reader, beside the nodes."""

from collections.abc import Callable
from dataclasses import dataclass

from fembridge.errors import UsageError
from fembridge.trace import PA_PER_MPA

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
