"""Which part of a section a panel shows, and where there is room for its names."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fembridge.typing import BoolArray, FloatArray

# The close view is at least this wide and deep; the probe's lower
# end stands in it.
_CLOSE_WIDTH_MM, _CLOSE_DEPTH_MM = 2.0, 2.3
_PROBE_SHOWN_MM = 0.36
_AROUND_SITE_MM = 0.3
# The flat of a punch is level within this.
_LEVEL_MM = 1.0e-6
# Of a probe higher than this, the section shows the lower end.
_PROBE_IN_SECTION_MM = 1.5
_AROUND_SECTION_MM = 0.12

_BARS_MM = (10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1)
_BAR_SHARE = 0.26


@dataclass(frozen=True, slots=True)
class Window:
    """What a panel shows: `x_mm` from left to right, `y_mm` from low to high."""

    x_mm: tuple[float, float]
    y_mm: tuple[float, float]

    @property
    def aspect(self) -> float:
        """Width over height."""
        return (self.x_mm[1] - self.x_mm[0]) / (self.y_mm[1] - self.y_mm[0])

    @property
    def bar_mm(self) -> float:
        """Length of a scale bar: round, at most a quarter or so of the width."""
        most_mm = _BAR_SHARE * (self.x_mm[1] - self.x_mm[0])
        return next((bar for bar in _BARS_MM if bar <= most_mm), _BARS_MM[-1])

    def meets(self, corner_mm: FloatArray) -> BoolArray:
        """Which shapes ``(N, corner, 2)`` may be seen, by their bounding boxes."""
        low, high = corner_mm.min(axis=1), corner_mm.max(axis=1)
        start = np.array([self.x_mm[0], self.y_mm[0]])
        end = np.array([self.x_mm[1], self.y_mm[1]])
        seen: BoolArray = ((high >= start) & (low <= end)).all(axis=1)
        return seen


def whole_window(node_mm: FloatArray, body_mm: FloatArray) -> Window:
    """Window on the whole section ``(N, 2)`` with the probe ``(P, 2)`` on it."""
    low, high = node_mm.min(axis=0), node_mm.max(axis=0)
    top_mm = min(body_mm[:, 1].max(), high[1] + _PROBE_IN_SECTION_MM)
    top_mm = max(top_mm, high[1] + _PROBE_SHOWN_MM)  # the close view lies inside
    around_mm = _AROUND_SECTION_MM
    return Window(
        (float(low[0] - around_mm), float(high[0] + around_mm)),
        (float(low[1] - around_mm), float(top_mm + around_mm)),
    )


def close_window(site_mm: FloatArray, body_mm: FloatArray, aspect: float) -> Window:
    """Window on the pad with all afferents ``(A, 2)`` and the probe's lowest point.

    `aspect` is the panel's width over its height. Two millimetres wide and 2.3 mm
    deep, or as much more as the afferents need; the probe is in the middle where
    that leaves them in sight.
    """
    lowest = body_mm[:, 1] <= body_mm[:, 1].min() + _LEVEL_MM
    touch_mm = body_mm[lowest].mean(axis=0)
    points = np.concatenate([site_mm, touch_mm[None]])
    left, low = points.min(axis=0) - _AROUND_SITE_MM
    right, _ = points.max(axis=0) + _AROUND_SITE_MM
    top = max(float(touch_mm[1]), 0.0) + _PROBE_SHOWN_MM
    height = max(top - min(float(low), -_CLOSE_DEPTH_MM), _CLOSE_WIDTH_MM / aspect)
    width = max(aspect * height, float(right - left))
    middle = float(touch_mm[0])
    if max(middle - left, right - middle) > 0.5 * width:
        middle = 0.5 * float(left + right)
    return Window((middle - 0.5 * width, middle + 0.5 * width), (top - width / aspect, top))


def spread(wanted: Sequence[float], step: float, bottom: float, top: float) -> list[float]:
    """Move falling heights apart by `step` or more, each as little as it can be.

    They stay between `bottom` and `top` where there is room for all; in groups
    that push each other, the middle stays where it was.
    """
    groups: list[list[float]] = []

    def middle(group: Sequence[float]) -> float:
        half = 0.5 * step * (len(group) - 1)
        mean = sum(group) / len(group)
        return min(max(mean, bottom + half), top - half)

    for height in wanted:
        group = [height]
        while groups:
            reach = 0.5 * step * (len(groups[-1]) + len(group))
            if middle(groups[-1]) - middle(group) >= reach:
                break
            group = groups.pop() + group
        groups.append(group)
    return [
        middle(group) + step * (0.5 * (len(group) - 1) - k)
        for group in groups
        for k in range(len(group))
    ]
