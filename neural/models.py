"""All models of an afferent in one table: equation, free parameters, reason.

`MODELS` has one model per name and class. ``published`` is the paper's; the others are this
project's, each made to answer one question about it. ``docs/science/model_study.md`` compares all
on the same data. Every model may have several cells (``cells``, ``spread``) and an adaptive
threshold (``jump_mv``, ``recovery_ms``).

A current is ``I' = (R_m / τ_m) I`` in mV/ms, so that ``alpha_mv_per_ms`` is the α′ of
Table 2 and neither R_m nor α in milliamperes is needed. Currents (4), (5) and (6) of the
paper have saturating terms.
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
    Past,
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
    DT_MS,
    FINE_DT_MS,
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

# Number of cells of `rising`, whose rates are means over a population.
CELLS = 5

# Number of cells of the shipped models. One more firing cell at 300 Hz raises the mean rate by 30
# impulses/s, not by 60, so that a fit cannot adapt single cells to single frequencies.
MORE_CELLS = 10

# Threshold minus rest in mV, section 2.2: a rise of stress by one step raises the potential by it.
_SA_GAP_MV, _RA_GAP_MV = 15.0, 10.0


# Function of stress, time step in ms and scheme of σ′ that returns filtered stress.
Filter: TypeAlias = Callable[[FloatArray, float, str], FloatArray]
# Filters with an infinite impulse response.
RECURSIVE: Mapping[Filter, Callable[[FloatArray, float, str, Past], FloatArray]] = {
    slow_rate: slow_rate,
    faded: faded,
    corpuscle: corpuscle,
}
# Number of samples before and after one that a filter may read, except recursions.
SAMPLES_AROUND = 64
Values: TypeAlias = Mapping[str, ArrayLike]


@dataclass(frozen=True, slots=True, eq=False)
class Coefficients:
    """Coefficients of a current ``alpha × Σ term`` with one term per filter output x.

    With `halves` a term saturates, ``x / (half + x)``; with `weights` it is linear,
    ``weight × x``; exactly one of the two is set. Entries are numbers or arrays.
    `degree` is the power of the stress to which outputs of linear filters are proportional.
    """

    alpha_mv_per_ms: ArrayLike
    halves: tuple[ArrayLike, ...] | None = None
    weights: tuple[ArrayLike, ...] | None = None
    degree: float = 1.0

    def scaled_for_cell(self, stress_factor: ArrayLike) -> "Coefficients":
        """Those of a cell that needs `need` times the stress for the same current."""
        if self.halves is not None:
            return replace(
                self, halves=tuple(np.multiply(half, stress_factor) for half in self.halves)
            )
        alpha = np.divide(self.alpha_mv_per_ms, np.power(stress_factor, self.degree))
        return replace(self, alpha_mv_per_ms=alpha)

    def for_retraction(self, share: ArrayLike) -> "Coefficients":
        """Coefficients of a membrane for falls of stress, with `share` of the sensitivity."""
        return replace(self, alpha_mv_per_ms=-np.multiply(self.alpha_mv_per_ms, share))

    def current(self, filtered: Sequence[FloatArray]) -> FloatArray:
        """Current in mV/ms from filtered stress; coefficients broadcast to its shape."""
        if self.halves is None:
            parts = [gain * x for x, gain in zip(filtered, self.gains(), strict=True)]
            return np.asarray(sum(parts[1:], parts[0]))
        sizes = [np.abs(x) for x in filtered]
        shares = [np.divide(x, half + x) for x, half in zip(sizes, self.halves, strict=True)]
        return np.asarray(np.multiply(self.alpha_mv_per_ms, sum(shares[1:], shares[0])))

    def gains(self) -> tuple[FloatArray, ...]:
        """``alpha × weight`` of each linear term."""
        return tuple(np.multiply(self.alpha_mv_per_ms, weight) for weight in self.weights or ())


@dataclass(frozen=True, slots=True)
class Free:
    """Free parameter of a fit: its range `low` to `high` in `unit`.

    The search is even in the logarithm of the parameter, or, with `even`, in the parameter.
    """

    field: str
    low: float
    high: float
    unit: str
    even: bool = False


# Range of each parameter in the search; the paper does not state its ranges.
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
SUSTAINED = Free("held_pa", 1e3, 1e6, "Pa")
RETRACTION = Free("retraction", 0.4, 1.0, "1", even=True)


@dataclass(frozen=True, slots=True)
class AfferentModel:
    """Model of one class: filters, coefficients of the current, and the reason for the model.

    `clamped` membranes do not fall below rest. With `two_way` a cell has a second membrane
    for falls of stress, and a spike of either is a spike of the cell. With `until_turn` the rise
    of the threshold after a spike ends as soon as the current drives the potential below rest.
    With `any_step` the equation does not contain the time step, and
    its parameters are valid at any.

    `equation` is stored with fitted parameters, and parameters with another equation are
    refused: its text changes with every constant. `quantity` is the stress that the model
    reads: ``von_mises``, or ``energy``, the uniaxial stress of equal strain energy.
    """

    name: str
    afferent: str
    parameters: type[AfferentParameters]
    filters: tuple[Filter, ...]
    coefficients: Callable[[Values], Coefficients]
    coefficients_free: tuple[Free, ...]
    equation: str
    reason: str
    clamped: bool = False
    quantity: str = "von_mises"
    adaptive: bool = False
    cells: int = 1
    two_way: bool = False
    until_turn: bool = False
    any_step: bool = False
    tau: Free | None = TAU
    spread: Free = SPREAD

    @property
    def is_signed(self) -> bool:
        """Whether units of both signs exist: the drive of a PC model has a sign, of others not."""
        return corpuscle in self.filters

    @property
    def step_ms(self) -> float:
        """Time step of a fit, in ms."""
        return FINE_DT_MS if self.any_step else DT_MS

    def filtered(
        self,
        stress_pa: FloatArray,
        dt_ms: float,
        derivative: str,
        pasts: Sequence[Past] | None = None,
    ) -> tuple[FloatArray, ...]:
        """Output of each filter, with the shape of `stress_pa`.

        For a part of a trace, with samples around it, `pasts` are the states of the filters.
        """
        if pasts is None:
            return tuple(filter_(stress_pa, dt_ms, derivative) for filter_ in self.filters)
        return tuple(
            RECURSIVE[filter_](stress_pa, dt_ms, derivative, past)
            if filter_ in RECURSIVE
            else filter_(stress_pa, dt_ms, derivative)
            for filter_, past in zip(self.filters, pasts, strict=True)
        )

    def membrane_coefficients(self, values: Values) -> tuple[Coefficients, ...]:
        """Coefficients of each membrane of a cell; a two-way cell has a second, for falls."""
        rises = self.coefficients(values)
        return (rises, rises.for_retraction(values["retraction"])) if self.two_way else (rises,)

    def membrane(self, values: Values, dt_ms: float) -> Membrane:
        """Membrane constants from `values`, parameters by name, at the time step `dt_ms`."""
        return Membrane.from_times(
            dt_ms,
            tau_ms=values["tau_ms"],
            gap_mv=np.subtract(values["threshold_mv"], values["rest_mv"]),
            refractory_ms=values["refractory_ms"],
            clamped=self.clamped,
            jump_mv=values["jump_mv"],
            recovery_ms=values["recovery_ms"],
            until_turn=self.until_turn,
            fatigue_mv=values.get("fatigue_mv", 0.0),
            fatigue_ms=values.get("fatigue_ms", math.inf),
        )

    def free(self, cells: int | None = None) -> tuple[Free, ...]:
        """Free parameters of a fit with `cells` cells (default: the number of the model)."""
        free = (self.tau, *self.coefficients_free) if self.tau else self.coefficients_free
        if self.adaptive:
            free = (*free, JUMP, RECOVERY)
        return (*free, self.spread) if (cells or self.cells) > 1 else free


def _saturating(*halves: str) -> Callable[[Values], Coefficients]:
    return lambda values: Coefficients(
        values["alpha_mv_per_ms"], halves=tuple(values[name] for name in halves)
    )


def _rising_sa(values: Values) -> Coefficients:
    sustained = np.multiply(values["held_pa"], values["tau_ms"])
    return Coefficients(
        _SA_GAP_MV, weights=(np.divide(1.0, values["step_pa"]), np.divide(1.0, sustained))
    )


def _rising_ra(values: Values) -> Coefficients:
    return Coefficients(_RA_GAP_MV, weights=(np.divide(1.0, values["step_pa"]),))


def level(stress_pa: FloatArray, *_: object) -> FloatArray:
    """The stress itself, as a `Filter`."""
    return stress_pa


def averaged_level(stress_pa: FloatArray, *_: object) -> FloatArray:
    """`sa_level` as a `Filter`."""
    return sa_level(stress_pa)


_PUBLISHED = (
    AfferentModel(
        name="published",
        afferent="SA",
        parameters=SaParameters,
        filters=(averaged_level, sa_rate),
        coefficients=_saturating("a1_pa", "a2_pa_per_ms"),
        coefficients_free=(A1, A2, ALPHA),
        equation="I' = α' (x1/(a1 + x1) + x2/(a2 + x2)), x1 = mean |σ|, x2 = mean |σ'|",
        reason="filters (1), (2) and current (4) of the paper",
    ),
    AfferentModel(
        name="published",
        afferent="RA",
        parameters=RaParameters,
        filters=(rate_change,),
        coefficients=_saturating("a3_pa_per_ms"),
        coefficients_free=(A3, ALPHA),
        equation="I' = α' x/(a3 + x), x = |σ'(t) − σ'(t − dt)|",
        reason="filter (3) and current (5) of the paper",
    ),
    AfferentModel(
        name="published",
        afferent="PC",
        parameters=PcParameters,
        filters=(acceleration_change,),
        coefficients=_saturating("a4_pa_per_ms2"),
        coefficients_free=(A4, ALPHA),
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
            reason="does strain energy density, a proposed drive of SA, explain more than von "
            "Mises stress? σ is the uniaxial stress of equal strain energy, √(2EW)",
        )
        for model in _PUBLISHED
    ),
    *(
        replace(
            model,
            name="adaptive",
            adaptive=True,
            reason="does a threshold that each spike raises, as in afferents, reduce "
            "the rates at high frequencies?",
        )
        for model in _PUBLISHED
    ),
    AfferentModel(
        name="rising",
        afferent="SA",
        parameters=RisingSaParameters,
        filters=(stress_rate, level),
        coefficients=_rising_sa,
        coefficients_free=(STEP, SUSTAINED),
        equation="I' = gap (σ'/step + σ/(held τ)), v ≥ rest",
        reason="observed impulses per cycle depend on the amplitude, hardly on the "
        "frequency: each rise of stress by a step fires one spike; sustained stress above a "
        "level fires repeatedly",
        clamped=True,
        cells=CELLS,
        any_step=True,
    ),
    AfferentModel(
        name="rising",
        afferent="RA",
        parameters=RisingRaParameters,
        filters=(stress_rate,),
        coefficients=_rising_ra,
        coefficients_free=(STEP,),
        equation="I' = gap σ'/step, v ≥ rest",
        reason="observed impulses per cycle depend on the amplitude, hardly on the "
        "frequency: each rise of stress by a step fires one spike",
        clamped=True,
        cells=CELLS,
        any_step=True,
    ),
    AfferentModel(
        name="fading",
        afferent="SA",
        parameters=FadingSaParameters,
        filters=(slow_rate, faded),
        coefficients=_rising_sa,
        coefficients_free=(replace(STEP, low=2e4, high=2e5), replace(SUSTAINED, low=4e3, high=4e4)),
        tau=replace(TAU, low=10.0, high=100.0),
        spread=replace(SPREAD, high=1.0),
        equation="I' = gap (r/step + max(σ - 0.8 s - 0.04 u, 0)/(held τ)), r is σ' through a low "
        "pass at 100 Hz, s follows σ in 200 ms and u in 5 s, v ≥ rest",
        reason="as rising; the response to sustained stress fades, as in Merkel cells, to a "
        "third within a second and slowly for seconds; fast movement has less effect",
        clamped=True,
        cells=MORE_CELLS,
        any_step=True,
    ),
    AfferentModel(
        name="two_way",
        afferent="RA",
        parameters=TwoWayRaParameters,
        filters=(stress_rate,),
        coefficients=_rising_ra,
        coefficients_free=(replace(STEP, high=1e5), RETRACTION),
        tau=None,
        spread=replace(SPREAD, high=1.5),
        equation="I' = gap σ'/step and -retraction gap σ'/step, a membrane each, v ≥ rest, "
        "threshold + jump, which fades in 8 ms and is gone at the turn, + fatigue, set to 15 mV by "
        "a spike, which fades in 100 ms",
        reason="RA fires at indentation and at retraction: a membrane for each counts steps of "
        "stress; further steps of one sweep are larger the sooner they come, so that slow ramps "
        "evoke more spikes; after a spike the next sweep needs more stress, the sooner it comes, "
        "so that weak vibrations evoke a spike in some of their cycles",
        clamped=True,
        cells=MORE_CELLS,
        two_way=True,
        until_turn=True,
        any_step=True,
    ),
    AfferentModel(
        name="corpuscle",
        afferent="PC",
        parameters=CorpusclePcParameters,
        filters=(corpuscle,),
        coefficients=lambda values: Coefficients(
            values["beta_mv_per_ms"], weights=(1.0,), degree=CORPUSCLE_POWER
        ),
        coefficients_free=(replace(BETA, low=0.3),),
        tau=replace(TAU, high=100.0),
        equation="I' = β (max(y, 0)^0.5 - 0.5 max(-y, 0)^0.5), y = σ through three high passes at "
        "500 Hz and two low passes at 135 Hz, v ≥ rest, threshold + jump, which fades in 9 ms and "
        "is gone at the turn",
        reason="PC cells are most sensitive between 200 and 300 Hz; a swing fires one spike "
        "over a wide range of amplitudes, weak swings add up, no amplitude drives a cell below "
        "rest, and a cell that missed a swing fires again soon",
        clamped=True,
        until_turn=True,
        cells=MORE_CELLS,
        any_step=True,
    ),
)

# The models of the shipped parameters; see ``docs/science/model_study.md``.
DEFAULT_MODELS: Mapping[str, str] = MappingProxyType(
    {"SA": "fading", "RA": "two_way", "PC": "corpuscle"}
)

MODELS: Mapping[str, Mapping[str, AfferentModel]] = MappingProxyType(
    {
        name: MappingProxyType({row.afferent: row for row in _ROWS if row.name == name})
        for name in dict.fromkeys(row.name for row in _ROWS)
    }
)


def model_named(name: str, afferent: str) -> AfferentModel:
    """Model of a name and a class.

    Raises
    ------
    ParameterError
        No model of this name, or none for this class.
    """
    if name not in MODELS:
        raise ParameterError(argument="drive", found=name, expected=f"one of {', '.join(MODELS)}")
    if afferent not in MODELS[name]:
        available = ", ".join(n for n, rows in MODELS.items() if afferent in rows)
        raise ParameterError(
            argument="drive", found=name, expected=f"one of {available} for {afferent}"
        )
    return MODELS[name][afferent]


def model_of(parameters: AfferentParameters) -> AfferentModel:
    """Model that `parameters` belong to."""
    return model_named(parameters.drive, parameters.afferent)
