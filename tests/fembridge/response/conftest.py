"""A response map whose curves are known in closed form."""

import numpy as np
import pytest

from fembridge.response.response_map import ResponseMap
from fembridge.run_folder import AfferentNode

DEPTH_UM = np.array([0.0, 2.0, 7.0, 20.0, 55.0, 110.0, 190.0, 300.0])
PLACES = (
    AfferentNode("SA", 11, "epidermis", 0.0, -0.6, 0.6),
    AfferentNode("PC", 12, "subcutaneous", 0.25, -2.5, 2.5),
)


def tensor_at(depth_um):
    """Tensors ``(K, 2, 6)`` in Pa that rise, fall and bend with depth."""
    share = np.asarray(depth_um) / 300.0
    tensor_pa = np.zeros((*share.shape, 2, 6))
    tensor_pa[..., 0, 0] = 1e4 * share**1.5
    tensor_pa[..., 0, 1] = -3e4 * share
    tensor_pa[..., 0, 2] = -8e3 * np.sin(3 * share)
    tensor_pa[..., 0, 3] = 2e3 * share**2
    tensor_pa[..., 1, 1] = -1e3 * np.tanh(2 * share)
    return tensor_pa


@pytest.fixture(scope="session")
def made_map():
    """Give a map of these curves; what is named replaces a field of it."""

    def make(**changes):
        fields = {
            "depth_um": DEPTH_UM,
            "tensor_pa": tensor_at(DEPTH_UM),
            "force_n_per_mm": 1e-3 * DEPTH_UM**1.2,
            "places": PLACES,
            "closure_percent": 0.125,
            "origin": {"solver": "calculix", "finger": {"name": "µ-finger"}},
        }
        return ResponseMap(**(fields | changes))

    return make
