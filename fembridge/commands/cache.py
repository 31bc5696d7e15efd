"""List what CalculiX solved before on this machine, or clear it.

A deck that was solved once is not solved again: its results are kept by the digest of the
deck and the solver, in the user's cache folder. FEMBRIDGE_CACHE names another folder, or
is "off"; --no-cache leaves it out for one command.
"""

import argparse
from typing import Any

EXAMPLE = "fembridge cache --clear"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    parser.add_argument("--clear", action="store_true", help="remove all entries")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """List the entries, the last used first, or remove them."""
    import time

    from fembridge.cache import OFF, VARIABLE, bytes_in, cache_folder, clear, entries

    folder = cache_folder()
    removed = clear() if args.clear else 0
    found = entries()
    sizes = [bytes_in(entry.folder) for entry in found]
    total = sum(sizes)
    if folder is None:
        print(f"switched off: {VARIABLE}={OFF}")
    elif args.clear:
        print(f"{removed / 1e6:.1f} MB removed from {folder}")
    else:
        for entry, size in zip(found, sizes, strict=True):
            used = time.strftime("%Y-%m-%d %H:%M", time.localtime(entry.used_s))
            print(f"{used}  {size / 1e6:8.1f} MB  {entry.what}")
        count = "1 entry" if len(found) == 1 else f"{len(found)} entries"
        print(f"{count}, {total / 1e6:.1f} MB in {folder}")
    return {
        "folder": folder,
        "count": len(found),
        "bytes": total,
        "removed_bytes": removed,
        "entries": [
            {"what": one.what, "bytes": size, "used_s": one.used_s, "folder": one.folder}
            for one, size in zip(found, sizes, strict=True)
        ],
    }
