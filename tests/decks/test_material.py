"""Materials: elasticity, Prony terms, density."""

import pytest

from decks.finger import TABLE_1, Material, PronyTerm
from decks.presets import finger_from
from fembridge.errors import FingerError


@pytest.mark.parametrize(
    ("terms", "words"),
    [
        ([(0.6, 0.1), (0.4, 0.2)], "take all of"),
        ([(0.0, 0.1)], "g must be > 0"),
        ([(1.0, 0.1)], "take all of"),
        ([(0.5, 0.0)], "tau_s must be 0.0001 to 10, got 0"),
        ([(0.5, float("nan"))], "tau_s must be finite"),
        ([(0.1, 0.1)] * 6, "6 Prony terms, expected at most 5"),
    ],
)
def test_terms_that_cannot_be_are_refused(terms, words):
    with pytest.raises(FingerError, match=words):
        Material(1.0, 0.4, prony=tuple(PronyTerm(*term) for term in terms))


def test_a_finger_file_has_terms_and_a_density():
    dermis = {"prony": [{"g": 0.3, "tau_s": 0.02}], "density_kg_m3": 1200.0}
    finger = finger_from({"materials": {"dermis": dermis}}, "f")
    assert finger.materials["dermis"].prony == (PronyTerm(0.3, 0.02),)
    assert finger.materials["dermis"].density_kg_m3 == 1200.0
    assert finger.materials["dermis"].young_mpa == TABLE_1["dermis"].young_mpa
    assert finger.relaxing_s == 0.02
    assert finger.at_once().relaxing_s == 0.0


@pytest.mark.parametrize(
    ("prony", "words"),
    [
        ("0.3", "prony"),
        ([0.3], "prony 1: 0.3"),
        ([{"g": 0.3}], "prony 1.*tau_s"),
        ([{"g": 0.3, "tau": 1}], "prony 1.*tau_s"),
        ([{"g": 0.3, "tau_s": 1}, {"g": "x", "tau_s": 1}], "prony 2.g: 'x'"),
    ],
)
def test_terms_in_a_file_that_mean_nothing_are_refused(prony, words):
    with pytest.raises(FingerError, match=words):
        finger_from({"materials": {"dermis": {"prony": prony}}}, "f")
