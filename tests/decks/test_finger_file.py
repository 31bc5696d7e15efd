"""Ten lines of TOML make a finger; anything else makes one clear error."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from decks.finger import AfferentSite, Finger
from decks.presets import PRESETS, QUICK, finger_from, mesh_of, read_finger, stored_mesh
from fembridge.errors import FingerError, UsageError

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

# Each with what the message names: a key, a value, a place.
HOSTILE = {
    "huge integer": ("[skin]\nepidermis_mm = 1" + 400 * "0", "epidermis_mm"),
    "endless integer": ("[skin]\nepidermis_mm = 1" + 5000 * "0", "TOML"),
    "fraction of a row": ("[resolution]\ndermis_rows = 2.5", r"dermis_rows: 2\.5"),
    "number for a table": ("skin = 3", "skin"),
    "materials": ("materials = 3", "materials"),
    "lines in a name": ('name = "a\\nb"', "name"),
    "long name": (f'name = "{61 * "x"}"', "name .* 60"),
    "layer": ('[afferents.SA]\nlayer = "fat"', "fat.* stratum"),
    "deep": ("a = " + 20_000 * "[", "TOML"),
    "not UTF-8": ('name = "für"'.encode("latin-1"), "TOML"),
    "large": ("#" * 1_000_001, "1000000 bytes"),
}

NEAR = {
    "[skin]\nepidemis_mm = 0.5": "did you mean epidermis_mm",
    "[skins]\nepidermis_mm = 0.5": "did you mean skin",
    "[materials.dermiss]\npoisson = 0.4": "did you mean dermis",
    "[materials.dermis]\nyoung = 0.4": "did you mean young_mpa",
    "[afferents.SA1]\ndepth_mm = 0.7": "did you mean SA",
    "[resolution]\nfar = 0.4": "did you mean far_mm",
}


def write(folder, text, name="mine.toml"):
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return str(path)


def test_ten_lines_make_another_finger(tmp_path):
    finger = read_finger(write(tmp_path, TEN_LINES))

    assert finger.name == "thick skin"
    assert finger.skin.epidermis_mm == 0.5
    assert finger.materials["dermis"].young_mpa == 0.08
    assert finger.materials["epidermis"] == QUICK.materials["epidermis"]
    assert finger.afferents["SA"] == AfferentSite("epidermis", 0.0, 0.70)
    assert finger.afferents["PC"] == QUICK.afferents["PC"]
    untouched = ("outline", "ridges", "papillae", "bone", "nail", "resolution")
    assert all(getattr(finger, part) == getattr(QUICK, part) for part in untouched)


def test_a_finger_without_a_name_has_that_of_its_file(tmp_path):
    finger = read_finger(write(tmp_path, "[materials.dermis]\nyoung_mpa = 0.03\n", "soft.toml"))
    assert (finger.name, finger.materials["dermis"].young_mpa) == ("soft", 0.03)


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_is_found_by_its_name(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write(tmp_path, "not = a finger", name)  # a file of that name is not in the way
    assert read_finger(name) is PRESETS[name]


@pytest.mark.parametrize("kind", HOSTILE)
def test_a_hostile_file_is_refused_in_one_clear_line(kind, tmp_path):
    text, words = HOSTILE[kind]
    path = write(tmp_path, text)
    with pytest.raises(FingerError, match=words) as caught:
        read_finger(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert len(message.removeprefix(path)) < 400


@pytest.mark.parametrize("text", NEAR)
def test_an_unknown_key_gets_the_near_ones(text, tmp_path):
    with pytest.raises(FingerError, match=NEAR[text]):
        read_finger(write(tmp_path, text))


@pytest.mark.parametrize("name", ["quik", "", ".", "a\0b", 300 * "x", "/dev/zero", "/dev/null/x"])
def test_what_is_neither_a_preset_nor_a_file_is_refused(name):
    with pytest.raises(UsageError, match="quick, paper"):
        read_finger(name)


scalars = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8)
KEYS = """
    name base skin ridges bone materials afferents resolution dermis SA layer
    epidermis_mm poisson young_mpa depth_mm far_mm dermis_rows start_deg
"""
keys = st.sampled_from(KEYS.split())
tables = st.recursive(
    scalars, lambda inner: st.lists(inner, max_size=2) | st.dictionaries(keys, inner)
)


@settings(settings.get_profile("costly"))
@given(st.dictionaries(keys | st.text(max_size=5), tables, max_size=4))
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
