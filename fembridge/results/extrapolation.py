"""From an element's integration points to its nodes: weights, by named method.

Marc stores stress at integration points, CalculiX prints it there; a node's value is made
of them. The methods carry the names that Mentat gives them:

``linear``     from the mean over the element's points in a straight line through the nearest
               point (the mean of those equally near): exact where stress is linear in the
               element, and what Marc does
``translate``  the value of the nearest point; of points equally near their mean
``average``    the mean over the element's points

Marc's rule is not in its manuals. It was found on the nodal print of a public model of two
bricks (github.com/nightly/fedes, ``models/Example-3D-beam-small``, ``Model1-output-Marc.70``
beside its ``.t19``): at all 12 nodes the tensor is that of this rule, averaged over the
elements. The constant in the print is 1.73, for sqrt(3), to its five digits, times a factor
of 0.9992 to 1.0033 a node that is not explained; sqrt(3) itself is within 0.21 % of the
greatest component and 0.19 % of each von Mises stress. The polynomial through the points, trilinear
in a brick, would be 7 % away. Quadrilaterals and quadratic elements are taken to follow;
wedges, whose points lie on no such line, keep their polynomial.

Order of points: xi fastest, then eta, then zeta, from -1 to +1; in triangles, tetrahedra
and wedges point k is the one next to corner k. Known for the Marc types in `DOCUMENTED`; for
the others of `ELEMENT_TYPES` it is inferred from their kin.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np

from fembridge.results.read_options import METHODS
from fembridge.typing import FloatArray

_SAME = 1.0e-9  # distances that differ by less are equal
_GAUSS = {1: (0.0,), 2: (-(3**-0.5), 3**-0.5), 3: (-(0.6**0.5), 0.0, 0.6**0.5)}
_TRIANGLE, _TETRAHEDRON = (2 / 3, 1 / 6), (0.5854101966249685, 0.1381966011250105)
# Mid-side nodes: the pairs of corners (from 0) that they lie between.
_RING = ((0, 1), (1, 2), (2, 3), (3, 0))
_MIDDLES = {
    "quad8": _RING,
    "tri6": ((0, 1), (1, 2), (2, 0)),
    "tet10": ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    "hex20": (
        *_RING, (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7),
    ),
}  # fmt: skip
FRD_ORDER: Mapping[str, list[int]] = {"hex20": [*range(12), *range(16, 20), *range(12, 16)]}
"""Where a ``.frd`` has the nodes of a shape in another order than Marc, which has the
mid-sides of a brick's top before those between."""
_SQUARE = ((-1, -1), (1, -1), (1, 1), (-1, 1))
_CUBE = (*((x, y, -1) for x, y in _SQUARE), *((x, y, 1) for x, y in _SQUARE))
_POINTS_A_SIDE = {1: 1, 8: 2, 27: 3}  # of a brick


@dataclass(frozen=True, slots=True)
class ElementType:
    """An element type of Marc: `family`, corners, mid-side nodes, and its `points`.

    `nodes` counts those that have values; a Herrmann element has one or more
    pressure nodes behind them, which get none.
    """

    family: str
    nodes: int
    points: int

    @property
    def shape(self) -> str:
        """Family and nodes in one word, ``quad4``."""
        return f"{self.family}{self.nodes}"


def _types(family: str, nodes: int, points: int, *numbers: int) -> dict[int, ElementType]:
    return dict.fromkeys(numbers, ElementType(family, nodes, points))


# Marc's numbers of element types whose points are known or inferred.
ELEMENT_TYPES: Mapping[int, ElementType] = {
    **_types("quad", 4, 4, 3, 10, 11, 18, 20, 75, 80, 81, 82, 139),
    **_types("quad", 4, 1, 114, 115, 116, 118, 119, 140),
    **_types("quad", 8, 9, 26, 27, 28, 32, 33),
    **_types("quad", 8, 4, 53, 54, 55, 58, 59),
    **_types("tri", 3, 1, 2, 6, 138, 201),
    **_types("tri", 6, 3, 124, 125, 126, 128, 129),
    **_types("hex", 8, 8, 7, 84),
    **_types("hex", 8, 1, 117, 120),
    **_types("hex", 20, 27, 21, 35),
    **_types("hex", 20, 8, 57, 61),
    **_types("tet", 4, 1, 134),
    **_types("tet", 10, 4, 127, 130),
    **_types("wedge", 6, 6, 136),
}
# Those whose count and order of points stand in a public source or a real file.
DOCUMENTED = frozenset({3, 6, 7, 11, 21, 27, 32, 54, 57, 114, 117, 118, 125, 127, 134,
                        136})  # fmt: skip


def node_weights(number: int, nodes: int, stored: int, method: str) -> FloatArray:
    """Weights ``(node, point)`` from what a file stores to an element's nodes; rows sum to 1.

    `number` is Marc's of the element type, `nodes` counts the element's in the file, pressure
    nodes among them: rows are those with values, the first ones. `stored` is how many points
    the file has for each element: that of the type in it that has most; further ones of a
    smaller type are not looked at. A single one where the type has more is the element's
    mean (inferred: the deck then has no ``all points``). `method` is one of `METHODS`.

    Raises
    ------
    ValueError
        The type is unknown and `method` is not "average"; the file has some of its
        points and not all; the element has too few nodes; no such method.
    """
    if method not in METHODS:
        raise ValueError(f"extrapolation {method!r}, expected {', '.join(METHODS)}")
    about = ELEMENT_TYPES.get(number)
    if about is None:
        if method != "average":
            raise ValueError(
                f"element type {number}: where its integration points lie is not "
                "known here; average of them is what can be had"
            )
        return np.full((nodes, stored), 1.0 / stored)
    if nodes < about.nodes:
        raise ValueError(f"element type {number} with {nodes} nodes, expected {about.nodes}")
    if 1 < stored < about.points:
        raise ValueError(
            f"element type {number} has {about.points} integration points, the "
            f"file stores {stored}: which they are is not known"
        )
    used = min(stored, about.points)
    weights = np.zeros((about.nodes, stored))
    if method == "average" or used == 1:
        weights[:, :used] = 1.0 / used
        return weights
    to, here = node_places(about), point_places(about.family, used)
    if method == "linear" and about.family == "wedge":
        weights[:, :used] = _wedge_terms(to) @ np.linalg.inv(_wedge_terms(here))
        return weights
    away = np.linalg.norm(to[:, None, :] - here[None, :, :], axis=2)
    nearest = (away <= away.min(axis=1, keepdims=True) + _SAME).astype(np.float64)
    nearest /= nearest.sum(axis=1, keepdims=True)
    if method == "linear":
        middle = here.mean(axis=0)
        reach = np.linalg.norm(to - middle, axis=1) / np.linalg.norm(
            nearest @ here - middle, axis=1
        )
        nearest = 1.0 / used + reach[:, None] * (nearest - 1.0 / used)
    weights[:, :used] = nearest
    return weights


def node_places(about: ElementType) -> FloatArray:
    """Where the nodes lie, ``(node, axis)``: in xi, eta, zeta from -1 to 1.

    A triangle and a tetrahedron have one axis a corner, 1 there and 0 at the
    others; a wedge the three of its triangle, and zeta.
    """
    corners = _corners(about.family)
    middle = [corners[list(pair)].mean(axis=0) for pair in _MIDDLES.get(about.shape, ())]
    return np.array([*corners, *middle])


def point_places(family: str, points: int) -> FloatArray:
    """Where the integration points lie, ``(point, axis)``, as `node_places`."""
    corners = _corners(family)
    if points == 1:
        middle: FloatArray = corners.mean(axis=0, keepdims=True)
        return middle
    if family == "wedge":
        far, near = _TRIANGLE
        flat = np.full((3, 3), near) + (far - near) * np.eye(3)
        return np.array([[*row, z] for z in _GAUSS[2] for row in flat])
    if family in ("tri", "tet"):
        far, near = _TRIANGLE if family == "tri" else _TETRAHEDRON
        return np.full((points, points), near) + (far - near) * np.eye(points)
    axes = 2 if family == "quad" else 3
    side = _GAUSS[round(points ** (1 / axes))]
    return np.array([place[::-1] for place in product(side, repeat=axes)])


def brick_weights(shape: str, points: int, corner: int) -> FloatArray:
    """Weights ``(points,)`` from the points of a brick to a node of "quad8", "hex20", ...

    The polynomial through the points, product of one a direction: constant of one point,
    linear of two, quadratic of three. CalculiX makes a brick of a plane element too: its
    points are equal through the thickness but for rounding, and their mean is taken.
    `corner` counts nodes as a ``.frd`` has them. A shape, or a number of its points, that is
    not known here is a ValueError.
    """
    if shape not in ("quad4", "quad8", "hex8", "hex20") or points not in _POINTS_A_SIDE:
        raise ValueError(f"{shape} with {points} integration points is not extrapolated")
    family, nodes = ("quad", shape[4:]) if shape.startswith("quad") else ("hex", shape[3:])
    places = node_places(ElementType(family, int(nodes), points))
    place = places[FRD_ORDER.get(shape, slice(None))][corner]
    side = _POINTS_A_SIDE[points]
    gauss = _GAUSS[side]
    factors = [
        np.array([np.prod([(x - b) / (a - b) for b in gauss if b != a]) for a in gauss])
        for x in place.tolist()
    ]
    if len(factors) == 2:
        factors.append(np.full(side, 1.0 / side))
    weights: FloatArray = np.einsum("x,y,z->zyx", *factors).ravel()
    return weights


def _corners(family: str) -> FloatArray:
    if family in ("tri", "tet"):
        return np.eye(3 if family == "tri" else 4)
    if family == "wedge":
        return np.array([[*row, z] for z in (-1.0, 1.0) for row in np.eye(3)])
    return np.array(_SQUARE if family == "quad" else _CUBE, dtype=np.float64)


def _wedge_terms(places: FloatArray) -> FloatArray:
    """Terms of the polynomial through a wedge's points, ``(place, term)``."""
    flat, z = places[:, :3], places[:, 3:]
    return np.hstack([flat, flat * z])
