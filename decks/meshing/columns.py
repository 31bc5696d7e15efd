"""How an edge is divided: even steps, or steps that grow from one width to another.

Counts are even throughout: an area whose sides have even counts can be filled with
quadrilaterals alone.
"""

import math
from dataclasses import dataclass

from decks.section import Section

# Growth of neighbouring columns beyond the ridges.
_GROWTH = 1.12


@dataclass(frozen=True, slots=True)
class Division:
    """`count` steps, each `growth` times as long as the one before."""

    count: int
    growth: float = 1.0


@dataclass(frozen=True, slots=True)
class Columns:
    """Patches along the outline: `break_mm` has an end more than `division`."""

    break_mm: tuple[float, ...]
    division: tuple[Division, ...]

    @property
    def count(self) -> int:
        """Number of columns in half a section."""
        return sum(patch.count for patch in self.division)


def columns_of(section: Section, far_mm: float) -> Columns:
    """Divide half the outline: contact, ridges, growth, side, nail."""
    resolution = section.finger.resolution
    ridged_mm = section.finger.ridges.half_width_mm
    contact_mm = min(resolution.contact_half_width_mm, ridged_mm)
    nail_mm, end_mm = section.nail_arc_mm, section.end_arc_mm
    fine_mm = resolution.ridge_mm
    grown_mm = min(
        ridged_mm + max(far_mm * _GROWTH - fine_mm, 0.3) / (_GROWTH - 1),
        0.5 * (ridged_mm + nail_mm),
    )
    ends_mm, divisions = [0.0], []
    for end, start_mm, stop_mm in (
        (contact_mm, resolution.contact_mm, resolution.contact_mm),
        (ridged_mm, fine_mm, fine_mm),
        (grown_mm, fine_mm, far_mm),
        (nail_mm, far_mm, far_mm),
        (end_mm, far_mm, far_mm),
    ):
        length_mm = end - ends_mm[-1]
        if length_mm < 1e-9:
            continue
        ends_mm.append(end)
        divisions.append(graded(length_mm, start_mm, stop_mm))
    return Columns(tuple(ends_mm), tuple(divisions))


def graded(length_mm: float, start_mm: float, stop_mm: float) -> Division:
    """Divide into steps from about `start_mm` to about `stop_mm` long."""
    if abs(stop_mm - start_mm) < 1e-9 or length_mm <= 2 * max(start_mm, stop_mm):
        return even(length_mm, min(start_mm, stop_mm))
    ratio = (length_mm - start_mm) / (length_mm - stop_mm)
    count = _even(math.log(stop_mm / start_mm) / math.log(ratio) + 1)
    return Division(count, (stop_mm / start_mm) ** (1 / max(count - 1, 1)))


def even(length_mm: float, step_mm: float) -> Division:
    """Divide into equal steps of about `step_mm`."""
    return Division(_even(length_mm / step_mm))


def _even(number: float) -> int:
    return 2 * max(1, round(number / 2))
