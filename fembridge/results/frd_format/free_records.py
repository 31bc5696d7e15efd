"""Records of unequal length in a ``.frd``: exponents of three digits.

Some builds print ``-5.28012E-003``, one character too many for its field. Such
a block has to be read line by line, to its end line `` -3``.
"""

import re
from collections.abc import Iterator

import numpy as np

from fembridge.errors import ResultError
from fembridge.results.byte_file import CHUNK_BYTES, WINDOW_BYTES, ByteFile
from fembridge.results.frd_format.block import FrdBlock
from fembridge.results.frd_format.fixed_text import number
from fembridge.typing import FloatArray, IntArray

_VALUE = re.compile(rb" *[+-]?\d\.\d{5}[Ee][+-]\d{3}")
_SHORT_VALUE = re.compile(rb" *[+-]?\d\.\d{5}[Ee][+-]\d{2}(?!\d)")
_ODD_VALUE = re.compile(rb" *[+-]?(?:1\.#\w+|nan\w*|inf\w*)", re.IGNORECASE)


def free_ids(file: ByteFile, block: FrdBlock) -> IntArray:
    """Numbers of the nodes of `block`, in its order, ``(record,)``.

    Raises
    ------
    ResultError
        A line is no record.
    """
    nodes = (node for node, _ in _records(file, block))
    return np.fromiter(nodes, dtype=np.int64)


def free_values(file: ByteFile, block: FrdBlock, nodes: IntArray) -> FloatArray:
    """Values at `nodes`, ``(node, component)``; of duplicates the first.

    Raises
    ------
    KeyError
        A node has no record; the error's argument is its number.
    ResultError
        A line is no record, or its values are not as many as they should be.
    """
    wanted, found = set(nodes.tolist()), dict[int, list[float]]()
    for node, text in _records(file, block):
        if node in wanted and node not in found:
            found[node] = _values(file, block, node, text)
    return np.array([found[node] for node in nodes.tolist()], dtype=np.float64).reshape(
        len(nodes), -1
    )


def _values(file: ByteFile, block: FrdBlock, node: int, text: bytes) -> list[float]:
    row, at, end = [], 0, len(text.rstrip())
    while at < end:
        match = _VALUE.match(text, at) or _SHORT_VALUE.match(text, at) or _ODD_VALUE.match(text, at)
        if match is None:
            raise ResultError(f"{block}, node {node}: {text[:80]!r}", file.path)
        try:
            row.append(number(match[0]))
        except ValueError as error:
            raise ResultError(f"{block}, node {node}: {error}", file.path) from error
        at = match.end()
    if len(row) != len(block.components):
        raise ResultError(
            f"{block}, node {node}: {len(row)} values, expected {len(block.components)}", file.path
        )
    return row


def _records(file: ByteFile, block: FrdBlock) -> Iterator[tuple[int, bytes]]:
    """Yield the node of each record and the text behind its number."""
    head = 3 + block.id_width
    node, text = 0, b""
    for line in _lines(file, block):
        mark = line[:3]
        if mark == b" -1" and line[3:head].strip().isdigit():
            if node:
                yield node, text
            node, text = int(line[3:head]), line[head:]
        elif mark == b" -2" and node:
            text += line[head:]
        else:
            raise ResultError(f"{block}: {line[:14]!r} is no record", file.path)
        if len(text) > 14 * len(block.components) + WINDOW_BYTES:
            raise ResultError(f"{block}, node {node}: a record without end", file.path)
    if node:
        yield node, text


def _lines(file: ByteFile, block: FrdBlock) -> Iterator[bytes]:
    at, rest = block.offset, b""
    while at < file.size:
        chunk = file.take(at, min(CHUNK_BYTES, file.size - at))
        at += len(chunk)
        *lines, rest = (rest + chunk).split(b"\n")
        for line in lines:
            if line.startswith(b" -3"):
                return
            yield line.removesuffix(b"\r")
        if len(rest) > WINDOW_BYTES:
            raise ResultError(f"{block}: a line without end", file.path)
    raise ResultError(f"{block}: its end line -3 is missing", file.path)
