"""Threshold amplitude of each afferent class against vibration frequency.

The *absolute* threshold of a cell is the smallest amplitude with a spike; the threshold of
*one impulse per cycle* is the smallest amplitude with as many spikes as complete cycles after
the first. Recorded thresholds are means over units, so the threshold of a class is that of
its median cell. A vibration starts at phase 0 with full amplitude, as the paper's stimuli,
from the pre-indentation of the parameters.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from fembridge.errors import UsageError
from fembridge.evidence import CRITERIA
from fembridge.number import parse_number
from fembridge.response.response_map import ResponseMap
from fembridge.stimulus import Stimulus
from fembridge.typing import BoolArray, FloatArray
from neural.encoder import encode_cells
from neural.models import model_of
from neural.parameters import DT_MS, AfferentParameters

if TYPE_CHECKING:
    import pandas

COLUMNS = ("afferent", "criterion", "frequency_hz", "amplitude_um")

# Range of the recorded frequencies of any class.
LOWEST_HZ, HIGHEST_HZ = 2.0, 800.0

# Preferred numbers of ISO 266.
THIRD_OCTAVES_HZ = tuple(
    float(step * 10**decade)
    for decade in (0, 1, 2)
    for step in (1, 1.25, 1.6, 2, 2.5, 3.15, 4, 5, 6.3, 8)
    if LOWEST_HZ <= step * 10**decade <= HIGHEST_HZ
)

_MIN_AMPLITUDE_UM = 0.01

# Number of amplitudes in the first pass, amplitudes between two neighbours in the next
# passes, and number of next passes: the ratio of neighbours falls from 1.45 to 1.08 to 1.015.
_FIRST_PASS, _NEXT_PASSES, _PASSES = 28, 4, 2

# A vibration lasts 100 ms or five cycles, whichever is longer, as those of Muniak et al.
# (2007), with at least ten samples per cycle.
_MIN_DURATION_MS, _MIN_CYCLES, _MIN_SAMPLES_PER_CYCLE = 100.0, 5.0, 10.0


def frequencies_of(text: str) -> list[float]:
    """Frequencies in Hz: ``5:800``, the third octaves of a range, or ``10,50,200``."""
    low, colon, high = text.partition(":")
    try:
        if not colon:
            return [parse_number(item) for item in text.split(",")]
        lowest_hz, highest_hz = parse_number(low), parse_number(high)
    except ValueError:
        raise UsageError(f"frequencies {text!r}, expected as 5:800 or 10,50,200") from None
    if not LOWEST_HZ <= lowest_hz <= highest_hz <= HIGHEST_HZ:
        raise UsageError(
            f"frequencies {text!r}, expected a range inside "
            f"{LOWEST_HZ:g}:{HIGHEST_HZ:g}, the recorded frequencies"
        )
    frequencies_hz = [hz for hz in THIRD_OCTAVES_HZ if lowest_hz <= hz <= highest_hz]
    if not frequencies_hz:
        raise UsageError(f"frequencies {text!r}: no third octave from {low} to {high} Hz")
    return frequencies_hz


def vibration(
    frequency_hz: float,
    amplitude_um: float,
    preindent_um: float,
    dt_ms: float = DT_MS,
    cycles: float = _MIN_CYCLES,
) -> Stimulus:
    """Sinusoid of 100 ms or `cycles` (default: 5), whichever is longer, every `dt_ms` (0.5).

    Frequency in Hz, zero-to-peak amplitude and pre-indentation in um.
    """
    duration_ms = max(_MIN_DURATION_MS, cycles * 1000.0 / frequency_hz)
    times_ms = np.arange(math.ceil(duration_ms / dt_ms - 1e-9) + 1) * dt_ms
    wave_um = amplitude_um * np.sin(2.0 * np.pi * frequency_hz * times_ms / 1000.0)
    return Stimulus(
        id=f"sine_{frequency_hz:g}_{amplitude_um:g}",
        displacement_um=preindent_um + wave_um,
        dt_ms=dt_ms,
        window_ms=(0.0, float(times_ms[-1])),
        preindent_um=preindent_um,
    )


def step_ms(frequency_hz: float, parameters: AfferentParameters) -> float:
    """Time step in ms with ten samples per cycle; that of the parameters where it is fixed."""
    dt_ms = parameters.dt_ms
    if model_of(parameters).any_step:
        while dt_ms > 1000.0 / (_MIN_SAMPLES_PER_CYCLE * frequency_hz):
            dt_ms /= 2.0
    return dt_ms


def thresholds(
    response: ResponseMap,
    parameters: AfferentParameters,
    frequencies_hz: Sequence[float],
    preindent_um: float = 0.0,
) -> "pandas.DataFrame":
    """Threshold amplitudes of a class.

    Parameters
    ----------
    response
        Response map with the stress of the class.
    parameters
        Parameters of the class.
    frequencies_hz
        Frequencies of the vibrations.
    preindent_um
        Depth of the probe before time 0, in um. Default: 0.

    Returns
    -------
    DataFrame
        ``afferent, criterion, frequency_hz, amplitude_um, least_um, most_um``: thresholds of
        the median, the most sensitive and the least sensitive cell. NaN where even the
        strongest vibration that `response` reaches is too weak.

    Raises
    ------
    UsageError, ResponseError
        A frequency outside 2 to 800 Hz; a class that `response` lacks.
    """
    import pandas

    for frequency_hz in frequencies_hz:
        if not LOWEST_HZ <= frequency_hz <= HIGHEST_HZ:
            raise UsageError(
                f"frequency {frequency_hz:g} Hz, expected {LOWEST_HZ:g} to {HIGHEST_HZ:g}"
            )
    rows = []
    for frequency_hz in frequencies_hz:
        ranked_um = _ranked_thresholds(response, parameters, frequency_hz, preindent_um)
        for criterion, (least_um, *middle_um, most_um) in zip(CRITERIA, ranked_um, strict=True):
            median_um = float(np.mean(middle_um))
            rows.append(
                (parameters.afferent, criterion, frequency_hz, median_um, least_um, most_um)
            )
    frame = pandas.DataFrame(rows, columns=[*COLUMNS, "least_um", "most_um"])
    return frame.replace(math.inf, math.nan)


def _ranked_thresholds(
    response: ResponseMap,
    parameters: AfferentParameters,
    frequency_hz: float,
    preindent_um: float,
) -> FloatArray:
    """Thresholds by both criteria of the most sensitive, two middle and least sensitive cell.

    ``(2, 4)`` in µm; infinity where there is none. Only brackets of these cells are refined.
    """
    most_um = response.deepest_um - preindent_um
    tried_um = np.geomspace(_MIN_AMPLITUDE_UM, most_um, _FIRST_PASS)
    fires = _fires(response, parameters, frequency_hz, preindent_um, tried_um)
    below_um, above_um = _bracket(tried_um, fires)
    last_cell = parameters.cells - 1
    ranks = [0, last_cell // 2, (last_cell + 1) // 2, last_cell]
    shares = np.arange(1, _NEXT_PASSES + 1) / (_NEXT_PASSES + 1)
    for _ in range(_PASSES):
        ranked_above_um = np.take_along_axis(
            above_um, np.argsort(above_um, axis=1)[:, ranks], axis=1
        )
        open_brackets = np.isfinite(above_um) & (below_um < above_um)
        open_brackets &= np.isin(above_um, ranked_above_um)
        if not open_brackets.any():
            break
        pairs = np.unique(
            np.stack([below_um[open_brackets], above_um[open_brackets]], axis=-1), axis=0
        )
        between_um = np.concatenate([low * (high / low) ** shares for low, high in pairs])
        tried_um = np.unique(np.concatenate([between_um, pairs.reshape(-1)]))
        fires = _fires(response, parameters, frequency_hz, preindent_um, tried_um)
        lower_um, upper_um = _bracket(tried_um, fires, below_um)
        below_um = np.where(open_brackets, lower_um, below_um)
        above_um = np.where(open_brackets, upper_um, above_um)
    thresholds_um = np.where(np.isfinite(above_um), np.sqrt(below_um * above_um), math.inf)
    ranked_um: FloatArray = np.sort(thresholds_um, axis=1)[:, ranks]
    return ranked_um


def _bracket(
    tried_um: FloatArray, fires: BoolArray, least_um: FloatArray | float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Last amplitude below the threshold and first at it, above `least_um`, from ``(A, ...)``."""
    column = tried_um.reshape(-1, *[1] * (fires.ndim - 1))
    reached = fires & (column > least_um)
    first = reached.argmax(axis=0)
    above_um = np.where(reached.any(axis=0), tried_um[first], math.inf)
    below_um = tried_um[np.maximum(first - 1, 0)]
    return np.where(first > 0, below_um, above_um), above_um


def _fires(
    response: ResponseMap,
    parameters: AfferentParameters,
    frequency_hz: float,
    preindent_um: float,
    amplitudes_um: FloatArray,
) -> BoolArray:
    """Whether each criterion is met, ``(amplitude, criterion, cell)``."""
    dt_ms = step_ms(frequency_hz, parameters)
    unit_wave = vibration(frequency_hz, 1.0, 0.0, dt_ms)
    waves_um = preindent_um + np.multiply.outer(unit_wave.displacement_um, amplitudes_um)
    joined = replace(
        unit_wave,
        displacement_um=waves_um.reshape(-1),
        window_ms=(0.0, dt_ms),
        preindent_um=preindent_um,
    )
    stress_pa = response.stress_pa(parameters, [joined]).reshape(waves_um.shape)
    spikes = encode_cells(stress_pa, dt_ms, replace(parameters, dt_ms=dt_ms))
    cycle_ms = 1000.0 / frequency_hz
    cycles = math.floor(unit_wave.window_ms[1] / cycle_ms + 1e-9) - 1
    ends_ms = np.array([cycle_ms, (cycles + 1) * cycle_ms]) + 1e-6
    fires = np.empty((amplitudes_um.size, 2, parameters.cells), np.bool_)
    for row, cells in enumerate(spikes):
        for cell, times_ms in enumerate(cells):
            before, until = times_ms.searchsorted(ends_ms, side="right")
            fires[row, :, cell] = times_ms.size > 0, until - before >= cycles
    return fires


def against_evidence(
    predicted: "pandas.DataFrame", observed: "pandas.DataFrame"
) -> "pandas.DataFrame":
    """`observed` thresholds with columns for the model's thresholds and their ratio.

    `predicted` must have the frequencies of `observed`; columns ``model_um`` and ``ratio``
    (model over observed) are added.
    """
    keys = ["afferent", "criterion", "frequency_hz"]
    merged = observed.merge(predicted[[*keys, "amplitude_um"]], on=keys, suffixes=("", "_model"))
    merged = merged.rename(columns={"amplitude_um_model": "model_um"})
    return merged.assign(ratio=merged["model_um"] / merged["amplitude_um"])
