"""Our decks read back by a grammar that was written without them."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from decks.analysis import analyse
from decks.marc.deck import marc_deck
from decks.marc.element_types import MARC_TYPES
from decks.marc_grammar import Section, read_marc_deck
from decks.marc_grammar.conditions import conditions
from decks.marc_grammar.contact import POSITION, contact, contact_tables, interactions
from decks.marc_grammar.history import initial_conditions, load_cases
from decks.marc_grammar.material import isotropic
from decks.marc_grammar.mesh import read_sets
from decks.marc_grammar.post import post
from decks.presets import PAPER, mesh_of
from decks.stimuli import resolve
from decks.waveform import make_stimulus

(NOISE,) = (make_stimulus(entry) for entry in resolve("noise_25_250_10"))
PRESSURE_TYPES = (80, 118)


@pytest.fixture(scope="module")
def read(built):
    """Give a model, its kind of probe, and what the grammar reads in its deck."""
    model, probe, deck = built
    return model, probe, read_marc_deck(deck.text.encode("ascii"))


def sections_of(model, probe):
    return [*model.layers, *([model.probe] if probe == "meshed" else [])]


def test_every_line_stands_in_one_option_and_none_is_unknown(built, read):
    _, _, ours = built
    _, _, deck = read
    lines = [line for option in deck.options for line in option.lines]
    assert [line.text for line in lines] == ours.text.splitlines()
    assert [line.number for line in lines] == list(range(1, len(lines) + 1))
    keywords = [word for word in ours.keywords if word != "nodal"]  # a part of `post`
    assert [option.keyword for option in deck.options] == keywords
    assert not deck.remarks
    assert deck.version == 15


def test_options_stand_where_marc_expects_them(read):
    _, _, deck = read
    first = {}
    for option in deck.options:
        first.setdefault(option.keyword, option.section)
    assert first["sizing"] is first["end"] is Section.PARAMETER
    assert first["connectivity"] is first["post"] is Section.MODEL
    assert first["auto load"] is first["continue"] is Section.HISTORY
    assert list(deck.cases) == [1]


def test_the_mesh_comes_back(read):
    model, probe, deck = read
    node_mm = model.node_mm
    if probe == "meshed":
        node_mm = np.concatenate([node_mm, model.probe_node_mm])
    assert_array_equal(deck.coordinates.number, np.arange(1, len(node_mm) + 1))
    assert_allclose(deck.coordinates.position[:, :2], node_mm, rtol=1e-15)
    sections = sections_of(model, probe)
    assert len(deck.elements) == len(sections)
    for block, section in zip(deck.elements, sections, strict=True):
        assert_array_equal(block.number, section.number)
        nodes = block.node
        if block.kind in PRESSURE_TYPES:
            assert_array_equal(nodes[:, -1], len(node_mm) + block.number)
            nodes = nodes[:, :-1]
        assert_array_equal(nodes, section.node)
    kind = MARC_TYPES[model.element].number
    assert {block.kind for block in deck.elements if block.body == 1} == {kind}


def test_sizes_are_what_the_deck_holds(read):
    _, _, deck = read
    highest = max(int(block.node.max()) for block in deck.elements)
    assert deck.sizes == (sum(len(block.number) for block in deck.elements), highest)


def test_sets_come_back(read):
    model, probe, deck = read
    sets = read_sets(deck.find("define", Section.MODEL))
    wanted = {section.name: section.number for section in sections_of(model, probe)}
    wanted |= {"held_nodes": model.fixed, "skin_apex": np.array([model.apex])}
    for name, number in model.afferent.items():
        wanted[f"afferent_{name.lower()}"] = np.array([number])
    if probe == "meshed":
        first = model.first_probe_node
        wanted["probe_nodes"] = first + np.arange(len(model.probe_node_mm))
    assert set(sets) == set(wanted)
    for name, members in wanted.items():
        assert_array_equal(sets[name].member, members)
        on_elements = name in [section.name for section in sections_of(model, probe)]
        assert sets[name].kind == ("element" if on_elements else "node")


def test_materials_come_back(read):
    model, probe, deck = read
    sections = sections_of(model, probe)
    found = isotropic(deck)
    assert [material.number for material in found] == list(range(1, len(sections) + 1))
    for block, material, section in zip(deck.elements, found, sections, strict=True):
        assert (material.name, material.criterion) == (section.name, "elastic")
        assert material.young == section.material.young_mpa
        assert material.poisson == section.material.poisson
        assert not any(material.tables)
        assert (block.geometry, block.material) == (1, material.number)
        assert block.body == (2 if section is model.probe else 1)


def test_the_waveform_comes_back(read):
    model, _, deck = read
    (table,) = deck.tables
    assert (table.name, table.number, table.variables) == ("waveform", 1, (1,))
    motion = model.motion
    assert_allclose(table.points[:, 0], motion.time_s, rtol=1e-15)
    assert_allclose(table.points[:, 1], motion.depth_mm, rtol=1e-15)


def test_bodies_and_their_contact_come_back(read):
    model, probe, deck = read
    found = contact(deck)
    finger, other = found.bodies
    assert (finger.number, finger.name, finger.kind) == (1, "finger", 1)
    assert (other.number, other.name) == (2, "probe")
    assert found.friction_type == (6 if model.contact.friction else 0)
    if probe == "rigid":
        assert (other.kind, other.control) == (2, POSITION)
        assert other.motion[:3] == (0.0, -1.0, 0.0)
        assert other.motion_table[:3] == (0, 1, 0)
        assert not any(other.motion[3:] + other.motion_table[3:])
        points = np.array([shape.point for shape in other.shapes])
        side = model.lower_side_mm
        assert_allclose(points, np.stack([side[:-1], side[1:]], axis=1), rtol=1e-15)
        for shape in other.shapes:
            assert (shape.counts, shape.orders) == ((2,), (2,))
            assert shape.weight.tolist() == [1, 1]
            assert shape.knot.tolist() == [0, 0, 1, 1]
    else:
        assert (other.kind, len(other.shapes)) == (1, 0)
        assert not any(other.motion)
    (touch,) = interactions(deck)
    assert (touch.number, touch.name) == (1, "touch")
    assert touch.friction == model.contact.friction
    assert not any(touch.tables)
    (pairs,) = contact_tables(deck)
    assert pairs.pairs == ((1, 2, 1),)


def test_what_is_held_and_moved_comes_back(read):
    _, probe, deck = read
    found = {
        each.name: (each.values, each.tables, each.directions, each.where)
        for each in conditions(deck)
    }
    wanted = {"held": ((0.0, 0.0), (0, 0), (1, 2), "held_nodes")}
    if probe == "meshed":
        wanted["probe_motion"] = ((0.0, -1.0), (0, 1), (1, 2), "probe_nodes")
    assert found == wanted
    (case,) = load_cases(deck)
    assert initial_conditions(deck) == case.active == tuple(wanted)


def test_the_increments_come_back(read):
    model, _, deck = read
    (case,) = load_cases(deck)
    motion = model.motion
    assert (case.name, case.stepping.keyword) == ("press", "auto load")
    assert case.increments == motion.increments
    assert_allclose(case.period, motion.increments * motion.dt_s, rtol=1e-14)


@pytest.mark.parametrize("kind", ["binary", "formatted", "both"])
def test_the_output_comes_back(make_model, kind):
    found = post(read_marc_deck(marc_deck(make_model(), post=kind).encode("ascii")))
    assert [(each.code, each.layer) for each in found.codes] == [(311, 0), (17, 0)]
    assert found.nodal == (1, 5, 35, 38)
    assert found.every == 1
    assert found.formatted == (kind == "formatted")


def test_the_papers_mesh_and_a_real_stimulus_come_back():
    model = analyse(PAPER, mesh_of(PAPER), NOISE, element="CPE4H")
    deck = read_marc_deck(marc_deck(model).encode("ascii"))
    assert deck.sizes == (17_702, len(model.node_mm) + 17_702)
    numbers = np.concatenate([block.number for block in deck.elements])
    assert_array_equal(np.sort(numbers), np.arange(1, 17_703))
    assert_allclose(deck.coordinates.position[:, :2], model.node_mm, rtol=1e-15)
    (case,) = load_cases(deck)
    assert case.increments == 500
