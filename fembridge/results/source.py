"""An open result file of any format: what it holds, a quantity at nodes, whole fields.

A `Reader` names the `Source` of its format. A `FieldSource` is one with whole fields: a format
lists the outputs of a file, each with its quantities as a `Block`, and gives the values of one;
histories, fields and pictures follow from that here.
"""

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Generic, NoReturn, TypeVar

import numpy as np

from decks.unit_system import UnitSystem
from fembridge.errors import ResultError, UsageError
from fembridge.memory import check_unpacked
from fembridge.results.byte_file import ByteFile
from fembridge.results.fields import (
    Block,
    Field,
    Frames,
    Scene,
    arrays_of,
    derived_of,
    node_numbers,
    rows_of,
    spread,
)
from fembridge.results.history import (
    NAMES,
    OF_STRESS,
    STRESS,
    TIME,
    History,
    name_in,
)
from fembridge.results.read_options import NotFiniteError, ReadOptions
from fembridge.results.stress import DERIVED, OneSidedStress
from fembridge.tables import write_table
from fembridge.typing import BoolArray, FloatArray, IntArray, Table

LAST = "last"  # increment
_INCREMENT = re.compile(r"(?:(\d{1,9}):)?(\d{1,9})", re.ASCII)


class Source(AbstractContextManager["Source"]):
    """An open `file` that is read with `options`; a context manager that closes it.

    What a format does not have is refused here.
    """

    format = ""
    """Name of the reader that opened the file."""

    def __init__(self, file: ByteFile, options: ReadOptions) -> None:
        self.file, self.path, self.options = file, file.path, options

    def __exit__(self, *error: object) -> None:
        self.file.__exit__(*error)

    def describe(self) -> Table:
        """What the file holds."""
        return {"format": self.format, "bytes": self.file.size}

    def unit_system(self) -> UnitSystem | None:
        """The units that the file names; None where it names none."""
        return None

    def named_nodes(self) -> Sequence[int]:
        """Nodes that a file of curves names itself."""
        return ()

    def node_sets(self) -> Mapping[str, Sequence[Sequence[int]]] | None:
        """Its sets of nodes by name, in pieces; None of a format without sets."""
        return None

    def history(
        self,
        nodes: Sequence[int] | None,
        quantity: str | None = None,
        modes: bool = False,
        last: bool = False,
    ) -> History:
        """Each output of a quantity at `nodes`, as it is.

        `nodes` None takes all that an output has; of a stress without those between
        materials, unless the options allow them. `quantity` is a word of `history.NAMES` or
        the file's name; None takes stress, without one displacement, else the first there
        is. `modes` takes those of frequency and buckling steps where there are times, too;
        `last` the last output alone.
        """
        if modes or quantity not in (None, STRESS, *OF_STRESS):
            raise UsageError(f"{self.path}: it gives stress over time at nodes, nothing else")
        found = self.stress(nodes)
        return replace(found, at=found.at[-1:], values=found.values[-1:]) if last else found

    def stress(self, nodes: Sequence[int] | None) -> History:
        """Stress over time at `nodes`, in that order, or all: of a file of nothing else."""
        raise NotImplementedError

    def table(self, quantity: str | None = None) -> Iterator[Sequence[object]]:
        """What a printed file holds, or one quantity of it: columns, then row by row."""
        raise NotImplementedError

    def write_table(self, output: Path, quantity: str | None = None) -> tuple[tuple[str, ...], int]:
        """Write `table` as CSV to `output`; its columns and the count of rows."""
        rows = self.table(quantity)
        columns, count = tuple(map(str, next(rows))), 0

        def counted() -> Iterator[Sequence[object]]:
            nonlocal count
            for count, row in enumerate(rows, start=1):  # noqa: B007 - the last is taken
                yield row
            if not count:
                words = "no rows" if quantity is None else f"no {quantity} in it"
                raise ResultError(f"{words}: there is nothing to write", self.path)

        write_table(output, columns, counted())
        return columns, count

    def places(self) -> tuple[IntArray, FloatArray, BoolArray]:
        """Nodes, coordinates ``(n, 3)`` in mm, and which have stress."""
        raise UsageError(f"{self.path}: it has no mesh: choose nodes by number")

    def sides(self, node: int, set_name: str = "") -> tuple[OneSidedStress, ...]:
        """Stress at `node` as each material there has it; of printed points those of a set."""
        self._refuse_fields()

    def field(self, quantity: str, increment: str = LAST) -> Field:
        """`quantity` at one increment: ``last``, ``N`` or ``STEP:N``."""
        self._refuse_fields()

    def fields(self, quantity: str) -> Iterator[Field]:
        """`quantity` at each of its outputs; what is absent is refused at once."""
        self._refuse_fields()

    def frames(
        self, quantities: Sequence[str] | None, derived: Sequence[str], modes: bool = False
    ) -> Frames:
        """Increments, or `modes`, one by one, never both; the file is looked through at once."""
        self._refuse_fields()

    def _refuse_fields(self) -> NoReturn:
        raise UsageError(f"{self.path}: it gives histories at nodes, no whole fields")


_Block = TypeVar("_Block", bound=Block)


class FieldSource(Source, Generic[_Block]):
    """A file with whole fields, whose format has the methods that are not implemented here."""

    def outputs(self) -> list[dict[str, _Block]]:
        """The blocks of each output by name, in file order; a damaged file is refused."""
        raise NotImplementedError

    def having(
        self, outputs: Sequence[dict[str, _Block]], names: Sequence[str]
    ) -> list[dict[str, _Block]]:
        """Outputs that have `names`, and these alone."""
        raise NotImplementedError

    def history_name(self, available: Sequence[str], quantity: str | None) -> str:
        """The name among those `available` that a history takes."""
        raise NotImplementedError

    def field_name(self, available: Sequence[str], quantity: str | None) -> str:
        """The name among those `available` that `quantity` means."""
        return name_in(available, quantity, self.path)

    def at_nodes(self, blocks: Sequence[_Block], nodes: Sequence[int]) -> FloatArray:
        """Values of one quantity, ``(T, node, component)``."""
        raise NotImplementedError

    def whole(self, block: _Block, known: IntArray | None = None) -> Field:
        """All of `block`; nodes that are `known` are kept once."""
        raise NotImplementedError

    def scene(
        self, outputs: Sequence[dict[str, _Block]]
    ) -> tuple[Sequence[dict[str, _Block]], Scene]:
        """The `outputs` that can be drawn, and the mesh that they are drawn on."""
        raise NotImplementedError

    def on_scene(self, block: _Block, scene: Scene) -> tuple[Field, IntArray]:
        """The field of `block`, and the point of each of its values; -1 for none."""
        field = self.whole(block)
        return field, rows_of(field.nodes, scene.nodes)

    def last_digit_ms(self, times_ms: FloatArray) -> FloatArray:
        """What the last digit of each time is, as the file has it, ``(T,)``."""
        raise NotImplementedError

    def check_unchanged(self) -> None:
        """Refuse, or with `partial` note, a file that was written to while it was read."""
        if (change := self.file.change) is not None:
            words = f"{change}; read it again when the run has ended"
            self.options.refuse(words, self.path, noted=change)

    def everywhere(self, blocks: Sequence[_Block]) -> tuple[IntArray, FloatArray]:
        """All nodes of any of `blocks`, rising, and values there; NaN where a node has none."""
        fields: list[Field] = []
        for block in blocks:
            fields.append(self.whole(block, fields[-1].nodes if fields else None))
        distinct = {
            id(one.nodes.base): one.nodes for one in fields
        }  # `whole` keeps equal ones once
        nodes = np.unique(np.concatenate(list(distinct.values())))
        # A few nodes at each output, always others, make a large table of a small file.
        table_bytes = 8 * len(fields) * nodes.size * len(blocks[0].components)
        subject, failed = f"{blocks[0].name} at all nodes", ResultError.at(self.path)
        check_unpacked(self.file.size, table_bytes, subject, failed, copies=3)
        values = np.full((len(fields), nodes.size, len(blocks[0].components)), np.nan)
        for row, one in enumerate(fields):
            rows = rows_of(nodes, one.nodes)
            values[row, rows >= 0] = one.values[rows[rows >= 0]]
        return nodes, values

    def history(
        self,
        nodes: Sequence[int] | None,
        quantity: str | None = None,
        modes: bool = False,
        last: bool = False,
    ) -> History:
        """Each output of a quantity at `nodes`, see `Source`."""
        outputs = self.outputs()
        name = self.history_name(names_in(outputs), quantity)
        blocks = [output[name] for output in self.having(outputs, (name,))]
        axis = self._one_axis(name, [one.axis for one in blocks], modes)
        blocks = [one for one in blocks if one.axis == axis]
        first = blocks[-1] if last else blocks[0]
        blocks = [first] if last else blocks
        for one in blocks:
            if one.components != first.components:
                held, expected = (", ".join(each.components) for each in (one, first))
                raise ResultError(f"{one} has {held}, an output before it {expected}", self.path)
        if nodes is None:
            numbers, values = self.everywhere(blocks)
        else:
            numbers = np.array(node_numbers(nodes), dtype=np.int64)
            values = self.at_nodes(blocks, numbers.tolist())
            whole = np.isfinite(values).all(axis=(1, 2))
            for row in np.flatnonzero(~whole).tolist():
                self.drop(blocks[row], not_finite(blocks[row], numbers, values[row], self.path))
            blocks, values = [blocks[row] for row in np.flatnonzero(whole)], values[whole]
        self.check_unchanged()
        if not blocks:
            raise ResultError("no whole, converged increment is left", self.path)
        return History(
            quantity=next((word for word, names in NAMES.items() if name in names), name),
            components=first.components,
            units=first.units,
            nodes=tuple(numbers.tolist()),
            at=np.array([one.at for one in blocks]),
            values=values,
            keys=np.array([one.key for one in blocks], dtype=np.int64),
            path=self.path,
            axis=axis,
            last_digit_ms=self.last_digit_ms,
        ).unrounded()

    def _one_axis(self, name: str, axes: Sequence[str], modes: bool) -> str:
        """The axis to take of those of the outputs of `name`: time, or `modes`; others are noted.

        That there are no modes is a `UsageError`.
        """
        counts = Counter(axes)
        others = [axis for axis in counts if axis != TIME]
        if modes and not others:
            raise UsageError(f"no modes of {name} in it, it is over time: without --modes")
        axis = others[0] if others and (modes or TIME not in counts) else TIME
        for left in counts.keys() - {axis}:
            take = "; --modes (modes=True) takes them" if axis == TIME else ""
            self.options.note(f"left out: {counts[left]} outputs of {name} over {left}{take}")
        return axis

    def drop(self, block: _Block, error: NotFiniteError) -> None:
        """Note that `block` is left out, which only a partial reading does."""
        if not self.options.partial:
            raise error
        step, increment = block.key
        self.options.note(f"dropped step {step}, increment {increment}: {error.problem}")

    def field(self, quantity: str, increment: str = LAST) -> Field:
        """`quantity` at one increment, without reading those before it.

        `increment` is "last", an increment's number, or ``STEP:INCREMENT`` where steps begin
        anew. Of a frequency or buckling step it is the number of the mode. Marc has
        sub-increments in the place of steps.
        """
        chosen = _INCREMENT.fullmatch(increment)
        if increment != LAST and chosen is None:
            raise UsageError(f"increment {increment!r}, expected last, N or STEP:N")
        held = self._blocks(quantity)
        blocks = {one.key: one for one in held}  # of duplicates the last
        if chosen is not None:
            number, step = int(chosen[2]), None if chosen[1] is None else int(chosen[1])
            blocks = {
                key: one
                for key, one in blocks.items()
                if key[1] == number and step in (None, key[0])
            }
            if len(blocks) > 1:
                steps = ", ".join(f"{key[0]}:{key[1]}" for key in blocks)
                raise UsageError(f"increment {number} is in {len(blocks)} steps: {steps}")
        if not blocks:
            (first, last), (end, of) = held[0].key, held[-1].key
            words = f"no increment {increment} of {quantity}, it has {first}:{last} to {end}:{of}"
            raise ResultError(words, self.path)
        return self.whole(list(blocks.values())[-1])

    def fields(self, quantity: str) -> Iterator[Field]:
        """`quantity` at each of its outputs; what is absent is refused at once."""
        return self._fields(self._blocks(quantity))

    def _blocks(self, quantity: str) -> list[_Block]:
        outputs = self.outputs()
        name = self.field_name(names_in(outputs), quantity)
        return [output[name] for output in self.having(outputs, (name,))]

    def _fields(self, blocks: Sequence[_Block]) -> Iterator[Field]:
        nodes: IntArray | None = None
        for block in blocks:
            try:
                field = self.whole(block, nodes)
            except NotFiniteError as error:
                self.drop(block, error)
                continue
            nodes = field.nodes
            yield field
            del field  # kept by the caller alone
        self.check_unchanged()

    def frames(
        self, quantities: Sequence[str] | None, derived: Sequence[str], modes: bool = False
    ) -> Frames:
        """Increments, or `modes`, one by one; the file is looked through at once."""
        outputs, names = self.outputs(), None
        if quantities is not None:
            names = [self.field_name(names_in(outputs), one) for one in quantities]
            outputs = self.having(outputs, names)
        axes = [next(iter(output.values())).axis for output in outputs]
        axis = self._one_axis(", ".join(names or ["any quantity"]), axes, modes)
        drawn, scene = self.scene(
            [one for one, of in zip(outputs, axes, strict=True) if of == axis]
        )
        return scene, axis == TIME, self._at_points(drawn, scene, derived)

    def _at_points(
        self, outputs: Sequence[dict[str, _Block]], scene: Scene, derived: Sequence[str]
    ) -> Iterator[tuple[float, dict[str, FloatArray]]]:
        for output in outputs:
            fields: dict[str, Field] = {}
            rows: dict[str, IntArray] = {}
            for name, block in output.items():
                try:
                    fields[name], rows[name] = self.on_scene(block, scene)
                except NotFiniteError as error:  # of this block, not of the others
                    self.options.note(f"left out: {block}: {error.problem}")
            if fields:
                at = next(iter(output.values())).at
                yield at, _at_points(fields, rows, derived, scene)

    def quantity_table(
        self, name: str, blocks: Sequence[_Block], nodes: IntArray, storage: str
    ) -> Table:
        """One quantity of a description; outputs that are not over time are its modes."""
        timed = [one for one in blocks if one.axis == TIME]
        others = [one for one in blocks if one.axis != TIME]
        return {
            "name": name,
            "components": list(blocks[0].components),
            "increments": len(timed),
            "first_ms": timed[0].at if timed else None,
            "last_ms": timed[-1].at if timed else None,
            "modes": len(others),
            "axis": others[0].axis if others else TIME,
            "first_value": others[0].value if others else None,
            "last_value": others[-1].value if others else None,
            "steps": sorted({one.key[0] for one in blocks}),
            "nodes": nodes.size,
            "lowest_node": int(nodes.min()) if nodes.size else None,
            "highest_node": int(nodes.max()) if nodes.size else None,
            "storage": storage,
        }


def field_of(block: Block, nodes: IntArray, values: FloatArray, path: Path) -> Field:
    """The field of `block`; a value that is not finite is a `NotFiniteError`."""
    if not np.isfinite(values).all():
        raise not_finite(block, nodes, values, path)
    time_ms = block.at if block.axis == TIME else float("nan")
    of = (block.name, *block.key, time_ms, block.components, block.units, nodes, values)
    return Field(*of, axis=block.axis, axis_value=block.value)


def not_finite(block: Block, nodes: IntArray, values: FloatArray, path: Path) -> NotFiniteError:
    """The error of the first of `values` ``(node, component)`` that is not finite."""
    row, column = np.argwhere(~np.isfinite(values))[0].tolist()
    when = f"{block.at:g} ms" if block.axis == TIME else f"{block.axis} {block.value:g}"
    words = f"node {nodes[row]} at {when}: {block.name} {block.components[column]} is "
    return NotFiniteError(f"{words}{values[row, column]}", path)


def names_in(outputs: Sequence[Mapping[str, Block]]) -> list[str]:
    """Names of the quantities of any output, in order of first appearance."""
    return list(dict.fromkeys(name for output in outputs for name in output))


def _at_points(
    fields: Mapping[str, Field],
    rows: Mapping[str, IntArray],
    derived: Sequence[str],
    scene: Scene,
) -> dict[str, FloatArray]:
    """All values of an increment at the points of the mesh, and what is derived from them."""
    points, size = {}, scene.nodes.size
    for name, one in fields.items():
        for word, values in arrays_of(one).items():
            points[word] = spread(values, rows[name], size)
    stress = next((name for name in NAMES[STRESS] if name in fields), "")
    named = fields if not stress else {"STRESS": fields[stress], **fields}
    for name in derived:
        takes = DERIVED[name][0]
        if all(quantity in named for quantity in takes):
            # Of 1e200, no warning. What is no tensor, or at other nodes, is said at the end.
            with np.errstate(over="ignore", invalid="ignore"), suppress(UsageError):
                where = rows[stress if takes[0] == "STRESS" else takes[0]]
                points[f"{name}_pa"] = spread(derived_of(name, named), where, size)
    return points
