"""Laws, anisotropy and published Prony sets: values, finger files, and the text of each dialect."""

import math
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import decks
import fembridge as fb
from decks.calculix import calculix_deck
from decks.contact_analysis import Model
from decks.dialects import DIALECTS, DeckOptions
from decks.finger import LAYERS, TABLE_1, Anisotropy, Material, OgdenTerm, Outline, PronyTerm
from decks.keyword_deck import abaqus_deck
from decks.presets import QUICK, finger_from, finger_table, mesh_of
from decks.prony import name_of_prony, prony_set, prony_sets
from decks.section import section_of, skin_tangent
from decks.unit_loads import PadMesh, prism_of, prism_text, smooth
from fembridge.errors import DeckError, FingerError

OGDEN = (OgdenTerm(0.75, 3.0), OgdenTerm(0.25, -6.0))
STRATUM = Anisotropy(0.6, 0.25, 0.15)


def finger_with(**layers):
    """`quick` with changes of some materials."""
    changed = {name: replace(TABLE_1[name], **values) for name, values in layers.items()}
    return replace(QUICK, materials={**TABLE_1, **changed})


def analysis_of(finger, short, element="CPE4"):
    return Model(finger, mesh_of(finger), element=element, support="prescribed").analysis(short)


# ---- Values


@pytest.mark.parametrize(
    ("values", "argument", "found"),
    [
        ({"law": "yeoh"}, "law", "yeoh"),
        ({"c01_share": 0.5}, "c01_share", None),
        ({"law": "neo-hookean", "c01_share": 0.5}, "c01_share", "neo-hookean"),
        ({"law": "mooney-rivlin", "c01_share": 1.5}, "c01_share", 1.5),
        ({"law": "ogden"}, "ogden", 0),
        ({"law": "linear", "ogden": OGDEN}, "ogden", "linear"),
        ({"law": "ogden", "ogden": OGDEN[:1]}, "ogden", 0.75),
        ({"law": "ogden", "ogden": (OgdenTerm(0.25, 2.0),) * 4}, "ogden", 4),
        ({"law": "ogden", "ogden": (2.0,)}, "ogden", 2.0),
        ({"law": "ogden", "ogden": OGDEN, "anisotropy": STRATUM}, "law", "ogden"),
    ],
)
def test_laws_that_cannot_be_are_refused(values, argument, found):
    with pytest.raises(FingerError) as caught:
        Material(1.0, 0.3, **values)
    assert (caught.value.argument, caught.value.found) == (argument, found)


@pytest.mark.parametrize(
    ("share", "alpha", "argument"), [(0.0, 2.0, "share"), (1.0, 0.0, "alpha"), (1.0, 51.0, "alpha")]
)
def test_an_ogden_term_has_a_share_and_an_exponent(share, alpha, argument):
    with pytest.raises(FingerError) as caught:
        OgdenTerm(share, alpha)
    assert caught.value.argument == argument


def test_an_anisotropic_layer_does_not_relax():
    with pytest.raises(FingerError) as caught:
        Material(1.0, 0.3, prony=(PronyTerm(0.5, 0.1),), anisotropy=STRATUM)
    assert caught.value.argument == "prony"


@pytest.mark.parametrize(
    ("values", "argument"),
    [
        ((0.0, 0.3, 0.2), "young_normal_mpa"),
        ((1.0, -0.1, 0.2), "poisson_normal"),
        ((1.0, 0.3, math.nan), "shear_normal_mpa"),
        ((1.0, 0.3, 0.2, -1.0), "young_along_mpa"),
    ],
)
def test_moduli_out_of_range_are_refused(values, argument):
    with pytest.raises(FingerError) as caught:
        Anisotropy(*values)
    assert caught.value.argument == argument


@given(normal=st.floats(0.05, 20), poisson=st.floats(0, 3), inner=st.floats(0, 0.45))
def test_a_layer_that_would_give_off_energy_is_refused(normal, poisson, inner):
    """Transverse isotropy is stable where ``1 - nu - 2 nu12^2 E2 / E1 > 0`` (Lempriere 1968)."""
    room = 1 - inner - 2 * poisson**2 * normal
    axes = Anisotropy(normal, poisson, 0.2)
    assume(abs(room) > 1e-6)
    if room > 0:
        assert Material(1.0, inner, anisotropy=axes).anisotropy is axes
    else:
        with pytest.raises(FingerError):
            Material(1.0, inner, anisotropy=axes)


def test_constants_of_an_isotropic_layer_are_its_moduli():
    plain = Material(2.0, 0.3)
    same = replace(plain, anisotropy=Anisotropy(2.0, 0.3, plain.shear_mpa))
    assert_allclose(same.engineering_constants, plain.engineering_constants, rtol=1e-12)


def test_nine_constants_are_those_of_the_layer():
    axes = Anisotropy(0.6, 0.25, 0.15, 1.2, 0.4, 0.3, 0.5)
    constants = Material(2.0, 0.3, anisotropy=axes).engineering_constants
    # nu23 is the contraction along the finger when the layer is pulled normal to the skin.
    assert_allclose(constants, (2.0, 0.6, 1.2, 0.25, 0.3, 0.4 * 0.6 / 1.2, 0.15, 0.5, 0.3))


# ---- Directions


def test_the_tangent_is_that_of_the_sampled_outline():
    section = section_of(QUICK)
    arc_mm = np.linspace(0.0, section.end_arc_mm, 60)
    for depth_mm in (0.0, 0.25, 1.7):
        point_mm = section.curve(lambda arc, d=depth_mm: np.full_like(arc, d), arc_mm)
        normal = np.stack(
            [np.interp(arc_mm, section.arc_mm, axis) for axis in section.normal.T], -1
        )
        tangent = skin_tangent(QUICK.outline, point_mm)
        assert_allclose(np.einsum("pk,pk->p", tangent, normal)[1:-1], 0, atol=2e-3)
        assert_allclose(np.linalg.norm(tangent, axis=1), 1, rtol=1e-12)
    assert_allclose(skin_tangent(Outline(), np.array([[0.0, -0.1]])), [[1.0, 0.0]], atol=1e-12)


def test_each_element_of_an_anisotropic_layer_has_the_direction_of_its_skin(short):
    analysis = analysis_of(finger_with(stratum_corneum={"anisotropy": STRATUM}), short)
    corneum, *others = analysis.layers
    assert all(layer.axes is None for layer in others)
    assert corneum.axes.shape == (len(corneum.number), 2)
    center_mm = analysis.node_mm[corneum.node - 1].mean(axis=1)
    at_apex = np.abs(center_mm[:, 0]) < 0.1
    assert_allclose(np.abs(corneum.axes[at_apex, 0]), 1, atol=1e-3)
    side = np.abs(center_mm[:, 0]) > 7.6  # where the finger is widest the skin runs along y
    assert side.any()
    assert_allclose(np.abs(corneum.axes[side, 1]), 1, atol=0.12)


# ---- Finger files


def test_constants_in_mpa_give_the_moduli_at_rest():
    """Mooney-Rivlin: G = 2 (C10 + C01); Ogden: G = the sum of mu; E = 2 G (1 + nu)."""
    finger = finger_from(
        {
            "materials": {
                "dermis": {"c10_mpa": 0.006, "c01_mpa": 0.002, "poisson": 0.45},
                "subcutaneous_tissue": {
                    "ogden": [{"mu_mpa": 0.003, "alpha": 9.0}, {"mu_mpa": 0.001, "alpha": -2}]
                },
            }
        },
        "f",
    )
    dermis, fat = finger.materials["dermis"], finger.materials["subcutaneous_tissue"]
    assert (dermis.law, fat.law) == ("mooney-rivlin", "ogden")
    assert_allclose((dermis.shear_mpa, dermis.c01_share), (0.016, 0.25))
    assert_allclose((fat.shear_mpa, fat.poisson), (0.004, 0.40))
    assert_allclose([(term.share, term.alpha) for term in fat.ogden], [(0.75, 9), (0.25, -2)])


@pytest.mark.parametrize(
    ("entries", "key", "found"),
    [
        ({"c10_mpa": 0.1}, "c01_mpa", None),
        ({"c10_mpa": "0.1", "c01_mpa": 0.1}, "c10_mpa", "0.1"),
        ({"c10_mpa": -0.1, "c01_mpa": 0.1}, "c10_mpa", -0.1),
        ({"c10_mpa": 0.1, "c01_mpa": 0.1, "young_mpa": 1.0}, "young_mpa", 1.0),
        ({"c10_mpa": 0.1, "c01_mpa": 0.1, "law": "ogden"}, "c01_share", "ogden"),
        ({"ogden": [{"mu_mpa": 0.0, "alpha": 2}]}, "ogden.mu_mpa", 0.0),
        (
            {"ogden": [{"mu_mpa": 0.1, "alpha": 2}, {"share": 0.1, "alpha": 2}]},
            "ogden.mu_mpa",
            None,
        ),
        ({"ogden": [{"mu_mpa": 0.1}]}, "ogden 1.alpha", None),
        ({"ogden": 3}, "ogden", 3),
        ({"ogden": [3]}, "ogden 1", 3),
        ({"law": 3}, "law", 3),
        ({"anisotropy": {"young_normal_mpa": 1.0}}, "anisotropy.poisson_normal", None),
        ({"prony": "skin-wang"}, "prony", "skin-wang"),
    ],
)
def test_constants_in_a_file_that_mean_nothing_are_refused(entries, key, found):
    with pytest.raises(FingerError) as caught:
        finger_from({"materials": {"dermis": entries}}, "f")
    assert (caught.value.key, caught.value.found) == (f"materials.dermis.{key}", found)


@pytest.mark.parametrize("layer", ["subcutaneous_tissue", "bone", "nail"])
def test_only_layers_along_the_outline_are_anisotropic(layer):
    axes = Anisotropy(TABLE_1[layer].young_mpa, 0.3, 0.1)
    with pytest.raises(FingerError) as caught:
        finger_with(**{layer: {"anisotropy": axes}})
    assert (caught.value.argument, caught.value.found) == (f"materials.{layer}.anisotropy", layer)


def test_a_table_of_a_finger_has_all_that_makes_it():
    finger = finger_with(
        stratum_corneum={"anisotropy": STRATUM},
        dermis={"law": "ogden", "ogden": OGDEN, "prony": (PronyTerm(0.5, 0.1),)},
        subcutaneous_tissue={"law": "mooney-rivlin", "c01_share": 0.3},
    )
    assert finger_from(finger_table(finger), "f") == finger


def test_the_table_of_a_preset_is_as_before_these_keys_existed():
    for layer in LAYERS:
        assert set(finger_table(QUICK)["materials"][layer]) == {"young_mpa", "poisson"}


def test_the_documented_materials_are_a_finger():
    text = (Path(decks.__file__).parents[1] / "docs/how_to/finger.md").read_text(encoding="utf-8")
    tables = [block.partition("\n```")[0] for block in text.split("```toml\n")[1:]]
    finger = finger_from(tomllib.loads(tables[1]), "documented")
    laws = {name: material.law for name, material in finger.materials.items() if material.law}
    assert laws == {"dermis": "mooney-rivlin", "subcutaneous_tissue": "ogden"}
    assert_allclose(finger.materials["dermis"].young_mpa, 4 * 0.006 * 1.48)
    assert finger.materials["stratum_corneum"].anisotropy is not None
    assert finger_from(tomllib.loads(tables[0]), "mine") == replace(QUICK, name="mine")


# ---- Published Prony sets


def test_a_finger_file_names_a_published_set():
    finger = finger_from({"materials": {"dermis": {"prony": "skin-wang-2015"}}}, "f")
    assert finger.materials["dermis"].prony == (PronyTerm(0.72, 0.19),)
    assert name_of_prony(finger.materials["dermis"].prony) == "skin-wang-2015"
    assert name_of_prony((PronyTerm(0.1, 0.2),)) is None


def test_each_set_has_a_source_and_leaves_a_lasting_share():
    tissues = set()
    for name, entry in prony_sets().items():
        tissues.add(entry.tissue)
        assert name.startswith(entry.tissue)
        assert Material(1.0, 0.4, prony=entry.prony).lasting_share > 0
        assert entry.measured
        assert any(str(year) in entry.source for year in range(1970, 2030))
    assert tissues == {"skin", "pulp"}


@pytest.mark.parametrize(
    ("name", "lasting"), [("skin-wang-2015", 0.28), ("skin-wang-2015-stretch", 0.47)]
)
def test_the_lasting_share_is_the_published_residual_stress_ratio(name, lasting):
    assert_allclose(Material(1.0, 0.4, prony=prony_set(name).prony).lasting_share, lasting)


# ---- Decks

LAWS = {
    "stratum_corneum": {"anisotropy": STRATUM},
    "epidermis": {"law": "neo-hookean"},
    "dermis": {"law": "ogden", "ogden": OGDEN},
    "subcutaneous_tissue": {"law": "mooney-rivlin", "c01_share": 0.25},
}


@pytest.mark.parametrize("write", [calculix_deck, abaqus_deck])
def test_keyword_decks_have_the_constants_of_each_law(write, short, parse_deck):
    element = "CPE4" if write is calculix_deck else "CPE4H"
    finger = finger_with(**LAWS)
    cards = parse_deck(write(analysis_of(finger, short, element))).cards
    laws, name = {}, None
    for keyword, options, rows in cards:
        name = options.get("NAME") if keyword == "MATERIAL" else name
        if keyword in ("HYPERELASTIC", "ELASTIC"):
            laws[name] = options, [float(text) for row in rows for text in row]
    dermis, fat = finger.materials["dermis"], finger.materials["subcutaneous_tissue"]
    options, numbers = laws["DERMIS"]
    assert options == {"OGDEN": "", "N": "2"}
    mu_mpa = [term.share * dermis.shear_mpa for term in OGDEN]
    expected = [mu_mpa[0], 3.0, mu_mpa[1], -6.0, 2 / dermis.bulk_mpa, 1e20]
    assert_allclose(numbers, expected, rtol=1e-12)
    options, numbers = laws["SUBCUTANEOUS_TISSUE"]
    assert options == {"MOONEY-RIVLIN": ""}
    constants = [0.375 * fat.shear_mpa, 0.125 * fat.shear_mpa, 2 / fat.bulk_mpa]
    assert_allclose(numbers, constants, rtol=1e-12)
    assert laws["EPIDERMIS"][0] == {"NEO HOOKE": ""}
    options, numbers = laws["STRATUM_CORNEUM"]
    assert options == {"TYPE": "ENGINEERING CONSTANTS"}
    assert_allclose(numbers, finger.materials["stratum_corneum"].engineering_constants, rtol=1e-12)


@pytest.mark.parametrize("write", [calculix_deck, abaqus_deck])
def test_keyword_decks_have_the_axes_of_each_element(write, short, parse_deck):
    element = "CPE4" if write is calculix_deck else "CPE4H"
    analysis = analysis_of(finger_with(**LAWS), short, element)
    corneum = analysis.layers[0]
    found = {}
    for keyword, options, rows in parse_deck(write(analysis)).cards:
        found.setdefault(keyword, []).append((options, rows))
    ((options, rows),) = found["DISTRIBUTION"]
    assert options["NAME"] == "STRATUM_CORNEUM_DIRECTIONS"
    assert rows[0] == ["", "1.0", "0.0", "0.0", "0.0", "1.0", "0.0"]
    assert [int(row[0]) for row in rows[1:]] == corneum.number.tolist()
    axes = np.array([[float(text) for text in row[1:]] for row in rows[1:]])
    assert_allclose(axes[:, :2], corneum.axes, atol=1e-9)
    assert_allclose((axes[:, :3] * axes[:, 3:]).sum(axis=1), 0, atol=1e-9)
    ((options, rows),) = found["ORIENTATION"]
    assert (options["NAME"], rows[0]) == ("STRATUM_CORNEUM_AXES", ["STRATUM_CORNEUM_DIRECTIONS"])
    oriented = [options for options, _ in found["SOLID SECTION"] if "ORIENTATION" in options]
    assert [(section["ELSET"], section["ORIENTATION"]) for section in oriented] == [
        ("STRATUM_CORNEUM", "STRATUM_CORNEUM_AXES")
    ]
    if write is abaqus_deck:
        ((options, rows),) = found["DISTRIBUTION TABLE"]
        assert (options["NAME"], rows) == ("STRATUM_CORNEUM_POINTS", [["COORD3D", "COORD3D"]])


@pytest.mark.parametrize(
    ("layer", "argument", "found"),
    [
        ("stratum_corneum", "anisotropy", "stratum_corneum"),
        ("dermis", "law", "ogden"),
        ("subcutaneous_tissue", "law", "mooney-rivlin"),
    ],
)
def test_marc_decks_refuse_what_no_real_deck_has_shown(layer, argument, found, short):
    analysis = analysis_of(finger_with(**{layer: LAWS[layer]}), short, "CPE4H")
    with pytest.raises(DeckError) as refused:
        DIALECTS["marc"].write(analysis, DeckOptions())
    assert (refused.value.argument, refused.value.found) == (argument, found)


def test_a_law_of_a_layer_is_kept_by_the_law_of_the_analysis(short):
    finger = finger_with(dermis=LAWS["dermis"], epidermis={"law": "linear"})
    model = Model(finger, mesh_of(finger), law="neo-hookean", support="prescribed")
    laws = {layer.name: layer.law for layer in model.analysis(short).layers}
    assert laws == {
        "stratum_corneum": "neo-hookean",
        "epidermis": "linear",
        "dermis": "ogden",
        "subcutaneous_tissue": "neo-hookean",
        "bone": "linear",
        "nail": "linear",
    }


# ---- Unit forces on a pad


def small_prism(finger):
    return prism_of(smooth(finger), PadMesh(spacing_mm=0.5, reach_mm=2.0, plane=True))


def test_a_pad_has_the_axes_of_its_anisotropic_layer(parse_deck):
    prism = small_prism(finger_with(stratum_corneum={"anisotropy": STRATUM}))
    deck = parse_deck(prism_text(prism, even_x=True, even_z=True))
    node_mm, elements = deck.nodes(), deck.elements()
    rows = deck.one("DISTRIBUTION", NAME="STRATUM_CORNEUM_DIRECTIONS")[2][1:]
    corneum = [int(row[0]) for row in deck.one("ELEMENT", ELSET="STRATUM_CORNEUM")[2]]
    assert [int(row[0]) for row in rows] == corneum
    for row in rows[:: len(rows) // 7]:
        # Along the skin: from the mean of the left to that of the right corners of the element.
        corner_mm = np.array([node_mm[node][:2] for node in elements[int(row[0])][:4]])
        along = corner_mm[[1, 2]].mean(axis=0) - corner_mm[[0, 3]].mean(axis=0)
        x, y = (float(text) for text in row[1:3])
        assert (x * along[0] + y * along[1]) / np.linalg.norm(along) > 0.99


def test_a_pad_keeps_the_prony_terms_of_its_finger():
    prism = small_prism(finger_with(dermis={"prony": (PronyTerm(0.5, 0.1),)}))
    assert prism.finger.time_constants_s == (0.1,)
    assert "VISCOELASTIC" not in prism_text(prism, even_x=True, even_z=True)


def test_an_afferent_in_an_anisotropic_layer_of_a_pad_is_refused():
    axes = Anisotropy(2.0, 0.3, 0.7)
    with pytest.raises(FingerError) as refused:
        small_prism(finger_with(epidermis={"anisotropy": axes}))
    assert (refused.value.argument, refused.value.found) == ("afferents.SA", "epidermis")


@pytest.mark.slow
@pytest.mark.solver
def test_a_pad_of_a_layer_without_anisotropy_written_as_anisotropic_is_the_same():
    corneum = TABLE_1["stratum_corneum"]
    equal = Anisotropy(corneum.young_mpa, corneum.poisson, corneum.shear_mpa)
    soft = Anisotropy(0.2, 0.3, 0.1)
    plain, same, softer = (
        fb.make_pad(
            finger_with(stratum_corneum={"anisotropy": axes}),
            spacing_mm=0.5,
            reach_mm=2.0,
            plane=True,
        ).down_mm[1]
        for axes in (None, equal, soft)
    )
    assert_allclose(same, plain, rtol=1e-4, atol=1e-6)
    middle = plain.shape[1] // 2
    assert softer[0, middle, 0] > 1.1 * plain[0, middle, 0]
