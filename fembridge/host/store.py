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
import filecmp
import hashlib
import json
import os
import re
import shutil
import stat
import tempfile
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import (
    TYPE_CHECKING,
    Any,
    TypeAlias,
    TypeVar,
    get_args,
    get_origin,
    get_type_hints,
)

from fembridge.errors import (
    FembridgeError,
    LockedError,
    OutputError,
    ResponseError,
    warn,
)
from fembridge.host.system import (
    LOCKS_ARE_ADVISORY,
    NO_LINK,
    NO_WAIT,
    close_folder,
    flush_to_disk,
    lock_folder,
    open_folder,
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
MakeError: TypeAlias = Callable[..., FembridgeError]
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
    """A draft folder, whose files are moved into `folder` on success.

    Parameters
    ----------
    folder
        Folder of the files, which is made.
    last
        Name of the file that is moved last. An old one is removed before the first file is
        replaced: in a folder with this file all files belong together.
    path
        Path in errors. Default: `folder`.

    Notes
    -----
    If all files exist with the same content, none is replaced. Other files in `folder` are not
    touched. The draft is locked; drafts of killed processes are removed. The draft of a draft
    is the draft itself.

    Raises
    ------
    OutputError
        `folder` cannot be made or written, or has a folder with the name of a file. Its
        earlier files are untouched.
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
            close_folder(handle)
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


def _made_and_locked(folder: Path) -> tuple[Path, int | None]:
    attempts = _MOST_ATTEMPTS
    while True:
        attempts -= 1
        try:
            draft = Path(tempfile.mkdtemp(prefix=DRAFT_PREFIX, dir=folder))
            handle = open_folder(draft)
        except FileNotFoundError:  # another removed the draft, not locked yet, or its empty folder
            if not attempts:
                raise
            folder.mkdir(parents=True, exist_ok=True)
            continue
        with suppress(OSError):  # a file system without locks: it stays, if we are killed
            lock_folder(handle)
        if draft.exists():
            return draft, handle
        close_folder(handle)


def remove_abandoned_drafts(folder: Path) -> None:
    """Remove the drafts in `folder` whose process has ended."""
    for draft in folder.glob(f"{DRAFT_PREFIX}*"):
        with suppress(OSError):  # in use, or of another user
            handle = open_folder(draft, NO_LINK | NO_WAIT)
            try:
                lock_folder(handle, wait=False)
                shutil.rmtree(draft, ignore_errors=True)
            finally:
                close_folder(handle)


def write_text(path: Path, text: str) -> None:
    """Write `text` as UTF-8 with LF line ends, whole or not at all."""
    with replacing(path) as draft, draft.open("w", encoding="utf-8", newline="") as out:
        out.write(text)


def write_toml(path: Path, table: Table) -> None:
    """Write `table` as TOML, whole or not at all."""
    import tomli_w

    write_text(path, tomli_w.dumps(table))


def make_folder(folder: Path) -> Path:
    """Make `folder` and its parents; an error names the file that is in the way."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        existing = (parent for parent in (folder, *folder.parents) if parent.exists())
        raise OutputError("is a file, expected a folder", next(existing, folder)) from error
    except OSError as error:
        raise OutputError(f"cannot make this folder: {error.strerror}", folder) from (error)
    return folder


def remove_file(path: Path) -> None:
    """Remove the file `path`, if it exists, before a new one is written."""
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"cannot be replaced: {error.strerror}", path) from error


def _check_replaceable(target: Path, path: Path) -> None:
    """Refuse a target that a rename would destroy: root can replace even ``/dev/null``."""
    if target.is_dir():
        raise OutputError("is a folder, expected a file", path)
    if target.exists() and not target.is_file():
        raise OutputError("is a device or a pipe, expected a file", path)


def _move_up(draft: Path, folder: Path, last: str) -> None:
    names = sorted(file.name for file in draft.iterdir())
    if last in names:
        names.remove(last)
        names.append(last)
    for name in names:
        _check_replaceable(folder / name, folder / name)
        flush_to_disk(draft / name)
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
    """Wait until other processes have moved their files there; without file locks, never."""
    handle = None
    with suppress(OSError):  # some network file systems lock no folder
        handle = open_folder(folder)
        lock_folder(handle)
    try:
        yield
    finally:
        close_folder(handle)


@contextmanager
def folder_lock(folder: Path, name: str, *, wait: bool = True) -> Iterator[None]:
    """The lock file `name` in `folder`, which one process at a time holds.

    The lock is one of the kernel: it ends with its process, even after a kill. The file has
    the number of the process and is removed at the end. On a file system without locks no
    process is kept out, and a warning is issued. Windows lets nobody write into a locked file:
    the number is absent there.

    Raises
    ------
    LockedError
        Another process holds it, and `wait` is false.
    OutputError
        The folder is absent or cannot be written, or `name` is a link.
    """
    from filelock import FileLock, Timeout

    path = folder / name
    if not folder.is_dir():
        raise OutputError("cannot write here: no such folder", folder)
    if path.is_symlink():
        raise OutputError("is a link, expected a lock file", path)
    lock = FileLock(path, thread_local=False)
    try:
        try:
            lock.acquire(blocking=wait, poll_interval=_LOOK_S)
            if LOCKS_ARE_ADVISORY:
                _write_number(path)
        except Timeout as error:
            raise LockedError(f"{_holder(path)} is at work here", folder) from error
        except OSError as error:
            if error.errno not in _NO_LOCKS:
                raise OutputError(f"cannot write here: {error.strerror}", folder) from error
            _remove_lock_file(path)  # it locks nothing
            warn(
                f"no file locks here ({error.strerror}): two processes in one folder at the same "
                "time do not notice each other",
            )
        yield
    finally:
        if lock.is_locked:
            _remove_lock_file(path)  # first: who opened it before looks again
        lock.release()


def _remove_lock_file(path: Path) -> None:
    """Remove the lock file `path`; a link of this name belongs to somebody else."""
    with suppress(OSError):
        status = path.lstat()
        if stat.S_ISREG(status.st_mode) and status.st_nlink == 1:
            path.unlink()


def _write_number(path: Path) -> None:
    """Write the number of this process into a lock file, not into a link."""
    with open(os.open(path, os.O_WRONLY | NO_LINK | NO_WAIT), "w") as file:  # noqa: PTH123 - of a handle
        status = os.fstat(file.fileno())
        if not stat.S_ISREG(status.st_mode) or status.st_nlink != 1:
            raise OSError(errno.EMLINK, "is a link, expected a lock file")
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
        raise error(f"cannot be read: {problem.strerror}", path) from problem
    if max(size, len(content)) > max_bytes:
        raise error(f"more than {max_bytes} bytes", path)
    return content


def read_toml(
    path: Path,
    error: MakeError,
    max_bytes: int = MAX_TOML_BYTES,
    max_keys: int = MAX_TOML_KEYS,
) -> Table:
    """Table of the TOML file `path`, with at most `max_bytes` and about `max_keys`.

    A key has at most `MAX_TOML_DEPTH` parts: a few kilobytes of dots would fill the memory.
    """
    content = read_bytes(path, max_bytes, error)
    return _parse_table(content.removeprefix(codecs.BOM_UTF8), path, "TOML", error, max_keys)


def _parse_table(content: bytes, path: Path, kind: str, error: MakeError, max_keys: int) -> Table:
    if deep := _DEEP_KEY.search(content):
        line = content.count(b"\n", 0, deep.start()) + 1
        raise error(f"a key of more than {MAX_TOML_DEPTH} parts", path, line)
    if content.count(b"=") + sum(1 for _ in _TABLE_HEAD.finditer(content)) > max_keys:
        raise error(f"more than {max_keys} keys", path)
    try:
        return tomllib.loads(content.decode())
    except (ValueError, RecursionError) as problem:  # no TOML, no UTF-8, nested too deep
        raise error(f"not readable as {kind}: {problem}", path) from problem


def structure(table: object, kind: type[_Value], error: MakeError, section: str = "") -> _Value:
    """Value of the dataclass `kind` from a TOML table, the `section` of a file.

    Numbers, texts and truth values are not converted: no text becomes a number. An unknown key
    is refused, with similar names. The `key` of the error is the first key at fault.
    """
    if _has_scalars_only(kind):
        problem: tuple[tuple[str | int, ...], BaseException]
        try:
            return _structure_scalars(table, kind)
        except _FieldError as field_error:
            problem = field_error.keys, field_error.cause
        except (FembridgeError, ValueError) as invalid:
            problem = (), invalid
        raise _table_error(*problem, error, section)

    from cattrs import BaseValidationError

    try:
        return _converter().structure(table, kind)
    except (BaseValidationError, FembridgeError, ValueError) as group:
        problem = _first_problem(group)
    # without the group of errors of cattrs, whose traceback hides the message
    raise _table_error(*problem, error, section)


def changed(value: _Value, table: object, error: MakeError) -> _Value:
    """The dataclass `value` with the entries of `table` instead of its own; as `structure`."""
    if not isinstance(table, Mapping):
        raise _table_error((), _KindError(table, "a table"), error, "")
    return structure(_merged(unstructure(value), table), type(value), error)


def unstructure(value: object) -> Any:  # noqa: ANN401 - as nested as the value
    """Tables, lists, numbers and texts of a dataclass, for TOML, without None."""
    if is_dataclass(value) and _has_scalars_only(type(value)):
        return {field.name: getattr(value, field.name) for field in fields(value)}
    return _without_none(_converter().unstructure(value))


def near_hint(name: str, options: Iterable[str]) -> str:
    """``; did you mean ...?`` for a misspelt `name`; "" if none of `options` is similar."""
    folded = {option.casefold(): option for option in options}
    similar = difflib.get_close_matches(name.casefold(), folded, n=2)
    return f"; did you mean {' or '.join(folded[key] for key in similar)}?" if similar else ""


_SCALARS: Mapping[type, tuple[tuple[type, ...], str]] = {
    bool: ((bool,), "true or false"),
    int: ((int,), "a whole number"),
    float: ((int, float), "a number"),
    str: ((str,), "a word"),
}
"""Accepted types of a value, and their text; a truth value is no number."""


@cache
def _converter() -> "Converter":
    from cattrs import Converter
    from cattrs.cols import list_structure_factory, mapping_structure_factory
    from cattrs.gen import make_dict_structure_fn

    converter = Converter(forbid_extra_keys=True)

    def hook_of(kind: Any) -> Callable[[object, object], object]:  # noqa: ANN401 - any type
        """Function that makes a `kind` from a value of that kind: no text becomes a list."""
        container, make = get_origin(kind), None
        types, expected = _SCALARS.get(kind, ((Mapping,), "a table"))
        if container in (list, tuple):
            types, expected = (list, tuple), "a list"
            as_list: Any = list[get_args(kind)[0]]  # type: ignore[misc] # known at run time
            make = list_structure_factory(as_list, converter)
        elif container is not None:
            make = mapping_structure_factory(kind, converter)
        elif kind not in _SCALARS:
            make = make_dict_structure_fn(kind, converter, _cattrs_forbid_extra_keys=True)

        def hook(value: Any, _: object) -> object:  # noqa: ANN401 - whatever TOML has
            if not isinstance(value, types) or (isinstance(value, bool) and kind is not bool):
                raise _KindError(value, expected)
            try:
                structured = kind(value) if make is None else make(value, kind)
            except OverflowError:
                raise _KindError(value, f"{expected} below 1e308") from None
            return tuple(structured) if container is tuple else structured

        return hook

    for kind in _SCALARS:
        converter.register_structure_hook(kind, hook_of(kind))
    converter.register_structure_hook_factory(_has_parts, hook_of)
    return converter


def _has_parts(kind: Any) -> bool:  # noqa: ANN401 - any type
    """Whether `kind` is a dataclass, a table, or a list of any length."""
    container, parts = get_origin(kind), get_args(kind)
    any_length = container is list or (container is tuple and parts[1:] == (...,))
    return is_dataclass(kind) or any_length or container in (dict, Mapping)


class _KindError(ValueError):
    """A value of a table that is not of the expected kind."""

    def __init__(self, value: object, expected: str) -> None:
        super().__init__(value, expected)
        self.value, self.expected = value, expected


class _UnknownKeyError(ValueError):
    """A key that is not one of the `names` of a table."""

    def __init__(self, key: str, names: Sequence[str]) -> None:
        super().__init__(key, names)
        self.key, self.names = key, names


class _FieldError(Exception):
    """A problem of a field of a dataclass: its keys and the cause."""

    def __init__(self, keys: tuple[str, ...], cause: Exception) -> None:
        super().__init__(keys, cause)
        self.keys, self.cause = keys, cause


def _has_scalars_only(kind: type) -> bool:
    """Whether `kind` is a dataclass of numbers, texts and truth values, which need no cattrs."""
    if kind not in _scalars_only:
        hints = get_type_hints(kind) if is_dataclass(kind) else {}
        _scalars_only[kind] = is_dataclass(kind) and all(
            field.init and hints[field.name] in _SCALARS for field in fields(kind)
        )
    return _scalars_only[kind]


_scalars_only: dict[type, bool] = {}


def _structure_scalars(table: object, kind: type[_Value]) -> _Value:
    """Value of a dataclass with `_has_scalars_only`, by the rules of `structure`."""
    if not isinstance(table, Mapping):
        raise _KindError(table, "a table")
    hints, defined = get_type_hints(kind), {field.name: field for field in fields(kind)}  # type: ignore[arg-type] # a dataclass
    if unknown := sorted(map(str, table.keys() - defined.keys())):
        raise _UnknownKeyError(unknown[0], list(defined))
    values: dict[str, object] = {}
    for name, field in defined.items():
        if name not in table:
            if field.default is MISSING and field.default_factory is MISSING:
                raise _FieldError((name,), KeyError(name))
            continue
        value, (types, expected) = table[name], _SCALARS[hints[name]]
        if not isinstance(value, types) or (isinstance(value, bool) and hints[name] is not bool):
            raise _FieldError((name,), _KindError(value, expected))
        try:
            values[name] = hints[name](value)
        except OverflowError:
            raise _FieldError((name,), _KindError(value, f"{expected} below 1e308")) from None
    return kind(**values)


def _table_error(
    keys: tuple[str | int, ...], cause: BaseException, make_error: MakeError, section: str
) -> FembridgeError:
    """Error of the problem `cause` at the `keys` of a table, the `section` of a file."""
    path = "".join(f" {key + 1}" if isinstance(key, int) else f".{key}" for key in keys)
    section = f"{section}{path}".lstrip(". ")
    value: object = None
    expected = None
    if isinstance(cause, FembridgeError):
        located = FembridgeError.from_error(cause, section=section)
        text, section = located.problem, located.key or ""
        value, expected = located.found, located.expected
    elif isinstance(cause, _UnknownKeyError):
        section = f"{section}.{cause.key}".lstrip(".")
        value, expected = cause.key, ", ".join(cause.names)
        text = f"is an unknown key, expected {expected}{near_hint(cause.key, cause.names)}"
    elif isinstance(cause, _KindError):
        value, expected = cause.value, cause.expected
        text = f"{repr(value)[:_LONGEST_SHOWN]}, expected {expected}"
        text = f"is {text}" if section else text
    elif isinstance(cause, KeyError):
        text = "is absent"
    else:
        text, section = f"{section}: {cause}".lstrip(": "), ""
    error = make_error(text)
    error.key, error.found, error.expected = section or None, value, expected
    return error


def _first_problem(group: BaseException) -> tuple[tuple[str | int, ...], BaseException]:
    """Keys and error of the first problem of a table; an unknown key before all others."""
    from cattrs import ForbiddenExtraKeysError

    problems = list(_problems(group))
    for keys, cause in problems:
        if isinstance(cause, ForbiddenExtraKeysError):
            names = [field.name for field in fields(cause.cl)]
            return keys, _UnknownKeyError(min(map(str, cause.extra_fields)), names)
    return problems[0]


def _problems(
    error: BaseException, keys: tuple[str | int, ...] = ()
) -> Iterator[tuple[tuple[str | int, ...], BaseException]]:
    """Keys and error of each problem of a table; an int is an index in a list, from 0."""
    from cattrs import BaseValidationError, ClassValidationError, IterableValidationError

    if isinstance(error, ClassValidationError):
        noted, plain = error.group_exceptions()
        for item, note in noted:
            yield from _problems(item, (*keys, note.name))
    elif isinstance(error, IterableValidationError):
        listed, plain = error.group_exceptions()
        for item, index_note in listed:
            yield from _problems(item, (*keys, index_note.index))
    elif isinstance(error, BaseValidationError):
        plain = list(error.exceptions)
    else:
        yield keys, error
        return
    for item in plain:
        yield from _problems(item, keys)


def _merged(base: Mapping[str, Any], overrides: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for key, value in overrides.items():
        both = isinstance(value, Mapping) and isinstance(merged.get(key), Mapping)
        merged[key] = _merged(merged[key], value) if both else value
    return merged


def _without_none(value: Any) -> Any:  # noqa: ANN401 - as nested as the value
    if isinstance(value, Mapping):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    if isinstance(value, list | tuple):
        return [_without_none(item) for item in value]
    return value


def sha256_of(path: Path) -> str:
    """SHA-256 of the bytes of a file, hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def write_sealed(path: Path, table: Table) -> None:
    """Write `table`, which has a ``format``, below a line with its checksum."""
    import tomli_w

    sealed = tomli_w.dumps(table)
    write_text(path, f"{_seal(sealed.encode())}\n{sealed}")


def read_sealed(path: Path, kind: str, expected: object, max_bytes: int = MAX_TOML_BYTES) -> Table:
    """Table that `write_sealed` wrote: a `kind`, with the ``format`` `expected`.

    `max_bytes` limits the size of the file. Default: 1 MB.
    """
    content = read_bytes(path, max_bytes, ResponseError)
    return sealed_table(content, path, kind, expected, max_bytes)


def sealed_table(
    content: bytes, path: Path, kind: str, expected: object, max_bytes: int = MAX_TOML_BYTES
) -> Table:
    """Table in the `content` of a file `path` that `write_sealed` wrote; as `read_sealed`."""
    if len(content) > max_bytes:
        raise ResponseError(f"more than {max_bytes} bytes", path)
    max_keys = MAX_TOML_KEYS * max_bytes // MAX_TOML_BYTES
    table = _parse_table(content, path, f"a {kind}", ResponseError, max_keys)
    if table.get("format") != expected:
        raise ResponseError(f"format {table.get('format')!r}, expected {expected}", path)
    seal, _, sealed = content.partition(b"\n")
    if seal != _seal(sealed).encode():
        raise ResponseError("its numbers do not match its checksum: it was edited or cut", path)
    return table


def _seal(sealed: bytes) -> str:
    """First line of a file: the checksum of all bytes below it."""
    return f'sha256 = "{hashlib.sha256(sealed).hexdigest()}"'


def digest(content: object) -> str:
    """SHA-256 of tables, lists, texts and numbers as JSON, sorted, without blanks, hexadecimal."""
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
