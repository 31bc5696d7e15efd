"""Result files that contradict themselves: refused or noted, never another number alone."""

import gzip
import random
import re
import struct
from pathlib import Path

import pytest
from opened import naming, shows
from test_abaqus_dat import AT_NODES, END, TITLE, increment, nodal, table

from fembridge.cli import main
from fembridge.errors import ResultError, UsageError
from fembridge.results import read, read_fields, read_history
from fembridge.results.printed import print_rows
from fembridge.results.read_options import ReadOptions
from fembridge.results.readers import read_values
from fembridge.results.status import read_sta

FIXTURES = Path(__file__).parents[3] / "fixtures"
FRD, MARC = FIXTURES / "frd_samples", FIXTURES / "marc_samples"
MUTATIONS = 12  # of each file; thousands were run by hand


@pytest.fixture
def ingest(file, capsys):
    """Exit code, stderr and table of ingest of a file of this name and content."""

    def run(name, content, *words):
        path = file(name, content)
        output = path.with_name("t.csv")
        output.unlink(missing_ok=True)
        capsys.readouterr()
        code = main(["ingest", str(path), "-o", str(output), *words])
        said = capsys.readouterr().err
        return code, said, output.read_text() if output.exists() else ""

    return run


# ---- Nodes of a .frd


def renumbered(name, old, new, block=-1):
    """A binary .frd with a node number of one STRESS block changed."""
    content = bytearray((FRD / name).read_bytes())
    starts = [match.end() for match in re.finditer(rb" -4  STRESS", content)]
    at = content.index(struct.pack("<i", old), content.index(b"\n -5  SZX", starts[block]))
    content[at : at + 4] = struct.pack("<i", new)
    return bytes(content)


@pytest.mark.parametrize("ways", [("--node", "all"), ("--node", "28"), ("--field", "STRESS")])
@pytest.mark.parametrize("name", ["cpe4_bin_f32.frd", "cpe4_bin_f64.frd"])
def test_a_node_of_a_block_that_the_mesh_has_not_is_refused(ingest, name, ways):
    content = renumbered(name, 28, 69)
    code, said, _ = ingest("job.frd", content, *ways)
    assert code == 1
    assert shows(said, "STRESS of step 1, increment 4", 69)
    code, said, rows = ingest("job.frd", content, *ways, "--partial")
    assert shows(said, "STRESS")
    if ways == ("--node", "28"):
        assert (code, shows(said, 28)) == (1, True)
    assert ",69," not in rows


def test_a_node_that_becomes_another_one_of_the_mesh_has_two_values(ingest):
    code, said, _ = ingest("job.frd", renumbered("cpe4_bin_f64.frd", 28, 29), "--node", "all")
    assert (code, shows(said, "increment 4", 29)) == (1, True)


def test_a_text_block_with_a_node_of_no_mesh_is_refused(ingest):
    lines = (FRD / "cpe4_ascii.frd").read_bytes().splitlines(keepends=True)
    last = [k for k, line in enumerate(lines) if line.startswith(b" -4  STRESS")][-1]
    row = next(k for k in range(last, len(lines)) if lines[k].startswith(b" -1        28"))
    lines[row] = lines[row].replace(b"28", b"69", 1)
    code, said, _ = ingest("job.frd", b"".join(lines), "--field", "STRESS")
    assert (code, shows(said, 69)) == (1, True)


def test_other_nodes_than_in_the_block_before_are_noted(block, write_frd, logged):
    """The output of a set: all its nodes are in the mesh, before and after the damage."""
    blocks = [
        block("STRESS", k, k * 1e-3, [(2, [1.0] * 6), (4 if k == 3 else 3, [2.0] * 6)], 3)
        for k in (1, 2, 3)
    ]
    notes = logged
    read_history(write_frd(blocks), "all")
    shown = "STRESS of step 1, increment 3", 4, "STRESS of step 1, increment 1", 3
    assert any(shows(note, *shown) for note in notes)


def test_a_field_of_a_set_is_compared_with_the_other_increments(ingest):
    content = renumbered("cpe8r_nset_bin_f32.frd", 67, 97)
    code, said, _ = ingest("job.frd", content, "--field", "STRESS")
    assert (code, shows(said, "increment 4", 97, "STRESS of step 1, increment 1", 67)) == (
        0,
        True,
    )


def test_a_sign_or_a_digit_of_an_exponent_that_is_lost_or_added_is_refused(ingest):
    text = (FRD / "cpe4_ascii.frd").read_text()
    row = " -1        25 8.55068E-03-9.74471E-03"
    assert row in text
    for new in (row.replace("-9.7", "9.7"), row.replace("E-03-", "E-030-")):
        code, said, _ = ingest("job.frd", text.replace(row, new), "--node", "25")
        assert (code, "STRESS of step 1, increment 2" in said) == (1, True)


def test_springs_that_open_and_close_have_other_nodes_without_a_word(block, write_frd, logged):
    names = ("COPEN", "CSLIP1")
    blocks = [
        block("CONTACT", k, k * 1e-3, [(node, [1.0, 2.0]) for node in nodes], 3, components=names)
        for k, nodes in enumerate([(1, 2), (2, 3), (2,)], start=1)
    ]
    notes = logged
    read_history(write_frd(blocks), "all", quantity="CONTACT")
    assert notes == []


@pytest.mark.parametrize(
    ("how", "shown"),
    [
        ({"increment": 2, "time_s": 3e-3}, (0.002, "STRESS of step 1, increment 2", 0.003)),
        ({"time_s": 1e-4}, ("DISP of step 1, increment 2", 0.002)),
        ({"name": "STRESQ"}, ("STRESQ", "STRESS")),
    ],
)
def test_headers_that_contradict_each_other_are_noted(block, write_frd, how, shown, logged):
    tensor = ("SXX", "SYY", "SZZ", "SXY", "SYZ", "SZX")
    blocks = []
    for k in (1, 2, 3):
        blocks.append(block("DISP", k, k * 1e-3, [(1, [1.0] * 3)], 3))
        stress = {"name": "STRESS", "increment": k, "time_s": k * 1e-3} | (how if k == 2 else {})
        blocks.append(block(**stress, records=[(1, [1.0] * 6)], flag=3, components=tensor))
    notes = logged
    read_history(write_frd(blocks), [1], quantity="displacement")
    assert any(shows(note, *shown) for note in notes), notes


# ---- Prints of CalculiX

DAT = (FRD / "cpe4_ascii.dat").read_text()
SECTIONS = re.split(r"(?=\n [a-z])", DAT)
CONTACT = [part for part in SECTIONS if " contact " in part]
NO_CONTACT_DISPLACEMENT = [part for part in CONTACT if part.startswith("\n contact stress")]


def without_line(text, number):
    lines = text.splitlines(keepends=True)
    return "".join(lines[:number] + lines[number + 1 :])


def doubled_line(text, number):
    lines = text.splitlines(keepends=True)
    return "".join([*lines[: number + 1], *lines[number:]])


@pytest.mark.parametrize("change", [without_line, doubled_line])
@pytest.mark.parametrize("words", [(), ("--quantity", "contact stress")])
def test_a_contact_row_lost_or_duplicate_is_refused_where_another_section_has_it(
    ingest, change, words
):
    parts = [*CONTACT[:3], change(CONTACT[3], 9), *CONTACT[4:]]
    code, said, _ = ingest("job.dat", "".join(parts), *words)
    assert code == 1
    assert shows(said, "contact stress for all contact elements at 1 ms", "relative contact")


@pytest.mark.parametrize("change", [without_line, doubled_line])
def test_a_contact_row_lost_or_duplicate_is_noted_where_no_other_section_shows_it(ingest, change):
    parts = NO_CONTACT_DISPLACEMENT
    counts = [len(part.strip().splitlines()) - 2 for part in parts]
    counts[2] += 1 if change is doubled_line else -1
    code, said, _ = ingest("job.dat", "".join([*parts[:2], change(parts[2], 9), *parts[3:]]))
    assert (code, shows(said, f"{counts[2]} at 1.5 ms")) == (0, True)


def test_the_count_of_contact_elements_contradicts_a_lost_row(ingest):
    count = "\n total number of contact elements for time  0.5000000E-03\n\n{:17}\n"
    section = NO_CONTACT_DISPLACEMENT[0]
    rows = len(section.strip().splitlines()) - 2
    assert ingest("job.dat", section + count.format(rows))[0] == 0
    code, said, _ = ingest("job.dat", without_line(section, 9) + count.format(rows))
    assert (code, shows(said, "total number of contact elements", rows)) == (1, True)


@pytest.mark.parametrize("words", [(), ("--quantity", "relative contact displacement")])
@pytest.mark.parametrize("blank_lines", [1, 2])
def test_records_whose_header_is_lost_are_of_no_other_section(ingest, words, blank_lines):
    """Stress behind displacements of contact would be a displacement in mm."""
    lines = CONTACT[1].splitlines(keepends=True)
    assert (lines[0], lines[2]) == ("\n", "\n")
    assert lines[1].startswith(" contact stress")
    text = "".join([CONTACT[0], *"\n" * blank_lines, *lines[3:], *CONTACT[2:]])
    code, said, _ = ingest("job.dat", text, *words)
    assert (code, shows(said, "job.dat", "contact")) == (1, True)
    code, said, rows = ingest("job.dat", text, *words, "--partial")
    assert (code, shows(said, "contact")) == (0, True)
    assert rows.count("\n0.5,,") == 3 * (len(CONTACT[0].strip().splitlines()) - 2)


@pytest.mark.parametrize(
    ("old", "new", "shown"),
    [
        (" stresses (", " strasses (", ("'strasses'",)),
        ("sxx,syy", "sxx,sxy", ("stresses", "sxx sxy")),
    ],
)
def test_a_header_that_calculix_does_not_write_is_noted(ingest, old, new, shown):
    text = "".join(part.replace(old, new) for part in SECTIONS)
    code, said, _ = ingest("job.dat", text)
    assert (code, shows(said, *shown)) == (0, True)


def test_every_recorded_print_is_read_without_a_doubt(ingest):
    paths = [path for path in FIXTURES.rglob("*.dat") if b"time " in path.read_bytes()[:200]]
    assert len(paths) > 5
    for path in paths:
        code, said, _ = ingest("job.dat", path.read_bytes())
        assert code == 0
        assert all(shows(line, "contact") for line in said.splitlines()), said


# ---- Prints of Abaqus

SKIN = f"von mises stress at nodes {table(AT_NODES.format('SKIN'), '', [], []).split(chr(10))[1]}"


def abaqus(count=6):
    return [increment(k, 0.0005, [nodal("SKIN", (4, 7), 0.001 * k)]) for k in range(1, count + 1)]


@pytest.mark.parametrize("row", [0, 2, 5])
@pytest.mark.parametrize("words", [(), ("--node", "4")])
def test_an_increment_whose_table_is_damaged_is_named(ingest, row, words):
    parts = abaqus()
    parts[row] = parts[row].replace("FOLLOWING TABLE", "FOLLOWIN  TABLE")
    code, said, _ = ingest("job.dat", TITLE + "".join(parts) + END, *words)
    assert code == 0
    named = shows(said, f"increments {row + 1}", "step 1", "1 of 6")
    assert named or shows(said, "increment", "step 1")


def test_tables_of_every_third_increment_and_the_last_are_noted_as_such(ingest):
    parts = [
        increment(k, 0.0005, [nodal("SKIN", (4,), 1.0)] if k in (3, 6, 8) else [])
        for k in range(1, 9)
    ]
    code, said, _ = ingest("job.dat", TITLE + "".join(parts) + END)
    assert (code, shows(said, 3, "step 1")) == (0, True)
    assert "in increments" not in said


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("STEP TIME COMPLETED       1.50E-03", "STEP TIME COMPLETED       1.5xE-03", "1.5xE-03"),
        ("STEP TIME COMPLETED       1.50E-03", "STEP TIME COMPLETED        ", "STEP TIME"),
        ("STEP TIME COMPLETED       1.50E-03", "STEP TIME COMPLETED       1.50E+999", "1.50E+999"),
        ("STEP TIME COMPLETED       1.50E-03,  TOTAL TIME COMPLETED", "x", "increment 3"),
        ("STEP TIME COMPLETED       1.50E-03", "STEP TIME COMPLETED       1.90E-03", "1.90E-03"),
        ("INCREMENT     3 SUMMARY", "INCREMXNT     3 SUMMXRY", "INCREMENT"),
        ("INCREMENT     3 SUMMARY", "INCREMENT     5 SUMMARY", "increment 5"),
        ("NODE  FOOT-", "NODX  FOOT-", "line"),
        ("            NOTE\n", "            NXTE\n", "job.dat:"),
        ("           7       1.500E-03", "           x       1.500E-03", "job.dat:"),
        ("           7       1.500E-03", "           4       1.500E-03", "1.5 ms"),
    ],
)  # fmt: skip
def test_what_an_increment_of_abaqus_lacks_is_refused(ingest, old, new, words):
    parts = [increment(k, 0.0005, [nodal("SKIN", (4, 7), 0.0005 * k)]) for k in range(1, 7)]
    assert old in parts[2]
    parts[2] = parts[2].replace(old, new, 1)
    code, said, _ = ingest("job.dat", TITLE + "".join(parts) + END)
    assert (code, words in said) == (1, True), said


def test_a_lost_heading_of_a_step_contradicts_the_total_time(ingest):
    first = [increment(k, 0.1, [nodal("A", (1,), 1.0 * k)]) for k in (1, 2)]
    later = [
        increment(k, 0.1, [nodal("A", (1,), 2.0 + k)], total_s=0.2 + 0.1 * k, step=2)
        for k in (1, 2)
    ]
    text = TITLE + "".join([*first, *later]) + END
    assert ingest("job.dat", text)[0] == 0
    code, said, _ = ingest("job.dat", text.replace("S T E P       2", "S T X P       2"))
    assert (code, shows(said, 1, 2)) == (1, True)


# ---- Numbers and times

STA = """ SUMMARY OF JOB INFORMATION
  STEP      INC     ATT  ITRS     TOT TIME     STEP TIME      INC TIME
     1          1     1     7  {}  0.500000E-03  0.500000E-03
     1          2     1     4  0.100000E-02  0.100000E-02  0.500000E-03
"""


@pytest.mark.parametrize("time", ["0.100000E602", "0.10000E+308", "0.100000E-999"])
def test_a_time_out_of_range_is_no_time_of_a_status_file(file, time):
    with pytest.raises(ResultError, match=naming("job.sta:3", time)):
        read_sta(file("job.sta", STA.format(time)))


def test_times_of_a_status_file_that_do_not_add_up_are_noted(ingest):
    code, said, _ = ingest("job.sta", STA.format("0.700000E-03"))
    assert (code, shows(said, "total_time_ms", 1, 1.2)) == (0, True)
    assert ingest("job.sta", STA.format("0.500000E-03"))[1] == ""


def test_sums_of_a_status_file_of_marc_that_do_not_add_up_are_noted(ingest):
    text = (MARC / "nour_plastic.sts").read_text()
    code, said, _ = ingest("job.sts", text.replace("    38       0     1", "    39       0     1"))
    assert (code, shows(said, "total_cycles", 39, 38)) == (0, True)
    assert not shows(ingest("job.sts", text)[1], "total_cycles")


HEAD = "Time\tEquivalent Von Mises Stress Node 2\n"


@pytest.mark.parametrize("odd", ["1e308", "1_000", "٣", "１", "nan", "inf", "1e999"])
@pytest.mark.parametrize("row", [1, 3])
def test_a_number_of_a_plot_that_mentat_does_not_write_is_refused(ingest, odd, row):
    rows = [f"{k * 5e-4:g}\t0.5\n" for k in range(8)]
    rows[row] = f"{odd}\t0.5\n"
    code, said, _ = ingest("plot.txt", (HEAD + "".join(rows)).encode())
    assert code == 1
    assert shows(said, f"plot.txt:{row + 2}")


def test_a_row_of_a_plot_that_is_lost_or_duplicate_is_noted(ingest):
    rows = [f"{k * 5e-4:g}\t0.5\n" for k in range(12)]
    assert ingest("plot.txt", HEAD + "".join(rows))[1] == ""
    said = ingest("plot.txt", HEAD + "".join(rows[:5] + rows[6:]))[1]
    assert shows(said, "0.5 ms", 1, "2 to 3 ms")
    said = ingest("plot.txt", HEAD + "".join(rows[:5] + rows[4:]))[1]
    assert shows(said, "2 ms", "2 ms")


def test_a_time_of_marc_that_is_none_ends_the_file_there(file):
    content = bytearray((MARC / "nour_linear.t16").read_bytes())
    block = content.rindex("".join(one + "   " for one in "=beg=518").encode()[:32])
    at = block + 284 + 12 + 4
    content[at : at + 4] = struct.pack("<f", float("nan"))
    with pytest.raises(ResultError, match=naming("job.t16", "nan")):
        read_history(file("job.t16", bytes(content)), [5], quantity="displacement")


# ---- Numbers of nodes

HUGE = 99_999_999_999_999_999_999


@pytest.mark.parametrize("node", [HUGE, -HUGE, 2**63, 1.5, float("nan"), float("inf"), None])
@pytest.mark.parametrize("name", ["cpe4_ascii.frd", "nour_linear.t16"])
def test_a_node_that_no_solver_has_is_misuse(name, node):
    path = (MARC if name.endswith("t16") else FRD) / name
    with pytest.raises(UsageError, match=naming("nodes", node)):
        read(path, [node])
    with pytest.raises(UsageError, match=naming("nodes", node)):
        read_values(path, [node], quantity="displacement")


def test_a_field_has_no_node_beyond_all_numbers():
    field = next(read_fields(FRD / "cpe4_ascii.frd", "DISP"))
    with pytest.raises(UsageError, match=naming("nodes", HUGE)):
        field.values_at([HUGE])


@pytest.mark.parametrize("words", [("--node", str(HUGE)), ("--point", f"{HUGE}:1")])
def test_a_huge_number_on_the_command_line_is_one_line(ingest, words):
    name = "cpe4_ascii.dat" if words[0] == "--point" else "cpe4_ascii.frd"
    code, said, _ = ingest(name, (FRD / name).read_bytes(), *words)
    assert (code, str(HUGE) in said) == (2, True)


# ---- Small files that describe large ones


@pytest.mark.parametrize("name", ["job.dat.gz", "plot.txt.gz", "job.sta.gz", "job.frd.gz"])
@pytest.mark.parametrize("unit", [b"\0" * 64, b"\n", b"1 2\n"])
def test_a_bomb_of_any_format_is_refused(file, monkeypatch, name, unit):
    monkeypatch.setattr("fembridge.results.byte_file.SMALL_BYTES", 1 << 18)
    path = file(name, gzip.compress(unit * ((1 << 21) // len(unit))))
    with pytest.raises(ResultError):
        list(print_rows(path, ReadOptions())) if "dat" in name or "sta" in name else read(path, [1])


def test_blank_lines_are_counted_and_not_walked(file):
    lines = "\n" * 1_000_000
    path = file("job.dat", f"{lines} displacements (vx,vy,vz) for set N and time  0.5E-03\n\n1_0\n")
    with pytest.raises(ResultError, match=r"job\.dat:1000003: "):
        list(print_rows(path, ReadOptions()))


def test_other_nodes_at_each_output_make_no_table_beyond_the_memory(block, write_frd, monkeypatch):
    monkeypatch.setattr("fembridge.host.memory.SMALL_BYTES", 1 << 16)
    monkeypatch.setattr("fembridge.host.memory.MAX_RATIO", 10)
    blocks = [block("DISP", k, k * 1e-3, [(k, [1.0] * 3)], 3) for k in range(1, 300)]
    with pytest.raises(ResultError, match=naming("written.frd", "DISP")):
        read_history(write_frd(blocks, mesh_flag=3), "all", quantity="DISP")


def test_a_line_of_an_element_that_is_none_takes_no_memory(small_run, write_frd):
    content = write_frd(small_run(2)).read_bytes()
    at = content.index(b" -3\n", content.index(b"    3C"))
    path = write_frd(small_run(2), name="long.frd")
    path.write_bytes(content[:at] + b" -2" + b"1" * 60_000 + b"\n" * 60_000 + content[at:])
    with pytest.raises(ResultError, match=naming("long.frd", 60_003)):
        read_values(path, [1, 3])


# ---- Seeded damage


def damaged(content, rng):
    """One byte, one line, or one number changed."""
    lines = content.splitlines(keepends=True)
    row, kind = rng.randrange(len(lines)), rng.choice(["lost", "twice", "letter", "odd"])
    if kind == "lost":
        return b"".join(lines[:row] + lines[row + 1 :])
    if kind == "twice":
        return b"".join([*lines[: row + 1], *lines[row:]])
    pattern = rb"[A-Za-z]" if kind == "letter" else rb"[-+]?\d[\d.Ee+-]*"
    places = list(re.finditer(pattern, content))
    place = rng.choice(places)
    odd = rng.choice([b"1e308", b"nan", b"1_000", b"99999999999999999999", b"0.1E602", b"1.0-400"])
    width = place.end() - place.start()
    new = b"x" if kind == "letter" else odd[:width].rjust(width)
    return content[: place.start()] + new + content[place.end() :]


def same_values(before, after):
    """Whether two tables differ in their numbers alone, not in what these are of."""
    keys = [[line.rsplit(",", 2)[0] for line in text.splitlines()] for text in (before, after)]
    return keys[0] == keys[1]


@pytest.mark.parametrize("name", ["contact.dat", "abaqus.dat", "job.sta", "job.sts", "plot.txt"])
def test_damage_is_refused_noted_or_a_value_that_nothing_contradicts(ingest, name):
    """Thousands of changes of each kind were read by hand; the values of rows may change alone."""
    texts = {
        "contact.dat": "".join(CONTACT),
        "abaqus.dat": TITLE + "".join(abaqus()) + END,
        "job.sta": (FRD / "vib_cpe4_bin_f64.sta").read_text(),
        "job.sts": (MARC / "nour_plastic.sts").read_text(),
        "plot.txt": HEAD + "".join(f"{k * 5e-4:g}\t{0.1 * k:g}\n" for k in range(12)),
    }
    content = texts[name].encode()
    code, notes, rows = ingest(name, content)
    assert code == 0
    rng = random.Random(26)
    changed = [damaged(content, rng) for _ in range(MUTATIONS)]
    ends = {content[: content.rindex(b"\n", 0, -1) + 1], content}  # a last row cannot be missed
    for text in changed:
        code, said, other = ingest(name, text)
        assert "Traceback" not in said
        alone = code == 0 and said == notes and other != rows
        assert not alone or text in ends or len(other.splitlines()) == len(rows.splitlines())
        assert "inf" not in other.lower() or "inf" in rows.lower()
