"""Recorded files beside `plain_results`: those of Debian's calculix-ccx-test too, if installed.

Those were written by other people with CalculiX 2.11 and are GPL: they are read
where they stand and never copied. Frequency, buckling and cyclic modes, beams and
shells expanded to bricks, contact, fluid networks, up to sixty components. All files
where ``CI`` is set, one of sixteen elsewhere.
"""

import gzip
import os
import re
from pathlib import Path

import pytest
from opened import naming
from plain_results import compare_dat, compare_frd

from fembridge.errors import ResultError
from fembridge.results import describe, read
from fembridge.results.byte_file import ByteFile
from fembridge.results.frd import FrdIndex, node_ids
from fembridge.results.nodes import read_node_sets
from fembridge.results.read_options import ReadOptions
from fembridge.results.readers import read_values

FOLDER = Path("/usr/share/doc/calculix-ccx-test/examples/test")
OF = 1 if os.environ.get("CI") == "true" else 16
FRD = sorted(p.name for p in FOLDER.glob("*.frd*") if "check" not in p.name)[OF - 1 :: OF]
DAT = sorted(path.name for path in FOLDER.glob("*.dat.ref*"))[OF - 1 :: OF]
DECKS = sorted(path.name for path in FOLDER.glob("*.inp*"))[OF - 1 :: OF]
OURS = ["cpe4_ascii.frd", "cpe4_nset_unsorted_dup.frd", "cpe4_2step_mixed.frd"]
OURS += ["cpe4_bin_f32.frd", "cpe4_bin_f64.frd"]
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


@pytest.mark.parametrize("name", [*OURS, *FRD])
def test_every_number_of_every_file_is_what_a_plain_reader_reads(name, samples, tmp_path):
    path = samples / name if name in OURS else unpacked(name, tmp_path)
    assert describe(path)["problem"] is None
    assert compare_frd(path) > 40


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
def test_every_printed_number_is_what_a_plain_reader_reads(tmp_path):
    count = 0
    for name in DAT:
        path = unpacked(name, tmp_path)
        count += compare_dat(path)
        path.unlink()
    assert count > 500_000 / OF / 4


@HERE
def test_the_sets_of_every_deck_are_read(tmp_path):
    count = 0
    for name in DECKS:
        path = unpacked(name, tmp_path)
        count += len(read_node_sets(path))
        path.unlink()
    assert count > 1000 / OF / 2
