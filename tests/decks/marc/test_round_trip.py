"""Our decks read back by the grammar: every line has its option, the mesh its numbers."""

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from decks.analysis import Model
from decks.marc.contents import POSITION, read_marc_deck
from decks.marc.grammar import Section
from decks.marc.write import marc_deck
from decks.presets import QUICK, mesh_of
from decks.stimuli import resolve
from decks.waveform import make_stimulus

(NOISE,) = (make_stimulus(entry) for entry in resolve("noise_25_250_10"))


def test_every_line_is_in_one_option_and_none_is_unknown(built):
    model, probe, ours = built
    deck = read_marc_deck(ours.text.encode("ascii"))
    lines = [line for option in deck.options for line in option.lines]
    assert [line.text for line in lines] == ours.text.splitlines()
    first = {}
    for option in deck.options:
        first.setdefault(option.keyword, option.section)
    assert first["sizing"] is first["end"] is Section.PARAMETER
    assert first["connectivity"] is first["post"] is Section.MODEL
    assert first["auto load"] is first["continue"] is Section.HISTORY
    assert (deck.remarks, deck.version) == ((), 15)
    finger, other = deck.bodies()
    motion = (other.control, *other.drives[1])
    assert (finger.name, finger.kind, other.name) == ("finger", 1, "probe")
    assert motion == ((POSITION, -1.0, 1) if probe == "rigid" else (0, 0.0, 0))
    parts = [*model.layers, *([model.probe] if probe == "meshed" else [])]
    place_mm, sets = deck.coordinates.position, deck.sets()
    node_mm = model.node_mm
    if probe == "meshed":
        node_mm = np.concatenate([node_mm, model.probe_mesh.node_mm])
    assert_allclose(place_mm[:, :2], node_mm, rtol=1e-15, atol=0)
    assert_array_equal(deck.coordinates.number, np.arange(1, len(node_mm) + 1))
    assert sets["skin_apex"].member.tolist() == [model.apex]
    for name, number in model.afferent.items():
        assert sets[f"afferent_{name.lower()}"].member.tolist() == [number]
    assert [each.name for each in deck.conditions()][1:] == ["probe_motion"] * (probe == "meshed")
    for block, material, part in zip(deck.elements, deck.materials(), parts, strict=True):
        assert_array_equal(block.node[:, : part.node.shape[1]], part.node)
        assert_array_equal(block.number, part.number)
        assert block.material == material.number
        assert material.name == part.name
        assert material.values[:2] == (part.material.young_mpa, part.material.poisson)


def test_pressure_nodes_and_a_real_stimulus_come_back():
    model = Model(QUICK, mesh_of(QUICK), element="CPE4H", support="prescribed").analysis(NOISE)
    deck = read_marc_deck(marc_deck(model).encode("ascii"))
    assert deck.sizes == (3100, len(model.node_mm) + 3100)
    for block, layer in zip(deck.elements, model.layers, strict=True):
        assert_array_equal(block.number, layer.number)
        assert_array_equal(block.node[:, :-1], layer.node)
        assert_array_equal(block.node[:, -1], len(model.node_mm) + layer.number)
    assert_allclose(deck.coordinates.position[:, :2], model.node_mm, rtol=1e-15)
    sets = deck.sets()
    assert_array_equal(sets["held_nodes"].member, model.fixed)
    (table,) = deck.tables
    wanted = np.stack([model.motion.time_s, model.motion.depth_mm], axis=1)
    assert_allclose(table.points, wanted, rtol=1e-15)
    (case,) = deck.load_cases()
    assert (case.increments, case.active) == (500, ("held",))
