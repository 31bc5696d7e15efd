"""Output files: written beside their final name, then renamed.

A reader of the final name finds the old content or the new, never a part: not
after Ctrl-C, not after a full disk, not after a kill.
"""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fembridge.errors import OutputError


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a temporary path beside `path`; on success it takes that name.

    Raises
    ------
    OutputError
        The folder cannot be made or written, or the disk is full. What stood
        under `path` before is untouched.
    """
    make_folder(path.parent)
    try:
        handle, name = tempfile.mkstemp(
            prefix=f".{path.stem[:40]}.", suffix=path.suffix, dir=path.parent
        )
    except OSError as error:
        raise OutputError(f"cannot write here: {error.strerror}", path) from error
    os.close(handle)
    draft = Path(name)
    try:
        yield draft
        draft.chmod(0o666 & ~_umask())
        draft.replace(path)
    except OSError as error:
        raise OutputError(f"cannot write: {error.strerror or error}", path) from error
    finally:
        draft.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write `text` as UTF-8 with LF line ends, whole or not at all."""
    with replacing(path) as draft, draft.open("w", encoding="utf-8", newline="") as out:
        out.write(text)
        out.flush()
        os.fsync(out.fileno())


def make_folder(folder: Path) -> Path:
    """Make `folder` and its parents; say which one could not be made."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        raise OutputError("a file stands where a folder is wanted", folder) from error
    except OSError as error:
        raise OutputError(f"cannot make this folder: {error.strerror}", folder) from (
            error
        )
    return folder


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
