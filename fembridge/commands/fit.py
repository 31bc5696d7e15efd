"""Find the parameters of afferents whose rates come closest to observed ones.

NSGA-II searches the free parameters of a model; each frequency is an objective.
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

from fembridge.commands.options import (
    add_observed_option,
    add_output_option,
    add_stored_finger_option,
    checked_model,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from fembridge.fitting.fit import Fit
    from fembridge.observed import ObservedRates
    from neural.agreement import Agreement
    from neural.models import Model

EXAMPLE = "fembridge fit --observed rates.csv --afferent RA --seed 1 -o fit"

LIST = "list"
EVERY = "all"
PICTURE_FILE = "tradeoffs.png"
_WIDTH = 22
_RECORDED = ("afferent", "drive", "cells", "family", "preindent_um", "finger")
_INTERRUPTED = 130  # the exit code that Ctrl-C has with every verb


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    from neural.models import DEFAULT_MODELS
    from neural.parameter_sets import fitted_preindent_um
    from neural.search import EVALUATIONS, POPULATION, RULES

    defaults = ", ".join(f"{model} {name}" for name, model in DEFAULT_MODELS.items())
    rules = "; ".join(f"{name}: {sentence}" for name, sentence in RULES.items())
    add_observed_option(parser)
    parser.add_argument(
        "--afferent",
        nargs="+",
        choices=("SA", "RA", "PC", EVERY),
        metavar="CLASS",
        help="SA, RA, PC or all (default: all that the table and the model have)",
    )
    parser.add_argument(
        "--drive",
        action=_Model,
        metavar="NAME",
        help=f"the model whose parameters are searched (default: {defaults}); "
        f"'--drive {LIST}' lists all, with equation and free parameters",
    )
    parser.add_argument(
        "--cells",
        type=int,
        metavar="N",
        help="cells of the population (default: the model's own number)",
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
        help="depth of the probe before time 0 (default: 0 for published, "
        f"else {fitted_preindent_um():g})",
    )
    stress = parser.add_mutually_exclusive_group()
    add_stored_finger_option(stress, default=None)
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

    from fembridge.fitting.fit import (
        FRONT_FILES,
        PARAMETERS_FILE,
        RATES_FILE,
        FitSettings,
        SearchBar,
        fit_afferents,
        fit_table,
        front_file,
        write_fit,
    )
    from fembridge.fitting.problem import solved_source, stored_source
    from fembridge.observed import FAMILIES, read_observed
    from fembridge.plots.style import save_figure
    from fembridge.plots.tradeoffs import tradeoffs_figure
    from fembridge.store import filling
    from neural.parameter_sets import fitted_preindent_um

    notes: list[str] = []

    def log(line: str) -> None:
        notes.append(line)
        print(line, file=sys.stderr)

    preindent_um = args.preindent_um
    if preindent_um is None:
        preindent_um = 0.0 if args.drive == "published" else fitted_preindent_um()
    settings = FitSettings(
        families=FAMILIES if args.family == EVERY else (args.family,),
        preindent_um=preindent_um,
        cells=args.cells,
        evaluations=args.evaluations,
        population=args.population,
        seed=args.seed,
        rule=args.rule,
    )
    observed = read_observed(Path(args.observed), complete=not args.allow_missing)
    models = _models_from(args, observed, settings.families, log)
    if args.response is not None:
        source = solved_source(Path(args.response))
    else:
        source = stored_source(args.finger or "quick")
    with SearchBar() as bar:

        def on_fit(fit: "Fit") -> None:
            bar.remove(fit.afferent)
            state = "" if fit.front.finished else ", interrupted"
            log(
                f"{fit.afferent}, model {fit.problem.model.name}: {fit.front.evaluations} "
                f"evaluations in {fit.seconds:.1f} s{state}, front of "
                f"{len(fit.front.values)}, chosen RMSE {fit.fitted.total.rmse_ips:.3g} ips"
            )

        made = fit_afferents(
            observed, source.response, models, settings, on_progress=bar, on_fit=on_fit
        )
    options = {name: getattr(args, name) for name in _RECORDED}
    options |= {"own_response": args.response is not None, "allow_missing": args.allow_missing}
    output = Path(args.output)
    with filling(output, last=PARAMETERS_FILE) as draft:
        name = "fit" if args.drive is None else f"fit_{args.drive}"
        write_fit(draft, made, name, fit_table(made, observed, source, options))
        save_figure(tradeoffs_figure(made), draft / PICTURE_FILE)
    fronts = [front_file(fit.afferent) for fit in made.fits]
    for other in set(FRONT_FILES) - set(fronts):  # of an earlier fit
        (output / other).unlink(missing_ok=True)
    files = [PARAMETERS_FILE, *fronts, RATES_FILE, PICTURE_FILE]
    if not args.json:
        for fit in made.fits:
            _print_fit(fit)
        print(f"{', '.join(files)}: {output}")
    if not made.finished:
        classes = ", ".join(fit.afferent for fit in made.fits)
        log(f"interrupted: the best so far of {classes} is kept, finished = false")
    return {
        "output": args.output,
        "finished": made.finished,
        "seed": settings.seed,
        "rule": settings.rule,
        "preindent_um": settings.preindent_um,
        "response": source.to_table(),
        "notes": notes,
        "files": files,
        "afferents": {fit.afferent: _summary_of(fit) for fit in made.fits},
        "exit_code": 0 if made.finished else _INTERRUPTED,
    }


def _models_from(
    args: argparse.Namespace,
    observed: "ObservedRates",
    families: tuple[str, ...],
    log: "Callable[[str], None]",
) -> "dict[str, Model]":
    """Model of each class to fit; where all are asked for, classes that lack one go."""
    from fembridge.errors import ParameterError, UsageError
    from fembridge.fitting.problem import observed_entries
    from neural.models import DEFAULT_MODELS, MODELS, model_named

    if args.drive is not None:
        checked_model(args.drive)
    asked = tuple(dict.fromkeys(args.afferent or (EVERY,)))
    classes = observed.afferents if EVERY in asked else asked
    for name in classes:
        observed.of(name)  # refuses one that was not observed
    if EVERY in asked:
        there = tuple(name for name in classes if observed_entries(observed, name, families))
        if there and there != classes:
            lacking = ", ".join(name for name in classes if name not in there)
            log(f"{lacking} left out: no observed rates of family {args.family}")
        classes = there or classes
        if args.drive is not None:
            known = MODELS[args.drive]
            lacking = ", ".join(name for name in classes if name not in known)
            if lacking:
                log(f"{lacking} left out: model {args.drive!r} is of {', '.join(known)}")
            classes = tuple(name for name in classes if name in known)
    try:
        return {name: model_named(args.drive or DEFAULT_MODELS[name], name) for name in classes}
    except ParameterError as error:
        raise UsageError(str(error)) from error


def _print_fit(fit: "Fit") -> None:
    """Print parameters, agreement and the reason of the choice."""
    model, cells = fit.problem.model, fit.problem.cells
    print(
        f"{fit.afferent}, model {model.name}: {len(fit.problem.free)} free parameters, "
        f"{cells} cell{'s' if cells > 1 else ''}"
    )
    for one in fit.problem.free:
        unit = "" if one.unit == "1" else f" {one.unit}"
        print(f"  {one.field} = {getattr(fit.parameters, one.field):.5g}{unit}")
    print(f"  {'':<{_WIDTH}}{'n':>4}{'R²':>8}{'RMSE':>9}{'bias':>9}   impulses/s")
    for row in fit.agreement_rows():
        name = f"{row.family}, {row.group}" if row.group == EVERY else row.group
        if row.family == EVERY:
            name = "all families"
        _print_row(name if row.seen else f"{name}, unseen", row.agreement)
    _print_row("Table 2, all", fit.published.total)
    print(f"  chosen: candidate {fit.choice.row + 1}, {fit.choice.why}")


def _summary_of(fit: "Fit") -> dict[str, Any]:
    """The fit of a class for ``--json``."""
    from dataclasses import asdict

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
                "seen": row.seen,
                **row.agreement.to_row(),
            }
            for row in fit.agreement_rows()
        ],
        "published": fit.published.total.to_row(),
    }


def _print_row(name: str, found: "Agreement") -> None:
    share = found.regression.r_squared
    text = "-" if math.isnan(share) else f"{share:.3f}"
    print(
        f"  {name:<{_WIDTH}}{found.regression.count:>4}{text:>8}"
        f"{found.rmse_ips:>9.2f}{found.bias_ips:>9.2f}"
    )


def models_text() -> str:
    """The table of models: class, equation, free parameters, reason."""
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
            for word, text in (
                ("equation", model.equation),
                ("free", f"{len(model.free())}: {free}"),
                ("cells", str(model.cells)),
                ("reason", model.reason),
            ):
                lines += textwrap.wrap(
                    text, width=88, initial_indent=f"  {word:<10}", subsequent_indent=" " * 12
                )
            lines.append("")
    return "\n".join(lines[:-1])


class _Model(argparse.Action):
    """Name of a model, or print the table of models and end, as --help."""

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
