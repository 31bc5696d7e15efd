"""Options of the verb ``fit``, and the table that ``--drive list`` prints."""

import argparse
import textwrap
from collections.abc import Sequence
from typing import Any

from fembridge.commands.options import add_output_option

LIST = "list"
EVERY = "all"


def add_fit_options(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    from neural.choice import RULES
    from neural.drive_table import DEFAULT_DRIVES
    from neural.search import EVALUATIONS, POPULATION
    from neural.sets import held_um

    defaults = ", ".join(f"{drive} {name}" for name, drive in DEFAULT_DRIVES.items())
    rules = "; ".join(f"{name}: {sentence}" for name, sentence in RULES.items())
    parser.add_argument(
        "--observed",
        required=True,
        metavar="RATES.csv",
        help="what to fit to: a table stimulus,afferent,rate_ips",
    )
    parser.add_argument(
        "--afferent",
        nargs="+",
        choices=("SA", "RA", "PC", EVERY),
        metavar="CLASS",
        help="SA, RA, PC or all (default: all that the table and the drive have)",
    )
    parser.add_argument(
        "--drive",
        action=_Drive,
        metavar="NAME",
        help=f"the model whose parameters are searched (default: {defaults}); "
        f"'--drive {LIST}' tells all, with equation and free parameters",
    )
    parser.add_argument(
        "--cells",
        type=int,
        metavar="N",
        help="cells that stand for a population (default: the drive's own number)",
    )
    parser.add_argument(
        "--family",
        choices=("sine", "diharm", "noise", EVERY),
        default="sine",
        help="stimuli to fit; the others of the table are judged, unseen (default: sine)",
    )
    parser.add_argument(
        "--evaluations",
        type=int,
        default=EVALUATIONS,
        metavar="N",
        help="candidates that are tried (default: %(default)d)",
    )
    parser.add_argument(
        "--population",
        type=int,
        default=POPULATION,
        metavar="N",
        help="candidates of a generation (default: %(default)d)",
    )
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="default: %(default)d")
    parser.add_argument(
        "--rule",
        choices=tuple(RULES),
        default=next(iter(RULES)),
        help=f"which candidate of the front is taken. {rules} (default: %(default)s)",
    )
    parser.add_argument(
        "--preindent-um",
        type=float,
        metavar="DEPTH",
        help="depth of the probe before time 0 (default: 0 for drive published, "
        f"else {held_um():g})",
    )
    stress = parser.add_mutually_exclusive_group()
    stress.add_argument(
        "--finger",
        choices=("quick", "paper"),
        help="whose stored response gives the stress (default: quick)",
    )
    stress.add_argument(
        "--response",
        metavar="DIR|FILE.toml",
        help="or a response of your own, as `fembridge simulate` keeps it",
    )
    parser.add_argument(
        "--allow-missing",
        action="store_true",
        help="take a table in which some stimuli have no rate of some class",
    )
    add_output_option(parser, default="fit")


def drives_text() -> str:
    """Give the table of drives: class, equation, free parameters, reason."""
    from neural.drive_table import DEFAULT_DRIVES, DRIVES

    lines = []
    for name, rows in DRIVES.items():
        for afferent, drive in rows.items():
            default = " (default)" if DEFAULT_DRIVES.get(afferent) == name else ""
            free = ", ".join(
                f"{one.field} {one.low:g} to {one.high:g}"
                + (f" {one.unit}" if one.unit != "1" else "")
                for one in drive.free()
            )
            lines.append(f"{name}, {afferent}{default}")
            for word, told in (
                ("equation", drive.equation),
                ("free", f"{len(drive.free())}: {free}"),
                ("cells", str(drive.cells)),
                ("reason", drive.reason),
            ):
                lines += textwrap.wrap(
                    told, width=88, initial_indent=f"  {word:<10}", subsequent_indent=" " * 12
                )
            lines.append("")
    return "\n".join(lines[:-1])


class _Drive(argparse.Action):
    """Take the name of a drive, or print the table of drives and end, as --help."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: str | Sequence[Any] | None,
        option_string: str | None = None,
    ) -> None:
        if values == LIST:
            print(drives_text())
            parser.exit()
        setattr(namespace, self.dest, values)
