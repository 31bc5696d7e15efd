"""Write a run folder for each stimulus: a deck, its waveform, and run.toml.

The deck is text that a person can read: units in its heading, named sets,
comments. run.toml says which node is which afferent and what the deck was made
from; the same inputs give the same bytes. `fembridge run` or `ccx -i job` in the
folder solves it; decks for Marc and Abaqus are for those who have these solvers.

--base-deck keeps your own model: a .inp of CalculiX or Abaqus, or a .dat of Marc,
unchanged to the byte but for the waveform, the increments and the output.
"""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from decks.dialects import DIALECTS, PROBES, RESULTS, DeckOptions, dialect_named
from fembridge.commands.built_rows import told
from fembridge.commands.model_options import (
    add_finger_options,
    add_output_option,
    add_solving_options,
    add_stimulus_options,
    model_from,
    stimuli_from,
)
from fembridge.commands.own_model_options import add_own_model_options, build_own
from fembridge.errors import DeckError, UsageError

EXAMPLE = "fembridge build-deck --stimulus noise_25_250 -o runs"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    add_stimulus_options(parser)
    parser.add_argument("--solver", choices=tuple(DIALECTS), help="whose deck (default: calculix)")
    add_output_option(parser, default="runs")
    _add_deck_options(parser.add_argument_group("the deck of our finger"))
    add_own_model_options(parser.add_argument_group("your own model"))


def _add_deck_options(group: argparse._ActionsContainer) -> None:
    add_finger_options(group)
    add_solving_options(group)
    group.add_argument(
        "--element",
        metavar="NAME",
        help="of the finger: CPE4 and others by Abaqus's name, for Marc 80, 11, 27, "
        "54 or 118 (default: CPE4; Marc and Abaqus: CPE4H, which is 80)",
    )
    group.add_argument(
        "--contact",
        choices=("node-to-surface", "surface-to-surface"),
        help="formulation (default: node-to-surface; the other one remembers; not of "
        "Marc, whose procedure sets segment-to-segment)",
    )
    group.add_argument(
        "--stiffness-mpa-per-mm",
        type=float,
        metavar="K",
        help="of the contact's springs (default: 200; Marc has none)",
    )
    group.add_argument("--friction", type=float, default=0.4, metavar="MU", help="default: 0.4")
    group.add_argument(
        "--results",
        choices=RESULTS,
        help="what the solver writes (default: binary, float64; Marc: both .t16 and .t19)",
    )
    group.add_argument(
        "--ascii",
        action="store_const",
        const="text",
        dest="results",
        help="the same as --results text: six digits",
    )
    group.add_argument(
        "--probe-body",
        choices=PROBES,
        help="of Marc: a rigid curve that a table moves, or elements whose nodes are "
        "moved (default: rigid; the others: meshed)",
    )


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Write the folders; the summary lists them."""
    if args.base_deck is not None:
        ours = argparse.ArgumentParser()
        _add_deck_options(ours)
        return build_own(args, ours.parse_args([]))
    if args.amplitude or args.step or args.afferent:
        raise UsageError("--amplitude, --step and --afferent are for --base-deck")

    from decks.analysis import Contact
    from fembridge.build import build_run_folder

    solver = args.solver or "calculix"
    dialect = dialect_named(solver)
    asked = {
        "formulation": args.contact,
        "stiffness_mpa_per_mm": args.stiffness_mpa_per_mm,
        "friction": args.friction,
    }
    given = {name: value for name, value in asked.items() if value is not None}
    for name in given:
        if name not in dialect.contact:
            raise UsageError(f"contact: a deck for {solver} has no {name}")
    try:
        contact = Contact(**given)
    except DeckError as error:
        raise UsageError(f"contact: {error}") from error
    try:
        args.element = dialect.element_named(args.element or dialect.element)
    except DeckError as error:
        raise UsageError(str(error)) from error
    stimuli = stimuli_from(args)
    model = replace(model_from(args), contact=contact)
    options = DeckOptions(args.results, args.probe_body)
    rows = []
    for stimulus in stimuli:
        built = build_run_folder(
            Path(args.output) / stimulus.id, model, stimulus, solver=solver, options=options
        )
        rows.append(told(args, stimulus.id, built))
    if dialect.how_to_run and not args.json:
        print(f"each is run by its owner, in its folder: {dialect.how_to_run}")
    return {"finger": model.finger.name, "solver": solver, "folders": rows}
