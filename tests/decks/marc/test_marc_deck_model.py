"""The deck as a model: mesh, materials, who is held, how it moves, what is written."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from decks.marc.deck import marc_deck
from decks.material import TABLE_1
from decks.stimuli import resolve
from decks.waveform import make_stimulus

(NOISE,) = (make_stimulus(entry) for entry in resolve("noise_25_250_10"))
(PRESSED,) = (make_stimulus(entry, 500.0) for entry in resolve("sine_20_250"))
PRESSURE_TYPES = (80, 118)


# ---- Mesh


def test_every_node_has_its_number_and_its_place(built):
    model, probe, deck = built
    node_mm = model.node_mm
    if probe == "meshed":
        node_mm = np.concatenate([node_mm, model.probe_node_mm])
    nodes = deck.nodes()
    assert list(nodes) == list(range(1, len(node_mm) + 1))
    assert_allclose(np.array([*nodes.values()])[:, :2], node_mm, rtol=1e-15, atol=0)
    assert not np.array([*nodes.values()])[:, 2].any()


def test_every_element_has_its_type_and_nodes_and_a_pressure_of_its_own(built):
    model, probe, deck = built
    sections = [*model.layers, *([model.probe] if probe == "meshed" else [])]
    elements = deck.elements()
    assert len(elements) == sum(len(section.number) for section in sections)
    pressures = []
    for section in sections:
        for number, wanted in zip(section.number.tolist(), section.node.tolist(), strict=True):
            kind, *nodes = elements[number]
            if kind in PRESSURE_TYPES:
                pressures.append(nodes.pop())
            assert nodes == wanted
    count = len(deck.nodes())
    assert sorted(pressures) == list(range(count + 1, count + 1 + len(pressures)))


def test_corners_run_counter_clockwise_and_mid_sides_lie_between_them(built):
    _, _, deck = built
    nodes = deck.nodes()
    for kind, *members in deck.elements().values():
        corner = np.array([nodes[number][:2] for number in members[:4]])
        across, up = corner[2] - corner[0], corner[3] - corner[1]
        assert across[0] * up[1] - across[1] * up[0] > 0
        if kind in (27, 54):
            middle = np.array([nodes[number][:2] for number in members[4:]])
            between = 0.5 * (corner + np.roll(corner, -1, axis=0))
            assert_allclose(middle, between, atol=1e-12)


def test_one_block_a_layer_names_its_material_and_body(built, columns):
    model, probe, deck = built
    integers, _ = columns
    blocks = deck.all("connectivity")
    names = [layer.name for layer in model.layers]
    bodies = [1] * len(names)
    if probe == "meshed":
        names, bodies = [*names, "probe_body"], [*bodies, 2]
    assert len(blocks) == len(names)
    for k, (block, name, body) in enumerate(zip(blocks, names, bodies, strict=True)):
        assert integers(block.rows[0]) == [0, 0, 1, 0, 1, k + 1, 0, body, 0]
        members = [integers(row)[0] for row in block.rows[1:]]
        assert deck.members("element", name) == members
        assert deck.all("isotropic")[k].rows[1][90:] == name


def test_a_meshed_probe_has_the_fingers_type_or_one_of_four_nodes(make_model, read_deck):
    for element, kind in (("CPE4H", 80), ("CPE4", 11), ("CPE4RH", 118), ("CPE8", 11)):
        model = make_model(element)
        deck = read_deck(marc_deck(model, probe="meshed"))
        elements = deck.elements()
        kinds = {elements[number][0] for number in model.probe.number.tolist()}
        assert kinds == {kind}


def test_a_rigid_probe_has_no_node_and_no_element(make_model, read_deck):
    model = make_model()
    deck = read_deck(marc_deck(model))
    assert max(deck.elements()) == len(model.mesh.quad)
    assert not [option for option in deck.all("define") if "probe" in option.word]
    assert len(deck.nodes()) == len(model.mesh.node_mm)


# ---- Sets, materials, geometry


def test_sets_hold_what_is_held_the_afferents_and_the_apex(built):
    model, probe, deck = built
    assert deck.members("node", "held_nodes") == model.fixed.tolist()
    assert deck.members("node", "skin_apex") == [model.apex]
    for name, number in model.afferent.items():
        assert deck.members("node", f"afferent_{name.lower()}") == [number]
        words = f"$....{name}: {model.sites[name]}"
        assert words in deck.text.splitlines()
    if probe == "meshed":
        first = model.first_probe_node
        wanted = list(range(first, first + len(model.probe_node_mm)))
        assert deck.members("node", "probe_nodes") == wanted


def test_materials_are_those_of_table_1(built, columns):
    model, _, deck = built
    integers, reals = columns
    found = {}
    for option in deck.all("isotropic"):
        young, poisson, *rest = reals(option.rows[2])
        assert not any(rest)
        assert not any(integers(option.rows[3]))
        found[option.rows[1][90:]] = (young, poisson)
    for layer in model.layers:
        wanted = TABLE_1[layer.name]
        assert found[layer.name] == (wanted.young_mpa, wanted.poisson)
    assert set(found) - {"probe_body"} == set(TABLE_1)


def test_plain_four_node_elements_alone_have_constant_dilatation(built, columns):
    model, _, deck = built
    _, reals = columns
    _, kind, name, row, blank = deck.one("geometry").rows
    assert kind[:20] == "         1         2"  # plane strain
    assert (name, blank) == ("plane_strain", "")
    plain_quad = float(model.element == "CPE4")
    assert reals(row) == [1.0, plain_quad, 0, 0, 0, 0, 0]


# ---- Motion


def table_of(deck, columns):
    integers, reals = columns
    head, variable, *rows = deck.one("table", "waveform").rows
    assert integers(head) == [1, 1, 0, 0, 2]
    assert integers(variable) == [1, len(rows), 2, *[0, 0, 2] * 3, 0, 0, 0, 0]
    return np.array([reals(row) for row in rows]).T


def test_the_table_is_the_stimulus_to_its_last_digit(make_model, read_deck, columns):
    deck = read_deck(marc_deck(make_model(stimulus=NOISE)))
    time_s, depth_mm = table_of(deck, columns)
    assert len(time_s) == 501
    assert_array_equal(np.round(time_s, 7), np.round(NOISE.times_ms * 1e-3, 7))
    assert_allclose(depth_mm * 1e3, NOISE.displacement_um, rtol=1e-15, atol=1e-15)


@pytest.mark.parametrize(("stimulus", "count"), [(NOISE, 500), (PRESSED, 520)])
def test_there_is_one_fixed_increment_a_sample_and_none_is_cut_back(
    stimulus, count, make_model, read_deck, columns
):
    integers, reals = columns
    deck = read_deck(marc_deck(make_model(stimulus=stimulus)))
    assert integers(deck.one("auto load").rows[0]) == [count, 0, 0, 0, 0]
    ((dt_s,),) = [reals(row) for row in deck.one("time step").rows]
    assert dt_s == 0.0005
    assert "auto step" not in deck.keywords
    time_s, _ = table_of(deck, columns)
    assert_allclose(time_s[-1], count * dt_s, rtol=1e-15)
    assert integers(deck.one("control").rows[0])[0] >= count


def test_a_pre_indentation_is_ramped_in_before_the_stimulus(make_model, read_deck, columns):
    deck = read_deck(marc_deck(make_model(stimulus=PRESSED)))
    _, depth_mm = table_of(deck, columns)
    assert depth_mm[0] == 0.0
    assert_allclose(np.diff(depth_mm[:21]), 0.025, rtol=1e-9)
    assert_allclose(depth_mm[20:] * 1e3, PRESSED.displacement_um, atol=1e-12)
    assert "$....up to 0.01 s: the ramp to the pre-indentation" in deck.text


def test_what_is_held_does_not_move_and_a_meshed_probe_moves_by_the_table(built, columns):
    _, probe, deck = built
    integers, reals = columns
    blank, *rows = deck.one("fixed disp").rows
    assert blank == ""
    conditions = [rows[k : k + 6] for k in range(0, len(rows), 6)]
    found = {
        head[60:]: (reals(value), integers(table), integers(dof), kind.strip(), nodes)
        for head, value, table, dof, kind, nodes in conditions
    }
    wanted = {"held": ([0.0, 0.0], [0, 0], [1, 2], "2", "held_nodes")}
    if probe == "meshed":
        wanted["probe_motion"] = ([0.0, -1.0], [0, 1], [1, 2], "2", "probe_nodes")
    assert found == wanted
    for name in ("job1", "press"):
        count, *active = deck.one("loadcase", name).rows
        assert int(count) == len(active)
        assert active == list(wanted)


def test_convergence_is_of_force_and_displacement(built, columns):
    _, _, deck = built
    integers, reals = columns
    counts, force, displacement = deck.one("control").rows
    assert deck.one("control").word == "structural"
    _, recycles, least, criterion, _, newton, *_ = integers(counts)
    assert (recycles, least, criterion, newton) == (40, 0, 5, 1)
    assert reals(force) == reals(displacement) == [1e-3, 0, 0, 0, 0, 0, -1.0, 0]


# ---- Output


@pytest.mark.parametrize(("kind", "number"), [("binary", 0), ("formatted", 1), ("both", 2)])
def test_stress_and_von_mises_are_posted_every_increment(
    make_model, read_deck, columns, kind, number
):
    integers, _ = columns
    deck = read_deck(marc_deck(make_model(), post=kind))
    head, *codes = [integers(row) for row in deck.one("post").rows]
    assert codes == [[311, 0], [17, 0]]
    nodal = [int(option.word) for option in deck.all("nodal")]
    assert nodal == [1, 5, 35, 38]
    assert all(len(option.line) == 30 for option in deck.all("nodal"))
    assert head == [2, 16, 17, number, 0, 19, 20, 0, 1, 0, 0, 0, 4, 0, 0, 0]


def test_both_kinds_of_post_file_are_said_to_be_a_guess(make_model, read_deck):
    for kind in ("both", "binary"):
        comments = " ".join(read_deck(marc_deck(make_model(), post=kind)).one("post").comments)
        told = "which no deck was seen with" in comments.replace(" $....", " ")
        assert told == (kind == "both")
