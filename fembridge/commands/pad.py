"""Compute the pad of a finger or of your own mesh with CalculiX: what `fembridge touch` superposes.

A section of a finger is swept along it; unit forces on one slice of the skin, in four runs for
the mirror images about x = 0 and z = 0, give its Green's functions (two minutes and 0.3 GB at
0.25 mm; the cost grows with about the fifth power of 1 / spacing).

With --base-deck it is the pad of your own solid model: unit forces on all nodes of --skin, stress
at the --afferents. --runs DIR keeps what was solved, and the same command goes on there.

Of a deck for Abaqus or Marc the decks of the unit forces are written to --runs. Run them with your
solver, then `fembridge pad DIR --results FILE...` makes the pad.
"""

import argparse
from inspect import signature
from pathlib import Path
from typing import Any

from fembridge.commands.options import NODE, Number, Use, add_from, words_of
from fembridge.ranges import Range
from fembridge.solver.settings import Solver

EXAMPLE = "fembridge pad --base-deck mine.inp --skin SKIN --afferents EPIDERMIS:0.6 -o pad.npz"

_FINGER_OPTIONS = "--finger --spacing-mm --ridges --plane --jobs"
_MESH_OPTIONS = (
    "--skin --afferents --after-step --apex --outward --along --solver --length-unit --force-n "
    "--forces-per-deck --step-per-force"
)
_SOLVED_HERE = "--threads --time-limit --reach-mm --runs"

USES = (
    Use(
        _FINGER_OPTIONS,
        "a finger, not for --base-deck or a folder",
        lambda args: args.base_deck is None and args.folder is None,
    ),
    Use(_MESH_OPTIONS, "--base-deck", lambda args: args.base_deck is not None),
    Use(
        "--results", "a folder of decks, or --base-deck", lambda args: args.folder or args.base_deck
    ),
    Use(_SOLVED_HERE, "a finger or --base-deck", lambda args: args.folder is None),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    from fembridge.touching.make_pad import make_pad

    parser.add_argument(
        "folder",
        nargs="?",
        type=Path,
        metavar="DIR",
        help="folder of decks for Abaqus or Marc that were solved",
    )
    add_from(
        parser,
        make_pad,
        "finger",
        spacing_mm=(
            "MM",
            "distance of two nodes that may touch (default: 0.25, of a plane pad 0.0625)",
        ),
        reach_mm=(
            "MM",
            "distance from the apex up to which skin may be touched (default: 4.5; own model: all)",
        ),
        ridges="model the ridges and papillae of the finger, along its axis (default: smooth)",
        plane="the section alone, in plane strain: shapes are endless along the finger",
    )
    own = parser.add_argument_group("your own model")
    own.add_argument(
        "--base-deck",
        type=Path,
        metavar="FILE",
        help="deck of a solid model: a .inp of CalculiX or Abaqus, or a .dat of Marc",
    )
    own.add_argument(
        "--solver",
        dest="target",
        choices=("calculix", "abaqus"),
        help="solver of a .inp (default: as the deck shows)",
    )
    own.add_argument("--skin", metavar="SURF", help="surface or node set that may be touched")
    own.add_argument(
        "--afferents",
        action="append",
        metavar="[CLASS=]SET[:MM]",
        help="where stress is computed: SA=EPIDERMIS:0.6 is 0.6 mm below the skin in this element "
        "set, 0.6 in the material at that depth, NODES at the nodes of this set; repeatable "
        "(default: SA=0.5875, RA=0.52, PC=2)",
    )
    own.add_argument(
        "--after-step",
        type=Number.within(Range(0, 1000, is_whole=True)),
        default=0,
        metavar="N",
        help="linearise after this step of the deck, such as a preload (default: 0, undeformed)",
    )
    own.add_argument("--apex", type=NODE, metavar="NODE", help="node at the middle of the map")
    for option, meaning in (
        ("outward", "direction out of the skin at the middle (default: mean normal of the skin)"),
        ("along", "direction along the finger, to its tip (default: longest of the skin)"),
    ):
        own.add_argument(
            f"--{option}",
            type=Number.within(Range()),
            nargs=3,
            metavar=("X", "Y", "Z"),
            help=meaning,
        )
    add_from(
        own,
        make_pad,
        length_unit=(("mm", "m", "in"), "unit of length of the deck (default: heading, else mm)"),
    )
    elsewhere = parser.add_argument_group("unit forces that Abaqus or Marc solves")
    elsewhere.add_argument(
        "--results",
        type=Path,
        nargs="+",
        metavar="FILE",
        help="results of the decks in their order: .dat of Abaqus, .t16 or .t19 of Marc (default: "
        "in DIR)",
    )
    add_from(
        elsewhere,
        make_pad,
        force_n=("N", "force of each increment of Marc (default: 0.0001)"),
        forces_per_deck=("N", "most forces of a deck (default: results of 1 GB)"),
        step_per_force="a step for each force in Abaqus (default: load cases of one step)",
    )
    add_from(parser, Solver, "threads", "jobs", "time_limit_s")
    parser.add_argument(
        "--runs",
        type=Path,
        metavar="DIR",
        help="keep the solver's runs in DIR (default: they are removed at the end); of Abaqus and "
        "Marc the folder of the decks (default: pad)",
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("pad.npz"),
        metavar="FILE.npz",
        help="default: pad.npz",
    )


def _words(args: argparse.Namespace) -> dict[str, Any]:
    """Arguments of `make_pad`."""
    from fembridge.touching.make_pad import make_pad

    words = words_of(args, make_pad)
    if args.folder is not None:
        return {"base_deck": args.folder, "results": args.results}
    if args.base_deck is None:
        return words
    from fembridge.errors import UsageError
    from fembridge.touching.pad_request import SkinMap

    outward, along = (value and tuple(value) for value in (args.outward, args.along))
    words["skin_map"] = SkinMap(args.apex, outward, along)
    by_class: dict[str, str] = {}
    for text in args.afferents or ():
        name, equals, place = text.rpartition("=")
        if not equals and len(args.afferents) > 1:
            expected = "CLASS=SET:MM where there are several"
            raise UsageError(argument="afferents", found=text, expected=expected)
        by_class[name] = place
    words["afferents"] = by_class.get("", by_class) or None
    return words


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Make the pad, or the decks of its forces; the summary has its size."""
    from contextlib import ExitStack
    from dataclasses import replace

    from fembridge.errors import OutputError, SolverError, UsageError
    from fembridge.host.store import check_output, working_folder
    from fembridge.touching.make_pad import make_pad

    if args.folder is not None and args.base_deck is not None:
        raise UsageError("is for a folder or a deck, not for both", argument="base_deck")
    words = _words(args)
    if args.base_deck is not None and args.results is None and _is_solved_elsewhere(args):
        return _write_decks(args, words)
    output: Path = args.output
    if output.suffix != ".npz":
        raise UsageError(argument="output", found=str(output), expected="a name in .npz")
    check_output(output.parent, output.name)
    with ExitStack() as stack:
        folder = args.runs or stack.enter_context(working_folder(output.parent))
        solver = replace(Solver(**words_of(args, Solver)), runs_folder=folder)
        try:
            pad = make_pad(**words, solver=solver)
        except SolverError as error:
            if args.runs:
                raise
            problem = f"{error.problem}; --runs DIR keeps the files of the solver"
            raise SolverError(problem, Path(error.path.name)) from error
        except OutputError as error:
            if args.runs or not error.path.is_relative_to(folder):
                raise
            raise OutputError(error.problem, output) from error
    pad.write(output)
    size = output.stat().st_size
    print(f"{output}: {pad.skin_text}, {pad.origin['elements']} elements, {size / 1e6:.1f} MB")
    return {"pad": output, "bytes": size, **pad.origin}


def _is_solved_elsewhere(args: argparse.Namespace) -> bool:
    from fembridge.solver.build import read_base_deck

    return read_base_deck(args.base_deck, args.target).solver != "calculix"


def _write_decks(args: argparse.Namespace, words: dict[str, Any]) -> dict[str, Any]:
    """Write the decks of the forces; the summary has the size of their results."""
    from fembridge.errors import UsageError
    from fembridge.touching.force_runs import COMMANDS
    from fembridge.touching.make_pad import pad_decks

    if "--output" in args.explicit:
        raise UsageError("is for the pad; --runs is the folder of the decks", argument="output")
    output: Path = args.runs or Path("pad")
    taken = signature(pad_decks).parameters
    options = {name: value for name, value in words.items() if name in taken}
    forces = pad_decks(**options, output=output)
    expected_bytes = forces.expected_bytes
    print(
        f"{output}: {forces.count} forces on {forces.nodes.size} nodes, stress of "
        f"{forces.elements.size} elements"
    )
    for name, size in zip(forces.names, expected_bytes, strict=True):
        command = COMMANDS[forces.solver].format(name)
        print(f"{command}  results of about {size / 1e6:.0f} MB")
    print(f"run these in {output}, then: fembridge pad {output} -o pad.npz")
    if forces.solver == "abaqus" and args.target is None:
        print("the deck is one of Abaqus; --solver calculix solves it here")
    return {
        "decks": [output / f"{name}{forces.suffix}" for name in forces.names],
        "solver": forces.solver,
        "unit_forces": forces.count,
        "nodes": int(forces.nodes.size),
        "elements_with_stress": int(forces.elements.size),
        "expected_bytes": expected_bytes,
    }
