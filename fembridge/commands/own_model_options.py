"""The part of ``fembridge build-deck`` that keeps a user's own model."""

import argparse
import sys
from pathlib import Path
from typing import Any

from fembridge.commands.built_rows import told
from fembridge.commands.model_options import stimuli_from

# Of a deck in N and these: how many mm, and the unit of its stress.
_UNITS = {"mm": (1.0, "MPa"), "m": (1000.0, "Pa")}


def add_own_model_options(group: argparse._ArgumentGroup) -> None:
    """Which deck, what in it becomes the waveform, where the afferents sit."""
    group.add_argument(
        "--base-deck",
        type=Path,
        metavar="FILE",
        help="a .inp of CalculiX or Abaqus, or a .dat of Marc",
    )
    group.add_argument(
        "--amplitude",
        metavar="NAME",
        help="the *AMPLITUDE, or Marc's table, that becomes the waveform (default: the "
        "only one that moves something)",
    )
    group.add_argument(
        "--step",
        metavar="N|NAME",
        help="the step by number, or Marc's load case by name, that it runs in "
        "(default: the only one that uses it)",
    )
    group.add_argument(
        "--afferent",
        type=_afferent,
        action="append",
        default=[],
        metavar="SA=NODE",
        help="the node of an afferent; repeat it for each. Without one, results of "
        "all nodes are written and fembridge ingest asks which to read",
    )
    group.add_argument(
        "--length-unit",
        choices=tuple(_UNITS),
        default="mm",
        help="of the deck (default: mm); with N its stress is in MPa, of m in Pa",
    )


def build_own(args: argparse.Namespace, defaults: argparse.Namespace) -> dict[str, Any]:
    """Write a folder for each stimulus; `defaults` are of options for our finger."""
    from decks.own_model.request import Request
    from fembridge.errors import UsageError
    from fembridge.own_model import build_own_folder, read_base_deck

    for name, default in vars(defaults).items():
        if name != "results" and getattr(args, name) != default:
            option = name.replace("_", "-")
            raise UsageError(f"--{option} is for our finger; --base-deck brings its own")
    names = [name for name, _ in args.afferent]
    if len(set(names)) < len(names):
        raise UsageError(f"--afferent names {max(names, key=names.count)} twice")
    length_mm, stress_unit = _UNITS[args.length_unit]
    request = Request(
        amplitude=args.amplitude,
        step=args.step,
        afferents=dict(args.afferent),
        length_mm=length_mm,
        results=args.results,
    )
    base = read_base_deck(args.base_deck, args.solver)
    rows = []
    remarks: tuple[str, ...] = ()
    for stimulus in stimuli_from(args):
        folder = Path(args.output) / stimulus.id
        built, remarks = build_own_folder(folder, base, stimulus, request, stress_unit)
        rows.append(told(args, stimulus.id, built))
    for remark in remarks:
        print(f"{base.path}: {remark}", file=sys.stderr)
    return {
        "base_deck": str(base.path),
        "solver": base.solver,
        "remarks": list(remarks),
        "folders": rows,
    }


def _afferent(word: str) -> tuple[str, int]:
    """Read ``SA=NODE``."""
    from fembridge.tables import AFFERENTS

    name, _, node = word.partition("=")
    if not name or not node.isdecimal():
        raise argparse.ArgumentTypeError(f"expected NAME=NODE, got {word!r}")
    if name not in AFFERENTS:  # `fembridge encode` would refuse its trace
        raise argparse.ArgumentTypeError(
            f"afferent {name!r}, expected one of {', '.join(AFFERENTS)}"
        )
    return name, int(node)
