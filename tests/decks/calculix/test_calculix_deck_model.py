"""The deck as a model: who is held, who touches, who is watched, how it moves."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from decks.calculix import calculix_deck
from decks.finger import LAYERS, SITES
from decks.keyword_deck import LONGEST_NUMBER
from decks.mesh import Mesh
from decks.stimuli import resolve
from decks.waveform import make_stimulus
from fembridge.errors import DeckError
from fembridge.stimulus import Stimulus

(NOISE,) = (make_stimulus(entry) for entry in resolve("noise_25_250_10"))
(PRESSED,) = (make_stimulus(entry, 500.0) for entry in resolve("sine_20_250"))


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


def test_an_afferent_at_the_apex_is_not_written_twice(models, short):
    analysis = models["plain"].analysis(short)
    doubled = replace(analysis, afferent_row={"SA": analysis.apex_row, "RA": analysis.apex_row})
    assert doubled.watched.tolist() == [analysis.apex]


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


def test_as_a_set_of_nodes_the_skin_has_its_mid_sides_too(models, short, parse_deck):
    plain_, quadratic = (
        set(parse_deck(calculix_deck(models[kind].analysis(short))).set_of("SKIN_CONTACT"))
        for kind in ("plain", "quadratic")
    )
    assert plain_ < quadratic
    assert len(quadratic) == 2 * len(plain_) - 1  # one between each two neighbours


def test_contact_by_node_gives_a_stiffness_and_a_tension(models, short, parse_deck):
    deck = parse_deck(calculix_deck(models["plain"].analysis(short)))
    assert deck.one("CONTACT PAIR")[1]["TYPE"] == "NODE TO SURFACE"
    _, options, rows = deck.one("SURFACE BEHAVIOR")
    assert options == {"PRESSURE-OVERCLOSURE": "LINEAR"}
    assert rows == [["200.0", "0.001"]]
    assert deck.one("FRICTION")[2] == [["0.4", "20.0"]]


def test_contact_by_surface_gives_a_stiffness_alone(models, short, parse_deck):
    deck = parse_deck(calculix_deck(models["by surface"].analysis(short)))
    assert deck.one("CONTACT PAIR")[1]["TYPE"] == "SURFACE TO SURFACE"
    assert deck.one("SURFACE BEHAVIOR")[2] == [["1000.0"]]
    assert deck.one("SURFACE", NAME="SKIN_SURFACE")[1]["TYPE"] == "ELEMENT"
    assert not [card for card in deck.all("NSET") if card[1]["NSET"] == "SKIN_CONTACT"]


def test_without_friction_there_is_no_card_of_it(models, short, parse_deck):
    assert not parse_deck(calculix_deck(models["smooth"].analysis(short))).all("FRICTION")


def test_a_contact_that_ccx_has_not_for_plane_elements_is_refused(models, short):
    analysis = models["plain"].analysis(short)
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


def test_the_amplitude_is_the_stimulus_to_its_last_digit(models, parse_deck):
    stimulus = NOISE
    deck = parse_deck(calculix_deck(models["plain"].analysis(stimulus)))
    time_s, depth_mm = amplitude_of(deck)
    assert_array_equal(time_s, np.round(stimulus.times_ms * 1e-3, 7))
    assert_array_equal(depth_mm, np.round(stimulus.displacement_um * 1e-3, 9))
    assert_allclose(depth_mm * 1e3, stimulus.displacement_um, rtol=0, atol=1e-12)


def test_a_pre_indentation_is_ramped_in_before_the_stimulus(models, parse_deck):
    deck = parse_deck(calculix_deck(models["plain"].analysis(PRESSED)))
    time_s, depth_mm = amplitude_of(deck)
    assert len(time_s) == 521
    assert (time_s[0], depth_mm[0]) == (0.0, 0.0)
    assert_allclose(np.diff(depth_mm[:21]), 0.025, rtol=1e-9)
    assert_allclose(depth_mm[20:] * 1e3, PRESSED.displacement_um, atol=1e-12)
    assert "up to 0.01 s: the ramp to the pre-indentation" in deck.comments


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
