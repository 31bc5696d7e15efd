"""Post files that are cut, changed or foreign: what was whole before, or words.

All cuts and 4000 changes where ``CI`` is set, a part of them elsewhere.
"""

import os
import struct

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from fembridge.errors import ResultError

CUT_STEP, CHANGES = (1, 4000) if os.environ.get("CI") == "true" else (37, 120)
STORAGES = [
    {"binary": True},
    {"binary": True, "big_endian": True, "real_bytes": 8},
    {"binary": False},
]


@pytest.fixture
def small_run(writer):
    """Two increments with all sorts of blocks on a mesh of one element."""

    def make(increments=2):
        model = writer.Model(
            sets=(("edges", 12, (7,), (2,)), ("held", 1, (1, 2), ())),
            codes=((17, 0, "Mises"), (311, 0, "")),
        )
        made = []
        for place in range(increments):
            values = np.arange(8.0).reshape(4, 2) + 10 * place
            made.append(
                writer.Increment(
                    number=place,
                    time_s=0.5 * place,
                    element=np.arange(8.0).reshape(1, 4, 2) + place,
                    nodal=(writer.Quantity("Displacement", 1, 2, values),),
                    variables=(("Completion", (50.0 * place,)),),
                )
            )
        return model, made

    return make


@pytest.mark.parametrize("how", STORAGES)
def test_a_cut_at_any_byte_leaves_the_whole_increments_before_it(
    how, writer, write_post, open_post, small_run
):
    model, increments = small_run()
    storage = writer.Storage(**how)
    path = write_post(storage, model, increments)
    whole = path.read_bytes()
    offered = set()
    ending = range(len(whole) - 20, len(whole))
    for size in [*range(0, len(whole) - 20, CUT_STEP), *ending]:
        path.unlink()  # else the disk is waited for
        path.write_bytes(whole[:size])
        try:
            post = open_post(path)
        except ResultError as error:
            assert str(path) in str(error)
            assert not offered  # once there is a model there is one
            continue
        with post:
            offered.add(len(post.increments))
            if post.problem is None:  # but for the end of the last line
                assert not how["binary"]
                assert whole[size:].strip() == b""
                assert post.unread_bytes == 0
            check_beginning(post, increments)
    assert offered == {0, 1, 2}


def check_beginning(post, increments):
    for row, expected in enumerate(increments[: len(post.increments)]):
        assert post.increments[row].time_s == expected.time_s
        values = post.nodal_values(row, "Displacement")
        assert_array_equal(values, expected.nodal[0].values)
        assert_array_equal(post.element_values(row, np.array([0])), expected.element)


def test_a_cut_names_block_increment_and_byte(writer, write_post, open_post, small_run):
    model, increments = small_run()
    path = write_post(writer.Storage(), model, increments)
    whole = path.read_bytes()
    at = whole.rindex(b"=   b   e   g   =   5   2   3")
    path.write_bytes(whole[: at + 300])
    with open_post(path) as post:
        assert "block 52300 of increment 1" in post.problem
        assert f"byte {at + 300}" in post.problem
        assert len(post.increments) == 1
        assert post.unread_bytes > 300


@pytest.mark.parametrize("how", STORAGES)
def test_changed_bytes_are_read_as_they_are_or_refused_in_words(
    how, writer, write_post, open_post, small_run
):
    model, increments = small_run(3)
    path = write_post(writer.Storage(**how), model, increments)
    whole, rng = path.read_bytes(), np.random.default_rng(7)
    read = refused = 0
    for _ in range(CHANGES):
        changed = bytearray(whole)
        for at in rng.integers(0, len(whole), rng.integers(1, 4)):
            kind = rng.integers(4)
            if kind == 0:
                changed[at] = rng.integers(256)
            elif kind == 1:
                changed[at] ^= 1 << rng.integers(8)
            elif kind == 2:
                changed[at : at + rng.integers(1, 9)] = b""
            else:
                changed[at : at + 4] = struct.pack("<i", 2**31 - 1)
        path.unlink()
        path.write_bytes(changed)
        try:
            with open_post(path) as post:
                read_all(post)
            read += 1
        except ResultError as error:
            assert str(path) in str(error)
            refused += 1
    assert read > CHANGES // 8
    assert refused > CHANGES // 20


def read_all(post):
    for mesh in post.meshes:
        assert len(mesh.node_ids) == len(mesh.coordinates_mm)
    for increment in post.increments:
        row = increment.row
        mesh = post.meshes[increment.mesh]
        if increment.has_element_values:
            post.element_values(row, np.arange(len(mesh.element_ids)))
        for quantity in increment.nodal:
            post.nodal_values(row, quantity.name)
        post.global_values(row)
        post.energies(row)


@pytest.mark.parametrize("how", STORAGES)
@pytest.mark.parametrize("word", range(30))
@pytest.mark.parametrize("count", [-1, 0, 2**31 - 1])
def test_a_count_that_lies_takes_no_memory(
    how, word, count, writer, write_post, open_post, small_run
):
    """Any of the verification integers, put to the least and most they can be."""
    model, increments = small_run()
    storage = writer.Storage(**how)
    path = write_post(storage, model, increments)
    whole = bytearray(path.read_bytes())
    if storage.binary:
        begin = b"=   b   e   g   =   5   0   2"
        at = whole.index(begin) - 4 + 288 + 4 + 4 * word + 8 * (word >= 18)
        whole[at : at + 4] = struct.pack(">i" if storage.big_endian else "<i", count)
    else:
        at = whole.index(b"\n", whole.index(b"=beg=50200")) + 1
        at += 13 * word + word // 6
        whole[at : at + 13] = f"{count:13d}".encode()
    path.write_bytes(whole)
    try:
        with open_post(path) as post:
            read_all(post)
    except ResultError as error:
        assert str(path) in str(error)


def test_a_file_without_its_end_may_still_be_written(writer, write_post, open_post, small_run):
    model, increments = small_run()
    path = write_post(writer.Storage(), model, increments, ended=False)
    with open_post(path) as post:
        assert "the run is going on, or was stopped" in post.problem
        assert len(post.increments) == 2
        assert post.unread_bytes == 0


@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize(("elements", "points"), [(1, 9), (1, 3), (3, 9), (3, 1)])
def test_element_values_of_another_count_are_left_out_and_remarked(
    binary, elements, points, writer, write_post, open_post
):
    """As would be if elements of fewer points than the most had fewer records."""
    stored = np.arange(elements * 4.0).reshape(elements, 4, 1)
    moved = writer.Quantity("Displacement", 1, 2, np.ones((4, 2)))
    model = writer.Model(
        elements=tuple((n, 11, (1, 2, 3, 4), (1,) * 5) for n in range(elements)), points=points
    )
    made = [writer.Increment(number=n, element=stored, nodal=(moved,)) for n in range(3)]
    with open_post(write_post(writer.Storage(binary), model, made)) as post:
        assert (post.problem, post.unread_bytes) == (None, 0)
        (remark,) = post.remarks
        assert "block 52300 of increment 0" in remark
        assert remark.endswith("left out, also in increments built alike")
        assert len(post.increments) == 3
        for increment in post.increments:
            assert not increment.has_element_values
            assert post.nodal_values(increment.row, "Displacement").all()


@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize("block", [b"507", b"508"])
def test_a_mesh_of_more_than_is_announced_is_refused(binary, block, writer, write_post, open_post):
    model = writer.Model(elements=((1, 11, (1, 2, 3, 4), (1,) * 5),) * 2)
    path = write_post(writer.Storage(binary), model)
    whole = path.read_bytes()
    if binary:
        at = whole.index(b"=   b   e   g   =   5   0   2") + 288
        at += 8 if block == b"507" else 4
        whole = whole[:at] + struct.pack("<i", 1) + whole[at + 4 :]
    else:
        old = f"{1:13d}{4:13d}{2:13d}".encode()
        counts = (4, 1) if block == b"507" else (1, 2)
        new = f"{1:13d}{counts[0]:13d}{counts[1]:13d}".encode()
        assert old in whole
        whole = whole.replace(old, new, 1)
    path.write_bytes(whole)
    with pytest.raises(ResultError, match=rf"more than 1 .*block {block.decode()}"):
        open_post(path)


def test_a_record_that_moved_inside_a_table_is_no_number(writer, write_post, open_post):
    """The walk looks at the first and the last record of a table, reading at all."""
    element = np.arange(32.0).reshape(8, 4, 1) + 1000
    model = writer.Model(elements=tuple((n, 11, (1, 2, 3, 4), (1,) * 5) for n in range(8)))
    path = write_post(writer.Storage(), model, [writer.Increment(element=element)])
    whole = path.read_bytes()
    at = whole.index(struct.pack("<f", 1009.0))  # the second point of element row 2
    path.write_bytes(whole[: at - 4] + struct.pack("<i", 5) + whole[at:])
    with open_post(path) as post:
        assert post.problem is None
        assert_array_equal(post.element_values(0, np.array([1, 3])), element[[1, 3]])
        with pytest.raises(ResultError, match=r"where .* is expected"):
            post.element_values(0, np.array([2]))


def test_bytes_behind_the_end_are_counted(writer, write_post, open_post, small_run):
    path = write_post(writer.Storage(), *small_run())
    path.write_bytes(path.read_bytes() + b"more")
    with open_post(path) as post:
        assert post.unread_bytes == 4
        assert post.remarks == ("4 bytes behind the end of the file",)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "empty, expected a post file"),
        (b"    1C\n", "begins with b'    1C"),
        (b"\x89PNG\r\n\x1a\n" * 99, "begins with b'.x89PNG"),
        (struct.pack("<i", 280) + b"j   o   b   ".ljust(280) * 2, "of Marc K7"),
        (struct.pack(">i", 280) + b"j   o   b   ".ljust(280) * 2, "of Marc K7"),
        (b"=beg=50100 (Analysis Title)\n", "no whole model: .*block 50100"),
        (b"=beg=abcde (Analysis Title)\n", "no whole model: .*has no number"),
    ],
)
def test_a_foreign_file_is_named_by_what_it_begins_with(content, words, tmp_path, open_post):
    path = tmp_path / "job.t16"
    path.write_bytes(content)
    with pytest.raises(ResultError, match=words):
        open_post(path)
