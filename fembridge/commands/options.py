"""Options that verbs share: stimuli, finger and probe, a deck of one's own, output."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from decks.probe import Probe


def add_stimulus_options(parser: argparse.ArgumentParser, preindent_default: str = "0") -> None:
    """Which stimuli; `preindent_default` is what holds without the option."""
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
        help="place of the probe across the finger (default: 0)",
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


def add_observed_option(parser: argparse.ArgumentParser) -> None:
    """What to fit to."""
    parser.add_argument(
        "--observed",
        required=True,
        metavar="RATES.csv",
        help="what to fit to: a table stimulus,afferent,rate_ips",
    )


def add_stored_finger_option(
    parser: argparse._ActionsContainer, default: str | None = "quick"
) -> None:
    """Whose stored response; None as the default tells whether it was asked for."""
    parser.add_argument(
        "--finger",
        choices=("quick", "paper"),
        default=default,
        help="whose stored response gives the stress (default: quick)",
    )


def checked_model(name: str) -> str:
    """`name` if it is a model of an afferent."""
    from fembridge.errors import UsageError
    from neural.models import MODELS

    if name not in MODELS:
        raise UsageError(
            f"model {name!r}, expected one of {', '.join(MODELS)}; "
            "`fembridge fit --drive list` describes each"
        )
    return name


def add_output_option(parser: argparse.ArgumentParser, default: str) -> None:
    """Where to."""
    parser.add_argument(
        "-o", "--output", type=_folder, default=default, metavar="DIR", help=f"default: {default}"
    )


def stimulus_words(args: argparse.Namespace) -> dict[str, Any]:
    """The stimuli that the options name, as arguments of `fembridge.api`."""
    names = ("stimulus", "preindent_um", "seed", "slide_mm_per_s")
    return {name: getattr(args, name) for name in names}


def model_words(args: argparse.Namespace) -> dict[str, Any]:
    """The finger and probe that the options describe, as arguments of `fembridge.api`."""
    names = ("finger", "element", "inertia", "whole_section")
    return {"probe": probe_from(args), **{name: getattr(args, name) for name in names}}


def probe_from(args: argparse.Namespace) -> "Probe":
    """The probe that the options describe."""
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
        choices=("mm", "m"),
        default="mm",
        help="of the deck (default: mm); with N its stress is in MPa, of m in Pa",
    )


def _folder(word: str) -> str:
    """Refuse an empty word, such as a variable that a script forgot to set."""
    if not word:
        raise argparse.ArgumentTypeError("expected the name of a folder, got ''")
    return word


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
