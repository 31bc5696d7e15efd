"""The indentation that a response map is made of: down in steps, and back up."""

from itertools import pairwise

import numpy as np

from decks.stimuli import MAX_AMPLITUDE_UM
from fembridge.errors import StimulusError
from fembridge.stimulus import Stimulus
from fembridge.typing import FloatArray

# Deep enough for every stimulus of the catalogue: 250 um and the noise's peaks.
DEFAULT_DEPTH_UM = 400.0
# Steps grow with depth: a small vibration sees as many of them as a large one.
STEPS = 30
_GROWTH = 1.7
_UNLOAD_EVERY = 3
# Node-to-surface contact takes any step down; up from deeper than the default, ccx
# 2.20 lost all contact for a whole increment in steps of 28 um, never in 16 um.
_DEEP_UNLOAD_STEP_UM = 12.0
_DT_MS = 0.5
_DIGITS = 3
# Shallower, the first steps would round to the same depth.
_LEAST_UM = 1.0


def indentation(depth_um: float = DEFAULT_DEPTH_UM) -> Stimulus:
    """Load to `depth_um` in 30 steps, unload over every third of their depths.

    Time has no meaning here; a step is one increment of the solver. Deeper than
    the default, the way back is divided into small steps.

    Raises
    ------
    StimulusError
        A depth that is not within 1 um to 10 mm.
    """
    if not _LEAST_UM <= depth_um <= MAX_AMPLITUDE_UM:
        raise StimulusError(
            f"indentation: depth_um is {depth_um:g}, expected {_LEAST_UM:g} to {MAX_AMPLITUDE_UM:g}"
        )
    share = np.arange(STEPS + 1) / STEPS
    load_um = np.round(depth_um * share**_GROWTH, _DIGITS)
    unload_um = load_um[STEPS - _UNLOAD_EVERY : 0 : -_UNLOAD_EVERY]
    if depth_um > DEFAULT_DEPTH_UM:
        unload_um = _divided(np.concatenate([load_um[-1:], unload_um]))[1:]
    samples_um = np.concatenate([load_um, unload_um])
    return Stimulus(
        id=f"indentation_{depth_um:g}",
        displacement_um=samples_um,
        dt_ms=_DT_MS,
        window_ms=(0.0, (samples_um.size - 1) * _DT_MS),
        origin={"family": "indentation", "depth_um": float(depth_um)},
    )


def depth_for(needed_um: float) -> float:
    """Depth of the indentation that answers stimuli down to `needed_um`."""
    if needed_um <= DEFAULT_DEPTH_UM:
        return DEFAULT_DEPTH_UM
    return float(np.ceil(needed_um / 100.0) * 100.0)


def _divided(depths_um: FloatArray) -> FloatArray:
    """Give the same depths, with more of them between where a step is too large."""
    parts = [depths_um[:1]]
    for start_um, end_um in pairwise(depths_um.tolist()):
        count = int(np.ceil((start_um - end_um) / _DEEP_UNLOAD_STEP_UM))
        way_um: FloatArray = np.linspace(start_um, end_um, count + 1)[1:]
        parts.append(np.round(way_um, _DIGITS))
    return np.concatenate(parts)
