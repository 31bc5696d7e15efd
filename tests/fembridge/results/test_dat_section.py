"""Prints of every kind in a ``.dat``, as CalculiX 2.11 and 2.20 write them."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fembridge.errors import ResultError
from fembridge.results.printed.dat import read_point_traces
from fembridge.results.printed.dat_section import dat_sections
from fembridge.results.printed.print_tables import print_table_of
from fembridge.results.read_options import ReadOptions

AT = "and time  0.5000000E-03"
REALS = [1.25, -2.5e-3, 3.0, 4.0e10, -5.0e-30, 6.0, 7.0]
# Header, labels of a record, count of its values, then: quantity, columns, labels.
KINDS = [
    (f"displacements (vx,vy,vz) for set N {AT}", "11", 3,
     "displacements", "vx vy vz", "node"),
    (f"forces (fx,fy,fz) forset N {AT}", "11", 3, "forces", "fx fy fz", "node"),
    (f"total force (fx,fy,fz) for set N {AT}", "", 3, "total force", "fx fy fz", ""),
    (f"stresses (elem, integ.pnt.,sxx,syy,szz,sxy,sxz,syz) for set N {AT}", "21 3", 6,
     "stresses", "sxx syy szz sxy sxz syz", "element point"),
    (f"mechanical strains (elem, integ.pnt.,exx,eyy,ezz,exy,exz,eyz) for set N {AT}",
     "21 3", 6, "mechanical strains", "exx eyy ezz exy exz eyz", "element point"),
    (f"equivalent plastic strain (elem, integ.pnt.,pe)for set N {AT}", "21 3", 1,
     "equivalent plastic strain", "pe", "element point"),
    (f"internal energy density (elem, integ.pnt.,eneset N {AT}", "21 3", 1,
     "internal energy density", "ene", "element point"),
    (f"internal state variables (elem, integ.pnt.,values) for set N {AT}", "21 3", 7,
     "internal state variables", [f"values{k}" for k in range(1, 8)], "element point"),
    (f"heat flux (elem, integ.pnt.,qx,qy,qz) for setN {AT}", "21 3", 3,
     "heat flux", "qx qy qz", "element point"),
    (f"internal energy (element, energy) for set N {AT}", "21", 1,
     "internal energy", "energy", "element"),
    (f"mass (element, mass) and mass moment of itertia(xx,yy,zz,xy,xz,yz) for set N "
     f"{AT}", "21", 7, "mass", "mass xx yy zz xy xz yz", "element"),
    (f"center of gravity for set N {AT}", "", 3, "center of gravity", "x y z", ""),
    (f"total volume for set N {AT}", "", 1, "total volume", ["total volume"], ""),
    (f"temperatures for set N {AT}", "11", 1, "temperatures", "temperatures", "node"),
    (f"network pressures (total pressure for gases, static for liquids) for set N {AT}",
     "11", 1, "network pressures", ["network pressures"], "node"),
]  # fmt: skip
CONTACT = [
    ("contact stress (slave element+face,press,tang1,tang2) for all contact elements "
     "and time 0.5000000E-03", "21 5", 3,
     "contact stress", "press tang1 tang2", "element face"),
    ("relative contact displacement (slave node,normal,tang1,tang2) for all contact "
     "elements and time 0.5000000E-03", "11", 3,
     "relative contact displacement", "normal tang1 tang2", "node"),
    ("contact print energy (slave element+face,energy)for all contact elements and "
     "time 0.5000000E-03", "21 5", 1, "contact print energy", "energy", "element face"),
]  # fmt: skip
STATISTICS = """
 statistics for slave set SSKIN, master set MIND and time  0.5000000E-03

   total surface force (fx,fy,fz) and moment about the origin (mx,my,mz)

    2.465882E-17 -1.466055E-02 -9.524675E-20  2.535678E-17 -2.811623E-18 -2.199083E-02

   area,  normal force (+ = tension) and shear force (size)

    6.446008E-01 -1.466055E-02  2.465886E-17

 total number of contact elements for time  0.5000000E-03

               54
"""


def printed(value):
    """Print one value as Fortran does: an exponent of three digits has no E."""
    return re.sub(r"E([+-]\d{3})$", r"\1", f"{value:.6E}").rjust(13)


def record(labels, values):
    words = labels.split()
    text = f"{words[0]:>10}" if words else "      "
    text += f" {words[1]:>3}" if len(words) > 1 else ""
    return text + "".join(f" {printed(value)}" for value in values) + "\n"


def sections_of(path, options=None):
    options = options or ReadOptions()
    return list(dat_sections(path, lambda *_: True, options))


@pytest.fixture
def dat(tmp_path):
    """A function that writes a ``.dat`` and gives its path."""

    def write(text):
        path = tmp_path / "job.dat"
        path.write_text(text)
        return path

    return write


@pytest.mark.parametrize(
    ("header", "labels", "count", "quantity", "columns", "label_names"), [*KINDS, *CONTACT]
)
def test_a_print_of_any_kind_is_read(dat, header, labels, count, quantity, columns, label_names):
    rows = record(labels, REALS[:count]) + record(labels, REALS[:count][::-1])
    (section,) = sections_of(dat(f"\n {header}\n\n{rows}"))
    names = columns.split() if isinstance(columns, str) else columns
    assert (section.quantity, section.columns) == (quantity, tuple(names))
    assert section.label_names == tuple(label_names.split())
    assert section.labels.tolist() == [[int(w) for w in labels.split()]] * 2
    assert section.values.tolist() == [REALS[:count], REALS[:count][::-1]]
    assert section.time_ms == 0.5
    assert section.set_name in ("N", "all contact elements")


def test_statistics_of_contact_become_sections_of_their_set(dat):
    force, area, number = sections_of(dat(STATISTICS))
    assert (force.quantity, force.set_name) == ("surface force", "SSKIN, master set MIND")
    assert force.columns == ("fx", "fy", "fz", "mx", "my", "mz")
    assert area.columns == ("area", "normal force", "shear force")
    assert area.values.tolist() == [[0.6446008, -1.466055e-02, 2.465886e-17]]
    assert (number.quantity, number.values.tolist()) == (
        "total number of contact elements",
        [[54.0]],
    )


def test_modes_have_a_number_and_no_time(dat, tmp_path):
    head = "                    E I G E N V A L U E    N U M B E R     7\n\n\n"
    path = dat(f"{head} {KINDS[0][0]}\n\n{record('11', REALS[:3])}")
    (section,) = sections_of(path)
    assert (section.mode, section.over_time) == (7, False)
    row = next(iter(print_table_of(path).rows(path, ReadOptions(), None)))
    assert row[:4] == ("", 7, "displacements", "N")


def test_tables_of_another_kind_are_told_once(dat):
    heard = []
    text = "     E I G E N V A L U E   O U T P U T\n\n MODE NO  X\n\n      1   0.4E+04\n"
    assert sections_of(dat(text), ReadOptions(tell=heard.append)) == []
    assert len(heard) == 1
    assert heard[0].startswith("tables of another kind are left out, from line 1: E I")


@pytest.mark.parametrize(
    "line",
    [
        "        1_1  1.0000000E+00",
        "         11  1.000000E+00  2.000000E+00",
        "             1.000000E+00  2.000000E+00  3.000000E+00",
        "         11 0x1.000000E+0  2.000000E+00  3.000000E+00",
        "        1_1  1.000000E+00  2.000000E+00  3.000000E+00",
    ],
)
def test_a_line_that_is_no_record_is_refused_by_number(dat, line):
    with pytest.raises(ResultError, match=r"job\.dat:4: no record of displacements"):
        sections_of(dat(f"\n {KINDS[0][0]}\n\n{line}\n"))


def test_traces_at_points_carry_element_and_point_in_their_number(samples):
    (trace,) = read_point_traces(samples / "cpe4_ascii.dat", [(13, 4)])
    assert trace.node == 1304
    assert (trace.start_ms, trace.dt_ms, trace.stress_pa.size) == (0.5, 0.5, 4)


@pytest.mark.parametrize(
    ("place", "words"),
    [
        ((1, 9), "element 1, point 9 is not printed: it has 1 to 8"),
        ((99, 1), "element 99, point 1 is not printed: elements are 1 to"),
    ],
)
def test_a_point_that_is_not_printed_is_named(samples, place, words):
    with pytest.raises(ResultError, match=words):
        read_point_traces(samples / "cpe4_ascii.dat", [place])


def test_two_sets_of_stresses_have_to_be_told_apart(dat):
    row = record("21 3", REALS[:6])
    header = KINDS[3][0]
    path = dat(f"\n {header}\n\n{row}\n {header.replace('set N', 'set M')}\n\n{row}")
    with pytest.raises(ResultError, match="there for 2 sets, N, M: name one"):
        read_point_traces(path, [(21, 3)])


@given(
    values=st.lists(
        st.lists(st.floats(-1e30, 1e30), min_size=3, max_size=3), min_size=1, max_size=9
    )
)
def test_any_printed_number_comes_back(tmp_path_factory, values):
    path = tmp_path_factory.mktemp("dat") / "job.dat"
    rows = "".join(record(str(n), row) for n, row in enumerate(values, start=1))
    path.write_text(f"\n {KINDS[0][0]}\n\n{rows}")
    (section,) = sections_of(path)
    expected = [[float(f"{value:.6E}") for value in row] for row in values]
    assert np.array_equal(section.values, np.array(expected))
