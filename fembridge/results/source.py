"""An open result file of any format: its content, a quantity at nodes, whole fields.

A `Reader` names the `Source` of its format. A `FieldSource` has whole fields: its format lists
the outputs of a file with the quantities of each as `FieldBlock`, and reads the values of a block;
this module makes histories, fields and frames for ParaView from them.
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
from fembridge.host.memory import check_unpacked
from fembridge.results.byte_file import ByteFile
from fembridge.results.fields import (
    Field,
    FieldBlock,
    Frames,
    Scene,
    derive_values,
    named_arrays,
    node_numbers,
    rows_of,
    scatter_rows,
)
from fembridge.results.history import (
    NAMES,
    STRESS,
    STRESS_FUNCTIONS,
    TIME,
    History,
    match_quantity,
)
from fembridge.results.read_options import NotFiniteError, ReadOptions
from fembridge.results.von_mises import DERIVED, OneSidedStress
from fembridge.typing import BoolArray, FloatArray, IntArray, Table

LAST = "last"  # increment
_INCREMENT = re.compile(r"(?:(\d{1,9}):)?(\d{1,9})", re.ASCII)


class Source(AbstractContextManager["Source"]):
    """An open `file`, read with `options`; a context manager that closes it.

    The methods here raise the error of a format that lacks the content.
    """

    format = ""
    """Name of the reader that opened the file."""

    def __init__(self, file: ByteFile, options: ReadOptions) -> None:
        self.file, self.path, self.options = file, file.path, options

    def __exit__(self, *error: object) -> None:
        self.file.__exit__(*error)

    def describe(self) -> Table:
        """Content of the file."""
        return {"format": self.format, "bytes": self.file.size}

    def unit_system(self) -> UnitSystem | None:
        """Unit system that the file names; None if it names none."""
        return None

    def named_nodes(self) -> Sequence[int]:
        """Nodes that a file of curves names."""
        return ()

    def node_sets(self) -> Mapping[str, Sequence[Sequence[int]]] | None:
        """Node sets by name, in pieces; None for a format without sets."""
        return None

    def element_corners(self, elements: Sequence[int]) -> Mapping[int, Sequence[int]]:
        """Nodes of each of `elements` in the order of the file; none of a format without a mesh."""
        return {}

    def shell_node(self, nodes: Sequence[int]) -> int | None:
        """The first of `nodes` that has the stress of the middle of a shell; None without."""
        return None

    def history(
        self,
        nodes: Sequence[int] | None,
        quantity: str | None = None,
        modes: bool = False,
        last_only: bool = False,
    ) -> History:
        """All outputs of a quantity at `nodes`, without resampling.

        Parameters
        ----------
        nodes
            Node numbers. None: all nodes; for stress, without those between materials unless
            the options allow them.
        quantity
            A name in `history.NAMES` or in the file. None: stress; without it displacement;
            without both the first quantity.
        modes
            Modes of frequency and buckling steps, also if the file has outputs over time.
        last_only
            Only the last output.
        """
        if modes or quantity not in (None, STRESS, *STRESS_FUNCTIONS):
            raise UsageError("this format has only stress over time at nodes", self.path)
        history = self.stress(nodes)
        return (
            replace(history, at=history.at[-1:], values=history.values[-1:])
            if last_only
            else history
        )

    def stress(self, nodes: Sequence[int] | None) -> History:
        """Stress over time at `nodes`, in that order, or at all, of a format of stress only."""
        raise NotImplementedError

    def table(self, quantity: str | None = None) -> Iterator[Sequence[object]]:
        """Printed file as a table, or one quantity of it: column names, then row by row."""
        raise NotImplementedError

    def write_table(self, output: Path, quantity: str | None = None) -> tuple[tuple[str, ...], int]:
        """Write `table` as CSV to `output`; return the columns and the number of rows."""
        from fembridge.io.text_table import write_table

        rows = self.table(quantity)
        columns, count = tuple(map(str, next(rows))), 0

        def counted() -> Iterator[Sequence[object]]:
            nonlocal count
            for count, row in enumerate(rows, start=1):  # noqa: B007 - the last value is used
                yield row
            if not count:
                message = "no rows" if quantity is None else f"no {quantity}"
                raise ResultError(f"{message}: nothing to write", self.path)

        write_table(output, columns, counted())
        return columns, count

    def node_positions(self) -> tuple[IntArray, FloatArray, BoolArray]:
        """Nodes ``(n,)``, coordinates ``(n, 3)`` in mm, whether each has stress ``(n,)``."""
        raise UsageError("no mesh in this format; choose nodes by number (--node)", self.path)

    def sides(self, node: int, set_name: str = "") -> tuple[OneSidedStress, ...]:
        """Stress at `node` in each material; from printed points of the element set `set_name`."""
        self._refuse_fields()

    def field(self, quantity: str, increment: str = LAST) -> Field:
        """`quantity` at one increment: ``last``, ``N`` or ``STEP:N``."""
        self._refuse_fields()

    def fields(self, quantity: str) -> Iterator[Field]:
        """`quantity` at each of its outputs; a missing quantity raises immediately."""
        self._refuse_fields()

    def frames(
        self, quantities: Sequence[str] | None, derived: Sequence[str], modes: bool = False
    ) -> Frames:
        """Increments or `modes`, one by one; the file is checked immediately."""
        self._refuse_fields()

    def _refuse_fields(self) -> NoReturn:
        raise UsageError("this format has histories at nodes, no whole fields", self.path)


_Block = TypeVar("_Block", bound=FieldBlock)


class FieldSource(Source, Generic[_Block]):
    """A file with whole fields; the format implements the abstract methods."""

    def outputs(self) -> list[dict[str, _Block]]:
        """Blocks of each output by name, in file order; a damaged file is refused."""
        raise NotImplementedError

    def select_outputs(
        self, outputs: Sequence[dict[str, _Block]], names: Sequence[str]
    ) -> list[dict[str, _Block]]:
        """Outputs that have `names`, reduced to these."""
        raise NotImplementedError

    def choose_name(self, available: Sequence[str], quantity: str | None) -> str:
        """Name of the quantity of a history, one of `available`."""
        raise NotImplementedError

    def match_name(self, available: Sequence[str], quantity: str | None) -> str:
        """Name of `quantity` in the file, one of `available`."""
        return match_quantity(available, quantity, self.path)

    def node_values(self, blocks: Sequence[_Block], nodes: Sequence[int]) -> FloatArray:
        """Values of one quantity, ``(T, node, component)``."""
        raise NotImplementedError

    def read_field(self, block: _Block, known_nodes: IntArray | None = None) -> Field:
        """Field of `block`; equal node numbers reuse the array `known_nodes`."""
        raise NotImplementedError

    def scene(
        self, outputs: Sequence[dict[str, _Block]]
    ) -> tuple[Sequence[dict[str, _Block]], Scene]:
        """Outputs for ParaView, and their mesh."""
        raise NotImplementedError

    def field_on_scene(self, block: _Block, scene: Scene) -> tuple[Field, IntArray]:
        """Field of `block`, and the mesh point of each of its values; -1 for none."""
        field = self.read_field(block)
        return field, rows_of(field.nodes, scene.nodes)

    def last_digit_ms(self, times_ms: FloatArray) -> FloatArray:
        """One unit of the last stored digit of each time, ``(T,)`` in ms."""
        raise NotImplementedError

    def check_unchanged(self) -> None:
        """Refuse a file that changed while it was read; with `partial` log it."""
        if (change := self.file.change) is not None:
            message = f"{change}; read the file again after the run"
            self.options.refuse(message, self.path, partial_note=change)

    def all_node_values(self, blocks: Sequence[_Block]) -> tuple[IntArray, FloatArray]:
        """Nodes of all `blocks`, sorted, and values ``(T, node, component)``, NaN for none."""
        fields: list[Field] = []
        for block in blocks:
            fields.append(self.read_field(block, fields[-1].nodes if fields else None))
        distinct = {
            id(field.nodes.base): field.nodes for field in fields
        }  # `whole` keeps equal ones once
        nodes = np.unique(np.concatenate(list(distinct.values())))
        # A small file makes a large table if each output has a few other nodes.
        table_bytes = 8 * len(fields) * nodes.size * len(blocks[0].components)
        subject, make_error = f"{blocks[0].name} at all nodes", ResultError.at(self.path)
        check_unpacked(self.file.size, table_bytes, subject, make_error, copies=3)
        values = np.full((len(fields), nodes.size, len(blocks[0].components)), np.nan)
        for row, field in enumerate(fields):
            rows = rows_of(nodes, field.nodes)
            values[row, rows >= 0] = field.values[rows[rows >= 0]]
        return nodes, values

    def history(
        self,
        nodes: Sequence[int] | None,
        quantity: str | None = None,
        modes: bool = False,
        last_only: bool = False,
    ) -> History:
        """All outputs of a quantity at `nodes`, see `Source`."""
        outputs = self.outputs()
        name = self.choose_name(quantity_names(outputs), quantity)
        blocks = [output[name] for output in self.select_outputs(outputs, (name,))]
        axis = self._select_axis(name, [block.axis for block in blocks], modes)
        blocks = [block for block in blocks if block.axis == axis]
        first = blocks[-1] if last_only else blocks[0]
        blocks = [first] if last_only else blocks
        for block in blocks:
            if block.components != first.components:
                actual, expected = (", ".join(item.components) for item in (block, first))
                raise ResultError(
                    f"{block} has {actual}, an output before it {expected}", self.path
                )
        if nodes is None:
            numbers, values = self.all_node_values(blocks)
        else:
            numbers = np.array(node_numbers(nodes), dtype=np.int64)
            values = self.node_values(blocks, numbers.tolist())
            is_finite = np.isfinite(values).all(axis=(1, 2))
            for row in np.flatnonzero(~is_finite).tolist():
                self.drop_or_raise(
                    blocks[row], not_finite_error(blocks[row], numbers, values[row], self.path)
                )
            blocks, values = [blocks[row] for row in np.flatnonzero(is_finite)], values[is_finite]
        self.check_unchanged()
        if not blocks:
            raise ResultError("no complete, converged increment", self.path)
        return History(
            quantity=next(
                (standard_name for standard_name, names in NAMES.items() if name in names), name
            ),
            components=first.components,
            units=first.units,
            nodes=tuple(numbers.tolist()),
            at=np.array([block.axis_value for block in blocks]),
            values=values,
            keys=np.array([block.key for block in blocks], dtype=np.int64),
            path=self.path,
            axis=axis,
            last_digit_ms=self.last_digit_ms,
        ).with_even_times()

    def _select_axis(self, name: str, axes: Sequence[str], modes: bool) -> str:
        """Axis of the outputs to read: time, or that of the modes; outputs of others are logged.

        Raises
        ------
        UsageError
            `modes` is set, and the file has none.
        """
        counts = Counter(axes)
        mode_axes = [axis for axis in counts if axis != TIME]
        if modes and not mode_axes:
            raise UsageError(
                f"is set, but {name} has outputs over time only", self.path, argument="modes"
            )
        axis = mode_axes[0] if mode_axes and (modes or TIME not in counts) else TIME
        for axis_left_out in counts.keys() - {axis}:
            hint = "; --modes (modes=True) takes them" if axis == TIME else ""
            self.options.note(
                f"left out: {counts[axis_left_out]} outputs of {name} over {axis_left_out}{hint}"
            )
        return axis

    def drop_or_raise(self, block: _Block, error: NotFiniteError) -> None:
        """Log with `partial` that `block` is left out; without it raise `error`."""
        if not self.options.partial:
            raise error
        step, increment = block.key
        self.options.note(f"dropped step {step}, increment {increment}: {error.problem}")

    def field(self, quantity: str, increment: str = LAST) -> Field:
        """`quantity` at one increment; earlier increments are not read.

        `increment` is "last", an increment number, or ``STEP:INCREMENT`` if increments are
        numbered in each step. In a frequency or buckling step it is the number of the mode. In
        a Marc file the step is the number of the sub-increment.
        """
        match = _INCREMENT.fullmatch(increment)
        if increment != LAST and match is None:
            raise UsageError(argument="increment", found=increment, expected="last, N or STEP:N")
        candidates = self._blocks(quantity)
        blocks = {block.key: block for block in candidates}  # the last of duplicate keys
        keys = [block.key for block in candidates]
        if match is not None:
            number, step = int(match[2]), None if match[1] is None else int(match[1])
            blocks = {
                key: block
                for key, block in blocks.items()
                if key[1] == number and step in (None, key[0])
            }
            if len(blocks) > 1:
                steps = ", ".join(f"{key[0]}:{key[1]}" for key in blocks)
                raise UsageError(
                    f"{number} is ambiguous, expected one of {steps}", argument="increment"
                )
        if not blocks:
            first, last = (f"{step}:{number}" for step, number in (keys[0], keys[-1]))
            raise ResultError(
                f"no increment {increment} of {quantity}, expected {first} to {last}", self.path
            )
        return self.read_field(list(blocks.values())[-1])

    def fields(self, quantity: str) -> Iterator[Field]:
        """`quantity` at each of its outputs; a missing quantity raises immediately."""
        return self._fields(self._blocks(quantity))

    def _blocks(self, quantity: str) -> list[_Block]:
        outputs = self.outputs()
        name = self.match_name(quantity_names(outputs), quantity)
        return [output[name] for output in self.select_outputs(outputs, (name,))]

    def _fields(self, blocks: Sequence[_Block]) -> Iterator[Field]:
        nodes: IntArray | None = None
        for block in blocks:
            try:
                field = self.read_field(block, nodes)
            except NotFiniteError as error:
                self.drop_or_raise(block, error)
                continue
            nodes = field.nodes
            yield field
            del field  # only the caller keeps it
        self.check_unchanged()

    def frames(
        self, quantities: Sequence[str] | None, derived: Sequence[str], modes: bool = False
    ) -> Frames:
        """Increments or `modes`, one by one; the file is checked immediately."""
        outputs, names = self.outputs(), None
        if quantities is not None:
            names = [self.match_name(quantity_names(outputs), name) for name in quantities]
            outputs = self.select_outputs(outputs, names)
        axes = [next(iter(output.values())).axis for output in outputs]
        axis = self._select_axis(", ".join(names or ["any quantity"]), axes, modes)
        drawn, scene = self.scene(
            [
                output
                for output, output_axis in zip(outputs, axes, strict=True)
                if output_axis == axis
            ]
        )
        return scene, axis == TIME, self._point_frames(drawn, scene, derived)

    def _point_frames(
        self, outputs: Sequence[dict[str, _Block]], scene: Scene, derived: Sequence[str]
    ) -> Iterator[tuple[float, dict[str, FloatArray]]]:
        for output in outputs:
            fields: dict[str, Field] = {}
            rows: dict[str, IntArray] = {}
            for name, block in output.items():
                try:
                    fields[name], rows[name] = self.field_on_scene(block, scene)
                except NotFiniteError as error:  # the other blocks are kept
                    self.options.note(f"left out: {block}: {error.problem}")
            if fields:
                axis_value = next(iter(output.values())).axis_value
                yield axis_value, _point_arrays(fields, rows, derived, scene)

    def quantity_table(
        self, name: str, blocks: Sequence[_Block], nodes: IntArray, storage: str
    ) -> Table:
        """A quantity in a description; outputs without time are its modes."""
        timed = [block for block in blocks if block.axis == TIME]
        modal = [block for block in blocks if block.axis != TIME]
        return {
            "name": name,
            "components": list(blocks[0].components),
            "increments": len(timed),
            "first_ms": timed[0].axis_value if timed else None,
            "last_ms": timed[-1].axis_value if timed else None,
            "modes": len(modal),
            "axis": modal[0].axis if modal else TIME,
            "first_value": modal[0].value if modal else None,
            "last_value": modal[-1].value if modal else None,
            "steps": sorted({block.key[0] for block in blocks}),
            "nodes": nodes.size,
            "lowest_node": int(nodes.min()) if nodes.size else None,
            "highest_node": int(nodes.max()) if nodes.size else None,
            "storage": storage,
        }


def make_field(block: FieldBlock, nodes: IntArray, values: FloatArray, path: Path) -> Field:
    """Field of `block`; a value that is not finite raises a `NotFiniteError`."""
    if not np.isfinite(values).all():
        raise not_finite_error(block, nodes, values, path)
    time_ms = block.axis_value if block.axis == TIME else float("nan")
    arguments = (block.name, *block.key, time_ms, block.components, block.units, nodes, values)
    return Field(*arguments, axis=block.axis, axis_value=block.value)


def not_finite_error(
    block: FieldBlock, nodes: IntArray, values: FloatArray, path: Path
) -> NotFiniteError:
    """Error about the first of `values` ``(node, component)`` that is not finite."""
    row, column = np.argwhere(~np.isfinite(values))[0].tolist()
    position_text = (
        f"{block.axis_value:g} ms" if block.axis == TIME else f"{block.axis} {block.value:g}"
    )
    prefix = f"node {nodes[row]} at {position_text}: {block.name} {block.components[column]} is "
    return NotFiniteError(f"{prefix}{values[row, column]}", path)


def quantity_names(outputs: Sequence[Mapping[str, FieldBlock]]) -> list[str]:
    """Names of the quantities of any output, in order of first appearance."""
    return list(dict.fromkeys(name for output in outputs for name in output))


def _point_arrays(
    fields: Mapping[str, Field],
    rows: Mapping[str, IntArray],
    derived: Sequence[str],
    scene: Scene,
) -> dict[str, FloatArray]:
    """Arrays of an increment at the points of the mesh, and derived quantities."""
    points, size = {}, scene.nodes.size
    for name, field in fields.items():
        for array_name, values in named_arrays(field).items():
            points[array_name] = scatter_rows(values, rows[name], size)
    stress = next((name for name in NAMES[STRESS] if name in fields), "")
    fields_by_name = fields if not stress else {"STRESS": fields[stress], **fields}
    for name in derived:
        takes = DERIVED[name][0]
        if all(quantity in fields_by_name for quantity in takes):
            # Huge values overflow without a warning. A quantity that cannot be derived (not a
            # tensor, other nodes) is logged at the end.
            with np.errstate(over="ignore", invalid="ignore"), suppress(UsageError):
                value_rows = rows[stress if takes[0] == "STRESS" else takes[0]]
                points[f"{name}_pa"] = scatter_rows(
                    derive_values(name, fields_by_name), value_rows, size
                )
    return points
