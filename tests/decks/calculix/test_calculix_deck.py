"""The deck as text: what ccx wants, and what a plain parser reads back out of it."""

import hashlib
import re
import socket
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from decks.analysis import analyse
from decks.calculix import calculix_deck
from decks.finger import LAYERS
from decks.keyword_deck import LONGEST_NUMBER
from decks.material import Material
from decks.presets import QUICK, mesh_of
from decks.stimuli import resolve
from decks.waveform import make_stimulus
from fembridge.errors import DeckError

SKIN = mesh_of(QUICK)


# ---- Text


def test_the_reference_deck_keeps_its_bytes(models):
    """Recorded runs name their deck by this digest; stored with the first of them."""
    (entry,) = resolve("noise_25_250_10")
    deck = calculix_deck(models["plain"].analysis(make_stimulus(entry)))
    assert hashlib.sha256(deck.encode()).hexdigest() == (
        "3247fd61fb054e6142661d61a77aa12710b6e9307ba5ac29f2d7f993c5ce65bd"
    )


def test_the_same_input_gives_the_same_bytes(models, short):
    for kind in ("plain", "flat aside"):
        model = models[kind]
        again = replace(model, mesh=mesh_of(model.finger))
        assert calculix_deck(model.analysis(short)) == calculix_deck(again.analysis(short))


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
    text = calculix_deck(analyse(finger, SKIN, stimulus))
    reference = calculix_deck(analyse(QUICK, SKIN, short))
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
    written = np.concatenate([finger_mm, analysis.probe_node_mm])
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


def test_mid_side_nodes_lie_between_their_corners(models, short, parse_deck):
    deck = parse_deck(calculix_deck(models["quadratic"].analysis(short)))
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


def test_a_modulus_of_many_digits_is_not_cut_by_ccx(short, parse_deck):
    soft = Material(1.2345678901234567e-05, 0.12345678901234568)
    finger = replace(QUICK, materials={**QUICK.materials, "dermis": soft})
    deck = parse_deck(calculix_deck(analyse(finger, SKIN, short)))
    (row,) = deck.all("ELASTIC")[2][2]
    assert max(map(len, row)) <= LONGEST_NUMBER
    assert_allclose([*map(float, row)], [soft.young_mpa, soft.poisson], rtol=1e-12)


def test_a_whole_number_and_the_same_float_give_the_same_deck(short):
    whole, real_ = (
        replace(QUICK, materials={**QUICK.materials, "dermis": Material(e, 0.3)}) for e in (1, 1.0)
    )
    assert calculix_deck(analyse(whole, SKIN, short)) == calculix_deck(analyse(real_, SKIN, short))


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


@pytest.mark.parametrize("element", ["CPE4", "CPE4R", "CPE8R"])
def test_all_elements_of_ccx_can_be_written(element, short):
    analysis = analyse(QUICK, SKIN, short, element=element)
    assert f"TYPE={element}," in calculix_deck(analysis)


@pytest.mark.parametrize("element", ["CPE4H", "CPE4RH", "CPE8"])
def test_an_element_that_ccx_has_not_is_refused(element, short):
    analysis = analyse(QUICK, SKIN, short, element=element)
    with pytest.raises(DeckError, match=f"calculix has no element '{element}'"):
        calculix_deck(analysis)
