"""The deck as text: what ccx wants, and what a plain parser reads back out of it.

The parser below shares no code with the writer. It knows cards, options and data
lines, nothing of fingers.
"""

import hashlib
import re
import socket
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from decks.analysis import ELEMENTS, Contact, analyse
from decks.calculix import calculix_deck, watched_nodes
from decks.calculix_lines import (
    LONGEST_NUMBER,
    element_lines,
    fixed,
    list_lines,
    node_lines,
    pair_lines,
    plain,
    real,
)
from decks.catalogue import resolve
from decks.finger import LAYERS, SITES, Material
from decks.presets import PRESETS, QUICK, mesh_of
from decks.probe import Probe
from decks.waveform import make_stimulus
from fembridge.build import Model
from fembridge.errors import DeckError
from fembridge.stimulus import Stimulus

MESHES = {name: mesh_of(finger) for name, finger in PRESETS.items()}
(NOISE,) = (make_stimulus(entry) for entry in resolve("noise_25_250_10"))
(PRESSED,) = (make_stimulus(entry, 500.0) for entry in resolve("sine_20_250"))
SHORT = Stimulus("short", np.array([0.0, 1.5, -2.25, 100.0]), 0.5, (0.0, 1.5))
MODELS = {
    "plain": Model(QUICK, MESHES["quick"]),
    "reduced": Model(QUICK, MESHES["quick"], element="CPE4R"),
    "quadratic": Model(QUICK, MESHES["quick"], element="CPE8R"),
    "by surface": Model(
        QUICK, MESHES["quick"], contact=Contact("surface-to-surface", 1000.0)
    ),
    "smooth": Model(QUICK, MESHES["quick"], contact=Contact(friction=0.0)),
    "flat aside": Model(
        QUICK, MESHES["quick"], Probe("flat", 2.0, 0.2, 0.3), element="CPE8R"
    ),
}


@dataclass
class Deck:
    """Cards in order: ``(keyword, options, data lines as words)``."""

    cards: list = field(default_factory=list)
    comments: list = field(default_factory=list)

    def all(self, keyword):
        return [card for card in self.cards if card[0] == keyword]

    def one(self, keyword, **options):
        (card,) = (
            card
            for card in self.all(keyword)
            if all(card[1].get(name) == value for name, value in options.items())
        )
        return card

    def set_of(self, name):
        return [int(word) for row in self.one("NSET", NSET=name)[2] for word in row]

    def nodes(self):
        return {
            int(row[0]): tuple(map(float, row[1:]))
            for card in self.all("NODE")
            for row in card[2]
        }

    def elements(self):
        return {
            int(row[0]): tuple(map(int, row[1:]))
            for card in self.all("ELEMENT")
            for row in card[2]
        }


def parse(text):
    deck = Deck()
    for line in text.splitlines():
        if line.startswith("**"):
            deck.comments.append(line[2:].strip())
        elif line.startswith("*"):
            keyword, *words = (word.strip() for word in line[1:].split(","))
            pairs = (word.partition("=") for word in words)
            options = {name.strip(): value.strip() for name, _, value in pairs}
            deck.cards.append((keyword, options, []))
        else:
            words = [word.strip() for word in line.rstrip(",").split(",")]
            deck.cards[-1][2].append(words)
    return deck


@pytest.fixture(scope="module", params=MODELS)
def built(request):
    analysis = MODELS[request.param].analysis(SHORT)
    text = calculix_deck(analysis)
    return analysis, text, parse(text)


# ---- Text


def test_the_reference_deck_keeps_its_bytes():
    """Recorded runs name their deck by this digest; stored with the first of them."""
    deck = calculix_deck(MODELS["plain"].analysis(NOISE))
    assert hashlib.sha256(deck.encode()).hexdigest() == (
        "3247fd61fb054e6142661d61a77aa12710b6e9307ba5ac29f2d7f993c5ce65bd"
    )


def test_the_same_input_gives_the_same_bytes():
    for model in MODELS.values():
        again = replace(model, mesh=mesh_of(model.finger))
        assert calculix_deck(model.analysis(SHORT)) == calculix_deck(
            again.analysis(SHORT)
        )


def test_a_deck_is_ascii_with_lf_and_ends_in_one(built):
    _, text, _ = built
    assert text.isascii()
    assert text.endswith("*END STEP\n")
    assert not set(text) & set("\r\t\0\f\v")
    assert not any(line != line.rstrip() or not line for line in text.splitlines())


def test_no_line_has_more_entries_than_ccx_reads_and_no_number_more_characters(built):
    _, text, deck = built
    for keyword, _, rows in deck.cards:
        most = 8 if keyword == "AMPLITUDE" else 16
        for row in rows:
            if keyword != "HEADING":
                assert len(row) <= most
                assert max(map(len, row)) <= LONGEST_NUMBER
    assert max(map(len, text.splitlines())) < 132


def test_nothing_tells_when_where_or_by_whom_a_deck_was_made(built):
    _, text, _ = built
    assert str(Path.home()) not in text
    assert str(Path.cwd()) not in text
    assert socket.gethostname() not in text
    assert not re.search(r"\b(19|20)\d\d-\d\d|\d\d:\d\d", text)
    assert "/" not in text.replace("MPa/mm", "")


def test_the_heading_says_units_and_what_it_is(built):
    analysis, _, deck = built
    keyword, options, rows = deck.cards[0]
    assert (keyword, options) == ("HEADING", {})
    assert rows == [["fembridge: short on finger quick"]]
    assert "Units: mm, N, s, MPa. Plane strain, 1 mm thick." in deck.comments
    assert set(analysis.notes) <= set(deck.comments)


@pytest.mark.parametrize(
    "name", ["人差し指", "a\n*STEP", "*STEP", "x" * 300, "tab\there", "\N{NULL}"]
)
def test_no_name_of_a_finger_or_stimulus_can_become_a_card(name):
    finger = replace(QUICK, name=name)
    stimulus = replace(SHORT, id=name)
    text = calculix_deck(analyse(finger, MESHES["quick"], stimulus))
    reference = calculix_deck(analyse(QUICK, MESHES["quick"], SHORT))
    assert text.isascii()
    assert [card[:2] for card in parse(text).cards] == [
        card[:2] for card in parse(reference).cards
    ]
    assert len(text.splitlines()) == len(reference.splitlines())
    assert len(text.splitlines()[1]) <= 78


# ---- Mesh


def test_nodes_of_the_finger_and_then_of_the_probe_come_back(built):
    analysis, _, deck = built
    nodes = deck.nodes()
    finger_mm = analysis.mesh.node_mm
    if analysis.element == "CPE8R":
        finger_mm, _ = analysis.mesh.with_midsides()
    written = np.concatenate([finger_mm, analysis.probe.node_mm])
    assert list(nodes) == list(range(1, len(written) + 1))
    read = np.array(list(nodes.values()))
    assert_allclose(read[:, :2], written, rtol=0, atol=0.51e-9)
    assert (read[:, 2] == 0).all()
    assert [card[1]["NSET"] for card in deck.all("NODE")] == ["FINGER", "PROBE"]


def test_elements_come_back_layer_by_layer(built):
    analysis, _, deck = built
    elements = deck.elements()
    corners = analysis.mesh.quad
    if analysis.element == "CPE8R":
        _, corners = analysis.mesh.with_midsides()
    for row, nodes in enumerate(corners):
        assert elements[row + 1] == tuple(nodes + 1)
    sets = [card[1] for card in deck.all("ELEMENT")]
    assert [one["ELSET"] for one in sets] == [*map(str.upper, LAYERS), "PROBE_BODY"]
    assert [one["TYPE"] for one in sets] == [analysis.element] * 6 + ["CPE4"]
    for index, layer in enumerate(LAYERS):
        _, _, rows = deck.one("ELEMENT", ELSET=layer.upper())
        numbers = [int(row[0]) - 1 for row in rows]
        assert numbers == np.flatnonzero(analysis.mesh.layer == index).tolist()
    assert list(elements) == sorted(elements)


def test_mid_side_nodes_lie_between_their_corners():
    deck = parse(calculix_deck(MODELS["quadratic"].analysis(SHORT)))
    at = {number: np.array(place) for number, place in deck.nodes().items()}
    _, _, rows = deck.one("ELEMENT", ELSET="DERMIS")
    for row in rows:
        nodes = [int(word) for word in row[1:]]
        assert len(nodes) == 8
        for k in range(4):
            middle = (at[nodes[k]] + at[nodes[(k + 1) % 4]]) / 2
            assert_allclose(at[nodes[4 + k]], middle, rtol=0, atol=1.1e-9)


# ---- Names


def test_every_set_that_a_card_names_exists_and_has_members(built):
    _, _, deck = built
    nodes, elements = deck.nodes(), deck.elements()
    node_sets = {card[1]["NSET"] for card in deck.all("NODE") + deck.all("NSET")}
    element_sets = {card[1]["ELSET"] for card in deck.all("ELEMENT")}
    for card in deck.all("NSET"):
        members = deck.set_of(card[1]["NSET"])
        assert members
        assert len(set(members)) == len(members)
        assert set(members) <= set(nodes)
    for keyword in ("NODE OUTPUT", "ELEMENT OUTPUT", "NODE PRINT"):
        assert {card[1]["NSET"] for card in deck.all(keyword)} <= node_sets
    for card in deck.all("BOUNDARY"):
        assert {row[0] for row in card[2]} <= node_sets
    assert {card[1]["ELSET"] for card in deck.all("SOLID SECTION")} == element_sets
    for card in deck.all("SURFACE"):
        targets = {row[0] for row in card[2]}
        if card[1]["TYPE"] == "NODE":
            assert targets <= node_sets
        else:
            assert {int(word) for word in targets} <= set(elements)
    used = {number for members in elements.values() for number in members}
    assert used == set(nodes)


def test_every_material_amplitude_surface_and_interaction_named_is_defined(built):
    _, _, deck = built
    materials = {card[1]["NAME"] for card in deck.all("MATERIAL")}
    assert {card[1]["MATERIAL"] for card in deck.all("SOLID SECTION")} == materials
    (pair,) = deck.all("CONTACT PAIR")
    surfaces = [card[1]["NAME"] for card in deck.all("SURFACE")]
    assert pair[2] == [surfaces]
    assert pair[1]["INTERACTION"] == deck.one("SURFACE INTERACTION")[1]["NAME"]
    named = {card[1]["AMPLITUDE"] for card in deck.all("BOUNDARY") if card[1]}
    assert named == {deck.one("AMPLITUDE")[1]["NAME"]}


def test_no_name_is_longer_than_ccx_keeps(built):
    _, _, deck = built
    for _, options, _ in deck.cards:
        assert all(len(value) <= 80 for value in options.values())


def test_materials_are_table_1(built):
    analysis, _, deck = built
    words = [card[2] for card in deck.all("ELASTIC")]
    for layer, row in zip(LAYERS, words, strict=False):
        material = analysis.finger.materials[layer]
        assert row == [[f"{material.young_mpa}", f"{material.poisson}"]]
    assert all(card[2] == [["1.0"]] for card in deck.all("SOLID SECTION"))


def test_a_modulus_of_many_digits_is_not_cut_by_ccx():
    soft = Material(1.2345678901234567e-05, 0.12345678901234568)
    finger = replace(QUICK, materials={**QUICK.materials, "dermis": soft})
    deck = parse(calculix_deck(analyse(finger, MESHES["quick"], SHORT)))
    (row,) = deck.all("ELASTIC")[2][2]
    assert max(map(len, row)) <= LONGEST_NUMBER
    assert_allclose([*map(float, row)], [soft.young_mpa, soft.poisson], rtol=1e-12)


def test_a_whole_number_and_the_same_float_give_the_same_deck():
    whole, real_ = (
        replace(QUICK, materials={**QUICK.materials, "dermis": Material(e, 0.3)})
        for e in (1, 1.0)
    )
    assert calculix_deck(analyse(whole, MESHES["quick"], SHORT)) == calculix_deck(
        analyse(real_, MESHES["quick"], SHORT)
    )


# ---- Who is held, who touches, who is watched


def test_bone_and_the_nails_outer_side_are_held_mid_sides_included(built):
    analysis, _, deck = built
    nodes, elements = deck.nodes(), deck.elements()
    bone = {
        number
        for row in deck.one("ELEMENT", ELSET="BONE")[2]
        for number in map(int, row[1:])
    }
    held = set(deck.set_of("HELD"))
    assert bone <= held
    edges = {}
    for number, members in elements.items():
        if number <= len(analysis.mesh.quad):
            for k in range(4):
                ends = frozenset((members[k], members[(k + 1) % 4]))
                middle = members[4 + k : 5 + k]
                edges.setdefault(ends, []).append((number, middle))
    nail = {int(row[0]) for row in deck.one("ELEMENT", ELSET="NAIL")[2]}
    outer = set()
    for ends, owners in edges.items():
        if len(owners) == 1 and owners[0][0] in nail:
            outer |= ends | set(owners[0][1])
    assert held == bone | outer
    y_mm = [nodes[number][1] for number in outer]
    assert max(y_mm) < -6.5


def test_afferents_and_the_apex_have_sets_of_one_node(built):
    analysis, _, deck = built
    for name, row in analysis.afferent.items():
        assert deck.set_of(f"AFFERENT_{name}") == [row + 1]
        site = SITES[name]
        place = deck.nodes()[row + 1]
        assert place == (site.x_mm, -site.depth_mm, 0.0)
        assert any(line.startswith(f"{name}: {site.layer}") for line in deck.comments)
    assert deck.set_of("SKIN_APEX") == [analysis.apex + 1]


def test_results_are_asked_for_at_the_watched_nodes_alone_each_once(built):
    analysis, _, deck = built
    watched = [*(row + 1 for row in analysis.afferent.values()), analysis.apex + 1]
    assert deck.set_of("OUTPUT_NODES") == watched == watched_nodes(analysis)
    for keyword, words in (("NODE OUTPUT", "U"), ("ELEMENT OUTPUT", "S")):
        _, options, rows = deck.one(keyword)
        assert options == {"NSET": "OUTPUT_NODES", "DOUBLE": ""}
        assert rows == [[words]]


def test_an_afferent_at_the_apex_is_not_written_twice():
    analysis = MODELS["plain"].analysis(SHORT)
    doubled = replace(analysis, afferent={"SA": analysis.apex, "RA": analysis.apex})
    assert watched_nodes(doubled) == [analysis.apex + 1]


def test_results_can_be_had_in_ascii():
    deck = parse(calculix_deck(MODELS["plain"].analysis(SHORT), binary=False))
    options = {"NSET": "OUTPUT_NODES"}
    assert deck.one("NODE FILE")[1] == options
    assert deck.one("EL FILE")[1] == options
    assert not deck.all("NODE OUTPUT") + deck.all("ELEMENT OUTPUT")


def test_the_force_on_the_probe_is_printed(built):
    _, _, deck = built
    assert deck.one("NODE PRINT") == (
        "NODE PRINT",
        {"NSET": "PROBE", "TOTALS": "ONLY"},
        [["RF"]],
    )


def test_every_surface_face_is_on_the_outside_and_faces_the_other(built):
    analysis, _, deck = built
    nodes, elements = deck.nodes(), deck.elements()
    _, _, probe = deck.one("SURFACE", NAME="PROBE_SURFACE")
    assert len(probe) == len(analysis.probe.quad)
    for number, face in probe:
        a, b = face_of(elements[int(number)], face)
        assert nodes[b][0] >= nodes[a][0]  # the body is to the left: above it
    _, options, skin = deck.one("SURFACE", NAME="SKIN_SURFACE")
    if options["TYPE"] == "NODE":
        return
    for number, face in skin:
        a, b = face_of(elements[int(number)], face)
        assert nodes[b][0] < nodes[a][0]  # below it


def face_of(members, face):
    k = int(face.removeprefix("S")) - 1
    return members[k], members[(k + 1) % 4]


def test_as_a_set_of_nodes_the_skin_has_its_mid_sides_too():
    plain_, quadratic = (
        set(parse(calculix_deck(MODELS[kind].analysis(SHORT))).set_of("SKIN_CONTACT"))
        for kind in ("plain", "quadratic")
    )
    assert plain_ < quadratic
    assert len(quadratic) == 2 * len(plain_) - 1  # one between each two neighbours


def test_contact_by_node_gives_a_stiffness_and_a_tension():
    deck = parse(calculix_deck(MODELS["plain"].analysis(SHORT)))
    assert deck.one("CONTACT PAIR")[1]["TYPE"] == "NODE TO SURFACE"
    _, options, rows = deck.one("SURFACE BEHAVIOR")
    assert options == {"PRESSURE-OVERCLOSURE": "LINEAR"}
    assert rows == [["200.0", "0.001"]]
    assert deck.one("FRICTION")[2] == [["0.4", "20.0"]]


def test_contact_by_surface_gives_a_stiffness_alone():
    deck = parse(calculix_deck(MODELS["by surface"].analysis(SHORT)))
    assert deck.one("CONTACT PAIR")[1]["TYPE"] == "SURFACE TO SURFACE"
    assert deck.one("SURFACE BEHAVIOR")[2] == [["1000.0"]]
    assert deck.one("SURFACE", NAME="SKIN_SURFACE")[1]["TYPE"] == "ELEMENT"
    assert not [card for card in deck.all("NSET") if card[1]["NSET"] == "SKIN_CONTACT"]


def test_without_friction_there_is_no_card_of_it():
    assert not parse(calculix_deck(MODELS["smooth"].analysis(SHORT))).all("FRICTION")


def test_a_contact_that_ccx_has_not_for_plane_elements_is_refused():
    analysis = MODELS["plain"].analysis(SHORT)
    object.__setattr__(analysis.contact, "formulation", "mortar")
    try:
        with pytest.raises(DeckError, match="ccx has no contact 'mortar'"):
            calculix_deck(analysis)
    finally:
        object.__setattr__(analysis.contact, "formulation", "node-to-surface")


# ---- Motion


def amplitude_of(deck):
    _, options, rows = deck.one("AMPLITUDE")
    assert options == {"NAME": "DEPTH", "TIME": "TOTAL TIME"}
    words = [word for row in rows for word in row]
    return np.array(words, dtype=float).reshape(-1, 2).T


@pytest.mark.parametrize("stimulus", [NOISE, SHORT], ids=lambda one: one.id)
def test_the_amplitude_is_the_stimulus_to_its_last_digit(stimulus):
    deck = parse(calculix_deck(MODELS["plain"].analysis(stimulus)))
    time_s, depth_mm = amplitude_of(deck)
    assert_array_equal(time_s, np.round(stimulus.times_ms * 1e-3, 7))
    assert_array_equal(depth_mm, np.round(stimulus.displacement_um * 1e-3, 9))
    assert_allclose(depth_mm * 1e3, stimulus.displacement_um, rtol=0, atol=1e-12)


def test_a_pre_indentation_is_ramped_in_before_the_stimulus():
    deck = parse(calculix_deck(MODELS["plain"].analysis(PRESSED)))
    time_s, depth_mm = amplitude_of(deck)
    assert len(time_s) == 521
    assert (time_s[0], depth_mm[0]) == (0.0, 0.0)
    assert_allclose(np.diff(depth_mm[:21]), 0.025, rtol=1e-9)
    assert_allclose(depth_mm[20:] * 1e3, PRESSED.displacement_um, atol=1e-12)
    assert "up to 0.01 s: the ramp to the pre-indentation" in deck.comments


@pytest.mark.parametrize(("stimulus", "count"), [(NOISE, 500), (PRESSED, 520)])
def test_the_step_has_one_fixed_increment_a_sample(stimulus, count):
    deck = parse(calculix_deck(MODELS["plain"].analysis(stimulus)))
    assert deck.one("STEP")[1] == {"NLGEOM": "", "INC": "100000"}
    _, options, [[increment_s, end_s]] = deck.one("STATIC")
    assert options == {"DIRECT": ""}
    assert float(increment_s) == 0.0005
    assert float(end_s) == count * 0.0005
    assert amplitude_of(deck)[0][-1] == float(end_s)


@pytest.mark.parametrize("dt_ms", [1 / 3, 0.5, 0.1, 1e-3, 1e-7, 0.0001234567, 20.0])
def test_increments_of_any_length_fill_the_step_exactly(dt_ms):
    """A step length cut to seven decimals would end one increment early or late."""
    stimulus = Stimulus("odd", np.arange(301.0), dt_ms, (0.0, 300 * dt_ms))
    deck = parse(calculix_deck(MODELS["plain"].analysis(stimulus)))
    _, _, [[increment_s, end_s]] = deck.one("STATIC")
    assert_allclose(float(end_s) / float(increment_s), 300, rtol=1e-11)
    time_s, _ = amplitude_of(deck)
    assert_allclose(time_s, stimulus.times_ms * 1e-3, rtol=2e-12)
    assert max(len(increment_s), len(end_s)) <= LONGEST_NUMBER


def test_the_probe_goes_down_by_the_depth_and_not_aside(built):
    _, _, deck = built
    fixed_, moved = deck.all("BOUNDARY")
    assert fixed_[2] == [["HELD", "1", "2"], ["PROBE", "1", "1"]]
    assert moved[1] == {"AMPLITUDE": "DEPTH"}
    assert moved[2] == [["PROBE", "2", "2", "-1.0"]]


def test_a_small_strain_analysis_is_written_without_nlgeom():
    small = replace(MODELS["plain"].analysis(SHORT), large_strain=False)
    assert parse(calculix_deck(small)).one("STEP")[1] == {"INC": "100000"}


def test_cards_stand_in_the_order_that_ccx_asks_for(built):
    _, _, deck = built
    order = [card[0] for card in deck.cards]
    step = order.index("STEP")
    in_step = set(order[step:])
    assert in_step == {
        *("STEP", "STATIC", "BOUNDARY", "NODE OUTPUT", "ELEMENT OUTPUT"),
        *("NODE PRINT", "END STEP"),
    }
    assert not in_step & set(order[:step])
    for at, keyword in enumerate(order):
        if keyword == "ELASTIC":
            assert order[at - 1] == "MATERIAL"
        if keyword in ("SURFACE BEHAVIOR", "FRICTION"):
            assert order[at - 1] in ("SURFACE INTERACTION", "SURFACE BEHAVIOR")


def test_all_elements_that_an_analysis_takes_can_be_written():
    for element in ELEMENTS:
        analysis = analyse(QUICK, MESHES["quick"], SHORT, element=element)
        assert f"TYPE={element}," in calculix_deck(analysis)


# ---- Lines


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_number_keeps_twelve_digits_in_twenty_characters(number):
    text = real(number)
    assert len(text) <= LONGEST_NUMBER
    assert_allclose(float(text), number, rtol=1e-12)


@given(st.floats(0, 1e6), st.integers(3, 9))
def test_a_number_of_fixed_decimals_gets_more_where_it_needs_them(number, digits):
    text = fixed(number, digits)
    assert len(text) <= LONGEST_NUMBER
    assert_allclose(float(text), number, rtol=1.1e-12)


def test_short_numbers_are_written_shortly():
    assert [real(x) for x in (200.0, 50, 1e-3, 0.1 * 3)] == [
        "200.0",
        "50.0",
        "0.001",
        "0.30000000000000004",
    ]
    assert [fixed(0.0005, 7), fixed(0.25, 7), fixed(0.0, 7)] == [
        "0.0005000",
        "0.2500000",
        "0.0000000",
    ]


@given(st.text())
def test_any_text_becomes_one_line_of_printable_ascii(text):
    line = plain(text)
    assert line.isascii()
    assert line.isprintable()


def test_lists_break_after_twelve_and_pairs_after_four():
    assert list(list_lines(range(1, 14))) == [
        "1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12,"
    ] + ["13,"]
    assert list(pair_lines([(str(k), "0") for k in range(5)])) == [
        "0, 0, 1, 0, 2, 0, 3, 0",
        "4, 0",
    ]


def test_nodes_are_numbered_and_flat_and_zero_has_no_sign():
    assert list(node_lines(np.array([[-0.0, 1.5], [2, -3]]), first=7)) == [
        "7, 0.000000000, 1.500000000, 0.0",
        "8, 2.000000000, -3.000000000, 0.0",
    ]


def test_elements_and_their_numbers_belong_together():
    assert list(element_lines([4, 9], np.array([[1, 2], [3, 4]]))) == [
        "4, 1, 2",
        "9, 3, 4",
    ]
    with pytest.raises(ValueError, match="zip"):
        list(element_lines([4], np.array([[1, 2], [3, 4]])))
