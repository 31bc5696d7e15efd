"""The curves of a finger's section: outline, layer boundaries, bone, half of each.

A curve is a depth below the smooth outline as a function of `arc_mm`, the way
along that outline from the pad's apex to the middle of the back.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from decks.finger import Finger, Outline
from fembridge.typing import FloatArray

DepthOfArc = Callable[[FloatArray], FloatArray]

# The outline is sampled this finely before anything is read off it.
_SAMPLES = 40_001
# Of the search for the nearest point of an ellipse; four reach the last digit within the skin.
_NEWTON_STEPS = 8


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """Half a section: sampled outline, inward normals, and where patches meet.

    `arc_mm` ``(S,)``, `point_mm` and `normal` ``(S, 2)``. `nail_arc_mm` is where
    the nail begins, `end_arc_mm` the middle of the back.
    """

    finger: Finger
    arc_mm: FloatArray
    point_mm: FloatArray
    normal: FloatArray
    nail_arc_mm: float

    @property
    def end_arc_mm(self) -> float:
        """Way from the apex to the middle of the back."""
        return float(self.arc_mm[-1])

    def curve(self, depth: DepthOfArc, arc_mm: FloatArray) -> FloatArray:
        """Points ``(A, 2)`` in mm at `depth` below the outline, at `arc_mm`."""
        at = np.stack([np.interp(arc_mm, self.arc_mm, self.point_mm[:, k]) for k in (0, 1)], -1)
        inward = np.stack([np.interp(arc_mm, self.arc_mm, self.normal[:, k]) for k in (0, 1)], -1)
        inward /= np.linalg.norm(inward, axis=1)[:, None]
        points: FloatArray = at + depth(arc_mm)[:, None] * inward
        points[(arc_mm <= 0) | (arc_mm >= self.end_arc_mm), 0] = 0.0
        return points

    def surface(self, arc_mm: FloatArray) -> FloatArray:
        """Depth of the skin's surface: the ridges; 0 at their tops."""
        ridges = self.finger.ridges
        wave = 0.5 * (1 - np.cos(2 * np.pi * arc_mm / ridges.spacing_mm))
        depth: FloatArray = ridges.height_mm * wave * self._fade(arc_mm)
        return depth

    def corneum(self, arc_mm: FloatArray) -> FloatArray:
        """Depth of the stratum corneum's (on the back: the nail's) lower side."""
        skin, nail = self.finger.skin, self.finger.nail
        share = _smooth_step(arc_mm, self.nail_arc_mm - 2.0, self.nail_arc_mm)
        thickness = skin.stratum_corneum_mm * (1 - share) + nail.thickness_mm * share
        depth: FloatArray = thickness + 0.5 * self.surface(arc_mm)
        return depth

    def epidermis(self, arc_mm: FloatArray) -> FloatArray:
        """Depth of the epidermis' lower side: intermediate ridges and papillae."""
        spacing_mm = 0.5 * self.finger.ridges.spacing_mm
        wave = 0.5 * np.cos(2 * np.pi * arc_mm / spacing_mm)
        mean = self.finger.skin.epidermis_depth_mm
        depth: FloatArray = mean + self.finger.papillae.height_mm * wave * self._fade(arc_mm)
        return depth

    def dermis(self, arc_mm: FloatArray) -> FloatArray:
        """Depth of the dermis' lower side."""
        return np.full_like(arc_mm, self.finger.skin.dermis_depth_mm)

    def bone(self, angle: FloatArray) -> FloatArray:
        """Points of the bone's outline, from its pad side (0) to its back (pi)."""
        bone = self.finger.bone
        across = bone.half_width_mm * np.sin(angle)
        along = -bone.depth_mm + bone.half_height_mm * np.cos(angle)
        across[(angle <= 0) | (angle >= np.pi)] = 0.0
        points: FloatArray = np.stack([across, along], -1)
        return points

    def _fade(self, arc_mm: FloatArray) -> FloatArray:
        """1 on the ridged pad, 0 beyond it, smooth over the last ridge."""
        ridges = self.finger.ridges
        start = ridges.half_width_mm - ridges.spacing_mm
        return 1 - _smooth_step(arc_mm, start, ridges.half_width_mm)


def section_of(finger: Finger) -> Section:
    """Sample the outline of `finger`."""
    half_width, half_height = (finger.outline.half_width_mm, finger.outline.half_height_mm)
    angle = np.linspace(0.0, np.pi, _SAMPLES)
    point = np.stack([half_width * np.sin(angle), half_height * (np.cos(angle) - 1.0)], -1)
    tangent = np.stack([half_width * np.cos(angle), -half_height * np.sin(angle)], -1)
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    steps = np.linalg.norm(np.diff(point, axis=0), axis=1)
    arc_mm = np.concatenate([[0.0], np.cumsum(steps)])
    seen_from_middle = np.degrees(np.arctan2(point[:, 0], point[:, 1] + half_height))
    nail_row = int(np.searchsorted(seen_from_middle, finger.nail.start_deg))
    return Section(
        finger=finger,
        arc_mm=arc_mm,
        point_mm=point,
        normal=np.stack([tangent[:, 1], -tangent[:, 0]], -1),
        nail_arc_mm=float(arc_mm[nail_row]),
    )


def skin_tangent(outline: Outline, point_mm: FloatArray) -> FloatArray:
    """Unit vectors ``(P, 2)`` along the outline, where it is nearest to each point ``(P, 2)``.

    They point towards +x at the apex of the pad and turn with the outline, clockwise.
    """
    half_width, half_height = outline.half_width_mm, outline.half_height_mm
    x, y = point_mm[:, 0], point_mm[:, 1] + half_height
    angle = np.arctan2(x / half_width, y / half_height)
    for _ in range(_NEWTON_STEPS):  # until the way to the outline is normal to it
        sin, cos = np.sin(angle), np.cos(angle)
        ahead_x, ahead_y = half_width * cos, -half_height * sin
        off_x, off_y = half_width * sin - x, half_height * cos - y
        slope = off_x * ahead_x + off_y * ahead_y
        curvature = ahead_x**2 + ahead_y**2 - off_x * half_width * sin - off_y * half_height * cos
        angle -= slope / curvature
    tangent = np.stack([half_width * np.cos(angle), -half_height * np.sin(angle)], -1)
    unit: FloatArray = tangent / np.linalg.norm(tangent, axis=1)[:, None]
    return unit


def _smooth_step(arc_mm: FloatArray, start_mm: float, end_mm: float) -> FloatArray:
    share = np.clip((arc_mm - start_mm) / (end_mm - start_mm), 0.0, 1.0)
    step: FloatArray = 0.5 * (1 - np.cos(np.pi * share))
    return step
