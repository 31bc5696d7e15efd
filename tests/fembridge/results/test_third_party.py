"""Recorded files by a plain reader, among them those of Debian's calculix-ccx-test, if installed.

Those were written by other people with CalculiX 2.11 and are GPL: they are read
where they stand and never copied. Frequency, buckling and cyclic modes, beams and
shells expanded to bricks, contact, fluid networks, up to sixty components. All files
where ``CI`` is set, one of sixteen elsewhere.
"""

import gzip
import os
import re
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from opened import naming

from fembridge.errors import ResultError
from fembridge.results import describe, read, read_fields
from fembridge.results.byte_file import ByteFile
from fembridge.results.frd import FrdIndex, node_ids
from fembridge.results.nodes import read_node_sets
from fembridge.results.printed import dat_sections
from fembridge.results.read_options import ReadOptions
from fembridge.results.readers import read_values

FOLDER = Path("/usr/share/doc/calculix-ccx-test/examples/test")
OF = 1 if os.environ.get("CI") == "true" else 16
FRD = sorted(p.name for p in FOLDER.glob("*.frd*") if "check" not in p.name)[OF - 1 :: OF]
DAT = sorted(path.name for path in FOLDER.glob("*.dat.ref*"))[OF - 1 :: OF]
DECKS = sorted(path.name for path in FOLDER.glob("*.inp*"))[OF - 1 :: OF]
OURS = ["cpe4_ascii.frd", "cpe4_nset_unsorted_dup.frd"]
HERE = pytest.mark.skipif(not FRD, reason="calculix-ccx-test is not installed")
LENIENT = ReadOptions(across_materials=True, stress_unit="Pa")


def unpacked(name, folder):
    """Write the file to `folder`, without ``.ref`` and ``.gz`` in its name."""
    content = (FOLDER / name).read_bytes()
    if name.endswith(".gz"):
        content = gzip.decompress(content)
    path = folder / re.sub(r"(\.ref)?(\.gz)?$", "", name)
    path.write_bytes(content)
    return path


def slow_blocks(path):
    """Read a file line by line, slowly and plainly: name and values by node."""
    blocks, now, node = [], None, 0
    for line in path.read_text("latin-1").splitlines():
        if line.startswith(" -4"):
            now = {}
            blocks.append((line[5:13].strip(), now))
        elif line.startswith(" -3"):
            now = None
        elif now is not None and line.startswith((" -1", " -2")):
            if line.startswith(" -1"):
                node = int(line[3:13])
                now[node] = []
            fields = line[13:].rstrip()
            now[node] += [float(fields[k : k + 12]) for k in range(0, len(fields), 12)]
    return blocks


@pytest.mark.parametrize("name", [*OURS, *FRD])
def test_every_value_of_every_file_is_what_a_plain_reader_reads(name, samples, tmp_path):
    path = samples / name if name in OURS else unpacked(name, tmp_path)
    expected = slow_blocks(path)
    held = describe(path)
    assert held["problem"] is None
    assert held["mesh_nodes"] > 0 and held["elements"] > 0 and held["quantities"]
    with ByteFile(path) as file:
        index = FrdIndex(file)
        assert (index.ended, index.damage) == (True, [])
        assert [block.name for block in index.blocks] == [name for name, _ in expected]
    for name in index.names:
        tables = [table for quantity, table in expected if quantity == name and table]
        fields = read_fields(path, name, stress_unit="Pa")
        for field, table in zip(fields, tables, strict=True):
            assert list(dict.fromkeys(field.nodes.tolist())) == list(table)
            assert_array_equal(field.values, [table[node] for node in field.nodes.tolist()])


@HERE
@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("segment.frd.ref.gz", (5, 2.66198)),
        ("twobeam.frd.gz", None),
        ("planestrain.frd.ref", None),
    ],
)
def test_modes_are_refused_as_a_history_and_increments_are_not(name, shown, tmp_path):
    path = unpacked(name, tmp_path)
    with ByteFile(path) as file:
        node = int(node_ids(file, FrdIndex(file).named("STRESS")[0])[0])
    if shown is None:
        assert read_values(path, [node], LENIENT)[1].shape[1:] == (1, 6)
        return
    with pytest.raises(ResultError, match=naming(*shown)):
        read(path, [node], across_materials=True)


@HERE
def test_every_print_is_read_to_its_end(tmp_path):
    count = 0
    for name in DAT:
        path = unpacked(name, tmp_path)
        for section in dat_sections(path, lambda *_: True, ReadOptions()):
            count += len(section.values)
            assert np.isfinite(section.values).all()
            assert len(section.labels) == len(section.values)
        path.unlink()
    assert count > 100_000 / OF / 2


@HERE
def test_the_sets_of_every_deck_are_read(tmp_path):
    count = 0
    for name in DECKS:
        path = unpacked(name, tmp_path)
        count += len(read_node_sets(path))
        path.unlink()
    assert count > 1000 / OF / 2
