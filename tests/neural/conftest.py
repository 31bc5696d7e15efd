"""Settings of the property tests, and every model of an afferent, one after the other."""

import pytest
from hypothesis import settings

from neural.models import MODELS

# A busy machine is no reason to fail.
settings.register_profile("no deadline", deadline=None)
settings.load_profile("no deadline")

ROWS = [row for models in MODELS.values() for row in models.values()]


@pytest.fixture(params=ROWS, ids=[f"{row.name}-{row.afferent}" for row in ROWS])
def row(request):
    """Each row of `MODELS`."""
    return request.param


# Parameters of one of each model: stress of some 10 kPa fires half a dozen spikes and more.
VALUES = {
    "tau_ms": 37.0,
    "a1_pa": 2.1e4,
    "a2_pa_per_ms": 9.3e3,
    "a3_pa_per_ms": 4.7e3,
    "a4_pa_per_ms2": 3.1e3,
    "alpha_mv_per_ms": 7.3,
    "beta_mv_per_ms": 0.43,
    "step_pa": 5.9e3,
    "held_pa": 1.7e4,
    "jump_mv": 2.3,
    "recovery_ms": 41.0,
    "retraction": 0.8,
}


@pytest.fixture
def parameters_of():
    """Function of a row of `MODELS` that returns parameters of it, with `changes`."""

    def parameters(row, **changes):
        named = {free.field: VALUES[free.field] for free in row.free(1)}
        return row.parameters(**{**named, "drive": row.name, **changes})

    return parameters
