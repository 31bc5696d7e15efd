"""A round fingertip: sizes, outline, TOML, and parts that do not fit each other."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from decks.finger import Material, PronyTerm
from decks.fingertip import (
    HUMAN,
    MACAQUE,
    AfferentDepth,
    Fingertip,
    fingertip_from,
    is_fingertip,
    read_fingertip,
)
from decks.presets import finger_from
from fembridge.errors import FingerError, UsageError

CAPSULE = np.array(
    [[0, 1, 0], [0, 0, 1], [1, 0, -0.5], [0.6, 0.8, -1], [0.48, 0.64, 0.6], [0, -0.6, 0.8]],
    dtype=float,
)


@pytest.mark.parametrize(("tip", "widths_mm"), [(HUMAN, (16, 20)), (MACAQUE, (8, 10))])
def test_the_widths_are_those_of_the_fingertips_of_dandekar_2003(tip, widths_mm):
    """Caption of their Fig. 4: human 16 to 20 mm, monkey 8 to 10 mm."""
    assert widths_mm[0] <= 2 * tip.outline.half_width_mm <= widths_mm[1]


@pytest.mark.parametrize("tip", [HUMAN, MACAQUE])
def test_the_apex_is_the_origin_and_the_tip_is_ahead(tip):
    apex, end = tip.skin_mm(CAPSULE[:2])
    assert_allclose(apex, 0, atol=1e-12)
    assert_allclose(end, [0, -tip.outline.half_height_mm, tip.outline.tip_mm])


def test_normals_are_perpendicular_to_the_skin_and_point_outwards():
    step = 1e-6
    turn = np.array([[-y, x, 0] for x, y, _ in CAPSULE])
    turned = CAPSULE + step * turn
    skin_mm = HUMAN.skin_mm(CAPSULE)
    tangent = (HUMAN.skin_mm(turned) - skin_mm) / step
    normal = HUMAN.normal(skin_mm)
    assert_allclose((normal * tangent).sum(axis=1), 0, atol=1e-4)
    assert_allclose(np.linalg.norm(normal, axis=1), 1)
    middle_mm = np.stack([0 * skin_mm[:, 0], np.full(len(skin_mm), -6.5), 0 * skin_mm[:, 0]], 1)
    assert ((skin_mm - middle_mm) * normal).sum(axis=1).min() > 0


def test_the_nails_edge_is_at_its_angle_from_the_apex():
    outline, height = HUMAN.outline, HUMAN.nail_height
    across_mm = outline.half_width_mm * np.sqrt(1 - height**2)
    angle_deg = np.degrees(np.arctan2(across_mm, height * outline.half_height_mm))
    assert_allclose(angle_deg, HUMAN.nail.start_deg)


def test_the_bone_has_a_waist_between_base_and_tuft():
    bone = HUMAN.bone
    z_mm = np.array([-HUMAN.outline.shaft_mm, bone.waist_z_mm, bone.tuft_z_mm, bone.end_z_mm])
    half_width_mm, half_height_mm, depth_mm = HUMAN.bone_axes_mm(z_mm)
    assert_allclose(half_width_mm, [3.2, 2.4, 3.1, 3.1])
    assert_allclose(half_height_mm, [2.2, 1.8, 1.5, 1.5])
    assert_allclose(depth_mm[[0, -1]], [8.5, 7.7])


def test_levels_run_through_the_depths_of_the_afferents():
    tip = fingertip_from(
        {
            "base": "fingertip",
            "resolution": {"dermis_rows": 2},
            "afferents": {"RA": {"layer": "dermis", "depth_mm": 0.8}},
        },
        "mine",
    )
    levels = [(level.depth_mm, level.layer) for level in tip.levels()]
    assert levels == [
        (0.25, "stratum_corneum"),
        (0.5, "epidermis"),
        (0.65, "epidermis"),
        (0.8, "dermis"),
        (1.2, "dermis"),
        (1.75, "dermis"),
        (2.0, "subcutaneous_tissue"),
    ]


def test_a_file_changes_a_preset(tmp_path):
    path = tmp_path / "small.toml"
    path.write_text(
        'base = "fingertip_macaque"\n[outline]\nhalf_width_mm = 4.2\n'
        "[materials.dermis]\nyoung_mpa = 0.08\n",
        encoding="utf-8",
    )
    tip = read_fingertip(str(path))
    assert (tip.name, tip.outline.half_width_mm) == ("small", 4.2)
    assert tip.materials["dermis"] == Material(0.08, 0.48)
    assert tip.bone == MACAQUE.bone
    assert is_fingertip(str(path))


def test_a_finger_in_cross_section_is_no_fingertip(tmp_path):
    path = tmp_path / "flat.toml"
    path.write_text('base = "quick"\n', encoding="utf-8")
    assert not is_fingertip(str(path))
    assert not is_fingertip("quick")
    with pytest.raises(FingerError) as caught:
        read_fingertip(str(path))
    assert (caught.value.key, caught.value.found) == ("base", "quick")


def test_a_fingertip_is_no_finger_in_cross_section():
    with pytest.raises(FingerError) as caught:
        finger_from({"base": "fingertip"}, "mine")
    assert (caught.value.key, caught.value.found) == ("base", "fingertip")


def test_an_unknown_name_is_refused():
    with pytest.raises(UsageError) as caught:
        read_fingertip("thumb")
    assert caught.value.found == "thumb"


@pytest.mark.parametrize(
    ("table", "key", "found"),
    [
        ({"bone": {"length_mm": 3}}, "bone.length_mm", None),
        ({"materials": {"fat": {"young_mpa": 1, "poisson": 0.3}}}, "materials.fat", "fat"),
        ({"name": "a/b"}, "name", "a/b"),
        ({"outline": {"half_width_mm": 1}}, "outline.half_width_mm", 1),
        ({"resolution": {"order": 3}}, "resolution.order", 3),
        ({"resolution": {"pad_mm": 3.0, "far_mm": 2.0}}, "resolution.pad_mm", 3.0),
        ({"nail": {"thickness_mm": 0.64}}, "nail.thickness_mm", 0.64),
        ({"nail": {"root_mm": 8.9}}, "nail.root_mm", 8.9),
        ({"skin": {"dermis_mm": 4.0}, "afferents": {"PC": {"depth_mm": 5.0}}}, "skin", 5.0),
        ({"bone": {"waist_z_mm": 4.0}}, "bone.waist_z_mm", 4.0),
        ({"bone": {"end_z_mm": 8.0}}, "bone", None),
        ({"afferents": {"SA": {"depth_mm": 0.7}}}, "afferents.SA.depth_mm", 0.7),
        ({"afferents": {"SA": {"depth_mm": 0.51}}}, "afferents", None),
        (
            {"materials": {"dermis": {"prony": [{"g": 0.3, "tau_s": 0.1}]}}},
            "materials.dermis.prony",
            1,
        ),
    ],
)
def test_what_cannot_be_is_refused_by_its_key(table, key, found):
    with pytest.raises(FingerError) as caught:
        fingertip_from({"base": "fingertip", **table}, "mine")
    assert key in (caught.value.key, caught.value.argument)
    if found is not None:
        assert caught.value.found == found


def test_relaxing_materials_are_refused():
    materials = {**HUMAN.materials, "dermis": Material(0.05, 0.48, (PronyTerm(0.3, 0.1),))}
    with pytest.raises(FingerError) as caught:
        Fingertip("mine", materials=materials)
    assert caught.value.argument == "materials.dermis.prony"


def test_an_afferent_of_another_class_gets_a_level():
    tip = Fingertip("mine", afferents={"SA2": AfferentDepth("dermis", 1.0)})
    assert [level.depth_mm for level in tip.levels()] == [0.25, 0.65, 1.0, 1.75]
