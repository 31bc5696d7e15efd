"""List the stimuli of the catalogue, or write their waveforms to files.

Without an id the whole catalogue is shown; an id, the name of a set or the path of a
waveform shows what it stands for. Amplitudes are zero-to-peak in um, positive into the
skin; a waveform has a sample every 0.5 ms, those of the paper for 250 ms. Two amplitudes
are kept as the appendix prints them though they are probably misprints; the list names
them. ramp_300_100_200_100 is a ramp-and-hold: depth in um, then up, hold and down in ms.

A waveform of yours is a .csv with time_ms (or time_s) and displacement_um (or
displacement_mm), a .wav, an .npy with --dt-ms, or what --export wrote. It starts at 0, or
where the probe stands before time 0; other steps than 0.5 ms are resampled.
"""

import argparse
import os
from itertools import groupby
from typing import TYPE_CHECKING, Any

from fembridge.commands.options import (
    NUMBERS,
    RepeatedOption,
    Use,
    add_from,
    names_a_file,
    words_of,
)
from fembridge.host.terminal import log

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from decks.stimuli import Entry
    from fembridge.stimulus import Stimulus

EXAMPLE = "fembridge stimuli --export csv sine_20_250,noise_25_250 -o waveforms/"

USES = (
    Use("--output --preindent-um --seed", "--export", lambda args: args.export),
    Use(
        "--dt-ms", "a waveform in .npy", lambda args: names_a_file(args.ids + args.waveform, ".npy")
    ),
    Use(
        "--full-scale-um",
        "a waveform in .wav",
        lambda args: names_a_file(args.ids + args.waveform, ".wav"),
    ),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    from fembridge.io.waveform import Waveform

    add = parser.add_argument
    meaning = "sine_20_250, a set as sine_20, noise or all, a waveform's path; commas join several"
    add("ids", nargs="*", metavar="ID|FILE", help=meaning)
    add("--waveform", action=RepeatedOption, default=[], metavar="FILE", help="the same as FILE")
    add(
        "--export",
        choices=("csv", "wav", "npy", "marc-table"),
        help="write the waveform of each ID instead of listing it",
    )
    destination = "file for one stimulus, folder for several (default: current folder)"
    add("-o", "--output", metavar="PATH", help=destination)
    depth = "depth of the probe before time 0 (default: 0)"
    add_from(parser, Waveform, "seed", "dt_ms", "full_scale_um")
    add(
        "--preindent-um",
        type=NUMBERS["preindent_um"],
        metavar="DEPTH",
        help=depth,
    )


def run(args: argparse.Namespace) -> dict[str, Any]:
    """List or export; the summary holds every stimulus or every file."""
    args.ids += args.waveform
    if args.export:
        return _export(args)
    return _list(args)


def _list(args: argparse.Namespace) -> dict[str, Any]:
    from decks import stimuli

    files, entries = stimuli.named(args.ids) if args.ids else ((), stimuli.CATALOGUE)
    waveforms = _made(args, files) if files else []
    for waveform in waveforms:
        start, end = waveform.window_ms
        depths_um = waveform.displacement_um
        print(
            f"{waveform.id}  {depths_um.size} samples, {depths_um.min():g} to "
            f"{waveform.deepest_um:g} um, counted in {start:g}-{end:g} ms  "
            f"({waveform.origin['file']})"
        )
    if entries:
        print(*(_entry_lines(entries) if args.ids else _catalogue_lines()), sep="\n")
    records: list[dict[str, Any]] = [
        {
            "id": waveform.id,
            **waveform.origin,
            "window_ms": list(waveform.window_ms),
            "in_appendix": False,
        }
        for waveform in waveforms
    ]
    records += map(_record, entries)
    return {"count": len(records), "stimuli": records, "notes": [stimuli.MISPRINT_NOTE]}


def _catalogue_lines() -> list[str]:
    """All of the catalogue: a block a family, a line for each set of levels."""
    from decks.stimuli import CATALOGUE, MISPRINT_NOTE, set_name

    lines = [
        f"{len(CATALOGUE)} stimuli of the paper's appendix. Each line is a set; "
        "an id is its name and a level:",
        "sine_20_250, diharm_10_50_125 (level of component 1), noise_25_250_10",
    ]
    for _, members in groupby(CATALOGUE, key=lambda entry: entry.family):
        entries = list(members)
        lines += ["", entries[0].title.format(len(entries))]
        for name, grouped in groupby(entries, key=set_name):
            levels = list(grouped)
            level_text = " ".join(map(_level, levels))
            lines.append(f"  {name:<13} {len(levels):>2}  {_window(levels[0]):>10}  {level_text}")
    lines += [
        "",
        "Sets: all, sine, diharm, noise, any name above (sine_20).",
        "Your own: sine_40_100, diharm_10_50_20_20 (both amplitudes), noise_30_200_7,",
        "ramp_300_100_200_100 (300 um deep in 100 ms, held for 200 ms, back in 100 ms),",
        "and any waveform in a .csv, .wav or .npy: its path instead of an id.",
        f"Note: {MISPRINT_NOTE}.",
    ]
    return lines


def _entry_lines(entries: "Sequence[Entry]") -> list[str]:
    """One line for each entry: its id, its numbers, its window."""
    width = max(len(entry.id) for entry in entries)
    lines = [
        f"{entry.id:<{width}}  {_description(entry)}, counted in {_window(entry)}"
        + ("" if entry.in_appendix else "  (not in the appendix)")
        for entry in entries
    ]
    return [*lines, f"{len(entries)} stimuli" if len(entries) > 1 else "1 stimulus"]


def _record(entry: "Entry") -> dict[str, object]:
    """Everything about an entry, for JSON."""
    record: dict[str, object] = {"id": entry.id, "family": entry.family}
    record |= entry.numbers()
    if entry.seed is not None:
        record["seed"] = entry.seed
    return record | {"window_ms": list(entry.window_ms), "in_appendix": entry.in_appendix}


def _level(entry: "Entry") -> str:
    from decks.stimuli import number_text

    amplitudes = (n for name, n in entry.numbers().items() if name.endswith("_um"))
    return "+".join(map(number_text, amplitudes))


def _window(entry: "Entry") -> str:
    start, end = entry.window_ms
    return f"{start:g}-{end:g} ms"


def _description(entry: "Entry") -> str:
    from decks.stimuli import number_text

    numbers = map(number_text, entry.numbers().values())
    drawn = "" if entry.seed is None else f", seed {entry.seed}"
    return entry.description_format.format(*numbers) + drawn


def _made(args: argparse.Namespace, sources: "Sequence[str | Path]") -> "list[Stimulus]":
    from fembridge.io.waveform import Waveform, check_preindentation

    stimuli = Waveform(sources, **words_of(args, Waveform)).stimuli(args.preindent_um or 0.0)
    check_preindentation(stimuli, args.preindent_um)
    return stimuli


def _export(args: argparse.Namespace) -> dict[str, Any]:
    from contextlib import ExitStack

    from fembridge.host.store import filling
    from fembridge.io.waveform_file import write_stimulus

    made = _made(args, args.ids)
    # All files of one export share their scale: a sound card plays them as loud as they are.
    peak_um = max(float(abs(stimulus.displacement_um).max()) for stimulus in made)
    files = []
    paths = _paths([stimulus.id for stimulus in made], args.export, args.output)
    with ExitStack() as stack:
        targets = paths
        if len(paths) > 1:
            draft = stack.enter_context(filling(paths[0].parent, last=paths[-1].name))
            targets = [draft / path.name for path in paths]
        scales_um = [
            write_stimulus(stimulus, target, args.export, peak_um)
            for stimulus, target in zip(made, targets, strict=True)
        ]
    for stimulus, path, scale_um in zip(made, paths, scales_um, strict=True):
        files.append(
            {
                "id": stimulus.id,
                "file": path,
                "format": args.export,
                "samples": stimulus.displacement_um.size,
                "dt_ms": stimulus.dt_ms,
                "preindent_um": stimulus.preindent_um,
                "seed": stimulus.origin.get("seed"),
                "full_scale_um": scale_um,
            }
        )
        print(path, *([] if scale_um is None else [f"(32767 is {scale_um!r} um)"]))
    if not args.json and len(files) > 1:
        log(f"{len(files)} files")
    return {"count": len(files), "files": files}


def _paths(ids: list[str], format_name: str, output: str | None) -> "list[Path]":
    """A file each in the folder `output`; of one stimulus an `output` with a suffix is the file."""
    from pathlib import Path

    from fembridge.errors import OutputError
    from fembridge.io.waveform_file import FORMATS

    suffix, _ = FORMATS[format_name]
    folder = Path(output or ".")
    named = bool(folder.suffix) and not (str(output).endswith(("/", os.sep)) or folder.is_dir())
    if len(ids) == 1 and named:
        return [folder]
    if len(ids) > 1 and folder.is_file():
        raise OutputError(f"a file, expected a folder for {len(ids)} stimuli", folder)
    return [folder / f"{stimulus_id}{suffix}" for stimulus_id in ids]
