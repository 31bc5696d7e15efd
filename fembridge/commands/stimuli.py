"""List the stimuli of the catalogue, or write their waveforms to files.

Without an id the whole catalogue is shown; an id or the name of a set shows
what it stands for. Amplitudes are zero-to-peak in um, positive into the skin;
a waveform has a sample every 0.5 ms for 250 ms. Two amplitudes are kept as the
appendix prints them though they are probably misprints; the list names them.
"""

import argparse
import sys
from typing import Any

EXAMPLE = "fembridge stimuli --export csv sine_20_250,noise_25_250 -o waveforms/"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    parser.add_argument(
        "ids",
        nargs="*",
        metavar="ID",
        help="sine_20_250, a set as sine_20, noise or all; commas join several",
    )
    parser.add_argument(
        "--export",
        choices=("csv", "wav", "npy", "marc-table"),
        help="write the waveform of each ID instead of listing it",
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="PATH",
        help="file for one stimulus, folder for several (default: current folder)",
    )
    parser.add_argument(
        "--preindent-um",
        type=float,
        default=None,
        metavar="DEPTH",
        help="depth of the probe before time 0, added to every sample (default: 0)",
    )
    parser.add_argument("--seed", type=int, help="draw other noise than the catalogue's (>= 0)")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """List or export; the summary holds every stimulus or every file."""
    from fembridge.errors import UsageError

    if args.export:
        return _export(args)
    for name in ("output", "preindent_um", "seed"):
        if getattr(args, name) is not None:
            option = name.replace("_", "-")
            raise UsageError(f"--{option} is for --export, which was not given")
    return _list(args)


def _list(args: argparse.Namespace) -> dict[str, Any]:
    from decks.stimuli import (
        CATALOGUE,
        MISPRINT_NOTE,
        catalogue_lines,
        entry_lines,
        resolve,
        to_record,
    )

    entries = resolve(args.ids) if args.ids else CATALOGUE
    if not args.json:
        print(*(entry_lines(entries) if args.ids else catalogue_lines()), sep="\n")
    return {
        "count": len(entries),
        "stimuli": [to_record(entry) for entry in entries],
        "notes": [MISPRINT_NOTE],
    }


def _export(args: argparse.Namespace) -> dict[str, Any]:
    from decks.stimuli import Noise, resolve
    from decks.waveform import make_stimulus
    from fembridge.errors import UsageError
    from fembridge.exports import export_paths, write_stimulus

    entries = resolve(args.ids)
    if args.seed is not None and not any(isinstance(e, Noise) for e in entries):
        raise UsageError("--seed is for noise, and no noise was named")
    paths = export_paths([entry.id for entry in entries], args.export, args.output)
    files = []
    for entry, path in zip(entries, paths, strict=True):
        stimulus = make_stimulus(entry, args.preindent_um or 0.0, args.seed)
        export = write_stimulus(stimulus, path, args.export)
        files.append(
            {
                "id": export.stimulus,
                "file": str(export.path),
                "format": export.format,
                "samples": stimulus.displacement_um.size,
                "dt_ms": stimulus.dt_ms,
                "preindent_um": stimulus.preindent_um,
                "seed": stimulus.origin.get("seed"),
                "full_scale_um": export.full_scale_um,
            }
        )
        if not args.json:
            scale = export.full_scale_um
            print(path, *([] if scale is None else [f"(32767 is {scale!r} um)"]))
    if not args.json and len(files) > 1:
        print(f"{len(files)} files", file=sys.stderr)
    return {"count": len(files), "files": files}
