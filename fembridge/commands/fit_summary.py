"""What the verb ``fit`` tells of a fit: a table to read, a summary for a program."""

import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fembridge.fitting.fit import Fit
    from neural.agreement import Agreement

_WIDTH = 22


def print_fit(fit: "Fit") -> None:
    """Print parameters, agreement and the reason of the choice."""
    from fembridge.fitting.judged_rates import EVERY
    from fembridge.fitting.provenance import agreement_rows

    drive, cells = fit.problem.drive, fit.problem.cells
    print(
        f"{fit.afferent}, drive {drive.name}: {len(fit.problem.free)} free parameters, "
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

    from fembridge.fitting.provenance import agreement_rows

    return {
        "drive": fit.problem.drive.name,
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
