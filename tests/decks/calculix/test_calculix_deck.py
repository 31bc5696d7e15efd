"""The deck as text and as a model: what ccx wants, and what a plain parser reads in it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from decks.calculix import calculix_deck
from decks.dialects import DIALECTS, DeckOptions
from decks.finger import LAYERS, TABLE_1
from decks.keyword_deck import LONGEST_NUMBER, fixed, real
from decks.mesh import Mesh
from decks.presets import QUICK
from decks.stimuli import resolve
from decks.synthesis import make_stimulus
from fembridge.solver.build import build_run_folder
from fembridge.stimulus import Stimulus

SOFT = ("stratum_corneum", "epidermis", "dermis", "subcutaneous_tissue")
(NOISE,) = (make_stimulus(entry) for entry in resolve("noise_25_250_10"))


# ---- Text


def test_no_line_has_more_entries_than_ccx_reads_and_no_number_more_characters(built):
    _, text, deck = built
    for keyword, _, rows in deck.cards:
        most = 8 if keyword == "AMPLITUDE" else 16
        for row in rows:
            if keyword != "HEADING":
                assert len(row) <= most
                assert max(map(len, row)) <= LONGEST_NUMBER
    assert max(map(len, text.splitlines())) < 132


def test_no_name_of_a_finger_or_stimulus_can_become_a_card(models, short, parse_deck):
    reference = calculix_deck(models["plain"].analysis(short))
    cards = [card[:2] for card in parse_deck(reference).cards]
    for finger, stimulus in (("人差し指", "a\n*STEP"), ("*STEP", "x" * 300), ("a\tb", "\N{NULL}")):
        named = replace(models["plain"], finger=replace(QUICK, name=finger))
        text = calculix_deck(named.analysis(replace(short, id=stimulus)))
        assert text.isascii()
        assert [card[:2] for card in parse_deck(text).cards] == cards
        assert len(text.splitlines()) == len(reference.splitlines())
        assert len(text.splitlines()[1]) <= 78


# ---- Names


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
        replace(models["plain"], element="CPE8R").analysis(short),
        mesh=strip,
        fixed_row=np.arange(8),
        afferent={},
        apex=1,
        contact_edge=np.array([[0, 2]]),
    )
    deck = parse_deck(calculix_deck(analysis))
    nodes = deck.nodes()
    held_mm = [nodes[number][:2] for number in deck.set_of("HELD")]
    inside = {(1.0, -0.5), (2.0, -0.5)}
    assert len(held_mm) == 8 + 8
    assert not inside & set(held_mm)


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


# ---- Motion


def amplitude_of(deck):
    _, options, rows = deck.one("AMPLITUDE")
    assert options == {"NAME": "DEPTH", "TIME": "TOTAL TIME"}
    words = [word for row in rows for word in row]
    return np.array(words, dtype=float).reshape(-1, 2).T


@pytest.mark.parametrize(
    "stimulus",
    [
        NOISE,
        *(
            Stimulus("odd", np.arange(301.0), dt_ms, (0.0, 300 * dt_ms))
            for dt_ms in (1 / 3, 1e-7, 0.0001234567)
        ),
    ],
    ids=lambda stimulus: f"{stimulus.dt_ms:g} ms",
)
def test_the_amplitude_is_the_stimulus_and_increments_fill_the_step(stimulus, models, parse_deck):
    """A step length cut to seven decimals would end one increment early or late."""
    deck = parse_deck(calculix_deck(models["plain"].analysis(stimulus)))
    _, _, [[increment_s, end_s]] = deck.one("STATIC")
    steps = stimulus.displacement_um.size - 1
    assert_allclose(float(end_s) / float(increment_s), steps, rtol=1e-11)
    assert max(len(increment_s), len(end_s)) <= LONGEST_NUMBER
    time_s, depth_mm = amplitude_of(deck)
    assert_allclose(time_s, stimulus.times_ms * 1e-3, rtol=2e-12)
    assert_array_equal(depth_mm, np.round(stimulus.displacement_um * 1e-3, 9))


# ---- The probe on a spring, half of a section, inertia


def test_all_nodes_of_the_probe_go_down_with_the_node_on_the_spring(models, parse_deck, short):
    model = replace(models["plain"], support="spring", section="whole").analysis(short)
    deck = parse_deck(calculix_deck(model))
    pairs = {}
    for _, _, (_, (node, axis, one, other, same, minus_one)) in deck.all("EQUATION"):
        assert (axis, same, float(one), float(minus_one)) == ("2", "2", 1.0, -1.0)
        pairs[int(node)] = int(other)
    first, count = model.first_probe_node, len(model.probe_mesh.node_mm)
    assert sorted(pairs) == list(range(first, first + count))
    [rigid] = set(pairs.values())
    _, _, [spring] = deck.one("ELEMENT", TYPE="SPRING2")
    _, on_spring, driver = map(int, spring)
    assert on_spring == rigid
    assert pairs.keys().isdisjoint({rigid, driver})


def test_decks_of_other_solvers_are_of_the_whole(models, short):
    half = replace(models["plain"], element="CPE4H", support="spring").analysis(short)
    assert half.is_half
    for name in ("abaqus", "marc"):
        decks = (
            DIALECTS[name].write(model, DeckOptions()) for model in (half, half.full_section())
        )
        of_half, of_full_section = decks
        assert of_half == of_full_section


@pytest.fixture
def held(short):
    """The stimulus on a pre-indentation."""
    return replace(short, displacement_um=300.0 + short.displacement_um, preindent_um=300.0)


def test_the_store_of_energy_touches_nothing_and_outweighs_the_skin(models, held, parse_deck):
    deck = parse_deck(calculix_deck(replace(models["plain"], inertia=True).analysis(held)))
    numbers = {row[0] for row in deck.one("NODE", NSET="STORE")[2]}
    for _, options, rows in deck.all("ELEMENT"):
        if options["TYPE"] != "SPRING1":
            assert not any(numbers.intersection(row[1:]) for row in rows)
    stiffness = float(deck.one("SPRING", ELSET="STORE_SPRING")[2][1][0])
    [(_, _, [[node, _, force]])] = deck.all("CLOAD")
    assert node in numbers
    stored_n_mm = float(force) ** 2 / stiffness / 2
    pressed_n_mm = 0.5 * 0.02 * 0.3  # 0.02 N at 300 um, about linear
    assert stored_n_mm > 1e4 * pressed_n_mm


def test_a_run_folder_tells_samples_and_not_increments(tmp_path, models, held):
    run = build_run_folder(tmp_path / "run", replace(models["plain"], inertia=True), held)
    assert (run.increments, run.dt_ms, run.before_ms) == (43, 0.5, 0.0)
    assert run.increments_in_all == 86
    assert_allclose([run.start_ms, run.end_ms], [20.0, 21.5])
    assert run.inputs["inertia"] is True
    assert "drive" not in run.inputs


# ---- Neo-Hookean skin


def test_its_constants_are_half_the_shear_modulus_and_two_over_the_bulk_modulus(
    models, short, parse_deck
):
    """Young's modulus and Poisson's ratio follow from G and K by E = 9KG/(3K + G)."""
    analysis = replace(models["plain"], law="neo-hookean").analysis(short)
    deck = parse_deck(calculix_deck(analysis))
    soft = [
        name for _, options, _ in deck.all("MATERIAL") if (name := options["NAME"].lower()) in SOFT
    ]
    assert sorted(soft) == sorted(SOFT)
    for layer, (_, _, [row]) in zip(soft, deck.all("HYPERELASTIC"), strict=True):
        c10_mpa, d1_per_mpa = map(float, row)
        shear_mpa, bulk_mpa = 2 * c10_mpa, 2 / d1_per_mpa
        young_mpa = 9 * bulk_mpa * shear_mpa / (3 * bulk_mpa + shear_mpa)
        poisson = (3 * bulk_mpa - 2 * shear_mpa) / (2 * (3 * bulk_mpa + shear_mpa))
        assert_allclose(young_mpa, TABLE_1[layer].young_mpa, rtol=1e-12)
        assert_allclose(poisson, TABLE_1[layer].poisson, rtol=1e-9)


# ---- Numbers


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
