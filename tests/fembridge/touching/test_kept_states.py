"""Touches of one shape share states: what a touch finds does not depend on the touches before."""

from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import fembridge as fb
from fembridge.touching import contact_history, kept_states, stress
from fembridge.touching.contact_history import solve_contact
from fembridge.touching.kept_states import drop_states, kept, kept_bytes, shape_key
from fembridge.touching.large_strain import SMALL_UM
from fembridge.touching.pad_file import resolve_pad
from fembridge.touching.press_levels import levels_up_to
from fembridge.touching.ridged_pad import with_ridges
from fembridge.touching.shape import Shape
from fembridge.touching.trajectory import Trajectory

PAD = resolve_pad("reference")
RIDGED = with_ridges(PAD, None)
FEW = fb.Population.grid(step_mm=2.5, half_width_mm=2.5, half_length_mm=2.5)


@pytest.fixture(autouse=True)
def nothing_kept():
    drop_states()
    yield
    drop_states()


def found(result):
    contact = result.contact
    arrays = result.stress_pa, result.force_n, result.depth_um, contact.forces_n, contact.knots
    return *arrays, result.fired.unit, result.fired.time_ms


@pytest.mark.parametrize(
    "levels",
    [{"press_um": [250.0, 270.0, 180.0, 255.0]}, {"press_n": [0.022, 0.0575, 0.023, 0.056]}],
)
def test_a_touch_in_a_loop_is_the_touch_alone(levels):
    [(argument, values)] = levels.items()
    press = partial(fb.touch, "sphere", population=FEW)
    loop = [found(press(**{argument: value})) for value in values]
    alone = []
    for value in values:
        drop_states()
        alone.append(found(press(**{argument: value})))
    for one, other in zip(loop, alone, strict=True):
        for array, expected in zip(one, other, strict=True):
            assert_array_equal(array, expected)


def test_touches_of_a_rung_solve_contact_and_stress_once(monkeypatch):
    solved, superposed = [], []

    def press_to(*arguments, **options):
        solved.append(arguments)
        return contact_press_to(*arguments, **options)

    def driving_stress_pa(*arguments, **options):
        superposed.append(arguments)
        return stress_driving_stress_pa(*arguments, **options)

    contact_press_to = contact_history.press_to
    stress_driving_stress_pa = stress.driving_stress_pa
    monkeypatch.setattr(contact_history, "press_to", press_to)
    monkeypatch.setattr(stress, "driving_stress_pa", driving_stress_pa)
    for depth_um in (265.0, 272.0, 299.0, 300.0):
        fb.touch(Shape.punch(1.0), press_um=depth_um, population=FEW)
    assert len(solved) == 1 and len(superposed) == 3  # classes
    fb.touch(Shape.punch(1.0), press_um=250.0, population=FEW, at_mm=(0.1, 0.0))
    fb.touch(Shape.punch(1.1), press_um=250.0, population=FEW)
    fb.touch(Shape.punch(1.0), press_um=210.0, population=FEW)
    assert len(solved) == 4


@pytest.mark.parametrize("shape", [Shape.sphere(5.0), Shape.braille("b"), Shape.edge()])
@pytest.mark.parametrize("press", [{"press_um": 231.0}, {"press_n": 0.045}])
def test_a_level_between_states_has_the_contact_solved_at_it(shape, press):
    trajectory = Trajectory.press(**press)
    contact = solve_contact(RIDGED, shape, trajectory, 0.4)
    highest = float(trajectory.level.max())
    assert contact.knots[-1] > 1.01 * highest
    by_force = "press_n" in press
    nodes, forces, depth_um = contact_history.press_to(
        RIDGED, shape, levels_up_to(highest), by_force=by_force
    )
    assert nodes.size
    total_n = np.interp(highest, contact.knots, contact.total_n)
    assert_allclose(total_n, forces[-1].sum(), rtol=2e-3)
    assert_allclose(np.interp(highest, contact.knots, contact.depth_um), depth_um[-1], rtol=2e-3)
    state = contact.reached - 1
    assert contact.knots[state - 1] < highest <= contact.knots[state]


def test_no_rung_has_touches_of_small_and_of_large_strain():
    sphere = Shape.sphere(5.0)
    at_limit = solve_contact(PAD, sphere, Trajectory.press(press_um=SMALL_UM), 0.4)
    assert at_limit.large_strain is None and at_limit.knots[-1] == SMALL_UM
    limit_n = float(at_limit.total_n[-1])
    for share, is_large in ((0.99, False), (1.01, True)):
        for press in ({"press_um": share * SMALL_UM}, {"press_n": share * limit_n}):
            contact = solve_contact(PAD, sphere, Trajectory.press(**press), 0.4)
            assert (contact.large_strain is not None) == is_large
    small = solve_contact(PAD, sphere, Trajectory.press(press_n=0.99 * limit_n), 0.4)
    assert small.knots[-1] == pytest.approx(limit_n, rel=1e-6)


def test_shapes_of_the_same_sizes_have_one_key_and_height_maps_their_own():
    assert shape_key(Shape.bar(1.0, 8.0)) == shape_key(Shape.bar(1.0, 8.0))
    assert shape_key(Shape.bar(1.0, 8.0)) != shape_key(Shape.bar(1.0, 8.5))
    assert shape_key(Shape.edge()) != shape_key(Shape.edge().rotated(90))
    first, second = (Shape.from_heights(np.full((9, 9), top), 0.2) for top in (0.1, 0.2))
    assert shape_key(first) == shape_key(first.moved(0, 0)) != shape_key(second)


def test_what_is_kept_has_a_limit_and_what_was_used_longest_ago_goes(monkeypatch):
    monkeypatch.setattr(kept_states, "MOST_BYTES", 100)
    made = []

    def value(key):
        return kept(key, lambda: made.append(key) or key, lambda _: 40)

    for key in "abacab":
        assert value(key) == key
    assert made == ["a", "b", "c", "b"] and kept_bytes() == 80
    assert kept(None, lambda: 1, lambda _: 1) == 1 and kept_bytes() == 80
