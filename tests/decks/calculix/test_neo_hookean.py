"""The neo-Hookean law in decks, and that CalculiX means the same by it."""

import pytest
from numpy.testing import assert_allclose

from decks.analysis import Model
from decks.calculix import calculix_deck
from decks.material import TABLE_1
from decks.presets import QUICK, mesh_of

SKIN = mesh_of(QUICK)
SOFT = ("stratum_corneum", "epidermis", "dermis", "subcutaneous_tissue")


@pytest.fixture(scope="module")
def law_deck(parse_deck, short):
    """Give the deck of a law, as text and parsed."""

    def build(law):
        text = calculix_deck(Model(QUICK, SKIN, support="prescribed", law=law).analysis(short))
        return text, parse_deck(text)

    return build


def constants(deck, layer):
    """C10 and D1 of a layer."""
    names = [card[1]["NAME"] for card in deck.all("MATERIAL")]
    soft = [name for name in names if name.lower() in SOFT]
    (row,) = deck.all("HYPERELASTIC")[soft.index(layer.upper())][2]
    return tuple(map(float, row))


@pytest.mark.parametrize("layer", SOFT)
def test_the_constants_are_half_the_shear_modulus_and_two_over_the_bulk_modulus(law_deck, layer):
    """Young's modulus and Poisson's ratio follow from G and K by E = 9KG/(3K + G)."""
    _, deck = law_deck("neo-hookean")
    c10_mpa, d1_per_mpa = constants(deck, layer)
    shear_mpa, bulk_mpa = 2 * c10_mpa, 2 / d1_per_mpa
    young_mpa = 9 * bulk_mpa * shear_mpa / (3 * bulk_mpa + shear_mpa)
    poisson = (3 * bulk_mpa - 2 * shear_mpa) / (2 * (3 * bulk_mpa + shear_mpa))
    assert_allclose(young_mpa, TABLE_1[layer].young_mpa, rtol=1e-12)
    assert_allclose(poisson, TABLE_1[layer].poisson, rtol=1e-9)
