"""What ``fembridge build-deck`` tells of a folder that it made."""

import argparse
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fembridge.run_folder import RunFolder


def told(args: argparse.Namespace, stimulus: str, built: "RunFolder") -> dict[str, Any]:
    """Print the line of a folder; give its row in the summary."""
    if not args.json:
        print(f"{built.folder}  {built.increments} increments of {built.dt_ms:g} ms")
    return {
        "stimulus": stimulus,
        "folder": str(built.folder),
        "increments": built.increments,
        "deck_sha256": built.deck_sha256,
    }
