"""Studies with designs: their fingers, what is asked of contacts, and refusals."""

import csv

import pytest

from decks.presets import PRESETS, QUICK
from fembridge.errors import UsageError
from fembridge.sweep import read_study, run_sweep
from fembridge.sweep.plan import plan_of
from fembridge.sweep.study_file import study_from

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


def test_a_hypercube_has_as_many_fingers_as_it_says_and_all_columns(tmp_path):
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
    plan = plan_of(study, "ccx")
    assert len(plan.items) == 6
    rows = {tuple(point.columns.values()) for point in plan.points}
    assert len(rows) == 6
    assert {*RANGES, "contact.friction"} <= set(plan.columns)
    for point in plan.points:
        asked = plan.items[point.item].response.asked
        assert asked == {"friction": point.columns["contact.friction"]}


def test_afferents_follow_their_layer_in_a_design_and_stay_where_it_says_fixed(tmp_path):
    asked = {"design": "one-at-a-time", "ranges": {"skin.epidermis_mm": [0.35, 0.45]}}
    follow = study_with(tmp_path, **asked).variants
    fixed = study_with(tmp_path, **asked, sites="fixed").variants

    depths = [each.finger.afferents["SA"].depth_mm for each in follow]
    assert depths == pytest.approx([0.5875, 0.5375, 0.6375])
    depths = [each.finger.afferents["PC"].depth_mm for each in follow]
    assert depths == pytest.approx([2.0, 1.95, 2.05])
    assert all(each.finger.afferents == QUICK.afferents for each in fixed)


def test_grids_and_rows_can_follow_and_tell_distances_too(tmp_path):
    name = "afferents.SA.to_boundary_mm"
    [thick] = study_with(tmp_path, grid={"skin.epidermis_mm": 0.45}, sites="follow").variants
    one, other = study_with(tmp_path, rows=[{name: 0.05}, {"contact.friction": 0.0}]).variants

    assert thick.finger.afferents["SA"].depth_mm == pytest.approx(0.6375)
    assert one.finger.afferents["SA"].depth_mm == pytest.approx(0.65)
    assert (one.value(name), other.value(name)) == (0.05, 0.1125)
    assert (one.contact, other.contact) == ({}, {"friction": 0.0})
    assert one.value("contact.friction") is None


def test_an_afferent_whose_depth_is_varied_stays_at_that_depth(tmp_path):
    study = study_with(
        tmp_path,
        design="one-at-a-time",
        ranges={"skin.epidermis_mm": "5 %", "afferents.SA.depth_mm": [0.5, 0.6]},
    )

    assert [each.finger.afferents["SA"].depth_mm for each in study.variants] == [
        0.5875,
        0.5875,
        0.5875,
        0.5,
        0.6,
    ]


def test_the_table_of_a_design_names_every_parameter_in_its_columns(here, tmp_path, study_file):
    study = study_file(
        'stimuli = ["sine_20_250"]\nstored = true\n[[fingers]]\n'
        'design = "one-at-a-time"\n[fingers.ranges]\n'
        "materials.dermis.young_mpa = [0.04, 0.06]\n"
    )
    sweep = run_sweep(study, tmp_path / "out")

    with sweep.results.open() as file:
        rows = list(csv.DictReader(file))
    assert [row["materials.dermis.young_mpa"] for row in rows[::3]] == ["0.05", "0.04", "0.06"]
    assert [row["status"] for row in rows[::3]] == ["done", "failed", "failed"]


def test_a_study_without_a_design_has_the_keys_that_it_had(tmp_path):
    """What was solved before designs were thought of is found again."""
    study = study_with(tmp_path, grid={"materials.dermis.young_mpa": [0.04, 0.05]})
    plain, changed = (each.finger for each in study.variants)

    assert changed == PRESETS["quick"]
    assert plain.afferents == QUICK.afferents
    responses = [item.response for item in plan_of(study, "ccx").items.values()]
    assert all(each.asked == {} for each in responses)


@pytest.mark.parametrize(
    ("finger", "problem"),
    [
        ({"ranges": RANGES}, "fingers 1: design: '', expected one-at-a-time or"),
        ({"design": "sobol", "ranges": RANGES}, "design: 'sobol', expected"),
        ({"design": "one-at-a-time"}, "design, but no ranges"),
        ({"samples": 3}, "samples, but no ranges"),
        ({"design": "one-at-a-time", "ranges": {}}, "ranges: none, expected one"),
        (
            {"design": "one-at-a-time", "ranges": RANGES, "samples": 4},
            "samples is for a latin-hypercube",
        ),
        ({"design": "latin-hypercube", "ranges": RANGES}, "samples: absent"),
        (
            {"design": "latin-hypercube", "ranges": RANGES, "samples": 1},
            "samples: 1, expected 2 to",
        ),
        (
            {"design": "latin-hypercube", "ranges": RANGES, "samples": 5.5},
            "samples: 5.5, expected a whole number",
        ),
        (
            {"design": "latin-hypercube", "ranges": RANGES, "samples": 5, "seed": -1},
            "seed: -1, expected 0 to",
        ),
        ({"design": "latin-hypercube", "ranges": RANGES, "samples": 90_000}, "1080000 points"),
        ({"ranges": RANGES, "grid": {}}, "grid and ranges, expected one of them"),
        (
            {"design": "one-at-a-time", "ranges": {"skin.colour": [1, 2]}},
            "skin.colour: the base has no such number",
        ),
        (
            {"design": "one-at-a-time", "ranges": {"contact.frction": [0, 1]}},
            "contact: unknown key 'frction'.*friction",
        ),
        (
            {"design": "one-at-a-time", "ranges": {"contact.formulation": [0, 1]}},
            "contact.formulation: the base has no such number",
        ),
        (
            {"design": "one-at-a-time", "ranges": {"skin.dermis_mm": [1.0, 2.5]}},
            "choose narrower ranges: skin.dermis_mm=2.5: the bone spans",
        ),
        (
            {
                "design": "latin-hypercube",
                "samples": 9,
                "ranges": {"afferents.SA.to_boundary_mm": [0.1, 0.9]},
            },
            r"choose narrower ranges: sample \d of 9: afferent SA .* not inside",
        ),
        ({"sites": "float"}, "sites: 'float', expected fixed or follow"),
        ({"rows": [{"afferents.SA.to_boundary_mm": "near"}]}, "'near', expected a num"),
        ({"rows": [{"afferents.SA.to_boundary_mm": -0.1}]}, "-0.1, expected a number"),
        (
            {"rows": [{"afferents.SA.to_boundary_mm": 0.1, "afferents.SA.depth_mm": 0.5}]},
            "to_boundary_mm beside afferents.SA.depth_mm, expected one",
        ),
        ({"rows": [{"afferents.XY.to_boundary_mm": 0.1}]}, "afferent 'XY'"),
        ({"rows": [{"contact.friction": -0.1}]}, "friction must be >= 0"),
    ],
)
def test_what_cannot_be_designed_is_one_line(tmp_path, finger, problem):
    with pytest.raises(UsageError, match=problem) as caught:
        study_with(tmp_path, **finger)
    assert "\n" not in str(caught.value)


def test_friction_cannot_be_asked_of_fingers_and_of_contacts(tmp_path):
    table = {
        "stimuli": ["sine_20_250"],
        "fingers": [{"design": "one-at-a-time", "ranges": {"contact.friction": "9 %"}}],
        "contacts": [{"friction": 0.3}],
    }
    with pytest.raises(UsageError, match="friction stands there and among the fingers"):
        study_from(table, tmp_path)
    table["contacts"], table["stored"] = [{}], True
    with pytest.raises(UsageError, match="a stored response has its own"):
        study_from(table, tmp_path)


def test_the_studies_of_the_documentation_are_what_it_says(request):
    studies = request.config.rootpath / "docs" / "studies"
    single = read_study(studies / "sensitivity_one_at_a_time.toml")
    cube = read_study(studies / "sensitivity_hypercube.toml")

    assert (len(single.variants), len(cube.variants)) == (29, 50)
    assert len(single.stimuli) == len(cube.stimuli) == 82
    assert set(single.variants[0].changes) == set(cube.variants[0].changes)
    assert single.variants[0].finger == QUICK
