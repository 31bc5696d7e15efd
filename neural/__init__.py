"""From the stress at an afferent to its spikes: NumPy alone, no solver.

``encode`` is the way in; ``neural.drive``, ``neural.current`` and ``neural.lif`` are
its three steps, ``neural.candidates`` is the same for many parameters at once.
"""

from neural.candidates import candidate_counts
from neural.drive import DERIVATIVES
from neural.encoder import (
    afferent_drives,
    encode,
    membrane_current,
    membrane_potential,
)
from neural.lif import spike_counts, spike_times
from neural.parameters import (
    AFFERENTS,
    PUBLISHED,
    AfferentParameters,
    Parameters,
    PcParameters,
    RaParameters,
    SaParameters,
    parameters_from_table,
    parameters_to_table,
    read_parameters,
)
from neural.rate import impulses_per_cycle, rate_ips, spikes_inside, window_rows

__all__ = [
    "AFFERENTS",
    "DERIVATIVES",
    "PUBLISHED",
    "AfferentParameters",
    "Parameters",
    "PcParameters",
    "RaParameters",
    "SaParameters",
    "afferent_drives",
    "candidate_counts",
    "encode",
    "impulses_per_cycle",
    "membrane_current",
    "membrane_potential",
    "parameters_from_table",
    "parameters_to_table",
    "rate_ips",
    "read_parameters",
    "spike_counts",
    "spike_times",
    "spikes_inside",
    "window_rows",
]
