"""The prism and its four decks."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from decks.finger import LAYERS
from decks.presets import QUICK
from decks.unit_loads import CASES, PadMesh, green_deck, prism_of, smooth
from fembridge.errors import FingerError

COARSE = PadMesh(spacing_mm=0.5, reach_mm=2.0, length_mm=6.0)
PRISM = prism_of(smooth(QUICK), COARSE)


def test_rows_are_the_layers_of_the_finger():
    section = PRISM.point_mm[:, 0, 1]  # on the axis
    for layer, top, bottom in (
        ("stratum_corneum", 0.0, 0.25),
        ("epidermis", 0.25, 0.65),
        ("dermis", 0.65, 1.75),
        ("subcutaneous_tissue", 1.75, 6.3),
    ):
        rows = np.flatnonzero(PRISM.row_layer == LAYERS.index(layer))
        assert_allclose(section[[rows[0], rows[-1] + 1]], [-top, -bottom], atol=1e-6)


def test_slices_grow_from_the_force_to_the_end():
    steps = np.diff(PRISM.z_mm)
    assert_allclose(steps[:2], 0.5)
    assert (np.diff(steps) >= -1e-9).all()
    assert_allclose(PRISM.z_mm[-1], 6.0)


def test_bricks_fill_the_quarter_once(parse_deck):
    deck = parse_deck(green_deck(PRISM, CASES[0]))
    nodes, elements, volume = deck.nodes(), deck.elements(), 0.0
    for corners in elements.values():
        at = np.array([nodes[n] for n in corners])
        across, up = at[2, :2] - at[0, :2], at[3, :2] - at[1, :2]
        area = 0.5 * (across[0] * up[1] - across[1] * up[0])
        assert area > 0
        volume += area * (at[4, 2] - at[0, 2])
    assert set(elements) == set(range(1, PRISM.elements + 1))
    section = np.pi * (8.0 * 6.5 - 3.2 * 2.2) / 2
    assert_allclose(volume, section * 6.0, rtol=0.02)


def test_each_case_has_the_forces_that_can_move_it(parse_deck):
    columns = PRISM.contact_columns
    counts = {case.name: len(case.loads(PRISM)) for case in CASES}
    assert counts == {
        "x_even": 2 * columns - 1,
        "x_odd": 2 * columns - 1,
        "z_x_even": columns,
        "z_x_odd": columns - 1,
    }
    for case in CASES:
        deck = parse_deck(green_deck(PRISM, case))
        [(_, _, rows)] = deck.all("CLOAD")
        assert len(rows) == counts[case.name]
        assert deck.all("GREEN")


@pytest.mark.parametrize(
    ("finger", "mesh", "named"),
    [(QUICK, COARSE, "0.125"), (smooth(QUICK), replace(COARSE, reach_mm=11.0), "10.3")],
)
def test_what_no_grid_can_hold_is_refused(finger, mesh, named):
    with pytest.raises(FingerError, match=named):
        prism_of(finger, mesh)


def test_ridges_are_in_the_grid_where_it_is_fine_enough():
    ridged = prism_of(QUICK, replace(COARSE, spacing_mm=0.125))
    top = ridged.point_mm[0, :5, 1]
    assert_allclose(
        top[[0, 4]],
        [0.0, prism_of(smooth(QUICK), replace(COARSE, spacing_mm=0.125)).point_mm[0, 4, 1]],
        atol=1e-6,
    )
    assert top[2] < -0.09
