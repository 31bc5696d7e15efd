"""Whole fields, places and pictures of a Marc post file.

Quantities go by Marc's names: those of the file at nodes (Displacement, Reaction Force),
those of the post codes at elements (Stress, Equivalent Von Mises Stress). A name is taken
case-blind, and as short as it is one quantity's alone; the whole name goes before longer
ones. Steps are Marc's sub-increments.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType

import numpy as np

from fembridge.errors import ResultError, UsageError
from fembridge.results.fields import Field, Frame, Key
from fembridge.results.marc import check_whole
from fembridge.results.marc_nodes import UNKNOWN_LAYERS, MeshPoints
from fembridge.results.marc_post import NodalQuantity, PostFile, PostIncrement
from fembridge.results.marc_quantity import (
    PA,
    STRESS_CODES,
    ElementQuantity,
    element_quantities,
    nodal_components,
    nodal_unit,
)
from fembridge.results.read_options import ReadOptions, in_pa
from fembridge.results.stress import DERIVED, derived_of
from fembridge.trace import MS_PER_S
from fembridge.typing import BoolArray, FloatArray, IntArray

_Quantity = NodalQuantity | ElementQuantity


class MarcSource:
    """An open post file, see `fembridge.results.fields.FieldSource`."""

    def __init__(self, path: Path, options: ReadOptions) -> None:
        self.path, self._options = path, options
        self._post = PostFile(path)
        self._points: tuple[int, MeshPoints] | None = None
        self._checked = False

    def __enter__(self) -> "MarcSource":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._post.__exit__(kind, error, trace)

    def keys(self, quantity: str) -> list[Key]:
        """Sub-increment and increment of each output of `quantity`."""
        self._check_whole()
        name = self._name(quantity)
        return [_key(one) for one in self._post.increments if name in self._quantities(one)]

    def field(self, quantity: str, key: Key) -> Field:
        """Read `quantity` at one of its `keys`.

        Of element values: nodes that lie in one layer, or with `across_materials` all, those
        between layers with the mean over all elements there.
        """
        name = self._name(quantity)
        one = next(
            each
            for each in reversed(self._post.increments)
            if _key(each) == key and name in self._quantities(each)
        )
        found = self._quantities(one)[name]
        points = self._mesh(one.mesh)
        if isinstance(found, NodalQuantity):
            components, unit = nodal_components(found), nodal_unit(found)
            rows = np.flatnonzero(~points.pressure_nodes())
            nodes = points.mesh.node_ids[rows]
            values = self._nodal(one, found)[rows]
        else:
            components, unit = found.components, found.unit
            self._note_mesh(points)
            nodes, values = self._one_value_a_node(one, found, points)
        bad = np.argwhere(~np.isfinite(values))
        if bad.size:
            raise ResultError(
                f"{name} of increment {one.increment}, node {nodes[bad[0][0]]}: "
                f"{components[bad[0][1]]} is {values[tuple(bad[0])]}",
                self.path,
            )
        return _field(name, one, components, unit, nodes, values)

    def places(self) -> Iterator[tuple[IntArray, FloatArray, BoolArray]]:
        """Yield nodes, coordinates ``(n, 3)`` in mm, and which have elements."""
        points = self._mesh(0)
        mesh = points.mesh
        if not mesh.node_ids.size:
            raise ResultError("no nodes in it, so no coordinates", self.path)
        keep = ~points.pressure_nodes()
        yield mesh.node_ids[keep], mesh.coordinates_mm[keep], points.bearing[keep]

    def frames(self, quantities: Sequence[str] | None, derived: Sequence[str]) -> Iterator[Frame]:
        """Check the request now; yield the increments when they are asked for.

        A point of the scene is a node as one layer has it: between layers stress jumps, as it
        does in the model.
        """
        self._check_whole()
        names = None if quantities is None else [self._name(one) for one in quantities]
        for name in derived:
            if DERIVED[name][0] != ("STRESS",):
                raise UsageError(
                    f"{name} takes {' and '.join(DERIVED[name][0])}: of a Marc file it is post "
                    "code 48"
                )
        return self._frames(names, derived)

    def _frames(self, names: Sequence[str] | None, derived: Sequence[str]) -> Iterator[Frame]:
        scenes = {}
        for one in self._post.increments:
            found = {
                name: quantity
                for name, quantity in self._quantities(one).items()
                if names is None or name in names
            }
            if not found:
                self._options.note(f"left out: increment {one.increment}, it has none")
                continue
            points = self._mesh(one.mesh)
            if one.mesh not in scenes:
                scenes = {one.mesh: points.scene()}
                self._note_mesh(points)
            values = {
                name: self._nodal(one, quantity)[points.rows]
                if isinstance(quantity, NodalQuantity)
                else self._at_points(one, quantity, points)
                for name, quantity in found.items()
            }
            tensors = [
                quantity
                for quantity in found.values()
                if isinstance(quantity, ElementQuantity)
                and quantity.is_tensor
                and quantity.codes[0] in STRESS_CODES
            ]
            if tensors:
                best = min(tensors, key=lambda tensor: STRESS_CODES.index(tensor.codes[0]))
                stress_pa = values[best.name]
                field = _field("STRESS", one, best.components, PA, points.nodes, stress_pa)
                with np.errstate(over="ignore", invalid="ignore"):
                    values |= {name: derived_of(name, {"STRESS": field}) for name in derived}
            flat = {
                name: value[:, 0] if value.ndim == 2 and value.shape[1] == 1 else value
                for name, value in values.items()
            }
            yield Frame(one.time_s * MS_PER_S, scenes[one.mesh], flat)

    def _one_value_a_node(
        self, one: PostIncrement, quantity: ElementQuantity, points: MeshPoints
    ) -> tuple[IntArray, FloatArray]:
        at_points = self._at_points(one, quantity, points)
        between = points.met > 1
        if between.any() and not self._options.across_materials:
            count = np.unique(points.rows[between]).size
            self._options.note(
                f"left out: {count} nodes lie between layers, where a mean belongs to none; "
                "--across-materials takes it"
            )
            rows = points.rows[~between]
            order = np.argsort(rows, kind="stable")
            return points.mesh.node_ids[rows[order]], at_points[~between][order]
        share = points.elements_at()
        rows, place = np.unique(points.rows, return_inverse=True)
        total = np.zeros((rows.size, at_points.shape[1]))
        np.add.at(total, place, at_points * share[:, None])
        elements = np.bincount(place, share, rows.size)
        return points.mesh.node_ids[rows], total / elements[:, None]

    def _at_points(
        self, one: PostIncrement, quantity: ElementQuantity, points: MeshPoints
    ) -> FloatArray:
        every = np.arange(points.mesh.element_ids.size)
        values = self._post.element_values(one.row, every)[:, :, quantity.columns]
        return self._in_our_unit(points.averaged(values, self._options.method), quantity.unit)

    def _nodal(self, one: PostIncrement, quantity: NodalQuantity) -> FloatArray:
        values = self._post.nodal_values(one.row, quantity.name)
        return self._in_our_unit(values, nodal_unit(quantity))

    def _in_our_unit(self, values: FloatArray, unit: str) -> FloatArray:
        if unit != PA or not np.isfinite(values).all():
            return values
        return in_pa(values, self._options, self.path)

    def _quantities(self, one: PostIncrement) -> dict[str, _Quantity]:
        """Quantities of an increment by name."""
        found: dict[str, _Quantity] = {
            quantity.name: quantity for quantity in one.nodal if not quantity.is_complex
        }
        if one.has_element_values:
            for quantity in element_quantities(self._post.codes):
                found.setdefault(quantity.name, quantity)
        return found

    def _name(self, word: str) -> str:
        """Name of the quantity that `word` stands for."""
        names = list(
            dict.fromkeys(name for one in self._post.increments for name in self._quantities(one))
        )
        plain = word.casefold()
        same = [name for name in names if name.casefold() == plain]
        close = same or [name for name in names if name.casefold().startswith(plain)]
        if len(close) == 1:
            return close[0]
        if close:
            raise UsageError(f"{word!r} may be {' or '.join(close)}")
        raise ResultError(f"no {word} in it, it holds {', '.join(names) or 'nothing'}", self.path)

    def _mesh(self, row: int) -> MeshPoints:
        if self._points is None or self._points[0] != row:  # one at a time
            self._points = row, MeshPoints(self._post.mesh(row), self.path)
        return self._points[1]

    def _check_whole(self) -> None:
        if not self._checked:
            check_whole(self._post, self._options)
        self._checked = True

    def _note_mesh(self, points: MeshPoints) -> None:
        if points.unknown_types:
            types = ", ".join(map(str, points.unknown_types))
            self._options.note(f"left out: elements of unknown type {types}")
        if not points.layers.known:
            self._options.note(UNKNOWN_LAYERS)


def _field(
    name: str,
    one: PostIncrement,
    components: tuple[str, ...],
    unit: str,
    nodes: IntArray,
    values: FloatArray,
) -> Field:
    return Field(
        name=name,
        step=one.sub_increment,
        increment=one.increment,
        time_ms=one.time_s * MS_PER_S,
        components=components,
        units=(unit,) * len(components),
        nodes=nodes,
        values=values,
    )


def _key(one: PostIncrement) -> Key:
    return one.sub_increment, one.increment
