"""The catalogue as lines of text, for a reader at a terminal.

Plain ASCII, so that no terminal and no pipe stumbles over a Greek letter.
"""

from collections.abc import Sequence
from itertools import groupby

from decks.stimuli.appendix import MISPRINT_NOTE
from decks.stimuli.catalogue import CATALOGUE, set_name
from decks.stimuli.entry import Diharmonic, Entry, Noise, Sine, number_text

TITLES = {"sine": "Sinusoids", "diharm": "Diharmonics", "noise": "Band-pass noises"}
LEVELS = {
    "sine": "zero-to-peak amplitudes",
    "diharm": "zero-to-peak amplitudes, component 1 + component 2",
    "noise": "root-mean-square levels",
}


def catalogue_lines() -> list[str]:
    """All of the catalogue: a block a family, a line for each set of levels."""
    lines = [
        f"{len(CATALOGUE)} stimuli of the paper's appendix. Each line is a set; "
        "an id is its name and a level:",
        "sine_20_250, diharm_10_50_125 (level of component 1), noise_25_250_10",
    ]
    for family, members in groupby(CATALOGUE, key=lambda entry: entry.family):
        entries = list(members)
        lines += ["", f"{TITLES[family]} ({len(entries)}): {LEVELS[family]} in um"]
        for name, levels in groupby(entries, key=set_name):
            lines.append(_set_line(name, list(levels)))
    lines += [
        "",
        "Sets: all, sine, diharm, noise, any name above (sine_20).",
        "Your own: sine_40_100, diharm_10_50_20_20 (both amplitudes), noise_30_200_7.",
        f"Note: {MISPRINT_NOTE}.",
    ]
    return lines


def entry_lines(entries: Sequence[Entry]) -> list[str]:
    """One line for each entry: its id, its numbers, its window."""
    width = max(len(entry.id) for entry in entries)
    lines = [
        f"{entry.id:<{width}}  {_description(entry)}, counted in {_window(entry)}"
        + ("" if entry.in_appendix else "  (not in the appendix)")
        for entry in entries
    ]
    return [*lines, f"{len(entries)} stimuli" if len(entries) > 1 else "1 stimulus"]


def to_record(entry: Entry) -> dict[str, object]:
    """Everything about an entry, for JSON."""
    record: dict[str, object] = {"id": entry.id, "family": entry.family}
    record |= entry.numbers()
    if isinstance(entry, Noise):
        record["seed"] = entry.seed
    return record | {"window_ms": list(entry.window_ms), "in_appendix": entry.in_appendix}


def _set_line(name: str, entries: Sequence[Entry]) -> str:
    levels = " ".join(_level(entry) for entry in entries)
    return f"  {name:<13} {len(entries):>2}  {_window(entries[0]):>10}  {levels}"


def _level(entry: Entry) -> str:
    if isinstance(entry, Sine):
        return number_text(entry.amplitude_um)
    if isinstance(entry, Noise):
        return number_text(entry.rms_um)
    return f"{number_text(entry.amplitude1_um)}+{number_text(entry.amplitude2_um)}"


def _window(entry: Entry) -> str:
    start, end = entry.window_ms
    return f"{start:g}-{end:g} ms"


def _description(entry: Entry) -> str:
    numbers = [number_text(number) for number in entry.numbers().values()]
    if isinstance(entry, Sine):
        return "{} Hz, {} um".format(*numbers)
    if isinstance(entry, Diharmonic):
        return "{} Hz + {} Hz, {} um + {} um".format(*numbers)
    return "{} to {} Hz, {} um RMS".format(*numbers) + f", seed {entry.seed}"
