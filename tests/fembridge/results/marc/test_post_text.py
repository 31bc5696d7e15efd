"""Formatted post files: numbers that touch, lines that were changed on the way."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from fembridge.errors import ResultError

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


@pytest.fixture
def write_text(tmp_path):
    def write(text):
        path = tmp_path / "job.t19"
        path.write_bytes(text.encode())
        return path

    return write


def check_two_nodes(post):
    assert (post.problem, post.remarks, post.unread_bytes) == (None, (), 0)
    mesh = post.meshes[0]
    assert mesh.node_ids.tolist() == [10, 30]
    assert mesh.coordinates_mm.tolist() == [[1, -2, 0], [-1e-100, 3e-101, 0]]
    assert mesh.connectivity.tolist() == [[30, 10]]
    values = post.element_values(0, np.array([0]))
    assert_array_equal(values, [[[-1, -2], [3, np.nan]]])
    moved = post.nodal_values(0, "Displacement")
    assert moved.tolist() == [[0.1, 0.2], [3e99, -0.4]]
    assert post.increments[0].time_s == 2.5


def test_exponents_without_a_letter_and_numbers_that_touch(write_text, open_post):
    with open_post(write_text(TWO_NODES)) as post:
        check_two_nodes(post)


@pytest.mark.parametrize(
    "change",
    [
        lambda line: line + "\r",
        lambda line: line.ljust(80),
        lambda line: line + " " * (len(line) % 3),
        lambda line: line + "\r" * (len(line) % 2),
        lambda line: line + "\n" * (line == "=end="),
    ],
    ids=["CRLF", "padded", "uneven", "mixed ends", "empty lines"],
)
def test_line_ends_and_blanks_at_them_change_nothing(change, write_text, open_post):
    text = "".join(change(line) + "\n" for line in TWO_NODES.splitlines())
    with open_post(write_text(text)) as post:
        check_two_nodes(post)


def test_tables_of_uneven_lines_are_read_row_by_row(writer, write_post, open_post):
    model = writer.Model(
        node_ids=tuple(range(1, 30)),
        coordinates=tuple((float(node), 0.5) for node in range(1, 30)),
        codes=tuple((code, 0, "") for code in range(311, 319)),
        elements=((1, 11, (1, 2, 3, 4), (0,) * 5), (2, 11, (1, 2, 3, 4), (0,) * 5)),
    )
    element = np.arange(64.0).reshape(2, 4, 8)
    moved = np.arange(87.0).reshape(29, 3)
    quantity = writer.Quantity("Displacement", 1, 3, moved)
    increment = writer.Increment(element=element, nodal=(quantity,))
    path = write_post(writer.Storage(binary=False), model, [increment])
    rng = np.random.default_rng(3)
    lines = path.read_text().splitlines()
    path.write_text("".join(line + " " * rng.integers(4) + "\n" for line in lines))
    with open_post(path) as post:
        assert (post.problem, post.unread_bytes) == (None, 0)
        assert post.meshes[0].coordinates_mm[:, 0].tolist() == [*range(1, 30)]
        rows = np.array([1, 0])
        assert_array_equal(post.element_values(0, rows), element[rows])
        rows = np.array([28, 3, 3])
        assert_array_equal(post.nodal_values(0, "Displacement", rows), moved[rows])
        assert_array_equal(post.nodal_values(0, "Displacement"), moved)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("-0.200000E+01", "-0.2000_0E+01", "belong to no number"),
        ("-0.200000E+01", "-0.2000x0E+01", "where a real is expected"),
        ("           30           10", "           3O           10", "invalid literal"),
    ],
)
def test_what_is_no_number_is_shown(old, new, words, write_text, open_post):
    path = write_text(TWO_NODES.replace(old, new, 1))
    with open_post(path) as post, pytest.raises(ResultError, match=words):
        assert post.meshes[0]


def test_a_block_that_is_built_otherwise_is_left_out_and_remarked(write_text, open_post):
    text = TWO_NODES.replace("           -1            0", "            1            0")
    with open_post(write_text(text)) as post:
        assert (post.problem, post.unread_bytes) == (None, 0)
        (remark,) = post.remarks
        assert "'Displacement' of 2 components with flag 1" in remark
        assert "block 52401 of increment 3" in remark
        assert post.increments[0].nodal == ()
        assert post.element_values(0, np.array([0])).shape == (1, 2, 2)


def test_lines_that_a_known_block_has_more_are_remarked(write_text, open_post):
    after = "-0.400000E+00\n"
    text = TWO_NODES.replace(after, f"{after}            5\n")
    with open_post(write_text(text)) as post:
        (remark,) = post.remarks
        assert "block 52401 of increment 3: more than is known" in remark
        assert post.nodal_values(0, "Displacement").shape == (2, 2)
