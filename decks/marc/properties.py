"""Materials and geometry of a Marc deck: ``isotropic``, ``geometry``.

One ``isotropic`` option a material: real decks that could be read hold one material
each; the block of each here is theirs.
"""

from collections.abc import Iterator

from decks.marc.layout import Layout
from decks.marc.lines import comment, integers, named, real, reals, zeros

# All elements share one geometry: plane strain of this thickness.
GEOMETRY = 1
GEOMETRY_NAME = "plane_strain"
THICKNESS_MM = 1.0

_PLANE_STRAIN = 2
# Colour of Mentat's first geometry.
_COLOUR = (1, 230, 0, 0)
_GEOMETRIC_PARAMETERS = 7
_PROPERTIES = 8


def materials(layout: Layout) -> Iterator[str]:
    """Write Young's modulus in MPa and Poisson's ratio of each part."""
    yield from comment(
        "materials: Young's modulus in MPa, Poisson's ratio; the density is 0, since "
        "nothing here has inertia"
    )
    for part in layout.parts:
        material = part.section.material
        yield named("isotropic", "structural")
        yield integers([0, 0, 0, 2])
        yield (
            integers([part.material])
            + f"{'elastic':<40}"
            + integers([10, 0, 0, 0])
            + part.section.name
        )
        yield reals(zeros(_PROPERTIES, f1=material.young_mpa, f2=material.poisson))
        yield integers([0] * _PROPERTIES)
        yield real(0.0)
        yield integers([0])
        yield ""


def geometry(layout: Layout) -> Iterator[str]:
    """Write the one geometry that all parts have."""
    dilatation = float(layout.element.constant_dilatation)
    if dilatation:
        yield from comment("the second parameter asks for constant dilatation")
    yield named("geometry")
    yield integers([0, 0, 2])
    yield integers([GEOMETRY, _PLANE_STRAIN, *_COLOUR])
    yield GEOMETRY_NAME
    yield reals(zeros(_GEOMETRIC_PARAMETERS, f1=THICKNESS_MM, f2=dilatation))
    yield ""
