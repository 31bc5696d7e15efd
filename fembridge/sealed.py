"""TOML files of numbers that carry their checksum: an edited or cut one is refused."""

import hashlib
import tomllib
from pathlib import Path

from fembridge.errors import ResponseError
from fembridge.outputs import write_text
from fembridge.typing import Table


def write_sealed(path: Path, table: Table) -> None:
    """Write `table`, which has a ``format``, under a line with its checksum.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    import tomli_w

    sealed = tomli_w.dumps(table)
    write_text(path, f"{_seal(sealed.encode())}\n{sealed}")


def read_sealed(path: Path, what: str, expected: object) -> Table:
    """Read what `write_sealed` wrote: a `what`, of the ``format`` `expected`.

    Raises
    ------
    ResponseError
        The file is absent, of another format, or was altered after it was written.
    """
    try:
        content = path.read_bytes()
        table = tomllib.loads(content.decode())
    except OSError as error:
        raise ResponseError(f"{path}: not readable: {error.strerror}") from error
    except (ValueError, RecursionError) as error:  # no TOML, no UTF-8, nested deep
        raise ResponseError(f"{path}: not readable as a {what}: {error}") from error
    if table.get("format") != expected:
        raise ResponseError(f"{path}: format {table.get('format')!r}, expected {expected}")
    stated, _, sealed = content.partition(b"\n")
    if stated != _seal(sealed).encode():
        raise ResponseError(f"{path}: its numbers do not match its checksum: it was edited or cut")
    return table


def _seal(sealed: bytes) -> str:
    """First line of a file: the checksum of all bytes below it."""
    return f'sha256 = "{hashlib.sha256(sealed).hexdigest()}"'
