"""A finger in cross-section: sizes, layers, materials, and positions of its afferents.

Values are checked when they are made: each number against its range, the parts of a
finger against each other.

The section is symmetric about ``x = 0``. The origin is the outermost point of the skin on
the pad, the top of the middle ridge; ``y`` points out of the pad, so that depth is ``-y``.
All lengths are in mm and all moduli in MPa, the units of the decks.

The materials of Table 1 of the paper are elastic. Two further entries make stress depend on
time: Prony terms, with which a layer relaxes, and the density, which is used if inertia is
requested. Neither is in the paper; both are set by the user.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

from fembridge.errors import FembridgeError, FingerError
from fembridge.trace import AFFERENT_NAME

# In thinner layers the elements are too flat for a solver.
MIN_THICKNESS_MM = 0.02

# Gap between the dermis and the bone: room for a row of elements.
_BONE_GAP_MM = 0.3

LAYERS = ("stratum_corneum", "epidermis", "dermis", "subcutaneous_tissue", "bone", "nail")

NOT_NEGATIVE = (0.0, math.inf)
POSITIVE = (math.ulp(0.0), math.inf)
FINITE = (-math.inf, math.inf)
_RANGE_TEXT = {NOT_NEGATIVE: ">= 0", POSITIVE: "> 0"}
_MAX_PRONY_TERMS = 5  # Prony terms of a material
_MAX_TAU_S = 10.0


@dataclass(frozen=True, slots=True)
class Ranged:
    """A value whose fields are checked against `RANGES`.

    A range is either a pair of finite numbers, ends included, or a tuple of allowed strings.

    Raises
    ------
    FingerError
        A field is out of range; a subclass may set another type as `ERROR`. The message
        names the field, its range and its value.
    """

    RANGES: ClassVar[Mapping[str, tuple[Any, ...]]] = {}
    ERROR: ClassVar[type[FembridgeError]] = FingerError

    def __post_init__(self) -> None:
        for name, allowed in self.RANGES.items():
            value = getattr(self, name)
            if isinstance(allowed[0], str):
                if value not in allowed:
                    expected = f"expected one of {', '.join(allowed)}"
                    raise self.ERROR(f"{name} {value!r}, {expected}")
                continue
            lower, upper = allowed
            if not math.isfinite(value):
                raise self.ERROR(f"{name} must be finite, got {value}")
            if not lower <= value <= upper:
                range_text = _RANGE_TEXT.get((lower, upper), f"{lower:g} to {upper:g}")
                raise self.ERROR(f"{name} must be {range_text}, got {value:g}")


@dataclass(frozen=True, slots=True)
class Outline(Ranged):
    """An ellipse: a human index fingertip is about 16 mm wide and 13 mm high.

    Source: the sections of Dandekar, Raju & Srinivasan 2003, J. Biomech. Eng.
    125:682, rounded.
    """

    half_width_mm: float = 8.0
    half_height_mm: float = 6.5

    RANGES: ClassVar = {"half_width_mm": (2.0, 50.0), "half_height_mm": (2.0, 50.0)}


@dataclass(frozen=True, slots=True)
class Skin(Ranged):
    """Thickness of the layers of the skin on the pad, measured from the ridge tops.

    Stratum corneum about 0.3 mm: optical coherence tomography of a finger pad,
    Adams et al. 2013, J. R. Soc. Interface 10:20120467, Fig. 1. Epidermis and
    dermis: our choice, since the paper gives no numbers; within the range of the models
    that the paper follows (its refs. 14, 17, 25, 29).
    """

    stratum_corneum_mm: float = 0.25
    epidermis_mm: float = 0.40
    dermis_mm: float = 1.10

    RANGES: ClassVar = dict.fromkeys(
        ("stratum_corneum_mm", "epidermis_mm", "dermis_mm"), (MIN_THICKNESS_MM, 50.0)
    )

    @property
    def epidermis_depth_mm(self) -> float:
        """Depth of the mean epidermis–dermis boundary."""
        return self.stratum_corneum_mm + self.epidermis_mm

    @property
    def dermis_depth_mm(self) -> float:
        """Depth of the boundary between dermis and subcutaneous tissue."""
        return self.epidermis_depth_mm + self.dermis_mm


@dataclass(frozen=True, slots=True)
class Ridges(Ranged):
    """Fingerprint ridges: a cosine on the pad that fades out over the last ridge.

    About 0.5 mm apart and 0.1 mm high: Adams et al. 2013, Fig. 1; Maeno,
    Kobayashi & Yamazaki 1998, JSME Int. J. C 41:94.
    """

    spacing_mm: float = 0.5
    height_mm: float = 0.1
    half_width_mm: float = 3.0

    RANGES: ClassVar = {
        "spacing_mm": POSITIVE,
        "half_width_mm": POSITIVE,
        "height_mm": NOT_NEGATIVE,
    }


@dataclass(frozen=True, slots=True)
class Papillae(Ranged):
    """Dermal papillae: two under each ridge, with an intermediate ridge between them.

    The epidermis is deepest under the middle of a ridge; the tips of the papillae are a
    quarter of the ridge spacing to each side. Arrangement: Maeno et al. 1998; the height is
    our choice, within their histology.
    """

    height_mm: float = 0.1

    RANGES: ClassVar = {"height_mm": NOT_NEGATIVE}


@dataclass(frozen=True, slots=True)
class Bone(Ranged):
    """The distal phalanx: an ellipse whose centre lies `depth_mm` below the pad."""

    half_width_mm: float = 3.2
    half_height_mm: float = 2.2
    depth_mm: float = 8.5

    RANGES: ClassVar = {
        "half_width_mm": (0.1, 50.0),
        "half_height_mm": (0.1, 50.0),
        "depth_mm": POSITIVE,
    }


@dataclass(frozen=True, slots=True)
class Nail(Ranged):
    """The nail plate: replaces the stratum corneum on the back of the finger.

    The nail begins on both sides at the angle `start_deg` from the apex of the pad, measured
    at the centre of the section.
    """

    thickness_mm: float = 0.45
    start_deg: float = 125.0

    RANGES: ClassVar = {"thickness_mm": (MIN_THICKNESS_MM, 50.0), "start_deg": (95.0, 170.0)}


@dataclass(frozen=True, slots=True)
class PronyTerm(Ranged):
    """A share `g` of the shear modulus that relaxes with time constant `tau_s`.

    ``G(t) = G0 (1 - sum g (1 - exp(-t/tau)))``, as in Abaqus; the bulk modulus does not
    relax.
    """

    g: float
    tau_s: float

    RANGES: ClassVar = {"g": POSITIVE, "tau_s": (1e-4, _MAX_TAU_S)}


@dataclass(frozen=True, slots=True)
class Material(Ranged):
    """A linear elastic, isotropic material; with `prony` terms, the instantaneous moduli.

    `density_kg_m3` is used if inertia is requested; 1109 is the density of skin (IT'IS
    Foundation, tissue properties database 4.1).
    """

    young_mpa: float
    poisson: float
    prony: tuple[PronyTerm, ...] = ()
    density_kg_m3: float = 1109.0

    RANGES: ClassVar = {
        "young_mpa": (1e-6, 1e9),
        "poisson": NOT_NEGATIVE,
        "density_kg_m3": (1.0, 1e5),
    }

    def __post_init__(self) -> None:
        Ranged.__post_init__(self)
        if not self.poisson < 0.5:
            raise FingerError(f"poisson must be in [0, 0.5), got {self.poisson}")
        object.__setattr__(self, "prony", tuple(self.prony))
        if len(self.prony) > _MAX_PRONY_TERMS:
            raise FingerError(f"{len(self.prony)} Prony terms, expected at most {_MAX_PRONY_TERMS}")
        if self.prony and not self.lasting_share > 0:
            raise FingerError("Prony terms take all of the shear modulus, expected less")

    @property
    def lasting_share(self) -> float:
        """Share of the shear modulus that does not relax."""
        return 1.0 - sum(term.g for term in self.prony)

    @property
    def shear_mpa(self) -> float:
        """Instantaneous shear modulus."""
        return self.young_mpa / (2 * (1 + self.poisson))

    @property
    def bulk_mpa(self) -> float:
        """Bulk modulus."""
        return self.young_mpa / (3 * (1 - 2 * self.poisson))


# Ishizuka et al., Table 1. Densities: IT'IS Foundation 4.1 (skin; subcutaneous fat;
# cortical bone); nail: keratin, rounded.
TABLE_1: dict[str, Material] = {
    "stratum_corneum": Material(2.0, 0.30),
    "epidermis": Material(2.0, 0.30),
    "dermis": Material(0.050, 0.48),
    "subcutaneous_tissue": Material(0.024, 0.40, density_kg_m3=911.0),
    "bone": Material(1.7e4, 0.30, density_kg_m3=1908.0),
    "nail": Material(1.7e2, 0.30, density_kg_m3=1300.0),
}


@dataclass(frozen=True, slots=True)
class AfferentSite(Ranged):
    """The position of an afferent, which is read at the nearest node inside `layer`.

    All elements of that node belong to `layer`: a solver averages nodal stress over all
    elements at a node, whatever their material, and the mean over a stiff and a soft layer
    is the stress of neither.
    """

    layer: str
    x_mm: float
    depth_mm: float

    RANGES: ClassVar = {"layer": LAYERS, "x_mm": FINITE, "depth_mm": NOT_NEGATIVE}


# Merkel cells sit at the tip of the intermediate ridge. The Meissner corpuscle is attached by
# fibrils to the epidermis at the tip of a papilla and so takes the stress of the epidermis
# there. Pacinian corpuscles lie in the subcutaneous tissue.
SITES: dict[str, AfferentSite] = {
    "SA": AfferentSite("epidermis", 0.0, 0.5875),
    "RA": AfferentSite("epidermis", 0.125, 0.52),
    "PC": AfferentSite("subcutaneous_tissue", 0.0, 2.0),
}


@dataclass(frozen=True, slots=True)
class Resolution(Ranged):
    """Resolution of the mesh: element widths along the skin, element rows across layers.

    Columns are `contact_mm` wide within `contact_half_width_mm` of the apex and `ridge_mm`
    wide on the other ridges; farther out they grow to `far_mm`.
    """

    contact_mm: float = 1 / 24
    contact_half_width_mm: float = 0.5
    ridge_mm: float = 0.125
    far_mm: float = 0.525
    stratum_corneum_rows: int = 2
    epidermis_rows: int = 8
    dermis_rows: int = 6

    RANGES: ClassVar = {
        **dict.fromkeys(("contact_mm", "ridge_mm", "far_mm"), (0.005, 2.0)),
        "contact_half_width_mm": POSITIVE,
        **dict.fromkeys(("stratum_corneum_rows", "epidermis_rows", "dermis_rows"), (1, 200)),
    }


@dataclass(frozen=True, slots=True)
class Finger:
    """A finger; `name` is the name of the preset or of the file that changes one."""

    name: str
    outline: Outline = field(default_factory=Outline)
    skin: Skin = field(default_factory=Skin)
    ridges: Ridges = field(default_factory=Ridges)
    papillae: Papillae = field(default_factory=Papillae)
    bone: Bone = field(default_factory=Bone)
    nail: Nail = field(default_factory=Nail)
    resolution: Resolution = field(default_factory=Resolution)
    materials: Mapping[str, Material] = field(default_factory=TABLE_1.copy)
    afferents: Mapping[str, AfferentSite] = field(default_factory=SITES.copy)

    def __post_init__(self) -> None:
        for name in ("materials", "afferents"):  # a copy that the caller cannot change
            object.__setattr__(self, name, dict(getattr(self, name)))
        if misfit := next(_misfits(self), None):
            raise FingerError(misfit)

    @property
    def relaxing_s(self) -> float:
        """Longest time constant of its materials, 0 if none relaxes."""
        terms = [term for material in self.materials.values() for term in material.prony]
        return max((term.tau_s for term in terms), default=0.0)

    def at_once(self) -> "Finger":
        """The finger without relaxation, with its instantaneous moduli."""
        if not self.relaxing_s:
            return self
        elastic = {layer: replace(material, prony=()) for layer, material in self.materials.items()}
        return replace(self, materials=elastic)


def _misfits(finger: Finger) -> Iterator[str]:
    """Messages for parts that do not fit each other: the entry, its value and its limit."""
    skin, ridges, papillae = finger.skin, finger.ridges, finger.papillae
    outline, bone, mesh = finger.outline, finger.bone, finger.resolution
    missing = [layer for layer in LAYERS if layer not in finger.materials]
    if missing:
        yield f"no material for {', '.join(missing)}"
    relief_mm = max(papillae.height_mm, 0.5 * (papillae.height_mm + ridges.height_mm))
    relief_entry = "papillae.height_mm, with the ridges,"
    to_dermis_mm = skin.epidermis_depth_mm
    # The curvature of an ellipse is largest at the end of its long axis.
    short, long = sorted((outline.half_width_mm, outline.half_height_mm))
    curvature_limit = "the outline's smallest radius of curvature"
    # Skin and gap are subtracted from both half axes of the outline. This ellipse is within a
    # few hundredths of a mm of the curve at that depth.
    wall_mm = skin.dermis_depth_mm + _BONE_GAP_MM
    top_mm, bottom_mm = bone.depth_mm - bone.half_height_mm, bone.depth_mm + bone.half_height_mm
    lowest_mm = 2 * outline.half_height_mm - wall_mm
    widest_mm, widest_entry = max(mesh.contact_mm, mesh.ridge_mm), "contact_mm or ridge_mm"
    half_mm = ridges.half_width_mm
    flat = ridges.height_mm == 0 == papillae.height_mm
    column_mm = math.inf if flat else (0.25 + 1e-9) * ridges.spacing_mm
    for entry, size_mm, expected, limit_mm, limit in (
        ("ridges.height_mm", ridges.height_mm, "<", skin.stratum_corneum_mm, "the stratum corneum"),
        ("nail.thickness_mm", finger.nail.thickness_mm, "<", to_dermis_mm, "corneum and epidermis"),
        (relief_entry, relief_mm, "<", skin.epidermis_mm, "the epidermis"),
        ("papillae.height_mm", papillae.height_mm, "<", 2 * skin.dermis_mm, "twice the dermis"),
        ("skin", skin.dermis_depth_mm, "<", short**2 / long, curvature_limit),
        ("ridges.spacing_mm", ridges.spacing_mm, "<=", half_mm, "one ridge on half the pad"),
        ("ridges.half_width_mm", half_mm, "<=", outline.half_width_mm, "half the outline"),
        (widest_entry, widest_mm, "<=", mesh.far_mm, "far_mm"),
        ("contact_mm", mesh.contact_mm, "<=", mesh.contact_half_width_mm, "contact_half_width_mm"),
        (widest_entry, widest_mm, "<=", column_mm, "four columns to a ridge"),
        ("skin, with a gap,", wall_mm, "<=", top_mm, "the bone's side to the pad"),
        ("the bone's other side", bottom_mm, "<=", lowest_mm, "it touches the skin"),
    ):
        if size_mm > limit_mm or (expected == "<" and size_mm == limit_mm):
            comparison = {"<": "less than", "<=": "at most"}[expected]
            yield f"{entry} is {size_mm:g} mm, expected {comparison} {limit_mm:.3g} mm: {limit}"
    room_mm = _room_for_bone_mm(finger, wall_mm)
    if bone.half_width_mm > room_mm:
        yield (
            f"bone.half_width_mm is {bone.half_width_mm:g} mm, expected at most {room_mm:.3g} mm: "
            "it touches the skin"
        )
    if not finger.afferents:
        yield "a finger without afferents has no result"
    for name, site in finger.afferents.items():
        if not (isinstance(name, str) and AFFERENT_NAME.fullmatch(name)):
            yield (
                f"afferent {name!r}: expected a capital letter, then capital letters, digits or "
                "_, at most 40 in all"
            )
        across = site.x_mm / outline.half_width_mm
        along = site.depth_mm / outline.half_height_mm - 1
        if not across * across + along * along <= 1:
            yield (
                f"afferent {name} at x = {site.x_mm:g} mm, depth {site.depth_mm:g} mm is outside "
                "the finger"
            )


def _room_for_bone_mm(finger: Finger, wall_mm: float) -> float:
    """Half width of the widest bone of this height and depth inside a wall of `wall_mm`."""
    outline, bone = finger.outline, finger.bone
    width_mm, height_mm = outline.half_width_mm - wall_mm, outline.half_height_mm - wall_mm
    offset_mm = bone.depth_mm - outline.half_height_mm  # > 0: towards the back
    room_mm = width_mm
    for step in range(1, 200):
        share = step / 100 - 1  # height on the bone, -1 to 1, as a share of its half height
        height = (offset_mm + share * bone.half_height_mm) / height_mm
        room_mm = min(room_mm, width_mm * ((1 - height**2) / (1 - share**2)) ** 0.5)
    return room_mm
