"""Find the parameters of afferents whose rates come closest to observed ones.

NSGA-II searches the free parameters of a drive; each frequency is an objective.
Written are the Pareto front of each class, the parameters of the candidate that was
taken, with how they came about (fitted.toml, which --parameters takes), the rates
that they give, and a picture of the trade-offs. Ctrl-C keeps the best so far.
"""

import argparse
import sys
from typing import TYPE_CHECKING, Any

from fembridge.commands.fit_options import EVERY, add_fit_options

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from fembridge.fitting.fit import Fit, FitRun
    from fembridge.fitting.response_source import ResponseSource
    from fembridge.fitting.settings import FitSettings
    from fembridge.observed import ObservedRates
    from neural.drive_model import Drive

EXAMPLE = "fembridge fit --observed rates.csv --afferent RA --seed 1 -o fit"

PICTURE_FILE = "tradeoffs.png"
_INTERRUPTED = 130  # the exit code that Ctrl-C has with every verb
_PUBLISHED = "published"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    add_fit_options(parser)


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Fit and write; the summary holds choice, parameters and agreement a class."""
    from pathlib import Path

    from fembridge.commands.fit_summary import print_fit, summary_of
    from fembridge.fitting.fit import fit_afferents
    from fembridge.fitting.search_bar import SearchBar
    from fembridge.observed import read_observed

    notes: list[str] = []

    def tell(line: str) -> None:
        notes.append(line)
        print(line, file=sys.stderr)

    settings = settings_from(args)
    observed = read_observed(Path(args.observed), complete=not args.allow_missing)
    drives = drives_from(args, observed, tell)
    source = source_from(args)
    with SearchBar() as bar:

        def on_fit(fit: "Fit") -> None:
            bar.remove(fit.afferent)
            tell(line_of(fit))

        made = fit_afferents(
            observed, source.response, drives, settings, on_progress=bar, on_fit=on_fit
        )
    output = Path(args.output)
    files = _write(output, made, args, observed, source)
    if not args.json:
        for fit in made.fits:
            print_fit(fit)
        print(f"{', '.join(files)}: {output}")
    if not made.finished:
        classes = ", ".join(fit.afferent for fit in made.fits)
        tell(f"interrupted: the best so far of {classes} is kept, finished = false")
    return {
        "output": args.output,
        "finished": made.finished,
        "seed": settings.seed,
        "rule": settings.rule,
        "preindent_um": settings.preindent_um,
        "response": source.to_table(),
        "notes": notes,
        "files": files,
        "afferents": {fit.afferent: summary_of(fit) for fit in made.fits},
        "exit_code": 0 if made.finished else _INTERRUPTED,
    }


def settings_from(args: argparse.Namespace) -> "FitSettings":
    """Make the settings that the options describe."""
    from fembridge.fitting.settings import FitSettings
    from fembridge.observed import FAMILIES
    from neural.sets import held_um

    preindent_um = args.preindent_um
    if preindent_um is None:
        preindent_um = 0.0 if args.drive == _PUBLISHED else held_um()
    return FitSettings(
        families=FAMILIES if args.family == EVERY else (args.family,),
        preindent_um=preindent_um,
        cells=args.cells,
        evaluations=args.evaluations,
        population=args.population,
        seed=args.seed,
        rule=args.rule,
    )


def drives_from(
    args: argparse.Namespace, observed: "ObservedRates", tell: "Callable[[str], None]"
) -> "dict[str, Drive]":
    """Give the drive of each class to fit; tell of classes that are left out."""
    from fembridge.errors import ParameterError, UsageError
    from neural.drive_table import DEFAULT_DRIVES, DRIVES, drive_named

    if args.drive is not None and args.drive not in DRIVES:
        raise UsageError(
            f"drive {args.drive!r}, expected one of {', '.join(DRIVES)}; "
            "`fembridge fit --drive list` tells about each"
        )
    asked = tuple(dict.fromkeys(args.afferent or (EVERY,)))
    classes = observed.afferents if EVERY in asked else asked
    for name in classes:
        observed.of(name)  # or tells which classes there are
    if EVERY in asked:
        classes = _with_rates(classes, args.family, observed, tell)
    if args.drive is not None and EVERY in asked:
        lacking = [name for name in classes if name not in DRIVES[args.drive]]
        classes = tuple(name for name in classes if name not in lacking)
        if lacking:
            known = ", ".join(DRIVES[args.drive])
            tell(f"{', '.join(lacking)} left out: drive {args.drive!r} is of {known}")
    try:
        return {name: drive_named(args.drive or DEFAULT_DRIVES[name], name) for name in classes}
    except ParameterError as error:
        raise UsageError(str(error)) from error


def _with_rates(
    classes: "tuple[str, ...]",
    family: str,
    observed: "ObservedRates",
    tell: "Callable[[str], None]",
) -> "tuple[str, ...]":
    """Leave out classes without a rate of the family to fit, if others have one."""
    from fembridge.fitting.problem import observed_entries
    from fembridge.observed import FAMILIES

    families = FAMILIES if family == EVERY else (family,)
    there = [name for name in classes if observed_entries(observed, name, families)]
    lacking = [name for name in classes if name not in there]
    if there and lacking:
        tell(f"{', '.join(lacking)} left out: no observed rates of family {family}")
    return tuple(there) or classes


def source_from(args: argparse.Namespace) -> "ResponseSource":
    """Give the response that the options name."""
    from pathlib import Path

    from fembridge.fitting.response_source import solved_source, stored_source

    if args.response is not None:
        return solved_source(Path(args.response))
    return stored_source(args.finger or "quick")


def line_of(fit: "Fit") -> str:
    """Tell of one search in a line."""
    front, least = fit.front, fit.fitted.total.rmse_ips
    state = "" if front.finished else ", interrupted"
    return (
        f"{fit.afferent}, drive {fit.problem.drive.name}: {front.evaluations} "
        f"evaluations in {fit.seconds:.1f} s{state}, front of {len(front.values)}, "
        f"chosen RMSE {least:.3g} ips"
    )


def _write(
    output: "Path",
    made: "FitRun",
    args: argparse.Namespace,
    observed: "ObservedRates",
    source: "ResponseSource",
) -> list[str]:
    """Write all files, or none; fronts that an earlier fit left beside them go."""
    from fembridge.fitting.fit_files import (
        FRONT_FILES,
        PARAMETERS_FILE,
        RATES_FILE,
        front_file,
        write_fit,
    )
    from fembridge.fitting.provenance import fit_table
    from fembridge.plots.style import save_figure
    from fembridge.plots.tradeoffs import tradeoffs_figure
    from fembridge.store import filling

    name = "fit" if args.drive is None else f"fit_{args.drive}"
    table = fit_table(made, observed, source, _options(args))
    with filling(output, last=PARAMETERS_FILE) as draft:
        write_fit(draft, made, name, table)
        save_figure(tradeoffs_figure(made), draft / PICTURE_FILE)
    fronts = [front_file(fit.afferent) for fit in made.fits]
    for other in set(FRONT_FILES) - set(fronts):
        (output / other).unlink(missing_ok=True)
    return [PARAMETERS_FILE, *fronts, RATES_FILE, PICTURE_FILE]


def _options(args: argparse.Namespace) -> dict[str, object]:
    """Give what was asked for, but for places on this machine."""
    return {
        "afferent": args.afferent,
        "drive": args.drive,
        "cells": args.cells,
        "family": args.family,
        "preindent_um": args.preindent_um,
        "finger": args.finger,
        "own_response": args.response is not None,
        "allow_missing": args.allow_missing,
    }
