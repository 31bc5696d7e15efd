"""Verify the finite-element model: studies against closed forms, with bounds.

Patch test, a second solver, Hertz contact, incompressibility, mesh, contact models,
contact stiffness, material laws, response map against transients. Files: a page
(verification.md) with figures, tables as CSV and verification.json. Requires ccx and
most of an hour; --quick runs smaller studies in under five minutes on two cores. Without
gmsh the studies that mesh fingers are skipped.
Finished runs are kept: a stopped verification resumes. The exit code is 1 when a check
fails its bound.
"""

import argparse
from typing import Any

from fembridge.commands.options import NUMBERS, Several, add_output_option
from fembridge.host.terminal import SolverBars

EXAMPLE = "fembridge verify --quick -o verification"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    parser.add_argument(
        "--quick", action="store_true", help="all studies, with fewer and shorter runs"
    )
    parser.add_argument(
        "--only",
        action=Several,
        metavar="NAME",
        help="patch, solver, hertz, incompressible, mesh, contact, penalty, laws, map "
        "(default: all)",
    )
    parser.add_argument(
        "--jobs",
        type=NUMBERS["jobs"],
        metavar="N",
        help="studies at the same time, a core each (default: the number of cores)",
    )
    add_output_option(parser, default="verification")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Run the studies and write the page; the summary holds each check."""
    from fembridge.reporting.verify import PAGE_FILE, verify

    with SolverBars() as bars:

        def on_message(message: Any) -> None:  # noqa: ANN401 - a line, or a run's progress
            (bars.print if isinstance(message, str) else bars)(message)

        result = verify(
            args.output, only=args.only, quick=args.quick, jobs=args.jobs, on_message=on_message
        )
    for study in result.summary["studies"]:
        passed = sum(check["passed"] for check in study["checks"])
        state = f"{passed} of {len(study['checks'])} checks"
        state = f"skipped: {study['skipped']}" if study["skipped"] else state
        print(f"{study['name']:<16}{state}")
    checks = result.checks
    for check in checks[~checks["passed"].astype(bool)].to_dict("records"):
        value = f"{check['found']:.3g} {check['unit']}".rstrip()
        expected = f"{check['side']} {check['bound']:g}"
        print(f"fails: {check['study']}: {check['what']}: {value}, expected {expected}")
    print(f"{PAGE_FILE}: {args.output}")
    return {"output": args.output, **result.summary, "exit_code": int(not result.passed)}
