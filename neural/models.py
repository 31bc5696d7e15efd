"""Table of all afferent models: equation, free parameters, reason.

`MODELS` has a row for each name and class. ``published`` is the paper's model; each of the
others answers one question about it and is compared with it on the same data in
``docs/model_study.md``. Every model may have more than one cell (``cells``, ``spread``) and
an adaptive threshold (``jump_mv``, ``recovery_ms``).

A current is ``I' = (R_m / τ_m) I`` in mV/ms, so that ``alpha_mv_per_ms`` is the α′ of
Table 2, and neither R_m nor α in mA is needed. Currents (4), (5) and (6) of the paper have
saturating shares.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from fembridge.errors import ParameterError
from fembridge.typing import FloatArray
from neural.filters import (
    CORPUSCLE_POWER,
    acceleration_change,
    corpuscle,
    faded,
    rate_change,
    sa_level,
    sa_rate,
    slow_rate,
    stress_rate,
)
from neural.lif import Membrane
from neural.parameters import (
    AfferentParameters,
    CorpusclePcParameters,
    FadingSaParameters,
    PcParameters,
    RaParameters,
    RisingRaParameters,
    RisingSaParameters,
    SaParameters,
    TwoWayRaParameters,
)

# Cells of `rising`, whose rates are means over a population: the steps of a recorded mean
# are a fifth of an impulse.
CELLS = 5

# Cells of the shipped models: one cell more or less at 300 Hz changes the rate by 30
# impulses/s instead of 60, and a fit cannot place its few steps on the fitted frequencies.
MORE_CELLS = 10

# Threshold minus rest of section 2.2, in mV.
_SA_GAP_MV, _RA_GAP_MV = 15.0, 10.0


# Filtered stress from stress in Pa, the time step in ms and the scheme of σ′.
Filter: TypeAlias = Callable[[FloatArray, float, str], FloatArray]
Values: TypeAlias = Mapping[str, ArrayLike]


@dataclass(frozen=True, slots=True, eq=False)
class Coefficients:
    """Coefficients of a current ``alpha × Σ share``, one share per filter.

    With `halves` a share saturates, ``x / (half + x)``; with `weights` it is linear,
    ``weight × x``; exactly one of both is set. Entries are numbers or arrays. The output
    of linear filters is proportional to the stress to the power `degree`.
    """

    alpha_mv_per_ms: ArrayLike
    halves: tuple[ArrayLike, ...] | None = None
    weights: tuple[ArrayLike, ...] | None = None
    degree: float = 1.0

    def for_need(self, stress_factor: ArrayLike) -> "Coefficients":
        """Coefficients of a cell that needs `stress_factor` times the stress for a current."""
        if self.halves is not None:
            return replace(
                self, halves=tuple(np.multiply(half, stress_factor) for half in self.halves)
            )
        alpha = np.divide(self.alpha_mv_per_ms, np.power(stress_factor, self.degree))
        return replace(self, alpha_mv_per_ms=alpha)

    def backwards(self, share: ArrayLike) -> "Coefficients":
        """Coefficients of a membrane for falling stress, `share` times as sensitive."""
        return replace(self, alpha_mv_per_ms=-np.multiply(self.alpha_mv_per_ms, share))

    def current(self, filtered: Sequence[FloatArray]) -> FloatArray:
        """Current in mV/ms from filtered stress; entries broadcast to its shape."""
        if self.halves is None:
            parts = [gain * x for x, gain in zip(filtered, self.gains(), strict=True)]
            return np.asarray(sum(parts[1:], parts[0]))
        sizes = [np.abs(x) for x in filtered]
        shares = [np.divide(x, half + x) for x, half in zip(sizes, self.halves, strict=True)]
        return np.asarray(np.multiply(self.alpha_mv_per_ms, sum(shares[1:], shares[0])))

    def gains(self) -> tuple[FloatArray, ...]:
        """``alpha × weight`` of each linear share."""
        return tuple(np.multiply(self.alpha_mv_per_ms, weight) for weight in self.weights or ())


@dataclass(frozen=True, slots=True)
class Free:
    """Free parameter of a fit, searched from `low` to `high` in `unit`.

    The search is uniform in the logarithm, or, where `even`, in the parameter.
    """

    field: str
    low: float
    high: float
    unit: str
    even: bool = False


# Search range of each parameter; the paper does not state its ranges.
TAU = Free("tau_ms", 1.0, 1000.0, "ms")
SPREAD = Free("spread", 0.0, 2.0, "1", even=True)
JUMP = Free("jump_mv", 0.1, 30.0, "mV")
RECOVERY = Free("recovery_ms", 1.0, 1000.0, "ms")
A1 = Free("a1_pa", 1e2, 1e6, "Pa")
A2 = Free("a2_pa_per_ms", 1e2, 1e6, "Pa/ms")
A3 = Free("a3_pa_per_ms", 1e1, 1e6, "Pa/ms")
A4 = Free("a4_pa_per_ms2", 1e-1, 1e4, "Pa/ms²")
ALPHA = Free("alpha_mv_per_ms", 1e-1, 1e3, "mV/ms")
BETA = Free("beta_mv_per_ms", 1e-2, 1e2, "mV/ms")
STEP = Free("step_pa", 1e3, 1e6, "Pa")
HELD_LEVEL = Free("held_pa", 1e3, 1e6, "Pa")
RETRACTION = Free("retraction", 0.4, 1.0, "1", even=True)


@dataclass(frozen=True, slots=True)
class Model:
    """One model of one class: filters, current, free parameters and reason.

    `clamped` membranes do not fall below rest. With `two_way` a cell has a second membrane
    that integrates falling stress, and a spike of either is a spike of the cell. The rise of
    the threshold by a spike `fades`; with `until_turn` it is 0 again as soon as the current
    drives the potential below rest. Filters of a `whole` model depend on the trace from its
    first sample. `any_step` equations have no time step: their parameters are valid at any.

    `equation` is stored with fitted parameters; parameters with another equation are
    refused, so its text changes with every constant. `quantity` is the stress it reads:
    ``von_mises``, or ``energy``, the uniaxial stress of equal strain energy.
    """

    name: str
    afferent: str
    parameters: type[AfferentParameters]
    filters: tuple[Filter, ...]
    coefficients: Callable[[Values], Coefficients]
    own_free: tuple[Free, ...]
    equation: str
    reason: str
    clamped: bool = False
    quantity: str = "von_mises"
    adaptive: bool = False
    cells: int = 1
    two_way: bool = False
    until_turn: bool = False
    fades: bool = True
    any_step: bool = False
    whole: bool = False
    tau: Free | None = TAU
    spread: Free = SPREAD

    def filtered(
        self, stress_pa: FloatArray, dt_ms: float, derivative: str
    ) -> tuple[FloatArray, ...]:
        """Output of each filter, in the shape of `stress_pa`."""
        return tuple(apply_filter(stress_pa, dt_ms, derivative) for apply_filter in self.filters)

    def ways(self, values: Values) -> tuple[Coefficients, ...]:
        """Coefficients of each membrane of a cell; the second of a two-way cell is for falls."""
        rises = self.coefficients(values)
        return (rises, rises.backwards(values["retraction"])) if self.two_way else (rises,)

    def membrane(self, values: Values, dt_ms: float) -> Membrane:
        """Membrane constants at the time step `dt_ms`; `values` are parameters by name."""
        return Membrane.from_times(
            dt_ms,
            tau_ms=values["tau_ms"],
            gap_mv=np.subtract(values["threshold_mv"], values["rest_mv"]),
            refractory_ms=values["refractory_ms"],
            clamped=self.clamped,
            jump_mv=values["jump_mv"],
            recovery_ms=values["recovery_ms"] if self.fades else math.inf,
            until_turn=self.until_turn,
        )

    def free(self, cells: int | None = None) -> tuple[Free, ...]:
        """Free parameters of a fit with `cells` (default: the number of the model)."""
        parameters = (self.tau, *self.own_free) if self.tau else self.own_free
        if self.adaptive:
            parameters = (*parameters, JUMP, RECOVERY)
        return (*parameters, self.spread) if (cells or self.cells) > 1 else parameters


def _saturating(*halves: str) -> Callable[[Values], Coefficients]:
    return lambda values: Coefficients(
        values["alpha_mv_per_ms"], halves=tuple(values[name] for name in halves)
    )


def _rising_sa(values: Values) -> Coefficients:
    held_pa_ms = np.multiply(values["held_pa"], values["tau_ms"])
    return Coefficients(
        _SA_GAP_MV, weights=(np.divide(1.0, values["step_pa"]), np.divide(1.0, held_pa_ms))
    )


def _rising_ra(values: Values) -> Coefficients:
    return Coefficients(_RA_GAP_MV, weights=(np.divide(1.0, values["step_pa"]),))


_PUBLISHED = (
    Model(
        name="published",
        afferent="SA",
        parameters=SaParameters,
        filters=(lambda stress, *_: sa_level(stress), sa_rate),
        coefficients=_saturating("a1_pa", "a2_pa_per_ms"),
        own_free=(A1, A2, ALPHA),
        equation="I' = α' (x1/(a1 + x1) + x2/(a2 + x2)), x1 = mean |σ|, x2 = mean |σ'|",
        reason="filters (1), (2) and current (4) of the paper",
    ),
    Model(
        name="published",
        afferent="RA",
        parameters=RaParameters,
        filters=(rate_change,),
        coefficients=_saturating("a3_pa_per_ms"),
        own_free=(A3, ALPHA),
        equation="I' = α' x/(a3 + x), x = |σ'(t) − σ'(t − dt)|",
        reason="filter (3) and current (5) of the paper",
    ),
    Model(
        name="published",
        afferent="PC",
        parameters=PcParameters,
        filters=(acceleration_change,),
        coefficients=_saturating("a4_pa_per_ms2"),
        own_free=(A4, ALPHA),
        equation="I' = α' x/(a4 + x), x = |σ″(t) − σ″(t − dt)|",
        reason="filter (4) and current (6) of the paper",
    ),
)


_ROWS = (
    *_PUBLISHED,
    *(
        replace(
            model,
            name="energy",
            quantity="energy",
            reason="does strain energy density, assumed to drive SA, explain more than von Mises "
            "stress? σ is the uniaxial stress of equal strain energy, √(2EW)",
        )
        for model in _PUBLISHED
    ),
    *(
        replace(
            model,
            name="adaptive",
            adaptive=True,
            reason="does a threshold that each spike raises, as in afferents, limit the rates "
            "at high frequencies?",
        )
        for model in _PUBLISHED
    ),
    Model(
        name="rising",
        afferent="SA",
        parameters=RisingSaParameters,
        filters=(stress_rate, lambda stress, *_: stress),
        coefficients=_rising_sa,
        own_free=(STEP, HELD_LEVEL),
        equation="I' = gap (σ'/step + σ/(held τ)), v ≥ rest",
        reason="observed impulses per cycle depend on the amplitude and hardly on the "
        "frequency: each rise of stress by a step fires once; stress above a level "
        "keeps firing",
        clamped=True,
        cells=CELLS,
        any_step=True,
    ),
    Model(
        name="rising",
        afferent="RA",
        parameters=RisingRaParameters,
        filters=(stress_rate,),
        coefficients=_rising_ra,
        own_free=(STEP,),
        equation="I' = gap σ'/step, v ≥ rest",
        reason="observed impulses per cycle depend on the amplitude and hardly on the "
        "frequency: each rise of stress by a step fires once",
        clamped=True,
        cells=CELLS,
        any_step=True,
    ),
    Model(
        name="fading",
        afferent="SA",
        parameters=FadingSaParameters,
        filters=(slow_rate, faded),
        coefficients=_rising_sa,
        own_free=(replace(STEP, low=2e4, high=2e5), replace(HELD_LEVEL, low=4e3, high=4e4)),
        tau=replace(TAU, low=10.0, high=100.0),
        spread=replace(SPREAD, high=1.0),
        equation="I' = gap (r/step + max(σ - s/2, 0)/(held τ)), r is σ' through a low pass at "
        "100 Hz, s follows σ in 200 ms, v ≥ rest",
        reason="as rising; as in Merkel cells, half of the response to a held stress fades "
        "within 200 ms: slow adaptation, and fewer spikes at 5 and 10 Hz; fast movement "
        "drives it less",
        clamped=True,
        cells=MORE_CELLS,
        whole=True,
        any_step=True,
    ),
    Model(
        name="two_way",
        afferent="RA",
        parameters=TwoWayRaParameters,
        filters=(stress_rate,),
        coefficients=_rising_ra,
        own_free=(replace(STEP, high=1e5), RETRACTION),
        tau=None,
        spread=replace(SPREAD, high=1.5),
        equation="I' = gap σ'/step and -retraction gap σ'/step, a membrane each, v ≥ rest, "
        "threshold + jump until the turn",
        reason="RA fires at indentation and at retraction: each has its own membrane that "
        "counts steps of stress; later steps of one sweep are four times as large",
        clamped=True,
        cells=MORE_CELLS,
        two_way=True,
        until_turn=True,
        fades=False,
        any_step=True,
    ),
    Model(
        name="corpuscle",
        afferent="PC",
        parameters=CorpusclePcParameters,
        filters=(corpuscle,),
        coefficients=lambda values: Coefficients(
            values["beta_mv_per_ms"], weights=(1.0,), degree=CORPUSCLE_POWER
        ),
        own_free=(replace(BETA, low=0.3),),
        tau=replace(TAU, high=100.0),
        equation="I' = β (max(y, 0)^0.6 - 0.85 max(-y, 0)^0.6), y = σ through three high "
        "and three low passes at 300 Hz, v ≥ rest, threshold + jump, which fades in 12 ms and "
        "is gone at the turn",
        reason="PC cells are most sensitive between 200 and 300 Hz; a cycle fires once over a "
        "wide range of amplitudes, subthreshold cycles add up, no amplitude drives a cell below "
        "rest, and a cell that misses a cycle fires again soon",
        clamped=True,
        until_turn=True,
        cells=MORE_CELLS,
        whole=True,
        any_step=True,
    ),
)

# Models of the shipped parameters; see ``docs/model_study.md``.
DEFAULT_MODELS: Mapping[str, str] = MappingProxyType(
    {"SA": "fading", "RA": "two_way", "PC": "corpuscle"}
)

MODELS: Mapping[str, Mapping[str, Model]] = MappingProxyType(
    {
        name: MappingProxyType({row.afferent: row for row in _ROWS if row.name == name})
        for name in dict.fromkeys(row.name for row in _ROWS)
    }
)


def model_named(name: str, afferent: str) -> Model:
    """Row of `MODELS` for a name and class.

    Raises
    ------
    ParameterError
        Unknown name, or no row for this class.
    """
    if name not in MODELS:
        raise ParameterError(f"model {name!r}, expected one of {', '.join(MODELS)}")
    if afferent not in MODELS[name]:
        names = ", ".join(n for n, rows in MODELS.items() if afferent in rows)
        raise ParameterError(f"no model {name!r} for {afferent}, expected one of {names}")
    return MODELS[name][afferent]


def model_of(parameters: AfferentParameters) -> Model:
    """Row of `MODELS` whose equation `parameters` belong to."""
    return model_named(parameters.drive, parameters.afferent)
