"""List what CalculiX solved before on this machine, or clear it.

A deck that was solved once is not solved again: its results are kept by the digest of the
deck and the solver, in the user's cache folder. FEMBRIDGE_CACHE names another folder, a
new or empty one, or is "off"; --no-cache leaves it out for one command.
"""

import argparse
from typing import Any

EXAMPLE = "fembridge cache --clear"
MOST_OTHERS = 5


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    parser.add_argument("--clear", action="store_true", help="remove all entries")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """List the entries, the last used first, or remove them."""
    from fembridge.host.cache import (
        OFF,
        VARIABLE,
        cache_folder,
        check_cache,
        clear,
        entries,
        other_names,
    )
    from fembridge.host.system import OPENS_FOLDERS

    check_cache()
    folder = cache_folder()
    removed = clear() if args.clear else 0
    available = entries()
    others = other_names()
    total = sum(entry.bytes for entry in available)
    if folder is None:
        print(f"switched off: {VARIABLE}={OFF}" if OPENS_FOLDERS else "no cache on this system")
    elif args.clear:
        print(f"{removed / 1e6:.1f} MB removed from {folder}")
    else:
        for entry in available:
            title = " ".join(entry.title.split())
            print(f"{_time_text(entry.used_s)}  {entry.bytes / 1e6:8.1f} MB  {title}")
        count = "1 entry" if len(available) == 1 else f"{len(available)} entries"
        print(f"{count}, {total / 1e6:.1f} MB in {folder}")
    if others:
        print(f"not entries of fembridge, left alone: {_listed(others)}")
    return {
        "folder": folder,
        "count": len(available),
        "bytes": total,
        "removed_bytes": removed,
        "entries": [
            {
                "what": entry.title,
                "bytes": entry.bytes,
                "used_s": entry.used_s,
                "folder": entry.folder,
            }
            for entry in available
        ],
        "others": others,
    }


def _listed(names: list[str]) -> str:
    """The first of `names`, and how many more there are."""
    more = len(names) - MOST_OTHERS
    return ", ".join(names[:MOST_OTHERS]) + (f" and {more} more" if more > 0 else "")


def _time_text(time_s: float) -> str:
    """Local time of seconds since 1970; a file may have any."""
    import time

    try:
        return time.strftime("%Y-%m-%d %H:%M", time.localtime(time_s))
    except (OverflowError, OSError, ValueError):
        return "at no known time"
