"""A quantity at nodes over the outputs of a solver: what there is, row by row.

Unlike a `StressTrace` its rows may be uneven in time, one alone, of several steps, or the
modes of a frequency or buckling step.
"""

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fembridge.errors import ResultError, TraceError, UsageError
from fembridge.results.stress import DERIVED, TENSOR
from fembridge.trace import (
    MS_PER_S,
    STEP_TOLERANCE,
    StressTrace,
    doubt_of_step,
    mean_step,
    resample,
)
from fembridge.typing import FloatArray, IntArray

if TYPE_CHECKING:
    import pandas

STRESS, VON_MISES = "stress", "von-mises"
# By word: the names that formats have for it, the first that a file has.
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
TENSOR_COMPONENTS = tuple(f"S{place.upper()}" for place in TENSOR)
# By word: what is computed of the tensor.
OF_STRESS = {
    name.replace("_", "-"): of for name, (takes, of) in DERIVED.items() if takes == ("STRESS",)
}
NO_KEYS = np.empty((0, 2), dtype=np.int64)
_FEW_STEPS = 0.2  # share of odd steps that may be damage; more are the solver's choice
IMPLAUSIBLE_PA = 1.0e9  # of soft tissue, whose stresses are some kPa
TIME, FREQUENCY = "total time", "frequency in cycles per time"
_AXES = {TIME: "time_ms", FREQUENCY: "frequency_hz", "buckling factor": "buckling_factor"}
_UNIT_WORDS = {"": "", "1": "", "%": "percent", "mm/s": "mm_per_s", "mm/s2": "mm_per_s2"}


@dataclass(frozen=True, slots=True, eq=False)
class History:
    """`values` ``(T, node, component)`` of `quantity` at `nodes`; NaN where a node has none.

    They are of the file `path`. A row is an output, of the step and increment, or mode, in
    `keys` ``(T, 2)``. `at` ``(T,)`` is its time in ms, or what `axis` says of a mode. `units`
    has one word a component. `afferents` are the classes that sit at the nodes, where these
    are known; `last_digit_ms` what the last digit of a time is, that the file has; `step_ms`
    the step from 0 on of a run from its stimulus on.
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
    def of_stress(
        cls, nodes: Iterable[int], times_ms: FloatArray, stress_pa: FloatArray, path: Path
    ) -> "History":
        """Stress over time ``(T, node, component)``: six are the tensor, one von Mises stress."""
        plain = stress_pa.shape[-1] == 1
        components = ("von_mises",) if plain else TENSOR_COMPONENTS
        units = ("Pa",) * len(components)
        word = VON_MISES if plain else STRESS
        return cls(
            word, components, units, tuple(map(int, nodes)), times_ms, stress_pa, NO_KEYS, path
        )

    @property
    def over_time(self) -> bool:
        """Whether rows are of times, not modes."""
        return self.axis == TIME

    @property
    def dt_ms(self) -> float | None:
        """The step of an even time axis; None of any other."""
        if self.step_ms is not None:
            return self.step_ms
        if not self.over_time or self.at.size < 2:
            return None
        dt_ms, odd = mean_step(self.at)
        return dt_ms if odd is None else None

    @property
    def uneven(self) -> bool:
        """Whether resampling would make an even time axis of it."""
        rising = self.over_time and self.at.size > 1 and bool((np.diff(self.at) > 0).all())
        return rising and self.dt_ms is None

    @property
    def form(self) -> str:
        """What the rows are, in words."""
        count, at = self.at.size, self.at
        if not self.over_time:
            span = f"{at[0]:g} to {at[-1]:g}" if count > 1 else f"{at[0]:g}"
            return f"{count} mode{'s' * (count > 1)}, {self.axis} {span}"
        if count == 1:
            return f"one increment, at {at[0]:g} ms"
        span = f"{count} increments, {at.min():g} to {at.max():g} ms"
        if self.dt_ms is not None:
            return f"{at[0]:g} to {at[-1]:g} ms every {self.dt_ms:g} ms"
        steps_ms = np.diff(at)
        if (back := np.flatnonzero(steps_ms <= 0)).size:
            row = int(back[0]) + 1
            return f"{span}; times do not rise: {at[row]:g} ms comes after {at[row - 1]:g} ms"
        if steps_ms.size > 1 and np.ptp(steps_ms[:-1]) <= STEP_TOLERANCE * steps_ms[0]:
            return f"{span}, every {steps_ms[0]:g} ms, the last after {steps_ms[-1]:g} ms"
        return f"{span}, uneven: {steps_ms.min():g} to {steps_ms.max():g} ms apart"

    def _doubt_of_times(self) -> str:
        """Which times do not rise, or which few steps differ from the others; or ""."""
        if not self.over_time or self.at.size < 2:
            return ""
        steps_ms = np.diff(self.at)
        row = int(np.argmin(steps_ms > 0))
        if steps_ms[row] <= 0:
            return f"times do not rise: {self.at[row + 1]:g} ms comes after {self.at[row]:g} ms"
        usual_ms = float(np.median(steps_ms))
        odd = np.abs(steps_ms - usual_ms) > STEP_TOLERANCE * usual_ms
        if steps_ms[-1] < usual_ms:  # to the end of a step
            odd[-1] = False
        if not 0 < odd.sum() <= _FEW_STEPS * odd.size:
            return ""
        row = int(np.argmax(odd))
        first_ms, second_ms = self.at[row : row + 2]
        return (
            f"times are {usual_ms:g} ms apart but for {odd.sum()}, the first {first_ms:g} to "
            f"{second_ms:g} ms: rows may be missing or damaged"
        )

    @property
    def resample_ms(self) -> float:
        """A step to resample with: an encoder's, or of a shorter history a twentieth or less."""
        span_ms = float(np.ptp(self.at))
        return 0.5 if span_ms >= 1.0 else float(10.0 ** np.floor(np.log10(span_ms / 10.0)))

    def peaks(self) -> list[tuple[str, float]]:
        """By node the column with the value that is largest without its sign, and that value."""
        names = column_names(self.components, self.units)
        flat = np.nan_to_num(self.values.transpose(1, 0, 2)).reshape(len(self.nodes), -1)
        places = np.abs(flat).argmax(axis=1)
        return [
            (names[place % len(names)], float(flat[row, place]))
            for row, place in enumerate(places.tolist())
        ]

    def taken(
        self, word: str, resample_ms: float | None, log: Callable[[str], None] | None
    ) -> "History":
        """What `word` says follows from it, resampled before: the tensor, where it is at hand."""
        held = self if resample_ms is None else self.resampled(resample_ms, log)
        found = held.derived(word)
        if log is not None and (doubt := self._doubt_of_times()):
            log(doubt)
        if log is not None and found.units[0] == "Pa":
            peak_pa = float(np.abs(np.nan_to_num(found.values)).max())
            if peak_pa > IMPLAUSIBLE_PA:
                log(
                    f"{found.quantity} reaches {peak_pa:.3g} Pa, above 1 GPa: of soft tissue it "
                    "is kPa; of a model in m take --length-unit m, or say --stress-unit"
                )
        return found

    def derived(self, word: str) -> "History":
        """The quantity `word` that follows from a stress tensor."""
        if word not in OF_STRESS or word == self.quantity:
            return self
        if not set(TENSOR_COMPONENTS) <= set(self.components):
            held = ", ".join(self.components)
            words = f"{self.path}: {word} takes a stress tensor, {self.quantity} has {held}"
            raise UsageError(words)
        with np.errstate(over="ignore", invalid="ignore"):
            columns = [self.components.index(one) for one in TENSOR_COMPONENTS]
            values = OF_STRESS[word](np.nan_to_num(self.values[:, :, columns]))
        name = word.replace("-", "_")
        components: tuple[str, ...] = (name,)
        if values.ndim == 2:
            values = values[..., None]
        else:
            components = tuple(f"{name}_{k + 1}" for k in range(values.shape[2]))
        values[np.isnan(self.values).any(axis=-1)] = np.nan
        units = ("Pa",) * len(components)
        return replace(self, quantity=word, components=components, units=units, values=values)

    def resampled(self, dt_ms: float, log: Callable[[str], None] | None = None) -> "History":
        """Every `dt_ms` by PCHIP, see `fembridge.trace.resample`."""
        if not self.over_time:
            raise UsageError(f"{self.path}: modes ({self.axis}) cannot be resampled over time")
        if words := self._missing():
            raise ResultError(f"{words}: it cannot be resampled; name other nodes", self.path)
        try:
            at, values = resample(self.at, self.values, dt_ms, log)
        except TraceError as error:
            raise ResultError(str(error), self.path) from error
        step_ms, odd = mean_step(self.at)
        coarser = odd is None and step_ms < dt_ms
        if log and coarser and (doubt := doubt_of_step(self.values, step_ms, dt_ms)):
            log(doubt)
        return replace(self, at=at, values=values, keys=NO_KEYS)

    def unrounded(self) -> "History":
        """With even times, where they are even but for the rounding that they are stored with.

        With six digits an even step of 1/3 ms looks uneven.
        """
        at = self.at
        if self.last_digit_ms is None or not self.over_time or at.size < 2:
            return self
        even, share = np.linspace(at[0], at[-1], at.size), np.linspace(0.0, 1.0, at.size)
        digit_ms = self.last_digit_ms(at)
        off_ms = digit_ms + (1.0 - share) * digit_ms[0] + share * digit_ms[-1]  # ends, too
        return replace(self, at=even) if (np.abs(even - at) <= off_ms).all() else self

    def traces(self) -> list[StressTrace]:
        """Von Mises stress at each node, on an even grid."""
        found = self.derived(VON_MISES)
        if not self.over_time:
            raise ResultError(f"{self.form}: no history over time, no trace to take", self.path)
        if (np.diff(self.at) <= 0).any():
            raise ResultError(self.form, self.path)
        if self.step_ms is not None and (words := self._missing()):
            raise ResultError(words, self.path)
        traces = []
        for row, node in enumerate(self.nodes):
            stress_pa = found.values[:, row, 0]  # noqa: PD011 - no frame
            afferent = self.afferents[row] if self.afferents else None
            if self.step_ms is not None:
                traces.append(StressTrace(stress_pa, self.step_ms, node, afferent))
                continue
            held = ~np.isnan(stress_pa)
            times_ms, count = self.at[held], int(held.sum())
            if count < 2:
                raise ResultError(f"node {node}: {count} samples, expected two or more", self.path)
            dt_ms, odd = mean_step(times_ms)
            if odd is not None:
                before_ms, after_ms = times_ms[odd : odd + 2]
                raise ResultError(
                    f"node {node}: uneven time step, {before_ms:g} to {after_ms:g} ms where "
                    f"{dt_ms:g} ms is the mean; --resample-ms 0.5 (resample_ms=0.5) evens it",
                    self.path,
                )
            start_ms = float(times_ms[0])
            traces.append(StressTrace(stress_pa[held], dt_ms, node, afferent, start_ms))
        return traces

    def _missing(self) -> str | None:
        """Which node has no value, and when; None where all have."""
        absent = np.argwhere(np.isnan(self.values).any(axis=2))
        if not absent.size:
            return None
        row, column = absent[0].tolist()
        return f"node {self.nodes[column]} has no value at {self.at[row]:g} ms, where others have"

    def columns(self) -> dict[str, Any]:
        """A long table by column, node by node: units in the names, von Mises as traces have it."""
        rows, count = self.at.size, len(self.nodes)
        held = ~np.isnan(self.values).all(axis=2).T  # (node, T)
        table: dict[str, Any] = {}  # of (T,), (node, 1) or both
        steps, numbers = self.keys.T
        if not self.over_time:
            table |= {"step": steps, "mode": numbers}
        table[_AXES.get(self.axis, "number")] = self.at
        if self.over_time:
            classes = self.afferents or (None,) * count
            table["afferent"] = np.array([one or "" for one in classes], dtype=object)[:, None]
        table["node"] = np.array(self.nodes, dtype=np.int64)[:, None]
        if self.over_time and self.quantity != VON_MISES and steps.size:
            table |= {"step": steps, "increment": numbers}
        for column, name in enumerate(column_names(self.components, self.units)):
            table[name] = self.values[:, :, column].T
        shape = count, rows
        return {name: np.broadcast_to(values, shape)[held] for name, values in table.items()}

    def to_frame(self) -> "pandas.DataFrame":
        """The table as a DataFrame."""
        import pandas

        return pandas.DataFrame(self.columns())


def column_names(components: Sequence[str], units: Sequence[str]) -> list[str]:
    """A name for each component that carries its unit: ``sxx_pa``."""
    names = []
    for component, unit in zip(components, units, strict=True):
        plain = re.sub(r"\W+", "_", component.lower()).strip("_")
        names.append(plain + unit_ending(unit))
    return names


def unit_ending(unit: str) -> str:
    """What a name ends in to carry `unit`: ``_pa``."""
    word = _UNIT_WORDS.get(unit, unit.lower())
    return f"_{word}" if word else ""


def printed_digit_ms(times_ms: FloatArray, digits: FloatArray | int) -> FloatArray:
    """The last of so many `digits` of each time that is printed in s, ``(T,)`` in ms."""
    times_s = np.maximum(np.abs(times_ms) / MS_PER_S, np.finfo(np.float64).tiny)
    digit_ms: FloatArray = 10.0 ** (np.floor(np.log10(times_s)) + 1 - digits) * MS_PER_S
    return digit_ms


def name_in(held: Sequence[str], wanted: str | None, path: Path) -> str:
    """The name among those of a file for `wanted`, case-blind and as short as is clear.

    None takes the displacement, without one the first.
    """
    if wanted is None:
        return next((one for one in NAMES["displacement"] if one in held), held[0])
    plain = {name: name.casefold() for name in held}
    for one in (*NAMES.get(wanted.casefold(), ()), wanted):
        if same := [name for name in held if plain[name] == one.casefold()]:
            return same[0]
    close = [name for name in held if plain[name].startswith(wanted.casefold())]
    if len(close) == 1:
        return close[0]
    what = f"{wanted!r} may be {' or '.join(close)}" if close else f"no {wanted} in it"
    raise ResultError(f"{what}; it holds {', '.join(held) or 'nothing'}", path)


def of_samples(samples: Sequence[tuple[int, FloatArray]], path: Path) -> History:
    """Von Mises stress of nodes, each with its ``(time_ms, stress_pa)`` samples ``(T, 2)``."""
    times_ms = samples[0][1][:, 0]
    same_times = all(np.array_equal(one[:, 0], times_ms) for _, one in samples)
    if not same_times:
        times_ms = np.unique(np.concatenate([one[:, 0] for _, one in samples]))
    values = np.full((times_ms.size, len(samples), 1), np.nan)
    for column, (_, one) in enumerate(samples):
        rows = slice(None) if same_times else np.searchsorted(times_ms, one[:, 0])
        values[rows, column, 0] = one[:, 1]
    return History.of_stress((node for node, _ in samples), times_ms, values, path)
