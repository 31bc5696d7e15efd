"""The deck of half a section: what is in it, and that its stress is the whole's."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from decks.abaqus import abaqus_deck
from decks.analysis import Contact, Model
from decks.calculix import calculix_deck
from decks.dialects import DIALECTS, DeckOptions
from decks.material import PronyTerm
from decks.presets import QUICK, mesh_of, model_of
from decks.probe import Probe
from decks.stimuli import resolve
from decks.waveform import make_stimulus
from fembridge.build import build_run_folder
from fembridge.results import read
from fembridge.results.printed import read_total_force
from fembridge.run_folder import read_run_folder
from fembridge.solver.ccx import run_ccx
from fembridge.solver.settings import SolverSettings

SKIN = mesh_of(QUICK)
RELAXING = replace(
    QUICK,
    materials={
        **QUICK.materials,
        "dermis": replace(QUICK.materials["dermis"], prony=(PronyTerm(0.4, 0.02),)),
    },
)


def half_of(stimulus, finger=QUICK, **options):
    return Model(finger, SKIN, **options).analysis(stimulus)


@pytest.fixture(scope="module", params=["plain", "quadratic", "relaxing", "smooth", "flat"])
def both(request, parse_deck, short):
    """Give what the parser reads in the deck of a whole, and of its half."""
    analysis = {
        "plain": lambda: half_of(short),
        "quadratic": lambda: half_of(short, element="CPE8R"),
        "relaxing": lambda: half_of(short, RELAXING),
        "smooth": lambda: half_of(short, contact=Contact(friction=0.0)),
        "flat": lambda: half_of(short, probe=Probe("flat", 2.0, 0.2)),
    }[request.param]()
    return [
        parse_deck(calculix_deck(replace(analysis, section=section)))
        for section in ("whole", "half")
    ]


def owned_by(deck, name):
    """Nodes of an element set."""
    rows = deck.one("ELEMENT", ELSET=name)[2]
    return {int(word) for row in rows for word in row[1:]}


def test_nodes_and_elements_are_those_of_the_whole_right_of_the_axis(both):
    whole, half = both
    nodes = whole.nodes()
    right = {number for number, (x, *_) in nodes.items() if x >= 0}
    assert half.nodes() == {number: nodes[number] for number in right}
    for card in whole.all("ELEMENT"):
        name = card[1]["ELSET"]
        if name.startswith("DRIVE_") or "_PRONY_" in name:
            continue
        kept = [row for row in card[2] if right.issuperset(map(int, row[1:]))]
        assert half.one("ELEMENT", ELSET=name)[2] == kept
        assert 2 * len(kept) == len(card[2])


def test_sets_of_a_half_name_nodes_that_are_there(both):
    whole, half = both
    nodes = set(half.nodes())
    for card in half.all("NSET"):
        name = card[1]["NSET"]
        assert nodes.issuperset(half.set_of(name))
        if name not in ("AXIS", "AXIS_CONTACT", "SKIN_CONTACT"):
            there = [number for number in whole.set_of(name) if number in nodes]
            assert half.set_of(name) == there
    tied = {int(card[2][1][0]) for card in half.all("EQUATION")}
    driven = {int(card[2][1][3]) for card in half.all("EQUATION")}
    assert tied == owned_by(half, "PROBE_BODY")
    assert tied | driven <= nodes


def test_branches_of_relaxing_skin_lie_over_the_half_alone(parse_deck, short):
    deck = parse_deck(calculix_deck(half_of(short, RELAXING)))
    layer = deck.one("ELEMENT", ELSET="DERMIS")[2]
    branch = deck.one("ELEMENT", ELSET="DERMIS_PRONY_1")[2]
    assert [row[1:] for row in branch] == [row[1:] for row in layer]


def test_the_skin_on_the_axis_has_a_contact_pair_of_its_own_half_as_stiff(both):
    whole, half = both
    nodes = half.nodes()
    on_axis = half.set_of("AXIS_CONTACT")
    beside = half.set_of("SKIN_CONTACT")
    assert on_axis
    assert all(nodes[number][0] == 0 for number in on_axis)
    assert all(nodes[number][0] > 0 for number in beside)
    together = {*on_axis, *beside}
    assert together == {n for n in whole.set_of("SKIN_CONTACT") if n in nodes}
    pairs = half.all("CONTACT PAIR")
    assert [(card[1]["INTERACTION"], card[2]) for card in pairs] == [
        ("TOUCH", [["SKIN_SURFACE", "PROBE_SURFACE"]]),
        ("TOUCH_ON_AXIS", [["AXIS_SURFACE", "PROBE_SURFACE"]]),
    ]
    assert half.one("SURFACE", NAME="AXIS_SURFACE")[2] == [["AXIS_CONTACT"]]
    names = [card[1]["NAME"] for card in half.all("SURFACE INTERACTION")]
    assert names == ["TOUCH", "TOUCH_ON_AXIS"]
    full, halved = ([float(word) for word in card[2][0]] for card in half.all("SURFACE BEHAVIOR"))
    assert full == [float(w) for w in whole.one("SURFACE BEHAVIOR")[2][0]]
    assert halved == [0.5 * value for value in full]
    frictions = [[float(w) for w in card[2][0]] for card in half.all("FRICTION")]
    if frictions:
        (mu, stick), (same_mu, half_stick) = frictions
        assert (same_mu, half_stick) == (mu, 0.5 * stick)


def test_all_nodes_on_the_axis_are_held_aside_in_each_step(both):
    whole, half = both
    finger = {int(row[0]) for row in half.one("NODE", NSET="FINGER")[2] if float(row[1]) == 0}
    assert set(half.set_of("AXIS")) == finger
    steps = half.all("STEP")
    fixed = [card[2] for card in half.all("BOUNDARY") if not card[1]]
    assert len(fixed) == len(steps)
    assert all(["AXIS", "1", "1"] in rows for rows in fixed)
    assert not any(["AXIS", "1", "1"] in card[2] for card in whole.all("BOUNDARY"))


def test_what_cannot_be_halved_is_written_whole_to_the_byte(short):
    for options in ({"probe": Probe(x_mm=0.25)}, {"support": "prescribed"}):
        analysis = half_of(short, **options)
        whole = replace(analysis, section="whole")
        assert calculix_deck(analysis) == calculix_deck(whole)


def test_decks_of_other_solvers_are_of_the_whole(short):
    analysis = half_of(short, element="CPE4H")
    whole = replace(analysis, section="whole")
    assert abaqus_deck(analysis) == abaqus_deck(whole)
    marc, same = (DIALECTS["marc"].write(one, DeckOptions()) for one in (analysis, whole))
    assert marc == same


@pytest.mark.solver
@pytest.mark.parametrize(("word", "held_um"), [("sine_100_54.98", 75.0), ("sine_100_85.98", 0.0)])
def test_half_of_a_section_has_the_stress_of_the_whole(word, held_um, tmp_path):
    """Twenty increments of a sine; within 0.02 % of the peak, forces as well."""
    [entry] = resolve([word])
    sine = make_stimulus(entry, preindent_um=held_um)
    wave = replace(sine, displacement_um=sine.displacement_um[:21], window_ms=(0.0, 10.0))
    traces, force_n = {}, {}
    for section in ("whole", "half"):
        model = replace(model_of(QUICK), section=section)
        folder = build_run_folder(tmp_path / section, model, wave).folder
        run_ccx(read_run_folder(folder), SolverSettings(threads=1))
        traces[section] = np.array([one.stress_pa for one in read(folder)])
        force_n[section] = read_total_force(folder / "job.dat", "PROBE")[1][:, 1]
        assert bool(read_run_folder(folder).on_axis) == (section == "half")
    peak_pa = traces["whole"].max(axis=1, keepdims=True)
    assert peak_pa.min() > 100
    assert_allclose(traces["half"] / peak_pa, traces["whole"] / peak_pa, rtol=0, atol=2e-4)
    peak_n = np.abs(force_n["whole"]).max()
    assert_allclose(force_n["half"] / peak_n, force_n["whole"] / peak_n, atol=5e-4)
