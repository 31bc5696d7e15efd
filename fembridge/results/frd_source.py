"""A ``.frd`` as it is asked for: histories at nodes, whole fields, its mesh.

Stress at a node is the mean over the elements there. On a layer boundary that mean belongs to
neither layer (0.011 MPa measured between 0.0005 and 0.022), so such a node is refused unless
``across_materials`` asks for it. Quantities are joined by step and increment, never by position: a
run that diverged has one more DISP than STRESS, and that last one never converged.

CalculiX has no units. Lengths are taken as mm, times as s, and stress in `ReadOptions.stress_unit`;
what comes out is mm, ms and Pa, for stresses and for energy densities (1 Pa is 1 J/m³).
"""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from decks.unit_system import UnitSystem, unit_system_in
from fembridge.errors import ResultError, UsageError
from fembridge.results.byte_file import ByteFile
from fembridge.results.fields import VERTEX, Field, Scene, SceneCells, rows_of
from fembridge.results.frd import (
    COMPONENTS,
    KIND_OF_TYPE,
    NODES_OF_TYPE,
    STRESS,
    UNKNOWN_MATERIAL,
    FrdBlock,
    FrdIndex,
    attempts_of,
    block_table,
    element_rows,
    imaginary,
    materials_at,
    node_ids,
    values_at,
)
from fembridge.results.history import OF_STRESS, name_in, printed_digit_ms
from fembridge.results.read_options import ReadOptions
from fembridge.results.source import FieldSource, check_finite, field_of
from fembridge.results.stress import OneSidedStress, clear_shear
from fembridge.trace import MS_PER_S
from fembridge.typing import BoolArray, FloatArray, IntArray, Table

Outputs = Sequence[dict[str, FrdBlock]]

# An array of this size is made and dropped, untouched, before fields are read: glibc
# then keeps memory of up to that size for the next field, instead of handing its
# pages back and faulting them in again at each increment (benchmarks: half the time
# of a float64 file, a quarter of a text one). Elsewhere it does nothing.
_KEPT_BYTES = 1 << 23
_HEADING_BYTES = 4096  # in which a heading is sought
_NO_RECORDS = " has 0 records: with OUTPUT=3D CalculiX writes none for an NSET of a plane model; "
_NO_RECORDS += "use OUTPUT=2D"


class FrdSource(FieldSource[FrdBlock]):
    """An open ``.frd``."""

    def __init__(self, file: ByteFile, options: ReadOptions) -> None:
        super().__init__(file, options)
        self._index = FrdIndex(file)

    def unit_system(self) -> UnitSystem | None:
        """That of the deck's heading, which CalculiX copies to the start of its results."""
        return unit_system_in(self.file.peek(0, _HEADING_BYTES).decode("latin-1"))

    def describe(self) -> Table:
        """Mesh, quantities, increments, what is wrong; and sets of the deck beside."""
        from fembridge.results.nodes import sets_beside

        index = self._index
        words = (self.file.change, index.problem())
        storage = ("ASCII", "ASCII", "float32", "float64")
        quantities = []
        for name in index.names:
            first, *_ = blocks = index.named(name)
            kind = storage[first.form.flag]
            quantities.append(self.quantity_table(name, blocks, self._nodes_of(first), kind))
        return {
            "format": "ccx-frd",
            "bytes": index.size,
            "mesh_nodes": None if index.nodes is None else index.nodes.records,
            "elements": None if index.elements is None else index.elements.records,
            "materials": dict(sorted(index.materials.items())),
            "sets": sets_beside(self.path),
            "quantities": quantities,
            "remarks": list(index.remarks),
            "problem": "; ".join(word for word in words if word) or None,
        }

    def _nodes_of(self, block: FrdBlock) -> IntArray:
        """Its nodes, each once; those of the mesh are read once for all blocks of all of it."""
        nodes = self._index.nodes
        whole = nodes is not None and nodes.records == block.records and not block.free
        return self._mesh_nodes if whole else np.unique(node_ids(self.file, block))

    @cached_property
    def _mesh_nodes(self) -> IntArray:
        nodes = self._index.nodes
        return np.empty(0, dtype=np.int64) if nodes is None else node_ids(self.file, nodes)

    def outputs(self) -> list[dict[str, FrdBlock]]:
        """Blocks of each output that counts, in file order.

        An output is what CalculiX writes at one increment (or of one mode): blocks with the
        same step and increment that follow each other. A run that did not end well may close
        with one that never converged: stress is written of converged increments alone, so a
        STRESS block shows convergence; without one the ``.sta`` file has to.
        """
        index, options = self._index, self.options
        problem = index.problem()
        for remark in index.remarks:
            options.note(remark)
        if problem is not None:
            words = "; ".join(filter(None, (self.file.change, *index.remarks, problem)))
            if not index.blocks:
                raise ResultError(words, self.path)
            options.refuse(words, self.path)
        outputs: list[dict[str, FrdBlock]] = []
        last = (0, 0)
        for block in index.blocks:
            if not outputs or block.name in outputs[-1] or block.key != last:
                outputs.append({})
            outputs[-1][block.name], last = block, block.key
        if outputs and not index.ended:
            failed = {(row.step, row.increment): row.failed for row in attempts_of(self.path)}
            if failed.get(last, STRESS not in outputs[-1]):
                options.note(f"dropped step {last[0]}, increment {last[1]}: not converged")
                outputs.pop()
        if not outputs:
            words = "no whole, converged increment in it"
            if not index.blocks:  # and yet it ended well
                words = (
                    "a mesh and no results: the deck has no *NODE FILE or *EL FILE; its prints, "
                )
                words += f"where it asks for any, are in {self.path.stem}.dat"
            raise ResultError(words, self.path)
        return self._with_records(outputs)

    def _with_records(self, outputs: Outputs) -> list[dict[str, FrdBlock]]:
        held = [{name: one for name, one in out.items() if one.records} for out in outputs]
        empty: dict[str, FrdBlock] = {}
        for name, one in ((name, one) for out in outputs for name, one in out.items()):
            if not one.records:
                empty.setdefault(name, one)  # the first
        for name, block in empty.items():
            # Where there is nothing else, all are named: what was asked for is among them.
            words = str(block) if any(held) else str(block).replace(name, ", ".join(empty), 1)
            words += _NO_RECORDS
            if not any(held):
                raise ResultError(words, self.path)
            self.options.note(f"left out: {words}")
        return [output for output in held if output]

    def having(self, outputs: Outputs, names: Sequence[str]) -> list[dict[str, FrdBlock]]:
        """Outputs that have all quantities `names`, and these alone.

        Raises
        ------
        ResultError
            One has some and not all, or stress or displacement is gone after an output of the
            same step that has it, and `partial` is not set.
        """
        had, others = set[int](), set[int]()
        found = []
        for output in outputs:
            step, increment = next(iter(output.values())).key
            absent = [name for name in names if name not in output]
            lost = step in had and not COMPONENTS.keys().isdisjoint(names)
            if len(absent) < len(names):
                had.add(step)
            if not absent:
                found.append({name: output[name] for name in names})
            elif len(absent) < len(names) or lost:
                # CalculiX writes them at every output of a step from the first that has them.
                words = f"step {step}, increment {increment} has no {absent[0]}"
                self.options.refuse(words, self.path, noted=f"dropped: {words}")
            else:
                others.add(step)
        if others:
            left = ", ".join(map(str, sorted(others)))
            self.options.note(f"left out: outputs without {' and '.join(names)} in step {left}")
        if not found:
            raise ResultError(f"no increment has all of {', '.join(names)}", self.path)
        return found

    def history_name(self, held: Sequence[str], quantity: str | None) -> str:
        """Stress, but for the real part of a complex one, else displacement, else the first."""
        stress = self._index.named(STRESS)[:1]
        tensor = stress and set(COMPONENTS[STRESS]) <= set(stress[0].components)
        if quantity in OF_STRESS or (
            quantity is None and tensor and STRESS in held and imaginary(STRESS) not in held
        ):
            quantity = STRESS
        name = self.field_name(held, quantity)
        for real in held:
            if (part := imaginary(real)) in held and name in (real, part):
                words = f"{real} is the real part of amplitudes, {part} the imaginary"
                self.options.note(words)
        return name

    def field_name(self, held: Sequence[str], quantity: str | None) -> str:
        """The name among those `held`; of one without records why there are none."""
        blocks = self._index.blocks
        empty = {b.name: b for b in reversed(blocks) if not b.records and b.name not in held}
        name = name_in(held if quantity is None else [*held, *empty], quantity, self.path)
        if name in empty:
            raise ResultError(f"{empty[name]}{_NO_RECORDS}", self.path)
        return name

    def at_nodes(self, blocks: Sequence[FrdBlock], nodes: Sequence[int]) -> FloatArray:
        """Values of one quantity, ``(T, node, component)``; stress inside one material."""
        values = values_at(self.file, blocks, nodes)
        if blocks[0].name == STRESS:
            self._as_modelled(nodes, values)
            inside = self._inside(nodes)
            if not inside.all():
                node, names = nodes[int(np.argmin(inside))], self._index.materials
                met = materials_at(self._index, [node])[:, 1].tolist()
                layers = " and ".join(names.get(one, f"material {one}") for one in met)
                raise ResultError(
                    f"node {node} is between {layers}: its stress is a mean "
                    "over both and belongs to neither; take a node inside one layer, or ask "
                    "for it with --across-materials (across_materials=True)",
                    self.path,
                )
        with np.errstate(over="ignore"):
            values *= [self.options.scale(unit) for unit in blocks[0].units]
        return values

    def everywhere(self, blocks: Sequence[FrdBlock]) -> tuple[IntArray, FloatArray]:
        """All nodes that any of `blocks` has, but for stress between materials."""
        nodes, values = super().everywhere(blocks)
        if blocks[0].name != STRESS:
            return nodes, values
        self._as_modelled(nodes.tolist(), values)
        inside = self._inside(nodes.tolist())
        if not inside.any():
            raise ResultError("no node with stress lies inside one material", self.path)
        if inside.all():
            return nodes, values
        self.options.note(
            f"left out: {(~inside).sum()} of {inside.size} nodes, between materials, where "
            "stress is a mean over them; --across-materials (across_materials=True) takes it"
        )
        return nodes[inside], values[:, inside]

    def _as_modelled(self, nodes: Sequence[int], stress: FloatArray) -> None:
        """Make stress the sum over branches of relaxing skin, without shear on a half's axis."""
        if self.options.branches:
            stress *= self._branches(nodes)[:, None]
        if self.options.on_axis:
            clear_shear(stress, nodes, self.options.on_axis)

    def _branches(self, nodes: Sequence[int]) -> FloatArray:
        return np.array([self.options.branches.get(node, 1) for node in nodes], dtype=np.float64)

    def _inside(self, nodes: Sequence[int]) -> BoolArray:
        """Which of `nodes` are inside one material, or are taken so."""
        if self.options.across_materials:
            return np.ones(len(nodes), dtype=np.bool_)
        held, met = np.unique(materials_at(self._index, nodes)[:, 0], return_counts=True)
        rows = rows_of(np.array(nodes, dtype=np.int64), held)
        inside: BoolArray = np.append(met, 0)[rows] <= self._branches(nodes)  # last: no element
        return inside

    def whole(self, block: FrdBlock, known: IntArray | None = None) -> Field:
        """All of `block`; nodes that are `known` are kept once."""
        if known is None:
            np.empty(_KEPT_BYTES, dtype=np.uint8)
        nodes, values = block_table(self.file, block)
        scales = [self.options.scale(unit) for unit in block.units]
        with np.errstate(over="ignore"):  # a number that overflows is not finite
            if set(scales) != {1.0}:
                values *= scales if len(set(scales)) > 1 else scales[0]
        same = known is not None and np.array_equal(nodes, known)
        return field_of(block, known if same and known is not None else nodes, values, self.path)

    def last_digit_ms(self, times_ms: FloatArray) -> FloatArray:
        """Below one second a ``.frd`` prints six digits, above it ten."""
        return printed_digit_ms(times_ms, np.where(times_ms < MS_PER_S, 6, 10))

    def places(self) -> tuple[IntArray, FloatArray, BoolArray]:
        """Nodes, coordinates ``(n, 3)`` in mm, and which have stress, or without any results."""
        index = self._index
        blocks = [block for block in index.named(STRESS) or index.blocks if block.records]
        if not blocks:
            held = ", ".join(index.names) or "nothing"
            raise ResultError(f"no results at nodes, it holds {held}", self.path)
        held_by = np.unique(node_ids(self.file, blocks[0]))
        nodes, at_mm = self._coordinates()
        return nodes, at_mm, np.isin(nodes, held_by)

    def sides(self, node: int, set_name: str = "") -> tuple[OneSidedStress, ...]:
        """Stress at `node` for each material there, lowest number first.

        A ``.frd`` holds one stress a node, the mean over all elements there. What the solver
        computed is in the ``.dat`` beside it, at integration points inside elements
        (``*EL PRINT, ELSET=...`` with S): here they are extrapolated to the node, element by
        element, and averaged over the elements of one material, never over two.

        The points of an element are those of the brick that CalculiX makes of it: x fastest,
        then y, then z. In a plane element the layers through the thickness are equal but for
        rounding, and their mean is taken. Values are the element's own system where it has one
        (``*ORIENTATION``); without one they are global.
        """
        from fembridge.results.extrapolation import brick_weights
        from fembridge.results.printed import read_point_stress

        if not set_name:
            words = "--one-sided takes the element set that the .dat beside a .frd prints"
            raise UsageError(words)
        mesh, beside = self.mesh(), self.path.with_suffix(".dat")
        around = [
            (int(cells.ids[row]), int(cells.material[row]), cells.kind, corner)
            for cells in mesh.cells
            for row, corner in np.argwhere(mesh.nodes[cells.rows] == node).tolist()
        ]
        if not around:
            raise ResultError(f"node {node} is at no element of the mesh", self.path)
        times_ms, points, tensor_pa = read_point_stress(beside, set_name, self.options)
        sides: dict[int, list[tuple[int, FloatArray]]] = {}
        for element, material, kind, corner in around:
            rows = np.flatnonzero(points[:, 0] == element)
            if not rows.size:
                raise ResultError(
                    f"set {set_name} has no stress of element {element}, which is at node "
                    f"{node}: its side would be a guess",
                    beside,
                )
            order = points[rows, 1]
            try:
                if not np.array_equal(np.sort(order), np.arange(1, order.size + 1)):
                    raise ValueError(f"points {', '.join(map(str, order))}, expected all from 1")
                weights = brick_weights(kind, order.size, corner)[order - 1]
            except ValueError as error:
                raise ResultError(f"element {element}: {error}", beside) from error
            there = np.einsum("p,tpc->tc", weights, tensor_pa[:, rows])
            sides.setdefault(material, []).append((element, there))
        return tuple(
            OneSidedStress(
                node=node,
                material=material,
                name=mesh.materials.get(material, f"material {material}"),
                elements=tuple(element for element, _ in sides[material]),
                times_ms=times_ms,
                tensor_pa=np.mean([tensor for _, tensor in sides[material]], axis=0),
            )
            for material in sorted(sides)
        )

    def scene(self, outputs: Outputs) -> tuple[Outputs, Scene]:
        """Increments with values at as many nodes as any, and the mesh or those nodes of it."""
        outputs = _fullest(outputs, self.options)
        scene = self._drawn(outputs, self.mesh())
        between = int((scene.met > 1).sum())
        if between:
            self.options.note(
                f"{between} nodes are between materials ('materials' is 2 or "
                "more there): nodal stress and strain are a mean over them and belong "
                "to none"
            )
        return outputs, scene

    def mesh(self) -> Scene:
        """Nodes in file order, elements by kind; of plane ones z is 0."""
        index, file = self._index, self.file
        if index.nodes is None or index.elements is None:
            kind = "nodes" if index.nodes is None else "elements"
            words = "; ".join(harm.problem for harm in index.damage)
            raise ResultError(f"no whole block of {kind}{words and ': '}{words}", file.path)
        if not index.nodes.records:
            raise ResultError("node block: no nodes", file.path)
        nodes, points_mm = self._coordinates()
        if np.unique(nodes).size != nodes.size:
            raise ResultError("node block: a node is duplicate", file.path)
        parts: dict[int, list[tuple[IntArray, IntArray, IntArray]]] = {}
        for one in element_rows(file, index.elements):
            expected = NODES_OF_TYPE.get(one.type)
            if expected != one.corners.shape[1]:
                raise ResultError(
                    f"element {one.ids[0]} of type {one.type} has "
                    f"{one.corners.shape[1]} nodes, expected {expected or 'another type'}",
                    file.path,
                )
            rows = rows_of(one.corners, nodes)
            if (rows < 0).any():
                absent = one.corners[rows < 0][0]
                raise ResultError(
                    f"an element has node {absent}, which the mesh has not", file.path
                )
            parts.setdefault(one.type, []).append((one.ids, one.material, rows))
        cells = tuple(
            SceneCells(KIND_OF_TYPE[kind], *map(np.concatenate, zip(*parts[kind], strict=True)))
            for kind in sorted(parts)
        )
        # Inside a layer 1 material meets, on its boundary 2, at a node of no element none.
        met = np.zeros(nodes.size, dtype=np.int64)
        for number in {number for one in cells for number in np.unique(one.material)}:
            touched = [one.rows[one.material == number].ravel() for one in cells]
            met[np.unique(np.concatenate(touched))] += 1
        return Scene(points_mm, nodes, cells, met, dict(index.materials))

    def _coordinates(self) -> tuple[IntArray, FloatArray]:
        """Numbers and coordinates of the nodes, in file order."""
        block, path = self._index.nodes, self.path
        if block is None or not block.records:
            raise ResultError("no node block, so no coordinates", path)
        nodes, points_mm = block_table(self.file, block)
        check_finite(block, nodes, points_mm, path)
        return nodes, points_mm * self.options.length_mm

    def _drawn(self, outputs: Outputs, scene: Scene) -> Scene:
        """`scene`; or its nodes that have values alone, where no element has them at all nodes.

        What is left out, or has no value, is noted once for the file.
        """
        blocks: dict[tuple[str, int], FrdBlock] = {}
        for output in outputs:
            for name, one in output.items():
                blocks.setdefault((name, one.records), one)
        held = {key: node_ids(self.file, one) for key, one in blocks.items()}
        every = [np.isin(scene.nodes, ids) for ids in held.values()]
        there = np.logical_or.reduce([np.zeros(scene.nodes.size, dtype=np.bool_), *every])
        note, size = self.options.note, scene.nodes.size
        for (name, _), ids in held.items():
            strange = ids[~np.isin(ids, scene.nodes)]
            if strange.size:
                note(
                    f"left out: {name} has {strange.size} nodes that the mesh has not, "
                    f"{strange[0]} among them"
                )
        if there.any() and not any(there[cells.rows].all(axis=1).any() for cells in scene.cells):
            note(f"values at {there.sum()} of {size} nodes, at no element's all: nodes alone")
            ids = np.arange(there.sum())
            cells = SceneCells(VERTEX, ids, np.full(ids.size, UNKNOWN_MATERIAL), ids[:, None])
            at_mm, nodes, met = scene.points_mm[there], scene.nodes[there], scene.met[there]
            return Scene(at_mm, nodes, (cells,), met, {})
        for (name, _), has in zip(held, every, strict=True):
            if not has.all():
                note(f"{name} has {has.sum()} of {size} nodes; the others are NaN")
        return scene


def _fullest(outputs: Outputs, options: ReadOptions) -> Outputs:
    """The increments that hold something at as many nodes as any.

    Those are whole fields in a file that has them now and then, else the afferents alone.
    """
    most: dict[str, int] = {}
    for output in outputs:
        for name, one in output.items():
            most[name] = max(one.records, most.get(name, 0))
    kept = [
        output
        for output in outputs
        if any(one.records == most[name] for name, one in output.items())
    ]
    if len(kept) < len(outputs):
        left = len(outputs) - len(kept)
        options.note(
            f"left out: {left} of {len(outputs)} increments, at fewer nodes than the others"
        )
    return kept
