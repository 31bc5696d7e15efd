"""An own Marc deck gets the waveform and keeps every other byte; what it leaves open is refused."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from decks.contact_analysis import Model
from decks.dialects import DeckOptions
from decks.marc.contents import POST_EVERY, POST_KIND, POST_KINDS, read_marc_deck
from decks.marc.write import marc_deck
from decks.motion import Motion, motion_of
from decks.own_model import AfferentSite, Request
from decks.own_model.marc_deck import rebase_marc
from decks.presets import QUICK, mesh_of
from decks.stimuli import resolve
from decks.synthesis import make_stimulus
from decks.unit_system import LENGTH_UNITS
from fembridge.errors import DeckError

MOTION = Motion(np.arange(4) * 5e-4, np.array([0.0, 0.125, -0.0625, 0.3]), 5e-4, 0)
LAYOUTS = ("extended", "fixed", "free")

decks = st.fixed_dictionaries(
    {
        "layout": st.sampled_from(LAYOUTS),
        "version": st.sampled_from((11, 14, 15)),
        "drive": st.sampled_from(("body", "disp")),
        "factor": st.sampled_from((-1.0, 1.0, -3.0, 0.5)),
        "stepping": st.sampled_from(("auto load", "auto step")),
        "post": st.sampled_from(((), (301,), (17,), (311, 17), (7, 311))),
        "post_head": st.dictionaries(st.sampled_from((4, 9)), st.integers(0, 1)),
        "end": st.sampled_from(("\n", "\r\n")),
    }
)
samples = st.lists(st.floats(-1.0, 1.0), min_size=2, max_size=9)


def motion_through(depths, dt_s=5e-4):
    return Motion(np.arange(len(depths)) * dt_s, np.array(depths), dt_s, 0)


def table_of(data, name="wave"):
    (table,) = (each for each in read_marc_deck(data).tables if each.name == name)
    return table


@given(
    parts=decks,
    depths=samples,
    unit=st.sampled_from(("mm", "m")),
    results=st.sampled_from([None, "binary", "text", "both"]),
)
def test_table_increments_and_output_are_the_waveforms_and_other_lines_stay(
    marc_text, parts, depths, unit, results
):
    data, motion = marc_text(**parts).text(), motion_through(depths)
    request = Request(length_unit=unit, results=results)
    new = rebase_marc(data, motion, request).deck

    points = table_of(new).points
    assert_array_equal(points[:, 0], np.arange(len(depths)) * 5e-4)
    depth = points[:, 1] * abs(parts["factor"]) * LENGTH_UNITS[unit].length_mm
    assert_allclose(depth, depths, rtol=1e-13, atol=1e-30)
    before, after = read_marc_deck(data), read_marc_deck(new)
    (case,) = after.load_cases()
    assert (case.stepping.keyword, case.increments) == ("auto load", len(depths) - 1)
    assert_allclose(case.period, motion.time_s[-1], rtol=1e-12)
    wanted = after.post()
    assert wanted.codes[: len(parts["post"])] == parts["post"]
    assert sorted(wanted.codes) == sorted({*parts["post"], 17, 311})
    kinds = {None: before.post().head[POST_KIND], **POST_KINDS}
    assert (wanted.head[POST_EVERY], wanted.head[POST_KIND]) == (1, kinds[results])

    changed = ("table", "auto load", "auto step", "time step", "post")
    old, lines = data.splitlines(keepends=True), new.splitlines(keepends=True)
    rest = iter(lines)
    for option in before.options:
        if option.keyword not in changed or option.section.value == "parameter":
            assert all(old[line.number - 1] in rest for line in option.lines)  # in order
    assert {line[-2:] == b"\r\n" for line in lines} == {parts["end"] == "\r\n"}
    assert rebase_marc(new, motion, request).deck == new


@pytest.mark.parametrize("layout", LAYOUTS)
def test_the_layout_of_the_deck_is_kept_and_digits_are_not_lost(marc_text, layout):
    data = marc_text(layout=layout).text()
    table = table_of(rebase_marc(data, motion_through([0.0, 1 / 3]), Request()).deck)
    commas = ["," in line.text for line in table.rows]
    assert commas[:2] == [layout == "free"] * 2
    assert commas[2:] == [layout != "extended"] * 2
    assert_allclose(table.points[1], [5e-4, 1 / 3], rtol=1e-15)


def test_a_waveform_starts_when_its_load_case_does_and_where_the_probe_stands_then(marc_text):
    """Time of tables runs on: 20 increments of 0.1 come before, in which the table acts."""
    deck = marc_text()
    cases = [*deck.case("rest", 20), *deck.case("press")]
    new = rebase_marc(deck.text(cases=cases), MOTION, Request(step="press"))
    was = table_of(deck.text(cases=cases)).points
    before, stands = was[was[:, 0] < 2.0], np.interp(2.0, *was.T)
    points = table_of(new.deck).points
    assert_array_equal(points[: len(before)], before)
    start = points[len(before) :]
    assert_allclose(start[:, 0], 2.0 + MOTION.time_s, rtol=1e-15)
    factor = new.stands_mm / stands
    assert_allclose(start[:, 1] - stands, MOTION.depth_mm / factor, rtol=1e-12, atol=1e-15)
    assert stands != 0
    assert rebase_marc(new.deck, MOTION, Request(step="press")).deck == new.deck
    rest, press = read_marc_deck(new.deck).load_cases()
    assert (rest.increments, press.increments) == (20, 3)
    assert new.before_s == pytest.approx(2.0)


def test_what_a_deck_has_too_little_of_is_put_in_and_no_more(marc_text):
    deck = marc_text()

    def rebased(**parts):
        return rebase_marc(deck.text(**parts), MOTION, Request()).deck

    assert b"     99999        10" in rebased(cases=list(deck.case(most=2)))
    assert b"         3        10" in rebased(cases=list(deck.case(most=3)))
    cases = [line for line in deck.case() if line.strip() != "time step"]
    cases.pop(-2)  # its number: only the count was there
    (case,) = read_marc_deck(rebased(cases=cases)).load_cases()
    assert (case.increments, case.period) == (3, pytest.approx(1.5e-3))
    cases = [*list(deck.case())[:-1], "post increment", deck.row(2, 0), "continue"]
    assert b"post increment\n" + deck.row(1, 0).encode() + b"\n" in rebased(cases=cases)
    assert read_marc_deck(rebased(output=["no print"])).post().codes == (17, 311)


@pytest.mark.parametrize(("version", "numbers"), [(11, 3), (14, 5)])
def test_automatic_steps_become_fixed_ones_of_as_many_numbers_as_the_version_has(
    marc_text, version, numbers
):
    deck = marc_text(version=version, stepping="auto step")
    cases = list(deck.case())
    step = deck.row(*[3, 0, 10, 0, 0][:numbers])
    for name in ("auto step", "AUTO STEP"):
        data = deck.text(cases=[name if line == "auto step" else line for line in cases])
        lines = rebase_marc(data, MOTION, Request()).deck.decode().splitlines()
        head, count, time = ("auto load", step, "time step")
        head, time = (head.upper(), time.upper()) if name.isupper() else (head, time)
        at = lines.index(head)
        assert lines[at + 1 : at + 3] == [count, time]


def test_load_cases_behind_keep_their_control_and_ones_before_may_not_move_the_probe(marc_text):
    deck = marc_text(drive="disp")
    (case, later), most = (list(deck.case(one, most=2)) for one in ("press", "on")), deck.row(99999)
    new = rebase_marc(deck.text(cases=[*case, *later]), MOTION, Request(step="press")).deck
    assert new.decode().count(f"control\n{most}") == 1
    push = deck.fixed("push", 1.0, 0)
    before = [deck.head("loadcase", "before"), deck.row(1), "push", *case[case.index("control") :]]
    data = deck.text(conditions=[*deck.conditions(), *push], cases=[*before, *case])
    with pytest.raises(DeckError, match="'push' moves 'held_nodes' in a load case before"):
        rebase_marc(data, MOTION, Request())


@given(data=st.data())
def test_a_mutated_deck_is_refused_or_taken(marc_text, data):
    text = bytearray(marc_text(**data.draw(decks)).text())
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(0, len(text) - 1))
        new = data.draw(st.sampled_from((b"", b"9", b"-", b"x", b" ", b"\n", b",")))
        text[place : place + data.draw(st.integers(0, 3))] = new
    try:
        rebased = rebase_marc(bytes(text), MOTION, Request(afferents={"SA": 1}))
    except DeckError:
        return
    read_marc_deck(rebased.deck)


# ---- Our own deck, taken as a user's

(NOISE,) = (make_stimulus(entry) for entry in resolve("noise_25_250_10"))
(SINE,) = (make_stimulus(entry) for entry in resolve("sine_20_250"))
ANALYSIS = Model(QUICK, mesh_of(QUICK), support="prescribed").analysis(NOISE)


@pytest.fixture(scope="module", params=["rigid", "meshed"])
def ours(request):
    """Our own deck, taken as a user's, and its kind of probe."""
    return marc_deck(ANALYSIS, DeckOptions(probe=request.param)).encode("ascii"), request.param


def test_a_flat_mesh_of_six_coordinates_a_node_has_its_afferents_in_the_plane(marc_text):
    deck = marc_text(layout="free")
    lines = [line.replace("3, 6, 0, 1,", "6, 6, 0, 1,") for line in deck.mesh()]
    lines = [line + f" {k}.0, 0.0, 0.0," * line.endswith(" 0.0,") for k, line in enumerate(lines)]
    data = deck.text(mesh=lines)
    assert read_marc_deck(data).coordinates.position.shape == (6, 6)
    sites = rebase_marc(data, MOTION, Request(afferents={"SA": 5})).sites
    assert sites == {"SA": AfferentSite((1.0, -1.0))}


def data_of(deck):
    """Its lines but for comments, which may name the stimulus."""
    return [line for line in deck.splitlines() if not line.startswith(b"$")]


def test_its_own_waveform_changes_no_byte_and_another_makes_the_deck_of_that(ours):
    deck, probe = ours
    assert rebase_marc(deck, motion_of(NOISE), Request()).deck == deck
    motion = motion_of(SINE)
    rebased = rebase_marc(deck, motion, Request()).deck
    written = marc_deck(replace(ANALYSIS, motion=motion), DeckOptions(probe=probe)).encode("ascii")
    assert data_of(rebased) == data_of(written)
    assert rebased != deck


# ---- Refusals


def refused(data, found, request=None):
    with pytest.raises(DeckError, match=found) as caught:
        rebase_marc(data, MOTION, request or Request())
    return str(caught.value)


def line_of(data, text, which=0):
    found = [n for n, line in enumerate(data.decode().splitlines(), 1) if text in line]
    return f"line {found[which]}"


def test_two_tables_that_drive_motions_are_refused_unless_one_is_named(marc_text):
    deck = marc_text(drive="disp")
    lines = [*deck.conditions(), *deck.fixed("twist", 2.0, 2)]
    tables = [*deck.table(), *deck.table("second", 2)]
    cases = [line.replace("         2", "         3") for line in deck.case()]
    cases.insert(4, "twist")
    data = deck.text(table=tables, conditions=lines, cases=cases)
    said = refused(data, r"2 tables .*wave \(line")
    assert said.startswith(line_of(data, "second"))
    new = rebase_marc(data, MOTION, Request(amplitude="SECOND"))
    points = {each.name: each.points for each in read_marc_deck(new.deck).tables}
    assert len(points["wave"]) == 2
    assert points["second"][-1, 1] == pytest.approx(MOTION.depth_mm[-1] / 2)  # factor 2


@pytest.mark.parametrize(
    ("name", "number", "asked", "text"),
    [
        ("wave", 2, "wave", "wave"),  # a duplicate name
        ("idle", 2, "idle", "idle"),  # drives nothing
        ("other", 1, "wave", "other"),  # a duplicate number
    ],
)
def test_a_second_table_that_cannot_be_meant_is_refused(marc_text, name, number, asked, text):
    deck = marc_text()
    data = deck.text(table=[*deck.table(), *deck.table(name, number)])
    said = refused(data, name, Request(amplitude=asked))
    assert said.startswith(line_of(data, text, -1 if name != "wave" else 1))


def test_different_factors_are_refused_with_both_lines_and_either_sign_is_one(marc_text):
    deck = marc_text(drive="disp", factor=-2.0)
    lines = [*deck.conditions(), *deck.fixed("held", 3.0, 1)]
    said = refused(deck.text(conditions=lines), "factor 3")
    assert "'indent'" in said and said.count("line ") == 2
    lines = [*deck.conditions(), *deck.fixed("held", 2.0, 1)]
    new = rebase_marc(deck.text(conditions=lines), MOTION, Request())
    assert any("factor -2" in remark for remark in new.remarks)


def test_a_rotation_is_no_displacement(marc_text):
    deck = marc_text(drive="disp")
    turn = [
        *(deck.row(1, 0, 0, 0, 1, 0, name="turn"), deck.row(0.0, 1.0)),
        *(deck.row(0, 1), deck.row(2, 4), deck.row(2), "held_nodes"),
    ]
    data = deck.text(conditions=[*deck.conditions(), *turn])
    assert refused(data, "degree of freedom 4 of `fixed disp` 'turn'").startswith("line ")


@pytest.mark.parametrize(
    ("row", "numbers", "found"),
    [(1, (1, 1, 0, 0, 3), "'wave'"), (2, (12, 2, 2, 0, 0, 2), "'wave'")],
)
def test_a_table_of_another_kind_is_refused(marc_text, row, numbers, found):
    deck = marc_text()
    lines = list(deck.table())
    lines[row] = deck.row(*numbers)
    if row == 1:
        lines[3:] = ["v1"]
    assert refused(deck.text(table=lines), found).startswith("line ")


def test_load_cases_that_could_be_several_or_are_not_there_are_refused(marc_text):
    deck = marc_text()
    data = deck.text(cases=[*deck.case("rest"), *deck.case("press")])
    said = refused(data, "2 load cases")
    assert "1 rest" in said and "2 press" in said
    assert "1 rest" in refused(data, "'lift'", Request(step="lift"))
    cases = list(deck.case())
    data = deck.text(cases=[*cases[: cases.index("auto load")], "continue"])
    said = refused(data, r"0 load cases with increments .* there: 1 press")
    assert said.startswith(line_of(data, "loadcase"))


def test_other_ways_of_stepping_are_refused_with_their_line(marc_text):
    data = marc_text(stepping="dynamic change").text()
    assert refused(data, "`dynamic change`").startswith(line_of(data, "dynamic change"))
    deck = marc_text()
    cases = [*deck.case("rest", stepping="dynamic change"), *deck.case("press")]
    refused(deck.text(cases=cases), "load case 1 'rest'", Request(step="press"))
    cases = list(deck.case())
    cases[-1:] = [*list(deck.case(stepping="auto step"))[-4:]]
    refused(deck.text(cases=cases), "`auto step`")


def test_a_node_between_materials_is_refused(ours):
    deck = read_marc_deck(ours[0])
    first, second = deck.elements[:2]
    between = sorted(set(first.node.ravel()) & set(second.node.ravel()))[0]
    with pytest.raises(DeckError, match="stratum_corneum and epidermis"):
        rebase_marc(ours[0], MOTION, Request(afferents={"SA": int(between)}))


def test_a_node_without_coordinates_is_refused(marc_text):
    data = marc_text().text()
    said = refused(data, "SA: node 7", Request(afferents={"SA": 7}))
    assert said.startswith(line_of(data, "coordinates"))
