"""Prints of CalculiX: total force, nodes, integration points."""

import os
import shutil

import numpy as np
import pytest
from numpy.testing import assert_allclose

from fembridge.errors import ResultError
from fembridge.results.frd import read_displacement
from fembridge.results.printed import dat
from fembridge.results.read_options import ReadOptions
from fembridge.results.stress import von_mises_pa

CUT_STEP = 1 if os.environ.get("CI") == "true" else 5
STRESSES = " stresses (elem, integ.pnt.,sxx,syy,szz,sxy,sxz,syz) for set EP and time  0.5000000E-03"


def test_total_force_is_the_sum_of_the_nodal_forces(samples):
    path = samples / "cpe4_ascii.dat"
    times_ms, total_n = dat.read_total_force(path, "NTOP")
    same_ms, nodes, forces_n = dat.read_node_print(path, "forces", "ntop")
    assert_allclose(times_ms, [0.5, 1.0, 1.5, 2.0], rtol=1e-12)
    assert_allclose(same_ms, times_ms, rtol=0)
    assert nodes.tolist() == [44, 45, 46, 47]
    assert_allclose(total_n, forces_n.sum(axis=1), rtol=1e-6, atol=1e-9)
    assert_allclose(total_n[0, 1], -1.466055e-02, rtol=0)


def test_printed_displacement_is_that_of_the_result_file(samples):
    _, nodes, moved_mm = dat.read_node_print(samples / "cpe4_ascii.dat", "displacements", "PROBES")
    _, stored_mm = read_displacement(samples / "cpe4_ascii.frd", nodes.tolist())
    assert_allclose(moved_mm, stored_mm, rtol=5e-6, atol=1e-15)


def test_integration_points_tell_two_layers_apart_where_nodes_do_not(samples):
    """E of 0.05 and 2 MPa, nu 0.3, stretched alike, plane strain, free above:
    stress s along it, nu s across the plane, so sqrt(1 - nu + nu²) s of von Mises.
    """
    _, points, tensor_pa = dat.read_point_stress(
        samples / "interface_cpe8r.dat", section_set(samples / "interface_cpe8r.dat")
    )
    along_pa = tensor_pa[-1, :, 0]
    assert points.shape == (along_pa.size, 2)
    assert set(np.round(along_pa).astype(int)) == {549, 21978}
    mises_pa = von_mises_pa(tensor_pa)[-1]
    assert_allclose(mises_pa, np.sqrt(1 - 0.3 + 0.3**2) * along_pa, rtol=1e-5)


def section_set(path):
    with pytest.raises(ResultError) as caught:
        dat.read_sections(path, "nothing")
    held = str(caught.value).partition("it holds ")[2].split("; ")
    return next(name for name in held if name.startswith("stresses")).split()[-1]


def test_the_shears_leave_in_the_order_of_the_result_file(tmp_path):
    path = tmp_path / "job.dat"
    numbers = "".join(f" {value:13.6E}" for value in range(1, 7))
    path.write_text(f"\n{STRESSES}\n\n         1   1{numbers}\n")
    _, _, tensor_pa = dat.read_point_stress(path, "EP", ReadOptions(stress_unit="Pa"))
    assert tensor_pa.tolist() == [[[1, 2, 3, 4, 6, 5]]]  # xx yy zz xy yz zx


def test_contact_prints_keep_element_and_face(samples):
    sections = dat.read_sections(samples / "cpe4_ascii.dat", "contact stress")
    assert [section.time_ms for section in sections] == [0.5, 1.0, 1.5, 2.0]
    assert sections[0].columns == ("press", "tang1", "tang2")
    assert sections[0].labels[0].tolist() == [21, 5]
    assert_allclose(sections[0].values[0, 0], 2.196991e-02, rtol=0)


def test_an_old_spelling_and_a_fortran_exponent_are_read(tmp_path):
    path = tmp_path / "job.dat"
    path.write_text(
        "\n total force (fx,fy,fz) forset TOP and time  0.1000000E-02\n\n"
        "        1.000000-101 -2.500000E+00  0.000000E+00\n"
    )
    times_ms, force_n = dat.read_total_force(path, "TOP")
    assert times_ms.tolist() == [1.0]
    assert force_n.tolist() == [[1.0e-101, -2.5, 0.0]]


def test_a_set_that_is_absent_is_named_beside_those_there(samples):
    with pytest.raises(ResultError, match=r"no total force for set NBOT.*total force for set NTOP"):
        dat.read_total_force(samples / "cpe4_ascii.dat", "NBOT")


def test_a_missing_file_is_an_error(tmp_path):
    with pytest.raises(ResultError, match="no such file"):
        dat.read_total_force(tmp_path / "job.dat", "TOP")


def test_every_cut_is_an_error_or_a_true_beginning(samples, tmp_path):
    """Cut at a line end, a section is one record short or wholly absent."""
    path = tmp_path / "cut.dat"
    whole = (samples / "cpe4_ascii.dat").read_bytes()
    head = whole[: whole.index(b" stresses")]
    later = whole[whole.index(b" displacements", len(head)) :]
    run = head + later[: later.index(b" stresses")]
    path.write_bytes(run)
    _, _, forces_n = dat.read_node_print(path, "forces", "NTOP")
    counts = set()
    for size in range(len(run) - 1, -1, -CUT_STEP):
        os.truncate(path, size)
        try:
            _, _, some_n = dat.read_node_print(path, "forces", "NTOP", ReadOptions(partial=True))
        except ResultError:
            continue
        counts.add(len(some_n))
        shared = min(some_n.shape[1], 4)
        assert_allclose(some_n[:, :shared], forces_n[: len(some_n), :shared], rtol=0)
    assert counts == {1, 2}


def test_a_record_cut_inside_is_refused_unless_partial(samples, tmp_path):
    path = tmp_path / "job.dat"
    shutil.copy(samples / "cpe4_ascii.dat", path)
    content = path.read_bytes()
    end = content.rindex(b" 47 ", 0, content.rindex(b" total force")) + 20
    path.write_bytes(content[:end])
    with pytest.raises(ResultError, match="cut inside a line"):
        dat.read_node_print(path, "forces", "NTOP")
    heard = []
    options = ReadOptions(partial=True, tell=heard.append)
    times_ms, _, _ = dat.read_node_print(path, "forces", "NTOP", options)
    assert times_ms.tolist() == [0.5, 1.0, 1.5]
    assert any("dropped forces at 2 ms" in words for words in heard)


def test_a_word_in_a_record_is_refused_by_line(tmp_path):
    path = tmp_path / "job.dat"
    path.write_text(f"\n{STRESSES}\n\n         1   1  0.1e\n")
    with pytest.raises(ResultError, match=r"job\.dat:4: no record"):
        dat.read_point_stress(path, "EP")
