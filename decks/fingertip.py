"""A round fingertip in three dimensions: sizes, layers, bone with its tuft, nail, materials.

The skin's surface is half an ellipsoid from the pad's apex to the tip, and an elliptic cylinder
from there towards the joint. The origin is the apex of the pad; ``x`` points across the finger,
``y`` out of the pad, so that depth is ``-y`` there, and ``z`` towards the tip. The fingertip is
symmetric about ``x = 0``. Lengths are in mm and moduli in MPa, as in `decks.finger`, whose
parts are used where they fit; ridges and papillae are not modelled.

``decks.fingertip_mesh`` makes the elements and ``decks.fingertip_deck`` the deck.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from decks.finger import (
    LAYERS,
    MIN_THICKNESS_MM,
    NOT_NEGATIVE,
    POSITIVE,
    TABLE_1,
    Material,
    Ranged,
    Skin,
)
from decks.finger_file import is_file, preset_or_file, with_changes
from fembridge.errors import FingerError
from fembridge.host.store import read_toml
from fembridge.trace import AFFERENT_NAME
from fembridge.typing import FloatArray

# Tissue between the layered skin and the bone: room for an element.
_BONE_GAP_MM = 0.25
_SKIN_LAYERS = ("epidermis", "dermis", "subcutaneous_tissue")
_SHARE = (0.05, 0.95)


@dataclass(frozen=True, slots=True)
class TipOutline(Ranged):
    """Outline of the skin: an ellipsoid at the tip, an elliptic cylinder behind it.

    A human fingertip is 16 to 20 mm wide, a macaque's 8 to 10 mm (Dandekar, Raju &
    Srinivasan 2003, J. Biomech. Eng. 125:682, caption of Fig. 4). The height is that of
    `decks.finger.Outline`. The two lengths are our choice: a tip of 10 mm gives the middle of
    the pad a radius of curvature of 15 mm along the finger.

    Parameters
    ----------
    half_width_mm
        Half axis across the finger in mm, 2 to 50. Default: 8.
    half_height_mm
        Half axis from pad to nail in mm, 2 to 50. Default: 6.5.
    tip_mm
        Distance along the finger from the apex of the pad to the tip in mm, 2 to 50. Default: 10.
    shaft_mm
        Length of the cylinder, from the apex of the pad to the end of the model, in mm, 1 to
        50. Default: 9.
    """

    half_width_mm: float = 8.0
    half_height_mm: float = 6.5
    tip_mm: float = 10.0
    shaft_mm: float = 9.0

    RANGES: ClassVar = {
        **dict.fromkeys(("half_width_mm", "half_height_mm", "tip_mm"), (2.0, 50.0)),
        "shaft_mm": (1.0, 50.0),
    }


@dataclass(frozen=True, slots=True)
class Phalanx(Ranged):
    """The distal phalanx: ellipses along the finger, wide at base and tuft, narrow at the waist.

    Base, narrow waist and tuft are the three zones of the anatomy of fractures (AO Surgery
    Reference, distal phalanx). The height of the waist is near the mean of 30 phalanges, 3.55 mm
    (Wyrsch et al., as cited by Darowish, Brenneman & Bigger 2015, Hand 10:100). Depth, base and
    widths are our choice: the bone of `decks.finger.Bone` at the end of the model.

    Parameters
    ----------
    base_half_width_mm, base_half_height_mm
        Half axes at the end of the model in mm, more than 0. Default: 3.2 and 2.2.
    base_depth_mm
        Depth of the centre below the apex of the pad there in mm, more than 0. Default: 8.5.
    waist_half_width_mm, waist_half_height_mm
        Half axes at the waist in mm, more than 0. Default: 2.4 and 1.8.
    waist_z_mm
        Position of the waist along the finger in mm. Default: -3.
    tuft_half_width_mm, tuft_half_height_mm
        Half axes at the tuft in mm, more than 0. Default: 3.1 and 1.5.
    tuft_depth_mm
        Depth of the centre below the apex of the pad there in mm, more than 0. Default: 7.7.
    tuft_z_mm
        Position of the widest part of the tuft in mm. Default: 3.
    end_z_mm
        Position of the end of the bone in mm. Default: 5.
    """

    base_half_width_mm: float = 3.2
    base_half_height_mm: float = 2.2
    base_depth_mm: float = 8.5
    waist_half_width_mm: float = 2.4
    waist_half_height_mm: float = 1.8
    waist_z_mm: float = -3.0
    tuft_half_width_mm: float = 3.1
    tuft_half_height_mm: float = 1.5
    tuft_depth_mm: float = 7.7
    tuft_z_mm: float = 3.0
    end_z_mm: float = 5.0

    RANGES: ClassVar = {
        **dict.fromkeys(
            (
                "base_half_width_mm", "base_half_height_mm", "waist_half_width_mm",
                "waist_half_height_mm", "tuft_half_width_mm", "tuft_half_height_mm",
            ),
            (0.1, 50.0),
        ),
        "base_depth_mm": POSITIVE,
        "tuft_depth_mm": POSITIVE,
        **dict.fromkeys(("waist_z_mm", "tuft_z_mm", "end_z_mm"), (-50.0, 50.0)),
    }  # fmt: skip


@dataclass(frozen=True, slots=True)
class NailPlate(Ranged):
    """The nail plate: replaces the stratum corneum on the back of the tip.

    Its edge is the cut of the skin with a plane, so that it narrows towards the tip. Thickness
    and start as `decks.finger.Nail`; finger nails are about 0.5 mm thick.

    Parameters
    ----------
    thickness_mm
        Thickness in mm, 0.02 to 50. Default: 0.45.
    start_deg
        Angle in deg from the apex of the pad, at the centre of the section through the apex, at
        which the nail begins on both sides, 95 to 170. Default: 125.
    root_mm
        Distance of the nail's root behind the apex of the pad in mm, more than 0. Default: 5.
    """

    thickness_mm: float = 0.45
    start_deg: float = 125.0
    root_mm: float = 5.0

    RANGES: ClassVar = {
        "thickness_mm": (MIN_THICKNESS_MM, 50.0),
        "start_deg": (95.0, 170.0),
        "root_mm": POSITIVE,
    }


@dataclass(frozen=True, slots=True)
class AfferentDepth(Ranged):
    """Depth of the afferents of a class; the mesh has nodes there below the whole skin.

    Parameters
    ----------
    layer
        ``"epidermis"``, ``"dermis"`` or ``"subcutaneous_tissue"``.
    depth_mm
        Depth below the skin in mm, inside the layer.
    """

    layer: str
    depth_mm: float

    RANGES: ClassVar = {"layer": _SKIN_LAYERS, "depth_mm": NOT_NEGATIVE}


# Merkel cells are at the lower side of the epidermis. The Meissner corpuscle takes the stress of
# the epidermis at its side, as in `decks.finger`; without papillae both have one depth.
DEPTHS: dict[str, AfferentDepth] = {
    "SA": AfferentDepth("epidermis", 0.5),
    "RA": AfferentDepth("epidermis", 0.5),
    "PC": AfferentDepth("subcutaneous_tissue", 2.0),
}


@dataclass(frozen=True, slots=True)
class TipResolution(Ranged):
    """Resolution of the mesh: element widths along the skin, rows of elements, their order.

    Parameters
    ----------
    pad_mm
        Width of the elements on the pad in mm, 0.1 to 5. Default: 0.7.
    pad_radius_mm
        Distance from the apex in mm up to which they have that width. Default: 4.
    far_mm
        Width to which the elements grow farther away in mm, 0.1 to 10. Default: 2.5.
    dermis_rows
        Rows of elements across the dermis, 1 to 20. Default: 1.
    order
        2 for tetrahedra of ten nodes (C3D10), 1 for those of four (C3D4). Default: 2.5.
    """

    pad_mm: float = 0.7
    pad_radius_mm: float = 4.0
    far_mm: float = 2.5
    dermis_rows: int = 1
    order: int = 2

    RANGES: ClassVar = {
        "pad_mm": (0.1, 5.0),
        "pad_radius_mm": POSITIVE,
        "far_mm": (0.1, 10.0),
        "dermis_rows": (1, 20),
        "order": (1, 2),
    }


@dataclass(frozen=True, slots=True)
class Level:
    """A surface parallel to the skin, at `depth_mm`; the row of elements above it is of `layer`."""

    depth_mm: float
    layer: str


_PARTS: Mapping[str, type] = {
    "outline": TipOutline,
    "skin": Skin,
    "bone": Phalanx,
    "nail": NailPlate,
    "resolution": TipResolution,
}


@dataclass(frozen=True, slots=True)
class Fingertip:
    """A round fingertip: sizes, layers, bone, nail, materials, depths of its afferents.

    Parameters
    ----------
    name
        Name in decks and as a file name.
    outline
        `TipOutline` of the skin. Default: 16 mm wide, 13 mm high, a tip of 10 mm.
    skin
        `decks.finger.Skin`, thickness of the layers. Default: 0.25, 0.4 and 1.1 mm.
    bone
        `Phalanx`. Default: 6.4 mm wide at its base, 6.2 mm at the tuft.
    nail
        `NailPlate`. Default: 0.45 mm thick.
    resolution
        `TipResolution` of the mesh. Default: elements 0.7 mm wide on the pad.
    materials
        `decks.finger.Material` of each layer of `decks.finger.LAYERS`. Default: Table 1 of the
        paper.
    afferents
        `AfferentDepth` by the name of its class. Default: SA, RA and PC.

    Raises
    ------
    FingerError
        Parts that do not fit each other, such as a bone that reaches into the skin.

    Examples
    --------
    >>> from decks.fingertip import HUMAN
    >>> [level.depth_mm for level in HUMAN.levels()]
    [0.25, 0.5, 0.65, 1.75, 2.0]
    """

    name: str
    outline: TipOutline = field(default_factory=TipOutline)
    skin: Skin = field(default_factory=Skin)
    bone: Phalanx = field(default_factory=Phalanx)
    nail: NailPlate = field(default_factory=NailPlate)
    resolution: TipResolution = field(default_factory=TipResolution)
    materials: Mapping[str, Material] = field(default_factory=TABLE_1.copy)
    afferents: Mapping[str, AfferentDepth] = field(default_factory=DEPTHS.copy)

    def __post_init__(self) -> None:
        for name in ("materials", "afferents"):  # a copy that the caller cannot change
            object.__setattr__(self, name, dict(getattr(self, name)))
        for name, kind in _PARTS.items():
            if not isinstance(getattr(self, name), kind):
                raise FingerError(
                    argument=name,
                    found=getattr(self, name),
                    expected=f"an object of {kind.__name__}",
                )
        if misfit := next(_misfits(self), None):
            raise misfit

    def levels(self) -> list[Level]:
        """Lower sides of the rows of elements, from the skin inwards."""
        skin = self.skin
        levels = [Level(skin.stratum_corneum_mm, "stratum_corneum")]
        for layer, bottom_mm, rows in (
            ("epidermis", skin.epidermis_depth_mm, 1),
            ("dermis", skin.dermis_depth_mm, self.resolution.dermis_rows),
            ("subcutaneous_tissue", math.inf, 0),
        ):
            top_mm = levels[-1].depth_mm
            depths = {site.depth_mm for site in self.afferents.values() if site.layer == layer}
            if rows:
                depths |= {round(float(d), 9) for d in np.linspace(top_mm, bottom_mm, rows + 1)[1:]}
            levels += [Level(depth_mm, layer) for depth_mm in sorted(depths)]
        return levels

    def bone_axes_mm(self, z_mm: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Half width, half height and depth of the centre of the bone along the finger."""
        bone = self.bone
        base_z_mm = min(-self.outline.shaft_mm, bone.waist_z_mm - 1e-9)

        def blended(*values: float) -> FloatArray:
            step = np.zeros_like(z_mm)
            ends = (base_z_mm, bone.waist_z_mm, bone.tuft_z_mm)
            for k in (0, 1):
                share = np.clip((z_mm - ends[k]) / (ends[k + 1] - ends[k]), 0.0, 1.0)
                step += 0.5 * (1 - np.cos(np.pi * share)) * (values[k + 1] - values[k])
            return values[0] + step

        middle_mm = 0.5 * (bone.base_depth_mm + bone.tuft_depth_mm)
        return (
            blended(bone.base_half_width_mm, bone.waist_half_width_mm, bone.tuft_half_width_mm),
            blended(bone.base_half_height_mm, bone.waist_half_height_mm, bone.tuft_half_height_mm),
            blended(bone.base_depth_mm, middle_mm, bone.tuft_depth_mm),
        )

    def bone_mm(self, capsule: FloatArray) -> FloatArray:
        """Points of the bone in mm of those of a capsule of radius 1, ``(P, 3)``.

        The capsule is half a ball at ``z > 0`` and a cylinder from ``z = -bone_length`` to 0.
        """
        bone = self.bone
        x, y, z = capsule.T
        ahead_mm = bone.end_z_mm - bone.tuft_z_mm
        behind_mm = (bone.tuft_z_mm + self.outline.shaft_mm) / self.bone_length
        z_mm = bone.tuft_z_mm + np.where(z > 0, ahead_mm * z, behind_mm * z)
        half_width_mm, half_height_mm, depth_mm = self.bone_axes_mm(z_mm)
        return np.stack([x * half_width_mm, y * half_height_mm - depth_mm, z_mm], axis=-1)

    def skin_mm(self, capsule: FloatArray) -> FloatArray:
        """Points of the skin in mm of those of a capsule of radius 1, ``(P, 3)``.

        The capsule is half a ball at ``z > 0`` and a cylinder from ``z = -1`` to 0.
        """
        outline = self.outline
        x, y, z = capsule.T
        z_mm = np.where(z > 0, outline.tip_mm * z, outline.shaft_mm * z)
        height_mm = outline.half_height_mm
        return np.stack([outline.half_width_mm * x, height_mm * (y - 1), z_mm], axis=-1)

    def normal(self, skin_mm: FloatArray) -> FloatArray:
        """Outward normals of the skin at points of it, ``(P, 3)``."""
        outline = self.outline
        x, y, z = skin_mm.T
        normal = np.stack(
            [
                x / outline.half_width_mm**2,
                (y + outline.half_height_mm) / outline.half_height_mm**2,
                np.maximum(z, 0.0) / outline.tip_mm**2,
            ],
            axis=-1,
        )
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        return normal

    @property
    def bone_length(self) -> float:
        """Length of the bone up to the tuft over its half width at the base."""
        return (self.bone.tuft_z_mm + self.outline.shaft_mm) / self.bone.base_half_width_mm

    @property
    def nail_height(self) -> float:
        """Height of the nail's edge over the centre, as a share of the half height, below 0."""
        angle = math.radians(self.nail.start_deg)
        across = math.sin(angle) / self.outline.half_width_mm
        along = math.cos(angle) / self.outline.half_height_mm
        return along / math.hypot(across, along)


def _misfits(tip: Fingertip) -> Iterator[FingerError]:
    """Errors of parts that do not fit each other: the entry, its value and its limit."""
    missing = [layer for layer in LAYERS if layer not in tip.materials]
    if missing:
        yield FingerError(f"has no material for {', '.join(missing)}", argument="materials")
    if relaxing := [layer for layer in tip.materials if tip.materials[layer].prony]:
        yield FingerError(
            argument=f"materials.{relaxing[0]}.prony",
            found=len(tip.materials[relaxing[0]].prony),
            expected="none: a fingertip is elastic",
        )
    skin, outline, bone, mesh = tip.skin, tip.outline, tip.bone, tip.resolution
    if not tip.afferents:
        yield FingerError("has no afferent, so there is no result", argument="afferents")
    bottoms = (skin.stratum_corneum_mm, skin.epidermis_depth_mm, skin.dermis_depth_mm, math.inf)
    for name, site in tip.afferents.items():
        if not (isinstance(name, str) and AFFERENT_NAME.fullmatch(name)):
            expected = "a capital letter, then capital letters, digits or _, at most 40 in all"
            yield FingerError(argument="afferents", found=name, expected=expected)
        layer = _SKIN_LAYERS.index(site.layer)
        least_mm, most_mm = (bottoms[layer] + MIN_THICKNESS_MM, bottoms[layer + 1])
        most_mm -= MIN_THICKNESS_MM
        if not least_mm <= site.depth_mm <= most_mm:
            yield FingerError(
                argument=f"afferents.{name}.depth_mm",
                found=site.depth_mm,
                expected=f"{least_mm:g} to {most_mm:g}, inside the layer",
            )
    levels = tip.levels()
    for before, level in pairwise(levels):
        if level.depth_mm - before.depth_mm < 0.999 * MIN_THICKNESS_MM:
            yield FingerError(
                f"makes a row of elements {level.depth_mm - before.depth_mm:g} mm thick, expected "
                f"{MIN_THICKNESS_MM:g} mm or more",
                argument="afferents",
                found=level.depth_mm - before.depth_mm,
                expected=f"{MIN_THICKNESS_MM:g} mm or more",
            )
    wall_mm = levels[-1].depth_mm + _BONE_GAP_MM
    axes = sorted((outline.half_width_mm, outline.half_height_mm, outline.tip_mm))
    for key, size_mm, limit_mm, limit in (
        ("nail.thickness_mm", tip.nail.thickness_mm, skin.epidermis_depth_mm - MIN_THICKNESS_MM,
         "corneum and epidermis"),
        ("nail.root_mm", tip.nail.root_mm, outline.shaft_mm - mesh.pad_mm, "outline.shaft_mm"),
        ("skin", levels[-1].depth_mm, axes[0] ** 2 / axes[2],
         "the outline's smallest radius of curvature"),
        ("resolution.pad_mm", mesh.pad_mm, mesh.far_mm, "far_mm"),
        ("bone.waist_z_mm", -bone.waist_z_mm, outline.shaft_mm, "outline.shaft_mm behind the apex"),
        ("bone.waist_z_mm", bone.waist_z_mm, bone.tuft_z_mm - 0.1, "tuft_z_mm"),
        ("bone.tuft_z_mm", bone.tuft_z_mm, bone.end_z_mm - 0.1, "end_z_mm"),
    ):  # fmt: skip
        if size_mm > limit_mm:
            expected = f"at most {limit_mm:.3g} mm: {limit}"
            yield FingerError(argument=key, found=size_mm, expected=expected)
    # Points of the bone, in an ellipsoid whose axes are shorter by the wall.
    turn, along = np.meshgrid(np.linspace(0, 2 * np.pi, 73), np.linspace(-tip.bone_length, 1, 161))
    radius = np.sqrt(1 - np.maximum(along, 0.0) ** 2)
    capsule = np.stack([radius * np.sin(turn), radius * np.cos(turn), along], axis=-1)
    x, y, z = tip.bone_mm(capsule.reshape(-1, 3)).T
    inside = (
        (x / (outline.half_width_mm - wall_mm)) ** 2
        + ((y + outline.half_height_mm) / (outline.half_height_mm - wall_mm)) ** 2
        + (np.maximum(z, 0.0) / (outline.tip_mm - wall_mm)) ** 2
    )
    if inside.max() > 1.0:
        row = int(inside.argmax())
        yield FingerError(
            f"reaches into the layers of the skin at x = {abs(x[row]):.2f}, depth {-y[row]:.2f}, "
            f"z = {z[row]:.2f} mm, expected {wall_mm:.3g} mm of tissue around it",
            argument="bone",
            expected=f"{wall_mm:.3g} mm of tissue around it",
        )


HUMAN = Fingertip("fingertip")
# Widths of Dandekar et al. 2003: a macaque's fingertip has about 0.55 of the human width; all
# other sizes but those of the skin are scaled with it.
_MACAQUE = 0.55
MACAQUE = Fingertip(
    "fingertip_macaque",
    outline=TipOutline(4.4, 3.6, 5.5, 5.0),
    skin=Skin(stratum_corneum_mm=0.12, epidermis_mm=0.22, dermis_mm=0.55),
    bone=Phalanx(
        base_half_width_mm=1.75,
        base_half_height_mm=1.15,
        base_depth_mm=4.7,
        waist_half_width_mm=1.3,
        waist_half_height_mm=1.0,
        waist_z_mm=-1.7,
        tuft_half_width_mm=1.6,
        tuft_half_height_mm=0.8,
        tuft_depth_mm=4.2,
        tuft_z_mm=1.6,
        end_z_mm=2.8,
    ),
    nail=NailPlate(thickness_mm=0.22, root_mm=2.8),
    resolution=TipResolution(pad_mm=0.38, pad_radius_mm=2.2, far_mm=1.4),
    afferents={
        "SA": AfferentDepth("epidermis", 0.26),
        "RA": AfferentDepth("epidermis", 0.26),
        "PC": AfferentDepth("subcutaneous_tissue", 1.05),
    },
)
TIPS = {tip.name: tip for tip in (HUMAN, MACAQUE)}


def read_fingertip(preset_or_path: str) -> Fingertip:
    """A preset by its name, or the fingertip that a TOML file describes.

    Raises
    ------
    UsageError
        No such preset or file.
    FingerError
        Not TOML, an unknown key (near ones are named), or a value that cannot be.
    """
    return preset_or_file(preset_or_path, TIPS, fingertip_from)


def is_fingertip(preset_or_path: str) -> bool:
    """Whether this is a preset of a fingertip, or a TOML file with one as its base."""
    if preset_or_path in TIPS:
        return True
    path = Path(preset_or_path)
    if not (path.suffix == ".toml" and is_file(path)):
        return False
    return _base_of(read_toml(path, FingerError)) in TIPS


def _base_of(table: Mapping[str, Any]) -> str:
    base = table.get("base")
    return base if isinstance(base, str) else ""


def fingertip_from(table: Mapping[str, Any], name: str) -> Fingertip:
    """The fingertip of a TOML table; `name` is used where the table has none."""
    base = _base_of(table)
    if base not in TIPS:
        raise FingerError(key="base", found=table.get("base"), expected=f"one of {', '.join(TIPS)}")
    overrides = {key: value for key, value in table.items() if key != "base"}
    return with_changes(replace(TIPS[base], name=name), overrides, {"materials": LAYERS})
