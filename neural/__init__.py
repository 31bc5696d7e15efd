"""From the stress at an afferent to its spikes: NumPy alone, no solver.

``encode`` is the way in; ``neural.drive``, ``neural.coefficients`` and ``neural.lif``
are its three steps, ``neural.candidates`` is the same for many parameters at once.
``neural.agreement``, ``neural.threshold`` and ``neural.spike_distance`` judge it.
"""

from neural.agreement import Agreement, Regression, agreement, bias_ips, regression, rmse_ips
from neural.candidates import candidate_counts
from neural.coefficients import Coefficients
from neural.drive import DERIVATIVES
from neural.drive_table import DRIVES, drive_named
from neural.encoder import (
    afferent_drives,
    encode,
    encode_afferents,
    encode_cells,
    membrane_current,
    membrane_potential,
)
from neural.further_parameters import (
    RateRaParameters,
    RisingRaParameters,
    RisingSaParameters,
    SharpPcParameters,
)
from neural.lif import spike_counts, spike_times
from neural.parameter_file import (
    ParameterSet,
    parameters_from_table,
    parameters_to_table,
    read_parameter_set,
    read_parameters,
)
from neural.parameters import (
    AFFERENTS,
    PUBLISHED,
    AfferentParameters,
    Parameters,
    PcParameters,
    RaParameters,
    SaParameters,
)
from neural.rate import impulses_per_cycle, mean_rate_ips, rate_ips, spikes_inside, window_rows
from neural.sets import DEFAULT_SET, SET_NAMES, parameter_set, parameter_set_or_file, parameter_sets
from neural.spike_distance import van_rossum_distance, victor_purpura_distance
from neural.threshold import (
    Plateau,
    entrainment_plateau,
    entrainment_threshold_um,
    threshold_amplitude_um,
    vector_strength,
)

__all__ = [
    "AFFERENTS",
    "DEFAULT_SET",
    "DERIVATIVES",
    "DRIVES",
    "PUBLISHED",
    "SET_NAMES",
    "AfferentParameters",
    "Agreement",
    "Coefficients",
    "ParameterSet",
    "Parameters",
    "PcParameters",
    "Plateau",
    "RaParameters",
    "RateRaParameters",
    "Regression",
    "RisingRaParameters",
    "RisingSaParameters",
    "SaParameters",
    "SharpPcParameters",
    "afferent_drives",
    "agreement",
    "bias_ips",
    "candidate_counts",
    "drive_named",
    "encode",
    "encode_afferents",
    "encode_cells",
    "entrainment_plateau",
    "entrainment_threshold_um",
    "impulses_per_cycle",
    "mean_rate_ips",
    "membrane_current",
    "membrane_potential",
    "parameter_set",
    "parameter_set_or_file",
    "parameter_sets",
    "parameters_from_table",
    "parameters_to_table",
    "rate_ips",
    "read_parameter_set",
    "read_parameters",
    "regression",
    "rmse_ips",
    "spike_counts",
    "spike_times",
    "spikes_inside",
    "threshold_amplitude_um",
    "van_rossum_distance",
    "vector_strength",
    "victor_purpura_distance",
    "window_rows",
]
