"""Plane models whose stress is known at every integration point, for the writer.

It shares nothing with the reader: points are placed by hand, element by element.
"""

import itertools
import math

import post_writer as writer

CODES = (
    (17, 0, ""), (311, 0, ""), (312, 0, ""), (313, 0, ""), (314, 0, ""),
    (315, 0, ""), (316, 0, ""),
)  # fmt: skip
_G, _H = 1 / math.sqrt(3), math.sqrt(0.6)
POINTS = {
    4: [(-_G, -_G), (_G, -_G), (-_G, _G), (_G, _G)],
    9: [(x, y) for y in (-_H, 0, _H) for x in (-_H, 0, _H)],
    1: [(0.0, 0.0)],
}
# Element type: its points, whether it has mid-side nodes, whether a pressure node.
KINDS = {
    3: (4, False, False), 11: (4, False, False), 80: (4, False, True),
    118: (1, False, True), 27: (9, True, False), 54: (4, True, False),
}  # fmt: skip


def place(corners, xi, eta):
    """Where (xi, eta) lies in a quadrilateral with straight sides."""
    shares = [(1 + sx * xi) * (1 + sy * eta) / 4 for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    return tuple(
        sum(share * corner[axis] for share, corner in zip(shares, corners, strict=True))
        for axis in (0, 1)
    )


def von_mises(s):
    """Of xx, yy, zz, xy, yz, zx."""
    normal = (s[0] - s[1]) ** 2 + (s[1] - s[2]) ** 2 + (s[2] - s[0]) ** 2
    return math.sqrt(normal / 2 + 3 * (s[3] ** 2 + s[4] ** 2 + s[5] ** 2))


class Plane:
    """Quadrilaterals: corners by number, elements as corner numbers, their layer."""

    def __init__(self, kind, nodes, quads, layers=None):
        self.kind = kind
        self.count, middle, pressure = KINDS[kind]
        self.nodes = dict(nodes)
        self.quads = list(quads)
        self.layers = list(layers or [0] * len(self.quads))
        self.corners = [[self.nodes[n] for n in quad] for quad in self.quads]
        self.elements = [tuple(quad) for quad in self.quads]
        self.bearing = set(itertools.chain(*self.quads))
        if middle:
            self._add_middles()
        if pressure:
            last = max(self.nodes)
            for row, element in enumerate(self.elements):
                self.nodes[last + 1 + row] = (0.0, 0.0)
                self.elements[row] = (*element, last + 1 + row)

    def _add_middles(self):
        known = {}
        for row, quad in enumerate(self.quads):
            more = []
            for a, b in zip(quad, (*quad[1:], quad[0]), strict=True):
                key = min(a, b), max(a, b)
                if key not in known:
                    known[key] = max(self.nodes) + 1
                    first, second = self.nodes[a], self.nodes[b]
                    self.nodes[known[key]] = tuple(
                        (p + q) / 2 for p, q in zip(first, second, strict=True)
                    )
                more.append(known[key])
            self.elements[row] = (*quad, *more)
            self.bearing.update(more)

    def at_points(self, stress, time_s):
        """Values of `CODES` at each point: ``stress(x, y, layer, time_s)`` is six."""
        rows = []
        for corners, layer in zip(self.corners, self.layers, strict=True):
            rows.append([])
            for xi, eta in POINTS[self.count]:
                tensor = stress(*place(corners, xi, eta), layer, time_s)
                rows[-1].append([von_mises(tensor), *tensor])
        return rows

    def model(self, **changes):
        """Give the model for the writer; extras have the layer as first number."""
        shown = {
            "node_ids": tuple(self.nodes),
            "coordinates": tuple(self.nodes.values()),
            "elements": tuple(
                (row + 1, self.kind, nodes, (layer + 1, 1, 1, 3, 1))
                for row, (nodes, layer) in enumerate(zip(self.elements, self.layers, strict=True))
            ),
            "points": self.count,
            "codes": CODES,
        }
        return writer.Model(**{**shown, **changes})

    def increments(self, stress, times_s):
        """Give increments with stress and a displacement of (time, -number)."""
        return tuple(
            writer.Increment(
                number=row,
                time_s=time_s,
                element=self.at_points(stress, time_s),
                nodal=(writer.Quantity("Displacement", 1, 2, [(time_s, -n) for n in self.nodes]),),
            )
            for row, time_s in enumerate(times_s)
        )


def grid(columns, rows, shift=lambda x, y: (x, y)):
    """Nodes and elements of a grid of unit squares, moved by `shift`."""
    nodes = {
        1 + x + y * (columns + 1): shift(float(x), float(y))
        for y in range(rows + 1)
        for x in range(columns + 1)
    }
    quads = [
        (n := 1 + x + y * (columns + 1), n + 1, n + columns + 2, n + columns + 1)
        for y in range(rows)
        for x in range(columns)
    ]
    return nodes, quads
