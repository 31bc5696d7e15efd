"""Damage that leaves a file readable: refused or said, never another number without a word."""

from pathlib import Path

import meshio
import numpy as np
import pytest
from opened import shows

from fembridge.cli import main

FIXTURES = Path(__file__).parents[3] / "fixtures"
MARC, FRD = FIXTURES / "marc_samples", FIXTURES / "frd_samples"


def letters(word):
    """`word` as a .t16 has it, a character in four bytes."""
    return "".join(one + "   " for one in word).encode()


@pytest.fixture
def ingest(file, here, capsys):
    """Exit code and stderr of ingest of a file of this name and content."""

    def run(name, content, *words):
        file(name, content)
        capsys.readouterr()
        code = main(["ingest", name, *words])
        return code, capsys.readouterr().err

    return run


POST = (MARC / "nour_plastic.t16").read_bytes()
VALUES = POST.rindex(letters("=beg=52300"))
PLASTIC, MOVED = ("--field", "Plastic Strain"), ("--field", "Displacement")
PICTURES = ("--vtu", "vtu")


@pytest.mark.parametrize("block", ["52300", "52401"])
@pytest.mark.parametrize("way", [PLASTIC, MOVED, PICTURES], ids=lambda way: way[1])
def test_damaged_values_of_a_post_file_are_refused_whatever_is_asked(ingest, here, block, way):
    """The first record of the last block of a kind has another length, before it and behind."""
    content = bytearray(POST)
    at = content.rindex(letters(f"=beg={block}")) + 280 + 4
    end = at + 4 + int.from_bytes(content[at : at + 4], "little")
    assert end > at + 4
    content[at : end + 4] = (4).to_bytes(4, "little") + bytes(4) + (4).to_bytes(4, "little")
    code, said = ingest("job.t16", bytes(content), *way)
    assert (code, f"block {block}" in said, "--partial" in said) == (1, True, True)
    assert sorted(one.name for one in here.iterdir()) == ["job.t16"]
    assert ingest("job.t16", bytes(content), *way, "--partial")[0] == 0


@pytest.mark.parametrize("other", ["53300", "52900"])
def test_a_block_under_another_number_is_damage(ingest, other):
    """52300 with one bit flipped is a block that real files have, and that is skipped."""
    changed = POST[:VALUES] + letters(f"=beg={other}") + POST[VALUES + 40 :]
    code, said = ingest("job.t16", changed, *PLASTIC)
    assert (code, other in said) == (1, True)


@pytest.mark.parametrize("way", [PLASTIC, PICTURES], ids=lambda way: way[1])
def test_an_increment_without_a_quantity_that_others_have_is_said(ingest, way):
    end = letters("=end=")
    behind = POST.index(end, VALUES) + len(end) + 4
    code, said = ingest("job.t16", POST[: VALUES - 4] + POST[behind:], *way)
    assert code == 0
    assert shows(said, "Plastic Strain in Global System", 23)


def test_nan_does_not_pass_into_a_picture_of_a_post_file(ingest):
    at = VALUES + 280 + 4 + 4
    changed = POST[:at] + np.float32(np.nan).tobytes() + POST[at + 4 :]
    code, said = ingest("job.t16", changed, *PICTURES)
    assert (code, shows(said, "nan")) == (0, True)
    last = meshio.read(sorted(Path("vtu").glob("*.vtu"))[-1]).point_data
    assert last
    assert all(np.isfinite(values).all() for values in last.values())


@pytest.mark.parametrize("lost", [-1, 1])
@pytest.mark.parametrize("way", [("--node", "23"), ("--field", "STRESS")])
def test_a_frd_that_ends_well_and_lacks_stress_is_refused(ingest, lost, way):
    text = (FRD / "cpe4_ascii.frd").read_text()
    name = [k for k in range(len(text)) if text.startswith(" -4  STRESS", k)][lost]
    begin, end = text.rindex("    1PSTEP", 0, name), text.index(" -3\n", name) + 4
    less = text[:begin] + text[end:]
    code, said = ingest("job.frd", less, *way)
    assert (code, shows(said, "STRESS")) == (1, True)
    code, said = ingest("job.frd", less, *way, "--partial")
    assert (code, shows(said, "step 1, increment")) == (0, True)
    code, said = ingest("job.frd", less, "--field", "DISP")
    assert (code, shows(said, "number", "step 1")) == (0, True)


def test_a_step_without_stress_is_said(ingest):
    blocks = (FRD / "cpe4_2step_mixed.frd").read_bytes().split(b"    1PSTEP")
    first = [one.split(b"\n")[0].split()[-1:] == [b"1"] for one in blocks]
    kept = [
        block
        for block, of_first in zip(blocks, first, strict=True)
        if not (of_first and b" -4  STRESS" in block)
    ]
    assert len(kept) < len(blocks)
    code, said = ingest("job.frd", b"    1PSTEP".join(kept), "--field", "STRESS")
    assert (code, shows(said, "STRESS", "step 1")) == (0, True)


TABLES = {
    ".sta": (FRD / "vib_cpe4_bin_f64.sta", 10, "row"),
    ".cvg": (FRD / "vib_cpe4_bin_f64.cvg", 29, "row"),
    ".sts": (MARC / "nour_plastic.sts", 12, "row"),
    ".dat": (FRD / "cpe4_ascii.dat", 60, "EPROBE at 0.5 ms"),
}


@pytest.mark.parametrize("suffix", TABLES)
@pytest.mark.parametrize("how", ["lost", "duplicate"])
def test_a_print_with_a_row_lost_or_duplicate_is_no_table(ingest, suffix, how):
    source, number, words = TABLES[suffix]
    lines = source.read_bytes().splitlines(keepends=True)
    lines[number : number + (how == "lost")] = [] if how == "lost" else [lines[number]]
    damaged = f"job{suffix}", b"".join(lines), "-o", "t.csv"
    code, said = ingest(*damaged)
    assert (code, words in said) == (1, True), said
    assert not Path("t.csv").exists()
    code, said = ingest(*damaged, "--partial")
    assert (code, words in said) == (0, True), said


def test_a_section_of_a_dat_lost_or_duplicate_is_said_or_refused(ingest):
    text = (FRD / "cpe4_ascii.dat").read_text()
    begin = [k for k in range(len(text)) if text.startswith(" stresses (", k)][2]
    end = min(k for k in (text.find("\n " + w, begin + 1) for w in "sdft") if k > 0) + 1
    code, said = ingest("job.dat", text[:begin] + text[end:], "-o", "t.csv")
    assert (code, shows(said, "stresses for set", "ms")) == (0, True)
    code, said = ingest("job.dat", text[:end] + text[begin:], "-o", "t.csv")
    assert (code, shows(said, "stresses for set", "ms")) == (1, True)


@pytest.mark.parametrize("suffix", [".sta", ".cvg"])
def test_every_recorded_progress_is_in_order(ingest, suffix):
    paths = sorted(FIXTURES.rglob(f"*{suffix}"))
    assert len(paths) > 5
    for path in paths:
        code, said = ingest(path.name, path.read_bytes(), "-o", "t.csv")
        assert code == 0 or len(path.read_text().splitlines()) < 5, said
