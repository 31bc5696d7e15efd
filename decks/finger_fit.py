"""Whether the parts of a finger fit together: layers, ridges, bone, afferents."""

import re
from typing import TYPE_CHECKING

from fembridge.errors import FingerError

if TYPE_CHECKING:
    from decks.finger import Bone, Finger, Outline

# Clear way between the dermis and the bone: room for a row of elements.
_BONE_GAP_MM = 0.3
# An afferent's name becomes part of a set's name in a deck.
_AFFERENT = re.compile(r"[A-Z][A-Z0-9_]{0,39}")


def check_fit(finger: "Finger") -> None:
    """Refuse a finger whose parts cross each other.

    Raises
    ------
    FingerError
        Names both parts, what they are and what they may be.
    """
    _check_layers(finger)
    _check_ridges(finger)
    _check_bone(finger)
    _check_afferents(finger)


def _check_layers(finger: "Finger") -> None:
    """Refuse layers that cross each other or fold where the outline bends."""
    skin, ridges, papillae = finger.skin, finger.ridges, finger.papillae
    if ridges.height_mm >= skin.stratum_corneum_mm:
        raise FingerError(
            f"ridges {ridges.height_mm:g} mm high in a stratum corneum of "
            f"{skin.stratum_corneum_mm:g} mm: expected less"
        )
    if finger.nail.thickness_mm >= skin.epidermis_depth_mm:
        raise FingerError(
            f"a nail of {finger.nail.thickness_mm:g} mm: expected thinner than "
            f"corneum and epidermis, {skin.epidermis_depth_mm:g} mm"
        )
    waves_mm = 0.5 * (papillae.height_mm + ridges.height_mm)
    if papillae.height_mm >= skin.epidermis_mm or waves_mm >= skin.epidermis_mm:
        raise FingerError(
            f"papillae {papillae.height_mm:g} mm high under ridges of "
            f"{ridges.height_mm:g} mm in an epidermis of {skin.epidermis_mm:g} mm: "
            "expected less"
        )
    if 0.5 * papillae.height_mm >= skin.dermis_mm:
        raise FingerError(
            f"papillae {papillae.height_mm:g} mm high over a dermis of "
            f"{skin.dermis_mm:g} mm: expected less than twice that"
        )
    if skin.dermis_depth_mm >= finger.outline.least_radius_mm:
        raise FingerError(
            f"skin {skin.dermis_depth_mm:g} mm deep folds where the outline's "
            f"radius is {finger.outline.least_radius_mm:.3g} mm: expected less"
        )


def _check_ridges(finger: "Finger") -> None:
    """Refuse ridges that reach the nail's side, or that no column can follow."""
    ridges, resolution = finger.ridges, finger.resolution
    if ridges.half_width_mm > finger.outline.half_width_mm:
        raise FingerError(
            f"ridges to {ridges.half_width_mm:g} mm on both sides: expected at "
            f"most the outline's half width, {finger.outline.half_width_mm:g} mm"
        )
    widest_mm = max(resolution.contact_mm, resolution.ridge_mm)
    flat = ridges.height_mm == 0 == finger.papillae.height_mm
    if not flat and widest_mm > (0.25 + 1e-9) * ridges.spacing_mm:
        raise FingerError(
            f"columns {widest_mm:g} mm wide under ridges {ridges.spacing_mm:g} mm "
            f"apart: contact_mm and ridge_mm must be at most "
            f"{0.25 * ridges.spacing_mm:g} mm, four to a ridge"
        )


def _check_bone(finger: "Finger") -> None:
    """Refuse a bone that reaches into the skin.

    Inside means: within the outline's ellipse less skin and gap on each half
    axis, which is the curve at that depth to a few hundredths of a mm.
    """
    bone, outline = finger.bone, finger.outline
    wall_mm = finger.skin.dermis_depth_mm + _BONE_GAP_MM
    top_mm = bone.depth_mm - bone.half_height_mm
    bottom_mm = bone.depth_mm + bone.half_height_mm
    lowest_mm = 2 * outline.half_height_mm - wall_mm
    if top_mm < wall_mm or bottom_mm > lowest_mm:
        raise FingerError(
            f"the bone spans depth {top_mm:g} to {bottom_mm:g} mm and touches "
            f"the skin: expected inside {wall_mm:g} to {lowest_mm:g} mm"
        )
    room_mm = _half_width_mm(outline, bone, wall_mm)
    if bone.half_width_mm > room_mm:
        raise FingerError(
            f"bone half width {bone.half_width_mm:g} mm, expected at most "
            f"{room_mm:.3g} mm: it touches the skin"
        )


def _check_afferents(finger: "Finger") -> None:
    if not finger.afferents:
        raise FingerError("a finger without afferents has nothing to tell")
    for name, site in finger.afferents.items():
        if not isinstance(name, str) or not _AFFERENT.fullmatch(name):
            raise FingerError(
                f"afferent {name!r}: expected a capital letter, then capital "
                "letters, digits or _, at most 40 in all"
            )
        across = site.x_mm / finger.outline.half_width_mm
        along = site.depth_mm / finger.outline.half_height_mm - 1
        if not across * across + along * along <= 1:
            raise FingerError(
                f"afferent {name} at x = {site.x_mm:g} mm, depth "
                f"{site.depth_mm:g} mm is outside the finger"
            )


def _half_width_mm(outline: "Outline", bone: "Bone", wall_mm: float) -> float:
    """Widest half width of a bone there that stays `wall_mm` from the outline."""
    width_mm = outline.half_width_mm - wall_mm
    height_mm = outline.half_height_mm - wall_mm
    off_mm = bone.depth_mm - outline.half_height_mm  # > 0: towards the back
    rooms_mm = [width_mm]
    for step in range(1, 200):  # the bone's outline, from its top to its bottom
        share = -1 + step / 100
        at = (off_mm + share * bone.half_height_mm) / height_mm
        rooms_mm.append(width_mm * ((1 - at * at) / (1 - share * share)) ** 0.5)
    return min(rooms_mm)
