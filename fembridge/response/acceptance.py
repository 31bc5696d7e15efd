"""Is a contact model to be trusted? It pushes, and unloading finds loading's stress.

Two traps, both measured with ccx 2.20. Surface-to-surface contact remembers: on
the way back the stress at a depth came out 17 to 20 % low. And a thin probe slips
between the skin's nodes: the run ends well, the skin untouched.
"""

import math
from dataclasses import dataclass

import numpy as np

from fembridge.typing import FloatArray

CLOSURE_PERCENT = 0.5
# Shallower than this share of the deepest, a step is not compared: the first
# touch of a few nodes is no measure of a contact model.
_COMPARED_SHARE = 0.05
_MATCH_UM = 1.0e-6
# The skin under the probe follows it, less what the penalty springs give.
_FOLLOWED_SHARE = 0.5


@dataclass(frozen=True, slots=True)
class Acceptance:
    """What a load–unload run showed; `problem` is None where it is accepted.

    `closure_percent` is the largest difference between unloading and loading at
    the same depth, in percent of the loading stress there, over all afferents; NaN
    where nothing could be compared. It `remembers` where the problem is that unloading
    differs from loading, and no other.
    """

    closure_percent: float
    force_n_per_mm: float
    followed_share: float
    problem: str | None
    remembers: bool = False


def judge(
    depth_um: FloatArray, stress_pa: FloatArray, force_n_per_mm: FloatArray, apex_um: FloatArray
) -> Acceptance:
    """Judge a run that loads to its deepest sample and comes back.

    Parameters
    ----------
    depth_um
        Probe depth ``(T,)``, the rest state first.
    stress_pa
        Von Mises stress ``(T, afferent)``.
    force_n_per_mm, apex_um
        Force of the skin on the probe, and how far the skin's apex moved in.
    """
    deepest = int(depth_um.argmax())
    deepest_um, moved_um = float(depth_um[deepest]), float(apex_um[deepest])
    force = float(force_n_per_mm[deepest])
    followed = moved_um / deepest_um if deepest_um > 0 else 0.0
    closure = _closure_percent(depth_um, stress_pa, deepest)
    problem, remembers = None, False
    if not (force > 0 and followed >= _FOLLOWED_SHARE):
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
        remembers = True
        problem = (
            f"unloading differs from loading by {closure:.3g} % at the same depth, "
            f"expected at most {CLOSURE_PERCENT} %"
        )
    return Acceptance(closure, force, followed, problem, remembers)


def _closure_percent(depth_um: FloatArray, stress_pa: FloatArray, deepest: int) -> float:
    load_um = depth_um[: deepest + 1]
    worst = []
    for row in range(deepest + 1, depth_um.size):
        same = np.flatnonzero(np.abs(load_um - depth_um[row]) <= _MATCH_UM)
        if same.size and depth_um[row] >= _COMPARED_SHARE * depth_um[deepest]:
            loading = stress_pa[same[0]]
            with np.errstate(divide="ignore", invalid="ignore"):
                worst.append(np.max(np.abs(stress_pa[row] / loading - 1)))
    return 100 * float(np.max(worst)) if worst else math.nan
