"""Find the parameters of afferents whose rates come closest to observed ones.

NSGA-II searches the free parameters of a drive; each frequency is an objective.
Written are the Pareto front of each class, the parameters of the candidate that was
taken, with how they came about (fitted.toml, which --parameters takes), the rates
that they give, and a picture of the trade-offs. Ctrl-C keeps the best so far.
"""

import argparse
import math
import sys
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from fembridge.commands.options import add_output_option

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from fembridge.fitting.fit import Fit, FitRun, FitSettings
    from fembridge.fitting.problem import ResponseSource
    from fembridge.observed import ObservedRates
    from neural.agreement import Agreement
    from neural.models import Model

EXAMPLE = "fembridge fit --observed rates.csv --afferent RA --seed 1 -o fit"

LIST = "list"
EVERY = "all"
PICTURE_FILE = "tradeoffs.png"
_WIDTH = 22
_INTERRUPTED = 130  # the exit code that Ctrl-C has with every verb
_PUBLISHED = "published"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    from neural.models import DEFAULT_MODELS
    from neural.parameter_sets import fitted_preindent_um
    from neural.search import EVALUATIONS, POPULATION, RULES

    defaults = ", ".join(f"{drive} {name}" for name, drive in DEFAULT_MODELS.items())
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
        f"else {fitted_preindent_um():g})",
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


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Fit and write; the summary holds choice, parameters and agreement a class."""
    from pathlib import Path

    from fembridge.fitting.fit import SearchBar, fit_afferents
    from fembridge.observed import read_observed

    notes: list[str] = []

    def tell(line: str) -> None:
        notes.append(line)
        print(line, file=sys.stderr)

    settings = settings_from(args)
    observed = read_observed(Path(args.observed), complete=not args.allow_missing)
    models = models_from(args, observed, tell)
    source = source_from(args)
    with SearchBar() as bar:

        def on_fit(fit: "Fit") -> None:
            bar.remove(fit.afferent)
            tell(line_of(fit))

        made = fit_afferents(
            observed, source.response, models, settings, on_progress=bar, on_fit=on_fit
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
    from fembridge.fitting.fit import FitSettings
    from fembridge.observed import FAMILIES
    from neural.parameter_sets import fitted_preindent_um

    preindent_um = args.preindent_um
    if preindent_um is None:
        preindent_um = 0.0 if args.drive == _PUBLISHED else fitted_preindent_um()
    return FitSettings(
        families=FAMILIES if args.family == EVERY else (args.family,),
        preindent_um=preindent_um,
        cells=args.cells,
        evaluations=args.evaluations,
        population=args.population,
        seed=args.seed,
        rule=args.rule,
    )


def models_from(
    args: argparse.Namespace, observed: "ObservedRates", tell: "Callable[[str], None]"
) -> "dict[str, Model]":
    """Give the drive of each class to fit; tell of classes that are left out."""
    from fembridge.errors import ParameterError, UsageError
    from neural.models import DEFAULT_MODELS, MODELS, model_named

    if args.drive is not None and args.drive not in MODELS:
        raise UsageError(
            f"drive {args.drive!r}, expected one of {', '.join(MODELS)}; "
            "`fembridge fit --drive list` tells about each"
        )
    asked = tuple(dict.fromkeys(args.afferent or (EVERY,)))
    classes = observed.afferents if EVERY in asked else asked
    for name in classes:
        observed.of(name)  # or tells which classes there are
    if EVERY in asked:
        classes = _with_rates(classes, args.family, observed, tell)
    if args.drive is not None and EVERY in asked:
        lacking = [name for name in classes if name not in MODELS[args.drive]]
        classes = tuple(name for name in classes if name not in lacking)
        if lacking:
            known = ", ".join(MODELS[args.drive])
            tell(f"{', '.join(lacking)} left out: drive {args.drive!r} is of {known}")
    try:
        return {name: model_named(args.drive or DEFAULT_MODELS[name], name) for name in classes}
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

    from fembridge.fitting.problem import solved_source, stored_source

    if args.response is not None:
        return solved_source(Path(args.response))
    return stored_source(args.finger or "quick")


def line_of(fit: "Fit") -> str:
    """Tell of one search in a line."""
    front, least = fit.front, fit.fitted.total.rmse_ips
    state = "" if front.finished else ", interrupted"
    return (
        f"{fit.afferent}, drive {fit.problem.model.name}: {front.evaluations} "
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
    from fembridge.fitting.fit import (
        FRONT_FILES,
        PARAMETERS_FILE,
        RATES_FILE,
        fit_table,
        front_file,
        write_fit,
    )
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


def print_fit(fit: "Fit") -> None:
    """Print parameters, agreement and the reason of the choice."""
    from fembridge.fitting.fit import agreement_rows

    model, cells = fit.problem.model, fit.problem.cells
    print(
        f"{fit.afferent}, drive {model.name}: {len(fit.problem.free)} free parameters, "
        f"{cells} cell{'s' if cells > 1 else ''}"
    )
    for one in fit.problem.free:
        unit = "" if one.unit == "1" else f" {one.unit}"
        print(f"  {one.field} = {getattr(fit.parameters, one.field):.5g}{unit}")
    print(f"  {'':<{_WIDTH}}{'n':>4}{'R²':>8}{'RMSE':>9}{'bias':>9}   impulses/s")
    for judged, row in agreement_rows(fit):
        name = f"{row.family}, {row.group}" if row.group == EVERY else row.group
        if row.family == EVERY:
            name = "all families"
        _print_row(name if judged.seen else f"{name}, unseen", row.agreement)
    _print_row("Table 2, all", fit.published.total)
    print(f"  chosen: candidate {fit.choice.row + 1}, {fit.choice.why}")


def summary_of(fit: "Fit") -> dict[str, Any]:
    """Give the fit of a class for ``--json``."""
    from dataclasses import asdict

    from fembridge.fitting.fit import agreement_rows

    return {
        "drive": fit.problem.model.name,
        "finished": fit.front.finished,
        "evaluations": fit.front.evaluations,
        "seconds": fit.seconds,
        "front_size": len(fit.front.values),
        "candidate": fit.choice.row + 1,
        "why": fit.choice.why,
        "parameters": asdict(fit.parameters),
        "agreement": [
            {
                "family": row.family,
                "group": row.group,
                "seen": judged.seen,
                **row.agreement.to_row(),
            }
            for judged, row in agreement_rows(fit)
        ],
        "published": fit.published.total.to_row(),
    }


def _print_row(name: str, found: "Agreement") -> None:
    share = found.regression.r_squared
    told = "-" if math.isnan(share) else f"{share:.3f}"
    print(
        f"  {name:<{_WIDTH}}{found.regression.count:>4}{told:>8}"
        f"{found.rmse_ips:>9.2f}{found.bias_ips:>9.2f}"
    )


def models_text() -> str:
    """Give the table of drives: class, equation, free parameters, reason."""
    from neural.models import DEFAULT_MODELS, MODELS

    lines = []
    for name, rows in MODELS.items():
        for afferent, model in rows.items():
            default = " (default)" if DEFAULT_MODELS.get(afferent) == name else ""
            free = ", ".join(
                f"{one.field} {one.low:g} to {one.high:g}"
                + (f" {one.unit}" if one.unit != "1" else "")
                for one in model.free()
            )
            lines.append(f"{name}, {afferent}{default}")
            for word, told in (
                ("equation", model.equation),
                ("free", f"{len(model.free())}: {free}"),
                ("cells", str(model.cells)),
                ("reason", model.reason),
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
            print(models_text())
            parser.exit()
        setattr(namespace, self.dest, values)
