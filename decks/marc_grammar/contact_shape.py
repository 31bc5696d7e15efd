"""Curves and surfaces of rigid contact bodies: NURBS, entity type 9.

A curve is ``9 points order divisions``, points as x and y, weights, knots, one a
line. A surface is ``9 nu nv order_u order_v divisions_u divisions_v trims``.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from decks.marc_grammar.layout import Layout, fields, integers
from decks.marc_grammar.line import Line
from fembridge.typing import FloatArray

NURBS = 9
_CURVE, _SURFACE = 4, 8  # numbers on the first line


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """A curve, `point` ``(P, 2)``, or a surface ``(P, 3)``; `weight` ``(P,)``.

    `counts` and `orders` hold one number for a curve, two for a surface. `knot` are
    those of the first direction, then of the second.
    """

    counts: tuple[int, ...]
    orders: tuple[int, ...]
    point: FloatArray
    weight: FloatArray
    knot: FloatArray
    line: Line


def read_shapes(rows: Sequence[Line], count: int, layout: Layout) -> tuple[Shape, ...]:
    """Read `count` shapes; those of a kind that is not known here end the list.

    Raises
    ------
    DeckError
        A curve or surface cut short.
    """
    shapes: list[Shape] = []
    rows = [row for row in rows if not row.blank]
    place = 0
    while len(shapes) < count and place < len(rows):
        head = integers(rows[place], layout)
        curve = len(head) < _SURFACE
        if head[0] != NURBS or (not curve and head[7]) or len(head) < _CURVE:
            break
        half = 1 if curve else 2
        counts, orders = tuple(head[1 : 1 + half]), tuple(head[1 + half : 1 + 2 * half])
        points = int(np.prod(counts, dtype=object))
        knots = sum(counts) + sum(orders)
        if min(*counts, *orders, 1) < 1 or place + 2 * points + knots >= len(rows):
            raise rows[place].refuse(
                f"a rigid {'curve' if curve else 'surface'} of {points} points is cut short"
            )
        place += 1
        point = _reals(rows[place : place + points], layout, 2 if curve else 3)
        place += points
        weight = _reals(rows[place : place + points], layout, 1)[:, 0]
        place += points
        knot = _reals(rows[place : place + knots], layout, 1)[:, 0]
        line = rows[place - 2 * points - 1]
        place += knots
        shapes.append(Shape(counts, orders, point, weight, knot, line))
    return tuple(shapes)


def _reals(rows: Sequence[Line], layout: Layout, width: int) -> FloatArray:
    values = [fields(row, layout, "r" * width) for row in rows]
    return np.array(values, dtype=np.float64).reshape(len(rows), width)
