"""All records of a block whose lines are of unequal length, piece by piece.

Some builds print exponents of three digits, ``-5.28012E-003``: one character too
many for the field, so that nothing stands where it should. A field then is what
has the form of a number; there is a blank or a sign in front of it, or nothing.
"""

import re
from collections.abc import Iterator

import numpy as np

from fembridge.errors import ResultError
from fembridge.results.byte_file import CHUNK_BYTES, ByteFile
from fembridge.results.frd_format.block import VALUES_A_LINE, FrdBlock
from fembridge.results.frd_format.fixed_text import number
from fembridge.typing import FloatArray, IntArray

_NUMBER = rb" *[+-]?\d\.\d{5}[Ee][+-](?:\d{3}(?!\.)|\d{2})"  # then may touch: 3.067
_ODD = rb" *[+-]?(?:1\.#[A-Za-z]+|[Nn][Aa][Nn]|[Ii][Nn][Ff](?:inity)?)"
_LONGEST = 24  # characters of a field, with room


def irregular_records(file: ByteFile, block: FrdBlock) -> Iterator[tuple[IntArray, FloatArray]]:
    """Yield nodes ``(rows,)`` and values ``(rows, component)``, as they come.

    Raises
    ------
    ResultError
        A line is no record, or records are more or fewer than announced.
    """
    record, number_field = _patterns(block)
    lines = -(-len(block.components) // VALUES_A_LINE)
    longest = _LONGEST * (len(block.components) + lines)
    at, rest, done = block.offset, b"", 0
    while done < block.records:
        more = file.peek(at, CHUNK_BYTES)
        at += len(more)
        text = rest + more
        nodes, values, place = [], list[bytes](), 0
        for found in record.finditer(text):
            number_of_node = found[1].strip()
            if found.start() != place or done == block.records:
                break
            if not number_of_node.isdigit():  # a blank among its digits
                break
            nodes.append(int(number_of_node))
            values.extend(number_field.findall(found[0], 3 + block.id_width))
            place = found.end()
            done += 1
        if done < block.records and (not more or len(text) - place > longest):
            raise ResultError(
                f"{block}: record {done + 1} of {block.records} begins with "
                f"{text[place : place + 24]!r}",
                file.path,
            )
        rest = text[place:]
        if nodes:
            shape = (len(nodes), len(block.components))
            floats = _floats(file, block, values).reshape(shape)
            yield np.array(nodes, dtype=np.int64), floats


def _floats(file: ByteFile, block: FrdBlock, fields: list[bytes]) -> FloatArray:
    try:
        return np.array([number(field) for field in fields], dtype=np.float64)
    except ValueError as error:
        raise ResultError(f"{block}: {error}", file.path) from error


def _patterns(block: FrdBlock) -> tuple[re.Pattern[bytes], re.Pattern[bytes]]:
    """Give the patterns of a record with its line ends, and of one field."""
    field = rb"(?:%b|%b)" % (_NUMBER, _ODD)
    width, parts = block.id_width, []
    for first in range(0, len(block.components), VALUES_A_LINE):
        some = min(VALUES_A_LINE, len(block.components) - first)
        mark = b" -2" + b" " * width if first else b" -1([ 0-9]{%d})" % width
        parts.append(mark + field + b"{%d} *\r?\n" % some)
    return re.compile(b"".join(parts)), re.compile(field)
