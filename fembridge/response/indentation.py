"""The indentation that a response map is made of: down in steps, and back up."""

import numpy as np

from fembridge.stimulus import Stimulus

# Deep enough for every stimulus of the catalogue: 250 um and the noise's peaks.
DEFAULT_DEPTH_UM = 400.0
# Steps grow with depth: a small vibration sees as many of them as a large one.
STEPS = 30
_GROWTH = 1.7
_UNLOAD_EVERY = 3
_DT_MS = 0.5
_DIGITS = 3


def indentation(depth_um: float = DEFAULT_DEPTH_UM) -> Stimulus:
    """Load to `depth_um` in 30 steps, unload over every third of them.

    Time has no meaning here; a step is one increment of the solver.
    """
    share = np.arange(STEPS + 1) / STEPS
    load_um = np.round(depth_um * share**_GROWTH, _DIGITS)
    unload_um = load_um[STEPS - _UNLOAD_EVERY : 0 : -_UNLOAD_EVERY]
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
