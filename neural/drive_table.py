"""All models of an afferent in one table: equation, free parameters, reason.

`DRIVES` has a row for each name and class. ``published`` is the paper's; the others
are this project's, each made to answer one question about it, and compared with it on
the same data in ``docs/model_study.md``. Beside the drive every model may have more
than one cell (``cells``, ``spread``) and an adaptive threshold (``jump_mv``,
``recovery_ms``).
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from fembridge.errors import ParameterError
from fembridge.typing import FloatArray
from neural.coefficients import Coefficients
from neural.drive import check_scheme, pc_drive, ra_drive, sa_level, sa_rate, stress_rate
from neural.drive_model import A1, A2, A3, A4, A5, ALPHA, BETA, HELD, STEP, Drive, Values
from neural.further_drives import (
    COMPRESSION,
    absolute_rate,
    acceleration_rise,
    rate_rise,
    sharp_rise,
)
from neural.further_parameters import (
    RateRaParameters,
    RisingRaParameters,
    RisingSaParameters,
    SharpPcParameters,
)
from neural.parameters import AfferentParameters, PcParameters, RaParameters, SaParameters

# Cells of the models whose rates are means over a population: a recorded mean has
# steps of a fifth of an impulse, as far as cells fire alike.
CELLS = 5

# Thresholds minus rest of section 2.2 in mV, on which the steps of stress count.
_SA_GAP_MV, _RA_GAP_MV = 15.0, 10.0


def _saturating(*halves: str) -> Callable[[Values], Coefficients]:
    return lambda values: Coefficients(
        values["alpha_mv_per_ms"], halves=tuple(values[name] for name in halves)
    )


def _sa(stress: FloatArray, dt_ms: float, scheme: str) -> tuple[FloatArray, ...]:
    return sa_level(stress), sa_rate(stress, dt_ms, scheme)


def _ra(stress: FloatArray, dt_ms: float, scheme: str) -> tuple[FloatArray, ...]:
    return (ra_drive(stress, dt_ms, scheme),)


def _pc(stress: FloatArray, dt_ms: float, scheme: str) -> tuple[FloatArray, ...]:
    return (pc_drive(stress, dt_ms, scheme),)


def _sharp(stress: FloatArray, dt_ms: float, scheme: str) -> tuple[FloatArray, ...]:
    """Give differences that look back whatever the scheme: they are no derivatives."""
    check_scheme(scheme)
    return (sharp_rise(stress, dt_ms),)


_PUBLISHED = (
    Drive(
        name="published",
        afferent="SA",
        parameters=SaParameters,
        filters=_sa,
        coefficients=_saturating("a1_pa", "a2_pa_per_ms"),
        own_free=(A1, A2, ALPHA),
        equation="I' = α' (x1/(a1 + x1) + x2/(a2 + x2)), x1 = mean |σ|, x2 = mean |σ'|",
        reason="filters (1), (2) and current (4) of the paper",
    ),
    Drive(
        name="published",
        afferent="RA",
        parameters=RaParameters,
        filters=_ra,
        coefficients=_saturating("a3_pa_per_ms"),
        own_free=(A3, ALPHA),
        equation="I' = α' x/(a3 + x), x = |σ'(t) − σ'(t − dt)|",
        reason="filter (3) and current (5) of the paper",
    ),
    Drive(
        name="published",
        afferent="PC",
        parameters=PcParameters,
        filters=_pc,
        coefficients=_saturating("a4_pa_per_ms2"),
        own_free=(A4, ALPHA),
        equation="I' = α' x/(a4 + x), x = |σ″(t) − σ″(t − dt)|",
        reason="filter (4) and current (6) of the paper",
    ),
)


def _with(drives: tuple[Drive, ...], **changes: object) -> tuple[Drive, ...]:
    from dataclasses import replace

    return tuple(replace(drive, **changes) for drive in drives)  # type: ignore[arg-type]


_ROWS = (
    *_PUBLISHED,
    *_with(
        _PUBLISHED,
        name="energy",
        quantity="energy",
        reason="does strain energy density, held to drive SA, tell more than von Mises "
        "stress? σ is the uniaxial stress of equal strain energy, √(2EW)",
    ),
    *_with(
        _PUBLISHED,
        name="adaptive",
        adaptive=True,
        reason="does a threshold that each spike raises, as afferents show, flatten "
        "the rates at high frequencies?",
    ),
    Drive(
        name="rate",
        afferent="RA",
        parameters=RateRaParameters,
        filters=lambda stress, dt_ms, scheme: (
            ra_drive(stress, dt_ms, scheme),
            absolute_rate(stress, dt_ms, scheme),
        ),
        coefficients=_saturating("a3_pa_per_ms", "a5_pa_per_ms"),
        own_free=(A3, A5, ALPHA),
        equation="I' = α' (x1/(a3 + x1) + x2/(a5 + x2)), x1 as published, x2 = |σ'|",
        reason="filter (3) grows with the square of the frequency and overrates "
        "300 Hz; |σ'| grows with the frequency alone",
    ),
    Drive(
        name="one_sided",
        afferent="RA",
        parameters=RaParameters,
        filters=lambda stress, dt_ms, scheme: (rate_rise(stress, dt_ms, scheme),),
        coefficients=_saturating("a3_pa_per_ms"),
        own_free=(A3, ALPHA),
        equation="I' = α' x/(a3 + x), x = max(σ'(t) − σ'(t − dt), 0)",
        reason="a cell that fires on one phase of a cycle locks one to one",
    ),
    Drive(
        name="one_sided",
        afferent="PC",
        parameters=PcParameters,
        filters=lambda stress, dt_ms, scheme: (acceleration_rise(stress, dt_ms, scheme),),
        coefficients=_saturating("a4_pa_per_ms2"),
        own_free=(A4, ALPHA),
        equation="I' = α' x/(a4 + x), x = max(σ″(t) − σ″(t − dt), 0)",
        reason="a cell that fires on one phase of a cycle locks one to one",
    ),
    Drive(
        name="rising",
        afferent="SA",
        parameters=RisingSaParameters,
        filters=lambda stress, dt_ms, scheme: (
            stress_rate(stress, dt_ms, scheme),
            np.asarray(stress),
        ),
        coefficients=lambda values: Coefficients(
            _SA_GAP_MV,
            weights=(
                np.divide(1.0, values["step_pa"]),
                np.divide(1.0, np.multiply(values["held_pa"], values["tau_ms"])),
            ),
        ),
        own_free=(STEP, HELD),
        equation="I' = gap (σ'/step + σ/(held τ)), v ≥ rest",
        reason="observed impulses a cycle go with the amplitude, hardly with the "
        "frequency: each rise of stress by a step fires once; stress above a level "
        "fires on",
        floored=True,
        cells=CELLS,
    ),
    Drive(
        name="rising",
        afferent="RA",
        parameters=RisingRaParameters,
        filters=lambda stress, dt_ms, scheme: (stress_rate(stress, dt_ms, scheme),),
        coefficients=lambda values: Coefficients(
            _RA_GAP_MV, weights=(np.divide(1.0, values["step_pa"]),)
        ),
        own_free=(STEP,),
        equation="I' = gap σ'/step, v ≥ rest",
        reason="observed impulses a cycle go with the amplitude, hardly with the "
        "frequency: each rise of stress by a step fires once",
        floored=True,
        cells=CELLS,
    ),
    Drive(
        name="sharp",
        afferent="PC",
        parameters=SharpPcParameters,
        filters=_sharp,
        coefficients=lambda values: Coefficients(
            values["beta_mv_per_ms"], weights=(1.0,), degree=COMPRESSION
        ),
        own_free=(BETA,),
        equation="I' = β max(Δ³σ, 0)^(1/3), Δσ = σ(t) − σ(t − 1 ms)",
        reason="filter (4) grows without end up to 1000 Hz, PC cells are keenest near "
        "250 Hz; their rates span amplitudes of 1 to 1000 by compression",
        cells=CELLS,
    ),
)

# The drives of the shipped parameters; see ``docs/model_study.md``.
DEFAULT_DRIVES: Mapping[str, str] = MappingProxyType(
    {"SA": "rising", "RA": "rising", "PC": "sharp"}
)

DRIVES: Mapping[str, Mapping[str, Drive]] = MappingProxyType(
    {
        name: MappingProxyType({row.afferent: row for row in _ROWS if row.name == name})
        for name in dict.fromkeys(row.name for row in _ROWS)
    }
)


def drive_named(name: str, afferent: str) -> Drive:
    """Give the row of a name and class.

    Raises
    ------
    ParameterError
        No such name, or none for this class.
    """
    if name not in DRIVES:
        raise ParameterError(f"drive {name!r}, expected one of {', '.join(DRIVES)}")
    if afferent not in DRIVES[name]:
        known = ", ".join(n for n, rows in DRIVES.items() if afferent in rows)
        raise ParameterError(
            f"no drive {name!r} for {afferent}, expected one of {known}"
            if known
            else f"afferent {afferent!r}, expected SA, RA or PC"
        )
    return DRIVES[name][afferent]


def drive_of(parameters: AfferentParameters) -> Drive:
    """Give the row that `parameters` belong to."""
    return drive_named(parameters.drive, parameters.afferent)
