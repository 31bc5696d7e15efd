"""From a finished indentation run to its response map."""

from pathlib import Path

import numpy as np

from decks.dialects import JOB
from fembridge.errors import ResponseError, ResultError
from fembridge.response.acceptance import judge
from fembridge.response.path_dependence import RemembersError
from fembridge.response.response_map import IN_PLANE, ResponseMap
from fembridge.results.frd import read_stress_and_displacement
from fembridge.results.printed.dat import read_total_force
from fembridge.results.read_options import ReadOptions
from fembridge.results.stress import von_mises_pa
from fembridge.run_folder import read_run_folder, read_waveform
from fembridge.trace import MS_PER_S
from fembridge.typing import FloatArray

PROBE_SET = "PROBE"
_UM_PER_MM = 1000.0
# Solvers print times with six digits.
_TIME_TOLERANCE = 1.0e-5
# Of the largest stress; recorded runs showed 1e-14.
_NO_SHEAR = 1.0e-6


def measured_response(folder: Path) -> ResponseMap:
    """Read the indentation run in `folder` and accept it, or say why not.

    Raises
    ------
    ResultError
        The run is not there, not whole, or its results are at other times than its
        waveform: one with a ramp to a pre-indentation, for example.
    ResponseError
        The contact model is not to be trusted: see `acceptance`.
    """
    run = read_run_folder(folder)
    times_ms, depth_um = read_waveform(folder)
    if not run.afferents:
        raise ResultError("run.toml names no afferent, expected one or more", folder)
    nodes = [place.node for place in run.afferents]
    options = ReadOptions(branches=run.branches, on_axis=run.on_axis)
    read = read_stress_and_displacement(run.results, nodes, [run.apex_node], options)
    _check_times(read.times_ms, times_ms[1:], run.results)
    force_times_ms, force_n = read_total_force(folder / f"{JOB}.dat", PROBE_SET)
    _check_times(force_times_ms, times_ms[1:], folder / f"{JOB}.dat")
    tensor_pa = _from_rest(_in_plane(read.tensor_pa, run.results))
    apex_um = _from_rest(-_UM_PER_MM * read.displacement_mm[:, 0, 1])
    # `RF` is the force that holds the probe down; the section is 1 mm thick.
    force_n_per_mm = _from_rest(-force_n[:, 1])
    found = judge(depth_um, von_mises_pa(tensor_pa), force_n_per_mm, apex_um)
    if found.remembers:
        raise RemembersError(f"{folder}: {found.problem}", found.closure_percent)
    if found.problem is not None:
        raise ResponseError(f"{folder}: {found.problem}")
    loading = slice(0, int(depth_um.argmax()) + 1)
    inputs = dict(run.inputs)
    return ResponseMap(
        depth_um=depth_um[loading],
        tensor_pa=tensor_pa[loading],
        force_n_per_mm=force_n_per_mm[loading],
        places=run.afferents,
        closure_percent=round(found.closure_percent, 6),
        origin={"solver": run.solver, "deck_sha256": run.deck_sha256, **inputs},
    )


def _in_plane(tensor_pa: FloatArray, path: Path) -> FloatArray:
    """Take out the out-of-plane shears: in plane strain they are rounding noise."""
    shear_pa = float(np.abs(tensor_pa[..., IN_PLANE:]).max())
    if shear_pa > _NO_SHEAR * float(np.abs(tensor_pa).max()):
        raise ResultError(
            f"out-of-plane shear of {shear_pa:.3g} Pa, expected none: plane strain", path
        )
    tensor_pa = tensor_pa.copy()
    tensor_pa[..., IN_PLANE:] = 0.0
    return tensor_pa


def _from_rest(values: FloatArray) -> FloatArray:
    """Put the stress-free state, which no solver writes, in front."""
    rest: FloatArray = np.concatenate([np.zeros_like(values[:1]), values])
    return rest


def _check_times(found_ms: FloatArray, expected_ms: FloatArray, path: Path) -> None:
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
