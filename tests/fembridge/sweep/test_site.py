"""Afferents that keep to a boundary of their layer."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from decks.finger import AfferentSite, Papillae, Ridges, Skin
from decks.presets import PRESETS, QUICK
from fembridge.errors import FingerError
from fembridge.sweep.site import Anchor, anchor_of, anchored


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


def test_on_the_axis_the_distance_is_that_of_the_flat_layers():
    """Under the middle of a ridge the epidermis reaches half a papilla deeper."""
    finger = replace(
        QUICK,
        skin=Skin(stratum_corneum_mm=0.3, epidermis_mm=0.45, dermis_mm=0.9),
        papillae=Papillae(0.08),
    )
    kept = {name: anchor_of(QUICK, name) for name in QUICK.afferents}
    moved = anchored(finger, kept)

    sites = moved.afferents
    assert sites["SA"].depth_mm == pytest.approx(0.75 + 0.04 - 0.1125)
    assert sites["PC"].depth_mm == pytest.approx(1.65 + 0.25)
    assert sites["RA"].depth_mm - QUICK.afferents["RA"].depth_mm == pytest.approx(
        (0.75 - 0.04) - (0.65 - 0.05), abs=1e-4
    )
    assert {n: (s.layer, s.x_mm) for n, s in sites.items()} == {
        n: (s.layer, s.x_mm) for n, s in QUICK.afferents.items()
    }


@pytest.mark.parametrize("name", PRESETS)
def test_nothing_moves_where_nothing_is_different(name):
    finger = PRESETS[name]
    kept = {each: anchor_of(finger, each) for each in finger.afferents}

    assert anchored(finger, kept) == finger
    assert anchored(finger, {}) is finger


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
    kept = {name: anchor_of(QUICK, name) for name in QUICK.afferents}
    moved = anchored(finger, kept)

    for name, anchor in kept.items():
        again = anchor_of(moved, name)
        assert again.upper == anchor.upper
        assert again.distance_mm == pytest.approx(anchor.distance_mm, abs=2e-6)


def test_a_place_beyond_the_layer_is_refused_with_the_layers_depths():
    thin = replace(QUICK, skin=Skin(0.3, 0.2, 1.1))
    with pytest.raises(FingerError, match=r"SA .* is not inside the epidermis, 0\.3 to 0\.55 mm"):
        anchored(thin, {"SA": Anchor(upper=False, distance_mm=0.3)})


def test_a_site_that_is_not_in_its_layer_has_no_boundary_to_keep_to():
    astray = with_site(QUICK, "RA", AfferentSite("dermis", 0.125, 0.4))
    with pytest.raises(FingerError, match=r"RA at depth 0\.4 mm is not inside the"):
        anchor_of(astray, "RA")
    boned = with_site(QUICK, "RA", AfferentSite("bone", 0.0, 8.0))
    with pytest.raises(FingerError, match="bone has no boundary of the skin"):
        anchor_of(boned, "RA")
    with pytest.raises(FingerError, match="afferent 'XX', expected one of SA, RA, PC"):
        anchor_of(QUICK, "XX")


def test_in_the_dermis_the_nearer_boundary_counts():
    shallow = with_site(QUICK, "RA", AfferentSite("dermis", 0.0, 0.8))
    deep = with_site(QUICK, "RA", AfferentSite("dermis", 0.0, 1.7))

    assert anchor_of(shallow, "RA") == Anchor(upper=True, distance_mm=0.1)
    assert anchor_of(deep, "RA") == Anchor(upper=False, distance_mm=0.05)
