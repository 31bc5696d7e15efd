"""What a solver computed, kept by the digest of what it was made from: solved once.

An entry is a folder named by its key. Its files are listed with their checksums in
``entry.toml``, which is sealed and takes its place last: a part of an entry is none, and
one that was altered is thrown away and made again. The cache is in the user's cache
folder; ``FEMBRIDGE_CACHE`` names another, or is ``off``. Beyond `LIMIT_BYTES` the entries
go that were not used for the longest time.
"""

import os
import shutil
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fembridge.errors import FembridgeError, OutputError, ResponseError
from fembridge.store import digest, filling, read_sealed, sha256_of, write_sealed
from fembridge.typing import Table

VARIABLE = "FEMBRIDGE_CACHE"
OFF = "off"
LIMIT_BYTES = 2_000_000_000
ENTRY_LIMIT_BYTES = 200_000_000
"""Of one entry: whole fields of a large model are not worth the place."""
FORMAT = 1
ENTRY_FILE = "entry.toml"
_KEY_LETTERS = 32


@dataclass(frozen=True, slots=True)
class Entry:
    """One entry: `what` it is, its `record`, and its last use, in seconds since 1970."""

    folder: Path
    what: str
    record: dict[str, Any]
    used_s: float


def cache_folder() -> Path | None:
    """Folder of the cache; None: it is switched off."""
    from platformdirs import user_cache_path

    asked = os.environ.get(VARIABLE)
    if asked == OFF:
        return None
    return Path(asked).absolute() if asked else user_cache_path("fembridge")


def key_of(made_from: Table) -> str:
    """Name of the entry that is made from `made_from`: tables, lists, words and numbers."""
    return digest({"format": FORMAT, **made_from})[:_KEY_LETTERS]


def take(key: str, folder: Path) -> dict[str, Any] | None:
    """Copy the files of the entry `key` into `folder`; its record, None where there is none.

    Raises
    ------
    OutputError
        `folder` cannot be written.
    """
    cache = cache_folder()
    if cache is None or not (cache / key / ENTRY_FILE).is_file():
        return None
    entry, copies = cache / key, []
    try:
        table = read_sealed(entry / ENTRY_FILE, "cache entry", FORMAT)
        for name, sha256 in table["files"].items():
            copy = folder / Path(name).name
            copies.append(copy)
            shutil.copyfile(entry / copy.name, copy)
            if sha256_of(copy) != sha256:
                raise ResponseError(f"{entry / copy.name}: altered")
        with suppress(OSError):
            os.utime(entry / ENTRY_FILE)
        record: dict[str, Any] = table["record"]
        return record
    except (ResponseError, KeyError, TypeError, AttributeError, FileNotFoundError):
        for copy in copies:
            copy.unlink(missing_ok=True)
        shutil.rmtree(entry, ignore_errors=True)
        return None
    except OSError as error:
        raise OutputError(f"cannot write: {error.strerror or error}", folder) from error


def keep(key: str, what: str, record: Table, files: Iterable[Path]) -> None:
    """Keep copies of `files` and `record` as the entry `key`.

    A cache that cannot be written is left as it is: the results are elsewhere, whole.
    """
    cache = cache_folder()
    paths = list(files)
    try:
        size = sum(path.stat().st_size for path in paths)
        if cache is None or size > ENTRY_LIMIT_BYTES:
            return
        cache.mkdir(mode=0o700, parents=True, exist_ok=True)
        _make_room(size)
        with filling(cache / key, last=ENTRY_FILE) as draft:
            for path in paths:
                shutil.copyfile(path, draft / path.name)
            table = {
                "format": FORMAT,
                "what": what,
                "record": dict(record),
                "files": {path.name: sha256_of(draft / path.name) for path in paths},
            }
            write_sealed(draft / ENTRY_FILE, table)
    except (OSError, FembridgeError):
        if cache is not None:
            shutil.rmtree(cache / key, ignore_errors=True)


def entries(most: int | None = None) -> list[Entry]:
    """Entries of the cache, the last used first; `most` of them alone are read."""
    found: list[Entry] = []
    for used_s, folder in _by_use()[:most]:
        with suppress(OSError, ResponseError):  # another process is at work on it
            table = read_sealed(folder / ENTRY_FILE, "cache entry", FORMAT)
            found.append(Entry(folder, table["what"], table["record"], used_s))
    return found


def clear() -> int:
    """Remove all of the cache; how many bytes that were.

    Raises
    ------
    OutputError
        Something of it cannot be removed.
    """
    cache = cache_folder()
    if cache is None or not cache.is_dir():
        return 0
    removed = 0
    for folder in cache.iterdir():
        if not _is_ours(folder):
            continue
        removed += bytes_in(folder)
        try:
            shutil.rmtree(folder)
        except OSError as error:
            raise OutputError(f"cannot be removed: {error.strerror}", folder) from error
    return removed


def _is_ours(folder: Path) -> bool:
    """Whether `folder` is named as an entry is: ``FEMBRIDGE_CACHE`` may name any folder."""
    name = folder.name
    return folder.is_dir() and len(name) == _KEY_LETTERS and not set(name) - set("0123456789abcdef")


def _by_use() -> list[tuple[float, Path]]:
    """Last use and folder of each entry, the last used first."""
    cache = cache_folder()
    found: list[tuple[float, Path]] = []
    for path in cache.glob(f"*/{ENTRY_FILE}") if cache else ():
        with suppress(OSError):
            found.append((path.stat().st_mtime, path.parent))
    return sorted(found, reverse=True)


def bytes_in(folder: Path) -> int:
    """Size of an entry on the disk."""
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())


def _make_room(wanted: int) -> None:
    """Remove entries from the end of the list until `wanted` bytes more are in the limit."""
    found = []
    for _, folder in _by_use():
        with suppress(OSError):  # another process removes it
            found.append((folder, bytes_in(folder)))
    total = sum(size for _, size in found)
    while found and total + wanted > LIMIT_BYTES:
        folder, size = found.pop()
        total -= size
        shutil.rmtree(folder, ignore_errors=True)
