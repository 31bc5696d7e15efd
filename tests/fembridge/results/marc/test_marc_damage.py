"""Changed and cut post files: an error of ours or numbers, never anything else."""

import contextlib
import importlib.util
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fembridge import read, write_vtu_series
from fembridge.errors import FembridgeError
from fembridge.results import describe
from fembridge.results.field_file import read_field
from fembridge.results.marc import read_displacement, read_one_sided
from fembridge.results.near_node import near_nodes
from fembridge.results.node_choice import NodeChoice
from fembridge.results.read_options import ReadOptions


def _sibling(name):
    found = importlib.util.spec_from_file_location(
        f"fembridge_test_{name}", Path(__file__).parent / f"{name}.py"
    )
    module = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    return module


models = _sibling("stress_models")
PARTIAL = ReadOptions(partial=True)
WAYS = {
    "traces": lambda path: read(path, [1, 5], partial=True, across_materials=True),
    "scalar": lambda path: read(path, [5], von_mises="scalar"),
    "sides": lambda path: read_one_sided(path, 5, PARTIAL),
    "displacement": lambda path: read_displacement(path, [1, 5], PARTIAL),
    "list": describe,
    "stress": lambda path: read_field(path, "Stress", options=PARTIAL),
    "moved": lambda path: read_field(path, "Displacement", options=PARTIAL),
    "near": lambda path: near_nodes(path, [(0.4, 0.4)]),
    "set": lambda path: NodeChoice(sets=["probes"]).resolve(path),
    "vtu": lambda path: write_vtu_series(path, path.parent / "vtu", partial=True),
}


@pytest.fixture(scope="module", params=["t16", "t19"])
def whole(request, writer):
    """Give a small file: a function of no argument, for its bytes and its name."""
    plane = models.Plane(80, *models.grid(2, 2), layers=[0, 0, 1, 1])
    increments = plane.increments(
        writer, lambda x, y, layer, t: [t * x, 0, 0, y, 0, 0], (0.0, 0.001, 0.002)
    )
    storage = writer.Storage(binary=request.param == "t16")
    model = plane.model(writer, sets=(("probes", 1, (5,), ()),))
    content = writer.post_bytes(storage, model, increments)
    return lambda: (content, storage.name)  # which a failing test does not print


@pytest.mark.parametrize("way", WAYS)
@settings(
    settings.get_profile("costly"), suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(seed=st.integers(0, 2**32 - 1), changes=st.integers(1, 4))
def test_changed_bytes_are_an_error_of_ours_or_numbers(way, seed, changes, whole, tmp_path):
    content, name = whole()
    rng = np.random.default_rng(seed)
    damaged = bytearray(content)
    for at in rng.integers(0, len(damaged), changes):
        damaged[at] = rng.choice([0, 1, 32, 45, 48, 57, 69, 127, 128, 255])
    if rng.integers(4) == 0:
        damaged = damaged[: rng.integers(1, len(damaged))]
    path = tmp_path / name
    path.unlink(missing_ok=True)  # else the disk is waited for
    path.write_bytes(damaged)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with contextlib.suppress(FembridgeError):
            WAYS[way](path)


@pytest.mark.parametrize("way", WAYS)
def test_the_whole_file_is_read_every_way(way, whole, tmp_path):
    content, name = whole()
    path = tmp_path / name
    path.write_bytes(content)
    if way == "scalar":
        with pytest.raises(FembridgeError, match="node 5 lies between"):
            WAYS[way](path)
    else:
        assert WAYS[way](path)
