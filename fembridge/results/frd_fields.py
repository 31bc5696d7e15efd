"""Whole fields of a ``.frd``, and its mesh: every node, one increment at a time.

In memory are the increment that is read and, as long as the caller keeps it, the one
before, whatever the size of the file. Times are the solver's, over all steps.

CalculiX names no units, its quantities do: decks speak mm, N and s, stress is in what
the reader's options say. What leaves here is Pa for stresses and for energy densities
(1 Pa is 1 J/m³), mm, mm/s, N. A quantity that is not listed is left as the file has it,
with the unit "".
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from fembridge.errors import ResultError, UsageError
from fembridge.results.byte_file import ByteFile
from fembridge.results.fields import (
    VERTEX,
    Field,
    Frame,
    Key,
    Scene,
    SceneCells,
    arrays_of,
    derived_of,
    history_of,
    rows_of,
    spread,
)
from fembridge.results.frd import (
    COMPONENTS,
    NODES_OF_TYPE,
    STRESS,
    UNKNOWN_MATERIAL,
    FrdBlock,
    FrdIndex,
    MeshBlock,
    Output,
    characters_of,
    check_unchanged,
    element_rows,
    having,
    irregular_records,
    materials_at,
    no_records,
    node_ids,
    outputs_of,
    record_ids,
    record_values,
    unrounded,
    values_at,
)
from fembridge.results.history import FREQUENCY, NAMES, TIME, History, name_in, one_axis, word_of
from fembridge.results.read_options import NotFiniteError, ReadOptions
from fembridge.results.readers import result_file
from fembridge.results.stress import DERIVED
from fembridge.typing import BoolArray, FloatArray, IntArray

KIND_OF_TYPE = {
    1: "he8", 2: "pe6", 3: "te4", 4: "he20", 5: "pe15", 6: "te10",
    7: "tr3", 8: "tr6", 9: "qu4", 10: "qu8", 11: "be2", 12: "be3",
}  # fmt: skip

_TEXT_BYTES = 3 << 17  # taken at a time
# An array of this size is made and dropped, untouched, before fields are read: glibc
# then keeps memory of up to that size for the next field, instead of handing its
# pages back and faulting them in again at each increment (benchmarks: half the time
# of a float64 file, a quarter of a text one). Elsewhere it does nothing.
_KEPT_BYTES = 1 << 23

_PA = "Pa"
# By quantity; one that ends in I is the imaginary part of the same.
_UNIT_OF_QUANTITY = {
    "DISP": "mm", "VELO": "mm/s", "FORC": "N",
    "STRESS": _PA, "STRPOS": _PA, "STRMID": _PA, "STRNEG": _PA, "ZZSTR": _PA,
    "MSTRESS": _PA, "ENER": _PA,
    "TOSTRAIN": "1", "MESTRAIN": "1", "PE": "1", "ERROR": "%",
}  # fmt: skip
# By component, in quantities that mix units.
_UNIT_OF_COMPONENT = {
    "COPEN": "mm", "CSLIP1": "mm", "CSLIP2": "mm",
    "CPRESS": _PA, "CSHEAR1": _PA, "CSHEAR2": _PA,
}  # fmt: skip
_UNIT_OF_MAGNITUDE = {"PDISP": "mm", "PSTRESS": _PA}


def read_mesh(path: Path | str) -> Scene:
    """The mesh of a ``.frd``, or of a run folder's.

    Raises
    ------
    ResultError
        The file is absent, foreign, has no mesh, or its mesh is damaged.
    """
    with ByteFile(result_file(path)) as file:
        return _mesh(FrdIndex(file))


def _mesh(index: FrdIndex, length_mm: float = 1.0) -> Scene:
    """Nodes in file order, elements by kind; of plane ones (tr3, tr6, qu4, qu8) z is 0."""
    file = index.file
    if index.nodes is None or index.elements is None:
        kind = "nodes" if index.nodes is None else "elements"
        words = "; ".join(harm.problem for harm in index.damage)
        raise ResultError(f"no whole block of {kind}{words and ': '}{words}", file.path)
    if not index.nodes.records:
        raise ResultError("node block: no nodes", file.path)
    nodes, points_mm = _table(file, _node_block(file, index.nodes), (length_mm,))
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
            raise ResultError(f"an element has node {absent}, which the mesh has not", file.path)
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


class FrdSource(AbstractContextManager["FrdSource"]):
    """An open ``.frd``, see `fembridge.results.fields.FieldSource`."""

    def __init__(self, path: Path, options: ReadOptions) -> None:
        self.path, self._options = path, options
        with ExitStack() as opened:
            self._file = opened.enter_context(ByteFile(path))
            self._index = FrdIndex(self._file)
            self._opened = opened.pop_all()

    def __exit__(self, *error: object) -> None:
        self._opened.close()

    def keys(self, quantity: str) -> list[Key]:
        """Step and increment of each output of `quantity`, in file order."""
        outputs = outputs_of(self._index, self._options)
        held = having(self._index, outputs, (quantity,), self._options)
        return list(dict.fromkeys(output[quantity].key for output in held))

    def field(self, quantity: str, key: Key) -> Field:
        """`quantity` at one of its `keys`."""
        block = [one for one in self._index.named(quantity) if one.key == key][-1]
        return _field(self._file, block, self._options)

    def fields(self, quantity: str) -> Iterator[Field]:
        """`quantity` at each of its outputs; what is absent is refused at once."""
        outputs = outputs_of(self._index, self._options)
        wanted = having(self._index, outputs, (quantity,), self._options)
        return self._fields([output[quantity] for output in wanted])

    def _fields(self, blocks: Sequence[FrdBlock]) -> Iterator[Field]:
        np.empty(_KEPT_BYTES, dtype=np.uint8)
        nodes = np.empty(0, dtype=np.int64)
        for block in blocks:
            try:
                field = _field(self._file, block, self._options, nodes)
            except NotFiniteError as error:
                _drop(block, error, self._options)
                continue
            nodes = field.nodes
            yield field
            del field  # kept by the caller alone
        check_unchanged(self._file, self._options)

    def places(self) -> Iterator[tuple[IntArray, FloatArray, BoolArray]]:
        """Nodes, coordinates ``(n, 3)`` in mm, and which have stress, or without any results."""
        file, index = self._file, self._index
        blocks = [block for block in index.named(STRESS) or index.blocks if block.records]
        if not blocks:
            held = ", ".join(index.names) or "nothing"
            raise ResultError(f"no results at nodes, it holds {held}", self.path)
        if index.nodes is None or not index.nodes.records:
            raise ResultError("no node block, so no coordinates", self.path)
        held_by = np.unique(node_ids(file, blocks[0]))
        nodes, at_mm = _table(file, _node_block(file, index.nodes), (self._options.length_mm,))
        yield nodes, at_mm, np.isin(nodes, held_by)

    def history(
        self, nodes: Sequence[int] | None, quantity: str | None, modes: bool, last: bool = False
    ) -> History:
        """`quantity` at `nodes` as it is, see `fembridge.results.fields.FieldSource`."""
        index, options = self._index, self._options
        outputs = outputs_of(index, options)
        held = tuple(dict.fromkeys(name for output in outputs for name in output))
        name = self._default_name(held)
        if quantity is not None:
            name = name_in(held, quantity, self.path)
        parts = {one: f"{one[:7]}I" for one in held}  # eight letters are printed
        whole = next(
            (one for one, part in parts.items() if name in (one, part) and part in held), ""
        )
        outputs = having(index, outputs, (name,), options)
        found = [output[name] for output in outputs]
        axes = self._axes(found)
        axis = one_axis(name, axes, modes, options)
        if whole:
            options.note(f"{whole} is the real part of amplitudes, {parts[whole]} the imaginary")
        found = [one for one, of in zip(found, axes, strict=True) if of == axis]
        blocks = [one for one in found if one.records]
        if not blocks:
            raise no_records(found[0], self.path)
        if len(blocks) < len(found):
            options.note(f"left out: {len(found) - len(blocks)} outputs of {name} without records")
        blocks = blocks[-1:] if last else blocks
        components = COMPONENTS.get(name, blocks[0].components)
        if not set(components) <= set(blocks[0].components):
            components = blocks[0].components
        for block in blocks:
            if absent := set(components) - set(block.components):
                words = f"{block} has no component {min(absent)}, an output before it has"
                raise ResultError(words, self.path)
        if nodes is None:
            return self._everywhere(blocks, axis)
        wanted = [int(node) for node in nodes]
        outputs, values_of = values_at(
            index, [{name: one} for one in blocks], {name: wanted}, options, components
        )
        blocks, values = [output[name] for output in outputs], values_of[name]
        if name not in COMPONENTS:
            values *= [options.scale(_unit(name, one)) for one in components]
        return History(
            quantity=word_of(name),
            components=components,
            units=tuple(_unit(name, one) for one in components),
            nodes=tuple(wanted),
            at=_times_ms(blocks) if axis == TIME else np.array([one.value for one in blocks]),
            values=values,
            keys=np.array([one.key for one in blocks], dtype=np.int64),
            axis=axis,
        )

    def _axes(self, blocks: Sequence[FrdBlock]) -> list[str]:
        """What each block is over; one with an imaginary part is over frequency."""
        parts = (f"{name[:7]}I" for name in self._index.names)  # eight letters are printed
        complex_ones = {block.key for part in parts for block in self._index.named(part)}
        return [
            FREQUENCY if one.over_time and one.key in complex_ones else one.axis for one in blocks
        ]

    def _default_name(self, held: Sequence[str]) -> str:
        """Stress, but for the real part of a complex one, else displacement, else the first."""
        names = [one for one in held if any(block.records for block in self._index.named(one))]
        if STRESS in names and f"{STRESS}I" not in held:
            block = self._index.named(STRESS)[0]
            if set(COMPONENTS[STRESS]) <= set(block.components):
                return STRESS
        return next((one for one in NAMES["displacement"] if one in names), (*names, *held)[0])

    def _everywhere(self, blocks: Sequence[FrdBlock], axis: str) -> History:
        """All nodes that any of `blocks` has, but for stress between materials."""
        options, ids = self._options, np.empty(0, dtype=np.int64)
        fields = []
        for block in blocks:
            one = _field(self._file, block, options, ids)
            fields.append(replace(one, axis=axis))
            ids = one.nodes
        found = history_of(fields)
        if found.over_time:
            found = replace(found, at=_times_ms(blocks))
        if blocks[0].name == STRESS:  # as `values_at` has it
            branches = np.array([options.branches.get(node, 1) for node in found.nodes])
            values = found.values * branches[:, None]
            on_axis = np.isin(found.nodes, list(options.on_axis))
            if on_axis.any():
                values[:, on_axis, found.components.index("SXY")] = 0.0
            found = replace(found, values=values)
        if blocks[0].name == STRESS and not options.across_materials:
            held, counts = np.unique(
                materials_at(self._index, found.nodes)[:, 0], return_counts=True
            )
            met = np.zeros(branches.size, dtype=np.int64)
            met[np.searchsorted(found.nodes, held)] = counts  # both rise
            inside = met <= branches
            if not inside.any():
                raise ResultError("no node with stress lies inside one material", self.path)
            if not inside.all():
                options.note(
                    f"left out: {(~inside).sum()} of {inside.size} nodes, between materials, where "
                    "stress is a mean over them; --across-materials (across_materials=True) "
                    "takes it"
                )
            nodes = tuple(np.array(found.nodes)[inside].tolist())
            found = replace(found, nodes=nodes, values=found.values[:, inside])
        check_unchanged(self._file, options)
        return found

    def frames(
        self, quantities: Sequence[str] | None, derived: Sequence[str], modes: bool = False
    ) -> Iterator[Frame]:
        """Increments, or `modes`, one by one; the file is looked through at once."""
        index, options = self._index, self._options
        outputs = outputs_of(index, options)
        if quantities is not None:
            outputs = having(index, outputs, quantities, options)
        axes = self._axes([next(iter(output.values())) for output in outputs])
        axis = one_axis(", ".join(quantities or ["any quantity"]), axes, modes, options)
        outputs = [one for one, of in zip(outputs, axes, strict=True) if of == axis]
        outputs = _fullest(outputs, options)
        scene = self._drawn(outputs, _mesh(index, options.length_mm))
        between = int((scene.met > 1).sum())
        if between:
            options.note(
                f"{between} nodes are between materials ('materials' is 2 or "
                "more there): nodal stress and strain are a mean over them and belong "
                "to none"
            )
        return self._frames(outputs, axis, scene, derived)

    def _drawn(self, outputs: Sequence[Output], scene: Scene) -> Scene:
        """`scene`; or its nodes that have values alone, where no element has them at all nodes.

        What is left out, or has no value, is noted once for the file.
        """
        blocks: dict[tuple[str, int], FrdBlock] = {}
        for output in outputs:
            for name, one in output.items():
                blocks.setdefault((name, one.records), one)
        held = {key: node_ids(self._file, one) for key, one in blocks.items() if one.records}
        every = [np.isin(scene.nodes, ids) for ids in held.values()]
        there = np.logical_or.reduce([np.zeros(scene.nodes.size, dtype=np.bool_), *every])
        note, size = self._options.note, scene.nodes.size
        for block in blocks.values():
            if not block.records:
                note(f"left out: {block} has 0 records")
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

    def _frames(
        self, outputs: Sequence[Output], axis: str, scene: Scene, derived: Sequence[str]
    ) -> Iterator[Frame]:
        for output in outputs:
            fields = {}
            for name, block in output.items():
                try:
                    if block.records:
                        fields[name] = _field(self._file, block, self._options)
                except NotFiniteError as error:  # of this block, not of the others
                    self._options.note(f"left out: {block}: {error.problem}")
            if fields:
                first = next(iter(output.values()))
                time = first.time_ms if axis == TIME else first.value
                yield Frame(time, scene, _at_points(fields, scene, derived), axis == TIME)


def _fullest(outputs: Sequence[Output], options: ReadOptions) -> list[Output]:
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


def _at_points(
    fields: Mapping[str, Field], scene: Scene, derived: Sequence[str]
) -> dict[str, FloatArray]:
    """All values of an increment at the nodes of the mesh."""
    points, size = {}, scene.nodes.size
    rows = {name: rows_of(one.nodes, scene.nodes) for name, one in fields.items()}
    for name, one in fields.items():
        for word, values in arrays_of(one).items():
            points[word] = spread(values, rows[name], size)
    for name in derived:
        takes = DERIVED[name][0]
        if not all(quantity in fields for quantity in takes):
            continue
        # Of 1e200, no warning. What is no tensor, or at other nodes, is said at the end.
        with np.errstate(over="ignore", invalid="ignore"), suppress(UsageError):
            points[f"{name}_pa"] = spread(derived_of(name, fields), rows[takes[0]], size)
    return points


def _times_ms(blocks: Sequence[FrdBlock]) -> FloatArray:
    """Times of `blocks` ``(T,)``, without the rounding of the print if they are even."""
    return unrounded(np.array([one.time_ms for one in blocks]))


def _drop(block: FrdBlock, error: NotFiniteError, options: ReadOptions) -> None:
    if not options.partial:
        raise error
    options.note(f"dropped step {block.step}, increment {block.increment}: {error.problem}")


def _field(
    file: ByteFile, block: FrdBlock, options: ReadOptions, known: IntArray | None = None
) -> Field:
    """The whole of `block`; nodes that are `known` are kept once."""
    if block.records == 0:
        raise no_records(block, file.path)
    units = tuple(_unit(block.name, component) for component in block.components)
    scales = [options.scale(unit) for unit in units]
    nodes, values = _table(file, block, scales)
    return Field(
        name=block.name,
        step=block.step,
        increment=block.increment,
        time_ms=float("nan") if block.modal else block.time_ms,
        components=block.components,
        units=units,
        nodes=nodes if known is None or not np.array_equal(nodes, known) else known,
        values=values,
        axis=block.axis,
        axis_value=block.value,
    )


def _table(
    file: ByteFile, block: FrdBlock, scales: Sequence[float] = (1.0,)
) -> tuple[IntArray, FloatArray]:
    """Nodes ``(record,)`` and values ``(record, component)``, times `scales`, in file order.

    Text is taken some hundred kilobytes at a time: what is in memory beside the arrays
    does not grow with the block.

    Raises
    ------
    ResultError
        A record is not one, or a field no number.
    NotFiniteError
        A number is NaN or infinite.
    """
    if block.free:
        nodes, values = irregular_records(file, block)
    else:
        nodes = np.empty(block.records, dtype=np.int64)
        values = np.empty((block.records, len(block.components)), dtype=np.float64)
        step = max(1, _TEXT_BYTES // block.record_bytes)
        for at in range(0, block.records, step):
            characters = characters_of(file, block, at, step)
            nodes[at : at + step] = record_ids(file.path, [block], characters, at)
            values[at : at + step] = record_values(file.path, [block], characters)
    with np.errstate(over="ignore"):  # a number that overflows is not finite
        if set(scales) != {1.0}:
            values *= scales if len(set(scales)) > 1 else scales[0]
    if not np.isfinite(values).all():
        row, column = np.argwhere(~np.isfinite(values))[0].tolist()
        when = f"{block.axis} {block.value:g}" if block.modal else f"{block.time_ms:g} ms"
        raise NotFiniteError(
            f"node {nodes[row]} at {when}: {block.name} {block.components[column]} is "
            f"{values[row, column]}",
            file.path,
        )
    return nodes, values


def _node_block(file: ByteFile, nodes: MeshBlock) -> FrdBlock:
    """The node block as what it is: records of three numbers."""
    line_end = 2 if nodes.flag < 2 and file.peek(nodes.offset - 2, 1) == b"\r" else 1
    described = ("node block", 0, 0, 0.0, nodes.records, ("x", "y", "z"), nodes.flag, nodes.offset)
    block = FrdBlock(*described, line_end)
    regular = nodes.flag >= 2 or block.end + len(b" -3") + line_end == nodes.end
    return block if regular else FrdBlock(*described, line_end, free=True)


def _unit(name: str, component: str) -> str:
    """The unit of a component, once its values are scaled."""
    if component in _UNIT_OF_COMPONENT:
        return _UNIT_OF_COMPONENT[component]
    if name in _UNIT_OF_MAGNITUDE:
        if component.startswith("MAG"):
            return _UNIT_OF_MAGNITUDE[name]
        return "deg" if component.startswith("PHA") else ""
    plain = _UNIT_OF_QUANTITY.get(name.removesuffix("I"), "")
    return _UNIT_OF_QUANTITY.get(name, plain)
