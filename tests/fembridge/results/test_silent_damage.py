"""Damage that leaves a file readable: refused or said, never another number without a word."""

from pathlib import Path

import meshio
import numpy as np
import pytest

from fembridge.cli import main

FIXTURES = Path(__file__).parents[3] / "fixtures"
MARC, FRD = FIXTURES / "marc_samples", FIXTURES / "frd_samples"
NAN = np.float32(np.nan).tobytes()


def letters(word):
    """`word` as a .t16 has it, a character in four bytes."""
    return "".join(one + "   " for one in word).encode()


@pytest.fixture
def ingest(tmp_path, monkeypatch, capsys):
    """Exit code and stderr of ingest, in a folder of its own."""
    monkeypatch.chdir(tmp_path)

    def run(*words):
        capsys.readouterr()
        code = main(["ingest", *map(str, words)])
        return code, capsys.readouterr().err

    return run


WAYS = {
    "plastic": ("--field", "Plastic Strain"),
    "moved": ("--field", "Displacement"),
    "vtu": ("--vtu", "vtu"),
}


@pytest.mark.parametrize("block", ["52300", "52401"])
@pytest.mark.parametrize("way", WAYS)
def test_damaged_values_of_a_post_file_are_refused_whatever_is_asked(ingest, tmp_path, block, way):
    """The first record of the last block of a kind has another length, before it and behind."""
    content = bytearray((MARC / "nour_plastic.t16").read_bytes())
    at = content.rindex(letters(f"=beg={block}")) + 280 + 4
    end = at + 4 + int.from_bytes(content[at : at + 4], "little")
    assert end > at + 4
    content[at : end + 4] = (4).to_bytes(4, "little") + bytes(4) + (4).to_bytes(4, "little")
    path = tmp_path / "job.t16"
    path.write_bytes(content)
    code, said = ingest(path, *WAYS[way])
    assert code == 1
    assert f"block {block}" in said
    assert "--partial" in said
    assert sorted(one.name for one in tmp_path.iterdir()) == ["job.t16"]
    assert ingest(path, *WAYS[way], "--partial")[0] == 0


def test_a_block_under_another_number_is_damage(ingest, tmp_path):
    """52300 with one bit flipped is a block that real files have, and that is skipped."""
    content = (MARC / "nour_plastic.t16").read_bytes()
    at = content.rindex(letters("=beg=52300"))
    path = tmp_path / "job.t16"
    for other in ("53300", "52900"):
        path.write_bytes(content[:at] + letters(f"=beg={other}") + content[at + 40 :])
        code, said = ingest(path, "--field", "Plastic Strain")
        assert (code, other in said) == (1, True)


def test_an_increment_without_a_quantity_that_others_have_is_said(ingest, tmp_path):
    content = (MARC / "nour_plastic.t16").read_bytes()
    begin, end = letters("=beg=52300"), letters("=end=")
    at = content.rindex(begin) - 4
    behind = content.index(end, at) + len(end) + 4
    path = tmp_path / "job.t16"
    path.write_bytes(content[:at] + content[behind:])
    for way in (("--field", "Plastic Strain"), ("--vtu", "vtu")):
        code, said = ingest(path, *way)
        assert code == 0
        assert "no Plastic Strain in Global System in increments 23" in said


def test_nan_does_not_pass_into_a_picture_of_a_post_file(ingest, tmp_path):
    content = bytearray((MARC / "nour_plastic.t16").read_bytes())
    at = content.rindex(letters("=beg=52300")) + 280 + 4 + 4
    content[at : at + 4] = NAN
    path = tmp_path / "job.t16"
    path.write_bytes(content)
    code, said = ingest(path, "--vtu", "vtu")
    assert code == 0
    assert "left out: " in said
    assert "is nan" in said
    last = meshio.read(sorted((tmp_path / "vtu").glob("*.vtu"))[-1]).point_data
    assert last
    assert all(np.isfinite(values).all() for values in last.values())


@pytest.mark.parametrize("lost", ["last", "middle"])
@pytest.mark.parametrize("way", [("--node", "23"), ("--field", "STRESS")])
def test_a_frd_that_ends_well_and_lacks_stress_is_refused(ingest, tmp_path, lost, way):
    text = (FRD / "cpe4_ascii.frd").read_text()
    places = [k for k in range(len(text)) if text.startswith(" -4  STRESS", k)]
    name = places[-1] if lost == "last" else places[1]
    begin = text.rindex("    1PSTEP", 0, name)
    end = text.index(" -3\n", name) + 4
    path = tmp_path / "job.frd"
    path.write_text(text[:begin] + text[end:])
    code, said = ingest(path, *way)
    assert code == 1
    assert "has no STRESS" in said
    code, said = ingest(path, *way, "--partial")
    assert code == 0
    assert "dropped: step 1, increment" in said
    code, said = ingest(path, "--field", "DISP")
    assert (code, "blocks are missing" in said) == (0, True)


def test_a_step_without_stress_is_said(ingest, tmp_path):
    blocks = (FRD / "cpe4_2step_mixed.frd").read_bytes().split(b"    1PSTEP")
    first = [one.split(b"\n")[0].split()[-1:] == [b"1"] for one in blocks]
    kept = [
        block
        for block, of_first in zip(blocks, first, strict=True)
        if not (of_first and b" -4  STRESS" in block)
    ]
    assert len(kept) < len(blocks)
    path = tmp_path / "job.frd"
    path.write_bytes(b"    1PSTEP".join(kept))
    code, said = ingest(path, "--field", "STRESS")
    assert code == 0
    assert "left out: outputs without STRESS in step 1" in said


TABLES = {
    ".sta": (FRD / "vib_cpe4_bin_f64.sta", 10, "rows are missing, duplicate or not in order"),
    ".cvg": (FRD / "vib_cpe4_bin_f64.cvg", 29, "rows are missing, duplicate or not in order"),
    ".sts": (MARC / "nour_plastic.sts", 12, "rows are missing, duplicate or not in order"),
    ".dat": (
        FRD / "cpe4_ascii.dat",
        60,
        "strains for set EPROBE at 0.5 ms is damaged: points of an element",
    ),
}


@pytest.mark.parametrize("suffix", TABLES)
@pytest.mark.parametrize("how", ["lost", "duplicate"])
def test_a_print_with_a_row_lost_or_duplicate_is_no_table(ingest, tmp_path, suffix, how):
    source, number, words = TABLES[suffix]
    lines = source.read_bytes().decode().splitlines(keepends=True)
    lines[number : number + (how == "lost")] = [] if how == "lost" else [lines[number]]
    path = tmp_path / f"job{suffix}"
    path.write_text("".join(lines), newline="")
    code, said = ingest(path, "-o", "t.csv")
    assert (code, words in said) == (1, True), said
    assert not (tmp_path / "t.csv").exists()
    code, said = ingest(path, "-o", "t.csv", "--partial")
    assert code == 0
    assert words in said


def test_a_section_of_a_dat_lost_or_duplicate_is_said_or_refused(ingest, tmp_path):
    text = (FRD / "cpe4_ascii.dat").read_text()
    heads = [k for k in range(len(text)) if text.startswith(" stresses (", k)]
    ends = [text.find("\n \n", k) for k in heads]
    assert len(heads) > 3
    begin = heads[2]
    end = min(k for k in (text.find("\n " + w, begin + 1) for w in ("s", "d", "f", "t")) if k > 0)
    section = text[begin : end + 1]
    path = tmp_path / "job.dat"
    path.write_text(text[:begin] + text[end + 1 :])
    code, said = ingest(path, "-o", "t.csv")
    assert code == 0
    assert "there is no stresses for set" in said
    path.write_text(text[:begin] + section + text[begin:])
    code, said = ingest(path, "-o", "t.csv")
    assert code == 1
    assert "is duplicate" in said
    assert ends


@pytest.mark.parametrize("suffix", [".sta", ".cvg"])
def test_every_recorded_progress_is_in_order(ingest, suffix):
    paths = sorted(FIXTURES.rglob(f"*{suffix}"))
    assert len(paths) > 5
    for path in paths:
        code, said = ingest(path, "-o", "t.csv")
        assert code == 0 or "no rows" in said, said
