"""CalculiX' own contact in three dimensions: a round probe pressed into the prism.

It is what superposed unit forces are checked against, not how a touch is computed: a
quarter of the prism and of a probe over its apex, node-to-surface, one static step a
depth.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from decks.contact_analysis import Contact
from decks.keyword_deck import real
from decks.unit_loads import Prism, prism_text
from fembridge.typing import FloatArray

PROBE_SET = "PROBE"
# Sectors of the quarter, and how thick the probe is drawn.
_SECTORS = 12
_THICK_MM = 0.3
# Skin further from the probe's rim than this is not looked at for contact.
_MARGIN_MM = 0.6


def contact_deck(
    prism: Prism,
    radius_mm: FloatArray,
    height_mm: FloatArray,
    depths_mm: Sequence[float],
    contact: Contact,
    *,
    large_strain: bool = False,
) -> str:
    """A round probe of rising `radius_mm` from 0 and `height_mm`, pressed to each depth."""
    return "\n".join(_lines(prism, radius_mm, height_mm, depths_mm, contact, large_strain)) + "\n"


def _lines(
    prism: Prism,
    radius_mm: FloatArray,
    height_mm: FloatArray,
    depths_mm: Sequence[float],
    contact: Contact,
    large_strain: bool,
) -> Iterator[str]:
    yield "*HEADING"
    yield "fembridge: a round probe on a prismatic finger, a quarter of both"
    yield prism_text(prism, even_x=True, even_z=True).rstrip("\n")
    first = prism.section_nodes * len(prism.z_mm) + 1
    yield from _probe(radius_mm, height_mm, first, prism.elements + 1)
    yield "*SURFACE, NAME=SKIN_SURFACE, TYPE=ELEMENT"
    reach_mm = radius_mm[-1] + _MARGIN_MM
    across = int((prism.point_mm[0, : prism.contact_columns - 1, 0] < reach_mm).sum())
    along = int((prism.z_mm[:-1] < reach_mm).sum())
    for k in range(along):
        for column in range(across):
            # The first layer's elements come first, slice by slice, row by row.
            yield f"{1 + k * first_layer(prism) + column}, S5"
    yield "*SURFACE INTERACTION, NAME=TOUCH"
    yield "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR"
    yield f"{real(contact.stiffness_mpa_per_mm)}, 0.001"
    if contact.friction:
        yield "*FRICTION"
        stick = contact.stick_share * contact.stiffness_mpa_per_mm
        yield f"{real(contact.friction)}, {real(stick)}"
    formulation = contact.formulation.upper().replace("-", " ")
    yield f"*CONTACT PAIR, INTERACTION=TOUCH, TYPE={formulation}"
    yield "SKIN_SURFACE, PROBE_SURFACE"
    for depth_mm in depths_mm:
        yield f"*STEP, INC=1000{', NLGEOM' if large_strain else ''}"
        yield "*STATIC"
        yield "0.5, 1.0"
        yield "*BOUNDARY"
        yield f"{PROBE_SET}, 1, 1"
        yield f"{PROBE_SET}, 3, 3"
        yield f"{PROBE_SET}, 2, 2, {real(-depth_mm)}"
        yield "*NODE OUTPUT, NSET=OUTPUT_NODES, DOUBLE, FREQUENCY=1000"
        yield "U"
        yield f"*NODE PRINT, NSET={PROBE_SET}, TOTALS=ONLY, FREQUENCY=1000"
        yield "RF"
        yield "*END STEP"


def first_layer(prism: Prism) -> int:
    """Elements of the stratum corneum in a slice."""
    return int((prism.row_layer == prism.row_layer[0]).sum()) * prism.nail_column


def _probe(radius_mm: FloatArray, height_mm: FloatArray, node: int, element: int) -> Iterator[str]:
    """A quarter of a round body: wedges in the middle, bricks around."""
    angle = np.linspace(0.0, np.pi / 2, _SECTORS + 1)
    yield f"*NODE, NSET={PROBE_SET}"
    number: dict[tuple[int, int, int], int] = {}
    for top in (0, 1):
        for ring, (radius, height) in enumerate(zip(radius_mm, height_mm, strict=True)):
            for sector, turn in enumerate(angle if ring else angle[:1]):
                number[top, ring, sector] = node
                x, z = radius * np.cos(turn), radius * np.sin(turn)
                y = height if not top else height_mm[-1] + _THICK_MM
                yield f"{node}, {x:.9f}, {y:.9f}, {z:.9f}"
                node += 1
    wedges, bricks = [], []
    for sector in range(_SECTORS):
        inner = [(0, 0), (1, sector + 1), (1, sector)]
        wedges.append([number[top, r, s] for top in (0, 1) for r, s in inner])
        for ring in range(1, len(radius_mm) - 1):
            quad = [(ring, sector), (ring, sector + 1), (ring + 1, sector + 1), (ring + 1, sector)]
            bricks.append([number[top, r, s] for top in (0, 1) for r, s in quad])
    for kind, rows in (("C3D6", wedges), ("C3D8", bricks)):
        yield f"*ELEMENT, TYPE={kind}, ELSET=PROBE_BODY"
        for each in rows:
            yield f"{element}, {', '.join(map(str, each))}"
            element += 1
    yield "*SURFACE, NAME=PROBE_SURFACE, TYPE=ELEMENT"
    for number_ in range(element - len(wedges) - len(bricks), element):
        yield f"{number_}, S1"
    yield from ("*MATERIAL, NAME=RIGID", "*ELASTIC", "2.1e5, 0.3")
    yield "*SOLID SECTION, ELSET=PROBE_BODY, MATERIAL=RIGID"
