"""Stress is never averaged over two layers unasked, whatever tells the layers."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from fembridge.errors import ResultError
from fembridge.results.marc import read_one_sided, read_stress_tensor
from fembridge.results.read_options import ReadOptions


def _sibling(name):
    found = importlib.util.spec_from_file_location(
        f"fembridge_test_{name}", Path(__file__).parent / f"{name}.py"
    )
    module = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    return module


models = _sibling("stress_models")
# Two columns of elements to the left are layer 0, one to the right is layer 1.
SOFT_MPA, STIFF_MPA = 1.0, 40.0
BETWEEN, INSIDE, IN_STIFF = 7, 6, 8


def uniform(x, y, layer, time_s):
    return [(STIFF_MPA if layer else SOFT_MPA) * time_s, 0, 0, 0, 0, 0]


@pytest.fixture
def two_layers():
    """Six elements, a layer boundary at x = 2."""
    return models.Plane(11, *models.grid(3, 2), layers=[0, 0, 1, 0, 0, 1])


def file_of(plane, writer, write_post, **changes):
    increments = plane.increments(writer, uniform, (0.0, 1.0))
    model = plane.model(writer, **changes)
    return write_post(writer.Storage(), model, increments)


def last_mpa(path, node, **options):
    tensor_pa = read_stress_tensor(path, [node], ReadOptions(**options))[1]
    return tensor_pa[-1, 0, 0] / 1e6


def test_a_node_inside_a_layer_has_that_layer_s_stress(two_layers, writer, write_post):
    path = file_of(two_layers, writer, write_post)
    assert last_mpa(path, INSIDE) == pytest.approx(SOFT_MPA)
    assert last_mpa(path, IN_STIFF) == pytest.approx(STIFF_MPA)


def test_a_node_between_layers_is_refused_with_both_names(two_layers, writer, write_post):
    path = file_of(two_layers, writer, write_post)
    ids = ("elements with ids 1 1 1 3 1", "elements with ids 2 1 1 3 1")
    words = f"node 7 lies between {' and '.join(ids)}: a mean over both"
    with pytest.raises(ResultError, match=words):
        last_mpa(path, BETWEEN)
    sets = (("epidermis", 0, (1, 2, 4, 5), ()), ("dermis", 0, (3, 6), ()))
    path = file_of(two_layers, writer, write_post, sets=sets)
    with pytest.raises(ResultError, match=r"between epidermis and dermis: .*one-sided"):
        last_mpa(path, BETWEEN)


def test_across_materials_takes_the_mean_over_all_elements(two_layers, writer, write_post):
    path = file_of(two_layers, writer, write_post)
    mean = (2 * SOFT_MPA + 2 * STIFF_MPA) / 4
    assert last_mpa(path, BETWEEN, across_materials=True) == pytest.approx(mean)
    corner = (SOFT_MPA + STIFF_MPA) / 2
    assert last_mpa(path, 3, across_materials=True) == pytest.approx(corner)


def test_each_side_of_a_boundary_for_itself(two_layers, writer, write_post):
    sets = (("epidermis", 0, (1, 2, 4, 5), ()), ("dermis", 0, (3, 6), ()))
    path = file_of(two_layers, writer, write_post, sets=sets)
    soft, stiff = read_one_sided(path, BETWEEN)
    assert (soft.name, stiff.name) == ("epidermis", "dermis")
    assert (soft.elements, stiff.elements) == ((2, 5), (3, 6))
    assert_allclose(soft.von_mises_pa, [0, SOFT_MPA * 1e6], rtol=1e-6)
    assert_allclose(stiff.von_mises_pa, [0, STIFF_MPA * 1e6], rtol=1e-6)
    (alone,) = read_one_sided(path, INSIDE)
    assert alone.elements == (1, 2, 4, 5)


def test_a_file_without_ids_is_asked_for_its_element_sets(two_layers, writer, write_post):
    sets = (("soft", 0, (1, 2, 4, 5), ()), ("stiff", 0, (3, 6), ()), ("n", 1, (7,), ()))
    path = file_of(two_layers, writer, write_post, revision=12, sets=sets)
    with pytest.raises(ResultError, match="node 7 lies between soft and stiff"):
        last_mpa(path, BETWEEN)
    assert last_mpa(path, IN_STIFF) == pytest.approx(STIFF_MPA)


def test_a_file_that_tells_no_layers_is_read_and_that_is_said(two_layers, writer, write_post):
    path = file_of(two_layers, writer, write_post, revision=12)
    said = []
    mean = (2 * SOFT_MPA + 2 * STIFF_MPA) / 4
    assert last_mpa(path, BETWEEN, tell=said.append) == pytest.approx(mean)
    assert "the file does not tell the materials of its elements" in said


def extended(*values):
    return "".join(f"{value:>10}" for value in values)


def deck_text(plane):
    """A deck of version 15 with a ``connectivity`` for each layer."""
    lines = [
        "title               job1",
        "extended",
        f"sizing              {extended(0, len(plane.elements), len(plane.nodes), 0)}",
        f"elements            {extended(plane.kind)}",
        f"version             {extended(15, 2, 0, 0)}",
        "table               " + extended(0, 0, 2, 1, 1, 0, 0, 1),
        "end",
    ]
    for layer in (0, 1):
        lines += ["connectivity", extended(0, 0, 1, 0, 1, layer + 1, 0, 1, 0)]
        lines += [
            extended(row + 1, plane.kind, *nodes)
            for row, (nodes, mine) in enumerate(zip(plane.elements, plane.layers, strict=True))
            if mine == layer
        ]
    lines += ["coordinates", extended(3, len(plane.nodes), 0, 1)]
    lines += [
        f"{node:>10}{x:>20.10f}{y:>20.10f}{0.0:>20.10f}" for node, (x, y) in plane.nodes.items()
    ]
    lines.append("end option")
    return "\n".join(lines) + "\n"


def test_the_deck_beside_tells_the_materials_of_a_file_without_ids(
    two_layers, writer, write_post, tmp_path
):
    path = tmp_path / "job.t16"
    path.write_bytes(file_of(two_layers, writer, write_post, revision=12).read_bytes())
    (tmp_path / "job.dat").write_text(deck_text(two_layers))
    with pytest.raises(ResultError, match="node 7 lies between material 1 and mat"):
        last_mpa(path, BETWEEN)
    assert last_mpa(path, INSIDE) == pytest.approx(SOFT_MPA)


@pytest.mark.parametrize("text", ["", "*NODE\n1, 0., 0.\n", "title\nconnectivity\n"])
def test_another_deck_beside_tells_nothing(text, two_layers, writer, write_post, tmp_path):
    path = tmp_path / "job.t16"
    path.write_bytes(file_of(two_layers, writer, write_post, revision=12).read_bytes())
    (tmp_path / "job.dat").write_text(text)
    mean = (2 * SOFT_MPA + 2 * STIFF_MPA) / 4
    assert last_mpa(path, BETWEEN) == pytest.approx(mean)


def test_a_collapsed_quadrilateral_counts_once_with_both_its_corners(writer, write_post):
    """Element 2 has node 2 at its corners 1 and 2: the mean of both is its share."""
    nodes = {1: (0, 0), 2: (1, 0), 3: (1, 1), 4: (0, 1), 5: (2, 1)}
    plane = models.Plane(11, nodes, [(1, 2, 3, 4), (2, 2, 5, 3)])
    rng = np.random.default_rng(3)
    values = rng.normal(size=(2, 4, 7))
    increments = [writer.Increment(number=0, element=values)]
    path = write_post(writer.Storage(real_bytes=8), plane.model(writer), increments)
    options = ReadOptions(extrapolate="translate")
    found = read_stress_tensor(path, [2], options)[1][0, 0] / 1e6
    second = (values[1, 0, 1:] + values[1, 1, 1:]) / 2
    assert_allclose(found, (values[0, 1, 1:] + second) / 2, rtol=1e-12)
    from fembridge.results.field_file import read_field

    field = read_field(path, "Stress", options=options)
    assert_allclose(field.at([2])[0] / 1e6, found, rtol=1e-12)
