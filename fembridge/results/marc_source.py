"""Whole fields, places and pictures of a Marc post file.

Quantities go by Marc's names: those of the file at nodes (Displacement, Reaction
Force), those of the post codes at elements (Stress, Equivalent Von Mises Stress). A
name is taken case-blind, and as short as it is one quantity's alone; the whole name
goes before longer ones. Steps are Marc's sub-increments.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType

import numpy as np

from fembridge.errors import ResultError, UsageError
from fembridge.results.derived import DERIVED, derived_of
from fembridge.results.field_source import Frame, Key
from fembridge.results.frd_format.field import Field
from fembridge.results.marc_format.content import NodalQuantity, PostIncrement
from fembridge.results.marc_format.post_file import PostFile
from fembridge.results.marc_nodes.layer import UNTOLD
from fembridge.results.marc_nodes.points import MeshPoints
from fembridge.results.marc_nodes.quantity import (
    PA,
    STRESS_CODES,
    ElementQuantity,
    element_quantities,
    nodal_components,
    nodal_unit,
)
from fembridge.results.marc_nodes.whole import check_whole
from fembridge.results.read_options import ReadOptions, in_pa
from fembridge.trace import MS_PER_S
from fembridge.typing import BoolArray, FloatArray, IntArray


class MarcSource:
    """An open post file, see `fembridge.results.field_source.FieldSource`."""

    def __init__(self, path: Path, options: ReadOptions) -> None:
        self.path, self._options = path, options
        self._post = PostFile(path)
        self._points: dict[int, MeshPoints] = {}
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
        """Give sub-increment and increment of each output of `quantity`."""
        self._check_whole()
        name = self._name(quantity)
        return [_key(one) for one in self._post.increments if name in self._held(one)]

    def field(self, quantity: str, key: Key) -> Field:
        """Read `quantity` at one of its `keys`.

        Of element values: nodes that lie in one layer, or with `across_materials`
        all, those between layers with the mean over all elements there.
        """
        name = self._name(quantity)
        one = next(
            x for x in reversed(self._post.increments) if _key(x) == key and name in self._held(x)
        )
        held = self._held(one)[name]
        if isinstance(held, NodalQuantity):
            components, unit = nodal_components(held), nodal_unit(held)
            points = self._mesh(one)
            keep = ~_pressure_nodes(points)
            rows = np.flatnonzero(keep)
            nodes = points.mesh.node_ids[rows]
            values = self._nodal(one, held)[rows]
        else:
            components, unit = held.components, held.unit
            nodes, values = self._one_value_a_node(one, held)
        bad = np.argwhere(~np.isfinite(values))
        if bad.size:
            raise ResultError(
                f"{name} of increment {one.increment}, node {nodes[bad[0][0]]}: "
                f"{components[bad[0][1]]} is {values[tuple(bad[0])]}",
                self.path,
            )
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

    def places(self) -> Iterator[tuple[IntArray, FloatArray, BoolArray]]:
        """Yield nodes, coordinates ``(n, 3)`` in mm, and which have elements."""
        if not self._post.meshes:
            raise ResultError("no mesh in it, so no coordinates", self.path)
        points = self._mesh_of(0)
        if not points.mesh.node_ids.size:
            raise ResultError("no nodes in it, so no coordinates", self.path)
        keep = ~_pressure_nodes(points)
        yield (points.mesh.node_ids[keep], points.mesh.coordinates_mm[keep], points.bearing[keep])

    def frames(self, quantities: Sequence[str] | None, derived: Sequence[str]) -> Iterator[Frame]:
        """Look through the file now; yield its increments when they are asked for.

        A point of the scene is a node as one layer has it: between layers stress
        jumps, as it does in the model.
        """
        self._check_whole()
        names = None
        if quantities is not None:
            names = [self._name(quantity) for quantity in quantities]
        unusable = [name for name in derived if DERIVED[name][0] != ("STRESS",)]
        if unusable:
            raise UsageError(
                f"{unusable[0]} takes {' and '.join(DERIVED[unusable[0]][0])}: of a "
                "Marc file it is post code 48"
            )
        return self._frames(names, derived)

    def _frames(self, names: Sequence[str] | None, derived: Sequence[str]) -> Iterator[Frame]:
        scenes = {}
        for one in self._post.increments:
            held = self._held(one)
            wanted = [name for name in held if names is None or name in names]
            if not wanted:
                self._options.note(f"left out: increment {one.increment}, it has none")
                continue
            points = self._mesh(one)
            if one.mesh not in scenes:
                scenes = {one.mesh: points.scene()}
                self._tell_mesh(points)
            values = {}
            for name in wanted:
                quantity = held[name]
                if isinstance(quantity, NodalQuantity):
                    values[name] = self._nodal(one, quantity)[points.rows]
                else:
                    values[name] = self._at_points(one, quantity, points)
            values.update(self._derived(one, held, values, points, derived))
            flat = {
                name: value[:, 0] if value.ndim == 2 and value.shape[1] == 1 else value
                for name, value in values.items()
            }
            yield Frame(one.time_s * MS_PER_S, scenes[one.mesh], flat)

    def _derived(
        self,
        one: PostIncrement,
        held: dict[str, NodalQuantity | ElementQuantity],
        values: dict[str, FloatArray],
        points: MeshPoints,
        derived: Sequence[str],
    ) -> dict[str, FloatArray]:
        """Compute what follows from the stress tensor that is there."""
        tensors = [
            quantity
            for name, quantity in held.items()
            if isinstance(quantity, ElementQuantity)
            and quantity.is_tensor
            and quantity.codes[0] in STRESS_CODES
            and name in values
        ]
        if not tensors:
            return {}
        best = min(tensors, key=lambda one: STRESS_CODES.index(one.codes[0]))
        field = Field(
            name="STRESS",
            step=one.sub_increment,
            increment=one.increment,
            time_ms=one.time_s * MS_PER_S,
            components=best.components,
            units=(PA,) * 6,
            nodes=points.nodes,
            values=values[best.name],
        )
        with np.errstate(over="ignore", invalid="ignore"):
            return {name: derived_of(name, {"STRESS": field}) for name in derived}

    def _one_value_a_node(
        self, one: PostIncrement, quantity: ElementQuantity
    ) -> tuple[IntArray, FloatArray]:
        points = self._mesh(one)
        self._tell_mesh(points)
        at_points = self._at_points(one, quantity, points)
        between = points.met > 1
        if between.any() and not self._options.across_materials:
            count = np.unique(points.rows[between]).size
            self._options.note(
                f"left out: {count} nodes lie between layers, where a mean belongs to "
                "none; --across-materials takes it"
            )
            at_points = at_points[~between]
            rows = points.rows[~between]
            order = np.argsort(rows, kind="stable")
            return points.mesh.node_ids[rows[order]], at_points[order]
        share = points.elements_at()[:, None]
        rows, place = np.unique(points.rows, return_inverse=True)
        total = np.zeros((rows.size, at_points.shape[1]))
        np.add.at(total, place, at_points * share)
        elements = np.bincount(place, share[:, 0], rows.size)
        return points.mesh.node_ids[rows], total / elements[:, None]

    def _at_points(
        self, one: PostIncrement, quantity: ElementQuantity, points: MeshPoints
    ) -> FloatArray:
        every = np.arange(points.mesh.element_ids.size)
        values = self._post.element_values(one.row, every)[:, :, quantity.columns]
        found = points.averaged(values, self._options.method, self.path)
        return self._in_our_unit(found, quantity.unit)

    def _nodal(self, one: PostIncrement, quantity: NodalQuantity) -> FloatArray:
        values = self._post.nodal_values(one.row, quantity.name)
        return self._in_our_unit(values, nodal_unit(quantity))

    def _in_our_unit(self, values: FloatArray, unit: str) -> FloatArray:
        if unit != PA or not np.isfinite(values).all():
            return values
        return in_pa(values, self._options, self.path)

    def _held(self, one: PostIncrement) -> dict[str, NodalQuantity | ElementQuantity]:
        """Give the quantities of an increment by name."""
        found: dict[str, NodalQuantity | ElementQuantity] = {
            quantity.name: quantity for quantity in one.nodal if not quantity.is_complex
        }
        if one.has_element_values:
            for quantity in element_quantities(self._post.codes):
                found.setdefault(quantity.name, quantity)
        return found

    def _name(self, word: str) -> str:
        """Give the name of the quantity that `word` stands for."""
        names = list(dict.fromkeys(n for one in self._post.increments for n in self._held(one)))
        plain = word.casefold()
        same = [name for name in names if name.casefold() == plain]
        close = same or [name for name in names if name.casefold().startswith(plain)]
        if len(close) == 1:
            return close[0]
        if close:
            raise UsageError(f"{word!r} may be {' or '.join(close)}")
        raise ResultError(f"no {word} in it, it holds {', '.join(names) or 'nothing'}", self.path)

    def _mesh(self, one: PostIncrement) -> MeshPoints:
        return self._mesh_of(one.mesh)

    def _mesh_of(self, row: int) -> MeshPoints:
        if row not in self._points:  # one at a time
            self._points = {row: MeshPoints(self._post.meshes[row], self.path)}
        return self._points[row]

    def _check_whole(self) -> None:
        if not self._checked:
            check_whole(self._post, self._options)
        self._checked = True

    def _tell_mesh(self, points: MeshPoints) -> None:
        if points.unknown_types:
            types = ", ".join(map(str, points.unknown_types))
            self._options.note(f"left out: elements of unknown type {types}")
        if not points.layers.told:
            self._options.note(UNTOLD)


def _pressure_nodes(points: MeshPoints) -> BoolArray:
    """Nodes that only stand behind the corners of elements, ``(N,)``."""
    mesh = points.mesh
    used = np.isin(mesh.node_ids, mesh.connectivity)
    drawn = points.bearing
    if points.unknown_types:  # any node of theirs may be a corner
        unknown = np.isin(mesh.element_types, points.unknown_types)
        drawn = drawn | np.isin(mesh.node_ids, mesh.connectivity[unknown])
    return used & ~drawn


def _key(one: PostIncrement) -> Key:
    return one.sub_increment, one.increment
