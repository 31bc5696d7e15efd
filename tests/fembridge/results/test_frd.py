"""A ``.frd``: recorded runs, what a writer knows, damage, at nodes and whole, and its mesh."""

import json
import os
import re
import shutil
import struct
import subprocess
import tracemalloc
import weakref
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from opened import mesh_of, naming, read_field, shows

from fembridge.errors import FembridgeError, ResultError, UsageError
from fembridge.results import describe, frd, read, read_fields
from fembridge.results.byte_file import ByteFile
from fembridge.results.frd import KIND_OF_TYPE, NODES_OF_TYPE, FrdIndex
from fembridge.results.nodes import read_node_sets
from fembridge.results.printed import read_node_print
from fembridge.results.read_options import ReadOptions
from fembridge.results.readers import read_values
from fembridge.results.status import read_cvg, read_sta
from fembridge.results.von_mises import von_mises_pa

moved_at = partial(read_values, quantity="displacement")


SAMPLES = Path(__file__).parents[3] / "fixtures" / "frd_samples"
EXPECTED = json.loads((SAMPLES / "expected.json").read_text())
INDEXED = [name for name, row in EXPECTED.items() if "datasets" in row]
WITH_STRESS = [name for name, row in EXPECTED.items() if "von_mises_at_nodes" in row]
LENIENT = ReadOptions(partial=True, across_materials=True)


@pytest.mark.parametrize("name", INDEXED)
def test_the_index_lists_what_another_reader_listed(name):
    expected = EXPECTED[name]
    with ByteFile(SAMPLES / name) as file:
        index = FrdIndex(file)
    found = [(block, block.records) for block in index.blocks]
    found += [(harm.block, harm.records) for harm in index.damage if harm.block]
    rows = [[b.name, *b.key, records, len(b.components), b.form.flag] for b, records in found]
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
    times_ms, tensor_pa = read_values(SAMPLES / name, nodes, LENIENT)
    assert_allclose(times_ms / 1e3, expected["times"], rtol=1e-12)
    stored_pa = np.array([expected["values"][str(n)] for n in nodes]).T * 1e6
    assert_allclose(von_mises_pa(tensor_pa), stored_pa, rtol=6e-7)


@pytest.mark.parametrize("sta", [True, False])
def test_the_increment_that_never_converged_is_left_out(tmp_path, sta, logged):
    """Seen in the ``.sta`` file, and without one in the missing STRESS."""
    shutil.copy(SAMPLES / "cpe4_diverged.frd", tmp_path)
    if sta:
        shutil.copy(SAMPLES / "cpe4_diverged.sta", tmp_path)
    times_ms, displacement_mm = moved_at(
        tmp_path / "cpe4_diverged.frd", [11], ReadOptions(partial=True)
    )
    assert times_ms.tolist() == [0.5]
    assert displacement_mm.shape == (1, 1, 3)
    assert any(shows(line, "step 1, increment 2") for line in logged[1:])
    assert shows(logged[0], "DISP, FORC", "ERROR, STRESS") != sta


def test_a_missing_node_is_named_with_its_neighbours():
    shown = "cpe4_bin_f32.frd", 48, "STRESS", 47, 1, 47, "45, 46, 47"
    with pytest.raises(ResultError, match=naming(*shown)):
        read_values(SAMPLES / "cpe4_bin_f32.frd", [11, 48])


AS_IS = ReadOptions(stress_unit="Pa")
PRINTED = "{:12.5E}".format


def stored(values, flag):
    """Give `values` as the storage `flag` keeps them."""
    if flag == 2:
        return values.astype(np.float32).astype(np.float64)
    if flag < 2:
        flat = [float(PRINTED(value)) for value in values.ravel()]
        return np.array(flat).reshape(values.shape)
    return values


def random_blocks(block, ids, flags, seed, count=6, name="STRESS", components=()):
    """Blocks of random values: of `ids` in that order, one flag an increment."""
    rng = np.random.default_rng(seed)
    sizes = 10.0 ** rng.integers(-30, 30, (len(flags), len(ids), count))
    values = rng.standard_normal((len(flags), len(ids), count)) * sizes
    values = values[:, [ids.index(node) for node in ids]]  # duplicates are equal
    blocks = [
        block(
            name,
            increment,
            increment * 5e-4,
            [(node, row.tolist()) for node, row in zip(ids, table, strict=True)],
            flag=flag,
            components=components,
        )
        for increment, (flag, table) in enumerate(zip(flags, values, strict=True), 1)
    ]
    return blocks, [stored(table, f) for table, f in zip(values, flags, strict=True)]


@given(
    ids=st.lists(st.integers(1, 99_999), min_size=1, max_size=40),
    flags=st.lists(st.sampled_from([0, 1, 2, 3]), min_size=1, max_size=4),
    count=st.integers(1, 14),
    seed=st.integers(0, 99),
)
def test_what_was_written_is_read_for_any_order_duplicates_and_storage(
    block, write_frd, ids, flags, count, seed
):
    """At nodes, some of them duplicate, and whole, of any count of components."""
    names = tuple(f"SDV{k}" for k in range(count))
    stress, tensors = random_blocks(block, ids, flags, seed)
    others, tables = random_blocks(block, ids, flags, seed, count, "SDV", names)
    path = write_frd([one for both in zip(stress, others, strict=True) for one in both])
    wanted = list(dict.fromkeys(reversed(ids)))

    times_ms, tensor_pa = read_values(path, wanted, AS_IS)
    fields = list(read_fields(path, "SDV"))

    assert_array_equal(tensor_pa, np.stack(tensors)[:, [ids.index(node) for node in wanted]])
    assert_array_equal(times_ms, [0.5 * (k + 1) for k in range(len(flags))])
    assert [field.increment for field in fields] == [k + 1 for k in range(len(flags))]
    for field, table in zip(fields, tables, strict=True):
        assert (field.components, field.nodes.tolist()) == (names, ids)
        assert_array_equal(field.values, table)


@pytest.mark.parametrize("flag", [1, 2, 3])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_value_that_is_no_number_is_named_or_its_increment_left_out(
    write_frd, block, flag, bad, logged
):
    rows = [(1, [1.0] * 6), (2, [1.0] * 6)]
    odd = [rows[0], (2, [1.0, bad, 1.0, 1.0, 1.0, 1.0])]
    path = write_frd(
        [block("STRESS", k, k * 1e-3, odd if k == 2 else rows, flag) for k in (1, 2, 3)]
    )
    shown = naming("node 2", "2 ms", "STRESS SYY", bad)
    for reader in (lambda: read_values(path, [2]), lambda: list(read_fields(path))):
        with pytest.raises(ResultError, match=shown):
            reader()
    partial = {"partial": True}
    assert read_values(path, [2], ReadOptions(**partial))[0].tolist() == [1.0, 3.0]
    assert [field.increment for field in read_fields(path, **partial)] == [1, 3]
    assert len(logged) == 2
    assert all(re.search(shown, line) and shows(line, "step 1, increment 2") for line in logged)


@pytest.mark.parametrize(
    ("of_block", "of_file", "replaced"),
    [
        ({"components": ("SZX", "SXX", "SYY", "SZZ", "SXY", "SYZ")}, {}, None),
        ({}, {"line_end": "\r\n"}, None),
        ({"number": "{:12.5e}".format}, {}, None),
        ({}, {}, b"%12d" % 1 + b" " * 21 + b"0"),  # a count of records that is blank
    ],
)
def test_files_of_other_programs_are_read(block, write_frd, of_block, of_file, replaced):
    names = of_block.get("components") or ("SXX", "SYY", "SZZ", "SXY", "SYZ", "SZX")
    row = [float(("SXX", "SYY", "SZZ", "SXY", "SYZ", "SZX").index(name) - 2.5) for name in names]
    path = write_frd(
        [block("STRESS", k, k * 1e-3, [(1, row)], **of_block) for k in (1, 2)], **of_file
    )
    if replaced is not None:
        content = path.read_bytes()
        assert content.count(replaced) == 2
        path.write_bytes(content.replace(replaced, b" " * 33 + b"0"))
    _, tensor_pa = read_values(path, [1], AS_IS)
    assert tensor_pa[:, 0].tolist() == [[-2.5, -1.5, -0.5, 0.5, 1.5, 2.5]] * 2


def test_a_node_between_two_layers_is_refused_by_name(samples):
    """Node 18 of the two-layer block: uniform stretch gives 0.01126 MPa there,
    which is neither the 0.00055 of one layer nor the 0.022 of the other."""
    shown = naming("node 18", "EPI", "DER", "--across-materials")
    for name in ("cpe4_ascii", "cpe4_bin_f32", "cpe4_2step_mixed"):
        with pytest.raises(ResultError, match=shown):
            read_values(samples / f"{name}.frd", [11, 18])


def test_a_word_in_place_of_the_material_number_is_no_material(samples, tmp_path):
    """As in old files, which write ``0EL`` there."""
    path = tmp_path / "old.frd"
    shutil.copy(samples / "cpe4_ascii.frd", path)
    content = path.read_bytes()
    start, end = content.index(b"    3C"), content.index(b"    1PSTEP")
    mesh = content[start:end]
    for number in (b"1", b"2", b"3"):
        mesh = mesh.replace(b"    9    0    " + number, b"    9    0   EL")
    path.write_bytes(content[:start] + mesh + content[end:])
    assert read_values(path, [18])[1].shape == (4, 1, 6)


CUT_STEP = 1 if os.environ.get("CI") == "true" else 97
LENIENT_PA = ReadOptions(partial=True, across_materials=True, stress_unit="Pa")


@pytest.mark.parametrize("flag", [1, 2, 3])
def test_a_cut_at_any_byte_gives_an_error_or_a_true_beginning(small_run, write_frd, flag):
    path = write_frd(small_run(2, flag), f"cut{flag}.frd", mesh_flag=min(flag, 2))
    times_ms, tensor = read_values(path, [1, 3], LENIENT_PA)
    _, moved = moved_at(path, [1, 3], LENIENT_PA)
    seen, whole_size = set(), path.stat().st_size
    ending = range(whole_size - 1, whole_size - 30, -1)
    for size in [*ending, *range(whole_size - 30, -1, -CUT_STEP)]:
        os.truncate(path, size)
        if size < whole_size - 1:  # without its last line end nothing is lost
            with pytest.raises(ResultError):
                read_values(path, [1, 3])
        for reader, whole in ((read_values, tensor), (moved_at, moved)):
            try:
                some_ms, some = reader(path, [1, 3], LENIENT_PA)
            except ResultError as error:
                assert str(path) in str(error)
                continue
            seen.add(some_ms.size)
            assert_array_equal(some_ms, times_ms[: some_ms.size])
            assert_array_equal(some, whole[: some_ms.size])
    assert seen == {1, 2}


@pytest.mark.parametrize("flag", [1, 2])
@pytest.mark.parametrize("count", [1, 3])
def test_a_count_that_lies_is_no_shift_of_records(block, write_frd, flag, count):
    records = [(1, [1.0] * 6), (2, [2.0] * 6)]
    blocks = [block("STRESS", k, k * 1e-3, records, flag=flag) for k in (1, 2)]
    blocks[0] = block("STRESS", 1, 1e-3, records, flag=flag, count=count)
    with pytest.raises(ResultError, match=naming("written.frd", "STRESS of step 1, increment 1")):
        read_values(write_frd(blocks), [1, 2])


HOLE_BYTES = 2 << 30  # of a sparse file: no disk is used
SEARCHED = HOLE_BYTES if os.environ.get("CI") == "true" else 32 << 20
# Sample, where it says the damage is, and the times that --partial still reads at node 11.
DAMAGED = {
    # Their STRESS was whole before the cut.
    "cpe4_bin_diskfull": (r"step 1, increment 2: TOSTRAIN .*byte 14336 of 14336", [0.5, 1.0]),
    "cpe4_diskfull": (r"CONTACT of step 1, increment 2 .* byte 40960, after 7 of 47", [0.5, 1.0]),
    "kill_bin_f32": (r"FORC of step 1, increment 2 .* byte 61197, after 59 of 252", [0.5, 1.0]),
    "kill_ascii": (r"DISP of step 1, increment 2 .* byte 114077, after 157 of 252", [0.5]),
    "cpe4_diverged": (r"increment 2 of step 1.* 1 of step 1, 0\.5 ms", [0.5]),
    "cpe4_dyn_impact": (r"increment 2 of step 1.* 1 of step 1, 0\.5 ms", [0.5]),
    "cpe4_incmax": (r"9999.* 2 of step 1, 1 ms", [0.5, 1.0]),
    "cpe4_negjac": ("mesh", None),
    "cpe4_nosolver": ("80 bytes", None),
    "cpe8r_3d_nset_zero": ("OUTPUT=2D", None),
    "cpe4_lastiter_ResultsForLastIterations": ("increment 2 of step 1", None),
}


def test_empty_blocks_are_named_from_the_first_increment_on(block, write_frd, logged):
    blocks = [block(name, k, k * 1e-3, []) for k in (1, 2) for name in ("DISP", "STRESS")]
    with pytest.raises(ResultError, match=naming("DISP, STRESS of step 1, increment 1", 0)):
        read_values(write_frd(blocks), [1])
    moved = [(1, [0.5] * 3)]
    blocks[0::2] = [block("DISP", k, k * 1e-3, moved) for k in (1, 2)]
    said = logged
    moved_at(write_frd(blocks), [1], ReadOptions())
    assert shows(said[0], "STRESS of step 1, increment 1", 0)
    with pytest.raises(ResultError, match=naming("STRESS of step 1, increment 1", 0)):
        read_fields(write_frd(blocks), "stress")
    with pytest.raises(ResultError, match=naming("written.frd", "FORC", "DISP")):
        read_fields(write_frd(blocks), "FORC")


@pytest.mark.parametrize("name", DAMAGED)
def test_a_damaged_sample_is_refused_in_the_right_words_and_its_beginning_read(
    samples, name, logged
):
    """Of these runs the first increments are those of the run that ended well."""
    words, times_ms = DAMAGED[name]
    with pytest.raises(ResultError, match=words):
        read_values(samples / f"{name}.frd", [11])
    if not times_ms:
        return
    options = ReadOptions(partial=True, across_materials=True)
    found_ms, tensor_pa = read_values(samples / f"{name}.frd", [11], options)
    assert found_ms.tolist() == times_ms
    assert logged
    twin = {"kill_ascii": "kill_bin_f32", "kill_bin_f32": "kill_ascii"}.get(name)
    if name in ("cpe4_diskfull", "cpe4_bin_diskfull", "cpe4_incmax"):
        twin = "cpe4_bin_f64"
    if twin is not None:
        same_pa = read_values(samples / f"{twin}.frd", [11], options)[1]
        shared = min(len(same_pa), len(tensor_pa))
        assert_allclose(tensor_pa[:shared, :, :4], same_pa[:shared, :, :4], rtol=1e-5, atol=1e-9)


def test_a_run_that_goes_on_while_its_history_is_read_is_refused_or_told(
    block, write_frd, monkeypatch, logged
):
    blocks = [block("STRESS", k, k * 1e-3, [(1, [1.0] * 6)]) for k in (1, 2)]
    path = write_frd(blocks)
    node_ids = "fembridge.results.frd.node_ids"
    original = frd.node_ids

    def growing(file, one):
        with path.open("ab") as more:
            more.write(b"\n")
        return original(file, one)

    monkeypatch.setattr(node_ids, growing)
    with pytest.raises(ResultError):
        read_values(path, [1])
    options = ReadOptions(partial=True)
    path = write_frd(blocks)
    assert read_values(path, [1], options)[0].tolist() == [1.0, 2.0]
    assert re.search(r"grew from \d+ to \d+ bytes", logged[-1])


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
        ("a.frd", b"    1C", describe, None),
        ("b.frd", b"    1C", lambda p: read(p, [1]), naming(4096)),
        ("c.dat", b"\n", lambda p: read_node_print(p, "forces", "A"), naming(65536)),
        ("d.sta", b"\n\n\n", read_sta, naming(65536)),
        ("e.cvg", b"\n\n\n\n\n", read_cvg, naming(65536)),
        ("f.inp", b"*NSET, NSET=A\n1,", read_node_sets, naming("f.inp", "bytes")),
    ],
)
def test_a_line_of_two_gigabytes_is_named_in_little_memory(tmp_path, name, start, reader, words):
    path = hole(tmp_path / name, start)
    action = (lambda: reader(path)) if words is None else refused(
        lambda: reader(path), words
    )  # fmt: skip
    assert peak_bytes(action) < 8 << 20
    if words is None:
        assert shows(reader(path)["problem"], 4096)


def test_a_block_of_nothing_is_named_in_little_memory(block, write_frd, tmp_path):
    """A hole that a full disk left, where records should be; it is read through."""
    whole = write_frd([block("STRESS", 1, 1e-3, [(1, [1.0] * 6)])]).read_bytes()
    path = hole(tmp_path / "hole.frd", whole[: whole.rindex(b" -1         1")], SEARCHED)
    words = naming("STRESS of step 1, increment 1", "byte", "0 of 1")
    assert peak_bytes(refused(lambda: read(path, [1]), words)) < 8 << 20


@pytest.mark.parametrize("flag", [1, 2, 3])
@pytest.mark.parametrize("reader", [lambda p: read(p, [1]), lambda p: list(read_fields(p))])
def test_a_count_of_billions_takes_no_memory(block, write_frd, flag, reader):
    lying = block("STRESS", 1, 1e-3, [(1, [1.0] * 6)], flag=flag, count=999_999_999_999)
    path = write_frd([lying])
    words = naming(999999999999)
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


def test_bytes_that_look_like_markers_are_values_in_a_binary_block(block, write_frd):
    for text in (b" -3\n", b" 9999\n  ", b"    1PST", b"  100CL "):
        (value,) = struct.unpack("<d", text.ljust(8)[:8])
        records = [(1, [value, 1.0, 2.0, 3.0, 4.0, 5.0]), (2, [6.0] * 6)]
        blocks = [block("STRESS", k, k * 1e-3, records, flag=3) for k in (1, 2)]
        path = write_frd(blocks, mesh_flag=2)
        with ByteFile(path) as file:
            assert not FrdIndex(file).damage
        options = ReadOptions(stress_unit="Pa")
        tensor_pa = read_values(path, [1], options)[1]
        assert tensor_pa[:, 0, 0].tolist() == [value, value]


# ---- Whole fields and the mesh


def three_digits(value):
    text = f"{value:.5E}"
    return f"{text[:-2]}0{text[-2:]}".rjust(12)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("line_end", ["\n", "\r\n"])
@pytest.mark.parametrize("chunk_bytes", [1 << 20, 400])
def test_exponents_of_three_digits_are_read(
    write_frd, block, sign, line_end, chunk_bytes, monkeypatch
):
    monkeypatch.setattr("fembridge.results.byte_file.CHUNK_BYTES", chunk_bytes)
    values = [sign * 5.28012e-3, 3.06745e-3, sign, 0.0, 2e10, -1e-12, 7.5]
    names = tuple(f"SDV{k}" for k in range(7))
    records = [(node, [node * x for x in values]) for node in range(1, 30)]
    blocks = [
        block("SDV", k, k * 1e-3, records, components=names, number=three_digits) for k in (1, 2)
    ]
    path = write_frd(blocks, line_end=line_end)
    expected = [[float(f"{x:.5E}") for x in row] for _, row in records]
    assert [field.values.tolist() for field in read_fields(path, "SDV")] == [expected] * 2


def test_a_field_is_read_only_and_finds_its_nodes(samples):
    field = next(read_fields(samples / "cpe4_nset_unsorted_dup.frd"))
    assert field.nodes.tolist() == [25, 11, 18, 11]
    assert_array_equal(field.values_at([11, 25]), field.values[[1, 0]])
    with pytest.raises(ValueError):
        field.values[0, 0] = 0.0
    with pytest.raises(UsageError, match=naming("node 12")):
        field.values_at([12])
    with pytest.raises(UsageError):
        field.component("SXZ")


@pytest.mark.parametrize("flag", [1, 2])
def test_no_more_than_two_increments_and_one_piece_of_text_are_in_memory(
    write_frd, block, flag, monkeypatch
):
    """Counted, not measured: what else the process allocates does not matter."""
    records = [(node, [float(node)] * 6) for node in range(1, 8001)]
    path = write_frd([block("STRESS", k, k * 1e-3, records, flag) for k in (1, 2, 3)])
    taken, alive = [], []
    take = ByteFile.take
    monkeypatch.setattr(
        ByteFile, "take", lambda self, at, size: taken.append(size) or take(self, at, size)
    )
    for field in read_fields(path):
        assert sum(one() is not None for one in alive) <= 1  # the one before
        alive.append(weakref.ref(field.values.base))
    assert len(alive) == 3
    del field
    assert all(one() is None for one in alive)
    assert max(taken) < 400_000


ELEMENTS = st.lists(
    st.tuples(st.sampled_from(sorted(NODES_OF_TYPE)), st.integers(1, 3)), min_size=1, max_size=40
)


@given(
    kinds=ELEMENTS,
    mesh_flag=st.sampled_from([1, 2]),
    line_end=st.sampled_from(["\n", "\r\n"]),
    runs=st.integers(1, 40),
    chunk_bytes=st.sampled_from([300, 997, 1 << 20]),
    seed=st.integers(0, 99),
)
def test_any_mix_of_elements_is_read_as_it_was_written(
    write_frd, kinds, mesh_flag, line_end, runs, chunk_bytes, seed
):
    rng, nodes = np.random.default_rng(seed), [3, 1, *range(7, 50)]
    elements = [
        (kind, material, rng.choice(nodes, NODES_OF_TYPE[kind]).tolist())
        for kind, material in kinds
        for _ in range(1 + runs // len(kinds))
    ]
    if mesh_flag == 2:
        line_end = "\n"  # among packed numbers it would be one of them
    path = write_frd([], nodes=nodes, elements=elements, mesh_flag=mesh_flag, line_end=line_end)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("fembridge.results.frd.CHUNK_BYTES", chunk_bytes)
        patch.setattr("fembridge.results.frd._TEXT_BYTES", chunk_bytes)
        grid = mesh_of(path)
    assert grid.nodes.tolist() == nodes
    assert grid.points_mm.tolist() == [[node, 0, 0] for node in nodes]
    assert grid.materials == {1: "EPI", 2: "DER"}
    kept = [(KIND_OF_TYPE[kind], number, *of) for number, (kind, *of) in enumerate(elements, 1)]
    assert [cells.kind for cells in grid.cells] == [
        KIND_OF_TYPE[kind] for kind in sorted({kind for kind, _, _ in elements})
    ]
    for cells in grid.cells:
        _, numbers, materials, corners = zip(
            *(one for one in kept if one[0] == cells.kind), strict=True
        )
        assert cells.ids.tolist() == list(numbers)
        assert cells.material.tolist() == list(materials)
        assert grid.nodes[cells.rows].tolist() == list(corners)
    met = [len({material for _, material, at in elements if node in at}) for node in nodes]
    assert grid.material_count.tolist() == met


def test_the_mesh_of_a_sample_is_that_of_its_deck(samples):
    deck = (samples / "interface_cpe8r.inp").read_text().splitlines()
    start = deck.index("*NODE, NSET=NALL") + 1
    nodes, elements, section = {}, {}, "*NODE"
    for line in deck[start:]:
        number, *words = line.split(",")
        if line.startswith("*"):
            section = number
        elif section == "*NODE":
            nodes[int(number)] = [float(word) for word in words]
        elif section == "*ELEMENT":
            elements[int(number)] = [int(word) for word in words]
    grid = mesh_of(samples / "interface_cpe8r.frd")
    places = grid.points_mm.tolist()
    assert dict(zip(grid.nodes.tolist(), places, strict=True)) == nodes
    (cells,) = grid.cells
    assert cells.kind == "quad8"
    assert dict(zip(cells.ids.tolist(), grid.nodes[cells.rows].tolist(), strict=True)) == elements
    on_boundary = grid.points_mm[:, 1] == 0.5
    assert_array_equal(grid.material_count == 2, on_boundary)


def test_blank_counts_and_beams_are_read(samples):
    """As in the file of the last iterations: contact springs are two-node beams."""
    grid = mesh_of(samples / "cpe4_lastiter_ResultsForLastIterations.frd")
    assert grid.nodes.size == 188
    assert [(c.kind, c.rows.shape) for c in grid.cells] == [("hex8", (30, 8)), ("line2", (112, 2))]


@pytest.mark.parametrize(
    ("old", "new", "shown"),
    [
        (b" -2         1         2", b" -2         1         x", ("element block",)),
        (b" -2         1         2", b" -2         1        77", (77,)),
        (b"    9    0    1", b"   10    0    1", ("type 10", 4, 8)),
        (b"    9    0    1", b"   19    0    1", ("type 19", 4)),
        (b" -1         1    9", b" -1         x    9", ("element block",)),
        (b"2 2.00000E+00", b"2 2.0O000E+00", ("node block", "node 2", "x")),
        (b"2 2.00000E+00", b"2         NAN", ("node 2", "node block x", "nan")),
        (b" -1         2 2.0", b" -1         1 2.0", ("node block",)),
    ],
)
def test_a_damaged_mesh_is_said(write_frd, old, new, shown):
    path = write_frd([])
    content = path.read_bytes()
    assert content.count(old) == 1
    path.write_bytes(content.replace(old, new))
    with pytest.raises(ResultError, match=naming(path.name, *shown)):
        mesh_of(path)


@pytest.mark.parametrize(
    ("old", "new", "shown"),
    [
        (b"1.00000E+00", b"1.0000xE+00", ("node 2", "SYY", "' 1.0000xE+00'")),
        (b" -1         2", b" -1       2 x", ("record 2 of 2",)),
        (b" -1         2", b" -5         2", ("record 2 of 2",)),
        (b" -4  STRESS      6", b" -4  STRESS  99999", ("STRESS", 99999)),
    ],
)
def test_a_damaged_record_is_named(write_frd, block, old, new, shown):
    records = [(1, [2.0] * 6), (2, [3.0, 1.0, 3.0, 3.0, 3.0, 3.0])]
    path = write_frd([block("STRESS", 1, 1e-3, records)])
    content = path.read_bytes()
    at = content.rindex(old)
    path.write_bytes(content[:at] + new + content[at + len(old) :])
    with pytest.raises(ResultError, match=naming(path.name, *shown)):
        list(read_fields(path, partial=True))


@pytest.mark.parametrize(
    ("increment", "step", "number", "time_ms"),
    [("last", 2, 2, 3.0), ("1:2", 1, 2, 1.0), ("2:1", 2, 1, 2.5), ("4", 1, 4, 2.0)],
)
def test_an_increment_is_chosen_by_number_or_step_and_number(
    samples, increment, step, number, time_ms
):
    field = read_field(samples / "cpe4_2step_mixed.frd", "STRESS", increment)
    assert (field.step, field.increment) == (step, number)
    assert field.time_ms == pytest.approx(time_ms)


@pytest.mark.parametrize("word", ["2", "first", "-1", "1:", "1:2:3", ""])
def test_a_word_that_chooses_no_increment_or_two_is_misuse(samples, word):
    with pytest.raises(
        UsageError, match=naming("increment", "1:2, 2:2" if word == "2" else "last, N")
    ):
        read_field(samples / "cpe4_2step_mixed.frd", "STRESS", word)
    with pytest.raises(ResultError, match=naming("cpe4_ascii.frd", 9, "DISP", "1:1 to 1:4")):
        read_field(samples / "cpe4_ascii.frd", "DISP", "9")


SHELL = """*NODE
1, 0, 0, 0
2, 1, 0, 0
3, 0, 1, 0
4, 1, 1, 0
5, .5, 0, 0
6, .5, 1, 0
7, 0, .5, 0
8, 1, .5, 0
*ELEMENT, TYPE=S8R, ELSET=E
1, 1, 2, 4, 3, 5, 8, 6, 7
*MATERIAL, NAME=A
*ELASTIC
1000, .3
*ORIENTATION, NAME=O
1, 0, 0, 0, 1, 0
*SHELL SECTION, ELSET=E, COMPOSITE
.1, , A, O
.2, , A, O
*BOUNDARY
1, 1, 6
3, 1, 6
7, 1, 6
*STEP
*STATIC
*CLOAD
2, 3, -.001
*NODE FILE, OUTPUT=3D
U
*END STEP
"""


@pytest.mark.solver
def test_layers_of_a_composite_shell_are_the_same_packed_as_printed(tmp_path):
    meshes = []
    for name, deck in (("text", SHELL), ("packed", SHELL.replace("FILE", "OUTPUT"))):
        (tmp_path / f"{name}.inp").write_text(deck)
        subprocess.run(["ccx", name], cwd=tmp_path, check=True, capture_output=True)
        held = describe(tmp_path / f"{name}.frd")
        assert (held["elements"], held["problem"]) == (2, None)
        assert shows(held["remarks"][0], 2)
        meshes.append(mesh_of(tmp_path / f"{name}.frd"))
    printed, packed = (mesh.cells[0] for mesh in meshes)
    assert np.array_equal(printed.rows, packed.rows)
    assert np.array_equal(printed.ids, packed.ids)
