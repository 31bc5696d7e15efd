"""Our decks read back: what the model has comes out of the deck again."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from decks.analysis import analyse
from decks.dialects import DIALECTS
from decks.marc.contents import POSITION, POST_KINDS, read_marc_deck
from decks.marc.grammar import Section
from decks.marc.write import marc_deck
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


def parts_of(model, probe):
    return [*model.layers, *([model.probe] if probe == "meshed" else [])]


def test_every_line_is_in_one_option_and_none_is_unknown(built, read):
    _, _, ours = built
    _, _, deck = read
    lines = [line for option in deck.options for line in option.lines]
    assert [line.text for line in lines] == ours.text.splitlines()
    keywords = [word for word in ours.keywords if word != "nodal"]  # a part of `post`
    assert [option.keyword for option in deck.options] == keywords
    first = {}
    for option in deck.options:
        first.setdefault(option.keyword, option.section)
    assert first["sizing"] is first["end"] is Section.PARAMETER
    assert first["connectivity"] is first["post"] is Section.MODEL
    assert first["auto load"] is first["continue"] is Section.HISTORY
    assert not deck.remarks
    assert deck.version == 15


def test_the_mesh_comes_back(read):
    model, probe, deck = read
    node_mm = model.node_mm
    if probe == "meshed":
        node_mm = np.concatenate([node_mm, model.probe_node_mm])
    assert_array_equal(deck.coordinates.number, np.arange(1, len(node_mm) + 1))
    assert_allclose(deck.coordinates.position[:, :2], node_mm, rtol=1e-15)
    for block, part in zip(deck.elements, parts_of(model, probe), strict=True):
        assert_array_equal(block.number, part.number)
        nodes = block.node
        if block.kind in PRESSURE_TYPES:
            assert_array_equal(nodes[:, -1], len(node_mm) + block.number)
            nodes = nodes[:, :-1]
        assert_array_equal(nodes, part.node)
        assert block.body == (2 if part is model.probe else 1)
    kind = int(DIALECTS["marc"].elements[model.element])
    assert {block.kind for block in deck.elements if block.body == 1} == {kind}
    highest = max(int(block.node.max()) for block in deck.elements)
    assert deck.sizes == (sum(len(block.number) for block in deck.elements), highest)


def test_sets_and_materials_come_back(read):
    model, probe, deck = read
    parts = parts_of(model, probe)
    wanted = {part.name: part.number for part in parts}
    wanted |= {"held_nodes": model.fixed, "skin_apex": [model.apex]}
    wanted |= {f"afferent_{name.lower()}": [node] for name, node in model.afferent.items()}
    if probe == "meshed":
        wanted["probe_nodes"] = model.first_probe_node + np.arange(len(model.probe_node_mm))
    sets = deck.sets()
    assert set(sets) == set(wanted)
    names = [part.name for part in parts]
    for name, members in wanted.items():
        assert_array_equal(sets[name].member, members)
        assert sets[name].kind == ("element" if name in names else "node")
    for block, material, part in zip(deck.elements, deck.materials(), parts, strict=True):
        assert (block.geometry, block.material) == (1, material.number)
        assert material.name == part.name
        assert material.values[:2] == (part.material.young_mpa, part.material.poisson)
        assert not any(material.tables)


def test_the_motion_comes_back(read):
    model, probe, deck = read
    motion = model.motion
    (table,) = deck.tables
    assert (table.name, table.number, table.variable) == ("waveform", 1, 1)
    assert_allclose(table.points, np.stack([motion.time_s, motion.depth_mm], 1), rtol=1e-15)
    conditions = {
        each.name: (each.values, each.tables, each.directions, each.where)
        for each in deck.conditions()
    }
    wanted = {"held": ((0.0, 0.0), (0, 0), (1, 2), "held_nodes")}
    finger, other = deck.bodies()
    assert (finger.name, finger.kind, other.name) == ("finger", 1, "probe")
    if probe == "rigid":
        assert (other.kind, other.control) == (2, POSITION)
        assert (other.motion[:3], other.tables[:3]) == ((0.0, -1.0, 0.0), (0, 1, 0))
        assert not any(other.motion[3:] + other.tables[3:])
    else:
        wanted["probe_motion"] = ((0.0, -1.0), (0, 1), (1, 2), "probe_nodes")
        assert (other.kind, any(other.motion)) == (1, False)
    assert conditions == wanted
    (case,) = deck.load_cases()
    assert (case.name, case.stepping.keyword, case.active) == ("press", "auto load", tuple(wanted))
    assert case.increments == motion.increments
    assert_allclose(case.period, motion.increments * motion.dt_s, rtol=1e-14)


@pytest.mark.parametrize("results", POST_KINDS)
def test_the_output_comes_back(make_model, results):
    found = read_marc_deck(marc_deck(make_model(), results=results).encode("ascii")).post()
    assert (found.codes, found.nodal, found.every) == ((311, 17), (1, 5, 35, 38), 1)
    assert found.head[3] == POST_KINDS[results]


def test_the_papers_mesh_and_a_real_stimulus_come_back():
    model = analyse(PAPER, mesh_of(PAPER), NOISE, element="CPE4H")
    deck = read_marc_deck(marc_deck(model).encode("ascii"))
    assert deck.sizes == (17_702, len(model.node_mm) + 17_702)
    numbers = np.concatenate([block.number for block in deck.elements])
    assert_array_equal(np.sort(numbers), np.arange(1, 17_703))
    assert_allclose(deck.coordinates.position[:, :2], model.node_mm, rtol=1e-15)
    (case,) = deck.load_cases()
    assert case.increments == 500
