"""Post files of Marc: written from random models and read again, damaged, recorded."""

import os
import struct
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import post_writer as writer
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from opened import naming, opened_post

from fembridge.errors import ResultError
from fembridge.results import marc_post

SET_TYPES = (0, 1, 7, 12, 13, 18, 19)
REALS = st.floats(-1e30, 1e30).filter(lambda x: x == 0 or abs(x) > 1e-30)
NAMES = st.text("abcdefgh XYZ_0189", min_size=1, max_size=24).map(str.strip).filter(bool)


def storages():
    """Draw a way to store numbers."""
    return st.one_of(
        st.builds(writer.Storage, big_endian=st.booleans(), real_bytes=st.sampled_from((4, 8))),
        st.builds(writer.Storage, binary=st.just(False), line_end=st.sampled_from(("\n", "\r\n"))),
    )


@st.composite
def random_models(draw):
    """Draw a small model: mixed elements, pressure nodes, sets of all types."""
    ids = draw(st.lists(st.integers(1, 99_999), min_size=1, max_size=9, unique=True))
    dimensions = draw(st.sampled_from((2, 3)))
    place = st.tuples(*[REALS] * dimensions)
    node = st.sampled_from(ids)
    extras = st.lists(st.integers(0, 40), min_size=5, max_size=5).map(tuple)
    element = st.tuples(
        st.integers(1, 99_999),
        st.sampled_from((11, 80, 27, 6)),
        st.lists(node, min_size=1, max_size=9).map(tuple),
        extras,
    )
    members = st.lists(st.integers(1, 99_999), max_size=15)
    sets = [
        (name, kind, tuple(some), tuple(range(len(some))))
        for name, kind, some in draw(
            st.lists(st.tuples(NAMES, st.sampled_from(SET_TYPES), members), max_size=3)
        )
    ]
    label = st.text("abcdefgh ", max_size=24).map(str.strip)
    code = st.tuples(st.integers(1, 900), st.just(0), label)
    return writer.Model(
        node_ids=tuple(ids),
        coordinates=tuple(draw(place) for _ in ids),
        elements=tuple(draw(st.lists(element, max_size=5))),
        points=draw(st.sampled_from((1, 3, 4, 9))),
        codes=tuple(draw(st.lists(code, max_size=8))),
        sets=tuple(sets),
        dimensions=dimensions,
        revision=draw(st.sampled_from((12, 13, 14))),
        strange_block=draw(st.booleans()),
    )


@st.composite
def runs(draw):
    """Draw a model and increments."""
    model, count = draw(random_models()), draw(st.integers(0, 6))
    seed = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    return model, tuple(
        replace(draw(increments_of(model, seed)), number=place) for place in range(count)
    )


@st.composite
def increments_of(draw, model, seed):
    """Draw one increment on `model`, with numbers from `seed`."""
    shape = len(model.elements), model.points, len(model.codes)
    element = None
    if draw(st.booleans()) and model.codes and model.elements:
        element = seed.normal(size=shape) * 10.0 ** seed.integers(-20, 20, size=shape)
    nodal = []
    for name, code in (("Displacement", 1), ("External Force", 3), ("Contact", 34)):
        components = draw(st.integers(1, 3))
        values = None
        if draw(st.booleans()):
            values = seed.normal(size=(len(model.node_ids), components))
        nodal.append(writer.Quantity(name, code, components, values, draw(st.booleans())))
    variables = [("Completion", [*seed.normal(size=2)]), ("fix", [0.5])]
    return writer.Increment(
        sub=draw(st.integers(0, 2)),
        time_s=draw(st.floats(0, 100)),
        title=draw(st.sampled_from(("lcase1", "lcase2"))),
        element=element,
        nodal=tuple(nodal[: draw(st.integers(0, 3))]),
        variables=tuple(variables[: draw(st.integers(0, 2))]),
        loads=tuple(seed.normal(size=draw(st.integers(0, 3)))),
    )


@settings(settings.get_profile("costly"))
@given(data=st.data())
def test_what_is_written_is_read_whatever_the_storage(data, write_post):
    storage = data.draw(storages())
    model, increments = data.draw(runs())
    with opened_post(write_post(storage, model, increments)) as post:
        assert post.kind == storage.name[-3:]
        assert post.revision == model.revision
        assert post.title == "job1"
        assert post.problem is None
        expected = ["revision 13"] * (model.revision == 13)
        expected += ["59900"] * model.strange_block
        assert len(post.remarks) == len(expected)
        for words in expected:
            assert any(words in remark for remark in post.remarks)
        assert len(post.increments) == len(increments)
        check_model(storage, model, post.mesh, post.codes)
        for row, (expected, found) in enumerate(zip(increments, post.increments, strict=True)):
            assert found.row == row
            check_increment(storage, model, expected, post, found)


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
    for found, (name, kind, members, _) in zip(mesh.sets, model.sets, strict=True):
        assert (found.name, found.members.tolist()) == (name, list(members))
        known = {0: "element", 1: "node", 12: "edge", 13: "face"}
        ordered = {18: "edge", 19: "face"}
        assert found.kind == {**known, **ordered}.get(kind, f"type {kind}")
    assert [(code.code, code.label) for code in codes] == [
        (code, label[:24].strip()) for code, _, label in model.codes
    ]


def check_increment(storage, model, expected, post, found):
    assert found.increment == expected.number
    assert found.sub_increment == expected.sub
    assert found.time_s == storage.kept(expected.time_s)
    assert found.has_element_values == (expected.element is not None)
    if expected.element is not None:
        whole = storage.kept(expected.element)
        rows = np.arange(len(model.elements))
        for some in (rows, rows[::-1], rows[::2], rows[[0, -1, 0]]):
            values = post.element_values(found.row, some)
            assert_array_equal(values, whole[some])
    for quantity, held in zip(expected.nodal, found.nodal, strict=True):
        for name in ("name", "code", "components"):
            assert getattr(held, name) == getattr(quantity, name)
        assert held.is_complex == quantity.imaginary
        assert (held.numbers is None) == (quantity.values is None)
        whole = np.zeros((len(model.node_ids), quantity.components))
        if quantity.values is not None:
            whole = storage.kept(quantity.values)
        assert_array_equal(post.nodal_values(found.row, quantity.name), whole)


@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize(
    ("revision", "code", "found"),
    [(14, (311, 2), (311, 2)), (14, (2311, 0), (311, 2)), (12, (2311, 0), (311, 2))],
)
def test_the_layer_of_a_code_is_its_own_number_or_its_thousands(
    binary, revision, code, found, write_post
):
    model = writer.Model(codes=((*code, "Stress"),), revision=revision)
    with opened_post(write_post(writer.Storage(binary), model)) as post:
        (held,) = post.codes
        assert (held.code, held.layer, held.label) == (*found, "Stress")


SMALL_BYTES = 1 << 14
BINARY_AND_TEXT = pytest.mark.parametrize("binary", [True, False])


@pytest.fixture
def read_in_parts(monkeypatch):
    """Let an increment of more than `SMALL_BYTES` not be compared as a whole."""
    monkeypatch.setattr(marc_post, "_SMALL_INCREMENT_BYTES", SMALL_BYTES)


@pytest.fixture
def many():
    """Give a function that makes a mesh of so many elements, and increments on it."""

    def make(increments, elements=2, every=1, nodes=4, **changes):
        model = writer.Model(
            node_ids=tuple(range(1, nodes + 1)),
            coordinates=tuple((float(node), 0.0) for node in range(nodes)),
            elements=tuple(
                (number, 11, (1, 2, 3, 4), (1, 1, 1, 2, 0)) for number in range(1, elements + 1)
            ),
            **changes,
        )
        shape = elements, 4, len(model.codes)
        points = np.arange(float(np.prod(shape))).reshape(shape)
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


def check_beginning(post, increments):
    for row, (found, expected) in enumerate(zip(post.increments, increments, strict=False)):
        assert (found.row, found.increment) == (row, expected.number)
        assert found.time_s == expected.time_s
        assert found.has_element_values == (expected.element is not None)
        if found.has_element_values:
            last = len(expected.element) - 1
            values = post.element_values(row, np.array([last, 0]))
            assert_array_equal(values, expected.element[[last, 0]])
        quantity = expected.nodal[0]
        assert_array_equal(post.nodal_values(row, quantity.name), quantity.values)


@BINARY_AND_TEXT
@pytest.mark.parametrize(("elements", "nodes"), [(2, 200), (300, 1500)])
@pytest.mark.usefixtures("read_in_parts")
def test_one_of_another_kind_among_them_is_read_as_it_is(binary, elements, nodes, many, write_post):
    model, increments = many(7, elements=elements, nodes=nodes)
    moved = increments[4].nodal[0]
    other = (replace(moved, name="Velocity", code=28), moved)
    increments[4] = replace(increments[4], nodal=other, title="another", sub=3)
    increments[6] = replace(increments[6], variables=(("Completely", (6.0,)),))
    with opened_post(write_post(writer.Storage(binary), model, increments)) as post:
        assert (post.problem, len(post.increments)) == (None, len(increments))
        check_beginning(post, increments)
        names = [[held.name for held in made.nodal] for made in post.increments]
        assert names.pop(4) == ["Velocity", "Displacement"]
        assert names == [["Displacement"]] * 6
        sub = [made.sub_increment for made in post.increments]
        assert sub == [0, 0, 0, 0, 3, 0, 0]


@BINARY_AND_TEXT
def test_the_walk_ends_where_a_new_mesh_comes(binary, many, write_post):
    model, increments = many(12)
    finer, more = many(12, elements=5, nodes=7)
    more[3] = replace(more[3], new_model=finer)
    made = increments[:3] + more[3:]
    with opened_post(write_post(writer.Storage(binary), model, made)) as post:
        assert "of increment 3" in post.problem
        assert [one.increment for one in post.increments] == [0, 1, 2]


@BINARY_AND_TEXT
def test_a_damaged_one_among_them_ends_the_walk_there(binary, many, write_post):
    model, increments = many(70)
    path = write_post(writer.Storage(binary), model, increments)
    content = path.read_bytes()
    mark = b"=   b   e   g   =   5   2   4" if binary else b"=beg=524"
    at, digit = -1, 20 if binary else 5  # the first one of the number
    for _ in range(51):
        at = content.index(mark, at + 1)
    path.write_bytes(content[: at + digit] + b"x" + content[at + digit + 1 :])
    with opened_post(path) as post:
        assert "of increment 50" in post.problem
        assert len(post.increments) == 50
        assert post.increments[49].time_s == 49 / 4


# Words as a real file of post revision 12 has them, with lines of our own numbers.
TWO_NODES = """\
=beg=50100 (Analysis Title)
          by hand
=end=
=beg=50200 (Analysis Verification Data)
            2            2            1            2            2            9
            1            0            2            2            2            0
            0           12            0            0            0            0
            0            0            0            0            0            0
            0            0            0            0            0            0
=end=
=beg=50600 (Element Variable Postcodes)
            7
           17
=end=
=beg=50700 (Element Connectivities)
            4            9            2           30           10
=end=
=beg=50800 (Nodal Coordinates)
           10 0.100000E+01-0.200000E+01
           30-0.100000E-99 0.300000-100
=end=
****
=beg=51600 (Loadcase Title)
          job1
=end=
=beg=51701 (Integer Increment Verification Data)
            0            3            0          102            2            0
            0            1            0            0            0            0
=end=
=beg=51801 (Real Increment Verification Data)
            2
 0.250000E+01 0.000000E+00
=end=
=beg=52300 (Element Integration Point Values)
-0.100000E+01-0.200000D+01
 0.300000E+01          NaN
=end=
=beg=52401 (Nodal Results)
            1            2
Displacement
            1            0            0            2            0            0
           -1            0            0            0            0            0
 0.100000E+00 0.200000E+00 0.300000+100-0.400000E+00
=end=
----
++++
"""


@pytest.mark.parametrize(
    "change",
    [
        lambda line: line,
        lambda line: line + "\r",
        lambda line: line.ljust(80),
        lambda line: line + "\n" * (line == "=end="),
    ],
    ids=["as it is", "CRLF", "padded", "empty lines"],
)
def test_exponents_without_a_letter_touching_numbers_and_any_line_ends_are_read(change, file):
    text = "".join(change(line) + "\n" for line in TWO_NODES.splitlines())
    with opened_post(file("job.t19", text)) as post:
        assert (post.problem, post.remarks) == (None, [])
        assert post.mesh.node_ids.tolist() == [10, 30]
        assert post.mesh.coordinates_mm.tolist() == [[1, -2, 0], [-1e-100, 3e-101, 0]]
        assert post.mesh.connectivity.tolist() == [[30, 10]]
        assert_array_equal(post.element_values(0, np.array([0])), [[[-1, -2], [3, np.nan]]])
        moved = post.nodal_values(0, "Displacement")
        assert moved.tolist() == [[0.1, 0.2], [3e99, -0.4]]
        assert post.increments[0].time_s == 2.5


# Printed with five digits (E10.4), from single precision.
RTOL = 6e-5


def status_rows(path):
    """Read rows of a status file: increment, time, greatest displacement."""
    rows = []
    for line in path.read_text(encoding="latin-1").splitlines():
        words = line.split()
        if len(words) == 13 and words[0].isdigit():
            numbers = [float(word) for word in words]
            rows.append((numbers[1], numbers[10], numbers[12]))
    return np.array(rows)


@pytest.mark.parametrize(
    ("name", "increments", "nodes", "elements", "codes"),
    [("nour_linear", 2, 18, 8, 0), ("nour_plastic", 24, 85, 64, 6)],
)
def test_every_byte_of_a_run_is_read_and_agrees_with_its_status_file(
    name, increments, nodes, elements, codes, marc_samples
):
    listed = status_rows(marc_samples / f"{name}.sts")
    assert len(listed) == increments
    with opened_post(marc_samples / f"{name}.t16") as post:
        assert (post.problem, post.remarks) == (None, [])
        assert (post.kind, post.revision, post.byte_order) == ("t16", 14, "little")
        assert (post.precision, post.points, len(post.codes)) == ("single", 1, codes)
        mesh = post.mesh
        assert mesh.node_ids.shape == (nodes,)
        assert mesh.coordinates_mm.shape == (nodes, 3)
        assert mesh.connectivity.shape == (elements, 4)
        assert set(mesh.element_types) == {114}
        assert np.isin(mesh.connectivity, mesh.node_ids).all()
        for row, (number, time_s, maximum) in enumerate(listed):
            increment = post.increments[row]
            assert increment.increment == number
            assert_allclose(increment.time_s, time_s, rtol=RTOL)
            moved = np.linalg.norm(post.nodal_values(row, "Displacement"), axis=1)
            assert_allclose(moved.max(), maximum, rtol=RTOL)


IN_CI = os.environ.get("CI") == "true"
CUT_STEP = 1 if IN_CI else 197
STORAGES = [
    {"binary": True},
    {"binary": True, "big_endian": True, "real_bytes": 8},
    {"binary": False},
]


@pytest.fixture
def small_run(many):
    """Two increments with all sorts of blocks on a mesh of one element."""
    sets = (("edges", 12, (1,), (2,)), ("held", 1, (1, 2), ()))
    return many(2, elements=1, sets=sets, codes=((17, 0, "Mises"), (311, 0, "")))


@pytest.mark.parametrize("how", STORAGES)
def test_a_cut_at_any_byte_leaves_the_whole_increments_before_it(how, write_post, small_run):
    model, increments = small_run
    storage = writer.Storage(**how)
    path = write_post(storage, model, increments)
    whole = path.read_bytes()
    offered = set()
    ending = range(len(whole) - 20, len(whole))
    for size in [*range(0, len(whole) - 20, CUT_STEP), *ending]:
        path.unlink()  # else the disk is waited for
        path.write_bytes(whole[:size])
        try:
            stack = ExitStack()
            post = stack.enter_context(opened_post(path))
        except ResultError as error:
            assert str(path) in str(error)
            assert not offered  # once there is a model there is one
            continue
        with stack:
            offered.add(len(post.increments))
            if post.problem is None:  # but for the end of the last line
                assert not how["binary"]
                assert whole[size:].strip() == b""
            check_beginning(post, increments)
    assert offered == {0, 1, 2}


def read_all(post):
    assert len(post.mesh.node_ids) == len(post.mesh.coordinates_mm)
    for increment in post.increments:
        if increment.has_element_values:
            post.element_values(increment.row, np.arange(len(post.mesh.element_ids)))
        for quantity in increment.nodal:
            post.nodal_values(increment.row, quantity.name)


@pytest.mark.parametrize("how", STORAGES)
@pytest.mark.parametrize("count", [-1, 0, 2**31 - 1])
def test_a_count_that_lies_takes_no_memory(how, count, write_post, small_run):
    """Any of the verification integers, put to the least and most they can be."""
    storage = writer.Storage(**how)
    path = write_post(storage, *small_run)
    whole = path.read_bytes()
    for word in range(0, 30, 1 if IN_CI else 4):
        changed = bytearray(whole)
        if storage.binary:
            begin = b"=   b   e   g   =   5   0   2"
            at = whole.index(begin) - 4 + 288 + 4 + 4 * word + 8 * (word >= 18)
            changed[at : at + 4] = struct.pack(">i" if storage.big_endian else "<i", count)
        else:
            at = whole.index(b"\n", whole.index(b"=beg=50200")) + 1
            at += 13 * word + word // 6
            changed[at : at + 13] = f"{count:13d}".encode()
        path.unlink()
        path.write_bytes(changed)
        try:
            with opened_post(path) as post:
                read_all(post)
        except ResultError as error:
            assert str(path) in str(error)


@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize(("elements", "points"), [(1, 9), (1, 3), (3, 9), (3, 1)])
def test_element_values_of_another_count_are_left_out_and_remarked(
    binary, elements, points, write_post
):
    """As would be if elements of fewer points than the most had fewer records."""
    stored = np.arange(elements * 4.0).reshape(elements, 4, 1)
    moved = writer.Quantity("Displacement", 1, 2, np.ones((4, 2)))
    model = writer.Model(
        elements=tuple((n, 11, (1, 2, 3, 4), (1,) * 5) for n in range(elements)), points=points
    )
    made = [writer.Increment(number=n, element=stored, nodal=(moved,)) for n in range(3)]
    with opened_post(write_post(writer.Storage(binary), model, made)) as post:
        assert post.remarks == []
        remark = post.problem
        assert "block 52300 of increment 0" in remark
        assert len(post.increments) == 3
        for increment in post.increments:
            assert not increment.has_element_values
            assert post.nodal_values(increment.row, "Displacement").all()


def test_a_record_that_moved_inside_a_table_is_no_number(write_post):
    """The walk looks at the first and the last record of a table, reading at all."""
    element = np.arange(32.0).reshape(8, 4, 1) + 1000
    model = writer.Model(elements=tuple((n, 11, (1, 2, 3, 4), (1,) * 5) for n in range(8)))
    path = write_post(writer.Storage(), model, [writer.Increment(element=element)])
    whole = path.read_bytes()
    at = whole.index(struct.pack("<f", 1009.0))  # the second point of element row 2
    path.write_bytes(whole[: at - 4] + struct.pack("<i", 5) + whole[at:])
    with opened_post(path) as post:
        assert post.problem is None
        assert_array_equal(post.element_values(0, np.array([1, 3])), element[[1, 3]])
        with pytest.raises(ResultError, match=naming(path.name, "bytes")):
            post.element_values(0, np.array([2]))


@pytest.mark.parametrize(
    ("content", "shown"),
    [
        (b"", ()),
        (b"    1C\n", (repr(b"    1C\n"),)),
        (b"\x89PNG\r\n\x1a\n" * 99, ("=beg=50100",)),
        (struct.pack("<i", 280) + b"j   o   b   ".ljust(280) * 2, ("K7",)),
        (struct.pack(">i", 280) + b"j   o   b   ".ljust(280) * 2, ("K7",)),
        (b"=beg=50100 (Analysis Title)\n", ("block 50100",)),
        (b"=beg=abcde (Analysis Title)\n", ("'=beg=abcde (Analysis Title)'",)),
    ],
)
def test_a_foreign_file_is_named_by_what_it_begins_with(content, shown, file):
    path = file("job.t16", content)
    with pytest.raises(ResultError, match=naming("job.t16", *shown)), opened_post(path):
        pass
