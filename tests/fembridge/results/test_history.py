"""What a file holds at nodes, row by row as it is: uneven, one alone, several steps, modes."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from opened import as_modes, naming, shows
from scipy.interpolate import PchipInterpolator

import fembridge as fb
from fembridge.errors import FembridgeWarning, ResultError, UsageError
from fembridge.results.von_mises import von_mises_pa

TENSOR = (0.003, -0.001, 0.002, 0.0005, -0.0002, 0.0001)
UNEVEN_S = (0.1, 0.2, 0.35, 0.7, 1.0)


def stresses(block, times_s, step=1):
    """A tensor at nodes 1 and 3 that grows with time, and is twice as large at node 3."""
    return [
        block("STRESS", k, t, [(n, [n * t * x for x in TENSOR]) for n in (1, 3)], flag=3, step=step)
        for k, t in enumerate(times_s, start=1)
    ]


def test_uneven_increments_are_rows_and_no_trace_until_they_are_resampled(write_frd, block):
    path = write_frd(stresses(block, UNEVEN_S))
    table = fb.read_history(path, [3])
    assert list(table) == ["time_ms", "afferent", "node", "von_mises_pa"]
    assert_allclose(table["time_ms"], np.multiply(UNEVEN_S, 1e3))
    expected_pa = von_mises_pa(np.multiply.outer(3e6 * np.array(UNEVEN_S), TENSOR))
    assert_allclose(table["von_mises_pa"], expected_pa, rtol=1e-12)
    with pytest.raises(
        ResultError, match=naming("written.frd", 3, "100 to 200 ms", "--resample-ms 0.5")
    ):
        fb.read(path, [3])
    [trace] = fb.read(path, [3], resample_ms=50.0)
    assert (trace.start_ms, trace.dt_ms, trace.stress_pa.size) == (100.0, 50.0, 19)


def test_it_is_the_tensor_that_is_resampled(write_frd, block):
    """Its shear changes sign: von Mises stress between two samples is less than at either."""
    rows = [(0.1, 0.001), (0.2, -0.002), (0.5, 0.003)]
    blocks = [
        block("STRESS", k, t, [(1, (0, 0, 0, shear, 0, 0))], flag=3)
        for k, (t, shear) in enumerate(rows, start=1)
    ]
    path = write_frd(blocks)
    table = fb.read_history(path, [1], resample_ms=10.0)
    times_ms, shear_pa = np.array(rows).T * [[1e3], [1e6]]
    shear_pa = PchipInterpolator(times_ms, shear_pa)(table["time_ms"])
    assert_allclose(table["von_mises_pa"], np.sqrt(3) * np.abs(shear_pa), atol=1e-9)
    assert table["von_mises_pa"].min() < 200 < np.sqrt(3) * 1000
    principal = fb.read_history(path, [1], quantity="principal", resample_ms=10.0)
    assert list(principal) == [
        "time_ms", "afferent", "node", "principal_1_pa", "principal_2_pa", "principal_3_pa",
    ]  # fmt: skip
    assert_allclose(principal["principal_1_pa"], np.abs(shear_pa), atol=1e-9)
    greatest = fb.read_history(path, [1], quantity="max-shear", resample_ms=10.0)
    assert_allclose(greatest["max_shear_pa"], np.abs(shear_pa), atol=1e-9)
    mean = fb.read_history(path, [1], quantity="mean-stress", resample_ms=10.0)
    assert_allclose(mean["mean_stress_pa"], 0, atol=1e-9)


@pytest.mark.parametrize("times_s", [(0.25,), (0.1, 0.2, 0.25), (0.1, 0.2, 0.2)])
@pytest.mark.filterwarnings("ignore:.*times do not rise:fembridge.FembridgeWarning")
def test_one_increment_a_short_last_one_and_equal_times_are_rows(write_frd, block, times_s):
    path = write_frd(stresses(block, times_s))
    table = fb.read_history(path, "all")
    assert table["node"].tolist() == [1] * len(times_s) + [3] * len(times_s)
    assert_allclose(table["time_ms"], 2 * [1e3 * t for t in times_s])
    if len(times_s) == 1:
        with pytest.raises(ResultError, match=naming("written.frd")):
            fb.read_history(path, [1], resample_ms=0.5)


def test_steps_follow_each_other_and_one_without_stress_is_left_out(write_frd, block, logged):
    moved = block("DISP", 1, 1.5, [(1, (1, 2, 3)), (3, (4, 5, 6))], step=2)
    path = write_frd([*stresses(block, (0.5, 1.0)), moved, *stresses(block, (2.0, 4.0), step=3)])
    said = logged
    table = fb.read_history(path, [1], quantity="stress")
    assert table["step"].tolist() == [1, 1, 3, 3]
    assert table["increment"].tolist() == [1, 2, 1, 2]
    assert_allclose(table["szx_pa"], np.array([0.5, 1, 2, 4]) * TENSOR[5] * 1e6, rtol=1e-12)
    assert any(shows(line, "STRESS", "step 2") for line in said)
    table = fb.read_history(path, [3], quantity="displacement")
    assert table[["d1_mm", "d2_mm", "d3_mm"]].to_numpy().tolist() == [[4, 5, 6]]


def test_a_file_of_displacements_or_of_anything_else_gives_those(write_frd, block):
    path = write_frd([block("DISP", 1, 0.5, [(2, (1, 2, 3))])])
    assert fb.read_history(path, [2])["d3_mm"].tolist() == [3]
    with pytest.raises(ResultError, match=naming("written.frd", "STRESS", "DISP")):
        fb.read_history(path, [2], quantity="von-mises")
    path = write_frd([block("NDTEMP", 1, 0.5, [(2, (20.5,))], components=("T",))])
    for quantity in (None, "temperature", "ndtemp", "NDT"):
        assert fb.read_history(path, [2], quantity=quantity)["t"].tolist() == [20.5]


@pytest.mark.parametrize(("code", "column"), [(b" 2", "frequency_hz"), (b" 4", "buckling_factor")])
def test_modes_are_rows_of_their_number_and_value(write_frd, block, code, column):
    path = as_modes(write_frd(stresses(block, (0.25, 2.5))), code)
    table = fb.read_history(path, [3])
    assert list(table) == ["step", "mode", column, "node", "von_mises_pa"]
    assert table[column].tolist() == [0.25, 2.5]
    with pytest.raises(UsageError, match=naming("written.frd", "resample_ms")):
        fb.read_history(path, [3], resample_ms=1.0)


def test_the_state_that_buckles_is_before_mode_1(write_frd, block):
    """CalculiX numbers outputs through all steps, and writes this state with the factor 0."""
    content = as_modes(write_frd(stresses(block, (0.0, 48.0, 106.0))), b" 4").read_bytes()
    path = write_frd(stresses(block, (1.0,)))
    path.write_bytes(content)
    table = fb.read_history(path, [3])
    assert table["mode"].tolist() == [0, 1, 2]
    assert table["buckling_factor"].tolist() == [0, 48, 106]


def test_where_there_are_times_modes_are_asked_for(write_frd, block, logged):
    timed = stresses(block, (0.5, 1.0))
    path = write_frd([*timed, *stresses(block, (7.0, 8.0), step=2)])
    content = path.read_bytes()
    at = content.rindex(b"    1PSTEP", 0, content.index(b" 7.0000000000"[:8]))
    tail = Path(path.with_name("tail.frd"))
    tail.write_bytes(content[at:])
    path.write_bytes(content[:at] + as_modes(tail).read_bytes())
    said = logged
    assert fb.read_history(path, [1])["time_ms"].tolist() == [500, 1000]
    assert any(shows(line, 2, "STRESS", "--modes") for line in said)
    table = fb.read_history(path, [1], modes=True)
    assert table["frequency_hz"].tolist() == [7, 8]
    with pytest.raises(UsageError, match=naming("timed.frd", "modes")):
        fb.read_history(write_frd(timed, "timed.frd"), [1], modes=True)


def test_every_node_is_one_row_an_output_that_has_it(write_frd, block):
    blocks = [
        block("NDTEMP", 1, 0.5, [(2, (20.0,)), (1, (10.0,))], components=("T",)),
        block("NDTEMP", 2, 1.0, [(3, (31.0,)), (2, (21.0,))], components=("T",)),
    ]
    table = fb.read_history(write_frd(blocks), "all")
    assert table[["node", "time_ms", "t"]].to_numpy().tolist() == [
        [1, 500, 10], [2, 500, 20], [2, 1000, 21], [3, 1000, 31],
    ]  # fmt: skip
    path = write_frd(blocks)
    with pytest.raises(ResultError, match=naming("written.frd", 3, "NDTEMP")):
        fb.read_history(path, [3])
    with pytest.raises(ResultError, match=naming(path.name, 3, "500 ms")):
        fb.read_history(path, "all", resample_ms=1.0)


def test_every_node_leaves_out_those_between_materials(samples, logged):
    path, said = samples / "interface_cpe8r.frd", logged
    inside = fb.read_history(path, "all")
    every = fb.read_history(path, "all", across_materials=True)
    gone = set(every["node"]) - set(inside["node"])
    assert {29, 33, 37} <= gone
    assert any(shows(line, f"{len(gone)} of {every['node'].nunique()}") for line in said)
    with pytest.raises(ResultError, match=naming("interface_cpe8r.frd", 29)):
        fb.read_history(path, [29, 1])
    shared = every[every["node"].isin(inside["node"])].reset_index(drop=True)
    pd.testing.assert_frame_equal(shared, inside.reset_index(drop=True))


HEADING = b"    1UHash: wQ2k, Date: 04/23/2022, Unit system: M_KG_S_C             \n"


def test_the_heading_tells_the_units_of_its_file(write_frd, block, logged):
    blocks = [
        block("DISP", 1, 0.5, [(1, (0.001, 0, 0))], flag=3),
        block("STRESS", 1, 0.5, [(1, (5e3, 0, 0, 0, 0, 0))], flag=3),
        block("FORC", 1, 0.5, [(1, (2.0, 0, 0))], flag=3, components=("F1", "F2", "F3")),
    ]
    path, said = write_frd(blocks), logged
    plain = path.read_bytes()
    path.write_bytes(plain.replace(b"    1C\n", b"    1C\n" + HEADING, 1))

    def first(quantity, **units):
        found = fb.read_history(path, [1], quantity=quantity, **units)
        return float(found.iloc[0, -3 if quantity != "von-mises" else -1])

    assert first("von-mises") == pytest.approx(5e3)
    assert first("displacement") == pytest.approx(1.0)
    assert first("reaction-force") == pytest.approx(2.0)
    assert any("M_KG_S_C: length in m, stress in Pa" in line for line in said)
    near = fb.read_history(path, near_mm=[(1000.0, 0.0)])
    assert near["node"].tolist() == [1]
    assert "node 1 at 1000, 0, 0 mm away" in said[-1]
    assert next(fb.read_fields(path, "DISP")).component("D1")[0] == pytest.approx(1.0)
    path.write_bytes(plain)
    assert first("displacement") == pytest.approx(0.001)
    assert first("displacement", length_unit="m") == pytest.approx(1.0)
    assert first("reaction-force", length_unit="in") == pytest.approx(2 * 4.4482216152605)
    with pytest.warns(FembridgeWarning, match="above 1 GPa"):
        assert first("von-mises") == pytest.approx(5e9)
    said.clear()
    assert first("von-mises", length_unit="m") == pytest.approx(5e3)
    assert not said


def test_the_real_part_of_amplitudes_says_so_and_gives_displacement(write_frd, block, logged):
    values = [(1, (1.0, 2.0, 3.0))]
    names = ("D1", "D2", "D3")
    blocks = [
        *stresses(block, (5.0,)),
        block(
            "STRESSI", 1, 5.0, [(1, TENSOR)], components=("SXX", "SYY", "SZZ", "SXY", "SYZ", "SZX")
        ),
        block("DISP", 1, 5.0, values),
        block("DISPI", 1, 5.0, values, components=names),
    ]
    said = logged
    table = fb.read_history(write_frd(blocks), [1])
    assert list(table)[:4] == ["step", "mode", "frequency_hz", "node"]
    assert table["frequency_hz"].tolist() == [5.0]
    assert any(shows(line, "DISP", "DISPI") for line in said)
    assert "frequency_hz" in fb.read_history(write_frd(blocks), [1], quantity="DISPI")


def test_a_blank_line_and_a_block_that_is_closed_and_empty_do_no_harm(write_frd, block, logged):
    path = write_frd([*stresses(block, (0.5,)), block("DISP", 1, 0.5, [], count=4)])
    path.write_bytes(path.read_bytes().replace(b"    1PSTEP", b"\n    1PSTEP", 1))
    said = logged
    assert len(fb.read_history(path, [1])) == 1
    assert any(shows(line, "DISP of step 1, increment 1", 4) for line in said)


def test_chosen_nodes_are_those_of_all(samples):
    path = samples / "cpe4_bin_f32.frd"
    for quantity in ("stress", "displacement", "reaction-force", "strain", "CONTACT"):
        every = fb.read_history(path, "all", quantity=quantity, across_materials=True)
        some = fb.read_history(path, [25, 11], quantity=quantity)
        for node in (11, 25):
            here = (one[one["node"] == node].drop(columns="node") for one in (every, some))
            assert_array_equal(*(one.select_dtypes("number").to_numpy() for one in here))
