"""A finger is what the paper's tables say, or ten lines of TOML, or it is refused with a reason."""

import math
from dataclasses import fields

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from decks.finger import (
    SITES,
    TABLE_1,
    AfferentSite,
    Bone,
    Finger,
    Material,
    Nail,
    Outline,
    Papillae,
    PronyTerm,
    Resolution,
    Ridges,
    Skin,
)
from decks.presets import PRESETS, QUICK, finger_from, mesh_of, read_finger, stored_mesh
from fembridge.errors import FingerError, UsageError


def test_a_size_that_is_no_size_is_refused_by_its_name():
    for part in (Outline, Skin, Ridges, Papillae, Bone, Nail, Resolution):
        for entry in fields(part):
            for value in (math.nan, math.inf, -math.inf, -1.0):
                with pytest.raises(FingerError) as caught:
                    part(**{entry.name: value})
                assert caught.value.argument == entry.name
                assert caught.value.found is value


@pytest.mark.parametrize("young_mpa", [0.0, -2.0, 1e-9, 1e12, math.inf])
def test_a_modulus_that_no_tissue_has_is_refused(young_mpa):
    with pytest.raises(FingerError) as refused:
        Material(young_mpa, 0.3)
    assert (refused.value.argument, refused.value.found) == ("young_mpa", young_mpa)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"epidermis_rows": 10**9}, r"epidermis_rows .* 200"),
        ({"contact_mm": 0.001}, r"contact_mm .* 0\.001"),
        ({"ridge_mm": 0.3, "far_mm": 0.2}, "far_mm"),
        ({"contact_mm": 0.05, "contact_half_width_mm": 0.01}, "contact_half_width_mm"),
    ],
)
def test_a_resolution_that_makes_no_mesh_is_refused(change, words):
    with pytest.raises(FingerError, match=words):
        Finger("odd", resolution=Resolution(**change))


@pytest.mark.parametrize(
    ("change", "argument", "found_mm", "expected"),
    [
        ({"ridges": Ridges(height_mm=0.25)}, "ridges.height_mm", 0.25, "less than 0.25 mm"),
        ({"nail": Nail(thickness_mm=0.65)}, "nail.thickness_mm", 0.65, "less than 0.65 mm"),
        ({"papillae": Papillae(0.4)}, "papillae.height_mm", 0.4, "less than 0.4 mm"),
        (
            {"skin": Skin(1.0), "ridges": Ridges(height_mm=0.8)},
            "papillae.height_mm",
            0.45,
            "less than 0.4 mm",
        ),
        (
            {"skin": Skin(dermis_mm=0.1), "papillae": Papillae(0.3)},
            "papillae.height_mm",
            0.3,
            "less than 0.2 mm",
        ),
        (
            {"outline": Outline(8.0, 3.6), "bone": Bone(1.0, 0.5, 3.6)},
            "skin",
            1.75,
            "less than 1.62 mm",
        ),
        ({"ridges": Ridges(half_width_mm=9.0)}, "ridges.half_width_mm", 9.0, "at most 8 mm"),
        ({"ridges": Ridges(spacing_mm=0.4)}, "resolution.ridge_mm", 0.125, "at most 0.1 mm"),
        ({"bone": Bone(depth_mm=4.0)}, "skin", 2.05, "at most 1.8 mm"),
        ({"bone": Bone(depth_mm=9.0)}, "bone.depth_mm", 11.2, "at most 10.9 mm"),
        ({"bone": Bone(half_width_mm=5.9)}, "bone.half_width_mm", 5.9, "at most 4.93 mm"),
    ],
)
def test_parts_that_do_not_fit_together_are_refused(change, argument, found_mm, expected):
    with pytest.raises(FingerError) as caught:
        Finger("odd", **change)
    assert (caught.value.argument, caught.value.expected) == (argument, expected)
    assert caught.value.found == pytest.approx(found_mm)


@pytest.mark.parametrize(
    ("change", "argument", "found"),
    [
        ({"afferents": {}}, "afferents", None),
        ({"afferents": {"SA": AfferentSite("dermis", 0.0, 13.1)}}, "afferents.SA", None),
        ({"afferents": {"SA": AfferentSite("dermis", -8.1, 6.5)}}, "afferents.SA", None),
        ({"afferents": {"sa": SITES["SA"]}}, "afferents", "sa"),
        ({"afferents": {"SA\n*END STEP": SITES["SA"]}}, "afferents", "SA\n*END STEP"),
        ({"materials": {"dermis": TABLE_1["dermis"]}}, "materials", None),
    ],
)
def test_afferents_and_materials_that_make_no_finger_are_refused(change, argument, found):
    with pytest.raises(FingerError) as caught:
        Finger("odd", **change)
    assert (caught.value.argument, caught.value.found) == (argument, found)
    assert "\n" not in str(caught.value)


def test_a_smooth_finger_may_have_wide_columns():
    wide = Resolution(contact_mm=0.2, ridge_mm=0.3)
    Finger("smooth", ridges=Ridges(height_mm=0), papillae=Papillae(0), resolution=wide)
    with pytest.raises(FingerError, match="four columns to a ridge"):
        Finger("ridged", resolution=wide)


@given(half_width_mm=st.floats(0.1, 8.0), depth_mm=st.floats(3.0, 11.0))
def test_a_bone_that_is_taken_is_clear_of_the_skin_all_around(half_width_mm, depth_mm):
    bone = Bone(half_width_mm, 1.0, depth_mm)
    try:
        finger = Finger("f", bone=bone)
    except FingerError:
        return
    clear_mm = min(
        math.hypot(
            half_width_mm * math.sin(at) - 8.0 * math.sin(around),
            6.5 - depth_mm + math.cos(at) - 6.5 * math.cos(around),
        )
        for at in (math.pi * k / 24 for k in range(25))
        for around in (math.pi * k / 300 for k in range(301))
    )
    assert clear_mm > finger.skin.dermis_depth_mm + 0.2


# ---- Terms by which it relaxes, and densities


@pytest.mark.parametrize(
    ("terms", "argument", "found"),
    [
        ([(0.6, 0.1), (0.4, 0.2)], "prony", None),
        ([(0.0, 0.1)], "g", 0.0),
        ([(1.0, 0.1)], "prony", None),
        ([(0.5, 0.0)], "tau_s", 0.0),
        ([(0.5, math.inf)], "tau_s", math.inf),
        ([(0.1, 0.1)] * 6, "prony", 6),
    ],
)
def test_terms_that_cannot_be_are_refused(terms, argument, found):
    with pytest.raises(FingerError) as caught:
        Material(1.0, 0.4, prony=tuple(PronyTerm(*term) for term in terms))
    assert (caught.value.argument, caught.value.found) == (argument, found)


def test_a_finger_file_has_terms_and_a_density():
    dermis = {"prony": [{"g": 0.3, "tau_s": 0.02}], "density_kg_m3": 1200.0}
    finger = finger_from({"materials": {"dermis": dermis}}, "f")
    assert finger.materials["dermis"].prony == (PronyTerm(0.3, 0.02),)
    assert finger.materials["dermis"].density_kg_m3 == 1200.0
    assert finger.materials["dermis"].young_mpa == TABLE_1["dermis"].young_mpa
    assert finger.relaxing_s == 0.02
    assert finger.at_once().relaxing_s == 0.0


@pytest.mark.parametrize(
    ("prony", "key", "found"),
    [
        ("0.3", "prony", "0.3"),
        ([0.3], "prony 1", 0.3),
        ([{"g": 0.3}], "prony 1.tau_s", None),
        ([{"g": 0.3, "tau": 1}], "prony 1.tau", "tau"),
        ([{"g": 0.3, "tau_s": 1}, {"g": "x", "tau_s": 1}], "prony 2.g", "x"),
        ([{"g": 0.3, "tau_s": -1}], "prony 1.tau_s", -1.0),
        ([{"g": 0.6, "tau_s": 1}, {"g": 0.4, "tau_s": 2}], "prony", None),
    ],
)
def test_terms_in_a_file_that_mean_nothing_are_refused(prony, key, found):
    with pytest.raises(FingerError) as caught:
        finger_from({"materials": {"dermis": {"prony": prony}}}, "f")
    assert (caught.value.key, caught.value.found) == (f"materials.dermis.{key}", found)


# ---- Files

TEN_LINES = """\
name = "thick skin"
base = "quick"
[skin]
epidermis_mm = 0.5
[materials.dermis]
young_mpa = 0.08
poisson = 0.45
[afferents.SA]
x_mm = 0
depth_mm = 0.70
"""

# Each with its key, if it is readable as TOML.
HOSTILE = {
    "huge integer": ("[skin]\nepidermis_mm = 1" + 400 * "0", "skin.epidermis_mm"),
    "endless integer": ("[skin]\nepidermis_mm = 1" + 5000 * "0", None),
    "fraction of a row": ("[resolution]\ndermis_rows = 2.5", "resolution.dermis_rows"),
    "number for a table": ("skin = 3", "skin"),
    "materials": ("materials = 3", "materials"),
    "lines in a name": ('name = "a\\nb"', "name"),
    "long name": (f'name = "{61 * "x"}"', "name"),
    "layer": ('[afferents.SA]\nlayer = "fat"', "afferents.SA.layer"),
    "deep": ("a = " + 20_000 * "[", None),
    "not UTF-8": ('name = "für"'.encode("latin-1"), None),
    "large": ("#" * 1_000_001, None),
}

NEAR = {
    "[skin]\nepidemis_mm = 0.5": "did you mean epidermis_mm",
    "[skins]\nepidermis_mm = 0.5": "did you mean skin",
    "[materials.dermiss]\npoisson = 0.4": "did you mean dermis",
    "[materials.dermis]\nyoung = 0.4": "did you mean young_mpa",
    "[afferents.SA1]\ndepth_mm = 0.7": "did you mean SA",
    "[resolution]\nfar = 0.4": "did you mean far_mm",
}


def test_ten_lines_make_another_finger(file):
    finger = read_finger(str(file("mine.toml", TEN_LINES)))

    assert finger.name == "thick skin"
    assert finger.skin.epidermis_mm == 0.5
    assert finger.materials["dermis"].young_mpa == 0.08
    assert finger.materials["epidermis"] == QUICK.materials["epidermis"]
    assert finger.afferents["SA"] == AfferentSite("epidermis", 0.0, 0.70)
    assert finger.afferents["PC"] == QUICK.afferents["PC"]
    untouched = ("outline", "ridges", "papillae", "bone", "nail", "resolution")
    assert all(getattr(finger, part) == getattr(QUICK, part) for part in untouched)


def test_a_finger_without_a_name_has_that_of_its_file(file):
    finger = read_finger(str(file("soft.toml", "[materials.dermis]\nyoung_mpa = 0.03\n")))
    assert (finger.name, finger.materials["dermis"].young_mpa) == ("soft", 0.03)


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_is_found_by_its_name(name, here, file):
    file(name, "not = a finger")  # a file of that name is not in the way
    assert read_finger(name) is PRESETS[name]


@pytest.mark.parametrize("kind", HOSTILE)
def test_a_hostile_file_is_refused_in_one_clear_line(kind, file):
    text, key = HOSTILE[kind]
    path = file("mine.toml", text)
    with pytest.raises(FingerError) as caught:
        read_finger(str(path))
    assert (caught.value.path, caught.value.key) == (path, key)
    assert len(str(caught.value).removeprefix(str(path))) < 400


@pytest.mark.parametrize("text", NEAR)
def test_an_unknown_key_gets_the_near_ones(text, file):
    with pytest.raises(FingerError, match=NEAR[text]):
        read_finger(str(file("mine.toml", text)))


@pytest.mark.parametrize("name", ["quik", "", ".", "a\0b", 300 * "x", "/dev/zero", "/dev/null/x"])
def test_what_is_neither_a_preset_nor_a_file_is_refused(name):
    with pytest.raises(UsageError) as caught:
        read_finger(name)
    assert (caught.value.argument, caught.value.found) == ("finger", name)


words = st.text('am_."\\\n é€😀', max_size=8)  # not all of Unicode, whose table takes seconds
scalars = st.none() | st.booleans() | st.integers() | st.floats() | words
KEYS = """
    name base skin ridges bone materials afferents resolution dermis SA layer
    epidermis_mm poisson young_mpa depth_mm far_mm dermis_rows start_deg
"""
keys = st.sampled_from(KEYS.split())
tables = st.recursive(
    scalars, lambda inner: st.lists(inner, max_size=2) | st.dictionaries(keys, inner)
)


@settings(settings.get_profile("costly"))
@given(st.dictionaries(keys | words, tables, max_size=4))
def test_any_table_is_a_finger_or_a_finger_error(table):
    try:
        assert isinstance(finger_from(table, "any"), Finger)
    except FingerError as error:
        assert str(error)


def test_other_materials_alone_need_no_mesher(monkeypatch):
    import decks.mesher

    def refuse(finger):
        raise AssertionError(finger)

    monkeypatch.setattr(decks.mesher, "mesh_finger", refuse)
    table = {"base": "quick", "materials": {"dermis": {"young_mpa": 1}}}
    finger = finger_from(table, "soft")
    assert len(mesh_of(finger).quad) == 3100
    assert stored_mesh("quick").is_file()
    with pytest.raises(AssertionError):
        mesh_of(finger_from({"skin": {"epidermis_mm": 0.5}}, "thick"))
