"""Verify the finite-element model: studies against closed forms, with bounds.

Patch test, a second solver, Hertz contact, incompressibility, mesh, contact models,
contact stiffness, material laws, response map against transients. Written are a page
(verification.md) with figures, tables as CSV and verification.json. It takes ccx and
most of an hour; --quick makes all studies, smaller, in under five minutes on two
cores. Finished runs are kept: a verify that was stopped goes on where it was. Exits
with 1 when a check fails its bound.
"""

import argparse
from typing import Any

from fembridge.commands.options import NUMBERS, Several, add_output_option
from fembridge.terminal import SolverBars

EXAMPLE = "fembridge verify --quick -o verification"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
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
        help="studies at the same time, a core each (default: the cores there are)",
    )
    add_output_option(parser, default="verification")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Make the studies and the page; the summary holds each check."""
    import os

    from fembridge.report.verify import (
        PAGE_FILE,
        studies_named,
        verify,
        versions_here,
        write_report,
    )

    studies_named(args.only)  # a wrong word is said before a solver that is not there
    versions = versions_here()
    with SolverBars() as bars:

        def on_message(message: Any) -> None:  # noqa: ANN401 - a line, or a run's progress
            (bars.print if isinstance(message, str) else bars)(message)

        findings = verify(
            args.output,
            args.only,
            quick=args.quick,
            jobs=args.jobs or len(os.sched_getaffinity(0)),
            on_message=on_message,
        )
    summary = write_report(args.output, findings, versions, quick=args.quick)
    for study in summary["studies"]:
        passed = sum(check["passed"] for check in study["checks"])
        state = study["skipped"] or f"{passed} of {len(study['checks'])} checks"
        print(f"{study['name']:<16}{state}")
    for name, finding in findings.items():
        for one in (check for check in finding.checks if not check.passed):
            found = f"{one.found:.3g} {one.unit}".rstrip()
            print(f"fails: {name}: {one.what}: {found}, expected {one.side} {one.bound:g}")
    print(f"{PAGE_FILE}: {args.output}")
    return {"output": args.output, **summary, "exit_code": int(not summary["passed"])}
