"""Lines of a solver's text file, one by one, in bounded memory.

A file that has no line ends (something else under a known name, a hole that a
full disk left) is found out after `LONGEST_LINE` bytes, not after all of it.
"""

from collections.abc import Iterator
from pathlib import Path

from fembridge.errors import ResultError
from fembridge.results.byte_file import ByteFile

LONGEST_LINE = 1 << 16
_BLOCK_BYTES = 1 << 18


def text_lines(path: Path) -> Iterator[tuple[int, str, bool]]:
    """Yield number, text and whether a line end closes it, for each line.

    Bytes are read as Latin-1, so that nothing but a missing file, or a line
    beyond all measure, can go wrong here.

    Raises
    ------
    ResultError
        There is no such file, it is cut while it is read, or a line is longer
        than `LONGEST_LINE` bytes.
    """
    with ByteFile(path) as file:
        number, rest = 0, b""
        for at in range(0, file.size, _BLOCK_BYTES):
            block = rest + file.take(at, min(_BLOCK_BYTES, file.size - at))
            *lines, rest = block.split(b"\n")
            for line in lines:
                number += 1
                _check_length(line, path, number)
                yield number, line.decode("latin-1").rstrip("\r"), True
            _check_length(rest, path, number + 1)
        if rest:
            yield number + 1, rest.decode("latin-1"), False


def _check_length(line: bytes, path: Path, number: int) -> None:
    if len(line) > LONGEST_LINE:
        raise ResultError(
            f"a line of more than {LONGEST_LINE} bytes beginning with {line[:12]!r}: "
            "no text of a solver",
            path,
            number,
        )
