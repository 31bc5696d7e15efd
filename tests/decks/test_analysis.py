"""What an analysis holds: who is held, who may touch, who is watched, and when."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from decks.analysis import ELEMENTS, Contact, analyse
from decks.finger import SITES, AfferentSite, Finger
from decks.motion import RAMP_INCREMENTS, motion_of
from decks.presets import PRESETS, QUICK, mesh_of
from decks.probe import Probe
from decks.stimuli.catalogue import resolve
from decks.stimuli.waveform import make_stimulus
from fembridge.errors import DeckError, FingerError
from fembridge.stimulus import Stimulus

MESHES = {name: mesh_of(finger) for name, finger in PRESETS.items()}
(SINE,) = (make_stimulus(entry) for entry in resolve("sine_20_250"))


@pytest.fixture(params=PRESETS)
def analysis(request):
    return analyse(PRESETS[request.param], MESHES[request.param], SINE)


def ramp_to(preindent_um, first_um=None, samples=5):
    first_um = preindent_um if first_um is None else first_um
    depth_um = np.full(samples, preindent_um, dtype=float)
    depth_um[0] = first_um
    return Stimulus("hold", depth_um, 0.5, (0.0, 1.0), preindent_um)


# ---- Motion


def test_without_a_pre_indentation_the_probe_moves_as_the_stimulus_says():
    motion = motion_of(SINE)
    assert_array_equal(motion.depth_mm, SINE.displacement_um * 1e-3)
    assert_array_equal(motion.time_s, np.arange(501) * 0.0005)
    assert (motion.dt_s, motion.ramp, motion.increments) == (0.0005, 0, 500)


def test_a_pre_indentation_is_reached_in_20_equal_steps_before_the_stimulus():
    (entry,) = resolve("sine_20_250")
    stimulus = make_stimulus(entry, preindent_um=500.0)
    motion = motion_of(stimulus)
    assert motion.ramp == RAMP_INCREMENTS == 20
    assert_allclose(motion.depth_mm[:21], np.arange(21) * 0.025, rtol=1e-12)
    assert_array_equal(motion.depth_mm[20:], stimulus.displacement_um * 1e-3)
    assert motion.increments == 520
    assert_allclose(motion.time_s[20], 0.010)


@pytest.mark.parametrize("first_um", [0.0, 499.0, 500.1, -500.0])
def test_a_stimulus_that_would_make_the_probe_jump_is_refused(first_um):
    words = f"hold: starts at {first_um:g} um, expected 500 um, where the probe stands"
    with pytest.raises(DeckError, match=words):
        motion_of(ramp_to(500.0, first_um))


def test_a_stimulus_that_starts_in_the_skin_needs_a_pre_indentation():
    with pytest.raises(DeckError, match="starts at 3 um, expected 0 um"):
        motion_of(ramp_to(0.0, 3.0))


# ---- Contact


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"formulation": "mortar"}, "'mortar', expected one of node-to-surface, surf"),
        ({"stiffness_mpa_per_mm": 0.0}, "stiffness_mpa_per_mm must be > 0, got 0"),
        ({"stiffness_mpa_per_mm": np.nan}, "stiffness_mpa_per_mm must be finite"),
        ({"stiffness_mpa_per_mm": True}, "stiffness_mpa_per_mm must be a number"),
        ({"friction": -0.1}, "friction must be >= 0, got -0.1"),
        ({"friction": "0.4"}, "friction must be a number"),
        ({"stick_share": 0}, "stick_share must be > 0"),
        ({"stick_share": np.inf}, "stick_share must be finite"),
    ],
)
def test_a_contact_that_no_solver_takes_is_a_deck_error(wrong, words):
    with pytest.raises(DeckError, match=words):
        Contact(**wrong)


def test_a_contact_tells_itself_in_a_line():
    assert str(Contact()) == "node-to-surface, 200 MPa/mm, friction 0.4"
    smooth = Contact("surface-to-surface", 3000.0, friction=0.0)
    assert str(smooth) == "surface-to-surface, 3000 MPa/mm, no friction"


# ---- The whole


def test_afferents_and_apex_are_nodes_of_the_skin(analysis):
    at = {name: analysis.mesh.node_mm[row] for name, row in analysis.afferent.items()}
    assert set(at) == set(SITES)
    for name, site in SITES.items():
        assert at[name].tolist() == [site.x_mm, -site.depth_mm]
    assert analysis.mesh.node_mm[analysis.apex].tolist() == [0.0, 0.0]


def test_all_of_the_bone_and_the_outer_side_of_the_nail_are_held(analysis):
    mesh = analysis.mesh
    bone = set(np.unique(mesh.quad[mesh.in_layer("bone")]).tolist())
    nail = set(np.unique(mesh.quad[mesh.in_layer("nail")]).tolist())
    outside = set(np.unique(mesh.outline()[0]).tolist())
    held = set(analysis.held.tolist())
    assert held == bone | (nail & outside)
    skin = set(np.unique(mesh.quad[mesh.in_layer("epidermis")]).tolist())
    assert not held & skin


def test_the_skin_that_may_touch_is_one_stretch_on_both_sides_of_the_probe(analysis):
    mesh = analysis.mesh
    element, face = analysis.contact_edge.T
    ends = np.stack([mesh.quad[element, face], mesh.quad[element, (face + 1) % 4]], axis=-1)
    assert (mesh.layer[element] == 0).all()
    counts = np.bincount(ends.ravel())
    assert sorted(counts[counts > 0])[:3] == [1, 1, 2]  # two ends, else joined
    x_mm = mesh.node_mm[ends, 0]
    assert_allclose([x_mm.min(), x_mm.max()], [-2.0, 2.0], atol=0.15)
    assert mesh.node_mm[ends, 1].min() > -0.5


def test_the_contact_moves_with_the_probe_and_grows_with_it():
    narrow = analyse(QUICK, MESHES["quick"], SINE)
    wide = analyse(QUICK, MESHES["quick"], SINE, probe=Probe(diameter_mm=4.0))
    aside = analyse(QUICK, MESHES["quick"], SINE, probe=Probe(x_mm=2.0))
    assert len(wide.contact_edge) > len(narrow.contact_edge)

    def middle_mm(analysis):
        quads = analysis.mesh.quad[analysis.contact_edge[:, 0]]
        return analysis.mesh.node_mm[quads, 0].mean()

    assert_allclose(middle_mm(narrow), 0.0, atol=1e-12)
    assert 1.0 < middle_mm(aside) < 2.5


def test_all_of_the_skin_that_the_probe_can_reach_may_touch(analysis):
    """At the depth of the deepest stimulus plus pre-indentation the probe is
    1 mm wide: 0.5 mm to both sides, and the margin is three times that."""
    mesh = analysis.mesh
    edge, owner, face = mesh.outline()
    middle = mesh.node_mm[edge].mean(axis=1)
    under = (np.abs(middle[:, 0]) < 0.5) & (middle[:, 1] > -1)
    allowed = set(map(tuple, analysis.contact_edge.tolist()))
    reached = zip(owner[under].tolist(), face[under].tolist(), strict=True)
    assert set(reached) <= allowed


def test_title_and_notes_say_what_was_put_together(analysis):
    name = analysis.finger.name
    assert analysis.title == f"sine_20_250 on finger {name}"
    counts = f"{len(analysis.mesh.quad)} elements, {len(analysis.mesh.node_mm)} corner"
    assert counts in analysis.notes[0]
    assert analysis.notes[1:] == ("probe: cylinder, 1 mm",)


@pytest.mark.parametrize("element", ["CPE3", "C3D8", "cpe4", "", "CPE4\n*STEP"])
def test_an_unknown_element_is_refused(element):
    with pytest.raises(DeckError, match=f"expected one of {', '.join(ELEMENTS)}"):
        analyse(QUICK, MESHES["quick"], SINE, element=element)


def test_a_probe_beside_the_pad_is_refused():
    with pytest.raises(FingerError, match="expected inside the pad"):
        analyse(QUICK, MESHES["quick"], SINE, probe=Probe(x_mm=9.0))


def test_an_afferent_without_a_node_near_it_is_refused():
    far = Finger("far", afferents={"SA": AfferentSite("bone", 0.0, 2.0)})
    with pytest.raises(FingerError, match=r"bone nearest .* expected within 0\.3 mm"):
        analyse(far, MESHES["quick"], SINE)
