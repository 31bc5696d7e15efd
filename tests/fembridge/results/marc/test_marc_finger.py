"""The quick finger in a post file: stress at its afferents is their own layer's."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from decks.finger import LAYERS
from decks.presets import QUICK, mesh_of
from fembridge import read
from fembridge.errors import ResultError, UsageError
from fembridge.run_folder import AfferentNode, RunFolder

DT_S = 0.0005
MIDDLE_MM = 1.0


def _sibling(name):
    found = importlib.util.spec_from_file_location(
        f"fembridge_test_{name}", Path(__file__).parent / f"{name}.py"
    )
    module = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    return module


models = _sibling("stress_models")


def stress_mpa(x, y, layer, time_s):
    """Linear in place and jumping from layer to layer."""
    return [time_s * 1e3 * (0.01 * (k + 1) + 0.02 * x - 0.01 * y + 0.5 * layer) for k in range(6)]


@pytest.fixture(scope="module")
def finger():
    """Corners, elements and layers of the quick mesh's middle, by number from 1."""
    mesh = mesh_of(QUICK)
    middle = np.abs(mesh.node_mm[mesh.quad, 0]).max(axis=1) < MIDDLE_MM
    kept = np.unique(mesh.quad[middle]).tolist()
    nodes = {row + 1: tuple(mesh.node_mm[row].tolist()) for row in kept}
    quads = [tuple(n + 1 for n in quad) for quad in mesh.quad[middle].tolist()]
    return nodes, quads, mesh.layer[middle].tolist()


def inner_nodes(finger):
    """A node for each layer, all of whose elements are of it."""
    _, quads, layers = finger
    met = {}
    for quad, layer in zip(quads, layers, strict=True):
        for node in quad:
            met.setdefault(node, set()).add(layer)
    return {layers.pop(): node for node, layers in met.items() if len(layers) == 1}


@pytest.fixture(scope="module", params=[11, 80, 27])
def run(request, finger, writer, tmp_path_factory):
    """A run folder of two increments after rest, each layer an element set."""
    nodes, quads, layers = finger
    plane = models.Plane(request.param, nodes, quads, layers)
    sets = tuple(
        (name, 0, tuple(k + 1 for k, x in enumerate(layers) if x == number), ())
        for number, name in enumerate(LAYERS)
    )
    increments = plane.increments(writer, stress_mpa, (0.0, DT_S, 2 * DT_S))
    folder = tmp_path_factory.mktemp("run")
    (folder / "job.t16").write_bytes(
        writer.post_bytes(writer.Storage(), plane.model(writer, sets=sets), increments)
    )
    places = tuple(
        AfferentNode(f"A{layer}", node, LAYERS[layer], *nodes[node], -nodes[node][1])
        for layer, node in sorted(inner_nodes(finger).items())
    )
    RunFolder(folder, "marc", 2, 1e3 * DT_S, 0.0, places, "0").write()
    return folder


def test_afferents_have_the_stress_of_their_own_layer(run, finger):
    traces = read(run)
    assert len(traces) == len(LAYERS)
    for trace in traces:
        layer = int(trace.afferent[1:])
        x, y = finger[0][trace.node]
        exact = [1e6 * models.von_mises(stress_mpa(x, y, layer, k * DT_S)) for k in range(3)]
        assert trace.start_ms == 0.0
        assert trace.dt_ms == pytest.approx(0.5, rel=1e-6)
        assert_allclose(trace.stress_pa, exact, rtol=1e-5, atol=1)


def test_a_node_on_the_boundary_of_two_layers_is_refused_by_their_names(run, finger):
    _, quads, layers = finger
    epidermis, dermis = LAYERS.index("epidermis"), LAYERS.index("dermis")
    in_layer = {
        n: {node for quad, x in zip(quads, layers, strict=True) if x == n for node in quad}
        for n in range(len(LAYERS))
    }
    others = set().union(*(s for n, s in in_layer.items() if n not in (epidermis, dermis)))
    shared = sorted((in_layer[epidermis] & in_layer[dermis]) - others)
    with pytest.raises(ResultError, match=f"node {shared[0]} lies between epidermis an"):
        read(run, [shared[0]])


def test_the_deck_s_run_must_have_reached_its_end(run, tmp_path):
    text = (run / "run.toml").read_text().replace("increments = 2", "increments = 5")
    (tmp_path / "run.toml").write_text(text)
    (tmp_path / "job.t16").write_bytes((run / "job.t16").read_bytes())
    with pytest.raises(ResultError, match=r"results end at 1 ms, the deck runs to 2.5"):
        read(tmp_path)
    assert np.isclose(read(tmp_path, partial=True)[0].times_ms[-1], 1.0)


def test_the_text_file_is_read_where_there_is_no_binary_one(finger, writer, tmp_path):
    nodes, quads = models.grid(2, 2)
    plane = models.Plane(80, nodes, quads)
    increments = plane.increments(writer, stress_mpa, (0.0, DT_S, 2 * DT_S))
    storage = writer.Storage(binary=False)
    (tmp_path / "job.t19").write_bytes(writer.post_bytes(storage, plane.model(writer), increments))
    place = AfferentNode("SA", 5, "dermis", 1.0, 1.0, 1.0)
    RunFolder(tmp_path, "marc", 2, 1e3 * DT_S, 0.0, (place,), "0").write()
    (trace,) = read(tmp_path)
    exact = 1e6 * models.von_mises(stress_mpa(1.0, 1.0, 0, 2 * DT_S))
    assert trace.stress_pa[-1] == pytest.approx(exact, rel=1e-5)


def test_steps_before_the_stimulus_need_not_have_its_time_step(writer, tmp_path):
    """Someone's own model: two steps of his to 0.3 s, then the stimulus."""
    plane = models.Plane(11, *models.grid(2, 2))
    times_s = (0.0, 0.1, 0.3, 0.3005, 0.301, 0.3015)
    increments = plane.increments(writer, stress_mpa, times_s)
    (tmp_path / "job.t16").write_bytes(
        writer.post_bytes(writer.Storage(), plane.model(writer), increments)
    )
    place = AfferentNode("SA", 5, "dermis", 1.0, 1.0, 1.0)
    RunFolder(tmp_path, "marc", 3, 0.5, 300.0, (place,), "0", before_ms=300.0).write()
    (trace,) = read(tmp_path)
    exact = [1e6 * models.von_mises(stress_mpa(1, 1, 0, t)) for t in times_s[2:]]
    assert_allclose(trace.stress_pa, exact, rtol=1e-5)
    assert (trace.start_ms, round(trace.dt_ms, 4)) == (0.0, 0.5)


def test_someone_s_own_model_may_be_in_another_unit(writer, tmp_path):
    plane = models.Plane(11, *models.grid(2, 2))
    increments = plane.increments(writer, stress_mpa, (0.0, DT_S, 2 * DT_S))
    (tmp_path / "job.t16").write_bytes(
        writer.post_bytes(writer.Storage(), plane.model(writer), increments)
    )
    place = AfferentNode("SA", 5, "dermis", 1.0, 1.0, 1.0)
    RunFolder(tmp_path, "marc", 2, 1e3 * DT_S, 0.0, (place,), "0", stress_unit="kPa").write()
    exact = 1e3 * models.von_mises(stress_mpa(1.0, 1.0, 0, 2 * DT_S))
    assert read(tmp_path)[0].stress_pa[-1] == pytest.approx(exact, rel=1e-5)
    with pytest.raises(UsageError, match="a run folder of fembridge is in kPa, always"):
        read(tmp_path, stress_unit="MPa")
