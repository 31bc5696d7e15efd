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
