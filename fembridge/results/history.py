"""A quantity at nodes at all outputs of a solver.

Unlike a `StressTrace` it may have uneven times, a single output, several steps, or the modes of
a frequency or buckling step.
"""

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fembridge.errors import ResultError, TraceError, UsageError, warn
from fembridge.results.von_mises import DERIVED, TENSOR
from fembridge.trace import (
    MS_PER_S,
    STEP_TOLERANCE,
    StressTrace,
    doubt_of_step,
    mean_step,
    middle_step,
    resample,
)
from fembridge.typing import FloatArray, IntArray

if TYPE_CHECKING:
    import pandas

STRESS, VON_MISES = "stress", "von-mises"
# By quantity: its names in the formats; the first that a file has is used.
NAMES = {
    STRESS: (
        "STRESS", "Cauchy Stress", "Stress", "Cauchy Stress 41 to 46", "Stress 11 to 16",
        "Stress in Global System",
    ),
    "displacement": ("DISP", "DISPR", "Displacement"),
    "reaction-force": ("FORC", "Reaction Force"),
    "strain": ("TOSTRAIN", "MESTRAIN", "Total Strain", "Elastic Strain"),
    "temperature": ("NDTEMP", "TOTEMP", "Temperature"),
}  # fmt: skip
TENSOR_COMPONENTS = tuple(f"S{component.upper()}" for component in TENSOR)
# By quantity: its function of the stress tensor.
STRESS_FUNCTIONS = {
    name.replace("_", "-"): function
    for name, (sources, function) in DERIVED.items()
    if sources == ("STRESS",)
}
NO_KEYS = np.empty((0, 2), dtype=np.int64)
_FEW_STEPS = 0.2  # share of other time steps that may be damage; more are the solver's choice
IMPLAUSIBLE_PA = 1.0e9  # stress in soft tissue is some kPa
TIME, FREQUENCY = "total time", "frequency in cycles per time"
_AXES = {TIME: "time_ms", FREQUENCY: "frequency_hz", "buckling factor": "buckling_factor"}
_UNIT_WORDS = {"": "", "1": "", "%": "percent", "mm/s": "mm_per_s", "mm/s2": "mm_per_s2"}


@dataclass(frozen=True, slots=True, eq=False)
class History:
    """Values of a quantity at nodes at the outputs of a file.

    Parameters
    ----------
    quantity, components, units
        Its name, and the name and unit of each component.
    nodes
        Node numbers.
    at
        Time of each output in ms ``(T,)``; for modes the value that `axis` names.
    values
        ``(T, node, component)``, NaN where a node has no value.
    keys
        Step and increment, or step and mode, of each output ``(T, 2)``.
    path
        The file.
    axis
        Quantity of `at`. Default: `TIME`.
    afferents
        Afferent class at each node, None if unknown. Default: ().
    last_digit_ms
        Function of times that returns one unit of their last stored digit, in ms. Default:
        None, times are exact.
    step_ms
        Time step in ms from the start of the stimulus on. Default: None, derived from `at`.
    """

    quantity: str
    components: tuple[str, ...]
    units: tuple[str, ...]
    nodes: tuple[int, ...]
    at: FloatArray
    values: FloatArray
    keys: IntArray
    path: Path
    axis: str = TIME
    afferents: tuple[str | None, ...] = ()
    last_digit_ms: Callable[[FloatArray], FloatArray] | None = None
    step_ms: float | None = None

    @classmethod
    def from_stress(
        cls, nodes: Iterable[int], times_ms: FloatArray, stress_pa: FloatArray, path: Path
    ) -> "History":
        """Stress over time: six components are the tensor, one is von Mises stress."""
        is_scalar = stress_pa.shape[-1] == 1
        components = ("von_mises",) if is_scalar else TENSOR_COMPONENTS
        units = ("Pa",) * len(components)
        quantity = VON_MISES if is_scalar else STRESS
        return cls(
            quantity, components, units, tuple(map(int, nodes)), times_ms, stress_pa, NO_KEYS, path
        )

    @property
    def over_time(self) -> bool:
        """Whether the outputs have times; False for modes."""
        return self.axis == TIME

    @property
    def dt_ms(self) -> float | None:
        """Time step in ms of an even time axis; None for any other axis."""
        if self.step_ms is not None:
            return self.step_ms
        if not self.over_time or self.at.size < 2:
            return None
        dt_ms, odd = mean_step(self.at)
        return dt_ms if odd is None else None

    @property
    def uneven(self) -> bool:
        """Whether times are uneven but increasing, so that they can be resampled."""
        rising = self.over_time and self.at.size > 1 and bool((np.diff(self.at) > 0).all())
        return rising and self.dt_ms is None

    @property
    def form(self) -> str:
        """Description of the outputs: count, range and step of the times."""
        count, values = self.at.size, self.at
        if not self.over_time:
            span = f"{values[0]:g} to {values[-1]:g}" if count > 1 else f"{values[0]:g}"
            return f"{count} mode{'s' * (count > 1)}, {self.axis} {span}"
        if count == 1:
            return f"one increment, at {values[0]:g} ms"
        span = f"{count} increments, {values.min():g} to {values.max():g} ms"
        if self.dt_ms is not None:
            return f"{values[0]:g} to {values[-1]:g} ms every {self.dt_ms:g} ms"
        steps_ms = np.diff(values)
        if (falling := np.flatnonzero(steps_ms <= 0)).size:
            row = int(falling[0]) + 1
            return (
                f"{span}; times do not rise: {values[row]:g} ms comes after {values[row - 1]:g} ms"
            )
        if steps_ms.size > 1 and np.ptp(steps_ms[:-1]) <= STEP_TOLERANCE * steps_ms[0]:
            return f"{span}, every {steps_ms[0]:g} ms, the last after {steps_ms[-1]:g} ms"
        return f"{span}, uneven: {steps_ms.min():g} to {steps_ms.max():g} ms apart"

    def _time_warning(self) -> str:
        """Warning about times that do not rise, or a few steps unlike the others; or ""."""
        if not self.over_time or self.at.size < 2:
            return ""
        steps_ms = np.diff(self.at)
        row = int(np.argmin(steps_ms > 0))
        if steps_ms[row] <= 0:
            return f"times do not rise: {self.at[row + 1]:g} ms comes after {self.at[row]:g} ms"
        median_ms = middle_step(steps_ms)
        is_odd = np.abs(steps_ms - median_ms) > STEP_TOLERANCE * median_ms
        if steps_ms[-1] < median_ms:  # to the end of a step
            is_odd[-1] = False
        if not 0 < is_odd.sum() <= _FEW_STEPS * is_odd.size:
            return ""
        row = int(np.argmax(is_odd))
        first_ms, second_ms = self.at[row : row + 2]
        return (
            f"the time step is {median_ms:g} ms except for {is_odd.sum()} steps, the first from "
            f"{first_ms:g} to {second_ms:g} ms: rows may be missing or damaged"
        )

    @property
    def resample_ms(self) -> float:
        """Suggested time step in ms: 0.5, or at most a tenth of a history shorter than 1 ms."""
        span_ms = float(np.ptp(self.at))
        return 0.5 if span_ms >= 1.0 else float(10.0 ** np.floor(np.log10(span_ms / 10.0)))

    def peaks(self) -> list[tuple[str, float]]:
        """Column and value of the largest absolute value at each node."""
        names = column_names(self.components, self.units)
        flat = np.nan_to_num(self.values.transpose(1, 0, 2)).reshape(len(self.nodes), -1)
        largest = np.abs(flat).argmax(axis=1)
        return [
            (names[column % len(names)], float(flat[row, column]))
            for row, column in enumerate(largest.tolist())
        ]

    def selected(self, quantity: str, resample_ms: float | None, quiet: bool = False) -> "History":
        """History of `quantity`, which is this one or derived from it, every `resample_ms`.

        The tensor is resampled, not the derived quantity. Implausible times or stress trigger a
        warning unless `quiet`.
        """
        history = self if resample_ms is None else self.resampled(resample_ms)
        selected = history.derived(quantity)
        if not quiet and (message := self._time_warning()):
            warn(message, self.path)
        if not quiet and selected.over_time and selected.units[0] == "Pa":
            peak_pa = float(np.abs(np.nan_to_num(selected.values)).max())
            if peak_pa > IMPLAUSIBLE_PA:
                warn(
                    f"{selected.quantity} reaches {peak_pa:.3g} Pa, above 1 GPa, but soft tissue "
                    "bears kPa: check --length-unit (m for a model in m) and --stress-unit",
                    self.path,
                )
        return selected

    def derived(self, quantity: str) -> "History":
        """History of `quantity`, computed from this stress tensor if it is another quantity."""
        if quantity not in STRESS_FUNCTIONS or quantity == self.quantity:
            return self
        if not set(TENSOR_COMPONENTS) <= set(self.components):
            components_text = ", ".join(self.components)
            raise UsageError(
                f"{quantity} needs a stress tensor, {self.quantity} has {components_text}",
                self.path,
            )
        with np.errstate(over="ignore", invalid="ignore"):
            columns = [
                self.components.index(name_of_component) for name_of_component in TENSOR_COMPONENTS
            ]
            values = STRESS_FUNCTIONS[quantity](np.nan_to_num(self.values[:, :, columns]))
        name = quantity.replace("-", "_")
        components: tuple[str, ...] = (name,)
        if values.ndim == 2:
            values = values[..., None]
        else:
            components = tuple(f"{name}_{k + 1}" for k in range(values.shape[2]))
        values[np.isnan(self.values).any(axis=-1)] = np.nan
        units = ("Pa",) * len(components)
        return replace(self, quantity=quantity, components=components, units=units, values=values)

    def resampled(self, dt_ms: float) -> "History":
        """History at every `dt_ms`, by PCHIP, see `fembridge.trace.resample`."""
        if not self.over_time:
            raise UsageError(
                f"needs outputs over time, found modes ({self.axis})",
                self.path,
                argument="resample_ms",
            )
        if message := self._missing_value():
            raise ResultError(f"cannot be resampled: {message}; choose other nodes", self.path)
        from logging import getLogger

        logger = getLogger(__name__)
        try:
            times_ms, values = resample(
                self.at, self.values, dt_ms, lambda line: logger.info(f"{self.path}: {line}")
            )
        except TraceError as error:
            raise ResultError(str(error), self.path) from error
        step_ms, uneven_row = mean_step(self.at)
        coarser = uneven_row is None and step_ms < dt_ms
        if coarser and (warning := doubt_of_step(self.values, step_ms, dt_ms)):
            warn(warning, self.path)
        return replace(self, at=times_ms, values=values, keys=NO_KEYS)

    def with_even_times(self) -> "History":
        """History with exactly even times, if the stored times are even except for rounding.

        With six digits a time step of 1/3 ms looks uneven.
        """
        times_ms = self.at
        if self.last_digit_ms is None or not self.over_time or times_ms.size < 2:
            return self
        even_ms, share = (
            np.linspace(times_ms[0], times_ms[-1], times_ms.size),
            np.linspace(0.0, 1.0, times_ms.size),
        )
        digit_ms = self.last_digit_ms(times_ms)
        tolerance_ms = digit_ms + (1.0 - share) * digit_ms[0] + share * digit_ms[-1]  # ends, too
        return (
            replace(self, at=even_ms)
            if (np.abs(even_ms - times_ms) <= tolerance_ms).all()
            else self
        )

    def traces(self) -> list[StressTrace]:
        """Von Mises stress at each node, on an even grid."""
        von_mises = self.derived(VON_MISES)
        if not self.over_time:
            raise ResultError(f"a trace needs outputs over time; found {self.form}", self.path)
        if (np.diff(self.at) <= 0).any():
            raise ResultError(self.form, self.path)
        if self.step_ms is not None and (message := self._missing_value()):
            raise ResultError(message, self.path)
        traces = []
        for row, node in enumerate(self.nodes):
            stress_pa = von_mises.values[:, row, 0]  # noqa: PD011 - no frame
            afferent = self.afferents[row] if self.afferents else None
            if self.step_ms is not None:
                traces.append(StressTrace(stress_pa, self.step_ms, node, afferent))
                continue
            has_value = ~np.isnan(stress_pa)
            times_ms, count = self.at[has_value], int(has_value.sum())
            if count < 2:
                raise ResultError(f"node {node}: {count} samples, expected two or more", self.path)
            dt_ms, uneven_row = mean_step(times_ms)
            if uneven_row is not None:
                before_ms, after_ms = times_ms[uneven_row : uneven_row + 2]
                raise ResultError(
                    f"node {node}: uneven time step from {before_ms:g} to {after_ms:g} ms, the "
                    f"mean step is {dt_ms:g} ms; --resample-ms 0.5 (resample_ms=0.5) makes an "
                    "even one",
                    self.path,
                )
            start_ms = float(times_ms[0])
            traces.append(StressTrace(stress_pa[has_value], dt_ms, node, afferent, start_ms))
        return traces

    def _missing_value(self) -> str | None:
        """Message about the first node without a value; None if all nodes have values."""
        absent = np.argwhere(np.isnan(self.values).any(axis=2))
        if not absent.size:
            return None
        row, column = absent[0].tolist()
        return f"node {self.nodes[column]} has no value at {self.at[row]:g} ms, other nodes do"

    def columns(self) -> dict[str, Any]:
        """A long table by column, node by node; column names have units."""
        rows, count = self.at.size, len(self.nodes)
        has_value = ~np.isnan(self.values).all(axis=2).T  # (node, T)
        table: dict[str, Any] = {}  # of (T,), (node, 1) or both
        steps, numbers = self.keys.T
        if not self.over_time:
            table |= {"step": steps, "mode": numbers}
        table[_AXES.get(self.axis, "number")] = self.at
        if self.over_time:
            classes = self.afferents or (None,) * count
            table["afferent"] = np.array([afferent or "" for afferent in classes], dtype=object)[
                :, None
            ]
        table["node"] = np.array(self.nodes, dtype=np.int64)[:, None]
        if self.over_time and self.quantity != VON_MISES and steps.size:
            table |= {"step": steps, "increment": numbers}
        for column, name in enumerate(column_names(self.components, self.units)):
            table[name] = self.values[:, :, column].T
        shape = count, rows
        return {name: np.broadcast_to(values, shape)[has_value] for name, values in table.items()}

    def to_frame(self) -> "pandas.DataFrame":
        """The table as a DataFrame."""
        import pandas

        return pandas.DataFrame(self.columns())


def column_names(components: Sequence[str], units: Sequence[str]) -> list[str]:
    """Column name of each component, with its unit: ``sxx_pa``."""
    names = []
    for component, unit in zip(components, units, strict=True):
        plain = re.sub(r"\W+", "_", component.lower()).strip("_")
        names.append(plain + unit_ending(unit))
    return names


def unit_ending(unit: str) -> str:
    """Suffix of a column name that carries `unit`: ``_pa``."""
    suffix = _UNIT_WORDS.get(unit, unit.lower())
    return f"_{suffix}" if suffix else ""


def printed_digit_ms(times_ms: FloatArray, digits: FloatArray | int) -> FloatArray:
    """One unit of the last digit, in ms, of times that are printed in s with `digits` digits."""
    times_s = np.maximum(np.abs(times_ms) / MS_PER_S, np.finfo(np.float64).tiny)
    digit_ms: FloatArray = 10.0 ** (np.floor(np.log10(times_s)) + 1 - digits) * MS_PER_S
    return digit_ms


def match_quantity(names: Sequence[str], requested: str | None, path: Path) -> str:
    """The one of `names` that `requested` means; case does not matter, a unique beginning suffices.

    None takes the displacement; without one, the first name.
    """
    if requested is None:
        return next((name for name in NAMES["displacement"] if name in names), names[0])
    folded = {name: name.casefold() for name in names}
    for synonym in (*NAMES.get(requested.casefold(), ()), requested):
        if matches := [name for name in names if folded[name] == synonym.casefold()]:
            return matches[0]
    candidates = [name for name in names if folded[name].startswith(requested.casefold())]
    if len(candidates) == 1:
        return candidates[0]
    problem = f"no quantity {requested}"
    if candidates:
        problem = f"{requested!r} is ambiguous: {' or '.join(candidates)}"
    raise ResultError(f"{problem}; the file has {', '.join(names) or 'none'}", path)


def history_of_samples(samples: Sequence[tuple[int, FloatArray]], path: Path) -> History:
    """Von Mises stress at nodes from samples ``(T, 2)`` of time in ms and stress in Pa."""
    times_ms = samples[0][1][:, 0]
    same_times = all(np.array_equal(curve[:, 0], times_ms) for _, curve in samples)
    if not same_times:
        times_ms = np.unique(np.concatenate([curve[:, 0] for _, curve in samples]))
    values = np.full((times_ms.size, len(samples), 1), np.nan)
    for column, (_, curve) in enumerate(samples):
        rows = slice(None) if same_times else np.searchsorted(times_ms, curve[:, 0])
        values[rows, column, 0] = curve[:, 1]
    return History.from_stress((node for node, _ in samples), times_ms, values, path)
