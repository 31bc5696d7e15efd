"""Where an afferent sits in its layer: how far from the nearer of its boundaries.

Merkel cells sit at the bottom of the epidermis and Meissner corpuscles hang on it,
however thick the skin above is. So a depth below the surface says less about an
afferent than its distance to the boundary that it is seen at: for SA and RA the one
between epidermis and dermis, for PC the one above the subcutaneous tissue. The
boundary is that at the afferent's own ``x``, ridges and papillae included.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from decks.finger import AfferentSite, Finger
from decks.section import DepthOfArc, Section, section_of
from fembridge.errors import FingerError
from fembridge.typing import FloatArray

SKIN = ("stratum_corneum", "epidermis", "dermis", "subcutaneous_tissue")
"""Layers that have a boundary to keep to."""

# A distance is told to a nanometre: beyond that is rounding.
_DIGITS = 6
# The boundaries are sampled this finely along the skin.
_STEP_MM = 0.005


@dataclass(frozen=True, slots=True)
class Anchor:
    """The boundary that an afferent keeps to: its layer's upper or lower one.

    `distance_mm` is the way from there into the layer.
    """

    upper: bool
    distance_mm: float


def anchor_of(finger: Finger, name: str) -> Anchor:
    """Give the boundary that afferent `name` of `finger` is nearest to.

    Raises
    ------
    FingerError
        No such afferent, or one that does not sit in its layer of the skin.
    """
    site = _site(finger, name)
    top_mm, bottom_mm = _span_mm(section_of(finger), site)
    _check_inside(name, site, top_mm, bottom_mm)
    below_top_mm, above_bottom_mm = site.depth_mm - top_mm, bottom_mm - site.depth_mm
    upper = below_top_mm <= above_bottom_mm
    return Anchor(upper, round(min(below_top_mm, above_bottom_mm), _DIGITS))


def anchored(finger: Finger, anchors: Mapping[str, Anchor]) -> Finger:
    """Put afferents of `finger` where their anchors tell.

    Raises
    ------
    FingerError
        The place is not inside the afferent's layer.
    """
    if not anchors:
        return finger
    section, sites = section_of(finger), dict(finger.afferents)
    for name, anchor in anchors.items():
        site = _site(finger, name)
        top_mm, bottom_mm = _span_mm(section, site)
        depth_mm = top_mm + anchor.distance_mm if anchor.upper else bottom_mm - anchor.distance_mm
        sites[name] = replace(site, depth_mm=round(max(depth_mm, 0.0), _DIGITS))
        _check_inside(name, sites[name], top_mm, bottom_mm)
    return replace(finger, afferents=sites)


def _site(finger: Finger, name: str) -> AfferentSite:
    if name not in finger.afferents:
        raise FingerError(f"afferent {name!r}, expected one of {', '.join(finger.afferents)}")
    return finger.afferents[name]


def _check_inside(name: str, site: AfferentSite, top_mm: float, bottom_mm: float) -> None:
    if not top_mm < site.depth_mm < bottom_mm:
        raise FingerError(
            f"afferent {name} at depth {site.depth_mm:g} mm is not inside the "
            f"{site.layer}, {top_mm:.4g} to {bottom_mm:.4g} mm deep there"
        )


def _span_mm(section: Section, site: AfferentSite) -> tuple[float, float]:
    """Give the depths between which the site's layer lies at the site's ``x``."""
    finger = section.finger
    upper_and_lower: dict[str, tuple[DepthOfArc, DepthOfArc | None]] = {
        "stratum_corneum": (section.surface, section.corneum),
        "epidermis": (section.corneum, section.epidermis),
        "dermis": (section.epidermis, section.dermis),
        "subcutaneous_tissue": (section.dermis, None),
    }
    if site.layer not in upper_and_lower:
        raise FingerError(f"a place in the {site.layer} has no boundary of the skin to keep to")
    upper, lower = upper_and_lower[site.layer]
    top_mm = _depth_mm(section, upper, site.x_mm)
    if lower is not None:
        return top_mm, _depth_mm(section, lower, site.x_mm)
    bone = finger.bone
    inside = max(0.0, 1 - (site.x_mm / bone.half_width_mm) ** 2)
    return top_mm, bone.depth_mm - bone.half_height_mm * inside**0.5


def _depth_mm(section: Section, curve: DepthOfArc, x_mm: float) -> float:
    """Give how deep a boundary lies at `x_mm`, measured down from the pad's apex."""
    arc_mm: FloatArray = np.arange(0.0, section.end_arc_mm, _STEP_MM)
    point_mm = section.curve(curve, arc_mm)
    pad_mm = point_mm[: int(point_mm[:, 0].argmax()) + 1]
    if abs(x_mm) > pad_mm[-1, 0]:
        raise FingerError(f"x = {x_mm:g} mm: expected within {pad_mm[-1, 0]:.3g} mm of the middle")
    return float(np.interp(abs(x_mm), pad_mm[:, 0], -pad_mm[:, 1]))
