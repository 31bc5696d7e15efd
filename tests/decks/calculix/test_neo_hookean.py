"""The neo-Hookean law in decks, and that CalculiX means the same by it."""

import subprocess

import numpy as np
import pytest
from numpy.testing import assert_allclose

from decks.analysis import Model
from decks.calculix import calculix_deck
from decks.keyword_deck import element_lines, node_lines, real
from decks.material import TABLE_1
from decks.presets import QUICK, mesh_of
from fembridge.machine import find_ccx
from fembridge.results.printed import read_point_stress

SKIN = mesh_of(QUICK)
SOFT = ("stratum_corneum", "epidermis", "dermis", "subcutaneous_tissue")
PA_PER_MPA = 1e6


@pytest.fixture(scope="module")
def law_deck(parse_deck, short):
    """Give the deck of a law, as text and parsed."""

    def build(law):
        text = calculix_deck(Model(QUICK, SKIN, support="prescribed").analysis(short, law=law))
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


def test_bone_nail_and_probe_stay_linear(law_deck):
    _, deck = law_deck("neo-hookean")
    kinds = dict(
        zip(
            [card[1]["NAME"] for card in deck.all("MATERIAL")],
            [c[0] for c in deck.cards if c[0] in ("ELASTIC", "HYPERELASTIC")],
            strict=True,
        )
    )
    linear = {name for name, kind in kinds.items() if kind == "ELASTIC"}
    assert linear == {"BONE", "NAIL", "PROBE_BODY"}


def test_the_laws_differ_in_nothing_but_materials(law_deck):
    linear, _ = law_deck("linear")
    other, _ = law_deck("neo-hookean")
    start, end = "** ---- Materials", "** ---- Contact"
    for part in (0, 1):
        cuts = [(text.split(start)[0], text.split(end)[1]) for text in (linear, other)]
        assert cuts[0][part] == cuts[1][part]


def test_nodes_to_be_watched_follow_the_afferents_and_none_is_twice(short):
    plain = Model(QUICK, SKIN, support="prescribed").analysis(short).watched.tolist()
    apex = plain[-1]
    rows = np.array([apex - 1, 40, 7])
    more = Model(QUICK, SKIN, support="prescribed").analysis(short, watched=rows).watched.tolist()
    assert more == [*plain, 41, 8]


def cauchy_mpa(gradient, c10_mpa, d1_per_mpa):
    """Stress of ``U = C10 (I1bar − 3) + (J − 1)²/D1`` in plane strain, in closed form.

    ``sigma = 2 C10/J dev(bbar) + 2 (J − 1)/D1 I``, with ``bbar = J^(−2/3) F Fᵀ``.
    """
    stretch = np.eye(3)
    stretch[:2, :2] += gradient
    volume = np.linalg.det(stretch)
    isochoric = volume ** (-2 / 3) * stretch @ stretch.T
    deviator = isochoric - np.trace(isochoric) / 3 * np.eye(3)
    return 2 * c10_mpa / volume * deviator + 2 * (volume - 1) / d1_per_mpa * np.eye(3)


@pytest.mark.solver
@pytest.mark.parametrize(
    "gradient",
    [
        pytest.param([[0.0, 0.0], [0.0, -0.5]], id="squeezed to half"),
        pytest.param([[0.0, 0.6], [0.0, 0.0]], id="sheared"),
        pytest.param([[0.3, -0.2], [0.1, -0.35]], id="both, and turned"),
        pytest.param([[1e-5, 0.0], [2e-5, -3e-5]], id="a little: Hooke"),
    ],
)
def test_calculix_finds_the_stress_of_the_closed_form(law_deck, tmp_path, gradient):
    """One square whose four nodes move with the gradient; all its points are alike."""
    gradient = np.array(gradient)
    text, deck = law_deck("neo-hookean")
    begin = text.index("*MATERIAL, NAME=EPIDERMIS")
    material = text[begin : text.index("*SOLID SECTION, ELSET=EPIDERMIS")]
    corner_mm = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    moved_mm = corner_mm @ gradient.T
    lines = [
        "*NODE, NSET=ALL",
        *node_lines(range(1, len(corner_mm) + 1), corner_mm),
        "*ELEMENT, TYPE=CPE4, ELSET=EPIDERMIS",
        *element_lines([1], np.array([[1, 2, 3, 4]])),
        *material.splitlines(),
        "*SOLID SECTION, ELSET=EPIDERMIS, MATERIAL=EPIDERMIS",
        "1.0",
        "*STEP, NLGEOM",
        "*STATIC, DIRECT",
        "0.1, 1.0",
        "*BOUNDARY",
        *(
            f"{row + 1}, {axis + 1}, {axis + 1}, {real(moved_mm[row, axis])}"
            for row in range(4)
            for axis in (0, 1)
        ),
        "*EL PRINT, ELSET=EPIDERMIS",
        "S",
        "*END STEP",
    ]
    (tmp_path / "job.inp").write_text("\n".join(lines) + "\n")
    subprocess.run([find_ccx(), "-i", "job"], cwd=tmp_path, check=True, timeout=60)
    _, _, stress_pa = read_point_stress(tmp_path / "job.dat", "EPIDERMIS")
    expected_pa = PA_PER_MPA * cauchy_mpa(gradient, *constants(deck, "epidermis"))
    order = [(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0)]
    wanted_pa = np.array([expected_pa[place] for place in order])
    found_pa = stress_pa[-1].reshape(-1, 6)
    scale_pa = np.abs(wanted_pa).max()
    tolerance = 1e-4 if scale_pa < 1e3 else 1e-6
    assert_allclose(
        found_pa, np.tile(wanted_pa, (len(found_pa), 1)), rtol=0, atol=tolerance * scale_pa
    )
    hooke_pa = PA_PER_MPA * hooke_mpa(gradient, TABLE_1["epidermis"])
    alike = np.abs(hooke_pa - expected_pa).max() < 1e-3 * scale_pa
    assert alike == (np.abs(gradient).max() < 1e-4)


def hooke_mpa(gradient, material):
    """Stress ``(3, 3)`` of small strain."""
    strain = np.zeros((3, 3))
    strain[:2, :2] = 0.5 * (gradient + gradient.T)
    shear_mpa = material.young_mpa / (2 * (1 + material.poisson))
    lame_mpa = 2 * shear_mpa * material.poisson / (1 - 2 * material.poisson)
    return lame_mpa * np.trace(strain) * np.eye(3) + 2 * shear_mpa * strain
