"""The response map of a user's deck: the driven displacement or load once in and out.

    0 ... depth_um        loading, in growing steps
      ... 0               unloading, over loading depths and middles between two of them
      ... -retract_um     away from the skin, in growing steps
      ... 0               back, in the same way

Stress at a depth that was met twice must be the same (`closure_percent`); stress in the middle
between two depths must be the one that a map interpolates (`interpolation_percent`). Both are
differences of von Mises stress at each afferent, in percent: the closure of the stress at that
depth, or of 5 % of the largest one there where it is smaller; the interpolation of the largest one.
A map is accepted if both are at most `CLOSURE_PERCENT`.

Stress that depends on time (creep, inertia, another load that is ramped beside the waveform) is
refused before the run: a load-unload run of no duration would not show it.
"""

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from decks.own_model import LoadScale
from fembridge.errors import FembridgeError, ResponseError, ResultError, StimulusError
from fembridge.io.run_folder import RunFolder
from fembridge.response.indentation import (
    CLOSURE_PERCENT,
    DEFAULT_DEPTH_UM,
    STEPS,
    HysteresisError,
    loading_um,
)
from fembridge.response.response_map import ResponseMap
from fembridge.results.history import STRESS, VON_MISES, History
from fembridge.results.result import Result
from fembridge.results.von_mises import TENSOR, von_mises_pa
from fembridge.stimulus import Stimulus
from fembridge.typing import FloatArray, IntArray

_LOGGER = logging.getLogger(__name__)

DECK_LIMITS_UM = (1.0, 10_000.0)
"""Least and largest depth in um of a load-unload run."""
STEP_LIMITS = (6, 400)
"""Least and largest number of loading steps."""
TRANSIENT = (
    "solve each waveform: fembridge build-deck --base-deck DECK --stimulus ID, then fembridge run"
)
"""The way where no map is possible."""

_FAMILY = "load_unload"
_DT_MS = 0.5
_DIGITS = 3
_MATCH_UM = 1.0e-6
_UNLOAD_STEP = 1.5  # of the loading steps: every second depth of unloading is a middle
# Below these shares of the largest stress, at the afferent and at any, a difference is measured
# against them: solvers converge to a share of the largest force.
_SMALL_SHARE, _SMALLEST_SHARE = 0.05, 1.0e-3
_FLAT_SHARE = 1.0e-6  # of the largest stress: differences of a probe that has left the skin
_TIME_TOLERANCE = 1.0e-3  # of a step, by which a result file may round its times


def load_unload(
    depth_um: float = DEFAULT_DEPTH_UM,
    retract_um: float | None = None,
    steps: int = STEPS,
) -> Stimulus:
    """The waveform of a load-unload run: see the module.

    Parameters
    ----------
    depth_um
        Largest depth in um. Default: 400.
    retract_um
        Distance in um to which the probe goes up from its position. Default: None, `depth_um`.
    steps
        Loading steps; away from the skin there are half as many. Default: 30.

    Raises
    ------
    StimulusError
        A depth or a number of steps outside its limits.
    """
    retract_um = depth_um if retract_um is None else retract_um
    for argument, value, limits in (
        ("depth_um", depth_um, DECK_LIMITS_UM),
        ("retract_um", retract_um or DECK_LIMITS_UM[0], DECK_LIMITS_UM),
        ("steps", steps, STEP_LIMITS),
    ):
        if not limits[0] <= value <= limits[1]:
            expected = f"{limits[0]:g} to {limits[1]:g}"
            raise StimulusError(argument=argument, found=value, expected=expected)
    samples_um = _way_um(depth_um, steps)
    if retract_um:
        samples_um = np.concatenate([samples_um, -_way_um(retract_um, (steps + 1) // 2)[1:]])
    return Stimulus(
        id=f"{_FAMILY}_{depth_um:g}",
        displacement_um=samples_um,
        dt_ms=_DT_MS,
        window_ms=(0.0, (samples_um.size - 1) * _DT_MS),
        origin={
            "family": _FAMILY,
            "depth_um": float(depth_um),
            "retract_um": float(retract_um),
            "steps": int(steps),
        },
    )


def _way_um(depth_um: float, steps: int) -> FloatArray:
    """Depths from 0 to `depth_um` in growing steps and back to 0, with middles of steps."""
    load_um = loading_um(depth_um, steps)
    position = np.arange(steps - _UNLOAD_STEP, 0.0, -_UNLOAD_STEP)
    unload_um = np.round(np.interp(position, np.arange(steps + 1), load_um), _DIGITS)
    return np.concatenate([load_um, unload_um, [0.0]])


def load_unload_of(run: RunFolder) -> Stimulus:
    """The waveform of the load-unload run in a folder.

    Raises
    ------
    ResultError
        The folder has another run.
    """
    stimulus: Mapping[str, Any] = run.inputs.get("stimulus", {})
    if stimulus.get("family") != _FAMILY:
        raise ResultError(
            f"has stimulus {stimulus.get('id')!r}, expected a load-unload run of `fembridge map`",
            run.folder,
            found=stimulus.get("id"),
        )
    try:
        return load_unload(
            float(stimulus["depth_um"]), float(stimulus["retract_um"]), int(stimulus["steps"])
        )
    except (KeyError, TypeError, ValueError) as error:
        raise ResultError(f"inputs.stimulus is no load-unload run: {error}", run.folder) from error


@dataclass(frozen=True, slots=True, eq=False)
class Closure:
    """Result of the check of a load-unload run.

    `percent` ``(A,)`` is the largest difference of unloading from loading at each afferent,
    `interpolation_percent` ``(A,)`` that of a map from the solved stress.
    """

    percent: FloatArray
    interpolation_percent: FloatArray


def closure_of(depth_um: FloatArray, tensor_pa: FloatArray) -> Closure:
    """Closure of a load-unload run: `tensor_pa` ``(T, A, 6)`` at the depths `depth_um` ``(T,)``."""
    rows = _loading_rows(depth_um)
    stress_pa = von_mises_pa(tensor_pa)
    peak_pa = stress_pa.max(axis=0)
    floor_pa = np.maximum(_SMALL_SHARE * peak_pa, _SMALLEST_SHARE * peak_pa.max())
    floor_pa = np.maximum(floor_pa, np.finfo(np.float64).tiny)
    others = np.setdiff1d(np.arange(depth_um.size), rows)
    loaded_um = depth_um[rows]
    same = np.abs(depth_um[others, None] - loaded_um) <= _MATCH_UM
    closed = others[same.any(axis=1)]
    loading_pa = stress_pa[rows[same[same.any(axis=1)].argmax(axis=1)]]
    difference = np.abs(stress_pa[closed] - loading_pa) / np.maximum(loading_pa, floor_pa)
    middles = others[~same.any(axis=1)]
    from scipy.interpolate import PchipInterpolator  # slow to import

    curve = PchipInterpolator(loaded_um, tensor_pa[rows], axis=0)
    error_pa = np.abs(von_mises_pa(curve(depth_um[middles])) - stress_pa[middles])
    interpolation = error_pa / np.maximum(peak_pa, _SMALLEST_SHARE * peak_pa.max() or 1.0)
    return Closure(
        100.0 * difference.max(axis=0, initial=0.0),
        100.0 * interpolation.max(axis=0, initial=0.0),
    )


def _loading_rows(depth_um: FloatArray) -> IntArray:
    """Rows of the samples at which a depth was met first, on the way out, by ascending depth."""
    deepest, highest = int(depth_um.argmax()), int(depth_um.argmin())
    rows = np.arange(deepest + 1)
    if depth_um[highest] < 0:
        start = deepest + int(np.flatnonzero(depth_um[deepest:] < 0)[0])
        rows = np.concatenate([np.arange(highest, start - 1, -1), rows])
    return rows


def deck_response(
    result: Result,
    stimulus: Stimulus,
    *,
    load: LoadScale | None = None,
    path_dependent: Sequence[str] = (),
) -> ResponseMap:
    """Response map of a load-unload run, from its open result file.

    Parameters
    ----------
    result
        The result file, with its run.
    stimulus
        The waveform of the run, `load_unload`.
    load
        Force or pressure that the waveform stands for. Default: None, a displacement.
    path_dependent
        What the deck has that may depend on earlier depths, for the message. Default: none.

    Raises
    ------
    ResultError
        The results end before the waveform, lack a sample or an afferent.
    HysteresisError
        Unloading differs from loading.
    ResponseError
        An afferent has no stress, or the steps are too long to interpolate between them.
    """
    run = result.run
    assert run is not None
    if not run.afferents:
        raise ResponseError(
            "the deck was written without afferents: write it again with --afferent SA=NODE",
            run.folder,
        )
    depth_um, tensor_pa = stimulus.displacement_um, samples_pa(result, stimulus)
    peak_pa = von_mises_pa(tensor_pa).max(axis=0)
    if not peak_pa.all():
        key = run.afferents[int(peak_pa.argmin())].key
        problem = f"the stress at afferent {key} is 0 at all depths to {stimulus.deepest_um:g} um"
        raise ResponseError(f"{problem}: the probe did not reach the skin", found=key)
    closure = closure_of(depth_um, tensor_pa)
    percent = float(closure.percent.max())
    if not percent <= CLOSURE_PERCENT:
        key = run.afferents[int(closure.percent.argmax())].key
        causes = "causes may be yielding, friction, contact or loose convergence"
        reasons = "; ".join(path_dependent) or causes
        raise HysteresisError(
            f"stress depends on the path, not on depth alone: unloading differs from loading by "
            f"{percent:.3g} % at {key}, expected at most {CLOSURE_PERCENT} % ({reasons}); "
            f"{TRANSIENT}",
            closure_percent=percent,
        )
    interpolation = float(closure.interpolation_percent.max())
    if not interpolation <= CLOSURE_PERCENT:
        key = run.afferents[int(closure.interpolation_percent.argmax())].key
        raise ResponseError(
            f"stress between two depths differs from the interpolated one by {interpolation:.3g} % "
            f"of its largest value at {key}, expected at most {CLOSURE_PERCENT} %: take more steps "
            f"than {stimulus.origin['steps']} (--steps), or a smaller depth (--depth-um)",
            found=interpolation,
            expected=f"at most {CLOSURE_PERCENT} %",
        )
    rows = _loading_rows(depth_um)
    highest_pa = tensor_pa[rows[:2]]
    lifts_off = depth_um[rows[0]] < 0 and bool(
        (np.abs(np.diff(highest_pa, axis=0)[0]).max(axis=-1) <= _FLAT_SHARE * peak_pa).all()
    )
    _LOGGER.info(
        f"unloading within {percent:.2g} % of loading, interpolation within {interpolation:.2g} %, "
        f"at {len(run.afferents)} afferents"
    )
    return ResponseMap(
        depth_um=depth_um[rows],
        tensor_pa=tensor_pa[rows],
        force_n_per_mm=np.empty(0),
        places=run.afferents,
        closure_percent=round(percent, 6),
        origin={
            "solver": run.solver,
            "deck_sha256": run.deck_sha256,
            "interpolation_percent": round(interpolation, 6),
            **run.inputs,
        },
        lifts_off=lifts_off,
        load=load,
    )


def samples_pa(result: Result, stimulus: Stimulus) -> FloatArray:
    """Stress tensors ``(T, afferent, 6)`` in Pa at the samples of `stimulus`.

    Of a file that has von Mises stress alone, the tensor is the uniaxial stress of that size.
    Outputs between two samples are left out.

    Raises
    ------
    ResultError
        The file has no output at a sample, or a value that is not finite.
    """
    history = _stress_history(result)
    times_ms = stimulus.times_ms
    rows = np.abs(history.at[:, None] - times_ms).argmin(axis=0)
    gap_ms = np.abs(history.at[rows] - times_ms)
    if (gap_ms > _tolerance_ms(stimulus)).any():
        row = int(gap_ms.argmax())
        raise ResultError(
            f"no output at {times_ms[row]:g} ms of the waveform, the nearest is at "
            f"{history.at[rows[row]]:g} ms",
            history.path,
            found=float(history.at[rows[row]]),
            expected=f"{times_ms[row]:g} ms",
        )
    values = np.asarray(history.values[rows])
    if not np.isfinite(values).all():
        node = history.nodes[int(np.argwhere(~np.isfinite(values))[0][1])]
        raise ResultError(f"stress of node {node} is not finite at all samples", history.path)
    if history.quantity == VON_MISES:
        tensor_pa = np.zeros((*values.shape[:2], len(TENSOR)))
        tensor_pa[..., 0] = values[..., 0]
        return tensor_pa
    return values


def _stress_history(result: Result) -> History:
    """Tensors at the afferents, or von Mises stress of a file that has no tensors.

    Outputs at uneven times are no doubt here: each sample is looked up by its time.
    """
    result = result.with_options(quiet=True)
    try:
        return result.history(quantity=STRESS, from_start=True, on_grid=False)
    except FembridgeError as error:
        try:
            return result.history(quantity=VON_MISES, from_start=True, on_grid=False)
        except FembridgeError:
            raise error from None


def _tolerance_ms(stimulus: Stimulus) -> float:
    """Largest difference of an output's time from that of its sample."""
    end_ms = float(stimulus.times_ms[-1])
    return max(_TIME_TOLERANCE, 1.0e-5 * math.ceil(end_ms)) * stimulus.dt_ms
