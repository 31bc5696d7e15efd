"""What all ways of ``fembridge ingest`` say and ask alike."""

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fembridge.results.read_options import ReadOptions


def stress_unit_of(args: argparse.Namespace, path: Path) -> str:
    """Give the unit of the file's stress: as asked, that of ``run.toml``, or MPa."""
    from fembridge.errors import ResultError
    from fembridge.results import run_folder_of

    if args.stress_unit:
        return str(args.stress_unit)
    try:
        run = run_folder_of(path)
    except ResultError:  # it is not what was asked for
        run = None
    return "MPa" if run is None else run.stress_unit


def unit_words(args: argparse.Namespace, path: Path, foreign: bool) -> str:
    """Say in which unit the file's stress was taken."""
    words = f"stress in the file taken as {stress_unit_of(args, path)}"
    if foreign and args.stress_unit is None:
        words += " (--stress-unit says otherwise)"
    return words


def options_of(args: argparse.Namespace, path: Path) -> "ReadOptions":
    """Give what was asked for as a reader takes it."""
    from fembridge.results.read_options import ReadOptions

    return ReadOptions(
        partial=args.partial,
        across_materials=args.across_materials,
        stress_unit=stress_unit_of(args, path),
        tell=teller(path),
        extrapolate=args.extrapolate,
        von_mises=args.von_mises,
    )


def teller(path: Path) -> Callable[[str], None]:
    """Give a function that puts a remark about `path` on stderr."""
    return lambda words: print(f"{path}: {words}", file=sys.stderr)


def listed(path: Path, held: dict[str, Any], quiet: bool) -> dict[str, Any]:
    """Show what `path` holds unless `quiet`; give it back."""
    if not quiet:
        from fembridge.commands.ingest_listing import show

        show(path, held)
    return held
