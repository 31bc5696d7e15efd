"""Increments that are built alike are found by what stands between their values."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from fembridge.results.marc_format import repeats

SMALL_BYTES = 1 << 14
BINARY_AND_TEXT = pytest.mark.parametrize("binary", [True, False])


@pytest.fixture
def read_in_parts(monkeypatch):
    """Let an increment of more than `SMALL_BYTES` not be compared as a whole."""
    monkeypatch.setattr(repeats, "_SMALL_BYTES", SMALL_BYTES)


@pytest.fixture
def many(writer):
    """Give a function that makes a mesh of so many elements, and increments on it."""

    def make(increments, elements=2, every=1, nodes=4):
        model = writer.Model(
            node_ids=tuple(range(1, nodes + 1)),
            coordinates=tuple((float(node), 0.0) for node in range(nodes)),
            elements=tuple(
                (number, 11, (1, 2, 3, 4), (1, 1, 1, 2, 0)) for number in range(1, elements + 1)
            ),
        )
        points = np.arange(elements * 4.0).reshape(elements, 4, 1)
        made = []
        for place in range(increments):
            moved = np.arange(2.0 * nodes).reshape(nodes, 2) - place
            made.append(
                writer.Increment(
                    number=place,
                    time_s=place / 4,
                    element=points + place if place % every == 0 else None,
                    nodal=(writer.Quantity("Displacement", 1, 2, moved),),
                    variables=(("Completion", (float(place),)),),
                )
            )
        return model, made

    return make


def check(post, increments):
    assert (post.problem, post.unread_bytes) == (None, 0)
    assert len(post.increments) == len(increments)
    for row, expected in enumerate(increments):
        found = post.increments[row]
        assert (found.row, found.increment) == (row, expected.number)
        assert (found.time_s, found.title) == (expected.time_s, expected.title)
        assert found.has_element_values == (expected.element is not None)
        if found.has_element_values:
            last = len(expected.element) - 1
            values = post.element_values(row, np.array([last, 0]))
            assert_array_equal(values, expected.element[[last, 0]])
        quantity = expected.nodal[0]
        some = np.arange(len(quantity.values))[::-3]
        values = post.nodal_values(row, quantity.name, some)
        assert_array_equal(values, quantity.values[some])
        assert_array_equal(
            [*post.global_values(row).values()], [values for _, values in expected.variables]
        )


@BINARY_AND_TEXT
@pytest.mark.parametrize("every", [1, 2, 7])
def test_many_small_increments(binary, every, many, writer, write_post, open_post):
    model, increments = many(150, every=every)
    with open_post(write_post(writer.Storage(binary), model, increments)) as post:
        check(post, increments)


@BINARY_AND_TEXT
@pytest.mark.usefixtures("read_in_parts")
def test_increments_of_more_bytes_than_are_compared_as_a_whole(
    binary, many, writer, write_post, open_post
):
    model, increments = many(4, elements=300, nodes=1500)
    path = write_post(writer.Storage(binary), model, increments)
    assert path.stat().st_size > 5 * SMALL_BYTES
    with open_post(path) as post:
        check(post, increments)


@BINARY_AND_TEXT
@pytest.mark.parametrize(("elements", "nodes"), [(2, 200), (300, 1500)])
@pytest.mark.usefixtures("read_in_parts")
def test_one_of_another_kind_among_them_is_read_as_it_is(
    binary, elements, nodes, many, writer, write_post, open_post
):
    model, increments = many(7, elements=elements, nodes=nodes)
    moved = increments[4].nodal[0]
    other = (replace(moved, name="Velocity", code=28), moved)
    increments[4] = replace(increments[4], nodal=other, title="another", sub=3)
    increments[6] = replace(increments[6], variables=(("Completely", (6.0,)),))
    with open_post(write_post(writer.Storage(binary), model, increments)) as post:
        check(post, increments)
        names = [[held.name for held in made.nodal] for made in post.increments]
        assert names.pop(4) == ["Velocity", "Displacement"]
        assert names == [["Displacement"]] * 6
        sub = [made.sub_increment for made in post.increments]
        assert sub == [0, 0, 0, 0, 3, 0, 0]


@BINARY_AND_TEXT
def test_after_a_new_mesh_nothing_is_taken_for_granted(binary, many, writer, write_post, open_post):
    model, increments = many(12)
    finer, more = many(12, elements=5, nodes=7)
    more[3] = replace(more[3], new_model=finer)
    made = increments[:3] + more[3:]
    with open_post(write_post(writer.Storage(binary), model, made)) as post:
        check(post, made)
        assert [found.mesh for found in post.increments] == [0] * 3 + [1] * 9
        assert [len(mesh.node_ids) for mesh in post.meshes] == [4, 7]
        assert post.meshes[-1] is post.meshes[1]
        assert len(post.meshes[:]) == 2


@BINARY_AND_TEXT
def test_a_damaged_one_among_them_ends_the_walk_there(binary, many, writer, write_post, open_post):
    model, increments = many(200)
    path = write_post(writer.Storage(binary), model, increments)
    content = path.read_bytes()
    mark = b"=   b   e   g   =   5   2   4" if binary else b"=beg=524"
    at, digit = -1, 20 if binary else 5  # the first one of the number
    for _ in range(151):
        at = content.index(mark, at + 1)
    path.write_bytes(content[: at + digit] + b"x" + content[at + digit + 1 :])
    with open_post(path) as post:
        assert "of increment 150" in post.problem
        assert len(post.increments) == 150
        assert post.increments[149].time_s == 149 / 4
