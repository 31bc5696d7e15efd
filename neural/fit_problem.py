"""What a fit minimises: the rates of many candidates against observed ones.

The objectives are the paper's (section 3.2): for each group of stimuli, such as the
sinusoids of one frequency, the mean of the squared differences of rates.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.typing import ArrayLike

from fembridge.errors import ParameterError
from fembridge.typing import FloatArray, IntArray
from neural.candidates import candidate_counts
from neural.drive import checked_stress
from neural.drive_model import Drive, Free
from neural.parameters import AfferentParameters, check_cells, quantiles
from neural.rate import window_rows
from neural.tally import window_edges


@dataclass(frozen=True, slots=True, eq=False)
class FitProblem:
    """One class, one drive, and the rates that were observed of it.

    Parameters
    ----------
    drive
        Row of `neural.drive_table`.
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
        Cells of a candidate; by default the drive's own number.

    Raises
    ------
    ParameterError
        Lengths that do not go together, or rates that are no rates.
    """

    drive: Drive
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
        sizes = {observed.size, len(self.groups), len(self.windows_ms)}
        square = stress.ndim == 2 and observed.ndim == 1
        if not square or sizes != {stress.shape[1]} or not observed.size:
            raise ParameterError(
                f"stress {stress.shape}, {observed.size} rates, {len(self.groups)} "
                f"groups, {len(self.windows_ms)} windows; expected (T, stimulus) and "
                "one of each a stimulus"
            )
        if not (np.isfinite(observed).all() and (observed >= 0).all()):
            raise ParameterError("an observed rate is negative or not finite")
        if self.cells:
            check_cells(self.cells, self.drive.afferent)
        rows = [window_rows(window, self.dt_ms) for window in self.windows_ms]
        edges = (np.array([each.start for each in rows]), np.array([each.stop for each in rows]))
        window_edges(edges, len(stress) - 1, observed.size)  # or tells which is wrong
        filtered = self.drive.filters(stress, self.dt_ms, "backward")
        for name, value in (
            ("cells", self.cells or self.drive.cells),
            ("stress_pa", stress),
            ("observed_ips", observed),
            ("_filtered", tuple(each[:-1] for each in filtered)),
            ("_edges", edges),
        ):
            object.__setattr__(self, name, value)

    @property
    def free(self) -> tuple[Free, ...]:
        """Parameters that are searched, the columns of `values`."""
        return self.drive.free(self.cells)

    @property
    def group_names(self) -> tuple[str, ...]:
        """Names of the objectives, in order of first appearance."""
        return tuple(dict.fromkeys(self.groups))

    def rates_ips(self, values: FloatArray, single: bool = False) -> FloatArray:
        """Rates ``(candidate, stimulus)`` of parameters ``(candidate, free)``.

        `single` precision is for searching.
        """
        values = np.atleast_2d(values)
        if values.ndim != 2 or values.shape[1] != len(self.free):
            raise ParameterError(
                f"values {values.shape}, expected (candidate, {len(self.free)}): "
                f"{', '.join(one.field for one in self.free)}"
            )
        named = {one.field: values[:, k] for k, one in enumerate(self.free)}
        fixed = _defaults(self.drive.parameters)
        spread = named.get("spread", np.zeros(len(values)))
        need = np.exp(np.multiply.outer(spread, quantiles(self.cells))).reshape(-1)
        known: dict[str, ArrayLike] = {
            **fixed,
            **{name: np.repeat(column, self.cells) for name, column in named.items()},
        }
        counts = candidate_counts(
            self._filtered,
            self.drive.coefficients(known).for_need(need),
            known["tau_ms"],
            dt_ms=self.dt_ms,
            gap_mv=fixed["threshold_mv"] - fixed["rest_mv"],
            refractory_ms=fixed["refractory_ms"],
            window=self._edges,
            floored=self.drive.floored,
            jump_mv=known["jump_mv"],
            recovery_ms=known["recovery_ms"],
            single=single,
        )
        spikes = counts.reshape(len(values), self.cells, -1).sum(axis=1)
        spans_ms = np.array([end - start for start, end in self.windows_ms])
        rates: FloatArray = spikes * 1000.0 / (self.cells * spans_ms)
        return rates

    def part(self, keep: ArrayLike) -> "FitProblem":
        """Give the problem of some of the stimuli, a flag each, ``(stimulus,)``."""
        flags = np.asarray(keep)
        if flags.dtype != np.bool_ or flags.shape != self.observed_ips.shape:
            raise ParameterError(
                f"{flags.dtype} {flags.shape}, expected a flag for each of "
                f"{self.observed_ips.size} stimuli"
            )
        (rows,) = np.nonzero(flags)
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
        """Give the parameters of one candidate, ``(free,)``."""
        if len(values) != len(self.free):
            raise ParameterError(f"{len(values)} values, expected {len(self.free)}")
        found = {one.field: float(value) for one, value in zip(self.free, values, strict=True)}
        return self.drive.parameters(
            **found, cells=self.cells, drive=self.drive.name, dt_ms=self.dt_ms
        )


def _defaults(kind: type[AfferentParameters]) -> dict[str, float]:
    """Give what the parameters of a class have where a fit does not search."""
    return {
        one.name: float(one.default) for one in fields(kind) if isinstance(one.default, int | float)
    }
