"""Write a run folder for each stimulus: a deck, its waveform, and run.toml.

The deck is text that a person can read: units in its heading, named sets,
comments. run.toml says which node is which afferent and what the deck was made
from; the same inputs give the same bytes. `fembridge run` or `ccx -i job` in the
folder solves it; decks for Marc and Abaqus are for those who have these solvers.

--base-deck keeps your own model: a .inp of CalculiX or Abaqus, or a .dat of Marc,
unchanged to the byte but for the waveform, the increments and the output.
"""

import argparse
import sys
from collections.abc import Callable
from typing import Any

from decks.dialects import DIALECTS, INCREMENTS, PROBES, RESULTS
from decks.unit_system import LENGTH_UNITS
from fembridge.commands.options import (
    FINGER,
    SOLVING,
    STIMULUS,
    Several,
    add_options,
    add_output_option,
    option,
    probe_from,
    words_of,
)
from fembridge.errors import UsageError

EXAMPLE = "fembridge build-deck --stimulus noise_25_250 -o runs"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    add_options(parser, STIMULUS)
    whose = "neural parameters that encode takes of the run: fitted, published (Table 2 of the "
    whose += "paper) or a TOML file; the probe is as deep before time 0 as in their fit"
    add_options(parser, ("parameters",), default="fitted", help=f"{whose} (default: fitted)")
    parser.add_argument("--solver", choices=tuple(DIALECTS), help="whose deck (default: calculix)")
    add_output_option(parser, default="runs")
    _add_deck_options(parser.add_argument_group("the deck of our finger"))
    own = parser.add_argument_group("your own model")
    whose = "a .inp of CalculiX or Abaqus, or a .dat of Marc; pre-indented only by --preindent-um"
    own.add_argument("--base-deck", metavar="FILE", help=whose)
    _add_own_options(own)


def _add_own_options(group: argparse._ActionsContainer) -> None:
    add = group.add_argument
    add(
        "--amplitude",
        metavar="NAME",
        help="the *AMPLITUDE, or Marc's table, that becomes the waveform (default: the "
        "only one that moves something)",
    )
    add(
        "--move",
        metavar="NSET,DOF",
        help="the displacement that becomes the waveform, with an amplitude or without: "
        "PROBE,2, or PROBE,-2 where the skin is on the negative side (default: the only one)",
    )
    add(
        "--step",
        metavar="N|NAME",
        help="the step by number, or Marc's load case by name, that it runs in "
        "(default: the only one that uses it)",
    )
    add(
        "--afferent",
        type=_afferent,
        action=Several,
        default=[],
        metavar="SA=NODE",
        help="the nodes of afferents. Without one, results of "
        "all nodes are written and fembridge ingest asks which to read",
    )
    unit = "of the deck: with mm stress is in MPa, with m in Pa, with in in psi (default: as "
    add("--length-unit", choices=tuple(LENGTH_UNITS), help=f"{unit}the heading says, else mm)")
    add(
        "--increments",
        choices=INCREMENTS,
        default="fixed",
        help="one a sample, or automatic: the solver may make them smaller where it has to, "
        "and results come at the samples all the same (default: fixed)",
    )


def _add_deck_options(group: argparse._ActionsContainer) -> None:
    add_options(group, (*FINGER, *SOLVING))
    add = group.add_argument
    add(
        "--element",
        metavar="NAME",
        help="of the finger: CPE4 and others by Abaqus's name, for Marc 80, 11, 27, "
        "54 or 118 (default: CPE4; Marc and Abaqus: CPE4H, which is 80)",
    )
    add(
        "--contact",
        choices=("node-to-surface", "surface-to-surface"),
        help="formulation (default: node-to-surface; the other one is path-dependent; not "
        "of Marc, whose procedure sets segment-to-segment)",
    )
    springs = "of the contact's springs (default: 200; Marc has none)"
    add("--stiffness-mpa-per-mm", type=float, metavar="K", help=springs)
    add("--friction", type=float, default=0.4, metavar="MU", help="default: 0.4")
    results = "what the solver writes (default: binary, float64; Marc: both .t16 and .t19)"
    add("--results", choices=RESULTS, help=results)
    add(
        "--ascii",
        action="store_const",
        const="text",
        dest="results",
        help="the same as --results text: six digits",
    )
    add(
        "--frames",
        type=int,
        default=0,
        metavar="N",
        help="also the whole field, all nodes, at every N-th sample, for ingest --vtu; 1: at "
        "each (own deck: 1 alone; Marc writes all nodes anyway)",
    )
    add(
        "--probe-body",
        choices=PROBES,
        help="of Marc: a rigid curve that a table moves, or elements whose nodes are "
        "moved (default: rigid; the others: meshed)",
    )


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Write the folders; the summary lists them."""
    from fembridge.api import build_deck

    remarks: list[str] = []
    words = words_of(args, build_deck)
    if args.base_deck is None:
        if given := _given(args, _add_own_options):
            raise UsageError(f"{', '.join(given)}: for --base-deck alone")
        words["probe"] = probe_from(args)
    else:
        for each in _given(args, _add_deck_options):
            if each not in ("--results", "--frames"):
                raise UsageError(f"{each} is for our finger; --base-deck brings its own")
        names = [name for name, _ in args.afferent]
        if len(set(names)) < len(names):
            raise UsageError(f"--afferent names {max(names, key=names.count)} twice")
        words["afferents"] = dict(args.afferent)
    built = build_deck(**words, log=remarks.append)
    solver = built[0].solver
    if not args.json:
        for one in built:
            print(f"{one.folder}  {one.increments} increments of {one.dt_ms:g} ms")
        how = DIALECTS[solver].how_to_run
        if how and args.base_deck is None:
            print(f"run each with your own solver, in its folder: {how}")
    for remark in remarks:
        print(remark if args.base_deck is None else f"{args.base_deck}: {remark}", file=sys.stderr)
    rows = [
        {
            "stimulus": one.folder.name,
            "folder": str(one.folder),
            "increments": one.increments,
            "deck_sha256": one.deck_sha256,
        }
        for one in built
    ]
    if args.base_deck is not None:
        own = {"base_deck": args.base_deck, "remarks": remarks}
        return {**own, "solver": solver, "folders": rows}
    finger: Any = built[0].inputs["finger"]
    return {"finger": finger["name"], "solver": solver, "folders": rows}


def _given(
    args: argparse.Namespace, add_options_to: Callable[[argparse.ArgumentParser], None]
) -> list[str]:
    """Those of a group's options that are not as usual."""
    group = argparse.ArgumentParser()
    add_options_to(group)
    usual = vars(group.parse_args([]))
    return [option(name) for name in usual if getattr(args, name) != usual[name]]


def _afferent(word: str) -> tuple[str, int]:
    """``SA=NODE`` as class and node."""
    from fembridge.tables import AFFERENTS

    name, _, node = word.partition("=")
    if not name or not node.isdecimal():
        raise argparse.ArgumentTypeError(f"expected NAME=NODE, got {word!r}")
    if name not in AFFERENTS:  # `fembridge encode` would refuse its trace
        raise argparse.ArgumentTypeError(
            f"afferent {name!r}, expected one of {', '.join(AFFERENTS)}"
        )
    return name, int(node)
