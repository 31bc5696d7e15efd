"""Write a run folder for each stimulus: a deck, its waveform, and run.toml.

The deck is text that a person can read: units in its heading, named sets,
comments. run.toml says which node is which afferent and what the deck was made
from; the same inputs give the same bytes. `fembridge run` or `ccx -i job` in the
folder solves it; decks for Marc and Abaqus are for those who have these solvers.

--base-deck keeps your own model: a .inp of CalculiX or Abaqus, or a .dat of Marc,
unchanged to the byte but for the waveform, the increments and the output.
"""

import argparse
import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from decks.dialects import DIALECTS, INCREMENTS, PROBES, RESULTS, SHELL_FACES
from decks.unit_system import LENGTH_UNITS
from fembridge.commands.options import (
    NODE,
    NUMBERS,
    PROBE_USES,
    SOLVING,
    STIMULUS,
    WAVE_USES,
    WAVEFORM,
    Several,
    Use,
    add_from,
    add_output_option,
    add_probe_options,
    probe_from,
    words_of,
)
from fembridge.errors import UsageError

if TYPE_CHECKING:
    from fembridge.io.run_folder import RunFolder
    from fembridge.io.waveform import Waveform

EXAMPLE = "fembridge build-deck --stimulus noise_25_250 -o runs"

_OF_OUR_FINGER = (
    "--finger --probe-shape --probe-diameter-mm --probe-fillet-mm --probe-x-mm --whole-section "
    "--inertia --law --element --contact --stiffness-mpa-per-mm --friction --probe-body"
)
_OF_AN_OWN_MODEL = (
    "--afferent --afferents --amplitude --move --step --length-unit --increments --shell-face "
    "--no-own-output"
)

USES = (
    Use(_OF_OUR_FINGER, "our finger; --base-deck brings its own", lambda args: not args.base_deck),
    Use(_OF_AN_OWN_MODEL, "--base-deck", lambda args: args.base_deck),
    *PROBE_USES,
    *WAVE_USES,
    Use("--ascii", "decks without --results", lambda args: "--results" not in args.explicit),
    Use(
        "--whole-section",
        "--solver calculix; decks for the others always have both halves",
        lambda args: args.target in (None, "calculix"),
    ),
    Use(
        "--contact --stiffness-mpa-per-mm",
        "decks for CalculiX and Abaqus, not for Marc",
        lambda args: args.target != "marc",
    ),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    from fembridge.io.waveform import Waveform
    from fembridge.solver.analysis import Analysis
    from fembridge.solver.deck import build_deck, rebase_deck

    parameters = "neural parameters that encode uses for the run: fitted, published (Table 2 of "
    parameters += "the paper) or a TOML file; they give the default of --preindent-um"
    add_from(parser, build_deck, *STIMULUS)
    add_from(parser, Waveform, *WAVEFORM)
    add_from(parser, build_deck, parameters=("NAME", parameters))
    parser.add_argument(
        "--solver",
        dest="target",
        choices=tuple(DIALECTS),
        help="solver of the deck (default: calculix)",
    )
    add_output_option(parser, default="runs")
    finger_options = parser.add_argument_group("the deck of our finger")
    add_from(finger_options, build_deck, "finger")
    add_probe_options(finger_options)
    add_from(
        finger_options,
        Analysis,
        *SOLVING,
        element=(
            "NAME",
            "of the finger: CPE4 and others by Abaqus's name, for Marc 80, 11, 27, "
            "54 or 118 (default: CPE4; Marc and Abaqus: CPE4H, which is 80)",
        ),
    )
    finger_options.add_argument(
        "--contact",
        choices=("node-to-surface", "surface-to-surface"),
        help="formulation (default: node-to-surface; the other one is path-dependent; not "
        "for Marc, whose procedure sets segment-to-segment)",
    )
    finger_options.add_argument(
        "--stiffness-mpa-per-mm",
        type=NUMBERS["stiffness_mpa_per_mm"],
        metavar="K",
        help="stiffness of the contact's springs (default: 200; not for Marc)",
    )
    finger_options.add_argument(
        "--friction",
        type=NUMBERS["friction"],
        metavar="MU",
        help="default: 0.4",
    )
    add_from(
        finger_options,
        build_deck,
        results=(
            RESULTS,
            "format of the results (default: binary, float64; Marc: both .t16 and .t19)",
        ),
        frames=(
            "N",
            "also the whole field, all nodes, at every N-th sample, for ingest --vtu; 1: at "
            "each (your own deck: only 1; Marc writes all nodes anyway)",
        ),
        probe_body=(
            PROBES,
            "probe in Marc: a rigid curve that a table moves, or elements whose nodes are "
            "moved (default: rigid; other solvers: meshed)",
        ),
    )
    text = "the same as --results text: six digits"
    finger_options.add_argument(
        "--ascii", action="store_const", const="text", dest="results", help=text
    )
    model_options = parser.add_argument_group("your own model")
    formats = "a .inp of CalculiX or Abaqus, or a .dat of Marc; --preindent-um is 0 by default"
    model_options.add_argument("--base-deck", metavar="FILE", help=formats)
    add_own_deck_options(model_options, rebase_deck)
    add_from(
        model_options,
        rebase_deck,
        own_output="take the deck's own requests of results out (default: they stay)",
    )


def add_own_deck_options(parser: argparse._ActionsContainer, function: Callable[..., Any]) -> None:
    """Add the options of a base deck that are arguments of `function`, and its afferents."""
    parser.add_argument(
        "--afferent",
        type=_afferent,
        action=SeveralAfferents,
        default=[],
        metavar="SA=NODE|SA=SET",
        help="nodes of each class, or a node set (default: results at all nodes)",
    )
    parser.add_argument(
        "--afferents",
        metavar="FILE.csv|SET",
        help="table afferent,node[,unit], or node set with the class in its name",
    )
    add_from(
        parser,
        function,
        amplitude=(
            "NAME",
            "*AMPLITUDE or table of Marc that becomes the waveform (default: the only one)",
        ),
        move=(
            "NSET,DOF",
            "displacement that becomes the waveform: PROBE,2, or PROBE,-2 where the skin is on the "
            "negative side (default: the only one)",
        ),
        step=(
            "N|NAME",
            "step, or load case of Marc (default: the only one that uses it)",
        ),
        length_unit=(
            tuple(LENGTH_UNITS),
            "of the deck (default: as its heading says, else mm)",
        ),
        increments=(INCREMENTS, "one a sample, or automatic: smaller where the solver needs it"),
        newton_per_um=(
            "N",
            "waveform as force of *CLOAD or point load, N newtons an um",
        ),
        mpa_per_um=(
            "P",
            "waveform as pressure of *DLOAD, *DSLOAD or dist loads, P MPa an um",
        ),
        shell_face=(SHELL_FACES, "layer of a shell that is read"),
    )


def own_deck_options(args: argparse.Namespace) -> dict[str, Any]:
    """Values of the options of `add_own_deck_options`."""
    nodes: dict[str, Any] = {}
    for name, value in args.afferent:
        if isinstance(value, str):
            if name in nodes:
                raise UsageError(f"names {name} twice", argument="afferent")
            nodes[name] = value
        else:
            nodes.setdefault(name, [])
            if isinstance(nodes[name], str) or value in nodes[name]:
                raise UsageError(f"names {name} twice", argument="afferent")
            nodes[name].append(value)
    if nodes and args.afferents is not None:
        raise UsageError("cannot be combined with --afferents", argument="afferent")
    afferents = args.afferents if args.afferents is not None else nodes or None
    named = (
        *("amplitude", "move", "step", "length_unit", "increments", "shell_face"),
        *("newton_per_um", "mpa_per_um"),
    )
    return {"afferents": afferents, **{name: getattr(args, name) for name in named}}


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Write the folders; the summary lists them."""
    from fembridge.io.waveform import Waveform

    stimulus = Waveform(args.stimulus, **words_of(args, Waveform))
    runs = _build(args, stimulus) if args.base_deck is None else _rebase(args, stimulus)
    for item in runs:
        print(f"{item.folder}  {item.increments} increments of {item.dt_ms:g} ms")
    target = runs[0].solver
    how = DIALECTS[target].how_to_run
    if how and args.base_deck is None:
        print(f"run each with your own solver, in its folder: {how}")
    rows = [
        {
            "stimulus": item.folder.name,
            "folder": item.folder,
            "increments": item.increments,
            "deck_sha256": item.deck_sha256,
        }
        for item in runs
    ]
    if args.base_deck is not None:
        remarks = runs[-1].inputs["base_deck"]["changes"]
        return {
            "base_deck": args.base_deck,
            "remarks": remarks,
            "solver": target,
            "folders": rows,
        }
    return {"finger": runs[0].inputs["finger"]["name"], "solver": target, "folders": rows}


def _build(args: argparse.Namespace, stimulus: "Waveform") -> "list[RunFolder]":
    """Run folders of our finger."""
    from decks.contact_analysis import Contact
    from fembridge.solver.analysis import Analysis
    from fembridge.solver.deck import build_deck

    options = {
        "formulation": args.contact,
        "stiffness_mpa_per_mm": args.stiffness_mpa_per_mm,
        "friction": args.friction,
    }
    contact = {name: value for name, value in options.items() if value is not None}
    return build_deck(
        stimulus,
        args.output,
        target=args.target or "calculix",
        finger=args.finger,
        probe=probe_from(args),
        parameters=args.parameters,
        preindent_um=args.preindent_um,
        analysis=Analysis(**words_of(args, Analysis)),
        contact=Contact(**contact) if contact else None,
        results=args.results,
        frames=args.frames,
        probe_body=args.probe_body,
    )


def _rebase(args: argparse.Namespace, stimulus: "Waveform") -> "list[RunFolder]":
    """Run folders of the user's own deck."""
    from fembridge.solver.deck import rebase_deck

    if args.frames not in (0, 1):
        raise UsageError(argument="frames", found=args.frames, expected="1 for your own deck")
    return rebase_deck(
        args.base_deck,
        stimulus,
        args.output,
        target=args.target,
        results=args.results,
        all_nodes=args.frames == 1,
        own_output=args.own_output,
        **own_deck_options(args),
        parameters=args.parameters,
        preindent_um=args.preindent_um or 0.0,
    )


class SeveralAfferents(Several):
    """Afferents of several classes: ``SA=12,15,19,RA=20``; a node without a class follows one."""

    def items(self, text: str) -> list[Any]:
        """Class and node, or class and node set, of each item."""
        words, name = [], ""
        for part in filter(None, map(str.strip, text.split(","))):
            if "=" in part:
                name = part.partition("=")[0]
            words.append(part if "=" in part or not name else f"{name}={part}")
        items: list[Any] = []
        for word in words or [text]:
            items += super().items(word)
        return items


def _afferent(text: str) -> tuple[str, int | str]:
    """``SA=NODE`` or ``SA=SET`` as class and node or set."""
    from fembridge.trace import AFFERENTS

    name, equals, value = text.partition("=")
    if name not in AFFERENTS or not equals or not value:  # `encode` would refuse its trace
        expected = f"NAME=NODE or NAME=SET with one of {', '.join(AFFERENTS)}"
        raise UsageError(found=text, expected=expected)
    if re.fullmatch("[+-]?[0-9.]+", value):
        try:
            return name, int(NODE(value))
        except UsageError as error:
            raise UsageError(found=text, expected="NAME=NODE, a number from 1") from error
    return name, value
