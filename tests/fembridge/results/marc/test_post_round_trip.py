"""Random models, written as both kinds of post file and read again."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal


@settings(settings.get_profile("costly"))
@given(data=st.data())
def test_what_is_written_is_read_whatever_the_storage(
    data, writer, random_posts, write_post, open_post
):
    storage = data.draw(random_posts.storages(writer))
    model, increments = data.draw(random_posts.runs(writer))
    with open_post(write_post(storage, model, increments)) as post:
        assert post.kind == storage.name[-3:]
        assert post.revision == model.revision
        assert post.title == "job1"
        assert (post.problem, post.unread_bytes) == (None, 0)
        expected = ["revision 13"] * (model.revision == 13)
        strange = [model, *(made.new_model for made in increments if made.new_model)]
        expected += ["59900"] * any(made.strange_block for made in strange)
        assert len(post.remarks) == len(expected)
        for words in expected:
            assert any(words in remark for remark in post.remarks)
        assert len(post.increments) == len(increments)
        check_model(storage, model, post.meshes[0], post.codes)
        at, mesh = model, 0
        for row, (expected, found) in enumerate(zip(increments, post.increments, strict=True)):
            if expected.new_model:
                at, mesh = expected.new_model, mesh + 1
                check_model(storage, at, post.meshes[mesh], post.codes_of(row))
            assert (found.row, found.mesh) == (row, mesh)
            check_increment(storage, at, expected, post, found)
        assert len(post.meshes) == mesh + 1


def check_model(storage, model, mesh, codes):
    old = model.revision < 13
    assert mesh.node_ids.tolist() == list(model.node_ids)
    kept = storage.kept(model.coordinates)
    assert_array_equal(mesh.coordinates_mm[:, : model.dimensions], kept)
    assert not mesh.coordinates_mm[:, model.dimensions :].any()
    assert mesh.element_ids.tolist() == [element[0] for element in model.elements]
    assert mesh.element_types.tolist() == [element[1] for element in model.elements]
    for row, element in zip(mesh.connectivity.tolist(), model.elements, strict=True):
        assert row[: len(element[2])] == list(element[2])
        assert not any(row[len(element[2]) :])
    if model.elements and not old:
        assert mesh.extras.tolist() == [list(element[3]) for element in model.elements]
    for found, (name, kind, members, sides) in zip(mesh.sets, model.sets, strict=True):
        assert (found.name, found.members.tolist()) == (name, list(members))
        known = {0: "element", 1: "node", 12: "edge", 13: "face"}
        ordered = {18: "edge", 19: "face"}
        assert found.kind == {**known, **ordered}.get(kind, f"type {kind}")
        has_sides = kind in (12, 13, 18, 19)
        assert found.sides.tolist() == (list(sides) if has_sides else [])
    assert [(code.code, code.label) for code in codes] == [
        (code, label[:24].strip()) for code, _, label in model.codes
    ]


def check_increment(storage, model, expected, post, found):
    assert found.increment == expected.number
    assert found.sub_increment == expected.sub
    assert found.title == expected.title
    assert found.time_s == storage.kept(expected.time_s)
    assert (found.recycles, found.cut_backs) == (expected.recycles, expected.cut_backs)
    assert found.has_element_values == (expected.element is not None)
    if expected.element is not None:
        whole = storage.kept(expected.element)
        rows = np.arange(len(model.elements))
        for some in (rows, rows[::-1], rows[::2], rows[[0, -1, 0]]):
            values = post.element_values(found.row, some)
            assert_array_equal(values, whole[some])
    for quantity, held in zip(expected.nodal, found.nodal, strict=True):
        assert dataclasses.astuple(held) == (
            quantity.name,
            quantity.code,
            quantity.components,
            quantity.values is not None,
            quantity.imaginary,
        )
        whole = np.zeros((len(model.node_ids), quantity.components))
        if quantity.values is not None:
            whole = storage.kept(quantity.values)
        assert_array_equal(post.nodal_values(found.row, quantity.name), whole)
        rows = np.arange(len(whole))[::-2]
        some = post.nodal_values(found.row, quantity.name, rows)
        assert_array_equal(some, whole[rows])
    values = post.global_values(found.row)
    assert [*values] == [name for name, _ in expected.variables]
    for name, reals in expected.variables:
        assert_array_equal(values[name], storage.kept(reals))
    reals = [expected.time_s, 0.0, *expected.energies]
    assert_array_equal(post.energies(found.row), storage.kept(reals))


@pytest.mark.parametrize("binary", [True, False])
def test_a_quantity_or_element_values_that_are_not_there_are_named(
    binary, writer, write_post, open_post
):
    displacement = writer.Quantity("Displacement", 1, 2, np.ones((4, 2)))
    increment = writer.Increment(number=3, time_s=0.5, nodal=(displacement,))
    path = write_post(writer.Storage(binary), writer.Model(), [increment])
    with open_post(path) as post:
        with pytest.raises(Exception, match="no nodal quantity 'Velocity'; it has Dis"):
            post.nodal_values(0, "Velocity")
        with pytest.raises(Exception, match=r"increment 3 \(time 0.5 s\) has no elem"):
            post.element_values(0, np.array([0]))
        with pytest.raises(IndexError):
            post.nodal_values(0, "Displacement", np.array([4]))


@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize(
    ("revision", "code", "found"),
    [(14, (311, 2), (311, 2)), (14, (2311, 0), (311, 2)), (12, (2311, 0), (311, 2))],
)
def test_the_layer_of_a_code_is_its_own_number_or_its_thousands(
    binary, revision, code, found, writer, write_post, open_post
):
    model = writer.Model(codes=((*code, "Stress"),), revision=revision)
    with open_post(write_post(writer.Storage(binary), model)) as post:
        (held,) = post.codes
        assert (held.code, held.layer, held.label) == (*found, "Stress")
