"""Each damaged or hostile file, and the words that name what is wrong with it."""

import os
import struct
import tracemalloc

import pytest
from numpy.testing import assert_allclose

from fembridge.errors import FembridgeError, ResultError, TraceError
from fembridge.results import frd, read
from fembridge.results.byte_file import ByteFile
from fembridge.results.frd_format.field import read_fields
from fembridge.results.frd_format.index import index_frd
from fembridge.results.node_sets import read_node_sets
from fembridge.results.printed.cvg import read_cvg
from fembridge.results.printed.dat import read_total_force
from fembridge.results.printed.sta import read_sta
from fembridge.results.read_options import ReadOptions

NO_END = "no end line 9999: the run did not end normally"
LAST_1 = r"last whole increment: 1 of step 1, 0\.5 ms"
HOLE_BYTES = 2 << 30  # of a sparse file: no disk is used
SEARCHED = HOLE_BYTES if os.environ.get("CI") == "true" else 128 << 20

# Sample, its words, and the times that --partial still reads at node 11.
DAMAGED = {
    "cpe4_bin_diskfull": (
        "block header of step 1, increment 2 is cut in its TOSTRAIN lines, at byte "
        f"14336 of 14336: cut inside a line; {NO_END}; {LAST_1}",
        [0.5, 1.0],  # its STRESS was whole before the cut
    ),
    "cpe4_diskfull": (
        f"CONTACT of step 1, increment 2 is cut at byte 40960, after 7 of 47 records; "
        f"{NO_END}; {LAST_1}",
        [0.5, 1.0],
    ),
    "cpe4_diverged": (f"{NO_END}; increment 2 of step 1 did not converge .*; {LAST_1}", [0.5]),
    "cpe4_dyn_impact": (f"{NO_END}; increment 2 of step 1 did not converge .*; {LAST_1}", [0.5]),
    "cpe4_incmax": (f"{NO_END}; last whole increment: 2 of step 1, 1 ms", [0.5, 1.0]),
    "kill_ascii": (
        f"DISP of step 1, increment 2 is cut at byte 114077, after 157 of 252 records; "
        f"{NO_END}; {LAST_1}",
        [0.5],
    ),
    "kill_bin_f32": (
        f"FORC of step 1, increment 2 is cut at byte 61197, after 59 of 252 records; "
        f"{NO_END}; {LAST_1}",
        [0.5, 1.0],  # its STRESS was whole before the cut
    ),
    "cpe4_negjac": ("mesh only, no results: the solver stopped at its start", None),
    "cpe4_nosolver": (r"header only \(80 bytes\): the solver stopped before its", None),
    "cpe8r_3d_nset_zero": ("has 0 records: with OUTPUT=3D .* use OUTPUT=2D", None),
    "cpe4_lastiter_ResultsForLastIterations": (
        r"iterations of increment 2 of step 1, no history \(LAST ITERATIONS\)",
        None,
    ),
}


@pytest.mark.parametrize("name", DAMAGED)
def test_a_damaged_sample_is_refused_in_the_right_words(samples, name):
    with pytest.raises(ResultError, match=DAMAGED[name][0]):
        frd.read_stress_tensor(samples / f"{name}.frd", [11])


@pytest.mark.parametrize("name", DAMAGED)
def test_a_damaged_sample_is_listed_with_what_is_wrong(samples, name):
    held = frd.describe(samples / f"{name}.frd")
    if name == "cpe8r_3d_nset_zero":
        assert {quantity["nodes"] for quantity in held["quantities"]} == {0}
        return
    assert held["problem"] is not None
    assert held["problem"].startswith(DAMAGED[name][0][:20].replace("\\", ""))  \
        or held["remarks"]  # fmt: skip


@pytest.mark.parametrize("name", [n for n, row in DAMAGED.items() if row[1]])
def test_what_was_whole_before_the_damage_is_read_and_equals_the_file(samples, name):
    """Of these runs the first increments are those of the run that ended well."""
    heard = []
    options = ReadOptions(partial=True, across_materials=True, tell=heard.append)
    times_ms, tensor_pa = frd.read_stress_tensor(samples / f"{name}.frd", [11], options)
    assert times_ms.tolist() == DAMAGED[name][1]
    assert heard
    twin = {"kill_ascii": "kill_bin_f32", "kill_bin_f32": "kill_ascii"}.get(name)
    if name in ("cpe4_diskfull", "cpe4_bin_diskfull", "cpe4_incmax"):
        twin = "cpe4_bin_f64"
    if twin is not None:
        same_pa = frd.read_stress_tensor(samples / f"{twin}.frd", [11], options)[1]
        shared = min(len(same_pa), len(tensor_pa))
        assert_allclose(tensor_pa[:shared, :, :4], same_pa[:shared, :, :4], rtol=1e-5, atol=1e-9)


def test_divergence_shows_without_the_sta_file(samples, tmp_path):
    path = tmp_path / "job.frd"
    path.write_bytes((samples / "cpe4_diverged.frd").read_bytes())
    words = r"increment 2 of step 1 has DISP, FORC and no .*STRESS.*: it did not conv"
    with pytest.raises(ResultError, match=words):
        frd.read_stress_tensor(path, [11])


@pytest.mark.parametrize("flag", [1, 2, 3])
def test_a_file_that_grows_while_it_is_read_is_named(block, write_frd, flag):
    path = write_frd([block("STRESS", 1, 1e-3, [(1, [1.0] * 6)], flag=flag)])
    with ByteFile(path) as file:
        assert file.change is None
        with path.open("ab") as more:
            more.write(b"    1PSTEP\n")
        assert "grew from" in file.change
        assert "something is still writing it" in file.change
        os.truncate(path, 10)
        assert "shrank from" in file.change


def test_a_run_that_goes_on_while_its_history_is_read_is_refused_or_told(
    block, write_frd, monkeypatch
):
    blocks = [block("STRESS", k, k * 1e-3, [(1, [1.0] * 6)]) for k in (1, 2)]
    path = write_frd(blocks)
    node_ids = "fembridge.results.frd_format.records.node_ids"
    original = frd.node_ids

    def growing(file, one):
        with path.open("ab") as more:
            more.write(b"\n")
        return original(file, one)

    monkeypatch.setattr(node_ids, growing)
    with pytest.raises(ResultError, match=r"grew from .* read it again when the run"):
        frd.read_stress_tensor(path, [1])
    heard = []
    options = ReadOptions(partial=True, tell=heard.append)
    path = write_frd(blocks)
    assert frd.read_stress_tensor(path, [1], options)[0].tolist() == [1.0, 2.0]
    assert "it grew from" in heard[-1]


def hole(path, start, size=HOLE_BYTES):
    """Write `start` and, behind it, `size` bytes without a line end."""
    path.write_bytes(start)
    os.truncate(path, len(start) + size)
    return path


def peak_bytes(action):
    """Memory that `action` takes at most."""
    tracemalloc.start()
    try:
        action()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def refused(action, words):
    def attempt():
        with pytest.raises(FembridgeError, match=words):
            action()

    return attempt


@pytest.mark.parametrize(
    ("name", "start", "reader", "words"),
    [
        ("a.frd", b"    1C", frd.describe, None),
        ("b.frd", b"    1C", lambda p: read(p, [1]), "a line of more than 4096 bytes"),
        ("c.dat", b"\n", lambda p: read_total_force(p, "A"), "more than 65536 bytes"),
        ("d.sta", b"\n\n\n", read_sta, "a line of more than 65536 bytes"),
        ("e.cvg", b"\n\n\n\n\n", read_cvg, "a line of more than 65536 bytes"),
        ("f.inp", b"*NSET, NSET=A\n1,", read_node_sets, "bytes, expected a deck of"),
    ],
)
def test_a_line_of_two_gigabytes_is_named_in_little_memory(tmp_path, name, start, reader, words):
    path = hole(tmp_path / name, start)
    action = (lambda: reader(path)) if words is None else refused(
        lambda: reader(path), words
    )  # fmt: skip
    assert peak_bytes(action) < 8 << 20
    if words is None:
        assert "a line of more than 4096 bytes" in reader(path)["problem"]


def test_a_block_of_nothing_is_named_in_little_memory(block, write_frd, tmp_path):
    """A hole that a full disk left, where records should be; it is read through."""
    whole = write_frd([block("STRESS", 1, 1e-3, [(1, [1.0] * 6)])]).read_bytes()
    path = hole(tmp_path / "hole.frd", whole[: whole.rindex(b" -1         1")], SEARCHED)
    words = r"STRESS of step 1, increment 1 is cut at byte \d+, after 0 of 1 records"
    assert peak_bytes(refused(lambda: read(path, [1]), words)) < 8 << 20


@pytest.mark.parametrize("flag", [1, 2, 3])
@pytest.mark.parametrize("reader", [lambda p: read(p, [1]), lambda p: list(read_fields(p))])
def test_a_count_of_billions_takes_no_memory(block, write_frd, flag, reader):
    lying = block("STRESS", 1, 1e-3, [(1, [1.0] * 6)], flag=flag, count=999_999_999_999)
    path = write_frd([lying])
    words = "999999999999 records"
    assert peak_bytes(refused(lambda: reader(path), words)) < 8 << 20


@pytest.mark.parametrize("kind", [b"    2C", b"    3C"])
@pytest.mark.parametrize("mesh_flag", [1, 2])
def test_a_mesh_count_of_billions_takes_no_memory(block, write_frd, kind, mesh_flag):
    path = write_frd([block("STRESS", 1, 1e-3, [(1, [1.0] * 6)])], mesh_flag=mesh_flag)
    content = path.read_bytes()
    at = content.index(kind) + 24
    path.write_bytes(content[:at] + b"999999999999" + content[at + 12 :])
    name = "node block" if kind == b"    2C" else "element block"
    action = refused(lambda: read(path, [1]), f"{name}: .*999999999999")
    assert peak_bytes(action) < 8 << 20


def test_a_mesh_count_that_lies_leaves_the_results_to_partial(block, write_frd):
    records = [(1, [1.0] * 6)]
    path = write_frd([block("STRESS", k, k * 1e-3, records) for k in (1, 2)])
    content = path.read_bytes()
    at = content.index(b"    2C") + 24
    path.write_bytes(content[:at] + b"%12d" % 3 + content[at + 12 :])
    with pytest.raises(ResultError, match="node block: 3 records announced, 4 present"):
        read(path, [1])
    assert len(read(path, [1], partial=True)[0].stress_pa) == 2


def test_a_header_that_announces_thousands_of_components_is_named(block, write_frd):
    path = write_frd([block("STRESS", 1, 1e-3, [(1, [1.0] * 6)])])
    content = path.read_bytes().replace(b" -4  STRESS      6", b" -4  STRESS  99999")
    path.write_bytes(content)
    with pytest.raises(ResultError, match="STRESS announces 99999 components"):
        read(path, [1])


def test_bytes_that_look_like_markers_are_values_in_a_binary_block(block, write_frd):
    for text in (b" -3\n", b" 9999\n  ", b"    1PST", b"  100CL "):
        (value,) = struct.unpack("<d", text.ljust(8)[:8])
        records = [(1, [value, 1.0, 2.0, 3.0, 4.0, 5.0]), (2, [6.0] * 6)]
        blocks = [block("STRESS", k, k * 1e-3, records, flag=3) for k in (1, 2)]
        path = write_frd(blocks, mesh_flag=2)
        with ByteFile(path) as file:
            assert not index_frd(file).damage
        options = ReadOptions(stress_unit="Pa")
        tensor_pa = frd.read_stress_tensor(path, [1], options)[1]
        assert tensor_pa[:, 0, 0].tolist() == [value, value]


def test_a_number_too_large_to_be_a_stress_is_named(block, write_frd):
    records = [(1, [1e305] * 6)]
    path = write_frd([block("STRESS", k, k * 1e-3, records, flag=3) for k in (1, 2)])
    with pytest.raises(ResultError, match=r"a stress of 1e\+305 MPa"):
        frd.read_stress_tensor(path, [1])
    with pytest.raises(TraceError, match="stress is inf at sample 0"):
        read(write_frd([
            block("STRESS", k, k * 1e-3, [(1, [1e200, 0, 0, 0, 0, 0])], flag=3)
            for k in (1, 2)
        ]), [1])  # fmt: skip


def test_thousands_of_damaged_blocks_are_told_in_three(block, write_frd):
    wrong = block("STRESS", 1, 1e-3, [(1, [1.0] * 6)], count=2)
    problem = frd.describe(write_frd([wrong] * 2000))["problem"]
    assert problem.count("announces 2 records and has 1") == 3
    assert "and 1997 places more" in problem


def test_a_blank_count_of_records_is_read_to_the_end_line(block, write_frd):
    records = [(n, [float(n)] * 6) for n in (1, 2, 3)]
    path = write_frd([block("STRESS", k, k * 1e-3, records) for k in (1, 2)])
    content = path.read_bytes()
    path.write_bytes(content.replace(b"           3" + b" " * 21 + b"0", b" " * 33 + b"0"))
    assert path.read_bytes() != content
    assert len(read(path, [3])[0].stress_pa) == 2
