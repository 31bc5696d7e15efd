"""Files: written whole or not at all, digests, and TOML to values and back.

A reader of a final name finds the old content or the new, never a part: not after
Ctrl-C, not after a full disk, not after a kill. Files that belong together are written
in a draft folder and take their places only when all are whole; of two processes that
do so in one folder, one waits for the other. Who writes holds a lock on its draft: one
that nobody holds was left by a kill, and is removed by the next who writes there.
"""

import codecs
import difflib
import errno
import fcntl
import filecmp
import hashlib
import json
import os
import re
import shutil
import stat
import tempfile
import tomllib
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar, get_args, get_origin

from fembridge.errors import (
    FembridgeError,
    FembridgeWarning,
    LockedError,
    OutputError,
    ResponseError,
)
from fembridge.typing import Table

if TYPE_CHECKING:
    from cattrs import Converter

DRAFT_PREFIX = ".fembridge-draft-"
_LOOK_S = 0.2
_MOST_ATTEMPTS = 20  # to make a draft where others remove what is empty
_NO_LOCKS = {errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP}
SHORT = 16
"""Hexadecimal digits of a digest that a folder is named by."""

_NO_FLOAT = 2**1023  # from here on a whole number is no float
_Value = TypeVar("_Value")
MakeError: TypeAlias = Callable[[str], FembridgeError]
"""A kind of error, or what makes one of the problem that is found."""


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path of the same name; on success what it holds takes the place of `path`.

    Where `path` is a link, what it points to is replaced. A file of a draft of `filling`
    takes its place with the others.

    Raises
    ------
    OutputError
        The folder cannot be made or written, the disk is full, or `path` is a
        folder, a device or a pipe. What stood under `path` before is untouched.
    """
    if path.parent.name.startswith(DRAFT_PREFIX):
        try:
            yield path
        except OSError as error:
            raise OutputError(f"cannot write: {error.strerror or error}", path) from error
        return
    target = Path(os.path.realpath(path)) if path.is_symlink() else path
    make_folder(path.parent)
    _check_replaceable(target, path)
    with filling(target.parent, target.name, path) as draft:
        yield draft / target.name


@contextmanager
def filling(folder: Path, last: str, path: Path | None = None) -> Iterator[Path]:
    """A draft folder; on success its files take their places in `folder`.

    Parameters
    ----------
    last
        Name of the file that takes its place last. An old one is taken away before
        the first file is replaced: a folder that has it holds files that belong
        together.
    path
        What an error names; by default `folder`.

    Notes
    -----
    Files that stand there already with the same content, all of them, are left
    alone. What else is in `folder` is not touched. The draft is locked, and those that
    a kill has left are removed. A draft's own draft is itself.

    Raises
    ------
    OutputError
        `folder` cannot be made or written, or a folder stands where a file is
        wanted. What stood in `folder` before is untouched.
    """
    if folder.name.startswith(DRAFT_PREFIX):
        yield folder
        return
    path = path or folder
    with working_folder(folder, path) as draft:
        try:
            yield draft
            _move_up(draft, folder, last)
        except OutputError as error:
            if not error.path.is_relative_to(draft):
                raise
            raise OutputError(error.problem, folder / error.path.relative_to(draft)) from error
        except OSError as error:
            raise OutputError(f"cannot write: {error.strerror or error}", path) from error


@contextmanager
def working_folder(folder: Path, path: Path | None = None) -> Iterator[Path]:
    """A locked draft folder in `folder`, removed at the end with all that is in it.

    A kill leaves it; the next command that writes into `folder` removes it, because
    nobody holds its lock any more. Folders that were made for it and hold nothing at the
    end are removed too. An error names `path`, by default `folder`.

    Raises
    ------
    OutputError
        `folder` cannot be made or written.
    """
    absent = [parent for parent in (folder, *folder.parents) if not parent.exists()]
    make_folder(folder)
    try:
        try:
            remove_abandoned_drafts(folder)
            draft, handle = _made_and_locked(folder)
        except OSError as error:
            raise OutputError(f"cannot write here: {error.strerror}", path or folder) from error
        try:
            yield draft
        finally:
            shutil.rmtree(draft, ignore_errors=True)
            os.close(handle)
    finally:
        with suppress(OSError):  # files are in it
            for parent in absent:
                parent.rmdir()


def temporary_folder() -> AbstractContextManager[Path]:
    """A `working_folder` among the system's temporary ones: the next of any process removes it."""
    return working_folder(Path(tempfile.gettempdir()))


def check_output(folder: Path, *names: str) -> None:
    """Refuse now, before all computing, what `filling` would refuse of `names` at the end.

    Folders that are not there yet are not left behind.

    Raises
    ------
    OutputError
        As `filling`.
    """
    with filling(folder, last=""):
        for name in names:
            _check_replaceable(folder / name, folder / name)


def _made_and_locked(folder: Path) -> tuple[Path, int]:
    attempts = _MOST_ATTEMPTS
    while True:
        attempts -= 1
        try:
            draft = Path(tempfile.mkdtemp(prefix=DRAFT_PREFIX, dir=folder))
            handle = os.open(draft, os.O_RDONLY)
        except FileNotFoundError:  # another removed the draft, not locked yet, or its empty folder
            if not attempts:
                raise
            folder.mkdir(parents=True, exist_ok=True)
            continue
        with suppress(OSError):  # a file system without locks: it stays, if we are killed
            fcntl.flock(handle, fcntl.LOCK_EX)
        if draft.exists():
            return draft, handle
        os.close(handle)


def remove_abandoned_drafts(folder: Path) -> None:
    """Remove the drafts in `folder` whose process has ended."""
    for draft in folder.glob(f"{DRAFT_PREFIX}*"):
        with suppress(OSError):  # in use, or of another user
            handle = os.open(draft, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(draft, ignore_errors=True)
            finally:
                os.close(handle)


def write_text(path: Path, text: str) -> None:
    """Write `text` as UTF-8 with LF line ends, whole or not at all."""
    with replacing(path) as draft, draft.open("w", encoding="utf-8", newline="") as out:
        out.write(text)


def write_toml(path: Path, table: Table) -> None:
    """Write `table` as TOML, whole or not at all."""
    import tomli_w

    write_text(path, tomli_w.dumps(table))


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


def remove_file(path: Path) -> None:
    """Remove the file `path`, if there is one, to make room for a new one."""
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"cannot be replaced: {error.strerror}", path) from error


def _check_replaceable(target: Path, path: Path) -> None:
    """Refuse what a rename would destroy: as root even ``/dev/null`` can go."""
    if target.is_dir():
        raise OutputError("a folder stands where a file is wanted", path)
    if target.exists() and not target.is_file():
        raise OutputError("a device or a pipe, expected the name of a file", path)


def _move_up(draft: Path, folder: Path, last: str) -> None:
    names = sorted(file.name for file in draft.iterdir())
    if last in names:
        names.remove(last)
        names.append(last)
    for name in names:
        _check_replaceable(folder / name, folder / name)
        with (draft / name).open("rb") as file:
            os.fsync(file.fileno())
    with locked_folder(folder):
        if all(
            (folder / name).is_file() and filecmp.cmp(draft / name, folder / name, shallow=False)
            for name in names
        ):
            return
        if len(names) > 1:
            (folder / last).unlink(missing_ok=True)
        for name in names:
            (draft / name).replace(folder / name)


@contextmanager
def locked_folder(folder: Path) -> Iterator[None]:
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


@contextmanager
def folder_lock(folder: Path, name: str, *, wait: bool = True) -> Iterator[None]:
    """The lock file `name` in `folder`, which one process of all has at a time.

    It is a lock of the kernel: it ends with its process, however that ends. The file
    holds the number of the process and is gone after an orderly end. On a file system
    without locks nobody is kept out, and a warning says so once.

    Raises
    ------
    LockedError
        Another process has it, and we do not `wait`.
    OutputError
        The folder is absent or cannot be written, or `name` is a link.
    """
    from filelock import FileLock, Timeout

    path = folder / name
    if not folder.is_dir():
        raise OutputError("cannot write here: no such folder", folder)
    if path.is_symlink():
        raise OutputError("a link stands where a lock file is wanted", path)
    lock = FileLock(path, thread_local=False)
    try:
        try:
            lock.acquire(blocking=wait, poll_interval=_LOOK_S)
            _write_number(path)
        except Timeout as error:
            raise LockedError(f"{_holder(path)} is at work here", folder) from error
        except OSError as error:
            if error.errno not in _NO_LOCKS:
                raise OutputError(f"cannot write here: {error.strerror}", folder) from error
            _remove_lock_file(path)  # it locks nothing
            warnings.warn(
                f"no file locks here ({error.strerror}): two that work in one folder at a time "
                "do not notice each other",
                FembridgeWarning,
                stacklevel=3,
            )
        yield
    finally:
        if lock.is_locked:
            _remove_lock_file(path)  # first: who opened it before looks again
        lock.release()


def _remove_lock_file(path: Path) -> None:
    """Remove the lock file `path`; a link in its place belongs to somebody else."""
    with suppress(OSError):
        status = path.lstat()
        if stat.S_ISREG(status.st_mode) and status.st_nlink == 1:
            path.unlink()


def _write_number(path: Path) -> None:
    """Write the number of this process into a lock file, and into nothing else."""
    with open(os.open(path, os.O_WRONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "w") as file:  # noqa: PTH123 - of a handle
        found = os.fstat(file.fileno())
        if not stat.S_ISREG(found.st_mode) or found.st_nlink != 1:
            raise OSError(errno.EMLINK, "a link stands where a lock file is wanted")
        file.truncate()
        file.write(f"{os.getpid()}\n")


def _holder(path: Path) -> str:
    """Process that wrote its number into the lock file `path`."""
    try:
        number = path.read_text(encoding="ascii").strip()
    except (OSError, ValueError):
        number = ""
    return f"process {number}" if number.isdigit() else "another process"


_LONGEST_SHOWN = 80  # of a value in a message
MAX_DECK_BYTES = 1 << 29
MAX_TOML_BYTES, MAX_TOML_KEYS, MAX_TOML_DEPTH = 1_000_000, 10_000, 8
_KEY_PART = rb"""(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*\.[ \t]*"""
# A parser's memory grows with the square of the parts of a key.
_DEEP_KEY = re.compile(rb"(?<![\w-])(?:%s){%d}" % (_KEY_PART, MAX_TOML_DEPTH))
_TABLE_HEAD = re.compile(rb"^[ \t]*\[", re.MULTILINE)


def read_bytes(path: Path, max_bytes: int, error: MakeError) -> bytes:
    """The content of a file, or of a pipe, of at most `max_bytes`."""
    try:
        with path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size  # of a pipe 0
            # A buffer of this size is taken before the first byte is read.
            content = b"" if size > max_bytes else file.read((size or max_bytes) + 1)
    except OSError as problem:
        raise error(f"{path}: cannot be read: {problem.strerror}") from problem
    if max(size, len(content)) > max_bytes:
        raise error(f"{path}: more than {max_bytes} bytes")
    return content


def read_toml(
    path: Path,
    error: MakeError,
    max_bytes: int = MAX_TOML_BYTES,
    max_keys: int = MAX_TOML_KEYS,
) -> Table:
    """Table of the TOML file `path`, of at most `max_bytes` and about `max_keys`.

    A key has at most `MAX_TOML_DEPTH` parts: a few kilobytes of dots would fill the memory.
    """
    content = read_bytes(path, max_bytes, error)
    return _table_in(content.removeprefix(codecs.BOM_UTF8), path, "TOML", error, max_keys)


def _table_in(content: bytes, path: Path, what: str, error: MakeError, max_keys: int) -> Table:
    if deep := _DEEP_KEY.search(content):
        line = content.count(b"\n", 0, deep.start()) + 1
        raise error(f"{path}:{line}: a key of more than {MAX_TOML_DEPTH} parts")
    if content.count(b"=") + sum(1 for _ in _TABLE_HEAD.finditer(content)) > max_keys:
        raise error(f"{path}: more than {max_keys} keys")
    try:
        return tomllib.loads(content.decode())
    except (ValueError, RecursionError) as problem:  # no TOML, no UTF-8, nested too deep
        raise error(f"{path}: not readable as {what}: {problem}") from problem


def structure(table: object, kind: type[_Value], error: MakeError) -> _Value:
    """Value of the dataclass `kind` from a table as TOML gives it.

    Numbers, words and truth values are taken as they are: no word becomes a number. An
    unknown key is refused with the near ones.
    """
    from cattrs import BaseValidationError

    try:
        return _converter().structure(table, kind)
    except (BaseValidationError, ValueError) as problem:
        raise error(_first_problem(problem)) from problem


def changed(value: _Value, table: object, error: MakeError) -> _Value:
    """`value`, a dataclass, with what `table` says in place of its own; as `structure`."""
    if not isinstance(table, Mapping):
        raise error(f"{table!r}, expected a table")
    return structure(_merged(unstructure(value), table), type(value), error)


def unstructure(value: object) -> Any:  # noqa: ANN401 - as nested as the value
    """Tables, lists, numbers and words of a dataclass, for TOML; None is left out."""
    return _without_none(_converter().unstructure(value))


def near_hint(word: str, known: Iterable[str]) -> str:
    """``; did you mean ...?`` for a misspelt `word`, "" where none of `known` is near."""
    folded = {name.casefold(): name for name in known}
    near = difflib.get_close_matches(word.casefold(), folded, n=2)
    return f"; did you mean {' or '.join(folded[name] for name in near)}?" if near else ""


_SCALARS: Mapping[type, tuple[tuple[type, ...], str]] = {
    bool: ((bool,), "true or false"),
    int: ((int,), "a whole number"),
    float: ((int, float), "a number"),
    str: ((str,), "a word"),
}
"""What is taken for a value of a type, and in words; a truth value is no number."""


@cache
def _converter() -> "Converter":
    from cattrs import Converter
    from cattrs.cols import list_structure_factory, mapping_structure_factory
    from cattrs.gen import make_dict_structure_fn

    converter = Converter(forbid_extra_keys=True)

    def hook_of(kind: Any) -> Callable[[object, object], object]:  # noqa: ANN401 - any type
        """What makes a `kind`: of its own kind of value alone, else a word would be a list."""
        of, made = get_origin(kind), None
        types, words = _SCALARS.get(kind, ((Mapping,), "a table"))
        if of in (list, tuple):
            types, words = (list, tuple), "a list"
            as_list: Any = list[get_args(kind)[0]]  # type: ignore[misc] # known at run time
            made = list_structure_factory(as_list, converter)
        elif of is not None:
            made = mapping_structure_factory(kind, converter)
        elif kind not in _SCALARS:
            made = make_dict_structure_fn(kind, converter, _cattrs_forbid_extra_keys=True)

        def hook(value: Any, _: object) -> object:  # noqa: ANN401 - whatever TOML has
            if not isinstance(value, types) or (isinstance(value, bool) and kind is not bool):
                raise ValueError(f"{repr(value)[:_LONGEST_SHOWN]}, expected {words}")
            try:
                found = kind(value) if made is None else made(value, kind)
            except OverflowError:
                raise ValueError(f"a number too large: expected {words}") from None
            return tuple(found) if of is tuple else found

        return hook

    for kind in _SCALARS:
        converter.register_structure_hook(kind, hook_of(kind))
    converter.register_structure_hook_factory(_has_parts, hook_of)
    return converter


def _has_parts(kind: Any) -> bool:  # noqa: ANN401 - any type
    """Whether `kind` is a dataclass, a table, or a list of any length."""
    of, parts = get_origin(kind), get_args(kind)
    any_length = of is list or (of is tuple and parts[1:] == (...,))
    return is_dataclass(kind) or any_length or of in (dict, Mapping)


def _first_problem(problem: BaseException) -> str:
    """First of the problems of a table, in one line with its place; a misspelt key before all."""
    from cattrs import ForbiddenExtraKeysError, transform_error

    def words(error: BaseException, _: type | None) -> str:
        if not isinstance(error, ForbiddenExtraKeysError):
            return "absent" if isinstance(error, KeyError) else str(error)
        known, key = [field.name for field in fields(error.cl)], min(map(str, error.extra_fields))
        return f"unknown key {key!r}, expected {', '.join(known)}{near_hint(key, known)}"

    found = transform_error(problem, "", words)
    first = next((line for line in found if line.startswith("unknown key")), found[0])
    what, _, place = first.rpartition(" @ ")
    place = re.sub(r"\[(\d+)\]", lambda one: f" {int(one[1]) + 1}", place)  # of a list
    place = re.sub(r"\['(.*?)'\]", r".\1", place).lstrip(". ")
    return f"{place}: {what}" if place else what


def _merged(under: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    found = dict(under)
    for key, value in over.items():
        both = isinstance(value, Mapping) and isinstance(found.get(key), Mapping)
        found[key] = _merged(found[key], value) if both else value
    return found


def _without_none(value: Any) -> Any:  # noqa: ANN401 - as nested as the value
    if isinstance(value, Mapping):
        return {key: _without_none(each) for key, each in value.items() if each is not None}
    if isinstance(value, list | tuple):
        return [_without_none(each) for each in value]
    return value


def sha256_of(path: Path) -> str:
    """Digest of a file's bytes, hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def write_sealed(path: Path, table: Table) -> None:
    """Write `table`, which has a ``format``, under a line with its checksum."""
    import tomli_w

    sealed = tomli_w.dumps(table)
    write_text(path, f"{_seal(sealed.encode())}\n{sealed}")


def read_sealed(path: Path, what: str, expected: object) -> Table:
    """Read what `write_sealed` wrote: a `what`, of the ``format`` `expected`."""
    content = read_bytes(path, MAX_TOML_BYTES, ResponseError)
    return sealed_table(content, path, what, expected)


def sealed_table(content: bytes, path: Path, what: str, expected: object) -> Table:
    """Table in the `content` of a file `path` that `write_sealed` wrote; as `read_sealed`."""
    if len(content) > MAX_TOML_BYTES:
        raise ResponseError(f"{path}: more than {MAX_TOML_BYTES} bytes")
    table = _table_in(content, path, f"a {what}", ResponseError, MAX_TOML_KEYS)
    if table.get("format") != expected:
        raise ResponseError(f"{path}: format {table.get('format')!r}, expected {expected}")
    stated, _, sealed = content.partition(b"\n")
    if stated != _seal(sealed).encode():
        raise ResponseError(f"{path}: its numbers do not match its checksum: it was edited or cut")
    return table


def _seal(sealed: bytes) -> str:
    """First line of a file: the checksum of all bytes below it."""
    return f'sha256 = "{hashlib.sha256(sealed).hexdigest()}"'


def digest(content: object) -> str:
    """SHA-256 of tables, lists, words and numbers as JSON, sorted, without blanks, hexadecimal."""
    plain = _plain(content)
    text = json.dumps(plain, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _plain(content: object) -> object:
    if content is None or isinstance(content, bool | str):
        return content
    if isinstance(content, int):
        is_float = abs(content) < _NO_FLOAT and float(content) == content
        return float(content) if is_float else content
    if isinstance(content, float):
        return content + 0.0
    if isinstance(content, Mapping):
        return {str(key): _plain(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_plain(value) for value in content]
    raise TypeError(f"{content!r} has no canonical text")
