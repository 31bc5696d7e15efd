"""Fail when the built wheel lacks a part or holds one too many."""

import sys
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGES = ("decks", "fembridge", "neural")


def main(folder: str) -> int:
    """Check the newest wheel in `folder`."""
    wheel = max(Path(folder).glob("*.whl"), key=lambda path: path.stat().st_mtime)
    names = set(zipfile.ZipFile(wheel).namelist())
    sources = (path for package in PACKAGES for path in (ROOT / package).rglob("*.*"))
    wanted = {
        path.relative_to(ROOT).as_posix() for path in sources if "__pycache__" not in path.parts
    }
    missing = sorted(wanted - names)
    tops = {name.split("/")[0] for name in names if ".dist-info/" not in name}
    strange = sorted(tops - set(PACKAGES))
    if missing or strange:
        print(f"{wheel.name}: missing {missing}, strange {strange}", file=sys.stderr)
        return 1
    size_mb = wheel.stat().st_size / 1e6
    print(f"{wheel.name}: {len(names)} files, {size_mb:.1f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
