"""What a solver computed, kept by the digest of what it was made from: solved once.

An entry is a folder named by its key. Its files are listed with their checksums in
``entry.toml``, which is sealed; the folder takes its name when it is whole. An entry that
was altered is not used and made again. The cache is in the user's cache folder;
``FEMBRIDGE_CACHE`` names another, or is ``off``. Beyond `LIMIT_BYTES` the entries go that
were not used for the longest time.

``FEMBRIDGE_CACHE`` may name any folder by mistake. So a folder with files of others is
refused, ``CACHEDIR.TAG`` marks the others, no link in the cache is followed, and only
the files that a sealed list names are ever removed, from the folder of their key.
"""

import hashlib
import os
import re
import shutil
import stat
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fembridge.errors import FembridgeError, OutputError, ResponseError, UsageError
from fembridge.host.store import (
    DRAFT_PREFIX,
    digest,
    locked_folder,
    remove_abandoned_drafts,
    sealed_table,
    sha256_of,
    working_folder,
    write_sealed,
    write_text,
)
from fembridge.host.system import FOLDER_ONLY, NO_LINK, NO_WAIT, OPENS_FOLDERS, flush_to_disk
from fembridge.typing import Table

VARIABLE = "FEMBRIDGE_CACHE"
OFF = "off"
LIMIT_BYTES = 2_000_000_000
ENTRY_LIMIT_BYTES = 200_000_000
"""Of one entry: whole fields of a large model are not worth the place."""
FORMAT = 1
ENTRY_FILE = "entry.toml"
TAG_FILE = "CACHEDIR.TAG"
"""Marks the cache; the name and first line are of https://bford.info/cachedir."""
TAG = (
    "Signature: 8a477f597d28d172789f06886806bc55\n"
    "# This folder is a cache of fembridge, which removes its entries when they are old.\n"
)

_KEY_LETTERS = 32
_KEY = re.compile(f"[0-9a-f]{{{_KEY_LETTERS}}}")
_SHA256 = re.compile("[0-9a-f]{64}")
_FILE_NAME = re.compile(r"[\w-][\w.-]{0,99}", re.ASCII)
_MOST_FILES = 100
_ENTRY_FILE_BYTES = 1_000_000
# What earlier versions have written into entries, also into those that a kill left.
_EARLIER_NAMES = re.compile(r"entry\.toml|job\.(frd|dat|sta|cvg)|solver\.(log|toml)")
# What systems put into every folder that is looked at.
_OF_THE_SYSTEM = re.compile(
    r"\.DS_Store|\._.*|\.localized|Thumbs\.db|desktop\.ini|\.directory|\.nfs[0-9a-f]+|lost\+found"
)
_MOST_SHOWN = 3


@dataclass(frozen=True, slots=True)
class Entry:
    """One entry of the cache.

    `title` describes the run, `record` what was kept with it, `files` the checksum of each
    file by name, `bytes` their size, and `used_s` the last use, in seconds since 1970.
    """

    folder: Path
    title: str
    record: dict[str, Any]
    files: Mapping[str, str]
    bytes: int
    used_s: float


class _DamagedError(Exception):
    """An entry that is none, or not as it was kept."""


def cache_folder() -> Path | None:
    """Folder of the cache; None: it is switched off, or the system opens no folders (Windows)."""
    from platformdirs import user_cache_path

    value = os.environ.get(VARIABLE)
    if value == OFF or not OPENS_FOLDERS:
        return None
    return Path(value).absolute() if value else user_cache_path("fembridge")


def check_cache() -> None:
    """Refuse a cache folder with files of others, before anything is solved.

    Raises
    ------
    UsageError
        ``FEMBRIDGE_CACHE`` names a file, or a folder that has content and is no cache of
        fembridge.
    """
    cache = cache_folder()
    if cache is not None and cache.is_file():
        raise UsageError(
            f"is {cache}, a file, expected a folder or {OFF!r}", argument=VARIABLE, found=cache
        )
    foreign = [] if cache is None else _foreign_names(cache)
    if foreign:
        more = ", ..." if len(foreign) > _MOST_SHOWN else ""
        raise UsageError(
            f"is {cache}, which holds other files ({', '.join(foreign[:_MOST_SHOWN])}"
            f"{more}), expected a cache of fembridge, an empty or a new folder, or {OFF!r}",
            argument=VARIABLE,
            found=cache,
        )


def key_of(made_from: Table) -> str:
    """Name of the entry that is made from `made_from`: tables, lists, words and numbers."""
    return digest({"format": FORMAT, **made_from})[:_KEY_LETTERS]


def take(key: str, folder: Path) -> dict[str, Any] | None:
    """Copy the files of the entry `key` into `folder`; its record, None where there is none.

    An entry that was altered, or cannot be read, is none. It does not replace files that
    are in `folder`.

    Raises
    ------
    OutputError
        `folder` cannot be written.
    """
    cache = _usable_cache()
    if cache is None:
        return None
    copies: list[Path] = []
    try:
        with _opened(cache / key) as handle:
            entry = _read(cache / key, handle)
            if entry.bytes > ENTRY_LIMIT_BYTES:
                raise _DamagedError
            for name, sha256 in entry.files.items():
                if (folder / name).exists():
                    raise _DamagedError
                copies.append(folder / name)
                _copy(handle, name, folder / name)
                if sha256_of(folder / name) != sha256:
                    raise _DamagedError
            with suppress(OSError):
                os.utime(ENTRY_FILE, dir_fd=handle, follow_symlinks=False)
            return entry.record
    except _DamagedError:
        for copy in copies:
            copy.unlink(missing_ok=True)
        return None
    except OSError as error:
        raise OutputError(f"cannot write: {error.strerror or error}", folder) from error


def keep(key: str, title: str, record: Table, files: Iterable[Path]) -> None:
    """Keep copies of `files` and `record` as the entry `key`.

    A cache that cannot be written is left as it is: the results are elsewhere, whole.
    """
    paths = list(files)
    with suppress(OSError, FembridgeError):
        size = sum(path.stat().st_size for path in paths)
        cache = _usable_cache()
        if cache is None or size > ENTRY_LIMIT_BYTES:
            return
        cache.mkdir(mode=0o700, parents=True, exist_ok=True)
        if not os.path.lexists(cache / TAG_FILE):
            write_text(cache / TAG_FILE, TAG)
        _make_room(cache, size)
        with working_folder(cache) as work:
            draft = work / key
            draft.mkdir()
            for path in paths:
                shutil.copyfile(path, draft / path.name)
            table = {
                "format": FORMAT,
                "key": key,
                "what": title,
                "record": dict(record),
                "files": {path.name: sha256_of(draft / path.name) for path in paths},
            }
            write_sealed(draft / ENTRY_FILE, table)
            for path in draft.iterdir():
                flush_to_disk(path)
            with locked_folder(cache):
                if not _is_whole(cache / key):
                    _remove_damaged(cache / key, [path.name for path in paths])
                    draft.rename(cache / key)  # fails where a folder with content is


def entries(most: int | None = None) -> list[Entry]:
    """Entries of the cache, the last used first; `most` of them alone are read."""
    cache = _usable_cache()
    available: list[Entry] = []
    for _, folder in [] if cache is None else _by_use(cache):
        if most is not None and len(available) >= most:
            break
        with suppress(_DamagedError), _opened(folder) as handle:
            available.append(_read(folder, handle))
    return available


def clear() -> int:
    """Remove all entries of the cache; how many bytes that were.

    Raises
    ------
    OutputError
        One of them cannot be removed.
    UsageError
        As `check_cache`.
    """
    check_cache()
    cache = cache_folder()
    if cache is None or not cache.is_dir():
        return 0
    removed = 0
    with locked_folder(cache):
        for entry in entries():
            try:
                _remove(entry)
            except OSError as error:
                problem = f"cannot be removed: {error.strerror}"
                raise OutputError(problem, entry.folder) from error
            removed += entry.bytes
        remove_abandoned_drafts(cache)
    return removed


def other_names() -> list[str]:
    """Names in the cache of what is no entry, nor of the system or of a command at work."""
    cache = _usable_cache()
    listed = {TAG_FILE, *(entry.folder.name for entry in entries())}
    names: list[str] = []
    with suppress(OSError):
        names = [] if cache is None else [path.name for path in cache.iterdir()]
    return sorted(
        name for name in names if name not in listed and not _is_draft_or_system_file(name)
    )


def _usable_cache() -> Path | None:
    """Folder of the cache, None where it is off or refused by `check_cache`."""
    cache = cache_folder()
    return None if cache is None or _foreign_names(cache) else cache


def _foreign_names(cache: Path) -> list[str]:
    """Names of others in a folder that is not marked as a cache, in order; [] elsewhere.

    Nobody else writes into the user's own cache folder of fembridge. Caches of earlier
    versions have no mark: they are known by what they hold.
    """
    if not os.environ.get(VARIABLE) or _is_tagged(cache):
        return []
    try:
        with os.scandir(cache) as items:
            return sorted(item.name for item in items if not _is_cache_item(item))
    except OSError:  # absent, no folder, or not ours to read: nothing is kept there
        return []


def _is_tagged(cache: Path) -> bool:
    """Whether our mark is in `cache`; a link is none."""
    with suppress(_DamagedError), _opened(cache, follow=True) as handle:
        return _content(handle, TAG_FILE, len(TAG)).startswith(TAG.encode())
    return False


def _is_cache_item(item: "os.DirEntry[str]") -> bool:
    """Whether fembridge or the system wrote an item of a folder without `TAG_FILE`."""
    if _is_draft_or_system_file(item.name):
        return True
    if not (_KEY.fullmatch(item.name) and item.is_dir(follow_symlinks=False)):
        return False
    try:
        names = [path.name for path in Path(item.path).iterdir()]
    except OSError:
        return False
    return all(_is_draft_or_system_file(name) or _EARLIER_NAMES.fullmatch(name) for name in names)


def _is_draft_or_system_file(name: str) -> bool:
    """Whether `name` is that of a draft of a running command, or of a file of the system."""
    return name.startswith(DRAFT_PREFIX) or _OF_THE_SYSTEM.fullmatch(name) is not None


@contextmanager
def _opened(folder: Path, *, follow: bool = False) -> Iterator[int]:
    """Handle of `folder`, for names in it; `_DamagedError` where it is none, or a link."""
    flags = os.O_RDONLY | FOLDER_ONLY | (0 if follow else NO_LINK)
    try:
        handle = os.open(folder, flags)
    except OSError as error:
        raise _DamagedError from error
    try:
        yield handle
    finally:
        os.close(handle)


def _open_file(folder: int, name: str) -> int:
    """Handle of the regular file `name` of an open folder; a link, pipe or device is damage."""
    try:
        handle = os.open(name, os.O_RDONLY | NO_LINK | NO_WAIT, dir_fd=folder)
    except OSError as error:
        raise _DamagedError from error
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise _DamagedError
    return handle


def _content(folder: int, name: str, limit_bytes: int) -> bytes:
    """At most `limit_bytes` of a file of an open folder."""
    with open(_open_file(folder, name), "rb") as file:
        try:
            return file.read(limit_bytes)
        except OSError as error:
            raise _DamagedError from error


def _copy(folder: int, name: str, target: Path) -> None:
    """Copy a file of an open folder; `_DamagedError` where it cannot be read."""
    with open(_open_file(folder, name), "rb") as source, target.open("wb") as out:
        remaining_bytes = ENTRY_LIMIT_BYTES
        while True:
            try:
                block = source.read(1 << 20)
            except OSError as error:
                raise _DamagedError from error
            if not block:
                return
            remaining_bytes -= len(block)
            if remaining_bytes < 0:
                raise _DamagedError
            out.write(block)


def _read(folder: Path, handle: int) -> Entry:
    """The entry in an open `folder`, checked but for the content of its files.

    Raises
    ------
    _DamagedError
        ``entry.toml`` is absent, a link, not sealed, of another key, or names what is no
        file of an entry.
    """
    if not _KEY.fullmatch(folder.name):
        raise _DamagedError
    content = _content(handle, ENTRY_FILE, _ENTRY_FILE_BYTES + 1)
    try:
        table = sealed_table(content, folder / ENTRY_FILE, "cache entry", FORMAT)
    except ResponseError as error:
        raise _DamagedError from error
    description, record, files = (table.get(name) for name in ("what", "record", "files"))
    if not (
        isinstance(description, str)
        and isinstance(record, dict)
        and isinstance(files, dict)
        and table.get("key", folder.name) == folder.name  # earlier versions wrote none
        and len(files) <= _MOST_FILES
        and all(_is_listed(name, sha256) for name, sha256 in files.items())
    ):
        raise _DamagedError
    size, used_s = len(content), 0.0
    with suppress(OSError):
        used_s = os.stat(ENTRY_FILE, dir_fd=handle, follow_symlinks=False).st_mtime
    for name in files:
        with suppress(OSError):
            size += os.stat(name, dir_fd=handle, follow_symlinks=False).st_size
    return Entry(folder, description, record, files, size, used_s)


def _is_listed(name: str, sha256: object) -> bool:
    """Whether `name` and `sha256` can be of a file that `keep` has put into an entry."""
    is_plain = _FILE_NAME.fullmatch(name) is not None and name != ENTRY_FILE
    return is_plain and isinstance(sha256, str) and _SHA256.fullmatch(sha256) is not None


def _by_use(cache: Path) -> list[tuple[float, Path]]:
    """Last use and folder of what may be an entry, the last used first."""
    items: list[tuple[float, Path]] = []
    with suppress(OSError), os.scandir(cache) as listed:
        for item in listed:
            if _KEY.fullmatch(item.name) and item.is_dir(follow_symlinks=False):
                path = cache / item.name
                with suppress(OSError):
                    items.append(((path / ENTRY_FILE).lstat().st_mtime, path))
    return sorted(items, reverse=True)


def _remove(entry: Entry) -> None:
    """Remove the files of an entry, the list first, and its folder where nothing else is in it.

    A folder under the name of a file is not ours, and stays.
    """
    with suppress(_DamagedError), _opened(entry.folder) as handle:
        for name in (ENTRY_FILE, *entry.files):
            _remove_name(handle, name)
    remove_abandoned_drafts(entry.folder)
    with suppress(OSError):
        entry.folder.rmdir()


def _remove_name(folder: int, name: str) -> None:
    """Remove the file `name` of an open folder, if it is there; a folder stays."""
    with suppress(FileNotFoundError, IsADirectoryError):
        if not stat.S_ISDIR(os.stat(name, dir_fd=folder, follow_symlinks=False).st_mode):
            os.unlink(name, dir_fd=folder)


def _is_whole(folder: Path) -> bool:
    """Whether `folder` is an entry, with the content that its list has."""
    with suppress(_DamagedError), _opened(folder) as handle:
        for name, sha256 in _read(folder, handle).files.items():
            with open(_open_file(handle, name), "rb") as file:
                if hashlib.file_digest(file, "sha256").hexdigest() != sha256:
                    return False
        return True
    return False


def _remove_damaged(folder: Path, names: Iterable[str]) -> None:
    """Make room for the entry of this key, which has just been solved: the old one is damaged."""
    with suppress(_DamagedError), _opened(folder) as handle:
        for name in (ENTRY_FILE, *names):
            _remove_name(handle, name)
            with suppress(OSError):  # an empty folder under the name of a file
                os.rmdir(name, dir_fd=handle)
    with suppress(OSError):
        folder.rmdir()


def _make_room(cache: Path, required: int) -> None:
    """Remove entries from the end of the list until `required` bytes more are in the limit."""
    if sum(_about_bytes(folder) for _, folder in _by_use(cache)) + required <= LIMIT_BYTES:
        return
    with locked_folder(cache):
        available = entries()
        total = sum(entry.bytes for entry in available)
        while available and total + required > LIMIT_BYTES:
            entry = available.pop()
            with suppress(OSError):
                _remove(entry)
            total -= entry.bytes


def _about_bytes(folder: Path) -> int:
    """Size of all files in a folder that may be an entry: an upper bound, without reading."""
    size = 0
    with suppress(OSError), os.scandir(folder) as items:
        for item in items:
            size += item.stat(follow_symlinks=False).st_size
    return size
