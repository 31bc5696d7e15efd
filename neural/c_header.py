"""C99 header of the encoder: `init` and `step` for each class, with parameters baked in.

Each line of the C code computes what `neural.filters`, `neural.models` and `neural.lif` compute,
in the same order, so that in double precision every spike is that of `neural.encode_afferents`
(with ``-ffp-contract=off``: a fused product and sum rounds once instead of twice). The code
allocates nothing and calls nothing but the square root of the compiler.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import exp, pi
from textwrap import indent
from typing import TypeAlias

import numpy as np

from fembridge.errors import ParameterError, UsageError
from neural import filters
from neural.filters import M1, M2, M3, M4
from neural.models import Coefficients, Filter, averaged_level, level, model_of
from neural.parameter_sets import ParameterSet, parameter_set
from neural.parameters import AfferentParameters, finest_step_ms, quantiles
from neural.time_step import AFTER, interpolation_weights, step_ratio

PRECISIONS = ("double", "float")

_Number: TypeAlias = Callable[[float], str]


@dataclass(frozen=True, slots=True)
class _Code:
    """C code of a filter: constants, fields of the state, and lines that set ``x[N]``.

    The lines read ``stress`` and ``state->seen``, the number of earlier samples, at most 255;
    `ahead` is the number of later samples that the output needs.
    """

    lines: str
    state: str
    ahead: int = 0


def export_c(
    parameters: str | ParameterSet = "fitted",
    *,
    precision: str = "double",
    sensor_ms: float | None = None,
    afferents: str | Sequence[str] | None = None,
) -> str:
    """C99 header that turns stress into spikes, sample by sample.

    The header has ``afferents_sa_init``, ``afferents_sa_step`` and the same of RA and PC,
    and ``afferents_init`` and ``afferents_step`` of all classes; its first comment says how
    to call them. It needs neither memory allocation nor a library.

    Parameters
    ----------
    parameters
        Parameter set: ``"fitted"``, ``"published"``, another shipped name, the path of a TOML
        file, or a `ParameterSet`. Default: ``"fitted"``.
    precision
        ``"double"``: the spikes of Python. ``"float"``: for processors without double
        precision; spikes may differ where rounding decides. Default: ``"double"``.
    sensor_ms
        Time between two calls of ``step`` in ms. A coarser sensor is interpolated as
        `neural.encode` does, with three samples of delay; of a finer one every n-th sample is
        read. Default: None, the step of the parameters.
    afferents
        Class or classes. Default: None, all.

    Returns
    -------
    str
        Text of the header.

    Raises
    ------
    UsageError
        An unknown precision or class, or neither the name of a set nor a file.
    ParameterError
        A `sensor_ms` that is neither a multiple nor a divisor of the step of the parameters, or
        coarser than the step of parameters whose equation contains it.

    Examples
    --------
    >>> import fembridge as fb
    >>> header = fb.export_c("fitted", sensor_ms=1.0)
    >>> "int afferents_step(" in header
    True
    """
    if precision not in PRECISIONS:
        raise UsageError(argument="precision", found=precision, expected=" or ".join(PRECISIONS))
    chosen = parameter_set(parameters)
    available = chosen.parameters
    names = [afferents] if isinstance(afferents, str) else list(afferents or available)
    for name in names:
        if name not in available:
            raise UsageError(
                argument="afferents", found=name, expected=f"one of {', '.join(available)}"
            )
    classes = {name: available[name] for name in available if name in names}
    step_ms = finest_step_ms(classes) if sensor_ms is None else float(sensor_ms)
    number = _double if precision == "double" else _single
    try:
        parts = [_class_code(values, step_ms, precision, number) for values in classes.values()]
    except ParameterError as error:
        if error.argument == "dt_ms":
            error.argument = "sensor_ms"
        raise
    lower = [name.lower() for name in classes]
    steps = [
        f"spikes += afferents_{name}_step(&state->{name}, stress_pa[{index}], fired);\n"
        f"fired += AFFERENTS_{name.upper()}_STEPS * AFFERENTS_{name.upper()}_CELLS;"
        for index, name in enumerate(lower)
    ]
    rooms = [f"AFFERENTS_{name}_STEPS * AFFERENTS_{name}_CELLS" for name in classes]
    return _filled(
        _HEADER,
        SET=_ascii(chosen.name),
        REAL=precision,
        SUFFIX="f" if precision == "float" else "",
        SENSOR=repr(step_ms),
        CODE="\n".join(parts),
        COUNT=str(len(classes)),
        ORDER=", ".join(classes),
        ROOM=" + ".join(rooms),
        FIELDS=_lines(f"afferents_{name} {name};" for name in lower),
        INITS=_lines(f"afferents_{name}_init(&state->{name});" for name in lower),
        STEPS=_lines(steps).rpartition("\n")[0],
    )


def _double(value: float) -> str:
    return repr(float(value))


def _single(value: float) -> str:
    return f"{np.format_float_scientific(np.float32(value), trim='0')}f"


def _ascii(text: str) -> str:
    """`text` as a comment of C takes it."""
    spelled = {"σ": "sigma", "τ": "tau", "α": "alpha", "β": "beta", "≥": ">=", "−": "-"}
    spelled |= {"′": "'", "″": "''"}
    for sign, word in spelled.items():
        text = text.replace(sign, word)
    return text.encode("ascii", "replace").decode().replace("*/", "* /")


def _lines(lines: Iterable[str], levels: int = 1) -> str:
    """Lines of C, those that are not empty, indented."""
    return indent("\n".join(filter(None, lines)), "    " * levels)


def _filled(template: str, **texts: str) -> str:
    for key, text in texts.items():
        template = template.replace(f"@{key}@", text)
    return template


def _class_code(
    values: AfferentParameters, sensor_ms: float, precision: str, number: _Number
) -> str:
    """C code of one class."""
    model, dt_ms = model_of(values), values.dt_ms
    finer, coarser = step_ratio(values, sensor_ms)
    codes = [
        _FILTERS[filter_](index, dt_ms, number, precision == "float")
        for index, filter_ in enumerate(model.filters)
    ]
    ahead = max(code.ahead for code in codes)
    membrane = model.membrane(values.by_name(), dt_ms)
    coefficients = [
        part.scaled_for_cell(factor)
        for part in model.membrane_coefficients(values.by_name())
        for factor in np.exp(values.spread * quantiles(values.cells))
    ]
    tables, current = _current_code(coefficients, number)
    adapts, tires = bool(np.any(membrane.jump)), bool(np.any(membrane.fatigue))
    rests = bool(np.any(membrane.refractory))
    rises = " + state->raised[m]" * adapts + " + state->tired[m]" * tires
    constants: dict[str, object] = {"LEAK": membrane.decay, "GAP": membrane.threshold}
    if adapts:
        constants |= {"JUMP": membrane.jump, "JUMP_KEPT": membrane.decay_of_jump}
    if tires:
        constants |= {"FATIGUE": membrane.fatigue, "FATIGUE_KEPT": membrane.decay_of_fatigue}
    size = len(coefficients)
    fields = [
        f"afferents_real potential[{size}];",
        f"afferents_real raised[{size}];" * adapts,
        f"afferents_real tired[{size}];" * tires,
        f"unsigned long wait[{size}];" * rests,
        f"afferents_real x[{len(codes)}];",
        *(code.state for code in codes),
        "afferents_real coarse[6];" * (finer > 1),
        "unsigned char samples;" * (finer > 1),
        "unsigned long phase;" * (coarser > 1),
        "unsigned char seen;",
    ]
    fire = [
        "v = state->potential[m] * LEAK + current;",
        "if (state->wait[m]) { v = 0; state->wait[m]--; }" * rests,
        "if (v < 0) state->raised[m] = 0;" * (model.until_turn and adapts),
        "if (v < 0) v = 0;" * model.clamped,
        "state->raised[m] *= JUMP_KEPT;" * adapts,
        "state->tired[m] *= FATIGUE_KEPT;" * tires,
        f"if (v > GAP{rises}) {{",
        "    v = 0;",
        "    state->raised[m] += JUMP;" * adapts,
        "    state->tired[m] = FATIGUE;" * tires,
        f"    state->wait[m] = {int(np.asarray(membrane.refractory))};" * rests,
        f"    fired[m % {values.cells}]++;",
        "    spikes++;",
        "}",
        "state->potential[m] = v;",
    ]
    if finer > 1:
        weights = [
            f"    {{{', '.join(map(number, row))}}},"
            for row in interpolation_weights(finer).tolist()
        ]
        advance = _filled(_INTERPOLATE, WEIGHTS="\n".join(weights), FINER=str(finer))
        delay = AFTER
    elif ahead:
        advance = f"@FILTER@;\nif (state->seen > {ahead}) spikes = @FIRE@;"
        delay = ahead * coarser
    else:  # a current waits for the sample at which its spikes are
        advance = "if (state->seen) spikes = @FIRE@;\n@FILTER@;"
        delay = coarser
    if coarser > 1:
        count = f"state->phase = state->phase % {coarser} + 1;"
        advance = f"{count}\nif (state->phase != 1) return 0;\n{advance}"
    advance = _filled(
        advance,
        FILTER="afferents_@LOWER@_filter(state, stress_pa)",
        FIRE="afferents_@LOWER@_fire(state, fired)",
    )
    return _filled(
        _CLASS,
        ADVANCE=_lines([advance]),
        EQUATION=_ascii(model.equation),
        DELAY=str(delay),
        CLASS_STEPS=str(finer),
        STEP=repr(dt_ms),
        CELLS=str(values.cells),
        STATE=_lines(fields),
        FILTER_LINES=_lines(code.lines for code in codes),
        TABLES=_lines(tables),
        CONSTANTS=_lines(
            f"const afferents_real {name} = {number(float(np.asarray(value)))};"
            for name, value in constants.items()
        ),
        CURRENT=current,
        FIRE_LINES=_lines(fire, 2),
        MEMBRANES=str(size),
        UPPER=values.afferent,
        LOWER=values.afferent.lower(),
    )


def _current_code(coefficients: Sequence[Coefficients], number: _Number) -> tuple[list[str], str]:
    """Tables of the coefficients of each membrane, and the current of membrane ``m``."""
    if coefficients[0].halves is None:
        rows = [[float(np.asarray(gain)) for gain in part.gains()] for part in coefficients]
        terms = [f"GAIN{term}[m] * state->x[{term}]" for term in range(len(rows[0]))]
        names, current = [f"GAIN{term}" for term in range(len(rows[0]))], " + ".join(terms)
    else:
        rows = [[*(float(np.asarray(half)) for half in part.halves or ())] for part in coefficients]
        terms = [
            f"afferents_size(state->x[{term}]) / (HALF{term}[m] + afferents_size(state->x[{term}]))"
            for term in range(len(rows[0]))
        ]
        names = [f"HALF{term}" for term in range(len(rows[0]))]
        current = f"ALPHA[m] * ({' + '.join(terms)})"
        names.append("ALPHA")
        for row, part in zip(rows, coefficients, strict=True):
            row.append(float(np.asarray(part.alpha_mv_per_ms)))
    tables = [
        f"static const afferents_real {name}[{len(rows)}] = {{\n"
        + "".join(f"    {number(row[column])},\n" for row in rows)
        + "};"
        for column, name in enumerate(names)
    ]
    return tables, current


def _level(index: int, dt_ms: float, number: _Number, single: bool) -> _Code:
    return _Code(f"state->x[{index}] = stress;", "")


def _rate_lines(index: int, dt_ms: float, number: _Number) -> list[str]:
    """Lines that declare ``rate{index}``, the backward difference."""
    past = f"state->past{index}"
    return [
        f"const afferents_real rate{index} ="
        f" state->seen ? (stress - {past}) / {number(dt_ms)} : 0;",
        f"{past} = stress;",
    ]


def _stress_rate(index: int, dt_ms: float, number: _Number, single: bool) -> _Code:
    lines = [*_rate_lines(index, dt_ms, number), f"state->x[{index}] = rate{index};"]
    return _Code("\n".join(lines), f"afferents_real past{index};")


def _pole(
    value: str, share: float, share_before: float, kept: float, state: str, number: _Number
) -> str:
    settled = (share + share_before) / (1.0 - kept)
    constants = ", ".join(map(number, (share, share_before, kept, settled)))
    return f"afferents_pole({value}, {constants}, {state}, !state->seen)"


def _low_pass(pole_hz: float, dt_ms: float) -> tuple[float, float, float]:
    """Constants of `neural.filters._low_passed`."""
    half = pi * pole_hz * dt_ms / 1000.0
    share = half / (1.0 + half)
    return share, share, (1.0 - half) / (1.0 + half)


def _slow_rate(index: int, dt_ms: float, number: _Number, single: bool) -> _Code:
    pole = _pole(f"rate{index}", *_low_pass(filters.SLOW_HZ, dt_ms), f"state->pole{index}", number)
    lines = [*_rate_lines(index, dt_ms, number), f"state->x[{index}] = {pole};"]
    return _Code("\n".join(lines), f"afferents_real past{index}, pole{index}[2];")


def _faded(index: int, dt_ms: float, number: _Number, single: bool) -> _Code:
    lines = [f"afferents_real left{index} = stress;"]
    for row, (share, fade_ms) in enumerate(filters.FADES):
        kept = exp(-dt_ms / fade_ms)
        pole = _pole("stress", 1.0 - kept, 0.0, kept, f"state->fade{index}[{row}]", number)
        lines.append(f"left{index} -= {number(share)} * {pole};")
    lines.append(f"state->x[{index}] = left{index} > 0 ? left{index} : 0;")
    return _Code("\n".join(lines), f"afferents_real fade{index}[{len(filters.FADES)}][2];")


def _corpuscle(index: int, dt_ms: float, number: _Number, single: bool) -> _Code:
    value, lines = f"passed{index}", [f"afferents_real passed{index} = stress;"]
    stages = filters.HIGH_PASSES + filters.LOW_PASSES
    for stage in range(stages):
        state = f"state->stage{index}[{stage}]"
        if stage >= filters.HIGH_PASSES:
            low = _low_pass(filters.CORPUSCLE_LOW_HZ, dt_ms)
            lines.append(f"{value} = {_pole(value, *low, state, number)};")
        elif single:
            # Differences of neighbouring samples: single precision would lose a small
            # vibration in the difference of a large stress and its low-passed self.
            share, _, kept = _low_pass(filters.CORPUSCLE_HIGH_HZ, dt_ms)
            constants = f"{number(1.0 - share)}, {number(kept)}"
            lines.append(f"{value} = afferents_rise({value}, {constants}, {state}, !state->seen);")
        else:
            high = _low_pass(filters.CORPUSCLE_HIGH_HZ, dt_ms)
            lines.append(f"{value} = {value} - {_pole(value, *high, state, number)};")
    if filters.CORPUSCLE_POWER != 0.5:
        raise ParameterError(
            argument="parameters", found=filters.CORPUSCLE_POWER, expected="a power of 0.5 of PC"
        )
    negative = number(-filters.NEGATIVE_SHARE)
    lines.append(f"state->x[{index}] = AFFERENTS_ROOT(afferents_size({value}));")
    lines.append(f"if ({value} < 0) state->x[{index}] *= {negative};")
    return _Code("\n".join(lines), f"afferents_real stage{index}[{stages}][2];")


def _rate_change(index: int, dt_ms: float, number: _Number, single: bool) -> _Code:
    change = f"afferents_size(rate{index} - state->rate{index})"
    lines = [
        *_rate_lines(index, dt_ms, number),
        f"state->x[{index}] = state->seen > 1 ? {change} : 0;",
        f"state->rate{index} = rate{index};",
    ]
    return _Code("\n".join(lines), f"afferents_real past{index}, rate{index};")


def _acceleration_change(index: int, dt_ms: float, number: _Number, single: bool) -> _Code:
    change = f"afferents_size(slope{index} - state->slope{index})"
    lines = [
        *_rate_lines(index, dt_ms, number),
        f"const afferents_real slope{index} ="
        f" state->seen ? (rate{index} - state->rate{index}) / {number(dt_ms)} : 0;",
        f"state->x[{index}] = state->seen > 2 ? {change} : 0;",
        f"state->rate{index} = rate{index};",
        f"state->slope{index} = slope{index};",
    ]
    return _Code("\n".join(lines), f"afferents_real past{index}, rate{index}, slope{index};")


def _window_lines(index: int, width: int, value: str, first: str) -> list[str]:
    """Lines that set ``x[index]`` to the mean of the last `width` values, the oldest first."""
    window, at = f"state->window{index}", f"state->at{index}"
    return [
        f"if (!state->seen) for (k = 0; k < {width}; k++) {window}[k] = {first};",
        f"{window}[{at}] = {value};",
        f"{at} = (unsigned char)(({at} + 1) % {width});",
        f"state->x[{index}] = 0;",
        f"for (k = 0; k < {width}; k++) state->x[{index}] += {window}[({at} + k) % {width}];",
        f"state->x[{index}] /= {width};",
    ]


def _averaged_level(index: int, dt_ms: float, number: _Number, single: bool) -> _Code:
    width, value = M1 + M2 + 1, "afferents_size(stress)"
    state = f"afferents_real window{index}[{width}];\nunsigned char at{index};"
    return _Code("\n".join(_window_lines(index, width, value, value)), state, M1)


def _averaged_rate(index: int, dt_ms: float, number: _Number, single: bool) -> _Code:
    width = M3 + M4 + 1
    lines = _rate_lines(index, dt_ms, number)
    lines += _window_lines(index, width, f"afferents_size(rate{index})", "0")
    state = f"afferents_real past{index}, window{index}[{width}];\nunsigned char at{index};"
    return _Code("\n".join(lines), state, M3)


_FILTERS: Mapping[Filter, Callable[[int, float, _Number, bool], _Code]] = {
    level: _level,
    filters.stress_rate: _stress_rate,
    filters.slow_rate: _slow_rate,
    filters.faded: _faded,
    filters.corpuscle: _corpuscle,
    filters.rate_change: _rate_change,
    filters.acceleration_change: _acceleration_change,
    averaged_level: _averaged_level,
    filters.sa_rate: _averaged_rate,
}

_HEADER = """\
/* Spikes of touch afferents from stress, sample by sample; written by fembridge export-c.

   Parameter set: @SET@. Classes: @ORDER@.

   Call afferents_init once, then afferents_step every AFFERENTS_SENSOR_MS with the stress in Pa
   that each class feels; it returns the number of spikes, and afferents_sa_step and the others
   do the same for one class:

       static afferents state;
       unsigned char fired[AFFERENTS_ROOM];
       afferents_init(&state);
       for (;;) {
           afferents_real stress_pa[AFFERENTS_CLASSES] = ...;
           int spikes = afferents_step(&state, stress_pa, fired);
       }

   fired has the blocks of the classes one after the other, a block AFFERENTS_SA_STEPS rows of
   AFFERENTS_SA_CELLS numbers of spikes, of the most sensitive cell first. In call n (from 0), row r
   (from 0) of a class is at

       (n - AFFERENTS_SA_DELAY) * AFFERENTS_SENSOR_MS + (r + 1) * AFFERENTS_SA_STEP_MS

   ms after the first sample. Spikes that are still to come when the samples end appear when the
   last sample is given AFFERENTS_SA_DELAY - 1 times more (a finer sensor than the step of the
   parameters loses none).

   No allocation, no library: the square root is that of the compiler, or your AFFERENTS_ROOT(x).
   Compile with -ffp-contract=off for the spikes of Python, and with -fno-math-errno where no
   mathematical library is linked. */
#ifndef AFFERENTS_H
#define AFFERENTS_H

typedef @REAL@ afferents_real;

#define AFFERENTS_SENSOR_MS @SENSOR@
#define AFFERENTS_CLASSES @COUNT@ /* @ORDER@ */

#ifndef AFFERENTS_ROOT
#if defined(__GNUC__)
#define AFFERENTS_ROOT(x) __builtin_sqrt@SUFFIX@(x)
#else
#include <math.h>
#define AFFERENTS_ROOT(x) ((afferents_real)sqrt(x))
#endif
#endif

static inline afferents_real afferents_size(afferents_real x) { return x < 0 ? -x : x; }

/* One pole: y = share x + share_before x_before + kept y_before, settled at the first sample. */
static inline afferents_real afferents_pole(afferents_real x, afferents_real share,
    afferents_real share_before, afferents_real kept, afferents_real settled,
    afferents_real *state, int first)
{
    if (first) { state[0] = x; state[1] = settled * x; }
    state[1] = share * x + share_before * state[0] + kept * state[1];
    state[0] = x;
    return state[1];
}

/* The rest of a one-pole low pass: y = share (x - x_before) + kept y_before. */
static inline afferents_real afferents_rise(afferents_real x, afferents_real share,
    afferents_real kept, afferents_real *state, int first)
{
    if (first) { state[0] = x; state[1] = 0; }
    state[1] = share * (x - state[0]) + kept * state[1];
    state[0] = x;
    return state[1];
}

@CODE@
/* All classes: @ORDER@. */
#define AFFERENTS_ROOM (@ROOM@)

typedef struct {
@FIELDS@
} afferents;

static inline void afferents_init(afferents *state)
{
@INITS@
}

static inline int afferents_step(afferents *state, const afferents_real *stress_pa,
    unsigned char *fired)
{
    int spikes = 0;
@STEPS@
    return spikes;
}

#endif
"""

_CLASS = """\
/* @UPPER@: @EQUATION@ */
#define AFFERENTS_@UPPER@_CELLS @CELLS@
#define AFFERENTS_@UPPER@_STEPS @CLASS_STEPS@
#define AFFERENTS_@UPPER@_STEP_MS @STEP@
#define AFFERENTS_@UPPER@_DELAY @DELAY@

typedef struct {
@STATE@
} afferents_@LOWER@;

static inline void afferents_@LOWER@_init(afferents_@LOWER@ *state)
{
    unsigned char *byte = (unsigned char *)state;
    unsigned long k;
    for (k = 0; k < sizeof *state; k++) byte[k] = 0;
}

static inline void afferents_@LOWER@_filter(afferents_@LOWER@ *state, afferents_real stress)
{
    int k = 0;
@FILTER_LINES@
    (void)k;
    if (state->seen < 255) state->seen++;
}

static inline int afferents_@LOWER@_fire(afferents_@LOWER@ *state, unsigned char *fired)
{
@TABLES@
@CONSTANTS@
    int m, spikes = 0;
    for (m = 0; m < @MEMBRANES@; m++) {
        const afferents_real current = @CURRENT@;
        afferents_real v;
@FIRE_LINES@
    }
    return spikes;
}

static inline int afferents_@LOWER@_step(afferents_@LOWER@ *state, afferents_real stress_pa,
    unsigned char *fired)
{
    int k, spikes = 0;
    for (k = 0; k < AFFERENTS_@UPPER@_STEPS * AFFERENTS_@UPPER@_CELLS; k++) fired[k] = 0;
@ADVANCE@
    return spikes;
}
"""

# The polynomial of degree 5 through six samples, as in `neural.time_step`.
_INTERPOLATE = """\
static const afferents_real WEIGHT[@FINER@][6] = {
@WEIGHTS@
};
afferents_real *s = state->coarse;
if (!state->samples) for (k = 0; k < 6; k++) s[k] = stress_pa;
for (k = 0; k < 5; k++) s[k] = s[k + 1];
s[5] = stress_pa;
if (state->samples < 3) { state->samples++; return 0; }
for (k = 0; k < @FINER@; k++) {
    afferents_real value = s[2];
    value += WEIGHT[k][0] * (s[0] - s[2]);
    value += WEIGHT[k][1] * (s[1] - s[2]);
    value += WEIGHT[k][3] * (s[3] - s[2]);
    value += WEIGHT[k][4] * (s[4] - s[2]);
    value += WEIGHT[k][5] * (s[5] - s[2]);
    afferents_@LOWER@_filter(state, value);
    spikes += afferents_@LOWER@_fire(state, fired + k * @CELLS@);
}"""
