"""The deck as text and as a model: what ccx wants, and what a plain parser reads in it."""

import hashlib
import re
import socket
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from decks.analysis import Model
from decks.calculix import calculix_deck
from decks.finger import LAYERS, SITES
from decks.keyword_deck import LONGEST_NUMBER
from decks.material import Material
from decks.mesh import Mesh
from decks.presets import QUICK, mesh_of
from decks.stimuli import resolve
from decks.waveform import make_stimulus
from fembridge.errors import DeckError
from fembridge.stimulus import Stimulus

(NOISE,) = (make_stimulus(entry) for entry in resolve("noise_25_250_10"))
(PRESSED,) = (make_stimulus(entry, 500.0) for entry in resolve("sine_20_250"))
SKIN = mesh_of(QUICK)


# ---- Text


def test_the_reference_deck_keeps_its_bytes(models):
    """Recorded runs name their deck by this digest; stored with the first of them."""
    (entry,) = resolve("noise_25_250_10")
    deck = calculix_deck(models["plain"].analysis(make_stimulus(entry)))
    assert hashlib.sha256(deck.encode()).hexdigest() == (
        "3247fd61fb054e6142661d61a77aa12710b6e9307ba5ac29f2d7f993c5ce65bd"
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


def test_the_heading_says_units_and_what_it_is(built, short):
    analysis, _, deck = built
    keyword, options, rows = deck.cards[0]
    assert (keyword, options) == ("HEADING", {})
    assert rows == [["fembridge: short on finger quick"]]
    assert "Units: mm, N, s, MPa. Plane strain, 1 mm thick." in deck.comments
    assert {*analysis.notes, f"contact: {analysis.contact}"} <= set(deck.comments)


@pytest.mark.parametrize(
    "name", ["人差し指", "a\n*STEP", "*STEP", "x" * 300, "tab\there", "\N{NULL}"]
)
def test_no_name_of_a_finger_or_stimulus_can_become_a_card(name, short, parse_deck):
    finger = replace(QUICK, name=name)
    stimulus = replace(short, id=name)
    text = calculix_deck(Model(finger, SKIN, support="prescribed").analysis(stimulus))
    reference = calculix_deck(Model(QUICK, SKIN, support="prescribed").analysis(short))
    assert text.isascii()
    assert [card[:2] for card in parse_deck(text).cards] == [
        card[:2] for card in parse_deck(reference).cards
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
    written = np.concatenate([finger_mm, analysis.probe_mesh.node_mm])
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


def test_a_modulus_of_many_digits_is_not_cut_by_ccx(short, parse_deck):
    soft = Material(1.2345678901234567e-05, 0.12345678901234568)
    finger = replace(QUICK, materials={**QUICK.materials, "dermis": soft})
    deck = parse_deck(calculix_deck(Model(finger, SKIN, support="prescribed").analysis(short)))
    (row,) = deck.all("ELASTIC")[2][2]
    assert max(map(len, row)) <= LONGEST_NUMBER
    assert_allclose([*map(float, row)], [soft.young_mpa, soft.poisson], rtol=1e-12)


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


@pytest.mark.parametrize("element", ["CPE4H", "CPE4RH", "CPE8"])
def test_an_element_that_ccx_has_not_is_refused(element, short):
    analysis = Model(QUICK, SKIN, element=element, support="prescribed").analysis(short)
    with pytest.raises(DeckError, match=f"calculix has no element '{element}'"):
        calculix_deck(analysis)


# ---- Who is held, who touches, who is watched


def test_bone_and_the_nails_outer_side_are_held_mid_sides_included(built):
    analysis, _, deck = built
    nodes, elements = deck.nodes(), deck.elements()
    bone = {number for row in deck.one("ELEMENT", ELSET="BONE")[2] for number in map(int, row[1:])}
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


def test_an_edge_inside_the_nail_is_free_even_between_two_held_nodes(models, short, parse_deck):
    """A nail of one row, open on both sides: its uprights' middles are not outside."""
    x, y = (at.ravel() for at in np.meshgrid(np.arange(4.0), [0.0, -1.0]))
    quad = np.array([[4, 5, 1, 0], [5, 6, 2, 1], [6, 7, 3, 2]])
    strip = Mesh(np.stack([x, y], -1), quad, np.full(3, LAYERS.index("nail")))
    analysis = replace(
        models["quadratic"].analysis(short),
        mesh=strip,
        fixed_row=np.arange(8),
        afferent_row={},
        apex_row=0,
        contact_edge=np.array([[0, 2]]),
    )
    deck = parse_deck(calculix_deck(analysis))
    nodes = deck.nodes()
    held_mm = [nodes[number][:2] for number in deck.set_of("HELD")]
    inside = {(1.0, -0.5), (2.0, -0.5)}
    assert len(held_mm) == 8 + 8
    assert not inside & set(held_mm)


def test_afferents_and_the_apex_have_sets_of_one_node(built):
    analysis, _, deck = built
    for name, row in analysis.afferent_row.items():
        assert deck.set_of(f"AFFERENT_{name}") == [row + 1]
        site = SITES[name]
        place = deck.nodes()[row + 1]
        assert place == (site.x_mm, -site.depth_mm, 0.0)
        assert any(line.startswith(f"{name}: {site.layer}") for line in deck.comments)
    assert deck.set_of("SKIN_APEX") == [analysis.apex]


def test_results_are_asked_for_at_the_watched_nodes_alone_each_once(built):
    analysis, _, deck = built
    watched = [*analysis.afferent.values(), analysis.apex]
    assert deck.set_of("OUTPUT_NODES") == watched == analysis.watched.tolist()
    for keyword, words in (("NODE OUTPUT", "U"), ("ELEMENT OUTPUT", "S")):
        _, options, rows = deck.one(keyword)
        assert options == {"NSET": "OUTPUT_NODES", "DOUBLE": ""}
        assert rows == [[words]]


def test_results_can_be_had_in_ascii(models, short, parse_deck):
    deck = parse_deck(calculix_deck(models["plain"].analysis(short), binary=False))
    options = {"NSET": "OUTPUT_NODES"}
    assert deck.one("NODE FILE")[1] == options
    assert deck.one("EL FILE")[1] == options
    assert not deck.all("NODE OUTPUT") + deck.all("ELEMENT OUTPUT")


def test_the_force_on_the_probe_is_printed(built):
    _, _, deck = built
    assert deck.one("NODE PRINT") == ("NODE PRINT", {"NSET": "PROBE", "TOTALS": "ONLY"}, [["RF"]])


def test_every_surface_face_is_on_the_outside_and_faces_the_other(built):
    analysis, _, deck = built
    nodes, elements = deck.nodes(), deck.elements()
    _, _, probe = deck.one("SURFACE", NAME="PROBE_SURFACE")
    assert len(probe) == len(analysis.probe_mesh.quad)
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


def test_contact_by_node_gives_a_stiffness_and_a_tension(models, short, parse_deck):
    deck = parse_deck(calculix_deck(models["plain"].analysis(short)))
    assert deck.one("CONTACT PAIR")[1]["TYPE"] == "NODE TO SURFACE"
    _, options, rows = deck.one("SURFACE BEHAVIOR")
    assert options == {"PRESSURE-OVERCLOSURE": "LINEAR"}
    assert rows == [["200.0", "0.001"]]
    assert deck.one("FRICTION")[2] == [["0.4", "20.0"]]


def test_without_friction_there_is_no_card_of_it(models, short, parse_deck):
    assert not parse_deck(calculix_deck(models["smooth"].analysis(short))).all("FRICTION")


# ---- Motion


def amplitude_of(deck):
    _, options, rows = deck.one("AMPLITUDE")
    assert options == {"NAME": "DEPTH", "TIME": "TOTAL TIME"}
    words = [word for row in rows for word in row]
    return np.array(words, dtype=float).reshape(-1, 2).T


def test_the_amplitude_is_the_stimulus_to_its_last_digit(models, parse_deck):
    stimulus = NOISE
    deck = parse_deck(calculix_deck(models["plain"].analysis(stimulus)))
    time_s, depth_mm = amplitude_of(deck)
    assert_array_equal(time_s, np.round(stimulus.times_ms * 1e-3, 7))
    assert_array_equal(depth_mm, np.round(stimulus.displacement_um * 1e-3, 9))
    assert_allclose(depth_mm * 1e3, stimulus.displacement_um, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("stimulus", "count"), [(NOISE, 500), (PRESSED, 520)])
def test_the_step_has_one_fixed_increment_a_sample(stimulus, count, models, parse_deck):
    deck = parse_deck(calculix_deck(models["plain"].analysis(stimulus)))
    assert deck.one("STEP")[1] == {"NLGEOM": "", "INC": "100000"}
    _, options, [[increment_s, end_s]] = deck.one("STATIC")
    assert options == {"DIRECT": ""}
    assert float(increment_s) == 0.0005
    assert float(end_s) == count * 0.0005
    assert amplitude_of(deck)[0][-1] == float(end_s)


@pytest.mark.parametrize("dt_ms", [1 / 3, 0.5, 0.1, 1e-3, 1e-7, 0.0001234567, 20.0])
def test_increments_of_any_length_fill_the_step_exactly(dt_ms, models, parse_deck):
    """A step length cut to seven decimals would end one increment early or late."""
    stimulus = Stimulus("odd", np.arange(301.0), dt_ms, (0.0, 300 * dt_ms))
    deck = parse_deck(calculix_deck(models["plain"].analysis(stimulus)))
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


def test_a_small_strain_analysis_is_written_without_nlgeom(models, short, parse_deck):
    small = replace(models["plain"].analysis(short), large_strain=False)
    assert parse_deck(calculix_deck(small)).one("STEP")[1] == {"INC": "100000"}
