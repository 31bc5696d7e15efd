"""All models of an afferent in one table: equation, free parameters, reason.

`MODELS` has a row for each name and class. ``published`` is the paper's; the others
are this project's, each made to answer one question about it, and compared with it on
the same data in ``docs/model_study.md``. Beside that every model may have more than one
cell (``cells``, ``spread``) and an adaptive threshold (``jump_mv``, ``recovery_ms``).

A current is ``I' = (R_m / τ_m) I`` in mV/ms, so that ``alpha_mv_per_ms`` is the α′ of
Table 2 and neither R_m nor the milliamperes of α are needed. A saturating share is that
of current (4), (5) and (6) of the paper.
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
    corpuscle_reach,
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

# Cells of `rising`, whose rates are means over a population: a recorded mean has steps of a
# fifth of an impulse, as far as cells fire equally.
CELLS = 5

# Those of the shipped models: cells of one step at 300 Hz are 30 impulses/s apart, not 60,
# and a fit does not place its few steps on the few frequencies that it sees.
MORE_CELLS = 10

# Thresholds minus rest of section 2.2 in mV, on which the steps of stress count.
_SA_GAP_MV, _RA_GAP_MV = 15.0, 10.0


# Filtered stress of stress, the time between two samples in ms, and a scheme of σ′.
Filter: TypeAlias = Callable[[FloatArray, float, str], FloatArray]
# Filters with a memory that has no end.
RECURSIVE: Mapping[Filter, Callable[[FloatArray, float, str, Past], FloatArray]] = {
    slow_rate: slow_rate,
    faded: faded,
}
# How many samples around one a filter may see, but for `corpuscle` and recursions.
_SAMPLES_AROUND = 64
Values: TypeAlias = Mapping[str, ArrayLike]


@dataclass(frozen=True, slots=True, eq=False)
class Coefficients:
    """Of a current ``alpha × Σ share``, one share a filter.

    With `halves` a share saturates, ``x / (half + x)``; with `weights` it is linear,
    ``weight × x``; just one of both is given. Entries are numbers or arrays.
    `degree` is the power of the stress that linear filters grow with.
    """

    alpha_mv_per_ms: ArrayLike
    halves: tuple[ArrayLike, ...] | None = None
    weights: tuple[ArrayLike, ...] | None = None
    degree: float = 1.0

    def for_need(self, need: ArrayLike) -> "Coefficients":
        """Those of a cell that needs `need` times the stress for the same current."""
        if self.halves is not None:
            return replace(self, halves=tuple(np.multiply(half, need) for half in self.halves))
        alpha = np.divide(self.alpha_mv_per_ms, np.power(need, self.degree))
        return replace(self, alpha_mv_per_ms=alpha)

    def backwards(self, share: ArrayLike) -> "Coefficients":
        """Those of a membrane that integrates falls, `share` times as sensitive to them."""
        return replace(self, alpha_mv_per_ms=-np.multiply(self.alpha_mv_per_ms, share))

    def current(self, filtered: Sequence[FloatArray]) -> FloatArray:
        """Current in mV/ms of filtered stress; entries broadcast to it."""
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
    """A parameter that a fit searches, evenly in its logarithm, from `low` to `high`.

    `even` ones are searched evenly in themselves.
    """

    field: str
    low: float
    high: float
    unit: str
    even: bool = False


# How far each parameter is searched; the paper does not state its bounds.
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
HELD = Free("held_pa", 1e3, 1e6, "Pa")
RETRACTION = Free("retraction", 0.4, 1.0, "1", even=True)


@dataclass(frozen=True, slots=True)
class Model:
    """One model of one class: what it filters, how that becomes current, and why.

    `clamped` membranes do not fall below rest. With `two_way` a cell has a second membrane
    that integrates falls, and a spike of either is a spike of the cell. What a spike adds to
    the threshold `fades`; with `until_turn` all of it is lost as soon as the current drives the
    potential below rest. `any_step` equations have no time step in them: their parameters hold
    at any.

    `equation` is kept beside fitted parameters, and those with another one are refused:
    when a constant changes, so does its text. `quantity` is the stress that it reads:
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
    tau: Free | None = TAU
    spread: Free = SPREAD

    def filtered(
        self,
        stress_pa: FloatArray,
        dt_ms: float,
        derivative: str,
        pasts: Sequence[Past] | None = None,
    ) -> tuple[FloatArray, ...]:
        """Stress after each filter, of the shape of `stress_pa`.

        Of a part of a trace, with samples around it, `pasts` are those of its filters.
        """
        if pasts is None:
            return tuple(each(stress_pa, dt_ms, derivative) for each in self.filters)
        return tuple(
            RECURSIVE[each](stress_pa, dt_ms, derivative, past)
            if each in RECURSIVE
            else each(stress_pa, dt_ms, derivative)
            for each, past in zip(self.filters, pasts, strict=True)
        )

    def samples_around(self, dt_ms: float) -> int:
        """How many samples before and after one count for its filters there, recursions aside."""
        longest = corpuscle_reach(dt_ms) if corpuscle in self.filters else 0
        return max(_SAMPLES_AROUND, longest)

    def ways(self, values: Values) -> tuple[Coefficients, ...]:
        """Coefficients of each membrane of a cell: a two-way one has a second, of falls."""
        rises = self.coefficients(values)
        return (rises, rises.backwards(values["retraction"])) if self.two_way else (rises,)

    def membrane(self, values: Values, dt_ms: float) -> Membrane:
        """Constants of the membranes of `values`, parameters by name, at a time step."""
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
        """What a fit of so many cells searches; by default the model's own number."""
        own = (self.tau, *self.own_free) if self.tau else self.own_free
        if self.adaptive:
            own = (*own, JUMP, RECOVERY)
        return (*own, self.spread) if (cells or self.cells) > 1 else own


def _saturating(*halves: str) -> Callable[[Values], Coefficients]:
    return lambda values: Coefficients(
        values["alpha_mv_per_ms"], halves=tuple(values[name] for name in halves)
    )


def _rising_sa(values: Values) -> Coefficients:
    held = np.multiply(values["held_pa"], values["tau_ms"])
    return Coefficients(
        _SA_GAP_MV, weights=(np.divide(1.0, values["step_pa"]), np.divide(1.0, held))
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
            reason="does strain energy density, held to drive SA, explain more than von Mises "
            "stress? σ is the uniaxial stress of equal strain energy, √(2EW)",
        )
        for model in _PUBLISHED
    ),
    *(
        replace(
            model,
            name="adaptive",
            adaptive=True,
            reason="does a threshold that each spike raises, as afferents show, flatten "
            "the rates at high frequencies?",
        )
        for model in _PUBLISHED
    ),
    Model(
        name="rising",
        afferent="SA",
        parameters=RisingSaParameters,
        filters=(stress_rate, lambda stress, *_: stress),
        coefficients=_rising_sa,
        own_free=(STEP, HELD),
        equation="I' = gap (σ'/step + σ/(held τ)), v ≥ rest",
        reason="observed impulses a cycle go with the amplitude, hardly with the "
        "frequency: each rise of stress by a step fires once; stress above a level "
        "fires on",
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
        reason="observed impulses a cycle go with the amplitude, hardly with the "
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
        own_free=(replace(STEP, low=2e4, high=2e5), replace(HELD, low=4e3, high=4e4)),
        tau=replace(TAU, low=10.0, high=100.0),
        spread=replace(SPREAD, high=1.0),
        equation="I' = gap (r/step + max(σ - s/2, 0)/(held τ)), r is σ' through a low pass at "
        "100 Hz, s follows σ in 200 ms, v ≥ rest",
        reason="rising, and as in Merkel cells half of the answer to a held stress fades "
        "within 200 ms: slow adaptation, and fewer spikes at 5 and 10 Hz; fast movement "
        "drives it less",
        clamped=True,
        cells=MORE_CELLS,
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
        "counts steps of stress; further steps of one sweep are four times as large",
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
        reason="PC cells are keenest between 200 and 300 Hz and duller above; a swing fires "
        "once over a wide range of amplitudes, what stays of faint ones adds up, no amplitude "
        "drives a cell below rest, and one that missed its turn is not silent for long",
        clamped=True,
        until_turn=True,
        cells=MORE_CELLS,
        any_step=True,
    ),
)

# The models of the shipped parameters; see ``docs/model_study.md``.
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
    """The row of a name and class.

    Raises
    ------
    ParameterError
        No such name, or none for this class.
    """
    if name not in MODELS:
        raise ParameterError(f"model {name!r}, expected one of {', '.join(MODELS)}")
    if afferent not in MODELS[name]:
        known = ", ".join(n for n, rows in MODELS.items() if afferent in rows)
        raise ParameterError(f"no model {name!r} for {afferent}, expected one of {known}")
    return MODELS[name][afferent]


def model_of(parameters: AfferentParameters) -> Model:
    """The row that `parameters` belong to."""
    return model_named(parameters.drive, parameters.afferent)
