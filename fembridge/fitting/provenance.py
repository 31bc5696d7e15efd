"""What ``fitted.toml`` tells beside the parameters: how they came about.

No rate, no path, no host and no clock time: the same fit gives the same bytes.
"""

from collections import Counter
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from itertools import chain

from fembridge import __version__
from fembridge.fitting.fit import Fit, FitRun
from fembridge.fitting.judged_rates import AgreementRow, JudgedRates
from fembridge.fitting.response_source import ResponseSource
from fembridge.observed import ObservedRates
from fembridge.typing import Table

_FAMILY_WORDS = {"sine": "sinusoids", "diharm": "diharmonics", "noise": "noises"}


def fit_table(
    run: FitRun,
    observed: ObservedRates,
    source: ResponseSource,
    options: Mapping[str, object] | None = None,
) -> Table:
    """Give the section ``fit`` of a file of fitted parameters.

    Parameters
    ----------
    options
        What was asked for on the command line, without paths.
    """
    settings = run.settings
    table: Table = {
        "source": _source(run),
        "finished": run.finished,
        "seed": settings.seed,
        "evaluations": settings.evaluations,
        "population": settings.population,
        "rule": settings.rule,
        "families": list(settings.families),
        "afferents": [fit.afferent for fit in run.fits],
        "left_out": list(run.asked[len(run.fits) :]),
        "versions": {"fembridge": __version__, **_versions("numpy", "pymoo")},
        "observed": {"file": observed.path.name, "sha256": observed.sha256},
        "response": source.to_table(),
    }
    if options:
        table["options"] = {k: v for k, v in options.items() if v is not None}
    return table | {fit.afferent: _class_table(fit) for fit in run.fits}


def agreement_rows(fit: Fit) -> list[tuple[JudgedRates, AgreementRow]]:
    """Give every row of agreement of a fit, each with the rates it is of."""
    return list(
        chain.from_iterable(((judged, row) for row in judged.rows()) for judged in fit.judged)
    )


def _source(run: FitRun) -> str:
    words = " and ".join(_FAMILY_WORDS[name] for name in run.settings.families)
    classes = ", ".join(fit.afferent for fit in run.fits)
    state = "" if run.finished else ", interrupted"
    return f"fembridge fit: NSGA-II on observed rates of {classes}, {words}{state}"


def _class_table(fit: Fit) -> Table:
    """Give how one class was fitted."""
    drive, free = fit.problem.drive, fit.problem.free
    return {
        "drive": drive.name,
        "equation": drive.equation,
        "stress": drive.quantity,
        "cells": fit.problem.cells,
        "finished": fit.front.finished,
        "evaluations": fit.front.evaluations,
        "front_size": len(fit.front.values),
        "candidate": fit.choice.row + 1,
        "rule": fit.choice.rule,
        "why": fit.choice.why,
        "free_parameters": len(free),
        "free": {
            one.field: {
                "low": one.low,
                "high": one.high,
                "unit": one.unit,
                "scale": "even" if one.even else "logarithmic",
            }
            for one in free
        },
        "observed_rates": {
            "fitted" if judged.seen else "unseen": dict(Counter(judged.groups))
            for judged in fit.judged
        },
        "agreement": [
            {
                "family": row.family,
                "group": row.group,
                "seen": judged.seen,
                "count": row.agreement.regression.count,
                "r_squared": row.agreement.regression.r_squared,
                "rmse_ips": row.agreement.rmse_ips,
                "bias_ips": row.agreement.bias_ips,
            }
            for judged, row in agreement_rows(fit)
        ],
    }


def _versions(*names: str) -> dict[str, str]:
    found = {}
    for name in names:
        try:
            found[name] = version(name)
        except PackageNotFoundError:  # put on the path without being installed
            found[name] = "unknown"
    return found
