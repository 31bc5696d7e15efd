"""Output files: written beside their final name, then renamed.

A reader of the final name finds the old content or the new, never a part: not
after Ctrl-C, not after a full disk, not after a kill. Files that belong together
are written in a draft folder and take their places only when all are whole; of two
processes that do so in one folder, one waits for the other.
"""

import fcntl
import filecmp
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from fembridge.errors import OutputError

_STEM_LETTERS = 40


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a temporary path beside `path`; on success it takes that name.

    Where `path` is a link, what it points to is replaced. The temporary path keeps
    the suffix, for writers that go by it.

    Raises
    ------
    OutputError
        The folder cannot be made or written, the disk is full, or `path` is a
        folder, a device or a pipe. What stood under `path` before is untouched.
    """
    make_folder(path.parent)
    target = Path(os.path.realpath(path)) if path.is_symlink() else path
    _check_replaceable(target, path)
    token = os.urandom(4).hex()
    draft = target.with_name(f".{target.stem[:_STEM_LETTERS]}.{token}{target.suffix}")
    try:
        draft.open("xb").close()  # with the permissions that any new file gets
    except OSError as error:
        raise OutputError(f"cannot write here: {error.strerror}", path) from error
    try:
        yield draft
        with draft.open("rb") as file:
            os.fsync(file.fileno())
        draft.replace(target)
    except OSError as error:
        raise OutputError(f"cannot write: {error.strerror or error}", path) from error
    finally:
        draft.unlink(missing_ok=True)


@contextmanager
def filling(folder: Path, last: str) -> Iterator[Path]:
    """Give a draft folder; on success its files take their places in `folder`.

    Parameters
    ----------
    last
        Name of the file that takes its place last. An old one is taken away before
        the first file is replaced: a folder that has it holds files that belong
        together.

    Notes
    -----
    Files that stand there already with the same content, all of them, are left
    alone. What else is in `folder` is not touched.

    Raises
    ------
    OutputError
        `folder` cannot be made or written, or a folder stands where a file is
        wanted. What stood in `folder` before is untouched.
    """
    make_folder(folder)
    try:
        draft = Path(tempfile.mkdtemp(prefix=".draft.", dir=folder))
    except OSError as error:
        raise OutputError(f"cannot write here: {error.strerror}", folder) from error
    try:
        yield draft
        _move_up(draft, folder, last)
    except OutputError as error:
        if not error.path.is_relative_to(draft):
            raise
        place = folder / error.path.relative_to(draft)
        raise OutputError(error.problem, place) from error
    except OSError as error:
        raise OutputError(f"cannot write: {error.strerror or error}", folder) from error
    finally:
        shutil.rmtree(draft, ignore_errors=True)


def write_text(path: Path, text: str) -> None:
    """Write `text` as UTF-8 with LF line ends, whole or not at all."""
    with replacing(path) as draft, draft.open("w", encoding="utf-8", newline="") as out:
        out.write(text)


def make_folder(folder: Path) -> Path:
    """Make `folder` and its parents; say what is in the way of it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        standing = (place for place in (folder, *folder.parents) if place.exists())
        raise OutputError(
            "a file stands where a folder is wanted", next(standing, folder)
        ) from error
    except OSError as error:
        raise OutputError(f"cannot make this folder: {error.strerror}", folder) from (error)
    return folder


def _check_replaceable(target: Path, path: Path) -> None:
    """Refuse what a rename would destroy: as root even ``/dev/null`` can go."""
    if target.is_dir():
        raise OutputError("a folder stands where a file is wanted", path)
    if target.exists() and not target.is_file():
        raise OutputError("a device or a pipe, expected the name of a file", path)


def _move_up(draft: Path, folder: Path, last: str) -> None:
    names = sorted((file.name for file in draft.iterdir()), key=lambda n: (n == last, n))
    for name in names:
        _check_replaceable(folder / name, folder / name)
    with _alone_in(folder):
        if all(_same(draft / name, folder / name) for name in names):
            return
        (folder / last).unlink(missing_ok=True)
        for name in names:
            (draft / name).replace(folder / name)


@contextmanager
def _alone_in(folder: Path) -> Iterator[None]:
    """Wait for others that move files up there; without locks, for nobody."""
    handle = None
    with suppress(OSError):  # some network file systems lock no folder
        handle = os.open(folder, os.O_RDONLY)
        fcntl.flock(handle, fcntl.LOCK_EX)
    try:
        yield
    finally:
        if handle is not None:
            os.close(handle)


def _same(new: Path, old: Path) -> bool:
    return old.is_file() and filecmp.cmp(new, old, shallow=False)
