"""A finger in cross-section: sizes, layers, materials, and positions of its afferents.

Values are checked when they are made: each number against its range, the parts of a
finger against each other.

The section is symmetric about ``x = 0``. The origin is the outermost point of the skin on
the pad, the top of the middle ridge; ``y`` points out of the pad, so that depth is ``-y``.
All lengths are in mm and all moduli in MPa, the units of the decks.

The materials of Table 1 of the paper are isotropic and elastic. Further entries, set by the
user, are not in the paper: a hyperelastic law, the axes of an anisotropic layer, Prony terms,
with which a layer relaxes, and the density, which is used if inertia is requested.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from numbers import Real
from typing import Any, ClassVar

import numpy as np

from fembridge.errors import FembridgeError, FingerError
from fembridge.trace import AFFERENT_NAME

# In thinner layers the elements are too flat for a solver.
MIN_THICKNESS_MM = 0.02

# Gap between the dermis and the bone: room for a row of elements.
_BONE_GAP_MM = 0.3

LAYERS = ("stratum_corneum", "epidermis", "dermis", "subcutaneous_tissue", "bone", "nail")
# Layers that follow the outline, so that a direction normal to the skin is defined in them.
SKIN_LAYERS = ("stratum_corneum", "epidermis", "dermis")
# Laws of a material at large strain; at small strain all of them are Hooke's law.
LAWS = ("linear", "neo-hookean", "mooney-rivlin", "ogden")

NOT_NEGATIVE = (0.0, math.inf)
POSITIVE = (math.ulp(0.0), math.inf)
FINITE = (-math.inf, math.inf)
_RANGE_TEXT = {NOT_NEGATIVE: "0 or more", POSITIVE: "more than 0"}
_MAX_PRONY_TERMS = 5  # Prony terms of a material
_MAX_TAU_S = 10.0
_MAX_OGDEN_TERMS = 3
_MODULUS_MPA = (1e-6, 1e9)
_SUM_TOLERANCE = 1e-6  # of the shares of Ogden terms


@dataclass(frozen=True, slots=True)
class Ranged:
    """A value whose fields are checked against `RANGES`.

    A range is either a pair of finite numbers, ends included, or a tuple of allowed strings.

    Raises
    ------
    FingerError
        A field is out of range; a subclass may set another type as `ERROR`. `argument` is the
        field, `found` its value and `expected` its range.
    """

    RANGES: ClassVar[Mapping[str, tuple[Any, ...]]] = {}
    ERROR: ClassVar[type[FembridgeError]] = FingerError

    def __post_init__(self) -> None:
        for name, allowed in self.RANGES.items():
            value = getattr(self, name)
            if isinstance(allowed[0], str):
                if value not in allowed:
                    expected = f"one of {', '.join(allowed)}"
                    raise self.ERROR(argument=name, found=value, expected=expected)
                continue
            if not (isinstance(value, Real) and math.isfinite(value)):
                raise self.ERROR(argument=name, found=value, expected="a finite number")
            lower, upper = allowed
            if not math.isfinite(value):
                raise self.ERROR(argument=name, found=value, expected="a finite number")
            if not lower <= value <= upper:
                expected = _RANGE_TEXT.get((lower, upper), f"{lower:g} to {upper:g}")
                raise self.ERROR(argument=name, found=value, expected=expected)


@dataclass(frozen=True, slots=True)
class Outline(Ranged):
    """Outline of the skin, an ellipse: a human index fingertip is about 16 mm wide and 13 mm high.

    Source: the sections of Dandekar, Raju & Srinivasan 2003, J. Biomech. Eng.
    125:682, rounded.

    Parameters
    ----------
    half_width_mm
        Half axis across the finger in mm, 2 to 50. Default: 8.
    half_height_mm
        Half axis from pad to nail in mm, 2 to 50. Default: 6.5.
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

    Parameters
    ----------
    stratum_corneum_mm
        Thickness of the stratum corneum in mm, 0.02 to 50. Default: 0.25.
    epidermis_mm
        Mean thickness of the epidermis in mm, 0.02 to 50. Default: 0.4.
    dermis_mm
        Mean thickness of the dermis in mm, 0.02 to 50. Default: 1.1.
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

    Parameters
    ----------
    spacing_mm
        Distance of two ridges in mm, more than 0. Default: 0.5.
    height_mm
        Height of a ridge above its grooves in mm, 0 or more. Default: 0.1.
    half_width_mm
        Distance in mm from the middle of the pad to the last ridge. Default: 3.
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

    Parameters
    ----------
    height_mm
        Height of a papilla in mm, 0 or more. Default: 0.1.
    """

    height_mm: float = 0.1

    RANGES: ClassVar = {"height_mm": NOT_NEGATIVE}


@dataclass(frozen=True, slots=True)
class Bone(Ranged):
    """The distal phalanx, an ellipse.

    Parameters
    ----------
    half_width_mm
        Half axis across the finger in mm, 0.1 to 50. Default: 3.2.
    half_height_mm
        Half axis from pad to nail in mm, 0.1 to 50. Default: 2.2.
    depth_mm
        Depth of the centre below the pad in mm, more than 0. Default: 8.5.
    """

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

    Parameters
    ----------
    thickness_mm
        Thickness in mm, 0.02 to 50. Default: 0.45.
    start_deg
        Angle in deg from the apex of the pad, at the centre of the section, at which the nail
        begins on both sides, 95 to 170. Default: 125.
    """

    thickness_mm: float = 0.45
    start_deg: float = 125.0

    RANGES: ClassVar = {"thickness_mm": (MIN_THICKNESS_MM, 50.0), "start_deg": (95.0, 170.0)}


@dataclass(frozen=True, slots=True)
class PronyTerm(Ranged):
    """A share of the shear modulus that relaxes with one time constant.

    ``G(t) = G0 (1 - sum g (1 - exp(-t/tau)))``, as in Abaqus; the bulk modulus does not
    relax.

    Parameters
    ----------
    g
        Share of the instantaneous shear modulus, more than 0. All terms of a material have a
        sum below 1.
    tau_s
        Time constant in s, 1e-4 to 10.
    """

    g: float
    tau_s: float

    RANGES: ClassVar = {"g": POSITIVE, "tau_s": (1e-4, _MAX_TAU_S)}


@dataclass(frozen=True, slots=True)
class OgdenTerm(Ranged):
    """A term of Ogden's law: ``2 mu / alpha^2 (l1^alpha + l2^alpha + l3^alpha - 3)``.

    ``mu`` is `share` times the shear modulus of the material at rest, and ``l`` are the
    stretches without their change of volume, as in Abaqus and CalculiX.

    Parameters
    ----------
    share
        Share of the shear modulus, more than 0. All terms of a material have the sum 1.
    alpha
        Exponent, -50 to 50, not 0. 2 is the neo-Hookean law.
    """

    share: float
    alpha: float

    RANGES: ClassVar = {"share": POSITIVE, "alpha": (-50.0, 50.0)}

    def __post_init__(self) -> None:
        Ranged.__post_init__(self)
        if not self.alpha:
            raise FingerError(argument="alpha", found=self.alpha, expected="-50 to 50, not 0")


@dataclass(frozen=True, slots=True)
class Anisotropy(Ranged):
    """Stiffness of a layer of the skin that differs between its directions.

    The three directions are across the finger along the skin, normal to the skin, and along
    the finger. `Material.young_mpa` is the modulus across the finger and `Material.poisson` the
    contraction along the finger when the layer is pulled across it. Without the last four
    values the layer is isotropic in its own plane (transversely isotropic); with them it is
    orthotropic.

    Parameters
    ----------
    young_normal_mpa
        Young's modulus normal to the skin in MPa, 1e-6 to 1e9.
    poisson_normal
        Contraction normal to the skin when the layer is pulled across the finger, as a share
        of the strain, 0 to 10.
    shear_normal_mpa
        Shear modulus between the normal and the direction across the finger, 1e-6 to 1e9 MPa.
    young_along_mpa
        Young's modulus along the finger in MPa. Default: None, as across.
    poisson_along_normal
        Contraction normal to the skin when the layer is pulled along the finger. Default:
        None, as across.
    shear_along_normal_mpa
        Shear modulus between the normal and the direction along the finger. Default: None, as
        across.
    shear_plane_mpa
        Shear modulus in the plane of the skin in MPa. Default: None,
        ``young_mpa / (2 (1 + poisson))``.
    """

    young_normal_mpa: float
    poisson_normal: float
    shear_normal_mpa: float
    young_along_mpa: float | None = None
    poisson_along_normal: float | None = None
    shear_along_normal_mpa: float | None = None
    shear_plane_mpa: float | None = None

    def __post_init__(self) -> None:
        for item in fields(self):
            value, is_ratio = getattr(self, item.name), item.name.startswith("poisson")
            lower, upper = (0.0, 10.0) if is_ratio else _MODULUS_MPA
            if value is None and item.default is None:
                continue
            if not (isinstance(value, Real) and lower <= float(value) <= upper):
                expected = f"{lower:g} to {upper:g}"
                raise FingerError(argument=item.name, found=value, expected=expected)


@dataclass(frozen=True, slots=True)
class Material(Ranged):
    """An elastic material, which may be hyperelastic, relax, or be anisotropic.

    Parameters
    ----------
    young_mpa
        Young's modulus in MPa at rest, 1e-6 to 1e9; of a relaxing material the instantaneous
        one.
    poisson
        Poisson's ratio at rest, from 0 to below 0.5.
    prony
        Up to five `PronyTerm`. Default: none, the material does not relax.
    density_kg_m3
        Density in kg/m³, 1 to 1e5, used if inertia is requested. Default: 1109, skin (IT'IS
        Foundation, tissue properties database 4.1).
    law
        ``"linear"``, ``"neo-hookean"``, ``"mooney-rivlin"`` or ``"ogden"``. All have the
        stiffness of `young_mpa` and `poisson` at rest. Default: None, the law of the analysis.
    c01_share
        Of the Mooney-Rivlin law: C01 as a share of C10 + C01, 0 to 1. Default: 0.
    ogden
        Of Ogden's law: one to three `OgdenTerm`. Default: none.
    anisotropy
        `Anisotropy` of a linear layer of the skin that does not relax. Default: None, isotropic.
    """

    young_mpa: float
    poisson: float
    prony: tuple[PronyTerm, ...] = ()
    density_kg_m3: float = 1109.0
    law: str | None = None
    c01_share: float = 0.0
    ogden: tuple[OgdenTerm, ...] = ()
    anisotropy: Anisotropy | None = None

    RANGES: ClassVar = {
        "young_mpa": _MODULUS_MPA,
        "poisson": NOT_NEGATIVE,
        "density_kg_m3": (1.0, 1e5),
        "c01_share": (0.0, 1.0),
    }

    def __post_init__(self) -> None:
        Ranged.__post_init__(self)
        if not self.poisson < 0.5:
            raise FingerError(
                argument="poisson", found=self.poisson, expected="0 or more, below 0.5"
            )
        self._set_terms("prony", PronyTerm, _MAX_PRONY_TERMS, "PronyTerm(g, tau_s)")
        self._set_terms("ogden", OgdenTerm, _MAX_OGDEN_TERMS, "OgdenTerm(share, alpha)")
        if self.prony and not self.lasting_share > 0:
            raise FingerError("takes all of the shear modulus, expected less", argument="prony")
        self._check_law()
        if self.anisotropy is not None:
            self._check_anisotropy()

    def _set_terms(self, name: str, kind: type, most: int, example: str) -> None:
        terms = tuple(getattr(self, name))
        object.__setattr__(self, name, terms)
        for term in terms:
            if not isinstance(term, kind):
                raise FingerError(argument=name, found=term, expected=example)
        if len(terms) > most:
            expected = f"at most {most} terms"
            raise FingerError(
                f"has {len(terms)} terms, expected {expected}",
                argument=name,
                found=len(terms),
                expected=expected,
            )

    def _check_law(self) -> None:
        if self.law is not None and self.law not in LAWS:
            expected = f"one of {', '.join(LAWS)}"
            raise FingerError(argument="law", found=self.law, expected=expected)
        for name, law in (("c01_share", "mooney-rivlin"), ("ogden", "ogden")):
            if getattr(self, name) and self.law != law:
                problem = f"is for the law {law}, but the law is {self.law or 'not set'}"
                raise FingerError(problem, argument=name, found=self.law, expected=law)
        if self.law == "ogden":
            total = sum(term.share for term in self.ogden)
            if abs(total - 1) > _SUM_TOLERANCE:
                expected = "terms whose shares have the sum 1"
                raise FingerError(argument="ogden", found=total, expected=expected)

    def _check_anisotropy(self) -> None:
        for name, value in (("law", self.law), ("prony", self.prony)):
            if value and value != "linear":
                problem = "cannot be combined with anisotropy: such a layer is linear and elastic"
                raise FingerError(problem, argument=name, found=value)
        young, poisson = self.engineering_constants[:3], self.engineering_constants[3:6]
        compliance = np.diag(np.reciprocal(young))
        for (row, column), ratio in zip(((0, 1), (0, 2), (1, 2)), poisson, strict=True):
            compliance[row, column] = compliance[column, row] = -ratio / young[row]
        if not np.linalg.eigvalsh(compliance).min() > 0:
            raise FingerError(
                "gives off energy when it is strained: smaller Poisson's ratios are needed",
                argument="anisotropy",
            )

    @property
    def engineering_constants(self) -> tuple[float, ...]:
        """E1, E2, E3, nu12, nu13, nu23, G12, G13, G23, moduli in MPa.

        1 is across the finger along the skin, 2 normal to the skin, 3 along the finger.
        """
        across_mpa, axes = self.young_mpa, self.anisotropy
        if axes is None:
            shear = (self.shear_mpa,) * 3
            return (across_mpa,) * 3 + (self.poisson,) * 3 + shear
        along_mpa = axes.young_along_mpa or across_mpa
        along_normal = axes.poisson_along_normal
        along_normal = axes.poisson_normal if along_normal is None else along_normal
        return (
            across_mpa,
            axes.young_normal_mpa,
            along_mpa,
            axes.poisson_normal,
            self.poisson,
            along_normal * axes.young_normal_mpa / along_mpa,
            axes.shear_normal_mpa,
            axes.shear_plane_mpa or self.shear_mpa,
            axes.shear_along_normal_mpa or axes.shear_normal_mpa,
        )

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
    """The position of an afferent, which is read at the nearest node inside its layer.

    All elements of that node belong to the layer: a solver averages nodal stress over all
    elements at a node, whatever their material, and the mean over a stiff and a soft layer
    is the stress of neither.

    Parameters
    ----------
    layer
        One of `LAYERS`, as ``"epidermis"``.
    x_mm
        Position across the finger in mm, from the middle of the pad.
    depth_mm
        Depth in mm below the top of the middle ridge, 0 or more.
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

    Parameters
    ----------
    contact_mm
        Width of the elements around the apex of the pad in mm, 0.005 to 2. Default: 1/24.
    contact_half_width_mm
        Distance from the apex in mm up to which they have that width. Default: 0.5.
    ridge_mm
        Width of the elements on the other ridges in mm, 0.005 to 2. Default: 0.125.
    far_mm
        Width to which the elements grow farther out in mm, 0.005 to 2. Default: 0.525.
    stratum_corneum_rows
        Rows of elements across the stratum corneum, 1 to 200. Default: 2.
    epidermis_rows
        Rows of elements across the epidermis, 1 to 200. Default: 8.
    dermis_rows
        Rows of elements across the dermis, 1 to 200. Default: 6.
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


_PARTS = (Outline, Skin, Ridges, Papillae, Bone, Nail, Resolution)


@dataclass(frozen=True, slots=True)
class Finger:
    """A finger in cross-section: sizes, layers, materials, positions of its afferents.

    The parts are classes of `decks.finger`, with lengths in mm and moduli in MPa; each
    checks its own ranges. `decks.presets.finger_from` makes a finger of a table of changes, as
    a TOML file has them.

    Parameters
    ----------
    name
        Name in decks, tables and files.
    outline
        `Outline` of the skin. Default: 16 mm wide, 13 mm high.
    skin
        `Skin`, thickness of stratum corneum, epidermis and dermis. Default: 0.25, 0.4 and
        1.1 mm.
    ridges
        Fingerprint `Ridges`. Default: every 0.5 mm, 0.1 mm high.
    papillae
        Dermal `Papillae`. Default: 0.1 mm high.
    bone
        `Bone`, the distal phalanx. Default: 6.4 mm wide, 4.4 mm high, 8.5 mm deep.
    nail
        `Nail`. Default: 0.45 mm thick.
    resolution
        `Resolution` of the mesh. Default: that of the preset ``quick``.
    materials
        `Material` of each layer of `LAYERS`, by its name. Default: Table 1 of the paper.
    afferents
        `AfferentSite` by the name of its class. Default: SA, RA and PC.

    Raises
    ------
    FingerError
        Parts that do not fit each other, such as skin thicker than the gap above the bone.

    Examples
    --------
    >>> import fembridge as fb
    >>> from decks.finger import Skin
    >>> thick = fb.Finger("thick", skin=Skin(epidermis_mm=0.5))
    >>> round(thick.skin.dermis_depth_mm, 2)
    1.85
    """

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
        parts = {kind.__name__.lower(): kind for kind in _PARTS}
        for name, value, kind in (
            ("name", self.name, str),
            *((name, getattr(self, name), kind) for name, kind in parts.items()),
            *((f"materials[{key!r}]", item, Material) for key, item in self.materials.items()),
            *((f"afferents[{key!r}]", item, AfferentSite) for key, item in self.afferents.items()),
        ):
            if not isinstance(value, kind):
                raise FingerError(
                    argument=name, found=value, expected=f"an object of {kind.__name__}"
                )
        if misfit := next(_misfits(self), None):
            raise misfit

    @property
    def relaxing_s(self) -> float:
        """Longest time constant of its materials, 0 if none relaxes."""
        return max(self.time_constants_s, default=0.0)

    @property
    def time_constants_s(self) -> tuple[float, ...]:
        """Time constants of its materials, each once, from short to long."""
        terms = (term for material in self.materials.values() for term in material.prony)
        return tuple(sorted({term.tau_s for term in terms}))

    def at_once(self) -> "Finger":
        """The finger without relaxation, with its instantaneous moduli."""
        if not self.relaxing_s:
            return self
        elastic = {layer: replace(material, prony=()) for layer, material in self.materials.items()}
        return replace(self, materials=elastic)


def _misfits(finger: Finger) -> Iterator[FingerError]:
    """Errors of parts that do not fit each other: the entry, its value and its limit."""
    skin, ridges, papillae = finger.skin, finger.ridges, finger.papillae
    outline, bone, mesh = finger.outline, finger.bone, finger.resolution
    for layer, material in finger.materials.items():
        if material.anisotropy is not None and layer not in SKIN_LAYERS:
            expected = f"one of {', '.join(SKIN_LAYERS)}, which follow the outline of the skin"
            key = f"materials.{layer}.anisotropy"
            yield FingerError(argument=key, found=layer, expected=expected)
    missing = [layer for layer in LAYERS if layer not in finger.materials]
    if missing:
        yield FingerError(f"has no material for {', '.join(missing)}", argument="materials")
    relief_mm = max(papillae.height_mm, 0.5 * (papillae.height_mm + ridges.height_mm))
    to_dermis_mm = skin.epidermis_depth_mm
    # The curvature of an ellipse is largest at the end of its long axis.
    short, long = sorted((outline.half_width_mm, outline.half_height_mm))
    curvature_limit = "the outline's smallest radius of curvature"
    # Skin and gap are subtracted from both half axes of the outline. This ellipse is within a
    # few hundredths of a mm of the curve at that depth.
    wall_mm = skin.dermis_depth_mm + _BONE_GAP_MM
    top_mm, bottom_mm = bone.depth_mm - bone.half_height_mm, bone.depth_mm + bone.half_height_mm
    lowest_mm = 2 * outline.half_height_mm - wall_mm
    height_key, contact_key = "papillae.height_mm", "resolution.contact_mm"
    widest_mm, widest_key = max(
        (mesh.contact_mm, contact_key), (mesh.ridge_mm, "resolution.ridge_mm")
    )
    corneum_mm, nail_mm = skin.stratum_corneum_mm, finger.nail.thickness_mm
    contact_half_mm = mesh.contact_half_width_mm
    half_mm = ridges.half_width_mm
    flat = ridges.height_mm == 0 == papillae.height_mm
    column_mm = math.inf if flat else (0.25 + 1e-9) * ridges.spacing_mm
    for key, addition, size_mm, comparison, limit_mm, limit in (
        ("ridges.height_mm", "", ridges.height_mm, "<", corneum_mm, "the stratum corneum"),
        ("nail.thickness_mm", "", nail_mm, "<", to_dermis_mm, "corneum and epidermis"),
        (height_key, "with the ridges ", relief_mm, "<", skin.epidermis_mm, "the epidermis"),
        (height_key, "", papillae.height_mm, "<", 2 * skin.dermis_mm, "twice the dermis"),
        ("skin", "", skin.dermis_depth_mm, "<", short**2 / long, curvature_limit),
        ("ridges.spacing_mm", "", ridges.spacing_mm, "<=", half_mm, "one ridge on half the pad"),
        ("ridges.half_width_mm", "", half_mm, "<=", outline.half_width_mm, "half the outline"),
        (widest_key, "", widest_mm, "<=", mesh.far_mm, "far_mm"),
        (contact_key, "", mesh.contact_mm, "<=", contact_half_mm, "contact_half_width_mm"),
        (widest_key, "", widest_mm, "<=", column_mm, "four columns to a ridge"),
        ("skin", "with a gap ", wall_mm, "<=", top_mm, "the bone's side to the pad"),
        ("bone.depth_mm", "to its far side ", bottom_mm, "<=", lowest_mm, "it touches the skin"),
    ):
        if size_mm > limit_mm or (comparison == "<" and size_mm == limit_mm):
            expected = f"{'less than' if comparison == '<' else 'at most'} {limit_mm:.3g} mm"
            yield FingerError(
                f"{addition}is {size_mm:g} mm, expected {expected}: {limit}",
                argument=key,
                found=size_mm,
                expected=expected,
            )
    room_mm = _room_for_bone_mm(finger, wall_mm)
    if bone.half_width_mm > room_mm:
        yield FingerError(
            f"is {bone.half_width_mm:g} mm, expected at most {room_mm:.3g} mm: it touches the skin",
            argument="bone.half_width_mm",
            found=bone.half_width_mm,
            expected=f"at most {room_mm:.3g} mm",
        )
    if not finger.afferents:
        yield FingerError("has no afferent, so there is no result", argument="afferents")
    for name, site in finger.afferents.items():
        if not (isinstance(name, str) and AFFERENT_NAME.fullmatch(name)):
            expected = "a capital letter, then capital letters, digits or _, at most 40 in all"
            yield FingerError(
                f"has the name {name!r}, expected {expected}",
                argument="afferents",
                found=name,
                expected=expected,
            )
        across = site.x_mm / outline.half_width_mm
        along = site.depth_mm / outline.half_height_mm - 1
        if not across * across + along * along <= 1:
            yield FingerError(
                f"is outside the finger: x = {site.x_mm:g} mm, depth {site.depth_mm:g} mm",
                argument=f"afferents.{name}",
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
