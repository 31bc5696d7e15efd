"""A touch on skin that relaxes: closed forms, plain loops, and what must be equal by two ways."""

import math
from dataclasses import replace

import numpy as np
import pandas
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import fembridge as fb
from decks.finger import LAYERS, PronyTerm
from decks.presets import finger_from
from fembridge.errors import FembridgeWarning, UsageError
from fembridge.touching.compliance import DenseCompliance
from fembridge.touching.contact import ContactSolver
from fembridge.touching.pad_file import resolve_pad
from fembridge.touching.population import Population
from fembridge.touching.relaxation import (
    Relaxation,
    RelaxingContact,
    _element_matrices,
    relaxation_of,
    relaxing_pad,
    shared_relaxation,
)
from fembridge.touching.shape import Shape
from fembridge.touching.touch import touch_skin
from fembridge.touching.trajectory import Trajectory
from neural import parameter_set
from tests.fembridge.touching.test_contact import love_compliance, plain_lcp

DT_MS = 0.5
RELAXATION = Relaxation(np.array([0.4, 0.25]), np.array([20.0, 3.0]))
TERMS = (PronyTerm(0.4, 0.02), PronyTerm(0.2, 0.2))
PAD = resolve_pad("reference")
ONE = Population.one_each()
FITTED = parameter_set("fitted_pad")


def finger(*layers, terms=TERMS):
    entries = [{"g": term.g, "tau_s": term.tau_s} for term in terms]
    return finger_from({"materials": {layer: {"prony": entries} for layer in layers}}, "relaxing")


FINGER = finger("dermis", "subcutaneous_tissue")
RELAXING = relaxing_pad(PAD, FINGER)
SHARED = relaxation_of(RELAXING)


def memory_matrix(relaxation, count):
    """``f = M P`` of samples: a plain sum over all of the past, P even between two samples."""
    matrix = np.zeros((count, count))
    for now in range(count):
        for change in range(now + 1):  # P goes from its value at change - 1 to that at change
            if change == 0:
                mean = relaxation.at(np.array(now * DT_MS))  # a jump at the first sample
            else:
                ages = (now - change + (np.arange(2000) + 0.5) / 2000) * DT_MS
                mean = relaxation.at(ages).mean()
            matrix[now, change] += mean
            if change:
                matrix[now, change - 1] -= mean
    return matrix


def contact_on(matrix, *, rested=False):
    return RelaxingContact(ContactSolver(DenseCompliance(matrix)), RELAXATION, DT_MS, rested=rested)


def test_the_function_falls_from_one_to_its_lasting_share():
    at = RELAXATION.at(np.array([0.0, 20.0, 1e6]))
    expected = 1 - 0.4 * (1 - math.exp(-1)) - 0.25 * (1 - math.exp(-20 / 3))
    assert_allclose(at, [1.0, expected, 0.35], rtol=1e-12)
    assert RELAXATION.lasting_share == pytest.approx(0.35)


def test_the_force_of_a_spring_held_at_a_depth_follows_the_function():
    contact = contact_on(np.array([[2.0]]))
    force = [contact.press_by(np.zeros(1), 100.0, by_force=False)[0][0] for _ in range(200)]
    assert_allclose(force, 0.1 / 2.0 * RELAXATION.at(DT_MS * np.arange(200)), rtol=1e-6)


def test_a_spring_under_a_held_force_creeps_as_the_volterra_equation_says():
    """``integral of g(t - s) dP(s) = F``, by a plain loop; and its end in closed form."""
    count = 120
    contact = contact_on(np.array([[2.0]]))
    depth_mm = np.array(
        [contact.press_by(np.zeros(1), 0.3, by_force=True)[1] for _ in range(count)]
    )
    memory, at_once = memory_matrix(RELAXATION, count), np.zeros(count)
    for now in range(count):
        at_once[now] = (0.3 - memory[now, :now] @ at_once[:now]) / memory[now, now]
    assert_allclose(depth_mm, 2.0 * at_once, rtol=1e-5)
    assert (np.diff(depth_mm) > 0).all()
    for _ in range(2000):
        _, end_mm = contact.press_by(np.zeros(1), 0.3, by_force=True)
    assert_allclose(end_mm, 2.0 * 0.3 / 0.35, rtol=1e-5)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10_000), nodes=st.integers(1, 8))
def test_a_random_touch_is_what_a_plain_loop_over_the_past_converges_to(seed, nodes):
    """Nodes enter and leave; the forces are never negative, the skin never inside the shape."""
    rng, count = np.random.default_rng(seed), 14
    place = rng.uniform(0, 3, (nodes, 2))
    away = np.linalg.norm(place[:, None] - place, axis=2)
    matrix = np.exp(-away) + 0.3 * np.eye(nodes)
    gaps_mm, level_um = rng.uniform(0, 0.4, (count, nodes)), 400 * rng.uniform(-0.3, 1, count)
    level_um[0] = 0.0
    contact, memory = contact_on(matrix), memory_matrix(RELAXATION, count)
    at_once, moved_mm = np.zeros((count, nodes)), np.zeros((count, nodes))
    for now in range(count):
        force, _ = contact.press_by(gaps_mm[now], level_um[now], by_force=False)
        past = memory[now, :now] @ at_once[:now]
        overlap = 1e-3 * level_um[now] - gaps_mm[now]
        share = memory[now, now]
        expected = plain_lcp(matrix / share, overlap + matrix @ past / share)
        assert_allclose(force, expected, atol=2e-5)
        at_once[now] = (expected - past) / share
        moved_mm[now] = matrix @ at_once[now]
        assert (moved_mm[now] >= overlap - 1e-4).all()


def test_a_sphere_on_a_relaxing_half_space_is_that_of_lee_and_radok():
    """While contact grows: ``F = 4/3 E sqrt(R) integral of g(t - s) d(depth^1.5)``."""
    modulus, radius, deepest, pitch = 2.0, 4.0, 0.05, 0.05
    at = np.arange(-11, 12) * pitch
    x, y = (each.ravel() for each in np.meshgrid(at, at))
    matrix = love_compliance(x[:, None] - x, y[:, None] - y, 0.5 * pitch, modulus)
    gap_mm = radius - np.sqrt(radius**2 - x**2 - y**2)
    depth_mm = deepest * np.minimum(np.arange(60) / 30, 1.0)
    contact = contact_on(matrix)
    force_n = [contact.press_by(gap_mm, 1e3 * depth, by_force=False)[0].sum() for depth in depth_mm]
    hertz_n = 4 / 3 * modulus * radius**0.5 * depth_mm**1.5
    expected = memory_matrix(RELAXATION, 60) @ hertz_n
    assert_allclose(force_n[10:], expected[10:], rtol=0.03)
    assert_allclose(np.array(force_n[30:]) / force_n[30], expected[30:] / expected[30], rtol=2e-3)


def test_skin_that_was_left_keeps_a_dent_that_recovers():
    matrix = np.array([[1.0, 0.3], [0.3, 1.0]])
    contact = contact_on(matrix)
    for _ in range(100):
        contact.press_by(np.array([0.0, 0.05]), 100.0, by_force=False)
    forces = [contact.press_by(np.zeros(2), level, by_force=False)[0] for level in (0.0, 20.0)]
    assert not any(force.any() for force in forces)  # 20 um do not reach the bottom of the dent
    for _ in range(400):
        contact.press_by(np.zeros(2), 0.0, by_force=False)
    after, _ = contact.press_by(np.zeros(2), 20.0, by_force=False)
    assert after.all()


# ---- The function of a finger


def test_an_element_stores_the_energy_of_hookes_law():
    corner_mm = np.array([[[0.0, 0.0], [2.0, 0.3], [1.8, 1.5], [0.1, 1.1]]])
    gradient = np.array([[2e-3, -1e-3], [4e-3, 1.5e-3]])
    shape, volume = _element_matrices(corner_mm)
    moved = (corner_mm[0] @ gradient.T).ravel()
    strain = np.zeros((3, 3))
    strain[:2, :2] = 0.5 * (gradient + gradient.T)
    deviator = strain - np.trace(strain) / 3 * np.eye(3)
    x, y = corner_mm[0].T
    area_mm2 = 0.5 * abs(x @ np.roll(y, -1) - y @ np.roll(x, -1))
    assert_allclose(moved @ shape[0] @ moved, 2 * area_mm2 * (deviator**2).sum(), rtol=1e-12)
    assert_allclose(moved @ volume[0] @ moved, area_mm2 * np.trace(strain) ** 2, rtol=1e-12)


@pytest.mark.slow
def test_more_relaxing_layers_relax_more_and_all_of_them_as_their_shear_modulus_at_most():
    soft = LAYERS[:4]
    lasting = [
        shared_relaxation(finger(*layers)).lasting_share
        for layers in (("dermis",), ("dermis", "subcutaneous_tissue"), soft)
    ]
    assert 1 > lasting[0] > lasting[1] > lasting[2] > 1 - 0.6
    shared = shared_relaxation(finger(*soft))
    # What volume adds does not relax; shares of the two terms are in the ratio of the layers'.
    assert_allclose(shared.g[0] / shared.g[1], 2.0, rtol=0.2)
    assert_allclose(shared.tau_ms, [20.0, 200.0])


def test_a_finger_with_other_moduli_than_the_pads_is_refused():
    stiffer = replace(
        FINGER,
        materials={**FINGER.materials, "dermis": replace(FINGER.materials["dermis"], young_mpa=1)},
    )
    with pytest.raises(UsageError) as refused:
        fb.touch(press_um=100, finger=stiffer)
    assert (refused.value.argument, refused.value.found) == ("finger", "relaxing")
    thicker = replace(FINGER, skin=replace(FINGER.skin, dermis_mm=1.2))
    with pytest.raises(UsageError):
        relaxing_pad(PAD, thicker)


# ---- Touches


def touched(trajectory, pad=RELAXING, shape=Shape.punch(1.0)):  # noqa: B008 - frozen
    return touch_skin(pad, shape, trajectory, ONE, FITTED)


def test_a_force_relaxes_at_a_held_depth_as_the_function_of_the_finger():
    jump = Trajectory(depth_um=np.full(400, 150.0))
    force = touched(jump).force_n
    assert_allclose(force / force[0], SHARED.at(jump.times_ms), rtol=1e-4)
    assert_allclose(force[0], touched(jump, PAD).force_n[0], rtol=1e-3)


def test_stress_relaxes_as_the_function_of_its_layer():
    """At a held depth; under an unrelaxed epidermis less than the force, in the tissue more."""
    jump = Trajectory(depth_um=np.full(200, 150.0))
    ratio = (stress := touched(jump).stress_pa) / stress[0]
    for unit, layer in enumerate(ONE.layer):
        of_layer = Relaxation(SHARED.layers[layer], SHARED.tau_ms)
        assert_allclose(ratio[:, unit], of_layer.at(jump.times_ms), rtol=1e-4)
    sa, _, pc = (ONE.afferent.index(name) for name in ("SA", "RA", "PC"))
    assert ratio[-1, sa] > SHARED.at(jump.times_ms[-1:])[0] > ratio[-1, pc]


def test_layer_forces_are_a_plain_sum_over_the_past():
    rng, count = np.random.default_rng(1), 30
    relaxation = replace(RELAXATION, layers={"dermis": np.array([0.3, -0.1])})
    at_once = rng.normal(1.0, 1.0, (count, 3))
    forces = memory_matrix(RELAXATION, count) @ at_once
    expected = memory_matrix(Relaxation(relaxation.layers["dermis"], RELAXATION.tau_ms), count)
    found = relaxation.layer_forces_n(forces, DT_MS, rested=False)["dermis"]
    assert_allclose(found, expected @ at_once, rtol=1e-4, atol=1e-5)


def test_depth_grows_under_a_held_force():
    jump = Trajectory(force_n=np.full(4000, 0.03))  # within small strain, as relaxing skin is
    result = touched(jump)
    assert_allclose(result.force_n, 0.03, rtol=1e-5)
    assert (np.diff(result.depth_um) > 0).all()
    lasting = touched(Trajectory(force_n=np.full(2, 0.03 / SHARED.lasting_share)), PAD)
    assert_allclose(result.depth_um[-1], lasting.depth_um[-1], rtol=2e-3)


def test_a_shape_without_force_rests_on_the_dent_until_the_skin_has_recovered():
    force_n = np.concatenate([np.full(100, 0.05), np.linspace(0.05, 0.0, 100), np.zeros(4000)])
    depth_um = touched(Trajectory(force_n=force_n)).depth_um
    assert depth_um[200] > 10
    assert np.abs(np.diff(depth_um[150:])).max() < 0.05 * depth_um.max()
    assert depth_um[-1] < 0.01 * depth_um[200]
    at_rest = touched(Trajectory(force_n=np.array([0.0, 0.0, 0.05])))
    assert (at_rest.depth_um[:2] == 0).all()


def test_skin_has_rested_at_a_pre_indentation():
    """A waveform that stays at its pre-indentation has the lasting force all along."""
    still = Trajectory.from_waveform(
        fb.Stimulus("still", np.full(60, 150.0), 0.5, (0.0, 29.5)), preindent_um=150.0
    )
    elastic = touched(still, PAD).force_n[-1]
    assert_allclose(touched(still).force_n, SHARED.lasting_share * elastic, rtol=1e-3)


@pytest.mark.parametrize("start_um", [0.0, 150.0])
def test_pins_relax_as_a_shape_that_begins_at_their_depth(start_um):
    """Pins that begin deeper than 0 have stood there before; others press skin at rest."""
    depth_um = np.full(100, 150.0)
    depth_um[0] = start_um
    table = pandas.DataFrame({"x_mm": [0.0], "z_mm": [0.0], "diameter_mm": [1.0]})
    pins = Trajectory.from_pins(table, depth_um[:, None], dt_ms=0.5)
    by_pin = touch_skin(RELAXING, None, pins, ONE, FITTED).force_n
    waveform = fb.Stimulus("pin", depth_um, 0.5, (0.0, 49.5))
    by_shape = touched(Trajectory.from_waveform(waveform, preindent_um=0.0)).force_n
    assert_allclose(by_pin, by_shape, rtol=1e-4)


def test_a_shape_that_slides_meets_skin_that_has_not_relaxed():
    """At a kept depth the force falls less than under a shape that stays."""
    slide = Trajectory.slide(60.0, press_um=150.0, duration_ms=60.0, direction_deg=0.0)
    shape = Shape.sphere(4.0).moved(-1.8, 0.0)
    stays = Trajectory(depth_um=np.full(slide.level.size, 150.0))
    ratios = []
    for trajectory, body in ((slide, shape), (stays, Shape.sphere(4.0))):
        relaxed, elastic = (touched(trajectory, pad, body).force_n[60] for pad in (RELAXING, PAD))
        ratios.append(relaxed / elastic)
    moving, staying = ratios
    assert SHARED.lasting_share < staying < moving < 1


def test_the_record_has_the_function_and_an_elastic_pad_has_none(tmp_path):
    with pytest.warns(FembridgeWarning, match="fitted"):
        result = fb.touch(press_um=100, finger=FINGER, population="one_each")
    assert result.origin["relaxation"].items() >= SHARED.to_table().items()
    result.write(tmp_path)
    again = fb.Touch.read(tmp_path)
    assert_allclose(again.force_n, result.force_n, rtol=1e-6)
    assert_allclose(again.stress_pa, result.stress_pa, rtol=1e-5)
    assert again.contact.nodes.pad.finger == result.contact.nodes.pad.finger
    elastic = fb.touch(press_um=100, population="one_each")
    assert "relaxation" not in elastic.origin
    assert relaxation_of(PAD) is None


def test_a_pad_file_keeps_the_terms_of_its_finger(tmp_path):
    RELAXING.write(tmp_path / "relaxing.npz")
    assert fb.Pad.read(tmp_path / "relaxing.npz").finger.materials["dermis"].prony == TERMS
