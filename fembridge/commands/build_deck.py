"""Write a run folder for each stimulus: a deck, its waveform, and run.toml.

The deck is text that a person can read: units in its heading, named sets,
comments. run.toml says which node is which afferent and what the deck was made
from; the same inputs give the same bytes. `fembridge run` or `ccx -i job` in the
folder solves it.
"""

import argparse
from dataclasses import replace
from typing import Any

from fembridge.commands.model_options import (
    add_model_options,
    add_output_option,
    add_stimulus_options,
    model_from,
    stimuli_from,
)

EXAMPLE = "fembridge build-deck --stimulus noise_25_250 -o runs"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    add_stimulus_options(parser)
    add_model_options(parser)
    add_output_option(parser, default="runs")
    parser.add_argument(
        "--solver", choices=("calculix",), default="calculix", help="whose deck"
    )
    parser.add_argument(
        "--contact",
        choices=("node-to-surface", "surface-to-surface"),
        default="node-to-surface",
        help="formulation (default: node-to-surface; the other one remembers)",
    )
    parser.add_argument(
        "--stiffness-mpa-per-mm",
        type=float,
        default=200.0,
        metavar="K",
        help="of the contact's springs (default: 200)",
    )
    parser.add_argument(
        "--friction", type=float, default=0.4, metavar="MU", help="default: 0.4"
    )
    parser.add_argument(
        "--ascii",
        action="store_true",
        help="ask for ASCII results (six digits) instead of binary float64",
    )


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Write the folders; the summary lists them."""
    from pathlib import Path

    from decks.analysis import Contact
    from fembridge.build import build_run_folder
    from fembridge.errors import DeckError, UsageError

    try:
        contact = Contact(
            args.contact,
            stiffness_mpa_per_mm=args.stiffness_mpa_per_mm,
            friction=args.friction,
        )
    except DeckError as error:
        raise UsageError(f"contact: {error}") from error
    stimuli = stimuli_from(args)
    model = replace(model_from(args), contact=contact)
    rows = []
    for stimulus in stimuli:
        folder = Path(args.output) / stimulus.id
        built = build_run_folder(folder, model, stimulus, binary=not args.ascii)
        rows.append(
            {
                "stimulus": stimulus.id,
                "folder": str(folder),
                "increments": built.increments,
                "deck_sha256": built.deck_sha256,
            }
        )
        if not args.json:
            print(f"{folder}  {built.increments} increments of {built.dt_ms:g} ms")
    return {"finger": model.finger.name, "folders": rows}
