"""All records of one result block of a ``.frd``, as arrays, part by part.

Text is taken some hundred kilobytes at a time: what is read beside the arrays
that come out does not grow with the block. Every record is held against what a
record looks like; a number that is not finite is an error with its node.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from fembridge.errors import ResultError
from fembridge.results.byte_file import ByteFile
from fembridge.results.frd_format.block import VALUES_A_LINE, FrdBlock
from fembridge.results.frd_format.decimals import ID_WIDTH, decimals, odd_number, whole_numbers
from fembridge.results.frd_format.fixed_text import FIELD, integers
from fembridge.results.frd_format.irregular import irregular_records
from fembridge.typing import BoolArray, FloatArray, IntArray

CHUNK_BYTES = 3 << 17
_MARK_BYTES = 3


class NotFiniteError(ResultError):
    """A NaN or an infinite value, which a partial reading may leave out."""


def read_table(
    file: ByteFile, block: FrdBlock, scales: Sequence[float], most_rows: int
) -> Iterator[tuple[IntArray, FloatArray]]:
    """Yield nodes ``(rows,)`` and values ``(rows, component)``, in file order.

    Each part but the last has `most_rows` records. `scales` are the factors by
    which the numbers of each component are multiplied.

    Raises
    ------
    ResultError
        A record is not one, or a field no number.
    NotFiniteError
        A number is NaN or infinite.
    """
    factor = np.array(scales, dtype=np.float64)
    if block.free:
        yield from _free_parts(file, block, factor, most_rows)
        return
    for first in range(0, block.records, most_rows):
        rows = min(most_rows, block.records - first)
        nodes = np.empty(rows, dtype=np.int64)
        values = np.empty((rows, len(block.components)), dtype=np.float64)
        step = max(1, CHUNK_BYTES // block.record_bytes)
        for at in range(0, rows, step):
            chunk = slice(at, min(at + step, rows))
            start = block.offset + (first + at) * block.record_bytes
            text = file.take(start, (chunk.stop - at) * block.record_bytes)
            read = _packed if block.binary else _printed
            fine = read(text, block, nodes[chunk], values[chunk], factor, file)
            if not fine.all():
                row = int(np.flatnonzero(~fine)[0])
                found = text[row * block.record_bytes :][: _MARK_BYTES + ID_WIDTH]
                raise ResultError(
                    f"{block}: record {first + at + row + 1} of {block.records} "
                    f"begins with {found!r}, or is not as long as the others",
                    file.path,
                )
        yield nodes, values


def _printed(
    text: bytes,
    block: FrdBlock,
    nodes: IntArray,
    values: FloatArray,
    factor: FloatArray,
    file: ByteFile,
) -> BoolArray:
    """Read records of text into `nodes` and `values`; tell which are records."""
    rows, width = len(nodes), block.record_bytes
    fine = _ids(text, block, nodes)
    mark, at, any_odd = b" -1", 0, False
    for column in range(0, len(block.components), VALUES_A_LINE):
        columns = slice(column, min(column + VALUES_A_LINE, len(block.components)))
        count = columns.stop - column
        start = at + _MARK_BYTES + block.id_width
        end = start + FIELD * count + block.line_end
        fine &= _holds(text, rows, width, at, mark)
        fine &= _holds(text, rows, width, end - 1, b"\n")
        if fine.all():
            found, odd = decimals(text, rows, width, start, count)
            if odd is not None:
                _replace(text, block, found, odd, start, column, nodes, file)
                any_odd = True
            values[:, columns] = found
        mark, at = b" -2", end
    _scale(values, factor)
    if any_odd and fine.all():  # the others are all finite
        _check_finite(file, block, nodes, values)
    return fine


def _replace(
    text: bytes,
    block: FrdBlock,
    found: FloatArray,
    odd: BoolArray,
    start: int,
    column: int,
    nodes: IntArray,
    file: ByteFile,
) -> None:
    """Put what the odd fields say in their places in `found`."""
    for row, place in np.argwhere(odd).tolist():
        try:
            value = odd_number(text, block.record_bytes, start, (row, place))
        except ValueError as error:
            raise ResultError(
                f"{block}, node {nodes[row]}, {block.components[column + place]}: {error}",
                file.path,
            ) from error
        found[row, place] = value


def _packed(
    text: bytes,
    block: FrdBlock,
    nodes: IntArray,
    values: FloatArray,
    factor: FloatArray,
    file: ByteFile,
) -> BoolArray:
    """Read packed records into `nodes` and `values`; tell which are records."""
    kind = "<f4" if block.flag == 2 else "<f8"
    together = f"V{block.record_bytes - 4}"  # copied as one: faster than one by one
    table = np.frombuffer(text, dtype=[("node", "<i4"), ("values", together)])
    nodes[...] = table["node"]
    flat = values.reshape(-1)  # a view: parts of an array made here
    flat[...] = np.ascontiguousarray(table["values"]).view(kind)
    _scale(values, factor)
    _check_finite(file, block, nodes, values)
    fine: BoolArray = nodes > 0
    return fine


def _free_parts(
    file: ByteFile, block: FrdBlock, factor: FloatArray, most_rows: int
) -> Iterator[tuple[IntArray, FloatArray]]:
    """Fill parts of `most_rows` from records that come in pieces of any size."""
    pieces = irregular_records(file, block)
    nodes, values = np.empty(0, np.int64), np.empty((0, factor.size))
    for first in range(0, block.records, most_rows):
        rows = min(most_rows, block.records - first)
        part_nodes = np.empty(rows, dtype=np.int64)
        part_values = np.empty((rows, factor.size), dtype=np.float64)
        filled = 0
        while filled < rows:
            if not nodes.size:
                nodes, values = next(pieces)
                _scale(values, factor)
                _check_finite(file, block, nodes, values)
            some = min(nodes.size, rows - filled)
            part_nodes[filled : filled + some] = nodes[:some]
            part_values[filled : filled + some] = values[:some]
            nodes, values, filled = nodes[some:], values[some:], filled + some
        yield part_nodes, part_values


def _ids(text: bytes, block: FrdBlock, nodes: IntArray) -> BoolArray:
    rows, width = len(nodes), block.record_bytes
    if block.id_width == ID_WIDTH:
        nodes[...], fine = whole_numbers(text, rows, width, _MARK_BYTES)
        return fine
    shape = (rows, block.id_width)
    fields = np.ndarray(shape, np.uint8, text, _MARK_BYTES, (width, 1))
    nodes[...], fine = integers(fields)
    return fine


def _holds(text: bytes, rows: int, width: int, at: int, mark: bytes) -> BoolArray:
    """Whether `mark` stands at byte `at` of each row."""
    fine = np.ones(rows, dtype=np.bool_)
    for place, character in enumerate(mark):
        fine &= np.ndarray((rows,), np.uint8, text, at + place, (width,)) == character
    return fine


def _scale(values: FloatArray, factor: FloatArray) -> None:
    """Multiply each column by its factor; all at once where they are the same."""
    with np.errstate(over="ignore"):  # a number that overflows is not finite
        if not (factor == factor[0]).all():
            values *= factor
        elif factor[0] != 1.0:
            values *= float(factor[0])


def _check_finite(file: ByteFile, block: FrdBlock, nodes: IntArray, values: FloatArray) -> None:
    finite = np.isfinite(values)
    if not finite.all():
        row, column = np.argwhere(~finite)[0].tolist()
        output = block.output
        when = f"{block.time_ms:g} ms"
        if block.modal:
            when = f"{output.axis} {output.value:g}"
        raise NotFiniteError(
            f"node {nodes[row]} at {when}: {block.name} {block.components[column]} is "
            f"{values[row, column]}",
            file.path,
        )
