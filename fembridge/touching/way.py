"""How a shape moves: depth or force, and place, over time; and arrays of moving pins."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from decks.stimuli import DT_MS
from fembridge.errors import UsageError
from fembridge.stimulus import Stimulus
from fembridge.stimulus_file import stimuli_of
from fembridge.tables import read_table
from fembridge.touching.contact import MM_PER_UM, MOST_UM
from fembridge.touching.shape import MAX_AWAY_MM, MAX_TURN_DEG, Shape, check_range
from fembridge.typing import FloatArray

_MS_PER_S = 1.0e3
_MOST_N = 20.0
_MOST_SAMPLES = 200_001
# The farthest that a shape is above first touch, and from the middle of the pad.
_MAX_LIFT_UM = 1.0e6
_MAX_AWAY_MM = 1_000.0
_MAX_TIME_MS = 1.0e12
_MAX_PINS, _MAX_PIN_SAMPLES = 2_000, 20_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Pins:
    """Flat round pins: `places` ``(x_mm, z_mm, diameter_mm)``, and `depth_um` ``(T, pin)``.

    Each pin's depth is counted from its own first touch.
    """

    places: tuple[tuple[float, float, float], ...]
    depth_um: FloatArray

    def __post_init__(self) -> None:
        if not 1 <= len(self.places) <= _MAX_PINS:
            raise UsageError(f"{len(self.places)} pins, expected 1 to {_MAX_PINS}")
        if self.depth_um.ndim != 2 or self.depth_um.shape[1] != len(self.places):
            raise UsageError(
                f"depth_um {self.depth_um.shape}, expected (T, {len(self.places)}), one a pin"
            )
        for x_mm, z_mm, diameter_mm in self.places:
            Shape.punch(diameter_mm).moved(x_mm, z_mm)  # refuses numbers that no pin has
        _check_values("depth_um of a pin", self.depth_um, -_MAX_LIFT_UM, MOST_UM)


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """How a shape moves: samples every `dt_ms` from time 0.

    `pressed` ``(T,)`` is its depth below first touch in um, with `newton` its force in N.
    `x_mm`, `z_mm` ``(T,)`` are its way over the skin, None where it does not slide. Where
    `pins` move on their own, `pressed` is the depth of the deepest. `window_ms` is when
    spikes are counted.
    """

    name: str
    dt_ms: float
    window_ms: tuple[float, float]
    pressed: FloatArray
    newton: bool = False
    x_mm: FloatArray | None = None
    z_mm: FloatArray | None = None
    pins: Pins | None = None

    def __post_init__(self) -> None:
        if self.pressed.ndim != 1 or not 1 <= self.pressed.size <= _MOST_SAMPLES:
            raise UsageError(f"{self.pressed.size} samples, expected 1 to {_MOST_SAMPLES}")
        if not 0 < self.dt_ms < math.inf:
            raise UsageError(f"dt_ms is {self.dt_ms:g}, expected more than 0")
        start_ms, end_ms = self.window_ms
        if not -math.inf < start_ms < end_ms < math.inf:
            raise UsageError(f"window_ms is {start_ms:g} to {end_ms:g}, expected a rising pair")
        most, unit = (_MOST_N, "N") if self.newton else (MOST_UM, "um")
        if not self.pressed.max() <= most:
            raise UsageError(f"pressed by {self.pressed.max():g} {unit}, expected at most {most:g}")
        if not self.pressed.min() >= -_MAX_LIFT_UM:
            raise UsageError(
                f"pressed by {self.pressed.min():g} {unit}, expected at least {-_MAX_LIFT_UM:g}"
            )
        for name, place_mm in (("x_mm", self.x_mm), ("z_mm", self.z_mm)):
            if place_mm is None:
                continue
            if place_mm.shape != self.pressed.shape:
                raise UsageError(f"{name} {place_mm.shape}, expected {self.pressed.shape}")
            _check_values(name, place_mm, -_MAX_AWAY_MM, _MAX_AWAY_MM)

    @property
    def slides(self) -> bool:
        """Whether the shape moves over the skin."""
        return self.x_mm is not None

    @property
    def times_ms(self) -> FloatArray:
        """Time of each sample, ``(T,)``."""
        times: FloatArray = np.arange(self.pressed.size, dtype=np.float64) * self.dt_ms
        return times

    @classmethod
    def of_stimulus(cls, stimulus: Stimulus) -> "Way":
        """The way of a stimulus of the catalogue; its way aside is along x."""
        way = cls(
            stimulus.id, stimulus.dt_ms, stimulus.window_ms, np.asarray(stimulus.displacement_um)
        )
        aside = stimulus.aside_um
        return way if aside is None else replace(way, x_mm=aside * MM_PER_UM, z_mm=0.0 * aside)

    @classmethod
    def hold(
        cls,
        press_um: float | None = None,
        press_n: float | None = None,
        ramp_ms: float = 50.0,
        hold_ms: float = 500.0,
    ) -> "Way":
        """Ramp, hold and ramp back; the ramps are raised cosines."""
        level, name = _level(press_um, press_n)
        if not (DT_MS <= ramp_ms <= 10_000 and DT_MS <= hold_ms <= 60_000):
            raise UsageError(f"ramp {ramp_ms:g} ms, hold {hold_ms:g} ms: expected 0.5 ms and more")
        ramp = 0.5 * (1 - np.cos(np.pi * np.arange(round(ramp_ms / DT_MS)) * DT_MS / ramp_ms))
        rest = np.zeros(20)  # 10 ms before, so that the onset is one
        held = np.ones(round(hold_ms / DT_MS) + 1)
        shape = np.concatenate([rest, ramp, held, ramp[::-1], rest])
        end_ms = (shape.size - 1) * DT_MS
        return cls(f"hold {name}", DT_MS, (0.0, end_ms), level * shape, press_um is None)

    @classmethod
    def slide(
        cls,
        speed_mm_per_s: float,
        press_um: float | None = None,
        press_n: float | None = None,
        duration_ms: float = 1000.0,
        direction_deg: float = -90.0,
        start_mm: tuple[float, float] = (0.0, 0.0),
    ) -> "Way":
        """Over the skin at one speed, pressed all the time; -90 degrees is towards -z."""
        level, name = _level(press_um, press_n)
        if not (np.isfinite(speed_mm_per_s) and 0 < speed_mm_per_s <= 1000):
            raise UsageError(f"slides at {speed_mm_per_s:g} mm/s, expected 0 to 1000")
        if not 10 <= duration_ms <= 60_000:
            raise UsageError(f"slides for {duration_ms:g} ms, expected 10 to 60000")
        check_range("direction_deg", direction_deg, -MAX_TURN_DEG, MAX_TURN_DEG)
        times_ms = np.arange(round(duration_ms / DT_MS) + 1) * DT_MS
        way_mm = speed_mm_per_s * times_ms / _MS_PER_S
        turn = np.radians(direction_deg)
        return cls(
            f"slide {speed_mm_per_s:g} mm/s {name}",
            DT_MS,
            (0.0, float(times_ms[-1])),
            np.full(times_ms.size, level),
            newton=press_um is None,
            x_mm=start_mm[0] + np.cos(turn) * way_mm,
            z_mm=start_mm[1] + np.sin(turn) * way_mm,
        )

    @classmethod
    def read(cls, path: Path | str) -> "Way":
        """A path: a table ``time_ms,x_mm,z_mm`` with ``depth_um`` or ``force_n``.

        Rows may be at any rising times; between them the path is straight.

        Raises
        ------
        TableError, UsageError
            Not such a table, a column of another name, or too long a time.
        """
        path = Path(path)
        table = read_table(path, ("time_ms", "x_mm", "z_mm"), ("depth_um", "force_n"))
        pressed = [name for name in ("depth_um", "force_n") if name in table.header]
        if len(pressed) != 1 or table.size < 2:
            raise UsageError(f"{path}: expected two rows or more with either depth_um or force_n")
        at_ms = table.numbers("time_ms", -_MAX_TIME_MS)
        table.refuse(np.diff(at_ms, prepend=at_ms[0] - 1) <= 0, lambda row: "time_ms does not rise")
        steps = (float(at_ms[-1]) - float(at_ms[0])) / DT_MS + 1e-9
        if not 1 <= steps < _MOST_SAMPLES:
            raise UsageError(
                f"{path}: time_ms from {at_ms[0]:g} to {at_ms[-1]:g}, expected {DT_MS:g} to "
                f"{(_MOST_SAMPLES - 1) * DT_MS:g} ms"
            )
        times_ms = np.arange(int(steps) + 1) * DT_MS
        x_mm, z_mm, level = (
            np.interp(times_ms + at_ms[0], at_ms, table.numbers(name))
            for name in ("x_mm", "z_mm", pressed[0])
        )
        window_ms = 0.0, float(times_ms[-1])
        return cls(path.stem, DT_MS, window_ms, level, pressed == ["force_n"], x_mm, z_mm)

    @classmethod
    def of_pins(cls, pins: Pins, dt_ms: float, window_ms: tuple[float, float]) -> "Way":
        """The way of pins that move on their own."""
        name = f"{len(pins.places)} pins"
        return cls(name, dt_ms, window_ms, pins.depth_um.max(axis=1), pins=pins)


def way_of(
    stimulus: str | Stimulus | None,
    press_um: float | None,
    press_n: float | None,
    ramp_ms: float,
    hold_ms: float,
    slide_mm_per_s: float | None,
    direction_deg: float,
    duration_ms: float,
    path: Path | str | None,
    preindent_um: float,
    log: Callable[[str], None],
) -> Way:
    """The one way that was asked for."""
    if path is not None:
        if any(each is not None for each in (stimulus, press_um, press_n, slide_mm_per_s)):
            raise UsageError("a path says how the shape moves: nothing else beside it")
        return Way.read(path)
    if stimulus is not None:
        if press_um is not None or press_n is not None or slide_mm_per_s is not None:
            raise UsageError("a stimulus says how deep the shape goes: no press or slide beside it")
        if isinstance(stimulus, Stimulus):
            return Way.of_stimulus(stimulus)
        found = stimuli_of(stimulus, preindent_um, log=log)
        if len(found) != 1:
            raise UsageError(f"stimulus {stimulus!r} names {len(found)} stimuli, expected one")
        return Way.of_stimulus(found[0])
    if press_um is None and press_n is None:
        raise UsageError("how is the shape pressed? a stimulus, press_um, press_n, path or pins")
    if slide_mm_per_s is not None:
        return Way.slide(slide_mm_per_s, press_um, press_n, duration_ms, direction_deg)
    return Way.hold(press_um, press_n, ramp_ms, hold_ms)


def read_pins(path: Path | str, preindent_um: float = 0.0) -> Way:
    """Pins of a table ``x_mm,z_mm,diameter_mm,stimulus``: an id of the catalogue each.

    Raises
    ------
    TableError, StimulusError
        Not such a table, or no such stimulus.
    """
    table = read_table(Path(path), ("x_mm", "z_mm", "diameter_mm", "stimulus"), ())
    if not 1 <= table.size <= _MAX_PINS:
        raise UsageError(f"{path}: {table.size} pins, expected 1 to {_MAX_PINS}")
    x_mm, z_mm, diameter_mm = (
        table.numbers(name, least)
        for name, least in (("x_mm", -MAX_AWAY_MM), ("z_mm", -MAX_AWAY_MM), ("diameter_mm", 0.01))
    )
    by_name: dict[str, Stimulus] = {}
    names = table.words("stimulus").tolist()
    for row, name in enumerate(names):
        try:
            Shape.punch(diameter_mm[row]).moved(x_mm[row], z_mm[row])
        except UsageError as error:
            raise table.error(row, str(error)) from error
        if name in by_name:
            continue
        stimuli = stimuli_of(name, preindent_um)
        if len(stimuli) != 1:
            raise table.error(row, f"stimulus {name!r} names {len(stimuli)}, expected one")
        by_name[name] = stimuli[0]
    waves = [by_name[name] for name in names]
    most = max(wave.displacement_um.size for wave in waves)
    if most * len(waves) > _MAX_PIN_SAMPLES:
        raise UsageError(
            f"{path}: {len(waves)} pins of {most} samples, expected at most "
            f"{_MAX_PIN_SAMPLES} in all"
        )
    depth_um = np.empty((most, len(waves)))
    for pin, wave in enumerate(waves):  # a pin whose waveform has ended stays where it is
        depth_um[:, pin] = np.pad(
            wave.displacement_um, (0, most - wave.displacement_um.size), "edge"
        )
    places = tuple(zip(x_mm.tolist(), z_mm.tolist(), diameter_mm.tolist(), strict=True))
    window_ms = min(w.window_ms[0] for w in waves), max(w.window_ms[1] for w in waves)
    return Way.of_pins(Pins(places, depth_um), waves[0].dt_ms, window_ms)


def _check_values(name: str, values: FloatArray, least: float, most: float) -> None:
    """Refuse `values` that are not finite or not from `least` to `most`."""
    lowest, highest = float(values.min()), float(values.max())
    if not (least <= lowest and highest <= most):
        raise UsageError(f"{name} is {lowest:g} to {highest:g}, expected {least:g} to {most:g}")


def _level(press_um: float | None, press_n: float | None) -> tuple[float, str]:
    """What a shape is pressed with, and its name."""
    if (press_um is None) == (press_n is None):
        raise UsageError("a shape is pressed to a depth or with a force, one of both")
    level = press_um if press_um is not None else press_n
    if level is None or not (np.isfinite(level) and level > 0):
        raise UsageError(f"pressed by {level}, expected more than 0")
    return level, f"{level:g} um" if press_um is not None else f"{level:g} N"
