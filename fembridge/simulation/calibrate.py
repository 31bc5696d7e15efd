"""The gain of a robot's sensor from one press of known force or depth.

A sensor has no skin: its number has to become the stress that the afferents of a fingertip would
have under the same press. So the same object is pressed on the fingertip model, with the force or
to the depth of the press, and the stress of each class below it is divided by the signal of the
press. PC, 2 mm deep, has a fiftieth of the stress of SA, so each class has a gain of its own.

The signal of the press is the largest median of five successive samples minus the signal without
load, the median of the samples before the press.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fembridge.errors import ParameterError, TraceError, UsageError, warn
from fembridge.version import __version__

if TYPE_CHECKING:
    import pandas
    from numpy.typing import ArrayLike

    from fembridge.touching.pad import Pad
    from fembridge.touching.shape import Shape
    from fembridge.trace import Traces
    from fembridge.typing import FloatArray, Table

CLASSES = ("SA", "RA", "PC")
# Parameters that were fitted on the mechanics of the reference pad.
_PAD_SET = "fitted_pad"
_DEEPEST_UM = 2000.0
_WINDOW = 5
# Above the first share of its largest change a signal is clearly loaded; the press begins where it
# leaves its noise, or the second share.
_LOADED_SHARE, _LEAST_SHARE = 0.1, 0.002
# A shorter part before the press says little of the noise.
_LONG_MS = 50.0
# A press is at least this many times the spread of the signal without load.
_CLEAR = 5.0


@dataclass(frozen=True, slots=True, repr=False)
class Calibration:
    """Gains and offset of a sensor, the result of `calibrate`.

    Parameters
    ----------
    gain_pa
        Stress in Pa of 1 unit of the sensor above its offset, by class. Below 0 where the signal
        falls under load.
    offset
        Signal without load, by column of the table; the number of a single column is that of any
        other column, too. Default: empty, 0.
    parameters
        Name of the parameter set that was fitted on these mechanics. Default: ``""``, none.
    provenance
        Press, its column and its signal, and the object. Default: empty.

    Raises
    ------
    ParameterError
        An unknown class, no class, or a number that is not finite or a gain of 0.

    Examples
    --------
    >>> import fembridge as fb
    >>> calibration = fb.Calibration({"SA": 2e4, "RA": 1.5e4, "PC": 400.0}, {"force": 0.5})
    >>> float(calibration.stress_pa(1.5)["PC"])
    400.0
    """

    gain_pa: Mapping[str, float]
    offset: Mapping[str, float] = field(default_factory=dict)
    parameters: str = ""
    provenance: Table = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.gain_pa or (unknown := set(self.gain_pa) - set(CLASSES)):
            found = ", ".join(sorted(unknown)) if self.gain_pa else "no class"
            expected = f"a gain of {', '.join(CLASSES)}"
            raise ParameterError(argument="gain_pa", found=found, expected=expected)
        for name in ("gain_pa", "offset"):
            numbers = {key: _number(name, key, value) for key, value in getattr(self, name).items()}
            object.__setattr__(self, name, numbers)
        for key, gain in self.gain_pa.items():
            if not gain:
                raise ParameterError(
                    argument="gain_pa", key=f"gain_pa.{key}", found=gain, expected="not 0"
                )

    def __repr__(self) -> str:
        offset = ", ".join(f"{name} {value:.6g}" for name, value in self.offset.items()) or "0"
        return f"Calibration({self.option}, offset {offset})"

    @property
    def option(self) -> str:
        """The gains as the option ``--gain-pa`` takes them: ``SA=2e4,RA=1.5e4,PC=400``."""
        return ",".join(f"{name}={gain:.6g}" for name, gain in self.gain_pa.items())

    def stress_pa(self, values: ArrayLike, column: str | None = None) -> dict[str, FloatArray]:
        """Stress in Pa of each class, of the shape of `values`, as `neural.Stream` takes it.

        Parameters
        ----------
        values
            Numbers of the sensor.
        column
            Name of their column, for its offset. Default: None, the only one.

        Raises
        ------
        UsageError
            The offset of the column is not known.
        """
        signal = np.asarray(values, dtype=np.float64) - self._offset_of(column)
        return {name: gain * signal for name, gain in self.gain_pa.items()}

    def to_stress(
        self, signals: Traces, columns: Sequence[str], afferents: Sequence[str] | None
    ) -> Traces:
        """Traces of the sensor as stress, one for each class.

        Parameters
        ----------
        signals
            Signals, column after column of each unit.
        columns
            Names of their columns.
        afferents
            Classes. Default: None, that of a signal, else all with a gain.

        Raises
        ------
        UsageError
            A class without a gain, or a column without an offset.
        """
        from fembridge.trace import StressTrace, Traces

        traces = []
        for number, signal in enumerate(signals):
            column = columns[number % len(columns)] if columns else None
            value = signal.stress_pa - self._offset_of(column)
            classes = [signal.afferent] if signal.afferent else afferents or list(self.gain_pa)
            for name in classes:
                if name not in self.gain_pa:
                    expected = f"one of {', '.join(self.gain_pa)}"
                    raise UsageError(
                        argument="gain_pa", found=f"no gain of {name}", expected=expected
                    )
                traces.append(
                    StressTrace(
                        self.gain_pa[name] * value,
                        signal.dt_ms,
                        signal.node,
                        name,
                        signal.start_ms,
                        signal.unit,
                        signal.stimulus,
                    )
                )
        return Traces(traces, signals.origin, signals.windows_ms)

    def _offset_of(self, column: str | None) -> float:
        if not self.offset:
            return 0.0
        if column is not None and column in self.offset:
            return self.offset[column]
        if len(self.offset) == 1:
            return next(iter(self.offset.values()))
        expected = f"one of {', '.join(self.offset)}"
        raise UsageError(
            argument="column", found=column, expected=f"{expected}, which have offsets"
        )

    def write(self, path: str | os.PathLike[str]) -> Path:
        """Write the calibration as TOML, which `read` and ``encode --calibration`` read.

        Parameters
        ----------
        path
            Path of the file.

        Returns
        -------
        Path
            The same.
        """
        from fembridge.host.store import write_toml

        table: Table = {"fembridge": __version__}
        if self.parameters:
            table["parameters"] = self.parameters
        table |= {"gain_pa": dict(self.gain_pa), "offset": dict(self.offset)}
        write_toml(Path(path), table | ({"press": self.provenance} if self.provenance else {}))
        return Path(path)

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Calibration:
        """Calibration of a file of `write`, or one written by hand: a table ``gain_pa``.

        Parameters
        ----------
        path
            Path of the file.

        Raises
        ------
        ParameterError
            The file is missing or not TOML, or a number is missing or out of range.
        """
        from fembridge.host.store import read_toml

        file = Path(path)
        table = read_toml(file, ParameterError.at(file))
        expected = {"fembridge", "parameters", "gain_pa", "offset", "press"}
        if unknown := sorted(set(table) - expected):
            raise ParameterError(
                path=file, key=unknown[0], found="an unknown key", expected=", ".join(expected)
            )
        parts: dict[str, Any] = {}
        for name in ("gain_pa", "offset", "press"):
            parts[name] = table.get(name, {})
            if not isinstance(parts[name], dict):
                raise ParameterError(path=file, key=name, found=parts[name], expected="a table")
        try:
            return cls(
                parts["gain_pa"], parts["offset"], str(table.get("parameters", "")), parts["press"]
            )
        except ParameterError as error:
            raise ParameterError.from_error(error, file) from error


def _number(name: str, key: str, value: object) -> float:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not np.isfinite(value):  # type: ignore[call-overload] # a number
        raise ParameterError(
            argument=name, key=f"{name}.{key}", found=value, expected="a finite number"
        )
    return float(value)  # type: ignore[arg-type] # a number


def calibrate(
    press: str | os.PathLike[str] | pandas.DataFrame,
    *,
    force_n: float | None = None,
    depth_um: float | None = None,
    shape: str | Shape = "punch",
    pad: str | Path | Pad = "reference",
    columns: Mapping[str, str | Sequence[str]] | None = None,
) -> Calibration:
    """Gains of a sensor from one press of known force or depth.

    The object that pressed the sensor is pressed on the fingertip of `touch`; each class has the
    stress of an afferent below its middle, the mean over positions across a fingerprint ridge.

    Parameters
    ----------
    press
        A table with a column of time and one or several of values: the path of a file, or a
        DataFrame. It begins before the press. Of several columns, the one with the largest change
        was pressed.
    force_n
        Largest force of the press in N. Default: None.
    depth_um
        Instead of the force, the depth in um to which the object would press a fingertip. Default:
        None.
    shape
        The object: a specification of `touch` such as ``"plate"``, ``"ball:diameter_mm=5"``, or a
        `Shape`. Default: ``"punch"``, a flat pin of 1 mm.
    pad
        The fingertip, as in `touch`. Default: ``"reference"``.
    columns
        Names of the columns, as in `encode`. Default: None, recognised.

    Returns
    -------
    Calibration

    Raises
    ------
    UsageError
        Not exactly one of `force_n` and `depth_um`, or more than the model reaches.
    TableError
        A table without a column of time or of values.
    TraceError
        A signal in which nothing is pressed.

    Warns
    -----
    FembridgeWarning
        The noise of the sensor before the press makes a class fire, or contact reaches the end of
        the skin.

    Examples
    --------
    >>> import numpy as np
    >>> import pandas as pd
    >>> import fembridge as fb
    >>> time_s = np.arange(0, 1, 0.001)
    >>> volts = 0.4 + 0.8 * np.interp(time_s, [0.2, 0.4, 0.6, 0.8], [0, 1, 1, 0])
    >>> calibration = fb.calibrate(pd.DataFrame({"time_s": time_s, "volts": volts}), depth_um=300)
    >>> round(calibration.offset["volts"], 3), calibration.gain_pa["SA"] > 5e4
    (0.4, True)
    """
    from fembridge.ranges import check_range

    if (force_n is None) == (depth_um is None):
        found = "both" if force_n is not None else "neither"
        problem = "or --depth-um (depth_um) is required, and not both"
        raise UsageError(problem, argument="force_n", found=found, expected="one of both")
    if force_n is not None:
        check_range("force_n", force_n)
    if depth_um is not None and not 0 < depth_um <= _DEEPEST_UM:
        expected = f"a number more than 0, at most {_DEEPEST_UM:g}"
        raise UsageError(argument="depth_um", found=depth_um, expected=expected)
    changes, offsets, still = _changes(press, columns)
    pressed = max(changes, key=lambda name: abs(changes[name]))
    change = changes[pressed]
    stress_pa, depth_um, force_n = _stress_under(shape, pad, force_n, depth_um)
    record: dict[str, object] = {
        "column": pressed,
        "change": change,
        "depth_um": depth_um,
        "force_n": force_n,
        "shape": shape if isinstance(shape, str) else shape.name,
        "pad": str(pad) if isinstance(pad, str | os.PathLike) else str(getattr(pad, "name", "pad")),
        "stress_pa": stress_pa,
    }
    if isinstance(press, str | os.PathLike):
        record = {"file": Path(press).name, **record}
    gains = {name: value / change for name, value in stress_pa.items()}
    _warn_of_noise(*still[pressed], gains)
    return Calibration(gains, offsets, _PAD_SET, record)


def _warn_of_noise(noise: FloatArray, dt_ms: float, gains: Mapping[str, float]) -> None:
    """Warn of classes that the noise of the sensor makes fire."""
    from neural import encode_cells, mean_rate_ips, parameter_set
    from neural.time_step import fits_step

    firing = []
    for name, values in parameter_set(_PAD_SET).parameters.items():
        if name in gains and noise.size * dt_ms > _LONG_MS and fits_step(values, dt_ms):
            [cells] = encode_cells(gains[name] * noise, dt_ms, values)
            rate_ips = mean_rate_ips(cells, (0.0, (noise.size - 1) * dt_ms))
            if rate_ips >= 1:
                firing.append(f"{name} {rate_ips:.0f} impulses/s")
    if firing:
        warn(
            f"the noise of the sensor without load fires {', '.join(firing)}: filter the signal "
            "before it is encoded, or leave the class out"
        )


def _changes(
    press: str | os.PathLike[str] | pandas.DataFrame,
    columns: Mapping[str, str | Sequence[str]] | None,
) -> tuple[dict[str, float], dict[str, float], dict[str, tuple[FloatArray, float]]]:
    """Of each column the change by the press, the signal without load, and its noise.

    The noise is the part before the press minus the offset, ``(T,)``, and its step in ms.
    """
    from fembridge.io.sensor_table import sensor_table
    from fembridge.io.trace_table import read_traces

    table: Any = Path(press) if isinstance(press, str | os.PathLike) else press
    sensor = sensor_table(table, columns, has_gain=True)
    chosen = columns if sensor is None else sensor.columns
    signals = read_traces(table, columns=chosen, gain_pa=1.0, is_sensor=True)
    names = sensor.value_names if sensor else []
    names = names or [signal.unit or "value" for signal in signals]
    if len(names) != len(signals):
        found = f"{len(signals)} signals"
        raise UsageError(argument="press", found=found, expected="one press, a row a time")
    changes, offsets, clear = {}, {}, False
    still: dict[str, tuple[FloatArray, float]] = {}
    for name, signal in zip(names, signals, strict=True):
        values = signal.stress_pa
        before = values[: _first_loaded(values)]
        offsets[name] = float(np.median(before))
        still[name] = before - offsets[name], signal.dt_ms
        medians = (
            np.median(np.lib.stride_tricks.sliding_window_view(values, _WINDOW), axis=1)
            if (values.size > _WINDOW)
            else values
        )
        rise = medians - offsets[name]
        changes[name] = float(rise[np.abs(rise).argmax()])
        clear |= abs(changes[name]) > _CLEAR * float(np.std(before))
    if not clear:
        raise TraceError(
            "no press: the signal changes by less than five times its spread before the press",
            Path(press) if isinstance(press, str | os.PathLike) else None,
        )
    return changes, offsets, still


def _first_loaded(values: FloatArray) -> int:
    """First sample of the press: it leaves the noise of the samples before."""
    first = np.median(values[: max(_WINDOW, values.size // 50)])
    size = np.abs(values - first)
    clearly = np.flatnonzero(size > _LOADED_SHARE * size.max())
    if not clearly.size:
        return values.size
    least = max(
        _CLEAR * float(np.std(values[: max(_WINDOW, clearly[0] // 2)])),
        _LEAST_SHARE * float(size.max()),
    )
    return max(_WINDOW, int(np.argmax(size > least)))


def _stress_under(
    shape: str | Shape, pad: str | Path | Pad, force_n: float | None, depth_um: float | None
) -> tuple[dict[str, float], float, float]:
    """Stress in Pa of each class below the object, and its depth in um and force in N."""
    import warnings

    from scipy.interpolate import PchipInterpolator

    from fembridge.errors import FembridgeWarning
    from fembridge.touching.pad_probe import PadProbe

    if depth_um is None:
        assert force_n is not None
        with warnings.catch_warnings():  # of depths that this press does not reach
            warnings.simplefilter("ignore", FembridgeWarning)
            deep = PadProbe(pad=pad, shape=shape, deepest_um=_DEEPEST_UM).response
        if force_n > deep.force_n[-1]:
            name = shape if isinstance(shape, str) else shape.name
            raise UsageError(
                argument="force_n",
                found=force_n,
                expected=f"at most {deep.force_n[-1]:.3g} N under {name}, which is then 2 mm deep; "
                "a wider object is another --shape (shape)",
            )
        depth_um = float(PchipInterpolator(deep.force_n, deep.depth_um)(force_n))
    response = PadProbe(pad=pad, shape=shape, deepest_um=depth_um).response
    force_n = float(response.force_n[-1]) if force_n is None else float(force_n)
    deepest_pa = response.tensor_pa[-1, :, 0]
    stress_pa = {
        name: float(
            np.mean(
                [deepest_pa[k] for k, site in enumerate(response.places) if site.afferent == name]
            )
        )
        for name in response.class_names()
    }
    return stress_pa, float(depth_um), force_n
