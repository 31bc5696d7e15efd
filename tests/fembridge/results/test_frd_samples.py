"""Recorded runs of CalculiX, each ended in its own way."""

import hashlib
import json
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from fembridge.errors import ResultError
from fembridge.results import frd, read
from fembridge.results.byte_file import ByteFile
from fembridge.results.frd_format.index import index_frd
from fembridge.results.read_options import ReadOptions
from fembridge.results.stress import von_mises_pa

SAMPLES = Path(__file__).parents[3] / "fixtures" / "frd_samples"
EXPECTED = json.loads((SAMPLES / "expected.json").read_text())
INDEXED = [name for name, row in EXPECTED.items() if "datasets" in row]
WITH_STRESS = [name for name, row in EXPECTED.items() if "von_mises_at_nodes" in row]
LENIENT = ReadOptions(partial=True, across_materials=True)


def index_of(path):
    with ByteFile(path) as file:
        return index_frd(file)


def test_the_samples_are_those_that_were_recorded():
    sums = tomllib.loads((SAMPLES / "RUN.toml").read_text())["sha256"]
    found = {name: hashlib.sha256((SAMPLES / name).read_bytes()).hexdigest() for name in sums}
    assert found == sums


@pytest.mark.parametrize("name", INDEXED)
def test_the_index_lists_what_another_reader_listed(name):
    index, expected = index_of(SAMPLES / name), EXPECTED[name]
    found = [(block, block.records) for block in index.blocks]
    found += [(harm.block, harm.records) for harm in index.damage if harm.block]
    rows = [
        [b.name, b.step, b.increment, records, len(b.components), b.flag] for b, records in found
    ]
    assert rows == [[row[0], *row[2:]] for row in expected["datasets"]]
    times_s = [row[1] for row in expected["datasets"]]
    assert_allclose([b.time_ms / 1e3 for b, _ in found], times_s, rtol=1e-12)
    assert index.ended == expected["ends_with_9999"]
    assert bool(index.damage) == expected["truncated"]
    assert index.nodes.records == expected["nodes"]
    assert index.elements.records == expected["elements"]


@pytest.mark.parametrize("name", WITH_STRESS)
def test_von_mises_stress_is_what_another_reader_computed(name):
    expected = EXPECTED[name]["von_mises_at_nodes"]
    nodes = [int(node) for node in expected["values"]]
    times_ms, tensor_pa = frd.read_stress_tensor(SAMPLES / name, nodes, LENIENT)
    assert_allclose(times_ms / 1e3, expected["times"], rtol=1e-12)
    stored_pa = np.array([expected["values"][str(n)] for n in nodes]).T * 1e6
    assert_allclose(von_mises_pa(tensor_pa), stored_pa, rtol=6e-7)


@pytest.mark.parametrize("name", [n for n in EXPECTED if n not in INDEXED])
def test_a_file_that_the_other_reader_gave_up_on_is_an_error_here(name):
    with pytest.raises(ResultError, match=name):
        frd.read_stress_tensor(SAMPLES / name, [1])


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("cpe4_nosolver", r"header only \(80 bytes\).*\.sta.*log"),
        ("cpe4_negjac", "mesh only, no results"),
        ("cpe4_incmax", r"no end line 9999.*last whole increment: 2 of step 1, 1 ms"),
        ("cpe4_diverged", "no end line 9999.*last whole increment: 1 of step 1"),
        ("cpe4_diskfull", "CONTACT of step 1, increment 2 is cut at byte 40960, after"),
        ("cpe4_bin_diskfull", "block header of step 1, increment 2 is cut in its TOST"),
        ("kill_ascii", "DISP of step 1, increment 2 is cut .* after 157 of 252 rec"),
        ("kill_bin_f32", "FORC of step 1, increment 2 is cut .* after 59 of 252 rec"),
        ("cpe4_lastiter_ResultsForLastIterations", "9999"),
        ("cpe8r_3d_nset_zero", "STRESS .* has 0 records.*OUTPUT=2D"),
    ],
)
def test_a_run_that_did_not_end_well_is_refused_with_its_reason(name, words):
    with pytest.raises(ResultError, match=words):
        frd.read_stress_tensor(SAMPLES / f"{name}.frd", [11])


def test_a_partial_reading_tells_what_is_wrong_with_the_file():
    heard = []
    options = ReadOptions(partial=True, tell=heard.append)
    times_ms, _ = frd.read_stress_tensor(SAMPLES / "kill_ascii.frd", [11], options)
    assert times_ms.tolist() == [0.5]
    assert len(heard) == 1
    assert "after 157 of 252" in heard[0]


def test_iterations_of_one_increment_are_no_history():
    path = SAMPLES / "cpe4_lastiter_ResultsForLastIterations.frd"
    with pytest.raises(ResultError, match="DISP of step 1 holds results of another kind"):
        frd.read_displacement(path, [11], LENIENT)
    with pytest.raises(ResultError, match="no STRESS in it, it holds DISP"):
        frd.read_stress_tensor(path, [11], LENIENT)


@pytest.mark.parametrize("sta", [True, False])
def test_the_increment_that_never_converged_is_left_out(tmp_path, sta):
    """Seen in the ``.sta`` file, and without one in the missing STRESS."""
    shutil.copy(SAMPLES / "cpe4_diverged.frd", tmp_path)
    if sta:
        shutil.copy(SAMPLES / "cpe4_diverged.sta", tmp_path)
    heard = []
    times_ms, displacement_mm = frd.read_displacement(
        tmp_path / "cpe4_diverged.frd", [11], ReadOptions(partial=True, tell=heard.append)
    )
    assert times_ms.tolist() == [0.5]
    assert displacement_mm.shape == (1, 1, 3)
    assert "dropped step 1, increment 2: not converged" in heard


def test_stress_and_displacement_are_joined_by_step_and_increment():
    both = frd.read_stress_and_displacement(
        SAMPLES / "cpe4_diverged.frd", [11], [11, 25], ReadOptions(partial=True)
    )
    assert both.times_ms.tolist() == [0.5]
    assert both.tensor_pa.shape == (1, 1, 6)
    assert both.displacement_mm.shape == (1, 2, 3)


def test_a_step_in_ascii_and_one_in_binary_make_one_history():
    path = SAMPLES / "cpe4_2step_mixed.frd"
    times_ms, tensor_pa = frd.read_stress_tensor(path, [11])
    assert_allclose(times_ms, [0.5, 1, 1.5, 2, 2.5, 3], rtol=1e-12)
    assert np.isfinite(tensor_pa).all()


def test_ascii_float32_and_float64_of_one_run_agree_to_their_digits():
    nodes = [11, 25]
    read_one = frd.read_stress_tensor
    ascii_pa, single_pa, double_pa = (
        read_one(SAMPLES / f"cpe4_{kind}.frd", nodes)[1][..., :4]  # yz, zx are 0
        for kind in ("ascii", "bin_f32", "bin_f64")
    )
    assert_allclose(ascii_pa, double_pa, rtol=5e-6)
    assert_allclose(single_pa, double_pa, rtol=6e-8)


def test_a_set_out_of_order_and_with_a_duplicate_is_read_by_number():
    some = frd.read_stress_tensor(SAMPLES / "cpe4_nset_unsorted_dup.frd", [11, 25])[1]
    every = frd.read_stress_tensor(SAMPLES / "cpe4_ascii.frd", [11, 25])[1]
    assert_allclose(some, every, rtol=0)


def test_displacement_agrees_with_the_print_of_the_same_run():
    """``.dat`` of the run, set PROBES at 0.5 ms: node 11."""
    _, displacement_mm = frd.read_displacement(SAMPLES / "cpe4_ascii.frd", [11])
    assert_allclose(displacement_mm[0, 0, 1], -8.254934e-03, rtol=5e-6)


def test_output_every_third_increment_makes_traces_of_its_own_step():
    (trace,) = read(SAMPLES / "cpe4_freq3.frd", [11])
    assert (trace.start_ms, trace.dt_ms) == (1.5, 0.5)


def test_automatic_increments_are_refused_as_a_trace():
    with pytest.raises(ResultError, match="uneven time step"):
        read(SAMPLES / "cpe4_timepoints.frd", [11])


def test_times_of_a_second_and_more_are_read():
    times_ms, _ = frd.read_stress_tensor(SAMPLES / "cpe4_time_ge_1.frd", [11])
    assert_allclose(times_ms, [500, 1000, 1500, 2000], rtol=1e-12)


def test_a_vibration_of_eighty_increments_is_one_even_trace():
    (trace,) = read(SAMPLES / "vib_cpe4_bin_f64.frd", [29])
    assert (trace.stress_pa.size, trace.dt_ms, trace.start_ms) == (80, 0.5, 0.5)


def test_a_missing_node_is_named_with_its_neighbours():
    words = r"node 48 has no record in STRESS .*: 47 nodes, 1 to 47; nearest 45, 46, 47"
    with pytest.raises(ResultError, match=words):
        frd.read_stress_tensor(SAMPLES / "cpe4_bin_f32.frd", [11, 48])


def test_a_description_tells_format_mesh_quantities_and_damage():
    held = frd.describe(SAMPLES / "cpe4_2step_mixed.frd")
    stress = next(q for q in held["quantities"] if q["name"] == "STRESS")
    assert (held["mesh_nodes"], held["elements"], held["problem"]) == (47, 30, None)
    assert (stress["increments"], stress["nodes"], stress["last_ms"]) == (6, 47, 3.0)
    assert "EPI" in held["materials"].values()
    assert "9999" in frd.describe(SAMPLES / "cpe4_incmax.frd")["problem"]
