"""What a caller may ask of any reader, beside the nodes."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from decks.unit_system import LENGTH_UNITS, UNIT_SYSTEMS
from fembridge.errors import ResultError, UsageError
from fembridge.typing import FloatArray

PA_PER_UNIT = {one.stress_unit: one.stress_pa for one in UNIT_SYSTEMS.values()}
METHODS = ("linear", "translate", "average")  # see `fembridge.results.extrapolation`
VON_MISES = ("tensor", "scalar")


class NotFiniteError(ResultError):
    """A NaN or an infinite value, which a partial reading may leave out."""


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """How strictly to read, in which unit, and where remarks go.

    `partial` takes what is whole of a run that did not end well, and says to `log`
    what it dropped; without it such a file is refused. `across_materials` allows the
    stress of a node on a layer boundary. `stress_unit` is the unit of the file:
    CalculiX and Marc have none, the deck decides; N and mm give MPa. `length_unit` is that
    of its coordinates and displacements, "mm", "m" or "in".

    Of a file that holds integration points (Marc's): `extrapolate` is how their
    values are carried to nodes, one of `METHODS`, None for the first.
    `von_mises` "tensor" (None too) takes the von Mises stress of the nodal tensor,
    "scalar" that of the points, carried to the node as a number.

    `branches` says of nodes in relaxing skin how many branches their stress is the
    sum of: a ``.frd`` holds the mean, over elements of that many materials.

    `on_axis` are nodes on the axis of a half of a section, where there is no shear.

    `classes` are those of the nodes at which the run's afferents sit.

    `columns` are names in a table or series by what they are, see
    `fembridge.results.columns`.
    """

    partial: bool = False
    across_materials: bool = False
    stress_unit: str = "MPa"
    log: Callable[[str], None] | None = None
    extrapolate: str | None = None
    von_mises: str | None = None
    branches: Mapping[int, int] = field(default_factory=dict)
    on_axis: Collection[int] = ()
    classes: Mapping[int, str] = field(default_factory=dict)
    length_unit: str = "mm"
    columns: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for what, value, known in (
            ("stress unit", self.stress_unit, PA_PER_UNIT),
            ("length unit", self.length_unit, LENGTH_UNITS),
            ("extrapolation", self.extrapolate or METHODS[0], METHODS),
            ("von Mises of", self.von_mises or VON_MISES[0], VON_MISES),
        ):
            if value not in known:
                raise UsageError(f"{what} {value!r}, expected {', '.join(known)}")

    @property
    def method(self) -> str:
        """How values are carried from integration points to nodes."""
        return self.extrapolate or METHODS[0]

    @property
    def length_mm(self) -> float:
        """The file's unit of length."""
        return LENGTH_UNITS[self.length_unit].length_mm

    def scale(self, unit: str) -> float:
        """What a number of the file is times, to be in `unit`; 1 in one that has no dimension.

        A force is a stress times a length squared, Pa m² is N; of lengths in mm it is taken
        as N whatever the stress is in.
        """
        stress_pa, length_mm = PA_PER_UNIT[self.stress_unit], self.length_mm
        force_n = 1.0 if length_mm == 1.0 else stress_pa * (length_mm / 1000.0) ** 2
        scales = {
            "Pa": stress_pa,
            "mm": length_mm,
            "mm/s": length_mm,
            "mm/s2": length_mm,
            "N": force_n,
        }
        return scales.get(unit, 1.0)

    def note(self, words: str) -> None:
        """Pass the remark `words` on to `log`."""
        if self.log is not None:
            self.log(words)

    def refuse(
        self, words: str, path: Path, line: int | None = None, noted: str | None = None
    ) -> None:
        """Refuse a file for `words`; a partial reading notes them, or `noted`, and goes on."""
        if not self.partial:
            raise ResultError(f"{words}; --partial (partial=True) takes what is whole", path, line)
        self.note(noted or words)


def in_pa(stress: FloatArray, options: ReadOptions, path: Path) -> FloatArray:
    """Stress of a file in Pa; a number too large to be one is a `ResultError`."""
    with np.errstate(over="ignore"):
        stress_pa: FloatArray = stress * PA_PER_UNIT[options.stress_unit]
    if not np.isfinite(stress_pa).all():
        worst = float(stress.flat[np.abs(stress).argmax()])
        raise ResultError(f"a stress of {worst:g} {options.stress_unit}", path)
    return stress_pa
