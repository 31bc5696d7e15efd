"""Studies from TOML: what they hold, and one clear line for what they must not."""

import math
from itertools import product
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from decks.presets import PRESETS
from decks.probe import Probe
from fembridge.errors import UsageError
from fembridge.sweep import read_study
from fembridge.sweep.study import MOST_POINTS
from fembridge.sweep.study_file import study_from
from fembridge.sweep.variant import grid_rows, grid_size

LEAST = {"stimuli": ["sine_20_250"]}


def test_a_study_of_one_line_is_the_quick_finger_as_the_parameters_were_fitted(study_file):
    study = read_study(study_file('stimuli = "noise_25_250"'))

    assert len(study.stimuli) == study.points == 5
    [variant] = study.variants
    assert variant.finger == PRESETS["quick"]
    assert (study.probes, study.contacts) == ((Probe(),), ({},))
    assert (study.methods, study.preindents_um) == (("map",), (75.0,))
    assert (study.parameters.name, study.name, study.stored) == ("fitted", "study", False)


def test_a_grid_gives_every_combination_and_rows_give_one_finger_each(study_file):
    study = read_study(
        study_file(
            """
            stimuli = ["sine_20_250"]
            [[fingers]]
            [fingers.grid]
            skin.epidermis_mm = [0.3, 0.5]
            "materials.dermis.young_mpa" = [0.04, 0.05, 0.06]
            [[fingers]]
            base = "paper"
            rows = [{afferents.SA.depth_mm = 0.5}, {ridges.height_mm = 0.05}]
            """
        )
    )

    grid = study.variants[:6]
    assert [
        (each.finger.skin.epidermis_mm, each.finger.materials["dermis"].young_mpa) for each in grid
    ] == list(product((0.3, 0.5), (0.04, 0.05, 0.06)))
    one, other = study.variants[6:]
    assert one.label == other.label == one.finger.name == "paper"
    assert one.finger.afferents["SA"].depth_mm == 0.5
    assert one.finger.ridges == PRESETS["paper"].ridges
    assert other.finger.ridges.height_mm == other.value("ridges.height_mm") == 0.05
    assert other.value("afferents.SA.depth_mm") == 0.5875
    assert other.value("skin.colour") is None


def test_a_finger_file_is_a_base_and_counts_from_the_study(study_file, tmp_path):
    (tmp_path / "mine.toml").write_text(
        '\ufeffname = "thick"\n[skin]\nepidermis_mm = 0.5\ndermis_mm = 1.2\n', "utf-8"
    )
    study = read_study(
        study_file(
            'stimuli = ["sine_20_250"]\nfingers = ["mine.toml", '
            '{base = "mine.toml", grid.skin.dermis_mm = [1.0]}]'
        )
    )

    plain, changed = study.variants
    assert plain.finger.name == changed.finger.name == "thick"
    assert (plain.label, changed.label) == ("mine", "mine")
    assert plain.finger.skin.dermis_mm == 1.2
    assert changed.finger.skin.dermis_mm == 1.0
    assert changed.finger.skin.epidermis_mm == 0.5


def test_lists_of_a_probe_multiply_and_a_flat_one_gets_its_fillet(study_file):
    study = read_study(
        study_file(
            'stimuli = ["sine_20_250"]\n[[probes]]\ndiameter_mm = [0.5, 1.0]\n'
            'x_mm = [0, 0.25]\n[[probes]]\nshape = "flat"\ndiameter_mm = 0.2\n'
            "[[contacts]]\nfriction = [0.0, 0.2]\n"
        )
    )

    assert [(each.diameter_mm, each.x_mm) for each in study.probes[:4]] == list(
        product((0.5, 1.0), (0, 0.25))
    )
    assert study.probes[4] == Probe("flat", 0.2, 0.05)
    assert study.contacts == ({"friction": 0.0}, {"friction": 0.2})
    assert study.points == 10


@given(
    st.dictionaries(
        st.sampled_from(["a.x", "a.y", "b.x", "c.x"]),
        st.lists(st.floats(0, 1), max_size=4, unique=True),
    )
)
def test_the_size_of_a_grid_is_the_number_of_its_rows(grid):
    rows = list(grid_rows(grid))
    assert grid_size(grid) == len(rows)
    assert len({tuple(row.items()) for row in rows}) == len(rows)


HOSTILE = {
    'stimulus = ["sine_20_250"]': "unknown key 'stimulus', .* did you mean stimuli",
    "methods = ['map']": "stimuli: absent",
    "stimuli = []": "stimuli: no stimulus named",
    "stimuli = ['../../etc/passwd']": "stimuli: no stimulus '../../etc/passwd'",
    "stimuli = [\"__import__('os').system('id')\"]": "stimuli: no stimulus",
    "stimuli = [nan]": "stimuli: nan, expected a word",
    "stimuli = 'sine_20_250'\nmethods = ['maps']": "methods: 'maps', expected map or",
    "stimuli = 'sine_20_250'\nmethods = []": "methods: none",
    "stimuli = 'sine_20_250'\nmethods = ['map', 'map']": "methods: map stands there tw",
    "stimuli = 'sine_20_250'\npreindent_um = nan": "preindent_um: nan, expected a fin",
    "stimuli = 'sine_20_250'\npreindent_um = -1": "preindent_um: -1.0, expected 0 to",
    "stimuli = 'sine_20_250'\npreindent_um = [1, 1.0]": "preindent_um: 1.0 stands th",
    "stimuli = 'sine_20_250'\nseed = -1": "seed: -1, expected 0 or more",
    "stimuli = 'sine_20_250'\nseed = 1.5": "seed: 1.5, expected a whole number",
    "stimuli = 'sine_20_250'\nstored = 'yes'": "stored: 'yes', expected true or false",
    "stimuli = 'sine_20_250'\nelement = 'CPE5'": "element: 'CPE5', expected one of",
    "stimuli = 'sine_20_250'\nname = ''": "name: '', expected 1 to 60",
    "stimuli = 'sine_20_250'\nparameters = '../p.toml'": "parameters: '../p.toml', exp",
    "stimuli = 'sine_20_250'\nparameters = 'publish'": "parameters: no parameter set",
    "stimuli = 'sine_20_250'\nparameters = 7": "parameters: 7, expected a word",
    "stimuli = 'sine_20_250'\nfingers = []": "fingers: none",
    "stimuli = 'sine_20_250'\nfingers = 'quick'": "fingers: 'quick', expected a list",
    "stimuli = 'sine_20_250'\nfingers = [3]": "fingers 1: 3, expected a table",
    "stimuli = 'sine_20_250'\nfingers = ['../q.toml']": "fingers 1: base: '../q.toml'",
    "stimuli = 'sine_20_250'\nfingers = ['/etc/passwd']": "fingers 1: base: '/etc/pas",
    "stimuli = 'sine_20_250'\nfingers = ['absent.toml']": "neither a preset .* nor a",
    "stimuli = 'sine_20_250'\nfingers = [{grids = {}}]": "fingers 1: unknown key 'gri",
    "stimuli = 'sine_20_250'\nfingers = [{grid = {skin = 1}}]": "'skin', expected sect",
    "stimuli = 'sine_20_250'\nfingers = [{grid = {skin.dermis_mm = []}}]": "empty list",
    "stimuli = 'sine_20_250'\nfingers = [{rows = []}]": "fingers 1: rows: none",
    "stimuli = 'sine_20_250'\nfingers = [{rows = [{}], grid = {}}]": "grid and rows",
    "stimuli = 'sine_20_250'\nfingers = [{rows = [{skin.dermis_mm = -1}]}]": (
        r"fingers 1: skin.dermis_mm = -1: \[skin\] dermis_mm must be 0.02 to 50"
    ),
    "stimuli = 'sine_20_250'\nfingers = [{rows = [{skin.dermis_mm = nan}]}]": (
        "fingers 1: row 1: skin.dermis_mm: nan, expected a finite number"
    ),
    "stimuli = 'sine_20_250'\nfingers = [{rows = [{skin.dermis_mm = true}]}]": (
        "fingers 1: row 1: skin.dermis_mm: True, expected a number"
    ),
    "stimuli = 'sine_20_250'\nfingers = [{grid.skin.dermis = [1.0]}]": (
        "unknown key 'dermis', .* did you mean dermis_mm"
    ),
    "stimuli = 'sine_20_250'\nfingers = [{grid.skin.dermis_mm = ['__import__']}]": (
        "dermis_mm must be a number, got '__import__'"
    ),
    "stimuli = 'sine_20_250'\nfingers = [{grid.skin.dermis_mm = [1.0, 1.0]}]": (
        "fingers 1: grid: skin.dermis_mm: 1.0 stands there twice"
    ),
    "stimuli = 'sine_20_250'\n[[fingers]]\n[fingers.grid]\n'skin.dermis_mm' = [1.0]\n"
    "skin.dermis_mm = [1.1]": "skin.dermis_mm stands there twice",
    "stimuli = 'sine_20_250'\n[[fingers]]\n[fingers.grid]\n'skin.dermis_mm.x' = [1.0]\n"
    "skin.dermis_mm = [1.1]": "skin.dermis_mm stands there twice",
    "stimuli = 'sine_20_250'\nprobes = [{diameter_mm = -1}]": "probes 1: diameter_mm",
    "stimuli = 'sine_20_250'\nprobes = [{diameter = 1}]": "did you mean diameter_mm",
    "stimuli = 'sine_20_250'\nprobes = [{x_mm = '../'}]": "x_mm must be a number",
    "stimuli = 'sine_20_250'\nprobes = [{fillet_mm = 0.1}]": "fillet_mm is for shape",
    "stimuli = 'sine_20_250'\nprobes = [{shape = 'round'}]": "probe shape 'round'",
    "stimuli = 'sine_20_250'\nprobes = []": "probes: none",
    "stimuli = 'sine_20_250'\nprobes = [{}, {}]": "probes: .* stands there twice",
    "stimuli = 'sine_20_250'\ncontacts = [{friction = -0.1}]": "contacts: friction",
    "stimuli = 'sine_20_250'\ncontacts = [{fricton = 0.1}]": "did you mean friction",
    "stimuli = 'sine_20_250'\ncontacts = [{friction = '0.4'}]": "must be a number",
    "stimuli = 'sine_20_250'\nstored = true\nmethods = ['transient']": "no transient",
    "stimuli = 'sine_20_250'\nstored = true\ncontacts = [{friction = 0}]": "its own",
    "stimuli = ": "not readable as TOML",
    "stimuli = 'sine_20_250'\n" + "a = " + "[" * 5000: "not readable as TOML",
}


@pytest.mark.parametrize("text", HOSTILE, ids=range(len(HOSTILE)))
def test_what_a_study_must_not_hold_is_one_line_with_file_and_key(text, study_file):
    path = study_file(text)
    with pytest.raises(UsageError, match=HOSTILE[text]) as caught:
        read_study(path)
    line = str(caught.value)
    assert line.startswith(f"{path}: ")
    assert "\n" not in line.removeprefix(f"{path}: not readable as TOML")
    assert len(line) < 700


def test_a_product_without_measure_is_refused_by_its_number_before_it_is_made():
    names = [f"skin.key_{k}" for k in range(10)]
    grid = {name: [float(k) for k in range(1000)] for name in names}

    with pytest.raises(UsageError, match=f"^{10**30} points .* at most {MOST_POINTS}"):
        study_from({**LEAST, "fingers": [{"grid": grid}]}, folder=None)


@pytest.mark.parametrize("part", ["probes", "contacts"])
def test_a_product_of_probes_or_contacts_is_refused_alike(part):
    keys = {"probes": ("diameter_mm", "x_mm"), "contacts": ("friction", "stick_share")}
    wide = {key: [0.1 + 1e-6 * k for k in range(400)] for key in keys[part]}

    with pytest.raises(UsageError, match=r"^160000 points"):
        study_from({**LEAST, part: [wide]}, folder=None)


def test_a_study_may_be_as_large_as_the_limit_says():
    values = [0.5 + 1e-5 * k for k in range(1000)]
    table = {**LEAST, "probes": [{"x_mm": values}]}
    study = study_from({**table, "preindent_um": [float(k) for k in range(100)]}, None)
    assert study.points == MOST_POINTS
    assert math.isclose(study.probes[-1].x_mm, values[-1])


@pytest.mark.parametrize("path", ["", ".", "absent.toml", "a\0b"])
def test_what_is_no_file_is_told_so(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError, match=r"cannot be read|no name of a file"):
        read_study(Path(path) if "\0" in path else tmp_path / path)


def test_bytes_that_are_no_text_are_refused(tmp_path):
    (tmp_path / "study.toml").write_bytes(b"stimuli = '\xff\xfe'")
    with pytest.raises(UsageError, match="not UTF-8"):
        read_study(tmp_path / "study.toml")
