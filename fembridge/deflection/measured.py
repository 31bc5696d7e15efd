"""From a finished run to the skin's profile, or why the run is not to be trusted."""

import numpy as np

from decks.dialects import JOB
from fembridge.deflection.press import Press, surface_of
from fembridge.deflection.profile import Deflection
from fembridge.errors import ResponseError, ResultError
from fembridge.results.frd import read_displacement
from fembridge.results.printed.dat import read_total_force
from fembridge.run_folder import RunFolder, read_waveform
from fembridge.typing import FloatArray

PROBE_SET = "PROBE"

# The skin under the probe follows it, less what the penalty springs give.
FOLLOWED = (0.95, 1.01)
# Both sides of a symmetric finger go down alike, to this share of the depth.
_UNLIKE_SHARE = 0.01
# No step down makes the force smaller by more than this share of the last one.
_FORCE_DIP_SHARE = 0.02
_TIME_TOLERANCE = 1.0e-5
# Further out the pad turns into the finger's side; the first node there is kept.
REACH_MM = 6.0
_MM_PER_UM = 1.0e-3
_MM_DIGITS, _N_DIGITS = 6, 8


def measured_deflection(run: RunFolder, press: Press) -> Deflection:
    """Read the run that was built of `press`, and accept it, or say why not.

    Raises
    ------
    ResultError
        The run is not there or not whole.
    ResponseError
        The probe slipped through the skin, or the sides went down unlike.
    """
    times_ms, depth_um = read_waveform(run.folder)
    depth_mm = depth_um * _MM_PER_UM
    mesh = press.mesh
    node = surface_of(mesh)
    found_ms, moved_mm = read_displacement(run.results, (node + 1).tolist())
    force_ms, force_n = read_total_force(run.folder / f"{JOB}.dat", PROBE_SET)
    for axis_ms, path in ((found_ms, run.results), (force_ms, run.folder)):
        if (
            axis_ms.size != times_ms.size - 1
            or (np.abs(axis_ms - times_ms[1:]) > _TIME_TOLERANCE * times_ms[-1]).any()
        ):
            raise ResultError("increments are not those of its waveform", path)
    # `RF` is the force that holds the probe down; the section is 1 mm thick.
    force_n_per_mm = np.concatenate([[0.0], -force_n[:, 1]])
    x_mm, down_mm = mesh.node_mm[node, 0], -moved_mm[-1, :, 1]
    apex_mm = float(down_mm[node == run.apex_node - 1][0])
    problem = why_not(float(depth_mm[-1]), apex_mm, force_n_per_mm)
    if problem is not None:
        raise ResponseError(f"{run.folder}: {problem}")
    distance_mm, deflection_mm, unlike_mm = both_sides(x_mm, down_mm)
    if unlike_mm > _UNLIKE_SHARE * depth_mm[-1]:
        raise ResponseError(
            f"{run.folder}: left and right differ by {unlike_mm:.3g} mm, expected at "
            f"most {_UNLIKE_SHARE * depth_mm[-1]:.3g} mm"
        )
    pad = slice(int(np.searchsorted(distance_mm, REACH_MM)) + 1)
    return Deflection(
        name=press.finger.name,
        elements=len(mesh.quad),
        distance_mm=distance_mm[pad],
        deflection_mm=np.round(deflection_mm[pad], _MM_DIGITS) + 0.0,
        depth_mm=float(depth_mm[-1]),
        loading_mm=depth_mm,
        loading_n_per_mm=np.round(force_n_per_mm, _N_DIGITS) + 0.0,
        origin={
            "solver": run.solver,
            "deck_sha256": run.deck_sha256,
            "sides_differ_mm": round(unlike_mm, _MM_DIGITS),
            **run.inputs,
        },
    )


def why_not(depth_mm: float, apex_mm: float, force_n_per_mm: FloatArray) -> str | None:
    """Say why a run is not one in which the probe pushed the skin; None if it is.

    Parameters
    ----------
    depth_mm, apex_mm
        How far the probe went down, and the skin's point under it.
    force_n_per_mm
        Force of the skin on the probe ``(K,)``, from first touch to `depth_mm`.
    """
    last = float(force_n_per_mm[-1])
    least, most = (share * depth_mm for share in FOLLOWED)
    if not (last > 0 and np.isfinite(force_n_per_mm).all()):
        return f"the probe did not push: the force at {depth_mm:g} mm is {last:.3g} N/mm"
    if not least <= apex_mm <= most:
        return (
            f"the skin under the probe moved {apex_mm:.4g} mm, expected {least:.4g} to "
            f"{most:.4g} mm: the probe slipped between its nodes"
        )
    dip = float(-np.diff(force_n_per_mm).min())
    if dip > _FORCE_DIP_SHARE * last:
        return (
            f"the force fell by {dip:.3g} N/mm on the way to {last:.3g} N/mm, expected it to grow"
        )
    return None


def both_sides(x_mm: FloatArray, down_mm: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Fold a profile at ``x = 0``: distance, mean of both sides, largest difference."""
    right = x_mm >= 0
    left_mm = np.interp(x_mm[right], -x_mm[::-1], down_mm[::-1])
    unlike_mm = float(np.abs(down_mm[right] - left_mm).max())
    return x_mm[right], 0.5 * (down_mm[right] + left_mm), unlike_mm
