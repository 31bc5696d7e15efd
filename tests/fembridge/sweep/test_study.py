"""Studies: what TOML files hold, their fingers and designs, and what they must not hold."""

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from decks.finger import AfferentSite, Papillae, Ridges, Skin
from decks.presets import PRESETS, QUICK
from decks.probe import Probe
from fembridge.errors import FingerError, UsageError
from fembridge.sweeps import fingers, read_study
from fembridge.sweeps.fingers import (
    MAX_POINTS,
    Anchor,
    Interval,
    anchor_of,
    anchored,
    latin_hypercube,
    range_of,
)
from fembridge.sweeps.study_file import study_from
from fembridge.sweeps.sweep import make_plan

LEAST = {"stimuli": ["sine_20_250"]}


@pytest.fixture
def not_optimised(monkeypatch):
    """Hypercubes as they are drawn: to search for one that is better takes seconds."""
    monkeypatch.setattr(fingers, "_MAX_OPTIMISED_SAMPLES", 0)


def test_a_grid_gives_every_combination_and_rows_give_one_finger_each():
    grid = {"skin.epidermis_mm": [0.3, 0.5], "materials.dermis.young_mpa": [0.04, 0.05, 0.06]}
    rows = [{"afferents.SA.depth_mm": 0.5}, {"ridges.height_mm": 0.05}]
    table = {**LEAST, "fingers": [{"grid": grid}, {"base": "paper", "rows": rows}]}
    *made, one, other = study_from(table, None).variants
    assert [tuple(map(each.value, grid)) for each in made] == list(product(*grid.values()))
    assert one.label == other.label == one.finger.name == "paper"
    assert one.finger.afferents["SA"].depth_mm == 0.5
    assert one.finger.ridges == PRESETS["paper"].ridges
    assert other.finger.ridges.height_mm == 0.05
    assert (other.value("afferents.SA.depth_mm"), other.value("skin.colour")) == (0.5875, None)


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


# Each with the key at fault, None if the file has none.
NO_STUDY = (
    ("stimulus = ['sine_20_250']", "stimulus"),
    ("methods = ['map']", "stimuli"),
    ("stimuli = ['../../etc/passwd']", None),
    ("stimuli = ", None),
    ("stimuli = 'sine_20_250'\n" + "a = " + "[" * 5000, None),
)

NOT_BESIDE_A_STIMULUS = (
    ("methods = ['maps']", "methods"),
    ("preindent_um = -1", "preindent_um"),
    ("seed = -1", "seed"),
    ("element = 'CPE5'", "element"),
    ("parameters = 'publish'", "parameters"),
    ("parameters = '../own.toml'", "parameters"),
    ("name = ''", "name"),
    ("fingers = []", "fingers"),
    ("fingers = ['absent.toml']", "fingers 1.base"),
    ("fingers = [{grids = {}}]", "fingers 1.grids"),
    ("fingers = [{rows = [{}], grid = {}}]", "fingers 1.rows"),
    ("fingers = [{rows = [{}, {skin.dermis_mm = nan}]}]", "fingers 1.rows 2.skin.dermis_mm"),
    ("fingers = [{grid.skin.dermis = [1.0]}]", "fingers 1.skin.dermis"),
    ("fingers = [{grid.skin.dermis_mm = [1.0, 1.0]}]", "fingers 1.grid.skin.dermis_mm"),
    (
        "[[fingers]]\n[fingers.grid]\n'skin.dermis_mm.x' = [1.0]\nskin.dermis_mm = [1.1]",
        "fingers 1.grid.skin.dermis_mm",
    ),
    ("fingers = [{grid.skin.dermis_mm = {}}]", "fingers 1.grid.skin.dermis_mm"),
    ("probes = [{diameter_mm = -1}]", "probes.diameter_mm"),
    ("probes = [{fillet_mm = 0.1}]", "probes.fillet_mm"),
    ("probes = [{}, {}]", "probes"),
    ("contacts = [{fricton = 0.1}]", "contacts.fricton"),
    ("stored = true\nmethods = ['transient']", "stored"),
    ("stored = true\ncontacts = [{friction = 0}]", "contacts"),
)


@pytest.mark.parametrize(
    ("text", "key"),
    [
        *NO_STUDY,
        *((f"stimuli = 'sine_20_250'\n{text}", key) for text, key in NOT_BESIDE_A_STIMULUS),
    ],
    ids=range(len(NO_STUDY) + len(NOT_BESIDE_A_STIMULUS)),
)
def test_a_study_with_an_error_is_refused_with_file_and_key(text, key, study_file):
    path = study_file(text)
    with pytest.raises(UsageError) as caught:
        read_study(path)
    assert (caught.value.path, caught.value.key) == (path, key)
    line = str(caught.value)
    assert "\n" not in line.removeprefix(f"{path}: not readable as TOML")
    assert len(line) < 700


@pytest.mark.parametrize(
    ("part", "keys", "count"),
    [
        ("fingers", [f"skin.key_{k}" for k in range(10)], 400**10),
        ("probes", ["diameter_mm", "x_mm"], 160_000),
    ],
)
def test_a_product_without_measure_is_refused_by_its_number_before_it_is_made(part, keys, count):
    wide = {key: [0.1 + 1e-6 * k for k in range(400)] for key in keys}
    entry = {"grid": wide} if part == "fingers" else wide
    with pytest.raises(UsageError) as caught:
        study_from({**LEAST, part: [entry]}, folder=None)
    assert (caught.value.found, caught.value.expected) == (count, f"at most {MAX_POINTS}")


RANGES = {"skin.dermis_mm": [0.9, 1.2], "materials.dermis.young_mpa": "20 %"}


def study_with(tmp_path, **finger):
    return study_from({"stimuli": ["sine_20"], "fingers": [finger]}, tmp_path)


def test_one_at_a_time_is_the_base_and_two_fingers_a_parameter(tmp_path):
    study = study_with(tmp_path, design="one-at-a-time", ranges=RANGES)

    assert [str(each) for each in study.variants] == [
        "quick base",
        "quick skin.dermis_mm=0.9",
        "quick skin.dermis_mm=1.2",
        "quick materials.dermis.young_mpa=0.04",
        "quick materials.dermis.young_mpa=0.06",
    ]
    assert study.variants[0].finger == QUICK
    assert [
        (each.value("skin.dermis_mm"), each.value("materials.dermis.young_mpa"))
        for each in study.variants
    ] == [(1.1, 0.05), (0.9, 0.05), (1.2, 0.05), (1.1, 0.04), (1.1, 0.06)]


def test_a_hypercube_has_as_many_fingers_as_it_says_and_all_columns(tmp_path, not_optimised):
    study = study_with(
        tmp_path,
        base="paper",
        design="latin-hypercube",
        samples=6,
        seed=5,
        ranges={**RANGES, "contact": {"friction": [0.2, 0.8]}},
    )

    assert len(study.variants) == 6
    assert str(study.variants[2]) == "paper sample 3 of 6"
    plan = make_plan(study, "ccx")
    assert len(plan.items) == 6
    assert len(plan.rows[[*RANGES, "contact.friction"]].drop_duplicates()) == 6
    for friction, key in zip(plan.rows["contact.friction"], plan.rows["key"], strict=True):
        assert plan.items[key].response.contact == {"friction": friction}


def test_afferents_follow_their_layer_in_a_design_and_stay_where_it_says_fixed(tmp_path):
    asked = {"design": "one-at-a-time", "ranges": {"skin.epidermis_mm": [0.35, 0.45]}}
    follow = study_with(tmp_path, **asked).variants
    fixed = study_with(tmp_path, **asked, sites="fixed").variants
    depths = [each.finger.afferents["SA"].depth_mm for each in follow]
    assert depths == pytest.approx([0.5875, 0.5375, 0.6375])
    depths = [each.finger.afferents["PC"].depth_mm for each in follow]
    assert depths == pytest.approx([2.0, 1.95, 2.05])
    assert all(each.finger.afferents == QUICK.afferents for each in fixed)


def test_an_afferent_whose_depth_is_varied_stays_at_that_depth(tmp_path):
    study = study_with(
        tmp_path,
        design="one-at-a-time",
        ranges={"skin.epidermis_mm": "5 %", "afferents.SA.depth_mm": [0.5, 0.6]},
    )
    depths_mm = [each.finger.afferents["SA"].depth_mm for each in study.variants]
    assert depths_mm == [0.5875, 0.5875, 0.5875, 0.5, 0.6]


@pytest.mark.parametrize(
    ("finger", "key", "found"),
    [
        ({"ranges": RANGES}, "design", ""),
        ({"design": "sobol", "ranges": RANGES}, "design", "sobol"),
        ({"design": "one-at-a-time"}, "design", None),
        ({"design": "one-at-a-time", "ranges": RANGES, "samples": 4}, "design", "one-at-a-time"),
        ({"design": "latin-hypercube", "ranges": RANGES}, "samples", 0),
        (
            {"design": "one-at-a-time", "ranges": {"skin.colour": [1, 2]}},
            "ranges.skin.colour",
            None,
        ),
        (
            {"design": "one-at-a-time", "ranges": {"skin.dermis_mm": [1, 2.5]}},
            "bone.depth_mm",
            10.7,
        ),
        (
            {
                "design": "latin-hypercube",
                "samples": 9,
                "ranges": {"afferents.SA.to_boundary_mm": [0.1, 0.9]},
            },
            "afferents.SA.depth_mm",
            0.0,
        ),
        (
            {"rows": [{"afferents.SA.to_boundary_mm": -0.1}]},
            "afferents.SA.to_boundary_mm",
            -0.1,
        ),
        (
            {"rows": [{"afferents.SA.to_boundary_mm": 0.1, "afferents.SA.depth_mm": 0.5}]},
            "afferents.SA.to_boundary_mm",
            None,
        ),
        ({"rows": [{"afferents.XY.to_boundary_mm": 0.1}]}, "afferents.XY", "XY"),
    ],
)
def test_a_design_with_an_error_is_refused_by_key(tmp_path, finger, key, found):
    with pytest.raises(UsageError) as caught:
        study_with(tmp_path, **finger)
    assert (caught.value.key, caught.value.found) == (f"fingers 1.{key}", found)
    assert "\n" not in str(caught.value)


def test_a_design_of_too_many_points_is_refused(tmp_path):
    with pytest.raises(UsageError) as caught:
        study_with(tmp_path, design="latin-hypercube", ranges=RANGES, samples=9_000)
    assert caught.value.found == 108_000


def drawn_shares(parameters, samples, seed):
    ranges = {str(k): Interval(0, 1) for k in range(parameters)}
    return np.array([[*row.values()] for row in latin_hypercube(ranges, samples, seed)])


@pytest.mark.parametrize(("samples", "parameters"), [(7, 1), (7, 3), (201, 3)])
def test_each_slice_of_each_range_has_one_finger(samples, parameters, not_optimised):
    shares = drawn_shares(parameters, samples, seed=3)
    assert shares.shape == (samples, parameters)
    assert (shares == drawn_shares(parameters, samples, seed=3)).all()
    assert (shares != drawn_shares(parameters, samples, seed=4)).any()
    slices = np.sort((shares * samples).astype(int), axis=0)
    np.testing.assert_array_equal(
        slices, np.repeat(np.arange(samples)[:, None], parameters, axis=1)
    )


@pytest.mark.parametrize(
    ("asked", "low", "high", "logarithmic"),
    [
        ([0.9, 1.3], 0.9, 1.3, False),
        ([-1, 2], -1, 2, False),
        ("20 %", 0.4, 0.6, False),
        ("±20%", 0.4, 0.6, False),
        ("+-12.5 %", 0.4375, 0.5625, False),
        ("factor 2", 0.25, 1.0, True),
    ],
)
def test_a_range_is_two_numbers_or_a_share_around_the_base(asked, low, high, logarithmic):
    assert range_of("skin.dermis_mm", asked, 0.5) == Interval(low, high, logarithmic)


@pytest.mark.parametrize("base", [1.0, 0.0, None])
@pytest.mark.parametrize(
    "asked",
    [
        *([1.3, 0.9], [1, 1], [1, 2, 3], [1, "two"], [0, math.nan], [0, math.inf], [False, True]),
        *("much", "100 %", "0 %", "factor 1", "factor 1_0", "\u0662 %", 0.5, None),
    ],
)
def test_what_is_no_range_is_refused(asked, base):
    with pytest.raises(UsageError) as caught:
        range_of("skin.dermis_mm", asked, base)
    assert (caught.value.key, caught.value.found) == ("skin.dermis_mm", asked)


def with_site(finger, name, site):
    return replace(finger, afferents={**finger.afferents, name: site})


def test_the_presets_afferents_keep_to_the_boundaries_they_are_described_by():
    """Decision 0005: SA 0.11 mm above its ridge, RA 0.08 mm above a papilla's tip."""
    assert anchor_of(QUICK, "SA") == Anchor(upper=False, distance_mm=0.1125)
    ra = anchor_of(QUICK, "RA")
    assert not ra.upper
    # The outline bends with r = 8²/6.5 mm at the apex: 0.6 mm deep at x = 0.125 mm
    # is a little further along, past the papilla's tip, and below where it falls.
    radius_mm = 64 / 6.5
    arc_mm = 0.125 / (1 - 0.6 / radius_mm)
    tip_mm = 0.65 + 0.05 * math.cos(2 * math.pi * arc_mm / 0.25)
    fall_mm = arc_mm**2 / 2 / radius_mm
    assert ra.distance_mm == pytest.approx(tip_mm + fall_mm - 0.52, abs=2e-4)
    assert anchor_of(QUICK, "PC") == Anchor(upper=True, distance_mm=0.25)


KEPT = {name: anchor_of(QUICK, name) for name in QUICK.afferents}


@settings(settings.get_profile("costly"))
@given(
    corneum=st.floats(0.2, 0.32),
    epidermis=st.floats(0.3, 0.48),
    dermis=st.floats(0.85, 1.2),
    ridge=st.floats(0, 0.15),
    papilla=st.floats(0, 0.15),
)
def test_in_any_skin_they_keep_their_distance(corneum, epidermis, dermis, ridge, papilla):
    finger = replace(
        QUICK,
        skin=Skin(corneum, epidermis, dermis),
        ridges=Ridges(height_mm=ridge),
        papillae=Papillae(papilla),
    )
    moved = anchored(finger, KEPT)

    for name, anchor in KEPT.items():
        again = anchor_of(moved, name)
        assert again.upper == anchor.upper
        assert again.distance_mm == pytest.approx(anchor.distance_mm, abs=2e-6)


def test_a_site_that_is_not_in_its_layer_has_no_boundary_to_keep_to():
    astray = with_site(QUICK, "RA", AfferentSite("dermis", 0.125, 0.4))
    with pytest.raises(FingerError) as caught:
        anchor_of(astray, "RA")
    assert (caught.value.key, caught.value.found) == ("afferents.RA.depth_mm", 0.4)
    boned = with_site(QUICK, "RA", AfferentSite("bone", 0.0, 8.0))
    with pytest.raises(FingerError, match="bone"):
        anchor_of(boned, "RA")
    with pytest.raises(FingerError) as caught:
        anchor_of(QUICK, "XX")
    assert (caught.value.key, caught.value.found) == ("afferents.XX", "XX")
