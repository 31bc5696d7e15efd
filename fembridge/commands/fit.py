"""Find the parameters of afferents whose rates come closest to observed ones.

NSGA-II searches the free parameters of a model; each frequency is an objective.
Written are the Pareto front of each class, the parameters of the candidate that was
taken, with how they came about (fitted.toml, which --parameters takes), the rates
that they give, and a picture of the trade-offs. Ctrl-C keeps the best so far.
"""

import argparse
import math
import textwrap
from typing import TYPE_CHECKING, Any

from fembridge.commands import written
from fembridge.commands.options import (
    NUMBERS,
    STORED_FINGER,
    Several,
    Use,
    add_from,
    add_output_option,
    words_of,
)
from fembridge.interrupt import INTERRUPTED
from fembridge.terminal import Notes, print_table

if TYPE_CHECKING:
    from fembridge.fitting.fit import Fit

EXAMPLE = "fembridge fit --observed rates.csv --afferent RA --seed 1 -o fit"

LIST = "list"
EVERY = "all"

USES = (Use("--spike-distance", "--spikes", lambda args: args.spikes is not None),)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    from fembridge import api
    from neural.fit_problem import DISTANCES
    from neural.models import DEFAULT_MODELS
    from neural.search import EVALUATIONS, POPULATION, RULES

    defaults = ", ".join(f"{model} {name}" for name, model in DEFAULT_MODELS.items())
    rules = "; ".join(f"{name}: {sentence}" for name, sentence in RULES.items())
    add_from(parser, api.fit, "observed")
    add = parser.add_argument
    add(
        "--afferent",
        action=Several,
        choices=("SA", "RA", "PC", EVERY),
        help="default: all that the table and the model have",
    )
    add(
        "--drive",
        action=_Model,
        metavar="NAME",
        help=f"the model whose parameters are searched (default: {defaults}); "
        f"'--drive {LIST}' lists all, with equation and free parameters",
    )
    add_from(parser, api.fit, cells=("N", "of the population (default: the model's own number)"))
    unseen = "stimuli to fit; the others of the table are judged, unseen"
    add_from(parser, api.fit, family=(("sine", "diharm", "noise", EVERY), unseen))
    tried = "candidates that are tried (default: %(default)d)"
    search: dict[str, Any] = {"type": NUMBERS["evaluations"], "metavar": "N"}
    add("--evaluations", **search, default=EVALUATIONS, help=tried)
    generation = "candidates of a generation (default: %(default)d)"
    search["type"] = NUMBERS["population"]
    add("--population", **search, default=POPULATION, help=generation)
    evidence = "fit threshold amplitudes too: thresholds_freeman_johnson_1982, or a table "
    evidence += "afferent,criterion,frequency_hz,amplitude_um"
    trains = "fit spike times too, with a latency: a table "
    trains += "stimulus,afferent,repeat,spike_time_ms"
    held_out = "predict each frequency (each group) by one fit more that did not see it; takes as "
    held_out += "many times as long; `fembridge validate` shows them"
    depth = "depth of the probe before time 0 (default: 0 for published, else as fitted)"
    add_from(
        parser,
        api.fit,
        rule=(tuple(RULES), f"which candidate of the front is taken. {rules}"),
        thresholds=("NAME|FILE.csv", evidence),
        timing="fit the published vector strengths at 20 Hz too (timing_20hz)",
        spikes=("FILE.csv", trains),
        held_out=held_out,
        seed=("N", ""),
        preindent_um=("DEPTH", depth),
        spike_distance=(DISTANCES, "of spike times, both with 5 ms"),
    )
    stress = parser.add_mutually_exclusive_group()
    add_from(stress, api.fit, "response", finger=STORED_FINGER)
    missing = "take a table in which some stimuli have no rate of some class"
    add("--allow-missing", action="store_true", help=missing)
    add_output_option(parser, default="fit")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Fit and write; the summary holds choice, parameters and agreement a class."""
    from fembridge import api
    from fembridge.fitting.fit import PARAMETERS_FILE, PICTURE_FILE, RATES_FILE, SearchBar

    with SearchBar() as bar:
        notes = Notes(bar.print)
        made = api.fit(
            **words_of(args, api.fit),
            afferents=args.afferent,
            complete=not args.allow_missing,
            log=notes,
            on_progress=bar,
        )
        if not made.finished:
            classes = ", ".join(fit.afferent for fit in made.fits)
            notes(f"interrupted: the best so far of {classes} is kept, finished = false")
    files = [PARAMETERS_FILE, *made.front_files, RATES_FILE, PICTURE_FILE]
    for fit in made.fits:
        _print_fit(fit)
    return {
        **written(args.output, files),
        "finished": made.finished,
        "seed": made.settings.seed,
        "rule": made.settings.rule,
        "preindent_um": made.settings.preindent_um,
        "response": made.provenance["response"],
        "notes": notes,
        "afferents": {fit.afferent: _summary_of(fit) for fit in made.fits},
        "exit_code": 0 if made.finished else INTERRUPTED,
    }


def _print_fit(fit: "Fit") -> None:
    """Print parameters, agreement and the reason of the choice."""
    model, cells = fit.problem.model, fit.problem.cells
    print(
        f"{fit.afferent}, model {model.name}: {len(fit.problem.free)} free parameters, "
        f"{cells} cell{'s' if cells > 1 else ''}"
    )
    values = fit.front.candidates[fit.choice.row]
    for one, value in zip(fit.problem.free, values, strict=True):
        print(f"  {one.field} = {value:.5g} {one.unit}".removesuffix(" 1"))
    rows = [(_name_of(row), row) for row in fit.agreement_rows()]
    if fit.held_out:
        rows.append(("each left out", fit.agreement("held_out_ips").to_row()))
    print_table(
        [f"{'':<24}", "n", "R²", "RMSE", "bias", " impulses/s"],
        [
            [
                f"  {name}",
                str(row["count"]),
                "-" if math.isnan(row["r_squared"]) else f"{row['r_squared']:.3f}",
                f"{row['rmse_ips']:.2f}",
                f"{row['bias_ips']:.2f}",
                "",
            ]
            for name, row in [*rows, ("Table 2, all", fit.agreement("published_ips").to_row())]
        ],
    )
    print(f"  chosen: candidate {fit.choice.row + 1}, {fit.choice.why}")


def _name_of(row: dict[str, Any]) -> str:
    """Stimuli of a row of agreement."""
    name = f"{row['family']}, all" if row["group"] == EVERY else row["group"]
    if row["family"] == EVERY:
        name = "all families"
    return name if row["seen"] else f"{name}, unseen"


def _summary_of(fit: "Fit") -> dict[str, Any]:
    """The fit of a class for ``--json``."""
    from dataclasses import asdict

    return {
        "drive": fit.problem.model.name,
        "finished": fit.front.finished,
        "evaluations": fit.front.evaluations,
        "seconds": fit.seconds,
        "front_size": len(fit.front.candidates),
        "candidate": fit.choice.row + 1,
        "why": fit.choice.why,
        "parameters": asdict(fit.parameters),
        "agreement": fit.agreement_rows(),
        "held_out": fit.agreement("held_out_ips").to_row() if fit.held_out else None,
        "published": fit.agreement("published_ips").to_row(),
    }


def models_text() -> str:
    """The table of models: class, equation, free parameters, reason."""
    from neural.models import DEFAULT_MODELS, MODELS

    blocks = []
    for name, rows in MODELS.items():
        for afferent, model in rows.items():
            free = ", ".join(
                f"{one.field} {one.low:g} to {one.high:g} {one.unit}".removesuffix(" 1")
                for one in model.free()
            )
            lines = [
                f"{name}, {afferent}{' (default)' if DEFAULT_MODELS[afferent] == name else ''}"
            ]
            for word, text in (
                ("equation", model.equation),
                ("free", f"{len(model.free())}: {free}"),
                ("cells", str(model.cells)),
                ("reason", model.reason),
            ):
                lines += textwrap.wrap(
                    text, width=88, initial_indent=f"  {word:<10}", subsequent_indent=" " * 12
                )
            blocks.append("\n".join(lines))
    return "\n\n".join(blocks)


class _Model(argparse.Action):
    """Name of a model, or print the table of models and end, as --help."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,  # noqa: ANN401 - as argparse has it
        option_string: str | None = None,
    ) -> None:
        if values == LIST:
            print(models_text())
            parser.exit()
        setattr(namespace, self.dest, values)
