"""Whole fields: every sample, what a writer knows, damage, and bounded memory."""

import gc
import json
import re
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from fembridge import read_fields
from fembridge.errors import ResultError, UsageError
from fembridge.results.derived import tensor_of
from fembridge.results.frd_format import table as frd_table
from fembridge.results.frd_format.field import Field, read_joined_fields
from fembridge.results.stress import von_mises_pa

SAMPLES = Path(__file__).parents[3] / "fixtures" / "frd_samples"
EXPECTED = json.loads((SAMPLES / "expected.json").read_text("utf-8"))
WITH_STRESS = [name for name, row in EXPECTED.items() if "von_mises_at_nodes" in row]
TOUCHING = re.compile(r" *[+-]?\d\.\d{5}[Ee][+-]\d{2,3}")


def plain_values(path, name):
    """Values of each block `name` of an ASCII file, line by line, by ``float``."""
    blocks, node, current = [], {}, None
    for line in path.read_bytes().decode("latin-1").split("\n"):
        if line.startswith(" -4"):
            current = line[5:13].strip()
        elif line.startswith(" -3") and current == name:
            blocks.append(node)
            node, current = {}, None
        elif line.startswith((" -1", " -2")) and current == name:
            found = [float(text) for text in TOUCHING.findall(line[13:])]
            key = int(line[3:13]) if line.startswith(" -1") else list(node)[-1]
            node.setdefault(key, []).extend(found)
    return blocks


@pytest.mark.parametrize("name", WITH_STRESS)
def test_von_mises_at_the_probes_is_what_an_independent_reader_found(name):
    known = EXPECTED[name]["von_mises_at_nodes"]
    fields = list(read_fields(SAMPLES / name, partial=True))
    assert_allclose([f.time_ms / 1e3 for f in fields], known["times"], rtol=1e-12)
    for node, stress_mpa in known["values"].items():
        stress_pa = [von_mises_pa(tensor_of_node(field, int(node))) for field in fields]
        assert_allclose(stress_pa, np.array(stress_mpa) * 1e6, rtol=1e-6)


def tensor_of_node(field, node):
    return tensor_of(field)[np.flatnonzero(field.nodes == node)[0]]


@pytest.mark.parametrize("name", ["cpe4_ascii", "cpe4_nset_unsorted_dup"])
@pytest.mark.parametrize("quantity", ["STRESS", "DISP", "ERROR"])
def test_every_number_is_the_float_of_its_text(samples, name, quantity):
    path = samples / f"{name}.frd"
    fields = list(read_fields(path, quantity, stress_unit="Pa"))
    blocks = plain_values(path, quantity)
    assert len(fields) == len(blocks) > 0
    for field, block in zip(fields, blocks, strict=True):
        if quantity != "ERROR" and name == "cpe4_ascii":
            assert field.nodes.tolist() == list(block)
        for node, row in zip(field.nodes.tolist(), field.values, strict=True):
            assert row.tolist() == block[node][: row.size]


def test_all_storages_of_one_run_agree_within_their_rounding(samples):
    exact, text, single = (
        list(read_fields(samples / f"cpe4_{how}.frd")) for how in ("bin_f64", "ascii", "bin_f32")
    )
    for known, printed, packed in zip(exact, text, single, strict=True):
        assert_array_equal(printed.nodes, known.nodes)
        assert_allclose(printed.values, known.values, rtol=5.1e-6, atol=1e-9)
        assert_allclose(packed.values, known.values, rtol=6e-8, atol=1e-9)


VALUES = st.floats(-1e30, 1e30, width=32).map(lambda x: float(f"{x:.5E}"))


@settings(deadline=None, max_examples=60)
@given(data=st.data(), flag=st.sampled_from([0, 1, 2, 3]), seed=st.integers(0, 99))
def test_what_was_written_is_read_whatever_the_storage(write_frd, block, data, flag, seed):
    count = data.draw(st.integers(1, 14), label="components")
    nodes = data.draw(st.lists(st.integers(1, 99_999), min_size=1, max_size=20), label="nodes")
    names = tuple(f"SDV{k}" for k in range(count))
    rng = np.random.default_rng(seed)
    tables = []
    for _ in range(2):
        values = rng.normal(size=(len(nodes), count)) * 10.0 ** rng.integers(-30, 30)
        if flag == 2:
            values = values.astype(np.float32).astype(np.float64)
        if flag < 2:
            values = np.array([[float(f"{x:.5E}") for x in row] for row in values])
        tables.append(values)
    path = write_frd(
        [
            block(
                "SDV",
                k,
                k * 1e-3,
                list(zip(nodes, values.tolist(), strict=True)),
                flag,
                components=names,
            )
            for k, values in enumerate(tables, start=1)
        ]
    )
    fields = list(read_fields(path, "SDV"))
    assert [field.increment for field in fields] == [1, 2]
    for field, values in zip(fields, tables, strict=True):
        assert field.components == names
        assert field.nodes.tolist() == nodes
        assert_array_equal(field.values, values)


def three_digits(value):
    text = f"{value:.5E}"
    return f"{text[:-2]}0{text[-2:]}".rjust(12)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("line_end", ["\n", "\r\n"])
@pytest.mark.parametrize("chunk_bytes", [1 << 20, 400])
def test_exponents_of_three_digits_are_read(
    write_frd, block, sign, line_end, chunk_bytes, monkeypatch
):
    monkeypatch.setattr("fembridge.results.frd_format.irregular.CHUNK_BYTES", chunk_bytes)
    values = [sign * 5.28012e-3, 3.06745e-3, sign, 0.0, 2e10, -1e-12, 7.5]
    names = tuple(f"SDV{k}" for k in range(7))
    records = [(node, [node * x for x in values]) for node in range(1, 30)]
    blocks = [
        block("SDV", k, k * 1e-3, records, components=names, number=three_digits) for k in (1, 2)
    ]
    path = write_frd(blocks, line_end=line_end)
    for at_once in (None, 10):
        fields = list(read_fields(path, "SDV", nodes_at_once=at_once))
        found = np.concatenate([f.values for f in fields if f.increment == 2])
        expected = [[float(f"{x:.5E}") for x in row] for _, row in records]
        assert found.tolist() == expected


def test_lines_that_end_as_in_windows_are_read(write_frd, block):
    path = write_frd([block("STRESS", 1, 1e-3, [(1, range(6))])], line_end="\r\n")
    (field,) = read_fields(path, stress_unit="Pa")
    assert field.values.tolist() == [[0, 1, 2, 3, 4, 5]]


def test_units_are_said_and_applied(samples):
    path = samples / "cpe4_ascii.frd"
    joined = next(read_joined_fields(path, ("STRESS", "DISP", "TOSTRAIN", "FORC", "CONTACT")))
    assert {name: field.units[0] for name, field in joined.items()} == {
        "STRESS": "Pa", "DISP": "mm", "TOSTRAIN": "1", "FORC": "N", "CONTACT": "mm",
    }  # fmt: skip
    contact = joined["CONTACT"]
    assert contact.units[contact.components.index("CPRESS")] == "Pa"
    raw = next(read_fields(path, "CONTACT", stress_unit="Pa"))
    for name, factor in (("CPRESS", 1e6), ("COPEN", 1.0)):
        assert_array_equal(contact.component(name), factor * raw.component(name))


def test_quantities_are_joined_by_step_and_increment(samples):
    """The run diverged: a last DISP has no STRESS, and never converged."""
    path, said = samples / "cpe4_diverged.frd", []
    joined = list(read_joined_fields(path, partial=True, tell=said.append))
    assert [set(fields) for fields in joined] == [{"STRESS", "DISP"}]
    assert joined[0]["STRESS"].key == joined[0]["DISP"].key == (1, 1)
    assert any("increment 2: not converged" in words for words in said)


def test_an_increment_that_has_only_one_of_two_quantities_is_refused(write_frd, block):
    disp = [block("DISP", k, k * 1e-3, [(1, (0, 0, 0))]) for k in (1, 2)]
    stress = block("STRESS", 1, 1e-3, [(1, range(6))])
    path = write_frd([disp[0], stress, disp[1]])
    with pytest.raises(ResultError, match="step 1, increment 2 has no STRESS"):
        read_joined_fields(path)
    assert len(list(read_joined_fields(path, partial=True))) == 1


@pytest.mark.parametrize(
    ("code", "word", "axis"),
    [
        (b" 2", b"MODAL     ", "frequency in cycles per time"),
        (b" 4", b"MODAL     ", "buckling factor"),
    ],
)
def test_a_mode_has_a_number_and_no_time(write_frd, block, code, word, axis):
    path = write_frd([block("DISP", 1, 0.25, [(1, (1, 2, 3))])])
    content = bytearray(path.read_bytes())
    at = content.index(b"  100CL")
    content[at + 56 : at + 58], content[at + 63 : at + 73] = code, word
    path.write_bytes(content)
    (field,) = read_fields(path, "DISP")
    assert np.isnan(field.time_ms)
    assert (field.axis, field.axis_value) == (axis, 0.25)
    assert field.values.tolist() == [[1, 2, 3]]


def test_a_field_is_read_only_and_finds_its_nodes(samples):
    field = next(read_fields(samples / "cpe4_nset_unsorted_dup.frd"))
    assert field.nodes.tolist() == [25, 11, 18, 11]
    assert_array_equal(field.at([11, 25]), field.values[[1, 0]])
    with pytest.raises(ValueError, match="read-only"):
        field.values[0, 0] = 0.0
    with pytest.raises(UsageError, match="has no node 12"):
        field.at([12])
    with pytest.raises(UsageError, match="no component 'SXZ'"):
        field.component("SXZ")


def test_a_field_cannot_be_made_of_arrays_that_do_not_fit():
    with pytest.raises(ValueError, match=r"expected \(2, 1\), got \(3, 1\)"):
        Field("DISP", 1, 1, 1.0, ("D1",), ("mm",), np.arange(2), np.zeros((3, 1)))


def test_node_numbers_that_repeat_are_kept_once(samples):
    first, second, *_ = read_fields(samples / "cpe4_ascii.frd")
    assert np.shares_memory(first.nodes, second.nodes)


def test_parts_of_an_increment_are_the_whole(samples):
    path = samples / "cpe4_ascii.frd"
    whole = list(read_fields(path))
    parts = list(read_fields(path, nodes_at_once=20))
    assert [(p.increment, p.first_row, p.nodes.size) for p in parts[:3]] == [
        (1, 0, 20), (1, 20, 20), (1, 40, 7),
    ]  # fmt: skip
    for field in whole:
        mine = [p.values for p in parts if p.increment == field.increment]
        assert_array_equal(np.concatenate(mine), field.values)


@pytest.mark.parametrize("flag", [0, 1, 2, 3])
def test_a_block_larger_than_a_chunk_is_read_whole(write_frd, block, flag, monkeypatch):
    monkeypatch.setattr(frd_table, "CHUNK_BYTES", 500)
    records = [(node, [node * x for x in range(6)]) for node in range(1, 90)]
    path = write_frd([block("STRESS", 1, 1e-3, records, flag)])
    (field,) = read_fields(path, stress_unit="Pa")
    assert field.values.tolist() == [list(row) for _, row in records]


@pytest.mark.parametrize("flag", [1, 2])
def test_memory_beside_the_arrays_that_come_out_does_not_grow(write_frd, block, flag, monkeypatch):
    """20 increments of 20 000 nodes: 35 MB of text, 1.1 MB an increment here."""
    # Made and dropped untouched: no memory, though it is counted as if it were.
    monkeypatch.setattr("fembridge.results.frd_format.field._KEPT_BYTES", 0)
    nodes = 20_000
    records = [(node, [float(node)] * 6) for node in range(1, nodes + 1)]
    body = [block("STRESS", 1, 1e-3, records, flag)]
    one = write_frd(body, name=f"one{flag}.frd").read_bytes()
    at, end = one.index(b"    1PSTEP"), one.rindex(b" 9999")
    path = write_frd([], name=f"many{flag}.frd")
    with path.open("wb") as file:
        file.write(one[:at])
        for k in range(1, 21):
            output = bytearray(one[at:end])
            output[36:48] = b"%12d" % k
            output[72 + 1 : 85] = b"%12.5E" % (k * 1e-3)
            file.write(output)
        file.write(b" 9999\n")
    del one, records, body, output
    gc.collect()
    tracemalloc.start()
    try:
        count = sum(field.nodes.size for field in read_fields(path))
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.reset_peak()
        parts = sum(f.nodes.size for f in read_fields(path, nodes_at_once=1000))
        peak_in_parts = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert count == parts == 20 * nodes
    assert peak < 2 * nodes * 7 * 8 + 4e6  # the field before is still held
    assert peak_in_parts < 4e6
