"""What studies give to the solver: meshes, decks, and what is read of a log."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from decks.material import Material
from decks.presets import PAPER
from fembridge.errors import DeckError
from fembridge.verification.bench import Bench
from fembridge.verification.hertz_block import pressed
from fembridge.verification.indent import down, read_touching
from fembridge.verification.mesh_family import member
from fembridge.verification.plane_deck import PlaneProblem, neo_hookean


def test_a_member_of_the_family_is_as_much_coarser_as_its_factor_says():
    assert member(1.0) == PAPER
    twice, paper = member(2.0).resolution, PAPER.resolution
    for name in ("contact_mm", "ridge_mm", "far_mm"):
        assert_allclose(getattr(twice, name), 2 * getattr(paper, name))
    for name in ("stratum_corneum_rows", "epidermis_rows", "dermis_rows"):
        assert 2 * getattr(twice, name) == getattr(paper, name)
    assert member(2.0).afferents == PAPER.afferents


@pytest.mark.parametrize("depth_um", [50.0, 200.0])
def test_the_way_down_is_even_and_ends_at_its_depth(depth_um):
    stimulus = down(depth_um, 5)
    assert stimulus.displacement_um.tolist() == [depth_um * k / 5 for k in range(6)]


def test_the_last_number_of_springs_in_a_log_counts(tmp_path):
    log = tmp_path / "solver.log"
    log.write_text(
        " Number of contact spring elements=1\n\n iteration 2\n\n"
        " Number of contact spring elements=3\n done\n"
    )
    assert read_touching(log) == 3
    log.write_text("a log without contact\n")
    assert read_touching(log) == 0


def problem(**changes):
    return PlaneProblem(
        **{
            "kind": "CPE4",
            "node_mm": np.array([[0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1.0]]),
            "element": np.array([[0, 1, 4, 3], [1, 2, 5, 4]]),
            "materials": (Material(1.0, 0.3), Material(2.0, 0.25)),
            "element_material": np.array([0, 1]),
            "moved": np.array([0, 5]),
            "moved_mm": np.array([[0.0, np.nan], [0.25, -0.5]]),
            **changes,
        }
    )


def cards(text, keyword):
    """Data lines, split, of each card of this name."""
    found = []
    for line in text.splitlines():
        if line.startswith("*"):
            found.append((line[1:].split(",")[0], []))
        else:
            found[-1][1].append([word.strip() for word in line.split(",")])
    return [rows for name, rows in found if name == keyword]


def test_a_deck_prescribes_what_is_given_and_leaves_the_rest_free():
    text = problem().deck()
    [boundary] = cards(text, "BOUNDARY")
    assert [list(map(float, row)) for row in boundary] == [
        [1, 1, 1, 0.0],
        [6, 1, 1, 0.25],
        [6, 2, 2, -0.5],
    ]
    assert cards(text, "ELASTIC") == [[["1.0", "0.3"]], [["2.0", "0.25"]]]
    elements = [row for card in cards(text, "ELEMENT") for row in card]
    assert [list(map(int, row)) for row in elements] == [[1, 1, 2, 5, 4], [2, 2, 3, 6, 5]]


def test_a_neo_hookean_deck_has_half_the_shear_and_two_over_the_bulk_modulus():
    text = problem(law="neo-hookean", large_strain=True).deck()
    first, second = cards(text, "HYPERELASTIC")
    assert_allclose([*map(float, second[0])], [0.5 * 0.8, 2 / (4 / 3)])
    assert_allclose([*map(float, first[0])], neo_hookean(Material(1.0, 0.3)))
    assert ", NLGEOM" in text
    assert "NLGEOM" not in problem().deck()


def test_words_that_a_deck_has_not_once_are_not_put_by_others(tmp_path):
    analysis, stimulus = pressed(0)
    words = ("*NO SUCH CARD", "*NODE PRINT")
    with pytest.raises(DeckError, match=r"'\*NO SUCH CARD' stands 0 times"):
        Bench(tmp_path).solve_changed("hertz", analysis, stimulus, words)
