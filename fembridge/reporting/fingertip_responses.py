"""Responses of the whole fingertip to touches that were recorded: ramps, textures, bars, fields.

A class is ten cells of its spread under the stimulus, as a population in a fit; a number is their
mean. Depths of more than 1 mm are beyond the range of small strain, as on the page of
`fembridge touch`; the warning is left out here.
"""

import math
import warnings
from collections.abc import Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from decks.stimuli import DT_MS
from fembridge.errors import FembridgeWarning
from fembridge.evidence.recorded_folder import texture
from fembridge.touching.pad import Pad
from fembridge.touching.population import Population
from fembridge.touching.receptive_field import receptive_field
from fembridge.touching.shape import Shape
from fembridge.touching.touch import touch_skin
from fembridge.touching.touch_result import Touch
from fembridge.touching.trajectory import Trajectory
from fembridge.trace import AFFERENTS
from fembridge.typing import FloatArray
from neural import ParameterSet

if TYPE_CHECKING:
    from collections.abc import Iterator

CELLS = 10
# Probe and speed of the ramps of Knibestöl (1973, 1975), and the time after a ramp in which its
# impulses still come.
RAMP_PROBE_MM, RAMP_SA_MM_PER_S, RAMP_MARGIN_MS = 2.0, 40.0, 10.0
# Force of Weber et al. (2013), and depth of grooves, width and height of dots, all assumed.
TEXTURE_N, GROOVE_MM, DOT_MM, DOT_HEIGHT_MM = 0.3, 0.5, 0.5, 0.4
# Way of a texture whose impulses are counted, and time before it.
_COUNTED_MM, _SETTLING_MS = 24.0, 100.0
# Bars of 14 mm, and gaps between bars of 4 mm, pressed by 1 mm (Phillips and Johnson 1981).
BAR_LENGTH_MM, BAR_BESIDE_GAP_MM, BAR_DEPTH_UM = 14.0, 4.0, 1000.0
FIELD_PROBE_MM, FIELD_THRESHOLDS = 0.5, 4.5
_REST_MS = 50.0


class Fingertip(NamedTuple):
    """Skin and parameters of the units below it."""

    pad: Pad
    model: ParameterSet

    def touch(self, shape: Shape, trajectory: Trajectory, units: Population) -> Touch:
        """`touch_skin` without the warnings of depth."""
        with _quiet():
            return touch_skin(self.pad, shape, trajectory, units, self.model)

    def ramp_rates_ips(
        self, depth_mm: float, windows_ms: Sequence[tuple[float, float]]
    ) -> FloatArray:
        """Mean rate of SA in windows from first touch, of a ramp at 40 mm/s and a hold."""
        longest_ms = max(end for _, end in windows_ms)
        trajectory = _ramp(depth_mm, RAMP_SA_MM_PER_S, longest_ms)
        times_ms = self._pressed_times_ms("SA", trajectory)
        rates = [
            np.sum((times_ms > start) & (times_ms <= end)) * 1e3 / (end - start) / CELLS
            for start, end in windows_ms
        ]
        return np.array(rates)

    def ramp_impulses(self, depth_mm: float, speed_mm_per_s: float) -> float:
        """Mean number of impulses of RA on a ramp."""
        end_ms = 1e3 * depth_mm / speed_mm_per_s + RAMP_MARGIN_MS
        trajectory = _ramp(depth_mm, speed_mm_per_s, RAMP_MARGIN_MS + 50.0)
        times_ms = self._pressed_times_ms("RA", trajectory)
        return float(np.sum((times_ms > 0) & (times_ms <= end_ms))) / CELLS

    def _pressed_times_ms(self, afferent: str, trajectory: Trajectory) -> FloatArray:
        """Spikes of all cells below a flat probe, from first touch."""
        units = _cells(afferent, np.zeros(CELLS), self.pad)
        touched = self.touch(Shape.punch(RAMP_PROBE_MM), trajectory, units)
        return np.asarray(touched.fired.time_ms - _REST_MS)

    def texture_rates_ips(self, shape: str, speed_mm_per_s: float) -> dict[str, float]:
        """Mean rate of each class under a scanned ``grating_P`` or ``dots_P``."""
        touched = self.scanned(shape, speed_mm_per_s)
        units = len(touched.population) // len(AFFERENTS)
        late = touched.fired.unit[touched.fired.time_ms > _SETTLING_MS]
        counts = np.bincount(late, minlength=len(touched.population)).reshape(len(AFFERENTS), units)
        rates = counts.mean(axis=1) * speed_mm_per_s / _COUNTED_MM
        return dict(zip(AFFERENTS, rates.tolist(), strict=True))

    def scanned(self, shape: str, speed_mm_per_s: float) -> Touch:
        """A texture scanned towards the tip over 15 units of each class, 2 x 3 mm of skin."""
        x_mm, z_mm = (
            grid.ravel() for grid in np.meshgrid(np.arange(-1, 1.1), np.arange(-1.5, 1.6, 0.75))
        )
        deviates = _deviates(5)[np.arange(x_mm.size) % 5]
        units = Population.at(
            np.repeat(AFFERENTS, x_mm.size).tolist(),
            np.tile(x_mm, len(AFFERENTS)),
            np.tile(z_mm, len(AFFERENTS)),
            deviate=np.tile(deviates, len(AFFERENTS)),
            finger=self.pad,
        )
        slide = Trajectory.slide(
            speed_mm_per_s,
            press_n=TEXTURE_N,
            direction_deg=90,
            duration_ms=_SETTLING_MS + 1e3 * _COUNTED_MM / speed_mm_per_s,
        )
        return self.touch(texture_shape(shape), slide, units)

    def bar_rates_ips(self, kind: str, width_mm: float, position_mm: FloatArray) -> FloatArray:
        """Rate of SA's median cell at distances from the middle of a ``bar`` or a ``gap``."""
        shape = (
            Shape.bar(width_mm, BAR_LENGTH_MM)
            if kind == "bar"
            else Shape.grating(width_mm, BAR_BESIDE_GAP_MM, relief_mm=2.0)
        )
        units = Population.line(0.25, 4.0, "z", ("SA",), finger=self.pad)
        held = self.touch(shape, Trajectory.press(press_um=BAR_DEPTH_UM), units)
        return np.interp(position_mm, units.z_mm, held.rate_ips)

    def field_mm2(self, afferent: str) -> tuple[float, bool]:
        """Median area of units at 4.5 times threshold, and whether the pad contains all fields.

        NaN on a pad that is not the same along the finger: a probe at each position takes minutes.
        """
        if not self.pad.uniform_along:
            return math.nan, False
        with _quiet():
            field = receptive_field(
                afferent,
                probe_diameter_mm=FIELD_PROBE_MM,
                depth_um=[],
                times_threshold=[FIELD_THRESHOLDS],
                pad=self.pad,
                parameters=self.model,
            )
        return float(field.areas["area_mm2"].median()), bool(field.areas["whole"].all())


def texture_shape(shape: str) -> Shape:
    """The texture ``grating_P`` or ``dots_P`` with the assumed relief."""
    kind, period_mm = texture(shape)
    if kind == "grating":
        return Shape.grating(0.5 * period_mm, 0.5 * period_mm, GROOVE_MM)
    return Shape.dots(period_mm, DOT_MM, DOT_HEIGHT_MM)


@contextmanager
def _quiet() -> "Iterator[None]":
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FembridgeWarning)
        yield


def _deviates(count: int) -> FloatArray:
    """Middles of `count` equal parts of the normal distribution."""
    from scipy.stats import norm

    return np.asarray(norm.ppf((np.arange(count) + 0.5) / count))


def _cells(afferent: str, x_mm: FloatArray, pad: Pad) -> Population:
    deviate = _deviates(x_mm.size)
    return Population.at([afferent] * x_mm.size, x_mm, 0 * x_mm, deviate=deviate, finger=pad)


def _ramp(depth_mm: float, speed_mm_per_s: float, after_ms: float) -> Trajectory:
    """Rest of 50 ms, ramp at a constant speed, and hold."""
    ramp_ms = 1e3 * depth_mm / speed_mm_per_s
    times_ms = np.arange(round((_REST_MS + ramp_ms + after_ms) / DT_MS) + 1) * DT_MS
    depth_um = np.clip((times_ms - _REST_MS) * speed_mm_per_s, 0.0, 1e3 * depth_mm)
    return Trajectory(depth_um, dt_ms=DT_MS, name="ramp")
