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
from typing import Any

from decks.dialects import DIALECTS, INCREMENTS, PROBES, RESULTS
from decks.unit_system import LENGTH_UNITS
from fembridge.commands.options import (
    NODE,
    PROBE_USES,
    SOLVING,
    STIMULUS,
    WAVE_USES,
    Several,
    Use,
    add_from,
    add_output_option,
    add_probe_options,
    probe_from,
    words_of,
)
from fembridge.errors import UsageError
from fembridge.terminal import log

EXAMPLE = "fembridge build-deck --stimulus noise_25_250 -o runs"

_OF_OUR_FINGER = (
    "--finger --probe-shape --probe-diameter-mm --probe-fillet-mm --probe-x-mm --whole-section "
    "--inertia --law --element --contact --stiffness-mpa-per-mm --friction --probe-body"
)
_OF_AN_OWN_MODEL = "--afferent --amplitude --move --step --length-unit --increments"

USES = (
    Use(_OF_OUR_FINGER, "our finger; --base-deck brings its own", lambda args: not args.base_deck),
    Use(_OF_AN_OWN_MODEL, "--base-deck", lambda args: args.base_deck),
    *PROBE_USES,
    *WAVE_USES,
    Use("--ascii", "decks without --results", lambda args: "--results" not in args.explicit),
    Use(
        "--whole-section",
        "--solver calculix; decks for the others always have both halves",
        lambda args: args.solver in (None, "calculix"),
    ),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    from fembridge.api import build_deck

    whose = "neural parameters that encode takes of the run: fitted, published (Table 2 of the "
    whose += "paper) or a TOML file; the probe is as deep before time 0 as in their fit"
    add_from(parser, build_deck, *STIMULUS)
    add_from(parser, build_deck, parameters=("NAME", whose))
    parser.add_argument("--solver", choices=tuple(DIALECTS), help="whose deck (default: calculix)")
    add_output_option(parser, default="runs")
    ours = parser.add_argument_group("the deck of our finger")
    add_from(ours, build_deck, "finger")
    add_probe_options(ours)
    add_from(
        ours,
        build_deck,
        *SOLVING,
        element=(
            "NAME",
            "of the finger: CPE4 and others by Abaqus's name, for Marc 80, 11, 27, "
            "54 or 118 (default: CPE4; Marc and Abaqus: CPE4H, which is 80)",
        ),
        contact=(
            ("node-to-surface", "surface-to-surface"),
            "formulation (default: node-to-surface; the other one is path-dependent; not "
            "of Marc, whose procedure sets segment-to-segment)",
        ),
        stiffness_mpa_per_mm=("K", "of the contact's springs (default: 200; Marc has none)"),
        friction=("MU", "default: 0.4"),
        results=(
            RESULTS,
            "what the solver writes (default: binary, float64; Marc: both .t16 and .t19)",
        ),
        frames=(
            "N",
            "also the whole field, all nodes, at every N-th sample, for ingest --vtu; 1: at "
            "each (own deck: 1 alone; Marc writes all nodes anyway)",
        ),
        probe_body=(
            PROBES,
            "of Marc: a rigid curve that a table moves, or elements whose nodes are "
            "moved (default: rigid; the others: meshed)",
        ),
    )
    six = "the same as --results text: six digits"
    ours.add_argument("--ascii", action="store_const", const="text", dest="results", help=six)
    own = parser.add_argument_group("your own model")
    whose = "a .inp of CalculiX or Abaqus, or a .dat of Marc; pre-indented only by --preindent-um"
    own.add_argument("--base-deck", metavar="FILE", help=whose)
    own.add_argument(
        "--afferent",
        type=_afferent,
        action=Several,
        default=[],
        metavar="SA=NODE",
        help="the nodes of afferents. Without one, results of "
        "all nodes are written and fembridge ingest asks which to read",
    )
    add_from(
        own,
        build_deck,
        amplitude=(
            "NAME",
            "the *AMPLITUDE, or Marc's table, that becomes the waveform (default: the "
            "only one that moves something)",
        ),
        move=(
            "NSET,DOF",
            "the displacement that becomes the waveform, with an amplitude or without: "
            "PROBE,2, or PROBE,-2 where the skin is on the negative side (default: the only one)",
        ),
        step=(
            "N|NAME",
            "the step by number, or Marc's load case by name, that it runs in "
            "(default: the only one that uses it)",
        ),
        length_unit=(
            tuple(LENGTH_UNITS),
            "of the deck: with mm stress is in MPa, with m in Pa, with in in psi (default: as the "
            "heading says, else mm)",
        ),
        increments=(
            INCREMENTS,
            "one a sample, or automatic: the solver may make them smaller where it has to, "
            "and results come at the samples all the same",
        ),
    )


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Write the folders; the summary lists them."""
    from fembridge.api import build_deck

    remarks: list[str] = []  # said at the end
    words = words_of(args, build_deck)
    if args.base_deck is None:
        words["probe"] = probe_from(args)
    else:
        names = [name for name, _ in args.afferent]
        if len(set(names)) < len(names):
            raise UsageError(f"--afferent names {max(names, key=names.count)} twice")
        words["afferents"] = dict(args.afferent)
    built = build_deck(**words, log=remarks.append)
    solver = built[0].solver
    for one in built:
        print(f"{one.folder}  {one.increments} increments of {one.dt_ms:g} ms")
    how = DIALECTS[solver].how_to_run
    if how and args.base_deck is None:
        print(f"run each with your own solver, in its folder: {how}")
    for remark in remarks:
        log(remark if args.base_deck is None else f"{args.base_deck}: {remark}")
    rows = [
        {
            "stimulus": one.folder.name,
            "folder": one.folder,
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


def _afferent(word: str) -> tuple[str, int]:
    """``SA=NODE`` as class and node."""
    from fembridge.tables import AFFERENTS

    name, equals, node = word.partition("=")
    if not name or not equals or not re.fullmatch("[0-9]+", node):
        raise argparse.ArgumentTypeError(f"expected NAME=NODE, got {word!r}")
    if name not in AFFERENTS:  # `fembridge encode` would refuse its trace
        raise argparse.ArgumentTypeError(
            f"afferent {name!r}, expected one of {', '.join(AFFERENTS)}"
        )
    return name, int(NODE(node))
