"""Options that verbs with a finger, a probe and stimuli share."""

import argparse
from dataclasses import replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from decks.probe import Probe
    from fembridge.build import Model
    from fembridge.stimulus import Stimulus


def add_stimulus_options(parser: argparse.ArgumentParser, preindent_default: str = "0") -> None:
    """Which stimuli; `preindent_default` tells what holds without the option."""
    parser.add_argument(
        "--stimulus",
        action="append",
        required=True,
        metavar="ID",
        help="sine_20_250, a set as noise_25_250 or all; commas or repetition join",
    )
    parser.add_argument(
        "--preindent-um",
        type=float,
        metavar="DEPTH",
        help=f"depth of the probe before time 0 (default: {preindent_default})",
    )
    parser.add_argument("--seed", type=int, help="draw other noise than the catalogue's (>= 0)")
    parser.add_argument(
        "--slide-mm-per-s",
        type=float,
        metavar="V",
        help="the probe also slides along x from time 0 on (default: it does not)",
    )


def add_model_options(parser: argparse.ArgumentParser) -> None:
    """Which finger, of which elements, and which probe."""
    add_finger_options(parser)
    add_solving_options(parser)
    parser.add_argument(
        "--element",
        choices=("CPE4", "CPE4R", "CPE8R"),
        default="CPE4",
        help="element of the finger (default: CPE4)",
    )


def add_finger_options(parser: argparse._ActionsContainer) -> None:
    """Which finger and which probe."""
    parser.add_argument(
        "--finger",
        default="quick",
        metavar="NAME|FILE.toml",
        help="quick (3 100 elements), paper (17 702) or a file (default: quick)",
    )
    parser.add_argument(
        "--probe-shape", choices=("cylinder", "flat"), default="cylinder", help="default: cylinder"
    )
    parser.add_argument(
        "--probe-diameter-mm", type=float, default=1.0, metavar="D", help="default: 1"
    )
    parser.add_argument(
        "--probe-fillet-mm",
        type=float,
        metavar="R",
        help="of a flat probe's edges (default: 0.1, at most a quarter of its width)",
    )
    parser.add_argument(
        "--probe-x-mm",
        type=float,
        default=0.0,
        metavar="X",
        help="where the probe stands across the finger (default: 0)",
    )


def add_solving_options(parser: argparse._ActionsContainer) -> None:
    """Whether mass counts; whether all of the section is solved."""
    parser.add_argument(
        "--whole-section",
        action="store_true",
        help="solve both halves of a section whose halves are mirror images (default: "
        "the right one, for waveforms in CalculiX)",
    )
    parser.add_argument(
        "--inertia",
        action="store_true",
        help="the skin's mass counts while the probe follows its waveform",
    )


def add_output_option(parser: argparse.ArgumentParser, default: str) -> None:
    """Where to."""
    parser.add_argument(
        "-o", "--output", type=_folder, default=default, metavar="DIR", help=f"default: {default}"
    )


def model_from(args: argparse.Namespace) -> "Model":
    """Make the model that the options describe."""
    from decks.finger_file import read_finger
    from fembridge.build import model_of

    model = model_of(
        read_finger(args.finger), probe=probe_from(args), element=args.element, inertia=args.inertia
    )
    return replace(model, section="whole") if args.whole_section else model


def probe_from(args: argparse.Namespace) -> "Probe":
    """Make the probe that the options describe."""
    from decks.probe import Probe
    from fembridge.errors import FingerError, UsageError

    fillet_mm = args.probe_fillet_mm
    if fillet_mm is None:
        fillet_mm = min(Probe().fillet_mm, 0.25 * abs(args.probe_diameter_mm))
    elif args.probe_shape != "flat":
        raise UsageError("--probe-fillet-mm is for --probe-shape flat")
    if args.probe_shape == "cylinder":
        fillet_mm = Probe().fillet_mm  # of no meaning; one value, one stored response
    try:
        return Probe(
            shape=args.probe_shape,
            diameter_mm=args.probe_diameter_mm,
            fillet_mm=fillet_mm,
            x_mm=args.probe_x_mm,
        )
    except FingerError as error:
        raise UsageError(f"probe: {error}") from error


def stimuli_from(args: argparse.Namespace, preindent_um: float = 0.0) -> "list[Stimulus]":
    """Make the stimuli that the options name, each once.

    `preindent_um` is taken where no option tells another.
    """
    from decks.stimuli import resolve
    from decks.waveform import make_stimulus
    from fembridge.errors import UsageError

    if args.seed is not None and args.seed < 0:
        raise UsageError(f"seed is {args.seed}, expected 0 or more")
    asked_um = args.preindent_um
    depth_um = preindent_um if asked_um is None else asked_um
    stimuli = [
        make_stimulus(entry, preindent_um=depth_um, seed=args.seed)
        for entry in resolve(args.stimulus)
    ]
    if args.slide_mm_per_s is None:
        return stimuli
    return [stimulus.sliding(args.slide_mm_per_s) for stimulus in stimuli]


def _folder(word: str) -> str:
    """Refuse an empty word, such as a variable that a script forgot to set."""
    if not word:
        raise argparse.ArgumentTypeError("expected the name of a folder, got ''")
    return word
