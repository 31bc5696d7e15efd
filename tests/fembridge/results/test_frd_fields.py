"""Whole fields and the mesh: every sample, what a writer knows, damage, bounded memory."""

import re
import subprocess
import weakref

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal
from opened import mesh_of, read_field

from fembridge.errors import ResultError, UsageError
from fembridge.results import describe, read_fields
from fembridge.results.byte_file import ByteFile
from fembridge.results.frd import KIND_OF_TYPE, NODES_OF_TYPE

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
    assert_array_equal(field.at([11, 25]), field.values[[1, 0]])
    with pytest.raises(ValueError):
        field.values[0, 0] = 0.0
    with pytest.raises(UsageError, match="has no node 12"):
        field.at([12])
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


@settings(deadline=None)
@given(
    kinds=ELEMENTS,
    mesh_flag=st.sampled_from([1, 2]),
    line_end=st.sampled_from(["\n", "\r\n"]),
    runs=st.integers(1, 40),
    seed=st.integers(0, 99),
)
def test_any_mix_of_elements_is_read_as_it_was_written(
    write_frd, kinds, mesh_flag, line_end, runs, seed
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
    grid = mesh_of(path)
    assert grid.nodes.tolist() == nodes
    assert grid.points_mm.tolist() == [[node, 0, 0] for node in nodes]
    assert grid.materials == {1: "EPI", 2: "DER"}
    numbered = [(number, *row) for number, row in enumerate(elements, start=1)]
    assert [cells.kind for cells in grid.cells] == [
        KIND_OF_TYPE[kind] for kind in sorted({kind for kind, _, _ in elements})
    ]
    for cells in grid.cells:
        mine = [row for row in numbered if KIND_OF_TYPE[row[1]] == cells.kind]
        assert cells.ids.tolist() == [number for number, *_ in mine]
        assert cells.material.tolist() == [material for _, _, material, _ in mine]
        assert grid.nodes[cells.rows].tolist() == [corners for *_, corners in mine]
    met = [
        len({material for _, material, corners in elements if node in corners}) for node in nodes
    ]
    assert grid.met.tolist() == met


@pytest.mark.parametrize("mesh_flag", [1, 2])
@pytest.mark.parametrize("chunk_bytes", [300, 997, 5000])
def test_a_mesh_larger_than_a_chunk_is_read_whole(write_frd, mesh_flag, chunk_bytes, monkeypatch):
    monkeypatch.setattr("fembridge.results.frd.CHUNK_BYTES", chunk_bytes)
    monkeypatch.setattr("fembridge.results.frd._TEXT_BYTES", chunk_bytes)
    nodes = list(range(1, 130))
    elements = [(9, 1, range(k, k + 4)) for k in range(1, 99)]
    elements[50:50] = [(4, 2, range(k, k + 20)) for k in range(1, 77)]
    path = write_frd([], nodes=nodes, elements=elements, mesh_flag=mesh_flag)
    mesh = mesh_of(path)
    hex20, quad4 = mesh.cells
    assert (hex20.kind, quad4.kind) == ("hex20", "quad4")
    assert mesh.nodes[hex20.rows].tolist() == [list(range(k, k + 20)) for k in range(1, 77)]
    assert mesh.nodes[quad4.rows].tolist() == [list(range(k, k + 4)) for k in range(1, 99)]
    assert quad4.ids.tolist() == [*range(1, 51), *range(127, 175)]


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
    assert_array_equal(grid.met == 2, on_boundary)


def test_blank_counts_and_beams_are_read(samples):
    """As in the file of the last iterations: contact springs are two-node beams."""
    grid = mesh_of(samples / "cpe4_lastiter_ResultsForLastIterations.frd")
    assert grid.nodes.size == 188
    assert [(c.kind, c.rows.shape) for c in grid.cells] == [("hex8", (30, 8)), ("line2", (112, 2))]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (b" -2         1         2", b" -2         1         x", "is no element"),
        (b" -2         1         2", b" -2         1        77", "has node 77"),
        (b"    9    0    1", b"   10    0    1", "type 10 has 4 nodes, expected 8"),
        (b"    9    0    1", b"   19    0    1", "type 19 has 4 nodes"),
        (b" -1         1    9", b" -1         x    9", "is no element"),
        (b"2 2.00000E+00", b"2 2.0O000E+00", "node block, node 2, x: "),
        (b"2 2.00000E+00", b"2         NAN", "node 2 at 0 ms: node block x is nan"),
        (b" -1         2 2.0", b" -1         1 2.0", "a node is duplicate"),
    ],
)
def test_a_damaged_mesh_is_said(write_frd, old, new, words):
    path = write_frd([])
    content = path.read_bytes()
    assert content.count(old) == 1
    path.write_bytes(content.replace(old, new))
    with pytest.raises(ResultError, match=words):
        mesh_of(path)


@pytest.mark.parametrize("flag", [1, 2, 3])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_number_that_is_not_finite_is_refused_or_left_out(write_frd, block, flag, value):
    good = [(n, [1.0] * 6) for n in (1, 2)]
    bad = [(1, [1.0] * 6), (2, [1.0, value, 1.0, 1.0, 1.0, 1.0])]
    path = write_frd(
        [block("STRESS", k, k * 1e-3, bad if k == 2 else good, flag) for k in (1, 2, 3)]
    )
    words = f"node 2 at 2 ms: STRESS SYY is {value}"
    with pytest.raises(ResultError, match=words):
        list(read_fields(path))
    said = []
    fields = list(read_fields(path, partial=True, log=said.append))
    assert [field.increment for field in fields] == [1, 3]
    assert said == [f"dropped step 1, increment 2: {words}"]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (b"1.00000E+00", b"1.0000xE+00", r"node 2, SYY: ' 1.0000xE\+00' is no number"),
        (b" -1         2", b" -1       2 x", "record 2 of 2 begins with"),
        (b" -1         2", b" -5         2", "record 2 of 2 begins with"),
    ],
)
def test_a_damaged_record_is_named(write_frd, block, old, new, words):
    records = [(1, [2.0] * 6), (2, [3.0, 1.0, 3.0, 3.0, 3.0, 3.0])]
    path = write_frd([block("STRESS", 1, 1e-3, records)])
    content = path.read_bytes()
    at = content.rindex(old)
    path.write_bytes(content[:at] + new + content[at + len(old) :])
    with pytest.raises(ResultError, match=words):
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
    with pytest.raises(UsageError, match="in 2 steps: 1:2, 2:2" if word == "2" else "last, N"):
        read_field(samples / "cpe4_2step_mixed.frd", "STRESS", word)


def test_an_increment_that_is_absent_is_named_beside_those_there(samples):
    with pytest.raises(ResultError, match="no increment 9 of DISP, it has 1:1 to 1:4"):
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
        assert "holds 2 times as many" in held["remarks"][0]
        meshes.append(mesh_of(tmp_path / f"{name}.frd"))
    printed, packed = (mesh.cells[0] for mesh in meshes)
    assert np.array_equal(printed.rows, packed.rows)
    assert np.array_equal(printed.ids, packed.ids)
