"""Receptive fields: where on the skin a probe makes an afferent fire.

The prism is the same all along z, so a probe that is pressed once at each place across
the finger, over afferents that lie further and further along it, is a probe at every
place over one afferent.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from decks.stimuli import DT_MS
from fembridge.errors import UsageError
from fembridge.touching.contact import MOST_UM, press_to
from fembridge.touching.doubts import depth_doubt, narrow_doubt, warn
from fembridge.touching.pad import Pad
from fembridge.touching.pad_file import pad_named
from fembridge.touching.population import ENDINGS_MM, Population
from fembridge.touching.shape import Shape
from fembridge.touching.stress import between, driving_stress_pa
from fembridge.touching.touch import PAD, check_number, parameters_on
from fembridge.touching.way import Way
from fembridge.typing import BoolArray, FloatArray, IntArray
from neural.encoder import encode_units
from neural.parameter_sets import ParameterSet

if TYPE_CHECKING:
    import pandas

# A ramp of 20 ms, as fast as one puts a probe on by hand, and a short hold.
_RAMP_MS, _HOLD_MS = 20.0, 100.0
# Length of a sinusoid, where the field is that of a vibration.
_VIBRATION_MS = 200.0
_HALF_LENGTH_MM = 8.0
_LEVELS = 21
# The least diameter of a probe, and what is more than 0.
_LEAST_PROBE_MM, _LEAST = 0.01, 1e-9
# Halvings of the search for a threshold.
_HALVINGS = 14


@dataclass(frozen=True, eq=False)
class ReceptiveField:
    """Impulses of the median `afferent` ``(depth, x, z)`` under a probe at each place.

    `x_mm` and `z_mm` are the probe's places from the afferent, `threshold_um` is the
    least depth (or amplitude) that fires it at its hot spot, infinite if none does.
    """

    afferent: str
    probe_diameter_mm: float
    x_mm: FloatArray
    z_mm: FloatArray
    depth_um: FloatArray
    impulses: IntArray
    criterion: float
    threshold_um: float

    @cached_property
    def answers(self) -> BoolArray:
        """Where the probe is answered, ``(depth, x, z)``."""
        hot = self.impulses.max(axis=(1, 2), keepdims=True)
        return np.asarray((self.impulses >= np.maximum(self.criterion * hot, 1)) & (hot > 0))

    @cached_property
    def areas(self) -> "pandas.DataFrame":
        """``afferent, depth_um, area_mm2, whole``; `whole`: the field ends on the map."""
        import pandas

        x_edge, z_edge = (
            np.concatenate([[at[0]], 0.5 * (at[1:] + at[:-1]), [at[-1]]])
            for at in (self.x_mm, self.z_mm)
        )
        cell_mm2 = np.diff(x_edge)[:, None] * np.diff(z_edge)
        inside = self.answers
        border = inside[:, [0, -1]].any(axis=(1, 2)) | inside[:, :, [0, -1]].any(axis=(1, 2))
        return pandas.DataFrame(
            {
                "afferent": self.afferent,
                "depth_um": self.depth_um,
                "area_mm2": (inside * cell_mm2).sum(axis=(1, 2)),
                "whole": ~border,
            }
        )

    def to_frame(self) -> "pandas.DataFrame":
        """``afferent, depth_um, x_mm, z_mm, impulses``, a row a place and depth."""
        import pandas

        depth, x, z = np.meshgrid(self.depth_um, self.x_mm, self.z_mm, indexing="ij")
        columns = {"depth_um": depth, "x_mm": x, "z_mm": z, "impulses": self.impulses}
        flat = {name: values.ravel() for name, values in columns.items()}
        return pandas.DataFrame({"afferent": self.afferent, **flat})


def receptive_field(
    afferent: str = "RA",
    *,
    probe_diameter_mm: float = 0.5,
    depth_um: Sequence[float] = (100.0, 200.0, 300.0, 400.0, 500.0),
    times_threshold: Sequence[float] = (),
    criterion: float = 0.1,
    frequency_hz: float | None = None,
    step_mm: float = 0.25,
    endings_mm: float = ENDINGS_MM,
    sa_von_mises: bool = False,
    pad: str | Pad = PAD,
    parameters: str | ParameterSet | None = None,
) -> ReceptiveField:
    """Where a probe makes the median afferent of a class fire, and over what area.

    Parameters
    ----------
    probe_diameter_mm
        From 0.01 to how far from the apex skin may be touched: on ``reference`` 4.3 mm.
    depth_um
        Depths of a ramp-and-hold press, or with `frequency_hz` amplitudes of a sinusoid.
    times_threshold
        Further depths, as multiples of the least that fires it at its hot spot.
    criterion
        Share of the impulses at the hot spot that counts as an answer, one at least.
    endings_mm, sa_von_mises
        What SA and RA units feel by, as in `fembridge.touch`.

    Returns
    -------
    ReceptiveField
        ``areas`` is a DataFrame ``afferent, depth_um, area_mm2, whole``; ``impulses``
        ``(depth, x, z)`` are the maps; ``fb.plot(it)`` shows them.

    Raises
    ------
    UsageError
        No such class, or a number out of its range.

    Warns
    -----
    FembridgeWarning
        Depths of more than 1 mm, or a probe narrower than 1.75 times the distance of nodes.

    Examples
    --------
    >>> import fembridge as fb
    >>> field = fb.receptive_field("SA", depth_um=[200], step_mm=1.0)
    >>> list(field.areas.columns)
    ['afferent', 'depth_um', 'area_mm2', 'whole']
    """
    skin = pad_named(pad)
    if skin.plane:
        raise UsageError("a plane pad has no fields: its probes are endless along the finger")
    own = parameters_on(skin, parameters).parameters
    if afferent not in tuple(own) or afferent not in skin.finger.afferents:
        raise UsageError(f"afferent {afferent!r}, expected one of {', '.join(own)}")
    check_number("probe_diameter_mm", probe_diameter_mm, _LEAST_PROBE_MM, skin.reach_mm)
    check_number("criterion", criterion, _LEAST, 1.0)
    check_number("step_mm", step_mm, 0.1, 2.0)
    depths, multiples = list(np.atleast_1d(depth_um)), list(np.atleast_1d(times_threshold))
    for name, values in (("depth_um", depths), ("times_threshold", multiples)):
        for value in values:
            check_number(name, value, _LEAST, MOST_UM)
    depths = sorted(map(float, depths))
    half_mm = skin.reach_mm - 0.5 * probe_diameter_mm
    across = np.arange(-int(half_mm / step_mm), int(half_mm / step_mm) + 1.0) * step_mm
    along = np.arange(0, int(_HALF_LENGTH_MM / step_mm) + 1.0) * step_mm
    wave = _wave(frequency_hz)
    deepest = MOST_UM if multiples else max(depths, default=0.0)
    level_um = deepest * (np.arange(_LEVELS) / (_LEVELS - 1)) ** 1.5
    probe = Shape.punch(probe_diameter_mm)

    def curves(x_mm: float, z_mm: FloatArray) -> FloatArray:
        """Stress ``(level, z)`` under a probe at `x_mm`."""
        nodes, forces, _ = press_to(skin, probe.moved(x_mm, 0.0), level_um)
        units = Population.at([afferent] * z_mm.size, 0 * z_mm, z_mm, finger=skin.finger)
        units = replace(units, endings_mm=endings_mm, sa_von_mises=sa_von_mises)
        return driving_stress_pa(skin, nodes, forces, units)

    def impulses(stress: FloatArray, depth: float) -> IntArray:
        """Impulses ``(place,)`` of stress ``(level, place)`` at one depth."""
        trace = between(level_um, stress, np.maximum(depth * wave, 0.0))
        classes = [afferent] * stress.shape[1]
        fired = encode_units(trace, classes, DT_MS, own)
        return np.bincount(fired.unit, minlength=stress.shape[1])

    middle = curves(0.0, np.zeros(1))
    threshold_um = _threshold(lambda depth: int(impulses(middle, depth)[0]), deepest)
    depths += [times * threshold_um for times in multiples if times * threshold_um <= MOST_UM]
    depths = sorted(depths)
    if not depths:
        raise UsageError(f"{afferent} does not fire up to {MOST_UM:g} um: no depth to map")
    for doubt in (
        narrow_doubt(skin, probe.name, probe_diameter_mm),
        depth_doubt(depths[-1]),
    ):
        if doubt:
            warn(doubt)
    stress = np.concatenate([curves(float(x), along) for x in across], axis=1)
    half = np.stack([impulses(stress, depth).reshape(across.size, -1) for depth in depths])
    return ReceptiveField(
        afferent=afferent,
        probe_diameter_mm=probe_diameter_mm,
        x_mm=across,
        z_mm=np.concatenate([-along[:0:-1], along]),
        depth_um=np.array(depths),
        impulses=np.concatenate([half[:, :, :0:-1], half], axis=2),
        criterion=criterion,
        threshold_um=threshold_um,
    )


def _wave(frequency_hz: float | None) -> FloatArray:
    """The probe's way as a share of its depth."""
    if frequency_hz is None:
        way = Way.hold(press_um=1.0, ramp_ms=_RAMP_MS, hold_ms=_HOLD_MS)
        return way.pressed
    check_number("frequency_hz", frequency_hz, 1.0, 1000.0)
    times_ms = np.arange(int(_VIBRATION_MS / DT_MS) + 1) * DT_MS
    return np.asarray(np.sin(2 * np.pi * frequency_hz * times_ms / 1000.0))


def _threshold(count: Callable[[float], int], deepest_um: float) -> float:
    """Least depth with an impulse, to a thousandth; infinite if none fires up to the end."""
    if not count(deepest_um):
        return float("inf")
    low, high = deepest_um * 1e-5, deepest_um
    for _ in range(_HALVINGS):
        middle = (low * high) ** 0.5
        low, high = (low, middle) if count(middle) else (middle, high)
    return high
