"""Every kind of section in a ``.dat`` of CalculiX, and tables of prints."""

import gzip
import os
import re
from dataclasses import replace
from functools import partial

import numpy as np
import opened
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from opened import naming, rows_of, shows

from fembridge.errors import ResultError
from fembridge.results import describe, printed
from fembridge.results.printed import dat_sections, print_rows, read_point_history
from fembridge.results.read_options import ReadOptions
from fembridge.results.von_mises import von_mises_pa

CUT_STEP = 1 if os.environ.get("CI") == "true" else 5
STRESSES = " stresses (elem, integ.pnt.,sxx,syy,szz,sxy,sxz,syz) for set EP and time  0.5000000E-03"


def test_total_force_is_the_sum_of_the_nodal_forces(samples):
    path = samples / "cpe4_ascii.dat"
    times_ms, _, total_n = printed.read_node_print(path, "total force", "NTOP")
    same_ms, nodes, forces_n = printed.read_node_print(path, "forces", "ntop")
    assert_allclose(times_ms, [0.5, 1.0, 1.5, 2.0], rtol=1e-12)
    assert_allclose(same_ms, times_ms, rtol=0)
    assert nodes.tolist() == [44, 45, 46, 47]
    assert_allclose(total_n[:, 0], forces_n.sum(axis=1), rtol=1e-6, atol=1e-9)
    assert_allclose(total_n[0, 0, 1], -1.466055e-02, rtol=0)


def test_integration_points_tell_two_layers_apart_where_nodes_do_not(samples):
    """E of 0.05 and 2 MPa, nu 0.3, stretched alike, plane strain, free above:
    stress s along it, nu s across the plane, so sqrt(1 - nu + nu²) s of von Mises.
    """
    _, points, tensor_pa = printed.read_point_stress(samples / "interface_cpe8r.dat", "EALL")
    along_pa = tensor_pa[-1, :, 0]
    assert points.shape == (along_pa.size, 2)
    assert set(np.round(along_pa).astype(int)) == {549, 21978}
    mises_pa = von_mises_pa(tensor_pa)[-1]
    assert_allclose(mises_pa, np.sqrt(1 - 0.3 + 0.3**2) * along_pa, rtol=1e-5)


def test_the_shears_leave_in_the_order_of_the_result_file(tmp_path):
    path = tmp_path / "job.dat"
    numbers = "".join(f" {value:13.6E}" for value in range(1, 7))
    path.write_text(f"\n{STRESSES}\n\n         1   1{numbers}\n")
    _, _, tensor_pa = printed.read_point_stress(path, "EP", ReadOptions(stress_unit="Pa"))
    assert tensor_pa.tolist() == [[[1, 2, 3, 4, 6, 5]]]  # xx yy zz xy yz zx


DISPLACEMENTS = " displacements (vx,vy,vz) for set N1 and time  {:.7E}"
EIGENVALUES = "     E I G E N V A L U E   O U T P U T"


def print_of(sections, before="", suffix=""):
    """A ``.dat`` with one record of three numbers at each time in s."""
    numbers = "".join(f" {value:13.6E}" for value in (1, 2, 3))
    texts = [
        f"\n{DISPLACEMENTS.format(time_s)}\n\n{7:10}{numbers}{suffix}\n" for time_s in sections
    ]
    return f"\n{before}\n{''.join(texts)}"


@pytest.mark.parametrize("suffix", [" L", " _shell_0000000006   ", " Mine-1  "])
def test_records_in_local_axes_are_read_with_a_remark(tmp_path, suffix):
    """ccx 2.20 writes L after *TRANSFORM and the name of an orientation after stress."""
    path = tmp_path / "job.dat"
    path.write_text(print_of([1.0], suffix=suffix))
    remarks = []
    [section] = dat_sections(path, lambda *_: True, ReadOptions(on_remark=remarks.append))
    assert section.labels.tolist() == [[7]]
    assert section.values.tolist() == [[1.0, 2.0, 3.0]]
    assert len(remarks) == 1
    assert "local" in str(remarks[0])


def test_a_steady_state_repeats_its_times_and_other_steps_do_not(tmp_path):
    """Each frequency of a *STEADY STATE DYNAMICS, HARMONIC=NO has a period of its own."""
    path = tmp_path / "job.dat"
    times_s = [0.0, 0.1, 0.0, 0.05]
    path.write_text(print_of(times_s, before=EIGENVALUES))
    _, *rows = print_rows(path, ReadOptions(on_remark=lambda remark: None))
    assert [row[0] for row in rows[::3]] == [0.0, 100.0, 0.0, 50.0]
    with pytest.raises(ResultError):
        printed.read_node_print(path, "displacements", "N1")
    path.write_text(print_of(times_s))
    with pytest.raises(ResultError, match="comes after 100 ms"):
        list(print_rows(path, ReadOptions()))


def test_a_section_of_a_mode_has_no_time():
    section = printed.DatSection("stresses", "EP", (), 2500.0, is_over_time=False)
    assert str(section) == "stresses for set EP at 2.5 Hz"
    assert str(replace(section, mode=3)) == "stresses for set EP of mode 3"


def test_every_cut_is_an_error_or_a_true_beginning(samples, tmp_path):
    """Cut at a line end, a section is one record short or wholly absent."""
    path = tmp_path / "cut.dat"
    whole = (samples / "cpe4_ascii.dat").read_bytes()
    head = whole[: whole.index(b" stresses")]
    later = whole[whole.index(b" displacements", len(head)) :]
    run = head + later[: later.index(b" stresses")]
    path.write_bytes(run)
    _, _, forces_n = printed.read_node_print(path, "forces", "NTOP")
    counts = set()
    for size in range(len(run) - 1, -1, -CUT_STEP):
        os.truncate(path, size)
        try:
            _, _, some_n = printed.read_node_print(
                path, "forces", "NTOP", ReadOptions(partial=True)
            )
        except ResultError:
            continue
        counts.add(len(some_n))
        shared = min(some_n.shape[1], 4)
        assert_allclose(some_n[:, :shared], forces_n[: len(some_n), :shared], rtol=0)
    assert counts == {1, 2}


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


def as_fortran(value):
    """Print one value as Fortran does: an exponent of three digits has no E."""
    return re.sub(r"E([+-]\d{3})$", r"\1", f"{value:.6E}").rjust(13)


def record(labels, values):
    words = labels.split()
    text = f"{words[0]:>10}" if words else "      "
    text += f" {words[1]:>3}" if len(words) > 1 else ""
    return text + "".join(f" {as_fortran(value)}" for value in values) + "\n"


def sections_of(path, options=None):
    options = options or ReadOptions()
    return list(dat_sections(path, lambda *_: True, options))


@pytest.fixture
def dat(file):
    """A function that writes a ``.dat`` and gives its path."""
    return partial(file, "job.dat")


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
    assert (section.mode, section.is_over_time) == (7, False)
    _, row, *_ = print_rows(path, ReadOptions())
    assert row[:4] == ("", 7, "displacements", "N")


def test_tables_of_another_kind_are_said_once(dat, logged):
    logged = logged
    text = "     E I G E N V A L U E   O U T P U T\n\n MODE NO  X\n\n      1   0.4E+04\n"
    assert sections_of(dat(text), ReadOptions()) == []
    assert len(logged) == 1
    assert shows(logged[0], "line 1", "E I")


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
    with pytest.raises(ResultError, match=naming("job.dat:4", "displacements")):
        sections_of(dat(f"\n {KINDS[0][0]}\n\n{line}\n"))


@pytest.mark.parametrize(
    ("place", "shown"),
    [
        ((1, 9), (1, 9, 1, 8)),
        ((99, 1), (99, 1, 1)),
    ],
)
def test_a_point_that_is_not_printed_is_named(samples, place, shown):
    with pytest.raises(ResultError, match=naming("cpe4_ascii.dat", *shown)):
        read_point_history(samples / "cpe4_ascii.dat", [place])


def test_two_sets_of_stresses_have_to_be_distinguished(dat):
    row = record("21 3", REALS[:6])
    header = KINDS[3][0]
    path = dat(f"\n {header}\n\n{row}\n {header.replace('set N', 'set M')}\n\n{row}")
    with pytest.raises(ResultError, match=naming("stresses", 2, "N", "M")):
        read_point_history(path, [(21, 3)])


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


MOVED, SPRINGS = (f" {kinds[0][0]}\n\n" for kinds in (KINDS, CONTACT))
MOVED_LATER, SPRINGS_LATER = (
    head.replace("0.5000000E-03", "0.1000000E-02") for head in (MOVED, SPRINGS)
)
GOOD, SPRING = record("11", REALS[:3]), record("21 5", REALS[:3])


def write_table(path, output, quantity=None, **options):
    return opened.write_table(path, output, ReadOptions(**options), quantity)[1]


@pytest.mark.parametrize(
    ("stress_unit", "stress_pa", "length"), [("MPa", 1515.402, "mm"), ("kPa", 1.515402, "deck")]
)
def test_a_dat_becomes_a_row_a_number_with_its_unit(
    samples, tmp_path, stress_unit, stress_pa, length
):
    """Of a deck in another unit stress is in Pa, and the rest as it is."""
    output = tmp_path / "t.csv"
    count = write_table(samples / "cpe4_ascii.dat", output, stress_unit=stress_unit)
    rows = rows_of(output)
    assert count == len(rows)
    first = {row["quantity"]: row for row in reversed(rows)}
    stress, total = first["stresses"], first["total force"]
    assert (stress["element"], stress["point"], stress["node"]) == ("1", "1", "")
    assert float(stress["value"]) == pytest.approx(stress_pa)
    assert (stress["unit"], first["displacements"]["unit"]) == ("Pa", length)
    assert (total["node"], total["set"], total["time_ms"]) == ("", "NTOP", "0.5")


def test_one_quantity_can_be_taken_and_an_absent_one_is_named(samples, tmp_path):
    output = tmp_path / "t.csv"
    assert write_table(samples / "cpe4_ascii.dat", output, "total force") == 12
    assert {row["quantity"] for row in rows_of(output)} == {"total force"}
    with pytest.raises(ResultError):
        write_table(samples / "cpe4_ascii.dat", output, "temperatures")
    assert len(rows_of(output)) == 12  # what stood there stays


@pytest.mark.parametrize("odd", ["NaN", "Infinity", "-Infinity"])
def test_a_value_that_is_no_number_is_named_or_its_section_left_out(dat, odd, logged):
    bad = f"        12{odd:>14}  1.000000E+00  1.000000E+00\n"
    path = dat(f"\n{MOVED}{GOOD}{GOOD}\n{MOVED_LATER}{GOOD}{bad}")
    output = path.with_name("t.csv")
    shown = naming("displacements", "N", "1 ms", 12, "vx", str(float(odd)))
    with pytest.raises(ResultError, match=shown):
        write_table(path, output)
    logged = logged
    assert write_table(path, output, partial=True) == 6
    assert re.search(shown, logged[0])


def test_a_contact_print_may_have_fewer_records_at_the_end(dat):
    path = dat(f"\n{SPRINGS}{SPRING}{SPRING}\n{SPRINGS_LATER}{SPRING}")
    assert write_table(path, path.with_name("t.csv")) == 9


def test_a_line_that_is_still_being_written_is_said(samples, tmp_path, file, logged):
    path = file("job.sta", (samples / "cpe4_ascii.sta").read_bytes()[:-20])
    logged = logged
    assert write_table(path, tmp_path / "t.csv") == 3
    assert shows(logged[0], "line 6")
    assert "line 6" in describe(path)["problem"]


def test_a_status_file_is_read_out_of_gzip_and_is_no_result_of_its_folder(samples, tmp_path):
    content = (samples / "cpe4_ascii.sta").read_bytes()
    (tmp_path / "job.sta.gz").write_bytes(gzip.compress(content))
    assert write_table(tmp_path / "job.sta.gz", tmp_path / "t.csv") == 4
    (tmp_path / "job.sta").write_bytes(content)
    with pytest.raises(ResultError, match=naming("job.frd")):
        describe(tmp_path)
    (tmp_path / "job.csv").write_text("time,value\n0,1\n1,2\n")
    assert describe(tmp_path)["format"] == "table"
