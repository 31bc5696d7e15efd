"""The files of a fit: a front a class, the parameters, the rates they give."""

import csv
import io
from collections.abc import Mapping
from pathlib import Path

from fembridge.fitting.fit import Fit, FitRun
from fembridge.store import write_text
from fembridge.tables import AFFERENTS, Rate, write_rates
from fembridge.typing import Table
from neural.parameter_file import parameters_to_table
from neural.search import total_rmse_ips

PARAMETERS_FILE = "fitted.toml"
RATES_FILE = "fitted_rates.csv"


def front_file(afferent: str) -> str:
    """Give the name of the file with the front of a class."""
    return f"pareto_{afferent}.csv"


FRONT_FILES = tuple(map(front_file, AFFERENTS))


def write_fit(folder: Path, run: FitRun, name: str, provenance: Table) -> None:
    """Write ``pareto_*.csv``, ``fitted.toml`` and ``fitted_rates.csv`` into `folder`.

    Parameters
    ----------
    name
        What the parameters are called.
    provenance
        The section ``fit`` of the file of parameters; see `fit_table`.

    Raises
    ------
    OutputError
        `folder` cannot be written.
    """
    import tomli_w

    for fit in run.fits:
        write_text(folder / front_file(fit.afferent), front_text(fit))
    write_rates(folder / RATES_FILE, fitted_rates(run))
    table = parameter_table(run, name, provenance)
    write_text(folder / PARAMETERS_FILE, tomli_w.dumps(table))


def parameter_table(run: FitRun, name: str, provenance: Mapping[str, object]) -> Table:
    """Give what ``fitted.toml`` holds: a file of parameters for every verb."""
    parameters = {fit.afferent: fit.parameters for fit in run.fits}
    return {
        "name": name,
        "preindent_um": float(run.settings.preindent_um),
        **parameters_to_table(parameters),
        "fit": dict(provenance),
    }


def fitted_rates(run: FitRun) -> list[Rate]:
    """Give the rates that the chosen candidates predict, of all observed stimuli."""
    return [
        Rate(entry.id, fit.afferent, rate_ips)
        for fit in run.fits
        for judged in fit.judged
        for entry, rate_ips in zip(judged.entries, judged.predicted_ips.tolist(), strict=True)
    ]


def front_text(fit: Fit) -> str:
    """Give a front as CSV: a row a candidate, the smallest total error first.

    Columns are the candidate's number from 1, whether it was chosen, its free
    parameters, the RMSE of each group and that of all stimuli.
    """
    front = fit.front
    out = io.StringIO(newline="")
    table = csv.writer(out, lineterminator="\n")
    groups = [f"rmse_{name.replace(' ', '_')}_ips" for name in front.groups]
    parameters = [one.field for one in front.free]
    table.writerow(["afferent", "candidate", "chosen", *parameters, *groups, "rmse_all_ips"])
    totals = total_rmse_ips(fit.problem, front.errors_ips2).tolist()
    values, rmse = front.values.tolist(), (front.errors_ips2**0.5).tolist()
    for row, total in enumerate(totals):
        chosen = "yes" if row == fit.choice.row else "no"
        table.writerow([fit.afferent, row + 1, chosen, *values[row], *rmse[row], total])
    return out.getvalue()
