"""What a fit minimises: the rates of many candidates against observed ones.

The objectives are the paper's (section 3.2): for each group of stimuli, such as the
sinusoids of one frequency, the mean of the squared differences of rates.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.typing import ArrayLike

from fembridge.typing import BoolArray, FloatArray, IntArray
from neural.counts import candidate_counts
from neural.filters import checked_stress
from neural.models import Free, Model
from neural.parameters import AfferentParameters, quantiles
from neural.rates import window_rows


@dataclass(frozen=True, slots=True, eq=False)
class FitProblem:
    """One class, one model, and the rates that were observed of it.

    Parameters
    ----------
    model
        Row of `neural.models`.
    stress_pa
        Stress at the afferent, ``(T, stimulus)`` in Pa; row 0 is at time 0.
    observed_ips
        Observed rates, ``(stimulus,)``.
    groups
        Name of the group of each stimulus: one objective a group.
    windows_ms
        Where the spikes of each stimulus are counted.
    dt_ms
        Time between two samples.
    cells
        Cells of a candidate; by default the model's own number.
    """

    model: Model
    stress_pa: FloatArray
    observed_ips: FloatArray
    groups: tuple[str, ...]
    windows_ms: tuple[tuple[float, float], ...]
    dt_ms: float
    cells: int = 0
    _filtered: tuple[FloatArray, ...] = field(init=False, repr=False)
    _edges: tuple[IntArray, IntArray] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        stress = checked_stress(np.array(self.stress_pa, dtype=np.float64))
        observed = np.array(self.observed_ips, dtype=np.float64)
        rows = [window_rows(window, self.dt_ms) for window in self.windows_ms]
        edges = (np.array([each.start for each in rows]), np.array([each.stop for each in rows]))
        filtered = self.model.filtered(stress, self.dt_ms, "backward")
        for name, value in (
            ("cells", self.cells or self.model.cells),
            ("stress_pa", stress),
            ("observed_ips", observed),
            ("_filtered", tuple(each[:-1] for each in filtered)),
            ("_edges", edges),
        ):
            object.__setattr__(self, name, value)

    @property
    def free(self) -> tuple[Free, ...]:
        """Parameters that are searched, the columns of `values`."""
        return self.model.free(self.cells)

    @property
    def group_names(self) -> tuple[str, ...]:
        """Names of the objectives, in order of first appearance."""
        return tuple(dict.fromkeys(self.groups))

    def rates_ips(self, values: FloatArray, single: bool = False) -> FloatArray:
        """Rates ``(candidate, stimulus)`` of parameters ``(candidate, free)``.

        `single` precision is for searching.
        """
        values = np.atleast_2d(values)
        named = {one.field: values[:, k] for k, one in enumerate(self.free)}
        fixed = _defaults(self.model.parameters)
        spread = named.get("spread", np.zeros(len(values)))
        need = np.exp(np.multiply.outer(spread, quantiles(self.cells))).reshape(-1)
        known: dict[str, ArrayLike] = {
            **fixed,
            **{name: np.repeat(column, self.cells) for name, column in named.items()},
        }
        counts = candidate_counts(
            self._filtered,
            self.model.coefficients(known).for_need(need),
            known["tau_ms"],
            dt_ms=self.dt_ms,
            gap_mv=fixed["threshold_mv"] - fixed["rest_mv"],
            refractory_ms=fixed["refractory_ms"],
            window=self._edges,
            clamped=self.model.clamped,
            jump_mv=known["jump_mv"],
            recovery_ms=known["recovery_ms"],
            single=single,
        )
        spikes = counts.reshape(len(values), self.cells, -1).sum(axis=1)
        spans_ms = np.array([end - start for start, end in self.windows_ms])
        rates: FloatArray = spikes * 1000.0 / (self.cells * spans_ms)
        return rates

    def part(self, keep: BoolArray) -> "FitProblem":
        """The problem of some of the stimuli, a flag each, ``(stimulus,)``."""
        (rows,) = np.nonzero(keep)
        return replace(
            self,
            stress_pa=self.stress_pa[:, rows],
            observed_ips=self.observed_ips[rows],
            groups=tuple(self.groups[row] for row in rows),
            windows_ms=tuple(self.windows_ms[row] for row in rows),
        )

    def errors_ips2(self, values: FloatArray, single: bool = False) -> FloatArray:
        """Objectives ``(candidate, group)``: mean squared errors in impulses²/s²."""
        return self.group_errors(self.rates_ips(values, single))

    def group_errors(self, rates_ips: FloatArray) -> FloatArray:
        """As `errors_ips2`, of rates ``(candidate, stimulus)`` that are known."""
        squared = (rates_ips - self.observed_ips) ** 2
        names = np.array(self.groups)
        return np.stack([squared[:, names == name].mean(axis=1) for name in self.group_names], 1)

    def parameters(self, values: Sequence[float] | FloatArray) -> AfferentParameters:
        """Parameters of one candidate, ``(free,)``."""
        found = {one.field: float(value) for one, value in zip(self.free, values, strict=True)}
        return self.model.parameters(
            **found, cells=self.cells, drive=self.model.name, dt_ms=self.dt_ms
        )


def _defaults(kind: type[AfferentParameters]) -> dict[str, float]:
    """What the parameters of a class have where a fit does not search."""
    return {
        one.name: float(one.default) for one in fields(kind) if isinstance(one.default, int | float)
    }
