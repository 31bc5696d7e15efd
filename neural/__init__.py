"""Spikes of an afferent from the stress at its position, without a solver.

``encode`` is the main function; its three steps are in ``neural.filters``, ``neural.models``
and ``neural.lif``. ``neural.counts`` counts spikes for many parameters at once,
``neural.agreement`` and ``neural.threshold`` compare predicted with observed rates,
``neural.fit_problem`` and ``neural.search`` fit parameters.
"""

from neural.agreement import Agreement, agreement
from neural.encoder import encode, encode_afferents, encode_cells
from neural.models import MODELS
from neural.parameter_sets import ParameterSet, parameter_set
from neural.parameters import PUBLISHED, AfferentParameters, Parameters
from neural.rates import mean_rate_ips, rate_ips
from neural.stream import Stream, StreamSpike

__all__ = [
    "MODELS",
    "PUBLISHED",
    "AfferentParameters",
    "Agreement",
    "ParameterSet",
    "Parameters",
    "Stream",
    "StreamSpike",
    "agreement",
    "encode",
    "encode_afferents",
    "encode_cells",
    "mean_rate_ips",
    "parameter_set",
    "rate_ips",
]
