"""From the stress at an afferent to its spikes: NumPy alone, no solver.

``encode`` is the way in; ``neural.filters``, ``neural.models`` and ``neural.lif`` are its
three steps, ``neural.counts`` is the same for many parameters at once.
``neural.agreement`` and ``neural.threshold`` judge it, ``neural.fit_problem``
and ``neural.search`` fit it.
"""

from neural.agreement import Agreement, agreement
from neural.encoder import encode, encode_afferents, encode_cells
from neural.models import MODELS
from neural.parameter_sets import ParameterSet, parameter_set
from neural.parameters import PUBLISHED, AfferentParameters, Parameters
from neural.rates import mean_rate_ips, rate_ips

__all__ = [
    "MODELS",
    "PUBLISHED",
    "AfferentParameters",
    "Agreement",
    "ParameterSet",
    "Parameters",
    "agreement",
    "encode",
    "encode_afferents",
    "encode_cells",
    "mean_rate_ips",
    "parameter_set",
    "rate_ips",
]
