# ruff: noqa: B905, PTH123, UP031 - it runs in Python 2.7 too
"""An imitation of Mentat's py_post, as its users describe it: put it on the path.

Position 0 is the model and holds no results. Nodes and elements are asked for by
index from 0 and carry their number as ``id``; ``node_sequence`` gives -1 for a node
that is absent. Element values are those of integration points, extrapolated to the
nodes by the method that ``extrapolation`` set. The "post file" is JSON:

    {"nodes": [[id, x, y]], "elements": [[id, type, [nodes]]],
     "sets": [[name, kind, [members]]],
     "positions": [{"increment": n, "time": s,
                    "scalars": {label: [[value a point] an element]},
                    "tensors": {label: [[[six] a point] an element]}}]}

"""

import json
import math

TENSOR = ("t11", "t22", "t33", "t12", "t23", "t13")
_OUT = math.sqrt(3.0)  # a corner, in Gauss points of 1 from the middle
_POINTS = ((-1, -1), (1, -1), (-1, 1), (1, 1))  # xi fastest
_CORNERS = ((-1, -1), (1, -1), (1, 1), (-1, 1))  # counter-clockwise


class _Item:
    def __init__(self, **given):
        self.__dict__.update(given)


class _Post:
    def __init__(self, model):
        self._model, self._elements = model, model["elements"]
        self._row = None
        self.position, self.increment, self.time = 0, -1, 0.0
        self.revision = 14

    def increments(self):
        return len(self._model["positions"]) + 1

    def moveto(self, position):
        if not 0 <= position < self.increments():
            raise IndexError("position %r" % position)
        self.position = position
        self._row = self._model["positions"][position - 1] if position else None
        self.increment = self._row["increment"] if position else -1
        self.time = self._row["time"] if position else 0.0

    def extrapolation(self, method):
        if method != "linear":
            raise ValueError(method)

    def close(self):
        self._model = None

    def nodes(self):
        return len(self._model["nodes"])

    def node_id(self, index):
        return self._model["nodes"][_checked(index)][0]

    def node(self, index):
        number, x, y = self._model["nodes"][_checked(index)]
        return _Item(id=number, x=x, y=y, z=0.0)

    def node_sequence(self, number):
        numbers = [node[0] for node in self._model["nodes"]]
        return numbers.index(number) if number in numbers else -1

    def elements(self):
        return len(self._elements)

    def element_id(self, index):
        return self._elements[_checked(index)][0]

    def element(self, index):
        number, kind, items = self._elements[_checked(index)]
        return _Item(id=number, type=kind, len=len(items), items=list(items))

    def element_scalars(self):
        return len(self._held("scalars"))

    def element_scalar_label(self, index):
        return sorted(self._held("scalars"))[index]

    def element_scalar(self, element, index):
        points = self._held("scalars")[self.element_scalar_label(index)][element]
        return [_Item(id=node, value=value) for node, value in self._at_nodes(element, points)]

    def element_tensors(self):
        return len(self._held("tensors"))

    def element_tensor_label(self, index):
        return sorted(self._held("tensors"))[index]

    def element_tensor(self, element, index):
        points = self._held("tensors")[self.element_tensor_label(index)][element]
        columns = [self._at_nodes(element, column) for column in zip(*points)]
        found = []
        for corner in zip(*columns):
            item = _Item(id=corner[0][0])
            for name, (_, value) in zip(TENSOR, corner):
                setattr(item, name, value)
            found.append(item)
        return found

    def sets(self):
        return len(self._model.get("sets", []))

    def set(self, index):
        name, kind, items = self._model["sets"][_checked(index)]
        return _Item(name=name, type=kind, len=len(items), items=list(items))

    def _held(self, kind):
        return {} if self._row is None else self._row.get(kind, {})

    def _at_nodes(self, element, points):
        """Values at the corners; a fifth node, of pressure, gets none."""
        corners = self._elements[element][2][:4]
        at = dict(zip(_POINTS, points))
        return [
            (
                node,
                sum(
                    value * (1 + xi * _OUT * a) / 2.0 * (1 + eta * _OUT * b) / 2.0
                    for (a, b), value in at.items()
                ),
            )
            for node, (xi, eta) in zip(corners, _CORNERS)
        ]


def _checked(index):
    if index < 0:
        raise IndexError("index %r: node_sequence found nothing?" % index)
    return index


def post_open(path):
    with open(path) as file:
        return _Post(json.load(file))
