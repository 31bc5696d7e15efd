"""Write the deck of a round fingertip in three dimensions.

Layered skin, bone with its tuft and nail, in tetrahedra, for CalculiX or Abaqus: a model for
check, or for your own simulations. It has the surface SKIN and sets of nodes at the depth of the
afferents, such as AFFERENTS_SA. The finger is fingertip (human), fingertip_macaque, or a TOML
file with one of these as its base. Needs gmsh.
"""

import argparse
from pathlib import Path
from typing import Any

from fembridge.commands.options import add_from

EXAMPLE = "fembridge fingertip --finger fingertip_macaque -o tip.inp"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    from fembridge.solver.fingertip import write_fingertip

    add_from(
        parser,
        write_fingertip,
        finger=("NAME|FILE", "fingertip, fingertip_macaque or a TOML file"),
        plate_mm=(
            "MM",
            "press a flat plate so deep into the pad (default: no plate and no step)",
        ),
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("fingertip.inp"),
        metavar="FILE.inp",
        help="default: fingertip.inp",
    )


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Write the deck; the summary has the size and the quality of its mesh."""
    from dataclasses import asdict

    from fembridge.solver.fingertip import write_fingertip

    deck = write_fingertip(args.output, args.finger, plate_mm=args.plate_mm)
    print(
        f"{deck.path}: {deck.elements} {deck.element}, {deck.nodes} nodes, "
        f"{deck.skin_faces} faces of skin, worst scaled Jacobian {deck.worst_scaled_jacobian:.3f}"
    )
    return asdict(deck)
