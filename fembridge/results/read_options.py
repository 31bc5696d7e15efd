"""Options of all readers."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from decks.unit_system import LENGTH_UNITS, UNIT_SYSTEMS
from fembridge.errors import ResultError, UsageError
from fembridge.typing import FloatArray

PA_PER_UNIT = {system.stress_unit: system.stress_pa for system in UNIT_SYSTEMS.values()}
METHODS = ("linear", "translate", "average")  # see `fembridge.results.extrapolation`
VON_MISES = ("tensor", "scalar")


class NotFiniteError(ResultError):
    """A NaN or an infinite value; with `partial` the reader leaves its increment out."""


@dataclass(frozen=True, slots=True)
class Remark:
    """Information about a file; `is_cut` marks that the end of the file is missing."""

    message: str
    is_cut: bool = False

    def __str__(self) -> str:
        return self.message


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """How strictly to read a file, and in which units.

    Parameters
    ----------
    partial
        Read the complete part of a run that did not end normally and log omissions.
        Default: False, such a file is refused.
    across_materials
        Allow the stress of a node on a layer boundary. Default: False.
    stress_unit
        Unit of stress in the file. CalculiX and Marc have no units, the deck decides; N and mm
        give MPa. Default: "MPa".
    extrapolate
        Method of extrapolation from integration points to nodes in a Marc file, one of
        `METHODS`. Default: None, the first of them.
    von_mises
        Of a Marc file: "tensor" is the von Mises stress of the nodal tensor, "scalar" the
        extrapolated von Mises stress of the integration points. Default: None, "tensor".
    branches
        Number of branches by node in relaxing skin. Stress there is the sum over branches; a
        ``.frd`` has the mean over elements of that many materials. Default: none.
    on_axis
        Nodes on the symmetry axis of a half section, where the shear is 0. Default: none.
    classes
        Afferent class by node, for the nodes of the run's afferents. Default: none.
    length_unit
        Unit of coordinates and displacements, "mm", "m" or "in". Default: "mm".
    columns
        Column or array names by quantity, see `fembridge.results.columns`. Default: none.
    path
        File that log lines name. Default: None, no file.
    quiet
        Neither log nor warn. Default: False.
    on_remark
        Called with each remark instead of logging it. Default: None.
    """

    partial: bool = False
    across_materials: bool = False
    stress_unit: str = "MPa"
    extrapolate: str | None = None
    von_mises: str | None = None
    branches: Mapping[int, int] = field(default_factory=dict)
    on_axis: Collection[int] = ()
    classes: Mapping[int, str] = field(default_factory=dict)
    length_unit: str = "mm"
    columns: Mapping[str, str] = field(default_factory=dict)
    path: Path | None = None
    quiet: bool = False
    on_remark: Callable[[Remark], None] | None = None

    def __post_init__(self) -> None:
        for argument, value, accepted in (
            ("stress_unit", self.stress_unit, PA_PER_UNIT),
            ("length_unit", self.length_unit, LENGTH_UNITS),
            ("extrapolate", self.extrapolate or METHODS[0], METHODS),
            ("von_mises", self.von_mises or VON_MISES[0], VON_MISES),
        ):
            if value not in accepted:
                raise UsageError(argument=argument, found=value, expected=", ".join(accepted))

    @property
    def method(self) -> str:
        """Method of extrapolation from integration points to nodes."""
        return self.extrapolate or METHODS[0]

    @property
    def length_mm(self) -> float:
        """Unit of length of the file, in mm."""
        return LENGTH_UNITS[self.length_unit].length_mm

    def scale(self, unit: str) -> float:
        """Factor from the file's unit to `unit`; 1 for a unit without dimension.

        A force is stress times length squared: Pa m² is N. With lengths in mm, forces are
        taken as N in any unit of stress.
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

    def note(self, message: str, *, is_cut: bool = False) -> None:
        """Pass a remark to `on_remark`; without it log the remark, unless `quiet`."""
        if self.on_remark is not None:
            self.on_remark(Remark(message, is_cut))
        elif not self.quiet:
            import logging

            prefix = "" if self.path is None else f"{self.path}: "
            remarks = logging.getLogger(__name__)
            remarks.info(f"{prefix}{message}", extra={"remark": message})

    def refuse(
        self,
        message: str,
        path: Path,
        line: int | None = None,
        *,
        partial_note: str | None = None,
        is_cut: bool = False,
    ) -> None:
        """Raise a `ResultError`; with `partial` note `partial_note`, else `message`, instead."""
        if not self.partial:
            advice = "--partial (partial=True) reads the complete part"
            raise ResultError(f"{message}; {advice}", path, line)
        self.note(partial_note or message, is_cut=is_cut)


def in_pa(stress: FloatArray, options: ReadOptions, path: Path) -> FloatArray:
    """Stress of a file in Pa; an infinite value raises a `ResultError`."""
    with np.errstate(over="ignore"):
        stress_pa: FloatArray = stress * PA_PER_UNIT[options.stress_unit]
    if not np.isfinite(stress_pa).all():
        worst = float(stress.flat[np.abs(stress).argmax()])
        raise ResultError(
            f"stress of {worst:g} {options.stress_unit}, expected a finite value", path
        )
    return stress_pa
