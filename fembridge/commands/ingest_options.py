"""What ``fembridge ingest`` understands: its words, and which go together."""

import argparse
from pathlib import Path

LAST = "last"  # increment
KINDS = ("list", "vtu", "field")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    parser.add_argument(
        "result",
        type=Path,
        metavar="RESULT",
        help="a .frd, .dat, .sta or .cvg of CalculiX; a .t16, .t19 or .sts of Marc; "
        "a plot that Mentat saved, .txt; or a run folder",
    )
    parser.add_argument(
        "--list", action="store_true", help="show what the file holds, write nothing"
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FILE",
        help="table to write (default: RESULT's name and what it is, here); "
        "for --field .npz or .csv",
    )
    parser.add_argument(
        "--stress-unit",
        choices=("MPa", "kPa", "Pa"),
        help="unit of the file's stress (default: MPa, which is N and mm)",
    )
    parser.add_argument(
        "--partial",
        action="store_true",
        help="take what is whole of a run that did not end normally",
    )
    _add_nodes(parser.add_argument_group("traces at nodes of a .frd, .t16 or .t19"))
    _add_points(parser.add_argument_group("from integration points of a .t16 or .t19"))
    _add_fields(parser.add_argument_group("whole fields of a .frd, .t16 or .t19"))
    _add_prints(parser.add_argument_group("prints in a .dat"))


def place(text: str) -> tuple[float, ...]:
    """Read ``X,Y`` or ``X,Y,Z``."""
    values = tuple(float(word) for word in text.split(","))
    if len(values) not in (2, 3):
        raise ValueError(text)
    return values


def point(text: str) -> tuple[int, int]:
    """Read ``ELEMENT:POINT``."""
    element, _, number = text.partition(":")
    return int(element), int(number)


def _add_nodes(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--node", type=int, nargs="+", action="extend", metavar="N", help="nodes by number"
    )
    group.add_argument(
        "--set",
        nargs="+",
        action="extend",
        metavar="NAME",
        dest="sets",
        help="nodes of a set: of the file, or of its deck",
    )
    group.add_argument(
        "--near",
        type=place,
        nargs="+",
        action="extend",
        metavar="X,Y[,Z]",
        help="the node with results nearest to a place in mm of the undeformed mesh; "
        "before a negative X write --near=-X,Y",
    )
    group.add_argument(
        "--deck",
        type=Path,
        metavar="DECK",
        help="where --set looks (default: the sets in a .t16 or .t19; of a .frd the "
        "deck of the same name in .inp)",
    )
    group.add_argument(
        "--afferents",
        action="store_true",
        help="the nodes of run.toml's afferents (the default where there is one)",
    )
    group.add_argument(
        "--across-materials",
        action="store_true",
        help="allow nodes between two materials, where stress is a mean over both",
    )
    group.add_argument(
        "--one-sided",
        nargs="?",
        const="",
        metavar="ELSET",
        help="of such --node, the stress in each material for itself; of a .frd from "
        "the points that the .dat beside it prints of this element set",
    )


def _add_points(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--extrapolate",
        choices=("linear", "translate", "average"),
        help="how values get to the nodes: by the polynomial through the points "
        "(the default), from the nearest point, or as the element's mean",
    )
    group.add_argument(
        "--von-mises",
        choices=("tensor", "scalar"),
        help="von Mises stress of the nodal tensor (the default), or of the points, "
        "carried to the nodes as a number, as Mentat plots it",
    )


def _add_fields(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--field", metavar="QUANTITY", help="all nodes at one increment: STRESS, DISP"
    )
    group.add_argument(
        "--increment",
        default=LAST,
        metavar="[STEP:]N",
        help="which increment, or mode, --field takes (default: last)",
    )
    group.add_argument(
        "--vtu", type=Path, metavar="FOLDER", help="every increment as VTU, and a PVD, for ParaView"
    )
    group.add_argument(
        "--derived",
        nargs="+",
        action="extend",
        metavar="NAME",
        help="what --vtu computes beside them: von_mises (the default), principal, "
        "max_shear, mean_stress, strain_energy_density",
    )
    group.add_argument(
        "--quantity",
        nargs="+",
        action="extend",
        metavar="NAME",
        help="only these: of a .frd for --vtu, of a .dat one for its table",
    )


def _add_prints(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--point",
        type=point,
        nargs="+",
        action="extend",
        metavar="ELEMENT:POINT",
        help="stress traces at integration points, which no averaging has touched; "
        "in the table their node is ELEMENT times 100 plus POINT",
    )
    group.add_argument("--print-set", metavar="NAME", help="of which set, if several are printed")


def kind_of(args: argparse.Namespace, path: Path, printed: bool) -> str:
    """Say what is asked for: list, vtu, field, table, plot, points, sides or traces.

    Raises
    ------
    UsageError
        Words that do not go together, or not with this kind of file.
    """
    from fembridge.errors import UsageError

    by_node = [
        word
        for word, given in (
            ("--node", args.node),
            ("--set", args.sets),
            ("--near", args.near),
            ("--afferents", args.afferents),
        )
        if given
    ]
    asked = [f"--{kind}" for kind in KINDS if getattr(args, kind)]
    asked += ["--point"] if args.point else []
    if args.afferents and len(by_node) > 1:
        asked += by_node
    elif by_node:
        asked.append(by_node[0])
    if len(asked) > 1:
        raise UsageError(f"{asked[0]} and {asked[1]} do not go together")
    word = asked[0] if asked else ""
    of_a_print = word in ("", "--list", "--point")
    if printed and not of_a_print:
        raise UsageError(f"{path}: {word} is for a .frd, .t16 or .t19")
    if args.point and path.suffix.lower() != ".dat":
        raise UsageError(f"{path}: --point is for a .dat")
    if args.increment != LAST and word != "--field":
        raise UsageError("--increment is for --field")
    if args.derived and word != "--vtu":
        raise UsageError("--derived is for --vtu")
    if args.one_sided is not None:
        if printed or by_node != ["--node"]:
            raise UsageError("--one-sided is for the --node of a .frd, .t16 or .t19")
        if args.von_mises:
            raise UsageError("--one-sided and --von-mises do not go together")
        return "sides"
    if word in ("--list", "--vtu", "--field"):
        if args.von_mises:
            raise UsageError(f"{word} and --von-mises do not go together")
        return word.removeprefix("--")
    if printed:
        return "points" if args.point else "table"
    return "plot" if not word and _is_no_history(path) else "traces"


def _is_no_history(path: Path) -> bool:
    """Whether it is a plot saved from Mentat, and not one over time."""
    if path.suffix.lower() != ".txt":
        return False
    from fembridge.results.mentat import is_over_time

    return not is_over_time(path)
