"""List the stimuli of the catalogue, or write their waveforms to files.

Without an id the whole catalogue is shown; an id or the name of a set shows
what it stands for. Amplitudes are zero-to-peak in um, positive into the skin;
a waveform has a sample every 0.5 ms for 250 ms. Two amplitudes are kept as the
appendix prints them though they are probably misprints; the list names them.
"""

import argparse
import os
import sys
from typing import TYPE_CHECKING, Any

from fembridge.commands.options import add_options, option

if TYPE_CHECKING:
    from pathlib import Path

EXAMPLE = "fembridge stimuli --export csv sine_20_250,noise_25_250 -o waveforms/"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    add = parser.add_argument
    word = "sine_20_250, a set as sine_20, noise or all; commas join several"
    add("ids", nargs="*", metavar="ID", help=word)
    add(
        "--export",
        choices=("csv", "wav", "npy", "marc-table"),
        help="write the waveform of each ID instead of listing it",
    )
    place = "file for one stimulus, folder for several (default: current folder)"
    add("-o", "--output", metavar="PATH", help=place)
    add_options(parser, ("preindent_um", "seed"))


def run(args: argparse.Namespace) -> dict[str, Any]:
    """List or export; the summary holds every stimulus or every file."""
    from fembridge.errors import UsageError

    if args.export:
        return _export(args)
    for name in ("output", "preindent_um", "seed"):
        if getattr(args, name) is not None:
            raise UsageError(f"{option(name)} is for --export, which was not given")
    return _list(args)


def _list(args: argparse.Namespace) -> dict[str, Any]:
    from decks import stimuli

    entries = stimuli.resolve(args.ids) if args.ids else stimuli.CATALOGUE
    if not args.json:
        lines = stimuli.entry_lines(entries) if args.ids else stimuli.catalogue_lines()
        print(*lines, sep="\n")
    return {
        "count": len(entries),
        "stimuli": [stimuli.to_record(entry) for entry in entries],
        "notes": [stimuli.MISPRINT_NOTE],
    }


def _export(args: argparse.Namespace) -> dict[str, Any]:
    from decks.stimuli import resolve
    from decks.waveform import make_stimulus
    from fembridge.errors import UsageError
    from fembridge.exports import write_stimulus

    entries = resolve(args.ids)
    if args.seed is not None and all(entry.seed is None for entry in entries):
        raise UsageError("--seed is for noise, and no noise was named")
    files = []
    paths = _paths([entry.id for entry in entries], args.export, args.output)
    for entry, path in zip(entries, paths, strict=True):
        stimulus = make_stimulus(entry, args.preindent_um or 0.0, args.seed)
        scale_um = write_stimulus(stimulus, path, args.export)
        files.append(
            {
                "id": stimulus.id,
                "file": str(path),
                "format": args.export,
                "samples": stimulus.displacement_um.size,
                "dt_ms": stimulus.dt_ms,
                "preindent_um": stimulus.preindent_um,
                "seed": stimulus.origin.get("seed"),
                "full_scale_um": scale_um,
            }
        )
        if not args.json:
            print(path, *([] if scale_um is None else [f"(32767 is {scale_um!r} um)"]))
    if not args.json and len(files) > 1:
        print(f"{len(files)} files", file=sys.stderr)
    return {"count": len(files), "files": files}


def _paths(ids: list[str], format_name: str, output: str | None) -> "list[Path]":
    """A file each in the folder `output`; of one stimulus `output` itself may be the file."""
    from pathlib import Path

    from fembridge.errors import OutputError
    from fembridge.exports import FORMATS

    suffix, _ = FORMATS[format_name]
    folder = Path(output or ".")
    if output and len(ids) == 1 and not (output.endswith(("/", os.sep)) or folder.is_dir()):
        return [folder]
    if len(ids) > 1 and folder.is_file():
        raise OutputError(f"a file, expected a folder for {len(ids)} stimuli", folder)
    return [folder / f"{stimulus_id}{suffix}" for stimulus_id in ids]
