"""The indentation that a response map is made of, and whether its contact is sound.

The probe goes down in steps and comes back: unloading has to find loading's stress.
Two traps, both measured with ccx 2.20. Surface-to-surface contact is path-dependent:
on the way back the stress at a depth came out 17 to 20 % low. And a thin probe slips
between the skin's nodes: the run ends well, the skin untouched.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from decks.dialects import JOB
from fembridge.errors import ResponseError, ResultError, StimulusError
from fembridge.response.response_map import IN_PLANE, ResponseMap
from fembridge.results.byte_file import ByteFile
from fembridge.results.frd import FrdIndex, values_at
from fembridge.results.printed import read_node_print
from fembridge.results.stress import TENSOR, von_mises_pa
from fembridge.run_folder import RunFolder, read_run_folder, read_waveform
from fembridge.stimulus import Stimulus
from fembridge.trace import MS_PER_S, PA_PER_MPA
from fembridge.typing import FloatArray

CLOSURE_PERCENT = 0.5
DEFAULT_DEPTH_UM = 400.0
"""Deep enough for every stimulus of the catalogue: 250 um and the noise's peaks."""
STEPS = 30
"""Steps grow with depth: a small vibration sees as many of them as a large one."""
DEEP_UM = 1000.0
"""Of all deeper stimuli: one indentation answers them too."""
REACH_UM = 2000.0
"""Nothing deeper was ever solved: the reference fingers reach 1500 um."""
_PROBE_SET = "PROBE"

_GROWTH = 1.7
_UNLOAD_EVERY = 3
_DT_MS = 0.5
_DIGITS = 3
# Shallower, the first steps would round to the same depth.
_LEAST_UM = 1.0

# Shallower than this share of the deepest, a step is not compared: the first
# touch of a few nodes is no measure of a contact model.
_COMPARED_SHARE = 0.05
_MATCH_UM = 1.0e-6
# The skin under the probe follows it, less what the penalty springs give.
_FOLLOWED_SHARE = 0.5
_UM_PER_MM = 1000.0
# Solvers print times with six digits.
_TIME_TOLERANCE = 1.0e-5
# Of the largest stress; recorded runs showed 1e-14.
_NO_SHEAR = 1.0e-6


class HysteresisError(ResponseError):
    """Unloading differs from loading by `closure_percent`, too much for a map."""

    def __init__(self, problem: str, closure_percent: float) -> None:
        super().__init__(problem, closure_percent)  # these rebuild it after pickling
        self.problem, self.closure_percent = problem, closure_percent

    def __str__(self) -> str:
        return self.problem


class Acceptance(NamedTuple):
    """What a load-unload run showed; `problem` is None where it is accepted.

    `closure_percent` is the largest difference between unloading and loading at
    the same depth, in percent of the loading stress there, over all afferents; NaN
    where nothing could be compared. With `hysteresis` the problem is that unloading
    differs from loading, and no other.
    """

    closure_percent: float
    problem: str | None
    hysteresis: bool = False


def indentation(depth_um: float = DEFAULT_DEPTH_UM, steps: int = STEPS) -> Stimulus:
    """Load to `depth_um` in `steps`, unload over every third of their depths.

    Time has no meaning here; a step is one increment of the solver.
    """
    if not _LEAST_UM <= depth_um <= REACH_UM:
        raise StimulusError(
            f"{depth_um:g} um deep, expected {_LEAST_UM:g} to {REACH_UM:g} um: no deeper "
            "indentation was ever solved; take a smaller amplitude or pre-indentation"
        )
    load_um = loading_um(depth_um, steps)
    unload_um = load_um[steps - _UNLOAD_EVERY : 0 : -_UNLOAD_EVERY]
    samples_um = np.concatenate([load_um, unload_um])
    return Stimulus(
        id=f"indentation_{depth_um:g}",
        displacement_um=samples_um,
        dt_ms=_DT_MS,
        window_ms=(0.0, (samples_um.size - 1) * _DT_MS),
        origin={"family": "indentation", "depth_um": float(depth_um)},
    )


def loading_um(depth_um: float, steps: int) -> FloatArray:
    """Depths from 0 to `depth_um` in `steps` that grow, ``(steps + 1,)``."""
    load_um: FloatArray = np.round(depth_um * (np.arange(steps + 1) / steps) ** _GROWTH, _DIGITS)
    return load_um


def depth_for(needed_um: float) -> float:
    """Depth of the indentation that answers stimuli down to `needed_um`."""
    depths_um = (DEFAULT_DEPTH_UM, DEEP_UM, float(np.ceil(needed_um / 100.0) * 100.0))
    return next(depth_um for depth_um in depths_um if needed_um <= depth_um)


def judge(
    depth_um: FloatArray, stress_pa: FloatArray, force_n_per_mm: FloatArray, apex_um: FloatArray
) -> Acceptance:
    """Judge a run that loads to its deepest sample and comes back.

    `depth_um` ``(T,)`` is the probe's, the rest state first; `stress_pa` ``(T, afferent)``
    is von Mises stress; then the force of the skin on the probe, and how far the skin's
    apex moved in, ``(T,)``.
    """
    deepest = int(depth_um.argmax())
    deepest_um, moved_um = float(depth_um[deepest]), float(apex_um[deepest])
    force = float(force_n_per_mm[deepest])
    load_um, back_um = depth_um[: deepest + 1], depth_um[deepest + 1 :]
    same = np.abs(load_um - back_um[:, None]) <= _MATCH_UM
    compared = same.any(axis=1) & (back_um >= _COMPARED_SHARE * deepest_um)
    closure = math.nan
    if compared.any():
        loading_pa = stress_pa[same[compared].argmax(axis=1)]
        with np.errstate(divide="ignore", invalid="ignore"):
            off = np.abs(stress_pa[deepest + 1 :][compared] / loading_pa - 1)
        closure = 100 * float(off.max())
    problem, hysteresis = None, False
    if not (force > 0 and moved_um >= _FOLLOWED_SHARE * deepest_um):
        problem = (
            f"the probe did not push: at {deepest_um:g} um the skin moved "
            f"{moved_um:.3g} um, the force is {force:.3g} N/mm"
        )
    elif not np.isfinite(stress_pa).all():
        problem = "stress is not finite everywhere"
    elif not (stress_pa[deepest] > 0).all():
        problem = f"an afferent feels nothing: its stress at {deepest_um:g} um is 0"
    elif math.isnan(closure):
        problem = "the run does not come back over depths that it loaded to"
    elif not closure <= CLOSURE_PERCENT:
        hysteresis = True
        problem = (
            f"unloading differs from loading by {closure:.3g} % at the same depth, "
            f"expected at most {CLOSURE_PERCENT} %"
        )
    return Acceptance(closure, problem, hysteresis)


def recorded_response(folder: Path) -> ResponseMap:
    """The response of the run in `folder`, whose waveform is read as well."""
    return measured_response(read_run_folder(folder), *read_waveform(folder))


def measured_response(run: RunFolder, times_ms: FloatArray, depth_um: FloatArray) -> ResponseMap:
    """Read the results of an indentation and accept it, or say why not.

    `times_ms` and `depth_um` ``(T,)`` are its waveform, the rest state first.

    Raises
    ------
    ResultError
        As of `read_pressed`.
    HysteresisError, ResponseError
        The contact model is not to be trusted: see `judge`.
    """
    folder = run.folder
    if not run.afferents:
        raise ResultError("run.toml names no afferent, expected one or more", folder)
    nodes = [place.node for place in run.afferents]
    pressed = read_pressed(run, times_ms, [*nodes, run.apex_node])
    tensor_pa = pressed.tensor_pa[:, :-1]
    shear_pa = float(np.abs(tensor_pa[..., IN_PLANE:]).max())
    if shear_pa > _NO_SHEAR * float(np.abs(tensor_pa).max()):
        raise ResultError(
            f"out-of-plane shear of {shear_pa:.3g} Pa, expected none: plane strain", run.results
        )
    tensor_pa[..., IN_PLANE:] = 0.0  # rounding noise
    apex_um = -_UM_PER_MM * pressed.moved_mm[:, -1, 1]
    accepted = judge(depth_um, von_mises_pa(tensor_pa), pressed.force_n_per_mm, apex_um)
    if accepted.hysteresis:
        raise HysteresisError(f"{folder}: {accepted.problem}", accepted.closure_percent)
    if accepted.problem is not None:
        raise ResponseError(f"{folder}: {accepted.problem}")
    loading = slice(0, int(depth_um.argmax()) + 1)
    return ResponseMap(
        depth_um=depth_um[loading],
        tensor_pa=tensor_pa[loading],
        force_n_per_mm=pressed.force_n_per_mm[loading],
        places=run.afferents,
        closure_percent=round(accepted.closure_percent, 6),
        origin={"solver": run.solver, "deck_sha256": run.deck_sha256, **run.inputs},
    )


class Pressed(NamedTuple):
    """What the skin did on a probe's way ``(T, node, ...)``, ``(T,)``, the rest state first."""

    tensor_pa: FloatArray
    moved_mm: FloatArray
    force_n_per_mm: FloatArray


def read_pressed(run: RunFolder, times_ms: FloatArray, nodes: Sequence[int]) -> Pressed:
    """Stress and displacement at `nodes`, and the force of the skin on the probe.

    `times_ms` ``(T,)`` are those of the waveform, the rest state first, which no solver writes.
    The deck is ours, so there is no unit, material or relaxing skin to ask for, as
    `fembridge.results.read` does.

    Raises
    ------
    ResultError
        The results are not there, not whole, or at other times than the waveform:
        those of a run with a ramp to a pre-indentation, for example.
    """
    found = []
    with ByteFile(run.results) as file:
        index = FrdIndex(file)
        if problem := index.problem():
            raise ResultError(problem, run.results)
        for name in ("STRESS", "DISP"):
            blocks = index.named(name)
            check_times(np.array([one.time_ms for one in blocks]), times_ms, run.results)
            found.append(values_at(file, blocks, nodes))
    tensor_mpa, moved_mm = found
    on_axis = [node in run.on_axis for node in nodes]  # of a half: without shear
    tensor_mpa[:, on_axis, TENSOR.index("xy")] = 0.0
    printed = run.folder / f"{JOB}.dat"
    force_ms, _, total_n = read_node_print(printed, "total force", _PROBE_SET)
    check_times(force_ms, times_ms, printed)
    force_n = total_n[:, 0, 1]
    if not all(np.isfinite(one).all() for one in (tensor_mpa, moved_mm, force_n)):
        raise ResultError("stress, displacement or force is not finite", run.results)
    # `RF` is the force that pushes the probe down; the section is 1 mm thick.
    found = [PA_PER_MPA * tensor_mpa, moved_mm, -force_n]
    # The rest state in front, which no solver writes.
    return Pressed(*(np.concatenate([np.zeros_like(one[:1]), one]) for one in found))


def check_times(found_ms: FloatArray, times_ms: FloatArray, path: Path) -> None:
    """Refuse results at other times than those of the waveform behind the rest state."""
    expected_ms = times_ms[1:]
    if found_ms.size != expected_ms.size:
        raise ResultError(f"{found_ms.size} increments, expected {expected_ms.size}", path)
    off = np.abs(found_ms - expected_ms) > _TIME_TOLERANCE * expected_ms[-1]
    if off.any():
        row = int(off.argmax())
        raise ResultError(
            f"increment {row + 1} is at {found_ms[row] / MS_PER_S:g} s, expected "
            f"{expected_ms[row] / MS_PER_S:g} s",
            path,
        )
