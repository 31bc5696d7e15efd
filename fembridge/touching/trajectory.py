"""How a shape moves: depth or force, and position, over time; and arrays of pins."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from typing import TYPE_CHECKING, Any

import numpy as np

from decks.stimuli import DECIMALS, DT_MS
from fembridge.errors import UsageError
from fembridge.io.text_table import FRAME, read_table
from fembridge.io.waveform import resolve_stimuli
from fembridge.ranges import ABOVE_ZERO, Range, check_range
from fembridge.touching.contact import DEEPEST_UM, MM_PER_UM, MOST_UM
from fembridge.touching.shape import MAX_AWAY_MM, Shape
from fembridge.typing import FloatArray, Table

if TYPE_CHECKING:
    import pandas
    from numpy.typing import ArrayLike

    from fembridge.io.waveform import WaveformLike
    from fembridge.stimulus import Stimulus

_MS_PER_S = 1.0e3
_MOST_N = 20.0
_MAX_SAMPLES = 200_001
# The highest lift of a shape above first touch, and its farthest position from the middle.
_MAX_LIFT_UM = 1.0e6
_MAX_DISTANCE_MM = 1_000.0
_MAX_TIME_MS = 1.0e12
_MAX_PINS, _MAX_PIN_SAMPLES = 2_000, 20_000_000
# Time at rest before a press and after it, so that its onset is part of it.
_REST_MS = 10.0
SPEED_MM_PER_S = Range(ABOVE_ZERO, 1000)
"""Speed of a shape that slides."""


@dataclass(frozen=True, slots=True, eq=False)
class PinArray:
    """Flat round pins that move on their own.

    Parameters
    ----------
    positions
        ``(x_mm, z_mm, diameter_mm)`` of each pin.
    depth_um
        Depth of each pin in um over time, ``(T, pin)``, from its own first touch.

    Raises
    ------
    UsageError
        No pins, too many, or another number of columns than of pins.
    """

    positions: tuple[tuple[float, float, float], ...]
    depth_um: FloatArray

    def __post_init__(self) -> None:
        count = len(self.positions)
        if not 1 <= count <= _MAX_PINS:
            raise UsageError(
                f"{count} pins, expected 1 to {_MAX_PINS}",
                argument="positions",
                found=count,
                expected=f"1 to {_MAX_PINS} pins",
            )
        if self.depth_um.ndim != 2 or self.depth_um.shape[1] != count:
            raise UsageError(
                f"has shape {self.depth_um.shape}, expected (T, {count}), a column a pin",
                argument="depth_um",
                found=self.depth_um.shape,
            )
        for x_mm, z_mm, diameter_mm in self.positions:
            Shape.punch(diameter_mm).moved(x_mm, z_mm)  # refuses impossible pins
        _check_values("depth_um", self.depth_um, -_MAX_LIFT_UM, MOST_UM)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Trajectory:
    """How a shape moves: samples of its depth or force, and of its position, from time 0.

    Class methods make the usual ones: `press`, `slide`, `from_waveform`, `from_table` and
    `from_pins`.

    Parameters
    ----------
    depth_um
        Depth of the shape below first touch in um, ``(T,)``. Default: None, `force_n` is
        given.
    force_n
        Force of the shape in N, ``(T,)``. Default: None, `depth_um` is given.
    x_mm, z_mm
        Position of the shape across and along the finger in mm, ``(T,)``, relative to its own
        place. Default: None, it does not slide.
    dt_ms
        Time between two samples in ms. Default: 0.5.
    window_ms
        Start and end in ms of the window in which spikes are counted, the start excluded.
        Default: all samples.
    name
        Name of the stimulus in tables. Default: ``trajectory``.
    preindent_um
        Depth in um before time 0, part of `depth_um`; None where the shape comes from above the
        skin, as in a press. Default: None.
    pins
        Pins that move on their own; `depth_um` is then that of the deepest. Default: None.
    origin
        How the samples were made, for the record. Default: nothing.

    Raises
    ------
    UsageError
        Both of depth and force or neither, arrays of different lengths, or numbers beyond the
        range of the model.

    Examples
    --------
    >>> import numpy as np
    >>> import fembridge as fb
    >>> steps = np.arange(400)
    >>> fb.Trajectory(depth_um=np.minimum(steps, 200), x_mm=0.01 * steps, z_mm=0 * steps)
    Trajectory('trajectory', 400 samples every 0.5 ms, up to 200 um, slides)
    """

    depth_um: FloatArray | None = None
    force_n: FloatArray | None = None
    x_mm: FloatArray | None = None
    z_mm: FloatArray | None = None
    dt_ms: float = DT_MS
    window_ms: tuple[float, float] = (0.0, math.inf)
    name: str = "trajectory"
    preindent_um: float | None = None
    pins: PinArray | None = None
    origin: Mapping[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if (self.depth_um is None) == (self.force_n is None):
            raise UsageError("expected either depth_um or force_n", argument="depth_um")
        for argument in ("depth_um", "force_n", "x_mm", "z_mm"):
            values = getattr(self, argument)
            if values is not None:
                object.__setattr__(self, argument, _to_samples(argument, values))
        count = self.level.size
        if not 1 <= count <= _MAX_SAMPLES:
            raise UsageError(f"{count} samples, expected 1 to {_MAX_SAMPLES}", found=count)
        if not 0 < self.dt_ms < math.inf:
            raise UsageError(argument="dt_ms", found=self.dt_ms, expected="more than 0")
        start_ms, end_ms = self.window_ms
        if end_ms == math.inf:
            end_ms = max((count - 1) * self.dt_ms, self.dt_ms)
            object.__setattr__(self, "window_ms", (start_ms, end_ms))
        if not -math.inf < start_ms < end_ms < math.inf:
            raise UsageError(
                argument="window_ms", found=self.window_ms, expected="a start before the end"
            )
        if self.depth_um is not None:
            _check_values("depth_um", self.depth_um, -_MAX_LIFT_UM, DEEPEST_UM)
        if self.force_n is not None:
            _check_values("force_n", self.force_n, -_MAX_LIFT_UM, _MOST_N)
        if (self.x_mm is None) != (self.z_mm is None):
            missing = "x_mm" if self.x_mm is None else "z_mm"
            raise UsageError("is missing beside the other coordinate", argument=missing)
        for argument, position_mm in (("x_mm", self.x_mm), ("z_mm", self.z_mm)):
            if position_mm is None:
                continue
            if position_mm.size != count:
                raise UsageError(
                    f"has {position_mm.size} samples, expected {count}",
                    argument=argument,
                    found=position_mm.size,
                )
            _check_values(argument, position_mm, -_MAX_DISTANCE_MM, _MAX_DISTANCE_MM)

    def __repr__(self) -> str:
        unit = "um" if self.force_n is None else "N"
        parts = [
            repr(self.name),
            f"{self.level.size} samples every {self.dt_ms:g} ms",
            f"up to {self.level.max():g} {unit}",
        ]
        return f"Trajectory({', '.join(parts + ['slides'] * self.slides)})"

    @property
    def level(self) -> FloatArray:
        """Depth in um, or force in N if that is given, ``(T,)``."""
        level = self.depth_um if self.force_n is None else self.force_n
        assert level is not None
        return level

    @property
    def by_force(self) -> bool:
        """Whether the force is given rather than the depth."""
        return self.force_n is not None

    @property
    def slides(self) -> bool:
        """Whether the shape moves over the skin."""
        return self.x_mm is not None

    @property
    def times_ms(self) -> FloatArray:
        """Time of each sample in ms, ``(T,)``."""
        times: FloatArray = np.arange(self.level.size, dtype=np.float64) * self.dt_ms
        return times

    def preindented(self, depth_um: float) -> Trajectory:
        """The trajectory, deeper by a pre-indentation if it begins at 0.

        Parameters
        ----------
        depth_um
            Depth in um before time 0. A press, a slide, a path, and a waveform or a pin that
            begins deeper than 0 stay as they are.
        """
        if self.preindent_um != 0 or not depth_um or self.depth_um is None:
            return self
        if self.pins is None:
            if self.depth_um[0] > 0:
                return self
            return replace(
                self, depth_um=np.round(self.depth_um + depth_um, DECIMALS), preindent_um=depth_um
            )
        pins_um = self.pins.depth_um
        deeper_um = np.where(pins_um[0] > 0, pins_um, np.round(pins_um + depth_um, DECIMALS))
        return replace(
            self,
            depth_um=deeper_um.max(axis=1),
            preindent_um=depth_um,
            pins=PinArray(self.pins.positions, deeper_um),
        )

    def to_table(self) -> Table:
        """Name, kind, time step, window and digest of the samples, for a record."""
        digest = sha256()
        columns = (self.depth_um, self.force_n, self.x_mm, self.z_mm)
        pins_um = None if self.pins is None else self.pins.depth_um
        for values in (*columns, pins_um):
            digest.update(b"" if values is None else np.ascontiguousarray(values).tobytes())
        if self.pins is not None:
            digest.update(np.array(self.pins.positions).tobytes())
        table: Table = {
            **self.origin,
            "name": self.name,
            "samples": int(self.level.size),
            "dt_ms": float(self.dt_ms),
            "window_ms": [float(edge_ms) for edge_ms in self.window_ms],
            "control": "force" if self.by_force else "depth",
            "sha256": digest.hexdigest(),
        }
        if self.preindent_um is not None:
            table["preindent_um"] = float(self.preindent_um)
        if self.pins is not None:
            table["pins"] = len(self.pins.positions)
        return table

    # ---- The usual trajectories

    @classmethod
    def press(
        cls,
        press_um: float | None = None,
        press_n: float | None = None,
        ramp_ms: float = 50.0,
        hold_ms: float = 500.0,
    ) -> Trajectory:
        """Ramp to a depth or force, hold, and ramp back; the ramps are raised cosines.

        Parameters
        ----------
        press_um, press_n
            Depth in um, or force in N: one of both. Default: None.
        ramp_ms, hold_ms
            Times in ms of each ramp and of the hold. Defaults: 50 and 500.

        Raises
        ------
        UsageError
            Depth and force together or neither, or a time out of range.
        """
        level, name = _level(press_um, press_n)
        check_range("ramp_ms", ramp_ms)
        check_range("hold_ms", hold_ms)
        ramp = 0.5 * (1 - np.cos(np.pi * np.arange(round(ramp_ms / DT_MS)) * DT_MS / ramp_ms))
        rest = np.zeros(round(_REST_MS / DT_MS))
        hold = np.ones(round(hold_ms / DT_MS) + 1)
        samples = level * np.concatenate([rest, ramp, hold, ramp[::-1], rest])
        origin = {"ramp_ms": float(ramp_ms), "hold_ms": float(hold_ms)}
        return cls(**_controlled(samples, press_um), name=f"hold {name}", origin=origin)

    @classmethod
    def slide(
        cls,
        slide_mm_per_s: float,
        press_um: float | None = None,
        press_n: float | None = None,
        duration_ms: float = 1000.0,
        direction_deg: float = -90.0,
    ) -> Trajectory:
        """Slide over the skin at a constant speed, at a constant depth or force.

        Parameters
        ----------
        slide_mm_per_s
            Speed in mm/s.
        press_um, press_n
            Depth in um, or force in N: one of both. Default: None.
        duration_ms
            Duration in ms. Default: 1000.
        direction_deg
            Direction in deg, counter-clockwise from +x as seen from above; 90 is towards
            the tip. Default: -90, towards the base.

        Raises
        ------
        UsageError
            Depth and force together or neither, or a number out of range.
        """
        level, name = _level(press_um, press_n)
        check_range("slide_mm_per_s", slide_mm_per_s, SPEED_MM_PER_S)
        check_range("duration_ms", duration_ms)
        check_range("direction_deg", direction_deg)
        times_ms = np.arange(round(duration_ms / DT_MS) + 1) * DT_MS
        distance_mm = slide_mm_per_s * times_ms / _MS_PER_S
        angle = np.radians(direction_deg)
        return cls(
            **_controlled(np.full(times_ms.size, level), press_um),
            x_mm=0.0 + np.cos(angle) * distance_mm,
            z_mm=0.0 + np.sin(angle) * distance_mm,
            name=f"slide {slide_mm_per_s:g} mm/s {name}",
            origin={
                "slide_mm_per_s": float(slide_mm_per_s),
                "direction_deg": float(direction_deg),
            },
        )

    @classmethod
    def from_waveform(cls, stimulus: WaveformLike, preindent_um: float = 0.0) -> Trajectory:
        """Depth of a waveform; if the waveform slides, its position across the finger.

        Parameters
        ----------
        stimulus
            An id of the catalogue, a `Stimulus`, a `Waveform`, the path of a waveform file, or
            a DataFrame ``time_ms,displacement_um``.
        preindent_um
            Depth in um before time 0, added to a waveform that begins at 0. Default: 0.

        Raises
        ------
        UsageError, StimulusError, TableError
            No such waveform, or several of them.
        """
        stimuli = resolve_stimuli(stimulus, preindent_um)
        if len(stimuli) != 1:
            raise UsageError(
                f"names {len(stimuli)} stimuli, expected one", argument="stimulus", found=stimulus
            )
        wave = stimuli[0]
        aside_um = wave.aside_um
        return cls(
            depth_um=np.asarray(wave.displacement_um),
            x_mm=None if aside_um is None else aside_um * MM_PER_UM,
            z_mm=None if aside_um is None else 0.0 * aside_um,
            dt_ms=wave.dt_ms,
            window_ms=wave.window_ms,
            name=wave.id,
            preindent_um=wave.preindent_um,
            origin={key: value for key, value in wave.origin.items() if value is not None},
        )

    @classmethod
    def from_table(
        cls, table: str | os.PathLike[str] | pandas.DataFrame, name: str | None = None
    ) -> Trajectory:
        """A path over the skin: ``time_ms,x_mm,z_mm`` with ``depth_um`` or ``force_n``.

        Parameters
        ----------
        table
            A DataFrame or the path of a CSV file. Rows may be at any rising times; the path is
            linear between them, and its first row is time 0.
        name
            Name of the stimulus. Default: None, the name of the file, or ``path``.

        Raises
        ------
        TableError, UsageError
            Another column, times that do not rise, or too long a time.
        """
        rows = read_table(table, ("time_ms", "x_mm", "z_mm"), ("depth_um", "force_n"))
        controls = [column for column in ("depth_um", "force_n") if column in rows.header]
        if len(controls) != 1 or rows.size < 2:
            raise UsageError(
                "expected two rows or more with either depth_um or force_n",
                rows.path,
                expected="depth_um or force_n, and two rows",
            )
        row_ms = rows.numbers("time_ms", -_MAX_TIME_MS)
        rows.refuse(np.diff(row_ms, prepend=row_ms[0] - 1) <= 0, lambda _: "time_ms does not rise")
        steps = (float(row_ms[-1]) - float(row_ms[0])) / DT_MS + 1e-9
        if not 1 <= steps < _MAX_SAMPLES:
            raise UsageError(
                f"time_ms from {row_ms[0]:g} to {row_ms[-1]:g}, expected {DT_MS:g} to "
                f"{(_MAX_SAMPLES - 1) * DT_MS:g} ms",
                rows.path,
            )
        times_ms = np.arange(int(steps) + 1) * DT_MS
        x_mm, z_mm, level = (
            np.interp(times_ms + row_ms[0], row_ms, rows.numbers(column))
            for column in ("x_mm", "z_mm", controls[0])
        )
        name = name or ("path" if rows.path is FRAME else rows.path.stem)
        try:
            return cls(**{controls[0]: level}, x_mm=x_mm, z_mm=z_mm, name=name)
        except UsageError as error:
            raise UsageError(
                error.problem, rows.path, argument=error.argument, found=error.found
            ) from error

    @classmethod
    def from_pins(
        cls,
        table: str | os.PathLike[str] | pandas.DataFrame,
        depth_um: ArrayLike | None = None,
        *,
        dt_ms: float = DT_MS,
        preindent_um: float = 0.0,
    ) -> Trajectory:
        """Flat round pins that move on their own.

        Parameters
        ----------
        table
            A DataFrame or the path of a CSV file with the columns ``x_mm,z_mm,diameter_mm``, a
            row a pin. Without `depth_um` the column ``stimulus`` names a waveform for each:
            an id or the path of a file; in a DataFrame also a `Stimulus` or a `Waveform`.
        depth_um
            Depths of the pins in um, ``(T, pin)``, from their own first touch. Default: None,
            the column ``stimulus``.
        dt_ms
            Time between two samples of `depth_um` in ms. Default: 0.5.
        preindent_um
            Depth in um before time 0, added to each pin that begins at 0. Default: 0.

        Raises
        ------
        TableError, StimulusError, UsageError
            Another column, a pin without a waveform, or too many samples.

        Examples
        --------
        >>> import numpy as np, pandas as pd
        >>> import fembridge as fb
        >>> pins = pd.DataFrame({"x_mm": [0, 1], "z_mm": [0, 0], "diameter_mm": [0.5, 0.5]})
        >>> fb.Trajectory.from_pins(pins, np.linspace([0, 50], [100, 50], 200))
        Trajectory('2 pins', 200 samples every 0.5 ms, up to 100 um)
        """
        has_depth = depth_um is not None
        columns = ("x_mm", "z_mm", "diameter_mm") + (() if has_depth else ("stimulus",))
        waves = None if has_depth else _waveforms_of(table)
        rows = read_table(table, columns, ())
        if not 1 <= rows.size <= _MAX_PINS:
            raise UsageError(f"{rows.size} pins, expected 1 to {_MAX_PINS}", rows.path)
        x_mm, z_mm, diameter_mm = (
            rows.numbers(column, least)
            for column, least in (
                ("x_mm", -MAX_AWAY_MM),
                ("z_mm", -MAX_AWAY_MM),
                ("diameter_mm", 0.01),
            )
        )
        for row in range(rows.size):
            try:
                Shape.punch(diameter_mm[row]).moved(x_mm[row], z_mm[row])
            except UsageError as error:
                raise rows.error(row, str(error)) from error
        positions = tuple(zip(x_mm.tolist(), z_mm.tolist(), diameter_mm.tolist(), strict=True))
        if depth_um is not None:
            samples_um = np.array(depth_um, dtype=np.float64)
            pins = PinArray(positions, samples_um)
            window_ms, start_um = (0.0, math.inf), 0.0
        else:
            named = rows.words("stimulus").tolist() if waves is None else waves
            by_name: dict[Any, Stimulus] = {}
            for row, wave in enumerate(named):
                key = wave if isinstance(wave, str) else id(wave)
                if key in by_name:
                    continue
                stimuli = resolve_stimuli(wave, preindent_um)
                if len(stimuli) != 1:
                    raise rows.error(row, f"stimulus {wave!r} names {len(stimuli)}, expected one")
                by_name[key] = stimuli[0]
            stimuli = [by_name[wave if isinstance(wave, str) else id(wave)] for wave in named]
            pins = PinArray(positions, _side_by_side(stimuli, rows.path))
            dt_ms = stimuli[0].dt_ms
            if other := [wave.id for wave in stimuli if wave.dt_ms != dt_ms]:
                raise UsageError(
                    f"{rows.path}: {other[0]} has another time step than {stimuli[0].id}"
                )
            starts, ends = zip(*(wave.window_ms for wave in stimuli), strict=True)
            window_ms, start_um = (min(starts), max(ends)), max(w.preindent_um for w in stimuli)
        trajectory = cls(
            depth_um=pins.depth_um.max(axis=1),
            dt_ms=dt_ms,
            window_ms=window_ms,
            name=f"{len(positions)} pins",
            preindent_um=start_um,
            pins=pins,
        )
        return trajectory.preindented(preindent_um) if has_depth else trajectory


def _side_by_side(stimuli: Sequence[Stimulus], path: os.PathLike[str]) -> FloatArray:
    """Depths ``(T, pin)`` of all waveforms; after the end of a shorter one its pin rests."""
    count = max(wave.displacement_um.size for wave in stimuli)
    if count * len(stimuli) > _MAX_PIN_SAMPLES:
        raise UsageError(
            f"{path}: {len(stimuli)} pins of {count} samples, expected at most "
            f"{_MAX_PIN_SAMPLES} in all"
        )
    depth_um = np.empty((count, len(stimuli)))
    for pin, wave in enumerate(stimuli):
        missing = count - wave.displacement_um.size
        depth_um[:, pin] = np.pad(wave.displacement_um, (0, missing), "edge")
    return depth_um


def _waveforms_of(table: Any) -> list[Any] | None:  # noqa: ANN401 - a path or a DataFrame
    """The column ``stimulus`` of a DataFrame if it has other values than texts."""
    values = list(table["stimulus"]) if "stimulus" in getattr(table, "columns", ()) else []
    return None if all(isinstance(value, str) for value in values) else values


def _to_samples(argument: str, values: object) -> FloatArray:
    """Samples ``(T,)`` in double precision."""
    try:
        samples = np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise UsageError(argument=argument, found=values, expected="numbers") from error
    if samples.ndim != 1:
        raise UsageError(
            f"has shape {samples.shape}, expected (T,)", argument=argument, found=samples.shape
        )
    return samples


def _check_values(argument: str, values: FloatArray, low: float, high: float) -> None:
    """Refuse `values` that are not finite or not from `low` to `high`."""
    if not values.size:
        return
    least, most = float(values.min()), float(values.max())
    if not (low <= least and most <= high):
        raise UsageError(
            f"is {least:g} to {most:g}, expected {low:g} to {high:g}",
            argument=argument,
            found=(least, most),
            expected=f"{low:g} to {high:g}",
        )


def _controlled(samples: FloatArray, press_um: float | None) -> dict[str, Any]:
    return {"force_n" if press_um is None else "depth_um": samples}


def _level(press_um: float | None, press_n: float | None) -> tuple[float, str]:
    """Depth or force of a press, and its name."""
    if press_um is None and press_n is None:
        raise UsageError(
            "is missing, and so is press_n", argument="press_um", expected="a depth or a force"
        )
    if press_um is not None and press_n is not None:
        raise UsageError("cannot be combined with press_um", argument="press_n", found=press_n)
    argument, level, unit = (
        ("press_um", press_um, "um") if press_n is None else ("press_n", press_n, "N")
    )
    assert level is not None
    check_range(argument, level)
    return level, f"{level:g} {unit}"
