"""How much memory a file or a request may take, checked before it is taken.

A small file can describe a large one: compressed zeros, a header with a huge count, a
picture of one colour. A reader therefore works out from the header how many bytes the
content will take and calls `check_memory` or `check_unpacked` before it reads on.

The limit is a quarter of the memory of this machine, or of its container. The environment
variable ``FEMBRIDGE_MEMORY`` sets another limit, for example ``8G``.
"""

import os
import re
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from fembridge.errors import FembridgeError, UsageError

VARIABLE = "FEMBRIDGE_MEMORY"
SHARE = 0.25
"""Share of the machine's memory that one file or request may take."""

MAX_RATIO = 100
"""Results compress 3 to 30 times; gzip and deflate can reach 1000."""

SMALL_BYTES = 1 << 28
"""Content up to this size may be compressed by any ratio."""

_UNKNOWN_MACHINE_BYTES = 8 << 30
_CGROUP_FILES = (
    "/sys/fs/cgroup/memory.max",
    "/sys/fs/cgroup/memory/memory.limit_in_bytes",
)
_SIZE = re.compile(r"(\d+(?:\.\d+)?)\s*([KMGT]?)(?:i?B)?", re.ASCII | re.IGNORECASE)
_POWERS = {"": 0, "K": 1, "M": 2, "G": 3, "T": 4}


def memory_limit_bytes() -> int:
    """Bytes that one file or request may take.

    Raises
    ------
    UsageError
        ``FEMBRIDGE_MEMORY`` is not a size.
    """
    text = os.environ.get(VARIABLE)
    if not text:
        return int(SHARE * machine_bytes())
    match = _SIZE.fullmatch(text.strip())
    size = float(match[1]) * 1024 ** _POWERS[match[2].upper()] if match else 0.0
    if not 1 <= size < 2**63:
        raise UsageError(argument=VARIABLE, found=text, expected="a size such as 8G or 500M")
    return int(size)


def machine_bytes() -> int:
    """Memory of this machine in bytes, or of its container where that is less."""
    sizes = []
    with suppress(OSError, ValueError, AttributeError):
        sizes.append(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    for path in _CGROUP_FILES:
        with suppress(OSError, ValueError):  # absent, or the word max
            sizes.append(int(Path(path).read_text(encoding="ascii")))
    return min((size for size in sizes if size > 0), default=_UNKNOWN_MACHINE_BYTES)


def check_memory(size_bytes: float, content: str, error: Callable[[str], FembridgeError]) -> None:
    """Refuse `content` when it needs more than `memory_limit_bytes`.

    Parameters
    ----------
    size_bytes
        Most memory at one time, copies included.
    content
        Subject of the sentence ``... takes 3.2 GB of memory``.
    error
        Makes the error of the problem.
    """
    limit_bytes = memory_limit_bytes()
    if size_bytes > limit_bytes:
        origin = "" if os.environ.get(VARIABLE) else ", a quarter of the machine's memory"
        raise error(
            f"{content} takes {size_text(size_bytes)} of memory, the limit is "
            f"{size_text(limit_bytes)}{origin}; {VARIABLE}=8G sets another limit"
        )


def check_unpacked(
    packed_bytes: int,
    unpacked_bytes: int,
    content: str,
    error: Callable[[str], FembridgeError],
    *,
    copies: float = 1.0,
) -> None:
    """Refuse compressed content that grows more than `MAX_RATIO` times, or needs too much memory.

    Parameters
    ----------
    packed_bytes, unpacked_bytes
        Size on the disk, and the size that the headers state.
    copies
        How many times the unpacked content is in memory at once.
    """
    if unpacked_bytes > max(SMALL_BYTES, MAX_RATIO * packed_bytes):
        raise error(
            f"{content} unpacks to {size_text(unpacked_bytes)}, more than {MAX_RATIO} times its "
            f"{size_text(packed_bytes)}"
        )
    check_memory(copies * unpacked_bytes, content, error)


def size_text(size_bytes: float) -> str:
    """A size for people: ``512 B``, ``3.2 GB``, in powers of 1024."""
    power = 0
    while size_bytes >= 1000 and power < len(_POWERS) - 1:
        size_bytes, power = size_bytes / 1024, power + 1
    letter = list(_POWERS)[power]
    return f"{size_bytes:.3g} {letter}B"
