"""Fit the parameters of afferents to observed rates.

NSGA-II searches the free parameters of a model; each frequency is an objective. Files: the
Pareto front of each class, the parameters of the selected candidate with their origin
(fitted.toml, for --parameters), observed and fitted rates, and a picture of the
trade-offs. Ctrl-C keeps the best candidates found so far.
"""

import argparse
import logging
import math
import textwrap
from typing import TYPE_CHECKING, Any

from fembridge.commands import written
from fembridge.commands.options import (
    STORED_FINGER,
    Several,
    Use,
    add_from,
    add_output_option,
    add_pad_probe_options,
    pad_probe_from,
    pad_probe_use,
    words_of,
)
from fembridge.host.interrupt import INTERRUPTED
from fembridge.host.terminal import print_table

if TYPE_CHECKING:
    from fembridge.fitting.fit import ClassFit

_LOGGER = logging.getLogger(__name__)

EXAMPLE = "fembridge fit --observed rates.csv --afferent RA --seed 1 -o fit"

LIST = "list"
ALL = "all"

USES = (
    Use("--spike-distance", "--spikes", lambda args: args.spikes is not None),
    pad_probe_use(),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    from fembridge.fitting.fit import FitTargets, Search, fit
    from neural.fit_problem import DISTANCES
    from neural.models import DEFAULT_MODELS
    from neural.search import RULES

    defaults = ", ".join(f"{model} {name}" for name, model in DEFAULT_MODELS.items())
    rules = "; ".join(f"{name}: {sentence}" for name, sentence in RULES.items())
    add_from(parser, fit, "observed")
    add = parser.add_argument
    add(
        "--afferent",
        action=Several,
        choices=("SA", "RA", "PC", ALL),
        help="default: all classes with rates and a model",
    )
    add(
        "--drive",
        action=_Model,
        metavar="NAME",
        help=f"model whose parameters are searched (default: {defaults}); "
        f"'--drive {LIST}' describes all",
    )
    add_from(parser, fit, cells=("N", "cells of the population (default: the number of the model)"))
    unseen = "stimuli to fit; rates of the others are predicted"
    add_from(parser, fit, family=(("sine", "diharm", "noise", ALL), unseen))
    add_from(
        parser,
        Search,
        evaluations=("N", "candidates evaluated per search"),
        population=("N", "candidates per generation"),
        seed=("N", "seed of the search"),
        rule=(
            "RULE",
            f"rule that selects a candidate of the front, or rules by class, SA=tolerant,"
            f"RA=balanced. {rules}",
        ),
    )
    add_from(
        parser,
        FitTargets,
        thresholds=(
            "NAME|FILE.csv",
            "also fit threshold amplitudes: thresholds_freeman_johnson_1982, or a table "
            "afferent,criterion,frequency_hz,amplitude_um",
        ),
        timing="also fit the published vector strengths at 20 Hz (timing_20hz)",
        spikes=(
            "FILE.csv",
            "also fit spike times, with a latency: a table stimulus,afferent,trial,spike_time_ms",
        ),
        spike_distance=(DISTANCES, "distance of spike times, both with 5 ms"),
    )
    add_from(
        parser,
        fit,
        held_out="also predict each frequency (each group) by a fit without it; takes a "
        "multiple of the time; `fembridge validate` shows the result",
        preindent_um=(
            "DEPTH",
            "depth of the probe before time 0 (default: 0 for published, otherwise as fitted)",
        ),
    )
    stress = parser.add_mutually_exclusive_group()
    add_from(stress, fit, "response", finger=STORED_FINGER)
    add_pad_probe_options(parser, stress)
    add_from(parser, fit, "unit", name=("NAME", "name of the parameter set (default: fit)"))
    missing = "accept stimuli without a rate of some class"
    add("--allow-missing", action="store_true", help=missing)
    add_output_option(parser, default="fit")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Fit and write; the summary holds choice, parameters and agreement per class."""
    from fembridge.fitting.fit import (
        COMPARISON_FILE,
        PARAMETERS_FILE,
        PICTURE_FILE,
        RATES_FILE,
        FitTargets,
        Search,
        SearchBar,
        fit,
    )

    with SearchBar() as bar:
        result = fit(
            **{**words_of(args, fit), "pad": pad_probe_from(args)},
            afferents=args.afferent,
            targets=FitTargets(**words_of(args, FitTargets)),
            search=Search(**words_of(args, Search)),
            complete=not args.allow_missing,
            on_progress=bar,
        )
        if not result.finished:
            _LOGGER.warning(f"interrupted: kept the best candidates of {', '.join(result.fits)}")
    files = [PARAMETERS_FILE, *result.front_files, RATES_FILE, COMPARISON_FILE, PICTURE_FILE]
    for class_fit in result.fits.values():
        _print_fit(class_fit)
    return {
        **written(args.output, files),
        "finished": result.finished,
        "seed": result.settings.search.seed,
        "rule": result.settings.search.rule,
        "preindent_um": result.settings.preindent_um,
        "response": result.provenance["response"],
        "afferents": {name: _summary_of(values) for name, values in result.fits.items()},
        "exit_code": 0 if result.finished else INTERRUPTED,
    }


def _print_fit(class_fit: "ClassFit") -> None:
    """Print parameters, agreement and the reason of the choice."""
    model, cells, free = class_fit.model, class_fit.cells, class_fit.front.free
    print(
        f"{class_fit.afferent}, model {model.name}: {len(free)} free parameters, "
        f"{cells} cell{'s' if cells > 1 else ''}"
    )
    values = class_fit.front.candidates[class_fit.choice.row]
    for parameter, value in zip(free, values, strict=True):
        print(f"  {parameter.field} = {value:.5g} {parameter.unit}".removesuffix(" 1"))
    rows = [(_name_of(row), row) for row in class_fit.agreement_rows()]
    if class_fit.held_out:
        rows.append(("held-out groups", class_fit.agreement("held_out_ips").to_row()))
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
            for name, row in [
                *rows,
                ("Table 2, all", class_fit.agreement("published_ips").to_row()),
            ]
        ],
    )
    print(f"  chosen: candidate {class_fit.choice.row + 1}, {class_fit.choice.why}")


def _name_of(row: dict[str, Any]) -> str:
    """Stimuli of a row of agreement."""
    name = f"{row['family']}, all" if row["group"] == ALL else row["group"]
    if row["family"] == ALL:
        name = "all families"
    return name if row["seen"] else f"{name}, unseen"


def _summary_of(class_fit: "ClassFit") -> dict[str, Any]:
    """The fit of a class for ``--json``."""
    from dataclasses import asdict

    return {
        "drive": class_fit.model.name,
        "finished": class_fit.front.finished,
        "evaluations": class_fit.front.evaluations,
        "seconds": class_fit.seconds,
        "front_size": len(class_fit.front.candidates),
        "candidate": class_fit.choice.row + 1,
        "why": class_fit.choice.why,
        "parameters": asdict(class_fit.parameters),
        "agreement": class_fit.agreement_rows(),
        "held_out": class_fit.agreement("held_out_ips").to_row() if class_fit.held_out else None,
        "published": class_fit.agreement("published_ips").to_row(),
    }


def models_text() -> str:
    """The table of models: class, equation, free parameters, reason."""
    from neural.models import DEFAULT_MODELS, MODELS

    blocks = []
    for name, rows in MODELS.items():
        for afferent, model in rows.items():
            free = ", ".join(
                f"{parameter.field} {parameter.low:g} to {parameter.high:g} "
                f"{parameter.unit}".removesuffix(" 1")
                for parameter in model.free()
            )
            lines = [
                f"{name}, {afferent}{' (default)' if DEFAULT_MODELS[afferent] == name else ''}"
            ]
            for label, text in (
                ("equation", model.equation),
                ("free", f"{len(model.free())}: {free}"),
                ("cells", str(model.cells)),
                ("reason", model.reason),
            ):
                lines += textwrap.wrap(
                    text, width=88, initial_indent=f"  {label:<10}", subsequent_indent=" " * 12
                )
            blocks.append("\n".join(lines))
    return "\n\n".join(blocks)


class _Model(argparse.Action):
    """Name of a model; ``list`` prints the table of models and ends, like --help."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,  # noqa: ANN401 - as in argparse
        option_string: str | None = None,
    ) -> None:
        if values == LIST:
            print(models_text())
            parser.exit()
        setattr(namespace, self.dest, values)
